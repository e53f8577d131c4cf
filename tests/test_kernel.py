from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate

from belahil import butterworth
from belahil.errors import RefusedInput
from belahil.pole_response import response
from sim.kernel import Kernel
from sim.pulse_shape import PulsePiece, PulseShape

CUTOFF_HZ = 19e6


def kernel(sigma_s: float = 2.3e-9, tau_s: float = 0.0, highpass_hz: float = 0.0, **more: float) -> Kernel:
    poles = butterworth.poles(CUTOFF_HZ, 3, highpass_hz)
    return Kernel(PulseShape((PulsePiece(1.0, sigma_s, tau_s),)), poles, int(highpass_hz > 0), **more)


def peak(one: Kernel) -> float:
    return float(np.abs(one.exact(np.linspace(one.starts_s, -one.starts_s + 60e-9, 2001))).max())


def by_contour(one: Kernel, lags_s: np.ndarray, digits: int = 40) -> np.ndarray:
    """Bromwich's integral of the transform, in many digits: no residues and no error functions."""
    with mpmath.workdps(digits):
        found = []
        piece = one.pulse.pieces[0]
        sigma, tau = mpmath.mpf(piece.sigma_s), mpmath.mpf(piece.tau_s)
        poles = [mpmath.mpc(pole) for pole in sorted(one.poles, key=abs)]
        gain = mpmath.fprod(-pole for pole in poles[one.zeros :])
        # The Gaussian's transform makes the trapezoid rule converge like one; the step keeps the period long.
        slowest = min(-pole.real for pole in poles)
        for lag in lags_s:
            t = mpmath.mpf(float(lag))
            step = mpmath.pi / (abs(t) + 12 * sigma + 90 / slowest)
            count = int(14 / sigma / step) + 1
            total = mpmath.mpf(0)
            for k in range(count):
                s = 1j * step * (k + mpmath.mpf(0.5))
                value = gain * s**one.zeros / mpmath.fprod(s - pole for pole in poles)
                total += (value * mpmath.exp(s * s * sigma**2 / 2 + s * t) / (1 + s * tau)).real
            found.append(float(total * step / mpmath.pi))
    return np.array(found)


def by_error_function(one: Kernel, lags_s: np.ndarray, digits: int) -> np.ndarray:
    """Residues times complex error functions, in so many digits that nothing cancels."""
    with mpmath.workdps(digits):
        piece = one.pulse.pieces[0]
        sigma = mpmath.mpf(piece.sigma_s)
        poles = [mpmath.mpc(pole) for pole in sorted(one.poles, key=abs)]
        gain = mpmath.fprod(-pole for pole in poles[one.zeros :])
        if piece.tau_s:
            poles.append(mpmath.mpc(-1 / mpmath.mpf(piece.tau_s)))
            gain /= mpmath.mpf(piece.tau_s)
        found = []
        for lag in lags_s:
            t = mpmath.mpf(float(lag))
            total = mpmath.mpc(0)
            for number, pole in enumerate(poles):
                others = (pole - other for k, other in enumerate(poles) if k != number)
                weight = gain * pole**one.zeros / mpmath.fprod(others)
                tail = mpmath.erfc(-(t + pole * sigma**2) / (sigma * mpmath.sqrt(2)))
                total += weight * mpmath.exp(pole * t + (pole * sigma) ** 2 / 2) * tail / 2
            found.append(float(total.real))
    return np.array(found)


@pytest.mark.parametrize("tau_s", [0.0, 3e-9, 1e-12, 200e-9])
@pytest.mark.parametrize("highpass_hz", [0.0, 100e3])
def test_the_closed_form_is_that_of_many_digits(tau_s: float, highpass_hz: float) -> None:
    one = kernel(2.3e-9, tau_s, highpass_hz, gain=2.5)
    lags_s = np.array([-15e-9, -3e-9, 0.0, 7e-9, 18e-9, 60e-9, 150e-9, 700e-9])

    exact = one.exact(lags_s)

    np.testing.assert_allclose(
        exact, 2.5 * by_error_function(one, lags_s, 60), rtol=0, atol=1e-12 * peak(one)
    )


def test_two_references_agree() -> None:
    one = kernel(2.3e-9, 3e-9)
    lags_s = np.array([-3e-9, 0.0, 18e-9, 60e-9])

    np.testing.assert_allclose(
        by_contour(one, lags_s), by_error_function(one, lags_s, 60), rtol=1e-11, atol=0
    )


@pytest.mark.parametrize(("sigma_s", "tau_s"), [(0.05e-9, 0.0), (2.3e-9, 3e-9), (30e-9, 3e-9), (400e-9, 0.0)])
@pytest.mark.parametrize("highpass_hz", [0.0, 100e3])
@pytest.mark.parametrize("tolerance", [1e-4, 1e-7, 1e-11])
def test_the_table_is_within_its_tolerance(
    sigma_s: float, tau_s: float, highpass_hz: float, tolerance: float
) -> None:
    # Given lags that the table was not checked at
    one = kernel(sigma_s, tau_s, highpass_hz, tolerance=tolerance)
    lags_s = np.random.default_rng(5).uniform(one.starts_s - 1e-8, one.starts_s + 20 * sigma_s + 2e-6, 4000)

    error = np.abs(one.at(lags_s) - one.exact(lags_s)).max() / peak(one)

    # (Between its values a polynomial errs most beside the middle by a little.)
    assert error <= 1.1 * tolerance
    assert one.table is not None


