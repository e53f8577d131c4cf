"""Each header that a driver sends stands in the page of its family, with where it is from."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from scope_bench import PULSE, config, device_of

from belahil.bench import Endpoints
from belahil.config import BenchConfig, parse_bench
from belahil.errors import LinkTimeout
from belahil.generators import FAMILIES
from belahil.oscilloscopes import SCOPES
from belahil.stimuli import NoSignal, Sine, Stimulus
from belahil.values import WindowRequest
from drivers import build
from sim.build import SCOPE_ADDRESS, VISA_ADDRESS, endpoints
from sim.devices.oscilloscopes.infiniivision import InfiniiVision

DOCS = Path(__file__).parents[1] / "docs"
STIMULI: tuple[Stimulus, ...] = (NoSignal(), Sine(1e6, 0.05), PULSE, Sine(2e6, 0.09, 0.001), PULSE)
COMMON = {"*IDN", "*ESE"}
"""What every session sends."""


class Overheard:
    """An instrument, and all messages that reached it."""

    def __init__(self, device: Any) -> None:
        self._device = device
        self.messages: list[bytes] = []

    def write(self, data: bytes, end: bool = True) -> None:
        self.messages.append(data)
        self._device.write(data, end)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._device, name)

    def headers(self) -> set[str]:
        """Return the headers of commands and questions, points of waveforms left out."""
        return {header for message in self.messages for header in _headers(message)}


def _headers(message: bytes) -> Iterator[str]:
    text = re.split(rb"#\d|WAVEDATA,", message)[0].decode("ascii").strip()
    for unit in re.findall(r'(?:[^;"]|"[^"]*")+', text):
        yield unit.split(" ")[0].rstrip("?")


def _documented(page: str, family: str) -> set[str]:
    """Return the headers in the first column of a family's table; every row says where they are from."""
    found: set[str] = set()
    lines = (DOCS / page).read_text("utf-8").splitlines()
    begin = next(place for place, line in enumerate(lines) if line.startswith(f"| `{family}` | from |"))
    for line in lines[begin + 2 :]:
        if not line.startswith("|"):
            break
        headers, source = line.strip("|").split("|")
        assert source.strip(), line
        names = re.findall(r"`([*:A-Z0-9_]{3,})`", headers.replace("`EXT`", ""))
        assert names, line
        assert not found & set(names), f"{found & set(names)} stand twice"
        found |= set(names)
    return found


def _opened(bench: BenchConfig, address: str, device: Any) -> tuple[Overheard, Endpoints]:
    ends = endpoints(bench)
    there = Overheard(device(ends))
    ends.visa_library.plug(address, there)
    return there, ends


def _larger(ends: Endpoints) -> InfiniiVision:
    small = device_of(ends)
    small._front.model = dataclasses.replace(small.model, name="DSO-X 3024T")
    return InfiniiVision(small._port, small._front)


@pytest.mark.parametrize("driver", sorted(SCOPES))
def test_every_header_of_an_oscilloscope_is_in_its_table(driver: str) -> None:
    sent: set[str] = set()
    for device in (device_of, _larger) if driver == "keysight-infiniivision" else (device_of,):
        # given sessions with each kind of instrument, when windows are measured, and one does not come
        there, ends = _opened(config(driver), SCOPE_ADDRESS, device)
        with build.bench(config(driver), ends) as bench:
            for shot, stimulus in enumerate(STIMULI):
                bench.measure(stimulus, WindowRequest(shot, None, 400))
        digitizer = build.open_digitizer(config(driver), ends)
        digitizer.arm(WindowRequest(0, None, 100, trigger="generator"))
        with pytest.raises(LinkTimeout):
            digitizer.read(0.1)
        digitizer.close()
        sent |= there.headers()
    # then the page has each header that was sent, and no other
    assert sent - COMMON == _documented("oscilloscopes.md", driver)
    assert sent >= COMMON


@pytest.mark.parametrize("driver", FAMILIES)
def test_every_header_of_a_generator_is_in_its_table(driver: str) -> None:
    # given a session, when sines and pulses are played
    bench_file = parse_bench(f'[generator]\ndriver = "{driver}"\naddress = "emulated"\n')
    there, ends = _opened(bench_file, VISA_ADDRESS, lambda ends: ends.visa_library._devices[VISA_ADDRESS])
    with build.bench(bench_file, ends) as bench:
        for shot, stimulus in enumerate(STIMULI):
            bench.measure(stimulus, WindowRequest(shot, 4, 200))
    # then the page has each header that was sent, and no other
    family = "keysight-33500" if driver == "keysight-33600" else driver
    assert there.headers() - COMMON == _documented("instruments.md", family)


def test_a_header_that_nobody_documented_is_found() -> None:
    # given a message with a header that is in no table
    overheard = Overheard(type("Deaf", (), {"write": lambda self, data, end: None})())
    overheard.write(b'*ESE 1;:CHAN1:LAB "a;:B C";:EXT:NEW 1;*ESE?\n')
    assert overheard.headers() - COMMON - _documented("oscilloscopes.md", "keysight-infiniivision") == {
        ":EXT:NEW"
    }
