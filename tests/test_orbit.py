"""An orbit after Kepler: beside integrated motion, quadrature over time, and the shape of an ellipse."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from belahil.errors import RefusedInput
from sim.constants import MERCURY_GM_M3_PER_S2, MERCURY_RADIUS_M
from sim.orbit import Orbit, eccentric_anomaly

ORBITS = [(480e3, 1500e3), (200e3, 1780e3), (500e3, 500e3), (300e3, 40e6)]


def integrated_m(orbit: Orbit, times_s: np.ndarray) -> np.ndarray:
    """Altitudes of a body that starts at the periapsis, from Newton's law alone."""
    r0 = MERCURY_RADIUS_M + orbit.periapsis_m
    r1 = MERCURY_RADIUS_M + orbit.apoapsis_m
    # Energy and angular momentum alone tell the speed at the periapsis.
    v0 = math.sqrt(2 * MERCURY_GM_M3_PER_S2 * r1 / (r0 * (r0 + r1)))

    def motion(_: float, at: np.ndarray) -> np.ndarray:
        pull = -MERCURY_GM_M3_PER_S2 * at[:2] / np.hypot(*at[:2]) ** 3
        return np.concatenate([at[2:], pull])

    found = solve_ivp(
        motion,
        (0, times_s[-1]),
        [r0, 0, 0, v0],
        "DOP853",
        times_s,
        rtol=1e-12,
        atol=1e-9,
        max_step=orbit.period_s / 200,
    )
    return np.hypot(found.y[0], found.y[1]) - MERCURY_RADIUS_M


@pytest.mark.parametrize("altitudes_m", ORBITS)
def test_altitudes_are_those_of_integrated_motion(altitudes_m: tuple[float, float]) -> None:
    orbit = Orbit(*altitudes_m)
    times_s = np.linspace(0.0, 1.25 * orbit.period_s, 101)

    found_m = orbit.altitude_m(2 * np.pi * times_s / orbit.period_s)

    # Each of some 250 steps may leave 1e-12 of place and speed, and time runs off with the speed.
    slack_m = 250 * 1e-12 * 4 * (MERCURY_RADIUS_M + orbit.apoapsis_m)
    assert np.abs(found_m - integrated_m(orbit, times_s)).max() < slack_m


@pytest.mark.parametrize("altitudes_m", ORBITS)
def test_the_way_by_true_anomalies_is_the_same(altitudes_m: tuple[float, float]) -> None:
    orbit = Orbit(*altitudes_m)
    mean_rad = np.linspace(-7.0, 7.0, 141)

    true_rad = orbit.true_anomaly_rad(mean_rad)

    assert orbit.altitude_at_m(true_rad) == pytest.approx(orbit.altitude_m(mean_rad), abs=1e-6)
    assert (np.diff(true_rad) > 0).all()
    assert np.abs(true_rad - mean_rad).max() < np.pi


@pytest.mark.parametrize("altitudes_m", ORBITS[:2] + ORBITS[3:])
@pytest.mark.parametrize("part", [0.0, 1e-9, 0.1, 0.5, 0.9, 1.0])
def test_time_below_an_altitude_is_a_quadrature_over_time(
    altitudes_m: tuple[float, float], part: float
) -> None:
    # Given the areas that the radius sweeps, Kepler's second law, up to an altitude
    orbit = Orbit(*altitudes_m)
    altitude_m = orbit.periapsis_m + part * (orbit.apoapsis_m - orbit.periapsis_m)
    true_rad = np.linspace(0.0, np.pi, 200_001)
    middles_rad = (true_rad[1:] + true_rad[:-1]) / 2
    swept = (MERCURY_RADIUS_M + orbit.altitude_at_m(middles_rad)) ** 2
    reached = np.concatenate([[0.0], np.cumsum(swept)]) / swept.sum()

    found = orbit.time_below(altitude_m)

    # (a step holds no more than 5e-6 / (1 - e)^2 of the time at the apoapsis)
    slack = 5e-6 / (1 - orbit.eccentricity) ** 2
    assert found == pytest.approx(np.interp(altitude_m, orbit.altitude_at_m(true_rad), reached), abs=slack)


def test_the_nominal_orbit_in_numbers() -> None:
    # Given 480 x 1500 km, a turn of which takes some 2.36 hours
    orbit = Orbit(480e3, 1500e3)

    assert orbit.semi_major_axis_m == 3429.4e3
    assert orbit.eccentricity == pytest.approx(510 / 3429.4, rel=1e-15)
    assert orbit.period_s / 3600 == pytest.approx(2.36, abs=0.03)
    # and Kepler's third law, from gravity at the ground and the radius alone
    gravity = MERCURY_GM_M3_PER_S2 / MERCURY_RADIUS_M**2
    assert gravity == pytest.approx(3.70, abs=0.005)
    assert orbit.period_s == pytest.approx(
        2 * math.pi * math.sqrt(MERCURY_RADIUS_M / gravity) * (3429.4 / 2439.4) ** 1.5, rel=1e-12
    )


def test_a_circle_is_all_at_its_altitude() -> None:
    orbit = Orbit(500e3, 500e3)

    assert [orbit.time_below(x) for x in (499e3, 500e3, 501e3)] == [0.0, 1.0, 1.0]
    assert (orbit.altitude_m(np.linspace(0, 9, 50)) == 500e3).all()


@given(st.floats(-50, 50), st.floats(0, 0.999999))
def test_keplers_equation_is_solved(mean_rad: float, eccentricity: float) -> None:
    found = float(eccentric_anomaly(mean_rad, eccentricity))

    # Rounding of M, and of the difference in which it is told.
    assert found - eccentricity * math.sin(found) == pytest.approx(mean_rad, abs=3e-14)


def test_keplers_equation_keeps_shapes() -> None:
    assert eccentric_anomaly(np.zeros((2, 0, 3)), 0.5).shape == (2, 0, 3)
    assert eccentric_anomaly(np.pi, 0.3) == np.pi


@pytest.mark.parametrize(
    "altitudes_m", [(1500e3, 480e3), (0.0, 1e6), (-1.0, 1e6), (5e5, math.inf), (math.nan, 1e6)]
)
def test_an_orbit_that_is_none_is_refused(altitudes_m: tuple[float, float]) -> None:
    with pytest.raises(RefusedInput, match="periapsis"):
        Orbit(*altitudes_m)


@pytest.mark.parametrize("eccentricity", [-0.1, 1.0, math.nan])
def test_an_eccentricity_that_is_none_is_refused(eccentricity: float) -> None:
    with pytest.raises(RefusedInput, match="eccentricity"):
        eccentric_anomaly(1.0, eccentricity)
