"""The receiver model: each effect beside its formula, and none that is absent."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from belahil.config import Interleave, SmallSignal, simulated
from belahil.errors import ConfigError
from belahil.pole_response import SampledNoise, autocovariance
from belahil.receiver import BELA_GRM
from belahil.receiver_truth import ReceiverTruth, receiver_truth
from belahil.stimuli import NoSignal, SampledPulse, Sine, Stimulus
from belahil.values import RangeWindow, WindowRequest
from sim import converter, receiver_model
from sim.converter import Quantizer, SampleGrid
from sim.draws import Draws
from sim.receiver_model import ReceiverModel

QUIET = msgspec.structs.replace(
    receiver_truth(simulated()),
    noise_rms_v_by_code=(0.0,) * 16,
    gain_by_code=(1.0,) * 16,
    adc_bits=16,
    adc_full_scale_v=0.2,
)
COUNT_V = 0.2 / 65536


def _model(**changes: Any) -> ReceiverModel:
    return ReceiverModel(msgspec.structs.replace(QUIET, **changes), BELA_GRM.digitizer)


def _window(model: ReceiverModel, stimulus: Any, shot: int = 0, code: int = 4, **request: Any) -> RangeWindow:
    return model.window(stimulus, WindowRequest(shot, code, **request), Draws(1, shot))


def _phase(shot: int) -> float:
    return 2 * np.pi * Draws(1, shot).uniform("phase")


# ---- when it samples


@given(st.floats(-1e-3, 1e-3), st.floats(-1e-9, 1e-9), st.integers(1, 700), st.floats(0, 3e-3))
def test_a_sample_is_where_clock_and_skew_put_it(
    error: float, skew_s: float, count: int, first_s: float
) -> None:
    grid = SampleGrid(12.5e-9 / (1 + error), skew_s)
    times = grid.times_s(count, first_s)
    for n in range(count):
        expected = first_s + n * 12.5e-9 / (1 + error) + (skew_s / 2 if n % 2 == 0 else -skew_s / 2)
        assert times[n] == pytest.approx(expected, abs=1e-18)  # a few last digits of 3 ms


@pytest.mark.parametrize("skew_s", [0.0, 50e-12])
@pytest.mark.parametrize("frequency_hz", [1e-3, 99_999.7, 13.1e6, 38e6, 119e6])
def test_the_fast_sine_is_the_sine(frequency_hz: float, skew_s: float) -> None:
    # given the sine of every sample by itself
    grid = SampleGrid(12.5e-9 / (1 + 50e-6), skew_s)
    angle = 2 * np.pi * frequency_hz * grid.times_s(16064) + 1.25
    # when it is made from two short tables
    made = grid.sine(16064, frequency_hz, 1.25)
    # then they differ by the rounding of the angles, of which each form has three
    assert np.max(np.abs(made - np.sin(angle))) < 6 * np.finfo(float).eps * np.max(angle)


def test_the_clock_error_changes_the_apparent_frequency() -> None:
    # given a receiver whose clock is fast by 100 ppm: it samples too often, so a sine looks slow
    window = _window(_model(clock_ppm=100.0), Sine(10e6, 0.15))
    apparent = np.arange(16064) * window.sample_interval_s
    wanted = 0.075 * np.sin(2 * np.pi * 10e6 / (1 + 100e-6) * apparent + _turned(10e6, 0))
    passed = wanted * _butterworth(10e6)
    assert np.max(np.abs(window.volts - passed)) < 0.51 * COUNT_V


def _butterworth(frequency_hz: float) -> float:
    return float((1 + (frequency_hz / 19e6) ** 6) ** -0.5)


def _turned(frequency_hz: float, shot: int) -> float:
    b, a = signal.butter(3, 2 * np.pi * 19e6, analog=True)
    return _phase(shot) + float(np.angle(signal.freqs(b, a, [2 * np.pi * frequency_hz])[1][0]))


# ---- the filter


@pytest.mark.parametrize("highpass_hz", [0.0, 600e3])
@pytest.mark.parametrize(
    ("order", "cutoff_hz", "frequency_hz"), [(1, 8e6, 3e6), (3, 6e6, 9e6), (4, 12e6, 1e6)]
)
def test_a_sine_is_what_a_long_run_settles_to(
    order: int, cutoff_hz: float, frequency_hz: float, highpass_hz: float
) -> None:
    # given a sine with an offset, run through the filter from rest by lsim until everything has died out
    zeros, poles, gain = signal.butter(order, 2 * np.pi * cutoff_hz * 1e-9, analog=True, output="zpk")
    if highpass_hz:
        zeros, poles = np.append(zeros, 0), np.append(poles, -2 * np.pi * highpass_hz * 1e-9)
    omega = 2 * np.pi * frequency_hz * 1e-9
    steps = int(np.ceil(omega * 12.5 / 0.004))
    times_ns = np.arange(-400 * steps, 64 * steps) * (12.5 / steps)
    input_v = 0.01 + 0.08 * np.sin(omega * times_ns + _phase(7))
    system = signal.ZerosPolesGain(zeros, poles, gain).to_ss()
    settled = signal.lsim(system, input_v, times_ns - times_ns[0])[1][400 * steps :: steps]
    # when the model digitizes it, then it agrees to the rounding of a count (the lines between the points
    # of lsim miss the sine by (omega step)^2 / 8 of 0.08 V, and exp(-18.8) of the start is left: 0.06 counts)
    model = _model(order=order, cutoff_hz=cutoff_hz, highpass_hz=highpass_hz)
    window = _window(model, Sine(frequency_hz, 0.16, 0.01), shot=7, sample_count=64)
    assert np.max(np.abs(window.volts - settled)) < 0.56 * COUNT_V


# ---- between filter and converter


def test_the_dead_zone_and_the_cubic_term_act_on_the_input_referred_voltage() -> None:
    # given the voltage behind the filter from a linear receiver, and one with both effects and a gain of 2.5
    linear = _window(_model(), Sine(2e6, 0.05)).volts
    small_signal = SmallSignal(cubic_per_v2=-30.0, deadband_v=2e-3)
    gain = (2.5,) * 16
    bent = _window(_model(small_signal=small_signal, gain_by_code=gain), Sine(2e6, 0.05)).volts
    # when the formulas are applied sample by sample
    expected = []
    for u in linear.tolist():
        dead = 0.0 if abs(u) < 2e-3 else u - (2e-3 if u > 0 else -2e-3)
        expected.append(2.5 * (dead - 30.0 * dead**3))
    # then they agree to the rounding of both
    assert np.max(np.abs(bent - np.array(expected))) < (0.5 * 2.5 + 0.5) * COUNT_V


def test_gain_is_that_of_the_code() -> None:
    model = _model(gain_by_code=tuple(0.5 + 0.1 * code for code in range(16)))
    for code in (0, 9, 15):
        window = _window(model, Sine(1e5, 0.05), code=code)
        assert window.gain_code == code
        assert np.ptp(window.volts) == pytest.approx(0.05 * (0.5 + 0.1 * code), abs=2 * COUNT_V)


def test_the_two_converters_differ_as_declared() -> None:
    # given a sine digitized by equal converters, and by converters that differ in gain and offset
    equal = _window(_model(), Sine(3e6, 0.1)).volts
    mismatch = Interleave(gain=0.02, offset_v=1e-3)
    window = _window(_model(interleave=mismatch), Sine(3e6, 0.1)).volts
    # then even samples have plus half of each, odd ones minus half
    assert np.max(np.abs(window[0::2] - (equal[0::2] * 1.01 + 0.5e-3))) < 1.02 * COUNT_V
    assert np.max(np.abs(window[1::2] - (equal[1::2] * 0.99 - 0.5e-3))) < 1.02 * COUNT_V


def test_a_skew_samples_even_later_and_odd_earlier() -> None:
    skew_s = 200e-12
    window = _window(_model(interleave=Interleave(skew_s=skew_s)), Sine(8e6, 0.15)).volts
    times = np.arange(16064) * 12.5e-9 + np.where(np.arange(16064) % 2, -skew_s / 2, skew_s / 2)
    expected = 0.075 * _butterworth(8e6) * np.sin(2 * np.pi * 8e6 * times + _turned(8e6, 0))
    assert np.max(np.abs(window - expected)) < 0.51 * COUNT_V


def test_a_mismatch_of_four_converters_is_refused() -> None:
    four = replace(BELA_GRM.digitizer, converters=4)
    ReceiverModel(QUIET, four)
    with pytest.raises(ConfigError, match="4 converters"):
        ReceiverModel(msgspec.structs.replace(QUIET, interleave=Interleave(gain=0.01)), four)


# ---- quantization


@given(
    st.integers(2, 16),
    st.floats(0.1, 10.0),
    st.lists(st.floats(-20, 20), min_size=1, max_size=40),
)
def test_a_code_is_the_nearest_and_clips(bits: int, full_scale_v: float, volts: list[float]) -> None:
    quantizer = Quantizer(full_scale_v, bits)
    counts, saturated = quantizer.counts(np.array(volts))
    lowest, highest = (-32768, 32767) if bits == 16 else (0, 2**bits - 1)
    beyond = 0
    for count, volt in zip(counts.tolist(), volts, strict=True):
        code = round(volt / (full_scale_v / 2**bits)) + quantizer.zero_count
        assert count == min(max(code, lowest), highest)
        beyond += code != count
    assert saturated == beyond
    assert counts.dtype == np.int16


@pytest.mark.parametrize("bits", [2, 12, 15, 16])
def test_a_window_tells_its_scale_and_what_was_clipped(bits: int) -> None:
    # given a sine of twice the full scale
    model = _model(adc_bits=bits, cutoff_hz=100e6)
    window = _window(model, Sine(1e5, 0.4))
    # then its codes span all there are, a window says how many samples lay beyond, and the spec is true
    assert int(window.counts.max()) - int(window.counts.min()) == 2**bits - 1
    assert window.saturated > 0.5 * window.counts.size
    assert window.volts_per_count == 0.2 / 2**bits
    assert window.zero_count == (0 if bits == 16 else 2 ** (bits - 1))
    assert model.spec.bits == bits
    assert not window.counts.flags.writeable
    # and 0 V is the code of zero
    assert np.all(_window(model, NoSignal()).volts == 0)


# ---- noise


@pytest.mark.parametrize("highpass_hz", [0.0, 20e3])
def test_noise_has_its_rms_and_the_colour_of_the_filter(highpass_hz: float) -> None:
    # given 2 mV of noise behind the filter in 40 windows
    rms_v, shots, count = 2e-3, 40, 16064
    model = _model(noise_rms_v_by_code=(rms_v,) * 16, highpass_hz=highpass_hz)
    noise = np.stack([_window(model, NoSignal(), shot).volts for shot in range(shots)])
    # when its covariance is taken at a few lags, beside that of white noise behind the filter
    wanted = autocovariance(model.poles, np.arange(200) * 12.5e-9, model.zeros)
    wanted *= rms_v**2 / wanted[0]
    around = np.concatenate([wanted[:0:-1], wanted])
    for lag in range(6):
        found = np.mean(noise[:, : count - lag] * noise[:, lag:])
        # then they agree within five standard deviations by Bartlett's formula for Gaussian noise
        doubled = np.sum(around[2 * lag :] * around[: around.size - 2 * lag])
        variance = (np.sum(around**2) + doubled) / (shots * count)
        expected = wanted[lag] + (COUNT_V**2 / 12 if lag == 0 else 0.0)
        assert abs(found - expected) < 5 * np.sqrt(variance)


def test_noise_is_that_of_the_code() -> None:
    model = _model(noise_rms_v_by_code=tuple(1e-3 * (1 + code) for code in range(16)))
    low, high = (_window(model, NoSignal(), code=code).volts for code in (0, 15))
    # the same draw, 16 times as large
    assert np.max(np.abs(high - 16 * low)) < (0.5 + 8) * COUNT_V


# ---- only what is there

EVERYTHING: dict[str, Any] = {
    "small_signal": SmallSignal(cubic_per_v2=1.0, deadband_v=1e-4),
    "gain_by_code": (1.2,) * 16,
    "noise_rms_v_by_code": (1e-3,) * 16,
    "interleave": Interleave(gain=0.01, offset_v=1e-3, skew_s=1e-11),
}
EFFECTS: dict[str, dict[str, Any]] = {
    "dead_zone": {"small_signal": SmallSignal(cubic_per_v2=1.0)},
    "cubic": {"small_signal": SmallSignal(deadband_v=1e-4)},
    "amplify": {"gain_by_code": (1.0,) * 16},
    "add_noise": {"noise_rms_v_by_code": (0.0,) * 16},
    "mismatch_gain": {"interleave": Interleave(offset_v=1e-3, skew_s=1e-11)},
    "mismatch_offset": {"interleave": Interleave(gain=0.01, skew_s=1e-11)},
}


def _called(*_: object, **__: object) -> None:
    raise AssertionError("called")


@pytest.mark.parametrize("effect", EFFECTS)
def test_what_is_absent_is_never_called(effect: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # given an effect that must not be called
    monkeypatch.setattr(receiver_model, effect, _called)
    # then a receiver that has everything calls it, and one that has all but this does not
    with pytest.raises(AssertionError, match="called"):
        _window(_model(**EVERYTHING), Sine(1e6, 0.1))
    _window(_model(**EVERYTHING | EFFECTS[effect]), Sine(1e6, 0.1))


def test_without_noise_none_is_prepared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(receiver_model, "SampledNoise", _called)
    _window(_model(), Sine(1e6, 0.1))
    with pytest.raises(AssertionError, match="called"):
        _model(noise_rms_v_by_code=(1e-3,) * 16)


def test_a_code_without_noise_draws_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(receiver_model, "add_noise", _called)
    model = _model(noise_rms_v_by_code=(0.0,) * 15 + (1e-3,))
    assert not np.any(_window(model, NoSignal(), code=4).counts)
    with pytest.raises(AssertionError, match="called"):
        _window(model, NoSignal(), code=15)


@pytest.mark.parametrize(
    "stimulus", [Sine(1e6, 0.1), NoSignal(), SampledPulse(np.array([0.0, 0.1, 0.0]), 40e6)]
)
def test_neutral_equals_absent_bit_for_bit(stimulus: Stimulus) -> None:
    # given a receiver without any effect, and one that carries out all of them with neutral numbers
    absent, neutral = _model(), _model()
    noise = SampledNoise(neutral.poles, 0, 12.5e-9)
    neutral.effects[4] = (
        partial(receiver_model.dead_zone, deadband_v=0.0),
        partial(receiver_model.cubic, cubic_per_v2=0.0),
        partial(receiver_model.amplify, gain=1.0),
        partial(receiver_model.add_noise, noise=noise, rms_v=0.0),
        partial(converter.mismatch_gain, gain=0.0),
        partial(converter.mismatch_offset, offset_v=0.0),
    )
    # then their windows are equal, and the absent ones are not on the list at all
    assert absent.effects[4] == ()
    assert _window(absent, stimulus).equals(_window(neutral, stimulus))


def test_removing_an_effect_leaves_the_draws_of_the_others() -> None:
    # given a noisy sine, the same without noise, and the same noise without a sine
    noisy = _model(noise_rms_v_by_code=(1e-3,) * 16)
    sine = Sine(5e6, 0.1)
    both = _window(noisy, sine, shot=9).volts
    # then phase and noise are the same in all three
    apart = _window(_model(), sine, shot=9).volts + _window(noisy, NoSignal(), shot=9).volts
    assert np.max(np.abs(both - apart)) < 1.51 * COUNT_V
    # and an offset of the converters moves the counts, no draw
    moved = _model(noise_rms_v_by_code=(1e-3,) * 16, interleave=Interleave(offset_v=6 * COUNT_V))
    step = _window(moved, sine, shot=9).counts - _window(noisy, sine, shot=9).counts
    assert np.all(step[0::2] == 3)
    assert np.all(step[1::2] == -3)


def test_draws_belong_to_seed_shot_and_effect() -> None:
    kinds = [
        Draws(seed, shot).uniform(effect)
        for seed in (0, 1, 2**70)
        for shot in (0, 1, 2**32 - 1)
        for effect in ("phase", "noise")
    ]
    assert len(set(kinds)) == len(kinds)
    assert all(0 <= number < 1 for number in kinds)
    assert Draws(3, 500).uniform("phase") == Draws(3, 500).stream("phase").random()


def test_a_truth_is_compared_by_value() -> None:
    assert _model() == _model()
    assert _model() != _model(clock_ppm=1.0)
    assert isinstance(_model().truth, ReceiverTruth)
