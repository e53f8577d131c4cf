"""A client that others wrote for the real instrument drives the emulated one unchanged."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from belahil.generators import MODELS, GeneratorSetting, stimulus_of
from belahil.stimuli import SampledPulse, Sine
from sim.devices.generator import GeneratorDevice
from sim.plant import PlantClock
from sim.transports.visa_library import EmulatedVisa

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
