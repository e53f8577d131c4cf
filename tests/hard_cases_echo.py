"""Hard cases of the echo, by name: what is fed in, what must hold, and what an obvious way makes of it.

Each check compares with a slow reference or an exact law. A naive variant is kept beside those where it
teaches something; it must fail, or the case is not hard.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import mpmath
import numpy as np
import pytest
from scipy import integrate, optimize

from belahil import butterworth
from belahil.errors import RefusedInput
from sim.accuracy import Accuracy
from sim.beam import beam_sigma_m
from sim.echo import echo
from sim.footprint import DelayHistogram, NoReturn, delays, plan_footprint
from sim.footprint_error import beam_transform, spacing_error
from sim.kernel import Kernel
from sim.laser import Laser
from sim.pulse_shape import PulsePiece, PulseShape
from sim.reference import cic_deposit, lag4_deposit, plane_echo
from sim.terrain import Surface, gradient_of, plane
from sim.terrain_grid import Grid

POLES = butterworth.poles(19e6, 3)
INTERVAL_S = 12.5e-9
ALTITUDE_M = 500e3
LASER = Laser(divergence_rad=50e-6)
SIGMA_M = beam_sigma_m(LASER, ALTITUDE_M)[0]
PULSE = PulseShape((PulsePiece(1.0, 2.2e-9),))
KERNEL = Kernel(PULSE, POLES)


class HardCase(NamedTuple):
    title: str
    check: Callable[[], None]


def peak_of(kernel: Kernel) -> float:
    times_s = np.linspace(kernel.starts_s, kernel.starts_s + 18 * kernel.pulse.std_s + 100e-9, 4001)
    return float(np.abs(kernel.exact(times_s)).max())


def white(slope_deg: float, azimuth_deg: float = 0.0) -> Surface:
    return plane(slope_deg, azimuth_deg, reflectance=1.0)


def pulse_much_shorter_than_a_bin() -> None:
    # Given a pulse of 0.05 bins, at any place in a bin
    bin_s, sigma_s = 1e-9, 0.05e-9
    for phase in np.linspace(0, 1, 21):
        # Then the deposit keeps all of its energy
        for deposit in (lag4_deposit, cic_deposit):
            assert abs(deposit(np.array([4 + phase]), np.array([1.0]), 9).sum() - 1) <= 1e-12
    # And the area of its response is 1, sampled at any phase
    kernel = Kernel(PulseShape((PulsePiece(1.0, sigma_s),)), POLES)
    for phase in (0.0, 0.3, 0.77):
        times_s = kernel.starts_s + sigma_s * (np.arange(14000) + phase)
        assert abs(sigma_s * kernel.exact(times_s).sum() - 1) <= 1e-12
    # Naive: a sampled pulse has eight times its energy, or none
    sampled = [
        bin_s * PulseShape((PulsePiece(1.0, sigma_s),)).density(bin_s * np.array([p])) for p in (0, 0.5)
    ]
    assert sampled[0][0] > 7
    assert sampled[1][0] < 1e-20


TAILED = PulseShape((PulsePiece(1.0, 2.2e-9, 8e-9),))


def cut_pulse(threshold: float) -> PulseShape:
    """Gaussian with an exponential tail, cut to zero below a threshold, exactly where it crosses it."""
    grid_s = np.linspace(-12e-9, 80e-9, 2000)
    top_s = grid_s[TAILED.density(grid_s).argmax()]
    level = threshold * TAILED.density(top_s)
    edges = [
        optimize.brentq(lambda t: float(TAILED.density(t) - level), *between, xtol=1e-22, rtol=1e-14)
        for between in ((-12e-9, top_s), (top_s, 80e-9))
    ]
    times_s = np.concatenate([edges[:1], grid_s[(grid_s > edges[0]) & (grid_s < edges[1])], edges[1:]])
    return PulseShape(times_s=times_s, relative=TAILED.density(times_s))


def impulse_response(time_s: float) -> float:
    """Of the filter, by its residues."""
    total = 0j
    for k, pole in enumerate(POLES):
        others = np.prod([pole - other for n, other in enumerate(POLES) if n != k])
        total += np.prod([-p for p in POLES]) / others * np.exp(pole * time_s)
    return float(total.real)


def pulse_that_jumps() -> None:
    means_s = []
    for threshold in (0.05, 0.1, 0.17, 0.171, 0.22, 0.4):
        # Given a pulse cut at its crossing times, as a table
        pulse = cut_pulse(threshold)
        kernel = Kernel(pulse, POLES)
        peak = peak_of(kernel)
        begin, end = pulse.times_s[0], pulse.times_s[-1]
        area, _ = integrate.quad(TAILED.density, begin, end, epsrel=1e-10, epsabs=0)
        # Then its response is that of adaptive quadrature of the curve itself
        for time_s in (0.0, 8e-9, 17e-9, 30e-9, 55e-9):
            value, _ = integrate.quad(
                lambda t, time_s=time_s: float(TAILED.density(t)) * impulse_response(time_s - t),
                begin,
                min(end, time_s),
                epsabs=1e-9 * peak,
            )
            # (Straight lines between its 2000 points: a part in 20 000 of the curve.)
            assert abs(float(kernel.exact(time_s)) - value / area) <= 1e-4 * peak
        # And bins of 1 ns lose less than 1e-3, wherever it lies in a bin
        fine_s = np.linspace(-10e-9, 90e-9, 400)
        for part in (0.0, 0.25, 0.5, 0.9):
            weights = lag4_deposit(np.array([2 + part]), np.array([1.0]), 6)
            got = sum(w * kernel.exact(fine_s - k * 1e-9) for k, w in enumerate(weights))
            assert np.abs(got - kernel.exact(fine_s - (2 + part) * 1e-9)).max() <= 1e-3 * peak
        means_s.append(pulse.mean_s)
    # And the mean falls with the threshold, without steps of a sample
    assert np.all(np.diff(means_s) < 0)
    assert means_s[2] - means_s[3] < 0.05e-9


def delays_nearly_equal() -> None:
    # Given planes from flat to 50 ns across the footprint, on a planned grid
    found = []
    for span_s in (0.0, 1e-17, 1e-15, 1e-12, 1e-9, 0.29e-9, 0.31e-9, 5e-9, 50e-9):
        slope = math.degrees(math.atan(span_s * 299792458.0 / (8 * SIGMA_M)))
        surface = white(slope)
        plan = plan_footprint(Accuracy(1e-8), KERNEL, LASER, ALTITUDE_M, surface, INTERVAL_S, "grid")
        first_s = -40e-9
        got = echo(KERNEL, delays(surface, LASER, ALTITUDE_M, plan, align_s=first_s), first_s, INTERVAL_S, 42)
        times_s = first_s + INTERVAL_S * np.arange(42)
        true = plane_echo(KERNEL, gradient_of(slope), (0.0, 0.0), SIGMA_M, ALTITUDE_M, times_s)
        # Then each is as exact as asked for; there is no division that could fail
        assert np.abs(got - true).max() <= 1e-8 * peak_of(KERNEL)
        found.append(got)
    # And the echo does not jump where the span becomes zero
    assert np.abs(found[1] - found[0]).max() <= 1e-8 * peak_of(KERNEL)


def exact_gaussian_response(kernel: Kernel, times_s: list[float], digits: int) -> np.ndarray:
    """Residues times complex error functions in many digits; poles may be as close as these part them."""
    with mpmath.workdps(digits):
        piece = kernel.pulse.pieces[0]
        sigma = mpmath.mpf(piece.sigma_s)
        poles = [mpmath.mpc(pole) for pole in kernel.poles]
        gain = mpmath.fprod(-pole for pole in poles)
        if piece.tau_s:
            poles.append(-1 / mpmath.mpf(piece.tau_s))
            gain /= mpmath.mpf(piece.tau_s)
        # Poles that are equal are parted by far less than the tolerance.
        for k, pole in enumerate(poles):
            if any(pole == other for other in poles[:k]):
                poles[k] = pole * (1 + mpmath.mpf(10) ** (-digits // 4))
        values = []
        for time_s in times_s:
            t, total = mpmath.mpf(time_s), mpmath.mpc(0)
            for k, pole in enumerate(poles):
                weight = gain / mpmath.fprod(pole - other for n, other in enumerate(poles) if n != k)
                z = -(t + pole * sigma**2) / (sigma * mpmath.sqrt(2))
                total += weight * mpmath.exp(pole * t + (pole * sigma) ** 2 / 2) * mpmath.erfc(z) / 2
            values.append(float(total.real))
    return np.array(values)


def by_naive_form(kernel: Kernel, times_s: np.ndarray) -> np.ndarray:
    """The textbook's form: exp(p t + (p sigma)^2 / 2) times an error function."""
    from scipy.special import erfc

    sigma, total = kernel.pulse.pieces[0].sigma_s, np.zeros(times_s.shape, dtype=complex)
    for k, pole in enumerate(kernel.poles):
        weight = np.prod([-p for p in kernel.poles]) / np.prod(
            [pole - other for n, other in enumerate(kernel.poles) if n != k]
        )
        z = -(times_s + pole * sigma**2) / (sigma * math.sqrt(2))
        total += weight * np.exp(pole * times_s + (pole * sigma) ** 2 / 2) * erfc(z) / 2
    return np.asarray(total.real)


