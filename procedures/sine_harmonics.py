"""What a record of a sine holds beside the sine: harmonics, images of interleaved converters, noise.

All of it is fitted at once by linear least squares: a constant, cosine and sine at the frequency and at its
harmonics 2 to 10 (IEEE Std 1057-2017 counts these), and for two converters the same columns times (-1)^n. So
a frequency need not be coherent. A line that falls within a bin of an earlier one cannot be told from it and
is left out.

The phase of a free-running sine differs from record to record, that of its harmonic h turns by h times as
much. Turned back, the lines of several records are averaged as complex numbers, and noise averages out.

Not modelled: distortion that depends on anything but the instantaneous voltage and the converter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from procedures.spectral_lines import Spectrum, spectrum

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

LAST_HARMONIC = 10
_APART_BINS = 1.0
_NEAR = 32
"""Bins at each side of a line that tell the noise there."""
_CLEAN = 1e-28
"""Part of the sine's power that rounding leaves of a record without noise."""


@dataclass(frozen=True, slots=True)
class Line:
    """A line that belongs to the sine.

    Parameters
    ----------
    harmonic : int
        0 for a constant, 1 for the sine itself.
    image : bool
        Multiplied by (-1)^n: how two converters differ.
    amplitude : float
        Peak value, V; of the constant and its image the value itself without sign.
    amplitude_u : float
        Standard uncertainty from the noise at its place, V.
    """

    harmonic: int
    image: bool
    amplitude: float
    amplitude_u: float

    @property
    def power(self) -> float:
        """Mean square, V^2, less what noise adds on average."""
        parts, share = (1, 1.0) if self.harmonic == 0 else (2, 0.5)
        return share * (self.amplitude**2 - parts * self.amplitude_u**2)

    @property
    def power_u(self) -> float:
        """Standard uncertainty of `power`, V^2."""
        parts, share = (1, 1.0) if self.harmonic == 0 else (2, 0.5)
        square = self.amplitude_u**2
        return share * math.sqrt(4 * self.amplitude**2 * square + 2 * parts * square**2)


@dataclass(frozen=True, slots=True, eq=False)
class Harmonics:
    """What several records of one sine hold.

    Parameters
    ----------
    lines : tuple of Line
        Constant, sine, harmonics and images that can be told apart.
    residual_v2 : float
        Mean square of what the plain three-parameter fit leaves: noise and distortion, V^2.
    residual_u_v2 : float
        Its standard uncertainty, V^2.
    noise_v2 : float
        Mean square of what the fit of all lines leaves, V^2.
    noise_u_v2 : float
        Its standard uncertainty, V^2.
    spectrum : Spectrum
        Of what that fit leaves.
    """

    lines: tuple[Line, ...]
    residual_v2: float
    residual_u_v2: float
    noise_v2: float
    noise_u_v2: float
    spectrum: Spectrum

    def line(self, harmonic: int, image: bool = False) -> Line | None:
        """Return one line; None where it falls on another."""
        return next((one for one in self.lines if (one.harmonic, one.image) == (harmonic, image)), None)


