"""A served bench with an oscilloscope: our drivers on every line, bare sockets, long blocks over HiSLIP."""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvisa
from msgspec.structs import replace
from scope_bench import SCRIPT, config
from served import RawClient, port_of, served
from test_emulate_command import emulating

from belahil.bench import open_bench
from belahil.cli.main import main
from belahil.config import as_toml, load_bench
from belahil.oscilloscopes import SCOPES
from drivers.visa_link import VisaLink
from sim.transports.server import Served, Serving

LINES = ["hislip", "tcp"] if sys.platform == "win32" else ["hislip", "tcp", "pty"]
QUICK = {"keysight-infiniivision": "hislip", "rigol-ds1000z": "pty", "siglent-sds": "tcp"}
NO_ERROR = '+0,"No error"'


def _ways() -> Iterator[Any]:
    for driver in sorted(SCOPES):
        for line in LINES:
            yield pytest.param(driver, line, marks=() if QUICK.get(driver) == line else pytest.mark.slow)


def _places(served_at: Served, line: str) -> tuple[str, str]:
    return {
        "hislip": (served_at.hislip_address, served_at.hislip_link),
        "tcp": (served_at.address, served_at.link),
        "pty": (served_at.pty_address, served_at.pty_link),
    }[line]


@pytest.mark.parametrize(("driver", "line"), list(_ways()))
def test_a_served_oscilloscope_gives_the_windows_of_the_bench_in_one_process(driver: str, line: str) -> None:
    # given the windows of the simulated bench
    script = SCRIPT[2:5]
    with open_bench(config(driver, "simulated")) as bench:
        reference = [bench.measure(stimulus, request).window for stimulus, request in script]
    # when generator and oscilloscope are served, and measured on one kind of line
    with served(Serving(pty=line == "pty"), as_toml(config(driver))) as (places, said):
        address, link = _places(places, line)
        whole = config(driver)
        client = replace(
            whole,
            generator=replace(whole.generator, address=address, visa_library="@py"),
            digitizer=replace(whole.digitizer, link=link),
        )
        with open_bench(client) as bench:
            shots = [bench.measure(stimulus, request) for stimulus, request in script]
    # then every window is equal, at the first attempt
    assert all(
        shot.window.equals(window) and dict(shot.window.housekeeping) == dict(window.housekeeping)
        for shot, window in zip(shots, reference, strict=True)
    )
    assert [shot.attempt for shot in shots] == [1, 1, 1]
    assert said == []


def test_two_sockets_are_enough_to_measure() -> None:
    # given plain sockets to a generator and an oscilloscope that waits for it
    quiet = config("rigol-ds1000z", receiver="noise_rms_v_by_code = [0.0]")
    with (
        served(bench=as_toml(quiet)) as (places, _),
        RawClient(port_of(places.address)) as generator,
        RawClient(port_of(places.link)) as scope,
    ):
        # when a sine of 50 mVpp plays, and a record is forced
        assert generator.ask(b"FREQ 1E6;:VOLT 0.05;:OUTP ON;*OPC?\n") == b"1\n"
        scope.line.sendall(b":CHAN1:SCAL 0.05;:TIM:SCAL 1E-5;:TRIG:SWE SING;:SING;:TFOR\n")
        assert scope.ask(b":TRIG:STAT?\n") == b"STOP\n"
        scope.line.sendall(b":WAV:SOUR CHAN1;MODE RAW;FORM BYTE;STAR 1;STOP 12000\n")
        preamble = scope.ask(b":WAV:PRE?\n").split(b",")
        scope.line.sendall(b":WAV:DATA?\n")
        block = scope.read(11 + 12000 + 1)
        # then it is the block that was asked for, and in it the sine behind a gain of 5.19
        assert block.startswith(b"#9000012000")
        assert block.endswith(b"\n")
        step_v, origin, reference = (float(field) for field in preamble[7:])
        volts = (np.frombuffer(block[11:-1], np.uint8) - reference - origin) * step_v
        assert np.ptp(volts) == pytest.approx(5.19 * 0.05, abs=2 * step_v)
        assert generator.ask(b"SYST:ERR?\n").strip() == NO_ERROR.encode()
        assert scope.ask(b"SYST:ERR?\n").strip() == NO_ERROR.removeprefix("+").encode()


@contextmanager
def _opened(address: str) -> Iterator[Any]:
    manager = pyvisa.ResourceManager("@py")
    resource = manager.open_resource(address.removeprefix("visa:"), timeout=10_000)
    try:
        yield resource
    finally:
        resource.close()
        manager.close()


def test_blocks_longer_than_a_message_of_hislip_come_whole() -> None:
    with served(bench=as_toml(config("tektronix-mso"))) as (places, _), _opened(places.hislip_link) as scope:
        # given a record of two megabytes, with line feeds among its bytes
        assert scope.query("*IDN?").startswith("TEKTRONIX,MSO54,")
        scope.write(":CH1:SCA 1E-3;:HOR:MOD:RECO 1E6;:TRIG:A:MOD NORM;:ACQ:STATE RUN;:TRIG FORC")
        scope.write(":WFMO:BYT_N 2;:DAT:ENC RIB;STAR 1;STOP 1E6")
        # when it is read, then all of it is there, again and again
        first, second = (
            scope.query_binary_values(":CURV?", datatype="h", is_big_endian=True, container=np.array)
            for _ in range(2)
        )
        assert first.shape == (1_000_000,)
        assert np.array_equal(first, second)
        assert (first.astype(">i2").tobytes().count(b"\n")) > 1000
        # and our link gets over one that it did not read
        link = VisaLink(places.hislip_link.removeprefix("visa:"), "@py")
        link.write(b":CURV?\n")
        link.clear()
        link.write(b"SYST:ERR?\n")
        assert link.read(100, 5.0).strip() == NO_ERROR.encode()
        link.close()


@pytest.mark.slow
def test_the_command_serves_an_oscilloscope_that_is_characterized_as_within(tmp_path: Path) -> None:
    # given a bench file with an oscilloscope, served by another process
    bench = tmp_path / "truth.toml"
    bench.write_text(as_toml(config("keysight-infiniivision")))
    words = ["characterize", "--quiet", "--dark-windows", "2"]
    words += ["--amplitudes-mvpp", "30,50", "--frequencies-mhz", "1,5,10,15,20,30"]
    with emulating(tmp_path, "--bench", str(bench)) as server:
        client = tmp_path / "client.toml"
        assert main([*words, "--bench", str(client), "--out", str(tmp_path / "far")]) == 0
        server.send_signal(signal.SIGTERM)
        out, err = server.communicate(timeout=20)
    assert (server.returncode, err) == (0, "")
    # and the same over HiSLIP, whose address the command tells
    (link,) = (line.split()[-1] for line in out.splitlines() if "hislip1" in line)
    assert load_bench(str(client)).digitizer.link in out
    assert link.startswith("visa:TCPIP::127.0.0.1::hislip1,")
    # then the results are those of the bench in this process
    assert main([*words, "--bench", str(bench), "--out", str(tmp_path / "near")]) == 0
    far, near = (json.loads((tmp_path / name / "summary.json").read_text()) for name in ("far", "near"))
    assert far["results"] == near["results"]
    assert far["source"] == near["source"] == "emulated"
