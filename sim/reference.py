"""Slow and obvious forms: what the compiled loops do, and what an echo is.

The loops here serve single shots, and all where numba cannot be imported. The rest is for tests and for
`belahil accuracy`: a fast form is right when it agrees with these.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from sim.constants import SPEED_OF_LIGHT_M_PER_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim.kernel import Kernel


def slant_delay(
    height_m: NDArray[np.float64], distance_squared_m2: NDArray[np.float64], altitude_m: float
) -> NDArray[np.float64]:
    """Return 2 (R - altitude) / c for places at a height and a squared horizontal distance from nadir, s.

    With d = altitude - height, R - altitude = r^2 / (d + sqrt(d^2 + r^2)) - height: no difference of large
    numbers.
    """
    down = altitude_m - height_m
    longer = distance_squared_m2 / (down + np.sqrt(down**2 + distance_squared_m2))
    return np.asarray(2 / SPEED_OF_LIGHT_M_PER_S * (longer - height_m))


def lag4_deposit(
    places: NDArray[np.float64], weights: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """Spread weights over the four bins about each place by the cubic through them.

    Parameters
    ----------
    places : ndarray of float64, shape (n,)
        In bins; from 1 to below ``count - 2``.
    weights : ndarray of float64, shape (n,)
        Any sign.
    count : int
        Number of bins.

    Returns
    -------
    ndarray of float64, shape (count,)
        Moments 0 to 3 in time are those of the places. A bin may be slightly negative: where positivity is
        needed, `cic_deposit` serves.
    """
    node = places.astype(np.intp)
    u = places - node
    lagrange = (
        -u * (u - 1) * (u - 2) / 6,
        (u + 1) * (u - 1) * (u - 2) / 2,
        -(u + 1) * u * (u - 2) / 2,
        (u + 1) * u * (u - 1) / 6,
    )
    histogram = np.zeros(count)
    for shift, basis in zip((-1, 0, 1, 2), lagrange, strict=True):
        histogram += np.bincount(node + shift, weights * basis, minlength=count)
    return histogram


def cic_deposit(places: NDArray[np.float64], weights: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Share weights between the two bins about each place, linearly; parameters as `lag4_deposit`.

    Never negative for weights that are not. The variance of an echo grows by a sixth of a bin squared.
    """
    node = places.astype(np.intp)
    part = places - node
    near = np.bincount(node, weights * (1 - part), minlength=count)
    return np.asarray(near + np.bincount(node + 1, weights * part, minlength=count))


def polyphase(
    histogram: NDArray[np.float64], taps: NDArray[np.float64], offset: int, stride: int, count: int
) -> NDArray[np.float64]:
    """Convolve a histogram with taps on the same bins, and keep every `stride`-th value.

    Parameters
    ----------
    histogram : ndarray of float64, shape (bins,)
    taps : ndarray of float64, shape (n,)
        Zero outside.
    offset : int
        Which tap meets bin 0 at sample 0.
    stride : int
        Bins from sample to sample.
    count : int
        Number of samples.
    """
    whole = np.convolve(histogram, taps)
    index = offset + stride * np.arange(count)
    inside = (index >= 0) & (index < whole.size)
    return np.where(inside, whole[np.where(inside, index, 0)], 0.0)