def gaussian_of_any_width() -> None:
    for sigma_s in (0.05e-9, 2.2e-9, 40e-9, 315e-9, 2400e-9):
        kernel = Kernel(PulseShape((PulsePiece(1.0, sigma_s),)), POLES)
        # Given times from long before it to long after it, and where the reflection takes over
        times_s = [k * sigma_s for k in (-30.0, -7.0, -1.0, 0.0, 2.0, 9.0)] + [20e-9, 400e-9]
        times_s.append(float(-POLES[0].real) * sigma_s**2)
        # exp((p sigma)^2 / 2) has so many digits before the point
        digits = 40 + int((abs(POLES[0]) * sigma_s) ** 2 / 2 / math.log(10)) * (sigma_s < 1e-6)
        made = kernel.exact(np.array(times_s))
        assert np.all(np.isfinite(made))
        if sigma_s < 1e-6:
            true = exact_gaussian_response(kernel, times_s, digits)
        else:
            true = plane_like(sigma_s, times_s)
        assert np.abs(made - true).max() <= 1e-13 * peak_of(kernel)
    # Naive: above 315 ns it is no number
    with np.errstate(all="ignore"):
        assert not np.all(np.isfinite(by_naive_form(kernel, np.array([0.0, 20e-9]))))


def plane_like(sigma_s: float, times_s: list[float]) -> np.ndarray:
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


