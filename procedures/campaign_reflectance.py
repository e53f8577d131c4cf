"""Campaign: which kinds of ground return pulses tell apart, from how high and with how many shots."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from belahil.errors import RefusedInput
from procedures.echo_options import EchoOptions, echo_plan
from procedures.energy_parts import MAIN_DEG, Sampling, read_results, slope_point
from procedures.range_scenes import DISTANCES_AU, base_scene, conditions
from procedures.reflectance_kinds import KINDS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.campaign_run import CampaignPlan
    from belahil.outcome import Outcome
    from procedures.range_points import Point

STUDY_ALTITUDES_M = tuple(100e3 * n for n in range(2, 16))
"""From 200 km, to which the periapsis may fall."""

_OWN_SEED = 0x20000
"""Added to the seed of draws, so that no other campaign shares them."""


@dataclass(frozen=True, slots=True)
class ReflectanceOptions(EchoOptions):
    """What a user may choose.

    Parameters
    ----------
    echoes, repeats, sets, noise_windows, calibration_echoes, seed, ground_seed
        As in `EchoOptions`.
    sun : str
        "mean" or "perihelion": distance of the Sun, for the days and for the dark noise.

    Raises
    ------
    RefusedInput
        A number below what statistics need, or another distance.
    """

    sun: str = "mean"

    def __post_init__(self) -> None:
        EchoOptions.__post_init__(self)
        if self.sun not in DISTANCES_AU:
            raise RefusedInput(f"--sun {self.sun}: allowed are {', '.join(DISTANCES_AU)}")


def plan(options: ReflectanceOptions) -> CampaignPlan:
    """Plan the chunks: noise, calibration, and draws about echoes by altitude."""
    return echo_plan(options, points(options))


def points(options: ReflectanceOptions) -> list[Point]:
    """Return the points: all kinds of ground by day and by night, slopes of 10 degrees."""
    every = conditions(base_scene(), tuple(KINDS.values()), (options.sun,))
    how = Sampling(options.echoes, options.repeats, options.sets, options.seed + _OWN_SEED, options.ground)
    return [slope_point("reflectance", altitude_m, MAIN_DEG, every, how) for altitude_m in STUDY_ALTITUDES_M]


def analyse(plan: CampaignPlan, results: list[dict[str, NDArray[Any]]]) -> Outcome:
    """Make the outcome of the chunks' results."""
    from procedures.campaign_reflectance_outcome import outcome

    return outcome(*read_results(plan, results))
