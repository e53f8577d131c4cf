"""What a server reads from and writes to, and what it makes of the bytes."""

from __future__ import annotations

import errno
import math
import os
import select
import socket
import time
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable

    from sim.devices.scpi import ScpiDevice
    from sim.transports.serial_port import ByteDevice

PORTION_BYTES = 1 << 16
MOST_UNSENT_BYTES = 1 << 20
"""A client that lets more than that lie is not listened to until it reads."""
_STRIDE_BYTES = 32
"""Of a line: about a command, which may take as long as a window."""
_ALIVE = {"TCP_KEEPIDLE": 10, "TCP_KEEPINTVL": 5, "TCP_KEEPCNT": 3}
"""In s and tries: a client whose computer was switched off leaves within half a minute."""


class Channel(Protocol):
    """A stream of bytes that never blocks; its verbs raise `OSError` when the other end is gone."""

    def fileno(self) -> int:
        """Number that a selector waits for."""
        ...

    def receive(self) -> bytes:
        """Return what has arrived; empty at the end of the stream."""
        ...

    def send(self, data: bytes) -> int:
        """Send what fits and return how much that was."""
        ...

    def close(self) -> None:
        """Let go."""
        ...


class SocketChannel:
    """A connected TCP socket."""

    def __init__(self, connected: socket.socket) -> None:
        connected.setblocking(False)
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for name, value in _ALIVE.items():
            if hasattr(socket, name):
                connected.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)
        self._socket = connected

    def fileno(self) -> int:
        """Number that a selector waits for."""
        return self._socket.fileno()

    def receive(self) -> bytes:
        """Return what has arrived; empty at the end of the stream."""
        return self._socket.recv(PORTION_BYTES)

    def send(self, data: bytes) -> int:
        """Send what fits and return how much that was."""
        try:
            return self._socket.send(data)
        except BlockingIOError:
            return 0

    def close(self) -> None:
        """Let go."""
        self._socket.close()


class HungUp(Exception):
    """Nobody has the far end open any more; somebody may come back."""


class PtyChannel:
    """A pseudo-terminal, which looks like a serial port to others; POSIX only.

    What this does not model: a line's modem lines.
    """

    def __init__(self) -> None:
        import tty

        self._near, far = os.openpty()
        tty.setraw(far)
        self.path = os.ttyname(far)
        # Held open here, the far end would hide whether a client is there.
        os.close(far)
        os.set_blocking(self._near, False)

    def fileno(self) -> int:
        """Number that a selector waits for."""
        return self._near

    def is_open(self) -> bool:
        """Whether a client has the far end open, or has left something to read."""
        poll = select.poll()
        poll.register(self._near, select.POLLIN)
        events = poll.poll(0)
        return not events or bool(events[0][1] & select.POLLIN)

    def receive(self) -> bytes:
        """Return what has arrived.

        Raises
        ------
        HungUp
            The client has closed the far end.
        """
        try:
            data = os.read(self._near, PORTION_BYTES)
        except OSError as error:
            if error.errno == errno.EIO:
                raise HungUp from error
            raise
        if not data:
            raise HungUp
        return data

    def send(self, data: bytes) -> int:
        """Send what fits and return how much that was."""
        try:
            return os.write(self._near, data)
        except BlockingIOError:
            return 0

    def close(self) -> None:
        """Let go."""
        os.close(self._near)


class Wire(ABC):
    """A client's side of a device.

    What was fed is carried out until `until_s` on the server's clock, and while not too much waits to be
    taken; what is left is carried out by the next call.
    """

    finished = False
    """Whether the connection ends once all has been sent."""
    is_busy = False
    """Whether `take` has something left to do."""
    due_s = math.inf
    """Time on the server's clock when `take` may have something to say without being fed."""

    @property
    def is_full(self) -> bool:
        """Whether nothing more can be taken for now."""
        return False

    @abstractmethod
    def feed(self, data: bytes, until_s: float = math.inf) -> None:
        """Take bytes from the client."""

    @abstractmethod
    def take(self, until_s: float = math.inf) -> bytes:
        """Give bytes for the client."""

    def gone(self) -> None:  # noqa: B027 - most have nothing to tidy up
        """Take notice that the client has left."""


class ScpiWire(Wire):
    """One of several clients of one instrument: it gets the answers to its own messages.

    Parameters
    ----------
    device : ScpiDevice
        Nobody can tell what such a client has read, so this is a stream (see `Connection`).
    """

    def __init__(self, device: ScpiDevice) -> None:
        self._connection = device.connect("stream")
        # A network drains answers as they come: no portion holds so many questions.
        self._connection.capacity = PORTION_BYTES

    @property
    def is_full(self) -> bool:
        """Whether messages are left that have to be carried out first."""
        return self.is_busy

    def feed(self, data: bytes, until_s: float = math.inf) -> None:
        """Take bytes; each line feed that is not part of a block ends a message."""
        self._connection.push(data)
        self._go_on(until_s)

    def take(self, until_s: float = math.inf) -> bytes:
        """Give the answers."""
        if self.is_busy:
            self._go_on(until_s)
        return b"".join(iter(self._connection.read, None))

    def _go_on(self, until_s: float) -> None:
        connection = self._connection

        def may() -> bool:
            return connection.unread_bytes < MOST_UNSENT_BYTES and time.monotonic() < until_s

        is_done = connection.unread_bytes < MOST_UNSENT_BYTES and connection.go_on(may)
        self.is_busy = not is_done

    def gone(self) -> None:
        """Drop what is not finished, and what the instrument still owes."""
        self._connection.clear()


class LineWire(Wire):
    """The only client of a device that is spoken to in bytes.

    Parameters
    ----------
    device : ByteDevice
        The device.
    release : callable, optional
        Is called when the client has left.
    """

    def __init__(self, device: ByteDevice, release: Callable[[], None] = lambda: None) -> None:
        self._device = device
        self._release = release
        self._backlog = bytearray()

    @property
    def is_full(self) -> bool:
        """Whether bytes are left that the device has to hear first."""
        return bool(self._backlog)

    def feed(self, data: bytes, until_s: float = math.inf) -> None:
        """Take bytes."""
        self._backlog += data
        self._go_on(until_s)

    def take(self, until_s: float = math.inf) -> bytes:
        """Give what is ready."""
        self._go_on(until_s)
        taken = self._device.read(PORTION_BYTES)
        self.is_busy |= self._device.waiting > 0
        return taken

    def _go_on(self, until_s: float) -> None:
        place = 0
        while place < len(self._backlog) and self._device.waiting < MOST_UNSENT_BYTES:
            self._device.write(bytes(self._backlog[place : place + _STRIDE_BYTES]))
            place += _STRIDE_BYTES
            if time.monotonic() >= until_s:
                break
        del self._backlog[:place]
        self.is_busy = bool(self._backlog)

    def gone(self) -> None:
        """Let another client have the device."""
        self._release()
