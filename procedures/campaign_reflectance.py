"""Campaign: which kinds of ground return pulses tell apart, from how high and with how many shots."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from belahil.campaign_run import CampaignPlan
from belahil.errors import RefusedInput
from procedures.energy_parts import (
    MAIN_DEG,
    Sampling,
    calibration_chunks,
    read_results,
    refuse_few,
    slope_point,
)
from procedures.range_ground import GroundKey
from procedures.range_parts import levels_chunks, shared_chunks
from procedures.range_scenes import DISTANCES_AU, base_scene, conditions
from procedures.reflectance_kinds import KINDS
from sim.scene import as_toml

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.outcome import Outcome
    from procedures.range_points import Point

STUDY_ALTITUDES_M = tuple(100e3 * n for n in range(2, 16))
"""From 200 km, to which the periapsis may fall."""

_NOISE_SEED, _OWN_SEED = 0x6E6F0000, 0x20000
_LEAST = {
    "echoes": 1,
    "repeats": 1,
    "sets": 1,
    "noise_windows": 20,
    "calibration_echoes": 1,
    "seed": 0,
    "ground_seed": 0,
}


@dataclass(frozen=True, slots=True)
class ReflectanceOptions:
    """What a user may choose.

    Parameters
    ----------
    echoes, sets : int
        On each of the eleven terrains, in each of `sets` sets at each altitude.
    repeats : int
        Shots drawn about each echo, with noise of their own.
    noise_windows : int
        Windows of noise for the law of its peaks.
    calibration_echoes : int
        Without noise, on each terrain at each altitude and slope.
    sun : str
        "mean" or "perihelion": distance of the Sun, for the days and for the dark noise.
    seed, ground_seed : int
        Of all draws; of the fractals.

    Raises
    ------
    RefusedInput
        A number below what statistics need, or another distance.
    """

    echoes: int = 40
    repeats: int = 6
    sets: int = 2
    noise_windows: int = 1000
    calibration_echoes: int = 20
    sun: str = "mean"
    seed: int = 1
    ground_seed: int = 100

    def __post_init__(self) -> None:
        refuse_few(self, _LEAST)
        if self.sun not in DISTANCES_AU:
            raise RefusedInput(f"--sun {self.sun}: allowed are {', '.join(DISTANCES_AU)}")

    @property
    def ground(self) -> GroundKey:
        """The eleven fractals."""
        return GroundKey(seed=self.ground_seed)


def plan(options: ReflectanceOptions) -> CampaignPlan:
    """Plan the chunks: noise, calibration, and draws about echoes by altitude."""
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


def points(options: ReflectanceOptions) -> list[Point]:
    """Return the points: all kinds of ground by day and by night, slopes of 10 degrees."""
    every = conditions(base_scene(), tuple(KINDS.values()), (options.sun,))
    how = Sampling(options.echoes, options.repeats, options.sets, options.seed + _OWN_SEED, options.ground)
    return [slope_point("reflectance", altitude_m, MAIN_DEG, every, how) for altitude_m in STUDY_ALTITUDES_M]


def analyse(plan: CampaignPlan, results: list[dict[str, NDArray[Any]]]) -> Outcome:
    """Make the outcome of the chunks' results."""
    from procedures.campaign_reflectance_outcome import outcome

    return outcome(*read_results(plan, results))
