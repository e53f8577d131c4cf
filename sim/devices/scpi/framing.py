"""Cutting a byte stream into program messages; blocks may hold any byte, so they are taken out here."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import NamedTuple

from sim.devices.scpi.status import ScpiError

# Stands in the text where a block was.
BLOCK_MARK = "\x00"
_SPECIAL = re.compile(rb"[\n#\"'\x00]")
# One whole message without quotes and blocks: most of them.
_PLAIN = re.compile(rb"[^\n#\"'\x00]*\n")
_BEFORE_BLOCK = (b" ", b"\t", b",")
_UNTIL_END = -1


_NO_BLOCKS: Mapping[int, bytes | ScpiError] = MappingProxyType({})


class Message(NamedTuple):
    """One program message.

    Parameters
    ----------
    text : str
        All of it, without its end; a `BLOCK_MARK` stands for each block.
    blocks : mapping of int to bytes or ScpiError
        Content of the block at a place in `text`, or what is wrong with it.
    """

    text: str
    blocks: Mapping[int, bytes | ScpiError] = _NO_BLOCKS


class Framer:
    """Gathers bytes until a message is complete, however the stream was split.

    A line feed ends a message unless it is part of a block; so does END. An unclosed quote does not reach
    over a line feed. A block begins where a parameter does; a definite one is as long as it says, an
    indefinite one lasts until END.

    Parameters
    ----------
    capacity : int
        Most bytes of one message; a longer one is read over, and reported as -363.
    has_end : bool
        Whether the link has END. Where it has none an indefinite block would never be over: it is error
        -161, and so is what follows it up to the next line feed.
    """

    def __init__(self, capacity: int, has_end: bool = True) -> None:
        self._capacity = capacity
        self.has_end = has_end
        self.reset()

    def reset(self) -> None:
        """Forget an incomplete message."""
        self._text = bytearray()
        self._blocks: dict[int, bytes | ScpiError] = {}
        self._block = bytearray()
        self._missing = 0
        self._head = b""
        self._quote = b""
        self._size = 0
        self._is_refused = False

    def feed(self, data: bytes, end: bool) -> Iterator[Message]:
        """Take more of the stream and yield the messages that it completes, each when it is asked for."""
        if not (self._size or self._head or len(data) > self._capacity) and _PLAIN.fullmatch(data):
            yield Message(data[:-1].decode("latin-1"), {})
            return
        data, self._head = self._head + data, b""
        place = 0
        while place < len(data):
            if self._missing:
                place = self._fill(data, place)
                continue
            found = _SPECIAL.search(data, place)
            stop = found.start() if found else len(data)
            self._keep(data[place:stop])
            place = stop + 1
            mark = found.group() if found else b""
            if mark == b"\n":
                yield self._take()
            elif mark == b"#" and not self._quote and self._text.endswith(_BEFORE_BLOCK):
                place = self._open(data, place, end)
            else:
                self._literal(mark)
        if end and (self._text or self._missing):
            yield self._take()

    def _literal(self, mark: bytes) -> None:
        if mark == self._quote:
            self._quote = b""
        elif mark in (b'"', b"'") and not self._quote:
            self._quote = mark
        # A zero byte is white space, and must not be taken for a block.
        self._keep(b" " if mark == b"\x00" else mark)

    def _keep(self, piece: bytes) -> None:
        if self._is_refused:
            return
        if self._fits(len(piece)):
            self._text += piece
        else:
            self._text[:] = piece[-1:]

    def _fits(self, count: int) -> bool:
        self._size += count
        return self._size <= self._capacity

    def _open(self, data: bytes, place: int, end: bool) -> int:
        """Begin a block after the ``#`` before `place`; return where to go on."""
        count = data[place : place + 1]
        if count and not count.isdigit():
            self._keep(b"#")
            return place
        if count == b"0" and not (end or self.has_end):
            self._close(ScpiError(-161, "an indefinite block needs END, which this link does not have"))
            self._is_refused = True
            return place + 1
        if count == b"0":
            self._missing = _UNTIL_END
            return place + 1
        stop = place + 1 + int(count or b"1")
        digits = data[place + 1 : stop]
        complete = stop <= len(data)
        if not complete and not end and (digits.isdigit() or not digits):
            self._head = data[place - 1 :]
            return len(data)
        if not complete or not digits.isdigit():
            self._close(ScpiError(-161))
            return place
        self._missing = int(digits)
        if not self._missing:
            self._close(b"")
        return stop

    def _fill(self, data: bytes, place: int) -> int:
        """Move what belongs to the open block; return where to go on."""
        whole = self._missing == _UNTIL_END
        stop = len(data) if whole else min(len(data), place + self._missing)
        if self._fits(stop - place):
            self._block += data[place:stop]
        if not whole:
            self._missing -= stop - place
            if not self._missing:
                self._close(bytes(self._block))
        return stop

    def _close(self, content: bytes | ScpiError) -> None:
        self._blocks[len(self._text)] = content
        self._keep(BLOCK_MARK.encode())
        self._block = bytearray()

    def _take(self) -> Message:
        """Return the message that has ended and begin the next."""
        if self._missing == _UNTIL_END:
            self._close(bytes(self._block).removesuffix(b"\n"))
        elif self._missing:
            self._close(ScpiError(-161))
        message = Message(self._text.decode("latin-1"), self._blocks)
        if self._size > self._capacity:
            message = Message(BLOCK_MARK, {0: ScpiError(-363)})
        self.reset()
        return message
