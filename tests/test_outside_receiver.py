"""A receiver that somebody wrote from the page alone is measured, and told what is wrong if something is."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import threading
import zlib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import outside_receiver as outside
import pytest

from belahil.cli.main import main

Captured = pytest.CaptureFixture[str]
SINES = ["--amplitudes-mvpp", "50", "--frequencies-mhz", "1,4,8,12,16,20,25"]
FEW = [*SINES[:3], "1,8,16,25", "--dark-windows", "1"]


@pytest.fixture(autouse=True)
def empty_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)


def bench_file(scpi_port: int, link_port: int) -> None:
    Path("lab.toml").write_text(
        f'[generator]\naddress = "TCPIP::127.0.0.1::{scpi_port}::SOCKET"\nvisa_library = "@py"\n'
        f'[digitizer]\nlink = "socket://127.0.0.1:{link_port}"\n'
    )


def results() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(Path("run/summary.json").read_text())["results"]
    return found


def distance(measured: dict[str, float], truth: float) -> float:
    """From the truth, in standard uncertainties."""
    return abs(measured["value"] - truth) / measured["standard_uncertainty"]


# --- in a process of its own, over two TCP ports


@contextmanager
def in_another_process() -> Iterator[None]:
    words = [sys.executable, outside.__file__, "--seconds", "60", "--seed", "5"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            _, scpi_port, _, link_port = process.stdout.readline().split()
            bench_file(int(scpi_port), int(link_port))
            yield
        finally:
            process.kill()


def test_a_receiver_written_from_the_page_comes_back_as_it_is() -> None:
    # given an outsider's receiver and generator, which share a hidden truth
    with in_another_process():
        # when two of its gain codes are characterized
        words = ["characterize", "--bench", "lab.toml", "--quiet", "--codes", "2,4", *SINES]
        assert main([*words, "--dark-windows", "2", "--out", "run"]) == 0
    # then that truth is found, within three standard uncertainties
    found = results()
    assert [row["code"] for row in found["gain_codes"]] == [2, 4]
    for row in found["gain_codes"]:
        gain = outside.GAIN_BY_CODE[row["code"]]
        assert (row["status"], row["order"]["integer"]) == ("ok", outside.ORDER)
        assert distance(row["gain"], gain) < 3
        assert distance(row["cutoff"], outside.CUTOFF_HZ) < 3
        assert distance(row["noise_rms"], outside.NOISE_RMS_V) < 3
        assert distance(row["input_noise_rms"], outside.NOISE_RMS_V / gain) < 3
    assert distance(found["clock_ppm"], 0.0) < 3
    assert found["best_code"] == 4
    # and the one converter that it has is not called two
    assert set(found["interleave"].values()) == {None}
    page = Path("run/report.html").read_text()
    assert "Gain is from the cut to the converter; amplitudes" in page
    assert "both converters" not in page


# --- in this process, with something changed


class Short(outside.Receiver):
    """Windows of at most 8000 samples, which fit into one segment; a subclass may change what it sends."""

    def _packet(self, service: int, subtype: int, data: bytes, flags: int = 3) -> bytes:
        if (service, subtype) == (200, 130):
            data = data[:4] + self.spec(data[4:])
        if (service, subtype) == (200, 131):
            payload = self.window(data[16:])
            data = data[:12] + struct.pack(">I", zlib.crc32(payload)) + payload
        return super()._packet(service, subtype, data, flags)

    def spec(self, octets: bytes) -> bytes:
        return octets[:8] + struct.pack(">I", 8000) + octets[12:]

    def window(self, payload: bytes) -> bytes:
        return payload


class TwosComplement(Short):
    def window(self, payload: bytes) -> bytes:
        counts = bytes(
            octet ^ (0x80 if place % 2 == 0 else 0) for place, octet in enumerate(payload[48:16048])
        )
        return payload[:48] + counts + payload[16048:]


class SwappedVolts(Short):
    def window(self, payload: bytes) -> bytes:
        return payload[:16] + payload[23:15:-1] + payload[24:]


class Codeless(Short):
    def spec(self, octets: bytes) -> bytes:
        return super().spec(octets)[:16] + b"\0"

    def _window(self, request: bytes, data: bytes) -> Iterator[bytes]:
        if data[4] != 255:
            raise outside.Refused(3, f"gain code {data[4]}; this receiver has none")
        return super()._window(request, data[:4] + b"\4" + data[5:])

    def window(self, payload: bytes) -> bytes:
        return payload[:4] + b"\xff" + payload[5:]


class Brief(Short):
    def spec(self, octets: bytes) -> bytes:
        return octets[:8] + struct.pack(">I", 511) + octets[12:]


class NeverAtOnce(Short):
    def spec(self, octets: bytes) -> bytes:
        return super().spec(octets)[:14] + b"\6" + octets[15:]


@contextmanager
def served(kind: type[outside.Receiver]) -> Iterator[None]:
    """Serve a receiver in threads of this process."""
    generator = outside.Generator()
    with (
        outside.ScpiServer(0, generator) as scpi,
        outside.LinkServer(0, kind(generator, 6)) as link,
        ExitStack() as running,
    ):
        for server in (scpi, link):
            thread = threading.Thread(target=server.serve_forever, args=(0.02,))
            thread.start()
            running.callback(thread.join, 10)
            running.callback(server.shutdown)
        bench_file(scpi.server_address[1], link.server_address[1])
        yield


def said(capsys: Captured) -> str:
    """The only line on standard error."""
    answer = capsys.readouterr()
    assert answer.err.startswith("belahil: ")
    assert answer.err.count("\n") == 1
    return answer.err


@pytest.mark.parametrize(
    ("kind", "rule"),
    [
        (TwosComplement, "counts from -32768 to 32767; allowed with 12 bits: -2048 to 2047 or 0 to 4095"),
        (SwappedVolts, "volts per count 8.126e-320, with 12 bits a span of 3.32837e-316 V; allowed: 0.001"),
    ],
)
@pytest.mark.parametrize(
    "command", [["bench", "check", "lab.toml"], ["characterize", "--bench", "lab.toml", *FEW]]
)
def test_a_window_that_breaks_a_rule_is_status_3_with_that_rule(
    capsys: Captured, kind: type[outside.Receiver], rule: str, command: list[str]
) -> None:
    with served(kind):
        assert main(command) == 3

    line = said(capsys)
    assert "belahil: window of shot 0: " in line
    assert rule in line


@pytest.mark.parametrize(
    ("kind", "rule"),
    [
        (Brief, "the receiver's longest window has 511 samples: at least 512 are needed"),
        (NeverAtOnce, "is started by trigger = immediate: the receiver has generator, digitizer"),
    ],
)
@pytest.mark.parametrize("command", [["characterize", *FEW], ["noise"]])
def test_a_receiver_that_cannot_be_measured_is_refused_at_the_start(
    capsys: Captured, kind: type[outside.Receiver], rule: str, command: list[str]
) -> None:
    with served(kind):
        assert main([*command, "--bench", "lab.toml", "--out", "run"]) == 2

    assert rule in said(capsys)
    assert not Path("run").exists()


def test_a_receiver_without_gain_codes_is_measured_and_told_of_as_such(capsys: Captured) -> None:
    with served(Codeless):
        assert main(["characterize", "--bench", "lab.toml", *FEW, "--out", "run"]) == 0
        told = capsys.readouterr().out
        assert main(["bench", "check", "--bench", "lab.toml"]) == 0
        checked = capsys.readouterr().out

    (row,) = results()["gain_codes"]
    assert (row["code"], row["status"]) == (None, "ok")
    assert distance(row["gain"], outside.GAIN_BY_CODE[4]) < 3
    assert "receiver without gain codes: gain 4.5" in told
    assert "could be" not in told
    assert "None" not in told + checked
    assert "dark window: 1." in checked
