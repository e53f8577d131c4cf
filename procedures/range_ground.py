"""The ground of the range campaign: terrains side by side, tilted.

The fractals have a Hurst exponent of 0.8 (paper, "Analog DTMs"); their heights are not printed and assumed,
as `procedures.arrival_ground` tells. Each is tilted so that the slope that is asked for occurs, towards
another side than its neighbour.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from belahil.chunks import Chunk, shared
from procedures.arrival_ground import EXTENT_M
from procedures.footprint_planes import FootprintPlanes
from procedures.study_ground import HURST, LEVELS, fractal, gapless_squares, terrain_file
from sim.terrain import Surface, gradient_of
from sim.terrain_grid import Grid

if TYPE_CHECKING:
    from typing import Any

    from numpy.typing import NDArray

SPACING_M = 1.5
TURN_DEG = 36.0
"""From the tilt of one fractal to that of the next: none of them all along a row of posts."""
MODEL = "model:"
"""Before the name of a terrain model in the kind of a ground."""

_FRACTAL = "procedures.range_ground:fractal_heights"


@dataclass(frozen=True, slots=True)
class GroundKey:
    """Which ground.

    Parameters
    ----------
    kind : str
        "fractal", "plane", or `MODEL` and the path or scene of a terrain model, which may be called so too.
    seed : int
        Of the smoothest fractal; the others have the next ones.
    tilt_deg : float
        Slope of the plane that is added to each terrain.
    factor : float
        By which heights are multiplied before.
    digest : str
        Of a terrain model's content, so that another one under the same name is not taken for it.
    hurst : float
        Exponent of the fractals; their RMS deviations at 65 m stay.
    """

    kind: str = "fractal"
    seed: int = 100
    tilt_deg: float = 10.0
    factor: float = 1.0
    digest: str = ""
    hurst: float = HURST


class Strips:
    """Square terrains of one spacing in a row along x, each tilted about its own middle.

    Parameters
    ----------
    flats : tuple of Grid
        Before the tilt, in their own coordinates, of one shape.
    tilt_deg : float
        Slope of the planes, the first towards +x.

    Attributes
    ----------
    surface : Surface
        All of them, with a reflectance of 1; nadir is in the middle one.
    """

    def __init__(self, flats: tuple[Grid, ...], tilt_deg: float) -> None:
        side, step = flats[0].values.shape[0], flats[0].spacing_m
        self.spacing_m, self.flats = step, flats
        self.away_m = step * (np.arange(side) - (side - 1) / 2)
        self.middles_m = side * step * (np.arange(len(flats)) - len(flats) // 2)
        self.gradients = tuple(gradient_of(tilt_deg, TURN_DEG * number) for number in range(len(flats)))
        tilted = [
            one.values + gx * self.away_m + (gy * self.away_m)[:, None]
            for one, (gx, gy) in zip(flats, self.gradients, strict=True)
        ]
        corner_m = float(self.away_m[0])
        relief = Grid(np.concatenate(tilted, axis=1), step, float(self.middles_m[0]) + corner_m, corner_m)
        self.surface = Surface("fractal", relief=relief, albedo=1.0)

    def planes(self, flat: tuple[FootprintPlanes, ...]) -> tuple[FootprintPlanes, ...]:
        """Tilt what `described` says of the flat terrains."""
        found = []
        for one, gradient in zip(flat, self.gradients, strict=True):
            inner = self.away_m[one.margin : self.away_m.size - one.margin]
            found.append(one.tilted(gradient, inner, inner))
        return tuple(found)


@lru_cache(maxsize=3)
def flat_terrains(kind: str, seed: int, factor: float, hurst: float = HURST) -> tuple[Grid, ...]:
    """Return the terrains of a ground before their tilt, each about its mean height.

    Raises
    ------
    RefusedInput
        A terrain model that cannot be read, or has no square without gaps; see `procedures.study_ground`.
    """
    if kind == "plane":
        posts = round(EXTENT_M / SPACING_M) + 1
        return (Grid(np.zeros((posts, posts)), SPACING_M, 0.0, 0.0),)
    if kind == "fractal":
        made = [shared(_FRACTAL, _of_level(level, seed, hurst)) for level in range(LEVELS)]
        reliefs = [Grid(one["height_m"], SPACING_M, 0.0, 0.0) for one in made]
    else:
        reliefs = list(gapless_squares(_relief(terrain_file(kind.removeprefix(MODEL)))))
    return tuple(Grid(factor * (one.values - one.values.mean()), one.spacing_m, 0.0, 0.0) for one in reliefs)


def fractal_heights(level: int, seed: int, hurst: float) -> dict[str, NDArray[np.float64]]:
    """Make one of the fractals, as the work of a chunk: ``height_m`` of shape (posts, posts)."""
    return {"height_m": _relief(fractal(level, seed, hurst=hurst)).values}


def fractal_chunks(seed: int, hurst: float) -> list[Chunk]:
    """Return the work of the fractals: done first, `flat_terrains` finds them in reach."""
    return [
        Chunk(f"fractal {level} of seed {seed}, exponent {hurst:g}", _FRACTAL, _of_level(level, seed, hurst))
        for level in range(LEVELS)
    ]


def _of_level(level: int, seed: int, hurst: float) -> dict[str, Any]:
    return {"level": level, "seed": seed, "hurst": hurst}


def _relief(surface: Surface) -> Grid:
    assert isinstance(surface.relief, Grid)
    return surface.relief


@lru_cache(maxsize=2)
def strips(ground: GroundKey) -> Strips:
    """Return a ground: 15 MB."""
    return Strips(flat_terrains(ground.kind, ground.seed, ground.factor, ground.hurst), ground.tilt_deg)
