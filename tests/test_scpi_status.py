"""Status, the order of questions and answers, and settings that are kept, as IEEE 488.2 has them."""

from __future__ import annotations

import random
from dataclasses import fields
from types import SimpleNamespace

import pytest
import pyvisa
from hypothesis import given
from hypothesis import strategies as st

from belahil.generators import FAMILIES, MODELS, GeneratorSetting
from sim.devices.generator import GeneratorDevice
from sim.devices.generator_families import generator_device
from sim.devices.scpi import ScpiDevice
from sim.devices.scpi.registers import Register
from sim.devices.scpi.status import ScpiError
from sim.plant import PlantClock
from sim.transports.visa_library import EmulatedVisa


class Port:
    """Where a generator plays into; its clock moves when the generator waits."""

    def __init__(self) -> None:
        self.clock = PlantClock()

    def play(self, setting: GeneratorSetting) -> None:
        pass

    def trigger(self) -> bool:
        return True


def generator() -> GeneratorDevice:
    return GeneratorDevice(MODELS["33522B"], Port())


def ask(device: ScpiDevice, *lines: str) -> list[str]:
    """Send lines one after the other, and return all answers."""
    answers: list[bytes] = []
    for line in lines:
        device.write(line.encode() + b"\n")
        answers += iter(device.read, None)
    return [answer.decode().rstrip("\n") for answer in answers]


# Registers


@given(
    steps=st.lists(st.tuples(st.sampled_from([1, 2, 4, 16384]), st.booleans()), max_size=12),
    positive=st.integers(0, 0x7FFF),
    negative=st.integers(0, 0x7FFF),
)
def test_a_register_latches_just_the_changes_that_its_filters_name(
    steps: list[tuple[int, bool]], positive: int, negative: int
) -> None:
    register = Register(positive=positive, negative=negative)
    expected = condition = 0
    for bit, on in steps:
        register.set(bit, on)
        rose, fell = on and not condition & bit, not on and condition & bit
        expected |= bit if (rose and positive & bit) or (fell and negative & bit) else 0
        condition = condition | bit if on else condition & ~bit
    assert (register.condition, register.event) == (condition, expected)
    assert register.take_event() == expected
    assert register.take_event() == 0


@pytest.mark.parametrize(("name", "summary"), [("QUEStionable", 8), ("OPERation", 128)])
def test_an_event_climbs_from_a_register_to_the_status_byte(name: str, summary: int) -> None:
    # given a falling condition that counts
    device = ScpiDevice("a,b,c,d")
    register = device.status.questionable if summary == 8 else device.status.operation
    ask(device, f"STAT:{name}:NTR 16;PTR 0;ENAB 16;*SRE {summary}")
    register.set(16, True)
    assert ask(device, f"*STB?;:STAT:{name}:COND?") == ["+0;+16"]
    # when it falls, then it is in the summary until the event is read
    register.set(16, False)
    assert ask(device, f"*STB?;:STAT:{name}?", "*STB?") == [f"{summary + 64:+d};+16", "+0"]
    assert ask(device, f"STAT:{name}:NTR?;PTR?;ENAB?") == ["+16;+0;+16"]
    ask(device, "STAT:PRES")
    assert ask(device, f"STAT:{name}:NTR?;PTR?;ENAB?", "*SRE?") == ["+0;+32767;+0", f"{summary:+d}"]


def test_a_message_is_available_while_an_answer_waits_and_within_its_own_message() -> None:
    device = ScpiDevice("a,b,c,d")
    assert ask(device, "*STB?") == ["+0"]
    assert ask(device, "*ESE?;*STB?") == ["+0;+16"]
    device.write(b"*ESE?\n")
    assert device.read_stb() == 16
    device.read()
    assert device.read_stb() == 0


def test_the_service_mask_has_no_bit_6() -> None:
    assert ask(ScpiDevice("a,b,c,d"), "*SRE 255;*SRE?") == ["+191"]


