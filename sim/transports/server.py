"""An emulated bench for other processes: SCPI over TCP, the GRM link over TCP and a pseudo-terminal."""

from __future__ import annotations

import signal
import sys
import threading
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from belahil.errors import RefusedInput
from belahil.values import WindowRequest
from sim.devices.generator_families import generator_device
from sim.devices.grm import GrmDevice
from sim.generator_path import true_model
from sim.plant import Plant
from sim.transports.channels import LineWire, PtyChannel, ScpiWire
from sim.transports.server_loop import Server

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from belahil.config import BenchConfig

LOOPBACK = "127.0.0.1"
MOST_SCPI_CLIENTS = 16


@dataclass(frozen=True, slots=True)
class Served:
    """Where the devices are, in the words of a bench file.

    Parameters
    ----------
    address : str
        Of the generator.
    link : str
        Of the receiver.
    pty_link : str
        Of the receiver at a pseudo-terminal; empty without one.
    stop : callable
        Ends the serving; may be called from any thread.
    """

    address: str
    link: str
    pty_link: str
    stop: Callable[[], None]


def serve(
    config: BenchConfig,
    announce: Callable[[Served], None],
    *,
    host: str = LOOPBACK,
    scpi_port: int = 0,
    link_port: int = 0,
    pty: bool = False,
) -> None:
    """Serve the emulated bench of a bench file until SIGINT, SIGTERM or `Served.stop`.

    Parameters
    ----------
    config : BenchConfig
        Its ``[emulation]`` is the truth, and stays here.
    announce : callable
        Is told where the devices are, once they can be reached.
    host : str
        Address to listen at.
    scpi_port, link_port : int
        TCP ports of the generator and of the receiver; 0 for any that is free.
    pty : bool
        Whether to offer the receiver at a pseudo-terminal too; all its clients share one receiver.

    Raises
    ------
    LinkError
        A port cannot be had.
    RefusedInput
        A pseudo-terminal where the system has none.
    ConfigError
        A truth that cannot be.
    """
    if pty and sys.platform == "win32":
        raise RefusedInput("a pseudo-terminal was asked for: Windows has none; allowed: the TCP link")
    _warm_up(config)
    plant = Plant(config)
    generator = generator_device(true_model(config), plant)

    def receiver() -> LineWire:
        return LineWire(GrmDevice(plant, "cobs", plant.clock))

    with Server() as server:
        scpi_port = server.listen(lambda: ScpiWire(generator), host, scpi_port, MOST_SCPI_CLIENTS)
        link_port = server.listen(receiver, host, link_port, most_clients=1)
        pty_link = ""
        if pty:
            channel = PtyChannel()
            server.attach(channel, receiver())
            pty_link = f"serial:{channel.path}"
        with _stopped_by_signals(server.stop):
            announce(
                Served(
                    f"TCPIP::{host}::{scpi_port}::SOCKET",
                    f"socket://{host}:{link_port}",
                    pty_link,
                    server.stop,
                )
            )
            server.run()


def _warm_up(config: BenchConfig) -> None:
    """Digitize a window that nobody sees: what the first one loads must not make a client wait."""
    plant = Plant(config)
    codes = plant.spec.gain_codes
    plant.arm(WindowRequest(0, codes[0] if codes else None))


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
