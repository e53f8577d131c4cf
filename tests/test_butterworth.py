from __future__ import annotations

import mpmath
import numpy as np
import pytest
from scipy import integrate, signal

from belahil import butterworth
from belahil.errors import RefusedInput

FILTERS = [(1, 0.0), (2, 0.0), (3, 0.0), (3, 20e3), (4, 1e6), (5, 100.0), (6, 0.0), (6, 1e6)]
CUTOFF_HZ = 19.0e6


def analog(order: int, highpass_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator by scipy, in units of the cut-off."""
    b, a = signal.butter(order, 1.0, analog=True)
    if highpass_hz:
        b, a = np.polymul(b, [1, 0]), np.polymul(a, [1, highpass_hz / CUTOFF_HZ])
    return b, a


@pytest.mark.parametrize(("order", "highpass_hz"), FILTERS)
def test_magnitude_and_phase_are_those_of_scipys_analog_filter(order: int, highpass_hz: float) -> None:
    # Given frequencies over nine decades
    frequency = np.geomspace(1.0, 1e9, 500)
    # When the response is computed from scipy's polynomials
    b, a = analog(order, highpass_hz)
    s = 1j * frequency / CUTOFF_HZ
    expected = np.polyval(b, s) / np.polyval(a, s)
    # Then magnitude and phase agree to rounding
    magnitude = butterworth.magnitude(frequency, CUTOFF_HZ, order, highpass_hz)
    phase = butterworth.phase(frequency, CUTOFF_HZ, order, highpass_hz)
    np.testing.assert_allclose(magnitude, np.abs(expected), rtol=1e-12)
    np.testing.assert_allclose(np.exp(1j * phase), expected / np.abs(expected), atol=1e-11)
    assert np.all(np.abs(np.diff(phase)) < 0.5)  # continuous


@pytest.mark.parametrize(("order", "highpass_hz"), FILTERS)
def test_poles_have_scipys_polynomial(order: int, highpass_hz: float) -> None:
    poles = butterworth.poles(CUTOFF_HZ, order, highpass_hz)
    made = np.poly(np.array(poles) / (2 * np.pi * CUTOFF_HZ))
    np.testing.assert_allclose(made, analog(order, highpass_hz)[1], rtol=1e-13, atol=1e-13)
    assert {pole.conjugate() for pole in poles} == set(poles)


@pytest.mark.parametrize(("order", "highpass_hz"), FILTERS)
def test_delay_is_the_slope_of_the_phase(order: int, highpass_hz: float) -> None:
    frequency = np.geomspace(1e4, 1e8, 50)
    step = 1e-4 * frequency
    slope = (
        butterworth.phase(frequency + step, CUTOFF_HZ, order, highpass_hz)
        - butterworth.phase(frequency - step, CUTOFF_HZ, order, highpass_hz)
    ) / (4 * np.pi * step)
    delay = butterworth.group_delay(frequency, CUTOFF_HZ, order, highpass_hz)
    # A central difference of a step h = 1e-4 f is wrong by some h^2 f'''/6 and by eps / (2 h) of the phase.
    np.testing.assert_allclose(delay, -slope, rtol=1e-6, atol=1e-14 / 1e4)


def test_delay_at_zero_of_order_three_is_two_over_the_cutoff() -> None:
    assert float(butterworth.group_delay(0.0, 19e6, 3)) == pytest.approx(2 / (2 * np.pi * 19e6), rel=1e-14)


@pytest.mark.parametrize("order", [0.8, 1.0, 2.5, 3.0, 6.0])
@pytest.mark.parametrize("highpass_hz", [0.0, 100.0, 20e3, 1e6, 50e6])
def test_noise_bandwidth_is_the_integral(order: float, highpass_hz: float) -> None:
    # Given the integrand in 30 digits, in units of the cut-off and in log frequency
    corner = mpmath.mpf(highpass_hz) / 19_000_000

    def integrand(t: mpmath.mpf) -> mpmath.mpf:
        x = mpmath.exp(t)
        return x / (1 + x ** (2 * mpmath.mpf(order))) * x**2 / (x**2 + corner**2)

    # When it is integrated between points that separate its corners
    with mpmath.workdps(30):
        expected = 19e6 * mpmath.quad(integrand, [-90, -12, -5, 0, 2, 10, 60, 150])
    # Then the closed form and the trapezoid sum agree with it
    whole = butterworth.noise_bandwidth(19e6, order)
    made = butterworth.noise_bandwidth(19e6, order, highpass_hz)
    assert made == pytest.approx(float(expected), rel=0, abs=1e-12 * whole)


def test_noise_bandwidth_by_plain_quadrature() -> None:
    value, _ = integrate.quad(lambda f: float(butterworth.magnitude(f, 19.0, 3, 0.02)) ** 2, 0, np.inf)
    assert butterworth.noise_bandwidth(19.0, 3, 0.02) == pytest.approx(value, rel=1e-7)


@pytest.mark.parametrize("order", [1, 3, 6, 2.7])
def test_extreme_frequencies_give_limits_without_a_warning(order: float) -> None:
    frequency = np.array([0.0, 1e-300, 1e300, np.inf])
    np.testing.assert_array_equal(butterworth.magnitude(frequency, 19e6, order)[[0, 1, 3]], [1, 1, 0])
    np.testing.assert_array_equal(butterworth.magnitude(frequency, 19e6, order, 20e3)[[0, 3]], [0, 0])


def test_a_real_order_meets_whole_ones_and_keeps_3_db() -> None:
    frequency = np.geomspace(1e5, 1e8, 40)
    below, at, above = (butterworth.magnitude(frequency, 19e6, order) for order in (3 - 1e-9, 3, 3 + 1e-9))
    np.testing.assert_allclose(below, at, rtol=1e-8)
    np.testing.assert_allclose(above, at, rtol=1e-8)
    assert float(butterworth.magnitude(19e6, 19e6, 2.345)) == pytest.approx(2**-0.5, rel=1e-15)


@pytest.mark.parametrize(
    ("cutoff_hz", "order", "highpass_hz"),
    [(0.0, 3, 0.0), (-1.0, 3, 0.0), (np.inf, 3, 0.0), (19e6, 0, 0.0), (19e6, 2.5, 0.0), (19e6, 3, -1.0)],
)
def test_impossible_filters_are_refused(cutoff_hz: float, order: float, highpass_hz: float) -> None:
    with pytest.raises(RefusedInput):
        butterworth.poles(cutoff_hz, order, highpass_hz)  # type: ignore[arg-type]


def test_noise_bandwidth_of_half_an_order_is_refused() -> None:
    with pytest.raises(RefusedInput, match="1/2"):
        butterworth.noise_bandwidth(19e6, 0.5)
