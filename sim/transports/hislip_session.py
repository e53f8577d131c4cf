"""What a HiSLIP client has asked and been told: the order of its messages, and its status byte."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from sim.devices.scpi.status import MASTER_BIT
from sim.transports.channels import MOST_UNSENT_BYTES
from sim.transports.hislip_messages import (
    DELIVERED,
    FIRST_ID,
    HEADER,
    Kind,
    Message,
    Refused,
    RefusedMessage,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from sim.devices.scpi import ScpiDevice
    from sim.transports.hislip_locks import Locks

MOST_PAYLOAD_BYTES = 1 << 20
_LEAST_MESSAGE_BYTES = 256
_SIZE = struct.Struct(">Q")
_BEFORE_FIRST_ID = FIRST_ID - 2


class Session:
    """One client in synchronized mode.

    Parameters
    ----------
    number : int
        1 to 65535.
    device : ScpiDevice
        The instrument.
    locks : Locks
        Of that instrument.

    Notes
    -----
    An answer is expected to be read, to its end, before the client sends anything else (IVI-6.1, 3.1.1);
    where it was not, the device reports -410. A client that says it has read an answer that is not expected
    is believed: some forget to forget it in a device clear, where the standard would have an error.
    """

    def __init__(self, number: int, device: ScpiDevice, locks: Locks) -> None:
        self.number = number
        self.device = device
        self.locks = locks
        self.is_complete = False
        self.is_clearing = False
        self.is_over = False
        self._connection = device.connect("message")
        self._said = {True: bytearray(), False: bytearray()}
        self._last_id = _BEFORE_FIRST_ID
        self._is_unread = False
        self._most_bytes = MOST_PAYLOAD_BYTES
        self._reasons = 0
        self._is_requesting = False

    def take(self, is_async: bool) -> bytes:
        """Give what is to be said on one of the two connections."""
        said = self._said[is_async]
        taken = bytes(said)
        said.clear()
        return taken

    @property
    def is_choked(self) -> bool:
        """Whether as much is to be said as is held for a client that does not read."""
        return any(len(said) >= MOST_UNSENT_BYTES for said in self._said.values())

    def obey(self, message: Message) -> None:
        """Take a message of the synchronous connection; `go_on` carries it out.

        Parameters
        ----------
        message : Message
            Data with or without their end, a trigger, or the end of a device clear.
        """
        if message.kind == Kind.DEVICE_CLEAR_COMPLETE:
            self._end_clear()
            return
        if self.is_clearing:
            return
        if message.control & ~DELIVERED:
            raise RefusedMessage(Refused.UNKNOWN_CONTROL, f"control code {message.control}; allowed: 0, 1")
        if self._is_unread and not message.control & DELIVERED:
            self._connection.interrupted()
        self._is_unread = False
        self._last_id = message.parameter
        if message.kind == Kind.TRIGGER:
            self._connection.push(b"*TRG\n", end=True)
        else:
            self._connection.push(message.payload, end=message.kind == Kind.DATA_END)

    def go_on(self, following: tuple[int, int] | None, may: Callable[[], bool]) -> bool:
        """Carry out what was taken, as long as `may` says so.

        Parameters
        ----------
        following : tuple of int or None
            Type and parameter of what the client has sent behind it already.
        may : callable
            As for `Connection.go_on`.

        Returns
        -------
        bool
            False when something is left.
        """
        if not self._connection.go_on(may):
            return False
        if self._connection.has_answer and following and following[0] in _MESSAGES:
            self._interrupt(following[1])
        return True

    def follow(self) -> None:
        """Say what the device has to say by now."""
        if self._connection.has_answer or self._connection.owed:
            answer = self._connection.read()
            if answer:
                self._answer(answer)

    def request_service(self) -> None:
        """Tell of a new reason for service; no further one until the client has asked for the status."""
        byte = self.device.status_byte(self._is_unread)
        reasons = byte & self.device.status.service_enable & ~MASTER_BIT
        if reasons & ~self._reasons and not self._is_requesting:
            self._is_requesting = True
            self._said[True] += Message(Kind.ASYNC_SERVICE_REQUEST, byte | MASTER_BIT).packed()
        self._reasons = reasons

    def status(self, message: Message) -> int:
        """Answer a status query; after it the device may request service again.

        A message is available when the client names the last message that arrived here, and has not said
        that it has read the answer (IVI-6.1, 6.14.1).
        """
        if message.control & ~DELIVERED:
            raise RefusedMessage(Refused.UNKNOWN_CONTROL, f"control code {message.control}; allowed: 0, 1")
        self.follow()
        if message.control & DELIVERED:
            self._is_unread = False
        available = self._is_unread and message.parameter == self._last_id
        byte = self.device.status_byte(available) & ~MASTER_BIT
        requesting, self._is_requesting = self._is_requesting, False
        return byte | (MASTER_BIT if requesting else 0)

    def agree_on_size(self, payload: bytes) -> bytes:
        """Take the longest message that the client understands, and give the longest that is understood here.

        Raises
        ------
        RefusedMessage
            That is no size.
        """
        if len(payload) != _SIZE.size:
            raise RefusedMessage(Refused.UNIDENTIFIED, f"a size has {_SIZE.size} bytes; got {len(payload)}")
        longest = max(_LEAST_MESSAGE_BYTES, _SIZE.unpack(payload)[0])
        self._most_bytes = min(MOST_PAYLOAD_BYTES, longest - HEADER.size)
        return _SIZE.pack(MOST_PAYLOAD_BYTES)

    def begin_clear(self) -> None:
        """Give up what is under way; what arrives until the clear is complete is dropped."""
        self.is_clearing = True
        self._forget()

    def end(self) -> None:
        """Leave nothing behind."""
        self.is_over = True
        self._forget()

    def _end_clear(self) -> None:
        self.is_clearing = False
        self._forget()
        self._last_id = _BEFORE_FIRST_ID
        self._said[False] += Message(Kind.DEVICE_CLEAR_ACKNOWLEDGE).packed()

    def _forget(self) -> None:
        self._connection.clear()
        self._said[False].clear()
        self._is_unread = False

    def _answer(self, answer: bytes) -> None:
        said, most = self._said[False], self._most_bytes
        for start in range(0, len(answer), most):
            kind = Kind.DATA_END if start + most >= len(answer) else Kind.DATA
            said += Message(kind, 0, self._last_id, answer[start : start + most]).packed()
        self._is_unread = True

    def _interrupt(self, by_id: int) -> None:
        """Drop an answer that nobody will read: the client has sent its next message already."""
        self._connection.interrupted()
        self._said[True] += Message(Kind.ASYNC_INTERRUPTED, 0, by_id).packed()
        self._said[False] += Message(Kind.INTERRUPTED, 0, by_id).packed()


_MESSAGES = (Kind.DATA, Kind.DATA_END, Kind.TRIGGER)
