"""Campaign: errors of the energy of return pulses, by altitude, reflectance, slope, day and night."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from belahil.campaign_run import CampaignPlan
from procedures.energy_parts import (
    MAIN_DEG,
    SLOPES_DEG,
    Sampling,
    calibration_chunks,
    read_results,
    refuse_few,
    slope_point,
)
from procedures.range_ground import GroundKey
from procedures.range_parts import STUDY_ALTITUDES_M, levels_chunks, shared_chunks
from procedures.range_scenes import DISTANCES_AU, base_scene, conditions
from sim.scene import as_toml

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.outcome import Outcome
    from procedures.range_points import Point

_NOISE_SEED, _SLOPE_SEED = 0x6E6F0000, 0x10000
"""Added to the seed of draws, so that noise windows and other slopes have draws of their own."""
_LEAST = {
    "echoes": 1,
    "slope_echoes": 1,
    "repeats": 1,
    "sets": 1,
    "noise_windows": 20,
    "calibration_echoes": 1,
    "seed": 0,
    "ground_seed": 0,
}


@dataclass(frozen=True, slots=True)
class EnergyErrorOptions:
    """What a user may choose.

    Parameters
    ----------
    echoes, slope_echoes : int
        On each of the eleven terrains, in each of `sets` sets: at slopes of 10 degrees, and in one set at
        each other slope.
    repeats : int
        Shots drawn about each echo, with noise of their own.
    sets : int
        Chunks of echoes for each altitude.
    noise_windows : int
        Windows of noise for the law of its peaks.
    calibration_echoes : int
        Without noise, on each terrain at each altitude and slope.
    seed, ground_seed : int
        Of all draws; of the fractals.

    Raises
    ------
    RefusedInput
        A number below what statistics need.
    """

    echoes: int = 40
    slope_echoes: int = 24
    repeats: int = 6
    sets: int = 2
    noise_windows: int = 1000
    calibration_echoes: int = 20
    seed: int = 1
    ground_seed: int = 100

    def __post_init__(self) -> None:
        refuse_few(self, _LEAST)

    @property
    def ground(self) -> GroundKey:
        """The eleven fractals."""
        return GroundKey(seed=self.ground_seed)


def plan(options: EnergyErrorOptions) -> CampaignPlan:
    """Plan the chunks: noise, calibration, and draws about echoes by altitude and slope."""
    every = points(options)
    chunks = shared_chunks(every) + levels_chunks(every, options.noise_windows, options.seed + _NOISE_SEED)
    chunks += calibration_chunks(options.calibration_echoes, options.seed, options.ground)
    for point in every:
        chunks += point.chunks()
    return CampaignPlan(
        tuple(chunks),
        as_toml(base_scene()),
        options.seed,
        {"laser": "bela", "detector": "bela", "receiver": "bela-grm"},
    )


def points(options: EnergyErrorOptions) -> list[Point]:
    """Return the points: slopes of 10 degrees with the Sun at both distances, and the others."""
    scene = base_scene()
    main = Sampling(options.echoes, options.repeats, options.sets, options.seed, options.ground)
    other = replace(main, echoes=options.slope_echoes, sets=1, seed=options.seed + _SLOPE_SEED)
    both, mean = conditions(scene, distances=tuple(DISTANCES_AU)), conditions(scene)
    found = []
    for slope_deg in (MAIN_DEG, *(one for one in SLOPES_DEG if one != MAIN_DEG)):
        for altitude_m in STUDY_ALTITUDES_M:
            if slope_deg == MAIN_DEG:
                found.append(slope_point("energy", altitude_m, slope_deg, both, main))
            else:
                found.append(slope_point("energy", altitude_m, slope_deg, mean, other))
    return found


def analyse(plan: CampaignPlan, results: list[dict[str, NDArray[Any]]]) -> Outcome:
    """Make the outcome of the chunks' results."""
    from procedures.campaign_energy_outcome import outcome

    return outcome(*read_results(plan, results))