@pytest.mark.parametrize(("flag", "kept"), [("1", "+0;+0"), ("0", "+4;+16")])
def test_power_on_keeps_the_masks_only_when_it_was_told_to(flag: str, kept: str) -> None:
    device = ScpiDevice("a,b,c,d")
    ask(device, f"*PSC {flag};*ESE 4;*SRE 16;FOO", "*ESR?")
    device.power_on()
    assert ask(device, "*PSC?;*ESE?;*SRE?;*ESR?;:SYST:ERR:COUN?") == [f"{flag};{kept};+128;+0"]


# Errors


def test_errors_are_counted_and_told_one_by_one_or_all_at_once() -> None:
    device = ScpiDevice("a,b,c,d")
    ask(device, "FOO", "*ESE 999", "*TRG")
    assert ask(device, "SYST:ERR:COUN?", "SYST:ERR:CODE?", "SYST:ERR:CODE:ALL?") == [
        "+3",
        "-113",
        "-222,-211",
    ]
    assert ask(device, "SYST:ERR:CODE?", "SYST:ERR:CODE:ALL?", "SYST:ERR:ALL?") == [
        "+0",
        "+0",
        '+0,"No error"',
    ]
    ask(device, "FOO", "*ESE 999")
    told = ['-113,"Undefined header; FOO",-222,"Data out of range; 0 to 255"', '+0,"No error"']
    assert ask(device, "SYST:ERR:ALL?", "SYST:ERR?") == told


@pytest.mark.parametrize("depth", [20, 32])
def test_the_queue_is_as_deep_as_the_model_says(depth: int) -> None:
    device = ScpiDevice("a,b,c,d", queue_depth=depth, signed=False)
    ask(device, *["FOO"] * (depth + 5))
    assert ask(device, "SYST:ERR:COUN?") == [str(depth)]
    assert ask(device, "SYST:ERR:CODE:ALL?")[0].split(",") == ["-113"] * (depth - 1) + ["-350"]
    assert ask(device, "SYST:ERR?") == ['0,"No error"']


# Questions and answers


@pytest.fixture
def instrument() -> tuple[ScpiDevice, pyvisa.resources.MessageBasedResource]:
    name = "USB0::0x0957::0x2C07::MY1::INSTR"
    device = generator()
    resource = pyvisa.ResourceManager(EmulatedVisa(PlantClock()).plug(name, device)).open_resource(name)
    return device, resource  # type: ignore[return-value]


def codes(device: ScpiDevice) -> list[int]:
    return [entry.code for entry in device.status.errors]


def test_a_message_before_the_answer_was_read_is_interrupted(
    instrument: tuple[ScpiDevice, pyvisa.resources.MessageBasedResource],
) -> None:
    device, resource = instrument
    resource.write("*IDN?")
    # when another question follows at once, or the answer was read in part
    assert resource.query("*ESE?") == "+0\n"
    assert codes(device) == [-410]
    resource.write("*IDN?")
    resource.read_bytes(3)
    assert resource.query("*ESE?") == "+0\n"
    assert codes(device) == [-410, -410]
    assert int(resource.query("*ESR?")) & 4


def test_a_read_with_nothing_asked_is_unterminated(
    instrument: tuple[ScpiDevice, pyvisa.resources.MessageBasedResource],
) -> None:
    device, resource = instrument
    with pytest.raises(pyvisa.VisaIOError):
        resource.read()
    assert codes(device) == [-420]
    # and so is one in the middle of a message, which is forgotten
    resource.send_end = False
    resource.write_raw(b"FREQ 5E")
    with pytest.raises(pyvisa.VisaIOError):
        resource.read()
    resource.write_raw(b"FREQ?\n")
    assert float(resource.read()) == 1000
    assert codes(device) == [-420, -420]


def test_a_stream_knows_nothing_of_reading() -> None:
    device = generator()
    stream = device.connect("stream")
    stream.write(b"*ESE?\n*ESE?\n")
    stream.write(b"*ESE?\n")
    assert [stream.read() for _ in range(4)] == [b"+0\n"] * 3 + [None]
    assert codes(device) == []


