"""Terrain models from arrays and GeoTIFF files, and a real one where it can be had."""

from __future__ import annotations

import math
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from belahil.errors import RefusedInput
from sim.terrain import Surface
from sim.terrain_dtm import albedo_map, from_array, from_geotiff, read_geotiff
from sim.terrain_grid import Grid, OffTerrain
from sim.terrain_statistics import plane_fit, rms_deviation, slope_map

# Three rows down the map, four columns; the last but one of the first row is a gap.
HEIGHTS = np.array([[9.0, 8.0, -9999.0, 6.0], [5.0, 4.0, 3.0, 2.0], [1.0, 0.0, -1.0, -2.0]])


def grid_of(surface: Surface) -> Grid:
    assert isinstance(surface.relief, Grid)
    return surface.relief


# ---- arrays


def test_nadir_may_lie_off_the_middle_of_an_array() -> None:
    surface = from_array(np.arange(20.0).reshape(4, 5), 2.0, centre_m=(2.0, -1.0))

    assert surface.bounds == (-6.0, 2.0, -2.0, 4.0)
    assert surface.height(0.0, 0.0) == 5.0 * 1 + 3.0


@pytest.mark.parametrize("way", ["nan", "masked", "value"])
def test_gaps_of_an_array_are_marked_in_any_way(way: str) -> None:
    heights: Any = np.arange(12.0).reshape(3, 4)
    no_data = None
    if way == "masked":
        heights = np.ma.masked_equal(heights, 6.0)
    elif way == "nan":
        heights[1, 2] = np.nan
    else:
        no_data = 6.0

    grid = grid_of(from_array(heights, 1.0, no_data=no_data))

    assert grid.known is not None
    assert np.argwhere(~grid.known).tolist() == [[1, 2]]
    assert grid.values[1, 2] == 0.0


def test_an_array_without_gaps_has_no_mask() -> None:
    assert grid_of(from_array(np.ma.masked_equal(np.ones((3, 3)), 7.0), 1.0)).known is None


def test_an_array_of_gaps_is_off_the_terrain() -> None:
    with pytest.raises(OffTerrain, match="3 x 4 posts: no post has data"):
        from_array(np.full((3, 4), np.nan), 1.0)


def test_the_datum_is_nadir_or_the_mean_where_nadir_has_none() -> None:
    heights = 1000.0 + np.arange(9.0).reshape(3, 3) ** 2
    holed = heights.copy()
    holed[1, 1] = np.nan

    assert grid_of(from_array(heights, 1.0)).values[1, 1] == 1016.0
    assert grid_of(from_array(heights, 1.0, datum_m=None)).values[1, 1] == 0.0
    level = grid_of(from_array(holed, 1.0, datum_m=None))
    assert level.values.sum() == pytest.approx(0.0, abs=1e-9)
    assert level.values[1, 1] == 0.0


def test_a_map_of_reflectance_may_have_gaps() -> None:
    surface = from_array(
        np.zeros((3, 3)), 1.0, reflectance=albedo_map([[0.1, -1], [0.3, 0.1]], 2.0, no_data=-1)
    )

    sample = surface.sample([-1.0, 1.0], [-1.0, -1.0])

    assert (sample.known.tolist(), sample.reflectance.tolist()) == ([True, False], [0.1, 0.0])


# ---- GeoTIFF


@pytest.fixture
def rasterio() -> Any:
    return pytest.importorskip("rasterio", reason="rasterio is not installed (belahil[dtm])")


def write(rasterio: Any, path: Path, heights: NDArray[Any] = HEIGHTS, **options: Any) -> Path:
    """Write a GeoTIFF of 5 m spacing, north up, with its first corner at (1000, 2000) m."""
    units, scale = options.pop("units", None), options.pop("scale", None)
    profile = {
        "driver": "GTiff",
        "height": heights.shape[-2],
        "width": heights.shape[-1],
        "count": 1 if heights.ndim == 2 else heights.shape[0],
        "dtype": heights.dtype,
        "nodata": -9999,
        "crs": "EPSG:32633",
        "transform": rasterio.Affine(5.0, 0.0, 1000.0, 0.0, -5.0, 2000.0),
    } | options
    with rasterio.open(path, "w", **profile) as dataset:
        dataset.write(heights, *([1] if heights.ndim == 2 else []))
        if units:
            dataset.units = (units,) * dataset.count
        if scale:
            dataset.scales, dataset.offsets = (scale[0],), (scale[1],)
    return path


