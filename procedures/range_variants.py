"""Variants of scene and ground: from an earlier model to this one, bias and temperature, other ground.

The ladder begins at the ready preset ``previous-model``: Gaussian pulse and filter, a gain 25 % higher, on a
plane. The paper names four improvements; each is switched on beside those before it. Its spatial profile has
no public numbers: the beam is Gaussian throughout, and the fourth rung is that the beam wanders. Last comes
the Butterworth filter, which the paper counts to the first three.

With the bias, and with the temperature of the photodiode, its gain follows Miller's equation. The dark noise
is left as it is: which part of it the photodiode multiplies is not known.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from msgspec import structs

from procedures.range_ground import MODEL, GroundKey, flat_terrains
from procedures.range_points import Point
from procedures.range_scenes import ALTITUDES_M, MEAN_REFLECTANCE, base_scene, conditions
from procedures.study_ground import LEVELS, digest
from sim.presets import detector_preset, laser_preset

if TYPE_CHECKING:
    from collections.abc import Iterator

    from procedures.campaign_range import RangeOptions
    from sim.scene import Scene

LADDER = (
    "previous model",
    "+ gain 20 % lower",
    "+ pulse with a tail",
    "+ fractal ground",
    "+ wandering beam",
    "+ Butterworth filter",
)
BIASES_V = tuple(300.0 + 10.0 * n for n in range(8))
TEMPERATURES_C = (0.0, 10.0, 20.0, 30.0, 40.0)
BIAS_ALTITUDES_M = (800e3, 1100e3, 1400e3)
COLUMNS = ("fractals", "planes", "terrain model")
_NOMINAL_V, _NOMINAL_C = 320.0, 20.0


def ladder_points(options: RangeOptions, seed: int) -> Iterator[Point]:
    """Return the rungs at each altitude."""
    for altitude_m in ALTITUDES_M:
        for rung, label in enumerate(LADDER):
            scene = rung_scene(altitude_m, rung)
            flat = rung < LADDER.index("+ fractal ground")
            yield Point(
                part="ladder",
                label=f"{altitude_m / 1e3:g} km, {label}",
                scene=scene,
                conditions=conditions(scene),
                echoes=options.study_echoes * (LEVELS if flat else 1),
                repeats=options.repeats,
                sets=1,
                seed=seed,
                ground=replace(options.ground, kind="plane") if flat else options.ground,
            )


def rung_scene(altitude_m: float, rung: int) -> Scene:
    """Return the scene of a rung; the last is the campaign's own."""
    scene = base_scene(altitude_m)
    laser, detector = scene.laser, scene.detector
    if rung < 1:
        detector = detector_preset("previous-model")
    if rung < 2:
        laser = laser_preset("previous-model")
    if rung < 4:
        laser = structs.replace(laser, jitter_rad=(0.0, 0.0))
    return structs.replace(
        scene, laser=laser, detector=detector, filter="gaussian" if rung < 5 else "butterworth"
    )


def bias_points(options: RangeOptions, seed: int) -> Iterator[Point]:
    """Return biases at the nominal temperature, and temperatures at the nominal bias."""
    settings = [(bias_v, _NOMINAL_C) for bias_v in BIASES_V]
    settings += [(_NOMINAL_V, one) for one in TEMPERATURES_C if one != _NOMINAL_C]
    for altitude_m in BIAS_ALTITUDES_M:
        for bias_v, celsius in settings:
            scene = base_scene(altitude_m)
            detector = structs.replace(scene.detector, bias_v=bias_v, apd_temperature_c=celsius)
            scene = structs.replace(scene, detector=detector)
            yield Point(
                part="bias",
                label=f"{altitude_m / 1e3:g} km, {bias_v:g} V, {celsius:g} C",
                scene=scene,
                conditions=conditions(scene, (MEAN_REFLECTANCE,)),
                echoes=options.study_echoes,
                repeats=options.repeats,
                sets=1,
                seed=seed,
                ground=options.ground,
                tilt=1.0,
            )


def column_points(options: RangeOptions, seed: int) -> Iterator[Point]:
    """Return other ground with the same slopes: planes, and a terrain model where one is given."""
    plane = replace(options.ground, kind="plane")
    grounds, every = {COLUMNS[1]: (plane, 1)}, options.study_echoes * LEVELS
    if options.terrain is not None:
        model = GroundKey(MODEL + options.terrain, tilt_deg=10.0, digest=digest(options.terrain))
        grounds[COLUMNS[2]] = model, len(flat_terrains(model.kind, model.seed, model.factor))
    for altitude_m in ALTITUDES_M:
        for label, (ground, terrains) in grounds.items():
            yield Point(
                part="columns",
                label=f"{altitude_m / 1e3:g} km, {label}",
                scene=base_scene(altitude_m),
                conditions=conditions(base_scene()),
                echoes=math.ceil(every / terrains),
                repeats=options.repeats,
                sets=1,
                seed=seed,
                ground=ground,
            )