def test_no_query_may_follow_one_whose_answer_has_no_end() -> None:
    device = ScpiDevice("a,b,c,d")
    assert ask(device, "*ESE?;*IDN?;*ESE?;*SRE 16", "*SRE?") == ["+0;a,b,c,d", "+16"]
    assert codes(device) == [-440]
    assert device.status.take_events() & 4


# What takes time


def test_completion_comes_when_the_triggered_burst_is_over() -> None:
    # given a burst of 5 ms after a delay of 1 ms
    device = generator()
    clock = device._clock
    ask(device, "OUTP1 1;:FREQ 2000;:BURS:NCYC 10;STAT 1;:TRIG:SOUR BUS;DEL 1E-3", "*CLS")
    ask(device, "*TRG;*OPC")
    assert ask(device, "*ESR?") == ["+0"]
    clock.sleep_s(3e-3)
    assert ask(device, "*ESR?") == ["+0"]
    # when *OPC? is asked, then the answer comes with the end of the burst
    assert ask(device, "*OPC?") == ["1"]
    assert clock.now_s() == pytest.approx(6e-3, abs=1e-12)
    assert ask(device, "*ESR?") == ["+1"]
    # and with nothing under way time stands still
    assert ask(device, "*OPC?;*WAI;*OPC?") == ["1;1"]
    ask(device, "*TRG;*WAI;*TRG;*WAI")
    assert clock.now_s() == pytest.approx(18e-3, abs=1e-12)
    assert codes(device) == []


def test_an_endless_burst_is_complete_only_when_it_is_stopped() -> None:
    device = generator()
    ask(device, "OUTP1 1;:BURS:NCYC INF;STAT 1;:TRIG:SOUR BUS", "*TRG")
    polite = device.connect("message")
    polite.write(b"*OPC?\n")
    assert polite.read() is None
    assert codes(device) == []
    # when another client stops it, then the answer comes, one time
    ask(device, "BURS:STAT 0")
    assert (polite.read(), codes(device)) == (b"1\n", [])
    assert (polite.read(), codes(device)) == (None, [-420])
    # and *CLS and device clear make the question forgotten
    for forget in (lambda: ask(device, "*CLS"), polite.clear):
        ask(device, "BURS:STAT 1", "*TRG")
        polite.write(b"*OPC?\n")
        forget()
        ask(device, "ABOR")
        assert polite.read() is None
    # and *WAI does not block for ever
    assert ask(device, "*TRG;*WAI;*ESE?") == ["+0"]


# Settings that are kept


def settings(device: GeneratorDevice) -> list[dict[str, object]]:
    without = ("model", "arbs", "report")
    return [
        {field.name: getattr(channel, field.name) for field in fields(channel) if field.name not in without}
        for channel in device.channels
    ]


COMMANDS = (
    "FUNC {choice:SIN,SQU,RAMP,PULS,NOIS,ARB,DC}", "FREQ {1e2,3e7}", "VOLT {1e-3,9}", "VOLT:OFFS {-4,4}",
    "VOLT:UNIT {choice:VPP,VRMS,DBM}", "PHAS {-360,360}", "FUNC:SQU:DCYC {1,99}", "BURS:NCYC {1,1000}",
    "BURS:NCYC INF", "BURS:STAT {choice:0,1}", "TRIG{n}:SOUR {choice:IMM,EXT,BUS,TIM}", "TRIG{n}:DEL {0,900}",
    "OUTP{n}:LOAD {1,10000}", "OUTP{n}:LOAD INF", "OUTP{n} {choice:0,1}", "OUTP{n}:POL {choice:NORM,INV}",
    "VOLT:LIM:HIGH {1,5}", "VOLT:LIM:LOW {-5,-1}", "VOLT:LIM:STAT {choice:0,1}", "FUNC:ARB w",
    "FUNC:ARB:SRAT {1e3,1e8}", "VOLT:RANG:AUTO {choice:0,1,ONCE}", "SWE:STAT {choice:0,1}",
)  # fmt: skip


