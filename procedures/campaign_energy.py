"""Campaign: errors of the energy of return pulses, by altitude, reflectance, slope, day and night."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from procedures.campaign_options import refuse_few
from procedures.echo_options import EchoOptions, echo_plan
from procedures.energy_parts import MAIN_DEG, SLOPES_DEG, Sampling, read_results, slope_point
from procedures.range_parts import STUDY_ALTITUDES_M
from procedures.range_scenes import DISTANCES_AU, base_scene, conditions

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.campaign_run import CampaignPlan
    from belahil.outcome import Outcome
    from procedures.range_points import Point

_SLOPE_SEED = 0x10000
"""Added to the seed of draws, so that other slopes have draws of their own."""


@dataclass(frozen=True, slots=True)
class EnergyErrorOptions(EchoOptions):
    """What a user may choose.

    Parameters
    ----------
    echoes, sets
        As in `EchoOptions`, at slopes of 10 degrees.
    slope_echoes : int
        On each terrain at each other slope, in one set.
    repeats, noise_windows, calibration_echoes, seed, ground_seed
        As in `EchoOptions`.

    Raises
    ------
    RefusedInput
        A number below what statistics need.
    """

    slope_echoes: int = 24

    def __post_init__(self) -> None:
        EchoOptions.__post_init__(self)
        refuse_few(self, {"slope_echoes": 1})


def plan(options: EnergyErrorOptions) -> CampaignPlan:
    """Plan the chunks: noise, calibration, and draws about echoes by altitude and slope."""
    return echo_plan(options, points(options))


def points(options: EnergyErrorOptions) -> list[Point]:
    """Return the points: slopes of 10 degrees with the Sun at both distances, and the others.

    Altitude by altitude, since slopes share what lies under a beam.
    """
    scene = base_scene()
    main = Sampling(options.echoes, options.repeats, options.sets, options.seed, options.ground)
    other = replace(main, echoes=options.slope_echoes, sets=1, seed=options.seed + _SLOPE_SEED)
    both, mean = conditions(scene, distances=tuple(DISTANCES_AU)), conditions(scene)
    found = []
    for altitude_m in STUDY_ALTITUDES_M:
        for slope_deg in SLOPES_DEG:
            if slope_deg == MAIN_DEG:
                found.append(slope_point("energy", altitude_m, slope_deg, both, main))
            else:
                found.append(slope_point("energy", altitude_m, slope_deg, mean, other))
    return found


def analyse(plan: CampaignPlan, results: list[dict[str, NDArray[Any]]]) -> Outcome:
    """Make the outcome of the chunks' results."""
    from procedures.campaign_energy_outcome import outcome

    return outcome(*read_results(plan, results))
