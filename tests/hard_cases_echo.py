"""Hard cases of the echo: jumps, flat ground, nothing at all, and a slope that no grid can hold."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hard_cases_filter import POLES, PULSE, peak_of
from hard_cases_row import error_or_inf, worst
from scipy import integrate, optimize, signal

from belahil.errors import RefusedInput
from sim.accuracy import Accuracy
from sim.beam import beam_sigma_m
from sim.detector import Detector
from sim.echo import echo
from sim.footprint import DelayHistogram, NoReturn, delays, plan_footprint
from sim.footprint_error import beam_transform, spacing_error
from sim.kernel import Kernel
from sim.laser import Laser
from sim.light_noise import shot_noise_density
from sim.pulse_shape import PulsePiece, PulseShape
from sim.reference import cic_deposit, lag4_deposit, plane_echo
from sim.terrain import Surface, gradient_of, plane
from sim.terrain_grid import Grid

INTERVAL_S = 12.5e-9
ALTITUDE_M = 500e3
LASER = Laser(divergence_rad=50e-6)
SIGMA_M = beam_sigma_m(LASER, ALTITUDE_M)[0]
KERNEL = Kernel(PULSE, POLES)


def white(slope_deg: float, azimuth_deg: float = 0.0) -> Surface:
    return plane(slope_deg, azimuth_deg, reflectance=1.0)


# ---- H03: a pulse much shorter than a bin


def pulse_much_shorter_than_a_bin() -> float:
    """Energy of deposit and of the filter's response, against 1."""
    errors = []
    # Given a pulse of 0.05 bins at any place in a bin
    for phase in np.linspace(0, 1, 21):
        for deposit in (lag4_deposit, cic_deposit):
            errors.append(abs(float(deposit(np.array([4 + phase]), np.array([1.0]), 9).sum()) - 1))
    sigma_s = 0.05e-9
    kernel = Kernel(PulseShape((PulsePiece(1.0, sigma_s),)), POLES)
    for phase in (0.0, 0.3, 0.77):
        times_s = kernel.starts_s + sigma_s * (np.arange(14000) + phase)
        errors.append(abs(float(sigma_s * kernel.exact(times_s).sum()) - 1))
    return worst(*errors)


def pulse_sampled_at_the_bins() -> float:
    """A sampled pulse has eight times its energy, or none."""
    bin_s, short = 1e-9, PulseShape((PulsePiece(1.0, 0.05e-9),))
    energies = [float(bin_s * short.density(bin_s * (np.arange(-9, 10) + phase)).sum()) for phase in (0, 0.5)]
    assert energies[1] < 1e-20
    return abs(energies[0] - 1)


# ---- H04: a pulse that jumps at a threshold

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


def pulse_that_jumps() -> float:
    """In bins of 1 ns, against the same curve between its crossings by adaptive quadrature."""
    errors, means_s = [], []
    fine_s = np.array([0.0, 8e-9, 17e-9, 30e-9, 55e-9])
    for threshold in (0.05, 0.1, 0.17, 0.171, 0.22, 0.4):
        # Given a pulse cut at its crossing times, as a table
        pulse = cut_pulse(threshold)
        kernel = Kernel(pulse, POLES)
        true = quadrature(pulse, fine_s)
        # (Straight lines between its 2000 points: a part in 20 000 of the curve.)
        assert np.abs(kernel.exact(fine_s) - true).max() <= 1e-4 * peak_of(kernel)
        for part in (0.0, 0.25, 0.5, 0.9):
            # When it lies anywhere in bins of 1 ns
            weights = lag4_deposit(np.array([2 + part]), np.array([1.0]), 6)
            got = sum(w * kernel.exact(fine_s + (2 + part - k) * 1e-9) for k, w in enumerate(weights))
            errors.append(np.abs(got - true).max() / peak_of(kernel))
        means_s.append(pulse.mean_s)
    # And the mean falls with the threshold, without steps of a sample
    assert np.all(np.diff(means_s) < 0)
    assert means_s[2] - means_s[3] < 0.05e-9
    return worst(*errors)


def quadrature(pulse: PulseShape, times_s: np.ndarray) -> np.ndarray:
    begin, end = pulse.times_s[0], pulse.times_s[-1]
    area, _ = integrate.quad(TAILED.density, begin, end, epsrel=1e-10, epsabs=0)
    values = [
        integrate.quad(
            lambda t, time_s=time_s: float(TAILED.density(t)) * impulse_response(time_s - t),
            begin,
            min(end, time_s),
            epsabs=1e-2,  # of some 1e7
            epsrel=1e-9,
        )[0]
        for time_s in times_s
    ]
    return np.array(values) / area