def some_command(draw: random.Random, commands: tuple[str, ...] = COMMANDS) -> str:
    text = draw.choice(commands).replace("{n}", number := draw.choice("12"))
    head, _, spec = text.partition("{")
    if spec.startswith("choice:"):
        text = head + draw.choice(spec[7:-1].split(","))
    elif spec:
        low, high = map(float, spec[:-1].split(","))
        text = head + f"{draw.uniform(low, high):.{draw.randint(1, 9)}g}"
    return text if text.startswith(("TRIG", "OUTP")) else f"SOUR{number}:{text}"


def test_any_settings_come_back_from_their_place_and_from_the_learned_message() -> None:
    draw = random.Random("settings")
    for _ in range(60):
        # given any settings that the instrument has agreed to
        device = generator()
        upload = "SOUR{}:DATA:ARB w,0,.1,.5,1,.5,.1,0,0"
        ask(device, upload.format(1), upload.format(2), *(some_command(draw) for _ in range(25)), "*CLS")
        before = settings(device)
        (learned,) = ask(device, "*LRN?")
        # when they are kept, others made, and the kept ones recalled
        ask(device, "*SAV 3", *(some_command(draw) for _ in range(25)), "*CLS")
        ask(device, "*RCL 3")
        # then all are as before, and what is not emulated says so again
        assert settings(device) == before, learned
        assert set(codes(device)) <= {901}
        # and another instrument learns them from the message, its volts rounded to four digits
        other = generator()
        ask(other, upload.format(1), upload.format(2), learned)
        for channel, expected in zip(settings(other), before, strict=True):
            for name in ("amplitude_vpp", "offset_v", "limit_low_v", "limit_high_v"):
                assert channel.pop(name) == pytest.approx(expected.pop(name), rel=1e-3)
            assert channel == expected
        # beyond a limit, rounding is clipped
        assert set(codes(other)) <= {-222, 901}


@pytest.mark.parametrize("family", FAMILIES)
def test_only_who_learns_answers_the_question_for_all_settings(family: str) -> None:
    model = MODELS[sorted(FAMILIES[family])[0]]
    device = generator_device(model, Port())
    answers = ask(device, "*LRN?")
    if family in ("keysight-33500", "keysight-33600", "agilent-33220"):
        assert answers[0].startswith("*RST;:OUTP")
        assert codes(device) == []
    else:
        assert answers == []
        assert codes(device) == [-113]


USER_COMMANDS = (
    "FUNC {choice:SIN,SQU,RAMP,PULS,NOIS,USER,DC}", "FREQ {1e2,2e7}", "VOLT {1e-2,9}", "VOLT:OFFS {-4,4}",
    "VOLT:UNIT {choice:VPP,VRMS,DBM}", "FUNC:SQU:DCYC {21,79}", "BURS:NCYC {1,1000}", "BURS:NCYC INF",
    "BURS:STAT {choice:0,1}", "TRIG:SOUR {choice:IMM,EXT,BUS}", "OUTP:LOAD {1,10000}", "OUTP:LOAD INF",
    "OUTP {choice:0,1}", "OUTP:POL {choice:NORM,INV}", "FUNC:USER {choice:W1,SINC}", "PULS:PER {1e-6,1}",
    "VOLT:HIGH {1,4}", "VOLT:LOW {-4,0}", "VOLT:RANG:AUTO {choice:0,1}",
)  # fmt: skip


