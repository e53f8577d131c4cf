"""A regional roughness from many residuals: stacked and compared with those of simulated footprints.

The roughness of a region is the geometric mean over its footprints; these scatter about it as a log-normal
whose width is that of the simulated terrains. The mean of the logarithm of residuals grows with roughness as
``c + ln(1 + (r / r0)^k)``: below some roughness there is only noise. The three numbers are fitted to
simulated footprints; a region's mean then has a likelihood for each roughness. Before it is seen, all values
from 1 cm to 1.5 m are as likely, by logarithm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from procedures.roughness_statistics import Footprints, Residual

GRID_M = np.geomspace(0.01, 1.5, 201)
FEWEST_OF_REGION = 30
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(9)
"""Of Gauss and Hermite: for means over the roughness of a region's footprints."""
_LOWEST, _HIGHEST = (-40.0, math.log(0.05), 0.3), (0.0, math.log(50.0), 4.0)
"""Of c, ln r0 and k."""


@dataclass(frozen=True, eq=False)
class Simulated:
    """Footprints with which regions are compared, arrays of shape (n,).

    Parameters
    ----------
    roughness_m, msr_v2 : ndarray of float64
        Of each.
    terrain : ndarray of int64
        On which.
    """

    roughness_m: NDArray[np.float64]
    msr_v2: NDArray[np.float64]
    terrain: NDArray[np.int64]

    @cached_property
    def width(self) -> float:
        """Standard deviation of the logarithm of roughness within a terrain."""
        log_m = np.log(self.roughness_m)
        _, number = np.unique(self.terrain, return_inverse=True)
        means = np.bincount(number, log_m) / np.bincount(number)
        return float(np.sqrt(np.mean((log_m - means[number]) ** 2)))

    @cached_property
    def _fit(self) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Parameters, their covariance, and the variance of a residual's logarithm."""
        from scipy.optimize import least_squares

        log_m, log_v2 = np.log(self.roughness_m), np.log(self.msr_v2)
        begin = (float(np.median(log_v2)), 0.0, 2.0)

        def left(at: NDArray[np.float64]) -> NDArray[np.float64]:
            return _curve(log_m, at) - log_v2

        found = least_squares(left, begin, bounds=(_LOWEST, _HIGHEST))
        variance = float(np.mean(found.fun**2))
        slopes = np.asarray(found.jac, dtype=np.float64)
        covariance = variance * np.linalg.pinv(slopes.T @ slopes)
        return np.asarray(found.x), np.asarray(covariance, dtype=np.float64), variance

    @cached_property
    def expected(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Mean logarithm of residuals of regions with the roughness of `GRID_M`, and the variance of that."""
        at, covariance, _ = self._fit
        steps = 1e-4 * np.eye(3)
        slopes = np.stack([(self._means(at + one) - self._means(at - one)) / 2e-4 for one in steps])
        return self._means(at), np.einsum("ig,ij,jg->g", slopes, covariance, slopes)

    def growth(self, log_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far the mean logarithm is above that of smooth ground, by logarithms of roughness."""
        at = self._fit[0]
        return np.asarray(_curve(log_m, at) - at[0])

    def _means(self, at: NDArray[np.float64]) -> NDArray[np.float64]:
        log_m = np.log(GRID_M)[:, None] + self.width * NODES
        return np.asarray(_curve(log_m, at) @ (WEIGHTS / WEIGHTS.sum()))

    @cached_property
    def dispersion(self) -> float:
        """By how much means of terrains scatter more about the expected ones than they should; at least 1."""
        return dispersion_of_means(self)

    def region(self, msr_v2: NDArray[np.float64]) -> Region:
        """Estimate a region's roughness from its residuals, V^2, shape (n,)."""
        return estimate(self, msr_v2, self.dispersion)

    @property
    def variance(self) -> float:
        """Of the logarithm of one residual."""
        return self._fit[2]


def _curve(log_m: NDArray[np.float64], at: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(at[0] + np.logaddexp(0.0, at[2] * (log_m - at[1])))


@dataclass(frozen=True, slots=True)
class Region:
    """An estimate.

    Parameters
    ----------
    roughness_m : float
        Most likely; the lower end of the grid where there is no more than noise.
    inside_68_m, inside_95_m : tuple of float
        Narrowest intervals with so much of the probability.
    footprints : int
        That told it.
    """

    roughness_m: float
    inside_68_m: tuple[float, float]
    inside_95_m: tuple[float, float]
    footprints: int


def estimate(simulated: Simulated, msr_v2: NDArray[np.float64], dispersion: float = 1.0) -> Region:
    """Estimate a region's roughness from its residuals.

    Parameters
    ----------
    simulated : Simulated
        Of the same altitude, reflectance, light and slope.
    msr_v2 : ndarray of float64
        At least one.
    dispersion : float
        By which the variance of a mean is larger than that of as many strangers.
    """
    away, variance = _away(simulated, msr_v2)
    log_likelihood = -0.5 * away**2 / (dispersion * variance) - 0.5 * np.log(variance)
    return likeliest(log_likelihood, msr_v2.size)


def likeliest(log_likelihood: NDArray[np.float64], footprints: int) -> Region:
    """Return the most likely roughness of `GRID_M`, and intervals with a flat prior in its logarithm."""
    chance = np.exp(log_likelihood - log_likelihood.max())
    chance /= chance.sum()
    best = float(GRID_M[np.argmax(chance)])
    return Region(best, _narrowest(chance, 0.68), _narrowest(chance, 0.95), footprints)


def _away(
    simulated: Simulated, msr_v2: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A region's mean less the expected ones, and the variance of that."""
    means, variance = simulated.expected
    return float(np.log(msr_v2).mean()) - means, variance + simulated.variance / msr_v2.size


def _narrowest(chance: NDArray[np.float64], share: float) -> tuple[float, float]:
    order = np.argsort(-chance, kind="stable")
    kept = order[: int(np.searchsorted(np.cumsum(chance[order]), share)) + 1]
    # Half a step on either side: the grid's points stand for what lies about them.
    half = np.sqrt(GRID_M[1] / GRID_M[0])
    return float(GRID_M[kept.min()] / half), float(GRID_M[kept.max()] * half)


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """Regions whose roughness is known, judged by terrains that they are no part of.

    Parameters
    ----------
    truth_m : ndarray of float64, shape (n,)
        Geometric means.
    found : tuple of Region
        What was estimated.
    dispersion : tuple of float
        That the terrains judged by showed among themselves, for each set.
    """

    truth_m: NDArray[np.float64]
    found: tuple[Region, ...]
    dispersion: tuple[float, ...]

    @property
    def width_68(self) -> float | None:
        """Median ratio of the ends of ``inside_68_m``, of terrains of 0.3 m and more; None without any."""
        spans = np.array([one.inside_68_m for one in self.found]).reshape(-1, 2)[self.truth_m >= 0.3]
        return float(np.median(spans[:, 1] / spans[:, 0])) if len(spans) else None

    def inside(self, share: str) -> NDArray[np.bool_]:
        """Which truths lie in ``inside_68_m`` or ``inside_95_m``."""
        spans = np.array([getattr(one, share) for one in self.found]).reshape(-1, 2)
        return np.asarray((self.truth_m >= spans[:, 0]) & (self.truth_m <= spans[:, 1]))


class Stack(Protocol):
    """Simulated footprints, with which a region is compared."""

    @property
    def dispersion(self) -> float:
        """By how much terrains scatter more than strangers."""
        ...

    def region(self, msr_v2: NDArray[np.float64]) -> Region:
        """Estimate a region's roughness."""
        ...


def trial(
    seen: Footprints,
    sets: NDArray[np.int64],
    case: int,
    residual: Residual,
    stacked: Callable[[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]], Stack] = Simulated,
) -> Trial:
    """Estimate the roughness of each terrain of each set, with the terrains of the other sets.

    Parameters
    ----------
    seen : Footprints
        All; those whose best pulse has the slope are used.
    sets : ndarray of int64, shape (n,)
        Set of each footprint.
    case : int
        Of noise.
    residual : {"window", "pulse"}
        As in `procedures.roughness_shape.power`.
    stacked : callable
        Makes of roughness, residuals and terrains what estimates: by mean logarithms, or
        `procedures.roughness_curves.StackedCurves`.
    """
    near = seen.compared(case, 0, residual)
    roughness_m, msr_v2 = seen.roughness_m[near], seen.residual_v2(residual, case)[near]
    terrain, own = seen.ground[near], sets[near]
    truth, found, dispersions = [], [], []
    for number in np.unique(own):
        others = own != number
        simulated = stacked(roughness_m[others], msr_v2[others], terrain[others])
        dispersions.append(simulated.dispersion)
        for one in np.unique(terrain[~others]):
            at = terrain == one
            if at.sum() >= FEWEST_OF_REGION:
                truth.append(np.exp(np.log(roughness_m[at]).mean()))
                found.append(simulated.region(msr_v2[at]))
    return Trial(np.array(truth), tuple(found), tuple(dispersions))


def dispersion_of_means(simulated: Simulated) -> float:
    """Return how much more means of terrains scatter about the expected ones than they should; at least 1."""
    squares = []
    for one in np.unique(simulated.terrain):
        at = simulated.terrain == one
        if at.sum() >= FEWEST_OF_REGION:
            away, variance = _away(simulated, simulated.msr_v2[at])
            true_m = math.exp(float(np.log(simulated.roughness_m[at]).mean()))
            place = np.log(np.clip(true_m, GRID_M[0], GRID_M[-1])), np.log(GRID_M)
            squares.append(np.interp(*place, away) ** 2 / np.interp(*place, variance))
    # Three numbers were fitted to them.
    return max(1.0, float(np.sum(squares)) / max(len(squares) - 3, 1))
