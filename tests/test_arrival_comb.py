"""Combs of pulses: what is read from a window, beside pulses in closed form and least squares by SciPy."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import curve_fit

from belahil import butterworth
from belahil.errors import RefusedInput
from belahil.generators import MODELS, on_grid
from belahil.stimuli import SampledPulse
from procedures.arrival_comb import PlayedComb, PulseComb, comb_spacing_s, played_comb
from procedures.arrival_fit import aligned, expected_comb, read_comb, window_shape
from procedures.arrival_points import reference_delay
from sim.filter_delay import detected

NS = 1e-9
T_S = 12.5e-9
MODEL = MODELS["33522B"]


def comb(fwhm_s: float, tests: int = 8, converters: int = 2) -> PulseComb:
    return PulseComb(fwhm_s, 60 * NS, 0.05, tests, 700 * NS, comb_spacing_s(T_S, converters, tests))


def played(one: PulseComb) -> SampledPulse:
    found = on_grid(one.stimulus(MODEL), MODEL)
    assert isinstance(found, SampledPulse)
    return found


@settings(max_examples=25, deadline=None)
@given(fwhm_ns=st.floats(8.0, 110.0), tests=st.integers(4, 12), converters=st.sampled_from([1, 2]))
def test_the_pulses_of_a_comb_are_found_where_and_as_wide_as_they_were_played(
    fwhm_ns: float, tests: int, converters: int
) -> None:
    # given
    wanted = comb(fwhm_ns * NS, tests, converters)
    # when
    found = played_comb(played(wanted))
    # then: centroids to the steps of 16 bits; straight lines of h = 4 ns are off by e = ln 2 (h / W)^2 of the
    # peak, and so is half of it: the width by 2 (e + e / 2) over the slope there, 2 ln 2 / W
    assert found.centres_s == pytest.approx(wanted.centres_s, abs=2e-12)
    assert found.widths_s[1:-1] == pytest.approx(
        np.full(tests, fwhm_ns * NS), abs=1.5 * 4.0**2 / fwhm_ns * NS
    )


@pytest.mark.parametrize("converters", [1, 2])
@pytest.mark.parametrize("tests", [4, 8, 11])
def test_test_pulses_take_all_places_between_two_samples_in_turn(converters: int, tests: int) -> None:
    spacing_s = comb_spacing_s(T_S, converters, tests)

    period_s = converters * T_S
    places = np.sort(np.arange(1, tests + 1) * spacing_s / period_s % 1.0 * tests)
    assert np.sort(np.rint(places) % tests) == pytest.approx(np.arange(tests), abs=1e-6)


def test_what_the_model_expects_is_the_delay_of_single_pulses_in_closed_form() -> None:
    # given filters with and without AC coupling, and pulses so wide that straight lines are Gaussians
    for cutoff_hz, order, fwhm_ns in ((19e6, 3, 40.0), (16e6, 2, 75.0), (25e6, 4, 100.0)):
        poles = butterworth.poles(cutoff_hz, order)
        one = played(comb(fwhm_ns * NS))
        # when
        found = expected_comb(one, played_comb(one), poles, 0, T_S)
        # then it agrees with the closed form of a Gaussian through these poles; the lines of 4 ns widen
        lines_s = math.sqrt(8 * math.log(2) / 6) * 4 * NS
        width_s, delay_s = detected(poles, 0, T_S, math.hypot(fwhm_ns * NS, lines_s))
        reference_s = detected(poles, 0, T_S, math.hypot(60 * NS, lines_s))[1]
        assert found.width_s == pytest.approx(width_s, abs=5e-12)
        assert found.reference_s == pytest.approx(reference_s, abs=3e-12)
        assert found.delay_s == pytest.approx(delay_s - reference_s, abs=3e-12)


@settings(max_examples=20, deadline=None)
@given(
    shift_s=st.floats(0.0, T_S),
    ppm=st.floats(-100.0, 100.0),
    offsets_v=st.tuples(st.floats(-0.01, 0.01), st.floats(-0.01, 0.01)),
)
def test_a_reading_is_free_of_trigger_clock_and_offsets(
    shift_s: float, ppm: float, offsets_v: tuple[float, float]
) -> None:
    # given Gaussians on samples of a clock that is off, with converters that have their own zero
    wanted = comb(30 * NS)
    late_s = 1.5 * NS
    lead_s, count = window_shape(float(np.ptp(wanted.centres_s)), T_S)
    true_s = wanted.centres_s[0] - lead_s - shift_s + np.arange(count) * T_S / (1 + 1e-6 * ppm)
    widths_s = np.full(10, 30 * NS)
    widths_s[[0, -1]] = 60 * NS
    centres_s = wanted.centres_s + np.where(widths_s < 40 * NS, late_s, 0.0)
    volts = np.exp(-4 * math.log(2) * ((true_s - centres_s[:, None]) / widths_s[:, None]) ** 2).sum(axis=0)
    for parity, offset_v in enumerate(offsets_v):
        volts[parity::2] += offset_v
    # when
    found = read_comb(volts, T_S, PlayedComb(wanted.centres_s, widths_s), lead_s, converters=2)
    # then
    assert found.status == "ok"
    assert found.delay_s == pytest.approx(late_s, abs=0.5e-12)
    assert found.width_s == pytest.approx(30 * NS, abs=1e-12)
    assert 1e6 * found.clock == pytest.approx(ppm, abs=0.3)


@pytest.mark.parametrize("seed", range(3))
def test_every_pulse_is_the_least_squares_gaussian(seed: int) -> None:
    # given a noisy window
    rng = np.random.default_rng(seed)
    wanted = comb(float(rng.uniform(25, 90)) * NS)
    one = played(wanted)
    poles = butterworth.poles(19e6, 3)
    lead_s, count = window_shape(float(np.ptp(wanted.centres_s)), T_S)
    times_s = wanted.centres_s[0] - lead_s + T_S * (np.arange(count) + rng.random())
    volts = replace(one, poles=poles).at(times_s) + 2e-4 * rng.standard_normal(count)
    # when
    found = read_comb(volts, T_S, played_comb(one), lead_s + 17 * NS - T_S * 0.5)

    # then SciPy finds the same centres
    def bell(t, height, centre, width):  # type: ignore[no-untyped-def]
        return height * np.exp(-4 * math.log(2) * ((t - centre) / width) ** 2)

    level = volts - volts[1:24].mean()
    arrivals = []
    for centre_s in wanted.centres_s - wanted.centres_s[0] + lead_s + 17 * NS:
        first = round((centre_s - 262.5 * NS) / T_S)
        places = np.arange(first, first + 42, dtype=float)
        start = (0.05, centre_s / T_S, 4.0)
        arrivals.append(curve_fit(bell, places, level[first : first + 42], start)[0][1] * T_S)
    ends = (arrivals[0] + arrivals[-1]) / 2
    assert found.delay_s == pytest.approx(np.mean(arrivals[1:-1]) - ends, abs=0.03 * NS)


def test_a_comb_is_found_wherever_it_lies_and_missed_where_it_is_not() -> None:
    # given a long window of noise with a comb in it
    rng = np.random.default_rng(5)
    one = played(comb(25 * NS))
    found = played_comb(one)
    poles = butterworth.poles(19e6, 3)
    times_s = -20e-6 + T_S * np.arange(4000)
    noise = 1e-3 * rng.standard_normal(times_s.size)
    # when
    place_s = aligned(replace(one, poles=poles).at(times_s) + noise, T_S, one, found, poles, 0)
    # then
    assert place_s == pytest.approx(20e-6 + found.centres_s[0] + 17 * NS, abs=T_S)
    assert aligned(noise, T_S, one, found, poles, 0) is None
    assert aligned(-replace(one, poles=poles).at(times_s), T_S, one, found, poles, 0) is None
    assert aligned(noise[:300], T_S, one, found, poles, 0) is None


@pytest.mark.parametrize("where_s", [10 * NS, 6.9e-6])
def test_a_comb_that_does_not_fit_into_its_window_has_a_status(where_s: float) -> None:
    one = played_comb(played(comb(25 * NS)))

    assert read_comb(np.zeros(600), T_S, one, where_s).status == "too_few_samples"


def test_a_window_without_pulses_has_a_status() -> None:
    one = played_comb(played(comb(25 * NS)))

    assert read_comb(np.zeros(600), T_S, one, 560 * NS).status == "no_pulse"


@pytest.mark.parametrize(
    ("pulse", "words"),
    [
        (SampledPulse(np.array([0.0, 1.0, 0.0]), 1e8), "has 1 pulses"),
        (SampledPulse(np.zeros(9), 1e8), "has 0 pulses"),
        (SampledPulse(-np.tile([0.0, 1.0, 0.0, 0.0], 9), 1e8), "has 0 pulses"),
        (
            SampledPulse(
                np.repeat(
                    [0.0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0], [9, 2, 9, 2, 9, 2, 9, 2, 5] + [2, 9] * 2
                ),
                1e8,
            ),
            "equal steps",
        ),
    ],
)
def test_what_is_no_comb_is_refused(pulse: SampledPulse, words: str) -> None:
    with pytest.raises(RefusedInput, match=words):
        played_comb(pulse)


@pytest.mark.parametrize(
    ("tests", "spacing_s", "words"), [(3, 1e-6, "at least 4"), (8, 5e-7, "apart"), (8, math.nan, "apart")]
)
def test_a_comb_that_cannot_be_is_refused(tests: int, spacing_s: float, words: str) -> None:
    with pytest.raises(RefusedInput, match=words):
        PulseComb(20 * NS, 60 * NS, 0.05, tests, 700 * NS, spacing_s)


@pytest.mark.parametrize(("count", "noise_s"), [(60, 0.02 * NS), (280, 0.05 * NS), (280, 0.3 * NS)])
def test_the_constant_is_enclosed_by_arrivals_and_its_uncertainty_is_not_too_small(
    count: int, noise_s: float
) -> None:
    # given arrivals of a delay of 10 ns less a part of a sample, many times
    rng = np.random.default_rng([count, round(1e12 * noise_s)])
    pulls = []
    for _ in range(400):
        arrivals = 10 * NS - T_S * rng.random(count) + noise_s * rng.standard_normal(count)
        # when
        found, status = reference_delay(arrivals, T_S, noise_s)
        # then
        assert status == "ok"
        pulls.append((found.value - 10 * NS) / found.standard_uncertainty)
    assert abs(np.mean(pulls)) < 0.2
    assert np.mean(np.abs(pulls) < 2) > 0.95
    assert np.std(pulls) > 0.2  # nor is it useless


def test_a_trigger_that_jitters_is_told_and_the_mean_stands() -> None:
    rng = np.random.default_rng(1)
    arrivals = 10 * NS - T_S * rng.random(500) + 3 * NS * rng.standard_normal(500)

    found, status = reference_delay(arrivals, T_S, 0.05 * NS)

    assert status == "trigger_jitter"
    assert found.value == pytest.approx(10 * NS, abs=4 * found.standard_uncertainty)
    assert found.standard_uncertainty == pytest.approx(
        math.hypot(T_S / math.sqrt(12), 3 * NS) / math.sqrt(500), rel=0.1
    )


def test_a_trigger_that_stands_still_leaves_a_sample_of_doubt() -> None:
    found, status = reference_delay(np.full(50, 4 * NS), T_S, 0.01 * NS)

    assert status == "ok"
    assert found.value == pytest.approx(4 * NS + T_S / 2)
    assert found.standard_uncertainty == pytest.approx(T_S / math.sqrt(12), rel=1e-3)
