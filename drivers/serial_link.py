"""A serial line, real or by URL, as a link."""

from __future__ import annotations

import sys
from contextlib import suppress
from typing import Any

from belahil.errors import LinkClosed, LinkTimeout

# Assumed: the fastest rate that common USB-to-serial converters and UARTs share.
DEFAULT_BAUD = 921600
WRITE_TIMEOUT_S = 2.0
_FAILED: tuple[type[Exception], ...] = (OSError,)
if sys.platform != "win32":
    import termios

    _FAILED += (termios.error,)  # which is no OSError
_NOT_OPENED: tuple[type[Exception], ...] = (*_FAILED, ValueError)


class SerialLink:
    """A serial line, or whatever else pyserial opens by URL.

    Parameters
    ----------
    port : serial.SerialBase
        Open, with a write time-out.
    """

    def __init__(self, port: Any) -> None:
        self._port = port

    def write(self, data: bytes) -> None:
        """Send all of `data`.

        Raises
        ------
        LinkTimeout
            The other end does not take it.
        LinkClosed
            It is gone.
        """
        import serial

        try:
            self._port.write(data)
        except serial.SerialTimeoutException as error:
            raise LinkTimeout(f"serial link {self._port.name}: {len(data)} bytes were not taken") from error
        except _FAILED as error:
            raise self._closed(error) from error

    def read(self, count: int, timeout_s: float) -> bytes:
        """Return up to `count` bytes as soon as there are some; empty when none came in time.

        Raises
        ------
        LinkClosed
            The other end is gone.
        """
        port = self._port
        try:
            # pyserial reads until `count` or the time-out, and over a socket it reports one waiting byte
            # whenever there are some: so wait for one byte, then take what is there without waiting.
            waiting = port.in_waiting
            if waiting > 1:
                return bytes(port.read(min(waiting, count)))
            port.timeout = timeout_s
            first = port.read(1)
            if not first or count == 1:
                return bytes(first)
            port.timeout = 0
            return bytes(first + port.read(count - 1))
        except _FAILED as error:
            raise self._closed(error) from error

    def clear(self) -> None:
        """Drop what has arrived."""
        try:
            self._port.reset_input_buffer()
        except _FAILED as error:
            raise self._closed(error) from error

    def close(self) -> None:
        """Let go of the port."""
        with suppress(*_FAILED):
            self._port.close()

    def _closed(self, error: Exception) -> LinkClosed:
        return LinkClosed(f"serial link {self._port.name} is gone: {error}")


def open_serial(url: str, baud: int = DEFAULT_BAUD) -> SerialLink:
    """Open what pyserial calls by `url`: a port, or a URL of one of its handlers.

    Raises
    ------
    LinkClosed
        It cannot be opened.
    """
    import serial

    try:
        port = serial.serial_for_url(url, baudrate=baud, write_timeout=WRITE_TIMEOUT_S, exclusive=True)
    except _NOT_OPENED as error:
        raise LinkClosed(f"serial link {url} does not open: {error}") from error
    return SerialLink(port)
