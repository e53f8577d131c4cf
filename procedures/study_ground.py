"""The ground of the campaigns: the eleven made terrains, and terrain models from files.

The publication's eleven fractals have a Hurst exponent of 0.8 and cover what is known of Mercury; their
heights are not printed. Assumed are the levels of `procedures.arrival_ground`.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput
from procedures.arrival_ground import EXTENT_M, ROUGHNESS_M
from sim.terrain_build import build_surface
from sim.terrain_dtm import from_geotiff
from sim.terrain_fractal import monofractal
from sim.terrain_grid import Grid

if TYPE_CHECKING:
    from sim.terrain import Surface

LEVELS = len(ROUGHNESS_M)
HURST = 0.8
"""Of the fractals (paper, "Analog DTMs")."""
_SIDES_M = (EXTENT_M, 0.75 * EXTENT_M, 0.5 * EXTENT_M)
"""Of squares of a terrain model: the largest of which there is one without gaps."""
_SHIFTS = 16
"""Places along a side of a square at which the next is looked for where there is a gap."""
BASELINE_M = 65.0
"""At which a level is an RMS deviation."""


def fractal(level: int, seed: int, extent_m: float = EXTENT_M, hurst: float = HURST) -> Surface:
    """Make one of the eleven fractals, without a tilt of its own but what chance gives it.

    Parameters
    ----------
    level : int
        0 to 10, the smoothest first.
    seed : int
        Of the eleven; each has one of its own.
    extent_m : float
        Side, m.
    hurst : float
        Hurst exponent.
    """
    return monofractal(extent_m=extent_m, hurst=hurst, rms_deviation_m=ROUGHNESS_M[level], seed=seed + level)


def terrain_file(path: str) -> Surface:
    """Read a terrain model: a GeoTIFF, or the ground of a scene that is a grid of posts.

    Raises
    ------
    RefusedInput
        It cannot be read, or the scene's ground is no grid.
    """
    from sim.scene import load_scene

    if Path(path).suffix.lower() in (".tif", ".tiff"):
        return from_geotiff(path)
    surface = build_surface(load_scene(path).surface)
    if not isinstance(surface.relief, Grid):
        raise RefusedInput(
            f"{path}: its ground is a {surface.kind}; allowed are fractal, multifractal and dtm, or the path "
            "of a GeoTIFF"
        )
    return surface


def digest(path: str) -> str:
    """Return a digest of a file, so that what was computed from another content is not taken for its own.

    A ready scene, which is no file, has its name as digest.

    Raises
    ------
    RefusedInput
        It cannot be read.
    """
    from sim.scene import ready_scenes

    if path in ready_scenes():
        return path
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()[:16]
    except OSError as error:
        raise RefusedInput(f"{path}: cannot be read ({error.strerror or error})") from error


def gapless_squares(relief: Grid, most: int = LEVELS) -> tuple[Grid, ...]:
    """Cut squares of one size without gaps out of a terrain model, each made level as the fractals are.

    Squares, because heights of a large model are not small against the altitude, which the slant path needs.
    Level, because the slope that a campaign asks for must occur when they are tilted.

    Parameters
    ----------
    relief : Grid
        With or without gaps.
    most : int
        Squares at most, evenly over the model.

    Returns
    -------
    tuple of Grid
        They do not overlap. As wide as the fractals, or narrower where the model or its gaps leave no such
        square; the whole of a square model up to twice as wide that has no gaps.

    Raises
    ------
    RefusedInput
        Not even one of half the width of the fractals.
    """
    shortest = min(relief.values.shape)
    sides = [round(side_m / relief.spacing_m) + 1 for side_m in _SIDES_M]
    if shortest <= 2 * sides[0]:
        sides = [shortest, *(side for side in sides if side < shortest)]
    for side in sides:
        corners = _without_gaps(relief, side) if side <= shortest else []
        if corners:
            at = np.unique(np.linspace(0, len(corners) - 1, min(most, len(corners))).round().astype(int))
            return tuple(_level(relief, corners[one], side) for one in at)
    rows, columns = relief.values.shape
    raise RefusedInput(
        f"a terrain model of {rows} x {columns} posts {relief.spacing_m:g} m apart has no square of "
        f"{_SIDES_M[-1]:g} m without gaps; one is needed"
    )


def _without_gaps(relief: Grid, side: int) -> list[tuple[int, int]]:
    """First posts of squares that do not overlap and have no gaps, band by band."""
    known = np.ones(relief.values.shape, dtype=np.int64) if relief.known is None else relief.known
    sums = np.pad(np.cumsum(np.cumsum(known, axis=0, dtype=np.int64), axis=1), ((1, 0), (1, 0)))
    step, found, row = max(1, side // _SHIFTS), [], 0
    while row + side <= known.shape[0]:
        band, column = [], 0
        while column + side <= known.shape[1]:
            far = row + side, column + side
            posts = sums[far] - sums[row, far[1]] - sums[far[0], column] + sums[row, column]
            if posts == side**2:
                band.append((row, column))
            column += side if posts == side**2 else step
        found += band
        row += side if band else step
    return found


def _level(relief: Grid, corner: tuple[int, int], side: int) -> Grid:
    """Cut a square out and take its mean and its plane off."""
    row, column = corner
    values = relief.values[row : row + side, column : column + side]
    away = np.arange(side) - (side - 1) / 2
    plane = (values @ away).sum() * away + ((away @ values).sum() * away)[:, None]
    return Grid(values - values.mean() - plane / (side * away @ away), relief.spacing_m, 0.0, 0.0)
