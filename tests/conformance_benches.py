"""Benches on which the conformance suite runs: every driver over every transport that its instrument has."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from pathlib import Path

from belahil.bench import Bench, open_bench
from belahil.config import BenchConfig, parse_bench
from drivers import build
from sim.build import SCOPE_ADDRESS, VISA_ADDRESS, endpoints
from sim.transports.server import Serving
from tests.served import served

# What the instruments have, by their data sheets; GPIB of Rigol and Siglent is an adapter at their USB port.
# A raw socket and HiSLIP are those of `belahil emulate`, which also offers a pseudo-terminal.
GENERATORS = {
    "keysight-33500": ("lan", "usb", "gpib", "socket", "hislip", "pty"),
    "keysight-33600": ("lan", "usb", "gpib", "socket", "hislip", "pty"),
    "agilent-33220": ("lan", "usb", "gpib", "socket", "hislip", "pty"),
    "rigol-dg": ("lan", "usb", "gpib", "socket", "hislip", "pty"),
    "tektronix-afg": ("lan", "usb", "gpib", "socket", "hislip", "pty"),
    "siglent-sdg": ("lan", "usb", "gpib", "socket", "hislip", "pty"),
}
SCOPES = {
    "keysight-infiniivision": ("lan", "usb", "socket", "hislip", "pty"),
    "rigol-ds1000z": ("lan", "usb", "socket", "hislip", "pty"),
    "siglent-sds": ("lan", "usb", "socket", "hislip", "pty"),
    "tektronix-mso": ("lan", "usb", "socket", "hislip", "pty"),
}
RECEIVERS = {
    "bela-grm": ("serial", "usb", "socket", "pty"),
    "gala-like": ("serial", "usb", "socket", "pty"),
    "analog": ("serial", "usb", "socket", "pty"),
}
NAMES = {
    "lan": "TCPIP0::192.0.2.1::inst0::INSTR",
    "usb": "USB0::0x0957::0x2807::MY1::INSTR",
    "gpib": "GPIB0::10::INSTR",
}


def text(generator: str = "keysight-33500", digitizer: str = "grm", receiver: str = "bela-grm") -> str:
    """Return a bench file without places."""
    return (
        f'[generator]\ndriver = "{generator}"\n[digitizer]\ndriver = "{digitizer}"\nreceiver = "{receiver}"\n'
    )


def placed(text: str, address: str, link: str, library: str = "") -> BenchConfig:
    """Return a bench file with places."""
    lines = f'[generator]\naddress = "{address}"\nvisa_library = "{library}"\n'
    return parse_bench(
        text.replace("[generator]\n", lines).replace("[digitizer]\n", f'[digitizer]\nlink = "{link}"\n')
    )


def with_generator(family: str, transport: str) -> AbstractContextManager[Bench]:
    """Return the bench of a generator over a transport, with the GRM on a serial line."""
    bench = text(family)
    if transport in NAMES:
        return plugged(placed(bench, "emulated", "emulated:serial"), generator=NAMES[transport])
    return far(bench, {"socket": "address", "hislip": "hislip_address", "pty": "pty_address"}[transport])


def with_scope(driver: str, transport: str) -> AbstractContextManager[Bench]:
    """Return the bench of an oscilloscope over a transport."""
    bench = text(digitizer=driver, receiver="analog")
    if transport in NAMES:
        return plugged(placed(bench, "emulated", "emulated:visa"), scope=NAMES[transport])
    return far(bench, "address", {"socket": "link", "hislip": "hislip_link", "pty": "pty_link"}[transport])


def with_receiver(receiver: str, transport: str) -> AbstractContextManager[Bench]:
    """Return the bench of a receiver on the GRM link over a transport."""
    bench = text(receiver=receiver)
    if transport in ("serial", "usb"):
        return plugged(placed(bench, "emulated", f"emulated:{transport}"))
    return far(bench, "address", {"socket": "link", "pty": "pty_link"}[transport])


@contextmanager
def plugged(config: BenchConfig, generator: str = "", scope: str = "") -> Iterator[Bench]:
    """Open the real drivers on devices in the process, under other VISA resource names."""
    ends = endpoints(config)
    visa = ends.visa_library
    if generator:
        visa.plug(generator, visa._devices[VISA_ADDRESS])
        ends = replace(ends, visa_address=generator)
    if scope:
        visa.plug(scope, visa._devices[SCOPE_ADDRESS])
        ends = replace(ends, visa_scope_address=scope)
    with build.bench(config, ends) as bench:
        yield bench


@contextmanager
def far(bench: str, address: str, link: str = "link", record: Path | None = None) -> Iterator[Bench]:
    """Open the real drivers on a served bench; the names are those of `Served`."""
    there = bench if '"grm"' in bench else f'{bench}link = "emulated:visa"\n'
    with served(Serving(pty=True), there) as (places, _):
        config = placed(bench, getattr(places, address), getattr(places, link), "@py")
        with open_bench(config, record=record) as opened:
            yield opened