class HarmonicPlan:
    """The fit of all lines of one frequency, prepared for many records.

    Parameters
    ----------
    frequency_hz, sample_rate_hz : float
        True ones, Hz, positive.
    sample_count : int
        Samples in a record, at least 512.
    interleaved : bool
        Two converters.
    """

    def __init__(
        self, frequency_hz: float, sample_rate_hz: float, sample_count: int, interleaved: bool
    ) -> None:
        cycles = frequency_hz / sample_rate_hz
        self.sample_rate_hz = sample_rate_hz
        self.names, self.places = _told_apart(cycles, sample_count, interleaved)
        number = np.arange(sample_count)
        turn = np.where(number % 2, -1.0, 1.0)
        columns = []
        for harmonic, image in self.names:
            sign = turn if image else 1.0
            turns = number * (harmonic * cycles - round(harmonic * cycles))
            angle = 2 * np.pi * (turns - np.rint(turns))
            columns.append(sign * np.cos(angle))
            if harmonic:
                columns.append(sign * np.sin(angle))
        self._columns = np.array(columns)
        self._inverse = np.linalg.inv(self._columns @ self._columns.T)
        # Constant, cosine and sine come first: alone they are the three-parameter fit.
        self._plain = self._columns[:3]
        self._plain_inverse = np.linalg.inv(self._plain @ self._plain.T)

    def fit(self, records: Array) -> Harmonics:
        """Fit records of the same sine, each with a phase of its own.

        Parameters
        ----------
        records : ndarray of float64, shape (r, n)
            V.
        """
        count = records.shape[1]
        values = (records @ self._columns.T) @ self._inverse
        left = records - values @ self._columns
        plain = records - (records @ self._plain.T) @ self._plain_inverse @ self._plain
        clean = _CLEAN * float(np.mean(records**2))
        noise = float(np.sum(left**2)) / (len(left) * (count - len(self._columns))) + clean
        residual = float(np.sum(plain**2)) / (len(plain) * (count - 3)) + clean
        seen = spectrum(left, self.sample_rate_hz)
        lines = self._lines(values, seen, len(records), clean)
        inner = seen.power[2:-2]
        # Half of the mean square of an exponential variate is its squared mean; averaging r of them adds 1/r.
        squares = float(np.sum(inner**2)) / (1 + 1 / len(records))
        noise_u = math.sqrt(squares / len(records)) + clean
        beside = [one.power_u for one in lines if (one.harmonic, one.image) not in ((0, False), (1, False))]
        return Harmonics(lines, residual, math.hypot(noise_u, *beside), noise, noise_u, seen)

    def _lines(self, values: Array, seen: Spectrum, records: int, clean: float) -> tuple[Line, ...]:
        phasors, row = [], 0
        for harmonic, _ in self.names:
            if harmonic:
                phasors.append(values[:, row] - 1j * values[:, row + 1])
            else:
                phasors.append(values[:, row].astype(np.complex128))
            row += 2 if harmonic else 1
        phase = np.angle(phasors[self.names.index((1, False))])
        lines = []
        for (harmonic, image), place, phasor in zip(self.names, self.places, phasors, strict=True):
            mean = np.mean(phasor * np.exp(-1j * harmonic * phase))
            density = _near_by(seen.power, place) + clean
            # A constant has one coefficient with half the variance of a sine's two.
            spread = math.sqrt(density / records * (1.0 if harmonic else 0.5))
            lines.append(Line(harmonic, image, float(abs(mean)), spread))
        return tuple(lines)


def _told_apart(cycles: float, count: int, interleaved: bool) -> tuple[list[tuple[int, bool]], list[float]]:
    """Return (harmonic, image) of each line that stands alone, and its place in bins."""
    wanted = [(0, False), (1, False)]
    if interleaved:
        wanted += [(0, True), (1, True)]
    for harmonic in range(2, LAST_HARMONIC + 1):
        wanted += [(harmonic, False), (harmonic, True)] if interleaved else [(harmonic, False)]
    names: list[tuple[int, bool]] = []
    places: list[float] = []
    for harmonic, image in wanted:
        turns = harmonic * cycles + (0.5 if image else 0.0)
        place = abs(turns - round(turns)) * count
        # A sine next to zero or half the sample rate is no sine of two coefficients.
        lonely = harmonic == 0 or _APART_BINS < place < count / 2 - _APART_BINS
        if lonely and all(abs(place - other) > _APART_BINS for other in places):
            names.append((harmonic, image))
            places.append(place)
    return names, places


def _near_by(power: Array, place: float) -> float:
    """Mean square of a bin near a place, V^2."""
    first = min(max(round(place) - _NEAR, 2), power.size - 2 * _NEAR - 3)
    return float(np.mean(power[first : first + 2 * _NEAR + 1]))