def test_a_33220a_learns_its_settings_from_the_message_of_another() -> None:
    draw, upload = random.Random("33220A"), "DATA VOLATILE,0,.5,1,-1;:DATA:COPY W1,VOLATILE"
    for _ in range(60):
        # given any settings of one
        device, other = (generator_device(MODELS["33220A"], Port()) for _ in range(2))
        ask(device, upload, *(some_command(draw, USER_COMMANDS) for _ in range(25)), "*CLS")
        (learned,) = ask(device, "*LRN?")
        # when another, set in some other way, is told them
        ask(other, upload, *(some_command(draw, USER_COMMANDS) for _ in range(10)), "*CLS", learned)
        # then both answer the same, volts to the four digits that a generator keeps
        (told,) = ask(other, "*LRN?")
        for said, expected in zip(told.split(";"), learned.split(";"), strict=True):
            (header, _, value), (_, _, due) = said.partition(" "), expected.partition(" ")
            if header.endswith((":AMPL", ":OFFS")):
                assert float(value) == pytest.approx(float(due), rel=1e-3)
            else:
                assert said == expected
        assert set(codes(other)) <= {-222, 901}


def test_a_33220a_gets_over_a_waveform_that_was_deleted_since() -> None:
    device = generator_device(MODELS["33220A"], Port())
    ask(
        device, "DATA VOLATILE,0,.5,1,-1;:DATA:COPY W1,VOLATILE", "FUNC:USER W1;:FUNC USER;:OUTP ON", "*SAV 1"
    )
    ask(device, "FUNC:USER SINC;:DATA:DEL W1", "*RCL 1")
    assert codes(device) == [785]
    assert ask(device, "FUNC?;FUNC:USER?") == ["USER;EXP_RISE"]


def test_a_waveform_that_was_cleared_since_is_missed_and_nothing_breaks() -> None:
    device = generator()
    ask(
        device,
        "DATA:ARB w,0,.1,.5,1,.5,.1,0,0",
        "FUNC:ARB w;:FUNC ARB;:OUTP 1",
        "*SAV 0",
        "*RST;DATA:VOL:CLE",
    )
    assert ask(device, "*RCL 0", "FUNC:ARB?") == ['"INT:\\BUILTIN\\EXP_RISE.ARB"']
    assert len(codes(device)) == 1


def test_a_place_that_is_empty_or_not_there_is_an_error_of_its_own() -> None:
    device = generator()
    ask(device, "FREQ 5000", "*RCL 2", "*SAV 5", "*RCL -1")
    assert codes(device) == [810, -222, -222]
    assert ask(device, "FREQ?") == ["+5.000000000000000E+03"]
    assert ask(device, "*OPT?") == ["0"]


# Snapshots

