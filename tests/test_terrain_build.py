"""The ``[surface]`` table of a scene, made into ground."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from belahil.errors import ConfigError, RefusedInput
from sim.scene_tables import SurfaceTable
from sim.terrain import Surface, boulder, crater, plane
from sim.terrain_build import build_surface
from sim.terrain_dtm import from_array
from sim.terrain_fractal import monofractal, multifractal
from sim.terrain_grid import Grid, OffTerrain

LEANING = {"slope_deg": 10.0, "azimuth_deg": 30.0, "reflectance": 0.08}
ROUND = {"diameter_m": 18.0, "exponent": 3.0, "centre_m": (2.0, -1.0)}
MADE = {
    "extent_m": 30.0,
    "spacing_m": 1.5,
    "baseline_m": 6.0,
    "rms_deviation_m": 0.4,
    "seed": 9,
    "hurst": 0.7,
}
X, Y = np.meshgrid(np.linspace(-12, 12, 9), np.linspace(-12, 12, 9))


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        (SurfaceTable("plane", **LEANING), plane(10.0, 30.0, reflectance=0.08)),
        (
            SurfaceTable("crater", depth_m=4.0, rim_height_m=0.1, **ROUND, **LEANING),
            crater(18.0, 4.0, rim_height_m=0.1, exponent=3.0, centre_m=(2.0, -1.0), **LEANING),
        ),
        (
            SurfaceTable("boulder", height_m=4.0, **ROUND, **LEANING),
            boulder(18.0, 4.0, exponent=3.0, centre_m=(2.0, -1.0), **LEANING),
        ),
        (SurfaceTable("fractal", **MADE, **LEANING), monofractal(**MADE, **LEANING)),
        (
            SurfaceTable("multifractal", alpha=1.6, c1=0.05, **MADE, **LEANING),
            multifractal(alpha=1.6, c1=0.05, **MADE, **LEANING),
        ),
    ],
    ids=lambda one: one.kind,
)
def test_every_key_reaches_the_ground(table: SurfaceTable, expected: Surface) -> None:
    found = build_surface(table)

    assert found.kind == expected.kind == table.kind
    assert np.array_equal(found.height(X, Y), expected.height(X, Y))
    assert found.reflectance(0.0, 0.0) == expected.reflectance(0.0, 0.0) == 0.08


def saved(path: Path, values: NDArray[Any]) -> str:
    np.save(path, values)
    return str(path)


HEIGHTS = 1000.0 + np.arange(63.0).reshape(7, 9)


def test_an_array_file_is_a_terrain_model(tmp_path: Path) -> None:
    path = saved(tmp_path / "hill.npy", HEIGHTS)

    whole = build_surface(SurfaceTable("dtm", file=path, spacing_m=2.0))
    part = build_surface(
        SurfaceTable("dtm", file=path, spacing_m=2.0, centre_m=(4.0, 2.0), extent_m=9.0, datum_m=1000.0)
    )

    expected = from_array(HEIGHTS, 2.0, datum_m=None)
    assert whole.bounds == expected.bounds
    assert np.array_equal(whole.height(X / 2, Y / 2), expected.height(X / 2, Y / 2))
    # posts within 4.5 m of nadir: two to each side, of which the array has all
    assert part.bounds == (-4.0, 4.0, -4.0, 4.0)
    assert part.height(0.0, 0.0) == HEIGHTS[4, 6] - 1000.0


def test_a_map_takes_the_place_of_the_reflectance(tmp_path: Path) -> None:
    heights = saved(tmp_path / "hill.npy", HEIGHTS)
    albedo = np.full((7, 9), 0.1)
    albedo[3, 4] = np.nan
    path = saved(tmp_path / "albedo.npy", albedo)

    surface = build_surface(SurfaceTable("dtm", file=heights, spacing_m=2.0, reflectance_map=path))

    assert isinstance(surface.albedo, Grid)
    assert surface.reflectance(4.0, 4.0) == pytest.approx(0.1)
    assert surface.sample([0.0, 4.0], [0.0, 4.0]).known.tolist() == [False, True]


def test_a_map_on_another_grid_is_refused(tmp_path: Path) -> None:
    path = saved(tmp_path / "albedo.npy", np.full((5, 5), 0.1))

    with pytest.raises(
        ConfigError, match=r"reflectance_map = .*albedo.npy: 5 x 5 posts .* 21 x 21 posts 1.5 m"
    ):
        build_surface(SurfaceTable("fractal", reflectance_map=path, **MADE))
    with pytest.raises(ConfigError, match="the grid of the heights, which is none"):
        build_surface(SurfaceTable("plane", reflectance_map=path))


def test_a_geotiff_is_a_terrain_model(tmp_path: Path) -> None:
    rasterio = pytest.importorskip("rasterio", reason="rasterio is not installed (belahil[dtm])")
    path = tmp_path / "hill.tif"
    transform = rasterio.Affine(2.0, 0.0, 0.0, 0.0, -2.0, 0.0)
    profile = {"width": 9, "height": 7, "count": 1, "dtype": "float64", "transform": transform}
    with rasterio.open(path, "w", driver="GTiff", **profile) as dataset:
        dataset.write(HEIGHTS[::-1], 1)

    surface = build_surface(SurfaceTable("dtm", file=str(path)))

    assert np.array_equal(
        surface.height(X / 2, Y / 2), from_array(HEIGHTS, 2.0, datum_m=None).height(X / 2, Y / 2)
    )


@pytest.mark.parametrize(
    ("values", "options", "words", "off_terrain"),
    [
        (b"", {}, "cannot be read as an array", False),
        (b"text", {}, "cannot be read as an array", False),
        (np.zeros(4), {}, "allowed is one array of real numbers with rows and columns", False),
        (np.zeros((3, 3), dtype=complex), {}, "real numbers", False),
        (np.zeros((3, 3)), {"spacing_m": 0.0}, "spacing_m = 0: must be positive", False),
        (np.zeros((3, 3)), {"centre_m": (900.0, 0.0)}, r"768 m round \(900.0, 0.0\) m", True),
        (np.zeros((3, 3)), {"extent_m": 0.1}, "holds no 2 x 2 posts of the 4.5 m x 4.5 m", True),
        (np.full((3, 3), np.nan), {}, "no post has data", True),
    ],
)
def test_an_array_that_is_no_terrain_is_refused_in_one_line(
    tmp_path: Path, values: bytes | NDArray[Any], options: dict[str, Any], words: str, off_terrain: bool
) -> None:
    path = tmp_path / "hill.npy"
    if isinstance(values, bytes):
        path.write_bytes(values)
    else:
        np.save(path, values)

    with pytest.raises(RefusedInput, match=words) as refusal:
        build_surface(SurfaceTable("dtm", file=str(path), **options))

    assert str(refusal.value).startswith(f"{path}: ")
    assert "\n" not in str(refusal.value)
    assert isinstance(refusal.value, OffTerrain) == off_terrain
