"""Slope, roughness and skewness of the heights in single footprints, post by post.

*Slope* and *roughness* are the tilt of, and the standard deviation about, the least-squares plane over the
disc within which the beam is above 1/e^2 of its peak, every post alike; as an option all posts count by the
beam. *Skewness* is the third standardized moment about that plane.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput
from procedures.footprint_planes import EDGE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim.terrain_grid import Grid

_REACH = 4.5
"""Standard deviations after which the beam counts as dark."""
_FEWEST = 9
_AT_ONCE = 512


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """Footprints, arrays of shape (n,).

    Parameters
    ----------
    slope_deg, azimuth_deg : ndarray of float64
        Of the plane; direction of steepest ascent.
    roughness_m : ndarray of float64
        Standard deviation about it, m.
    skewness : ndarray of float64
        About it; 0 on ground that is flat to its last digits.
    raw_skewness : ndarray of float64
        Of the heights themselves, with the slope in them.
    """

    slope_deg: NDArray[np.float64]
    azimuth_deg: NDArray[np.float64]
    roughness_m: NDArray[np.float64]
    skewness: NDArray[np.float64]
    raw_skewness: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Disc:
    """Posts about the middle of a footprint.

    Parameters
    ----------
    rows, columns : ndarray of int64, shape (k,)
        From the middle.
    weights : ndarray of float64, shape (k,)
        Sum 1.
    """

    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    weights: NDArray[np.float64]

    @property
    def reach(self) -> int:
        """Posts from the middle at most."""
        return int(np.abs(self.rows).max())


def disc(spacing_m: float, sigma_m: float, *, across_m: float | None = None, by_beam: bool = False) -> Disc:
    """Return the posts that count.

    Parameters
    ----------
    spacing_m : float
        Between posts, m.
    sigma_m : float
        Standard deviation of the beam on the ground along x, m.
    across_m : float or None
        And along y, m; None: the same, a round beam.
    by_beam : bool
        Count posts by the beam; else those of the 1/e^2 disc alike.

    Raises
    ------
    RefusedInput
        Fewer than nine posts.
    """
    across_m = sigma_m if across_m is None else across_m
    edge_m = (_REACH if by_beam else EDGE) * sigma_m
    reach = int(max(edge_m, edge_m / sigma_m * across_m) / spacing_m)
    row, column = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    squares = spacing_m**2 * ((sigma_m / across_m * row) ** 2 + column**2)
    inside = squares <= edge_m**2
    if inside.sum() < _FEWEST:
        raise RefusedInput(
            f"a footprint of {sigma_m:.3g} m rms on posts {spacing_m:g} m apart holds {inside.sum()} posts; "
            f"at least {_FEWEST} are needed"
        )
    weights = np.exp(-0.5 * squares / sigma_m**2) if by_beam else np.ones(squares.shape)
    return Disc(row[inside], column[inside], weights[inside] / weights[inside].sum())


def moments(heights_m: NDArray[np.float64], posts: Disc, spacing_m: float) -> Moments:
    """Describe footprints by the heights of their posts.

    Parameters
    ----------
    heights_m : ndarray of float64, shape (n, k)
        At the posts of the disc, m.
    posts : Disc
        The disc: even about both axes, so that mean and both gradients are independent.
    spacing_m : float
        Between posts, m.
    """
    w, x, y = posts.weights, spacing_m * posts.columns, spacing_m * posts.rows
    # From the first post first: a datum of a planet's radius must not cost digits.
    about = heights_m - heights_m[:, :1]
    about -= (about @ w)[:, None]
    gx, gy = about @ (w * x) / (w @ x**2), about @ (w * y) / (w @ y**2)
    left = about - gx[:, None] * x - gy[:, None] * y
    roughness_m = np.sqrt(left**2 @ w)
    return Moments(
        np.degrees(np.arctan(np.hypot(gx, gy))),
        np.degrees(np.arctan2(gy, gx)),
        roughness_m,
        _skewness(left, w, np.abs(heights_m).max(axis=1)),
        _skewness(about, w, np.abs(heights_m).max(axis=1)),
    )


def _skewness(
    about: NDArray[np.float64], weights: NDArray[np.float64], highest_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    spread = np.sqrt(about**2 @ weights)
    rough = spread > 4 * np.finfo(np.float64).eps * highest_m
    safe = np.where(rough, spread, 1.0)
    return np.where(rough, about**3 @ weights / safe**3, 0.0)


def described(
    relief: Grid, row: NDArray[np.int64], column: NDArray[np.int64], posts: Disc
) -> tuple[Moments, NDArray[np.bool_]]:
    """Describe footprints about posts of a terrain, and tell which have data everywhere.

    Parameters
    ----------
    relief : Grid
        Heights.
    row, column : ndarray of int64, shape (n,)
        Posts in the middle, at least the disc's reach from the edge.
    posts : Disc
        The disc.
    """
    parts, whole = [], []
    for begin in range(0, row.size, _AT_ONCE):
        at = (
            row[begin : begin + _AT_ONCE, None] + posts.rows,
            column[begin : begin + _AT_ONCE, None] + posts.columns,
        )
        parts.append(moments(relief.values[at], posts, relief.spacing_m))
        have = np.ones(at[0].shape[0], dtype=bool) if relief.known is None else relief.known[at].all(axis=1)
        whole.append(have)
    joined = (np.concatenate([getattr(one, name) for one in parts]) for name in Moments.__slots__)
    return Moments(*joined), np.concatenate(whole)


def white_skewness(
    posts: Disc, spacing_m: float, count: int, stream: np.random.Generator
) -> NDArray[np.float64]:
    """Draw the skewness of footprints whose heights are white noise, shape (count,)."""
    found = [
        moments(
            stream.standard_normal((min(_AT_ONCE, count - at), posts.rows.size)), posts, spacing_m
        ).skewness
        for at in range(0, count, _AT_ONCE)
    ]
    return np.concatenate(found)


def even_places(
    relief: Grid, margin_m: float, per_side: int | None, apart_m: float
) -> tuple[NDArray[np.int64], ...]:
    """Return rows and columns of posts that lie evenly over a terrain.

    Parameters
    ----------
    relief : Grid
        The terrain.
    margin_m : float
        Kept free along its edge, m.
    per_side : int or None
        Along each side; None: as many as fit `apart_m` apart.
    apart_m : float
        For None, m.

    Raises
    ------
    RefusedInput
        No room.
    """
    margin = math.ceil(margin_m / relief.spacing_m)
    found = []
    for size in relief.values.shape:
        room = size - 1 - 2 * margin
        if room < 0:
            raise RefusedInput(
                f"{size} posts {relief.spacing_m:g} m apart have no room for a footprint with "
                f"{margin_m:.4g} m on either side"
            )
        count = per_side or 1 + int(room * relief.spacing_m / apart_m)
        low, high = (margin, size - 1 - margin) if count > 1 else ((size - 1) // 2, (size - 1) // 2)
        found.append(np.round(np.linspace(low, high, count)).astype(np.int64))
    row, column = np.meshgrid(*found, indexing="ij")
    return row.ravel(), column.ravel()
