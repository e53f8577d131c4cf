"""A loop that serves emulated devices to other processes."""

from __future__ import annotations

import itertools
import math
import os
import selectors
import socket
import time
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from belahil.errors import LinkError
from sim.transports.channels import MOST_UNSENT_BYTES, HungUp, SocketChannel

if TYPE_CHECKING:
    from collections.abc import Callable

    from sim.transports.channels import Channel, PtyChannel, Wire
    from sim.transports.line_pace import LinePace

    Connect = Callable[[], Wire]
    NewPace = Callable[[], LinePace]

_READ, _WRITE = selectors.EVENT_READ, selectors.EVENT_WRITE
_TURN_S = 0.01
"""How long one client keeps the others waiting, beside what a single command takes."""
_PORTION_BYTES = 1 << 18
_LOOK_AGAIN_S = 0.05
"""How often a pseudo-terminal without a client is looked at: nothing tells when one comes."""


class _Client:
    """A channel, the wire behind it, and what could not be sent yet."""

    def __init__(
        self, number: int, channel: Channel, wire: Wire, pace: LinePace | None, line: _Line | None
    ) -> None:
        self.number = number
        self.channel = channel
        self.wire = wire
        self.pace = pace
        self.line = line
        self.watched = 0
        self.unsent = bytearray()
        self.is_stuck = False
        self.is_served = False

    def receive(self) -> None:
        data = self.channel.receive()
        if not data:
            raise ConnectionAbortedError("the client has left")
        until_s = time.monotonic() + _TURN_S
        self.wire.feed(data, until_s)
        if self.pace is None and not self.unsent:
            self._answer_at_once(until_s)

    def _answer_at_once(self, until_s: float) -> None:
        """Send what a question gave before anything else is looked after: most clients wait for it."""
        taken = self.wire.take(until_s)
        if taken:
            self.unsent += taken[self.channel.send(taken) :]
        self.is_served = not (self.unsent or self.wire.finished or self.wire.is_busy)

    def pump(self, now_s: float) -> None:
        """Send what the device has to say, as far as time and the channel allow."""
        until_s = time.monotonic() + _TURN_S
        while self._has_room and (taken := self.wire.take(until_s)):
            self.unsent += taken
            if self.pace:
                self.pace.queue(len(taken), now_s)
            if time.monotonic() >= until_s:
                break
        self.is_stuck = self.is_served = False
        while self.unsent and not self.is_stuck:
            count = min(_PORTION_BYTES, self.pace.ready(now_s) if self.pace else _PORTION_BYTES)
            if not count:
                return
            sent = self.channel.send(bytes(self.unsent[:count]))
            del self.unsent[:sent]
            if self.pace:
                self.pace.sent(sent)
            self.is_stuck = not sent
        if self.wire.finished and not self.unsent:
            raise ConnectionAbortedError("all has been said")

    def next_s(self, now_s: float) -> float:
        """Time when `pump` has something to do although nothing has arrived."""
        due_s = self.wire.due_s
        if self.wire.is_busy:
            due_s = now_s if self._has_room else math.inf
        if self.pace is None or self.is_stuck:
            return due_s
        return min(due_s, self.pace.next_s(now_s))

    @property
    def _has_room(self) -> bool:
        return len(self.unsent) < MOST_UNSENT_BYTES

    @property
    def events(self) -> int:
        """What to wait for."""
        read = _READ if self._has_room and not self.wire.is_full else 0
        return read | (_WRITE if self.is_stuck else 0)


class _Turn(NamedTuple):
    """What to do when something has arrived.

    Older clients come first, since of the two connections of a HiSLIP client the older one has what the
    other asks about; listeners come last, so that who has left makes room for who comes.
    """

    order: float
    act: Callable[[], None]


def _in_order(turn: _Turn) -> float:
    return turn.order


@dataclass(frozen=True, slots=True)
class _Line:
    """A pseudo-terminal, and what a client finds there."""

    channel: PtyChannel
    connect: Connect
    new_pace: NewPace | None


