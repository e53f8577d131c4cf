"""Lines in the spectrum of noise: interference that no model foresaw.

The periodograms of several records are averaged, each with a Hann taper. What rises above the running median
further than chance allows anywhere in the spectrum is a line: an averaged periodogram of noise over its mean
is a gamma variate with as many degrees as records (Welch 1967). The place of a line follows exactly from the
ratio of its two largest bins (Rife and Vincent 1970, for a Hann taper), its power from the bins round it.

Not modelled: lines that come and go, or whose frequency moves by more than a bin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.values import Estimate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

FALSE_ALARM = 1e-3
"""Probability that noise without any line shows one somewhere."""
MOST_LINES = 8
_REACH = 3
"""Bins at each side that hold the power of a line: with a Hann taper all but 1e-4 of it."""
_NEAR = 64
"""Bins at each side that tell the noise density."""
_SMALLEST = 1e-60
_TAPER_BINS = 1.5
"""Noise bandwidth of the Hann taper, bins."""


@dataclass(frozen=True, slots=True)
class SpectralLine:
    """A sine in the noise.

    Parameters
    ----------
    frequency : Estimate
        Hz, between 0 and half the sample rate.
    rms : Estimate
        V.
    """

    frequency: Estimate
    rms: Estimate


@dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """An averaged periodogram.

    Parameters
    ----------
    power : ndarray of float64, shape (n // 2 + 1,)
        Mean square in each bin, V^2; all bins sum to that of the records.
    floor : ndarray of float64, shape (n // 2 + 1,)
        The same of the noise alone, from the bins near by.
    bin_hz : float
        Distance of the bins, Hz.
    records : int
        How many were averaged.
    """

    power: Array
    floor: Array
    bin_hz: float
    records: int

    @property
    def least_line_v2(self) -> Array:
        """Mean square that a bin needs to be a line, V^2."""
        from scipy.special import gammainccinv

        return self.floor * float(gammainccinv(self.records, FALSE_ALARM / self.power.size)) / self.records


def spectrum(records: Array, sample_rate_hz: float) -> Spectrum:
    """Average the periodograms of records.

    Parameters
    ----------
    records : ndarray of float64, shape (r, n)
        V, without their means; n at least 512.
    sample_rate_hz : float
        Hz.
    """
    from scipy.special import gammainccinv

    count = records.shape[1]
    taper = np.hanning(count + 1)[:-1]
    power = np.zeros(count // 2 + 1)
    for one in records:
        power += np.abs(np.fft.rfft(one * taper)) ** 2
    power *= 2 / (count * float(taper @ taper) * len(records))
    # The ends lack a mirror image: half, and what removed means emptied there is no measure of noise.
    power[0] /= 2
    if count % 2 == 0:
        power[-1] /= 2
    middle = float(gammainccinv(len(records), 0.5)) / len(records)
    return Spectrum(power, _running_median(power) / middle, sample_rate_hz / count, len(records))


def _running_median(power: Array) -> Array:
    """Median over the bins near by, those next to both ends left out; interpolated between blocks."""
    inner = power[_REACH:-_REACH]
    width = min(2 * _NEAR, inner.size)
    starts = np.unique(np.append(np.arange(0, inner.size - width + 1, width // 2), inner.size - width))
    medians = np.median(np.lib.stride_tricks.sliding_window_view(inner, width)[starts], axis=1)
    places = starts + _REACH + (width - 1) / 2
    return np.asarray(np.interp(np.arange(power.size), places, medians))


def find_lines(seen: Spectrum) -> tuple[SpectralLine, ...]:
    """Return the lines of a spectrum, the strongest first, at most 8.

    Parameters
    ----------
    seen : Spectrum
        Its ends, within three bins of 0 and of half the sample rate, are not searched.
    """
    excess = np.where(seen.power > seen.least_line_v2, seen.power, 0.0)
    excess[: _REACH + 1] = excess[-_REACH - 1 :] = 0.0
    found: list[SpectralLine] = []
    while len(found) < MOST_LINES:
        top = int(np.argmax(excess))
        if excess[top] <= 0:
            break
        found.append(_line(seen, top))
        # What leaks through the taper falls with the third power of the distance.
        reach = max(
            _REACH,
            math.ceil((20 * float(seen.power[top]) / max(float(seen.floor[top]), _SMALLEST)) ** (1 / 6)),
        )
        excess[max(top - reach, 0) : top + reach + 1] = 0.0
    return tuple(sorted(found, key=lambda one: -one.rms.value))


def _line(seen: Spectrum, top: int) -> SpectralLine:
    near = slice(top - _REACH, top + _REACH + 1)
    floor = float(seen.floor[top])
    power = max(float(np.sum(seen.power[near] - seen.floor[near])), 0.1 * float(seen.power[top]))
    side = 1 if seen.power[top + 1] >= seen.power[top - 1] else -1
    ratio = math.sqrt(float(seen.power[top + side] / seen.power[top]))
    place = top + side * max(0.0, (2 * ratio - 1) / (1 + ratio))
    noise = _TAPER_BINS * floor / seen.records
    # In phase with the line noise moves its power, in quadrature its frequency (Cramer and Rao's bound).
    power_u = math.sqrt(2 * power * noise + (2 * _REACH + 1) * floor**2 / seen.records)
    place_u = math.sqrt(6 * noise / power) / math.pi
    rms = math.sqrt(power)
    return SpectralLine(
        Estimate(place * seen.bin_hz, place_u * seen.bin_hz, "Hz"), Estimate(rms, power_u / (2 * rms), "V")
    )
