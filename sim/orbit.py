"""An orbit about Mercury after Kepler: altitude against time, and time below an altitude.

What this does not model: the flattening of the planet (1.1 km between equator and pole), its gravity field
beside the central term, the Sun, relief, and the planet's turning below.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput
from sim.constants import MERCURY_GM_M3_PER_S2, MERCURY_RADIUS_M

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

_STEPS = 60
"""Of Newton's method or bisection, whichever is safe; five or six are usual."""
_SETTLED_RAD = 1e-15


@dataclass(frozen=True, slots=True)
class Orbit:
    """An ellipse about the centre of the planet.

    Parameters
    ----------
    periapsis_m, apoapsis_m : float
        Least and largest altitude above the mean radius, m.

    Raises
    ------
    RefusedInput
        Altitudes that are not positive and finite, or a periapsis above the apoapsis.
    """

    periapsis_m: float
    apoapsis_m: float

    def __post_init__(self) -> None:
        if not 0 < self.periapsis_m <= self.apoapsis_m < math.inf:
            raise RefusedInput(
                f"an orbit of {self.periapsis_m / 1e3:g} x {self.apoapsis_m / 1e3:g} km: the periapsis must "
                "be above 0 and not above the apoapsis"
            )

    @property
    def semi_major_axis_m(self) -> float:
        """Half of the long axis, m."""
        return MERCURY_RADIUS_M + (self.periapsis_m + self.apoapsis_m) / 2

    @property
    def eccentricity(self) -> float:
        """0 for a circle."""
        return (self.apoapsis_m - self.periapsis_m) / (2 * self.semi_major_axis_m)

    @property
    def period_s(self) -> float:
        """Time of one turn, s."""
        return 2 * math.pi * math.sqrt(self.semi_major_axis_m**3 / MERCURY_GM_M3_PER_S2)

    def time_below(self, altitude_m: float) -> float:
        """Return the part of the time that is spent at an altitude, m, or below it: 0 to 1.

        In closed form: r = a (1 - e cos E), and time is E - e sin E (Kepler's equation).
        """
        if altitude_m < self.periapsis_m:
            return 0.0
        if altitude_m >= self.apoapsis_m:
            return 1.0
        # From the periapsis, so that no difference of large numbers is left near it.
        part = (altitude_m - self.periapsis_m) / (self.apoapsis_m - self.periapsis_m)
        eccentric_rad = 2 * math.asin(math.sqrt(part))
        return (eccentric_rad - self.eccentricity * math.sin(eccentric_rad)) / math.pi

    def altitude_m(self, mean_rad: ArrayLike) -> NDArray[np.float64]:
        """Return altitudes at mean anomalies: times after the periapsis, 2 pi a turn.

        Parameters
        ----------
        mean_rad : array_like of float
            Of any shape, finite.
        """
        eccentric_rad = eccentric_anomaly(mean_rad, self.eccentricity)
        span_m = self.apoapsis_m - self.periapsis_m
        return np.asarray(self.periapsis_m + span_m * np.sin(eccentric_rad / 2) ** 2)

    def true_anomaly_rad(self, mean_rad: ArrayLike) -> NDArray[np.float64]:
        """Return angles at the planet from the periapsis, at mean anomalies; they grow with these."""
        e, half = self.eccentricity, eccentric_anomaly(mean_rad, self.eccentricity) / 2
        # The angle between both anomalies never leaves a quarter of a turn.
        beta = e / (1 + math.sqrt(1 - e * e))
        whole = 2 * half
        return np.asarray(whole + 2 * np.arctan2(beta * np.sin(whole), 1 - beta * np.cos(whole)))

    def altitude_at_m(self, true_rad: ArrayLike) -> NDArray[np.float64]:
        """Return altitudes at true anomalies, by the polar equation of the ellipse."""
        e = self.eccentricity
        focal_m = self.semi_major_axis_m * (1 - e * e)
        return np.asarray(focal_m / (1 + e * np.cos(true_rad)) - MERCURY_RADIUS_M)


def eccentric_anomaly(mean_rad: ArrayLike, eccentricity: float) -> NDArray[np.float64]:
    """Solve Kepler's equation M = E - e sin E.

    Parameters
    ----------
    mean_rad : array_like of float
        M, of any shape, finite; any number of turns.
    eccentricity : float
        e, 0 to below 1.

    Returns
    -------
    ndarray of float64
        E, with the turns of M; M is met to some 1e-15 of a turn.

    Raises
    ------
    RefusedInput
        An eccentricity outside of its range.

    Notes
    -----
    Newton's steps, each held within the bounds that those before it have left.
    """
    if not 0 <= eccentricity < 1:
        raise RefusedInput(f"eccentricity {eccentricity!r}: must be 0 to below 1")
    given = np.asarray(mean_rad, dtype=np.float64)
    turns = 2 * np.pi * np.round(given / (2 * np.pi))
    mean = np.abs(given - turns)
    low, high = mean, np.minimum(mean + eccentricity, np.pi)
    found = np.minimum(mean + eccentricity * np.sin(mean), high)
    for _ in range(_STEPS):
        off = found - eccentricity * np.sin(found) - mean
        low, high = np.where(off < 0, found, low), np.where(off > 0, found, high)
        newton = found - off / (1 - eccentricity * np.cos(found))
        better = np.where((newton >= low) & (newton <= high), newton, (low + high) / 2)
        settled = np.abs(better - found).max(initial=0.0) <= _SETTLED_RAD
        found = better
        if settled:
            break
    return np.asarray(turns + np.copysign(found, given - turns))
