"""Keyed noise, slow and obvious: what `sim.compiled_noise` does, in NumPy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sim.keyed import words

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim.keyed import Key


def normal_of(word: NDArray[np.uint32]) -> NDArray[np.float32]:
    """Return the normal deviate of each word, as `sim.keyed` defines it."""
    from scipy.special import ndtri

    quantile = -ndtri(((word & np.uint32(0x7FFFFFFF)) + 0.5) / 2.0**32)
    return np.where(word >> np.uint32(31), -quantile, quantile).astype(np.float32)


def normals(key: Key, first: int, count: int) -> NDArray[np.float32]:
    """Return the normal deviates of a stream with the numbers from `first` on, shape (count,)."""
    return normal_of(words(key, first, count))


def coloured(key: Key, taps: NDArray[np.float32], count: int) -> NDArray[np.float32]:
    """Return a moving average of the first ``count + taps.size - 1`` deviates of a stream, shape (count,).

    The first tap weighs the newest deviate.
    """
    white = normals(key, 0, count + taps.size - 1)
    # With fewer deviates than taps NumPy would swap the two.
    return np.convolve(white, taps, mode="valid")[:count]


def digitized(
    noise: NDArray[np.float32],
    echo_v: NDArray[np.float64],
    low: int,
    factors: tuple[float, float],
    offsets_v: tuple[float, float],
    volts_per_count: float,
    bits: int,
) -> tuple[NDArray[np.float64], int]:
    """Add an echo to a window of noise, and digitize.

    Parameters
    ----------
    noise : ndarray of float32, shape (n,)
        At the converter, V.
    echo_v : ndarray of float64, shape (m,)
        At the converter, V.
    low : int
        Its first sample; it lies within the window.
    factors, offsets_v : tuple of float
        Of even samples and of odd ones.
    volts_per_count, bits
        As of `sim.converter.Quantizer`.

    Returns
    -------
    volts : ndarray of float64, shape (n,)
        Whole counts, as volts.
    saturated : int
        How many samples lay beyond an end.
    """
    volts = noise.astype(np.float64)
    volts[low : low + echo_v.size] += echo_v
    for one in (0, 1):
        volts[one::2] = volts[one::2] * factors[one] + offsets_v[one]
    counts = np.rint(volts / volts_per_count)
    least, most = -(2.0 ** (bits - 1)), 2.0 ** (bits - 1) - 1
    saturated = int(np.count_nonzero((counts < least) | (counts > most)))
    return np.clip(counts, least, most) * volts_per_count, saturated
