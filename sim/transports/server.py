"""An emulated bench for other processes: SCPI and the GRM link over TCP and pseudo-terminals, and HiSLIP."""

from __future__ import annotations

import ipaddress
import math
import signal
import socket
import sys
import threading
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from belahil.errors import RefusedInput
from belahil.oscilloscopes import SCOPES
from belahil.values import WindowRequest
from sim.devices.generator_families import generator_device
from sim.devices.grm import GrmDevice
from sim.devices.oscilloscopes.families import DEVICES
from sim.generator_path import true_model
from sim.oscilloscope import ScopeReceiver
from sim.plant import Plant
from sim.transports.channels import PtyChannel, ScpiWire, Wire
from sim.transports.hislip import HislipPort, sub_address
from sim.transports.line_pace import LinePace
from sim.transports.one_receiver import OneReceiver
from sim.transports.server_loop import Server, bracketed, resolved

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from belahil.config import BenchConfig
    from sim.devices.scpi import ScpiDevice

LOOPBACK = "127.0.0.1"
MOST_SCPI_CLIENTS = 16
MOST_HISLIP_CLIENTS = 16
MOST_REFUSED = 8
"""Clients that are told, at the same time, that there are too many."""


@dataclass(frozen=True, slots=True)
class Serving:
    """How a bench is served.

    Parameters
    ----------
    host : str
        Address to listen at.
    scpi_port, link_port, hislip_port : int
        TCP ports of the generator, of the receiver and of HiSLIP; 0 for any that is free.
    pty : bool
        Whether to offer generator and receiver at pseudo-terminals too.
    baud : float
        Bits per second of the serial lines: the GRM link and the pseudo-terminals, ten to a byte;
        infinity for lines that take no time.
    latency_s : float
        From when an instrument answers to when the answer begins to leave, on every line.
    """

    host: str = LOOPBACK
    scpi_port: int = 0
    link_port: int = 0
    hislip_port: int = 0
    pty: bool = False
    baud: float = math.inf
    latency_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Served:
    """Where the devices are, in the words of a bench file.

    Parameters
    ----------
    address, hislip_address : str
        Of the generator.
    link, hislip_link : str
        Of the receiver; the latter empty for one that is no oscilloscope.
    pty_address, pty_link : str
        Of the two at pseudo-terminals; empty without them.
    stop : callable
        Ends the serving; may be called from any thread.
    """

    address: str
    hislip_address: str
    link: str
    hislip_link: str
    pty_address: str
    pty_link: str
    stop: Callable[[], None]


def serve(
    config: BenchConfig,
    announce: Callable[[Served], None],
    how: Serving = Serving(),
    tell: Callable[[str], None] = lambda line: None,
) -> None:
    """Serve the emulated bench of a bench file until SIGINT, SIGTERM or `Served.stop`.

    Parameters
    ----------
    config : BenchConfig
        Its ``[emulation]`` is the truth, and stays here.
    announce : callable
        Is told where the devices are, once they can be reached.
    how : Serving
        Where, and how fast.
    tell : callable
        Takes lines for whoever runs the server: who was refused, and that strangers can reach it.

    Raises
    ------
    LinkError
        The host has no address, or a port cannot be had.
    RefusedInput
        A pseudo-terminal where the system has none.
    ConfigError
        A truth that cannot be.
    """
    if how.pty and sys.platform == "win32":
        raise RefusedInput("a pseudo-terminal was asked for: Windows has none; allowed: the TCP link")
    _warm_up(config)
    scope = ScopeReceiver(config) if config.digitizer.driver in SCOPES else None
    plant = Plant(config, scope)
    generator = generator_device(true_model(config), plant)

    def scpi() -> ScpiWire:
        return ScpiWire(generator)

    def serial_pace() -> LinePace:
        return LinePace(how.baud, how.latency_s)

    spoken_to: list[ScpiDevice] = [generator]
    digitizer: Callable[[], Wire]
    pace: Callable[[], LinePace] | None
    if scope is None:
        receiver = OneReceiver(lambda: GrmDevice(plant, "cobs", plant.clock), tell)
        digitizer, most, pace = receiver.wire, 1 + MOST_REFUSED, serial_pace
        places = "socket://{}:{}", "serial:{}"
    else:
        oscilloscope = DEVICES[config.digitizer.driver](plant, scope)
        spoken_to.append(oscilloscope)
        digitizer, most, pace = partial(ScpiWire, oscilloscope), MOST_SCPI_CLIENTS, _network_pace(how)
        places = "visa:TCPIP::{}::{}::SOCKET", "visa:ASRL{}::INSTR"

    with Server(tell) as server:
        scpi_port = server.listen(scpi, how.host, how.scpi_port, MOST_SCPI_CLIENTS, _network_pace(how))
        hislip = HislipPort(spoken_to, MOST_HISLIP_CLIENTS)
        # Each client has two connections.
        connections = 2 * MOST_HISLIP_CLIENTS * len(spoken_to) + MOST_REFUSED
        hislip_port = server.listen(hislip.wire, how.host, how.hislip_port, connections, _network_pace(how))
        link_port = server.listen(digitizer, how.host, how.link_port, most, pace)
        pty_address = pty_link = ""
        if how.pty:
            lines = PtyChannel(), PtyChannel()
            server.attach(lines[0], scpi, serial_pace)
            server.attach(lines[1], digitizer, serial_pace)
            pty_address, pty_link = f"ASRL{lines[0].path}::INSTR", places[1].format(lines[1].path)
        if not _is_loopback(how.host):
            tell(f"listening at {how.host}: whoever reaches this computer can use the bench; no password")
        host = _reached_as(how.host)
        if host.startswith("["):
            tell(f"PyVISA takes no name with {host}: for VISA listen at a host name, or at 127.0.0.1")
        by_hislip = [
            f"TCPIP::{host}::{sub_address(place)},{hislip_port}::INSTR" for place in range(len(spoken_to))
        ]
        with _stopped_by_signals(server.stop):
            announce(
                Served(
                    f"TCPIP::{host}::{scpi_port}::SOCKET",
                    by_hislip[0],
                    places[0].format(host, link_port),
                    "" if scope is None else f"visa:{by_hislip[1]}",
                    pty_address,
                    pty_link,
                    server.stop,
                )
            )
            server.run()


def _network_pace(how: Serving) -> Callable[[], LinePace] | None:
    return (lambda: LinePace(math.inf, how.latency_s)) if how.latency_s else None


def _is_loopback(host: str) -> bool:
    """Whether only this computer reaches what listens at `host`."""
    _, address = resolved(host)
    return ipaddress.ip_address(address[0]).is_loopback


def _reached_as(host: str) -> str:
    """Name for clients: where all addresses are listened at, that of this computer."""
    return socket.gethostname() if host in ("", "0.0.0.0", "::") else bracketed(host)


def _warm_up(config: BenchConfig) -> None:
    """Digitize windows that nobody sees: what the first ones load must not make a client wait."""
    # The filter of pulses loads it, which takes longer than clients wait; so does the search for candidates.
    import scipy.signal  # noqa: F401

    plant = Plant(config)
    codes = plant.spec.gain_codes
    for products in plant.spec.products:
        plant.arm(WindowRequest(0, codes[0] if codes else None, products=products))


@contextmanager
def _stopped_by_signals(stop: Callable[[], None]) -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    signals = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, lambda *_: stop()) for number in signals]
    try:
        yield
    finally:
        for number, handler in zip(signals, before, strict=True):
            signal.signal(number, handler)