def test_a_geotiff_lies_north_up_with_nadir_on_the_ground(rasterio: Any, tmp_path: Path) -> None:
    path = write(rasterio, tmp_path / "hill.tif")

    surface = from_geotiff(path, reflectance=0.1)
    raw = from_geotiff(path, datum_m=0.0)

    # given the middle between the second and the third column of the middle row
    grid = grid_of(raw)
    assert (surface.kind, surface.spacing_m, surface.bounds) == ("dtm", 5.0, (-7.5, 7.5, -5.0, 5.0))
    assert np.array_equal(grid.values[::-1], np.where(HEIGHTS == -9999, 0.0, HEIGHTS))
    assert grid.known is not None
    assert np.argwhere(~grid.known).tolist() == [[2, 2]]
    assert raw.height(-7.5, 5.0) == 9.0
    assert raw.height(0.0, 0.0) == 3.5
    assert surface.height([0.0, 7.5], [0.0, -5.0]).tolist() == [0.0, -5.5]
    assert surface.reflectance(0.0, 0.0) == 0.1
    with pytest.raises(OffTerrain):
        surface.height(1.0, 4.0)


@pytest.mark.parametrize("upwards", [False, True])
@pytest.mark.parametrize("extent_m", [None, 20.0])
def test_nadir_and_extent_choose_a_part(
    rasterio: Any, tmp_path: Path, upwards: bool, extent_m: float | None
) -> None:
    """A file whose rows run up the map is the same ground."""
    x, y = np.meshgrid(np.arange(21) * 5.0 - 50, np.arange(11) * 5.0 - 25)
    ground = np.round(100 + 0.3 * x - 0.2 * y + 0.01 * x * y, 6)
    stored, step = (ground, 5.0) if upwards else (ground[::-1].copy(), -5.0)
    path = write(
        rasterio,
        tmp_path / "part.tif",
        stored,
        transform=rasterio.Affine(5.0, 0.0, 0.0, 0.0, step, 0.0),
    )

    part = read_geotiff(path, centre_m=(22.0, 5.0), extent_m=extent_m)

    expected = (-72.0, 28.0, -30.0, 20.0) if extent_m is None else (-7.0, 8.0, -10.0, 10.0)
    assert part.bounds == pytest.approx(expected)
    x_posts, y_posts = part.posts()
    x, y = np.meshgrid(x_posts + 22.0, y_posts + 5.0)
    np.testing.assert_allclose(part.values, 100 + 0.3 * x - 0.2 * y + 0.01 * x * y, atol=1e-6)


def test_scale_offset_and_other_bands_are_read(rasterio: Any, tmp_path: Path) -> None:
    stored = np.array([[1, 2], [3, -9999]], dtype=np.int16)
    scaled = write(rasterio, tmp_path / "scaled.tif", stored, scale=(0.5, 100.0), units="metre")
    two = write(rasterio, tmp_path / "two.tif", np.stack([HEIGHTS, 2 * HEIGHTS]))

    grid = read_geotiff(scaled)

    assert grid.values.tolist() == [[101.5, 0.0], [100.5, 101.0]]
    assert grid.known is not None
    assert grid.known.tolist() == [[True, False], [True, True]]
    assert read_geotiff(two, band=2).values[0, 0] == 2.0


def test_nan_is_a_gap_without_being_declared(rasterio: Any, tmp_path: Path) -> None:
    heights = np.where(HEIGHTS == -9999, np.nan, HEIGHTS).astype(np.float32)

    grid = read_geotiff(write(rasterio, tmp_path / "nan.tif", heights, nodata=None, crs=None))

    assert grid.known is not None
    assert np.argwhere(~grid.known).tolist() == [[2, 2]]


def refusal(path: Path, **options: Any) -> str:
    with pytest.raises(RefusedInput) as refused:
        read_geotiff(path, **options)
    assert "\n" not in str(refused.value)
    assert str(refused.value).startswith(f"{path}: ")
    return str(refused.value)


def test_ground_off_the_file_or_without_data_is_a_typed_error(rasterio: Any, tmp_path: Path) -> None:
    path = write(rasterio, tmp_path / "hill.tif")
    empty = write(rasterio, tmp_path / "empty.tif", np.full((3, 4), -9999.0))

    assert "100 m round (500.0, 0.0) m from the middle holds no 2 x 2 posts of the 20 m x 15 m" in refusal(
        path, centre_m=(500.0, 0.0), extent_m=100
    )
    assert "no post has data" in refusal(empty)
    for options in ({"centre_m": (500.0, 0.0), "extent_m": 100}, {"centre_m": (0.0, -90.0), "extent_m": 10}):
        with pytest.raises(OffTerrain):
            read_geotiff(path, **options)
    with pytest.raises(OffTerrain):
        read_geotiff(empty)


