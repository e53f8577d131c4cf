"""Analog-to-digital converters: when they sample, how two of them differ, and what code they give.

What this does not model: differential and integral nonlinearity, aperture jitter, missing codes, and a
difference in bandwidth between the two converters.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim.draws import Draws

# Even, so that every block starts with the same converter.
_BLOCK = 128


@dataclass(frozen=True, slots=True)
class SampleGrid:
    """The true instants at which two interleaved converters sample.

    Parameters
    ----------
    interval_s : float
        True time between samples, s.
    skew_s : float
        Even samples are taken half of it later, odd ones half of it earlier, s.
    """

    interval_s: float
    skew_s: float = 0.0

    def times_s(self, sample_count: int, first_s: float = 0.0) -> NDArray[np.float64]:
        """Return the instants, shape (sample_count,), when the unskewed sample 0 is at `first_s`."""
        times = first_s + np.arange(sample_count, dtype=np.float64) * self.interval_s
        if self.skew_s:
            times[0::2] += self.skew_s / 2
            times[1::2] -= self.skew_s / 2
        return times

    def sine(self, sample_count: int, frequency_hz: float, phase_rad: float) -> NDArray[np.float64]:
        """Return ``sin(2 pi f t + phase)`` at ``t = times_s(sample_count)``.

        The sine of a sum, with coarse and fine times: two short tables instead of a sine per sample. Exact
        to some 1e-15 times the angle in radians, as the direct form is.
        """
        rows = -(-sample_count // _BLOCK)
        omega = 2 * np.pi * frequency_hz
        coarse = omega * (np.arange(rows) * (_BLOCK * self.interval_s)) + phase_rad
        fine = omega * self.times_s(_BLOCK)
        values: NDArray[np.float64] = np.multiply.outer(np.sin(coarse), np.cos(fine))
        values += np.multiply.outer(np.cos(coarse), np.sin(fine))
        return values.reshape(-1)[:sample_count]


def mismatch_gain(volts: NDArray[np.float64], draws: Draws, *, gain: float) -> None:
    """Multiply even samples by ``1 + gain / 2`` and odd ones by ``1 - gain / 2``, in place."""
    volts[0::2] *= 1 + gain / 2
    volts[1::2] *= 1 - gain / 2


def mismatch_offset(volts: NDArray[np.float64], draws: Draws, *, offset_v: float) -> None:
    """Add ``offset_v / 2`` to even samples and take it from odd ones, in place."""
    volts[0::2] += offset_v / 2
    volts[1::2] -= offset_v / 2


@dataclass(frozen=True, slots=True)
class Quantizer:
    """Volts to codes.

    Up to 15 bits the codes are offset binary, 0 to 2**bits - 1 with zero volts at 2**(bits - 1). With 16 bits
    they are two's complement with zero volts at 0, so that int16 holds them.

    Parameters
    ----------
    full_scale_v : float
        Whole span, V.
    bits : int
        2 to 16.
    """

    full_scale_v: float
    bits: int

    @property
    def volts_per_count(self) -> float:
        """Size of one code, V."""
        return self.full_scale_v / (1 << self.bits)

    @property
    def zero_count(self) -> int:
        """Code of zero volts."""
        return 0 if self.bits == 16 else 1 << (self.bits - 1)

    def counts(self, volts: NDArray[np.float64]) -> tuple[NDArray[np.int16], int]:
        """Round to the nearest code and clip at both ends.

        Parameters
        ----------
        volts : ndarray of float64, shape (n,)
            At the converter, V; overwritten.

        Returns
        -------
        counts : ndarray of int16, shape (n,)
            Codes.
        saturated : int
            How many samples lay beyond an end.
        """
        lowest = self.zero_count - (1 << (self.bits - 1))
        highest = lowest + (1 << self.bits) - 1
        volts /= self.volts_per_count
        np.rint(volts, out=volts)
        volts += self.zero_count
        saturated = 0
        if volts.size and (volts.min() < lowest or volts.max() > highest):
            saturated = int(np.count_nonzero((volts < lowest) | (volts > highest)))
            np.clip(volts, lowest, highest, out=volts)
        return volts.astype(np.int16), saturated