class Server:
    """Serves devices over one plant, in one thread: no device is ever asked by two clients at once.

    Use it as a context manager; leaving it closes all that is open.

    Parameters
    ----------
    tell : callable, optional
        Takes a line for whoever runs the server.
    new_pace : callable, optional
        Makes the pace of a new client; without it bytes take no time.
    """

    def __init__(
        self, tell: Callable[[str], None] = lambda line: None, new_pace: NewPace | None = None
    ) -> None:
        self._tell = tell
        self._new_pace = new_pace
        self._selector = selectors.DefaultSelector()
        self._clients: list[_Client] = []
        self._numbers = itertools.count()
        self._absent: list[_Line] = []
        self._listeners: list[socket.socket] = []
        self._stopping = False
        self._waker, self._woken = socket.socketpair()
        self._selector.register(self._woken, _READ)

    def listen(
        self, connect: Connect, host: str, port: int, most_clients: int, new_pace: NewPace | None = None
    ) -> int:
        """Wait for clients on a TCP port.

        Parameters
        ----------
        connect : callable
            Makes the wire of a new client.
        host : str
            Address to listen at.
        port : int
            0 for any that is free.
        most_clients : int
            At once; a further one is disconnected.
        new_pace : callable, optional
            In place of the server's.

        Returns
        -------
        int
            The port.

        Raises
        ------
        LinkError
            The host has no address, or the port cannot be had.
        """
        family, address = resolved(host, port)
        try:
            listener = socket.create_server(address, family=family)
        except OSError as error:
            why = os.strerror(error.errno) if error.errno else error
            raise LinkError(f"{bracketed(host)}:{port}: {why}; nothing can be served there") from error
        listener.setblocking(False)
        self._listeners.append(listener)
        bound: int = listener.getsockname()[1]
        connected: list[_Client] = []

        def accept() -> None:
            with suppress(OSError):
                line, peer = listener.accept()
                channel = SocketChannel(line)
                connected[:] = [client for client in connected if client in self._clients]
                if len(connected) < most_clients:
                    connected.append(self._add(channel, connect(), new_pace))
                else:
                    channel.close()
                    self._tell(
                        f"port {bound}: {_place(peer)} was sent away: {most_clients} clients are there"
                    )

        self._selector.register(listener, _READ, _Turn(math.inf, accept))
        return bound

    def attach(self, channel: PtyChannel, connect: Connect, new_pace: NewPace | None = None) -> None:
        """Serve a pseudo-terminal; each client that opens it gets a new wire."""
        self._absent.append(_Line(channel, connect, new_pace))

    def run(self) -> None:
        """Serve until `stop`."""
        while not self._stopping:
            ready = [key.data for key, events in self._selector.select(self._patience_s()) if events & _READ]
            if len(ready) > 1:
                ready = sorted(filter(None, ready), key=_in_order)
            for turn in ready:
                if turn:
                    turn.act()
            self._look_for_callers()
            now_s = time.monotonic()
            # What one device was told can give another one something to say.
            for client in tuple(self._clients):
                if client.is_served and len(ready) == 1:
                    client.is_served = False
                else:
                    self._attempt(client, client.pump, now_s)

    def stop(self) -> None:
        """Make `run` return; may be called from another thread or a signal handler."""
        self._stopping = True
        with suppress(OSError):
            self._waker.send(b"\0")

    def __enter__(self) -> Server:
        return self

    def __exit__(self, *_: object) -> None:
        self._stopping = True
        for client in tuple(self._clients):
            self._drop(client)
        self._selector.close()
        for line in self._absent:
            line.channel.close()
        for closing in (*self._listeners, self._waker, self._woken):
            closing.close()

    def _patience_s(self) -> float | None:
        now_s = time.monotonic()
        next_s = math.inf
        for client in self._clients:
            next_s = min(next_s, client.next_s(now_s))
        if self._absent:
            next_s = min(next_s, now_s + _LOOK_AGAIN_S)
        return max(0.0, next_s - now_s) if next_s < math.inf else None

    def _look_for_callers(self) -> None:
        for line in tuple(self._absent):
            if line.channel.is_open():
                self._absent.remove(line)
                self._add(line.channel, line.connect(), line.new_pace, line)

    def _add(
        self, channel: Channel, wire: Wire, new_pace: NewPace | None, line: _Line | None = None
    ) -> _Client:
        new_pace = new_pace or self._new_pace
        client = _Client(next(self._numbers), channel, wire, new_pace() if new_pace else None, line)
        self._clients.append(client)
        self._watch(client)
        return client

    def _attempt(self, client: _Client, action: Callable[..., None], *about: float) -> None:
        """Do something with a client, and let go of one that is gone."""
        try:
            action(*about)
        except BlockingIOError:
            return
        except (OSError, HungUp):
            self._drop(client)
            return
        self._watch(client)

    def _watch(self, client: _Client) -> None:
        """Wait for what the client can do; a selector does not take those who wait for nothing."""
        wanted = client.events
        if wanted == client.watched:
            return
        listen = _Turn(client.number, partial(self._attempt, client, client.receive))
        if not client.watched:
            self._selector.register(client.channel, wanted, listen)
        elif wanted:
            self._selector.modify(client.channel, wanted, listen)
        else:
            self._selector.unregister(client.channel)
        client.watched = wanted

    def _drop(self, client: _Client) -> None:
        self._clients.remove(client)
        if client.watched:
            self._selector.unregister(client.channel)
        client.wire.gone()
        if client.line and not self._stopping:
            self._absent.append(client.line)
        else:
            client.channel.close()


def resolved(host: str, port: int = 0) -> tuple[socket.AddressFamily, Any]:
    """Return the family and the address that a host name, or an address of IPv4 or IPv6, stands for.

    Raises
    ------
    LinkError
        There is none.
    """
    try:
        found = socket.getaddrinfo(host or None, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except (OSError, UnicodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "no name can be so"
        raise LinkError(
            f"--host {host}: {why}; allowed: a name or an address of this computer, such as 127.0.0.1 or ::1"
        ) from error
    family, _, _, _, address = found[0]
    return family, address


def bracketed(host: str) -> str:
    """Write a host as it stands before a port: an address of IPv6 has brackets there."""
    return f"[{host}]" if ":" in host else host


def _place(peer: tuple[str, int]) -> str:
    return f"{bracketed(peer[0])}:{peer[1]}"
