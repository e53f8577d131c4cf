"""The plant: who sees what when, what reaches the cut, and draws that depend on nothing but the shot."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest

from belahil.config import BenchConfig, parse_bench
from belahil.errors import ConfigError, InstrumentRefused
from belahil.generators import MODELS, ArbBlock, GeneratorSetting, dac_codes, setting_for
from belahil.stimuli import NoSignal, SampledPulse, Sine
from belahil.values import RangeWindow, Trigger, WindowRequest
from sim.generator_path import generator_path, true_model
from sim.plant import Plant

MODEL = MODELS["33522B"]
NOISY = BenchConfig()
QUIET_RECEIVER = {
    "noise_rms_v_by_code": (0.0,) * 16,
    "gain_by_code": (1.0,) * 16,
    "adc_bits": 16,
    "adc_full_scale_v": 1.0,
}
COUNT_V = 1.0 / 65536
PULSE = SampledPulse(np.array([0.0, 0.1, 0.1, 0.1, 0.0]), 80e6, start_s=100e-9)


def _config(receiver: dict[str, Any] | None = None, **tables: dict[str, Any]) -> BenchConfig:
    config = BenchConfig()
    emulation = msgspec.structs.replace(
        config.emulation,
        receiver=msgspec.structs.replace(config.emulation.receiver, **QUIET_RECEIVER | (receiver or {})),
        generator=msgspec.structs.replace(config.emulation.generator, **tables.pop("hidden", {})),
    )
    changed = {
        name: msgspec.structs.replace(getattr(config, name), **table) for name, table in tables.items()
    }
    return msgspec.structs.replace(config, emulation=emulation, **changed)


def _plant(receiver: dict[str, Any] | None = None, **tables: dict[str, Any]) -> Plant:
    return Plant(_config(receiver, **tables))


def _armed(plant: Plant, trigger: Trigger = "immediate", shot: int = 0, **request: Any) -> RangeWindow | None:
    plant.arm(WindowRequest(shot, 4, trigger=trigger, **request))
    return plant.collect()


def _captured(plant: Plant, trigger: Trigger = "immediate", shot: int = 0, **request: Any) -> RangeWindow:
    plant.arm(WindowRequest(shot, 4, trigger=trigger, **request))
    if trigger == "generator":
        assert plant.trigger()
    window = plant.collect()
    assert window is not None
    return window


# ---- who sees what


@pytest.mark.parametrize(
    ("trigger", "source", "seen"),
    [
        ("immediate", "BUS", False),
        ("immediate", "EXT", False),
        ("immediate", "IMM", False),
        ("generator", "BUS", True),
        ("digitizer", "EXT", True),
        ("digitizer", "BUS", False),
        ("digitizer", "IMM", False),
    ],
)
def test_a_pulse_is_seen_only_by_a_window_with_its_own_trigger(
    trigger: Trigger, source: str, seen: bool
) -> None:
    plant = _plant()
    plant.play(replace(setting_for(PULSE, MODEL), trigger_source=source))
    assert bool(np.any(_captured(plant, trigger).counts)) == seen


@pytest.mark.parametrize("source", ["EXT", "IMM", "TIM"])
def test_a_bus_trigger_starts_only_a_burst_that_waits_for_it(source: str) -> None:
    plant = _plant()
    for setting in (
        replace(setting_for(PULSE, MODEL), trigger_source=source),
        replace(setting_for(PULSE, MODEL), burst=False),
        setting_for(Sine(1e6, 0.1), MODEL),
    ):
        plant.play(setting)
        assert _armed(plant, "generator") is None
        assert not plant.trigger()
        assert plant.collect() is None


def test_a_trigger_before_the_window_is_lost_and_starts_nothing_later() -> None:
    # given a pulse that was triggered while nothing was armed
    plant = _plant()
    plant.play(setting_for(PULSE, MODEL, trigger="generator"))
    assert plant.trigger()
    # then a window armed afterwards waits, and each window needs a trigger of its own
    assert _armed(plant, "generator") is None
    assert plant.trigger()
    assert plant.collect() is not None
    assert plant.trigger()
    assert plant.collect() is None


@pytest.mark.parametrize("trigger", ["immediate", "digitizer"])
def test_a_free_running_sine_is_seen_by_windows_that_start_by_themselves(trigger: Trigger) -> None:
    plant = _plant()
    plant.play(setting_for(Sine(1e6, 0.1), MODEL))
    assert np.ptp(_captured(plant, trigger).volts) > 0.09


@pytest.mark.parametrize(
    "setting",
    [
        GeneratorSetting(),
        replace(setting_for(Sine(1e6, 0.1), MODEL), output=False),
        setting_for(NoSignal(), MODEL),
        GeneratorSetting(output=True, function="OTHER"),
        replace(setting_for(Sine(1e6, 0.1), MODEL), burst=True, trigger_source="BUS"),
    ],
)
def test_what_is_off_or_unknown_is_silent(setting: GeneratorSetting) -> None:
    plant = _plant()
    plant.play(setting_for(Sine(1e6, 0.1), MODEL))
    plant.play(setting)
    assert not np.any(_captured(plant).counts)


def test_a_pulse_with_the_output_off_triggers_a_window_of_nothing() -> None:
    plant = _plant()
    plant.play(replace(setting_for(PULSE, MODEL, trigger="generator"), output=False))
    assert not np.any(_captured(plant, "generator").counts)


def test_a_window_is_handed_over_once_and_can_be_forgotten() -> None:
    plant = _plant()
    plant.arm(WindowRequest(3, 4))
    plant.arm(WindowRequest(4, 4))
    window = plant.collect()
    assert window is not None
    assert window.shot == 4
    assert plant.collect() is None
    plant.play(setting_for(PULSE, MODEL, trigger="generator"))
    for armed in ("generator", "immediate"):
        plant.arm(WindowRequest(5, 4, trigger=armed))
        plant.abort()
        plant.trigger()
        assert plant.collect() is None


@pytest.mark.parametrize(
    ("change", "said", "reason"),
    [
        ({"source": "transmit"}, "source transmit with trigger immediate; allowed: trigger digitizer", 7),
        (
            {"source": "transmit", "trigger": "generator"},
            "source transmit with trigger generator; allowed: trigger digitizer",
            7,
        ),
        (
            {"products": "candidates", "sample_count": 3},
            "3 samples with products candidates; allowed: 4 to 16064",
            4,
        ),
    ],
)
def test_what_only_the_plant_refuses_costs_the_older_window(
    change: dict[str, Any], said: str, reason: int
) -> None:
    plant = _plant()
    plant.arm(WindowRequest(0, 4))
    with pytest.raises(InstrumentRefused, match=said) as caught:
        plant.arm(replace(WindowRequest(1, 4), **change))
    assert caught.value.reason == reason
    # and an older window is gone
    assert plant.collect() is None


# ---- when


def _centroid_s(window: RangeWindow) -> float:
    """Centre of the pulse after the trigger, on the receiver's own grid."""
    times = window.start_s + np.arange(window.counts.size) * window.sample_interval_s
    return float(np.sum(times * window.volts) / np.sum(window.volts))


