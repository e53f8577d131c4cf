"""The ground of the campaigns: the eleven made terrains, and terrain models from files.

The publication's eleven fractals have a Hurst exponent of 0.8 and cover what is known of Mercury; their
heights are not printed. Assumed are the levels of `procedures.arrival_ground`.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

from belahil.errors import RefusedInput
from procedures.arrival_ground import EXTENT_M, ROUGHNESS_M
from sim.terrain_build import build_surface
from sim.terrain_dtm import from_geotiff
from sim.terrain_fractal import monofractal
from sim.terrain_grid import Grid

if TYPE_CHECKING:
    from sim.terrain import Surface

LEVELS = len(ROUGHNESS_M)
BASELINE_M = 65.0
"""At which a level is an RMS deviation."""


def fractal(level: int, seed: int, extent_m: float = EXTENT_M) -> Surface:
    """Make one of the eleven fractals, without a tilt of its own but what chance gives it.

    Parameters
    ----------
    level : int
        0 to 10, the smoothest first.
    seed : int
        Of the eleven; each has one of its own.
    extent_m : float
        Side, m.
    """
    return monofractal(extent_m=extent_m, rms_deviation_m=ROUGHNESS_M[level], seed=seed + level)


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
