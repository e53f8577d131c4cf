"""The emulated generator: messages set what the plant is told to play, and what the instrument answers."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as stnp

from belahil.errors import LimitExceeded
from belahil.generators import (
    MODELS,
    ArbBlock,
    GeneratorSetting,
    open_circuit,
    round_to_step,
    setting_for,
    stimulus_of,
)
from belahil.stimuli import NoSignal, SampledPulse, Sine, Stimulus
from sim.devices.generator import NOT_PLAYED_BIT, GeneratorDevice
from sim.devices.generator_arbs import ArbMemory
from sim.devices.generator_channel import Channel
from sim.devices.generator_output import is_played

BUILT_IN = r'"INT:\BUILTIN\EXP_RISE.ARB"'


class Recorder:
    """A plant's generator side that remembers."""

    def __init__(self) -> None:
        self.played: list[GeneratorSetting] = []
        self.triggers = 0
        self.takes_triggers = True

    @property
    def setting(self) -> GeneratorSetting:
        return self.played[-1] if self.played else GeneratorSetting()

    def play(self, setting: GeneratorSetting) -> None:
        self.played.append(setting)

    def trigger(self) -> bool:
        self.triggers += self.takes_triggers
        return self.takes_triggers


class Bench:
    """A generator with somebody who talks to it."""

    def __init__(self, name: str = "33522B") -> None:
        self.port = Recorder()
        self.device = GeneratorDevice(MODELS[name], self.port)

    def send(self, *messages: str | bytes) -> list[str]:
        for message in messages:
            data = message if isinstance(message, bytes) else message.encode()
            self.device.write(data + b"\n", end=True)
        return [answer.decode().rstrip("\n") for answer in iter(self.device.read, None)]

    def ask(self, *messages: str) -> str:
        (answer,) = self.send(*messages)
        return answer

    def errors(self) -> list[int]:
        found = []
        while (code := int(self.ask("SYST:ERR?").split(",")[0])) != 0:
            found.append(code)
        return found


def block(data: bytes) -> bytes:
    length = str(len(data))
    return f"#{len(length)}{length}".encode() + data


def messages_for(setting: GeneratorSetting) -> list[str | bytes]:
    """Write a setting as commands, in an order in which none exceeds a limit."""
    load = "INF" if math.isinf(setting.load_ohm) else repr(setting.load_ohm)
    messages: list[str | bytes] = [
        "*RST",
        f"OUTP1:LOAD {load}",
        "VOLT MIN",
        f"VOLT:OFFS {setting.offset_v!r}",
        f"SOUR1:FREQ {setting.frequency_hz!r};VOLT {setting.amplitude_vpp!r}",
        f"TRIG:SOUR {setting.trigger_source};DEL {setting.trigger_delay_s!r}",
        f"BURS:STAT {setting.burst:d};NCYC 1",
    ]
    if setting.arb is not None:
        codes = setting.arb.codes.astype("<i2").tobytes()
        messages += [
            "FORM:BORD SWAP;:DATA:VOL:CLE",
            b"DATA:ARB:DAC PULSE," + block(codes),
            f"FUNC:ARB PULSE;ARB:SRAT {setting.arb.sample_rate_hz!r}",
            f"FUNC:ARB:FILT {'NORM' if setting.arb.interpolation == 'linear' else 'STEP'}",
        ]
    return [*messages, f"FUNC {setting.function}", f"OUTP {setting.output:d}"]


sines = st.builds(
    Sine,
    frequency_hz=st.floats(1e-6, 30e6),
    amplitude_vpp=st.floats(2e-3, 5.0),
    offset_v=st.floats(-1.0, 1.0),
)
pulses = st.builds(
    SampledPulse,
    volts=stnp.arrays(np.float64, st.integers(2, 40), elements=st.floats(-2.0, 2.0)),
    sample_rate_hz=st.floats(1.0, 250e6),
    start_s=st.floats(0.0, 1e-3),
    interpolation=st.sampled_from(["linear", "hold"]),
)
# It may begin with a jump, and so not before one interval of the rate as it is rounded, to 1 uHz.
pulses = pulses.map(lambda one: replace(one, start_s=one.start_s + (1 + 1e-6) / one.sample_rate_hz))


@settings(deadline=None)
@given(
    stimulus=sines | pulses | st.just(NoSignal()),
    name=st.sampled_from(["33522B", "33622A"]),
    load_ohm=st.sampled_from([50.0, 75.0, 1e3, math.inf]),
    trigger=st.sampled_from(["generator", "digitizer"]),
)
def test_what_a_driver_wants_to_play_is_what_the_plant_is_told(
    stimulus: Stimulus, name: str, load_ohm: float, trigger: str
) -> None:
    # given the setting that plays a stimulus
    wanted = setting_for(stimulus, MODELS[name], load_ohm, trigger)
    bench = Bench(name)
    # when it is sent as text and blocks, twice to see that nothing is left from before
    for _ in range(2):
        bench.send(*messages_for(wanted))
    # then the plant has an equal one, and the instrument did not complain
    assert bench.errors() == []
    assert bench.port.setting == wanted
    assert bench.device.status.questionable.condition == 0


