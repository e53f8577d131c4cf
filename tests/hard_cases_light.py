"""Hard cases of laser and detector: short tails, gains near breakdown, small angles, small constants."""

from __future__ import annotations

import math
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hard_cases_row import error_or_inf, worst
from msgspec.structs import replace
from scipy.special import erfc

from belahil.errors import RefusedInput
from sim.detector import Detector, amperes_per_photon_rate, miller_gain, multiplication, solid_angle_sr
from sim.laser import Laser, photon_energy_j, photon_number
from sim.light_noise import shot_noise_density
from sim.pulse_forms import modified_gaussian

# ---- H06: exponentially modified Gaussian

RISE_S = 2.2e-9
TAIL_TIMES_S = np.array([-60, -30, -8, -2, -0.1, 0, 0.3, 2, 5, 9, 25, 60, 84, 300, 3000]) * 1e-9


def tails_of_any_length() -> float:
    """Against the textbook form of the density with 60 digits, wherever it is above 1e-300."""
    errors = []
    for ratio in (0.0, 1e-300, 1e-14, 1e-11, 1e-8, 1e-6, 5e-4, 0.02, 0.5, 3.0 / 2.2, 40.0):
        tau_s = ratio * RISE_S
        for time_s, found in zip(TAIL_TIMES_S, modified_gaussian(TAIL_TIMES_S, RISE_S, tau_s), strict=True):
            true = modified_gaussian_of_many_digits(time_s, RISE_S, tau_s)
            if true > 1e-300 / RISE_S:
                errors.append(float(abs(found / true - 1)))
            else:
                assert 0 <= found <= 1e-299 / RISE_S
    return worst(*errors)


def modified_gaussian_of_many_digits(time_s: float, sigma_s: float, tau_s: float) -> mpmath.mpf:
    with mpmath.workdps(60):
        t, s, k = mpmath.mpf(time_s), mpmath.mpf(sigma_s), mpmath.mpf(tau_s)
        if tau_s < 1e-30 * sigma_s:  # to 60 digits the Gaussian, and beyond the oracle's own series
            return mpmath.npdf(t, 0, s)
        # The product of a huge and a tiny factor: many digits do not mind.
        grown = mpmath.exp(s**2 / (2 * k**2) - t / k)
        return grown * mpmath.erfc((s / k - t / s) / mpmath.sqrt(2)) / (2 * k)


def textbook_form_of_a_short_tail() -> float:
    """Infinity times zero for a tail of 0.05 ns."""
    tau_s = 0.05e-9
    with np.errstate(over="ignore", invalid="ignore"):
        grown = np.exp(np.float64(RISE_S**2 / (2 * tau_s**2))) * erfc(RISE_S / tau_s / math.sqrt(2))
    true = modified_gaussian_of_many_digits(0.0, RISE_S, tau_s)
    return float(abs(grown / (2 * tau_s) / float(true) - 1))


# ---- H12: Miller's gain near breakdown

BREAKDOWN_V, EXPONENT = 391.43, 0.103624


def miller_of_many_digits(bias_v: float) -> mpmath.mpf:
    with mpmath.workdps(60):
        return 1 / (1 - (mpmath.mpf(bias_v) / mpmath.mpf(BREAKDOWN_V)) ** mpmath.mpf(EXPONENT))


def gain_near_breakdown() -> float:
    """Against Miller's formula with 60 digits; at breakdown and above, and below 0 V, it is refused."""
    near = (1 - 1e-6, 1 - 1e-9, 1 - 1e-12, 1 - 1e-15)
    errors = []
    for part in (0.0, 1e-6, 0.05, 0.0999, 0.1, 0.5, 0.8175, 0.99, *near):
        found = miller_gain(part * BREAKDOWN_V, BREAKDOWN_V, EXPONENT)
        errors.append(float(abs(found / miller_of_many_digits(part * BREAKDOWN_V) - 1)))
    for bias_v in (BREAKDOWN_V, 400.0, math.inf, -1.0, math.nan):
        with pytest.raises(RefusedInput, match="0 <= bias < breakdown"):
            miller_gain(bias_v, BREAKDOWN_V, EXPONENT)
    return worst(*errors)


