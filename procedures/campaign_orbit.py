"""Campaign: which part of an orbit's time gives good ranges, by reflectance, slope, day and night."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from belahil.campaign_run import CampaignPlan
from belahil.errors import RefusedInput
from procedures.campaign_options import refuse_few, refuse_outside
from procedures.energy_parts import read_results
from procedures.orbit_points import SLOPES_DEG, orbit_chunks
from procedures.range_ground import GroundKey
from procedures.range_scenes import DISTANCES_AU, REFLECTANCES, base_scene
from sim.orbit import Orbit
from sim.scene import as_toml

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.outcome import Outcome

NOMINAL, DRIFTED, LOWERED = "nominal", "lowered, same period", "lowered, same apoapsis"
LOWERED_KM = 200.0
"""To which the periapsis may fall in the extended mission (paper)."""
LOWEST_KM, HIGHEST_KM = 150.0, 3000.0
"""Below, an echo of bright ground reaches the end of the converter's span; above, hardly anything is seen."""
_LEAST = {
    "echoes": 1,
    "repeats": 1,
    "noise_windows": 20,
    "calibration_echoes": 1,
    "seed": 0,
    "ground_seed": 0,
}


@dataclass(frozen=True, slots=True)
class OrbitOptions:
    """What a user may choose.

    Parameters
    ----------
    periapsis_km, apoapsis_km : float
        Altitudes of the nominal orbit, km.
    lowered_periapsis_km : float or None
        Of the extended mission, km, below the nominal one; None: 200 where that is lower.
    limits_km : tuple of float
        Altitudes up to which the laser may be fired, km.
    rate_hz : float
        Shots per second.
    reflectances : tuple of float
        Of the ground.
    slopes_deg : tuple of float
        Of the planes under the footprints, 0 to 60.
    sun : str
        "mean" or "perihelion": distance of the Sun, by day and in the dark noise that the text implies.
    periapsis_latitude_deg : float
        Where the periapsis of the polar orbit is; for the mean over local times alone.
    step_km : float
        Between altitudes that are computed.
    echoes, repeats : int
        On each terrain at each altitude and slope; shots about each.
    noise_windows : int
        For the law of noise peaks.
    calibration_echoes : int
        Without noise, on each terrain at each altitude and slope: they calibrate the energy.
    seed, ground_seed : int
        Of all draws; of the fractals.

    Raises
    ------
    RefusedInput
        A number outside of its range.
    """

    periapsis_km: float = 480.0
    apoapsis_km: float = 1500.0
    lowered_periapsis_km: float | None = None
    limits_km: tuple[float, ...] = (1050.0, 1400.0)
    rate_hz: float = 10.0
    reflectances: tuple[float, ...] = REFLECTANCES
    slopes_deg: tuple[float, ...] = SLOPES_DEG
    sun: str = "mean"
    periapsis_latitude_deg: float = 0.0
    step_km: float = 100.0
    echoes: int = 48
    repeats: int = 3
    noise_windows: int = 2000
    calibration_echoes: int = 20
    seed: int = 1
    ground_seed: int = 100

    def __post_init__(self) -> None:
        refuse_few(self, _LEAST)
        if self.sun not in DISTANCES_AU:
            raise RefusedInput(f"--sun {self.sun}: allowed are {', '.join(DISTANCES_AU)}")
        refuse_outside("rate-hz", (self.rate_hz,), 1e-3, 1e3)
        refuse_outside("limits-km", self.limits_km, LOWEST_KM, HIGHEST_KM)
        refuse_outside("reflectances", self.reflectances, 1e-3, 1.0)
        refuse_outside("slopes-deg", self.slopes_deg, 0.0, 60.0)
        refuse_outside("periapsis-latitude-deg", (self.periapsis_latitude_deg,), -90.0, 90.0)
        refuse_outside("step-km", (self.step_km,), 5.0, 500.0)
        if not (self.reflectances and self.slopes_deg):
            raise RefusedInput("--reflectances and --slopes-deg: at least one number each is needed")
        lowered = self.lowered_periapsis_km
        if lowered is not None and not lowered < self.periapsis_km:
            raise RefusedInput(
                f"--lowered-periapsis-km {lowered:g}: must be below the nominal one, {self.periapsis_km:g} km"
            )
        for orbit in self.orbits().values():
            refuse_outside("periapsis-km", (orbit.periapsis_m / 1e3,), LOWEST_KM, HIGHEST_KM)
            refuse_outside("apoapsis-km", (orbit.apoapsis_m / 1e3,), LOWEST_KM, HIGHEST_KM)

    def orbits(self) -> dict[str, Orbit]:
        """Return the nominal orbit and, where there is one, what becomes of it when the periapsis falls.

        The eccentricity grows by the pull of the Sun, which leaves the period, and so the semi-major axis:
        the apoapsis rises by as much. Beside it the apoapsis is held, as a manoeuvre could.
        """
        nominal = Orbit(1e3 * self.periapsis_km, 1e3 * self.apoapsis_km)
        lowered_km = LOWERED_KM if self.lowered_periapsis_km is None else self.lowered_periapsis_km
        if not lowered_km < self.periapsis_km:
            return {NOMINAL: nominal}
        fallen_m = nominal.periapsis_m - 1e3 * lowered_km
        return {
            NOMINAL: nominal,
            DRIFTED: Orbit(1e3 * lowered_km, nominal.apoapsis_m + fallen_m),
            LOWERED: Orbit(1e3 * lowered_km, nominal.apoapsis_m),
        }

    @property
    def altitudes_m(self) -> tuple[float, ...]:
        """Altitudes that are computed: those at the ends of the orbits, and whole steps between."""
        ends = [end for orbit in self.orbits().values() for end in (orbit.periapsis_m, orbit.apoapsis_m)]
        low, high, step_m = min(ends), max(ends), 1e3 * self.step_km
        whole = [step_m * n for n in range(math.ceil(low / step_m), math.floor(high / step_m) + 1)]
        inside = [one for one in whole if low + step_m / 5 < one < high - step_m / 5]
        return tuple(sorted({low, *inside, high}))

    @property
    def ground(self) -> GroundKey:
        """The eleven fractals."""
        return GroundKey(seed=self.ground_seed)


def plan(options: OrbitOptions) -> CampaignPlan:
    """Plan the chunks: echoes at each altitude and slope, calibration, and the law of noise peaks."""
    return CampaignPlan(
        tuple(orbit_chunks(options)),
        as_toml(base_scene()),
        options.seed,
        {"laser": "bela", "detector": "bela", "receiver": "bela-grm"},
    )


def analyse(plan: CampaignPlan, results: list[dict[str, NDArray[Any]]]) -> Outcome:
    """Make the outcome of the chunks' results."""
    from msgspec import convert

    from procedures.campaign_orbit_outcome import outcome

    # The first chunk follows the orbits, and its values are the options.
    options = convert(dict(plan.chunks[0].given), OrbitOptions)
    return outcome(options, *read_results(replace(plan, chunks=plan.chunks[1:]), results[1:]))
