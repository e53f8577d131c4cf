"""Generator grids: one rounding for driver and plant, and refusals that name the limit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from belahil.errors import LimitExceeded, RefusedInput
from belahil.generators import MODELS, model_of, on_grid, open_circuit, per_50_ohm, setting_for, stimulus_of
from belahil.stimuli import NoSignal, SampledPulse, Sine, TransmittedPulse, largest_volts, scaled

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
    pulse = SampledPulse(np.array(volts), rate, 0.0, "linear" if linear else "hold")
    # when it is put on the grid
    played = on_grid(pulse, model)
    # then each point is off by at most one DAC step (the top is clipped), and it ends at zero
    assert isinstance(played, SampledPulse)
    setting = setting_for(pulse, model)
    step = setting.amplitude_vpp / 2 * 2 ** (16 - model.dac_bits) / 32767
    assert np.max(np.abs(played.volts[: len(volts)] - pulse.volts)) <= step * 1.0001
    assert played.volts[-1] == 0
    assert played.volts.size >= model.min_points


@pytest.mark.parametrize(
    ("stimulus", "said"),
    [
        (Sine(31e6, 0.1), "31 MHz: 33522B makes 1 µHz to 30 MHz"),
        (Sine(1e6, 0.5e-3), "at least 0.001 Vpp"),
        (Sine(1e6, 9.0, 1.0), "at most 5 V peak"),
        (SampledPulse(np.ones(9), 300e6), "plays at most 2.5e+08 Sa/s"),
        (SampledPulse(np.ones(9), 1e6, -1e-6), "allows 0 to 1000 s"),
        (SampledPulse(np.ones(1_000_001), 1e6), "holds at most 1000000"),
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