@pytest.mark.parametrize(
    ("trigger", "delay_s", "trigger_delay_s"),
    [
        ("generator", 0.0, 0.0),
        ("generator", 0.6e-6, 0.0),
        ("generator", 0.0, 0.3e-6),
        ("digitizer", 0.0, 0.0),
        ("digitizer", 0.0, 5.0e-6),
        ("digitizer", 5.01e-6, 5.0e-6),
    ],
)
def test_delays_put_a_pulse_where_they_say(trigger: Trigger, delay_s: float, trigger_delay_s: float) -> None:
    # given a pulse that starts 1 us after its own trigger
    plant = _plant(bench={"trigger_delay_s": trigger_delay_s})
    pulse = replace(PULSE, start_s=1e-6)
    plant.play(setting_for(pulse, MODEL, trigger=trigger))
    # its centre of mass: two samples in, and the filter's group delay at 0 Hz, the sum of -1/pole = 2 / omega
    centre_s = 1e-6 + 2 / 80e6 + 2 / (2 * math.pi * 19e6)
    expected = centre_s - trigger_delay_s if trigger == "generator" else centre_s + trigger_delay_s
    found = []
    for shot in range(200):
        window = _captured(plant, trigger, shot, delay_s=delay_s, sample_count=640)
        assert window.start_s == round(delay_s * 80e6) / 80e6
        found.append((_centroid_s(window) - expected) * 80e6)
    # then it lies up to one sample early, uniformly: the trigger came that long before an edge
    assert -1.01 < min(found) < -0.95
    assert -0.05 < max(found) < 0.01
    assert abs(np.mean(found) + 0.5) < 5 / math.sqrt(12 * 200)


