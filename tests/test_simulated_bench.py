"""The simulated bench from end to end, and its equality with the emulated ones, count by count."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from belahil.bench import open_bench
from belahil.config import BenchConfig, parse_bench
from belahil.errors import (
    BelahilError,
    ConfigError,
    InstrumentError,
    InstrumentRefused,
    InterlockRefused,
    LimitExceeded,
    LinkTimeout,
    RefusedInput,
)
from belahil.generators import MODELS
from belahil.stimuli import NoSignal, SampledPulse, Sine, Stimulus, TransmittedPulse
from belahil.values import Shot, WindowRequest
from sim.build import endpoints
from sim.instruments import SimulatedDigitizer, SimulatedGenerator
from sim.plant import Plant

LINKS = ("simulated", "emulated:serial", "emulated:usb")

ODD = """
[bench]
trigger = "{trigger}"
trigger_delay_s = 25e-9
[generator]
driver = "{driver}"
load_ohm = {load_ohm}
attenuation_db = 6.0
[digitizer]
input_ohm = 1e6
[emulation]
seed = 77
[emulation.generator]
bits = 11
amplitude_error = 0.02
flatness = 0.05
bandwidth_hz = 70e6
[emulation.receiver]
cutoff_hz = 16.3e6
order = 4
highpass_hz = 4e3
small_signal = {{ cubic_per_v2 = -0.5, deadband_v = 2e-5 }}
adc_bits = 13
adc_full_scale_v = 1.7
clock_ppm = 31.0
interleave = {{ gain = 0.01, offset_v = 1e-3, skew_s = 40e-12 }}
input_ohm = 0.9e6
"""
STIMULI: tuple[Stimulus, ...] = (
    NoSignal(),
    Sine(1.25e6, 0.03),
    Sine(21.7e6, 0.2, 0.01),
    SampledPulse(np.hanning(60) * 0.1, 93e6, 200e-9),
    SampledPulse(np.array([0.02, 0.1, -0.07]), 20e6, 50e-9, "hold"),
)


def _on(config: BenchConfig, link: str) -> BenchConfig:
    address = "simulated" if link == "simulated" else "emulated"
    return msgspec.structs.replace(
        config,
        generator=msgspec.structs.replace(config.generator, address=address),
        digitizer=msgspec.structs.replace(config.digitizer, link=link),
    )


def _odd(trigger: str = "generator", driver: str = "keysight-33500", load_ohm: str = "50") -> BenchConfig:
    return parse_bench(ODD.format(trigger=trigger, driver=driver, load_ohm=load_ohm))


def _session(config: BenchConfig) -> list[Shot]:
    with open_bench(config) as bench:
        return [
            bench.measure(stimulus, WindowRequest(3 * place + again, code, 1000, delay_s))
            for place, stimulus in enumerate(STIMULI)
            for again, (code, delay_s) in enumerate([(4, 0.0), (0, 1.3e-6), (15, 3e-3)])
        ]


@pytest.mark.parametrize(
    "config",
    [
        BenchConfig(),
        _odd(),
        _odd("digitizer", "keysight-33600"),
        _odd("generator", "keysight-33600", "inf"),
    ],
    ids=["default", "odd", "digitizer triggers", "high impedance"],
)
def test_simulated_and_emulated_benches_give_equal_counts(config: BenchConfig) -> None:
    # given the same bench file on three links
    simulated, *emulated = (_session(_on(config, link)) for link in LINKS)
    for session in emulated:
        for direct, shot in zip(simulated, session, strict=True):
            # then the windows are equal in every bit, and so is what was played
            assert np.array_equal(direct.window.counts, shot.window.counts)
            assert direct.window.equals(shot.window)
            assert direct.played == shot.played
            assert direct.attempt == shot.attempt == 1
    assert len({shot.window.counts.tobytes() for shot in simulated}) == len(simulated)


def test_a_sine_arrives_with_the_gain_of_the_preset() -> None:
    # given the simulated bench by its name
    with open_bench("simulated") as bench:
        assert bench.source == "simulated"
        assert bench.generator_model == MODELS["33522B"]
        assert all("EMULATED" in identity for identity in bench.identities.values())
        # when 50 mVpp are measured at code 4, far below the cut-off
        shot = bench.measure(Sine(99_991.0, 0.05), WindowRequest(0, 4))
    # then there are 5.19 times 25 mV at the converter, within five standard uncertainties: the density of
    # 0.83 mV rms over 19.9 MHz counts, which is 40 / 19.9 times that of white noise in 40 MHz
    angle = 2 * np.pi * 99_991.0 * np.arange(16064) * shot.window.sample_interval_s
    sine, cosine = np.linalg.lstsq(np.stack([np.sin(angle), np.cos(angle)], 1), shot.window.volts)[0]
    assert math.hypot(sine, cosine) == pytest.approx(
        5.19 * 0.025, abs=5 * 0.83e-3 * math.sqrt(2 * 40 / 19.9 / 16064)
    )
    assert shot.window.saturated == 0


def test_a_seed_is_another_bench_and_a_shot_is_not_its_history() -> None:
    def measured(seed: int | None, shots: list[int]) -> Shot:
        with open_bench("simulated", seed=seed) as bench:
            return [bench.measure(Sine(2e6, 0.05), WindowRequest(shot, 4, 500)) for shot in shots][-1]

    alone = measured(None, [500])
    assert alone.window.equals(measured(1, [*range(490, 500), 500]).window)
    assert not np.array_equal(alone.window.counts, measured(2, [500]).window.counts)


@pytest.mark.parametrize(
    ("stimulus", "request_", "error", "said"),
    [
        (Sine(31e6, 0.1), WindowRequest(0, 4), LimitExceeded, "33522B makes"),
        (Sine(1e6, 0.51), WindowRequest(0, 4), InterlockRefused, "max_vpp = 0.5"),
        (NoSignal(), WindowRequest(0, 16), LimitExceeded, "gain code 16"),
        (NoSignal(), WindowRequest(0, 4, 16065), LimitExceeded, "1 to 16064"),
        (NoSignal(), WindowRequest(2**32, 4), LimitExceeded, "does not fit"),
        (NoSignal(), WindowRequest(0, None), InstrumentRefused, "gain code None"),
        (NoSignal(), WindowRequest(0, 4, delay_s=-1e-9), InstrumentRefused, "delay of -1e-09 s"),
        (NoSignal(), WindowRequest(0, 4, delay_s=math.inf), RefusedInput, "delay_s = inf: must be"),
        (NoSignal(), WindowRequest(0, 4, 3, products="candidates"), InstrumentRefused, "3 samples with"),
        (NoSignal(), WindowRequest(0, 4, source="transmit"), LimitExceeded, "NoSignal with source"),
        (TransmittedPulse(), WindowRequest(0, 4), LimitExceeded, "TransmittedPulse with source = return"),
        (SampledPulse(np.ones(9) * 0.1, 150e6, 7e-9), WindowRequest(0, 4), InstrumentRefused, ""),
    ],
)
@pytest.mark.parametrize("link", LINKS)
def test_benches_refuse_alike_and_work_afterwards(
    link: str, stimulus: Stimulus, request_: WindowRequest, error: type[BelahilError], said: str
) -> None:
    # given a generator whose converter is slower than its name promises
    config = parse_bench("[emulation.generator]\nsample_rate_hz = 100e6")
    with open_bench(_on(config, link)) as bench:
        # when something is asked that cannot be
        with pytest.raises(error) as caught:
            bench.measure(stimulus, request_)
        # then one line says so, with the same number, and the bench still measures
        assert said in str(caught.value)
        assert "\n" not in str(caught.value)
        reasons = {"gain": 3, "delay": 5, "3 samples": 4, "": -222}
        if isinstance(caught.value, InstrumentRefused):
            assert caught.value.reason == next(
                number for start, number in reasons.items() if said.startswith(start)
            )
        assert np.ptp(bench.measure(Sine(1e6, 0.05), WindowRequest(1, 4, 500)).window.volts) > 0.2


def _instruments() -> tuple[Plant, SimulatedGenerator, SimulatedDigitizer]:
    plant = Plant(BenchConfig())
    return plant, SimulatedGenerator(plant, MODELS["33522B"], 50.0), SimulatedDigitizer(plant)


def test_a_window_whose_trigger_does_not_come_times_out_on_the_plants_clock() -> None:
    plant, generator, digitizer = _instruments()
    with pytest.raises(InstrumentError, match="before it was armed"):
        digitizer.read(1.0)
    with pytest.raises(InstrumentRefused, match="trigger ignored"):
        generator.trigger()
    digitizer.arm(WindowRequest(6, 4, trigger="generator"))
    with pytest.raises(LinkTimeout, match=r"shot 6: no trigger came within 1.5 s"):
        digitizer.read(1.5)
    assert plant.clock.now_s() == 1.5
    # and what was given up is not read later
    with pytest.raises(InstrumentError, match="before it was armed"):
        digitizer.read(1.0)


def test_the_output_is_off_until_it_is_switched_on_and_after_closing() -> None:
    # given a plant with a large sine prepared
    _, generator, digitizer = _instruments()

    def span_v(shot: int) -> float:
        digitizer.arm(WindowRequest(shot, 4, 500))
        return float(np.ptp(digitizer.read(1.0).volts))

    generator.prepare(Sine(1e6, 0.2), "immediate")
    assert span_v(0) < 0.1
    # then the receiver sees it between output(True) and close
    generator.output(True)
    assert span_v(1) > 0.9
    generator.prepare(Sine(1e6, 0.1), "immediate")
    assert span_v(2) == pytest.approx(0.519, abs=0.02)
    generator.close()
    assert span_v(3) < 0.1


def test_a_refused_pulse_leaves_what_was_played() -> None:
    _, generator, digitizer = _instruments()
    generator.prepare(Sine(1e6, 0.2), "immediate")
    generator.output(True)
    with pytest.raises(LimitExceeded):
        generator.prepare(SampledPulse(np.ones(5), 300e6), "generator")
    digitizer.arm(WindowRequest(0, 4, 500))
    assert np.ptp(digitizer.read(1.0).volts) > 0.9


def test_endpoints_of_both_links_share_nothing_but_the_file() -> None:
    serial, usb = endpoints(_on(BenchConfig(), LINKS[1])), endpoints(_on(BenchConfig(), LINKS[2]))
    assert serial.serial_url
    assert serial.usb_backend is None
    assert usb.usb_backend is not None
    assert not usb.serial_url
    assert serial.visa_library is not usb.visa_library
    assert serial.clock is not usb.clock
    with pytest.raises(ConfigError, match="emulated:serial and emulated:usb"):
        endpoints(_on(BenchConfig(), "simulated"))
