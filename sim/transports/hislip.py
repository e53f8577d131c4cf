"""HiSLIP (IVI-6.1, revision 1.0, synchronized mode): instruments at two TCP connections for each client.

The synchronous connection carries messages with their ends, triggers and the end of a device clear. The
asynchronous one carries status queries, device clears, service requests and locks.

What this does not model: overlapped mode, encryption and the other messages of revision 2.0, and a front
panel, so remote and local control are answered and change nothing.
"""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

from sim.transports.channels import MOST_UNSENT_BYTES, Wire
from sim.transports.hislip_locks import LockAnswer, Locks
from sim.transports.hislip_messages import (
    FIRST_VENDOR_KIND,
    Fatal,
    FatalProblem,
    Kind,
    Message,
    Reader,
    Refused,
    RefusedMessage,
)
from sim.transports.hislip_session import MOST_PAYLOAD_BYTES, Session

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sim.devices.scpi import ScpiDevice

_VERSION = 0x0100
_MOST_HELD_BYTES = 2 * MOST_PAYLOAD_BYTES
_MOST_SESSIONS = 0xFFFF
_LONGEST_KEY = 256


class HislipPort:
    """The instruments behind one port, their clients and their locks.

    Parameters
    ----------
    devices : sequence of ScpiDevice
        At sub-addresses hislip0, hislip1 and so on; a client that names none gets the first.
    most_clients : int
        Of each at once; a further one is told so by fatal error 4.
    now_s : callable
        Time for the waits for locks.
    """

    def __init__(
        self, devices: Sequence[ScpiDevice], most_clients: int, now_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._devices = {sub_address(place): (device, Locks()) for place, device in enumerate(devices)}
        self.now_s = now_s
        self.sessions: dict[int, Session] = {}
        self._most_clients = most_clients
        self._last_number = 0

    def wire(self) -> HislipWire:
        """Return the wire of a new connection; its first message tells which of the two it is."""
        return HislipWire(self)

    def open(self, message: Message) -> Session:
        """Begin a session.

        Raises
        ------
        FatalProblem
            For an instrument that is not here, or one client too many.
        """
        address = message.payload.decode("latin-1").lower() or sub_address(0)
        if address not in self._devices:
            raise FatalProblem(
                Fatal.POOR_INITIALIZATION, f"no instrument here but {' and '.join(self._devices)}"
            )
        if message.parameter >> 16 < _VERSION:
            raise FatalProblem(Fatal.POOR_INITIALIZATION, "versions from 1.0 on are understood")
        device, locks = self._devices[address]
        if sum(session.device is device for session in self.sessions.values()) >= self._most_clients:
            raise FatalProblem(
                Fatal.TOO_MANY_CLIENTS, f"{self._most_clients} clients are there, which is all"
            )
        while self._last_number in self.sessions or not self._last_number:
            self._last_number = self._last_number % _MOST_SESSIONS + 1
        session = self.sessions[self._last_number] = Session(self._last_number, device, locks)
        return session

    def close(self, session: Session) -> None:
        """End a session: its locks are free, and nothing of its input is left."""
        if self.sessions.pop(session.number, None):
            session.locks.drop(session.number)
            session.end()


def sub_address(place: int) -> str:
    """Return the name of an instrument within its port, counted from 0."""
    return f"hislip{place}"


class HislipWire(Wire):
    """One connection of a client."""

    def __init__(self, port: HislipPort) -> None:
        self._port = port
        self._reader = Reader(MOST_PAYLOAD_BYTES)
        self._own = bytearray()
        self._session: Session | None = None
        self._is_async = False
        self._awaited: tuple[str, float] | None = None

    @property
    def is_full(self) -> bool:
        """Whether a client that is locked out has sent more than is kept for it."""
        return len(self._reader) > _MOST_HELD_BYTES

    def feed(self, data: bytes, until_s: float = math.inf) -> None:
        """Take bytes, and do what their messages say."""
        if not self.finished:
            self._reader.feed(data)
            self._go_on(until_s)

    def take(self, until_s: float = math.inf) -> bytes:
        """Give what this connection has to say."""
        self._go_on(until_s)
        self._await_lock()
        session = self._session
        if session:
            # The synchronous connection is the older one, so its answers are out when service is thought of.
            session.request_service() if self._is_async else session.follow()
            self._own += session.take(self._is_async)
            self.finished |= session.is_over
        taken = bytes(self._own)
        self._own.clear()
        return taken

    def gone(self) -> None:
        """End the session: a client needs both of its connections."""
        if self._session:
            self._port.close(self._session)

    def _go_on(self, until_s: float) -> None:
        """Do what complete messages say, as far as time and the locks of others allow."""

        def may() -> bool:
            return time.monotonic() < until_s

        self.is_busy = True
        while not (self.finished or self._is_choked()):
            if self._session and not (self._is_async or self._session.go_on(self._reader.following(), may)):
                return
            try:
                message = None if self._is_barred() else self._reader.next()
                if message is None:
                    self.is_busy = False
                    return
                self._obey(message)
            except RefusedMessage as error:
                if self._session is None:
                    self._end(Fatal.POOR_INITIALIZATION, error.text)
                else:
                    self._own += Message(Kind.ERROR, error.code, 0, error.text.encode()).packed()
            except FatalProblem as error:
                self._end(error.code, error.text)
            if not may():
                return
        self.is_busy = not self.finished

    def _is_choked(self) -> bool:
        if len(self._own) >= MOST_UNSENT_BYTES:
            return True
        return bool(self._session and not self._is_async and self._session.is_choked)

    def _is_barred(self) -> bool:
        session = self._session
        if session is None or self._is_async or session.is_clearing:
            return False
        return session.locks.bars(session.number)

    def _end(self, code: Fatal, text: str) -> None:
        self._own += Message(Kind.FATAL_ERROR, code, 0, text.encode()).packed()
        self._hang_up()

    def _hang_up(self) -> None:
        self.finished = True
        if self._session:
            self._port.close(self._session)

    def _obey(self, message: Message) -> None:
        if self._session is None:
            self._begin(message)
        elif message.kind in (Kind.INITIALIZE, Kind.ASYNC_INITIALIZE):
            raise FatalProblem(Fatal.POOR_INITIALIZATION, "this connection is initialized already")
        elif message.kind == Kind.FATAL_ERROR:
            self._hang_up()
        elif message.kind == Kind.ERROR:
            return
        elif not self._session.is_complete:
            raise FatalProblem(Fatal.ONE_CHANNEL, "the asynchronous connection is missing")
        elif self._is_async:
            self._obey_async(self._session, message)
        elif message.kind in (Kind.DATA, Kind.DATA_END, Kind.TRIGGER, Kind.DEVICE_CLEAR_COMPLETE):
            self._session.obey(message)
        else:
            raise _unknown(message)

    def _begin(self, message: Message) -> None:
        if message.kind == Kind.INITIALIZE:
            self._session = self._port.open(message)
            number = self._session.number
            self._answer(Kind.INITIALIZE_RESPONSE, 0, _VERSION << 16 | number)
        elif message.kind == Kind.ASYNC_INITIALIZE:
            session = self._port.sessions.get(message.parameter & _MOST_SESSIONS)
            if session is None or session.is_complete:
                raise FatalProblem(Fatal.POOR_INITIALIZATION, "no session waits for this connection")
            self._session, self._is_async, session.is_complete = session, True, True
            self._answer(Kind.ASYNC_INITIALIZE_RESPONSE)
        else:
            raise FatalProblem(Fatal.POOR_INITIALIZATION, "a connection begins with its initialization")

    def _obey_async(self, session: Session, message: Message) -> None:
        match message.kind:
            case Kind.ASYNC_MAX_MESSAGE_SIZE:
                size = session.agree_on_size(message.payload)
                self._answer(Kind.ASYNC_MAX_MESSAGE_SIZE_RESPONSE, payload=size)
            case Kind.ASYNC_STATUS_QUERY:
                self._answer(Kind.ASYNC_STATUS_RESPONSE, session.status(message))
            case Kind.ASYNC_DEVICE_CLEAR:
                session.begin_clear()
                self._answer(Kind.ASYNC_DEVICE_CLEAR_ACKNOWLEDGE)
            case Kind.ASYNC_REMOTE_LOCAL_CONTROL:
                _allow(message, 6)
                self._answer(Kind.ASYNC_REMOTE_LOCAL_RESPONSE)
            case Kind.ASYNC_LOCK:
                self._lock(session, message)
            case Kind.ASYNC_LOCK_INFO:
                held = session.locks
                self._answer(Kind.ASYNC_LOCK_INFO_RESPONSE, int(held.is_exclusive), held.holders)
            case _:
                raise _unknown(message)

    def _lock(self, session: Session, message: Message) -> None:
        _allow(message, 1)
        locks = session.locks
        if not message.control:
            self._answer(Kind.ASYNC_LOCK_RESPONSE, locks.release(session.number))
        elif self._awaited or len(message.payload) > _LONGEST_KEY:
            self._answer(Kind.ASYNC_LOCK_RESPONSE, LockAnswer.ERROR)
        else:
            self.due_s = self._port.now_s() + message.parameter / 1e3
            self._awaited = message.payload.decode("latin-1"), self.due_s
            self._await_lock()

    def _await_lock(self) -> None:
        """Answer a request for a lock once it is granted, or its time is over."""
        if self._awaited is None or self._session is None:
            return
        key, until_s = self._awaited
        answer = self._session.locks.request(self._session.number, key)
        if answer is not LockAnswer.FAILURE or self._port.now_s() >= until_s:
            self._awaited, self.due_s = None, math.inf
            self._answer(Kind.ASYNC_LOCK_RESPONSE, answer)

    def _answer(self, kind: Kind, control: int = 0, parameter: int = 0, payload: bytes = b"") -> None:
        self._own += Message(kind, control, parameter, payload).packed()


def _allow(message: Message, most: int) -> None:
    if message.control > most:
        raise RefusedMessage(Refused.UNKNOWN_CONTROL, f"control code {message.control}; allowed: 0 to {most}")


def _unknown(message: Message) -> RefusedMessage:
    is_vendor = message.kind >= FIRST_VENDOR_KIND
    return RefusedMessage(
        Refused.UNKNOWN_VENDOR_KIND if is_vendor else Refused.UNKNOWN_KIND,
        f"message type {message.kind} is not understood on this connection",
    )