def test_the_identity_names_a_known_model_and_says_that_it_is_emulated() -> None:
    assert Bench("33622A").ask("*IDN?") == "Keysight Technologies,33622A,EMULATED,0.00-emulated"


def test_a_new_generator_is_silent_and_reset_makes_it_so_again() -> None:
    bench = Bench()
    assert bench.port.played == []
    bench.send("APPL:SIN 1 MHZ,1", "*RST")
    assert bench.port.setting == GeneratorSetting()
    assert bench.ask("FUNC?;:OUTP?;:FUNC:ARB?") == f"SIN;0;{BUILT_IN}"


@pytest.mark.parametrize(
    ("command", "query", "answer"),
    [
        ("FUNC ARBitrary", "FUNC?", "ARB"),
        ("FUNC SQU", "FUNC:SHAP?", "SQU"),
        ("FREQ 1.5 MHZ", "FREQ?", 1.5e6),
        ("SOURce1:FREQuency 1000000.0", "FREQ:CW?", 1e6),
        ("FREQ:MODE FIXED", "FREQ:MODE?", "FIX"),
        ("VOLT 50MVPP", "VOLT?", 0.05),
        ("VOLT 0.1234567", "VOLT?", 0.1235),
        ("VOLT:OFFS -10 mV", "VOLT:OFFS?", -0.01),
        ("VOLT:UNIT VRMS", "VOLT:UNIT?", "VRMS"),
        ("VOLT:RANG:AUTO OFF", "VOLT:RANG:AUTO?", "OFF"),
        ("VOLT:LIM:HIGH 2", "VOLT:LIM:HIGH?", 2.0),
        ("VOLT:LIM:LOW -2", "VOLT:LIM:LOW?", -2.0),
        ("VOLT:LIM:STAT ON", "VOLT:LIM:STAT?", "1"),
        ("PHAS 90 DEG", "PHAS?", 90.0),
        ("FUNC:ARB:SRAT 80E6", "FUNC:ARB:SRAT?", 80e6),
        ("FUNC:ARB:SRAT 80 MSA/S", "FUNC:ARB:SRATE?", 80e6),
        ("FUNC:ARB:FILT STEP", "FUNC:ARB:FILT?", "STEP"),
        ("FUNC:ARB:ADV TRIGGER", "FUNC:ARB:ADV?", "TRIG"),
        ("FUNC:SQU:DCYC 20", "FUNC:SQU:DCYC?", 20.0),
        ("FUNC:RAMP:SYMM 50 PCT", "FUNC:RAMP:SYMM?", 50.0),
        ("FUNC:PULS:PER 1.000000e-06", "FUNC:PULS:PER?", 1e-6),
        ("FUNC:PULSE:WIDTh 20 NS", "FUNC:PULS:WIDT?", 20e-9),
        ("FUNC:PULS:DCYC 30", "FUNC:PULS:DCYC?", 30.0),
        ("FUNC:PULS:HOLD DCYCLE", "FUNC:PULS:HOLD?", "DCYC"),
        ("FUNC:PULS:TRAN:BOTH 8.4e-9", "FUNC:PULS:TRAN:TRA?", 8.4e-9),
        ("FUNC:PULS:TRAN 9e-9", "FUNC:PULS:TRAN:LEAD?", 9e-9),
        ("FUNC:NOIS:BAND 1 MHZ", "FUNC:NOIS:BAND?", 1e6),
        ("FUNC:PRBS:BRAT 1e4", "FUNC:PRBS:BRAT?", 1e4),
        ("BURS:STAT ON", "BURS:STAT?", "1"),
        ("BURS:MODE GATED", "BURS:MODE?", "GAT"),
        ("SOURce1:BURSt:NCYCLes 3", "BURS:NCYC?", 3.0),
        ("BURS:NCYC INF", "BURS:NCYC?", 9.9e37),
        ("BURS:PHAS -90", "BURS:PHAS?", -90.0),
        ("BURS:INT:PER 1 MS", "BURS:INT:PER?", 1e-3),
        ("BURS:GATE:POL INV", "BURS:GATE:POL?", "INV"),
        ("TRIG:SOUR TIMer", "TRIG1:SOUR?", "TIM"),
        ("TRIG:DEL 1.5 US", "TRIG:DEL?", 1.5e-6),
        ("TRIG:SLOP NEG", "TRIG:SLOP?", "NEG"),
        ("TRIG:TIM 5", "TRIG:TIM?", 5.0),
        ("TRIG:COUN 7", "TRIG:COUN?", 7.0),
        ("OUTP 1", "OUTPut1:STATe?", "1"),
        ("OUTP:LOAD 75", "OUTP:LOAD?", 75.0),
        ("OUTP:LOAD INF", "OUTP:LOAD?", 9.9e37),
        ("OUTP:LOAD 9.9E37", "OUTP:LOAD?", 9.9e37),
        ("OUTP:POL INV", "OUTP:POL?", "INV"),
        ("OUTP:SYNC OFF", "OUTP:SYNC?", "0"),
        ("OUTP:SYNC:SOUR CH2", "OUTP:SYNC:SOUR?", "CH2"),
        ("OUTP:TRIG 1", "OUTP:TRIG?", "1"),
        ("OUTP:TRIG:SLOP NEG", "OUTP:TRIG:SLOP?", "NEG"),
        ("FORM:BORD SWAP", "FORM:BORD?", "SWAP"),
        ("DISP:TEXT 'two \"words\"'", "DISP:TEXT?", '"two ""words"""'),
        ("SOUR2:FREQ 7", "SOUR2:FREQ?", 7.0),
    ],
)
def test_every_setting_has_its_query(command: str, query: str, answer: str | float) -> None:
    bench = Bench()
    before = bench.ask(query)
    bench.send(command)
    after = bench.ask(query)
    assert (float(after) if isinstance(answer, float) else after) == answer
    assert after != before
    assert bench.errors() == []
    # and a reset brings the default back
    bench.send("*RST")
    assert bench.ask(query) == before or "DISP" in query


