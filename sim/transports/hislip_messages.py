"""Messages of HiSLIP (IVI-6.1, revision 1.0): a header of 16 bytes and a payload."""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import NamedTuple

HEADER = struct.Struct(">2sBBIQ")
PROLOGUE = b"HS"
FIRST_ID = 0xFFFF_FF00
"""Number of a client's first message, and of the first after a device clear; the next have every second."""
DELIVERED = 1
"""Control bit: the client has handed the last answer to its program, to the end."""


class Kind(IntEnum):
    """Types of messages."""

    INITIALIZE = 0
    INITIALIZE_RESPONSE = 1
    FATAL_ERROR = 2
    ERROR = 3
    ASYNC_LOCK = 4
    ASYNC_LOCK_RESPONSE = 5
    DATA = 6
    DATA_END = 7
    DEVICE_CLEAR_COMPLETE = 8
    DEVICE_CLEAR_ACKNOWLEDGE = 9
    ASYNC_REMOTE_LOCAL_CONTROL = 10
    ASYNC_REMOTE_LOCAL_RESPONSE = 11
    TRIGGER = 12
    INTERRUPTED = 13
    ASYNC_INTERRUPTED = 14
    ASYNC_MAX_MESSAGE_SIZE = 15
    ASYNC_MAX_MESSAGE_SIZE_RESPONSE = 16
    ASYNC_INITIALIZE = 17
    ASYNC_INITIALIZE_RESPONSE = 18
    ASYNC_DEVICE_CLEAR = 19
    ASYNC_SERVICE_REQUEST = 20
    ASYNC_STATUS_QUERY = 21
    ASYNC_STATUS_RESPONSE = 22
    ASYNC_DEVICE_CLEAR_ACKNOWLEDGE = 23
    ASYNC_LOCK_INFO = 24
    ASYNC_LOCK_INFO_RESPONSE = 25


FIRST_VENDOR_KIND = 128


class Fatal(IntEnum):
    """Errors after which the server closes both connections."""

    UNIDENTIFIED = 0
    POOR_HEADER = 1
    ONE_CHANNEL = 2
    POOR_INITIALIZATION = 3
    TOO_MANY_CLIENTS = 4


class Refused(IntEnum):
    """Errors that cost one message."""

    UNIDENTIFIED = 0
    UNKNOWN_KIND = 1
    UNKNOWN_CONTROL = 2
    UNKNOWN_VENDOR_KIND = 3
    TOO_LARGE = 4


class FatalProblem(Exception):
    """What a client sent cannot be gone on with."""

    def __init__(self, code: Fatal, text: str) -> None:
        super().__init__(text)
        self.code = code
        self.text = text


class RefusedMessage(Exception):
    """One message cannot be taken; the next one can."""

    def __init__(self, code: Refused, text: str) -> None:
        super().__init__(text)
        self.code = code
        self.text = text


class Message(NamedTuple):
    """One message; `kind` is a number, since a client may send any."""

    kind: int
    control: int = 0
    parameter: int = 0
    payload: bytes = b""

    def packed(self) -> bytes:
        """Return it as bytes."""
        return (
            HEADER.pack(PROLOGUE, self.kind, self.control, self.parameter, len(self.payload)) + self.payload
        )


class Reader:
    """Gathers bytes until a message is complete, however the stream was split.

    Parameters
    ----------
    most_bytes : int
        Longest payload; that of a longer message is read over.
    """

    def __init__(self, most_bytes: int) -> None:
        self._most_bytes = most_bytes
        self._held = bytearray()
        self._skip = 0

    def __len__(self) -> int:
        return len(self._held)

    def feed(self, data: bytes) -> None:
        """Take more of the stream."""
        skipped = min(self._skip, len(data))
        self._skip -= skipped
        self._held += data[skipped:]

    def next(self) -> Message | None:
        """Return the next message once it is complete, None before.

        Raises
        ------
        FatalProblem
            This is no header: nobody knows where the next message begins.
        RefusedMessage
            Its payload is too long.
        """
        if len(self._held) < HEADER.size:
            return None
        prologue, kind, control, parameter, length = HEADER.unpack_from(self._held)
        if prologue != PROLOGUE:
            raise FatalProblem(Fatal.POOR_HEADER, f"a message begins with {PROLOGUE.decode()}")
        stop = HEADER.size + length
        if length > self._most_bytes:
            gone = min(stop, len(self._held))
            del self._held[:gone]
            self._skip = stop - gone
            raise RefusedMessage(
                Refused.TOO_LARGE, f"{length} bytes in one message; allowed: {self._most_bytes}"
            )
        if len(self._held) < stop:
            return None
        payload = bytes(memoryview(self._held)[HEADER.size : stop])
        del self._held[:stop]
        return Message(kind, control, parameter, payload)

    def following(self) -> tuple[int, int] | None:
        """Type and parameter of the next message when its header is there, complete or not."""
        if len(self._held) < HEADER.size:
            return None
        _, kind, _, parameter, _ = HEADER.unpack_from(self._held)
        return kind, parameter
