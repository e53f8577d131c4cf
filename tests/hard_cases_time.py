"""Hard cases of times and ways: small differences of large numbers."""

from __future__ import annotations

import math
from fractions import Fraction

import mpmath
import numpy as np
from hard_cases_row import worst

from sim.footprint import DelayHistogram
from sim.reference import slant_delay

LIGHT_M_PER_S = 299792458

# ---- H09: time of flight in single precision

HEIGHTS_M = np.array([-1234.5, -3.25, -0.0625, 0.0, 0.0009765625, 0.75, 17.125, 812.375], dtype=np.float32)
ALTITUDES_M = (200e3, 500e3, 1500e3)


def heights_in_single_precision() -> float:
    """Delays from the gate and from an edge of the clock, s, against exact fractions."""
    errors = []
    exact_s = [-2 * Fraction(float(z)) / LIGHT_M_PER_S for z in HEIGHTS_M]
    for altitude_m in ALTITUDES_M:
        found_s = slant_delay(HEIGHTS_M, np.zeros(HEIGHTS_M.size), altitude_m)
        errors += [float(abs(Fraction(t) - true)) for t, true in zip(found_s.tolist(), exact_s, strict=True)]
        # A whole number of edges and the rest, as a window's place and a fit within it
        interval_s = 12.5e-9
        gate_s = 2 * Fraction(altitude_m) / LIGHT_M_PER_S
        edges = round(gate_s / Fraction(interval_s)) - 21
        rest_s = float(gate_s - edges * Fraction(interval_s))
        for t, true in zip(found_s.tolist(), exact_s, strict=True):
            whole = edges * Fraction(interval_s) + Fraction(rest_s + t)
            errors.append(float(abs(whole - gate_s - true)))
    return worst(*errors)


def times_of_flight_in_single_precision() -> float:
    """The spacing of single precision is 0.1 to 0.9 ns at these times."""
    exact_s = [-2 * Fraction(float(z)) / LIGHT_M_PER_S for z in HEIGHTS_M]
    errors = []
    for altitude_m in ALTITUDES_M:
        flight_s = np.float32(2 / LIGHT_M_PER_S) * (np.float32(altitude_m) - HEIGHTS_M)
        after_s = flight_s - np.float32(2 / LIGHT_M_PER_S) * np.float32(altitude_m)
        errors += [float(abs(Fraction(float(t)) - true)) for t, true in zip(after_s, exact_s, strict=True)]
    return worst(*errors)


# ---- H10: spread of times of flight

SPREAD_WEIGHTS = np.array([0.25, 1.0, 3.0, 2.0, 0.5, 0.125])


def histogram(first_s: float) -> DelayHistogram:
    return DelayHistogram(first_s, 2e-12, SPREAD_WEIGHTS, float(SPREAD_WEIGHTS.sum()), 1.0)


def spread_of_places() -> mpmath.mpf:
    """Variance in bins squared, exactly."""
    total = sum(map(Fraction, SPREAD_WEIGHTS.tolist()))
    first, second = (
        sum(Fraction(k) ** power * Fraction(w) for k, w in enumerate(SPREAD_WEIGHTS.tolist())) / total
        for power in (1, 2)
    )
    spread = second - first**2
    return mpmath.mpf(spread.numerator) / spread.denominator


def spread_of_delays() -> float:
    """Variance of delays from the gate and of times of flight of 10 ms, against exact fractions."""
    errors = []
    with mpmath.workdps(40):
        for first_s in (-37e-9, 0.0, 1e-6, 10e-3):
            variance = mpmath.mpf(histogram(first_s).std_s) ** 2 / mpmath.mpf(2e-12) ** 2
            errors.append(float(abs(variance / spread_of_places() - 1)))
    return worst(*errors)


def mean_square_less_square_of_mean() -> float:
    """E[t^2] - E[t]^2 of times of flight: nothing is left, or less."""
    times_s = 10e-3 + 2e-12 * np.arange(SPREAD_WEIGHTS.size)
    shares = SPREAD_WEIGHTS / SPREAD_WEIGHTS.sum()
    variance = float(shares @ times_s**2 - (shares @ times_s) ** 2)
    return abs(variance / (float(spread_of_places()) * 2e-12**2) - 1)


# ---- H11: slant path

PLACES_M = [(r, z) for r in (0.0, 1.0, 30.0, 300.0) for z in (-900.0, -1.0, 0.0, 1e-3, 30.0, 900.0)]


def slant_of_many_digits(altitude_m: float) -> list[mpmath.mpf]:
    with mpmath.workdps(60):
        h = mpmath.mpf(altitude_m)
        return [mpmath.hypot(mpmath.mpf(r), h - mpmath.mpf(z)) - h for r, z in PLACES_M]


def way_beyond_the_altitude() -> float:
    """R - H, m, against 60 digits: curved wavefront and relief, seen from 200 to 1500 km."""
    r, z = np.array(PLACES_M).T
    errors = []
    for altitude_m in ALTITUDES_M:
        found_m = slant_delay(z, r**2, altitude_m) * (LIGHT_M_PER_S / 2)
        true_m = slant_of_many_digits(altitude_m)
        errors += [float(abs(a - b)) for a, b in zip(found_m.tolist(), true_m, strict=True)]
    # The wavefront's own curvature is 2.3 mm at 30 m from 200 km
    bend_m = float(slant_delay(np.zeros(1), np.full(1, 900.0), 200e3)[0]) * LIGHT_M_PER_S / 2
    assert math.isclose(bend_m, 30**2 / (2 * 200e3), rel_tol=1e-7)
    return worst(*errors)


def way_less_the_altitude() -> float:
    """A root near the altitude less the altitude: 1e-10 m of rounding."""
    r, z = np.array(PLACES_M).T
    altitude_m = 1500e3
    naive_m = np.sqrt(r**2 + (altitude_m - z) ** 2) - altitude_m
    true_m = slant_of_many_digits(altitude_m)
    return worst(*(float(abs(a - b)) for a, b in zip(naive_m.tolist(), true_m, strict=True)))
