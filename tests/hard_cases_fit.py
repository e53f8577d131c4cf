"""Hard cases of pulse fits and misfits: no pulse, no width, no shape of a pulse, and pulses that are cut."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hard_cases_row import error_or_inf, worst
from scipy.optimize import OptimizeWarning, curve_fit

from belahil.pulse_bound import bound, gaussian_gradient
from belahil.pulse_fit import GaussianPulse, gaussian_fit
from belahil.template_misfit import template_misfit

INTERVAL_S = 12.5e-9
TIMES_S = np.arange(42) * INTERVAL_S
PLACES = np.arange(42.0)


def gaussian(times: np.ndarray, arrival: float, fwhm: float, amplitude: float) -> np.ndarray:
    with np.errstate(under="ignore"):
        return amplitude * np.exp(-4 * np.log(2) * ((times - arrival) / fwhm) ** 2)


def largest_error(fit: GaussianPulse | None, true: GaussianPulse) -> float:
    assert fit is not None
    return worst(
        abs(fit.arrival_s - true.arrival_s) / INTERVAL_S,
        abs(fit.fwhm_s / true.fwhm_s - 1),
        abs(fit.amplitude_v / true.amplitude_v - 1),
    )


def by_curve_fit(volts: np.ndarray, start: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", OptimizeWarning)
        with np.errstate(all="ignore"):
            return curve_fit(gaussian, PLACES, volts, start)


# ---- H18 to H21: windows without a pulse, without a width, without a sample


def flat_window() -> float:
    """Pulses found in windows of zeros."""
    fit = gaussian_fit(np.zeros(42), INTERVAL_S)
    assert (fit.status, fit.residual_rms_v) == ("no_pulse", 0.0)
    return float(fit.pulse is not None)


def curve_fit_of_nothing() -> float:
    """A width and an amplitude come back, and no error."""
    found, _ = by_curve_fit(np.zeros(42), (20, 4, 1))
    return float(np.all(np.isfinite(found)))


def spikes() -> float:
    """Place of spikes of one and two samples, in samples; their width is undetermined, and says so."""
    errors = []
    for samples in ((1.0,), (1.0, 1.0)):
        volts = np.zeros(42)
        volts[20 : 20 + len(samples)] = samples
        fit = gaussian_fit(volts, INTERVAL_S)
        assert fit.status == "width_undetermined"
        assert fit.pulse is not None
        assert fit.pulse.fwhm_s == pytest.approx(INTERVAL_S, rel=1e-9)
        errors.append(abs(fit.pulse.arrival_s / INTERVAL_S - 20 - (len(samples) - 1) / 2))
    return worst(*errors)


def curve_fit_of_a_spike() -> float:
    """Of one sample comes a width near zero, or below it; of two it stops with an error."""
    volts = np.zeros(42)
    volts[20] = 1.0
    found, _ = by_curve_fit(volts, (20, 4, 1))
    assert abs(found[1]) < 0.6  # of a sample, or negative, without a word
    volts[21] = 1.0
    return error_or_inf(lambda: float(by_curve_fit(volts, (20, 4, 1))[0][0]), RuntimeError, "Optimal param")


def no_shape_of_a_pulse() -> float:
    """Windows that pass for a pulse: a constant, the same with rounding, a ramp, the wrong polarity."""
    inverted = -gaussian(PLACES, 20, 4, 1)
    windows = {
        "no_pulse": (np.full(42, 0.1), np.full(42, 0.1) * (1 + 1e-16 * PLACES), np.full(42, -0.1)),
        "width_undetermined": (1 + 1e-3 * PLACES,),
        "inverted": (inverted, 1e-6 * inverted),
    }
    return float(
        sum(
            gaussian_fit(volts, INTERVAL_S).status != status
            for status, rows in windows.items()
            for volts in rows
        )
    )


def curve_fit_of_a_constant() -> float:
    """A pulse as wide as ten thousand samples, and no error."""
    found, _ = by_curve_fit(np.full(42, 0.1), (20, 4, 1))
    assert abs(found[1]) > 1e4
    return float(np.all(np.isfinite(found)))


def missing_samples() -> float:
    """Against the Gaussian that the other samples lie on."""
    true, errors = GaussianPulse(255e-9, 45e-9, 0.03), []
    for bad in (np.nan, np.inf, -np.inf):
        volts = true.at(TIMES_S)
        volts[[19, 21]] = bad
        fit = gaussian_fit(volts, INTERVAL_S)
        assert (fit.status, fit.masked) == ("ok", 2)
        errors.append(largest_error(fit.pulse, true))
    return worst(*errors)


def curve_fit_with_a_hole() -> float:
    """It refuses the whole window for one sample."""
    volts = gaussian(PLACES, 20.4, 3.6, 0.03)
    volts[19] = np.nan
    return error_or_inf(lambda: float(by_curve_fit(volts, (20, 4, 1))[0][0]), ValueError, "infs or NaNs")


# ---- H22: a clipped pulse

CLIP_V = 30.0
PRINTED = (0.02, 0.04)
CLIPPED = [
    GaussianPulse(255e-9, width_s, peak) for peak, width_s in ((40.0, 45e-9), (80.0, 45e-9), (200.0, 100e-9))
]
"""Each has enough unclipped samples for a width."""


def clipped_pulses() -> float:
    """Mean errors of width and amplitude of 1000 shots, in parts of the printed 2 % and 4 %.

    Single shots cannot be held to these figures: they are below the Cramer-Rao bound of the samples that are
    left, see `test_h22_printed_figures_are_below_the_bound`. Their spread is that bound.
    """
    # Without noise the flanks give the pulse back, at any amplitude
    for amplitude in (40.0, 80.0, 200.0, 1000.0):
        true = GaussianPulse(255e-9, 45e-9, amplitude)
        fit = gaussian_fit(np.minimum(true.at(TIMES_S), CLIP_V), INTERVAL_S, clip_v=CLIP_V)
        assert (fit.status, fit.clipped) == ("saturated", int((true.at(TIMES_S) >= CLIP_V).sum()))
        assert largest_error(fit.pulse, true) < 1e-8
    errors = []
    for true in CLIPPED:
        widths, amplitudes = clipped_fits(true)
        errors += [abs(widths.mean()) / PRINTED[0], abs(amplitudes.mean()) / PRINTED[1]]
    return worst(*errors)


def clipped_fits(true: GaussianPulse) -> tuple[np.ndarray, np.ndarray]:
    """Relative errors of width and amplitude in 1 V of noise."""
    rng, shots = np.random.default_rng(5), 1000
    noisy = true.at(TIMES_S) + rng.standard_normal((shots, 42))
    fits = [gaussian_fit(np.minimum(row, CLIP_V), INTERVAL_S, clip_v=CLIP_V) for row in noisy]
    assert {fit.status for fit in fits} == {"saturated"}
    pulses = [fit.pulse for fit in fits if fit.pulse is not None]
    assert len(pulses) == shots
    widths = np.array([pulse.fwhm_s for pulse in pulses]) / true.fwhm_s - 1
    return widths, np.array([pulse.amplitude_v for pulse in pulses]) / true.amplitude_v - 1


def clipped_bound(true: GaussianPulse) -> tuple[float, float]:
    """Least relative spread of width and amplitude that the unclipped samples permit, in 1 V of noise."""
    kept = true.at(TIMES_S) < CLIP_V
    least = np.sqrt(np.diag(bound(gaussian_gradient(true, TIMES_S[kept]), 1.0)))
    return float(least[1] / true.fwhm_s), float(least[2] / true.amplitude_v)


def clip_taken_for_the_top() -> float:
    """A plain fit is 11 % too wide at 4/3 of the clip, and more above, noise or not."""
    true = CLIPPED[0]
    found, _ = by_curve_fit(np.minimum(true.at(TIMES_S), CLIP_V), (20, 4, 30))
    return float(abs(found[1] * INTERVAL_S / true.fwhm_s - 1)) / PRINTED[0]


# ---- H38, H39: misfits of shapes

SHAPES = np.array([gaussian(PLACES, 20, width, 1) for width in (2, 4, 8)])


def zero_pulse_among_shapes() -> float:
    """Shapes that a zero pulse is said to have."""
    found = template_misfit(np.zeros(42), SHAPES)
    assert np.array_equal(found.mean_square_v2, np.zeros(3))
    other = template_misfit(np.ones(42), np.zeros(42))
    assert (found.status, other.status) == ("no_pulse", "no_pulse")
    assert template_misfit(3 * SHAPES[1], SHAPES).best == 1
    return float((found.best is not None) + (other.best is not None))


def best_of_what_is_no_number() -> float:
    """The largest of three nan is the first, as if that shape had been found."""
    with np.errstate(invalid="ignore"):
        best = np.argmax(SHAPES @ np.zeros(42) / (0.0 * np.linalg.norm(SHAPES, axis=1)))
    assert best == 0
    return 1.0


def small_misfits(way: object) -> float:
    errors = []
    shape = SHAPES[1].astype(np.float32)
    for amplitude in (100.0, 500.0, 3000.0):
        ripple = (1.8e-3 * np.cos(PLACES * 2.9)).astype(np.float32)
        volts = (np.float32(amplitude) * shape + ripple).astype(np.float32)
        long, g = volts.astype(np.longdouble), shape.astype(np.longdouble)
        true = float(np.mean((long - (long @ g) / (g @ g) * g) ** 2))
        errors.append(abs(float(way(volts, shape)) / true - 1))  # type: ignore[operator]
    return worst(*errors)


def small_misfit_in_single_precision() -> float:
    """Relative, against the residual in extended precision."""
    return small_misfits(lambda volts, shape: template_misfit(volts, shape).mean_square_v2[0])


def misfit_by_squares() -> float:
    """v.v - (v.g)^2 / g.g cancels."""
    return small_misfits(lambda v, g: (v @ v - (v @ g) ** 2 / (g @ g)) / 42)
