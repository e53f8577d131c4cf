"""What a question and a block cost, counted in calls and turns of a loop: seconds belong to a machine."""

from __future__ import annotations

import socket
import sys
import threading
from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest

from belahil.generators import MODELS, GeneratorSetting
from sim.devices.generator import GeneratorDevice
from sim.devices.scpi import ScpiDevice
from sim.transports.channels import ScpiWire, SocketChannel
from sim.transports.server_loop import Server

BLOCK_BYTES = 32_768
HEADER = b":SOUR1:DATA:VOL:CLE;:SOUR1:DATA:ARB:DAC w,#532768"


class Port:
    """Where the generator plays into."""

    def play(self, setting: GeneratorSetting) -> None:
        pass

    def trigger(self) -> bool:
        return True


def calls(task: Callable[[], object]) -> int:
    """Count the calls of functions, Python's and C's, that a task makes."""
    count = 0

    def note(frame: object, event: str, argument: object) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    task()  # what the first one loads does not count
    sys.setprofile(note)
    try:
        task()
    finally:
        sys.setprofile(None)
    return count


@pytest.mark.parametrize("portion_bytes", [1 << 20, 1 << 16, 1460])
def test_a_block_of_line_feeds_is_no_more_work_than_a_random_one(portion_bytes: int) -> None:
    wire = ScpiWire(GeneratorDevice(MODELS["33522B"], Port()))
    noise = np.random.default_rng(1).integers(1, 10, BLOCK_BYTES, dtype=np.uint8).tobytes()

    def upload(block: bytes) -> None:
        message = HEADER + block + b"\n"
        for start in range(0, len(message), portion_bytes):
            wire.feed(message[start : start + portion_bytes])
        assert wire.take() == b""

    work = [calls(lambda block=block: upload(block)) for block in (noise, b"\n" * BLOCK_BYTES)]
    assert work[1] == work[0]
    assert work[0] < 400 + 40 * BLOCK_BYTES / portion_bytes


def test_a_question_is_a_few_dozen_calls() -> None:
    device = GeneratorDevice(MODELS["33522B"], Port())

    def ask() -> None:
        device.write(b"*IDN?\n")
        assert device.read() is not None

    # 35 at the time of writing; framing it byte by byte, or searching the tree again, would be far more.
    assert calls(ask) < 50


def test_a_question_over_tcp_is_one_turn_of_the_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    # given a served device whose loop is counted
    counts: Counter[str] = Counter()
    for name in ("receive", "send"):
        whole = getattr(SocketChannel, name)

        def counted(
            self: SocketChannel, *about: bytes, name: str = name, whole: Callable[..., object] = whole
        ):  # type: ignore[no-untyped-def]
            counts[name] += 1
            return whole(self, *about)

        monkeypatch.setattr(SocketChannel, name, counted)
    with Server() as server:
        select = server._selector.select

        def counted_select(timeout: float | None = None) -> object:
            counts["select"] += 1
            return select(timeout)

        monkeypatch.setattr(server._selector, "select", counted_select)
        port = server.listen(lambda: ScpiWire(ScpiDevice("a,b,c,d")), "127.0.0.1", 0, most_clients=1)
        thread = threading.Thread(target=server.run)
        thread.start()
        try:
            with socket.create_connection(("127.0.0.1", port), timeout=10) as client:
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                client.sendall(b"*IDN?\n")
                assert client.recv(99) == b"a,b,c,d\n"
                before = counts.copy()
                # when a hundred questions are asked one by one
                for _ in range(100):
                    client.sendall(b"*IDN?\n")
                    assert client.recv(99) == b"a,b,c,d\n"
                spent = counts - before
        finally:
            server.stop()
            thread.join(10)
    # then each is received at one go, and answered before the loop turns again
    assert spent["receive"] == spent["send"] == 100
    assert 99 <= spent["select"] <= 102
