"""The range finder on whole windows: interpolation and refinement, and arrival against the bound in noise."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING

import numpy as np

from belahil.pole_response import SampledNoise
from belahil.pulse_bound import bound, filtered_noise_covariance
from belahil.pulse_fit import CURVATURE
from belahil.receiver import BELA_GRM
from procedures.accuracy_detection import (
    ABOVE_BOUND,
    FWHM_S,
    MM_PER_S,
    NOISE_FREE,
    PHASES,
    SNRS,
    UNIT,
    WIDTHS_S,
    bound_mm,
    by_scipy,
    fitted,
    white_case,
    white_reference,
)
from procedures.accuracy_footprint import INTERVAL_S, SAMPLES, kernel
from procedures.accuracy_rows import Measured, Setting
from sim.rfm import RangeFinder
from sim.template_bank import TemplateBank
from sim.whitened_fit import WhitenedFit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Noise = Callable[[np.random.Generator], NDArray[np.float64]]

REFINED_MM = 0.2
"""Of the least squares, after one refinement step."""

WINDOW = BELA_GRM.digitizer.max_sample_count
OPTICAL_S = (45e-9, 10e-9)
COLOURED_SNR = 30.0
_TRIALS = 1000
_MIDDLE = WINDOW // 2
_BEGIN = _MIDDLE - SAMPLES // 2 + 2
_AROUND = 150
"""Samples on either side of the middle, after which a pulse is over."""

_METHOD = "range finder"
_SAME = "least squares to the last digit (SciPy) of the same correlation window, without the window's mean"


def range_finder_settings() -> Iterator[Setting]:
    """List what is measured."""
    quiet = partial(Setting, "detection", NOISE_FREE)
    for widths in (8, 12, 16, 32):
        text = f"{widths} widths, log-parabola"
        yield quiet("range finder, unrefined", text, _SAME, UNIT, partial(_noise_free, widths, 0))
    for steps in (1, 2, 3):
        asked = REFINED_MM if steps == 1 else None
        text = f"12 widths, {steps} step{'s' if steps > 1 else ''}"
        yield quiet(_METHOD, text, _SAME, UNIT, partial(_noise_free, 12, steps), asked)
    for snr in SNRS:
        noisy = partial(Setting, "detection", white_case(snr), _METHOD)
        asked_mm = ABOVE_BOUND * bound_mm(snr)
        yield noisy("12 widths, 1 step", white_reference(_TRIALS), UNIT, partial(_white, snr), asked_mm)
    for optical_s in OPTICAL_S:
        yield from _coloured_settings(optical_s)


def _coloured_settings(optical_s: float) -> Iterator[Setting]:
    case = f"receiver's noise, echo {1e9 * optical_s:g} ns"
    reference = (
        f"the same without noise; rms of {_TRIALS} at SNR {COLOURED_SNR:g}, predicted is the Cramer-Rao bound"
    )
    # What is promised for the flight-like templates ends at 45 ns: a narrow echo leaves the filter skewed.
    asked = ABOVE_BOUND * coloured_bound_mm(optical_s) if optical_s >= FWHM_S else None
    one = partial(Setting, "detection", case)
    yield one("Gaussian fit", "converged", reference, UNIT, partial(_coloured_fit, optical_s), asked)
    yield one(_METHOD, "12 widths, 1 step", reference, UNIT, partial(_coloured_search, optical_s), asked)
    known_mm = ABOVE_BOUND * _known_bound_mm(optical_s)
    yield one("whitened fit", "known response", reference, UNIT, partial(_whitened, optical_s), known_mm)


def _finder(widths: int, steps: int) -> RangeFinder:
    return RangeFinder(TemplateBank(INTERVAL_S, widths), refinement_steps=steps)


def _echo(optical_s: float, centre: float, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """An echo of Gaussian delays behind the receiver; places in samples."""
    return kernel(1e-4).widened(optical_s / math.sqrt(CURVATURE)).exact((times - centre) * INTERVAL_S)


@lru_cache(maxsize=8)
def _peak(optical_s: float) -> float:
    return float(_echo(optical_s, 0.0, np.linspace(-4, 8, 2401)).max())


def _windows(optical_s: float, phase: float) -> NDArray[np.float64]:
    """A whole window with an echo of unit peak in its middle."""
    volts = np.zeros(WINDOW)
    near = slice(_MIDDLE - _AROUND, _MIDDLE + _AROUND)
    volts[near] = _echo(optical_s, _MIDDLE + phase, np.arange(near.start, near.stop, dtype=np.float64))
    return volts / _peak(optical_s)


def _noise_free(widths: int, steps: int) -> Measured:
    """Return the worst difference from least squares over widths and sampling phases."""
    finder, worst_s = _finder(widths, steps), 0.0
    for optical_s in WIDTHS_S:
        for phase in PHASES:
            volts = _windows(optical_s, phase)
            arrival_s, _, _, first = finder.search(volts)[0]
            begin = int(first)
            part = volts[begin : begin + SAMPLES] - volts.mean()
            worst_s = max(worst_s, abs(arrival_s - begin * INTERVAL_S - by_scipy(part, 1e-15)))
    return Measured(worst_s * MM_PER_S, lambda: finder.search(volts), work={"widths": widths})


def _white(snr: float) -> Measured:
    """Gaussians in white noise, found in a whole window."""
    places = np.arange(WINDOW, dtype=np.float64)
    width = FWHM_S / INTERVAL_S

    def pulse(phase: float) -> NDArray[np.float64]:
        with np.errstate(under="ignore"):
            return np.asarray(np.exp(-0.5 * CURVATURE * ((places - _MIDDLE - phase) / width) ** 2))

    finder, rng = _finder(12, 1), np.random.Generator(np.random.SFC64(1))
    errors_s = np.empty(_TRIALS)
    for trial in range(_TRIALS):
        phase = float(rng.uniform())
        volts = pulse(phase) + rng.standard_normal(WINDOW) / snr
        errors_s[trial] = finder.search(volts)[0, 0] - (_MIDDLE + phase) * INTERVAL_S
    return _rms(errors_s, lambda: finder.search(volts), bound_mm(snr))


def _rms(errors_s: NDArray[np.float64], shot: Callable[[], object], predicted_mm: float) -> Measured:
    return Measured(MM_PER_S * math.sqrt(float(np.mean(errors_s**2))), shot, predicted=predicted_mm)


def _rms_of_phases(bound_s: Callable[[float], float]) -> float:
    """Return what a bound, given the place of an echo in samples, is on the whole, mm."""
    squares = [bound_s(_MIDDLE - _BEGIN + phase) ** 2 for phase in PHASES]
    return MM_PER_S * math.sqrt(float(np.mean(squares)))


@lru_cache(maxsize=4)
def coloured_bound_mm(optical_s: float) -> float:
    """Return the Cramer-Rao bound of the arrival in the receiver's noise: place, width and height unknown."""
    times, step, wider = np.arange(SAMPLES, dtype=np.float64), 1e-3, 1e-3
    noise = _covariance(_peak(optical_s) / COLOURED_SNR)

    def bound_s(centre: float) -> float:
        later, sooner = (_echo(optical_s, centre + sign * step, times) for sign in (1, -1))
        broad, narrow = (_echo(optical_s * (1 + sign * wider), centre, times) for sign in (1, -1))
        gradient = np.stack([(later - sooner) / (2 * step), broad - narrow, _echo(optical_s, centre, times)])
        return math.sqrt(float(bound(gradient, noise)[0, 0])) * INTERVAL_S

    return _rms_of_phases(bound_s)


