"""RMS deviation of relief by baseline, with an uncertainty from its blocks; parts of a terrain model.

A deviation is that of `sim.terrain_statistics.rms_deviation`. How well the ground's own deviation is known
from one piece of it shows in its blocks: a jackknife leaves one of 4 x 4 out at a time. Blocks share relief
that is larger than they are, so the jackknife alone is too small, at an exponent of 0.8 by a factor of 3. It
is multiplied by what it misses over fractional Brownian surfaces of the exponent that was found: `MISSED`,
from 250 made surfaces each. Relief that is not self-affine beyond the piece is not in it. Beyond an exponent
of 0.9 the factors of 0.9 are taken: on self-affine ground of 0.95 they are too small by a quarter, of 0.98 by
half; but so high an exponent is mostly that of a model made smooth, which they do not describe either.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from operator import itemgetter
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput
from sim.terrain_statistics import plane_fit

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from sim.terrain_grid import Grid

BLOCKS = 4
"""Along each side."""
LONGEST = 0.25
"""Longest baseline, as a part of the shorter side."""
EXPONENTS = (0.2, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
PARTS = (1 / 64, 1 / 16, 1 / 8, 1 / 4)
"""Baselines as parts of the shorter side."""
MISSED = (
    (1.00, 1.11, 1.33, 1.68, 1.60),
    (1.06, 1.25, 1.46, 1.86, 1.76),
    (1.17, 1.38, 1.60, 2.04, 1.93),
    (1.41, 1.61, 1.84, 2.32, 2.19),
    (1.85, 2.01, 2.23, 2.75, 2.58),
    (2.78, 2.84, 2.98, 3.45, 3.13),
    (4.52, 4.51, 4.64, 5.18, 4.03),
)
"""Scatter of deviations over made surfaces by their jackknife, rows by `EXPONENTS`, columns by `PARTS`; the
last column is that of the exponent. To 5 %, tried by the tests. Where no exponent was found, that of 0.8 is
taken."""
MOST_KNOWN = 0.99
"""Of the posts of an area must have data where areas are chosen here."""


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """RMS deviation by baseline, arrays of shape (n,).

    Parameters
    ----------
    baseline_m : ndarray of float64
        As near to what was asked for as whole spacings come, m; 0 where the piece has no such baseline.
    rms_m : ndarray of float64
        Its RMS deviation, m; 0 there.
    u_m : ndarray of float64
        Standard uncertainty as that of the ground, m.
    pairs : ndarray of int64
        Pairs of posts; 0 there.
    hurst : ndarray of float64, shape (2,)
        Slope of log deviation against log baseline and its standard uncertainty, in the same way; NaN with
        fewer than two baselines, on flat ground, and where a block has no data.
    """

    baseline_m: NDArray[np.float64]
    rms_m: NDArray[np.float64]
    u_m: NDArray[np.float64]
    pairs: NDArray[np.int64]
    hurst: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Area:
    """A square of a terrain.

    Parameters
    ----------
    name : str
        What it is.
    x_m, y_m : float
        Its middle.
    side_m : float
        Its side.
    """

    name: str
    x_m: float
    y_m: float
    side_m: float


def profile(grid: Grid, baselines_m: Sequence[float]) -> Profile:
    """Measure RMS deviations, each with its jackknife.

    Parameters
    ----------
    grid : Grid
        Heights.
    baselines_m : sequence of float
        Positive, ascending, m. Those below 0.7 of a spacing or beyond a quarter of the shorter side are left
        out, and so are all but the nearest of those that come to the same number of spacings.
    """
    rows = np.zeros((len(baselines_m), 3))
    pairs = np.zeros(len(baselines_m), dtype=np.int64)
    blocks: dict[float, tuple[NDArray[np.float64], NDArray[np.int64]]] = {}
    for at, lag in _lags(grid, np.asarray(baselines_m)).items():
        sums, counts = block_sums(grid, lag)
        if not counts.sum():
            continue
        pairs[at] = counts.sum()
        baseline_m = lag * grid.spacing_m
        blocks[baseline_m] = (sums, counts)
        rows[at] = baseline_m, np.sqrt(sums.sum() / counts.sum()), _jackknife(sums, counts)
    exponent, u = _hurst(blocks)
    rows[:, 2] *= missed(exponent, rows[:, 0] / (grid.spacing_m * (min(grid.values.shape) - 1)))
    hurst = np.array([exponent, u * missed(exponent)[0]])
    return Profile(rows[:, 0], rows[:, 1], rows[:, 2], pairs, hurst)


def missed(exponent: float, parts: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """Return by how much a jackknife is too small: at baselines, or (None) for the exponent itself."""
    at = 0.8 if np.isnan(exponent) else exponent
    columns = [np.interp(at, EXPONENTS, column) for column in zip(*MISSED, strict=True)]
    if parts is None:
        return np.array(columns[-1:])
    return np.asarray(np.interp(np.log(np.maximum(parts, 1e-9)), np.log(PARTS), columns[:-1]))


def _lags(grid: Grid, baselines_m: NDArray[np.float64]) -> dict[int, int]:
    """Spacings of each baseline that is measured, by its place."""
    spacings = baselines_m / grid.spacing_m
    longest = LONGEST * (min(grid.values.shape) - 1)
    lags = np.maximum(np.round(spacings).astype(int), 1)
    found: dict[int, int] = {}
    for lag in np.unique(lags[(spacings >= np.sqrt(0.5)) & (spacings <= longest)]):
        same = np.flatnonzero((lags == lag) & (spacings >= np.sqrt(0.5)) & (spacings <= longest))
        found[int(same[np.argmin(np.abs(np.log(spacings[same] / lag)))])] = int(lag)
    return found


def block_sums(grid: Grid, lag: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Sums of the squared differences over a lag along both axes, and their number, by block, flat."""
    sums, counts = np.zeros((BLOCKS, BLOCKS)), np.zeros((BLOCKS, BLOCKS), dtype=np.int64)
    for turn in (False, True):
        heights = grid.values.T if turn else grid.values
        if lag >= heights.shape[1]:
            continue
        squared = (heights[:, lag:] - heights[:, :-lag]) ** 2
        if grid.known is None:
            have = np.ones(squared.shape, dtype=np.bool_)
        else:
            known = grid.known.T if turn else grid.known
            have = known[:, lag:] & known[:, :-lag]
            squared = np.where(have, squared, 0.0)
        edges = [np.linspace(0, size, BLOCKS + 1).astype(int) for size in squared.shape]
        for row, column in np.ndindex(BLOCKS, BLOCKS):
            part = np.s_[edges[0][row] : edges[0][row + 1], edges[1][column] : edges[1][column + 1]]
            place = (column, row) if turn else (row, column)
            sums[place] += squared[part].sum()
            counts[place] += int(have[part].sum())
    return sums.ravel(), counts.ravel()


