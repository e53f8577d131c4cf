"""The library of flat slopes and its search, beside one that tries every pulse with a minimizer."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from msgspec import structs
from scipy.optimize import minimize_scalar

from belahil.pulse_fit import gaussian_fit
from procedures.pulse_library import (
    AZIMUTHS_DEG,
    SLOPES_DEG,
    PulseLibrary,
    best_matches,
    mean_fit,
    plane_chain,
    pulse_library,
    timed_matches,
)
from sim.presets import laser_preset
from sim.scene import Scene

T_S = 12.5e-9
WINDOW = 42


@pytest.fixture(scope="module")
def library() -> PulseLibrary:
    return pulse_library(Scene(), tuple(range(0, 41, 2)), (0.0, 90.0))


def elliptical(ellipticity: float = 0.3) -> Scene:
    return structs.replace(Scene(), laser=laser_preset(beam="elliptical", ellipticity=ellipticity))


def samples(
    library: PulseLibrary, pulse: np.ndarray, factor: np.ndarray, shift_s: np.ndarray, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Windows of pulses that come later than their fitted Gaussians say."""
    arrival_s = T_S * (WINDOW / 2 + np.random.default_rng(seed).uniform(-0.5, 0.5, pulse.size))
    volts, _ = library.at(pulse, T_S * np.arange(WINDOW) - arrival_s[:, None] - shift_s[:, None])
    return factor[:, None] * volts, arrival_s


def test_the_published_library_has_a_pulse_for_each_slope_and_azimuth() -> None:
    # given a beam that is not round
    found = pulse_library(elliptical(), SLOPES_DEG[:4], AZIMUTHS_DEG)

    # then level ground has one pulse, a slope one for each azimuth that the ellipse can tell from others
    assert (SLOPES_DEG[-1], len(SLOPES_DEG), len(AZIMUTHS_DEG)) == (40.0, 41, 12)
    assert [int((found.slope_deg == slope).sum()) for slope in SLOPES_DEG[:4]] == [1, 4, 4, 4]
    assert found.azimuth_deg[found.slope_deg == 2].tolist() == [0.0, 30.0, 60.0, 90.0]


def test_a_round_beam_tells_no_azimuth(library: PulseLibrary) -> None:
    assert library.slope_deg.tolist() == list(range(0, 41, 2))
    assert np.all(np.diff(library.fwhm_s) > 0)


def test_pointing_changes_no_pulse_of_the_library(library: PulseLibrary) -> None:
    off = structs.replace(Scene(), laser=laser_preset(pointing_rad=(2e-5, -1e-5)))

    assert np.array_equal(pulse_library(off, (10.0,), (0.0,)).volts[0], library.volts[5])


@pytest.mark.parametrize("slope_deg", [0.0, 10.0, 40.0])
def test_pulses_between_the_stored_places_are_those_of_the_chain(slope_deg: float) -> None:
    chain = plane_chain(Scene(), slope_deg, 0.0)
    one = pulse_library(Scene(), (slope_deg,), (0.0,))
    first_s, step_s, count = -100e-9, 0.137e-9, 3000

    exact = chain.curve(None, first_s, step_s, count)
    volts, slopes = one.at(
        np.array([0]), (first_s + step_s * np.arange(count))[None, :] + _arrival_shift(one)
    )

    peak = exact.max()
    assert np.abs(volts[0] - exact).max() < 3e-6 * peak
    # the derivative by differences, to what its own step leaves
    assert np.abs(slopes[0, 1:-1] - (exact[2:] - exact[:-2]) / (2 * step_s)).max() < 1e-3 * peak / 1e-8


def _arrival_shift(one: PulseLibrary) -> float:
    """From the chain's gate to the arrival: the curve begins 500 ns before the gate."""
    return float(one.first_s[0]) + 500e-9