def test_time_moves_by_shots_and_waiting_only() -> None:
    plant = _plant()
    clock = plant.clock
    assert clock.now_s() == 0
    clock.sleep_s(2.5)
    clock.sleep_s(-1.0)
    for shot in range(3):
        _captured(plant, shot=shot)
    plant.play(setting_for(PULSE, MODEL, trigger="generator"))
    assert _armed(plant, "generator") is None
    assert clock.now_s() == pytest.approx(2.8)
    assert plant.housekeeping() == {"uptime_s": clock.now_s(), "window_count": 3.0}


# ---- draws


def _shot(plant: Plant, shot: int, pulse: bool = False) -> RangeWindow:
    plant.play(setting_for(PULSE if pulse else Sine(3e6, 0.1), MODEL, trigger="generator"))
    return _captured(plant, "generator" if pulse else "immediate", shot)


@pytest.mark.parametrize("pulse", [False, True])
def test_shot_500_is_the_same_alone_in_a_row_and_repeated(pulse: bool) -> None:
    # given a plant that goes through many shots, with a request that comes to nothing on the way
    busy = Plant(NOISY)
    for shot in range(495, 500):
        _shot(busy, shot, pulse)
        _shot(busy, shot, not pulse)
    busy.arm(WindowRequest(500, 4, trigger="generator"))
    # then shot 500 is the one of a plant that does nothing else, and so is its repetition
    alone = _shot(Plant(NOISY), 500, pulse)
    assert alone.equals(_shot(busy, 500, pulse))
    assert alone.equals(_shot(busy, 500, pulse))
    # but no other shot, seed or code is
    assert not np.array_equal(alone.counts, _shot(busy, 501, pulse).counts)
    reseeded = msgspec.structs.replace(NOISY, emulation=msgspec.structs.replace(NOISY.emulation, seed=2))
    assert not np.array_equal(alone.counts, _shot(Plant(reseeded), 500, pulse).counts)


def test_the_phase_of_a_sine_is_uniform() -> None:
    plant = _plant()
    plant.play(setting_for(Sine(1e6, 0.2), MODEL))
    turns = []
    for shot in range(400):
        volts = _captured(plant, shot=shot, sample_count=80).volts
        turns.append(np.angle(np.sum(volts * np.exp(-2j * np.pi * np.arange(80) / 80))) / (2 * np.pi) % 1)
    # Kolmogorov and Smirnov: the 1e-4 point of the statistic is 2.23 / sqrt(n)
    ordered = np.sort(turns)
    assert np.max(np.abs(ordered - (np.arange(400) + 0.5) / 400)) < 2.23 / math.sqrt(400)


# ---- how much


# No fraction of the sample rate with a small denominator: the rounding of 16 000 different samples then moves
# a fitted amplitude by sqrt(2 / 12 / 16000) = 0.0032 counts rms, an offset by less; 0.02 counts are six times
# that.
ROUNDING_V = 0.02 * COUNT_V


def _fit(plant: Plant, frequency_hz: float) -> tuple[float, float]:
    """Amplitude and offset of a sine, V."""
    window = _captured(plant, sample_count=16000)
    angle = 2 * np.pi * frequency_hz * np.arange(16000) * 12.5e-9
    design = np.stack([np.sin(angle), np.cos(angle), np.ones(16000)], axis=1)
    sine, cosine, offset = np.linalg.lstsq(design, window.volts)[0]
    return math.hypot(sine, cosine), float(offset)