@given(hertz=st.floats(1e-6, 30e6), volts=st.floats(2e-3, 9.9))
def test_numbers_come_back_as_the_instrument_holds_them(hertz: float, volts: float) -> None:
    bench = Bench()
    bench.send(f"FREQ {hertz!r};VOLT {volts!r}")
    frequency, amplitude = map(float, bench.ask("FREQ?;VOLT?").split(";"))
    assert frequency == round_to_step(hertz, 1e-6)
    assert amplitude == float(f"{volts:.3e}")
    assert (frequency, amplitude) == (bench.port.setting.frequency_hz, bench.port.setting.amplitude_vpp)


# Limits


@pytest.mark.parametrize(
    ("command", "query", "held"),
    [
        ("FREQ 31 MHZ", "FREQ?", 30e6),
        ("FREQ 0", "FREQ?", 1e-6),
        ("FREQ INF", "FREQ?", 30e6),
        ("VOLT 11", "VOLT?", 10.0),
        ("VOLT 0", "VOLT?", 1e-3),
        ("VOLT INF", "VOLT?", 10.0),
        ("VOLT:OFFS 6", "VOLT:OFFS?", 4.95),
        ("VOLT:OFFS -6", "VOLT:OFFS?", -4.95),
        ("OUTP:LOAD 0.5", "OUTP:LOAD?", 1.0),
        ("OUTP:LOAD 20000", "OUTP:LOAD?", 10e3),
        ("FUNC:ARB:SRAT 1e9", "FUNC:ARB:SRAT?", 250e6),
        ("TRIG:DEL 2000", "TRIG:DEL?", 1000.0),
        ("BURS:INT:PER 1e-9", "BURS:INT:PER?", 1e-6),
        ("BURS:NCYC 0", "BURS:NCYC?", 1.0),
        ("PHAS 361", "PHAS?", 360.0),
    ],
)
def test_out_of_range_is_adjusted_and_queued(command: str, query: str, held: float) -> None:
    bench = Bench()
    bench.send(command)
    assert float(bench.ask(query)) == held
    assert bench.errors() == [-222]


@pytest.mark.parametrize(
    ("name", "header", "least", "most", "default"),
    [
        ("33522B", "FREQ", 1e-6, 30e6, 1e3),
        ("33622A", "FREQ", 1e-6, 120e6, 1e3),
        ("33611A", "FUNC:ARB:SRAT", 1e-6, 660e6, 40e3),
        ("33522B", "VOLT", 1e-3, 10.0, 0.1),
        ("33522B", "VOLT:OFFS", -4.95, 4.95, 0.0),
        ("33522B", "OUTP:LOAD", 1.0, 10e3, 50.0),
        ("33522B", "TRIG:DEL", 0.0, 1e3, 0.0),
    ],
)
def test_limits_and_defaults_have_words(
    name: str, header: str, least: float, most: float, default: float
) -> None:
    bench = Bench(name)
    words = ("MIN", "MAX", "DEF")
    asked = [float(bench.ask(f"{header}? {word}")) for word in words]
    assert asked == [least, most, default]
    for word, value in zip(words, (least, most, default), strict=True):
        bench.send("*RST", f"{header} {word}")
        assert float(bench.ask(f"{header}?")) == value
    assert bench.errors() == []


