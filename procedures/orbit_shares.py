"""From curves over altitude to shares of an orbit's time, good ranges and their errors.

Shots follow each other in equal times, so shares of time are shares of shots. *Good* is a range that is no
false detection.

Day is the noon of every place, night has no sunlight: the two ends. *Local time* is the mean over a polar
orbit whose plane has any angle to the Sun, each as likely, as over whole Mercury years: half of its time is
night, and elsewhere the cosine of the Sun's angle of incidence is that of the ground below.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.values import Estimate
from procedures.orbit_curves import along, logit, probability

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from procedures.orbit_curves import Nodes
    from sim.orbit import Orbit

LIGHTS = ("day", "night", "local time")
LEVELS = (0.05, 0.50, 0.90)
"""Of the probability of false detection."""
QUANTILES = (0.5, 0.9)
ENERGY = 0.30
"""Relative error of the energy E_G below which its share of time is told (paper)."""
TIMES = 241
"""Of half a turn: the other half mirrors it."""
_SUNS = 12
"""Angles between orbit and Sun, in a quarter of a turn."""


@dataclass(frozen=True, slots=True)
class Arc:
    """The part of an orbit up to an altitude, from the periapsis on.

    Parameters
    ----------
    orbit : Orbit
        Of which.
    top_m : float
        The altitude, m.
    periapsis_latitude_rad : float
        Of its periapsis.
    """

    orbit: Orbit
    top_m: float
    periapsis_latitude_rad: float = 0.0

    @property
    def share(self) -> float:
        """Part of the time of a turn."""
        return self.orbit.time_below(self.top_m)

    @property
    def mean_rad(self) -> NDArray[np.float64]:
        """Equal times of half a turn, as mean anomalies."""
        return np.linspace(0.0, math.pi * self.share, TIMES)


@dataclass(frozen=True, slots=True)
class Told:
    """What an arc gives under one light.

    Parameters
    ----------
    below : tuple of Estimate
        Part of the orbit's time in which the probability of false detection is below each of `LEVELS`.
    energy : Estimate
        Part of the orbit's time in which the error of the energy E_G of detections is below `ENERGY`.
    good : Estimate
        Part of the orbit's shots that give a good range.
    error : Estimate or None
        Rms error of good ranges, m; None where there are none.
    error_below : tuple of Estimate
        For each of `QUANTILES`: so many of the good ranges come from where the rms error is at most this, m;
        none where there are none.
    """

    below: tuple[Estimate, ...]
    energy: Estimate
    good: Estimate
    error: Estimate | None
    error_below: tuple[Estimate, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Copies:
    """The numbers of `Told` in its order, with what chance and interpolation make of them.

    Parameters
    ----------
    values : ndarray of float64, shape (numbers, 1 + copies)
        The estimate, and its copies.
    straight : ndarray of float64, shape (numbers,)
        The estimate by straight lines between altitudes.
    ranges : bool
        Whether there are good ranges.
    """

    values: NDArray[np.float64]
    straight: NDArray[np.float64]
    ranges: bool

    def less(self, other: Copies) -> Copies:
        """Return the differences to another arc, copy by copy."""
        both = self.ranges and other.ranges
        return Copies(self.values - other.values, self.straight - other.straight, both)

    def told(self) -> Told:
        """Return the numbers with their uncertainties."""
        count = len(LEVELS)
        every = [self.estimate(n, "1" if n < count + 2 else "m") for n in range(len(self.values))]
        energy, good, error = every[count : count + 3]
        some = self.ranges
        return Told(
            below=tuple(every[:count]),
            energy=energy,
            good=good,
            error=error if some else None,
            error_below=tuple(every[count + 3 :]) if some else (),
        )

    def estimate(self, number: int, unit: str) -> Estimate:
        """Return one number."""
        return Estimate(float(self.values[number, 0]), math.hypot(*self.parts(number)), unit)

    def parts(self, number: int) -> tuple[float, float]:
        """Return its standard uncertainties by chance and by the way of interpolation."""
        return uncertainties(self.values[number], float(self.straight[number]))


def uncertainties(copies: NDArray[np.float64], straight: float) -> tuple[float, float]:
    """Return the scatter of a number's copies, and what straight lines change, as likely anywhere in it."""
    return float(copies[1:].std()), abs(straight - float(copies[0])) / math.sqrt(3)


def numbers(arc: Arc, nodes: Nodes, light: str) -> Copies:
    """Return what an arc gives under a light, one of `LIGHTS`."""
    values = _numbers(arc, nodes, light, False)
    straight = _numbers(arc, nodes.estimate, light, True)
    return Copies(values, straight[:, 0], bool(nodes.known.any()) and arc.share > 0)