def _jackknife(sums: NDArray[np.float64], counts: NDArray[np.int64]) -> float:
    """Standard uncertainty of the root of the mean square; 0 with fewer than two blocks of data."""
    sums, counts = sums[counts > 0], counts[counts > 0]
    if counts.size < 2:
        return 0.0
    without = np.sqrt((sums.sum() - sums) / (counts.sum() - counts))
    return float(np.sqrt((counts.size - 1) * np.mean((without - without.mean()) ** 2)))


def _hurst(blocks: Mapping[float, tuple[NDArray[np.float64], NDArray[np.int64]]]) -> NDArray[np.float64]:
    """Exponent of all blocks, and its jackknife."""
    sums = np.array([one for one, _ in blocks.values()])
    counts = np.array([count for _, count in blocks.values()])
    if len(blocks) < 2 or not (counts.all() and sums.all()):
        return np.array([np.nan, np.nan])
    across = np.log(list(blocks))
    across -= across.mean()
    whole, left_out = sums.sum(axis=1), sums.T
    each = 0.5 * np.log((whole - left_out) / (counts.sum(axis=1) - counts.T))
    exponents = each @ across / (across @ across)
    exponent = 0.5 * np.log(whole / counts.sum(axis=1)) @ across / (across @ across)
    spread = (exponents.size - 1) * np.mean((exponents - exponents.mean()) ** 2)
    return np.array([exponent, np.sqrt(spread)])


