"""``belahil emulate``: another process measures a bench whose truth it cannot know."""

from __future__ import annotations

import json
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from belahil.cli.emulate import client_file
from belahil.cli.main import main
from belahil.config import load_bench, parse_bench

ROOT = Path(__file__).resolve().parent.parent
TRUTH = """
[generator]
driver = "keysight-33600"
attenuation_db = 6.0
[emulation]
seed = 3
[emulation.receiver]
cutoff_hz = 17.3e6
clock_ppm = 12.0
[limits]
cutoff_hz = [17e6, 18e6]
"""


def test_a_client_file_is_the_bench_elsewhere_without_its_truth() -> None:
    config = parse_bench(TRUTH)
    text = client_file(config, "TCPIP::127.0.0.1::5025::SOCKET", "socket://127.0.0.1:5026")
    client = parse_bench(text)
    assert "emulation" not in text
    assert client.source == "hardware"
    assert (client.generator.driver, client.generator.attenuation_db) == ("keysight-33600", 6.0)
    assert client.limits == config.limits
    assert (client.generator.address, client.digitizer.link) == (
        "TCPIP::127.0.0.1::5025::SOCKET",
        "socket://127.0.0.1:5026",
    )


def test_a_bench_of_hardware_is_not_served_as_another_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bench = tmp_path / "lab.toml"
    bench.write_text(client_file(parse_bench(TRUTH), "TCPIP::192.0.2.10::INSTR", "serial:COM3"))

    assert main(["emulate", "--bench", str(bench)]) == 2

    assert "is hardware; needed is one whose instruments are emulated" in capsys.readouterr().err


@contextmanager
def emulating(folder: Path, *words: str) -> Iterator[subprocess.Popen[str]]:
    """``belahil emulate`` in a process of its own, once its client file is written."""
    client = folder / "client.toml"
    process = subprocess.Popen(
        [sys.executable, "-m", "belahil", "emulate", "--client", str(client), *words],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        # A busy machine has taken more than half a minute to start a process.
        deadline = time.monotonic() + 100
        while not client.exists() and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.02)
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_client_in_another_process_finds_the_results_of_the_bench_within(
    tmp_path: Path, number: signal.Signals
) -> None:
    # given a bench with a hidden truth, served by another process
    bench = tmp_path / "truth.toml"
    bench.write_text(TRUTH)
    words = ["characterize", "--quiet", "--codes", "3,4", "--dark-windows", "2"]
    words += ["--amplitudes-mvpp", "30,50", "--frequencies-mhz", "1,5,10,15,20,30"]
    with emulating(tmp_path, "--bench", str(bench)) as server:
        # when it is measured with the client's bench file, and within this process with the truth's
        client = str(tmp_path / "client.toml")
        assert load_bench(client).emulation != load_bench(str(bench)).emulation
        assert main([*words, "--bench", client, "--out", str(tmp_path / "far")]) == 0
        assert main([*words, "--bench", str(bench), "--out", str(tmp_path / "near")]) == 0
        # then the results are equal, and both say that they are emulated
        far, near = (json.loads((tmp_path / name / "summary.json").read_text()) for name in ("far", "near"))
        assert far["results"] == near["results"]
        assert (far["source"], near["source"]) == ("emulated", "emulated")
        assert (far["verdict"], near["verdict"]) == ("pass", "pass")
        # and only who emulates knows the seed and what is not modelled
        assert (far["seed"], near["seed"]) == (None, 3)
        pages = [(tmp_path / name / "report.html").read_text() for name in ("far", "near")]
        assert ["does not model" in page for page in pages] == [False, True]
        # and the server ends in peace
        server.send_signal(number)
        out, err = server.communicate(timeout=20)
        assert (server.returncode, err) == (0, "")
        assert f'address = "{load_bench(client).generator.address}"' in out


@pytest.mark.slow
def test_a_port_that_is_taken_is_status_3(tmp_path: Path) -> None:
    with emulating(tmp_path) as first:
        assert first.poll() is None
        port = load_bench(str(tmp_path / "client.toml")).generator.address.split("::")[2]
        (tmp_path / "second").mkdir()
        with emulating(tmp_path / "second", "--scpi-port", port) as second:
            _, err = second.communicate(timeout=30)
            assert second.returncode == 3
            assert err.startswith("belahil: ")
            assert err.count("\n") == 1
            assert port in err


def test_a_taken_port_and_strangers_are_each_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        for option in ("--scpi-port", "--hislip-port", "--link-port"):
            assert main(["emulate", option, str(port)]) == 3
            assert (
                capsys.readouterr().err
                == f"belahil: 127.0.0.1:{port}: Address already in use; nothing can be served there\n"
            )
    # and a server for strangers, slow on purpose, says where it is and warns
    command = ["--host", "0.0.0.0", "--latency-ms", "5", "--baud", "115200"]
    with emulating(tmp_path, *command) as server:
        client = load_bench(str(tmp_path / "client.toml"))
        with socket.create_connection(("127.0.0.1", int(client.generator.address.split("::")[2]))) as line:
            line.sendall(b"*OPC?\r\n")
            assert line.recv(10) == b"1\n"
        server.send_signal(signal.SIGTERM)
        out, err = server.communicate(timeout=20)
    assert server.returncode == 0
    assert err.startswith("belahil: listening at 0.0.0.0: whoever reaches this computer")
    assert err.count("\n") == 1
    assert re.search(r"# generator: TCPIP::\S+::hislip0,\d+::INSTR\n", out)
