"""Gaussian test pulses: what a generator really plays of them, beside the Gaussian."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from belahil.bench import open_bench
from belahil.config import simulated
from belahil.errors import RefusedInput
from belahil.generators import MODELS, on_grid
from belahil.stimuli import SampledPulse
from belahil.values import WindowRequest
from procedures.gaussian_pulses import TrainPulse, earliest_centre_s, gaussian_pulse, gaussian_train

NS = 1e-9
NAMES = ("33522B", "33611A", "33622A")


def played(pulse: SampledPulse, name: str) -> SampledPulse:
    found = on_grid(pulse, MODELS[name])
    assert isinstance(found, SampledPulse)
    return found


@settings(max_examples=60)
@given(
    fwhm_ns=st.floats(8.0, 3000.0),
    peak_v=st.floats(2e-3, 4.0) | st.floats(-4.0, -2e-3),
    name=st.sampled_from(NAMES),
    later_ns=st.floats(0.0, 5e3),
)
def test_what_is_played_is_the_gaussian_to_its_straight_lines_and_steps(
    fwhm_ns: float, peak_v: float, name: str, later_ns: float
) -> None:
    # given a pulse that the model can play
    model, fwhm_s = MODELS[name], fwhm_ns * NS
    centre_s = earliest_centre_s(fwhm_s, model) + later_ns * NS
    # when the generator makes what it can of it
    pulse = gaussian_pulse(fwhm_s, peak_v, model, centre_s)
    one = played(pulse, name)
    # then it differs from the Gaussian, at any time, by no more than a straight line over an interval, the
    # step of the converter, and the rounding of the delay to its grid
    times_s = np.linspace(centre_s - 4 * fwhm_s, centre_s + 4 * fwhm_s, 4001)
    wanted = peak_v * np.exp(-4 * math.log(2) * ((times_s - centre_s) / fwhm_s) ** 2)
    line = math.log(2) / (pulse.sample_rate_hz * fwhm_s) ** 2
    step = 2.0 ** (1 - model.dac_bits) * 1.01
    moved = abs(one.start_s - pulse.start_s) * 1.43 / fwhm_s  # the steepest place of a Gaussian
    assert moved < 1e-6
    assert np.max(np.abs(one.at(times_s) - wanted)) <= abs(peak_v) * (line + step + moved)
    assert one.volts[0] == one.volts[-1] == 0


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("centre_ns", [600.0, 600.37, 611.9])
def test_its_centroid_is_where_it_was_asked_for_whatever_the_grids(name: str, centre_ns: float) -> None:
    # given, when
    one = played(gaussian_pulse(30 * NS, 0.1, MODELS[name], centre_ns * NS), name)
    # then the centroid of the straight lines is the centre, to the steps of the converter
    times_s = one.start_s + np.arange(one.volts.size) / one.sample_rate_hz
    assert one.volts @ times_s / one.volts.sum() == pytest.approx(centre_ns * NS, abs=0.01 * NS)


def test_a_pulse_as_wide_as_a_memory_takes_fewer_points() -> None:
    pulse = gaussian_pulse(1e-3, 0.1, MODELS["33522B"], 4e-3)

    assert pulse.volts.size < 1500
    assert pulse.sample_rate_hz == pytest.approx(256e3)


@pytest.mark.parametrize("name", NAMES)
def test_a_train_is_the_sum_of_its_pulses(name: str) -> None:
    # given pulses of several widths, two of which overlap, and one that points down
    model = MODELS[name]
    pulses = [
        TrainPulse(60 * NS, 0.1, 400 * NS),
        TrainPulse(12 * NS, 0.08, 1011.3 * NS),
        TrainPulse(25 * NS, -0.05, 1030 * NS),
    ]
    # when
    one = played(gaussian_train(pulses, model), name)
    # then between the points it is their sum, to straight lines of the narrowest and a step
    times_s = np.linspace(0.0, 1.6e-6, 5001)
    wanted = sum(
        pulse.peak_v * np.exp(-4 * math.log(2) * ((times_s - pulse.centre_s) / pulse.fwhm_s) ** 2)
        for pulse in pulses
    )
    line = math.log(2) / (one.sample_rate_hz * 12 * NS) ** 2
    assert np.max(np.abs(one.at(times_s) - wanted)) < 0.1 * (1.6 * line + 2.0 ** (2 - model.dac_bits))


def test_a_train_of_nothing_is_refused() -> None:
    with pytest.raises(RefusedInput, match="no pulses"):
        gaussian_train([], MODELS["33522B"])


def test_a_bench_plays_it() -> None:
    # given a bench
    with open_bench(simulated()) as bench:
        model = bench.generator_model
        pulse = gaussian_pulse(40 * NS, 20e-3, model, 500 * NS)
        # when
        shot = bench.measure(pulse, WindowRequest(0, 4, 128))
    # then it comes back as played, at the cut, and the window shows it some 18 ns later
    assert isinstance(shot.played, SampledPulse)
    assert shot.played.volts.max() == pytest.approx(20e-3, rel=1e-2)
    peak_s = float(np.argmax(shot.window.volts)) * shot.window.sample_interval_s
    assert peak_s == pytest.approx(518 * NS, abs=15 * NS)


@pytest.mark.parametrize(
    ("fwhm_s", "peak_v", "centre_s", "words"),
    [
        (0.0, 0.1, 1e-6, "both must be finite"),
        (math.nan, 0.1, 1e-6, "both must be finite"),
        (1e-8, 0.0, 1e-6, "both must be finite"),
        (1e-8, math.inf, 1e-6, "both must be finite"),
        (3.9e-9, 0.1, 1e-6, "points 4 ns apart"),
        (20e-9, 0.1, 40e-9, "must begin after the trigger"),
        (20e-9, 0.1, math.nan, "must begin after the trigger"),
        (20e-9, 0.1, math.inf, "must begin after the trigger"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(
    fwhm_s: float, peak_v: float, centre_s: float, words: str
) -> None:
    with pytest.raises(RefusedInput, match=words) as refusal:
        gaussian_pulse(fwhm_s, peak_v, MODELS["33522B"], centre_s)
    assert "\n" not in str(refusal.value)
