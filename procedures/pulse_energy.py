"""The pulse of a window, and both of its integrals: over its samples, and over the Gaussian fitted to them.

Not modelled: other pulses in the window; the largest is taken. A baseline is taken off for each converter,
from the samples before the pulse. Where there are none, as in a correlation window that the receiver sent
alone, the receiver's 0 V is believed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.pulse_fit import FitStatus, gaussian_fit
from procedures.clipping import span_of
from procedures.played_pulses import GAUSSIAN_AREA

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.values import RangeWindow
    from sim.rfm import RangeFinder

EnergyStatus = FitStatus | Literal["another_receiver", "not_known"]

LEAST_QUIET = 64
"""Samples of a converter from which a baseline is taken, at least."""

_SETTLED_SAMPLES = 64
"""Before the correlation window, so far from the pulse that it has not begun."""

_RECENTRINGS = 3
"""Times that a correlation window moves to have its pulse in the middle; one is nearly always enough."""


@dataclass(frozen=True, slots=True)
class PulseEnergy:
    """A detected pulse.

    Parameters
    ----------
    status : str
        That of `belahil.pulse_fit`; only ``ok`` has numbers. ``saturated``: samples were clipped, and both
        integrals are too small. ``another_receiver``: sampled at another rate than the known receiver does.
        ``not_known``: a gain code whose gain is not known, or a stimulus that is not one pulse upwards.
    arrival_s, fwhm_s, amplitude_v : float
        Of the fitted Gaussian; the arrival from the first sample of the window.
    window_v_s : float
        E_CW: trapezoids over the correlation window, V s.
    gaussian_v_s : float
        E_G: area of the Gaussian, V s.
    rectified_v_s : float
        As `window_v_s`, with samples below 0 V taken for 0 V.
    """

    status: EnergyStatus
    arrival_s: float = 0.0
    fwhm_s: float = 0.0
    amplitude_v: float = 0.0
    window_v_s: float = 0.0
    gaussian_v_s: float = 0.0
    rectified_v_s: float = 0.0

    @property
    def usable(self) -> bool:
        """Whether both integrals say something."""
        return self.status == "ok"


def window_energy(window: RangeWindow, finder: RangeFinder, converters: int, bits: int) -> PulseEnergy:
    """Find and integrate the pulse of a digitized window.

    Parameters
    ----------
    window : RangeWindow
        With its samples, or with the correlation window of its best candidate alone.
    finder : RangeFinder
        Of the receiver: how long a correlation window is, and where.
    converters, bits : int
        Interleaved converters, each of which has its baseline; their resolution.
    """
    if not window.counts.size:
        counts = window.candidates[0].correlation_window if window.candidates else ()
        if len(counts) < 4:
            return PulseEnergy("too_few_samples")
        volts = (np.array(counts, dtype=np.float64) - window.zero_count) * window.volts_per_count
        found = _integrated(volts, window.sample_interval_s)
        return _clipped_instead(found) if window.saturated else found
    volts = window.volts
    first = _first_sample(volts, finder)
    if first is None:
        return PulseEnergy("no_pulse" if volts.size >= 4 else "too_few_samples")
    quiet = max(0, first - _SETTLED_SAMPLES)
    for one in range(converters):
        if quiet // converters >= LEAST_QUIET:
            volts[one::converters] -= volts[one:quiet:converters].mean()
    found = pulse_energy(volts, window.sample_interval_s, finder, first)
    return _clipped_instead(found) if window.saturated or _at_an_end(window, bits) else found


def pulse_energy(
    volts: NDArray[np.float64], interval_s: float, finder: RangeFinder, first: int | None = None
) -> PulseEnergy:
    """Find and integrate the largest pulse of a row of samples about 0 V.

    Parameters
    ----------
    volts : ndarray of float64, shape (n,)
        V at the converter.
    interval_s : float
        Between samples, s.
    finder : RangeFinder
        As in `window_energy`.
    first : int or None
        Where its correlation window begins, if that is known.
    """
    begin = _first_sample(volts, finder) if first is None else first
    if begin is None:
        return PulseEnergy("no_pulse" if volts.size >= 4 else "too_few_samples")
    size = min(finder.correlation_window_samples, volts.size)
    for _ in range(_RECENTRINGS):
        found = _integrated(volts[begin : begin + size], interval_s)
        if not found.fwhm_s:
            return found
        lag = begin + round(found.arrival_s / interval_s)
        middle = max(min(lag - (size - 1) // 2, volts.size - size), 0)
        if middle == begin:
            break
        begin = middle
    return PulseEnergy(
        found.status,
        found.arrival_s + begin * interval_s,
        found.fwhm_s,
        found.amplitude_v,
        found.window_v_s,
        found.gaussian_v_s,
        found.rectified_v_s,
    )


def _integrated(volts: NDArray[np.float64], interval_s: float) -> PulseEnergy:
    fit = gaussian_fit(volts, interval_s)
    if fit.pulse is None:
        return PulseEnergy(fit.status)
    return PulseEnergy(
        fit.status,
        fit.pulse.arrival_s,
        fit.pulse.fwhm_s,
        fit.pulse.amplitude_v,
        float(np.trapezoid(volts, dx=interval_s)),
        GAUSSIAN_AREA * fit.pulse.fwhm_s * fit.pulse.amplitude_v,
        float(np.trapezoid(np.maximum(volts, 0.0), dx=interval_s)),
    )


def _first_sample(volts: NDArray[np.float64], finder: RangeFinder) -> int | None:
    if volts.size < 4:
        return None
    found = finder.search(volts)
    return int(found[0, 3]) if found.size else None


def _at_an_end(window: RangeWindow, bits: int) -> bool:
    low, high = span_of(window, bits)
    return bool(window.counts.max() >= high or window.counts.min() <= low)


def _clipped_instead(found: PulseEnergy) -> PulseEnergy:
    return PulseEnergy("saturated", found.arrival_s) if found.fwhm_s else found
