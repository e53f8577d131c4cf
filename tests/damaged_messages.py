"""Damaged SCPI messages, and the grammar of the answers that are due all the same."""

from __future__ import annotations

import random
import re

from sim.devices.scpi import ScpiDevice
from sim.devices.scpi.tree import patterns_of

PIECES = [
    b";", b":", b",", b" ", b"?", b"*", b"#", b"#0", b"#3", b"#9999999999", b"'", b'"', b"\n", b"\r",
    b"\0", b"\xff", b"\t", b"1e400", b"-1E-400", b"9.9E37", b"#HFFFFFFFFFFFFFFFF", b"1" * 50, b"A" * 20,
    b"MIN", b"MAX", b"INF", b"NAN", b"DEF", b" MHZ", b"e", b"-", b".", b"SOUR2:", b"SOUR9:", b";:", b"(1)",
]  # fmt: skip


ITEM = rb'(?:[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:E[+-]?\d+)?|[A-Z][A-Z0-9_]*|"(?:[^"\n]|"")*"|\(@?[\d,:]*\))'
# Of a Tektronix oscilloscope, until it is told otherwise.
HEADER = rb"(?:(?::[A-Z0-9_]+)+ )?"
# Siglent's own words come back behind their header, with units, and hold no quotes.
ECHO = rb'(?:[A-Z][A-Z0-9:_]* [^;\n"]*)'
WORDS = [
    b"1", b"0", b"50", b"1E6", b"-3.5", b"0.1", b"1E400", b"INF", b"MIN", b"MAX", b"DEF", b"ON", b"OFF",
    b"ARB", b"BUS", b"EXT", b"A1", b'"A1"', b"1 MHZ", b"50MVPP", b"2 S", b"10 OHM", b"#14abcd", b"VPP",
    b"SIN", b"'x'",
]  # fmt: skip


def mutated(line: bytes, others: list[bytes], draw: random.Random) -> bytes:
    """Damage a line in one to three places, also with parts of others."""
    data = bytearray(line)
    for _ in range(draw.randint(1, 3)):
        place = draw.randint(0, len(data))
        kind = draw.randrange(6)
        if kind == 0:
            del data[place : place + draw.randint(1, 4)]
        elif kind == 1:
            data[place:place] = draw.choice(PIECES)
        elif kind == 2 and place < len(data):
            data[place] = draw.randrange(256)
        elif kind == 3:
            other = draw.choice(others)
            data[place:] = other[draw.randint(0, len(other)) :]
        elif kind == 4:
            data[place:place] = data[draw.randint(0, len(data)) :]
        else:
            data += b";" + draw.choice(others)
    return bytes(data[:2000])


def without_blocks(answer: bytes) -> bytes:
    """Return an answer with a 0 for each block that is as long as it says."""
    begins = re.compile(rb"(?:(?<=[,;])|(?<=:CURVE )|(?<=:CURV )|^)#([1-9])")
    place = 0
    while found := begins.search(answer, place):
        place = found.start()
        digits = answer[found.end() : found.end() + int(found[1])]
        stop = found.end() + len(digits) + int(digits)
        assert stop < len(answer)
        answer = answer[:place] + b"0" + answer[stop:]
    return answer


def is_legal(answer: bytes, identity: bytes, item: bytes = ITEM) -> bool:
    """Whether an answer follows the grammar of response messages (IEEE 488.2, 8.3).

    Units between semicolons, items between commas; the last unit may be the identity, or a learned message.
    Siglent's waveforms come as bare points, to the end.
    """
    answer = without_blocks(re.sub(rb"WAVEDATA,.*", b"WAVEDATA,\n", answer, flags=re.DOTALL))
    unit = rb"(?:%b(?:,%b)*|%b)" % (item, item, ECHO)
    last = rb"(?:%b|\*RST(?:;:[^\n]*)?)" % re.escape(identity)
    return bool(re.fullmatch(rb"(?:%b;)*(?:%b|%b)\n" % (unit, unit, last), answer))


def check_answers_on(device: ScpiDevice, identity: bytes, data: bytes) -> None:
    """Assert that a device still says who it is, and has a lawful error, after it was sent some data."""
    device.write(b"*IDN?\n")
    assert device.read() == identity + b"\n", data
    device.write(b"SYST:ERR?\n")
    error = device.read()
    assert error is not None
    assert re.fullmatch(rb'[+-]?\d+,"[ !#-~]*"\n', error)


def lines_of(device: ScpiDevice, draw: random.Random) -> list[bytes]:
    """Return a command and a question for each header that a device has, with parameters of all kinds."""
    lines = []
    for pattern in device.tree.actions:
        header, _ = draw.choice(
            [(pattern, ())] if pattern[0] == "*" else patterns_of(pattern, device.tree.largest_suffix)
        )
        lines.append(header.encode() + b"?")
        lines.append(header.encode() + b" " + b",".join(draw.choices(WORDS, k=draw.choice([1, 1, 1, 2, 3]))))
    return lines


def some_bytes(draw: random.Random) -> bytes:
    """Return bytes that mean nothing."""
    return bytes(draw.choices(b"ABFREQ:;?*#,. 0123456789\"'\n\r\0\xff", k=draw.randint(0, 40)))