def tail_that_meets_a_pole() -> None:
    real_pole = next(-pole.real for pole in POLES if pole.imag == 0)
    times_s = [-4e-9, 5e-9, 15e-9, 25e-9, 60e-9, 150e-9]
    for gap in (0.0, 1e-14, 1e-10, 1e-6, 1e-4, 1e-3, 9e-3, 1.1e-2, 0.1):
        # Given a tail whose rate approaches the filter's real pole
        kernel = Kernel(PulseShape((PulsePiece(1.0, 2.2e-9, 1 / (real_pole * (1 + gap))),)), POLES)
        true = exact_gaussian_response(kernel, times_s, 120)
        # Then nothing is lost, at any gap
        assert np.abs(kernel.exact(np.array(times_s)) - true).max() <= 1e-12 * peak_of(kernel)
    # Naive: residues of a double pole
    doubled = Kernel(PULSE, (*POLES, complex(-real_pole * (1 + 1e-14))))
    true = exact_gaussian_response(doubled, times_s, 120)
    naive = by_naive_form(doubled, np.array(times_s))
    assert np.abs(naive - true).max() > 1e-3 * peak_of(doubled)


def shot_noise_of_a_filtered_echo() -> None:
    # Given the filtered echo of a flat footprint: it undershoots
    times_s = INTERVAL_S / 16 * np.arange(-200, 800)
    filtered = KERNEL.exact(times_s)
    assert filtered.min() < -0.05 * filtered.max()
    # When the variance is taken from the light before the filter
    surface = white(3.0)
    plan = plan_footprint(Accuracy(1e-4), Kernel(PULSE), LASER, ALTITUDE_M, surface, INTERVAL_S, "grid")
    light = delays(surface, LASER, ALTITUDE_M, plan, align_s=times_s[0], deposit="cic")
    rate = echo(Kernel(PULSE), light, times_s[0], INTERVAL_S / 16, times_s.size)
    # Then it is nowhere negative
    assert rate.min() >= 0
    assert np.all(np.isfinite(np.sqrt(rate)))
    # Naive: the root of the filtered echo
    with np.errstate(invalid="ignore"):
        assert np.isnan(np.sqrt(filtered)).mean() > 0.1


