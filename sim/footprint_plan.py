"""Which pixels and time bins an echo needs for a tolerance; the errors are those of `sim.footprint_error`."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from belahil.errors import RefusedInput
from sim.beam import beam_image, beam_sigma_m
from sim.constants import SPEED_OF_LIGHT_M_PER_S
from sim.footprint_error import beam_transform, curvature_error, deposit_error, spacing_error

if TYPE_CHECKING:
    from sim.accuracy import Accuracy
    from sim.kernel import Kernel
    from sim.laser import Laser
    from sim.terrain import Surface

Method = Literal["grid", "closed form"]

MOST_PIXELS = 4_000_000
_MOST_BINS_PER_SAMPLE = 4096
_COARSEST_SIGMA = 3.0
_FEWEST = 2
"""Pixels from the middle of a field of view to its edge: with fewer it may lie between them."""


@dataclass(frozen=True, slots=True)
class Seen:
    """The circle of a field of view on level ground: its centre from nadir and radius, m."""

    centre_m: tuple[float, float]
    radius_m: float


@dataclass(frozen=True, slots=True)
class FootprintPlan:
    """How a footprint is to be summed.

    Parameters
    ----------
    method : {"grid", "closed form"}
        Pixels, or for a plane under a Gaussian beam the Gaussian distribution of its delays.
    tolerance : float
        What was asked for.
    slope_rad : float
        The steepest, for which it was made.
    reach : float
        Pixels further out than so many standard deviations of the beam are left out; infinite where a field
        of view bounds them.
    radius_m, pixel_m : float
        Of the circle that holds all pixels; between pixels. 0 with the closed form.
    centre_m : tuple of float or None
        Of that circle, from nadir, where a field of view bounds it; None: the beam's.
    bin_s : float
        Of the histogram of delays; divides the sample interval. 0 with the closed form.
    pixels : int
        About how many.
    beam_cut_error, spacing_error, deposit_error, curvature_error : float
        Predicted, relative to the peak. The last is what the closed form leaves out.
    posts_m : float
        Spacing of the terrain model; 0: the surface is known everywhere.
    """

    method: Method
    tolerance: float
    slope_rad: float
    reach: float = 0.0
    radius_m: float = 0.0
    pixel_m: float = 0.0
    bin_s: float = 0.0
    pixels: int = 0
    beam_cut_error: float = 0.0
    spacing_error: float = 0.0
    deposit_error: float = 0.0
    curvature_error: float = 0.0
    posts_m: float = 0.0
    centre_m: tuple[float, float] | None = None

    @property
    def predicted_error(self) -> float:
        """Max |dV| / peak of the mean shot, without what lies between the posts of a terrain model."""
        return self.beam_cut_error + self.spacing_error + self.deposit_error + self.curvature_error


def plan_footprint(
    accuracy: Accuracy,
    kernel: Kernel,
    laser: Laser,
    altitude_m: float,
    surface: Surface,
    interval_s: float,
    method: Method | None = None,
    seen: Seen | None = None,
) -> FootprintPlan:
    """Choose the coarsest steps whose predicted error is within a tolerance.

    Parameters
    ----------
    accuracy : Accuracy
        The tolerance.
    kernel : Kernel
        Pulse and receiver.
    laser : Laser
        Its beam and pointing.
    altitude_m : float
        Above zero, m.
    surface : Surface
        On a grid every post is used, and places between posts where the tolerance asks for them.
    interval_s : float
        Between samples, s.
    method : {"grid", "closed form"} or None
        None: the closed form where it serves.
    seen : Seen or None
        Beyond which a factor of `sim.footprint.delays` will leave no light. Where it is smaller than the
        beam, only places in it become pixels.

    Raises
    ------
    RefusedInput
        No altitude; or the tolerance cannot be met: the message has the error that is predicted for the
        finest steps. Or the closed form was asked for where there is none.
    OffTerrain
        The beam does not meet the terrain.
    """
    tolerance = accuracy.tolerance
    if not 0 < altitude_m < math.inf:
        raise RefusedInput(f"altitude {altitude_m!r} m: must be positive and finite")
    sigma_m = beam_sigma_m(laser, altitude_m)
    reach = math.sqrt(2 * math.log(1 / accuracy.beam_cut))
    radius_m = _radius(laser, altitude_m, reach)
    if method != "grid":
        refusal = _closed_form_refusal(kernel, laser, surface)
        error = 0.0 if refusal else curvature_error(kernel, surface.gradient, sigma_m[0], altitude_m)
        if method and (refusal or error > tolerance):
            why = refusal or f"it leaves out {error:.2g} of the peak, beyond {tolerance:g}"
            raise RefusedInput(f"closed form of an echo: {why}")
        if not refusal and (method or error <= tolerance):
            slope = math.atan(math.hypot(*surface.gradient))
            return FootprintPlan("closed form", tolerance, slope, curvature_error=error)
    along, across = laser.pointing_rad
    centre = altitude_m * math.tan(along), altitude_m * math.tan(across)
    area_m2, coarsest_m, cut = (
        _area(laser, altitude_m, reach),
        _COARSEST_SIGMA * sigma_m[1],
        accuracy.beam_cut,
    )
    is_narrow = seen is not None and seen.radius_m < radius_m
    if seen is not None and is_narrow:
        centre, radius_m, reach, cut = seen.centre_m, seen.radius_m, math.inf, 0.0
        area_m2 = min(area_m2, math.pi * radius_m**2)
        coarsest_m = min(coarsest_m, radius_m / _FEWEST)
    slope = surface.steepest(centre[0], centre[1], radius_m)
    bin_s, deposit = _bins(kernel, accuracy.deposit, interval_s)
    light = beam_transform(laser, altitude_m)
    finest_m = math.sqrt(area_m2 / MOST_PIXELS)
    tilt = 2 * math.tan(slope) / SPEED_OF_LIGHT_M_PER_S
    pixel_m = _coarsest(
        lambda dx: spacing_error(kernel, light, sigma_m, tilt, dx),
        accuracy.spacing,
        finest_m,
        coarsest_m,
    )
    if surface.spacing_m:
        pixel_m = surface.spacing_m / math.ceil(surface.spacing_m / pixel_m - 1e-9)
    predicted = spacing_error(kernel, light, sigma_m, tilt, pixel_m)
    if predicted > accuracy.spacing * (1 + 1e-9):
        raise RefusedInput(
            f"tolerance {tolerance:g} at a slope of {math.degrees(slope):.4g} deg: "
            f"{MOST_PIXELS} pixels, one every {pixel_m:.3g} m, leave a predicted error of {predicted:.2g}"
        )
    return FootprintPlan(
        method="grid",
        tolerance=tolerance,
        slope_rad=slope,
        reach=reach,
        radius_m=radius_m,
        pixel_m=pixel_m,
        bin_s=bin_s,
        pixels=math.ceil(area_m2 / pixel_m**2),
        beam_cut_error=cut,
        spacing_error=predicted,
        deposit_error=deposit,
        posts_m=surface.spacing_m,
        centre_m=centre if is_narrow else None,
    )


def _closed_form_refusal(kernel: Kernel, laser: Laser, surface: Surface) -> str:
    if surface.relief is not None:
        return "only a plane has one"
    if not isinstance(surface.albedo, float | int):
        return "there is none with a map of reflectance"
    if laser.beam == "image":
        return "there is none for a beam from an image"
    if not kernel.pulse.pieces:
        return "there is none for a pulse from a table"
    return ""


def _bins(kernel: Kernel, allowed: float, interval_s: float) -> tuple[float, float]:
    """Choose the longest bin that divides the interval and deposits well enough."""
    too_few, parts, error = 0, 1, deposit_error(kernel, interval_s)
    while error > allowed:
        if parts == _MOST_BINS_PER_SAMPLE:
            why = "the pulse jumps or bends, and nothing behind it smooths it"
            if kernel.pulse.pieces:
                behind = "and the filter behind it change" if kernel.poles else "behind no filter changes"
                why = f"the pulse {behind} within {kernel.finest_s:.2g} s, which is too fast for them"
            raise RefusedInput(
                f"time bins of {interval_s / _MOST_BINS_PER_SAMPLE:.2g} s leave a predicted error of "
                f"{error:.2g}, beyond {allowed:g}: {why}"
            )
        # The fourth power of a smooth kernel; where the pulse bends the error falls only with the first.
        more = max(parts + 1, math.ceil(parts * max(1.25, 0.9 * (error / allowed) ** 0.25)))
        too_few, parts = parts, min(more, _MOST_BINS_PER_SAMPLE)
        error = deposit_error(kernel, interval_s / parts)
    while parts - too_few > 1:
        middle = (too_few + parts) // 2
        coarser = deposit_error(kernel, interval_s / middle)
        if coarser <= allowed:
            parts, error = middle, coarser
        else:
            too_few = middle
    return interval_s / parts, error


def _coarsest(error: Callable[[float], float], allowed: float, finest: float, coarsest: float) -> float:
    """Bisect for the largest step within an error; the finest where none is."""
    if error(coarsest) <= allowed:
        return coarsest
    low, high = math.log(finest), math.log(coarsest)
    while high - low > 1e-3:
        middle = (low + high) / 2
        low, high = (middle, high) if error(math.exp(middle)) <= allowed else (low, middle)
    return math.exp(low)


def _radius(laser: Laser, altitude_m: float, reach: float) -> float:
    if laser.beam == "image":
        rows, columns = beam_image(laser).pixels.shape
        return laser.image_pixel_rad * altitude_m * math.hypot(rows, columns)
    return reach * beam_sigma_m(laser, altitude_m)[0]


def _area(laser: Laser, altitude_m: float, reach: float) -> float:
    if laser.beam == "image":
        return beam_image(laser).pixels.size * (laser.image_pixel_rad * altitude_m) ** 2
    major_m, minor_m = beam_sigma_m(laser, altitude_m)
    return math.pi * reach**2 * major_m * minor_m
