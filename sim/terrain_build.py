"""From the ``[surface]`` table of a scene to the ground."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, assert_never

from belahil.errors import ConfigError
from sim.terrain import Surface, boulder, crater, plane
from sim.terrain_dtm import levelled, read_array, read_geotiff
from sim.terrain_fractal import monofractal, multifractal
from sim.terrain_grid import Grid

if TYPE_CHECKING:
    from sim.scene_tables import SurfaceTable


def build_surface(table: SurfaceTable) -> Surface:
    """Make the ground of a scene.

    Parameters
    ----------
    table : SurfaceTable
        A file that ends in ``.npy`` is an array, any other a GeoTIFF.

    Raises
    ------
    RefusedInput
        When a number or a file is not allowed; `ConfigError` when the map has another grid than the heights.
    OffTerrain
        When a file has no data where they are asked for.
    """
    surface = _ground(table)
    if not table.reflectance_map:
        return surface
    reflectance = _read(table, table.reflectance_map)
    heights = surface.relief
    if not isinstance(heights, Grid) or not _same_posts(heights, reflectance):
        raise ConfigError(
            f"[surface] reflectance_map = {table.reflectance_map}: {_told(reflectance)}; "
            f"allowed is the grid of the heights, {_told(heights)}"
        )
    return replace(surface, albedo=reflectance)


def _ground(table: SurfaceTable) -> Surface:
    match table.kind:
        case "plane":
            return plane(table.slope_deg, table.azimuth_deg, reflectance=table.reflectance)
        case "crater":
            return crater(
                table.diameter_m,
                table.depth_m,
                rim_height_m=table.rim_height_m,
                exponent=table.exponent,
                centre_m=table.centre_m,
                slope_deg=table.slope_deg,
                azimuth_deg=table.azimuth_deg,
                reflectance=table.reflectance,
            )
        case "boulder":
            return boulder(
                table.diameter_m,
                table.height_m,
                exponent=table.exponent,
                centre_m=table.centre_m,
                slope_deg=table.slope_deg,
                azimuth_deg=table.azimuth_deg,
                reflectance=table.reflectance,
            )
        case "fractal" | "multifractal":
            return _fractal(table)
        case "dtm":
            grid = levelled(_read(table, table.file), table.datum_m)
            return Surface("dtm", relief=grid, albedo=table.reflectance)
        case _:
            assert_never(table.kind)


def _fractal(table: SurfaceTable) -> Surface:
    if table.kind == "fractal":
        surface = monofractal(
            extent_m=table.extent_m,
            spacing_m=table.spacing_m,
            hurst=table.hurst,
            rms_deviation_m=table.rms_deviation_m,
            baseline_m=table.baseline_m,
            seed=table.seed,
            slope_deg=table.slope_deg,
            azimuth_deg=table.azimuth_deg,
        )
    else:
        surface = multifractal(
            extent_m=table.extent_m,
            spacing_m=table.spacing_m,
            hurst=table.hurst,
            alpha=table.alpha,
            c1=table.c1,
            rms_deviation_m=table.rms_deviation_m,
            baseline_m=table.baseline_m,
            seed=table.seed,
            slope_deg=table.slope_deg,
            azimuth_deg=table.azimuth_deg,
        )
    return replace(surface, albedo=table.reflectance)


def _read(table: SurfaceTable, path: str) -> Grid:
    # Only a terrain model has a centre: the check of scenes refuses it for the other grids.
    if Path(path).suffix == ".npy":
        return read_array(path, table.spacing_m, centre_m=table.centre_m, extent_m=table.extent_m)
    return read_geotiff(path, centre_m=table.centre_m, extent_m=table.extent_m)


def _same_posts(one: Grid, other: Grid) -> bool:
    gaps = [abs(a - b) for a, b in zip(one.bounds, other.bounds, strict=True)]
    return one.values.shape == other.values.shape and max(gaps) < 1e-6 * one.spacing_m


def _told(grid: object) -> str:
    if not isinstance(grid, Grid):
        return "which is none"
    rows, columns = grid.values.shape
    return f"{rows} x {columns} posts {grid.spacing_m:g} m apart"