def printed_form_of_the_gain() -> float:
    """A difference of nearly equal numbers; above breakdown it is negative without a word."""
    assert 1 / (1 - (400 / BREAKDOWN_V) ** EXPONENT) < 0
    bias_v = (1 - 1e-12) * BREAKDOWN_V
    naive = 1 / (1 - (bias_v / BREAKDOWN_V) ** EXPONENT)
    return float(abs(naive / miller_of_many_digits(bias_v) - 1))


# ---- H13: solid angle of a telescope

RADIUS_M = 0.1


def telescope_far_away() -> float:
    """Against 4 pi sin^2(theta / 2) with 60 digits; single precision keeps seven."""
    errors = []
    for altitude_m in (200e3, 500e3, 1500e3, 1.0, 1e-3):
        with mpmath.workdps(60):
            half = mpmath.atan(mpmath.mpf(RADIUS_M) / mpmath.mpf(altitude_m)) / 2
            true = 4 * mpmath.pi * mpmath.sin(half) ** 2
            errors.append(float(abs(solid_angle_sr(RADIUS_M, altitude_m) / true - 1)))
        single = solid_angle_sr(np.float32(RADIUS_M), np.float32(altitude_m))
        assert single.dtype == np.float32  # type: ignore[attr-defined]
        assert float(single) == pytest.approx(solid_angle_sr(RADIUS_M, altitude_m), rel=4e-7)
    return worst(*errors)


def solid_angle_by_a_cosine() -> float:
    """2 pi (1 - cos): four digits are left at 1500 km, none in single precision."""
    assert np.float32(1) - np.cos(np.arctan(np.float32(RADIUS_M / 1500e3))) == 0
    naive = 2 * math.pi * (1 - math.cos(math.atan(RADIUS_M / 1500e3)))
    with mpmath.workdps(60):
        half = mpmath.atan(mpmath.mpf(RADIUS_M) / 1500000) / 2
        return float(abs(naive / (4 * mpmath.pi * mpmath.sin(half) ** 2) - 1))


# ---- H14: constants of 1e-34 and counts of 1e17

CHARGE_C = Fraction(1.602176634e-19)


def photons_and_their_noise() -> float:
    """Against the same numbers as exact fractions; single precision keeps six digits of the noise."""
    laser, detector = Laser(), replace(Detector(), multiplication=48.0, excess_noise_exponent=1.0)
    energy = Fraction(6.62607015e-34) * Fraction(299792458) / Fraction(laser.wavelength_m)
    amperes = CHARGE_C * Fraction(detector.quantum_efficiency) * 48
    pairs = [
        (photon_energy_j(laser.wavelength_m), energy),
        (photon_number(laser), Fraction(laser.energy_j) / energy),
        (amperes_per_photon_rate(detector), amperes),
    ]
    assert photon_number(laser) > 2**53  # beyond the integers that floats count one by one
    assert multiplication(detector) == 48.0
    errors = [float(abs(Fraction(found) / true - 1)) for found, true in pairs]
    for rate_hz in (1.0, 7e10, 1e19):
        # A root of a fraction, to 60 digits: q R_f M sqrt(2 eps_qe M n)
        with mpmath.workdps(60):
            inside = 2 * Fraction(detector.quantum_efficiency) * 48 * Fraction(rate_hz)
            outside = CHARGE_C * Fraction(detector.feedback_ohm) * 48
            true = mpmath.mpf(outside.numerator) / outside.denominator
            true *= mpmath.sqrt(mpmath.mpf(inside.numerator) / inside.denominator)
            errors.append(float(abs(float(shot_noise_density(detector, rate_hz)) / true - 1)))
            single = shot_noise_density(detector, np.full(1, rate_hz, dtype=np.float32))
            assert single.dtype == np.float32
            assert abs(float(single[0]) / true - 1) < 1e-6
    return worst(*errors)


def shot_noise_by_its_variance() -> float:
    """In single precision q^2 is subnormal and the variance is zero; 1e19 photons cannot be drawn."""
    charge = np.float32(1.602176634e-19)
    error_or_inf(lambda: float(np.random.default_rng(1).poisson(1e19)), ValueError, "lam value too large")
    with np.errstate(under="ignore"):
        variance = charge * charge * np.float32(1e-9)
        assert np.float32(6.62607015e-34) ** 2 == 0
    return float(abs(float(variance) / (1.602176634e-19**2 * 1e-9) - 1))