SNAPSHOTS = {
    # What QCoDeS, PyMeasure and pylablib ask of a 33500 when they read all settings, in their spelling.
    "qcodes": (
        "SOURce{n}:FUNCtion? SOURce{n}:FREQuency:MODE? SOURce{n}:FREQuency? SOURce{n}:PHASe? "
        "SOURce{n}:VOLTage:UNIT? SOURce{n}:VOLTage? SOURce{n}:VOLTage:OFFSet? OUTPut{n}? "
        "SOURce{n}:FUNCtion:RAMP:SYMMetry? SOURce{n}:FUNCtion:PULSE:WIDTh? TRIGger{n}:SOURce? "
        "TRIGger{n}:SLOPe? TRIGger{n}:COUNt? TRIGger{n}:DELay? TRIGger{n}:TIMer? OUTPut{n}:POLarity? "
        "SOURce{n}:BURSt:STATe? SOURce{n}:BURSt:MODE? SOURce{n}:BURSt:NCYCLes? SOURce{n}:BURSt:PHASe? "
        "SOURce{n}:BURSt:GATE:POLarity? SOURce{n}:BURSt:INTernal:PERiod? OUTPut:SYNC? OUTPut:SYNC:SOURce? "
        "SYSTem:ERRor?"
    ),
    "pymeasure": (
        "SOUR{n}:FUNC? SOUR{n}:FREQ? SOUR{n}:VOLT? SOUR{n}:VOLT:UNIT? SOUR{n}:VOLT:OFFS? SOUR{n}:VOLT:HIGH? "
        "SOUR{n}:VOLT:LOW? SOUR{n}:PHAS? SOUR{n}:FUNC:SQU:DCYC? SOUR{n}:FUNC:RAMP:SYMM? "
        "SOUR{n}:FUNC:PULS:PER? SOUR{n}:FUNC:PULS:HOLD? SOUR{n}:FUNC:PULS:WIDT? SOUR{n}:FUNC:PULS:DCYC? "
        "SOUR{n}:FUNC:PULS:TRAN? OUTP{n}? OUTP{n}:LOAD? SOUR{n}:BURS:STAT? SOUR{n}:BURS:MODE? "
        "SOUR{n}:BURS:INT:PER? SOUR{n}:BURS:NCYC? SOUR{n}:FUNC:ARB? SOUR{n}:FUNC:ARB:ADV? "
        "SOUR{n}:FUNC:ARB:FILT? SOUR{n}:FUNC:ARB:SRAT? FUNC:ARB:FREQ? FUNC:ARB:PER? FUNC:ARB:POIN? "
        "FUNC:ARB:PTP? TRIG:SOUR? OUTP:TRIG? SYST:BEEP:STAT? *OPT? *STB? *OPC? SYST:ERR?"
    ),
    "pylablib": (
        "OUTPUT{n}? OUTPUT{n}:POLARITY? OUTPUT{n}:SYNC? OUTPUT{n}:LOAD? SOURCE{n}:VOLTAGE:LOW? "
        "SOURCE{n}:VOLTAGE:HIGH? SOURCE{n}:VOLTAGE? SOURCE{n}:VOLTAGE:OFFSET? SOURCE{n}:FREQUENCY? "
        "SOURCE{n}:PHASE? SOURCE{n}:FUNCTION? SOURCE{n}:FUNCTION:SQUARE:DCYCLE? "
        "SOURCE{n}:FUNCTION:RAMP:SYMMETRY? SOURCE{n}:FUNCTION:PULSE:WIDTH? SOURCE{n}:BURST:STATE? "
        "SOURCE{n}:BURST:MODE? SOURCE{n}:BURST:NCYCLES? SOURCE{n}:BURST:GATE:POL? OUTPUT{n}:TRIG? "
        "OUTPUT{n}:TRIG:SLOPE? VOLTAGE:UNIT? UNIT:ANGLE?"
    ),
    "instrumentkit": (
        "FUNC? FREQ? VOLT? VOLT:UNIT? VOLT:OFFS? PHAS? FUNC:SQU:DCYC? FUNC:RAMP:SYMM? OUTP? OUTP:SYNC? "
        "OUTP:POL? OUTP:LOAD? SYST:ERR:CODE:ALL? SYST:VERS? *OPC? *TST? *PSC?"
    ),
}


@pytest.mark.parametrize("client", SNAPSHOTS)
@pytest.mark.parametrize("number", [1, 2])
def test_every_header_of_a_full_snapshot_is_answered(client: str, number: int) -> None:
    device = generator()
    for header in SNAPSHOTS[client].format(n=number).split():
        (answer,) = ask(device, header + "\r")
        assert answer, header
    assert codes(device) == []


def test_every_property_that_pymeasure_can_read_is_answered() -> None:
    agilent = pytest.importorskip("pymeasure.instruments.agilent")
    name = "USB0::0x0957::0x2C07::MY1::INSTR"
    device = generator()
    client = agilent.Agilent33500(name, visa_library=EmulatedVisa(PlantClock()).plug(name, device))
    read = 0
    for part in (client, client.ch_1, client.ch_2):
        for key in dir(type(part)):
            if not isinstance(getattr(type(part), key), property):
                continue
            try:
                getattr(part, key)
            except LookupError:  # can only be written
                continue
            read += 1
    assert read > 80
    assert codes(device) == []
    client.adapter.close()


def test_an_error_keeps_nothing_of_the_message_that_made_it() -> None:
    device = SimpleNamespace(status=ScpiDevice("a,b,c,d").status)
    device.status.report(ScpiError(-222, "x" * 10**6))
    assert all(len(entry.text) < 120 for entry in device.status.errors)
