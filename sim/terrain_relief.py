"""Relief in closed form: what a crater or a boulder adds to the plane that carries it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True)
class RadialRelief:
    """A body of revolution: ``rim + (top - rim) (1 - u^n)`` within the radius, ``rim u^-3`` outside of it.

    Parameters
    ----------
    centre_m : tuple of float
        x and y of the axis, m.
    radius_m : float
        u is the distance from the axis over this, m.
    top_m : float
        Height on the axis, m; negative for a crater.
    rim_m : float
        Height at the radius, m.
    exponent : float
        n, at least 1.
    """

    centre_m: tuple[float, float]
    radius_m: float
    top_m: float
    rim_m: float
    exponent: float

    def height(self, x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Height above the plane, m."""
        u = np.hypot(x_m - self.centre_m[0], y_m - self.centre_m[1]) / self.radius_m
        inside = self.rim_m + (self.top_m - self.rim_m) * (1 - np.minimum(u, 1) ** self.exponent)
        return np.where(u < 1, inside, self.rim_m * np.maximum(u, 1) ** -3.0)

    def steepest(self, x_m: float, y_m: float, radius_m: float) -> float:
        """Largest gradient on the circles round the axis that a disc touches, m/m."""
        distance = np.hypot(x_m - self.centre_m[0], y_m - self.centre_m[1])
        nearest = max(distance - radius_m, 0.0) / self.radius_m
        farthest = (distance + radius_m) / self.radius_m
        # Inside it is steeper the farther out, outside the farther in.
        wall = outside = 0.0
        if nearest < 1:
            fall = abs(self.top_m - self.rim_m) * self.exponent / self.radius_m
            wall = fall * min(farthest, 1.0) ** (self.exponent - 1)
        if farthest >= 1:
            outside = 3 * abs(self.rim_m) / self.radius_m * max(nearest, 1.0) ** -4.0
        return max(wall, outside)
