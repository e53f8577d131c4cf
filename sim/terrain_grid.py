"""Numbers on a square grid of posts, some of which may be missing, read bilinearly between the posts.

What this does not model: the ground between two posts. Relief smaller than the spacing is absent from a grid,
and what that does to an echo has to be estimated apart from the accuracy of the arithmetic.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

# A post may be missed by the rounding of x_min + n * spacing: far below anything a surface shows.
_ROUNDING_POSTS = 1e-9


class OffTerrain(RefusedInput):
    """Ground was asked for where the terrain has none: beyond its edge, or without data."""


@dataclass(frozen=True, eq=False)
class Grid:
    """Values at the posts ``(x_min_m + column spacing_m, y_min_m + row spacing_m)``.

    Parameters
    ----------
    values : ndarray of float64, shape (rows, columns)
        At least 2 x 2; a copy is kept, read-only, contiguous, with 0 where the value is missing.
    spacing_m : float
        Between neighbouring posts in both directions, m; positive.
    x_min_m, y_min_m : float
        Place of ``values[0, 0]``, m.
    known : ndarray of bool, shape (rows, columns), or None
        False where there is no data; None when no value is missing.

    Raises
    ------
    RefusedInput
        When the shape or the spacing is not allowed, or a known value is not finite.
    OffTerrain
        When all values are missing.
    """

    values: NDArray[np.float64]
    spacing_m: float
    x_min_m: float
    y_min_m: float
    known: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        values = np.array(self.values, dtype=np.float64, order="C")
        if values.ndim != 2 or min(values.shape) < 2:
            raise RefusedInput(f"a grid of shape {values.shape}: needs at least 2 x 2 posts")
        if not 0 < self.spacing_m < np.inf:
            raise RefusedInput(f"spacing_m = {self.spacing_m!r}: must be positive and finite")
        if not (np.isfinite(self.x_min_m) and np.isfinite(self.y_min_m)):
            raise RefusedInput(f"a grid that begins at ({self.x_min_m!r}, {self.y_min_m!r}): must be finite")
        known = None if self.known is None else np.array(self.known, dtype=np.bool_, order="C")
        if known is not None and known.shape != values.shape:
            raise RefusedInput(f"known of shape {known.shape} for values of shape {values.shape}")
        if known is not None and known.all():
            known = None
        if known is not None:
            if not known.any():
                raise OffTerrain(f"a grid of {values.shape[0]} x {values.shape[1]} posts: no post has data")
            values[~known] = 0.0
            known.setflags(write=False)
        if not np.all(np.isfinite(values)):
            raise RefusedInput("a grid with values that are not finite: mark them as missing")
        values.setflags(write=False)
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "known", known)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """First and last post: x_min, x_max, y_min, y_max, m."""
        rows, columns = self.values.shape
        return (
            self.x_min_m,
            self.x_min_m + (columns - 1) * self.spacing_m,
            self.y_min_m,
            self.y_min_m + (rows - 1) * self.spacing_m,
        )

    def posts(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Coordinates of the columns, shape (columns,), and of the rows, shape (rows,), m."""
        rows, columns = self.values.shape
        x_m = self.x_min_m + self.spacing_m * np.arange(columns, dtype=np.float64)
        y_m = self.y_min_m + self.spacing_m * np.arange(rows, dtype=np.float64)
        return x_m, y_m

    def sample(self, x_m: ArrayLike, y_m: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Interpolate bilinearly.

        Parameters
        ----------
        x_m, y_m : array_like
            Places, m, of shapes that broadcast together.

        Returns
        -------
        values : ndarray of float64
            0 where not known.
        known : ndarray of bool
            False outside of the posts, and where a post that bears on the value is missing.
        """
        rows, columns = self.values.shape
        column, x_part, x_inside = _cell(x_m, self.x_min_m, self.spacing_m, columns)
        row, y_part, y_inside = _cell(y_m, self.y_min_m, self.spacing_m, rows)
        flat = row * columns + column
        corner = self.values.ravel()
        lower = corner[flat] + x_part * (corner[flat + 1] - corner[flat])
        upper = corner[flat + columns] + x_part * (corner[flat + columns + 1] - corner[flat + columns])
        values = lower + y_part * (upper - lower)
        known = np.broadcast_to(x_inside & y_inside, values.shape).copy()
        if self.known is not None:
            have = self.known.ravel()
            left, right = x_part < 1, x_part > 0
            for step, matters in ((0, y_part < 1), (columns, y_part > 0)):
                known &= have[flat + step] | ~(left & matters)
                known &= have[flat + step + 1] | ~(right & matters)
        return np.where(known, values, 0.0), known

    def steepest(self, x_m: float, y_m: float, radius_m: float) -> float:
        """Return the largest gradient of the interpolated values within a disc.

        Parameters
        ----------
        x_m, y_m, radius_m : float
            Centre and radius of the disc, m.

        Returns
        -------
        float
            Value per metre; over whole cells, so that it is never too small. A cell with a missing corner
            does not count.

        Raises
        ------
        OffTerrain
            When no whole cell lies in the disc.

        Notes
        -----
        In a bilinear cell dz/dx depends on y alone and dz/dy on x alone, both linearly. So the largest
        gradient is at a corner, and combines the steeper one of the two edges in each direction.
        """
        rows, columns = self.values.shape
        left, right = _span(x_m, radius_m, self.x_min_m, self.spacing_m, columns)
        low, high = _span(y_m, radius_m, self.y_min_m, self.spacing_m, rows)
        z = self.values[low : high + 1, left : right + 1]
        if min(z.shape) >= 2:
            across = self.x_min_m + self.spacing_m * (np.arange(left, right) + 0.5) - x_m
            along = self.y_min_m + self.spacing_m * (np.arange(low, high) + 0.5) - y_m
            touched = np.hypot(across, along[:, None]) <= radius_m + self.spacing_m * np.sqrt(0.5)
            if self.known is not None:
                have = self.known[low : high + 1, left : right + 1]
                touched &= have[1:, 1:] & have[1:, :-1] & have[:-1, 1:] & have[:-1, :-1]
            if touched.any():
                x_edge = np.abs(np.diff(z, axis=1))
                y_edge = np.abs(np.diff(z, axis=0))
                climb = np.hypot(
                    np.maximum(x_edge[1:], x_edge[:-1]), np.maximum(y_edge[:, 1:], y_edge[:, :-1])
                )
                return float(climb[touched].max() / self.spacing_m)
        raise OffTerrain(f"within {radius_m:g} m of ({x_m:g}, {y_m:g}) m: the terrain has no ground there")


def _cell(
    place_m: ArrayLike, first_m: float, spacing_m: float, count: int
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.bool_]]:
    """Index of the post before each place, the part of the way to the next, and whether it is inside."""
    posts = (np.asarray(place_m, dtype=np.float64) - first_m) / spacing_m
    inside = (posts >= -_ROUNDING_POSTS) & (posts <= count - 1 + _ROUNDING_POSTS)
    posts = np.clip(np.where(inside, posts, 0.0), 0.0, count - 1)
    index = np.minimum(posts.astype(np.int64), count - 2)
    return index, posts - index, inside


def _span(centre_m: float, radius_m: float, first_m: float, spacing_m: float, count: int) -> tuple[int, int]:
    """First and last post of the cells that an interval touches; empty when last <= first."""
    if np.isnan(centre_m + radius_m):
        return 0, -1
    low = np.clip(np.floor((centre_m - radius_m - first_m) / spacing_m), 0, count)
    high = np.clip(np.ceil((centre_m + radius_m - first_m) / spacing_m), -1, count - 1)
    return int(low), int(high)
