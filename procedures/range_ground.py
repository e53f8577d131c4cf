"""The ground of the range campaign: eleven fractals side by side, tilted, and places of a slope on them.

The fractals have a Hurst exponent of 0.8 (paper, "Analog DTMs"); their heights are not printed and assumed,
as `procedures.arrival_ground` tells. Each is tilted so that the slope that is asked for occurs, towards
another side than its neighbour; footprints are places whose plane has that slope, as many on each fractal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput
from procedures.arrival_ground import EXTENT_M
from procedures.footprint_planes import FootprintPlanes, footprint_planes
from procedures.study_ground import LEVELS, fractal
from sim.constants import SPEED_OF_LIGHT_M_PER_S
from sim.draws import Draws
from sim.terrain import Surface, gradient_of
from sim.terrain_grid import Grid

if TYPE_CHECKING:
    from numpy.typing import NDArray

SPACING_M = 1.5
TURN_DEG = 36.0
"""From the tilt of one fractal to that of the next: none of them all along a row of posts."""

_MARGIN = 4.9
"""Standard deviations of the beam that no footprint lies nearer to an edge: room for the jitter."""


@dataclass(frozen=True, slots=True, eq=False)
class Strips:
    """Terrains side by side in one grid; nadir is in the middle one.

    Parameters
    ----------
    surface : Surface
        All of them, with a reflectance of 1.
    strips : tuple of Grid
        Each by itself, at its place.
    """

    surface: Surface
    strips: tuple[Grid, ...]


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
        Two-way time from the gate at nominal pointing, 2 (0 - z) / c weighted by the beam, s.
    true_by_centre_s, true_by_plane_s : ndarray of float64
        The same of the post in the middle, and of the plane there, s.
    slope_deg, roughness_m : ndarray of float64
        Of the plane over the 1/e^2 disc.
    """

    centre_m: NDArray[np.float64]
    strip: NDArray[np.int64]
    true_s: NDArray[np.float64]
    true_by_centre_s: NDArray[np.float64]
    true_by_plane_s: NDArray[np.float64]
    slope_deg: NDArray[np.float64]
    roughness_m: NDArray[np.float64]


def fractal_strips(seed: int, slope_deg: float, extent_m: float = EXTENT_M) -> Strips:
    """Make the eleven fractals, each with a tilt.

    Parameters
    ----------
    seed : int
        Of the smoothest; the others have the next ones.
    slope_deg : float
        Of the tilt.
    extent_m : float
        Side of each, m.
    """
    flats = [fractal(level, seed, extent_m).relief for level in range(LEVELS)]
    return side_by_side([one.values for one in flats if isinstance(one, Grid)], slope_deg)


def plane_strip(slope_deg: float, extent_m: float = EXTENT_M) -> Strips:
    """Make a plane on posts, with the tilt of the strip in the middle of eleven."""
    posts = round(extent_m / SPACING_M) + 1
    return side_by_side([np.zeros((posts, posts))], slope_deg)


def side_by_side(heights_m: list[NDArray[np.float64]], slope_deg: float) -> Strips:
    """Tilt square terrains about their middles and put them in a row, along x.

    Parameters
    ----------
    heights_m : list of ndarray of float64, shape (n, n)
        At posts `SPACING_M` apart.
    slope_deg : float
        Of the tilt that is added to each.
    """
    side = heights_m[0].shape[0]
    away = SPACING_M * (np.arange(side) - (side - 1) / 2)
    step_m = side * SPACING_M
    middles = step_m * (np.arange(len(heights_m)) - len(heights_m) // 2)
    strips = []
    for number, (values, middle) in enumerate(zip(heights_m, middles.tolist(), strict=True)):
        gx, gy = gradient_of(slope_deg, TURN_DEG * number)
        level = values - values.mean()
        strips.append(Grid(level + gx * away + (gy * away)[:, None], SPACING_M, middle + away[0], away[0]))
    whole = Grid(
        np.concatenate([one.values for one in strips], axis=1), SPACING_M, strips[0].x_min_m, away[0]
    )
    return Strips(Surface("fractal", relief=whole, albedo=1.0), tuple(strips))


def described(ground: Strips, sigma_m: float) -> tuple[FootprintPlanes, ...]:
    """Return what lies under a round beam of `sigma_m` at the posts of each strip; as `footprint_planes`."""
    return tuple(footprint_planes(relief, sigma_m, _MARGIN * sigma_m) for relief in ground.strips)


def places(
    ground: Strips,
    planes: tuple[FootprintPlanes, ...],
    slopes_deg: tuple[float, float],
    count: int,
    draws: Draws,
) -> Places:
    """Draw places at which the plane has a slope, as many on each strip.

    Parameters
    ----------
    ground, planes
        The terrains, and what lies under the beam on them.
    slopes_deg : tuple of float
        Least and largest slope.
    count : int
        On each strip; where fewer posts serve, some are taken more than once.
    draws : Draws
        "places".

    Raises
    ------
    RefusedInput
        A strip on which the slope does not occur.
    """
    stream = draws.stream("places")
    found = []
    for number, (relief, under) in enumerate(zip(ground.strips, planes, strict=True)):
        slope = under.slope_deg
        serving = np.flatnonzero((slope >= slopes_deg[0]) & (slope <= slopes_deg[1]))
        if not serving.size:
            raise RefusedInput(
                f"slopes of {slopes_deg[0]:g} to {slopes_deg[1]:g} deg on terrain {number}: its footprints "
                f"have {slope.min():.3g} to {slope.max():.3g} deg"
            )
        chosen = stream.choice(serving, count, replace=serving.size < count)
        found.append(_places(relief, under, chosen, number))
    columns = zip(*found, strict=True)
    return Places(*(np.concatenate(column) for column in columns))


def _places(
    relief: Grid, planes: FootprintPlanes, chosen: NDArray[np.int64], number: int
) -> tuple[NDArray[np.float64], ...]:
    row, column = np.unravel_index(chosen, planes.light_m.shape)
    x_m = relief.x_min_m + relief.spacing_m * (column + planes.margin)
    y_m = relief.y_min_m + relief.spacing_m * (row + planes.margin)
    heights = (planes.light_m, planes.centre_m, planes.plane_m)
    return (
        np.stack([x_m, y_m], axis=1),
        np.full(chosen.size, number),
        *(-2 / SPEED_OF_LIGHT_M_PER_S * one.ravel()[chosen] for one in heights),
        planes.slope_deg.ravel()[chosen],
        planes.roughness_m.ravel()[chosen],
    )
