"""The parts of the range campaign as points: what each varies, and over which ground."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from typing import TYPE_CHECKING

import numpy as np
from msgspec import structs

from belahil.chunks import Chunk
from procedures.range_budget import budget_points
from procedures.range_chunks import curve_chunk
from procedures.range_ground import fractal_chunks
from procedures.range_points import Point, noise_chunks
from procedures.range_scenes import (
    ALTITUDES_M,
    DISTANCES_AU,
    SLOPES_DEG,
    Condition,
    base_scene,
    conditions,
    noise_scene,
)
from procedures.range_variants import bias_points, column_points, ladder_points
from sim.scene import as_toml

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from procedures.campaign_range import RangeOptions

PARTS = ("table", "altitude", "map", "budget", "ladder", "bias", "columns")

STUDY_ALTITUDES_M = tuple(100e3 * n for n in range(4, 16))
HISTOGRAM_ALTITUDES_M = (500e3, 1000e3, 1500e3)
_HISTOGRAM_SETS = 4
MAP_SLOPES_DEG = tuple(5.0 * n for n in range(9))
_MAP_HALF_DEG = 1.5
"""Footprints of a map have its slope within so much."""
_SHARE_OF_SETS = {500e3: 0.375}
"""Of the table's: where all echoes are detected, fewer tell the same."""
_SHARES = {
    (500e3, "day", 0.08): 0.3,
    (500e3, "day", 0.17): 0.3,
    (500e3, "day", 0.30): 0.6,
    (500e3, "night", 0.08): 0.3,
    (500e3, "night", 0.17): 0.6,
    (800e3, "day", 0.30): 0.2,
    (800e3, "night", 0.08): 0.8,
    (800e3, "night", 0.17): 0.2,
    (800e3, "night", 0.30): 0.3,
    (1100e3, "day", 0.17): 0.6,
    (1100e3, "day", 0.30): 0.5,
    (1100e3, "night", 0.08): 0.7,
    (1100e3, "night", 0.17): 0.5,
    (1100e3, "night", 0.30): 0.3,
    (1400e3, "day", 0.17): 0.8,
    (1400e3, "day", 0.30): 0.6,
    (1400e3, "night", 0.17): 0.5,
    (1400e3, "night", 0.30): 0.4,
}
"""Part of those sets that brings the errors of a cell to 1 % as well, from the pace at which they fall; 1 for
the others. It spends work where it is needed, and changes no result but by chance."""
_AT_PERIHELION = 1.5
_MAP_SHARE = 4
"""Of the echoes that other parts have."""
_SETS_APART = 0x10000
"""Between the seeds of parts: none shares the places and the noise of another."""
_LEVELS = 8
SHOTS_IN_CHUNK = 500
"""Whole shots on each terrain at most, some 3 s of work: memory does not grow with the number of shots."""


def points(options: RangeOptions) -> Iterator[Point]:
    """Return the points of the parts that are asked for."""
    made = {
        "table": _table,
        "altitude": _altitude,
        "map": _map,
        "budget": budget_points,
        "ladder": ladder_points,
        "bias": bias_points,
        "columns": column_points,
    }
    for number, part in enumerate(PARTS):
        if part in options.parts:
            for point in made[part](options, options.seed + _SETS_APART * number):
                yield replace(point, definitions=options.definitions)


def shared_chunks(every: Sequence[Point]) -> list[Chunk]:
    """Return the work that many chunks of points share: made once, where all workers reach the results.

    First comes the correction that most need, then the fractals. Corrections that few need are not in it.
    """
    grounds = [point.ground for point in every if point.ground.kind == "fractal"]
    made = dict.fromkeys((ground.seed, ground.hurst) for ground in grounds)
    scene = next((point.scene for point in every if point.scene.filter != "gaussian"), None)
    curve = [] if scene is None else [curve_chunk(scene)]
    return [*curve, *(chunk for one in made for chunk in fractal_chunks(*one))]


