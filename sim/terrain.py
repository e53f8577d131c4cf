"""The ground: heights and reflectance at any place, from shapes in closed form or from a grid.

Coordinates are metres on the tangent plane where nadir meets the ground: x and y along it, z up. Azimuths
run from +x towards +y. Fractal surfaces are in `sim.terrain_fractal`, arrays and terrain models
in `sim.terrain_dtm`.

What this does not model: overhangs and vertical walls (a height is a function of x and y), the curvature of
the planet (0.03 mm at 12 m from nadir, on Mercury), shadowing, and relief below the spacing of a grid.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.errors import RefusedInput
from sim.terrain_grid import Grid, OffTerrain
from sim.terrain_relief import RadialRelief

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

Kind = Literal["plane", "crater", "boulder", "fractal", "multifractal", "dtm"]

REFLECTANCE = 0.17
"""Mean normal albedo of Mercury at 1064 nm (Neumann et al., 2013)."""

RIM_HEIGHT_PER_DIAMETER = 0.036
"""Fresh simple craters (Pike, 1977)."""

_EVERYWHERE = (-np.inf, np.inf, -np.inf, np.inf)


@dataclass(frozen=True, slots=True, eq=False)
class TerrainSample:
    """The ground at some places, arrays of one shape.

    Parameters
    ----------
    height_m : ndarray of float64
        0 where not known.
    reflectance : ndarray of float64
        0 where not known: ground without data returns no light.
    known : ndarray of bool
        Where there are a height and a reflectance.
    """

    height_m: NDArray[np.float64]
    reflectance: NDArray[np.float64]
    known: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Surface:
    """A plane, with relief on it or a grid in its place.

    Parameters
    ----------
    kind : str
        As in a scene file.
    gradient : tuple of float
        dz/dx and dz/dy of the plane through the origin, m/m. Zero with a grid, which holds its own slope.
    relief : RadialRelief, Grid or None
        Heights above the plane, m.
    albedo : float or Grid
        Normal albedo at the laser's wavelength; not negative.

    Raises
    ------
    RefusedInput
        A gradient that is not finite or goes with a grid, or a reflectance that is negative or not finite.
    """

    kind: Kind
    gradient: tuple[float, float] = (0.0, 0.0)
    relief: RadialRelief | Grid | None = None
    albedo: float | Grid = REFLECTANCE

    def __post_init__(self) -> None:
        if not all(np.isfinite(self.gradient)):
            raise RefusedInput(f"gradient = {self.gradient}: must be finite")
        if isinstance(self.relief, Grid) and any(self.gradient):
            raise RefusedInput("a gradient beside a grid: `tilted` puts the slope into the grid")
        lowest = self.albedo.values.min() if isinstance(self.albedo, Grid) else self.albedo
        if not 0 <= lowest < np.inf:
            raise RefusedInput(f"reflectance = {lowest:g}: must be finite and not negative")

    @property
    def spacing_m(self) -> float:
        """Between the posts, m; 0 for a shape in closed form."""
        return self.relief.spacing_m if isinstance(self.relief, Grid) else 0.0

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """x_min, x_max, y_min, y_max of the heights, m; infinite for a shape in closed form."""
        return self.relief.bounds if isinstance(self.relief, Grid) else _EVERYWHERE

    def sample(self, x_m: ArrayLike, y_m: ArrayLike) -> TerrainSample:
        """Height and reflectance at places that may lie off the terrain.

        Parameters
        ----------
        x_m, y_m : array_like
            m; shapes that broadcast together.

        Raises
        ------
        OffTerrain
            When none of the places has ground.
        """
        height_m, known = self._heights(x_m, y_m)
        if isinstance(self.albedo, Grid):
            reflectance, mapped = self.albedo.sample(x_m, y_m)
            known = known & mapped
        else:
            reflectance = np.full(height_m.shape, float(self.albedo))
        if not known.any():
            raise self._off_terrain("none", x_m, y_m)
        return TerrainSample(np.where(known, height_m, 0.0), np.where(known, reflectance, 0.0), known)

    def height(self, x_m: ArrayLike, y_m: ArrayLike) -> NDArray[np.float64]:
        """Height, m, at places that must all have ground.

        Parameters
        ----------
        x_m, y_m : array_like
            m; shapes that broadcast together.

        Raises
        ------
        OffTerrain
            When a place lies off the grid or has no data; `sample` accepts some of them.
        """
        height_m, known = self._heights(x_m, y_m)
        if not known.all():
            raise self._off_terrain("not every one", x_m, y_m)
        return height_m

    def reflectance(self, x_m: ArrayLike, y_m: ArrayLike) -> NDArray[np.float64] | float:
        """Normal albedo: one number, or an array of it from a map; errors as `height`."""
        if not isinstance(self.albedo, Grid):
            return float(self.albedo)
        reflectance, known = self.albedo.sample(x_m, y_m)
        if not known.all():
            raise self._off_terrain("not every one", x_m, y_m)
        return reflectance

    def steepest(self, x_m: float, y_m: float, radius_m: float) -> float:
        """Bound the slope within a disc from above.

        Parameters
        ----------
        x_m, y_m, radius_m : float
            Centre and radius, m.

        Returns
        -------
        float
            Angle from the horizontal, rad. It is reached on a plane, and on a grid within a cell of the disc;
            relief on a slope counts as if it fell along the slope somewhere.

        Raises
        ------
        OffTerrain
            When a grid has no whole cell there, or the centre is no place.
        """
        if not np.isfinite(x_m + y_m):
            raise self._off_terrain("none", x_m, y_m)
        climb = float(np.hypot(*self.gradient))
        if self.relief is not None:
            climb += self.relief.steepest(x_m, y_m, radius_m)
        return float(np.arctan(climb))

    def _heights(self, x_m: ArrayLike, y_m: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        if isinstance(self.relief, Grid):
            return self.relief.sample(x_m, y_m)
        x, y = np.broadcast_arrays(np.asarray(x_m, dtype=np.float64), np.asarray(y_m, dtype=np.float64))
        known = np.isfinite(x) & np.isfinite(y)
        if not known.all():
            x, y = np.where(known, x, 0.0), np.where(known, y, 0.0)
        height_m = self.gradient[0] * x + self.gradient[1] * y
        if self.relief is not None:
            height_m = height_m + self.relief.height(x, y)
        return np.asarray(height_m), known

    def _off_terrain(self, how_many: str, x_m: ArrayLike, y_m: ArrayLike) -> OffTerrain:
        x_min, x_max, y_min, y_max = self.bounds
        x, y = np.asarray(x_m), np.asarray(y_m)
        asked = (
            "no place"
            if not x.size * y.size
            else (f"x {x.min():g} to {x.max():g} m, y {y.min():g} to {y.max():g} m")
        )
        return OffTerrain(
            f"{asked}: {how_many} of the places has ground; the {self.kind} covers "
            f"x {x_min:g} to {x_max:g} m, y {y_min:g} to {y_max:g} m, less its gaps"
        )


def gradient_of(slope_deg: float, azimuth_deg: float = 0.0) -> tuple[float, float]:
    """Dz/dx and dz/dy of a plane, m/m.

    Parameters
    ----------
    slope_deg : float
        0 to below 90.
    azimuth_deg : float
        Direction of steepest ascent, from +x towards +y.

    Raises
    ------
    RefusedInput
        For a slope or an azimuth that is not allowed.
    """
    if not (0 <= slope_deg < 90 and np.isfinite(azimuth_deg)):
        raise RefusedInput(
            f"slope_deg = {slope_deg:g}, azimuth_deg = {azimuth_deg:g}: the slope must be 0 to below 90"
        )
    climb = np.tan(np.radians(slope_deg))
    azimuth_rad = np.radians(azimuth_deg)
    return float(climb * np.cos(azimuth_rad)), float(climb * np.sin(azimuth_rad))


def plane(
    slope_deg: float = 0.0, azimuth_deg: float = 0.0, *, reflectance: float | Grid = REFLECTANCE
) -> Surface:
    """Make a plane through the origin; parameters as `gradient_of`."""
    return Surface("plane", gradient_of(slope_deg, azimuth_deg), None, reflectance)


def crater(
    diameter_m: float = 20.0,
    depth_m: float = 3.0,
    *,
    rim_height_m: float | None = None,
    exponent: float = 2.0,
    centre_m: tuple[float, float] = (0.0, 0.0),
    slope_deg: float = 0.0,
    azimuth_deg: float = 0.0,
    reflectance: float | Grid = REFLECTANCE,
) -> Surface:
    """Make a bowl with a raised rim, on a plane.

    Parameters
    ----------
    diameter_m : float
        From rim crest to rim crest, m.
    depth_m : float
        From the crest of the rim to the floor, m. The default of 0.15 diameters is assumed: fresh simple
        craters have 0.2 (Pike, 1977), and those of some ten metres are mostly worn.
    rim_height_m : float or None
        Of the crest above the plane, m; at most the depth. None: 0.036 diameters (Pike, 1977), or the
        depth where that is less. The ejecta fall off with the third power of the distance (McGetchin et al.,
        1973).
    exponent : float
        Shape of the bowl: 2 is a paraboloid, more has a flatter floor and steeper walls.
    centre_m : tuple of float
        x and y, m.
    slope_deg, azimuth_deg : float
        Of the plane, as in `gradient_of`.
    reflectance : float or Grid
        Normal albedo.

    Raises
    ------
    RefusedInput
        For a size that is not allowed.

    Notes
    -----
    Without a rim it is, upside down, the boulder of the same diameter, height and exponent.
    """
    if rim_height_m is None:
        rim_height_m = min(RIM_HEIGHT_PER_DIAMETER * diameter_m, depth_m)
    if not 0 <= rim_height_m <= depth_m:
        raise RefusedInput(f"rim_height_m = {rim_height_m:g}: must be 0 to depth_m = {depth_m:g}")
    _check_shape(diameter_m, "depth_m", depth_m, exponent, centre_m)
    relief = RadialRelief(centre_m, diameter_m / 2, rim_height_m - depth_m, rim_height_m, exponent)
    return Surface("crater", gradient_of(slope_deg, azimuth_deg), relief, reflectance)


def boulder(
    diameter_m: float = 20.0,
    height_m: float = 3.0,
    *,
    exponent: float = 2.0,
    centre_m: tuple[float, float] = (0.0, 0.0),
    slope_deg: float = 0.0,
    azimuth_deg: float = 0.0,
    reflectance: float | Grid = REFLECTANCE,
) -> Surface:
    """Make a rounded bump on a plane.

    Parameters
    ----------
    diameter_m, height_m : float
        At its foot, and above the plane, m. The defaults are assumed: about the footprint of BELA at 500 km.
    exponent : float
        2 is a paraboloid; 4 is closest to a half ellipsoid, but for its vertical foot; more is
        flatter on top.
    centre_m : tuple of float
        x and y, m.
    slope_deg, azimuth_deg : float
        Of the plane, as in `gradient_of`. A boulder at its centre does not change the mean slope there.
    reflectance : float or Grid
        Normal albedo.

    Raises
    ------
    RefusedInput
        For a size that is not allowed.
    """
    _check_shape(diameter_m, "height_m", height_m, exponent, centre_m)
    relief = RadialRelief(centre_m, diameter_m / 2, height_m, 0.0, exponent)
    return Surface("boulder", gradient_of(slope_deg, azimuth_deg), relief, reflectance)


def tilted(surface: Surface, slope_deg: float, azimuth_deg: float = 0.0) -> Surface:
    """Add a plane through the origin, as `gradient_of` describes it, to any surface."""
    gx, gy = gradient_of(slope_deg, azimuth_deg)
    if not isinstance(surface.relief, Grid):
        return replace(surface, gradient=(surface.gradient[0] + gx, surface.gradient[1] + gy))
    x, y = surface.relief.posts()
    values = surface.relief.values + gx * x + (gy * y)[:, None]
    return replace(surface, relief=replace(surface.relief, values=values))


def _check_shape(
    diameter_m: float, name: str, vertical_m: float, exponent: float, centre_m: tuple[float, float]
) -> None:
    if not (0 < diameter_m < np.inf and 0 < vertical_m < np.inf and all(np.isfinite(centre_m))):
        raise RefusedInput(
            f"diameter_m = {diameter_m:g}, {name} = {vertical_m:g}, centre_m = {centre_m}: "
            "the sizes must be positive, all must be finite"
        )
    if not 1 <= exponent < np.inf:
        raise RefusedInput(f"exponent = {exponent:g}: must be at least 1")
