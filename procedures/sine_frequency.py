"""When the frequency is not known exactly: four-parameter fit, and one clock error for a whole sweep."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import compress
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.values import Estimate
from procedures.coherent import alias_hz
from procedures.sine_fit import SineFit, SinePlan

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

_SEARCH_BINS = 8.0
_ROUNDS = 20


def fit_four_parameters(
    volts: Array,
    sample_rate_hz: float,
    near_hz: float | None = None,
    interleaved: bool = True,
    keep: NDArray[np.bool_] | None = None,
    volts_per_count: float = 0.0,
) -> SineFit:
    """Fit a sine of unknown frequency (IEEE Std 1057-2017, four parameters).

    The start is always the peak of the spectrum (Hann window, parabola through three logarithms), never a
    guess: Gauss and Newton's steps find nothing from more than a bin away.

    Parameters
    ----------
    volts : ndarray of float64, shape (n,)
        V.
    sample_rate_hz : float
        Hz.
    near_hz : float or None
        Nominal frequency, Hz. The peak is sought within 8 bins or 300 ppm of its alias, and the result is the
        frequency near it, not the alias. None: the highest peak, between 0 and half the sample rate.
    interleaved, keep, volts_per_count
        As in `SinePlan` and `SinePlan.fit`.

    Returns
    -------
    SineFit
        With `frequency` fitted. When there is no sine to fit its standard uncertainty is infinite.
    """
    used = np.isfinite(volts) if keep is None else keep & np.isfinite(volts)
    frequency = _spectral_peak(np.where(used, volts, 0.0), used, sample_rate_hz, near_hz)
    bin_hz = sample_rate_hz / volts.size
    for _ in range(_ROUNDS):
        plan = SinePlan(frequency, sample_rate_hz, volts.size, interleaved)
        fit = plan.fit(volts, keep, volts_per_count=volts_per_count)
        error = fit.frequency_error
        if not math.isfinite(error.standard_uncertainty):
            return replace(fit, frequency=Estimate(frequency, math.inf, "Hz"))
        step = frequency * error.value
        if abs(step) <= max(1e-3 * frequency * error.standard_uncertainty, 1e-14 * frequency):
            break
        frequency += min(max(step, -bin_hz / 2), bin_hz / 2)
    spread = frequency * error.standard_uncertainty
    # The phase at the first sample moves with the frequency; at the middle of the record it would not.
    phase_u = math.hypot(fit.phase.standard_uncertainty, math.pi * spread * volts.size / sample_rate_hz)
    return replace(
        fit,
        frequency=Estimate(frequency, spread, "Hz"),
        phase=replace(fit.phase, standard_uncertainty=phase_u),
    )


def _spectral_peak(
    volts: Array, used: NDArray[np.bool_], sample_rate_hz: float, near_hz: float | None
) -> float:
    count = volts.size
    centred = np.where(used, volts - volts.sum() / max(np.count_nonzero(used), 1), 0.0)
    power = np.abs(np.fft.rfft(centred * np.hanning(count + 1)[:count])) ** 2
    first, last = 1, power.size - 2
    if near_hz is not None:
        bin_hz = sample_rate_hz / count
        place, reach = alias_hz(near_hz, sample_rate_hz) / bin_hz, max(_SEARCH_BINS, 3e-4 * near_hz / bin_hz)
        first = min(max(first, math.floor(place - reach)), last)
        last = max(min(last, math.ceil(place + reach)), first)
    top = first + int(np.argmax(power[first : last + 1]))
    low, middle, high = np.log(np.maximum(power[top - 1 : top + 2], 1e-300)).tolist()
    curve = 2 * middle - low - high
    alias = (top + ((high - low) / (2 * curve) if curve > 0 else 0.0)) * sample_rate_hz / count
    if near_hz is None:
        return alias
    zone = round(near_hz / sample_rate_hz) * sample_rate_hz
    return float(zone + math.copysign(alias, near_hz - zone))


@dataclass(frozen=True, slots=True)
class ClockFit:
    """The clock error of a digitizer against the generator, from sines of known frequency.

    Parameters
    ----------
    status : {"ok", "inconsistent", "not_measurable"}
        "inconsistent": the records contradict each other (chi square above its mean by more than 6 standard
        deviations) and the uncertainty is widened to cover that; "not_measurable": no record shows a sine.
    ppm, standard_uncertainty_ppm : float
        The true sample rate is the nominal one times ``1 + ppm * 1e-6``; 0 and infinite when not measurable.
    chi_square : float
        Of the records against one common error.
    records : int
        How many were used.
    """

    status: Literal["ok", "inconsistent", "not_measurable"]
    ppm: float
    standard_uncertainty_ppm: float
    chi_square: float
    records: int

    def sample_rate_hz(self, nominal_hz: float) -> float:
        """Return the true sample rate, Hz."""
        return nominal_hz * (1 + self.ppm * 1e-6)


def common_clock(
    records: Iterable[tuple[float, Array]],
    sample_rate_hz: float,
    interleaved: bool = True,
    limit_ppm: float = 300.0,
) -> ClockFit:
    """Find the one clock error that a whole sweep shares.

    First the likelihood of all records together is searched over all errors up to the limit, with the
    records' sums over short blocks: steep sines are precise, slow ones unambiguous, together they are both.
    Then Gauss and Newton's steps of the joint least squares, each record with the noise at its frequency.

    Parameters
    ----------
    records : iterable of (float, ndarray of float64, shape (n,))
        True frequency of the sine, Hz, and the record, V. Leave out clipped records. Some ten of the
        strongest are enough.
    sample_rate_hz : float
        Nominal, Hz.
    interleaved : bool
        Two converters.
    limit_ppm : float
        Largest error considered.
    """
    held = list(records)
    fits = _fits(held, sample_rate_hz, interleaved)
    held, fits = _only(held, fits, [fit.usable for fit in fits])
    ppm = _search(fits, sample_rate_hz, held[0][1].size, limit_ppm) if held else 0.0
    # Only now, at nearly the right frequency, it shows which records are more than noise.
    fits = _fits(held, sample_rate_hz * (1 + ppm * 1e-6), interleaved)
    held, fits = _only(held, fits, [_is_seen(fit) for fit in fits])
    if not held:
        return ClockFit("not_measurable", 0.0, math.inf, 0.0, 0)
    for _ in range(_ROUNDS):
        errors = [fit.frequency_error for fit in fits]
        weight = np.array([1 / one.standard_uncertainty**2 for one in errors])
        value = np.array([one.value for one in errors])
        step = float(weight @ value / weight.sum())
        spread = float(weight.sum()) ** -0.5
        # A record that seems fast was sampled slowly.
        ppm = ((1 + ppm * 1e-6) / (1 + step) - 1) * 1e6
        if abs(step) <= max(1e-2 * spread, 1e-15):
            break
        fits = _fits(held, sample_rate_hz * (1 + ppm * 1e-6), interleaved)
    chi_square = float(weight @ (value - step) ** 2)
    free = max(len(held) - 1, 1)
    consistent = chi_square <= free + 6 * math.sqrt(2 * free)
    if not consistent:
        spread *= math.sqrt(chi_square / free)
    return ClockFit("ok" if consistent else "inconsistent", ppm, spread * 1e6, chi_square, len(held))


def _only(
    records: list[tuple[float, Array]], fits: list[SineFit], wanted: list[bool]
) -> tuple[list[tuple[float, Array]], list[SineFit]]:
    return list(compress(records, wanted)), list(compress(fits, wanted))


def _is_seen(fit: SineFit) -> bool:
    """Whether the sine is there: noise alone reaches five standard uncertainties once in 270 000 records."""
    return fit.usable and fit.amplitude.value > 5 * fit.amplitude.standard_uncertainty


def _fits(records: list[tuple[float, Array]], sample_rate_hz: float, interleaved: bool) -> list[SineFit]:
    plans: dict[tuple[float, int], SinePlan] = {}
    fits = []
    for frequency_hz, volts in records:
        key = frequency_hz, volts.size
        if key not in plans:
            plans[key] = SinePlan(frequency_hz, sample_rate_hz, volts.size, interleaved)
        fits.append(plans[key].fit(volts))
    return fits


def _search(fits: list[SineFit], sample_rate_hz: float, sample_count: int, limit_ppm: float) -> float:
    """Return the error, ppm, of the highest joint likelihood on a grid fine enough for the steepest sine."""
    duration = sample_count / sample_rate_hz
    steepest = max(fit.frequency.value for fit in fits)
    points = 2 * math.ceil(8 * limit_ppm * 1e-6 * steepest * duration) + 1
    ppm = np.linspace(-limit_ppm, limit_ppm, points)
    likelihood = np.zeros(points)
    for fit in fits:
        blocks = fit.phasors.size
        time = (np.arange(blocks) - (blocks - 1) / 2) * duration / blocks
        # Sampled slowly (negative ppm) a sine seems fast.
        turned = np.exp(2j * np.pi * fit.frequency.value * 1e-6 * np.outer(ppm, time)) @ fit.phasors
        likelihood += np.abs(turned) ** 2 / fit.noise_density
    return float(ppm[np.argmax(likelihood)])
