"""The ground of the range campaign: terrains side by side, tilted, and places of a slope on them.

The fractals have a Hurst exponent of 0.8 (paper, "Analog DTMs"); their heights are not printed and assumed,
as `procedures.arrival_ground` tells. Each is tilted so that the slope that is asked for occurs, towards
another side than its neighbour; footprints are places whose plane has that slope, as many on each fractal.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from belahil.chunks import Chunk, shared
from belahil.errors import RefusedInput
from procedures.arrival_ground import EXTENT_M
from procedures.footprint_planes import FootprintPlanes, footprint_planes
from procedures.range_truth import USUAL, Definitions
from procedures.study_ground import HURST, LEVELS, fractal, gapless_squares, terrain_file
from sim.constants import SPEED_OF_LIGHT_M_PER_S
from sim.terrain import Surface, gradient_of
from sim.terrain_grid import Grid

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

    from numpy.typing import NDArray

    from sim.draws import Draws

SPACING_M = 1.5
TURN_DEG = 36.0
"""From the tilt of one fractal to that of the next: none of them all along a row of posts."""
MODEL = "model:"
"""Before the name of a terrain model in the kind of a ground."""

_MARGIN = 4.9
"""Standard deviations of the beam that no footprint lies nearer to an edge: room for the jitter."""
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


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """Footprints, arrays of shape (n,).

    Parameters
    ----------
    centre_m : ndarray of float64, shape (n, 2)
        x and y of nadir, m.
    strip : ndarray of int64
        On which terrain.
    true_s : ndarray of float64
        Two-way time from the gate at nominal pointing by the definition that holds, s.
    true_by_light_s, true_by_centre_s, true_by_plane_s : ndarray of float64
        2 (0 - z) / c weighted by the beam, of the post in the middle, and of the plane there, s.
    slope_deg, roughness_m : ndarray of float64
        Of the plane that the definitions name.
    """

    centre_m: NDArray[np.float64]
    strip: NDArray[np.int64]
    true_s: NDArray[np.float64]
    true_by_light_s: NDArray[np.float64]
    true_by_centre_s: NDArray[np.float64]
    true_by_plane_s: NDArray[np.float64]
    slope_deg: NDArray[np.float64]
    roughness_m: NDArray[np.float64]


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


def described(
    flats: tuple[Grid, ...], sigma_m: float | tuple[float, float], by_beam: bool = False
) -> tuple[FootprintPlanes, ...]:
    """Return what lies under a beam of `sigma_m` at the posts of each; as `footprint_planes`."""
    margin_m = _MARGIN * (max(sigma_m) if isinstance(sigma_m, tuple) else sigma_m)
    return tuple(footprint_planes(relief, sigma_m, margin_m, by_beam=by_beam) for relief in flats)


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


@lru_cache(maxsize=2)
def _flat_planes(
    kind: str, seed: int, factor: float, hurst: float, sigma_m: tuple[float, float], by_beam: bool
) -> tuple[FootprintPlanes, ...]:
    return described(flat_terrains(kind, seed, factor, hurst), sigma_m, by_beam)


def footprints(
    given: Mapping[str, Any],
    sigma_m: tuple[float, float],
    slopes_deg: tuple[float, float],
    count: int,
    draws: Draws,
    definitions: Definitions = USUAL,
) -> tuple[Strips, Places]:
    """Return a ground and places on it.

    Parameters
    ----------
    given : mapping
        Fields of `GroundKey`.
    sigma_m : tuple of float
        Of the beam along x and along y, m.
    slopes_deg
        As in `serving`.
    count, draws
        As in `places`.
    definitions : Definitions
        Of the true time, and of slope and roughness.
    """
    key = GroundKey(**given)
    ground = strips(key)
    every = _serving(ground, key, sigma_m, slopes_deg, definitions.by_beam, definitions.truth)
    return ground, places(every, count, draws)


@lru_cache(maxsize=1)
def _serving(
    ground: Strips,
    key: GroundKey,
    sigma_m: tuple[float, float],
    slopes_deg: tuple[float, float],
    by_beam: bool,
    truth: str,
) -> tuple[Places, ...]:
    flat = _flat_planes(key.kind, key.seed, key.factor, key.hurst, sigma_m, by_beam)
    return serving(ground, ground.planes(flat), slopes_deg, truth)


def serving(
    ground: Strips,
    planes: tuple[FootprintPlanes, ...],
    slopes_deg: tuple[float, float],
    truth: str = "light",
) -> tuple[Places, ...]:
    """Return all places at which the plane has a slope, terrain by terrain.

    Parameters
    ----------
    ground, planes
        The terrains, and what lies under the beam on them.
    slopes_deg : tuple of float
        Least and largest slope.
    truth : str
        Key of `procedures.range_truth.TRUTHS`.

    Raises
    ------
    RefusedInput
        The slope occurs on none; a terrain on which it does not occur is left out.
    """
    found, met = [], []
    for number, under in enumerate(planes):
        slope_deg = under.slope_deg
        met += [slope_deg.min(), slope_deg.max()]
        chosen = np.flatnonzero((slope_deg >= slopes_deg[0]) & (slope_deg <= slopes_deg[1]))
        if chosen.size:
            found.append(_at_posts(ground, under, chosen, number, truth))
    if not found:
        raise RefusedInput(
            f"slopes of {slopes_deg[0]:g} to {slopes_deg[1]:g} deg: the footprints on this ground have "
            f"{min(met):.3g} to {max(met):.3g} deg"
        )
    return tuple(found)


def places(every: tuple[Places, ...], count: int, draws: Draws) -> Places:
    """Draw places, as many on each terrain.

    Parameters
    ----------
    every : tuple of Places
        From `serving`.
    count : int
        On each terrain; where fewer posts serve, some are taken more than once.
    draws : Draws
        "places".
    """
    stream = draws.stream("places")
    sizes = [one.strip.size for one in every]
    chosen = [stream.choice(size, count, replace=size < count) for size in sizes]
    both = list(zip(every, chosen, strict=True))
    taken = {name: np.concatenate([getattr(one, name)[at] for one, at in both]) for name in Places.__slots__}
    return Places(**taken)


def _at_posts(
    ground: Strips, planes: FootprintPlanes, chosen: NDArray[np.int64], number: int, truth: str
) -> Places:
    row, column = np.unravel_index(chosen, planes.light_m.shape)
    x_m = ground.middles_m[number] + ground.away_m[column + planes.margin]
    y_m = ground.away_m[row + planes.margin]
    heights = {"light": planes.light_m, "centre": planes.centre_m, "plane": planes.plane_m}
    times_s = {key: -2 / SPEED_OF_LIGHT_M_PER_S * one.ravel()[chosen] for key, one in heights.items()}
    return Places(
        np.stack([x_m, y_m], axis=1),
        np.full(chosen.size, number),
        times_s[truth],
        times_s["light"],
        times_s["centre"],
        times_s["plane"],
        planes.slope_deg.ravel()[chosen],
        planes.roughness_m.ravel()[chosen],
    )
