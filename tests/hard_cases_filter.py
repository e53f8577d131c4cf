"""Hard cases of the filter: recursions that grow, exponents that overflow, poles that meet."""

from __future__ import annotations

import math

import mpmath
import numpy as np
from hard_cases_row import worst
from scipy import signal
from scipy.special import erfc

from belahil import butterworth
from belahil.pole_response import response
from sim.kernel import Kernel
from sim.pulse_shape import PulsePiece, PulseShape

CUTOFF_HZ = 19e6
POLES = butterworth.poles(CUTOFF_HZ, 3)
PULSE = PulseShape((PulsePiece(1.0, 2.2e-9),))
HIGHPASSES_HZ = (1e3, 10e3, 100e3)


def peak_of(kernel: Kernel) -> float:
    times_s = np.linspace(kernel.starts_s, kernel.starts_s + 18 * kernel.pulse.std_s + 100e-9, 4001)
    return float(np.abs(kernel.exact(times_s)).max())


def residues(poles: list[mpmath.mpc], zeros: int) -> list[mpmath.mpc]:
    """Of the filter with its zeros at s = 0 in its slowest poles, whose others have a gain of 1 at 0 Hz."""
    gain = mpmath.fprod(-pole for pole in sorted(poles, key=abs)[zeros:])
    return [
        gain * pole**zeros / mpmath.fprod(pole - other for n, other in enumerate(poles) if n != k)
        for k, pole in enumerate(poles)
    ]


