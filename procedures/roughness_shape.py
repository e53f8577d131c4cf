"""What the shape of a return pulse tells of roughness: residuals about the best pulse of flat slopes."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from procedures.roughness_statistics import cumulative, mean_of, quantile_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from procedures.roughness_statistics import Footprints, Residual

SMOOTH_M, MIDDLE_M, ROUGH_M = (0.0, 0.1), (0.4, 0.6), (0.9, 1.1)
BINS_M = (SMOOTH_M, MIDDLE_M, ROUGH_M)
LIMIT_V2 = 1e-6
"""1 mV^2."""
CONTOURS = (0.50, 0.70, 0.90, 0.95, 0.99)
LEVELS_V2 = np.geomspace(1e-10, 1e-4, 241)
MAP_EDGES_M = np.arange(0.0, 2.01, 0.1)
FEWEST = 20
"""Footprints in a bin of a map."""
READINGS: tuple[Residual, ...] = ("window", "pulse", "largest", "timed")
"""What the paper's residual may be: of the pulse's samples alone; no mean; of a pulse not moved in time."""
STACKED = 100
"""Footprints of a region."""


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """Residuals of one case.

    Parameters
    ----------
    curves : ndarray of float64, shape (3, levels)
        Share of MSR at or below `LEVELS_V2`, by `BINS_M`; zero in a bin without footprints.
    counts : ndarray of int64, shape (3,)
        Footprints in these bins.
    above : dict of tuple of (float, float) or None
        Share above 1 mV^2 by bin, with uncertainties, by residual.
    counted : dict of tuple of int
        Of so many footprints.
    cells : ndarray of float64, shape (bins, levels)
        The same shares by bins of `MAP_EDGES_M`.
    cell_counts : ndarray of int64, shape (bins,)
        Footprints there.
    contours_v2 : ndarray of float64, shape (contours, bins)
        Quantiles; NaN with fewer than `FEWEST` footprints.
    """

    curves: NDArray[np.float64]
    counts: NDArray[np.int64]
    above: dict[Residual, tuple[tuple[float, float] | None, ...]]
    counted: dict[Residual, tuple[int, ...]]
    cells: NDArray[np.float64]
    cell_counts: NDArray[np.int64]
    contours_v2: NDArray[np.float64]


def shape(seen: Footprints, case: int, reflectance: int = 0) -> Shape:
    """Sort residuals by roughness; of footprints whose best pulse has the slope."""
    near = seen.compared(case, reflectance)
    roughness_m, msr_v2 = seen.roughness_m[near], seen.msr_v2[reflectance, case][near]
    inside = [between(roughness_m, one) for one in BINS_M]
    shares = {residual: _above(seen, case, reflectance, residual) for residual in READINGS}
    cells = [between(roughness_m, pair) for pair in itertools.pairwise(MAP_EDGES_M)]
    return Shape(
        np.array([cumulative(msr_v2[at], LEVELS_V2) for at in inside]),
        np.array([at.sum() for at in inside]),
        {residual: share for residual, (share, _) in shares.items()},
        {residual: count for residual, (_, count) in shares.items()},
        np.array([cumulative(msr_v2[at], LEVELS_V2) for at in cells]),
        np.array([at.sum() for at in cells]),
        np.array(
            [
                [np.quantile(msr_v2[at], share) if at.sum() >= FEWEST else np.nan for at in cells]
                for share in CONTOURS
            ]
        ),
    )


def _above(
    seen: Footprints, case: int, reflectance: int, residual: Residual
) -> tuple[tuple[tuple[float, float] | None, ...], tuple[int, ...]]:
    """Shares above 1 mV^2 by bin of roughness, and of how many footprints."""
    near = seen.compared(case, reflectance, residual)
    high = (seen.residual_v2(residual, case, reflectance) > LIMIT_V2).astype(np.float64)
    inside = [near & between(seen.roughness_m, one) for one in BINS_M]
    shares = (mean_of(high[at], seen.ground[at]) if at.any() else None for at in inside)
    return tuple(shares), tuple(int(at.sum()) for at in inside)


def between(roughness_m: NDArray[np.float64], span_m: tuple[float, float]) -> NDArray[np.bool_]:
    """Tell which lie in a span, its end left out."""
    return (roughness_m >= span_m[0]) & (roughness_m < span_m[1])


@dataclass(frozen=True, slots=True)
class Power:
    """How well residuals tell rough from smooth ground, in one case.

    Parameters
    ----------
    smooth, rough : int
        Footprints below 0.1 m, and from 0.9 to 1.1 m.
    limit_v2 : float
        Below which are 99 % of the smooth ones, V^2.
    share, share_u : float
        Of the rough ones above it, with both uncertainties; 1 % is chance.
    separation, separation_u : float
        Of the mean logarithms of `STACKED` rough and as many smooth residuals, in standard deviations of
        their difference.
    """

    smooth: int
    rough: int
    limit_v2: float
    share: float
    share_u: float
    separation: float
    separation_u: float


def power(
    seen: Footprints, case: int, reflectance: int, residual: Residual, stream: np.random.Generator
) -> Power | None:
    """Compare rough with smooth footprints; None with fewer than 100 smooth or 20 rough ones.

    Parameters
    ----------
    seen : Footprints
        All of one altitude.
    case, reflectance : int
        Which of theirs.
    residual : {"window", "pulse", "largest", "timed"}
        As in `procedures.roughness_statistics.Footprints.residual_v2`.
    stream : numpy.random.Generator
        For a bootstrap.
    """
    near = seen.compared(case, reflectance, residual)
    smooth = near & between(seen.roughness_m, SMOOTH_M)
    rough = near & between(seen.roughness_m, ROUGH_M)
    if smooth.sum() < 5 * FEWEST or rough.sum() < FEWEST:
        return None
    msr_v2 = seen.residual_v2(residual, case, reflectance)
    limit_v2, limit_u = quantile_of(msr_v2[smooth], seen.ground[smooth], 0.99, stream)
    share, u = mean_of((msr_v2[rough] > limit_v2).astype(np.float64), seen.ground[rough])
    ends = [float((msr_v2[rough] > limit_v2 + sign * limit_u).mean()) for sign in (-1, 1)]
    logs = np.log(np.maximum(msr_v2, np.finfo(np.float64).tiny))
    means = [mean_of(logs[at], seen.ground[at]) for at in (rough, smooth)]
    one_sd = float(np.sqrt((logs[rough].var() + logs[smooth].var()) / STACKED))
    return Power(
        int(smooth.sum()),
        int(rough.sum()),
        limit_v2,
        share,
        float(np.hypot(u, (ends[0] - ends[1]) / 2)),
        (means[0][0] - means[1][0]) / one_sd,
        float(np.hypot(means[0][1], means[1][1])) / one_sd,
    )


def slopes_by_library(seen: Footprints, case: int) -> dict[str, NDArray[np.float64]]:
    """Slopes of the ground by the slope of the best pulse: mean, its uncertainty, spread, count."""
    there = seen.width_s[0, case] > 0
    best, slope, cluster = seen.library_deg[0, case][there], seen.slope_deg[there], seen.ground[there]
    found = []
    for one in np.unique(best):
        at = best == one
        if at.sum() >= FEWEST:
            found.append((one, *mean_of(slope[at], cluster[at]), slope[at].std(), at.sum()))
    names = ("library_deg", "mean_deg", "mean_u_deg", "spread_deg", "count")
    return dict(zip(names, np.array(found).reshape(-1, len(names)).T, strict=True))
