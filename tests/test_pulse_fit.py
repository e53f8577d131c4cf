from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import OptimizeWarning, curve_fit

from belahil import butterworth
from belahil.errors import RefusedInput
from belahil.pole_response import SampledNoise
from belahil.pulse_bound import bound, filtered_noise_covariance, gaussian_gradient, white_bound
from belahil.pulse_fit import GaussianPulse, gaussian_fit
from belahil.template_misfit import template_misfit

INTERVAL_S = 12.5e-9
TIMES_S = np.arange(42) * INTERVAL_S


def gaussian(times: np.ndarray, arrival: float, fwhm: float, amplitude: float) -> np.ndarray:
    with np.errstate(under="ignore"):
        return amplitude * np.exp(-4 * np.log(2) * ((times - arrival) / fwhm) ** 2)


def largest_error(fit: GaussianPulse | None, true: GaussianPulse) -> float:
    assert fit is not None
    return max(
        abs(fit.arrival_s - true.arrival_s) / INTERVAL_S,
        abs(fit.fwhm_s / true.fwhm_s - 1),
        abs(fit.amplitude_v / true.amplitude_v - 1),
    )


@given(
    arrival=st.floats(8, 33),
    fwhm=st.floats(1.6, 12),
    amplitude=st.floats(1e-6, 1e3),
    interval_s=st.sampled_from([12.5e-9, 5e-9, 1.0]),
)
def test_a_gaussian_is_found_exactly(
    arrival: float, fwhm: float, amplitude: float, interval_s: float
) -> None:
    # Given a Gaussian anywhere inside the window
    true = GaussianPulse(arrival * interval_s, fwhm * interval_s, amplitude)
    # When it is fitted
    fit = gaussian_fit(true.at(np.arange(42) * interval_s), interval_s)
    # Then its parameters come back to rounding
    assert fit.status == "ok"
    assert fit.pulse is not None
    np.testing.assert_allclose(
        [fit.pulse.arrival_s / interval_s, fit.pulse.fwhm_s / interval_s, fit.pulse.amplitude_v / amplitude],
        [arrival, fwhm, 1],
        rtol=0,
        atol=1e-9,
    )


@pytest.mark.parametrize("seed", range(6))
def test_with_noise_it_is_the_least_squares_gaussian(seed: int) -> None:
    # Given a noisy pulse, and another library's least squares from a good start
    rng = np.random.default_rng(seed)
    volts = gaussian(np.arange(42.0), 20 + rng.random(), 2 + 5 * rng.random(), 5) + rng.standard_normal(42)
    fit = gaussian_fit(volts, 1.0)
    assert fit.pulse is not None
    start = (fit.pulse.arrival_s, fit.pulse.fwhm_s, fit.pulse.amplitude_v)
    expected, _ = curve_fit(gaussian, np.arange(42.0), volts, start, xtol=1e-14, ftol=1e-14)
    # Then both agree as far as that library's derivatives by differences go
    np.testing.assert_allclose(start, expected, rtol=0, atol=1e-5)
    residual = volts - gaussian(np.arange(42.0), *expected)
    assert fit.residual_rms_v == pytest.approx(np.sqrt(residual @ residual / 39), rel=1e-6)


# Hard cases H18 to H22: what a plain least squares makes of them, and what is made of them here.


def test_h18_a_flat_window_has_no_pulse() -> None:
    flat = np.zeros(42)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", OptimizeWarning)
        naive, _ = curve_fit(gaussian, np.arange(42.0), flat, (20, 4, 1))
    assert naive[1] > 0  # a width out of nothing, and no error
    assert gaussian_fit(flat, INTERVAL_S).status == "no_pulse"
    assert gaussian_fit(flat, INTERVAL_S).pulse is None


@pytest.mark.parametrize("samples", [(1.0,), (1.0, 1.0)])
def test_h19_a_spike_has_a_place_but_no_width(samples: tuple[float, ...]) -> None:
    volts = np.zeros(42)
    volts[20 : 20 + len(samples)] = samples
    fit = gaussian_fit(volts, INTERVAL_S)
    assert fit.status == "width_undetermined"
    assert fit.pulse is not None
    assert abs(fit.pulse.arrival_s / INTERVAL_S - 20 - (len(samples) - 1) / 2) < 1
    assert fit.pulse.fwhm_s == pytest.approx(INTERVAL_S, rel=1e-9)