def _numbers(arc: Arc, nodes: Nodes, light: str, straight: bool) -> NDArray[np.float64]:
    """Each number of `Told` for each copy."""
    at_m = arc.orbit.altitude_m(arc.mean_rad)
    weights, place, part = _lanes(arc, nodes, light)
    false, errors, energies = (
        _at_levels(along(nodes.altitude_m, one, at_m, straight), place, part)
        for one in (nodes.logit, nodes.log_error, nodes.log_energy)
    )
    levels = [*((false, float(logit(level))) for level in LEVELS), (energies, math.log(ENERGY))]
    # Weights leave a sum that rounds to a little more than all of it.
    below = [arc.share * np.minimum(share_below(one, level) @ weights, 1.0) for one, level in levels]
    if not nodes.known.any():
        below[-1] = np.zeros_like(below[-1])
    good = (1 - probability(false)) * (weights[:, None] * _trapezoid(TIMES))
    total = good.sum(axis=(1, 2))
    squares_m2 = (good * np.exp(2 * errors)).sum(axis=(1, 2)) / total
    quantiles = np.exp(weighted_quantiles(errors, good, QUANTILES))
    return np.stack([*below, arc.share * total, np.sqrt(squares_m2), *quantiles])


def _lanes(
    arc: Arc, nodes: Nodes, light: str
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Ways of the noise along an arc: weights (l,), level below it and part of the way to the next (l, n)."""
    last = nodes.level_v.size - 1
    if light == "night":
        return np.ones(1), np.zeros((1, TIMES), dtype=np.int64), np.zeros((1, TIMES))
    if light == "day":
        return np.ones(1), np.full((1, TIMES), last - 1), np.ones((1, TIMES))
    level_v = np.sqrt(
        nodes.level_v[0] ** 2 + sun_parts(arc) * (nodes.level_v[last] ** 2 - nodes.level_v[0] ** 2)
    )
    place = np.clip(np.searchsorted(nodes.level_v, level_v, side="right") - 1, 0, last - 1)
    part = (level_v - nodes.level_v[place]) / (nodes.level_v[place + 1] - nodes.level_v[place])
    # The first lane is night: half of the time.
    weights = np.concatenate([[0.5], np.full(len(place), 0.5 / len(place))])
    dark = np.zeros((1, TIMES))
    return weights, np.concatenate([dark.astype(np.int64), place]), np.concatenate([dark, part])


def sun_parts(arc: Arc) -> NDArray[np.float64]:
    """Return cosines of the Sun's angle of incidence where there is day, shape (l, n), all lanes as likely.

    With the angle u along a polar orbit from the equator, and the angle between the plane of the orbit and
    the Sun, which stands over the equator, the cosine is that of u times that of the other.
    """
    true_rad = arc.orbit.true_anomaly_rad(arc.mean_rad)
    turns_rad = (np.arange(_SUNS) + 0.5) * (math.pi / 2 / _SUNS)
    halves = [arc.periapsis_latitude_rad + sign * true_rad for sign in (1.0, -1.0)]
    return np.concatenate([np.abs(np.cos(half)) * np.cos(turns_rad)[:, None] for half in halves])


def _at_levels(
    values: NDArray[np.float64], place: NDArray[np.int64], part: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Interpolate between levels of noise by straight lines: (r, n, s) to (r, l, n)."""
    times = np.arange(values.shape[1])
    low, high = values[:, times, place], values[:, times, place + 1]
    return np.asarray(low + part * (high - low))


def share_below(values: NDArray[np.float64], level: float) -> NDArray[np.float64]:
    """Return the part of equal steps in which values lie below a level; straight lines join them.

    Parameters
    ----------
    values : ndarray of float64, shape (..., n)
        At least two.
    level : float
        Finite.

    Returns
    -------
    ndarray of float64, shape (...)
    """
    low = np.minimum(values[..., 1:], values[..., :-1]) - level
    high = np.maximum(values[..., 1:], values[..., :-1]) - level
    crosses = (low < 0) & (high > 0)
    part = np.where(crosses, -low / np.where(crosses, high - low, 1.0), (low < 0).astype(np.float64))
    return np.asarray(part.mean(axis=-1))


def weighted_quantiles(
    values: NDArray[np.float64], weights: NDArray[np.float64], parts: tuple[float, ...]
) -> NDArray[np.float64]:
    """Return the least values that hold given parts of the weights, shape (parts, r), of arrays (r, ...)."""
    rows, sizes = values.reshape(len(values), -1), weights.reshape(len(weights), -1)
    order = np.argsort(rows, axis=1)
    reached = np.cumsum(np.take_along_axis(sizes, order, axis=1), axis=1)
    found = np.empty((len(parts), len(rows)))
    for n, part in enumerate(parts):
        at = (reached >= part * reached[:, -1:]).argmax(axis=1)
        found[n] = rows[np.arange(len(rows)), order[np.arange(len(rows)), at]]
    return found


def _trapezoid(count: int) -> NDArray[np.float64]:
    """Weights of equal steps, their sum 1."""
    weights = np.full(count, 1.0 / (count - 1))
    weights[[0, -1]] /= 2
    return weights
