"""The lowest and highest posts in squares of a terrain model, which bound the delays of a footprint."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sim.constants import SPEED_OF_LIGHT_M_PER_S

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from sim.terrain_grid import Grid

_TILE = 16
"""Posts along a side of the squares whose lowest and highest are kept."""


class ReliefTiles:
    """Squares of posts of a relief, each with its lowest and highest known one.

    Parameters
    ----------
    relief : Grid
        Heights over the plane that carries them.
    """

    def __init__(self, relief: Grid) -> None:
        self._relief = relief
        self._lowest, self._highest = (_tiles(relief, pick) for pick in (np.min, np.max))

    def spread_s(
        self, centres_m: NDArray[np.float64], radius_m: float, altitude_m: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return delays before and after which no light comes back, from the posts about.

        Parameters
        ----------
        centres_m : ndarray of float64, shape (n, 2)
            x and y of the footprints, m.
        radius_m : float
            Of all of them, m.
        altitude_m : float
            Of the instrument above z = 0: how much the wavefront bends, m.

        Returns
        -------
        tuple of ndarray of float64, shape (n,)
            From the gate, s; as of level ground at z = 0 where no post is known.
        """
        relief = self._relief
        early, late = np.empty(len(centres_m)), np.empty(len(centres_m))
        corner = np.array([relief.x_min_m, relief.y_min_m])
        shape = np.array(self._lowest.shape[::-1])
        begin = np.floor((centres_m - radius_m - corner) / relief.spacing_m).astype(np.int64) // _TILE
        end = np.ceil((centres_m + radius_m - corner) / relief.spacing_m).astype(np.int64) // _TILE + 1
        begin, end = np.clip(begin, 0, shape - 1), np.clip(end, 1, shape)
        for k, ((left, lower), (right, upper)) in enumerate(zip(begin, end, strict=True)):
            tiles = np.s_[lower : max(upper, lower + 1), left : max(right, left + 1)]
            early[k], late[k] = self._highest[tiles].max(), self._lowest[tiles].min()
        lit = np.isfinite(early)
        early, late = np.where(lit, early, 0.0), np.where(lit, late, 0.0)
        bend_m = radius_m**2 / (2 * altitude_m)
        return -2 * early / SPEED_OF_LIGHT_M_PER_S, 2 * (bend_m - late) / SPEED_OF_LIGHT_M_PER_S


def _tiles(relief: Grid, pick: Callable[..., NDArray[np.float64]]) -> NDArray[np.float64]:
    """The lowest, or highest, known post of each square; infinite the other way where there is none."""
    values, nothing = relief.values, np.inf if pick is np.min else -np.inf
    if relief.known is not None:
        values = np.where(relief.known, values, nothing)
    rows, columns = (-(-size // _TILE) * _TILE for size in values.shape)
    margins = ((0, rows - values.shape[0]), (0, columns - values.shape[1]))
    padded = np.pad(values, margins, constant_values=nothing)
    return pick(padded.reshape(rows // _TILE, _TILE, columns // _TILE, _TILE), axis=(1, 3))
