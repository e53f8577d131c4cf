"""Bad input: one line of what was asked and what is allowed, the right status, output off, data kept."""

from __future__ import annotations

import queue
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

import sim.build
from belahil.bench import open_bench
from belahil.cli.main import main
from belahil.config import emulated
from belahil.errors import InstrumentRefused, InterlockRefused
from belahil.grm_link import Reason
from belahil.receiver import BELA_GRM
from belahil.run import Run
from belahil.stimuli import Sine
from belahil.values import WindowRequest
from procedures import characterize, noise
from sim.plant import Plant
from sim.transports.server import Served, serve

Captured = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def plants(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[Plant]:
    """The plants that the test builds, in an empty folder."""
    built: list[Plant] = []

    class Noted(Plant):
        def __init__(self, *words: object) -> None:
            super().__init__(*words)  # type: ignore[arg-type]
            built.append(self)

    monkeypatch.setattr(sim.build, "Plant", Noted)
    monkeypatch.chdir(tmp_path)
    return built


def output_is_on(plant: Plant) -> bool:
    return plant._setting.output


def refused(capsys: Captured, words: list[str], status: int, *said: str) -> None:
    """Run a command and read its only line."""
    assert main([words[0], "--quiet", *words[1:]]) == status
    answer = capsys.readouterr()
    assert answer.out == ""
    assert answer.err.startswith("belahil: ")
    assert answer.err.count("\n") == 1
    for part in said:
        assert part in answer.err


# ---- bench files


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "[generator]\nattenuation = 6",
            ["[generator]", "unknown key `attenuation`", "allowed: driver", "attenuation_db"],
        ),
        ("[genrator]", ["unknown key `genrator`", "allowed: bench, generator, digitizer, emulation, limits"]),
        ("[generator]\nmax_vpp = 'half'", ["[generator] max_vpp", "expected a number", "got text"]),
        ("[bench]\nsettle_s = -1", ["[bench] settle_s", ">= 0"]),
        ("[emulation.receiver]\nadc_bits = 99", ["[emulation.receiver] adc_bits", "<= 16"]),
        ("[emulation.receiver]\nadc_full_scale_v = 2e3", ["receiver] adc_full_scale_v", "<= 1000"]),
        ("[generator]\naddress = 'GPIB::7'", ["both must be emulated, both simulated, or both real"]),
        ("[digitizer]\nlink = 'ftp://x'", ['link = "ftp://x" is unknown', "serial:PORT"]),
        ("max_vpp == 3", ["not valid TOML"]),
        ("[limits]\ncutoff_hz = [20e6, 18e6]", ["cutoff_hz", "low must not exceed high"]),
    ],
)
def test_a_bench_file_that_is_wrong(
    capsys: Captured, plants: list[Plant], text: str, said: list[str]
) -> None:
    Path("lab.toml").write_text(text)
    for command in ("characterize", "noise"):
        refused(capsys, [command, "--bench", "lab.toml", "--out", "run"], 2, "lab.toml: ", *said)
    assert plants == []
    assert [path.name for path in Path().iterdir()] == ["lab.toml"]


# ---- what the bench cannot do


@pytest.mark.parametrize("bench", ["emulated", "simulated"])
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--codes", "4,16"], ["gain code 16", "gain codes 0 to 15"]),
        (["--amplitudes-mvpp", "30,600"], ["0.3 V at the cut", "max_vpp = 0.5 allows 0.25 V"]),
        (["--frequencies-mhz", "1,31"], ["a sine of 31 MHz", "33522B", "30 MHz"]),
        (["--frequencies-mhz", "1e-13"], ["100 nHz", "33522B makes 1 µHz"]),
        (["--amplitudes-mvpp", "0.0001"], ["1e-07", "0.001"]),
        (["--frequencies-mhz", "20"], ["frequencies 20 MHz: 0 of them", "not a multiple of fs/4 = 20 MHz"]),
        (["--frequencies-mhz", "20,1,1"], ["frequencies 20, 1 MHz: 1 of them", "a gain needs 2"]),
        (["--frequencies-mhz", "0.002,5"], ["1 of them", "at least 2.49 kHz away from 0"]),
    ],
)
def test_what_this_bench_cannot_do_is_refused_before_a_run_begins(
    capsys: Captured, plants: list[Plant], bench: str, words: list[str], said: list[str]
) -> None:
    refused(capsys, ["characterize", "--bench", bench, "--out", "run", *words], 2, *said)
    assert [output_is_on(plant) for plant in plants] == [False]
    assert not Path("run").exists()


@pytest.mark.parametrize("command", ["characterize", "noise"])
@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"max_sample_count": 511}, "longest window has 511 samples: at least 512 are needed"),
        (
            {"triggers": ("generator",)},
            "a window of NoSignal is started by trigger = immediate: the rec",
        ),
        ({"products": ("candidates",)}, "products = window: the receiver has candidates"),
    ],
)
def test_a_receiver_that_cannot_do_what_is_needed(
    capsys: Captured,
    plants: list[Plant],
    monkeypatch: pytest.MonkeyPatch,
    command: str,
    change: dict[str, object],
    said: str,
) -> None:
    told = replace(BELA_GRM.digitizer, **change)  # type: ignore[arg-type]
    monkeypatch.setattr(Plant, "spec", property(lambda plant: told))
    refused(capsys, [command, "--bench", "simulated", "--out", "run"], 2, said)
    assert [output_is_on(plant) for plant in plants] == [False]
    assert not Path("run").exists()


