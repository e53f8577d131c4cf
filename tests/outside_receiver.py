"""A receiver and a signal generator that somebody wrote from ``docs/grm-link.md`` alone, without the source.

It imports nothing of the project. The receiver speaks the GRM link on one TCP port. What it digitizes comes
from a small SCPI generator on a second TCP port, since no analog signal can reach it: the two share one
`Generator` object in place of the cable.

    python outside_receiver.py --link-port 15026 --scpi-port 15025 --seconds 600 --log
"""

from __future__ import annotations

import argparse
import contextlib
import math
import re
import socketserver
import struct
import threading
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

# The truth, which a client is to find.
_GAINS = "1.37 2.03 2.71 3.49 4.57 5.83 7.19 8.41 9.67 11.3 13.9 16.7 19.1 23.3 27.7 33.1"
GAIN_BY_CODE = tuple(map(float, _GAINS.split()))
CUTOFF_HZ = 16.2e6
ORDER = 2
NOISE_RMS_V = 1.1e-3

SAMPLE_RATE_HZ = 80e6
MOST_SAMPLES = 16_064
BITS = 12
LOWEST, HIGHEST = -(2 ** (BITS - 1)), 2 ** (BITS - 1) - 1
VOLTS_PER_COUNT = 2.0 / 2**BITS  # full scale 2.0 V
ZERO_COUNT = 3.25
LONGEST_DELAY_S = 0.1
LONGEST_PART = 16_346
IDENTITY = "Outside, receiver of grm-link.md, serial 1, software 1.0"
GENERATOR_IDENTITY = "Agilent Technologies,33522B,OUTSIDE,1.0"
HOUSEKEEPING = b"\x01\x0dtemperature_k" + struct.pack(">d", 295.0)  # a table of section 7.3
SOURCE_OHM = INPUT_OHM = 50.0
IDLE_S = 600.0


def short_form(header: str) -> str:
    """`:SOURce1:FREQuency` as `FREQ`: nodes of at most four letters, or three when the fourth is a vowel."""
    nodes = [re.sub(r"\d+\Z", "", node.upper()) for node in header.removeprefix(":").split(":")]
    nodes = [node if len(node) <= 4 else node[: 3 if node[3] in "AEIOU" else 4] for node in nodes]
    return ":".join(nodes).removeprefix("SOUR:")


AFTER_RESET = {
    "*ESE": "0",
    "OUTP": "0",
    "OUTP:LOAD": "50",
    "FUNC": "SIN",
    "FREQ": "1000",
    "VOLT": "0.1",
    "VOLT:OFFS": "0",
    "VOLT:UNIT": "VPP",
    "VOLT:LIM:HIGH": "5",
    "VOLT:LIM:LOW": "-5",
    "VOLT:LIM:STAT": "0",
    "BURS:STAT": "0",
}
SAME_AS = {"ON": "1", "OFF": "0", "SINUSOID": "SIN", "INFINITY": "INF", "MIN": "0.001"}


@dataclass
class Generator:
    """State and SCPI of one channel; what is no part of a steady sine is kept and read back, to no effect."""

    log: Callable[[str], None] = lambda line: None
    lock: threading.Lock = field(default_factory=threading.Lock)
    errors: list[str] = field(default_factory=list)
    state: dict[str, str] = field(default_factory=lambda: dict(AFTER_RESET))

    def answer(self, line: str) -> str | None:
        """Carry out one line of commands and queries; semicolons join the answers of a compound query."""
        with self.lock:
            self.log(f"scpi {line}")
            answers = [self._one(unit.strip()) for unit in line.split(";") if unit.strip()]
        return ";".join(answer for answer in answers if answer is not None) or None

    def _one(self, unit: str) -> str | None:
        """One command or query, each with its whole path from the root."""
        header, _, argument = unit.partition(" ")
        name = short_form(header.removesuffix("?"))
        if header.endswith("?"):
            if name == "SYST:ERR":
                return self.errors.pop(0) if self.errors else '+0,"No error"'
            if name in self.state:
                return self._shown(self.state[name])
            if name in ("*IDN", "*OPC"):
                return GENERATOR_IDENTITY if name == "*IDN" else "1"
        elif name in ("*RST", "*CLS"):
            self.errors.clear()
            if name == "*RST":
                self.state = dict(AFTER_RESET)
            return None
        elif name in self.state:
            value = argument.strip().upper()
            self.state[name] = SAME_AS.get(value, value)
            return None
        self.errors.append(f'-113,"Undefined header; {header}"')
        return None

    @staticmethod
    def _shown(value: str) -> str:
        if value == "INF":
            return "9.9E+37"
        return value if re.fullmatch(r"\d+|[A-Z]+", value) else f"{float(value):+.15E}"

    def at_input(self) -> tuple[float, float, float]:
        """Frequency, peak amplitude and offset of the voltage at the receiver's input."""
        with self.lock:
            state = dict(self.state)
        if state["OUTP"] == "0":
            return 0.0, 0.0, 0.0
        factor = (1 + SOURCE_OHM / float(state["OUTP:LOAD"])) * INPUT_OHM / (INPUT_OHM + SOURCE_OHM)
        amplitude = float(state["VOLT"]) / 2 * factor if state["FUNC"] == "SIN" else 0.0
        return float(state["FREQ"]), amplitude, float(state["VOLT:OFFS"]) * factor