def test_h20_constant_and_negative_windows_say_what_they_are() -> None:
    # A constant up to rounding, a slow ramp, and a pulse of the wrong polarity
    assert gaussian_fit(np.full(42, 0.1) * (1 + 1e-16), INTERVAL_S).status == "no_pulse"
    assert gaussian_fit(1 + 1e-3 * np.arange(42), INTERVAL_S).status == "width_undetermined"
    inverted = gaussian_fit(-gaussian(np.arange(42.0), 20, 4, 1), INTERVAL_S)
    assert (inverted.status, inverted.pulse) == ("inverted", None)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_h21_samples_that_are_not_finite_are_left_out_and_counted(bad: float) -> None:
    true = GaussianPulse(255e-9, 45e-9, 0.03)
    volts = true.at(TIMES_S)
    volts[[19, 21]] = bad
    with pytest.raises(ValueError, match="infs or NaNs"):
        curve_fit(gaussian, TIMES_S, volts, (255e-9, 45e-9, 0.03))
    fit = gaussian_fit(volts, INTERVAL_S)
    assert (fit.status, fit.masked) == ("ok", 2)
    assert largest_error(fit.pulse, true) < 1e-10


@pytest.mark.parametrize("amplitude", [40.0, 80.0, 200.0, 1000.0])
def test_h22_clipped_samples_are_left_out(amplitude: float) -> None:
    # Given a pulse cut at 30 mV: a plain fit is 11 to 114 % too wide
    true = GaussianPulse(255e-9, 45e-9, amplitude)
    clipped = np.minimum(true.at(TIMES_S), 30.0)
    naive, _ = curve_fit(gaussian, TIMES_S / INTERVAL_S, clipped, (20, 4, 30))
    assert naive[1] * INTERVAL_S / true.fwhm_s - 1 > 0.1
    # Then without noise its flanks give it back
    fit = gaussian_fit(clipped, INTERVAL_S, clip_v=30.0)
    assert (fit.status, fit.clipped) == ("saturated", int((true.at(TIMES_S) >= 30).sum()))
    assert largest_error(fit.pulse, true) < 1e-8


@pytest.mark.parametrize(("amplitude", "fwhm_s"), [(40.0, 45e-9), (80.0, 45e-9), (200.0, 100e-9)])
def test_h22_with_noise_a_clipped_fit_is_as_good_as_its_flanks(amplitude: float, fwhm_s: float) -> None:
    # Given 1 mV of noise
    true = GaussianPulse(255e-9, fwhm_s, amplitude)
    rng = np.random.default_rng(5)
    shots = 400
    fits = [
        gaussian_fit(np.minimum(true.at(TIMES_S) + rng.standard_normal(42), 30.0), INTERVAL_S, clip_v=30.0)
        for _ in range(shots)
    ]
    # Then the width has the spread that the unclipped samples permit, and the bias of a fit is below it
    kept = true.at(TIMES_S) < 30
    best = np.sqrt(np.diag(bound(gaussian_gradient(true, TIMES_S[kept]), 1.0)))[1] / fwhm_s
    widths = np.array([fit.pulse.fwhm_s / fwhm_s - 1 for fit in fits if fit.pulse])
    assert {fit.status for fit in fits} == {"saturated"}
    # The spread of a spread from 400 shots is 3.5 %; below 1 the clip itself helps (it selects).
    assert 0.8 < widths.std() / best < 1.2
    assert abs(widths.mean()) < 0.02


def test_too_few_samples_and_wrong_input_are_told() -> None:
    assert gaussian_fit([np.nan] * 39 + [1, 2, 1], INTERVAL_S).status == "too_few_samples"
    with pytest.raises(RefusedInput, match="samples is allowed"):
        gaussian_fit(np.ones((2, 42)), INTERVAL_S)
    with pytest.raises(RefusedInput, match="samples is allowed"):
        gaussian_fit([1.0, 2.0], INTERVAL_S)
    with pytest.raises(RefusedInput, match="above zero"):
        gaussian_fit(np.ones(42), 0.0)


@given(st.lists(st.floats(-1e6, 1e6), min_size=4, max_size=60))
def test_any_samples_give_a_typed_result(volts: list[float]) -> None:
    fit = gaussian_fit(volts, INTERVAL_S)
    if fit.pulse is not None:
        numbers = [fit.pulse.arrival_s, fit.pulse.fwhm_s, fit.pulse.amplitude_v, fit.residual_rms_v]
        assert np.isfinite(numbers).all()
        assert fit.pulse.amplitude_v > 0
    else:
        assert fit.status in ("no_pulse", "inverted")