@pytest.mark.parametrize("attenuation_db", [0.0, 6.0, 20.0])
@pytest.mark.parametrize("input_ohm", [50.0, 25.0, 1e6, math.inf])
@pytest.mark.parametrize("load_ohm", [50.0, 10e3, math.inf])
def test_attenuator_source_and_loads_divide_as_resistors_do(
    load_ohm: float, input_ohm: float, attenuation_db: float
) -> None:
    # given the network of resistors: source, matched T pad, input
    ratio = 10 ** (attenuation_db / 20)
    arm_ohm, shunt_s = 50 * (ratio - 1) / (ratio + 1), (ratio**2 - 1) / (100 * ratio)
    open_v = 0.2 * (1.0 if math.isinf(load_ohm) else (load_ohm + 50) / load_ohm)
    source_s, branch_s = 1 / (50 + arm_ohm), 1 / (arm_ohm + input_ohm)
    middle_v = open_v * source_s / (source_s + shunt_s + branch_s)
    cut_v = middle_v * (1 - arm_ohm * branch_s)
    # when the plant plays into it
    plant = _plant({"input_ohm": input_ohm}, generator={"attenuation_db": attenuation_db})
    plant.play(setting_for(Sine(100_037.1, 0.4), MODEL, load_ohm))
    # then its voltage is at the cut (the filter takes 1e-14 at this frequency)
    assert _fit(plant, 100_037.1)[0] == pytest.approx(cut_v, abs=ROUNDING_V)


@pytest.mark.parametrize("frequency_hz", [100_037.1, 10_000_373.0, 29_999_871.0])
def test_errors_of_the_generator_reach_the_cut(frequency_hz: float) -> None:
    hidden = {"amplitude_error": 0.03, "flatness": -0.1, "bandwidth_hz": 45e6}
    plant = _plant({"cutoff_hz": 19e6, "order": 2}, hidden=hidden)
    plant.play(setting_for(Sine(frequency_hz, 0.4), MODEL))
    filtered = (1 + (frequency_hz / 19e6) ** 4) ** -0.5
    flat = 1 - 0.1 * frequency_hz / 40e6
    passed = (1 + (frequency_hz / 45e6) ** 2) ** -0.5
    expected = 0.2 * 1.03 * flat * passed * filtered
    assert _fit(plant, frequency_hz)[0] == pytest.approx(expected, abs=ROUNDING_V)


@pytest.mark.parametrize(("highpass_hz", "expected_v"), [(0.0, 0.05 * 1.03), (1e3, 0.0)])
def test_an_offset_passes_unless_there_is_a_high_pass(highpass_hz: float, expected_v: float) -> None:
    plant = _plant({"highpass_hz": highpass_hz}, hidden={"amplitude_error": 0.03})
    plant.play(setting_for(Sine(1_000_373.0, 0.1, 0.05), MODEL))
    assert _fit(plant, 1_000_373.0)[1] == pytest.approx(expected_v, abs=ROUNDING_V)


@pytest.mark.parametrize(("bits", "codes"), [(None, 16), (14, 14), (8, 8), (16, 16)])
def test_the_hidden_converter_rounds_a_waveform(bits: int | None, codes: int) -> None:
    path = generator_path(_config(hidden={"bits": bits}))
    relative = 0.9 * np.sin(np.arange(50))
    block = ArbBlock(dac_codes(relative, 16), 80e6)
    setting = GeneratorSetting(True, "ARB", amplitude_vpp=0.2, arb=block, burst=True, trigger_source="BUS")
    played = path.stimulus(setting)
    assert isinstance(played, SampledPulse)
    step = 2 ** (16 - codes)
    expected = np.rint(block.codes / step) * step / 32767 * 0.1
    assert played.volts == pytest.approx(expected, rel=1e-12)


def test_the_hidden_converter_may_be_slower_than_its_name_promises() -> None:
    assert true_model(BenchConfig()) == MODEL
    assert true_model(_config(generator={"driver": "keysight-33600"})) == MODELS["33622A"]
    hidden = true_model(_config(hidden={"bits": 10, "sample_rate_hz": 1e8}))
    assert hidden == replace(MODEL, max_arb_rate_hz=1e8)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[emulation.generator]\namplitude_error = -1.0", "amplitude_error = -1"),
        ("[emulation.generator]\nflatness = -1.4", "flatness = -1.4"),
        (
            "[emulation.generator]\nbandwidth_hz = 1e3\n[emulation.receiver]\nhighpass_hz = 2e3",
            "bandwidth_hz = 1000: must be above highpass_hz = 2000",
        ),
        (
            "[emulation.receiver]\nhighpass_hz = 20e6",
            "highpass_hz = 2e\\+07: must be below cutoff_hz = 1.9e\\+07",
        ),
    ],
)
def test_a_truth_that_cannot_be_is_refused(text: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        Plant(parse_bench(text))