def jumps_on_a_grid() -> float:
    """Samples of the cut pulse each 1 ns: the crossings lie anywhere between them."""
    pulse, fine_s = cut_pulse(0.17), np.array([8e-9, 17e-9, 30e-9])
    true, errors = quadrature(pulse, fine_s), []
    for phase in np.arange(8) / 8:
        grid_s = 1e-9 * (np.arange(-20, 90) + phase)
        sampled = pulse.density(grid_s)
        got = [
            sum(s * impulse_response(t - u) for s, u in zip(sampled, grid_s, strict=True) if u < t)
            for t in fine_s
        ]
        errors.append(np.abs(np.array(got) * 1e-9 - true).max() / peak_of(Kernel(pulse, POLES)))
    return worst(*errors)


# ---- H05: delays that are nearly equal


def delays_nearly_equal() -> float:
    """Planes from flat to 50 ns across the footprint, against Fourier integrals; nothing is divided."""
    errors, found = [], []
    for span_s in (0.0, 1e-17, 1e-15, 1e-12, 1e-9, 0.29e-9, 0.31e-9, 5e-9, 50e-9):
        slope = math.degrees(math.atan(span_s * 299792458.0 / (8 * SIGMA_M)))
        surface = white(slope)
        plan = plan_footprint(Accuracy(1e-8), KERNEL, LASER, ALTITUDE_M, surface, INTERVAL_S, "grid")
        first_s = -40e-9
        got = echo(KERNEL, delays(surface, LASER, ALTITUDE_M, plan, align_s=first_s), first_s, INTERVAL_S, 42)
        times_s = first_s + INTERVAL_S * np.arange(42)
        true = plane_echo(KERNEL, gradient_of(slope), (0.0, 0.0), SIGMA_M, ALTITUDE_M, times_s)
        errors.append(np.abs(got - true).max() / peak_of(KERNEL))
        found.append(got)
    # And the echo does not jump where the span becomes zero
    errors.append(np.abs(found[1] - found[0]).max() / peak_of(KERNEL))
    return worst(*errors)


def divided_difference_of_delays() -> float:
    """Light spread evenly over a span, as the divided difference of the step response over it."""
    span_s, times_s = 1e-17, np.array([10e-9, 17e-9, 30e-9])
    steps = []
    for end in (0.5, -0.5):
        total = np.zeros(times_s.size, dtype=complex)
        for k, pole in enumerate(POLES):
            others = np.prod([pole - other for n, other in enumerate(POLES) if n != k])
            weight = np.prod([-p for p in POLES]) / others
            total += weight / pole * (np.exp(pole * (times_s + end * span_s)) - 1)
        steps.append(total.real)
    true = np.array([impulse_response(t) for t in times_s])
    return float(np.abs((steps[0] - steps[1]) / span_s - true).max() / np.abs(true).max())


# ---- H15, H16: light that must not be negative


def shot_noise_of_a_filtered_echo() -> float:
    """Least rate from which the variance of shot noise is taken, below zero, of the peak."""
    # Given the filtered echo of nearly flat ground: it undershoots
    times_s = INTERVAL_S / 16 * np.arange(-200, 800)
    filtered = KERNEL.exact(times_s)
    assert filtered.min() < -0.05 * filtered.max()
    # When the variance is taken from the light before the filter
    surface = white(3.0)
    plan = plan_footprint(Accuracy(1e-4), Kernel(PULSE), LASER, ALTITUDE_M, surface, INTERVAL_S, "grid")
    light = delays(surface, LASER, ALTITUDE_M, plan, align_s=times_s[0], deposit="cic")
    rate = echo(Kernel(PULSE), light, times_s[0], INTERVAL_S / 16, times_s.size)
    noise = shot_noise_density(Detector(), 1e9 * rate)
    assert np.all(np.isfinite(noise))
    assert rate.max() > 0
    # And a filtered rate is refused
    with pytest.raises(RefusedInput, match="must not be negative"):
        shot_noise_density(Detector(), filtered)
    return max(0.0, -float(rate.min()) / float(rate.max()))


def root_of_a_filtered_echo() -> float:
    """Where the echo undershoots the root is no number, and a recursion spreads it to all that follows."""
    filtered = KERNEL.exact(INTERVAL_S / 16 * np.arange(-200, 800))
    with np.errstate(invalid="ignore"):
        noise = np.sqrt(filtered)
    assert np.isnan(noise).mean() > 0.1
    numerator, denominator = signal.butter(3, 19e6, fs=16 / INTERVAL_S)
    behind = signal.lfilter(numerator, denominator, noise)
    assert np.isnan(behind).sum() > np.isnan(noise).sum()
    return float(noise.min())


