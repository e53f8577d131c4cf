"""What of a wished pulse a generator can play: least squares, limits, attenuators."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from msgspec import structs
from numpy.typing import NDArray

from belahil import butterworth
from belahil.bench import open_bench, setting_per_cut_volt
from belahil.config import BenchConfig, emulated, simulated
from belahil.errors import LimitExceeded
from belahil.generators import DEFAULT_MODEL, MODELS, per_50_ohm
from belahil.pole_response import response
from belahil.stimuli import SampledPulse, Sine, largest_volts
from belahil.values import WindowRequest
from procedures.playable import PADS_DB, advised_attenuation_db, is_too_faint, playable

NS = 1e-9
RECEIVER = butterworth.poles(19e6, 3)
SLOW, FAST = MODELS["33522B"], MODELS["33622A"]


def bench_with(attenuation_db: float = 0.0, driver: str = "keysight-33500", **keys: float) -> BenchConfig:
    config = simulated()
    part = structs.replace(config.generator, driver=driver, attenuation_db=attenuation_db, **keys)
    return structs.replace(config, generator=part)


def bell(sigma_ns: float, peak_v: float, centre_ns: float = 500.0, tail_ns: float = 0.0) -> SampledPulse:
    """A Gaussian, finely sampled, with or without a one-sided tail."""
    times = np.arange(0.0, 2 * centre_ns, 0.125)
    volts = np.exp(-0.5 * ((times - centre_ns) / sigma_ns) ** 2)
    if tail_ns:
        kernel = np.exp(-np.arange(0.0, 14 * tail_ns, 0.125) / tail_ns)
        volts = np.convolve(volts, kernel)[: times.size]
    return SampledPulse(peak_v * volts / volts.max(), 8e9)


def behind(pulse: SampledPulse, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """The pulse behind the receiver's filter."""
    return response(
        pulse.volts, pulse.sample_rate_hz, pulse.start_s, pulse.interpolation,
        (*pulse.poles, *RECEIVER), times_s,
    )  # fmt: skip


def off_the_curve(pulse: SampledPulse, like: SampledPulse) -> SampledPulse:
    """The plain way: the curve at the generator's instants."""
    times_s = like.start_s + np.arange(like.volts.size) / like.sample_rate_hz
    return SampledPulse(pulse.at(times_s), like.sample_rate_hz, like.start_s, like.interpolation)


TIMES_S = np.arange(300.0, 900.0, 0.7) * NS


@settings(max_examples=40, deadline=None)
@given(
    sigma_ns=st.floats(6.0, 60.0),
    tail_ns=st.floats(0.0, 15.0),
    begin_ns=st.floats(0.0, 20.0),
    pole_hz=st.sampled_from([math.inf, 20e6, 60e6]),
)
def test_lines_of_least_squares_keep_a_pulse_better_than_points_off_its_curve(
    sigma_ns: float, tail_ns: float, begin_ns: float, pole_hz: float
) -> None:
    # given a wished pulse that begins anywhere, and may have passed a pole
    made = bell(sigma_ns, 5e-3, tail_ns=tail_ns)
    poles = () if math.isinf(pole_hz) else (complex(-2 * math.pi * pole_hz),)
    wished = SampledPulse(made.volts, made.sample_rate_hz, begin_ns * NS, "linear", poles)
    # when it is put on the grid of a generator of 250 MSa/s
    found = playable(wished, SLOW, bench_with(20.0))
    # then behind the receiver it is what was wished, to the fourth power of the interval over the width, and
    # to the rounding of the converter, which 15 bits of one sign leave
    wanted = behind(wished, TIMES_S)
    error = np.max(np.abs(behind(found.stimulus, TIMES_S) - wanted)) / wanted.max()
    width_ns = math.hypot(sigma_ns, 8.0)  # of the filter's own response
    assert error < (4.0 / width_ns) ** 4 / 80 + 2e-6
    played = np.max(np.abs(behind(found.played, TIMES_S) - wanted)) / wanted.max()
    assert played < error + 2.0**-15
    # and points off the curve miss it by far more
    plain = behind(off_the_curve(wished, found.stimulus), TIMES_S)
    assume(sigma_ns < 30)
    assert np.max(np.abs(plain - wanted)) / wanted.max() > 3 * error


def test_steps_of_least_squares_are_means_and_keep_the_area() -> None:
    # given a pulse, and a generator that holds its points
    wished = bell(15.0, 5e-3)
    # when it is put on its grid
    found = playable(wished, SLOW, bench_with(20.0), "hold")
    # then each step is the mean of the curve over it, so the area is kept
    area = found.stimulus.volts.sum() / found.stimulus.sample_rate_hz
    assert area == pytest.approx(5e-3 * 15e-9 * math.sqrt(2 * math.pi), rel=1e-6)
    at = int(np.argmax(found.stimulus.volts))
    begin_s = found.stimulus.start_s + at / found.stimulus.sample_rate_hz
    inside = wished.at(begin_s + (np.arange(4000) + 0.5) / 4000 / found.stimulus.sample_rate_hz)
    assert found.stimulus.volts[at] == pytest.approx(inside.mean(), rel=1e-5)


@pytest.mark.parametrize("driver", ["keysight-33500", "keysight-33600"])
@pytest.mark.parametrize("address", ["simulated", "emulated"])
@pytest.mark.parametrize("bandwidth_hz", [math.inf, 30e6])
def test_what_it_says_is_what_the_bench_plays(driver: str, address: str, bandwidth_hz: float) -> None:
    # given a bench with an attenuator, whose generator has a declared bandwidth or none
    config = simulated() if address == "simulated" else emulated()
    part = structs.replace(config.generator, driver=driver, attenuation_db=30.0, bandwidth_hz=bandwidth_hz)
    config = structs.replace(config, generator=part)
    with open_bench(config) as bench:
        found = playable(bell(9.0, 3e-3), bench.generator_model, config)
        # when the pulse is measured
        shot = bench.measure(found.stimulus, WindowRequest(0, 4, 42))
    # then it was played as foretold, with the declared pole, and to the converter's full code
    assert shot.played == found.played
    assert bool(found.played.poles) == math.isfinite(bandwidth_hz)
    assert found.full_range > 0.998


