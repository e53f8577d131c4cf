from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import curve_fit

from belahil import butterworth
from belahil.errors import RefusedInput
from belahil.pole_response import SampledNoise
from belahil.pulse_bound import bound, filtered_noise_covariance, gaussian_gradient, white_bound
from belahil.pulse_fit import GaussianPulse, gaussian_fit

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


@given(
    st.lists(st.floats(-1.5, 1.5), min_size=6, max_size=42),
    st.integers(-2, 2),
    st.sampled_from([1e-3, 0.9, 30.0]),
)
def test_a_window_at_both_ends_of_the_span_is_saturated(
    shape: list[float], counts_apart: int, clip_v: float
) -> None:
    # Given a window that clips at both ends of a span whose ends need not be equally far from 0 V
    lowest_v, highest_v = (
        -clip_v * (1 + 1e-3 * max(counts_apart, 0)),
        clip_v * (1 - 1e-3 * min(counts_apart, 0)),
    )
    volts = np.clip(clip_v * np.array([-2.0, *shape, 2.0]), lowest_v, highest_v)
    fit = gaussian_fit(volts, INTERVAL_S, clip_v)
    # Then nobody knows which excursion was the larger, and no pulse is made up
    assert (fit.status, fit.pulse) == ("saturated", None)
    assert fit.clipped == int((np.abs(volts) >= clip_v).sum())


def test_a_window_of_clipped_samples_has_no_pulse_and_says_why() -> None:
    assert gaussian_fit(np.full(42, 1.0), INTERVAL_S, 1.0).status == "saturated"
    assert gaussian_fit([1.0] * 3 + [np.nan] * 39, INTERVAL_S, 1.0).status == "too_few_samples"
    # Given a pulse that points downwards and clips there
    downwards = np.maximum(-gaussian(np.arange(42.0), 20, 4, 3.0), -1.0)
    assert gaussian_fit(downwards, INTERVAL_S, 1.0).status == "inverted"


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