def negative_bins() -> float:
    """Least bin below zero, of the largest, where all light comes in a few bins."""
    errors = []
    for slope_deg in (0.0, 1.0, 10.0):
        surface = white(slope_deg)
        plan = plan_footprint(Accuracy(1e-4), KERNEL, LASER, ALTITUDE_M, surface, INTERVAL_S, "grid")
        kept = delays(surface, LASER, ALTITUDE_M, plan, align_s=0.37e-9, deposit="cic")
        assert isinstance(kept, DelayHistogram)
        errors.append(max(0.0, -float(kept.weights.min()) / float(kept.weights.max())))
        # Nothing is lost, and photons can be drawn
        assert kept.weights.sum() == pytest.approx(kept.total, rel=1e-12)
        np.random.default_rng(1).poisson(1000 * kept.weights)
    return worst(*errors)


def cubic_deposit_of_flat_ground() -> float:
    """The cubic through four bins is negative in two of them, and no photons can be drawn."""
    plan = plan_footprint(Accuracy(1e-4), KERNEL, LASER, ALTITUDE_M, white(0.0), INTERVAL_S, "grid")
    flat = delays(white(0.0), LASER, ALTITUDE_M, plan, align_s=0.37e-9)
    assert isinstance(flat, DelayHistogram)
    assert flat.weights.min() < -0.05 * flat.weights.max()
    return error_or_inf(
        lambda: float(np.random.default_rng(1).poisson(1000 * flat.weights).min()), ValueError, "lam"
    )


# ---- H17: a beam far beside the terrain


def beam_beside_the_terrain() -> float:
    """Energy that comes back from there, which is a result with a reason."""
    ground = Surface("dtm", relief=Grid(np.zeros((60, 60)), 1.5, -45.0, -45.0), albedo=0.2)
    plan = plan_footprint(Accuracy(1e-3), KERNEL, LASER, ALTITUDE_M, ground, INTERVAL_S)
    energies = []
    for away_m in (40 * SIGMA_M, 30e3):
        nothing = delays(ground, LASER, ALTITUDE_M, plan, (away_m / ALTITUDE_M, 0.0))
        assert isinstance(nothing, NoReturn)
        assert "dtm covers" in nothing.reason
        energies += [nothing.total, float(np.abs(echo(KERNEL, nothing, 0.0, INTERVAL_S, 42)).max())]
    return worst(*energies)


def mean_with_weights_that_underflow() -> float:
    """All weights are zero 40 standard deviations away, and their mean is a division by zero."""
    away_m = 40 * SIGMA_M + 1.5 * np.arange(60)
    weights = np.exp(-0.5 * (away_m / SIGMA_M) ** 2)
    return error_or_inf(lambda: float(np.average(away_m, weights=weights)), ZeroDivisionError, "sum to zero")


# ---- H41: a slope of 89 degrees along the grid


def cliff_along_the_grid() -> float:
    """Predicted error over measured one, or the inverse, where no affordable grid serves."""
    surface, ratios = white(89.0), []
    plan = plan_footprint(Accuracy(1e-4), KERNEL, LASER, ALTITUDE_M, white(10.0), INTERVAL_S, "grid")
    tilt = 2 * math.tan(math.radians(89.0)) / 299792458.0
    first_s, count = -3e-6, 480
    times_s = first_s + INTERVAL_S * np.arange(count)
    true = plane_echo(KERNEL, gradient_of(89.0), (0.0, 0.0), SIGMA_M, ALTITUDE_M, times_s)
    for pixel_m in (0.25, 1.5):
        predicted = spacing_error(KERNEL, beam_transform(LASER, ALTITUDE_M), (SIGMA_M,) * 2, tilt, pixel_m)
        light = delays(surface, LASER, ALTITUDE_M, replace(plan, pixel_m=pixel_m), align_s=first_s)
        measured = np.abs(echo(KERNEL, light, first_s, INTERVAL_S, count) - true).max() / true.max()
        assert measured > 0.5
        ratios += [predicted / measured, measured / predicted]
    # And the plan takes the closed form, or refuses
    closed = plan_footprint(Accuracy(1e-4), KERNEL, LASER, ALTITUDE_M, surface, INTERVAL_S)
    assert closed.method == "closed form"
    got = echo(KERNEL, delays(surface, LASER, ALTITUDE_M, closed), first_s, INTERVAL_S, count)
    assert np.abs(got - true).max() <= 1e-4 * true.max()
    with pytest.raises(RefusedInput, match="predicted error"):
        plan_footprint(Accuracy(1e-4), KERNEL, LASER, ALTITUDE_M, surface, INTERVAL_S, "grid")
    return worst(*ratios)
