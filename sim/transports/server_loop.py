"""A loop that serves emulated devices to other processes."""

from __future__ import annotations

import selectors
import socket
from contextlib import suppress
from typing import TYPE_CHECKING

from belahil.errors import LinkError
from sim.transports.channels import SocketChannel

if TYPE_CHECKING:
    from collections.abc import Callable

    from sim.transports.channels import Channel, Wire

_READ, _WRITE = selectors.EVENT_READ, selectors.EVENT_WRITE


class _Client:
    """A channel, the wire behind it, and what could not be sent yet."""

    def __init__(self, channel: Channel, wire: Wire) -> None:
        self.channel = channel
        self.wire = wire
        self.unsent = b""

    def receive(self) -> None:
        data = self.channel.receive()
        if not data:
            raise ConnectionAbortedError("the client has left")
        self.wire.feed(data)

    def pump(self) -> None:
        """Send what the device has to say, as far as the channel takes it."""
        while self.unsent or (taken := self.wire.take()):
            self.unsent = self.unsent or taken
            sent = self.channel.send(self.unsent)
            if not sent:
                return
            self.unsent = self.unsent[sent:]


class Server:
    """Serves devices over one plant, in one thread: no device is ever asked by two clients at once.

    Use it as a context manager; leaving it closes all that is open.
    """

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()
        self._clients: list[_Client] = []
        self._listeners: list[socket.socket] = []
        self._stopping = False
        self._waker, self._woken = socket.socketpair()
        self._selector.register(self._woken, _READ)

    def listen(self, connect: Callable[[], Wire], host: str, port: int, most_clients: int) -> int:
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

        Returns
        -------
        int
            The port.

        Raises
        ------
        LinkError
            The port cannot be had.
        """
        try:
            listener = socket.create_server((host, port))
        except OSError as error:
            raise LinkError(
                f"{host}:{port}: {error.strerror or error}; nothing can be served there"
            ) from error
        listener.setblocking(False)
        self._listeners.append(listener)
        connected: list[_Client] = []

        def accept() -> None:
            with suppress(BlockingIOError, ConnectionError):
                channel = SocketChannel(listener.accept()[0])
                connected[:] = [client for client in connected if client in self._clients]
                if len(connected) < most_clients:
                    connected.append(self._add(channel, connect()))
                else:
                    channel.close()

        self._selector.register(listener, _READ, accept)
        bound: int = listener.getsockname()[1]
        return bound

    def attach(self, channel: Channel, wire: Wire) -> None:
        """Serve a channel that is open."""
        self._add(channel, wire)

    def run(self) -> None:
        """Serve until `stop`."""
        while not self._stopping:
            for key, events in self._selector.select():
                if key.data and events & _READ:
                    key.data()
            # What one device was told can give another one something to say.
            for client in tuple(self._clients):
                self._attempt(client, client.pump)

    def stop(self) -> None:
        """Make `run` return; may be called from another thread or a signal handler."""
        self._stopping = True
        with suppress(OSError):
            self._waker.send(b"\0")

    def __enter__(self) -> Server:
        return self

    def __exit__(self, *_: object) -> None:
        for client in tuple(self._clients):
            self._drop(client)
        self._selector.close()
        for closing in (*self._listeners, self._waker, self._woken):
            closing.close()

    def _add(self, channel: Channel, wire: Wire) -> _Client:
        client = _Client(channel, wire)
        self._clients.append(client)
        self._selector.register(channel, _READ, lambda: self._attempt(client, client.receive))
        return client

    def _attempt(self, client: _Client, action: Callable[[], None]) -> None:
        """Do something with a client, and let go of one that is gone."""
        try:
            action()
        except BlockingIOError:
            return
        except OSError:
            self._drop(client)
            return
        key = self._selector.get_key(client.channel)
        wanted = _READ | _WRITE if client.unsent else _READ
        if key.events != wanted:
            self._selector.modify(client.channel, wanted, key.data)

    def _drop(self, client: _Client) -> None:
        self._clients.remove(client)
        self._selector.unregister(client.channel)
        client.channel.close()