def test_levels_have_words_too_and_push_the_other_level() -> None:
    bench = Bench()
    assert [float(bench.ask(f"VOLT:HIGH? {word}")) for word in ("MIN", "MAX", "DEF")] == [-4.999, 5.0, 0.05]
    assert [float(bench.ask(f"VOLT:LOW? {word}")) for word in ("MIN", "MAX", "DEF")] == [-5.0, 4.999, -0.05]
    bench.send("VOLT:HIGH MAX;LOW MIN")
    assert float(bench.ask("VOLT?")) == 10.0
    assert bench.errors() == []
    bench.send("VOLT:HIGH MIN;HIGH MAX;LOW MAX")
    assert [float(bench.ask(f"VOLT:{q}?")) for q in ("HIGH", "LOW")] == [5.0, 4.999]
    assert bench.errors() == []
    bench.send("VOLT:HIGH 1")
    assert [float(bench.ask(f"VOLT:{q}?")) for q in ("HIGH", "LOW")] == [1.0, 0.999]
    assert bench.errors() == [-221]


def test_amplitude_and_offset_share_the_range() -> None:
    bench = Bench()
    bench.send("VOLT:OFFS 4", "VOLT 3")
    assert float(bench.ask("VOLT?")) == 2.0
    bench.send("VOLT:OFFS 4.5")
    assert float(bench.ask("VOLT:OFFS?")) == 4.0
    assert bench.errors() == [-222, -222]
    # High impedance doubles it all.
    bench.send("OUTP:LOAD INF")
    assert [float(bench.ask(q)) for q in ("VOLT?", "VOLT:OFFS?", "VOLT? MIN")] == [4.0, 8.0, 2e-3]
    assert bench.errors() == []


def test_a_new_shape_reduces_what_it_cannot_do_as_a_conflict() -> None:
    bench = Bench()
    bench.send("FREQ 10 MHZ", "FUNC RAMP")
    assert float(bench.ask("FREQ?")) == 200e3
    bench.send("FUNC DC", "VOLT:OFFS 5", "FUNC SIN")
    assert float(bench.ask("VOLT:OFFS?")) == 4.95
    assert bench.errors() == [-221, -221]


def test_levels_are_offset_and_amplitude_seen_otherwise() -> None:
    bench = Bench()
    bench.send("VOLT:HIGH 0.3;LOW 0.1")
    assert bench.port.setting == replace(GeneratorSetting(), amplitude_vpp=0.2, offset_v=0.2)
    assert [float(bench.ask(f"VOLT:{q}?")) for q in ("HIGH", "LOW")] == [0.3, 0.1]
    # A level on the wrong side moves the other one by the least amplitude.
    bench.send("VOLT:HIGH 0.05")
    assert [float(bench.ask(f"VOLT:{q}?")) for q in ("HIGH", "LOW")] == [0.05, 0.049]
    assert bench.errors() == [-221]


def test_voltage_limits_hold_and_are_refused_inside_of_the_waveform() -> None:
    bench = Bench()
    bench.send("VOLT:LIM:HIGH 0.25;LOW -0.25;STAT ON", "VOLT 1", "VOLT:OFFS 1")
    assert [float(bench.ask(q)) for q in ("VOLT?", "VOLT:OFFS?")] == [0.5, 0.0]
    bench.send("VOLT:LIM:HIGH 0.1")
    assert float(bench.ask("VOLT:LIM:HIGH?")) == 0.25
    assert bench.errors() == [-222, -222, -222]
    bench.send("VOLT:LIM:STAT OFF;HIGH 0.1;STAT ON")
    assert bench.ask("VOLT:LIM:STAT?") == "0"
    assert bench.errors() == [-221]


@given(
    load=st.floats(1.0, 1e4),
    steps=st.lists(st.tuples(st.floats(-12.0, 12.0), st.booleans()), min_size=1, max_size=4),
)
@example(1.0, [(0.3, True), (-0.1, False)])
@example(3.0, [(-9.0, False), (9.0, True)])
def test_no_levels_at_any_load_exceed_the_largest_voltage_or_fall_below_the_least(
    load: float, steps: list[tuple[float, bool]]
) -> None:
    channel = Channel(MODELS["33522B"], lambda error: None, arbs=ArbMemory(MODELS["33522B"]))
    channel.set_load(load)
    for volts, high in steps:
        channel.set_level(volts, high)
        assert abs(channel.offset_v) + channel.amplitude_vpp / 2 <= channel.peak_v * (1 + 1e-15)
        assert channel.amplitude_vpp >= channel.least_vpp