def part_of(grid: Grid, area: Area) -> Grid:
    """Cut an area out; its posts lie within half a side of its middle.

    Raises
    ------
    RefusedInput
        Fewer than two posts a side; `OffTerrain` where none of them has data.
    """
    x_m, y_m = grid.posts()
    half_m = area.side_m / 2 + 1e-9 * grid.spacing_m
    columns = np.flatnonzero(np.abs(x_m - area.x_m) <= half_m)
    rows = np.flatnonzero(np.abs(y_m - area.y_m) <= half_m)
    if min(rows.size, columns.size) < 2:
        (x_min, x_max, y_min, y_max), step_m = grid.bounds, grid.spacing_m
        raise RefusedInput(
            f"area {area.name} of {area.side_m:g} m about ({area.x_m:g}, {area.y_m:g}) m holds {rows.size} x "
            f"{columns.size} posts; the terrain has posts {step_m:g} m apart from ({x_min:g}, {y_min:g}) to "
            f"({x_max:g}, {y_max:g}) m"
        )
    first_row, first = int(rows[0]), int(columns[0])
    part = np.s_[first_row : first_row + rows.size, first : first + columns.size]
    known = None if grid.known is None else grid.known[part]
    x_min_m = grid.x_min_m + first * grid.spacing_m
    y_min_m = grid.y_min_m + first_row * grid.spacing_m
    return replace(grid, values=grid.values[part], x_min_m=x_min_m, y_min_m=y_min_m, known=known)


def tiles_of(grid: Grid, side_m: float, step: float = 1.0) -> list[Area]:
    """Squares that cover a terrain as evenly as whole ones can, `step` of a side apart at most.

    One in the middle, as large as fits, where a side is longer than the terrain.
    """
    x_min, x_max, y_min, y_max = grid.bounds
    side_m = min(side_m, x_max - x_min, y_max - y_min)
    places = []
    for low, high, count in zip((x_min, y_min), (x_max, y_max), tile_counts(grid, side_m, step), strict=True):
        ends = (low + side_m / 2, high - side_m / 2)
        places.append(np.linspace(*ends, count) if count > 1 else np.array([(low + high) / 2]))
    return [Area(f"tile {x:.0f},{y:.0f}", float(x), float(y), side_m) for y in places[1] for x in places[0]]


def tile_counts(grid: Grid, side_m: float, step: float = 1.0) -> tuple[int, int]:
    """Return how many tiles `tiles_of` makes along x and along y."""
    x_min, x_max, y_min, y_max = grid.bounds
    side_m = min(side_m, x_max - x_min, y_max - y_min)
    along_x, along_y = (
        1 + int((length_m - side_m) / (step * side_m) + 1e-9) for length_m in (x_max - x_min, y_max - y_min)
    )
    return along_x, along_y


def typical_areas(grid: Grid, side_m: float) -> tuple[Area, ...]:
    """Choose a sloped, a smooth and a cratered square that do not overlap.

    Sloped: the plane through it is the steepest. Smooth: of the others, the heights scatter least. Cratered:
    of the others, they scatter most about their plane. With few squares the later ones may be missing.
    """
    found = []
    for area in tiles_of(grid, side_m, 0.5):
        piece = part_of(grid, area)
        if piece.known is not None and piece.known.mean() < MOST_KNOWN:
            continue
        x_m, y_m = piece.posts()
        weights = None if piece.known is None else piece.known.astype(np.float64)
        plane = plane_fit(x_m[None, :], y_m[:, None], piece.values, weights)
        climb_m = np.tan(plane.slope_rad) * side_m / np.sqrt(12)
        found.append((area, plane.slope_rad, -float(np.hypot(climb_m, plane.roughness_m)), plane.roughness_m))
    chosen: list[Area] = []
    for by, name in enumerate(("sloped", "smooth", "cratered"), 1):
        free = [one for one in found if not any(_overlap(one[0], other) for other in chosen)]
        if free:
            best = max(free, key=itemgetter(by))
            chosen.append(replace(best[0], name=name))
    return tuple(chosen)


def _overlap(one: Area, other: Area) -> bool:
    near_m = (1 - 1e-9) * (one.side_m + other.side_m) / 2
    return abs(one.x_m - other.x_m) < near_m and abs(one.y_m - other.y_m) < near_m
