"""What a server reads from and writes to, and what it makes of the bytes."""

from __future__ import annotations

import os
import socket
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from sim.devices.scpi import ScpiDevice
    from sim.transports.serial_port import ByteDevice

PORTION_BYTES = 1 << 16


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


class PtyChannel:
    """A pseudo-terminal, which looks like a serial port to others; POSIX only.

    What this does not model: a line's pace, and its modem lines.
    """

    def __init__(self) -> None:
        import tty

        # The far end stays open here too: without it, a client that leaves would end the line.
        self._near, self._far = os.openpty()
        tty.setraw(self._near)
        tty.setraw(self._far)
        os.set_blocking(self._near, False)
        self.path = os.ttyname(self._far)

    def fileno(self) -> int:
        """Number that a selector waits for."""
        return self._near

    def receive(self) -> bytes:
        """Return what has arrived."""
        return os.read(self._near, PORTION_BYTES)

    def send(self, data: bytes) -> int:
        """Send what fits and return how much that was."""
        try:
            return os.write(self._near, data)
        except BlockingIOError:
            return 0

    def close(self) -> None:
        """Let go of both ends."""
        os.close(self._near)
        os.close(self._far)


class Wire(Protocol):
    """A client's side of a device."""

    def feed(self, data: bytes) -> None:
        """Take bytes from the client."""
        ...

    def take(self) -> bytes:
        """Give bytes for the client."""
        ...


class ScpiWire:
    """One of several clients of one instrument: it gets the answers to its own messages.

    Parameters
    ----------
    device : ScpiDevice
        Nobody can tell what such a client has read, so this is a stream (see `Connection`).
    """

    def __init__(self, device: ScpiDevice) -> None:
        self._connection = device.connect("stream")

    def feed(self, data: bytes) -> None:
        """Take bytes; each line feed that is not part of a block ends a message."""
        self._connection.write(data)

    def take(self) -> bytes:
        """Give the answers."""
        return b"".join(iter(self._connection.read, None))


class LineWire:
    """The only client of a device that is spoken to in bytes."""

    def __init__(self, device: ByteDevice) -> None:
        self._device = device

    def feed(self, data: bytes) -> None:
        """Take bytes."""
        self._device.write(data)

    def take(self) -> bytes:
        """Give what is ready."""
        return self._device.read(PORTION_BYTES)