@pytest.mark.parametrize(
    ("limits", "amplitude", "offset"), [("HIGH 2;LOW -2", 4.0, 0.0), ("LOW 5;:VOLT:OFFS 5", 1e-3, 4.9995)]
)
def test_an_amplitude_that_limits_beside_a_constant_do_not_allow_is_reduced(
    limits: str, amplitude: float, offset: float
) -> None:
    # given limits that were set while the large amplitude was not played
    bench = Bench()
    bench.send("VOLT 10;:FUNC DC", f"VOLT:LIM:{limits}", "VOLT:LIM:STAT ON")
    assert bench.errors() == []
    # when a waveform is chosen, then it fits into them, or is the smallest below the largest voltage
    bench.send("FUNC SIN")
    assert [float(bench.ask(q)) for q in ("VOLT?", "VOLT:OFFS?")] == pytest.approx([amplitude, offset])
    assert set(bench.errors()) == {-221}


@given(
    amplitude=st.floats(0.01, 4.0),
    offset=st.floats(-2.0, 2.0),
    loads=st.lists(st.floats(1.0, 10e3) | st.just(math.inf), min_size=1, max_size=5),
)
def test_the_load_setting_changes_numbers_and_not_the_output(
    amplitude: float, offset: float, loads: list[float]
) -> None:
    bench = Bench()
    bench.send(f"VOLT {amplitude!r};VOLT:OFFS {offset!r}")
    before = bench.port.setting
    for load in loads:
        bench.send(f"OUTP:LOAD {load!r}" if load < math.inf else "OUTP:LOAD INF")
        now = bench.port.setting
        # Open-circuit volts per volt of setting, (load + 50) / load, as an independent witness.
        assert now.load_ohm == load
        assert now.amplitude_vpp * open_circuit(load) == pytest.approx(before.amplitude_vpp * 2, rel=1e-14)
        assert now.offset_v * open_circuit(load) == pytest.approx(before.offset_v * 2, rel=1e-14, abs=1e-300)
    assert bench.errors() == []


def test_units_convert_with_the_crest_of_the_shape() -> None:
    bench = Bench()
    bench.send("VOLT 0.1 VRMS")
    assert float(bench.ask("VOLT?")) == 0.2 * math.sqrt(2)
    bench.send("VOLT:UNIT VRMS")
    assert float(bench.ask("VOLT?")) == 0.1
    bench.send("VOLT:UNIT DBM", "VOLT 10")
    assert float(bench.ask("VOLT?")) == 10.0
    # 10 dBm are 10 mW: U^2 = P R.
    assert bench.port.setting.amplitude_vpp == pytest.approx(
        2 * math.sqrt(2) * math.sqrt(0.01 * 50), rel=1e-14
    )
    bench.send("FUNC SQU", "VOLT 1 VRMS")
    assert bench.device.channels[0].amplitude_vpp == 2.0
    assert bench.errors() == []


def test_a_power_needs_a_load() -> None:
    bench = Bench()
    bench.send("VOLT:UNIT DBM", "OUTP:LOAD INF")
    assert bench.ask("VOLT:UNIT?") == "VPP"
    bench.send("VOLT 0 DBM", "VOLT:UNIT DBM")
    assert bench.errors() == [-221, -221]
    assert bench.ask("VOLT:UNIT?") == "VPP"


# Arbitrary waveforms


@given(
    codes=stnp.arrays(np.int16, st.integers(8, 60), elements=st.integers(-8191, 8191)),
    bits=st.sampled_from([14, 16]),
    swap=st.booleans(),
    text=st.booleans(),
)
def test_codes_on_the_grid_of_the_dac_are_kept_as_they_are(
    codes: np.ndarray, bits: int, swap: bool, text: bool
) -> None:
    # given codes that the DAC has
    bench = Bench("33522B" if bits == 16 else "33622A")
    codes = (codes * (4 if bits == 14 else 1)).astype(np.int16)
    # when they are sent as a block in either byte order, or as text
    order = "<i2" if swap else ">i2"
    data = ",".join(map(str, codes)).encode() if text else block(codes.astype(order).tobytes())
    bench.send(f"FORM:BORD {'SWAP' if swap else 'NORM'}", b"DATA:ARB:DAC w," + data, "FUNC:ARB W;:FUNC ARB")
    # then they are played as they are, and the attributes tell of them
    assert bench.errors() == []
    assert bench.port.setting.arb == ArbBlock(codes, 40e3, "linear")
    points, average, span, crest = bench.ask("DATA:ATTR:POIN?;AVER?;PTP? W;CFAC?").split(";")
    assert int(points) == codes.size
    assert float(average) == float(Fraction(sum(map(int, codes)), 32767 * codes.size))
    assert float(span) == float(Fraction(int(codes.max()) - int(codes.min()), 32767))
    if np.any(codes):
        rms = math.sqrt(math.fsum(float(c) ** 2 for c in codes) / codes.size)
        assert float(crest) == pytest.approx(max(abs(int(c)) for c in codes) / rms, rel=4e-16)
    else:
        assert float(crest) == 9.91e37