def levels_chunks(every: Sequence[Point], windows: int, seed: int) -> list[Chunk]:
    """Return the work of the law of noise peaks for all that some points meet."""
    receivers: dict[str, tuple[Point, set[float], set[float]]] = {}
    for point in every:
        key = as_toml(noise_scene(point.scene))
        _, exact, between = receivers.setdefault(key, (point, set(), set()))
        levels = {one.noise_rms_v for one in point.conditions}
        (exact if point.part == "table" else between).update(levels)
    chunks = []
    for number, (point, exact, between) in enumerate(receivers.values()):
        if len(between) > _LEVELS:
            between = set(np.geomspace(min(between), max(between), _LEVELS).tolist())
        chunks += noise_chunks(point.scene, sorted(exact | between), windows, seed, number)
    return chunks


def _table(options: RangeOptions, seed: int) -> Iterator[Point]:
    every = conditions(base_scene(), distances=tuple(DISTANCES_AU))
    for altitude_m in ALTITUDES_M:
        yield Point(
            part="table",
            label=f"{altitude_m / 1e3:g} km",
            scene=base_scene(altitude_m),
            conditions=every,
            echoes=options.echoes,
            repeats=options.repeats,
            sets=math.ceil(_SHARE_OF_SETS.get(altitude_m, 1.0) * options.sets),
            seed=seed,
            ground=options.ground,
            shares=tuple(_share(altitude_m, one) for one in every),
        )


def _share(altitude_m: float, condition: Condition) -> float:
    """What of the sets a cell needs: more of them for the Sun at perihelion, whose noise is higher."""
    share = _SHARES.get((altitude_m, condition.light, condition.reflectance), 1.0)
    return share if condition.distance == "mean" else min(1.0, _AT_PERIHELION * share)


def _altitude(options: RangeOptions, seed: int) -> Iterator[Point]:
    for altitude_m in STUDY_ALTITUDES_M:
        yield Point(
            part="altitude",
            label=f"{altitude_m / 1e3:g} km",
            scene=base_scene(altitude_m),
            conditions=conditions(base_scene()),
            echoes=options.study_echoes,
            repeats=options.repeats,
            # Tails of a distribution need more.
            sets=_HISTOGRAM_SETS if altitude_m in HISTOGRAM_ALTITUDES_M else 1,
            seed=seed,
            ground=options.ground,
        )


def _map(options: RangeOptions, seed: int) -> Iterator[Point]:
    # Altitude by altitude: slopes share what lies under a beam.
    for altitude_m in STUDY_ALTITUDES_M:
        for slope_deg in MAP_SLOPES_DEG:
            yield Point(
                part="map",
                label=f"{slope_deg:g} deg, {altitude_m / 1e3:g} km",
                scene=base_scene(altitude_m),
                conditions=conditions(base_scene()),
                echoes=max(1, options.study_echoes // _MAP_SHARE),
                repeats=options.repeats,
                sets=1,
                seed=seed,
                ground=replace(options.ground, tilt_deg=slope_deg),
                slopes_deg=(max(0.0, slope_deg - _MAP_HALF_DEG), slope_deg + _MAP_HALF_DEG),
            )


def brute_chunks(options: RangeOptions, seed: int) -> list[Chunk]:
    """Return whole shots of the cells of the table at mean distance, each cell on its own, in equal parts."""
    chunks, scene = [], base_scene()
    parts = -(-options.shots // SHOTS_IN_CHUNK)
    for altitude_m in ALTITUDES_M:
        text = as_toml(structs.replace(scene, altitude_m=altitude_m))
        for one in conditions(scene):
            given = {
                "scene": text,
                "ground": asdict(options.ground),
                "slopes_deg": list(SLOPES_DEG),
                "condition": asdict(one),
                "seed": seed,
                "definitions": asdict(options.definitions),
            }
            name = f"shots from {altitude_m / 1e3:g} km, {one.light}, reflectance {one.reflectance:g}"
            for number in range(parts):
                own = {"number": number, "count": (options.shots + number) // parts}
                chunks.append(
                    Chunk(f"{name}, set {number}", "procedures.range_chunks:whole_shots", given | own)
                )
    return chunks
