"""The compiled loops; what each does, and its NumPy form of the same name, is in `sim.reference`.

They serve where there are many shots. For one shot numba would take longer to load than it saves; `sim.loops`
loads this module when it is first needed. Compiled when first called and kept on disk.

Of what numba calls fast math only the freedoms of rounding are given, and in sums of products their order:
NaN and infinity keep their meaning.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from numpy.typing import NDArray

_TWO_OVER_C = 2 / 299792458.0
_THIRD, _SIXTH = 1 / 3, 1 / 6
_1, _2, _3 = np.uint64(1), np.uint64(2), np.uint64(3)
_SUMS = {"reassoc", "contract", "nsz"}


@njit(cache=True, nogil=True, fastmath=_SUMS)
def _products(
    backwards: NDArray[np.float64],
    taps: NDArray[np.float64],
    offset: int,
    stride: int,
    samples: NDArray[np.float64],
) -> None:
    """Scalar products of a histogram, last bin first, with the taps; written so that they vectorize."""
    bins = backwards.size
    for i in range(samples.size):
        begin = offset + i * stride - (bins - 1)
        low, high = max(begin, 0), min(begin + bins, taps.size)
        total = 0.0
        if high > low:
            # Unsigned: a signed index might be negative, and the loop would not vectorize.
            tap, bin_ = np.uint64(low), np.uint64(low - begin)
            for j in range(np.uint64(high - low)):
                total += backwards[bin_ + j] * taps[tap + j]
        samples[i] = total


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
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
    """As `sim.reference.grid_echo`."""
    rows, columns = height_m.shape
    shots = centres_m.shape[0]
    samples, energies = np.empty((shots, count)), np.empty(shots)
    moments, backwards = np.zeros(4 * (bins + 3)), np.zeros(bins + 3)
    place, shares = np.empty(columns), np.empty(columns)
    across, square = np.empty(columns), np.empty(columns)
    scale = spacing_m * spacing_m / (2 * math.pi * sigma_m[0] * sigma_m[1])
    to_bins = _TWO_OVER_C / bin_s
    half, inverse = 0.5 / altitude_m, 1 / altitude_m
    mapped = brightness.size > 1
    for shot in range(shots):
        x0, y0 = centres_m[shot]
        start = origins_s[shot] / bin_s
        left = max(0, math.ceil((x0 - reach * sigma_m[0] - corner_m[0]) / spacing_m))
        right = min(columns, math.floor((x0 + reach * sigma_m[0] - corner_m[0]) / spacing_m) + 1)
        low = max(0, math.ceil((y0 - reach * sigma_m[1] - corner_m[1]) / spacing_m))
        high = min(rows, math.floor((y0 + reach * sigma_m[1] - corner_m[1]) / spacing_m) + 1)
        for j in range(left, right):
            x = corner_m[0] + j * spacing_m
            away = (x - x0) / sigma_m[0]
            square[j] = (x - x0) ** 2
            across[j] = math.exp(-0.5 * away * away)
        energy = 0.0
        for i in range(low, high):
            y = corner_m[1] + i * spacing_m - y0
            away = y / sigma_m[1]
            wide = sigma_m[0] * math.sqrt(max(reach * reach - away * away, 0.0))
            begin = max(left, math.ceil((x0 - wide - corner_m[0]) / spacing_m))
            end = min(right, math.floor((x0 + wide - corner_m[0]) / spacing_m) + 1)
            if end <= begin:
                continue
            y2, along = y * y, scale * math.exp(-0.5 * away * away)
            row, x2, at, lit = height_m[i, begin:end], square[begin:end], place[begin:end], across[begin:end]
            for j in range(end - begin):
                z = row[j]
                q = (x2[j] + y2) * half
                e = z * inverse
                at[j] = (q * (1 + e + e * e - q * half) - z) * to_bins - start
            if mapped:
                bright, even, lit = brightness[i, begin:end], lit, shares[begin:end]
                for j in range(end - begin):
                    lit[j] = even[j] * bright[j]
            for j in range(end - begin):
                node = int(at[j])
                if np.uint64(node) >= np.uint64(bins):  # or below 0
                    continue
                part, weight = at[j] - node, lit[j] * along
                second = weight * part * part
                m = np.uint64(4) * np.uint64(node)
                moments[m] += weight
                moments[m + _1] += weight * part
                moments[m + _2] += second
                moments[m + _3] += second * part
        first, last = 0, bins - 1
        while first < last and moments[4 * first] == 0:
            first += 1
        while last > first and moments[4 * last] == 0:
            last -= 1
        width = last - first + 4
        spread = backwards[:width]
        spread[:] = 0.0
        for node in range(first, last + 1):
            m = np.uint64(4 * node)
            m0, m1, m2, m3 = moments[m], moments[m + _1], moments[m + _2], moments[m + _3]
            moments[m] = moments[m + _1] = moments[m + _2] = moments[m + _3] = 0.0
            j = width - 1 - (node - first)
            spread[j] += 0.5 * m2 - _THIRD * m1 - _SIXTH * m3
            spread[j - 1] += m0 - m2 + 0.5 * (m3 - m1)
            spread[j - 2] += m1 + 0.5 * (m2 - m3)
            spread[j - 3] += _SIXTH * (m3 - m1)
            energy += m0
        energies[shot] = energy
        # The first bin of the spread histogram is the one before `first`.
        _products(spread, taps, offset - (first - 1), stride, samples[shot])
    return samples, energies