@given(
    values=st.lists(st.floats(-1, 1, width=32), min_size=8, max_size=40),
    swap=st.booleans(),
    text=st.booleans(),
)
def test_fractions_are_rounded_to_the_dac(values: list[float], swap: bool, text: bool) -> None:
    bench = Bench()
    data = np.array(values, "<f4" if swap else ">f4").tobytes()
    sent = ", ".join(map(repr, values)).encode() if text else block(data)
    bench.send(f"FORM:BORD {'SWAP' if swap else 'NORM'}", b"DATA:ARB f," + sent, "FUNC:ARB f;:FUNC ARB")
    assert bench.errors() == []
    arb = bench.port.setting.arb
    assert arb is not None
    # The nearest code, ties to even.
    assert list(arb.codes) == [round(Fraction(value) * 32767) for value in values]


@pytest.mark.parametrize(
    ("message", "code"),
    [
        (b"DATA:ARB:DAC W,1,2,3,4,5,6,7,8", 783),
        (b"DATA:ARB:DAC w,1,2,3,4,5,6,7,8", 783),
        (b"DATA:ARB 'no good',0,0,0,0,0,0,0,0", 783),
        (b"FUNC:ARB nothing", 785),
        (b"DATA:ATTR:AVER? nothing", 785),
        (b"DATA:ARB:DAC x,1,2,3,4,5,6,7", -222),
        (b"DATA:ARB:DAC x,#17abcdefg", 800),
        (b"DATA:ARB x,#17abcdefg", -161),
        (b"DATA:ARB x,#240" + b"\xff" * 40, -230),
        (b"DATA:ARB x,0,0,0,0,0,0,0,FOO", -141),
        (b"DATA:ARB 5,0,0,0,0,0,0,0,0", -104),
        (b"DATA:ARB x", -109),
    ],
)
def test_a_bad_upload_has_its_own_error_and_changes_nothing(message: bytes, code: int) -> None:
    bench = Bench()
    bench.send("DATA:ARB:DAC W,0,0,0,0,0,0,0,32767", "FUNC:ARB W")
    catalog = bench.ask("DATA:VOL:CAT?")
    assert catalog == f'{BUILT_IN},"W"'
    bench.send(message)
    assert bench.errors() == [code]
    assert bench.ask("DATA:VOL:CAT?") == catalog
    assert bench.ask("FUNC:ARB?") == '"W"'


def test_values_beyond_full_scale_are_clipped_and_queued() -> None:
    bench = Bench("33622A")
    bench.send("DATA:ARB:DAC a,32767,-32767,0,0,0,0,0,1", "FUNC:ARB a;:FUNC ARB")
    assert bench.errors() == []
    bench.send("DATA:ARB b,2,-2,0,0,0,0,0,1e300")
    assert bench.errors() == [-222]
    # The memory holds 16 bits; the plant rounds to the 14 bits of the converter.
    arb = bench.port.setting.arb
    assert arb is not None
    assert list(arb.codes) == [32767, -32767, 0, 0, 0, 0, 0, 1]


def test_memory_is_limited_and_can_be_cleared() -> None:
    bench = Bench()
    assert bench.ask("DATA:VOL:FREE?") == "+1000000"
    bench.send(b"DATA:ARB:DAC big," + block(bytes(2 * 999_996)), "FUNC:ARB BIG")
    assert bench.ask("DATA:VOL:FREE?") == "+4"
    bench.send(b"DATA:ARB:DAC small," + block(bytes(16)))
    assert bench.errors() == [781]
    bench.send("DATA:VOL:CLE")
    assert bench.ask("DATA:VOL:CAT?;:FUNC:ARB?") == f"{BUILT_IN};{BUILT_IN}"
    assert bench.ask("DATA:VOL:FREE?") == "+1000000"
    # Each channel has its own.
    bench.send("SOUR2:DATA:ARB w,0,0,0,0,0,0,0,1")
    assert bench.ask("DATA:VOL:CAT?") == BUILT_IN
    assert bench.ask("SOUR2:DATA:VOL:CAT?") == f'{BUILT_IN},"W"'
    assert bench.errors() == []


@pytest.mark.parametrize(("word", "interpolation"), [("NORM", "linear"), ("STEP", "hold"), ("OFF", "hold")])
def test_the_filter_decides_between_the_points(word: str, interpolation: str) -> None:
    bench = Bench()
    bench.send(f"FUNC:ARB:FILT {word}", "FUNC ARB")
    assert bench.port.setting.arb is not None
    assert bench.port.setting.arb.interpolation == interpolation


def test_inverted_polarity_inverts_a_waveform() -> None:
    bench = Bench()
    bench.send("DATA:ARB:DAC w,1,2,3,4,5,6,7,-32767", "FUNC:ARB w;:FUNC ARB", "OUTP:POL INV")
    arb = bench.port.setting.arb
    assert arb is not None
    assert list(arb.codes) == [-1, -2, -3, -4, -5, -6, -7, 32767]


