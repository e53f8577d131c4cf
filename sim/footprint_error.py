"""What pixels and time bins will leave of an error, before anything is computed.

Three errors are predicted, each from the transforms of the receiver's kernel and of the beam, so that the
prediction follows the bandwidth of pulse and filter:

* the edge of the beam that is left out, exp(-R^2 / 2 sigma^2);
* the spacing of the pixels. The pixel-centre sum is a trapezoid rule; what it adds is the spectrum of the
  light on the ground about the multiples of 1 / dx (Poisson's summation formula). A gradient of s seconds a
  metre turns frequency f into s f cycles a metre, so the light there has passed the kernel at f = m / (dx s).
  The worst gradient is along the grid;
* the deposit on time bins: the cubic through four values of the kernel, at the worst place in a bin.

On a plane along the grid the second is met within some 20 %. On relief the steepest slope is used for all of
it; that is an estimate, no bound. Edges and kinks are left to `sim.footprint_edges`. What relief smaller than
the posts of a terrain model would have done is not in it: `sim.echo.posts_error` tells that apart.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from sim.beam import beam_image, beam_sigma_m
from sim.constants import SPEED_OF_LIGHT_M_PER_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim.kernel import Kernel
    from sim.laser import Laser

_FINE_LOBES = 16
"""Values in a lobe of an image's transform."""

_EVERY_ROUND = math.pi**2 / 6
"""1 + 1/4 + 1/9 + ...: rounds of a grid, where a transform falls with the square."""


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


@lru_cache(maxsize=32)
def echo_peak(kernel: Kernel, spread_s: float) -> float:
    """Return the peak of a kernel behind a Gaussian of `spread_s`: the echo of a plane."""
    every_hz = _spectrum(kernel)[0]
    highest_hz = every_hz[-1]
    if spread_s:
        highest_hz = min(highest_hz, 9 / (2 * math.pi * spread_s))
    # Steps of the spectrum, or finer: a pulse from a table reaches far, and wider ones would fold its echo.
    count = max(1024, math.ceil(highest_hz / every_hz[1]))
    times = 8 if count <= 8192 else 2
    frequency_hz = np.arange(count) * (highest_hz / count)
    spectrum = kernel.transform(frequency_hz) * np.exp(-2 * (math.pi * frequency_hz * spread_s) ** 2)
    return float(np.abs(np.fft.irfft(spectrum, times * count)).max() * times * highest_hz)


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
    """Return the magnitude of a beam's transform against cycles a metre, 1 at 0, in its worst direction.

    That of an image has the kinks between its pixels: it falls as 1 / k^2, with zeros at the multiples of one
    turn a pixel, where steps of a pixel's whole fraction would miss nothing. Beyond half a turn it is
    therefore a hull of all such, and of all further rounds of the grid of steps.
    """
    if laser.beam != "image":
        narrow_m = beam_sigma_m(laser, altitude_m)[1]
        return lambda cycles: np.asarray(np.exp(-2 * (np.pi * narrow_m * cycles) ** 2))
    image = beam_image(laser)
    pixel_m, side = image.pixel_rad * altitude_m, max(image.pixels.shape)
    rows = [image.pixels.sum(axis=axis) / image.pixels.sum() for axis in (0, 1)]
    level = np.max([np.abs(np.fft.rfft(row, 2 * _FINE_LOBES * side)) for row in rows], axis=0)
    turns = np.linspace(0, 0.5, level.size)
    tail = _EVERY_ROUND * float((level * np.sin(np.pi * turns) ** 2).max()) / np.pi**2

    def magnitude(cycles: NDArray[np.float64]) -> NDArray[np.float64]:
        round_pixel = np.abs(cycles) * pixel_m
        near = np.interp(round_pixel, turns, level) * np.sinc(round_pixel) ** 2
        return np.where(round_pixel <= 0.5, near, tail / np.maximum(round_pixel, 0.5) ** 2)

    return magnitude


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