def test_a_fit_over_all_phases_is_the_mean_of_fits(library: PulseLibrary) -> None:
    curve, steps = library.volts[7], 32

    found = mean_fit(curve, steps, WINDOW, T_S)

    middle = int(np.argmax(curve)) - WINDOW // 2 * steps
    each = [gaussian_fit(curve[middle + phase :: steps][:WINDOW], T_S).pulse for phase in range(steps)]
    arrivals = [(middle + phase) * T_S / steps + one.arrival_s for phase, one in enumerate(each) if one]
    assert found[0] == pytest.approx(np.mean(arrivals), rel=1e-12)
    assert found[1] == pytest.approx(np.mean([one.fwhm_s for one in each if one]), rel=1e-12)
    assert found[2] == pytest.approx(np.mean([one.amplitude_v for one in each if one]), rel=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_a_pulse_of_the_library_is_found_exactly(library: PulseLibrary, seed: int) -> None:
    draws = np.random.default_rng(seed)
    pulse = draws.integers(0, len(library.volts), 200)
    factor, shift_s = draws.uniform(0.05, 3.0, 200), draws.uniform(-1.2, 1.2, 200) * T_S
    volts, arrival_s = samples(library, pulse, factor, shift_s, seed)

    found = best_matches(library, volts, arrival_s)

    assert np.array_equal(found.pulse, pulse)
    assert found.factor == pytest.approx(factor, rel=1e-6)
    assert found.shift_s == pytest.approx(shift_s, abs=1e-14)
    assert np.all(found.msr_v2 < 1e-12 * (volts**2).mean(axis=1))


def obvious(library: PulseLibrary, volts: np.ndarray, arrival_s: float) -> float:
    """Least mean square over all pulses, each with its own search for the shift from several starts."""
    times_s = T_S * np.arange(volts.size) - arrival_s

    def left(shift: float, pulse: int) -> float:
        model = library.at(np.array([pulse]), (times_s - shift * T_S)[None, :])[0][0]
        factor = max(float(volts @ model), 0.0) / float(model @ model)
        return float(np.mean((volts - factor * model) ** 2))

    edges = np.linspace(-1.5, 1.5, 7)
    return min(
        minimize_scalar(
            left, bounds=(low, high), args=(pulse,), method="bounded", options={"xatol": 1e-9}
        ).fun
        for pulse in range(len(library.volts))
        for low, high in itertools.pairwise(edges)
    )


@pytest.mark.parametrize(
    ("noise_v", "tail"),
    [
        pytest.param(0.0, 0.3, marks=pytest.mark.slow),
        pytest.param(0.8e-3, 0.0, marks=pytest.mark.slow),
        (1.5e-3, 0.4),
    ],
)
def test_the_best_match_is_that_of_trying_everything(
    library: PulseLibrary, noise_v: float, tail: float
) -> None:
    # given pulses with a second, later one on them, and noise
    draws = np.random.default_rng(17)
    pulse = draws.integers(2, 15, 6)
    volts, arrival_s = samples(library, pulse, np.ones(6), np.zeros(6), 5)
    late, _ = library.at(pulse - 2, T_S * np.arange(WINDOW) - arrival_s[:, None] - 30e-9)
    volts = volts + tail * late + noise_v * draws.standard_normal(volts.shape)

    found = best_matches(library, volts, arrival_s)

    # then nothing leaves less, to the rounding of both searches
    for row in range(6):
        expected = obvious(library, volts[row], float(arrival_s[row]))
        assert found.msr_v2[row] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("noise_v", "late_s"), [(0.0, 0.0), (0.8e-3, 0.0), (0.8e-3, 4e-9)])
def test_a_timed_match_is_that_of_trying_every_pulse_where_it_is(
    library: PulseLibrary, noise_v: float, late_s: float
) -> None:
    # given pulses, some later than their plane tells
    draws = np.random.default_rng(4)
    pulse = draws.integers(0, len(library.volts), 8)
    volts, arrival_s = samples(library, pulse, np.full(8, 1.4), np.zeros(8), 6)
    volts = volts + noise_v * draws.standard_normal(volts.shape)
    zero_s = arrival_s - library.delay_s[pulse] - late_s

    found = timed_matches(library, volts, zero_s)

    for row in range(8):
        left = []
        for number, delay_s in enumerate(library.delay_s):
            times_s = (T_S * np.arange(WINDOW) - zero_s[row] - delay_s)[None, :]
            model = library.at(np.array([number]), times_s)[0][0]
            _, rest, _, _ = np.linalg.lstsq(model[:, None], volts[row], rcond=None)
            left.append(float(rest[0]) / WINDOW)
        assert found.msr_v2[row] == pytest.approx(min(left), rel=1e-6, abs=1e-18)
        assert found.pulse[row] == int(np.argmin(left))
    if noise_v == 0:
        assert np.array_equal(found.pulse, pulse)
        assert found.factor == pytest.approx(1.4, rel=1e-6)


def test_a_window_that_no_pulse_resembles_keeps_all_its_square(library: PulseLibrary) -> None:
    volts, arrival_s = samples(library, np.array([3]), np.ones(1), np.zeros(1), 1)

    found = best_matches(library, -np.abs(volts), arrival_s)

    assert found.factor[0] == 0.0
    assert found.msr_v2[0] == pytest.approx((volts**2).mean(), rel=1e-12)
