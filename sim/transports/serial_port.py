"""An emulated serial line beneath pyserial: ``serial.serial_for_url(register_serial(...))``."""

from __future__ import annotations

import itertools
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import serial
from serial.serialutil import PortNotOpenError, SerialBase

if TYPE_CHECKING:
    from collections.abc import Iterator

    from belahil.interfaces import Clock

SCHEME = "grm://"
_HANDLERS = "sim.transports"
_NUMBERS = itertools.count(1)


class ByteDevice(Protocol):
    """The far end of a line: bytes in any portions, both ways."""

    @property
    def waiting(self) -> int:
        """Bytes that are ready."""
        ...

    def write(self, data: bytes) -> None:
        """Take bytes."""
        ...

    def read(self, max_bytes: int) -> bytes:
        """Give bytes that are ready; empty when there are none."""
        ...

    def clear(self) -> None:
        """Drop what is ready."""
        ...


@dataclass(frozen=True, slots=True)
class _Line:
    device: ByteDevice
    clock: Clock


_LINES: dict[str, _Line] = {}


def register_serial(device: ByteDevice, clock: Clock, name: str = "line") -> str:
    """Make a device reachable by a URL; the line is there until its port has been closed.

    Parameters
    ----------
    device : ByteDevice
        Answers at once or not at all.
    clock : Clock
        Its time advances by each time-out that expires; nothing sleeps.
    name : str
        For messages; a number is added.

    Returns
    -------
    str
        For `serial.serial_for_url`.
    """
    if _HANDLERS not in serial.protocol_handler_packages:
        serial.protocol_handler_packages.append(_HANDLERS)
    url = f"{SCHEME}{name}-{next(_NUMBERS)}"
    _LINES[url] = _Line(device, clock)
    return url


class EmulatedPort(SerialBase):  # type: ignore[misc]
    """A port whose line ends in a Python object.

    What this does not model: the pace of a line, its modem lines, and framing errors.
    """

    is_open: bool
    _line: _Line | None = None

    def open(self) -> None:
        """Connect to the line that the port names.

        Raises
        ------
        serial.SerialException
            There is none, or it is in use.
        """
        if self.is_open:
            raise serial.SerialException(f"{self.port} is already open")
        if self.port not in _LINES:
            raise serial.SerialException(f"{self.port}: no emulated device is there")
        self._line = _LINES[self.port]
        self.is_open = True

    def close(self) -> None:
        """Unplug the line."""
        if self.is_open:
            _LINES.pop(self.port, None)
            self._line = None
            self.is_open = False

    @property
    def in_waiting(self) -> int:
        """Bytes that are ready."""
        with self._connected() as line:
            return line.device.waiting

    @property
    def out_waiting(self) -> int:
        """0: bytes take no time."""
        return 0

    def read(self, size: int = 1) -> bytes:
        """Give `size` bytes, or what there is when the time-out has expired.

        Raises
        ------
        serial.SerialException
            The port has no time-out, and what it would wait for never comes.
        """
        taken = b""
        with self._connected() as line:
            while len(taken) < size:
                more = line.device.read(size - len(taken))
                if not more:
                    self._expire(line)
                    break
                taken += more
        return taken

    def _expire(self, line: _Line) -> None:
        if self.timeout is None:
            raise serial.SerialException(f"{self.port}: nothing more will come, and the read has no time-out")
        if self.timeout > 0:
            line.clock.sleep_s(self.timeout)

    def write(self, data: Any) -> int:
        """Hand over bytes."""
        octets = bytes(data)
        with self._connected() as line:
            line.device.write(octets)
        return len(octets)

    def flush(self) -> None:
        """Do nothing: bytes take no time."""

    def reset_input_buffer(self) -> None:
        """Drop what is ready."""
        with self._connected() as line:
            line.device.clear()

    def reset_output_buffer(self) -> None:
        """Do nothing: what was written has arrived."""

    @contextmanager
    def _connected(self) -> Iterator[_Line]:
        """Give the line, and say in pyserial's way that it is gone."""
        if self._line is None:
            raise PortNotOpenError()
        try:
            yield self._line
        except ConnectionError as error:
            raise serial.SerialException(f"{self.port} is disconnected: {error}") from error

    def _reconfigure_port(self) -> None:
        """Accept any line setting."""

    _update_rts_state = _update_dtr_state = _update_break_state = _reconfigure_port
