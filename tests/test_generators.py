"""Generator grids: one rounding for driver and plant, and refusals that name the limit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from belahil.errors import LimitExceeded, RefusedInput
from belahil.generators import MODELS, model_of, on_grid, open_circuit, per_50_ohm, setting_for, stimulus_of
from belahil.stimuli import (
    Interpolation,
    NoSignal,
    SampledPulse,
    Sine,
    TransmittedPulse,
    largest_volts,
    scaled,
)

MODEL = MODELS["33522B"]


@given(frequency=st.floats(1e-3, 30e6), amplitude=st.floats(1e-3, 9.9), offset=st.floats(-0.04, 0.04))
def test_what_is_on_the_grid_stays_there(frequency: float, amplitude: float, offset: float) -> None:
    once = on_grid(Sine(frequency, amplitude, offset), MODEL)
    assert on_grid(once, MODEL) == once
    assert isinstance(once, Sine)
    assert once.frequency_hz == pytest.approx(frequency, abs=0.6e-6)
    assert once.amplitude_vpp == pytest.approx(amplitude, rel=0.6e-3)


@given(
    volts=st.lists(st.floats(-2.0, 2.0), min_size=2, max_size=40),
    rate=st.floats(1e6, 250e6),
    name=st.sampled_from(["33522B", "33611A"]),
    linear=st.booleans(),
)
def test_a_pulse_is_played_within_a_step_of_the_dac(
    volts: list[float], rate: float, name: str, linear: bool
) -> None:
    # given any pulse the model can make
    model = MODELS[name]
    pulse = SampledPulse(np.array(volts), rate, 2e-6, "linear" if linear else "hold")
    # when it is put on the grid
    played = on_grid(pulse, model)
    # then each point is off by at most one DAC step (the top is clipped), and it begins and ends at zero
    assert isinstance(played, SampledPulse)
    setting = setting_for(pulse, model)
    step = setting.amplitude_vpp / 2 * 2 ** (16 - model.dac_bits) / 32767
    lead = int(played.start_s < pulse.start_s) if abs(volts[0]) <= step else 1
    assert np.max(np.abs(played.volts[lead : lead + len(volts)] - pulse.volts)) <= step * 1.0001
    assert played.volts[0] == played.volts[-1] == 0
    assert abs(played.start_s + lead / played.sample_rate_hz - pulse.start_s) <= model.delay_step_s * 0.501
    assert played.volts.size >= model.min_points


@pytest.mark.parametrize(
    ("interpolation", "before_v"), [("hold", [0.0, 0.0, 0.0]), ("linear", [0.0, 0.5, 0.75])]
)
def test_a_jump_is_played_from_zero_because_a_burst_rests_at_its_first_point(
    interpolation: Interpolation, before_v: list[float]
) -> None:
    # given a pulse that begins with a jump, 1 us after its trigger
    pulse = SampledPulse(np.array([1.0, 0.25]), 1e6, 1e-6, interpolation)
    # when it is put on the grid
    played = on_grid(pulse, MODEL)
    # then the generator rests at zero, and what it plays in the interval before is told
    assert isinstance(played, SampledPulse)
    assert played.start_s == 0
    assert played.volts.tolist() == pytest.approx([0.0, 1.0, 0.25, *[0.0] * 5], abs=2e-5)
    assert played.at(np.array([0.0, 0.5e-6, 0.75e-6])).tolist() == pytest.approx(before_v, abs=2e-5)
    # and from there on it is the pulse that was asked for
    times = np.array([1.0, 1.2, 1.7, 1.999]) * 1e-6 + 1e-10
    assert played.at(times) == pytest.approx(pulse.at(times), abs=1e-3)
    # and it is on the grid now, as is a pulse that rises from zero, or from less than half a step
    assert on_grid(played, MODEL) == played
    rising = on_grid(SampledPulse(np.array([1e-6, 1.0, 0.0]), 1e6), MODEL)
    assert isinstance(rising, SampledPulse)
    assert (rising.start_s, rising.volts.argmax()) == (0, 1)


@pytest.mark.parametrize(
    ("stimulus", "said"),
    [
        (Sine(31e6, 0.1), "31 MHz: 33522B makes 1 µHz to 30 MHz"),
        (Sine(1e6, 0.5e-3), "at least 0.001 Vpp"),
        (Sine(1e6, 9.0, 1.0), "at most 5 V peak"),
        (SampledPulse(np.ones(9), 300e6), "plays at most 2.5e+08 Sa/s"),
        (SampledPulse(np.ones(9), 1e6, -1e-6), "allows 0 to 1000 s"),
        (SampledPulse(np.ones(1_000_001), 1e6, 1e-6), "holds at most 1000000"),
        (
            SampledPulse(np.ones(9), 1e6, 0.9e-6),
            "so a zero goes before it; allowed: start_s of at least one interval, 1e-06 s",
        ),
        (SampledPulse(np.ones(9), 1e6, poles=(-1e7 + 0j,)), "has passed a filter of 1 poles"),
    ],
)
def test_a_refusal_names_the_limit(stimulus: Sine | SampledPulse, said: str) -> None:
    with pytest.raises(LimitExceeded) as caught:
        on_grid(stimulus, MODEL)
    assert said in str(caught.value)


def test_load_setting_scales_limits_and_open_circuit_volts() -> None:
    assert per_50_ohm(50) == 1
    assert per_50_ohm(float("inf")) == 2
    assert open_circuit(50) == 2
    assert open_circuit(float("inf")) == 1
    # 15 Vpp is too much into 50 ohm and fine into an open circuit
    with pytest.raises(LimitExceeded):
        setting_for(Sine(1e6, 15.0), MODEL, 50)
    assert setting_for(Sine(1e6, 15.0), MODEL, float("inf")).amplitude_vpp == 15


def test_quiet_stimuli_keep_their_kind() -> None:
    assert on_grid(TransmittedPulse(), MODEL) == TransmittedPulse()
    assert stimulus_of(setting_for(NoSignal(), MODEL)) == NoSignal()


def test_an_unknown_model_is_refused() -> None:
    assert model_of("Agilent Technologies,33522B,MY1,4.00") is MODEL
    with pytest.raises(LimitExceeded, match="'33250A'"):
        model_of("Agilent Technologies,33250A,0,1")


def test_pulses_hold_or_join_their_points() -> None:
    held = SampledPulse(np.array([1.0, 3.0]), 1.0, 10.0, "hold")
    joined = SampledPulse(np.array([1.0, 3.0]), 1.0, 10.0, "linear")
    times = np.array([9.99, 10.0, 10.5, 11.0, 11.5, 12.0])
    assert held.at(times).tolist() == [0, 1, 1, 3, 3, 0]
    assert joined.at(times).tolist() == [0, 1, 2, 3, 0, 0]
    assert scaled(held, 2.0) == SampledPulse(np.array([2.0, 6.0]), 1.0, 10.0, "hold")
    assert largest_volts(joined) == 3


@pytest.mark.parametrize("bad", [(0.0, 1.0), (1.0, 0.0), (float("nan"), 1.0), (1.0, float("inf"))])
def test_a_sine_must_be_one(bad: tuple[float, float]) -> None:
    with pytest.raises(RefusedInput):
        Sine(*bad)
