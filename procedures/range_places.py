"""Places of a slope on the ground of the range campaign: footprints whose plane has it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput
from procedures.footprint_planes import FootprintPlanes, footprint_planes
from procedures.range_ground import GroundKey, Strips, flat_terrains, strips
from procedures.range_truth import USUAL, Definitions
from sim.constants import SPEED_OF_LIGHT_M_PER_S

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

    from numpy.typing import NDArray

    from sim.draws import Draws
    from sim.terrain_grid import Grid

_MARGIN = 4.9
"""Standard deviations of the beam that no footprint lies nearer to an edge: room for the jitter."""


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


def described(
    flats: tuple[Grid, ...], sigma_m: float | tuple[float, float], by_beam: bool = False
) -> tuple[FootprintPlanes, ...]:
    """Return what lies under a beam of `sigma_m` at the posts of each; as `footprint_planes`."""
    margin_m = _MARGIN * (max(sigma_m) if isinstance(sigma_m, tuple) else sigma_m)
    return tuple(footprint_planes(relief, sigma_m, margin_m, by_beam=by_beam) for relief in flats)


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
