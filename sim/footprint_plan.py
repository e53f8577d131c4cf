"""Which pixels and time bins an echo needs, and what error they will leave.

Three errors are predicted, each from the transforms of the receiver's kernel and of the beam, so that the
prediction follows the bandwidth of pulse and filter:

* the edge of the beam that is left out, exp(-R^2 / 2 sigma^2);
* the spacing of the pixels. The pixel-centre sum is a trapezoid rule; what it adds is the spectrum of the
  light on the ground about the multiples of 1 / dx (Poisson's summation formula). A gradient of s seconds a
  metre turns frequency f into s f cycles a metre, so the light there has passed the kernel at f = m / (dx s).
  The worst gradient is along the grid;
* the deposit on time bins: the cubic through four values of the kernel, at the worst place in a bin.

On a plane along the grid the second is met within some 20 %. On relief the steepest slope is used for all of
it; that is an estimate, no bound. What relief smaller than the posts of a terrain model would have done is
not in it: `sim.echo.posts_error` tells that apart.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.errors import RefusedInput
from sim.beam import beam_image, beam_sigma_m
from sim.constants import SPEED_OF_LIGHT_M_PER_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim.accuracy import Accuracy
    from sim.kernel import Kernel
    from sim.laser import Laser
    from sim.terrain import Surface

Method = Literal["grid", "closed form"]

MOST_PIXELS = 4_000_000
_MOST_BINS_PER_SAMPLE = 4096
_COARSEST_SIGMA = 3.0


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
        Pixels further out than so many standard deviations of the beam are left out.
    radius_m, pixel_m : float
        Of the circle that holds all pixels; between pixels. 0 with the closed form.
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

    @property
    def predicted_error(self) -> float:
        """Max |dV| / peak, without what lies between the posts of a terrain model."""
        return self.beam_cut_error + self.spacing_error + self.deposit_error + self.curvature_error


def plan_footprint(
    accuracy: Accuracy,
    kernel: Kernel,
    laser: Laser,
    altitude_m: float,
    surface: Surface,
    interval_s: float,
    method: Method | None = None,
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

    Raises
    ------
    RefusedInput
        The tolerance cannot be met; the message has the error that is predicted for the finest steps. Or the
        closed form was asked for where there is none.
    OffTerrain
        The beam does not meet the terrain.
    """
    tolerance = accuracy.tolerance
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
    centre = tuple(altitude_m * math.tan(angle) for angle in laser.pointing_rad)
    slope = surface.steepest(centre[0], centre[1], radius_m)
    bin_s, deposit = _bins(kernel, accuracy.deposit, interval_s)
    light = beam_transform(laser, altitude_m)
    finest_m = math.sqrt(_area(laser, altitude_m, reach) / MOST_PIXELS)
    tilt = 2 * math.tan(slope) / SPEED_OF_LIGHT_M_PER_S
    pixel_m = _coarsest(
        lambda dx: spacing_error(kernel, light, sigma_m, tilt, dx),
        accuracy.spacing,
        finest_m,
        _COARSEST_SIGMA * sigma_m[1],
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
        pixels=math.ceil(_area(laser, altitude_m, reach) / pixel_m**2),
        beam_cut_error=accuracy.beam_cut,
        spacing_error=predicted,
        deposit_error=deposit,
        posts_m=surface.spacing_m,
    )


def spacing_error(
    kernel: Kernel,
    light: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    sigma_m: tuple[float, float],
    tilt_s_per_m: float,
    pixel_m: float,
) -> float:
    """Predict what a spacing of pixels adds to the echo of a plane along the grid, relative to its peak.

    Parameters
    ----------
    kernel : Kernel
        Pulse and receiver.
    light : callable
        From `beam_transform`.
    sigma_m : tuple of float
        Standard deviations of the beam, the larger one first, m.
    tilt_s_per_m : float
        Gradient of the delay, 2 tan(slope) / c.
    pixel_m : float
        m.

    Returns
    -------
    float
        A bound but for the choice of direction: the sum of the magnitudes of all that is aliased.
    """
    frequency_hz, level = _spectrum(kernel)
    highest_hz = frequency_hz[-1]
    turns = 1 / pixel_m
    # Once round the grid: along the gradient at every frequency, across it, and both.
    near = frequency_hz
    if tilt_s_per_m:
        width = 1 / (2 * math.pi * sigma_m[1] * tilt_s_per_m)
        ridge = turns / tilt_s_per_m + width * np.linspace(-9, 9, 181)
        near = np.union1d(near, ridge[(ridge > 0) & (ridge < highest_hz)])
    here = np.interp(near, frequency_hz, level)
    cycles = near * tilt_s_per_m
    once = np.trapezoid((light(turns - cycles) + light(turns + cycles)) * here, near)
    across = float(light(np.array([turns]))[0])
    aside = np.trapezoid(2 * light(cycles) * here, near) * across
    total = float(2 * once + 2 * aside + 4 * once * across)
    # Further round: only narrow ridges are left there.
    most = int(min(1e5, highest_hz * tilt_s_per_m * pixel_m))
    if most >= 2:
        ridges = np.arange(2, most + 1) * turns / tilt_s_per_m
        there = np.interp(ridges, frequency_hz, level, right=0.0)
        span = float(light_width(light, sigma_m[1]) / tilt_s_per_m)
        total += 2 * span * float(there.sum())
    return total / echo_peak(kernel, tilt_s_per_m * sigma_m[0])


def light_width(light: Callable[[NDArray[np.float64]], NDArray[np.float64]], sigma_m: float) -> float:
    """Integral of a beam's transform over all cycles a metre, 1/m."""
    cycles = np.linspace(0, 9 / (2 * math.pi * sigma_m), 400)
    return 2 * float(np.trapezoid(light(cycles), cycles))