def _coloured_search(optical_s: float) -> Measured:
    finder = _finder(12, 1)
    noise = SampledNoise(kernel(1e-4).poles, 0, INTERVAL_S)
    return _coloured(
        optical_s,
        partial(_windows, optical_s),
        lambda rng: noise.draw(rng, WINDOW),
        lambda volts: float(finder.search(volts)[0, 0]),
    )


def _coloured_fit(optical_s: float) -> Measured:
    noise = SampledNoise(kernel(1e-4).poles, 0, INTERVAL_S)
    return _coloured(
        optical_s,
        lambda phase: _windows(optical_s, phase)[_BEGIN : _BEGIN + SAMPLES],
        lambda rng: noise.draw(rng, SAMPLES),
        fitted,
    )


@lru_cache(maxsize=4)
def _whitened_fit(optical_s: float) -> WhitenedFit:
    response = kernel(1e-4).widened(optical_s / math.sqrt(CURVATURE))
    peak = _peak(optical_s)
    return WhitenedFit(lambda since_s: response.at(since_s) / peak, _covariance(1 / COLOURED_SNR), INTERVAL_S)


def _known_bound_mm(optical_s: float) -> float:
    """Return the bound where the response is known: place and height unknown."""
    fit = _whitened_fit(optical_s)
    return _rms_of_phases(lambda centre: fit.bound(centre * INTERVAL_S, 1.0)[0])


def _whitened(optical_s: float) -> Measured:
    fit, noise = _whitened_fit(optical_s), SampledNoise(kernel(1e-4).poles, 0, INTERVAL_S)
    found = _coloured(
        optical_s,
        lambda phase: _windows(optical_s, phase)[_BEGIN : _BEGIN + SAMPLES],
        lambda rng: noise.draw(rng, SAMPLES),
        lambda volts: fit.fit(volts).arrival_s,
    )
    return replace(found, predicted=_known_bound_mm(optical_s))


def _covariance(noise_rms: float) -> NDArray[np.float64]:
    return filtered_noise_covariance(kernel(1e-4).poles, 0, INTERVAL_S, SAMPLES, noise_rms)


def _coloured(
    optical_s: float,
    window: Callable[[float], NDArray[np.float64]],
    noise: Noise,
    arrival: Callable[[NDArray[np.float64]], float],
) -> Measured:
    """Return the rms difference that noise makes, over sampling phases."""
    rng = np.random.Generator(np.random.SFC64(1))
    clean = [window(phase) for phase in PHASES]
    without_s = [arrival(volts) for volts in clean]
    errors_s = np.empty(_TRIALS)
    for trial in range(_TRIALS):
        which = trial % len(clean)
        volts = clean[which] + noise(rng) / COLOURED_SNR
        errors_s[trial] = arrival(volts) - without_s[which]
    return _rms(errors_s, lambda: arrival(volts), coloured_bound_mm(optical_s))
