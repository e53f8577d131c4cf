"""``belahil bench new``: it lists what is there, asks nobody without consent, and writes what it found."""

from __future__ import annotations

import io
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from pyvisa.rname import to_canonical_name

from belahil.cli.main import main
from belahil.config import load_bench
from sim.build import endpoints
from sim.transports.visa_library import EmulatedVisa

Captured = pytest.CaptureFixture[str]
AFG, SCOPE, METER, OTHER = (
    to_canonical_name(name)
    for name in (
        "USB0::2391::11271::MY1::INSTR",
        "TCPIP0::10.0.0.7::INSTR",
        "GPIB0::3::INSTR",
        "GPIB0::9::INSTR",
    )
)
ANSWERS = {
    AFG: "Agilent Technologies,33522B,MY1,1.0",
    SCOPE: "KEYSIGHT TECHNOLOGIES,DSOX1204G,CN1,2.0",
    METER: "Somebody,Voltmeter 3,7,1.0",
}


class Instrument:
    """Answers ``*IDN?``, and notes that it was asked."""

    def __init__(self, identity: str, asked: list[str]) -> None:
        self.identity, self.asked, self.out = identity, asked, b""

    def write(self, data: bytes, end: bool = True) -> None:
        self.asked.append(self.identity)
        self.out = self.identity.encode() + b"\n" if data == b"*IDN?\n" else b""

    def read(self) -> bytes | None:
        found, self.out = self.out, b""
        return found or None

    def clear(self) -> None:
        self.out = b""

    def read_stb(self) -> int:
        return 0


