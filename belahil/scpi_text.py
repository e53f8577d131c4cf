"""What crosses the link of a SCPI instrument, cut into commands and answers, whoever wrote it."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal

TextDifference = Literal["text", "number", "format"]

_MARK = re.compile(rb"\"[^\"]*\"|'[^']*'|#[1-9]|WAVEDATA,|[;\n]", re.IGNORECASE)
_BLOCK = re.compile(rb"([\x20\x21\x24-\x7e]*)(#([1-9]))")
_BARE = re.compile(rb"[\x20-\x7e]*?(WAVEDATA,)", re.IGNORECASE)
_FIELD = re.compile(rb'(?:[^;"]|"[^"]*")+')
_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)")
_ERROR = re.compile(r'\s*([+-]?\d+)\s*,\s*"(.*)"\s*', re.DOTALL)
_SAME_NUMBER = 1e-12


@dataclass(frozen=True, slots=True)
class Block:
    """An answer with bytes in it.

    Parameters
    ----------
    before : str
        Text in front of the block.
    head : str
        ``#`` with its digits, for example ``#41200``; empty where bytes come without a length of their own.
    data : bytes
        What is in the block, fewer bytes than its head tells where it was cut short.
    """

    before: str
    head: str
    data: bytes

    def __str__(self) -> str:
        """Tell all but the bytes."""
        return f"{self.before}{self.head}<{len(self.data)} bytes>"


def units(message: bytes) -> list[str]:
    r"""Cut a program message into commands and questions; of binary data only the length is told.

    >>> units(b'*ESE 3;:SOUR1:FUNC:ARB "A;B";:DATA X,#15\x00;\n;A;*ESE?\n')
    ['*ESE 3', ':SOUR1:FUNC:ARB "A;B"', ':DATA X,#15<5 bytes>', '*ESE?']
    """
    found, text, place = [], "", 0
    while mark := _MARK.search(message, place):
        text += message[place : mark.start()].decode("latin-1")
        word, place = mark[0], mark.end()
        if word in (b";", b"\n"):
            found.append(text)
            text = ""
            continue
        text += word.decode("latin-1")
        if word[:1] == b"#" and (size := _size(message, place - 1)) is not None:
            begin = place + int(word[1:])
            text += f"{message[place:begin].decode()}<{len(message[begin : begin + size])} bytes>"
            place = begin + size
        elif word[-1:] == b",":
            bare = message[place:].removesuffix(b"\n")
            text, place = f"{text}<{len(bare)} bytes>", len(message)
    found.append(text + message[place:].decode("latin-1"))
    return [unit.strip() for unit in found if unit.strip()]


def header_of(unit: str) -> str:
    """Return the header of a command or a question, in capitals and without the colon of the root.

    >>> header_of(':sour1:func:arb? "A"')
    'SOUR1:FUNC:ARB?'
    """
    return unit.split(None, 1)[0].removeprefix(":").upper()


def fields(message: bytes, count: int) -> list[bytes] | None:
    r"""Cut a response message into the answers of `count` questions; None when there is another number.

    >>> fields(b'1;+0,"No; error";+5\n', 3)
    [b'1', b'+0,"No; error"', b'+5']
    """
    message = message.removesuffix(b"\n").removesuffix(b"\r")
    if count == 1:
        return [message]
    found = _FIELD.findall(message)
    return found if len(found) == count else None


def read_field(field: bytes) -> str | Block:
    r"""Return one answer as text, or with its bytes apart.

    >>> read_field(b"DAT2,#15\x00\x01\x02\x03\x04")
    Block(before='DAT2,', head='#15', data=b'\x00\x01\x02\x03\x04')
    >>> read_field(b"#1 is a name")
    '#1 is a name'
    """
    found, bare = _BLOCK.match(field), _BARE.match(field)
    if bare and not (found and found.start(2) < bare.start(1)):
        return Block(bare[0].decode(), "", field[bare.end() :])
    size = _size(field, found.start(3)) if found else None
    if found is None or size is None:
        return field.decode("latin-1").strip()
    begin = found.end() + int(found[3])
    return Block(
        found[1].decode(), field[found.start(2) : begin].decode("latin-1"), field[begin : begin + size]
    )


def _size(message: bytes, place: int) -> int | None:
    """Return how many bytes a block tells whose digit of digits is at `place`; None when it tells none."""
    digits = message[place + 1 : place + 1 + int(message[place : place + 1])]
    whole = len(digits) == int(message[place : place + 1])
    return int(digits) if whole and digits.isdigit() else None


def text_difference(recorded: str, emulated: str) -> TextDifference | None:
    """Tell how two answers differ: in a number, in how the same numbers are written, or in words.

    >>> text_difference("+1.0E+01,SIN", "10,SIN"), text_difference("10V", "11V"), text_difference("A", "B")
    ('format', 'number', 'text')
    """
    if recorded == emulated:
        return None
    ours, theirs = _NUMBER.split(recorded), _NUMBER.split(emulated)
    if len(ours) == 1 or [one.strip() for one in ours[::2]] != [one.strip() for one in theirs[::2]]:
        return "text"
    pairs = zip(ours[1::2], theirs[1::2], strict=True)
    same = all(math.isclose(float(a), float(b), rel_tol=_SAME_NUMBER) for a, b in pairs)
    return "format" if same else "number"


def error_entry(answer: str) -> tuple[int, str] | None:
    """Read number and text of an entry of an error queue; None when it is none.

    >>> error_entry('-222,"Data out of range"'), error_entry("0")
    ((-222, 'Data out of range'), None)
    """
    found = _ERROR.fullmatch(answer)
    return (int(found[1]), found[2]) if found else None