# What is played


def test_apply_sets_all_at_once_and_switches_on() -> None:
    bench = Bench()
    bench.send("TRIG:SOUR BUS;:BURS:STAT ON", "APPL:SIN 1 MHZ,0.05 VPP,10 MV")
    wanted = GeneratorSetting(output=True, frequency_hz=1e6, amplitude_vpp=0.05, offset_v=0.01)
    assert bench.port.setting == wanted
    numbers = "+1.000000000000000E+06,+5.000000000000000E-02,+1.000000000000000E-02"
    assert bench.ask("APPL?") == f'"SIN {numbers}"'
    bench.send("APPL:DC DEF,DEF,0", "APPL:ARB 2 MSA/S")
    assert bench.ask("FUNC:ARB:SRAT?;:TRIG:SOUR?") == "+2.000000000000000E+06;IMM"
    assert bench.errors() == []


def test_the_plant_is_told_once_for_each_message_that_changes_the_output_and_for_no_other() -> None:
    bench = Bench()
    bench.send("FREQ 1e6;VOLT 1;:OUTP ON")
    assert len(bench.port.played) == 1
    bench.send("FREQ 1e6", "SOUR2:FREQ 5", "OUTP2 ON", "TRIG:SLOP NEG", "FREQ?", "FOO", "FUNC:ARB:SRAT 1e6")
    assert len(bench.port.played) == 1
    bench.send("FREQ 2e6;FOO")
    assert len(bench.port.played) == 2
    assert bench.port.setting.frequency_hz == 2e6


def test_a_waveform_that_does_not_change_is_the_same_object() -> None:
    bench = Bench()
    bench.send("FUNC ARB;:OUTP ON")
    first = bench.port.setting.arb
    bench.send("VOLT 1")
    assert bench.port.setting.arb is first


def test_only_a_burst_on_the_bus_takes_a_trigger() -> None:
    bench = Bench()
    bench.send("FUNC ARB", "*TRG", "BURS:STAT ON", "*TRG", "TRIG:SOUR EXT", "*TRG")
    assert bench.port.triggers == 0
    assert bench.errors() == [-211, -211, -211]
    bench.send("TRIG:SOUR BUS;*TRG")
    assert bench.port.triggers == 1
    # The plant knew of the setting before it was triggered.
    assert bench.port.setting.trigger_source == "BUS"
    assert bench.errors() == []
    bench.port.takes_triggers = False
    bench.send("*TRG")
    assert bench.errors() == [-211]
    bench.send("SOUR2:BURS:STAT ON;:TRIG2:SOUR BUS", "TRIG1:SOUR IMM", "*TRG")
    assert bench.port.triggers == 1
    assert bench.errors() == []


def test_a_shape_that_is_not_emulated_says_so_once_and_plays_nothing() -> None:
    bench = Bench()
    bench.send("FUNC SQU")
    assert bench.errors() == []
    bench.send("OUTP ON", "VOLT 1", "FUNC RAMP")
    assert isinstance(stimulus_of(bench.port.setting), NoSignal)
    assert bench.errors() == [901]
    assert bench.ask("STAT:QUES:COND?") == f"+{NOT_PLAYED_BIT}"
    bench.send("FUNC SIN")
    assert bench.ask("STAT:QUES:COND?") == "+0"
    assert stimulus_of(bench.port.setting) == Sine(1e3, 1.0)
    bench.send("FUNC SQU")
    assert bench.errors() == [901]


@pytest.mark.parametrize(
    "messages",
    [
        ("BURS:STAT ON",),
        ("FUNC ARB",),
        ("FUNC ARB", "BURS:STAT ON", "BURS:NCYC 2"),
        ("FUNC ARB", "BURS:STAT ON", "BURS:MODE GAT"),
        ("FUNC ARB", "BURS:STAT ON", "BURS:PHAS 10"),
        ("FUNC ARB", "BURS:STAT ON", "FUNC:ARB:ADV TRIG"),
        ("FUNC ARB", "BURS:STAT ON", "VOLT:OFFS 0.1"),
        ("FUNC DC", "VOLT:OFFS 0.1"),
    ],
)
def test_what_the_plant_does_not_play_is_marked_without_an_error(messages: tuple[str, ...]) -> None:
    bench = Bench()
    bench.send("OUTP ON", "TRIG:SOUR BUS", *messages)
    assert bench.ask("STAT:QUES:COND?") == f"+{NOT_PLAYED_BIT}"
    assert bench.errors() == []
    # A trigger is taken all the same, as the instrument would.
    if bench.ask("BURS:STAT?") == "1":
        bench.send("*TRG")
        assert bench.port.setting.burst
        assert bench.errors() == []