def echo_peak(kernel: Kernel, spread_s: float) -> float:
    """Return the peak of a kernel behind a Gaussian of `spread_s`: the echo of a plane."""
    highest_hz = _spectrum(kernel)[0][-1]
    if spread_s:
        highest_hz = min(highest_hz, 9 / (2 * math.pi * spread_s))
    count = 1024
    frequency_hz = np.arange(count) * (highest_hz / count)
    spectrum = kernel.transform(frequency_hz) * np.exp(-2 * (math.pi * frequency_hz * spread_s) ** 2)
    return float(np.abs(np.fft.irfft(spectrum, 8 * count)).max() * 8 * highest_hz)


def deposit_error(kernel: Kernel, bin_s: float) -> float:
    """Predict the error of the cubic deposit on bins, relative to the peak, for a pulse on flat ground.

    The error of the cubic through four values is largest half way. There it is the kernel less a filter of
    these values, so its spectrum is known.
    """
    frequency_hz, _ = _spectrum(kernel)
    half = math.pi * frequency_hz * bin_s
    missed = 1 - 1.125 * np.cos(half) + 0.125 * np.cos(3 * half)
    spectrum = _complex_spectrum(kernel)
    count = 2 * (frequency_hz.size - 1)
    error = np.abs(np.fft.irfft(spectrum * missed, count)).max()
    return float(error / np.abs(np.fft.irfft(spectrum, count)).max())


def curvature_error(
    kernel: Kernel, gradient: tuple[float, float], sigma_m: float, altitude_m: float
) -> float:
    """Estimate what the closed form of a plane's echo misses because the wavefront is curved.

    The closed form has the mean delay that the curvature adds. What is left, to first order, is a third
    cumulant: 3 bend spread^2 + 2 bend^3 for the spread of the delays and the bend 2 sigma^2 / (c H), and a
    variance of bend^2.
    """
    spread_s = 2 / SPEED_OF_LIGHT_M_PER_S * sigma_m * math.hypot(*gradient)
    bend_s = 2 / SPEED_OF_LIGHT_M_PER_S * sigma_m**2 / altitude_m
    frequency_hz, _ = _spectrum(kernel)
    if spread_s:
        frequency_hz = np.linspace(0, min(frequency_hz[-1], 9 / (2 * math.pi * spread_s)), 1025)
    omega = 2 * math.pi * frequency_hz
    left = omega**3 * (bend_s * spread_s**2 / 2 + bend_s**3 / 3) + omega**2 * bend_s**2 / 2
    spectrum = np.abs(kernel.transform(frequency_hz)) * np.exp(-0.5 * (omega * spread_s) ** 2)
    return float(2 * np.trapezoid(spectrum * left, frequency_hz)) / echo_peak(kernel, spread_s)


def beam_transform(laser: Laser, altitude_m: float) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Return the magnitude of a beam's transform against cycles a metre, 1 at 0, in its worst direction."""
    if laser.beam != "image":
        narrow_m = beam_sigma_m(laser, altitude_m)[1]
        return lambda cycles: np.asarray(np.exp(-2 * (np.pi * narrow_m * cycles) ** 2))
    image = beam_image(laser)
    pixel_m = image.pixel_rad * altitude_m

    def magnitude(cycles: NDArray[np.float64]) -> NDArray[np.float64]:
        sides = []
        for axis in (0, 1):
            share = image.pixels.sum(axis=axis) / image.pixels.sum()
            phases = np.exp(-2j * np.pi * pixel_m * np.multiply.outer(cycles, np.arange(share.size)))
            sides.append(np.abs(phases @ share))
        return np.asarray(np.maximum(*sides) * np.sinc(cycles * pixel_m) ** 2)

    return magnitude


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
    parts, error = 1, deposit_error(kernel, interval_s)
    while error > allowed:
        parts = max(parts + 1, math.ceil(parts * 0.9 * (error / allowed) ** 0.25))
        if parts > _MOST_BINS_PER_SAMPLE:
            raise RefusedInput(
                f"time bins of {interval_s / _MOST_BINS_PER_SAMPLE:.2g} s leave a predicted error of "
                f"{error:.2g}, beyond {allowed:g}: the pulse jumps, and nothing behind it smooths it"
            )
        error = deposit_error(kernel, interval_s / parts)
    while parts > 1 and (coarser := deposit_error(kernel, interval_s / (parts - 1))) <= allowed:
        parts, error = parts - 1, coarser
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


@lru_cache(maxsize=32)
def _complex_spectrum(kernel: Kernel) -> NDArray[np.complex128]:
    return kernel.transform(_spectrum(kernel)[0])


@lru_cache(maxsize=32)
def _spectrum(kernel: Kernel) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return frequencies from 0 to where the kernel passes nothing, and its magnitude there."""
    slow = sorted(abs(pole.real) for pole in kernel.poles)[kernel.zeros :]
    longest_s = 16 * kernel.pulse.std_s + 32 / min(slow, default=math.inf)
    highest_hz = 1 / kernel.finest_s
    level = np.abs(kernel.transform(np.array([0.1 * highest_hz])))[0]
    while np.abs(kernel.transform(np.array([highest_hz, 0.93 * highest_hz]))).max() > 1e-13 * level:
        highest_hz *= 1.3
        if highest_hz * longest_s > 2**16:
            break
    frequency_hz = np.linspace(0, highest_hz, 2 ** math.ceil(math.log2(highest_hz * longest_s) + 1) + 1)
    return frequency_hz, np.abs(kernel.transform(frequency_hz))
