"""The conversion from an electrical integral to optical energy: a line, and the curve that is left about it.

Both axes are normalized by the detected amplitude A, so that one curve holds for strong and weak pulses: with
x = E / A, s, and y = E_optical / A, J/V, the line is y = a x + b, and the curve is the mean of y / (a x + b)
against x (Nishiyama et al., section "Conversion from electrical signals to return pulse energy").

Not modelled: noise in x. It is that of E, which y shares through A; near the pulses of a calibration it makes
the slope smaller by the square of its relative size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput
from belahil.values import Estimate

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

LEAST_GROUPS = 3
"""Of different x: a line through two leaves no curve."""


@dataclass(frozen=True, slots=True, eq=False)
class EnergyFit:
    """A line, and the curve of the ratio to it.

    Parameters
    ----------
    slope, intercept : Estimate
        a, J/(V s); b, J/V. The uncertainty is the scatter within groups, of points whose x is what it is.
    covariance : ndarray, shape (2, 2)
        Of slope and intercept.
    places_s : ndarray, shape (g,)
        Mean x of each group, rising.
    ratios, ratio_u : ndarray, shape (g,)
        Mean of y / (a x + b) there, and its standard uncertainty by the scatter.
    left_rms : float
        Of single points about line and curve, relative, with each half of the points judged by the other's
        curve.
    """

    slope: Estimate
    intercept: Estimate
    covariance: NDArray[np.float64]
    places_s: NDArray[np.float64]
    ratios: NDArray[np.float64]
    ratio_u: NDArray[np.float64]
    left_rms: float

    @property
    def largest_deviation(self) -> Estimate:
        """Largest deviation of the curve from 1, with its sign."""
        worst = int(np.argmax(np.abs(self.ratios - 1)))
        return Estimate(float(self.ratios[worst] - 1), float(self.ratio_u[worst]))

    def line(self, x_s: ArrayLike) -> NDArray[np.float64]:
        """Return a x + b, J/V, with the shape of `x_s`."""
        return self.slope.value * np.asarray(x_s, dtype=np.float64) + self.intercept.value

    def energy_per_volt(self, x_s: ArrayLike) -> NDArray[np.float64]:
        """Return line times curve, J/V: what converts E / A to E_optical / A.

        Straight lines between groups; beyond the first and the last the curve stays as it is there.
        """
        x = np.asarray(x_s, dtype=np.float64)
        return self.line(x) * np.interp(x, self.places_s, self.ratios)


def fit_energy(
    x_s: ArrayLike, y_j_per_v: ArrayLike, groups: ArrayLike, weights: ArrayLike | None = None
) -> EnergyFit | None:
    """Fit line and curve.

    Parameters
    ----------
    x_s, y_j_per_v : array_like of float, shape (n,)
        E / A and E_optical / A.
    groups : array_like of int, shape (n,)
        Points of nearly the same x: pulses of one width, or bins. Each group has the same weight in the line.
    weights : array_like of float, shape (n,), or None
        Of points within their group, for example the square of the amplitude; None: equal.

    Returns
    -------
    EnergyFit or None
        None where fewer than three groups have points.

    Raises
    ------
    RefusedInput
        Shapes that differ, numbers that are not finite, or weights that are not positive.
    """
    x, y = np.asarray(x_s, dtype=np.float64), np.asarray(y_j_per_v, dtype=np.float64)
    group = np.asarray(groups)
    weight = np.ones(x.shape) if weights is None else np.asarray(weights, dtype=np.float64)
    if x.ndim != 1 or not x.shape == y.shape == group.shape == weight.shape:
        raise RefusedInput(
            f"points {x.shape}, {y.shape}, {group.shape}, {weight.shape}: equal rows are allowed"
        )
    if not (np.isfinite(x).all() and np.isfinite(y).all() and (weight > 0).all()):
        raise RefusedInput("points of an energy fit: all must be finite, with positive weights")
    names, member = np.unique(group, return_inverse=True)
    if names.size < LEAST_GROUPS:
        return None
    share = weight / np.bincount(member, weight)[member]  # sums to 1 in each group
    columns = np.stack([x, np.ones(x.size)])
    normal = np.linalg.inv((columns * share) @ columns.T)
    slope, intercept = normal @ (columns * share) @ y
    variance = _variances(y - slope * x, share, member)
    lever = normal @ columns * share
    covariance = (lever * variance) @ lever.T
    line = slope * x + intercept
    places, ratios, ratio_u = _curve(x, y / line, share, member)
    return EnergyFit(
        Estimate(float(slope), math.sqrt(covariance[0, 0]), "J V-1 s-1"),
        Estimate(float(intercept), math.sqrt(covariance[1, 1]), "J V-1"),
        covariance,
        places,
        ratios,
        ratio_u,
        _left(x, y / line, share, member),
    )


def bins(x_s: ArrayLike, count: int) -> NDArray[np.int64]:
    """Put points into bins that hold equally many, shape (n,)."""
    x = np.asarray(x_s, dtype=np.float64)
    edges = np.quantile(x, np.linspace(0, 1, count + 1)[1:-1])
    return np.searchsorted(edges, x, side="right").astype(np.int64)


def clusters(widths_s: ArrayLike, apart: float = 0.02) -> NDArray[np.int64]:
    """Number points by width, shape (n,): a new number where sorted widths are apart by more than a part."""
    widths = np.asarray(widths_s, dtype=np.float64)
    order = np.argsort(widths, kind="stable")
    jumps = np.diff(widths[order]) > apart * widths[order][:-1]
    numbers = np.zeros(widths.size, dtype=np.int64)
    numbers[order] = np.concatenate([[0], np.cumsum(jumps)])[: widths.size]
    return numbers


def _variances(
    residual: NDArray[np.float64], share: NDArray[np.float64], member: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the variance of each point about its group, by its own residual and leverage.

    Whatever the variances are, sums over many points are unbiased (MacKinnon and White, J. Econometrics 29,
    1985, their HC2): part of the scatter goes with 1 / amplitude, and the wobble with the sampling phase does
    not. A point that is alone gets the mean of the others.
    """
    mean = np.bincount(member, share * residual)
    shared = share < 1 - 1e-12
    own = (residual - mean[member]) ** 2 / np.where(shared, 1 - share, 1.0)
    common = float(own[shared].mean()) if shared.any() else 0.0
    return np.where(shared, own, common)