def test_the_default_table_keeps_1e_7_with_few_values() -> None:
    one = kernel(2.3e-9, 3e-9)

    assert one.table is not None
    assert one.table.error <= 1e-7
    assert one.table.coefficients.shape[1] < 2000


@pytest.mark.parametrize("highpass_hz", [0.0, 100e3])
def test_a_pulse_from_a_table_meets_the_filter_as_a_sampled_stimulus_does(highpass_hz: float) -> None:
    # Given break points on equal steps, with a jump at the end
    times_s = 4e-9 * np.arange(30)
    values = np.random.default_rng(2).uniform(0, 1, 30)
    pulse = PulseShape(times_s=times_s, relative=values)
    poles = butterworth.poles(CUTOFF_HZ, 3, highpass_hz)
    one = Kernel(pulse, poles, int(highpass_hz > 0))
    lags_s = np.linspace(-5e-9, 400e-9, 333)

    sampled = response(pulse.relative, 250e6, 0.0, "linear", poles, lags_s, int(highpass_hz > 0))

    np.testing.assert_allclose(one.exact(lags_s), sampled, rtol=0, atol=1e-12 * np.abs(sampled).max())
    np.testing.assert_allclose(one.at(lags_s), sampled, rtol=0, atol=1.1e-7 * np.abs(sampled).max())


def test_a_table_of_uneven_steps_meets_quadrature() -> None:
    times_s = np.array([0.0, 1e-9, 1.5e-9, 4e-9, 20e-9])
    one = Kernel(PulseShape(times_s=times_s, relative=np.array([0.0, 1, 0.7, 0.6, 0])), kernel().poles)
    narrow = kernel(1e-13)  # as good as the filter's impulse response

    for lag_s in (0.7e-9, 3e-9, 15e-9, 40e-9):
        value, _ = integrate.quad(
            lambda t, lag_s=lag_s: float(one.pulse.density(t) * narrow.exact(lag_s - t)),
            0.0,
            min(20e-9, lag_s),
            points=[t for t in times_s[1:-1] if t < lag_s],
            epsabs=0,
            epsrel=1e-11,
        )
        # The stand-in impulse is 1e-13 s wide; its variance bends the response by 1e-10 at the most.
        assert float(one.exact(lag_s)) == pytest.approx(value, abs=1e-8 * peak(narrow))


def test_without_poles_the_kernel_is_the_pulse() -> None:
    pulse = PulseShape((PulsePiece(1.0, 2.3e-9, 3e-9),))
    lags_s = np.linspace(-20e-9, 60e-9, 101)

    np.testing.assert_array_equal(Kernel(pulse, gain=2.0).at(lags_s), 2 * pulse.density(lags_s))


@given(
    st.floats(0.05e-9, 50e-9), st.floats(0, 30e-9), st.sampled_from([0.0, 1e4, 1e6]), st.floats(-1e-7, 1e-6)
)
def test_the_transform_is_that_of_the_closed_form_at_dc_and_elsewhere(
    sigma_s: float, tau_s: float, highpass_hz: float, lag_s: float
) -> None:
    one = kernel(sigma_s, tau_s, highpass_hz)

    assert np.isfinite(one.exact(lag_s))
    assert abs(one.transform(0.0)) == pytest.approx(0.0 if highpass_hz else 1.0, abs=1e-12)


def test_the_area_of_the_response_is_the_gain_at_dc() -> None:
    one = kernel(2.3e-9, 3e-9, gain=3.0)
    step_s = 0.2e-9

    area = step_s * one.exact(np.arange(one.starts_s, one.ends_s, step_s)).sum()

    assert area == pytest.approx(3.0, rel=1e-12)


def test_widened_is_a_gaussian_filter() -> None:
    one, sigma_s = kernel(2.3e-9, 3e-9), 5e-9
    frequency_hz = np.linspace(0, 60e6, 7)

    gaussian = np.exp(-2 * (np.pi * frequency_hz * sigma_s) ** 2)

    np.testing.assert_allclose(
        one.widened(sigma_s).transform(frequency_hz), one.transform(frequency_hz) * gaussian, rtol=1e-12
    )


def test_taps_are_the_kernel_on_a_grid() -> None:
    one = kernel(2.3e-9, 3e-9)
    step_s = 12.5e-9 / 10

    for phase_s in (0.0, 0.4e-9):
        taps, first = one.taps(step_s, phase_s, 100e-9)
        lags_s = phase_s + step_s * (first + np.arange(taps.size))
        np.testing.assert_allclose(taps, one.exact(lags_s), rtol=0, atol=1e-7 * peak(one))
        assert lags_s[-1] <= 100e-9 < lags_s[-1] + step_s


@pytest.mark.parametrize(
    ("poles", "zeros", "tolerance", "why"),
    [
        ((complex(1.0),), 0, 1e-7, "left half"),
        ((), 1, 1e-7, "without a zero"),
        ((complex(-1e8),), 1, 1e-7, "without a zero"),
        ((complex(-1e8),), 0, 0.0, "tolerance"),
        ((complex(-1e8),), 0, math.nan, "tolerance"),
    ],
)
def test_what_is_no_kernel_is_refused(
    poles: tuple[complex, ...], zeros: int, tolerance: float, why: str
) -> None:
    with pytest.raises(RefusedInput, match=why):
        Kernel(PulseShape((PulsePiece(1.0, 1e-9),)), poles, zeros, tolerance=tolerance)
