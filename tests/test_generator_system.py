"""What a 33500B or 33600A keeps beside its channels: asked, set, reset, learnt and recalled."""

from __future__ import annotations

import pytest

from belahil.generators import MODELS, GeneratorSetting
from sim.devices.generator import GeneratorDevice


class Port:
    def play(self, setting: GeneratorSetting) -> None:
        pass

    def trigger(self) -> bool:
        return True


def generator(model: str = "33522B") -> GeneratorDevice:
    return GeneratorDevice(MODELS[model], Port())


def ask(device: GeneratorDevice, text: str) -> str:
    device.write(text.encode() + b"\n")
    answer = device.read()
    assert answer is not None, (text, device.status.errors)
    return answer.decode().strip()


def errors(device: GeneratorDevice) -> list[int]:
    found = []
    while code := int(ask(device, "SYST:ERR?").split(",")[0]):
        found.append(code)
    return found


# A header, what it answers after a reset, another value, and what that answers.
SETTINGS = [
    ("ROSC:SOUR", "INT", "EXTernal", "EXT"),
    ("ROSC:SOUR:AUTO", "1", "OFF", "0"),
    ("VOLT:COUP", "0", "ON", "1"),
    ("SOUR2:VOLT:COUP:STAT", "0", "1", "1"),
    ("FREQ:COUP", "0", "ON", "1"),
    ("FREQ:COUP:MODE", "OFFS", "RATIO", "RAT"),
    ("FREQ:COUP:OFFS", "+0.000000000000000E+00", "-2 kHz", "-2.000000000000000E+03"),
    ("FREQ:COUP:RAT", "+1.000000000000000E+00", "2.5", "+2.500000000000000E+00"),
    ("RATE:COUP", "0", "ON", "1"),
    ("SOUR1:MARK:POIN", "+1.000000000000000E+01", "77.4", "+7.700000000000000E+01"),
    ("SOUR2:MARK:CYCL", "+2.000000000000000E+00", "5", "+5.000000000000000E+00"),
    ("MARK:FREQ", "+5.000000000000000E+02", "1 kHz", "+1.000000000000000E+03"),
    ("SOUR1:COMB:FEED", "NONE", "CH2", "CH2"),
    ("OUTP:SYNC:MODE", "NORM", "MARK", "MARK"),
    ("OUTP2:SYNC:POL", "NORM", "INV", "INV"),
    ("DISP:UNIT:VOLT", "AMPL", "HIGH", "HIGH"),
    ("DISP:UNIT:ARBR", "SRAT", "PER", "PER"),
    ("DISP:VIEW", "STAN", "DUAL", "DUAL"),
    ("DISP:FOC", "CH1", "CH2", "CH2"),
    ("SYST:BEEP:STAT", "1", "OFF", "0"),
    ("AM:DEPT", "+1.000000000000000E+02", "30", "+3.000000000000000E+01"),
    ("AM:SOUR", "INT", "CH2", "CH2"),
    ("FM:DEV", "+1.000000000000000E+02", "250", "+2.500000000000000E+02"),
    ("PM:DEV", "+1.800000000000000E+02", "90", "+9.000000000000000E+01"),
    ("FSK:FREQ", "+1.000000000000000E+02", "300", "+3.000000000000000E+02"),
    ("BPSK:PHAS", "+1.800000000000000E+02", "45", "+4.500000000000000E+01"),
    ("PWM:INT:FREQ", "+1.000000000000000E+01", "20", "+2.000000000000000E+01"),
]


@pytest.mark.parametrize("model", ["33522B", "33622A"])
def test_settings_are_remembered_reset_learnt_and_recalled(model: str) -> None:
    # given a generator after a reset
    device, other = generator(model), generator(model)
    for header, first, _, _ in SETTINGS:
        assert ask(device, f"{header}?") == first, header
    # when each is changed, then each is told
    device.write(b"*SAV 1\n")
    for header, _, value, answer in SETTINGS:
        device.write(f"{header} {value}\n".encode())
        assert ask(device, f"{header}?") == answer, header
    # and what is learnt brings them to another generator, a place recalls them, a reset ends them
    other.write(ask(device, "*LRN?").encode() + b"\n*SAV 2\n*RCL 2\n")
    device.write(b"*RCL 1\n")
    for header, first, _, answer in SETTINGS:
        assert (ask(other, f"{header}?"), ask(device, f"{header}?")) == (answer, first), header
    other.write(b"*RST\n")
    assert [ask(other, f"{header}?") for header, *_ in SETTINGS] == [first for _, first, *_ in SETTINGS]
    assert errors(device) == errors(other) == []


def test_one_channel_has_nothing_to_be_tied_to() -> None:
    device = generator("33521B")
    device.write(b"FREQ:COUP?\nVOLT:COUP?\nCOMB:FEED?\n")
    assert errors(device) == [-113] * 3
    assert ask(device, "MARK:CYCL?;:ROSC:SOUR:CURR?") == "+2.000000000000000E+00;INT"


def test_a_channel_with_another_one_added_is_not_played() -> None:
    device = generator()
    device.write(b"OUTP ON\nCOMB:FEED CH2\n")
    assert errors(device) == [901]


def test_places_of_states_have_names_and_may_be_empty() -> None:
    device = generator()
    assert ask(device, "MEM:STAT:CAT?") == '"AUTO_RECALL","STATE_1","STATE_2","STATE_3","STATE_4"'
    assert ask(device, "MEM:NST?") == "+5"
    # when a place is filled and named, then it says so, also after a reset
    device.write(b"*SAV 3\nMEM:STAT:NAME 3,SWEEP_A\n*RST\n")
    assert ask(device, "MEM:STAT:VAL? 3;VAL? 2;NAME? 3") == '1;0;"SWEEP_A"'
    # and when it is emptied, it has its old name
    device.write(b"MEM:STAT:DEL 3\n")
    assert ask(device, "MEM:STAT:VAL? 3;NAME? 3") == '0;"STATE_3"'
    device.write(b"*RCL 3\nMEM:STAT:NAME 9\n")
    assert errors(device) == [810, -222]


def test_remote_control_and_network_are_answered() -> None:
    device = generator()
    device.write(b'SYST:REM;:SYST:RWL;:SYST:LOC\nSYST:COMM:LAN:IPAD "10.0.0.7";UPD\nDISP:TEXT "a ""b"""\n')
    assert (
        ask(device, "SYST:COMM:LAN:IPAD?;IPAD? STAT;SMAS?;DHCP?") == '"10.0.0.7";"10.0.0.7";"255.255.0.0";1'
    )
    assert ask(device, "DISP:TEXT?") == '"a ""b"""'
    # they belong to no state, and are not learnt
    device.write(b"*RST\n")
    assert ask(device, "SYST:COMM:LAN:IPAD?") == '"10.0.0.7"'
    assert "LAN" not in ask(device, "*LRN?")
    device.write(b'SYST:COMM:LAN:IPAD "10.0.0"\n')
    assert errors(device) == [-224]
