"""A served emulated bench in a thread of its own."""

from __future__ import annotations

import queue
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from belahil.config import parse_bench
from sim.transports.server import Served, Serving, serve


@contextmanager
def served(how: Serving = Serving(), bench: str = "") -> Iterator[tuple[Served, list[str]]]:  # noqa: B008
    """Serve a bench; yields where it is, and the lines that the server says meanwhile."""
    told: queue.Queue[Served] = queue.Queue()
    lines: list[str] = []
    thread = threading.Thread(target=serve, args=(parse_bench(bench), told.put, how, lines.append))
    thread.start()
    places = told.get(timeout=30)
    try:
        yield places, lines
    finally:
        places.stop()
        thread.join(timeout=20)
    assert not thread.is_alive()


def port_of(address: str) -> int:
    """TCP port in a VISA resource name or a socket URL."""
    if address.startswith("socket"):
        return int(address.rpartition(":")[2])
    return int(address.removeprefix("visa:").split("::")[2].rpartition(",")[2])


class RawClient:
    """A TCP client that sends bytes and waits for lines."""

    def __init__(self, port: int) -> None:
        self.line = socket.create_connection(("127.0.0.1", port), timeout=10)
        self._file = self.line.makefile("rb")

    def ask(self, message: bytes) -> bytes:
        """Send a message and return the line that answers it."""
        self.line.sendall(message)
        return self._file.readline()

    def read(self, count: int) -> bytes:
        """Return so many bytes."""
        return self._file.read(count)

    def close(self) -> None:
        """Hang up."""
        self._file.close()
        self.line.close()

    def __enter__(self) -> RawClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