def test_h38_nothing_is_best_for_a_zero_pulse() -> None:
    shapes = np.array([gaussian(np.arange(42.0), 20, width, 1) for width in (2, 4, 8)])
    with np.errstate(invalid="ignore"):
        naive = np.argmax(shapes @ np.zeros(42) / (0.0 * np.linalg.norm(shapes, axis=1)))
    assert naive == 0  # as if the first shape had been found
    found = template_misfit(np.zeros(42), shapes)
    assert (found.status, found.best) == ("no_pulse", None)
    assert np.array_equal(found.mean_square_v2, np.zeros(3))
    assert template_misfit(np.ones(42), np.zeros(42)).status == "no_pulse"
    assert template_misfit(3 * shapes[1], shapes).best == 1


@pytest.mark.parametrize("amplitude", [100.0, 500.0, 3000.0])
def test_h39_a_small_misfit_survives_single_precision(amplitude: float) -> None:
    shape = gaussian(np.arange(42.0), 20, 4, 1).astype(np.float32)
    ripple = (1.8e-3 * np.cos(np.arange(42.0) * 2.9)).astype(np.float32)
    volts = (np.float32(amplitude) * shape + ripple).astype(np.float32)
    long, g = volts.astype(np.longdouble), shape.astype(np.longdouble)
    expected = float(np.mean((long - (long @ g) / (g @ g) * g) ** 2))
    naive = (volts @ volts - (volts @ shape) ** 2 / (shape @ shape)) / 42
    assert abs(naive / expected - 1) > 0.1
    found = template_misfit(volts, shape)
    # Rounding of the samples' products is half a step of single precision at the peak.
    rounding = (amplitude * 2.0**-24) ** 2
    assert found.mean_square_v2[0] == pytest.approx(expected, rel=1e-2, abs=2 * rounding)


def test_the_white_bound_is_the_inverse_information_of_the_samples() -> None:
    # Given a pulse of 70 ns: sums over samples are integrals to exp(-2 pi^2 1.7^2), times a few hundred
    pulse = GaussianPulse(256.3e-9, 70e-9, 0.02)
    deviations = np.sqrt(np.diag(bound(gaussian_gradient(pulse, TIMES_S), 1e-6)))
    closed = white_bound(pulse, INTERVAL_S, 1e-3)
    np.testing.assert_allclose(deviations, [closed.arrival_s, closed.fwhm_s, closed.amplitude_v], rtol=1e-9)


def test_gradient_of_a_gaussian_is_its_difference_quotient() -> None:
    pulse = GaussianPulse(256.3e-9, 45e-9, 0.02)
    steps = np.diag([1e-13, 1e-13, 1e-7])
    numbers = np.array([pulse.arrival_s, pulse.fwhm_s, pulse.amplitude_v])
    for row, step in zip(gaussian_gradient(pulse, TIMES_S), steps, strict=True):
        high, low = (GaussianPulse(*moved).at(TIMES_S) for moved in (numbers + step, numbers - step))
        quotient = (high - low) / (2 * step.max())
        np.testing.assert_allclose(quotient, row, rtol=0, atol=1e-6 * np.abs(row).max())


def test_covariance_of_filtered_noise_is_that_of_its_draws() -> None:
    # Given noise behind the receiver's filter, with quantization noise after it
    poles = butterworth.poles(19e6, 3, 0.0)
    covariance = filtered_noise_covariance(poles, 0, INTERVAL_S, 5, 2.0, 0.5)
    rng = np.random.default_rng(2)
    drawn = 2 * SampledNoise(poles, 0, INTERVAL_S).draw(rng, 400_000) + 0.5 * rng.standard_normal(400_000)
    found = [np.mean(drawn[: drawn.size - lag] * drawn[lag:]) for lag in range(5)]
    # Then lag by lag they agree; one standard error is about 4.25 sqrt(2 sum rho^2 / N) = 0.012
    np.testing.assert_allclose(covariance[0], found, rtol=0, atol=0.06)
    assert np.array_equal(covariance, covariance.T)


def test_bounds_without_an_answer_are_refused() -> None:
    with pytest.raises(RefusedInput, match="not positive definite"):
        bound(np.ones((1, 3)), -np.eye(3))
    with pytest.raises(RefusedInput, match="equal effect"):
        bound(np.zeros((2, 3)), 1.0)
