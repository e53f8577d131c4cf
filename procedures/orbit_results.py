"""What the chunks of the orbit campaign say together: curves, shares of orbits, and where curves cross."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from procedures.energy_cells import energy_cells
from procedures.orbit_crossings import crossing
from procedures.orbit_curves import nodes
from procedures.orbit_shares import LEVELS, LIGHTS, Arc, Copies, numbers
from procedures.range_table import cells
from sim.draws import Draws

if TYPE_CHECKING:
    from collections.abc import Mapping

    from procedures.campaign_orbit import OrbitOptions
    from procedures.echo_energy import Conversion
    from procedures.energy_cells import EnergyCell
    from procedures.orbit_crossings import Crossing
    from procedures.orbit_curves import Nodes
    from procedures.orbit_shares import Told
    from procedures.range_points import Collected, Drawn
    from procedures.range_table import Cell
    from sim.orbit import Orbit

DAY_S = 86400.0


@dataclass(frozen=True, slots=True)
class Row:
    """An arc of an orbit over some ground under one light.

    Parameters
    ----------
    orbit : str
        Its name.
    limit_m : float or None
        Altitude up to which the laser is fired, m; None: everywhere.
    slope_deg, reflectance : float
        Of the ground.
    light : str
        One of `procedures.orbit_shares.LIGHTS`.
    copies : Copies
        Its numbers.
    """

    orbit: str
    limit_m: float | None
    slope_deg: float
    reflectance: float
    light: str
    copies: Copies

    @property
    def told(self) -> Told:
        """Its numbers with their uncertainties."""
        return self.copies.told()


@dataclass(frozen=True, slots=True)
class CrossingRow:
    """Where the probability of false detection over some ground crosses a level."""

    slope_deg: float
    reflectance: float
    light: str
    level: float
    found: Crossing


@dataclass(frozen=True, slots=True, eq=False)
class OrbitStudy:
    """All of the campaign.

    Parameters
    ----------
    options : OrbitOptions
        As begun.
    orbits : mapping of str to Orbit
        By name, the nominal one first.
    cells : tuple of (float, tuple of Cell, tuple of EnergyCell)
        Nominal slope, deg, and the cells of each point.
    curves : mapping of (float, float) to Nodes
        By slope, deg, and reflectance.
    shares : tuple of Row
        Whole orbits.
    limits : tuple of Row
        The nominal orbit up to each limit.
    crossings : tuple of CrossingRow
        By day and by night.
    largest_peak_v, half_span_v : float
        Of the echoes, at the largest reflectance; of the converter from zero to its end, V.
    """

    options: OrbitOptions
    orbits: Mapping[str, Orbit]
    cells: tuple[tuple[float, tuple[Cell, ...], tuple[EnergyCell, ...]], ...]
    curves: Mapping[tuple[float, float], Nodes]
    shares: tuple[Row, ...]
    limits: tuple[Row, ...]
    crossings: tuple[CrossingRow, ...]
    largest_peak_v: float
    half_span_v: float

    def share(self, orbit: str, slope_deg: float, reflectance: float, light: str) -> Row:
        """Return the row of a whole orbit."""
        wanted = (orbit, slope_deg, reflectance, light)
        return next(
            one for one in self.shares if (one.orbit, one.slope_deg, one.reflectance, one.light) == wanted
        )

    def shots(self, orbit: str) -> float:
        """Return how many shots a turn has."""
        return self.options.rate_hz * self.orbits[orbit].period_s

    def turns_a_day(self, orbit: str) -> float:
        """Return how often the orbit is flown in 24 hours."""
        return DAY_S / self.orbits[orbit].period_s

    @property
    def usual(self) -> tuple[float, float]:
        """Slope, deg, and reflectance nearest to 10 degrees and 0.17."""
        slopes, shines = self.options.slopes_deg, self.options.reflectances
        return min(slopes, key=lambda one: abs(one - 10.0)), min(shines, key=lambda one: abs(one - 0.17))


def study(options: OrbitOptions, found: Collected, convert: Conversion) -> OrbitStudy:
    """Reduce what the chunks gave."""
    laws, curves, every = found.laws(), {}, []
    for number, slope_deg in enumerate(options.slopes_deg):
        points = found.of("orbit")[number :: len(options.slopes_deg)]
        ranges = [cells(one, laws) for one in points]
        energies = [energy_cells(one, laws, convert) for one in points]
        told = [tuple(zip(*both, strict=True)) for both in zip(ranges, energies, strict=True)]
        every += [(slope_deg, *both) for both in zip(ranges, energies, strict=True)]
        for reflectance in options.reflectances:
            curves[slope_deg, reflectance] = nodes(points, told, laws, reflectance, Draws(options.seed, 0))
    orbits = options.orbits()
    tilt_rad = math.radians(options.periapsis_latitude_deg)
    whole: dict[tuple[str, float | None], Arc] = {
        (name, None): Arc(orbit, orbit.apoapsis_m, tilt_rad) for name, orbit in orbits.items()
    }
    first, nominal = next(iter(orbits.items()))
    limited: dict[tuple[str, float | None], Arc] = {
        (first, 1e3 * km): Arc(nominal, 1e3 * km, tilt_rad) for km in options.limits_km
    }
    return OrbitStudy(
        options=options,
        orbits=orbits,
        cells=tuple(every),
        curves=curves,
        shares=_rows(whole, curves),
        limits=_rows(limited, curves),
        crossings=tuple(
            CrossingRow(*key, light, level, crossing(curve, light, level))
            for key, curve in curves.items()
            for light in LIGHTS[:2]
            for level in LEVELS
        ),
        largest_peak_v=max(options.reflectances) * max(_highest_v(one) for one in found.of("orbit")),
        half_span_v=found.of("orbit")[0].scene.truth.adc_full_scale_v / 2,
    )


def _highest_v(drawn: Drawn) -> float:
    return float(np.max(drawn.arrays["peak_v"]))


def _rows(
    arcs: Mapping[tuple[str, float | None], Arc], curves: Mapping[tuple[float, float], Nodes]
) -> tuple[Row, ...]:
    return tuple(
        Row(*name, *key, light, numbers(arc, curve, light))
        for name, arc in arcs.items()
        for key, curve in curves.items()
        for light in LIGHTS
    )
