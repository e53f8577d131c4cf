"""A client that asks for more than it reads, beside others that are to be served meanwhile."""

from __future__ import annotations

import itertools
import math
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from belahil.generators import MODELS, GeneratorSetting
from sim.devices.generator import GeneratorDevice
from sim.devices.scpi import ScpiDevice
from sim.devices.scpi.device import MOST_ANSWER_BYTES
from sim.devices.scpi.tree import Action
from sim.transports.channels import MOST_UNSENT_BYTES, LineWire, ScpiWire, Wire
from sim.transports.hislip import HislipPort
from sim.transports.hislip_messages import Kind, Message
from sim.transports.server_loop import Server
from tests.served import RawClient

PORTION = 60_000
LATE_S = 1.0  # A portion of these questions takes several seconds when it is carried out at one go.
UNIT_S = 1e-3


class Port:
    def play(self, setting: GeneratorSetting) -> None:
        pass

    def trigger(self) -> bool:
        return True


class SlowLine:
    """A device on a line to which each command, of 16 bytes, is some work."""

    def __init__(self) -> None:
        self.said = bytearray()

    @property
    def waiting(self) -> int:
        return len(self.said)

    def write(self, data: bytes) -> None:
        time.sleep(UNIT_S * len(data) / 16)
        self.said += data * 100

    def read(self, max_bytes: int) -> bytes:
        taken = bytes(self.said[:max_bytes])
        del self.said[:max_bytes]
        return taken

    def clear(self) -> None:
        self.said.clear()


def slow_device() -> ScpiDevice:
    """A device whose ``SLOW?`` takes a millisecond and says 10 kB."""

    def slow(_: object) -> str:
        time.sleep(UNIT_S)
        return "x" * 10_000

    device = ScpiDevice("a,b,c,d")
    device.tree.add("SLOW", query=Action(slow))
    return device


@contextmanager
def running(server: Server) -> Iterator[None]:
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        yield
    finally:
        server.stop()
        thread.join(10)
        assert not thread.is_alive()


def data(text: bytes) -> bytes:
    """Many messages, each with its end, as a HiSLIP client may send them behind each other."""
    ids = itertools.count(0xFFFFFF00, 2)
    return b"".join(
        Message(Kind.DATA_END, 0, next(ids) & 0xFFFFFFFF, part).packed() for part in text.split(b"\n") if part
    )


