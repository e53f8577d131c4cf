"""The ground under the footprints of an arrival curve: made terrain, a terrain model, or a scene's.

The default stands for what the publication used: eleven fractal terrains with a Hurst exponent of 0.8 (paper,
"Analog DTMs"). Their heights are not printed; assumed are RMS deviations of 0.3 to 8 m at 65 m, in geometric
steps, and that each terrain is met on four slopes from 0 to 30 degrees, so that detected widths reach 110 ns.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from msgspec import structs

from belahil.errors import RefusedInput
from sim.laser import Laser
from sim.scene import load_scene
from sim.terrain import tilted
from sim.terrain_build import build_surface
from sim.terrain_dtm import from_geotiff, levelled
from sim.terrain_fractal import monofractal
from sim.terrain_grid import Grid

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sim.terrain import Surface

ROUGHNESS_M = tuple(float(one) for one in np.geomspace(0.3, 8.0, 11))
SLOPES_DEG = (0.0, 10.0, 20.0, 30.0)
ALTITUDES_M = (400e3, 700e3, 1000e3, 1400e3)
"""From the lower end of BELA's orbit to the last altitude at which it ranges (paper)."""

EXTENT_M = 600.0
"""Side of a made terrain, and of the parts of a large one, each with its own zero of height."""
MOST_PARTS = 5
"""Parts along each side of a large terrain; they lie evenly over it."""

_GEOTIFF = (".tif", ".tiff")
_TURN_DEG = 36.0
"""The slopes of terrains do not all point along a row of posts, the worst case of a grid."""


@dataclass(frozen=True, slots=True)
class Ground:
    """Some ground, and the laser that lights it.

    Parameters
    ----------
    name : str
        In a few words.
    surface : Surface
        Over a grid of posts.
    laser : Laser
        Its pointing is not used: each footprint has its place.
    altitudes_m : tuple of float
        From which it is seen, where the user says nothing, m.
    """

    name: str
    surface: Surface
    laser: Laser
    altitudes_m: tuple[float, ...] = ALTITUDES_M


def grounds(terrain: str | None, seed: int) -> Iterator[Ground]:
    """Return the ground, one terrain after the other.

    Parameters
    ----------
    terrain : str or None
        A GeoTIFF; or a scene, ready or as a TOML file, of which laser, ground and altitude are taken. None:
        the default of this module.
    seed : int
        Of made terrain.

    Raises
    ------
    RefusedInput
        The file cannot be read, or the scene's ground is no grid of posts; see `sim.terrain_dtm` and
        `sim.scene`.
    """
    if terrain is None:
        yield from _made(seed)
    elif Path(terrain).suffix.lower() in _GEOTIFF:
        yield from _tiled(Ground("terrain model", from_geotiff(terrain), Laser()))
    else:
        scene = load_scene(terrain)
        surface = build_surface(scene.surface)
        if not isinstance(surface.relief, Grid):
            raise RefusedInput(
                f"--terrain {terrain}: its ground is a {surface.kind}; allowed are fractal, multifractal "
                "and dtm, or the path of a GeoTIFF"
            )
        laser = structs.replace(scene.laser, pointing_rad=(0.0, 0.0))
        yield from _tiled(Ground(f"scene, {surface.kind}", surface, laser, (scene.altitude_m,)))


def _made(seed: int) -> Iterator[Ground]:
    for number, roughness_m in enumerate(ROUGHNESS_M):
        flat = monofractal(extent_m=EXTENT_M, rms_deviation_m=roughness_m, seed=seed + number)
        for turn, slope_deg in enumerate(SLOPES_DEG):
            surface = tilted(flat, slope_deg, _TURN_DEG * (number + turn / len(SLOPES_DEG)))
            name = f"fractal, {roughness_m:.2g} m at 65 m, {slope_deg:g} deg"
            yield Ground(name, surface, Laser())


def _tiled(ground: Ground) -> Iterator[Ground]:
    """Parts of a terrain so large that its heights would spoil the series for the slant path."""
    relief, albedo = ground.surface.relief, ground.surface.albedo
    assert isinstance(relief, Grid)
    side = round(EXTENT_M / relief.spacing_m)
    begins = [_begins(size, side) for size in relief.values.shape]
    if max(map(len, begins)) == 1:
        yield ground
        return
    for row, column in itertools.product(*begins):
        part = np.s_[row : row + side, column : column + side]
        if relief.known is not None and not relief.known[part].any():
            continue
        heights = levelled(_part(relief, part), None)
        shine = _part(albedo, part) if isinstance(albedo, Grid) else albedo
        name = f"{ground.name}, rows from {row}, columns from {column}"
        yield replace(ground, name=name, surface=replace(ground.surface, relief=heights, albedo=shine))


def _begins(size: int, side: int) -> list[int]:
    """First posts of parts along one direction; one part that is all of it up to twice a side."""
    if size <= 2 * side:
        return [0]
    return [round(one) for one in np.linspace(0, size - side, min(MOST_PARTS, size // side))]


def _part(grid: Grid, part: tuple[slice, slice]) -> Grid:
    known = None if grid.known is None else grid.known[part]
    x_min_m = grid.x_min_m + part[1].start * grid.spacing_m
    y_min_m = grid.y_min_m + part[0].start * grid.spacing_m
    return Grid(grid.values[part], grid.spacing_m, x_min_m, y_min_m, known)
