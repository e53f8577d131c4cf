"""What emulated instruments cost by themselves: a question, a block, a window; in the process and over TCP.

    python benchmarks/protocol.py
    python benchmarks/protocol.py --rounds 50    # a quick look

In the process each figure stands beside a fixed loop (`reference_loop`) timed in turn with it. Over TCP, a
client with a raw socket asks a served bench and two bare echoes, each in a process of its own, in turn: one
does nothing but receive and send back, the other waits in a selector, as a server of several clients must.
Each is asked a few times in a row, as a client does that works with it; first with client and server on
processors of their own, as on two computers, then on one. Medians; the figures are of this machine, and
nothing asserts them.
"""

from __future__ import annotations

import argparse
import os
import socket
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from belahil._blas import pin_to_one_thread

pin_to_one_thread()

import numpy as np  # noqa: E402
from reference_loop import one_round  # noqa: E402

from belahil.config import parse_bench  # noqa: E402
from belahil.generators import MODELS, GeneratorSetting  # noqa: E402
from belahil.grm_link import (  # noqa: E402
    Framing,
    Telemetry,
    WindowAssembler,
    framed,
    packet_stream,
    read_answer,
    segments,
    telemetry,
)
from belahil.values import RangeWindow, WindowRequest  # noqa: E402
from sim.devices.generator import GeneratorDevice  # noqa: E402
from sim.plant import Plant  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Iterator

BLOCK_BYTES = 32_768
IN_A_ROW = 10
HEADER = b":SOUR1:DATA:VOL:CLE;:SOUR1:DATA:ARB:DAC w,#532768"
ECHO = """
import socket
listener = socket.create_server(("127.0.0.1", 0))
print(listener.getsockname()[1], flush=True)
client = listener.accept()[0]
client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
while data := client.recv(65536):
    client.sendall(data)
"""
SELECTING = """
import selectors, socket
listener = socket.create_server(("127.0.0.1", 0))
print(listener.getsockname()[1], flush=True)
client = listener.accept()[0]
client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
client.setblocking(False)
selector = selectors.DefaultSelector()
selector.register(client, selectors.EVENT_READ)
while selector.select():
    data = client.recv(65536)
    if not data:
        break
    client.sendall(data)
"""
SERVE = """
from belahil.config import parse_bench
from sim.transports.server import serve
serve(parse_bench(""), lambda served: print(served.address.split("::")[2], flush=True))
"""


class Silent:
    """Where the generator plays into."""

    def play(self, setting: GeneratorSetting) -> None:
        pass

    def trigger(self) -> bool:
        return True


def in_turn(tasks: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Time tasks in turn, each by its median, s."""
    times: dict[str, list[float]] = {name: [] for name in tasks}
    for number in range(rounds + 3):
        for name, task in tasks.items():
            begin = time.perf_counter()
            for _ in range(IN_A_ROW):
                task()
            if number >= 3:  # what the first ones load and fill does not count
                times[name].append((time.perf_counter() - begin) / IN_A_ROW)
    return {name: statistics.median(row) for name, row in times.items()}


def window() -> RangeWindow:
    plant = Plant(parse_bench(""))
    plant.arm(WindowRequest(1, 4))
    taken = plant.collect()
    assert taken is not None
    return taken


def through_the_link(taken: RangeWindow, framing: Framing) -> RangeWindow:
    """Cut a window into packets, frame them, and put it together again."""
    line = b"".join(
        framed(telemetry(part, number, checked=True).pack(), framing)
        for number, part in enumerate(segments(taken, 7))
    )
    assembler, whole = WindowAssembler(7, taken.shot), None
    for packet in packet_stream(Telemetry, framing).feed(line):
        whole = assembler.add(read_answer(packet))  # type: ignore[arg-type]
    assert whole is not None
    return whole


def in_process(rounds: int) -> None:
    device, taken = GeneratorDevice(MODELS["33522B"], Silent()), window()
    angles = np.linspace(0.0, 1000.0, 16064)
    # Both have the mean size that 0x0A0A has, so that the arithmetic on the points is alike too.
    noise = np.random.default_rng(1).integers(2000, 3000, BLOCK_BYTES // 2).astype(">i2").tobytes()

    def ask(line: bytes) -> bytes | None:
        device.write(line)
        return device.read()

    tasks: dict[str, Callable[[], object]] = {
        "reference loop": lambda: one_round(angles),
        "*IDN?": lambda: ask(b"*IDN?\n"),
        "FREQ 1E6;FREQ?": lambda: ask(b"FREQ 1E6;FREQ?\n"),
        "32 kB block, random": lambda: device.write(HEADER + noise + b"\n"),
        "32 kB block of 0x0A": lambda: device.write(HEADER + b"\n" * BLOCK_BYTES + b"\n"),
        "32 kB window, serial": lambda: through_the_link(taken, "cobs"),
        "32 kB window, USB": lambda: through_the_link(taken, "raw"),
    }
    found = in_turn(tasks, rounds)
    for name, seconds in found.items():
        print(f"{name:22s} {1e6 * seconds:9.1f} us   x {seconds / found['reference loop']:7.4f} of the loop")
    print(f"0x0A / random: {found['32 kB block of 0x0A'] / found['32 kB block, random']:.2f}")


@contextmanager
def served(program: str, cores: set[int]) -> Iterator[socket.socket]:
    process = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parent.parent
    )
    with process:
        try:
            assert process.stdout is not None
            port = int(process.stdout.readline())
            if cores:
                os.sched_setaffinity(process.pid, cores)
            with socket.create_connection(("127.0.0.1", port)) as client:
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                yield client
        finally:
            process.kill()


def asked(client: socket.socket, line: bytes) -> bytes:
    client.sendall(line)
    heard = b""
    while not heard.endswith(b"\n"):
        heard += client.recv(65536)
    return heard


def over_tcp(rounds: int, places: str, client: set[int], servers: set[int]) -> None:
    if client:
        os.sched_setaffinity(0, client)
    with (
        served(SERVE, servers) as bench,
        served(ECHO, servers) as echo,
        served(SELECTING, servers) as selecting,
    ):
        answer = asked(bench, b"*IDN?\n")
        block = HEADER + b"\x01\x02" * (BLOCK_BYTES // 2) + b";*ESE?\n"
        found = in_turn(
            {
                # As many bytes as the answer has: the echo is not to win by a shorter line.
                "echo": lambda: asked(echo, answer),
                "selecting echo": lambda: asked(selecting, answer),
                "*IDN?": lambda: asked(bench, b"*IDN?\n"),
                "echo of 32 kB": lambda: asked(echo, block),
                "32 kB block": lambda: asked(bench, block),
            },
            rounds,
        )
    print(f"over TCP, client and server {places}:")
    for name, seconds in found.items():
        print(f"{name:22s} {1e6 * seconds:9.1f} us")
    print(f"*IDN? / echo: {found['*IDN?'] / found['echo']:.2f}")
    print(f"*IDN? / selecting echo: {found['*IDN?'] / found['selecting echo']:.2f}")
    print(f"block / echo: {found['32 kB block'] / found['echo of 32 kB']:.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=300)
    rounds = parser.parse_args().rounds
    in_process(rounds)
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    if len(cores) < 2:
        over_tcp(rounds, "wherever the system puts them", set(), set())
        return
    # Where the system puts them it may be one processor for the one and two for the other, ten times as far.
    over_tcp(rounds, "on processors of their own", {cores[0]}, {cores[1]})
    over_tcp(rounds, "on one processor", {cores[0]}, {cores[0]})


if __name__ == "__main__":
    main()
