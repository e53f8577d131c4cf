"""Campaign: errors of ranges and probability of false detection, by altitude, reflectance, day and night."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from msgspec import structs

from belahil.campaign_run import CampaignPlan
from belahil.chunks import Chunk
from belahil.errors import RefusedInput
from procedures.range_scenes import (
    ALTITUDES_M,
    DISTANCES_AU,
    SLOPES_DEG,
    base_scene,
    conditions,
)
from sim.scene import as_toml

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.outcome import Outcome

_WINDOWS_IN_CHUNK = 250
_NOISE_SEED, _SHOT_SEED = 0x6E6F, 0x7368
"""Added to the seed of draws, so that noise windows and whole shots have numbers of their own."""


@dataclass(frozen=True, slots=True)
class RangeOptions:
    """What a user may choose.

    Parameters
    ----------
    echoes : int
        On each of the eleven terrains, in each of `sets` sets.
    repeats : int
        Shots drawn about each echo, with noise of their own.
    sets : int
        Chunks of echoes for each altitude.
    noise_windows : int
        Windows of noise for the law of its peaks.
    shots : int
        Whole shots on each terrain in each cell, by brute force; 0: none.
    seed : int
        Of all draws; the ground has one of its own.
    ground_seed : int
        Of the fractals.

    Raises
    ------
    RefusedInput
        A number below what statistics need.
    """

    echoes: int = 60
    repeats: int = 6
    sets: int = 6
    noise_windows: int = 2000
    shots: int = 100
    seed: int = 1
    ground_seed: int = 100

    def __post_init__(self) -> None:
        for name, least in (
            ("echoes", 1),
            ("repeats", 1),
            ("sets", 1),
            ("noise_windows", 20),
            ("shots", 0),
            ("seed", 0),
            ("ground_seed", 0),
        ):
            if getattr(self, name) < least:
                raise RefusedInput(
                    f"--{name.replace('_', '-')} {getattr(self, name)}: at least {least} is needed"
                )


def plan(options: RangeOptions) -> CampaignPlan:
    """Plan the chunks of the headline table."""
    scene = base_scene()
    every = conditions(scene, distances=tuple(DISTANCES_AU))
    levels_v = sorted({one.noise_rms_v for one in every})
    ground = {"ground": "fractal", "ground_seed": options.ground_seed, "slopes_deg": list(SLOPES_DEG)}
    chunks = []
    for first in range(0, options.noise_windows, _WINDOWS_IN_CHUNK):
        given: dict[str, Any] = {
            "scene": as_toml(scene),
            "noise_rms_v": levels_v,
            "windows": min(_WINDOWS_IN_CHUNK, options.noise_windows - first),
            "seed": options.seed + _NOISE_SEED,
            "first": first,
        }
        chunks.append(Chunk(f"noise from window {first}", "procedures.range_chunks:noise_peaks", given))
    for altitude_m in ALTITUDES_M:
        text = as_toml(structs.replace(scene, altitude_m=altitude_m))
        for number in range(options.sets):
            given = {"scene": text, **ground, "conditions": [asdict(one) for one in every]}
            given |= {
                "count": options.echoes,
                "repeats": options.repeats,
                "seed": options.seed,
                "number": number,
            }
            name = f"echoes from {altitude_m / 1e3:g} km, set {number}"
            chunks.append(Chunk(name, "procedures.range_chunks:echo_draws", given))
    if options.shots:
        chunks += _brute_chunks(options, ground)
    return CampaignPlan(
        tuple(chunks),
        as_toml(scene),
        options.seed,
        {"laser": "bela", "detector": "bela", "receiver": "bela-grm"},
    )


def _brute_chunks(options: RangeOptions, ground: dict[str, Any]) -> list[Chunk]:
    scene, chunks = base_scene(), []
    for altitude_m in ALTITUDES_M:
        text = as_toml(structs.replace(scene, altitude_m=altitude_m))
        for one in conditions(scene):
            given = {"scene": text, **ground, "condition": asdict(one), "count": options.shots}
            given |= {"seed": options.seed + _SHOT_SEED, "number": 0}
            name = f"shots from {altitude_m / 1e3:g} km, {one.light}, reflectance {one.reflectance:g}"
            chunks.append(Chunk(name, "procedures.range_chunks:whole_shots", given))
    return chunks


def analyse(plan: CampaignPlan, results: list[dict[str, NDArray[Any]]]) -> Outcome:
    """Make the outcome of the chunks' results."""
    from procedures.range_outcome import outcome
    from procedures.range_table import headline

    return outcome(headline(plan, results))