def test_a_file_that_is_no_square_grid_in_metres_is_refused(rasterio: Any, tmp_path: Path) -> None:
    affine = rasterio.Affine
    degrees = write(rasterio, tmp_path / "degrees.tif", crs="EPSG:4326")
    feet = write(rasterio, tmp_path / "feet.tif", crs="EPSG:2263")
    oblong = write(rasterio, tmp_path / "oblong.tif", transform=affine(5.0, 0, 0, 0, -4.0, 0))
    turned = write(rasterio, tmp_path / "turned.tif", transform=affine(4.0, 3.0, 0, 3.0, -4.0, 0))
    heights = write(rasterio, tmp_path / "km.tif", units="km")
    text = tmp_path / "text.tif"
    text.write_text("no picture")

    assert "is in degrees; allowed is a map projection in metres" in refusal(degrees)
    assert "foot" in refusal(feet)
    assert "steps of (5, 0) m a column and (0, -4) m a row; allowed is a square grid" in refusal(oblong)
    assert "allowed is a square grid along the axes" in refusal(turned)
    assert "heights in 'km'; allowed is the metre" in refusal(heights)
    assert "cannot be read as a GeoTIFF" in refusal(text)
    assert "cannot be read as a GeoTIFF" in refusal(tmp_path / "missing.tif")
    assert "band 2 was asked for, it has 1 to 1" in refusal(feet, band=2)


@pytest.mark.filterwarnings("ignore:Dataset has no geotransform")
def test_a_file_without_a_place_is_refused(rasterio: Any, tmp_path: Path) -> None:
    path = write(rasterio, tmp_path / "nowhere.tif", crs=None, transform=None)

    assert "does not tell the place and the spacing" in refusal(path)


def test_without_rasterio_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rasterio", None)
    (tmp_path / "hill.tif").touch()

    message = refusal(tmp_path / "hill.tif")

    assert "needs rasterio" in message
    assert "install it beside belahil, or give an array" in message


def test_without_the_file_nobody_is_sent_for_rasterio(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rasterio", None)

    assert refusal(tmp_path / "hil.tif") == f"{tmp_path / 'hil.tif'}: no such file"


# ---- a real one


@pytest.fixture(scope="module")
def moon() -> Surface:
    pytest.importorskip("rasterio", reason="rasterio is not installed (belahil[dtm])")
    path = os.environ.get("BELAHIL_LUNAR_DTM")
    if not path:
        pytest.skip("BELAHIL_LUNAR_DTM names no lunar terrain model (1 m, 1000 x 1000 posts)")
    return from_geotiff(path, datum_m=0.0)


def test_the_lunar_model_is_read_whole(moon: Surface) -> None:
    grid = grid_of(moon)

    assert (grid.values.shape, grid.spacing_m, grid.known) == ((1000, 1000), 1.0, None)
    assert (round(grid.values.min(), 1), round(grid.values.max(), 1)) == (1006.3, 1090.2)
    assert moon.bounds == (-499.5, 499.5, -499.5, 499.5)


def test_the_lunar_model_has_the_deviations_measured_before(moon: Surface) -> None:
    found = rms_deviation(moon, [5, 20, 65, 100, 200])

    # to the digits that were written down
    written = np.array([0.33, 1.27, 3.91, 5.85, 11.1])
    assert np.all(np.abs(found.rms_m - written) <= [0.005, 0.005, 0.005, 0.005, 0.05])


def test_the_lunar_model_has_the_slopes_measured_before(moon: Surface) -> None:
    slopes = slope_map(moon, 25.0)

    median, steep = np.degrees(np.percentile(slopes.slope_rad[slopes.known], [50, 95]))

    # 4.1 and 8.5 were taken from one post to its two neighbours 25 m on. With the other three pairs of
    # directions that gives 4.13 to 4.19 and 8.40 to 8.60; differences about one place lie in between.
    assert (median, steep) == (pytest.approx(4.1, abs=0.1), pytest.approx(8.5, abs=0.1))


def test_the_lunar_model_has_the_roughness_measured_before(moon: Surface) -> None:
    heights = grid_of(moon).values
    y, x = np.mgrid[:25, :25] - 12.0
    fits = [
        plane_fit(x, y, heights[row : row + 25, column : column + 25])
        for row in range(0, 1000, 25)
        for column in range(0, 1000, 25)
    ]

    roughness_m = np.percentile([fit.roughness_m for fit in fits], [50, 5, 95])
    skewness = np.std([fit.skewness for fit in fits if fit.skewness is not None])

    # Which squares of 25 m were taken is not known. With steps of 5 to 50 m between them the four numbers are
    # 0.0504-0.0528, 0.0096-0.0110, 0.169-0.182 m and 0.457-0.497.
    assert np.all(np.abs(roughness_m - np.array([0.052, 0.011, 0.175])) <= [0.0016, 0.0014, 0.007])
    assert skewness == pytest.approx(0.47, abs=0.03)


def test_a_footprint_on_the_lunar_model_is_ground_and_beside_it_is_not(moon: Surface) -> None:
    along = np.arange(-25, 26) * 1.0
    x, y = np.meshgrid(along, along)

    sample = moon.sample(x + 490.0, y)

    assert sample.known.sum() == 51 * 35
    assert math.degrees(moon.steepest(0.0, 0.0, 25.0)) < 45
    with pytest.raises(OffTerrain):
        moon.sample(x + 600.0, y)