def mean_variances(
    residual: NDArray[np.float64], share: NDArray[np.float64], member: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the variance of the weighted mean of each group, shape (g,).

    Parameters
    ----------
    residual, share : ndarray of float64, shape (n,)
        Points, and their weights, which sum to 1 in each group.
    member : ndarray of int, shape (n,)
        Group of each, 0 to g - 1.
    """
    variances = share**2 * _variances(residual, share, member)
    return np.bincount(member, variances).astype(np.float64)


def _curve(
    x: NDArray[np.float64], ratio: NDArray[np.float64], share: NDArray[np.float64], member: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    places, ratios = np.bincount(member, share * x), np.bincount(member, share * ratio)
    spread = np.sqrt(mean_variances(ratio, share, member))
    order = np.argsort(places, kind="stable")
    return places.astype(np.float64)[order], ratios.astype(np.float64)[order], spread[order]


def _left(
    x: NDArray[np.float64], ratio: NDArray[np.float64], share: NDArray[np.float64], member: NDArray[np.int64]
) -> float:
    """Rms of what the curve of the other half leaves; groups of one point judge themselves."""
    turn = np.zeros(x.size, dtype=np.int64)
    for one in range(member.max() + 1):
        mine = np.flatnonzero(member == one)
        turn[mine] = np.arange(mine.size) % 2
    left = np.zeros(x.size)
    for half in (0, 1):
        lent = turn != half
        if np.unique(member[lent]).size < member.max() + 1:
            lent = np.ones(x.size, dtype=np.bool_)
        own = np.bincount(member[lent], share[lent])
        places, ratios, _ = _curve(x[lent], ratio[lent], share[lent] / own[member[lent]], member[lent])
        mine = turn == half
        left[mine] = ratio[mine] / np.interp(x[mine], places, ratios) - 1
    return float(np.sqrt(np.average(left**2, weights=share)))
