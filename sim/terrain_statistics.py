"""What describes relief: RMS deviation by baseline, Hurst exponent, slopes, the plane in a footprint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.errors import RefusedInput
from sim.terrain_grid import Grid, OffTerrain

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from sim.terrain import Surface

# Below so many roundings of the largest height, residuals are those of the input's last digits.
_ROUNDINGS = 4.0
# Smaller to larger axis of the points' ellipse, squared, below which they lie on a line.
_THINNEST = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class RmsDeviation:
    """Root mean square difference of heights that are a baseline apart (Shepard et al., 2001).

    Parameters
    ----------
    baseline_m : ndarray of float64, shape (n,)
        Whole numbers of spacings, ascending, m.
    rms_m : ndarray of float64, shape (n,)
        ``sqrt(mean((z(x + L) - z(x))**2))`` over all pairs along both axes, m; the mean slope stays in.
    pairs : ndarray of int64, shape (n,)
        Number of pairs.
    """

    baseline_m: NDArray[np.float64]
    rms_m: NDArray[np.float64]
    pairs: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class HurstEstimate:
    """Slope of log RMS deviation against log baseline.

    Parameters
    ----------
    exponent : float or None
        H; None unless the status is "ok".
    scatter : float
        Rms distance of the points from the line, as a natural logarithm of the deviation. It is no
        uncertainty of H: deviations at different baselines share their heights.
    status : {"ok", "flat", "too few baselines"}
        "flat": a deviation is zero, which has no logarithm.
    """

    exponent: float | None
    scatter: float
    status: Literal["ok", "flat", "too few baselines"]


@dataclass(frozen=True, slots=True, eq=False)
class SlopeMap:
    """Slopes over one baseline.

    Parameters
    ----------
    slope_rad : ndarray of float64, shape (rows, columns)
        Steepest slope, from differences along both axes, rad; 0 where not known. Smaller than the grid by
        the baseline, which is missing equally at opposite edges.
    known : ndarray of bool, shape (rows, columns)
        Where no height was missing.
    baseline_m : float
        A whole number of spacings, m.
    """

    slope_rad: NDArray[np.float64]
    known: NDArray[np.bool_]
    baseline_m: float


@dataclass(frozen=True, slots=True)
class PlaneFit:
    """The plane through a footprint, and what is left over.

    Parameters
    ----------
    centre_m : tuple of float
        Weighted mean of x, y and z, m; the plane goes through it.
    gradient : tuple of float
        dz/dx and dz/dy, m/m.
    roughness_m : float
        Weighted standard deviation of the heights about the plane, m.
    skewness : float or None
        Third standardized moment about the plane; None when the status is "flat".
    status : {"ok", "flat"}
        "flat": the roughness is that of the last digits of the heights, or zero.
    """

    centre_m: tuple[float, float, float]
    gradient: tuple[float, float]
    roughness_m: float
    skewness: float | None
    status: Literal["ok", "flat"]

    @property
    def slope_rad(self) -> float:
        """Angle of the plane from the horizontal, rad."""
        return float(np.arctan(np.hypot(*self.gradient)))

    @property
    def azimuth_rad(self) -> float:
        """Direction of steepest ascent, from +x towards +y, -pi to pi; 0 on a horizontal plane."""
        return float(np.arctan2(self.gradient[1], self.gradient[0]))


def rms_deviation(surface: Surface | Grid, baselines_m: Sequence[float]) -> RmsDeviation:
    """Measure the RMS deviation of a gridded surface.

    Parameters
    ----------
    surface : Surface or Grid
        Heights on a grid; pairs with a missing height do not count.
    baselines_m : sequence of float
        m; rounded to whole numbers of spacings, at least one; equal ones count once.

    Raises
    ------
    RefusedInput
        For a surface without a grid, or no baseline.
    OffTerrain
        When a baseline has no pair.
    """
    grid = _grid(surface)
    lags = sorted({_lag(grid, baseline_m) for baseline_m in baselines_m})
    if not lags:
        raise RefusedInput("RMS deviation at no baseline: at least one is needed")
    rms_m, pairs = [], []
    for lag in lags:
        total, count = 0.0, 0
        for heights, known in ((grid.values, grid.known), (grid.values.T, _transposed(grid.known))):
            if lag >= heights.shape[1]:
                continue
            climb = heights[:, lag:] - heights[:, :-lag]
            if known is not None:
                climb = climb[known[:, lag:] & known[:, :-lag]]
            total += float(np.sum(climb * climb))
            count += climb.size
        if not count:
            raise OffTerrain(f"baseline {lag * grid.spacing_m:g} m: no two posts with data are so far apart")
        rms_m.append(np.sqrt(total / count))
        pairs.append(count)
    return RmsDeviation(np.array(lags) * grid.spacing_m, np.array(rms_m), np.array(pairs, dtype=np.int64))


def hurst_exponent(deviation: RmsDeviation) -> HurstEstimate:
    """Fit ``rms ~ baseline**H`` by least squares of the logarithms, each baseline with the same weight.

    Notes
    -----
    On a surface whose mean slope or larger craters are left in, H is larger than that of the roughness; on
    one that was detrended over a short length it is too small for H above 0.5.
    """
    if deviation.baseline_m.size < 2:
        return HurstEstimate(None, 0.0, "too few baselines")
    if not np.all(deviation.rms_m > 0):
        return HurstEstimate(None, 0.0, "flat")
    across = np.log(deviation.baseline_m)
    across -= across.mean()
    up = np.log(deviation.rms_m)
    up -= up.mean()
    exponent = float(across @ up / (across @ across))
    return HurstEstimate(exponent, float(np.sqrt(np.mean((up - exponent * across) ** 2))), "ok")


def slope_map(surface: Surface | Grid, baseline_m: float) -> SlopeMap:
    """Steepest slope from the differences over one baseline along both axes, about one place.

    Parameters
    ----------
    surface : Surface or Grid
        Heights on a grid.
    baseline_m : float
        m; rounded to a whole number of spacings.

    Raises
    ------
    RefusedInput
        For a surface without a grid.
    OffTerrain
        When the grid is smaller than the baseline, or no slope is known.
    """
    grid = _grid(surface)
    lag = _lag(grid, baseline_m)
    length_m = lag * grid.spacing_m
    rows, columns = grid.values.shape
    # A cross about each post, or about the middle between two when the baseline is an odd number of spacings.
    across, along = _middle(rows, lag), _middle(columns, lag)
    known = np.ones((max(rows - lag, 0), max(columns - lag, 0)), dtype=np.bool_)
    if not known.size:
        raise OffTerrain(f"slopes over {length_m:g} m: the grid has {rows} x {columns} posts")
    z = grid.values
    climb = np.hypot(z[across, lag:] - z[across, :-lag], z[lag:, along] - z[:-lag, along])
    if grid.known is not None:
        have = grid.known
        known = have[across, lag:] & have[across, :-lag] & have[lag:, along] & have[:-lag, along]
    if not known.any():
        raise OffTerrain(f"slopes over {length_m:g} m: no four posts with data form a cross")
    return SlopeMap(np.where(known, np.arctan(climb / length_m), 0.0), known, length_m)


def plane_fit(x_m: ArrayLike, y_m: ArrayLike, z_m: ArrayLike, weights: ArrayLike | None = None) -> PlaneFit:
    """Fit a plane by weighted least squares, and describe the heights about it.

    Parameters
    ----------
    x_m, y_m, z_m : array_like
        Places and heights, m; of equal or broadcastable shape.
    weights : array_like or None
        Relative, not negative: the beam's density, 0 where a height is missing. None: all equal.

    Raises
    ------
    RefusedInput
        When a number is not finite, a weight is negative, or fewer than three points that span a plane
        have a weight.

    Notes
    -----
    All moments are those of numbers from which their mean was taken first, so that a datum of a planet's
    radius costs no more digits than the heights themselves have lost.
    """
    x, y, z, weight = _points(x_m, y_m, z_m, weights)
    x_mean, y_mean, z_mean = (_mean(weight, values) for values in (x, y, z))
    floor_m = _ROUNDINGS * np.finfo(np.float64).eps * float(np.abs(z).max())
    x, y, z = x - x_mean, y - y_mean, z - z_mean
    xx, xy, yy = (float(weight @ product) for product in (x * x, x * y, y * y))
    # The product of the axes of the points' ellipse against the square of their sum.
    determinant = xx * yy - xy * xy
    if not determinant > _THINNEST * (xx + yy) ** 2:
        raise RefusedInput(
            f"a plane through {np.count_nonzero(weight)} points with a weight: needs three, not on a line"
        )
    gx = gy = 0.0
    for _ in range(2):  # the second time it fits what rounding left over
        xz, yz = float(weight @ (x * z)), float(weight @ (y * z))
        dx, dy = (yy * xz - xy * yz) / determinant, (xx * yz - xy * xz) / determinant
        z = z - dx * x - dy * y
        z = z - _mean(weight, z)
        gx, gy = gx + dx, gy + dy
    roughness_m = float(np.sqrt(weight @ (z * z)))
    centre_m = (x_mean, y_mean, z_mean)
    if not roughness_m > floor_m:
        return PlaneFit(centre_m, (gx, gy), roughness_m, None, "flat")
    standardized = z / roughness_m
    return PlaneFit(centre_m, (gx, gy), roughness_m, float(weight @ standardized**3), "ok")


def _points(
    x_m: ArrayLike, y_m: ArrayLike, z_m: ArrayLike, weights: ArrayLike | None
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Flat arrays of float64, and weights that add up to one."""
    given = [np.asarray(values, dtype=np.float64) for values in (x_m, y_m, z_m)]
    given.append(np.asarray(1.0 if weights is None else weights, dtype=np.float64))
    x, y, z, weight = (values.ravel() for values in np.broadcast_arrays(*given))
    if not all(np.isfinite(values).all() for values in (x, y, z, weight)) or np.any(weight < 0):
        raise RefusedInput("a plane fit: places, heights and weights must be finite, weights not negative")
    if not np.any(weight > 0):
        raise RefusedInput(f"a plane through {x.size} points: none of them has a weight")
    # Against the largest first: a beam far from the points has weights that may add up to nothing.
    weight = weight / weight.max()
    return x, y, z, weight / weight.sum()


def _mean(weight: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """Weighted mean in two passes; the weights add up to one."""
    first = float(weight @ values)
    return first + float(weight @ (values - first))


def _grid(surface: Surface | Grid) -> Grid:
    relief = surface if isinstance(surface, Grid) else surface.relief
    if not isinstance(relief, Grid):
        raise RefusedInput("statistics over a baseline: need heights on a grid, not a shape in closed form")
    return relief


def _lag(grid: Grid, baseline_m: float) -> int:
    if not 0 < baseline_m < np.inf:
        raise RefusedInput(f"baseline {baseline_m!r} m: must be positive and finite")
    return max(round(baseline_m / grid.spacing_m), 1)


def _middle(count: int, lag: int) -> slice:
    return slice(lag // 2, count - lag + lag // 2)


def _transposed(known: NDArray[np.bool_] | None) -> NDArray[np.bool_] | None:
    return None if known is None else known.T
