"""What only the Tektronix AFG or the Siglent SDG does: their words, answers and traps."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from belahil.errors import CorruptData, InstrumentRefused
from belahil.generators import MODELS, GeneratorSetting, family_of, setting_for, stimulus_of
from belahil.stimuli import SampledPulse, Sine
from drivers.generators.families import dialect_of
from drivers.generators.siglent_sdg import SiglentSdgDialect, fields_of
from drivers.generators.verified import VerifiedGenerator
from drivers.scpi import ScpiSession
from drivers.visa_link import VisaLink
from sim.devices.generator_families import generator_device
from sim.devices.generators.siglent_wavedata import WaveData
from sim.devices.scpi import ScpiDevice
from sim.plant import PlantClock
from sim.transports.channels import ScpiWire
from sim.transports.visa_library import EmulatedVisa

ADDRESS = "TCPIP0::emulated::inst0::INSTR"
PULSE = SampledPulse(np.array([0.0, 0.1, -0.05, 0.02, 0.0]), 20e6, 2e-6)
Talk = Callable[[str], str]


class Port:
    """Where a generator plays into, and what it played when it was triggered."""

    def __init__(self) -> None:
        self.setting = GeneratorSetting()
        self.started: list[GeneratorSetting] = []

    def play(self, setting: GeneratorSetting) -> None:
        self.setting = setting

    def trigger(self) -> bool:
        self.started.append(self.setting)
        return True


@pytest.fixture
def port() -> Port:
    return Port()


def _talk(device: ScpiDevice) -> Talk:
    """Send each line; return the last answer."""

    def talk(text: str) -> str:
        device.write(text.encode("latin-1") + b"\n")
        answer = b""
        while (one := device.read()) is not None:
            answer = one
        return answer.decode("latin-1").rstrip("\n")

    return talk


@pytest.fixture
def afg(port: Port) -> Talk:
    return _talk(generator_device(MODELS["AFG3152C"], port))


@pytest.fixture
def sdg(port: Port) -> Talk:
    return _talk(generator_device(MODELS["SDG2042X"], port))


def _driver(device: ScpiDevice, name: str, load_ohm: float = 50.0) -> VerifiedGenerator:
    clock = PlantClock()
    session = ScpiSession(VisaLink(ADDRESS, EmulatedVisa(clock).plug(ADDRESS, device)), clock, ADDRESS)
    return VerifiedGenerator(session, dialect_of(family_of(MODELS[name])), load_ohm, 5.0)


# ---- the AFG


def test_the_afg_answers_after_a_reset(afg: Talk) -> None:
    for query, answer in {
        "*IDN?": "TEKTRONIX,AFG3152C,EMULATED,SCPI:99.0 FV:0.00-emulated",
        "SYST:ERR?": '0,"No error"',
        "SOUR1:FREQ:FIX?": "1.0000E+06",
        "sour1:freq:cw?": "1.0000E+06",
        "SOUR1:VOLT:LEV:IMM:AMPL?": "1.0000E+00",
        "SOURCE1:FUNCTION:SHAPE?": "SIN",
        "OUTP1:IMP?": "50",
        "OUTP1:STAT?": "0",
        "TRIG:SEQ:SOUR?": "TIM",
        "SOUR1:BURS:NCYC?": "5",
        "DATA:POIN? EMEM": "1000",
        "DATA:CAT?": '"EMEM1","EMEM2"',
    }.items():
        assert afg(query) == answer
    assert afg("OUTP1:IMP INF;:OUTP1:IMP?") == "9.9E+37"
    assert afg("SYST:ERR?") == '0,"No error"'


@pytest.mark.parametrize(
    ("command", "query", "becomes", "error"),
    [
        ("SOUR1:VOLT 1MVPP", "SOUR1:VOLT?", 20e-3, -222),
        ("SOUR1:VOLT:AMPL 500MVPP", "SOUR1:VOLT?", 0.5, 0),
        ("SOUR1:FREQ 200MHZ", "SOUR1:FREQ?", 150e6, -222),
        ("SOUR1:VOLT 10VPP;:SOUR1:FREQ 120MHZ", "SOUR1:VOLT?", 8.0, -221),
        ("SOUR1:FREQ 120MHZ;:SOUR1:VOLT 9VPP", "SOUR1:VOLT?", 8.0, -222),
        ("SOUR1:FREQ 120MHZ;:SOUR1:FUNC EMEM", "SOUR1:FREQ?", 75e6, -221),
        ("SOUR1:FUNC SINE", "SOUR1:FREQ?", 1e6, -224),
        ("SOUR1:FUNC USER3", "SOUR1:FREQ?", 1e6, -224),
        ("SOUR5:FREQ 1", "SOUR1:FREQ?", 1e6, -114),
        ("SOUR1:APPL:SIN 1E3", "SOUR1:FREQ?", 1e6, -113),
        ("SOUR1:VOLT:LIM:HIGH 0.6V;:SOUR1:VOLT 2", "SOUR1:VOLT?", 1.2, -222),
        ("SOUR1:BURS:TDEL 123.4567US", "SOUR1:BURS:TDEL?", 123.46e-6, 0),
        ("DATA:DATA EMEM,#16abcdef", "DATA:POIN? EMEM", 3, -222),
        ("DATA:DATA EMEM,#13abc", "DATA:POIN? EMEM", 1000, -161),
        ("DATA:DEF EMEM,1", "DATA:POIN? EMEM", 1000, -222),
        ("DATA:COPY USER2,EMEM;:SOUR2:FUNC USER2;:DATA:DEL USER2", "DATA:POIN? USER2", 1000, -224),
        ("*TRG", "SOUR1:BURS:STAT?", 0, -211),
    ],
)
def test_the_afg_adjusts_and_tells(afg: Talk, command: str, query: str, becomes: float, error: int) -> None:
    afg(command)
    assert float(afg(query)) == pytest.approx(becomes, rel=1e-12)
    assert int(afg("SYST:ERR?").split(",")[0]) == error
    assert afg("SYST:ERR?") == '0,"No error"'


def test_the_largest_count_of_an_afg_is_a_whole_number(afg: Talk) -> None:
    assert afg("SOUR1:BURS:NCYC MAX;NCYC?") == "1000000"


def test_an_afg_takes_the_trigger_of_the_bus_beside_that_of_the_connector(port: Port) -> None:
    # given a burst that waits for the connector
    device = generator_device(MODELS["AFG3152C"], port)
    driver = _driver(device, "AFG3152C")
    driver.prepare(PULSE, "digitizer")
    driver.output(True)
    assert port.setting.trigger_source == "EXT"
    # when it is triggered over the bus, which our driver refuses to do
    with pytest.raises(InstrumentRefused, match="no stimulus waits"):
        driver.trigger()
    device.write(b"*TRG\n")
    # then the same waveform starts, and the connector is waited for again
    (started,) = port.started
    assert started.trigger_source == "BUS"
    assert stimulus_of(started) == stimulus_of(port.setting)
    assert port.setting.trigger_source == "EXT"


def test_points_of_an_afg_are_words_from_0_to_16382(afg: Talk) -> None:
    # given a waveform of the lowest, the middle and the highest word
    words = np.array([0, 8191, 16382], dtype=">u2")
    afg("DATA:DATA EMEM,#16" + words.tobytes().decode("latin-1"))
    # then they come back, one by one, all together, and from a copy
    assert [afg(f"DATA:DATA:VAL? EMEM,{place}") for place in (1, 2, 3)] == ["0", "8191", "16382"]
    assert afg("DATA:COPY USER1,EMEM;:TRAC? USER1") == "#16" + words.tobytes().decode("latin-1")
    afg("SOUR1:FUNC USER1;:DATA:DATA:VAL EMEM,2,16383")
    assert afg("DATA:VAL? EMEM,2") == "16382"
    assert afg("DATA:VAL? USER1,2;:SOUR1:FUNC?") == "8191;USER1"
    assert afg("SYST:ERR?").startswith("-222")


@pytest.mark.parametrize("last", [0.0, 4.0])
def test_sines_of_an_afg_pass_from_one_limit_to_the_other(port: Port, last: float) -> None:
    # given that the largest amplitude falls with frequency
    device = generator_device(MODELS["AFG3252C"], port)
    driver = _driver(device, "AFG3252C")
    for sine in (Sine(1e6, 4.9), Sine(230e6, 3.9), Sine(2e6, 4.9), Sine(239e6, last or 0.1)):
        # when one sine follows the other, then no error is raised on the way
        driver.prepare(sine, "immediate")
        driver.output(True)
        assert stimulus_of(port.setting) == sine


# ---- the SDG


def test_the_sdg_answers_after_a_reset(sdg: Talk) -> None:
    for query, answer in {
        "*IDN?": "Siglent Technologies,SDG2042X,EMULATED,0.00-emulated",
        "C1:BSWV?": "C1:BSWV WVTP,SINE,FRQ,1000HZ,PERI,0.001S,AMP,4V,AMPVRMS,1.414Vrms,OFST,0V,"
        "HLEV,2V,LLEV,-2V,PHSE,0",
        "C1:OUTP?": "C1:OUTP OFF,LOAD,HZ,PLRT,NOR",
        "c2:outp?": "C2:OUTP OFF,LOAD,HZ,PLRT,NOR",
        "C1:BTWV?": "C1:BTWV STATE,OFF",
        "C1:SRATE?": "C1:SRATE MODE,DDS",
        "C1:BSWV FRQ,12345678.9;C1:OUTP LOAD,50;C1:BSWV WVTP,DC;C1:BSWV?": "C1:BSWV WVTP,DC,OFST,0V",
        "*OPC?": "1",
    }.items():
        assert sdg(query) == answer


@pytest.mark.parametrize(
    ("command", "query", "key", "becomes"),
    [
        ("C1:BSWV FRQ,50MHZ", "C1:BSWV?", "FRQ", "40000000HZ"),
        ("C1:BSWV FRQ,30e6", "C1:BSWV?", "FRQ", "30000000HZ"),
        ("C1:BSWV AMP,15V;C1:BSWV FRQ,30e6", "C1:BSWV?", "AMP", "10V"),
        ("C1:BSWV AMP,0.0001", "C1:BSWV?", "AMP", "0.002V"),
        ("C1:BSWV AMP,50mV", "C1:BSWV?", "AMP", "0.05V"),
        ("C1:BSWV WVTP,SQUARE,FRQ,30e6", "C1:BSWV?", "FRQ", "25000000HZ"),
        ("C1:OUTP LOAD,10", "C1:OUTP?", "LOAD", "50"),
        ("C1:OUTP LOAD,50", "C1:BSWV?", "AMP", "2V"),
        ("C1:BSWV AMP,0.002;C1:OUTP LOAD,50", "C1:BSWV?", "AMP", "0.001V"),
        ("C1:OUTP ON,LOAD,75,PLRT,INVT", "C1:OUTP?", "PLRT", "INVT"),
        ("C1:BTWV TRSR,MAN", "C1:BTWV?", "STATE", "OFF"),
        ("C1:BTWV STATE,ON,DLAY,2.4e-07S", "C1:BTWV?", "DLAY", "2.4E-07S"),
        ("C1:SRATE MODE,TARB,VALUE,90000000", "C1:SRATE?", "VALUE", "75000000SA/S"),
    ],
)
def test_the_sdg_changes_what_cannot_be_without_a_word(
    sdg: Talk, command: str, query: str, key: str, becomes: str
) -> None:
    sdg(command)
    assert fields_of(sdg(query))[key] == becomes
    assert sdg("SYST:ERR?") == '0,"No error"'


def test_the_sdg_queues_what_it_does_not_know(sdg: Talk) -> None:
    for command, code in {"SOUR1:FREQ 1": -113, "C3:OUTP ON": -114, "C1:ARWV NAME,NONE": -224}.items():
        sdg(command)
        assert int(sdg("SYST:ERR?").split(",")[0]) == code


def test_the_default_load_of_an_sdg_is_no_trap(port: Port) -> None:
    # given an instrument whose numbers are open-circuit volts until it is told otherwise
    device = generator_device(MODELS["SDG2042X"], port)
    _talk(device)("C1:BSWV AMP,0.1;C1:OUTP ON")
    assert (port.setting.load_ohm, port.setting.amplitude_vpp) == (math.inf, 0.1)
    # when a driver for a load of 50 ohm plays the same number
    driver = _driver(device, "SDG2042X")
    driver.prepare(Sine(1e6, 0.1), "immediate")
    driver.output(True)
    # then the setting says 50 ohm, which is twice as much behind the source
    assert (port.setting.load_ohm, port.setting.amplitude_vpp) == (50.0, 0.1)


def test_a_change_that_the_sdg_does_not_tell_of_is_found(port: Port) -> None:
    # given an instrument that makes less than its model can
    device = generator_device(MODELS["SDG2042X"], port)
    driver = _driver(device, "SDG2042X")
    write = device.write

    def limited(data: bytes, end: bool = False) -> None:
        write(data.replace(b"AMP,0.1", b"AMP,0.09"), end)

    device.write = limited  # type: ignore[method-assign]
    # when a sine is prepared, then what came back is told, and the output is off
    with pytest.raises(CorruptData, match=r"was to give WVTP,SINE.*AMP,0\.1.* answers .*AMP,0\.09V"):
        driver.prepare(Sine(1e6, 0.1), "immediate")
    assert not port.setting.output


def test_answers_of_an_sdg_are_compared_to_the_digits_that_it_shows() -> None:
    dialect = SiglentSdgDialect()
    setting = setting_for(Sine(12.3456789e6, 0.03, -0.0011), MODELS["SDG2042X"])
    (wave,) = (one for one in dialect.items(setting, MODELS["SDG2042X"]) if "BSWV" in one.query)
    said = "C1:BSWV WVTP,SINE,FRQ,{}HZ,PERI,8.1e-08S,AMP,{}V,OFST,-0.0011V,PHSE,0"
    assert dialect.agrees(said.format("12345678.9", "0.03"), wave.expected)
    assert dialect.agrees(said.format("12345678.91", "0.03"), wave.expected)
    assert not dialect.agrees(said.format("12345679", "0.03"), wave.expected)
    assert not dialect.agrees(said.format("12345678.9", "0.03001"), wave.expected)
    assert not dialect.agrees("C1:BSWV WVTP,SINE", wave.expected)
    assert not dialect.agrees("", wave.expected)


# ---- waveforms as bare bytes

BARE = st.binary(min_size=16, max_size=60).map(lambda data: data[: len(data) // 2 * 2])


def _blocked(data: bytes, head: bytes = b"C1:WVDT WVNM,W,WAVEDATA,") -> bytes:
    length = str(len(data)).encode()
    return head + b"#%d%b%b" % (len(length), length, data)


def _cut(stream: bytes, places: list[int]) -> Iterator[bytes]:
    edges = sorted({0, len(stream), *(place % len(stream) for place in places)})
    for first, last in itertools.pairwise(edges):
        yield stream[first:last]


@given(BARE, st.lists(st.integers(0, 10_000), max_size=6))
def test_points_with_a_length_come_whole_however_the_stream_is_cut(data: bytes, places: list[int]) -> None:
    # given points that may be line feeds, between two other messages
    head = b"C1:WVDT WVNM,W,LENGTH,%dB,WAVEDATA," % len(data)
    stream = b"*CLS\n" + head + data + b"\nC1:OUTP?\n"
    wave = WaveData()
    # when they arrive in any portions
    made = b"".join(wave.feed(piece, end=False) for piece in _cut(stream, places))
    # then a block stands in their place
    assert made == b"*CLS\n" + _blocked(data, head) + b"\nC1:OUTP?\n"


@given(BARE, st.booleans())
def test_points_without_a_length_last_until_the_end(data: bytes, line_feed: bool) -> None:
    stream = b"C1:WVDT WVNM,W,WAVEDATA," + data + b"\n" * line_feed
    # given END, or a stream that pauses after a line feed
    assert WaveData().feed(stream, end=True) == _blocked(data) + b"\n" * line_feed
    if line_feed:
        assert WaveData().feed(stream, end=False) == _blocked(data) + b"\n"


def test_a_waveform_is_uploaded_over_a_raw_socket_and_comes_back(port: Port) -> None:
    # given a client at a socket, whose bytes have no END, and points of 0x0A0A
    device = generator_device(MODELS["SDG2042X"], port)
    wire, data = ScpiWire(device), b"\n\n" * 20
    # when it sends them as the vendor's example does
    wire.feed(b"C1:WVDT WVNM,wave1,FREQ,2000.0,AMPL,4.0,OFST,0.0,PHASE,0.0,WAVEDATA," + data + b"\n")
    wire.feed(b"C1:ARWV NAME,wave1\nC1:ARWV?\nWVDT? USER,wave1\n")
    # then they are there
    said = wire.take()
    assert said.startswith(b"C1:ARWV INDEX,2,NAME,wave1\n")
    assert said.endswith(b"LENGTH,40B,FREQ,1000HZ,AMPL,4V,OFST,0V,PHASE,0,WAVEDATA," + data + b"\n")


def test_an_upload_that_is_cut_short_is_no_waveform(port: Port) -> None:
    device = generator_device(MODELS["SDG2042X"], port)
    for data in (b"1234", b""):
        device.write(b"C1:WVDT WVNM,W,LENGTH,40B,WAVEDATA," + data, end=True)
        assert _talk(device)("SYST:ERR?").startswith("-161")
    assert _talk(device)("STL? USER") == "STL WVNM"


def test_an_sdg_starts_a_burst_by_hand(port: Port) -> None:
    device = generator_device(MODELS["SDG2042X"], port)
    driver = _driver(device, "SDG2042X")
    played = driver.prepare(PULSE, "generator")
    driver.output(True)
    driver.trigger()
    (started,) = port.started
    assert stimulus_of(started) == played
    # and not one that waits for the connector
    driver.prepare(PULSE, "digitizer")
    driver.output(True)
    device.write(f"{SiglentSdgDialect.trigger}\n".encode())
    assert len(port.started) == 1
