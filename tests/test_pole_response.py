from __future__ import annotations

import itertools

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from belahil import butterworth
from belahil.errors import RefusedInput
from belahil.pole_response import SampledNoise, autocovariance, frequency_response, response
from belahil.stimuli import SampledPulse

RATE_HZ = 250e6
START_S = 3e-7
UNIT = 2 * np.pi * 19e6
FILTERS = [(1, 0.0), (2, 0.0), (3, 0.0), (3, 20e3), (4, 100.0), (5, 3e3), (6, 0.0), (6, 1e6)]


def poles_and_zeros(
    order: int, highpass_hz: float, cutoff_hz: float = 19e6
) -> tuple[tuple[complex, ...], int]:
    return butterworth.poles(cutoff_hz, order, highpass_hz), int(highpass_hz > 0)


def by_lsim(
    pulse: np.ndarray, interpolation: str, poles: tuple[complex, ...], zeros: int, parts: int
) -> np.ndarray:
    """Response at `parts` points in each interval, from the first break point to the end of the pulse."""
    slowest_first = sorted(poles, key=abs)
    gain = np.prod([-pole / UNIT for pole in slowest_first[zeros:]]).real
    system = signal.ZerosPolesGain([0.0] * zeros, np.array(poles) / UNIT, gain).to_ss()
    interval = UNIT / RATE_HZ
    if interpolation == "linear":
        times = np.arange((pulse.size - 1) * parts + 1) * interval / parts
        volts = np.interp(times, np.arange(pulse.size) * interval, pulse)
        return signal.lsim(system, volts, times, interp=True)[1]
    times = np.arange(pulse.size * parts + 1) * interval / parts
    volts = np.append(np.repeat(pulse, parts), 0.0)
    return signal.lsim(system, volts, times, interp=False)[1]


@pytest.mark.parametrize(("order", "highpass_hz"), FILTERS)
@pytest.mark.parametrize("interpolation", ["linear", "hold"])
def test_response_is_that_of_lsim_between_break_points(
    order: int, highpass_hz: float, interpolation: str
) -> None:
    # Given random break points, with a jump at both ends
    poles, zeros = poles_and_zeros(order, highpass_hz)
    pulse = np.random.default_rng(order).standard_normal(120)
    # When lsim integrates on a grid 7 times as fine
    expected = by_lsim(pulse, interpolation, poles, zeros, parts=7)
    times = START_S + np.arange(expected.size) / (7 * RATE_HZ)
    shuffled = np.random.default_rng(1).permutation(expected.size)
    made = response(pulse, RATE_HZ, START_S, interpolation, poles, times[shuffled], zeros)  # type: ignore[arg-type]
    # Then both agree to rounding, in whatever order the times are asked for
    np.testing.assert_allclose(made, expected[shuffled], rtol=0, atol=1e-12)