def grid_echo(
    height_m: NDArray[np.float64],
    brightness: NDArray[np.float64],
    corner_m: tuple[float, float],
    spacing_m: float,
    centres_m: NDArray[np.float64],
    sigma_m: tuple[float, float],
    reach: float,
    altitude_m: float,
    origins_s: NDArray[np.float64],
    bin_s: float,
    bins: int,
    taps: NDArray[np.float64],
    offset: int,
    stride: int,
    count: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sample the echoes of Gaussian beams that look down on the posts of a grid.

    Parameters
    ----------
    height_m : ndarray of float64, shape (rows, columns)
        Heights, small against the altitude.
    brightness : ndarray of float64, shape (rows, columns) or (1, 1)
        Factors of the posts' light; of shape (1, 1) it is not used.
    corner_m : tuple of float
        x and y of ``height_m[0, 0]``, m.
    spacing_m : float
        Between posts, m.
    centres_m : ndarray of float64, shape (shots, 2)
        Nadir and centre of each beam, m.
    sigma_m : tuple of float
        Standard deviations of the beams along x and y, m.
    reach : float
        Posts beyond so many standard deviations are left out.
    altitude_m : float
        m.
    origins_s : ndarray of float64, shape (shots,)
        Delay at bin 0, s.
    bin_s : float
        s.
    bins : int
        Light outside 0 to `bins` is left out.
    taps, offset, stride, count
        As in `polyphase`.

    Returns
    -------
    samples : ndarray of float64, shape (shots, count)
    energies : ndarray of float64, shape (shots,)
        Sum of the weights, 1 for a whole beam of brightness 1.
    """
    rows, columns = height_m.shape
    samples, energies = np.zeros((len(centres_m), count)), np.zeros(len(centres_m))
    x = corner_m[0] + spacing_m * np.arange(columns)
    y = corner_m[1] + spacing_m * np.arange(rows)
    scale = spacing_m**2 / (2 * math.pi * sigma_m[0] * sigma_m[1])
    for shot, ((x0, y0), origin_s) in enumerate(zip(centres_m, origins_s, strict=True)):
        left, right = np.searchsorted(x, (x0 - reach * sigma_m[0], x0 + reach * sigma_m[0]))
        low, high = np.searchsorted(y, (y0 - reach * sigma_m[1], y0 + reach * sigma_m[1]))
        dx, dy = x[left:right] - x0, y[low:high, None] - y0
        distance = (dx / sigma_m[0]) ** 2 + (dy / sigma_m[1]) ** 2
        light = np.where(distance <= reach**2, scale * np.exp(-0.5 * distance), 0.0)
        if brightness.size > 1:
            light = light * brightness[low:high, left:right]
        delay_s = slant_delay(height_m[low:high, left:right], dx**2 + dy**2, altitude_m)
        places = (delay_s - origin_s) / bin_s
        inside = (places >= 0) & (places < bins)
        weights = light[inside]
        histogram = lag4_deposit(places[inside] + 1, weights, bins + 3)
        samples[shot] = polyphase(histogram, taps, offset + 1, stride, count)
        energies[shot] = weights.sum()
    return samples, energies


def plane_echo(
    kernel: Kernel,
    gradient: tuple[float, float],
    centre_m: tuple[float, float],
    sigma_m: float,
    altitude_m: float,
    times_s: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the echo of a plane through the origin, of reflectance 1, by Fourier integration.

    Neither pixels nor poles taken apart: the transforms of kernel and delays, summed over frequency. The beam
    is a Gaussian of `sigma_m` about `centre_m`. The curvature of the wavefront is in it to second order in
    the size of the footprint; the next order is 1e-15 s for 30 m at 500 km and a slope of 60 degrees.

    Parameters
    ----------
    kernel : Kernel
        Its pulse and filter.
    gradient : tuple of float
        dz/dx and dz/dy.
    centre_m : tuple of float
        Where the beam's axis meets the plane z = 0, m from nadir.
    sigma_m, altitude_m : float
        m.
    times_s : ndarray of float64, shape (n,)
        s.
    """
    x, y = centre_m
    z = gradient[0] * x + gradient[1] * y
    slant_m = math.hypot(x, y, altitude_m - z)
    mean_s = float(slant_delay(np.array(z), np.array(x * x + y * y), altitude_m))
    tilt = [(place - g * (altitude_m - z)) / slant_m for place, g in zip(centre_m, gradient, strict=True)]
    spread_s = 2 / SPEED_OF_LIGHT_M_PER_S * sigma_m * math.hypot(*tilt)
    bend_s = 2 / SPEED_OF_LIGHT_M_PER_S * sigma_m**2 / slant_m
    highest_hz = _highest(kernel, spread_s)
    longest_s = 2 * (np.abs(times_s - mean_s).max() + 12 * spread_s) + kernel.ends_s - kernel.starts_s
    frequency_hz = (np.arange(math.ceil(highest_hz * longest_s) + 1) + 0.5) / longest_s
    turned = 1 + 2j * np.pi * frequency_hz * bend_s
    delays = np.exp(-2 * (np.pi * frequency_hz * spread_s) ** 2 / turned) / turned
    spectrum = kernel.transform(frequency_hz) * delays
    phases = np.exp(2j * np.pi * np.multiply.outer(times_s - mean_s, frequency_hz))
    return np.asarray(2 / longest_s * (phases @ spectrum).real)


def _highest(kernel: Kernel, spread_s: float) -> float:
    """Frequency above which nothing above 1e-16 is left, Hz."""
    highest_hz = 1e6
    level = np.abs(kernel.transform(np.array([highest_hz]))[0])
    while np.abs(kernel.transform(np.array([highest_hz]))[0]) > 1e-17 * level:
        highest_hz *= 1.5
        if spread_s * highest_hz > 1.5:  # exp(-2 pi^2 1.5^2) = 5e-20
            break
    return highest_hz