@pytest.mark.parametrize(
    ("flood", "by_hislip"),
    [
        (b"SLOW?\n" * (PORTION // 6), False),
        (b"SLOW?;" * (PORTION // 6) + b"\n", False),
        (b"SLOW?\n" * (PORTION // 6), True),
        (b"SLOW?;" * (PORTION // 6) + b"\n", True),
    ],
    ids=["messages", "one message", "hislip messages", "one hislip message"],
)
def test_others_are_answered_beside_a_client_that_asks_and_does_not_read(
    flood: bytes, by_hislip: bool
) -> None:
    device = slow_device()
    with Server() as server:
        port = server.listen(lambda: ScpiWire(device), "127.0.0.1", 0, most_clients=2)
        devices = HislipPort([device], most_clients=2)
        hislip = server.listen(devices.wire, "127.0.0.1", 0, most_clients=4)
        with running(server), RawClient(port) as other, socket.create_connection(("127.0.0.1", port)) as deaf:
            # given a client that has sent a portion of questions, by either protocol
            if by_hislip:
                deaf.close()
                deaf, aside = (socket.create_connection(("127.0.0.1", hislip)) for _ in range(2))
                deaf.sendall(Message(Kind.INITIALIZE, 0, 0x01000000, b"hislip0").packed())
                deaf.recv(16)
                aside.sendall(Message(Kind.ASYNC_INITIALIZE, 0, 1).packed())
                aside.recv(16)
            deaf.sendall(data(flood) if by_hislip else flood)
            # when another asks, again and again
            for _ in range(5):
                begun_s = time.monotonic()
                assert other.ask(b"*OPC?\n") == b"1\n"
                # then it does not wait for that portion
                assert time.monotonic() - begun_s < LATE_S
            if by_hislip:
                deaf.close()
                aside.close()


def test_others_are_answered_beside_a_client_that_keeps_a_line_busy() -> None:
    device = slow_device()
    with Server() as server:
        port = server.listen(lambda: ScpiWire(device), "127.0.0.1", 0, most_clients=1)
        line = server.listen(lambda: LineWire(SlowLine()), "127.0.0.1", 0, most_clients=1)
        with running(server), RawClient(port) as other, RawClient(line) as deaf:
            deaf.line.sendall(b"0123456789abcdef" * (PORTION // 16))
            for _ in range(5):
                begun_s = time.monotonic()
                assert other.ask(b"*OPC?\n") == b"1\n"
                assert time.monotonic() - begun_s < LATE_S


_GENERATOR = GeneratorDevice(MODELS["33522B"], Port())


@pytest.mark.parametrize(
    ("wire", "question", "longest"),
    [
        (lambda: ScpiWire(_GENERATOR), b"*LRN?\n", len(_GENERATOR.learn()) + 1),
        (lambda: LineWire(SlowLine()), b"0123456789abcdef", 3200),
    ],
    ids=["scpi", "line"],
)
def test_what_is_held_for_a_client_that_does_not_read_is_bounded(
    wire: Callable[[], Wire], question: bytes, longest: int
) -> None:
    # given many questions, of which each turn carries out one
    client = wire()
    client.feed(question * 200, -math.inf)
    parts = [client.take(-math.inf)]
    while client.is_busy:
        assert client.is_full
        parts.append(client.take(-math.inf))
    # then an answer or two at a time is held, none is lost, and there is room for more
    assert max(map(len, parts)) <= 2 * longest
    assert len(b"".join(parts)) % 200 == 0
    assert sum(map(len, parts)) > 200 * longest / 4
    assert not client.is_full


def test_a_wire_carries_out_no_more_than_may_wait_to_be_sent() -> None:
    wire = ScpiWire(slow_device())
    # when far more is asked for than a megabyte of answers, without a limit of time
    wire.feed(b"SLOW?\n" * 1000)
    # then the rest waits until that has been taken
    parts = [wire.take()]
    while wire.is_busy or parts[-1]:
        parts.append(wire.take())
    assert max(map(len, parts)) <= MOST_UNSENT_BYTES + 10_001
    assert b"".join(parts) == (b"x" * 10_000 + b"\n") * 1000


def test_answers_of_one_message_that_are_too_long_are_dropped_with_an_error() -> None:
    device = ScpiDevice("a,b,c,d")
    long = "x" * (MOST_ANSWER_BYTES // 8)
    device.tree.add("LONG", query=Action(lambda _: long))
    # what is allowed comes whole
    device.write(b"LONG?" + b";LONG?" * 8 + b"\n")
    assert device.read() == ";".join([long] * 9).encode() + b"\n"
    # what is not gives no answer, and the next question does
    device.write(b"LONG?" + b";LONG?" * 20 + b";*ESE 3\n*ESE?\nSYST:ERR?\n")
    assert device.read() == b"+3\n"
    error = device.read()
    assert error is not None
    assert error.startswith(b"-430,")


def test_messages_of_others_come_between_two_units_and_change_no_answer() -> None:
    device = ScpiDevice("a,b,c,d")
    first, second = device.connect("stream"), device.connect("stream")
    # given a message that has to wait after each of its units
    first.push(b"*ESE 1;*ESE?;*OPC?;*ESE?\n")
    while not first.go_on(lambda: False):
        second.write(b"*IDN?\n")
        assert second.read() == b"a,b,c,d\n"
    assert first.read() == b"+1;1;+1\n"
    # and one that is dropped half-way leaves nothing behind
    first.push(b"*ESE 5;*ESE?;*ESE 6\n")
    assert not first.go_on(lambda: False)
    first.clear()
    first.write(b"*ESE?\n")
    assert first.read() == b"+5\n"
    assert first.read() is None