def test_a_declared_bandwidth_acts_on_sines_too() -> None:
    # given the same bench with and without a declared bandwidth
    played = {}
    for bandwidth_hz in (math.inf, 30e6):
        with open_bench(bench_with(bandwidth_hz=bandwidth_hz)) as bench:
            # when a sine at the corner is played
            played[bandwidth_hz] = bench.measure(Sine(30e6, 0.1), WindowRequest(0, 4, 64)).played
    # then it is told 3 dB lower
    wide, narrow = played[math.inf], played[30e6]
    assert isinstance(wide, Sine)
    assert isinstance(narrow, Sine)
    assert narrow.amplitude_vpp == pytest.approx(wide.amplitude_vpp / math.sqrt(2), rel=1e-12)


@settings(max_examples=60, deadline=None)
@given(
    peaks_mv=st.lists(st.floats(1e-4, 14.0), min_size=1, max_size=4),
    fitted_db=st.sampled_from(PADS_DB),
    load_ohm=st.sampled_from([50.0, math.inf, 1e3]),
    driver=st.sampled_from(sorted(DEFAULT_MODEL)),
)
def test_the_advised_attenuator_serves(
    peaks_mv: list[float], fitted_db: float, load_ohm: float, driver: str
) -> None:
    # given echoes of some heights, and whatever attenuator is there now
    model = MODELS[DEFAULT_MODEL[driver]]
    config = bench_with(fitted_db, driver, load_ohm=load_ohm)
    peaks_v = [peak * 1e-3 for peak in peaks_mv]
    # when one is advised
    advised_db = advised_attenuation_db(peaks_v, model, config)
    # then it does not depend on the one that is there, and every echo can be played with it
    assert advised_db == advised_attenuation_db(peaks_v, model, bench_with(0.0, driver, load_ohm=load_ohm))
    if advised_db is None:
        for pad_db in PADS_DB:
            at = bench_with(pad_db, driver, load_ohm=load_ohm)
            # points of least squares may reach 1.37 times as far as the pulse
            most_v = model.max_peak_v * per_50_ohm(load_ohm) / (0.5 + 0.5 * math.sqrt(3)) * (1 - 1e-6)
            too_large = max(peaks_v) * setting_per_cut_volt(at) > most_v
            assert too_large or is_too_faint(bell(10.0, min(peaks_v)), model, at)
        return
    better = bench_with(advised_db, driver, load_ohm=load_ohm)
    for peak_v in peaks_v:
        pulse = bell(10.0, peak_v)
        assert not is_too_faint(pulse, model, better)
        found = playable(pulse, model, better)
        # its points may stay below its peak, where the smallest amplitude fits that
        assert found.full_range > 0.99 * min(1.0, largest_volts(found.stimulus) / peak_v)
        # and without it a faint one is refused in one line that names it
        if is_too_faint(pulse, model, config):
            with pytest.raises(LimitExceeded, match="makes at least") as refused:
                playable(pulse, model, config)
            alone_db = advised_attenuation_db([peak_v], model, config)
            assert f"attenuation_db = {alone_db:g}" in str(refused.value)
            assert "\n" not in str(refused.value)


def test_points_of_a_coarse_grid_that_overshoot_are_playable_behind_the_advised_attenuator() -> None:
    # given a pulse so narrow that its points, 20 ns apart, reach beyond its peak
    model = MODELS["33220A"]
    config = bench_with(0.0, "agilent-33220")
    pulse = bell(12.0, 4.99e-3)
    # when 60 dB would bring its peak just to the generator's largest amplitude
    advised_db = advised_attenuation_db([4.99e-3, 2e-5], model, config)
    # then less is advised, and it can be played
    assert advised_db == 50.0
    assert playable(pulse, model, bench_with(advised_db, "agilent-33220")).full_range > 0.99


def test_what_no_attenuator_helps_is_refused_and_says_so() -> None:
    with pytest.raises(LimitExceeded, match="no attenuator of up to 60 dB would do"):
        playable(bell(10.0, 1e-8), SLOW, bench_with())


@pytest.mark.parametrize(
    ("pulse", "words"),
    [
        (SampledPulse(np.ones(5) * 8.0, 250e6, 1e-6), "at most 10 Vpp; no attenuator helps"),
        (SampledPulse(np.ones(5) * 1e-3, 250e6, -1e-6), "allows 0 to 1000 s"),
        (SampledPulse(np.ones(5000) * 1e-3, 1e6), "holds at most 1000000"),
    ],
)
def test_what_the_generator_cannot_make_is_refused(pulse: SampledPulse, words: str) -> None:
    with pytest.raises(LimitExceeded, match=words):
        playable(pulse, SLOW, bench_with())


def test_an_attenuator_that_is_too_large_is_told_with_one_that_serves() -> None:
    # given an echo from near, behind an attenuator for faint ones
    with pytest.raises(
        LimitExceeded, match=r"a setting of 20 Vpp; 33522B makes at most 10 Vpp; (\d+) dB"
    ) as no:
        playable(bell(10.0, 0.1), SLOW, bench_with(40.0))
    # then what is told does
    advised_db = float(str(no.value).rpartition("; ")[2].split(" dB")[0])
    assert playable(bell(10.0, 0.1), SLOW, bench_with(advised_db)).full_range > 0.99