def negative_bins() -> None:
    for slope_deg in (0.0, 1.0, 10.0):
        surface = white(slope_deg)
        plan = plan_footprint(Accuracy(1e-4), KERNEL, LASER, ALTITUDE_M, surface, INTERVAL_S, "grid")
        # Given that all light comes in a few bins; when it must not be negative
        kept = delays(surface, LASER, ALTITUDE_M, plan, align_s=0.37e-9, deposit="cic")
        assert isinstance(kept, DelayHistogram)
        # Then no bin is, not by rounding either, and nothing is lost
        assert kept.weights.min() >= 0
        assert kept.weights.sum() == pytest.approx(kept.total, rel=1e-12)
        np.random.default_rng(1).poisson(1000 * kept.weights)
    # Naive: the cubic deposit of a flat footprint
    flat = delays(white(0.0), LASER, ALTITUDE_M, plan, align_s=0.37e-9)
    assert isinstance(flat, DelayHistogram)
    assert flat.weights.min() < -0.05 * flat.weights.max()
    with pytest.raises(ValueError, match="lam"):
        np.random.default_rng(1).poisson(1000 * flat.weights)


def beam_beside_the_terrain() -> None:
    ground = Surface("dtm", relief=Grid(np.zeros((60, 60)), 1.5, -45.0, -45.0), albedo=0.2)
    plan = plan_footprint(Accuracy(1e-3), KERNEL, LASER, ALTITUDE_M, ground, INTERVAL_S)
    # Given a beam 40 standard deviations, or kilometres, away
    for away_m in (40 * SIGMA_M, 30e3):
        nothing = delays(ground, LASER, ALTITUDE_M, plan, (away_m / ALTITUDE_M, 0.0))
        # Then there is no return, and that is a value like others
        assert isinstance(nothing, NoReturn)
        assert nothing.total == 0.0
        assert "dtm covers" in nothing.reason
        np.testing.assert_array_equal(echo(KERNEL, nothing, 0.0, INTERVAL_S, 42), np.zeros(42))
    # Naive: weights that all underflow
    weights = np.exp(-0.5 * np.array([40.0, 41.0]) ** 2)
    with pytest.raises(ZeroDivisionError):
        np.average([1.0, 2.0], weights=weights)


def cliff_along_the_grid() -> None:
    # Given 89 degrees along the grid, where no affordable grid serves
    surface = white(89.0)
    # Then the error that would be made is predicted within a factor of two
    plan = plan_footprint(Accuracy(1e-4), KERNEL, LASER, ALTITUDE_M, white(10.0), INTERVAL_S, "grid")
    tilt = 2 * math.tan(math.radians(89.0)) / 299792458.0
    for pixel_m in (0.25, 1.5):
        predicted = spacing_error(KERNEL, beam_transform(LASER, ALTITUDE_M), (SIGMA_M,) * 2, tilt, pixel_m)
        first_s, count = -3e-6, 480
        light = delays(surface, LASER, ALTITUDE_M, replace(plan, pixel_m=pixel_m), align_s=first_s)
        times_s = first_s + INTERVAL_S * np.arange(count)
        true = plane_echo(KERNEL, gradient_of(89.0), (0.0, 0.0), SIGMA_M, ALTITUDE_M, times_s)
        measured = np.abs(echo(KERNEL, light, first_s, INTERVAL_S, count) - true).max() / true.max()
        assert measured > 0.5
        assert predicted / 2 <= measured <= 2 * predicted
    # And the plan takes the closed form, or refuses
    closed = plan_footprint(Accuracy(1e-4), KERNEL, LASER, ALTITUDE_M, surface, INTERVAL_S)
    assert closed.method == "closed form"
    got = echo(KERNEL, delays(surface, LASER, ALTITUDE_M, closed), first_s, INTERVAL_S, count)
    assert np.abs(got - true).max() <= 1e-4 * true.max()
    with pytest.raises(RefusedInput, match="predicted error"):
        plan_footprint(Accuracy(1e-4), KERNEL, LASER, ALTITUDE_M, surface, INTERVAL_S, "grid")


ECHO_CASES: dict[str, HardCase] = {
    "H03": HardCase("a pulse of 0.05 time steps", pulse_much_shorter_than_a_bin),
    "H04": HardCase("a pulse that jumps at a threshold", pulse_that_jumps),
    "H05": HardCase("a flat footprint, and nearly one", delays_nearly_equal),
    "H07": HardCase("a filtered Gaussian of 0.05 to 2400 ns", gaussian_of_any_width),
    "H08": HardCase("a tail that meets a pole of the filter", tail_that_meets_a_pole),
    "H15": HardCase("the root of a filtered rate", shot_noise_of_a_filtered_echo),
    "H16": HardCase("negative bins of the cubic deposit", negative_bins),
    "H17": HardCase("a beam far beside the terrain", beam_beside_the_terrain),
    "H41": HardCase("a slope of 89 degrees along the grid", cliff_along_the_grid),
}