def exact_gaussian_response(kernel: Kernel, times_s: list[float], digits: int) -> np.ndarray:
    """Residues times complex error functions in many digits; poles may be as close as these part them."""
    with mpmath.workdps(digits):
        piece = kernel.pulse.pieces[0]
        sigma = mpmath.mpf(piece.sigma_s)
        poles = [mpmath.mpc(pole) for pole in kernel.poles]
        if piece.tau_s:
            assert not kernel.zeros
            poles.append(-1 / mpmath.mpf(piece.tau_s))
        # Poles that are equal are parted by far less than the tolerance.
        for k, pole in enumerate(poles):
            if any(pole == other for other in poles[:k]):
                poles[k] = pole * (1 + mpmath.mpf(10) ** (-digits // 4))
        weights = residues(poles, kernel.zeros)
        values = []
        for time_s in times_s:
            t, total = mpmath.mpf(time_s), mpmath.mpc(0)
            for pole, weight in zip(poles, weights, strict=True):
                z = -(t + pole * sigma**2) / (sigma * mpmath.sqrt(2))
                total += weight * mpmath.exp(pole * t + (pole * sigma) ** 2 / 2) * mpmath.erfc(z) / 2
            values.append(float(total.real))
    return np.array(values)


def by_naive_form(kernel: Kernel, times_s: np.ndarray) -> np.ndarray:
    """The textbook's form: exp(p t + (p sigma)^2 / 2) times an error function."""
    sigma, total = kernel.pulse.pieces[0].sigma_s, np.zeros(times_s.shape, dtype=complex)
    for k, pole in enumerate(kernel.poles):
        weight = np.prod([-p for p in kernel.poles]) / np.prod(
            [pole - other for n, other in enumerate(kernel.poles) if n != k]
        )
        z = -(times_s + pole * sigma**2) / (sigma * math.sqrt(2))
        total += weight * np.exp(pole * times_s + (pole * sigma) ** 2 / 2) * erfc(z) / 2
    return np.asarray(total.real)


# ---- H01: a band-pass of order 3


def band_pass(highpass_hz: float) -> Kernel:
    return Kernel(PULSE, (*butterworth.poles(highpass_hz, 3), *POLES), zeros=3, tolerance=1e-9)


def bands_of_five_decades() -> float:
    """Against residues and error functions of 60 digits."""
    errors, step_s = [], 0.1e-9
    for highpass_hz in HIGHPASSES_HZ:
        kernel = band_pass(highpass_hz)
        peak = peak_of(kernel)
        taps, first = kernel.taps(step_s, 0.0, 600e-9)
        assert np.all(np.isfinite(taps))
        numbers = [-50, 0, 83, 170, 333, 900, 5900]
        true = exact_gaussian_response(kernel, [step_s * n for n in numbers], 60)
        errors.append(np.abs(taps[np.array(numbers) - first] - true).max() / peak)
        # And long after the pulse, in closed form and from the table
        later_s = [3e-6, 20e-6, 300e-6]
        true = exact_gaussian_response(kernel, later_s, 60)
        errors += [np.abs(way(np.array(later_s)) - true).max() / peak for way in (kernel.exact, kernel.at)]
    return worst(*errors)


def one_recursion_for_the_band() -> float:
    """Numerator and denominator of the whole band-pass at 0.1 ns: poles outside the unit circle."""
    step_s = 0.1e-9
    numerator, denominator = signal.butter(3, [10e3, CUTOFF_HZ], "band", fs=1 / step_s)
    assert np.abs(np.roots(denominator)).max() > 1
    times_s = step_s * np.arange(-100, 200_000)
    with np.errstate(all="ignore"):
        got = signal.lfilter(numerator, denominator, PULSE.density(times_s))
    kernel = band_pass(10e3)
    return float(np.abs(got - kernel.exact(times_s)).max() / peak_of(kernel))


# ---- H02: a high-pass of order 1 before the low-pass

TRIANGLE_V = np.array([0.0, 1.0, 0.0])
TRIANGLE_RATE_HZ = 100e6
TAIL_S = [200e-6, 210e-6, 300e-6, 1e-3]


def triangle_behind(poles: tuple[complex, ...], times_s: list[float]) -> np.ndarray:
    """The triangle is three ramps; each mode makes of a ramp (e^(p t) - 1 - p t) / p^2."""
    with mpmath.workdps(60):
        exact = [mpmath.mpc(pole) for pole in poles]
        values = []
        for time_s in times_s:
            total = mpmath.mpc(0)
            for pole, weight in zip(exact, residues(exact, 1), strict=True):
                for number, rise in enumerate((1, -2, 1)):
                    t = mpmath.mpf(time_s) - number / mpmath.mpf(TRIANGLE_RATE_HZ)
                    if t > 0:
                        ramp = (mpmath.exp(pole * t) - 1 - pole * t) / pole**2
                        total += weight * rise * TRIANGLE_RATE_HZ * ramp
            values.append(float(total.real))
    return np.array(values)


def tails_behind_a_high_pass() -> float:
    """Against residues of 60 digits; single precision cannot be asked for."""
    errors = []
    for highpass_hz in HIGHPASSES_HZ:
        poles = butterworth.poles(CUTOFF_HZ, 3, highpass_hz)
        times_s = [15e-9, 30e-9, 1e-6, *TAIL_S]
        made = response(TRIANGLE_V, TRIANGLE_RATE_HZ, 0.0, "linear", poles, times_s, zeros=1)
        true = triangle_behind(poles, times_s)
        errors.append(np.abs(made - true).max() / np.abs(true).max())
        # Volts in single precision go through double precision, to the same digits
        single = response(
            TRIANGLE_V.astype(np.float32), TRIANGLE_RATE_HZ, 0.0, "linear", poles, times_s, zeros=1
        )
        assert single.dtype == np.float64
        assert np.array_equal(single, made)
    return worst(*errors)


def one_recursion_in_single_precision() -> float:
    """The product of both at 0.1 ns in single precision: it runs away."""
    rate_hz = 10e9
    high = signal.butter(1, 10e3, "high", fs=rate_hz)
    low = signal.butter(3, CUTOFF_HZ, fs=rate_hz)
    numerator, denominator = (np.convolve(*both).astype(np.float32) for both in zip(high, low, strict=True))
    pulse = np.zeros(2_000_000, dtype=np.float32)
    pulse[:200] = 1 - np.abs(np.arange(200) / 100 - 1)
    with np.errstate(all="ignore"):
        got = signal.lfilter(numerator, denominator, pulse)
    assert got.dtype == np.float32
    return float(np.abs(got[-1]))


# ---- H07: a Gaussian of any width


def gaussian_of_any_width() -> float:
    """Against residues and error functions of up to 2000 digits, above them an asymptotic series."""
    errors = []
    for sigma_s in (0.05e-9, 2.2e-9, 40e-9, 315e-9, 2400e-9):
        kernel = Kernel(PulseShape((PulsePiece(1.0, sigma_s),)), POLES)
        # Given times from long before it to long after it, and where the reflection takes over
        times_s = [k * sigma_s for k in (-30.0, -7.0, -1.0, 0.0, 2.0, 9.0)] + [20e-9, 400e-9]
        times_s.append(float(-POLES[0].real) * sigma_s**2)
        # exp((p sigma)^2 / 2) has so many digits before the point
        digits = 40 + int((abs(POLES[0]) * sigma_s) ** 2 / 2 / math.log(10)) * (sigma_s < 1e-6)
        made = kernel.exact(np.array(times_s))
        if sigma_s < 1e-6:
            true = exact_gaussian_response(kernel, times_s, digits)
        else:
            true = wide_gaussian_response(sigma_s, times_s)
        errors.append(np.abs(made - true).max() / peak_of(kernel))
    return worst(*errors)


def wide_gaussian_response(sigma_s: float, times_s: list[float]) -> np.ndarray:
    """A Gaussian so wide that the filter's asymptotic series is exact: derivatives times its moments."""
    with mpmath.workdps(40):
        transfer = lambda s: mpmath.fprod(-mpmath.mpc(p) / (s - mpmath.mpc(p)) for p in POLES)  # noqa: E731
        series = mpmath.taylor(transfer, 0, 12, radius=1e7, method="quad")
        values = []
        for time_s in times_s:
            x = mpmath.mpf(time_s) / sigma_s
            gaussian = mpmath.exp(-x * x / 2) / (mpmath.sqrt(2 * mpmath.pi) * sigma_s)
            hermite = [mpmath.mpf(1), x]
            for k in range(1, 12):
                hermite.append(x * hermite[k] - k * hermite[k - 1])
            total = sum(
                c.real * (-1) ** k * hermite[k] / mpmath.mpf(sigma_s) ** k for k, c in enumerate(series)
            )
            values.append(float(total * gaussian))
    return np.array(values)


def textbook_form_of_a_wide_gaussian() -> float:
    """The exponential overflows above 315 ns, and meets an error function of zero."""
    kernel = Kernel(PulseShape((PulsePiece(1.0, 2400e-9),)), POLES)
    times_s = [0.0, 20e-9]
    with np.errstate(all="ignore"):
        made = by_naive_form(kernel, np.array(times_s))
    return float(np.abs(made - wide_gaussian_response(2400e-9, times_s)).max() / peak_of(kernel))


# ---- H08: a tail whose rate meets a pole

REAL_POLE = next(-pole.real for pole in POLES if pole.imag == 0)
AROUND_S = [-4e-9, 5e-9, 15e-9, 25e-9, 60e-9, 150e-9]


def tail_that_meets_a_pole() -> float:
    """Against residues and error functions of 120 digits, equal poles parted by 1e-30."""
    errors = []
    for gap in (0.0, 1e-14, 1e-10, 1e-6, 1e-4, 1e-3, 9e-3, 1.1e-2, 0.1):
        kernel = Kernel(PulseShape((PulsePiece(1.0, 2.2e-9, 1 / (REAL_POLE * (1 + gap))),)), POLES)
        true = exact_gaussian_response(kernel, AROUND_S, 120)
        errors.append(np.abs(kernel.exact(np.array(AROUND_S)) - true).max() / peak_of(kernel))
    return worst(*errors)


def residues_of_a_double_pole() -> float:
    """Residues of two poles 1e-14 apart are 1e12 and cancel."""
    doubled = Kernel(PULSE, (*POLES, complex(-REAL_POLE * (1 + 1e-14))))
    true = exact_gaussian_response(doubled, AROUND_S, 120)
    naive = by_naive_form(doubled, np.array(AROUND_S))
    return float(np.abs(naive - true).max() / peak_of(doubled))