class Laboratory:
    """What the three libraries list, and who was asked."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        import pyvisa

        self.asked: list[str] = []
        self.visa: dict[str, str] = {}
        self.ports: list[Any] = []
        self.devices: list[Any] = []
        real, self.stdin = pyvisa.ResourceManager, ""

        def manager(library: Any = "") -> Any:
            from belahil.clock import SystemClock

            emulated = EmulatedVisa(SystemClock())
            for name, identity in self.visa.items():
                emulated.plug(name, Instrument(identity, self.asked))
            return real(emulated)

        monkeypatch.setattr("pyvisa.ResourceManager", manager)
        monkeypatch.setattr("serial.tools.list_ports.comports", lambda: self.ports)
        monkeypatch.setattr("usb.core.find", lambda find_all: iter(self.devices))
        self._monkeypatch = monkeypatch

    def says(self, *answers: str) -> None:
        self._monkeypatch.setattr("sys.stdin", io.StringIO("".join(f"{one}\n" for one in answers)))


class Port(SimpleNamespace):
    def __lt__(self, other: Port) -> bool:
        return bool(self.device < other.device)


def usb_device(interface_class: int = 0xFF, subclass: int = 0, **words: Any) -> Any:
    ends = [SimpleNamespace(bmAttributes=2, bEndpointAddress=address) for address in (0x81, 0x01)]

    class Described(list[Any]):
        """A list with the attributes that pyusb gives to it."""

    interface, device = Described(ends), Described()
    interface.__dict__.update(bInterfaceClass=interface_class, bInterfaceSubClass=subclass)
    device.append([interface])
    names = {"manufacturer": "Maker", "product": "Receiver", "serial_number": "S1"}
    numbers = {"idVendor": 0x1209, "idProduct": 0x0001, "bDeviceClass": words.get("device_class", 0)}
    device.__dict__.update(names | numbers)
    return device


@pytest.fixture
def laboratory(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Laboratory:
    monkeypatch.chdir(tmp_path)
    return Laboratory(monkeypatch)


def test_a_search_lists_all_and_asks_nobody_without_consent(laboratory: Laboratory, capsys: Captured) -> None:
    # given a generator, a serial port, a receiver on USB, a hub, and an instrument that VISA lists already
    laboratory.visa = {AFG: ANSWERS[AFG], "ASRL1::INSTR": "listed as a port"}
    laboratory.ports = [Port(device="COM3", description="USB Serial"), Port(device="COM1", description="n/a")]
    laboratory.devices = [usb_device(), usb_device(device_class=9), usb_device(0xFE, 3)]
    # when the user looks for them and lets nothing be asked
    laboratory.says(*"nnnn", "", "", "0.3")
    assert main(["bench", "new", "--search"]) == 0
    # then each is a line, nobody was sent anything, and the bench is emulated
    out = capsys.readouterr().out
    found = [line for line in out.splitlines() if line.startswith("found")]
    assert found == [
        f"found {AFG}",
        "found serial:COM1",
        "found serial:COM3 (USB Serial)",
        "found usb:1209:0001:S1 (Maker Receiver)",
    ]
    assert laboratory.asked == []
    assert load_bench("bench.toml").source == "emulated"
    assert load_bench("bench.toml").generator.max_vpp == 0.3


def test_what_the_user_agrees_to_is_asked_and_written(laboratory: Laboratory, capsys: Captured) -> None:
    # given three instruments of which the user lets two be asked, and answers to what is missing
    laboratory.visa = ANSWERS
    laboratory.says("y", "y", "n", "inf", "6", "0.2")
    assert main(["bench", "new", "--search"]) == 0
    # then only those were asked
    assert laboratory.asked == [ANSWERS[AFG], ANSWERS[SCOPE]]
    assert capsys.readouterr().out.count("found ") == 3
    # and the numbers are those that the user told
    generator = load_bench("bench.toml").generator
    assert (generator.load_ohm, generator.attenuation_db, generator.max_vpp) == (math.inf, 6.0, 0.2)


def test_a_probe_finds_generator_and_oscilloscope(laboratory: Laboratory, capsys: Captured) -> None:
    laboratory.visa = ANSWERS
    assert main(["bench", "new", "--probe", "--defaults", "--attenuation-db", "20"]) == 0
    out = capsys.readouterr().out
    assert f"{AFG}: {ANSWERS[AFG]} (generator, driver keysight-33500)" in out
    assert f"{METER}: {ANSWERS[METER]} (no driver is for it)" in out
    config = load_bench("bench.toml")
    assert (config.source, config.generator.address, config.generator.attenuation_db) == (
        "hardware",
        AFG,
        20.0,
    )
    assert (config.digitizer.driver, config.digitizer.link) == ("keysight-infiniivision", f"visa:{SCOPE}")
    assert config.digitizer.receiver == "analog"


def test_a_receiver_on_a_serial_line_is_known_by_its_link(laboratory: Laboratory, capsys: Captured) -> None:
    # given an emulated receiver behind pyserial, and a port at which nobody answers
    ends = endpoints(load_bench("emulated"))
    laboratory.visa = {AFG: ANSWERS[AFG]}
    laboratory.ports = [
        Port(device=ends.serial_url, description="receiver"),
        Port(device="nowhere", description=None),
    ]
    assert main(["bench", "new", "--probe", "--defaults"]) == 0
    out = capsys.readouterr().out
    assert "belahil,bela-grm" in out
    assert "(digitizer, driver grm)" in out
    assert "serial:nowhere: serial link nowhere does not open" in out
    assert load_bench("bench.toml").digitizer.link == f"serial:{ends.serial_url}"


def test_which_of_two_generators_is_the_users_choice(laboratory: Laboratory, capsys: Captured) -> None:
    laboratory.visa = {AFG: ANSWERS[AFG], OTHER: "Agilent Technologies,33220A,X,1"}
    # given two of a kind, a program that may not ask refuses
    assert main(["bench", "new", "--probe", "--defaults"]) == 2
    assert "2 instruments can be the generator" in capsys.readouterr().err
    # and a user chooses, tells the link that was not found, and takes the defaults
    laboratory.says("2", "serial:COM3", "", "", "")
    assert main(["bench", "new", "--probe"]) == 0
    config = load_bench("bench.toml")
    (second,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("2: ")]
    assert second.startswith(f"2: {config.generator.address}, ")
    assert config.digitizer.link == "serial:COM3"
    assert (config.generator.load_ohm, config.generator.max_vpp) == (50.0, 0.5)


def test_a_library_that_fails_is_a_line_and_the_others_are_asked(
    laboratory: Laboratory, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    import usb.core

    def none(find_all: bool) -> Any:
        raise usb.core.NoBackendError("No backend available")

    monkeypatch.setattr("usb.core.find", none)
    laboratory.ports = [Port(device="COM3", description=None)]
    assert main(["bench", "new", "--search", "--defaults"]) == 0
    out = capsys.readouterr().out
    assert "pyusb cannot be asked: No backend available" in out
    assert "found serial:COM3" in out


def test_an_emulated_oscilloscope_is_written_too(laboratory: Laboratory) -> None:
    assert main(["bench", "new", "--digitizer", "keysight-infiniivision"]) == 0
    config = load_bench("bench.toml")
    assert (config.digitizer.link, config.digitizer.receiver) == ("emulated:visa", "analog")


@pytest.mark.parametrize(
    ("places", "settle_s"),
    [((), 0.0), (("--address", "TCPIP::192.0.2.10::5025::SOCKET", "--link", "serial:COM3"), 0.05)],
    ids=["emulated", "hardware"],
)
def test_real_instruments_are_given_time_to_settle(
    laboratory: Laboratory, places: tuple[str, ...], settle_s: float
) -> None:
    assert main(["bench", "new", *places]) == 0
    assert load_bench("bench.toml").bench.settle_s == settle_s


def test_a_scope_without_its_driver_is_told_what_it_needs(laboratory: Laboratory, capsys: Captured) -> None:
    at = "TCPIP::192.0.2.10::5025::SOCKET"
    assert main(["bench", "new", "--address", at]) == 2
    assert "for an oscilloscope its --digitizer and visa:RESOURCE" in capsys.readouterr().err
    assert main(["bench", "new", "--address", at, "--digitizer", "siglent-sds"]) == 2
    assert "for example visa:TCPIP" in capsys.readouterr().err
