"""Every family of generators: its dialect on its emulated instrument, and the plant beneath both."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from belahil.bench import open_bench
from belahil.cli.main import main
from belahil.config import (
    BenchConfig,
    BenchTable,
    DigitizerTable,
    EmulatedGenerator,
    EmulatedReceiver,
    EmulationTable,
    GeneratorTable,
    parse_bench,
)
from belahil.errors import ConfigError, CorruptData, InstrumentRefused, LimitExceeded
from belahil.generators import (
    DEFAULT_MODEL,
    FAMILIES,
    MODELS,
    GeneratorModel,
    GeneratorSetting,
    family_of,
    on_grid,
    per_50_ohm,
    setting_for,
    stimulus_of,
)
from belahil.stimuli import NoSignal, SampledPulse, Sine, Stimulus, scaled
from belahil.values import WindowRequest
from drivers.generators.families import dialect_of
from drivers.generators.verified import VerifiedGenerator
from drivers.scpi import ScpiSession
from drivers.visa_link import VisaLink
from procedures.gaussian_pulses import TrainPulse, gaussian_train
from procedures.playable import playable
from sim.devices.generator_families import generator_device
from sim.plant import PlantClock
from sim.transports.visa_library import EmulatedVisa

ADDRESS = "TCPIP0::emulated::inst0::INSTR"
OTHERS = [family for family in FAMILIES if not family.startswith("keysight")]
PLACES = {"simulated": ("simulated", "simulated"), "serial": ("emulated", "emulated:serial")}
RNG = np.random.default_rng(5)


class Port:
    """Where a generator plays into."""

    def __init__(self) -> None:
        self.setting = GeneratorSetting()
        self.triggers = 0

    def play(self, setting: GeneratorSetting) -> None:
        self.setting = setting

    def trigger(self) -> bool:
        self.triggers += 1
        return True


class Bench:
    """A driver on an emulated instrument, and what is sent between them."""

    def __init__(self, name: str, load_ohm: float = 50.0, largest_v: float = 5.0) -> None:
        self.port = Port()
        self.model = MODELS[name]
        self.device = generator_device(self.model, self.port)
        self.tamper = lambda message: message
        write = self.device.write

        def tampered(data: bytes, end: bool = False) -> None:
            write(self.tamper(data), end)

        self.device.write = tampered  # type: ignore[method-assign]
        self.clock = PlantClock()
        link = VisaLink(ADDRESS, EmulatedVisa(self.clock).plug(ADDRESS, self.device))
        session = ScpiSession(link, self.clock, ADDRESS)
        dialect = dialect_of(family_of(self.model))
        self.driver = VerifiedGenerator(session, dialect, load_ohm, largest_v)


def _asked(device: object, message: str) -> str:
    device.write(message.encode() + b"\n")  # type: ignore[attr-defined]
    answer = device.read()  # type: ignore[attr-defined]
    return "" if answer is None else str(answer.decode("latin-1").strip())


def _fitted(stimulus: Stimulus, model: GeneratorModel) -> Stimulus:
    """Return a stimulus as near as the model can come."""
    if isinstance(stimulus, SampledPulse):
        rate_hz = min(stimulus.sample_rate_hz, model.max_arb_rate_hz)
        shown = stimulus.interpolation if stimulus.interpolation in model.interpolations else "linear"
        return replace(stimulus, sample_rate_hz=rate_hz, interpolation=shown)  # type: ignore[arg-type]
    return stimulus


STIMULI: tuple[Stimulus, ...] = (
    NoSignal(),
    Sine(1e6, 0.05),
    Sine(12.3456789e6, 0.03, -0.0011),
    SampledPulse(RNG.uniform(-0.02, 0.02, 300), 80e6, start_s=2e-6),
    SampledPulse(RNG.uniform(-0.2, 0.2, 5), 33.3e6, 1e-6, "hold"),
    SampledPulse(np.zeros(3), 80e6),
    Sine(1e6, 0.05),
)


def _config(place: str, trigger: str, driver: str, load_ohm: float) -> BenchConfig:
    address, link = PLACES[place]
    return BenchConfig(
        bench=BenchTable(trigger=trigger, trigger_delay_s=0.5e-6),  # type: ignore[arg-type]
        generator=GeneratorTable(driver=driver, address=address, load_ohm=load_ohm, attenuation_db=6.0),
        digitizer=DigitizerTable(link=link),
        emulation=EmulationTable(
            seed=11,
            generator=EmulatedGenerator(bits=10, amplitude_error=0.01, flatness=-0.02, bandwidth_hz=60e6),
            receiver=EmulatedReceiver(cutoff_hz=17.1e6, highpass_hz=5e3, clock_ppm=13.0, input_ohm=52.0),
        ),
    )


@pytest.mark.parametrize(("trigger", "load_ohm"), [("generator", 50.0), ("digitizer", math.inf)])
@pytest.mark.parametrize("driver", OTHERS)
def test_equal_seeds_give_equal_counts(driver: str, trigger: str, load_ohm: float) -> None:
    # given the same hidden truth behind the real driver and without any link
    model, shots = MODELS[DEFAULT_MODEL[driver]], {}
    for place in PLACES:
        with open_bench(_config(place, trigger, driver, load_ohm)) as bench:
            # when the same plan is measured
            shots[place] = [
                bench.measure(_fitted(stimulus, model), WindowRequest(index, 4, 777, delay_s=1e-7))
                for index, stimulus in enumerate(STIMULI)
            ]
    # then each window and what was played are equal, at the first attempt
    for reference, shot in zip(shots["simulated"], shots["serial"], strict=True):
        assert shot.window.equals(reference.window)
        assert shot.played == reference.played
        assert shot.attempt == 1
    # and the pulses did reach the receiver
    quiet, loud = (np.std(shots["serial"][index].window.volts[:500]) for index in (0, 3))
    assert loud > 2 * quiet


_SINES = st.builds(Sine, st.floats(1.0, 20e6), st.floats(45e-3, 0.4), st.floats(-0.05, 0.05))
_PULSES = st.builds(
    SampledPulse,
    st.lists(st.floats(-0.2, 0.2), min_size=2, max_size=40).map(np.array),
    st.floats(1e4, 250e6),
    st.floats(0, 1e-4),
    st.sampled_from(["linear", "hold"]),
).map(lambda one: replace(one, start_s=one.start_s + 1 / one.sample_rate_hz))


@pytest.mark.parametrize("name", [DEFAULT_MODEL[family] for family in OTHERS])
@settings(max_examples=25)
@given(
    plan=st.lists(
        st.tuples(
            st.one_of(_SINES, _PULSES, st.just(NoSignal())), st.sampled_from(["generator", "digitizer"])
        ),
        max_size=5,
    ),
    load_ohm=st.sampled_from([50.0, 75.0, math.inf]),
)
def test_what_is_played_is_what_the_setting_says(
    name: str, plan: list[tuple[Stimulus, str]], load_ohm: float
) -> None:
    bench = Bench(name, load_ohm)
    for asked, trigger in plan:
        stimulus = _fitted(asked, bench.model)
        if isinstance(stimulus, SampledPulse):  # the fitted rate has longer intervals
            stimulus = replace(stimulus, start_s=stimulus.start_s + 1 / stimulus.sample_rate_hz)
        wanted = setting_for(stimulus, bench.model, load_ohm, trigger)
        # when a stimulus is prepared and the output is switched on
        played = bench.driver.prepare(stimulus, trigger)
        bench.driver.output(True)
        # then the instrument plays exactly that, at the first try
        assert stimulus_of(bench.port.setting) == stimulus_of(wanted)
        assert played == on_grid(stimulus, bench.model, load_ohm, trigger)
        if not bench.model.rest_before_on_s:
            assert bench.clock.now_s() == 0
        if isinstance(stimulus, SampledPulse) and trigger == "generator":
            bench.driver.trigger()
            assert bench.port.triggers == 1
            bench.port.triggers = 0
    assert bench.driver.close()
    assert not bench.port.setting.output


@pytest.mark.parametrize("name", [name for family in OTHERS for name in FAMILIES[family]])
def test_a_model_names_itself_and_its_limits_hold(name: str) -> None:
    bench = Bench(name)
    model = bench.model
    assert bench.driver.identity.split(",")[:2] == [model.manufacturer, name]
    assert bench.driver.limits is model
    with pytest.raises(LimitExceeded, match=name):
        bench.driver.prepare(Sine(1.01 * model.max_sine_hz, 0.1), "immediate")
    with pytest.raises(LimitExceeded, match=name):
        bench.driver.prepare(Sine(1e6, 0.9 * model.min_amplitude_vpp), "immediate")
    with pytest.raises(LimitExceeded, match=name):
        bench.driver.prepare(SampledPulse(np.ones(9), 1.01 * model.max_arb_rate_hz, 1e-3), "generator")


@pytest.mark.parametrize("family", OTHERS)
def test_the_load_setting_changes_numbers_and_not_volts(family: str) -> None:
    # given the same open-circuit volts asked of an instrument set to 50 ohm and to high impedance
    open_v = {}
    for load_ohm in (50.0, math.inf):
        bench = Bench(DEFAULT_MODEL[family], load_ohm)
        bench.driver.prepare(scaled(Sine(1e6, 0.1), per_50_ohm(load_ohm)), "immediate")
        bench.driver.output(True)
        # then the setting differs by a factor of two
        assert bench.port.setting.amplitude_vpp == 0.1 * per_50_ohm(load_ohm)
        assert bench.port.setting.load_ohm == load_ohm
        open_v[load_ohm] = bench.port.setting.amplitude_vpp * (2 if load_ohm == 50 else 1)
    assert open_v[50.0] == open_v[math.inf]


def _uploads(message: bytes) -> bool:
    return b"#" in message or b"WAVEDATA," in message


@pytest.mark.parametrize("family", OTHERS)
@pytest.mark.parametrize("count", [20, 3000])
def test_a_block_that_is_damaged_on_its_way_is_found(family: str, count: int) -> None:
    bench = Bench(DEFAULT_MODEL[family])
    rate_hz = min(10e6, bench.model.max_arb_rate_hz)
    pulse = SampledPulse(np.linspace(-0.1, 0.1, count), rate_hz, 1e-6)

    def flipped(message: bytes) -> bytes:
        if not _uploads(message):
            return message
        at = len(message) - 8
        return message[:at] + bytes([message[at] ^ 1]) + message[at + 1 :]

    bench.tamper = flipped
    with pytest.raises((CorruptData, InstrumentRefused)):
        bench.driver.prepare(pulse, "generator")
    assert not bench.port.setting.output
    # and one that is lost, too, though an older one with the same number of points is still there
    bench.tamper = lambda message: message
    bench.driver.prepare(pulse, "generator")
    bench.tamper = lambda message: b"" if _uploads(message) else message
    with pytest.raises((CorruptData, InstrumentRefused)):
        bench.driver.prepare(replace(pulse, volts=np.roll(pulse.volts, 1), start_s=2e-6), "generator")


@pytest.mark.parametrize("family", OTHERS)
def test_a_bench_file_takes_the_family(family: str) -> None:
    assert parse_bench(f'[generator]\ndriver = "{family}"\n').generator.driver == family
    least, most = MODELS[DEFAULT_MODEL[family]].load_span_ohm
    for ohm in (0.9 * least, 1.1 * most):
        with pytest.raises(ConfigError, match=f"allowed: {least:g} to {most:g} ohm, or inf"):
            parse_bench(f'[generator]\ndriver = "{family}"\nload_ohm = {ohm}\n')


# ---- the 33220A


def test_the_33220a_waits_by_zeros_and_plays_by_frequency() -> None:
    # given a pulse that starts 1.01 us after its trigger, at 50 MSa/s
    bench = Bench("33220A")
    pulse = SampledPulse(np.array([0.0, 0.1, 0.2, 0.1, 0.0]), 50e6, 1.01e-6)
    played = bench.driver.prepare(pulse, "generator")
    # then 50 zeros of 20 ns stand before it (half an interval is rounded to even), and no delay
    assert isinstance(played, SampledPulse)
    assert (played.start_s, played.volts.size) == (0.0, 55)
    assert not played.volts[:50].any()
    assert played.volts[50:] == pytest.approx(pulse.volts, abs=0.1 / 8191)
    # and all of it repeats at a frequency on the grid of 1 uHz, no faster than 50 MSa/s
    assert _asked(bench.device, "FREQ?") == "+9.090909090900000E+05"
    assert played.sample_rate_hz == 55 * 909090.90909
    assert _asked(bench.device, "DATA:ATTR:POIN? VOLATILE;:FUNC?;:FUNC:USER?") == "+55;USER;VOLATILE"


@pytest.mark.parametrize(
    ("command", "query", "becomes", "error"),
    [
        ("FREQ 30 MHZ", "FREQ?", 20e6, -222),
        ("VOLT 1 MV", "VOLT?", 10e-3, -222),
        ("VOLT:OFFS 9", "VOLT:OFFS?", 4.95, -222),
        ("FREQ 20E6;:FUNC RAMP", "FREQ?", 200e3, -222),
        ("FREQ 20E6;:FUNC USER", "FREQ?", 6e6, -222),
        ("FUNC SINE", "FREQ?", 1e3, -224),
        ("TRIG:DEL 1E-6", "FREQ?", 1e3, -113),
        ("SOUR1:DATA:ARB X,1,2,3", "FREQ?", 1e3, -113),
        ("FUNC:USER VOLATILE", "FREQ?", 1e3, 785),
        ("DATA:DAC VOLATILE,#13abc", "FREQ?", 1e3, 800),
        ("DATA VOLATILE,0,2", "DATA:ATTR:PTP? VOLATILE", 1.0, -222),
        ("OUTP:LOAD INF;:VOLT:UNIT DBM", "VOLT?", 0.2, -222),
    ],
)
def test_the_33220a_adjusts_and_tells(command: str, query: str, becomes: float, error: int) -> None:
    device = generator_device(MODELS["33220A"], Port())
    device.write(command.encode() + b"\n")
    assert float(_asked(device, query)) == pytest.approx(becomes, rel=1e-12)
    assert int(_asked(device, "SYST:ERR?").split(",")[0]) == error
    assert _asked(device, "SYST:ERR?") == '+0,"No error"'


# ---- the Rigol DG1000Z


def test_the_dg1062z_is_set_from_its_defaults_to_what_is_asked() -> None:
    # given an instrument as a reset leaves it: high impedance, 5 Vpp
    device = generator_device(MODELS["DG1062Z"], Port())
    assert (
        _asked(device, ":OUTP1:LOAD?;:SOUR1:VOLT?;:SOUR1:FREQ?") == "9.900000E+37;5.000000E+00;1.000000E+03"
    )
    device.write(b":OUTP1:LOAD 50\n")
    assert _asked(device, "SOUR1:VOLT?") == "2.500000E+00"
    # when a driver for 50 ohm plays a pulse
    bench = Bench("DG1062Z")
    bench.driver.prepare(SampledPulse(np.array([0.0, 0.1, 0.2, 0.0]), 60e6, 1e-6), "generator")
    bench.driver.output(True)
    # then load, mode, rate, delay and trigger are what it asked for
    assert _asked(bench.device, ":OUTP1?;:OUTP1:LOAD?") == "ON;5.000000E+01"
    assert _asked(bench.device, ":SOUR1:FUNC?;:SOUR1:FUNC:ARB:MODE?;SRAT?") == "USER;SRAT;6.000000E+07"
    assert _asked(bench.device, ":SOUR1:BURS:TRIG:SOUR?;TRIGO?;:SOUR1:BURS:TDEL?") == "MAN;POS;1.000000E-06"
    assert bench.port.setting.arb is not None
    assert bench.port.setting.arb.codes.tolist() == [0, 4096, 8191, 0, 0, 0, 0, 0]


@pytest.mark.parametrize(
    ("command", "query", "becomes", "error"),
    [
        ("FREQ 70 MHZ", "FREQ?", 60e6, -222),
        ("OUTP1:LOAD 50;:SOUR1:VOLT 1 MV;VOLT 0.1 MV", "VOLT?", 1e-3, -222),
        ("FREQ 20E6;:SOUR1:VOLT 20", "VOLT?", 10.0, -222),
        ("VOLT 20;:SOUR1:FREQ 40E6", "VOLT?", 5.0, -221),
        ("FREQ 60E6;:SOUR1:FUNC RAMP", "FREQ?", 1e6, -221),
        ("FUNC SINE", "FREQ?", 1e3, -224),
        ("TRIG1:DEL 1E-6", "FREQ?", 1e3, -113),
        ("SOUR3:FREQ 1", "FREQ?", 1e3, -114),
        ("DATA:DAC VOLATILE,#13abc", "FREQ?", 1e3, -161),
        ("DATA:DAC VOLATILE,1,2,3", "DATA:POIN? VOLATILE", 8192, -222),
    ],
)
def test_the_dg1062z_adjusts_and_tells(command: str, query: str, becomes: float, error: int) -> None:
    device = generator_device(MODELS["DG1062Z"], Port())
    device.write(command.encode() + b"\n")
    assert float(_asked(device, query)) == pytest.approx(becomes, rel=1e-6)
    assert int(_asked(device, "SYST:ERR?").split(",")[0]) == error
    assert _asked(device, "SYST:ERR?") == '0,"No error"'


def test_the_dg1062z_makes_8192_points_of_fewer_unless_the_rate_plays_them() -> None:
    device = generator_device(MODELS["DG1062Z"], Port())
    device.write(b"DATA:DAC VOLATILE," + b",".join(b"%d" % (1000 * one) for one in range(10)) + b"\n")
    assert _asked(device, "DATA:POIN? VOLATILE;:FUNC:ARB:MODE?;:FUNC?") == "8192;FREQ;USER"
    assert _asked(device, "DATA:VAL? VOLATILE,8192") == "9000"
    device.write(b"FUNC:ARB:MODE SRAT;:DATA:DAC VOLATILE," + b",".join([b"8192"] * 10) + b"\n")
    assert _asked(device, "DATA:POIN? VOLATILE;:DATA:LOAD? VOLATILE") == "10;1"
    # and packages of DAC16 are one waveform, played by its rate
    device.write(b"FUNC:ARB:MODE FREQ\n")
    device.write(b"TRAC:DATA:DAC16 VOLATILE,CON,#216" + b"\x00\x20" * 8 + b"\n")
    device.write(b"TRAC:DATA:DAC16 VOLATILE,END,#216" + b"\xff\x3f" * 8 + b"\n")
    assert _asked(device, "DATA:POIN? VOLATILE;:FUNC:ARB:MODE?;:DATA:VAL? VOLATILE,16") == "16;SRAT;16383"


def test_a_sine_of_the_dg1062z_is_smaller_the_faster_it_is() -> None:
    model = MODELS["DG1062Z"]
    assert [model.max_vpp_at(hertz) for hertz in (10e6, 11e6, 31e6)] == [10.0, 5.0, 2.5]
    with pytest.raises(LimitExceeded, match=r"DG1062Z makes at most 2\.5 Vpp there into 50 ohm"):
        on_grid(Sine(40e6, 3.0), model)
    # and going up and down in frequency never asks for too much on the way
    bench = Bench("DG1062Z")
    for sine in (Sine(1e6, 9.0), Sine(40e6, 2.0), Sine(1e6, 9.0), Sine(20e6, 4.0), Sine(2e6, 0.1, 1.0)):
        bench.driver.prepare(sine, "immediate")
        assert bench.clock.now_s() == 0
        assert _asked(bench.device, "SYST:ERR?") == '0,"No error"'


# ---- what procedures ask of every family


@pytest.mark.parametrize("family", OTHERS)
def test_a_gaussian_is_played_where_it_was_asked_for(family: str) -> None:
    # given two Gaussians of 200 ns, the second of them early and late on the grid of points
    model = MODELS[DEFAULT_MODEL[family]]
    pulses = (TrainPulse(200e-9, 0.1, 3.0e-6), TrainPulse(200e-9, -0.05, 5.0123e-6))
    # when they are sampled for this model and rounded to what it plays
    train = gaussian_train(pulses, model)
    played = on_grid(train, model)
    assert isinstance(played, SampledPulse)
    # then straight lines (ln 2 (h / fwhm)^2 of the peak), codes (half a step of the amplitude) and a start
    # moved to its grid (half of it, along the steepest slope) are all that differs
    h = 1 / train.sample_rate_hz
    step_v = 0.2 / 2 / 2 ** (model.dac_bits - 1)
    steepest = 0.1 * 1.43 / 200e-9
    moved_s = abs(model.started_s(train.start_s, train.sample_rate_hz) - train.start_s)
    off = 0.1 * math.log(2) * (h / 200e-9) ** 2 + 2 * step_v + steepest * (moved_s + 1e-12)
    times_s = np.linspace(2e-6, 6e-6, 4001)
    asked = sum(
        one.peak_v * np.exp(-4 * math.log(2) * ((times_s - one.centre_s) / one.fwhm_s) ** 2) for one in pulses
    )
    assert np.max(np.abs(played.at(times_s) - asked)) < off
    assert off < 0.01


@pytest.mark.parametrize("family", OTHERS)
def test_an_echo_is_made_playable(family: str) -> None:
    # given an echo at 80 MSa/s that no generator's grid fits
    model = MODELS[DEFAULT_MODEL[family]]
    times_s = np.arange(400) / 80e6
    wished = SampledPulse(0.1 * np.exp(-0.5 * ((times_s - 2.5e-6) / 150e-9) ** 2), 80e6, 1.234e-6)
    # when it is fitted to what the generator plays
    made = playable(wished, model, _config("simulated", "generator", family, 50.0))
    # then what is played is close to it, and the setting holds its points
    places_s = np.linspace(1e-6, 7e-6, 2001)
    assert np.max(np.abs(made.played.at(places_s) - wished.at(places_s))) < 2e-4
    assert made.full_range > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("family", OTHERS)
def test_a_receiver_is_characterized(family: str, tmp_path: Path) -> None:
    # given the emulated bench of the family behind 20 dB
    file = tmp_path / "bench.toml"
    file.write_text(f'[generator]\ndriver = "{family}"\nattenuation_db = 20.0\n')
    words = "--codes 4 --amplitudes-mvpp 200 --frequencies-mhz 1,4,8,12,16,19 --dark-windows 2 --quiet"
    # when its receiver is characterized in a few windows
    out = tmp_path / "run"
    assert main(["characterize", "--bench", str(file), *words.split(), "--out", str(out)]) == 0
    # then the cut-off is that of the preset
    summary = json.loads((out / "summary.json").read_text())
    cutoff = summary["results"]["gain_codes"][0]["cutoff"]
    assert abs(cutoff["value"] - 19e6) < 5 * cutoff["standard_uncertainty"] < 1e5
    assert DEFAULT_MODEL[family] in summary["instruments"]["generator"]