class ScpiHandler(socketserver.StreamRequestHandler):
    """One client of the generator, lines ended by LF."""

    server: ScpiServer
    timeout = IDLE_S

    def handle(self) -> None:
        """Answer line by line until the client leaves."""
        for line in self.rfile:
            answer = self.server.generator.answer(line.decode("ascii", "replace").strip())
            if answer is not None:
                self.wfile.write(answer.encode() + b"\n")


class ScpiServer(socketserver.ThreadingTCPServer):
    """Several clients at a time."""

    allow_reuse_address = True
    daemon_threads = True

    def __init__(self, port: int, generator: Generator) -> None:
        super().__init__(("127.0.0.1", port), ScpiHandler)
        self.generator = generator


def digitize(
    generator: Generator, code: int, samples: int, rng: np.random.Generator
) -> tuple[np.ndarray, int]:
    """Counts of one window, and how many of them stand at an end of the converter's span."""
    frequency, amplitude, offset = generator.at_input()
    response = 1 / math.sqrt(1 + (frequency / CUTOFF_HZ) ** (2 * ORDER))
    angle = 2 * math.pi * frequency / SAMPLE_RATE_HZ * np.arange(samples) + rng.uniform(0, 2 * math.pi)
    volts = GAIN_BY_CODE[code] * (amplitude * response * np.sin(angle) + offset)
    volts += rng.normal(0, NOISE_RMS_V, samples)
    counts = np.clip(np.rint(volts / VOLTS_PER_COUNT + ZERO_COUNT), LOWEST, HIGHEST)
    return counts, int(np.count_nonzero((counts == LOWEST) | (counts == HIGHEST)))


class Refused(Exception):
    """A telecommand that is answered by a refusal: reason and text."""

    def __init__(self, reason: int, text: str) -> None:
        super().__init__(text)
        self.reason = reason


def crc16(data: bytes) -> int:
    """CRC-16/IBM-3740."""
    crc = 0xFFFF
    for octet in data:
        crc ^= octet << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x1021 if crc & 0x8000 else crc << 1
        crc &= 0xFFFF
    return crc


def cobs_encode(data: bytes) -> bytes:
    """Stuff a packet so that it holds no zero."""
    out = bytearray()
    runs = data.split(b"\0")
    for number, run in enumerate(runs):
        whole = len(run) // 254 * 254
        for at in range(0, whole, 254):
            out += b"\xff" + run[at : at + 254]
        if run[whole:] or not whole or number < len(runs) - 1:
            out += bytes([len(run) - whole + 1]) + run[whole:]
    return bytes(out)


def cobs_decode(stuffed: bytes) -> bytes:
    """Undo `cobs_encode`; ValueError when it is none."""
    out, at = bytearray(), 0
    while at < len(stuffed):
        code = stuffed[at]
        run = stuffed[at + 1 : at + code]
        if code == 0 or len(run) != code - 1:
            raise ValueError("not COBS")
        out += run
        at += code
        if code < 255 and at < len(stuffed):
            out.append(0)
    return bytes(out)


def is_telecommand(packet: bytes) -> bool:
    """Tell whether the packet rules of section 4 accept it."""
    return (
        13 <= len(packet) <= 16_384
        and packet[:2] == b"\x18\x64"
        and packet[2] >> 6 == 3
        and struct.unpack_from(">H", packet, 4)[0] == len(packet) - 7
        and packet[6] >> 4 == 2
        and crc16(packet) == 0
    )


