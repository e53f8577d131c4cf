"""Terrain models: heights from an array, or from a GeoTIFF through rasterio (the extra ``dtm``).

What this does not model: errors and artefacts of a terrain model, which are taken for ground, and the map
projection, whose scale is taken for 1 and whose grid axes are taken for x and y.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.errors import RefusedInput
from sim.terrain import REFLECTANCE, Kind, Surface
from sim.terrain_grid import Grid, OffTerrain

_METRE = (None, "", "m", "metre", "metres", "meter", "meters")

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


def from_array(
    z_m: ArrayLike,
    spacing_m: float,
    *,
    centre_m: tuple[float, float] = (0.0, 0.0),
    no_data: float | None = None,
    datum_m: float | None = 0.0,
    reflectance: float | Grid = REFLECTANCE,
    kind: Kind = "dtm",
) -> Surface:
    """Make a surface of heights on a square grid.

    Parameters
    ----------
    z_m : array_like, shape (rows, columns)
        Heights, m; rows go with y, columns with x. NaN and the masked values of a masked array are gaps.
    spacing_m : float
        Between neighbouring posts in both directions, m.
    centre_m : tuple of float
        Where nadir is, as seen from the middle of the grid, m.
    no_data : float or None
        A value that stands for a gap.
    datum_m : float or None
        Height that becomes z = 0, m. None: the height at nadir, or the mean where nadir has no data.
    reflectance : float or Grid
        Normal albedo; `albedo_map` makes a map on the same grid.
    kind : str
        What the surface calls itself.

    Raises
    ------
    RefusedInput, OffTerrain
        As `Grid`.
    """
    place = _middle(np.shape(z_m), spacing_m, centre_m)
    grid = _marked(z_m, spacing_m, *place, no_data)
    return Surface(kind, relief=levelled(grid, datum_m), albedo=reflectance)


def albedo_map(
    reflectance: ArrayLike,
    spacing_m: float,
    *,
    centre_m: tuple[float, float] = (0.0, 0.0),
    no_data: float | None = None,
) -> Grid:
    """Make a map of reflectance; parameters and errors as `from_array`."""
    return _marked(reflectance, spacing_m, *_middle(np.shape(reflectance), spacing_m, centre_m), no_data)


def from_geotiff(
    path: str | Path,
    *,
    centre_m: tuple[float, float] = (0.0, 0.0),
    extent_m: float | None = None,
    datum_m: float | None = None,
    band: int = 1,
    reflectance: float | Grid = REFLECTANCE,
) -> Surface:
    """Make a surface of the heights in a GeoTIFF.

    Parameters
    ----------
    path, centre_m, extent_m, band
        As in `read_geotiff`.
    datum_m, reflectance
        As in `from_array`, but with nadir on the ground unless a datum is given.

    Raises
    ------
    RefusedInput, OffTerrain
        As `read_geotiff`.
    """
    grid = read_geotiff(path, centre_m=centre_m, extent_m=extent_m, band=band)
    return Surface("dtm", relief=levelled(grid, datum_m), albedo=reflectance)


def read_geotiff(
    path: str | Path,
    *,
    centre_m: tuple[float, float] = (0.0, 0.0),
    extent_m: float | None = None,
    band: int = 1,
) -> Grid:
    """Read a GeoTIFF whose grid is square and in metres.

    Parameters
    ----------
    path : str or Path
        The file. Its no-data value, its mask and values that are not finite become gaps; its scale and
        offset are applied. A post is the middle of a pixel. Without a coordinate system its unit is taken
        for the metre.
    centre_m : tuple of float
        Where nadir is, as seen from the middle of the file's grid: x along the columns, y up the map, m.
    extent_m : float or None
        Side of the square round nadir to keep, m; only this part is read. None: all.
    band : int
        From 1.

    Returns
    -------
    Grid
        Nadir at (0, 0).

    Raises
    ------
    RefusedInput
        When rasterio is missing, or the file cannot be read, is not in metres, or has no square grid.
    OffTerrain
        When the square lies off the file or has no data.
    """
    rasterio = _rasterio(path)
    try:
        with warnings.catch_warnings():
            # A file without a place is refused below, in our own words.
            warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
            dataset = rasterio.open(path)
    except rasterio.errors.RasterioIOError as error:
        raise RefusedInput(f"{path}: cannot be read as a GeoTIFF: {error}") from error
    with dataset:
        if not 1 <= band <= dataset.count:
            raise RefusedInput(f"{path}: band {band} was asked for, it has 1 to {dataset.count}")
        spacing_m = _spacing_m(path, dataset, band)
        # Rows mostly run down the map; `up` is what one row adds to y, in posts.
        up = -1 if dataset.transform.e < 0 else 1
        column = (dataset.width - 1) / 2 + centre_m[0] / spacing_m
        row = (dataset.height - 1) / 2 + up * centre_m[1] / spacing_m
        left, right = _kept(column, extent_m, spacing_m, dataset.width)
        top, bottom = _kept(row, extent_m, spacing_m, dataset.height)
        if right <= left or bottom <= top:
            raise _off_file(path, centre_m, extent_m, spacing_m, dataset.shape)
        stored = dataset.read(band, window=((top, bottom + 1), (left, right + 1)), masked=True)
        heights = stored.astype(np.float64) * dataset.scales[band - 1] + dataset.offsets[band - 1]
    first_row = bottom if up < 0 else top
    x_min_m, y_min_m = (left - column) * spacing_m, up * (first_row - row) * spacing_m
    try:
        return _marked(heights[::up], spacing_m, x_min_m, y_min_m)
    except OffTerrain as error:
        raise OffTerrain(f"{path}: {error}") from None


def read_array(
    path: str | Path,
    spacing_m: float,
    *,
    centre_m: tuple[float, float] = (0.0, 0.0),
    extent_m: float | None = None,
) -> Grid:
    """Read a grid from a file that `numpy.save` wrote: rows go with y, NaN is a gap.

    Parameters
    ----------
    path, centre_m, extent_m
        As in `read_geotiff`.
    spacing_m : float
        Between neighbouring posts in both directions, m.

    Raises
    ------
    RefusedInput
        When the file cannot be read or holds no grid of numbers.
    OffTerrain
        When the square lies off the array or has no data.
    """
    try:
        stored = np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise RefusedInput(f"{path}: cannot be read as an array: {str(error).splitlines()[0]}") from error
    if not isinstance(stored, np.ndarray) or stored.ndim != 2 or stored.dtype.kind not in "fiu":
        raise RefusedInput(f"{path}: allowed is one array of real numbers with rows and columns")
    if not 0 < spacing_m < np.inf:
        raise RefusedInput(f"{path}: spacing_m = {spacing_m:g}: must be positive and finite")
    column = (stored.shape[1] - 1) / 2 + centre_m[0] / spacing_m
    row = (stored.shape[0] - 1) / 2 + centre_m[1] / spacing_m
    left, right = _kept(column, extent_m, spacing_m, stored.shape[1])
    low, high = _kept(row, extent_m, spacing_m, stored.shape[0])
    if right <= left or high <= low:
        raise _off_file(path, centre_m, extent_m, spacing_m, stored.shape)
    part = stored[low : high + 1, left : right + 1]
    try:
        return _marked(part, spacing_m, (left - column) * spacing_m, (low - row) * spacing_m)
    except OffTerrain as error:
        raise OffTerrain(f"{path}: {error}") from None


def levelled(grid: Grid, datum_m: float | None) -> Grid:
    """Take a height for z = 0; parameters as `from_array`."""
    if datum_m is None:
        at_nadir, known = grid.sample(0.0, 0.0)
        inside = grid.values if grid.known is None else grid.values[grid.known]
        datum_m = float(at_nadir) if known else float(inside.mean())
    return replace(grid, values=grid.values - datum_m) if datum_m else grid


def _rasterio(path: str | Path) -> Any:
    try:
        import rasterio
        import rasterio.errors
    except ImportError as error:
        # Nobody should install it for a name that is mistyped.
        if not Path(path).exists():
            raise RefusedInput(f"{path}: no such file") from None
        raise RefusedInput(
            f"{path}: reading a GeoTIFF needs rasterio ({error}); "
            "install it beside belahil, or give an array (.npy)"
        ) from error
    return rasterio


def _spacing_m(path: str | Path, dataset: Any, band: int) -> float:
    """Spacing of a square grid in metres; anything else is refused."""
    step = dataset.transform
    if dataset.crs is None and step.is_identity:
        raise RefusedInput(f"{path}: does not tell the place and the spacing of its grid")
    if dataset.crs is not None:
        if dataset.crs.is_geographic:
            raise RefusedInput(f"{path}: is in degrees; allowed is a map projection in metres")
        unit, in_metres = dataset.crs.linear_units_factor
        if in_metres != 1:
            raise RefusedInput(f"{path}: its unit of length is the {unit}; allowed is the metre")
    if step.b or step.d or step.a <= 0 or abs(abs(step.e) - step.a) > 1e-6 * step.a:
        raise RefusedInput(
            f"{path}: steps of ({step.a:g}, {step.d:g}) m a column and ({step.b:g}, {step.e:g}) m a row; "
            "allowed is a square grid along the axes"
        )
    if dataset.units[band - 1] not in _METRE:
        raise RefusedInput(f"{path}: heights in {dataset.units[band - 1]!r}; allowed is the metre")
    return float(step.a)


def _kept(centre: float, extent_m: float | None, spacing_m: float, count: int) -> tuple[int, int]:
    """First and last post within half the extent."""
    if extent_m is None:
        return 0, count - 1
    half = extent_m / 2 / spacing_m
    return max(math.ceil(centre - half), 0), min(math.floor(centre + half), count - 1)


def _off_file(
    path: str | Path,
    centre_m: tuple[float, float],
    extent_m: float | None,
    spacing_m: float,
    shape: tuple[int, ...],
) -> OffTerrain:
    whole = "all" if extent_m is None else f"{extent_m:g} m"
    return OffTerrain(
        f"{path}: {whole} round {centre_m} m from the middle holds no 2 x 2 posts of the "
        f"{shape[1] * spacing_m:g} m x {shape[0] * spacing_m:g} m that it covers"
    )


def _marked(
    values: ArrayLike, spacing_m: float, x_min_m: float, y_min_m: float, no_data: float | None = None
) -> Grid:
    """A grid whose gaps are the masked values, NaN, and the value that stands for one."""
    numbers = np.ma.asarray(values).astype(np.float64)
    plain: NDArray[np.float64] = np.ma.getdata(numbers)
    known = ~np.ma.getmaskarray(numbers) & ~np.isnan(plain)
    if no_data is not None:
        known &= plain != no_data
    return Grid(plain, spacing_m, x_min_m, y_min_m, known)


def _middle(shape: tuple[int, ...], spacing_m: float, centre_m: tuple[float, float]) -> tuple[float, float]:
    """Place of the first post when nadir is at `centre_m` from the middle of the grid."""
    if len(shape) != 2:
        raise RefusedInput(f"a grid of shape {shape}: needs rows and columns")
    rows, columns = shape
    return -(columns - 1) / 2 * spacing_m - centre_m[0], -(rows - 1) / 2 * spacing_m - centre_m[1]
