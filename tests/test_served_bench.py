"""Real transports: the devices in another process, the truth only there, and the same counts here."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from belahil.bench import open_bench
from belahil.config import BenchConfig, EmulationTable, load_bench, parse_bench
from belahil.errors import LinkClosed
from belahil.recording import read_session
from belahil.stimuli import NoSignal, SampledPulse, Sine, Stimulus
from belahil.values import Shot, WindowRequest

TRUTH = """
[bench]
trigger = "generator"
[generator]
driver = "keysight-33500"
address = "emulated"
attenuation_db = 6.0
[digitizer]
driver = "grm"
link = "emulated:serial"
[emulation]
seed = 99
[emulation.receiver]
cutoff_hz = 15.5e6
order = 2
clock_ppm = -20.0
adc_full_scale_v = 1.9
interleave = { gain = 0.008, offset_v = 1e-3, skew_s = 20e-12 }
"""
SERVE = """
import sys
from belahil.config import load_bench
from sim.transports.server import Serving, serve

def announce(served):
    print(served.address, served.link, served.pty_link, flush=True)

serve(load_bench(sys.argv[1]), announce, Serving(pty=sys.platform != "win32"))
print("stopped", flush=True)
"""
STIMULI: tuple[Stimulus, ...] = (
    NoSignal(),
    Sine(2.5e6, 0.05),
    SampledPulse(np.hanning(200) * 0.02, 80e6, start_s=1e-6),
    # A block full of line feeds: the code 0x0A0A is 2570 of 32767.
    SampledPulse(np.append(np.full(500, 0.02 * 2570 / 32767), 0.02), 80e6, 13e-9),
    Sine(2.5e6, 0.05),
)


@contextmanager
def _served(path: Path) -> Iterator[tuple[subprocess.Popen[str], list[str]]]:
    """Serve a bench file from another process, and yield where its devices are."""
    process = subprocess.Popen(
        [sys.executable, "-c", SERVE, str(path)],
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parent.parent,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )
    with process:
        try:
            assert process.stdout is not None
            yield process, process.stdout.readline().split()
        finally:
            process.kill()


def _measured(bench_file: str | BenchConfig, record: Path | None = None) -> list[Shot]:
    config = parse_bench(bench_file) if isinstance(bench_file, str) else bench_file
    with open_bench(config, record=record) as bench:
        return [
            bench.measure(stimulus, WindowRequest(10 * index + code, code, delay_s=1e-7))
            for index, stimulus in enumerate(STIMULI)
            for code in (4, 9)
        ]


def _without_truth(address: str, link: str) -> str:
    """Return the bench file that a user of the served devices would write."""
    text = TRUTH[: TRUTH.index("[emulation]")]
    return text.replace('address = "emulated"', f'address = "{address}"\nvisa_library = "@py"').replace(
        "emulated:serial", link
    )


def test_devices_in_another_process_give_the_counts_of_those_in_this_one(tmp_path: Path) -> None:
    # given a server that alone knows the truth
    path = tmp_path / "truth.toml"
    path.write_text(TRUTH)
    reference = _measured(TRUTH)
    with _served(path) as (process, (address, *links)):
        assert len(links) == (1 if sys.platform == "win32" else 2)
        # when its devices are measured over TCP, and then over a pseudo-terminal
        for number, link in enumerate(links):
            shots = _measured(_without_truth(address, link), tmp_path / f"{number}.rec")
            # then every window is equal to that of the bench in this process
            for shot, expected in zip(shots, reference, strict=True):
                assert shot.window.equals(expected.window)
                assert shot.played == expected.played
        # and the server ends when it is told to
        process.send_signal(signal.SIGTERM)
        assert process.stdout is not None
        assert process.stdout.read() == "stopped\n"
        assert process.wait(10) == 0
    # and with the server gone a recording of each transport gives the same
    for number in range(len(links)):
        session = read_session(tmp_path / f"{number}.rec")
        assert (session.source, session.seed) == ("hardware", None)
        again = _measured(session.config)
        for shot, expected in zip(again, reference, strict=True):
            assert shot.window.equals(expected.window)
            assert shot.played == expected.played


# pyserial leaves a socket to the garbage collector when the other end closed it first.
@pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket.socket:pytest.PytestUnraisableExceptionWarning"
)
def test_a_server_that_dies_is_a_closed_link_and_data_before_it_are_right(tmp_path: Path) -> None:
    path = tmp_path / "truth.toml"
    path.write_text(TRUTH)
    with _served(path) as (process, (address, link, *_)):
        bench = open_bench(parse_bench(_without_truth(address, link)))
        bench.measure(Sine(2.5e6, 0.05), WindowRequest(0, 4))
        # when the server is killed
        process.kill()
        process.wait(10)
        # then the next measurement says so at once, and closing does not raise
        with pytest.raises(LinkClosed):
            bench.measure(Sine(3e6, 0.05), WindowRequest(1, 4))
        bench.close()
    with pytest.raises(LinkClosed, match=f"serial link {link} does not open"):
        open_bench(parse_bench(_without_truth(address, link)))


def test_a_bench_file_of_served_devices_has_no_truth(tmp_path: Path) -> None:
    # The client's file holds the default emulation, which no driver reads.
    path = tmp_path / "client.toml"
    path.write_text(_without_truth("TCPIP::127.0.0.1::1::SOCKET", "socket://127.0.0.1:1"))
    config = load_bench(str(path))
    assert config.source == "hardware"
    assert config.emulation == EmulationTable()