class Receiver:
    """Answers telecommands; each window is captured at once, so that nothing is armed between two."""

    def __init__(self, generator: Generator, seed: int | None = None) -> None:
        self.generator = generator
        self.rng = np.random.default_rng(seed)
        self.sequence = 0
        self.started = time.monotonic()

    def answers(self, packet: bytes) -> Iterator[bytes]:
        """Telemetry packets that answer one intact telecommand."""
        request, service, subtype, data = packet[:4], packet[7], packet[8], packet[11:-2]
        self.generator.log(f"link {service},{subtype} {data.hex()}")
        try:
            if service != 200 or not 1 <= subtype <= 5:
                raise Refused(1, f"service {service}, {subtype}; allowed: service 200, subtypes 1 to 5")
            if len(data) != (20 if subtype == 3 else 0):
                raise Refused(2, f"{len(data)} octets of data; allowed: 20 with ARM, else none")
            if subtype == 1:
                yield self._packet(200, 129, request + IDENTITY.encode())
            elif subtype == 2:
                codes = bytes(range(len(GAIN_BY_CODE)))
                spec = struct.pack(">dI5B", SAMPLE_RATE_HZ, MOST_SAMPLES, BITS, 1, 1, 1, len(codes))
                yield self._packet(200, 130, request + spec + codes)
            elif subtype == 3:
                yield from self._window(request, data)
            elif subtype == 4:
                yield self._packet(200, 132, request + HOUSEKEEPING)
            else:
                yield self._packet(1, 1, request)
        except Refused as refusal:
            yield self._packet(1, 2, request + struct.pack(">H", refusal.reason) + str(refusal).encode())

    def _window(self, request: bytes, data: bytes) -> Iterator[bytes]:
        shot, code, trigger, source, products, samples, delay = struct.unpack(">I4BId", data)
        if code >= len(GAIN_BY_CODE):
            raise Refused(3, f"gain code {code}; allowed: 0 to {len(GAIN_BY_CODE) - 1}")
        if not 1 <= samples <= MOST_SAMPLES:
            raise Refused(4, f"{samples} samples; allowed: 1 to {MOST_SAMPLES}")
        if not 0 <= delay <= LONGEST_DELAY_S:
            raise Refused(5, f"delay {delay} s; allowed: 0 to {LONGEST_DELAY_S} s")
        others = ((6, "trigger", trigger), (7, "source", source), (8, "products", products))
        for reason, name, value in others:
            if value != 0:
                raise Refused(reason, f"{name} {value}; allowed: 0")
        yield self._packet(1, 1, request)
        start = round(delay * SAMPLE_RATE_HZ) / SAMPLE_RATE_HZ
        time.sleep(start)
        counts, saturated = digitize(self.generator, code, samples, self.rng)
        payload = struct.pack(">IBBHII", shot, code, 0, 0, samples, saturated)
        payload += struct.pack(">4d", VOLTS_PER_COUNT, ZERO_COUNT, 1 / SAMPLE_RATE_HZ, start)
        payload += (counts + 32_768).astype(">u2").tobytes() + HOUSEKEEPING
        parts = [payload[at : at + LONGEST_PART] for at in range(0, len(payload), LONGEST_PART)]
        for index, part in enumerate(parts):
            flags = 3 if len(parts) == 1 else 1 if index == 0 else 2 if index == len(parts) - 1 else 0
            head = struct.pack(">IHHI", shot, index, len(parts), zlib.crc32(payload))
            yield self._packet(200, 131, request + head + part, flags)

    def _packet(self, service: int, subtype: int, data: bytes, flags: int = 3) -> bytes:
        fraction = int((time.monotonic() - self.started) * 2**24)
        packet = struct.pack(">HHH", 0x0864, flags << 14 | self.sequence, 14 + len(data) + 2 - 1)
        packet += struct.pack(">3B2H", 0x20, service, subtype, 0, 0) + fraction.to_bytes(7, "big") + data
        self.sequence = (self.sequence + 1) % 2**14
        return packet + struct.pack(">H", crc16(packet))


class LinkHandler(socketserver.BaseRequestHandler):
    """One client of the receiver: pieces between zeros in, stuffed packets between zeros out."""

    server: LinkServer

    def handle(self) -> None:
        """Answer piece by piece until the client leaves."""
        self.request.settimeout(IDLE_S)
        rest = b""
        with contextlib.suppress(OSError):  # the client left
            while data := self.request.recv(65_536):
                *pieces, rest = (rest + data).split(b"\0")
                rest = rest[:16_451]  # a longer one is refused in any case
                for piece in filter(None, pieces):
                    self._piece(piece)

    def _piece(self, piece: bytes) -> None:
        try:
            packet = cobs_decode(piece)
        except ValueError:
            return
        if is_telecommand(packet):
            for answer in self.server.receiver.answers(packet):
                self.request.sendall(b"\0" + cobs_encode(answer) + b"\0")


class LinkServer(socketserver.TCPServer):
    """One client at a time; the next one waits."""

    allow_reuse_address = True

    def __init__(self, port: int, receiver: Receiver) -> None:
        super().__init__(("127.0.0.1", port), LinkHandler)
        self.receiver = receiver


def main() -> None:
    """Serve both ports of a loopback bench for a limited time."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--link-port", type=int, default=0)
    parser.add_argument("--scpi-port", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--seed", type=int)
    parser.add_argument("--log", action="store_true", help="print what the clients ask")
    options = parser.parse_args()
    generator = Generator(log=print if options.log else lambda line: None)
    receiver = Receiver(generator, options.seed)
    with ScpiServer(options.scpi_port, generator) as scpi, LinkServer(options.link_port, receiver) as link:
        for server in (scpi, link):
            threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        print(f"scpi {scpi.server_address[1]} link {link.server_address[1]}", flush=True)
        with contextlib.suppress(KeyboardInterrupt):
            time.sleep(options.seconds)


if __name__ == "__main__":
    main()
