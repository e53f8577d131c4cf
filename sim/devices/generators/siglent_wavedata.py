"""The points of a waveform in a Siglent command: bytes as they are, after ``WAVEDATA,``."""

from __future__ import annotations

import re

from sim.devices.scpi.exchange import Connection, Exchange, Instrument

_MARK = re.compile(rb"WAVEDATA,", re.IGNORECASE)
_LENGTH = re.compile(rb"LENGTH,\s*(\d{1,8})B?\s*,", re.IGNORECASE)
_LONGEST_TEXT = 1 << 16
_LONGEST_DATA = 1 << 25


class WaveData:
    """Puts a definite-length block in the place of bare points, so that other parts need not know of them.

    How many there are is told by ``LENGTH,nB`` before them, or else by END, which USB and VXI-11 have. A raw
    socket has none: there a line feed after whole points ends them when nothing has come after it yet, so
    that points which arrive in portions may be cut (1 of 512 portions). A line feed after the points is no
    part of them.
    """

    def __init__(self) -> None:
        self._held = bytearray()
        self._head: bytes | None = None
        self._count: int | None = None

    def feed(self, data: bytes, end: bool) -> bytes:
        """Take more of the stream and return what is ready of it, with blocks."""
        self._held += data
        ready = bytearray()
        while self._held or (end and self._head is not None):
            piece = self._text(end) if self._head is None else self._points(end)
            if piece is None:
                break
            ready += piece
        return bytes(ready)

    def _text(self, end: bool) -> bytes | None:
        stop = self._held.find(b"\n") + 1
        mark = _MARK.search(self._held, 0, stop or len(self._held))
        if mark:
            self._head = self._taken(mark.end())
            length = _LENGTH.search(self._head)
            self._count = int(length[1]) if length else None
            return b""
        if stop or end or len(self._held) > _LONGEST_TEXT:
            return self._taken(stop or len(self._held))
        return None

    def _points(self, end: bool) -> bytes | None:
        size = len(self._held)
        if self._count is not None:
            if size < self._count and not end:
                return None
            return self._block(min(size, self._count))
        closed = self._held.endswith(b"\n") and size % 2 == 1
        if end or closed or size > _LONGEST_DATA:
            return self._block(size - closed)
        return None

    def _block(self, size: int) -> bytes:
        """Return the command with its block; it is as long as it says, so that a cut one is noticed."""
        head, count = self._head or b"", self._count if self._count is not None else size
        self._head = self._count = None
        digits = str(count).encode()
        return head + b"#%d%b" % (len(digits), digits) + self._taken(size)

    def _taken(self, count: int) -> bytes:
        piece = bytes(self._held[:count])
        del self._held[:count]
        return piece


class WaveConnection(Connection):
    """A connection to an instrument that is sent waveforms as bare points."""

    def __init__(self, instrument: Instrument, exchange: Exchange = "stream") -> None:
        super().__init__(instrument, exchange)
        self._data = WaveData()

    def push(self, data: bytes, end: bool = False) -> None:
        """Take bytes, see `WaveData`."""
        super().push(self._data.feed(data, end), end)

    def clear(self) -> None:
        """Drop what was sent in part and what was not read."""
        self._data = WaveData()
        super().clear()