@pytest.mark.parametrize("module", ["characterize", "noise"])
def test_the_shortest_windows_that_can_be_measured(monkeypatch: pytest.MonkeyPatch, module: str) -> None:
    told = replace(BELA_GRM.digitizer, max_sample_count=512)
    monkeypatch.setattr(Plant, "spec", property(lambda plant: told))
    options = {"characterize": characterize.GainOptions(codes=(4,)), "noise": noise.NoiseOptions(codes=(4,))}
    procedure = {"characterize": characterize, "noise": noise}[module]
    with open_bench("simulated") as bench:
        plan = procedure.plan(bench, options[module])
    assert plan.sample_count == 512


def test_an_offset_over_the_interlock(plants: list[Plant]) -> None:
    with open_bench("emulated") as bench:
        bench.measure(Sine(1e6, 0.1, 0.1), WindowRequest(0, 4, 64))
        assert output_is_on(plants[0])
        with pytest.raises(InterlockRefused, match=r"0.26 V at the cut, offset included.*max_vpp = 0.5"):
            bench.measure(Sine(1e6, 0.1, 0.21), WindowRequest(1, 4, 64))
    assert not output_is_on(plants[0])


def test_the_interlock_is_at_the_cut_behind_the_attenuator(capsys: Captured) -> None:
    # The generator makes at most 10 Vpp, which is 1 Vpp behind 20 dB.
    Path("lab.toml").write_text("[generator]\nattenuation_db = 20.0\nmax_vpp = 2.0")
    words = ["characterize", "--bench", "lab.toml", "--out", "run", "--amplitudes-mvpp"]
    refused(capsys, [*words, "2100"], 2, "max_vpp = 2 allows 1 V")
    refused(capsys, [*words, "1500"], 2, "15 Vpp", "33522B makes at most 5 V peak")


# ---- instruments that do not answer, or say no


@contextmanager
def served() -> Iterator[Served]:
    """An emulated bench in a thread of its own; tells where it is."""
    told: queue.Queue[Served] = queue.Queue()
    thread = threading.Thread(target=serve, args=(emulated(), told.put))
    thread.start()
    places = told.get(timeout=20)
    try:
        yield places
    finally:
        places.stop()
        thread.join(timeout=20)


def closed_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.mark.parametrize(
    ("address", "link", "said"),
    [
        ("TCPIP::127.0.0.1::{port}::SOCKET", "served", "nobody answers at TCPIP::127.0.0.1::"),
        # the receiver is opened first
        ("TCPIP::127.0.0.1::{port}::SOCKET", "socket://127.0.0.1:{port}", "socket://127.0.0.1:"),
        ("served", "socket://127.0.0.1:{port}", "socket://127.0.0.1:"),
        ("served", "serial:/dev/there-is-none", "/dev/there-is-none"),
        ("served", "usb:1209:0001", "1209:0001"),
    ],
)
def test_an_address_where_nobody_answers(capsys: Captured, address: str, link: str, said: str) -> None:
    port = closed_port()
    with served() as places:
        address = places.address if address == "served" else address.format(port=port)
        link = places.link if link == "served" else link.format(port=port)
        _refused_at(capsys, address, link, said)


def _refused_at(capsys: Captured, address: str, link: str, said: str) -> None:
    Path("lab.toml").write_text(
        f'[generator]\naddress = "{address}"\nvisa_library = "@py"\n[digitizer]\nlink = "{link}"'
    )
    refused(capsys, ["characterize", "--bench", "lab.toml", "--out", "run"], 3, said)
    assert not Path("run").exists()


def test_a_receiver_that_refuses_ends_the_run_and_keeps_the_data(
    capsys: Captured, plants: list[Plant], monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a receiver that has had enough at its seventh window
    arm = Plant.arm

    def sometimes(self: Plant, request: WindowRequest) -> None:
        if request.shot == 6:
            raise InstrumentRefused("too hot: 91 C; allowed: 85 C", Reason.OTHER)
        arm(self, request)

    monkeypatch.setattr(Plant, "arm", sometimes)
    # when it is characterized
    words = ["characterize", "--codes", "4", "--frequencies-mhz", "1,2", "--amplitudes-mvpp", "30,50"]
    refused(
        capsys,
        [*words, "--out", "run"],
        3,
        "too hot: 91 C; allowed: 85 C",
        "6 shots are kept",
        "--resume run",
    )
    # then six windows are kept, and the output is off
    assert not output_is_on(plants[0])
    with Run.resume("run") as run:
        assert len(run.shots()) == 6
    assert "too hot" in Path("run/log.txt").read_text()