@given(
    setting=st.builds(
        GeneratorSetting,
        output=st.booleans(),
        function=st.sampled_from(["SIN", "ARB", "DC", "OTHER"]),
        burst=st.booleans(),
        arb=st.just(ArbBlock(np.zeros(8, np.int16), 1e6)),
    )
)
def test_without_an_offset_played_means_that_the_plant_has_a_stimulus(setting: GeneratorSetting) -> None:
    silent = isinstance(stimulus_of(setting), NoSignal)
    meant_to_be = not setting.output or setting.function == "DC"
    assert is_played(setting) == (meant_to_be or not silent)


def test_a_model_with_one_channel_has_no_second() -> None:
    bench = Bench("33521B")
    bench.send("SOUR2:FREQ 1", "OUTP2 ON")
    assert bench.errors() == [-114, -114]


@pytest.mark.parametrize("stimulus", [Sine(100e6, 0.1), Sine(1e6, 11.0)])
def test_what_the_model_refuses_the_instrument_adjusts(stimulus: Sine) -> None:
    with pytest.raises(LimitExceeded):
        setting_for(stimulus, MODELS["33522B"])
    bench = Bench()
    bench.send(f"APPL:SIN {stimulus.frequency_hz!r},{stimulus.amplitude_vpp!r}")
    assert bench.errors() == [-222]


# Third-party clients


PYMEASURE = """
*IDN?|FUNC SIN|FREQ 1000000.000000|VOLT 0.500000|VOLT:OFFS 0.100000|OUTP:LOAD 50|OUTP 1|SOUR1:FUNC SIN
SOUR1:FREQ 5000000.000000|SOUR1:VOLT:UNIT VPP|SOUR1:VOLT 0.250000|SOUR1:VOLT:OFFS 0.000000|SOUR1:PHAS 0.000000
OUTP1 1|SOUR1:BURS:STAT 1|SOUR1:BURS:NCYC 1|SOUR1:BURS:MODE TRIGGERED|SOUR1:BURS:INT:PER 1.000000e-03
TRIG:SOUR BUS|*TRG;*WAI|OUTP1 0|SOUR1:FUNC PULS|SOUR1:FUNC:PULS:PER 1.000000e-06|SOUR1:FUNC:PULS:HOLD WIDTH
SOUR1:FUNC:PULS:TRAN:BOTH 8.400000e-09|SOUR1:FUNC:PULS:WIDT 2.000000e-08|SOUR1:FUNC:PULS:TRAN?|*TRG;*WAI
SOUR1:DATA:VOL:CLE|SOUR1:DATA:ARB:DAC test, 0, 1, 2, 3, 4, 5, 6, 7|SOUR1:FUNC:ARB test
SOUR1:FUNC:ARB:FILT NORMAL|SOUR1:FUNC:ARB:ADV SRATE|SOUR1:FUNC:ARB:SRAT 1000000.000000|SOUR1:FUNC ARB
PHAS:SYNC|SYST:BEEP|DISP:TEXT 'go'|DISP:TEXT:CLE|OUTP:TRIG 1|TRIG:SOUR EXTERNAL|*OPC?|SYST:ERR?
"""
QCODES = """
*IDN?|SOURce1:FUNCtion SIN|SOURce1:FREQuency 1000000.0|SOURce1:VOLTage:UNIT VPP|SOURce1:VOLTage 0.5
SOURce1:VOLTage:OFFSet 0.0|SOURce1:PHASe 0|OUTPut1 1|SYSTem:ERRor?|SOURce2:FREQuency:MODE?
SOURce1:FUNCtion:RAMP:SYMMetry?|SOURce1:FUNCtion:PULSE:WIDTh?|TRIGger1:COUNt?|TRIGger1:DELay?|TRIGger1:TIMer?
TRIGger1:SOURce?|TRIGger1:SLOPe?|OUTPut1:POLarity?|SOURce1:BURSt:STATe?|SOURce1:BURSt:MODE?
SOURce1:BURSt:NCYCLes?|SOURce1:BURSt:PHASe?|SOURce1:BURSt:GATE:POLarity?|SOURce1:BURSt:INTernal:PERiod?
OUTPut:SYNC?|OUTPut:SYNC:SOURce?|SOURce1:VOLTage?|SOURce1:VOLTage:UNIT?|SOURce1:FREQuency?|OUTPut1?
"""


@pytest.mark.parametrize("name", ["33522B", "33622A"])
@pytest.mark.parametrize("text", [PYMEASURE, QCODES])
def test_messages_of_other_clients_leave_no_error(text: str, name: str) -> None:
    bench = Bench(name)
    for message in text.strip().replace("\n", "|").split("|"):
        answers = bench.send(message)
        assert len(answers) == message.count("?"), message
        assert bench.errors() == [], message
