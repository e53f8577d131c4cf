"""A client that others wrote for the real instrument drives the emulated one unchanged."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import pyvisa

from belahil.generators import MODELS, GeneratorSetting, stimulus_of
from belahil.stimuli import SampledPulse, Sine
from sim.devices.generator import GeneratorDevice
from sim.devices.generator_families import generator_device
from sim.plant import PlantClock
from sim.transports.visa_library import EmulatedVisa
from tests.served import served

agilent = pytest.importorskip("pymeasure.instruments.agilent")
NAME = "USB0::0x0957::0x2C07::MY1::INSTR"


class Port:
    """Where the generator plays into."""

    def __init__(self) -> None:
        self.setting = GeneratorSetting()
        self.triggers = 0

    def play(self, setting: GeneratorSetting) -> None:
        self.setting = setting

    def trigger(self) -> bool:
        self.triggers += 1
        return True


@pytest.fixture
def port() -> Port:
    return Port()


@pytest.fixture
def client(port: Port) -> Iterator[Any]:
    library = EmulatedVisa(PlantClock()).plug(NAME, GeneratorDevice(MODELS["33522B"], port))
    instrument = agilent.Agilent33500(NAME, visa_library=library)
    yield instrument
    assert instrument.check_errors() == []
    instrument.adapter.close()


@pytest.fixture(params=["SOCKET", "INSTR"])
def far_client(request: pytest.FixtureRequest) -> Iterator[Any]:
    """The same class at a served bench, over raw TCP and over HiSLIP."""
    with served() as (places, _):
        address = places.address if request.param == "SOCKET" else places.hislip_address
        ends = {"read_termination": "\n", "write_termination": "\n"}
        instrument = agilent.Agilent33500(address, visa_library="@py", **ends)
        yield instrument
        assert instrument.check_errors() == []
        instrument.adapter.close()
        instrument.adapter.manager.close()


def test_pymeasure_drives_a_served_generator(far_client: Any) -> None:
    # a sine
    channel = far_client.ch_1
    channel.shape = "SIN"
    channel.frequency = 5e6
    channel.amplitude_unit = "VPP"
    channel.amplitude = 0.25
    channel.offset = 0.05
    channel.output = True
    assert (channel.shape, channel.frequency, channel.amplitude, channel.offset) == ("SIN", 5e6, 0.25, 0.05)
    assert far_client.check_errors() == []
    # an arbitrary waveform, as one cycle for each trigger of the bus
    channel.data_volatile_clear()
    channel.data_arb("test_wave", [0.0, 0.5, 1.0, 0.5, 0.0, -0.5, -1.0, 0.0], data_format="float")
    channel.arb_file = "test_wave"
    channel.shape = "ARB"
    channel.arb_srate = 80e6
    channel.amplitude = 0.2
    channel.burst_state = True
    channel.burst_mode = "TRIG"
    channel.burst_ncycles = 1
    far_client.trigger_source = "BUS"
    channel.output = True
    far_client.trigger()
    assert (channel.shape, channel.arb_srate, channel.burst_ncycles) == ("ARB", 80e6, 1)
    assert far_client.check_errors() == []
    # and a burst of a sine
    channel.shape = "SIN"
    channel.burst_ncycles = 5
    far_client.trigger()
    assert (channel.shape, channel.burst_state, channel.burst_ncycles) == ("SIN", True, 5)


def test_pymeasure_plays_a_sine(client: Any, port: Port) -> None:
    assert client.id == "Agilent Technologies,33522B,EMULATED,0.00-emulated"
    channel = client.ch_1
    channel.shape = "SIN"
    channel.frequency = 5e6
    channel.amplitude_unit = "VPP"
    channel.amplitude = 0.25
    channel.offset = 0.05
    channel.phase = 0
    channel.output = True
    assert client.check_errors() == []
    assert (channel.shape, channel.frequency, channel.amplitude, channel.offset) == ("SIN", 5e6, 0.25, 0.05)
    assert stimulus_of(port.setting) == Sine(5e6, 0.25, 0.05)


def test_pymeasure_triggers_a_burst_of_an_arbitrary_waveform(client: Any, port: Port) -> None:
    channel = client.ch_1
    channel.data_volatile_clear()
    channel.data_arb("test_wave", [0.0, 0.5, 1.0, 0.5, 0.0, -0.5, -1.0, 0.0], data_format="float")
    channel.arb_file = "test_wave"
    channel.shape = "ARB"
    channel.arb_srate = 80e6
    channel.amplitude = 0.2
    channel.burst_state = True
    channel.burst_mode = "TRIG"
    channel.burst_ncycles = 1
    client.trigger_source = "BUS"
    channel.output = True
    client.trigger()
    assert client.check_errors() == []
    assert port.triggers == 1
    played = stimulus_of(port.setting)
    assert isinstance(played, SampledPulse)
    assert played.volts == pytest.approx(0.1 * np.array([0, 0.5, 1, 0.5, 0, -0.5, -1, 0]), abs=0.1 / 32767)


def test_pymeasure_hears_of_what_is_refused(client: Any) -> None:
    client.write("FREQ 1E9")
    ((number, text),) = client.check_errors()
    assert int(number) == -222
    assert "Data out of range" in text


@pytest.fixture
def client_33220(port: Port) -> Iterator[Any]:
    library = EmulatedVisa(PlantClock()).plug(NAME, generator_device(MODELS["33220A"], port))
    with pytest.warns(FutureWarning, match="SCPI"):  # its authors do not know that a 33220A speaks SCPI
        instrument = agilent.Agilent33220A(NAME, visa_library=library)
    yield instrument
    assert instrument.check_errors() == []
    instrument.adapter.close()


def test_pymeasure_plays_a_sine_on_a_33220a(client_33220: Any, port: Port) -> None:
    client = client_33220
    assert client.id == "Agilent Technologies,33220A,EMULATED,0.00-emulated"
    client.shape = "SINUSOID"
    client.amplitude_unit = "VPP"
    client.frequency = 4.7e3
    client.amplitude = 1
    client.offset = 0.25
    client.output = True
    assert client.check_errors() == []
    assert (client.shape, client.frequency, client.amplitude, client.offset) == ("SIN", 4.7e3, 1, 0.25)
    assert (client.voltage_high, client.voltage_low) == (0.75, -0.25)
    assert stimulus_of(port.setting) == Sine(4.7e3, 1.0, 0.25)


def test_pymeasure_sets_everything_else_of_a_33220a(client_33220: Any, port: Port) -> None:
    client = client_33220
    for name, value in {
        "square_dutycycle": 40,
        "ramp_symmetry": 30,
        "pulse_period": 1e-3,
        "pulse_hold": "WIDT",
        "pulse_width": 1e-4,
        "pulse_dutycycle": 12,
        "burst_mode": "TRIG",
        "burst_ncycles": 10,
        "burst_state": True,
        "trigger_source": "BUS",
        "trigger_state": True,
        "beeper_state": False,
        "output": True,
    }.items():
        setattr(client, name, value)
        read = getattr(client, name)
        assert read == (value if isinstance(value, str) else pytest.approx(value)), name
    client.pulse_transition = 20e-9
    client.remote_local_state = "LOC"
    client.trigger()
    client.wait_for_trigger()
    client.beep()
    assert port.triggers == 1


def test_pymeasure_plays_a_sine_on_a_dg1062z(port: Port) -> None:
    # given its class for the sister family DG800, whose words these are too
    rigol = pytest.importorskip("pymeasure.instruments.rigol.rigol_dg800")
    library = EmulatedVisa(PlantClock()).plug(NAME, generator_device(MODELS["DG1062Z"], port))
    client = rigol.DG800(NAME, visa_library=library)
    channel = client.channel_1
    channel.high_impedance = False
    assert channel.load == 50
    channel.sine = (5e6, 0.25, 0.05, 0)
    channel.output_enabled = True
    assert (channel.shape, channel.frequency, channel.output_enabled) == ("SIN", 5e6, True)
    assert stimulus_of(port.setting) == Sine(5e6, 0.25, 0.05)
    channel.high_impedance = True
    assert channel.load == 9.9e37
    assert channel.waveform[1:4] == [5e6, 0.5, 0.1]
    for name, value in (("pulse_width", 1e-4), ("duty_cycle", 30.0), ("sync_enabled", False)):
        setattr(channel, name, value)
        assert getattr(channel, name) == pytest.approx(value)
    channel.output_enabled = False  # what the plant does not play is an error when the output is on
    channel.pulse = (1e5, 1.0, 0.0, 0.0)
    assert channel.shape == "PULS"
    channel.dc = 0.5
    assert channel.shape == "DC"
    assert client.check_errors() == []
    client.adapter.close()


@pytest.fixture
def client_afg(port: Port) -> Iterator[Any]:
    tektronix = pytest.importorskip("pymeasure.instruments.tektronix")
    library = EmulatedVisa(PlantClock()).plug(NAME, generator_device(MODELS["AFG3152C"], port))
    with pytest.warns(FutureWarning, match="SCPI"):  # its authors do not know that it speaks SCPI
        instrument = tektronix.AFG3152C(NAME, visa_library=library)
    yield instrument
    assert instrument.check_errors() == []
    instrument.adapter.close()


def test_pymeasure_plays_a_sine_on_an_afg(client_afg: Any, port: Port) -> None:
    client, channel = client_afg, client_afg.ch1
    assert client.id == "TEKTRONIX,AFG3152C,EMULATED,SCPI:99.0 FV:0.00-emulated"
    client.reset()
    channel.waveform(shape="SIN", frequency=5e6, units="VPP", amplitude=0.25, offset=0.05)
    # Its `enable` and `impedance` name headers that no AFG has.
    client.write("output1:impedance 50ohm")
    client.write("output1:state on")
    assert client.check_errors() == []
    assert (channel.shape, channel.frequency, channel.amp_vpp, channel.offset) == (
        "sinusoidal",
        5e6,
        0.25,
        0.05,
    )
    assert channel.unit == "VPP"
    assert stimulus_of(port.setting) == Sine(5e6, 0.25, 0.05)
    client.write("output1:state off")
    assert not port.setting.output


def test_pymeasure_sets_everything_else_of_an_afg(client_afg: Any, port: Port) -> None:
    client, channel = client_afg, client_afg.ch2
    for shape in channel.SHAPES:
        channel.shape = shape
        assert channel.shape == shape
    channel.shape = "pulse"
    channel.duty = 30
    assert channel.duty == 30
    channel.shape = "sinusoidal"
    channel.unit = "VRMS"
    channel.amp_vrms = 0.5
    assert channel.amp_vrms == 0.5
    channel.unit = "DBM"
    channel.amp_dbm = 0
    assert channel.amp_dbm == pytest.approx(0, abs=0.01)
    client.beep()
    assert client.opc() == 1


def test_a_trigger_may_be_named_by_its_source(client: Any) -> None:
    # as pylablib does
    client.write("SOURCE1:TRIG:SOURCE BUS")
    client.write("SOURCE1:TRIG:SLOPE NEG")
    assert client.ask("TRIG1:SOUR?;SLOP?").strip() == "BUS;NEG"
    assert client.ask("SOURCE1:TRIG:SOURCE?").strip() == "BUS"
    client.write("SOURCE1:OUTPUT:TRIG ON")
    assert client.ask("OUTP:TRIG?;:SOURCE1:OUTPUT:TRIG?;:SOURCE1:OUTPUT:TRIG:SLOPE?").strip() == "1;1;POS"
    # and a list of all settings has it under its own name alone
    settings = client.ask("*LRN?")
    assert settings.count(":TRIG1:SOUR BUS") == 1
    assert "SOUR1:TRIG" not in settings
    assert "SOUR1:OUTP" not in settings


def asked(client: Any, *pairs: tuple[str, str]) -> None:
    """Set each and read it back."""
    for header, value in pairs:
        client.write(f"{header} {value}")
        assert client.ask(f"{header}?").strip().lstrip("+") == value, header
    assert client.check_errors() == []


def test_modulations_are_remembered(client: Any, port: Port) -> None:
    # as Instro sets them
    asked(
        client,
        ("AM:SOUR", "EXT"),
        ("AM:INT:FUNC", "SQU"),
        ("FM:INT:FUNC", "RAMP"),
        ("PM:INT:FUNC", "SIN"),
        ("FSK:SOUR", "INT"),
        ("BPSK:SOUR", "EXT"),
    )
    for header in ("AM:INT:FREQ", "AM:DEPT", "FM:DEV", "PM:DEV", "PWM:DEV", "FSK:INT:RATE", "FSK:FREQ"):
        client.write(f"SOUR2:{header} 12")
        assert float(client.ask(f"SOUR2:{header}?")) == 12
    assert client.check_errors() == []
    # and are kept and brought back, and in the list of all settings
    client.write("BPSK 90;*SAV 1;:BPSK 45;*RCL 1")
    assert float(client.ask("BPSK:PHAS?")) == 90
    assert re.search(r":SOUR2:FM\S* \+1\.20*E\+01;", client.ask("*LRN?"))
    # and one that is on plays nothing
    client.write("OUTP ON")
    assert stimulus_of(port.setting) is not None
    client.write("AM:STAT ON")
    assert client.check_errors()[0][0] == 901
    client.write("AM:STAT OFF")


def test_a_dg1062z_tells_what_a_burst_leaves(port: Port) -> None:
    # as QCoDeS asks
    library = EmulatedVisa(PlantClock()).plug(NAME, generator_device(MODELS["DG1062Z"], port))
    line: Any = pyvisa.ResourceManager(library).open_resource(
        NAME, read_termination="\n", write_termination="\n"
    )
    for header, value in (("SOUR1:BURST:IDLE", "CENTER"), ("OUTPUT2:GAT:POL", "NEGATIVE")):
        line.write(f":{header} {value}")
        assert line.query(f":{header}?") == value
    assert line.query("SYST:ERR?").startswith("0,")


def test_modulations_of_an_afg_are_remembered(client_afg: Any, port: Port) -> None:
    # as QCoDeS sets them
    asked(
        client_afg,
        ("SOURce2:AM:SOURce", "EXT"),
        ("SOURce1:FM:INTernal:FUNCtion", "TRI"),
        ("SOURce1:FSKey:STATe", "0"),
        ("SOURce1:SWEep:SPACing", "LOG"),
        ("SOURce1:FREQuency:CONCurrent", "1"),
    )
    for header in ("AM:DEPTh 20PCT", "FREQuency:STARt 2000Hz", "SWEep:TIME 0.02s", "PULSe:WIDTh 2E-6s"):
        client_afg.write(f"SOURce1:{header}")
        value = float(header.split()[1].rstrip("PCTHzs"))
        assert float(client_afg.ask(f"SOURce1:{header.split()[0]}?")) == value
    client_afg.write("output1:state on")
    client_afg.write("SOURce1:PM:STATe ON")
    assert client_afg.check_errors()[0][0] == 901
    client_afg.write("SOURce1:PM:STATe OFF;:output1:state off")


def test_an_afg_remembers_files_noise_and_its_timer_and_adds_no_signal(client_afg: Any, port: Port) -> None:
    # as QCoDeS asks
    for header, answer in (
        ("SOURce1:FUNCtion:EFILe", '"A ""B"".TFW"'),
        ("SOURce2:AM:INTernal:FUNCtion:EFILe", '"M.TFW"'),
        ("SOURce2:COMBine:FEED", '""'),
    ):
        client_afg.write(f"{header} {answer}")
        assert client_afg.ask(f"{header}?").strip() == answer
    for header, value in (
        ("TRIGger:SEQuence:TIMer", "0.5s"),
        ("SOURce3:POWer:LEVel:IMMediate:AMPLitude", "10PCT"),
        ("SOUR4:POW", "20PCT"),
    ):
        client_afg.write(f"{header} {value}")
        assert float(client_afg.ask(f"{header}?")) == float(value.rstrip("sPCT"))
    assert float(client_afg.ask("SOURce3:POWer?")) == 10
    # and noise that is added plays nothing
    client_afg.write("output1:state on;:SOURce1:COMBine:FEED 'NOISe'")
    assert client_afg.check_errors()[0][0] == 901
    assert client_afg.ask("SOURce1:COMBine:FEED?").strip() == "NOIS"
    client_afg.write("SOURce1:COMBine:FEED '';:output1:state off")


def test_an_sdg_tells_that_modulations_and_sweeps_are_off(port: Port) -> None:
    # as QCoDeS asks
    library = EmulatedVisa(PlantClock()).plug(NAME, generator_device(MODELS["SDG2042X"], port))
    line: Any = pyvisa.ResourceManager(library).open_resource(
        NAME, read_termination="\n", write_termination="\n"
    )
    for word in ("MDWV", "SWWV"):
        line.write(f"C2:{word} STATE,OFF")
        assert line.query(f"C2:{word}?") == f"C2:{word} STATE,OFF"
        assert line.query("SYST:ERR?").startswith("0,")
        line.write(f"C2:{word} STATE,ON")
        assert line.query("SYST:ERR?").startswith("-221,")
    assert line.query("C1:SYNC?") == "C1:SYNC OFF"
    line.write("C1:SYNC ON,TYPE,CH2")
    assert line.query("C1:SYNC?") == "C1:SYNC ON,TYPE,CH2"
    line.write("C1:INVT ON")
    assert line.query("C1:INVT?;C1:OUTP?") == "C1:INVT ON;C1:OUTP OFF,LOAD,HZ,PLRT,INVT"