def exact_response(
    poles: list[mpmath.mpc], zeros: int, pulse: list[float], times: list[float]
) -> list[mpmath.mpf]:
    """Piecewise-linear response (times in intervals): inverse Laplace transform round all poles."""
    slowest_first = sorted(poles, key=abs)
    gain = mpmath.fprod(-pole for pole in slowest_first[zeros:])
    # The trapezoid rule at m points leaves (|s| t)^m / m!, below 1e-25 here.
    points = 110
    circle = [
        2 * max(map(abs, poles)) * mpmath.expjpi(mpmath.mpf(2 * k + 1) / points) for k in range(points // 2)
    ]
    transfer = [gain * s**zeros / mpmath.fprod(s - pole for pole in poles) for s in circle]

    def ramp(power: int, since: mpmath.mpf) -> mpmath.mpf:
        terms = (h / s ** (power - 1) * mpmath.exp(s * since) for h, s in zip(transfer, circle, strict=True))
        return 2 * mpmath.fsum(terms).real / points

    def at(time: float) -> mpmath.mpf:
        begun = [k for k in range(len(pulse)) if k < time]
        slopes = [0.0, *np.diff(pulse), 0.0]
        total = pulse[0] * ramp(1, mpmath.mpf(time))
        for k in begun:
            total += (slopes[k + 1] - slopes[k]) * ramp(2, mpmath.mpf(time) - k)
        if len(begun) == len(pulse):
            total -= pulse[-1] * ramp(1, mpmath.mpf(time) - (len(pulse) - 1))
        return total

    return [at(time) for time in times]


@pytest.mark.parametrize("gap", [0.0, 1e-14, 1e-10, 1e-7, 1e-5, 0.9e-3, 0.9e-2, 1.1e-2, 0.1])
@pytest.mark.parametrize(
    "kind", ["real pair", "conjugate pair", "double pairs", "triple", "slow pair", "lonely pair"]
)
def test_coincident_poles_lose_nothing(gap: float, kind: str) -> None:
    # Given poles that approach each other down to equality
    upper = complex(-0.5, 0.75)
    poles, zeros = {
        "real pair": ([-0.8, -0.8 * (1 + gap), -1.1], 0),
        "conjugate pair": ([complex(-0.8, 0.4 * gap), complex(-0.8, -0.4 * gap), -1.1], 0),
        "double pairs": (
            [upper, upper * (1 + gap), upper.conjugate(), (upper * (1 + gap)).conjugate(), -1.0],
            0,
        ),
        "triple": ([-0.8, -0.8 * (1 + gap), -0.8 * (1 + 2 * gap), -0.05], 1),
        "slow pair": ([-1e-3, -1e-3 * (1 + gap), -0.8], 2),
        "lonely pair": ([-0.8, -0.8 * (1 + gap)], 0),
    }[kind]
    # (With gap 0 the two of a conjugate pair are one real double pole.)
    pulse = [0.3, 1.0, -0.4, 0.7]
    times = [0.5, 1.0, 2.25, 3.0, 3.5, 9.0]
    # When 40 digits integrate round all poles at once
    with mpmath.workdps(40):
        expected = exact_response([mpmath.mpc(pole) for pole in poles], zeros, pulse, times)
    made = response(pulse, 1.0, 0.0, "linear", [complex(pole) for pole in poles], times, zeros)
    # Then double precision gives the same; 1e-11: a triple pole just outside a cluster loses four digits
    np.testing.assert_allclose(made, np.array(expected, dtype=float), rtol=0, atol=1e-11)


def test_a_filtered_step_approaches_the_gain_and_an_ac_coupling_lets_it_decay() -> None:
    late = [20e-6]
    assert response([1.0, 1.0], 1e3, 0.0, "hold", butterworth.poles(19e6, 3), late)[0] == pytest.approx(1)
    made = response([1.0, 1.0], 1e3, 0.0, "hold", butterworth.poles(19e6, 3, 20e3), late, zeros=1)[0]
    # After the low-pass delay of 2 / w_c the step decays with the time constant of the coupling.
    assert made == pytest.approx(np.exp(-2 * np.pi * 20e3 * (20e-6 - 2 / UNIT)), rel=1e-5)


def test_silence_before_the_start_and_decay_after_the_end() -> None:
    poles = butterworth.poles(19e6, 3)
    times = np.array([-1.0, START_S - 1e-15, START_S, START_S + 1.0])
    np.testing.assert_array_equal(response([1.0, 2.0], RATE_HZ, START_S, "linear", poles, times), 0.0)


@given(st.integers(0, 2**32 - 1), st.sampled_from(["linear", "hold"]))
def test_response_is_linear_and_moves_with_its_pulse(seed: int, interpolation: str) -> None:
    rng = np.random.default_rng(seed)
    one, other = rng.standard_normal((2, 20))
    poles = butterworth.poles(19e6, int(rng.integers(1, 7)))
    times = rng.uniform(0, 200e-9, 30)

    def made(pulse: np.ndarray, start_s: float = 0.0) -> np.ndarray:
        return response(pulse, RATE_HZ, start_s, interpolation, poles, times + start_s)  # type: ignore[arg-type]

    np.testing.assert_allclose(made(one + 2 * other), made(one) + 2 * made(other), rtol=0, atol=1e-12)
    # 1 us later the times are rounded to 2e-22 s, and the volts move by at most some 1e9 V/s.
    np.testing.assert_allclose(made(one, 1e-6), made(one), rtol=0, atol=1e-11)


def test_a_sampled_pulse_with_poles_is_its_own_response() -> None:
    poles = butterworth.poles(10e6, 1)
    volts = np.array([0.0, 1.0, 0.5])
    times = np.linspace(0, 1e-6, 11)
    made = SampledPulse(volts, 1e7, 0.0, "linear", poles).at(times)
    np.testing.assert_allclose(made, by_quadrature(volts, times, 2 * np.pi * 10e6), rtol=0, atol=1e-10)


def by_quadrature(volts: np.ndarray, times: np.ndarray, rate: float) -> np.ndarray:
    """First-order response by a plain midpoint sum of the convolution."""
    fine = (np.arange(400_000) + 0.5) * 0.2e-6 / 400_000
    pulse = np.interp(fine, np.arange(3) * 1e-7, volts)
    return np.array(
        [
            np.sum(np.where(fine < t, pulse * rate * np.exp(-rate * (np.maximum(t - fine, 0))), 0))
            * 0.2e-6
            / 4e5
            for t in times
        ]
    )


@pytest.mark.parametrize(("order", "highpass_hz"), FILTERS)
def test_frequency_response_has_the_butterworth_magnitude_and_phase(order: int, highpass_hz: float) -> None:
    poles, zeros = poles_and_zeros(order, highpass_hz)
    frequency = np.geomspace(10.0, 1e9, 200)
    made = frequency_response(poles, frequency, zeros)
    np.testing.assert_allclose(
        np.abs(made), butterworth.magnitude(frequency, 19e6, order, highpass_hz), 1e-12
    )
    turned = np.exp(1j * butterworth.phase(frequency, 19e6, order, highpass_hz))
    np.testing.assert_allclose(made / np.abs(made), turned, rtol=0, atol=1e-12)


def test_a_long_sine_settles_on_the_frequency_response() -> None:
    # Given 40 periods of a finely sampled 5-MHz sine behind the filter
    poles, zeros = poles_and_zeros(3, 1e6)
    break_points = np.arange(16_001) / 2e9
    times = np.linspace(7.6e-6, 7.9e-6, 50)
    made = response(np.sin(2 * np.pi * 5e6 * break_points), 2e9, 0.0, "linear", poles, times, zeros)
    # Then it is the steady state, but for chords instead of arcs, (w T)^2 / 8 = 3e-5, and the last transient
    factor = complex(frequency_response(poles, 5e6, zeros))
    np.testing.assert_allclose(made, (factor * np.exp(2j * np.pi * 5e6 * times)).imag, rtol=0, atol=6e-5)


@pytest.mark.parametrize(("order", "highpass_hz"), FILTERS)
def test_autocovariance_at_zero_is_the_noise_bandwidth(order: int, highpass_hz: float) -> None:
    poles, zeros = poles_and_zeros(order, highpass_hz)
    made = float(autocovariance(poles, 0.0, zeros))
    assert made == pytest.approx(butterworth.noise_bandwidth(19e6, order, highpass_hz), rel=1e-11)


def test_autocovariance_is_the_transform_of_the_spectrum() -> None:
    poles, zeros = poles_and_zeros(3, 1e6)
    lags = np.array([0.0, 5e-9, 30e-9, -100e-9])
    frequency = np.arange(0, 4e9, 1e4)
    spectrum = np.abs(frequency_response(poles, frequency, zeros)) ** 2
    expected = [np.sum(spectrum * np.cos(2 * np.pi * frequency * lag)) * 1e4 for lag in lags]
    # |H|^2 falls as f^-6: beyond 4 GHz there is 1e-12 of it; the sum itself repeats after 1e-4 s.
    np.testing.assert_allclose(autocovariance(poles, lags, zeros), expected, rtol=0, atol=1e-3)


def drawn_covariance(noise: SampledNoise, poles: int, count: int) -> np.ndarray:
    """Covariance of the first samples: exact, since a draw is linear in its normal deviates."""

    class OneDeviate:
        def __init__(self, index: int) -> None:
            self.index = index

        def standard_normal(self, size: int) -> np.ndarray:
            return np.eye(1, size, self.index)[0]

    columns = [noise.draw(OneDeviate(k), count) for k in range(poles + count)]  # type: ignore[arg-type]
    return np.array(columns).T @ np.array(columns)


@pytest.mark.parametrize(("order", "highpass_hz"), FILTERS)
@pytest.mark.parametrize(
    ("cutoff_hz", "interval_s"),
    [
        *itertools.product([12e6, 28e6], [12.5e-9, 5e-9]),
    ],
)
def test_drawn_noise_has_the_autocovariance_from_its_first_sample(
    order: int, highpass_hz: float, cutoff_hz: float, interval_s: float
) -> None:
    poles, zeros = poles_and_zeros(order, highpass_hz, cutoff_hz)
    made = drawn_covariance(SampledNoise(poles, zeros, interval_s), len(poles), 40)
    lags = np.arange(40)
    expected = autocovariance(poles, lags * interval_s, zeros)[np.abs(lags[:, None] - lags)]
    np.testing.assert_allclose(made, expected / expected[0, 0], rtol=0, atol=1e-11)


@pytest.mark.parametrize(("order", "highpass_hz"), FILTERS)
@pytest.mark.parametrize("interval_s", [1e-6, 2e-6, 1e-4, 0.1])
def test_noise_is_right_where_a_sample_has_forgotten_the_one_before(
    order: int, highpass_hz: float, interval_s: float
) -> None:
    # But for what the high-pass remembers; at 2 us the step of the low-pass is below 1e-38. With time
    # constants so far apart the solver is less exact: 1.4e-9, where a spectrum may be wrong by 1e-6.
    poles, zeros = poles_and_zeros(order, highpass_hz)
    made = drawn_covariance(SampledNoise(poles, zeros, interval_s), len(poles), 40)
    lags = np.arange(40)
    expected = autocovariance(poles, lags * interval_s, zeros)[np.abs(lags[:, None] - lags)]
    np.testing.assert_allclose(made, expected / expected[0, 0], rtol=0, atol=1e-8)


@pytest.mark.parametrize(("order", "highpass_hz"), [(6, 0.0), (3, 100.0)])
def test_noise_is_right_where_a_sample_is_far_shorter_than_any_time_constant(
    order: int, highpass_hz: float
) -> None:
    poles, zeros = poles_and_zeros(order, highpass_hz)
    made = drawn_covariance(SampledNoise(poles, zeros, 1e-10), len(poles), 300)
    lags = np.arange(300)
    expected = autocovariance(poles, lags * 1e-10, zeros)[np.abs(lags[:, None] - lags)]
    # The weights of six close poles cancel to some 1e-11 in the reference.
    np.testing.assert_allclose(made, expected / expected[0, 0], rtol=0, atol=2e-10)


def test_drawn_noise_has_the_folded_spectrum() -> None:
    # Given 60 windows of noise behind a 19-MHz filter of order 3 at 80 MHz
    noise = SampledNoise(butterworth.poles(19e6, 3), 0, 12.5e-9)
    rng = np.random.default_rng(5)
    windows = np.array([noise.draw(rng, 16064) for _ in range(60)])
    # When their periodograms are averaged over 250 frequencies each
    power = np.mean(np.abs(np.fft.rfft(windows))[:, 1:8001].reshape(60, 32, -1) ** 2, axis=(0, 2))
    centre = (np.arange(32) * 250 + 125.5) * 80e6 / 16064
    folds = np.arange(-200, 201)[:, None] * 80e6
    expected = np.sum(butterworth.magnitude(np.abs(centre + folds), 19e6, 3) ** 2, axis=0)
    expected *= 16064 * 80e6 / 2 / butterworth.noise_bandwidth(19e6, 3)
    # Then each average, of 15000 exponential deviates, is within 5 standard deviations
    assert np.max(np.abs(power / expected - 1)) < 5 / np.sqrt(60 * 250) + 2e-3  # 2e-3: curvature of a band


def test_equal_generators_draw_equal_noise() -> None:
    noise = SampledNoise(butterworth.poles(19e6, 3), 0, 12.5e-9)
    one, other = (noise.draw(np.random.default_rng(3), 100) for _ in range(2))
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("poles", "zeros"),
    [
        ([1.0 + 0j], 0),
        ([-1 + 1j], 0),
        ([-1 + 0j], 1),
        ([], 0),
        ([-1 + 1j, -2 - 1j], 0),
        ([complex("nan")], 0),
    ],
)
def test_impossible_filters_are_refused(poles: list[complex], zeros: int) -> None:
    with pytest.raises(RefusedInput):
        frequency_response(poles, [1.0], zeros)


def test_noise_sampled_too_finely_is_refused() -> None:
    with pytest.raises(RefusedInput, match="beyond double precision"):
        SampledNoise(butterworth.poles(19e6, 6, 20.0), 1, 1e-13)
