"""Program messages to program message units: a header and its parameters."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import Literal, NamedTuple

from sim.devices.scpi.framing import BLOCK_MARK, Message
from sim.devices.scpi.status import ScpiError

Kind = Literal["number", "character", "string", "block"]
Blocks = Mapping[int, bytes | ScpiError]

# IEEE 488.2 counts all control codes but the line feed as white space; the framer has replaced code 0.
_SPACE = "".join(map(chr, (*range(1, 10), *range(11, 33))))
_UNIT = re.compile(r"""(?>[^;"']+|"[^"]*"|'[^']*')*""")
_PARAMETER = re.compile(r"""(?>[^,"']+|"[^"]*"|'[^']*')*""")
_HEADER = re.compile(rf"[^{re.escape(_SPACE)}]+")
_CHARACTER = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_STRING = re.compile(r""""(?>[^"]|"")*"|'(?>[^']|'')*'""")
_RADIX = re.compile(r"#(?:H([0-9A-F]{1,13})|Q([0-7]{1,17})|B([01]{1,52}))", re.IGNORECASE)
_CACHED_LENGTH = 200


class Token(NamedTuple):
    """One parameter; `text` of a string is without quotes, `block` is empty for all but a block."""

    kind: Kind
    text: str
    block: bytes = b""


class Unit(NamedTuple):
    """A header as it was sent, and its parameters."""

    header: str
    parameters: tuple[Token, ...]


def parse(message: Message) -> tuple[Unit | ScpiError, ...]:
    """Split a message into units; an error is the last entry, since what follows it has no meaning."""
    if message.blocks or len(message.text) > _CACHED_LENGTH:
        return _parse(message.text, message.blocks)
    return _parse_short(message.text)


@lru_cache(maxsize=1024)
def _parse_short(text: str) -> tuple[Unit | ScpiError, ...]:
    return _parse(text, {})


def _parse(text: str, blocks: Blocks) -> tuple[Unit | ScpiError, ...]:
    units: list[Unit | ScpiError] = []
    try:
        for start, piece in _pieces(text, _UNIT, ";"):
            body = piece.lstrip(_SPACE)
            if body:
                units.append(_unit(body.rstrip(_SPACE), start + len(piece) - len(body), blocks))
    except ScpiError as error:
        units.append(error)
    return tuple(units)


def _pieces(text: str, pattern: re.Pattern[str], separator: str) -> Iterator[tuple[int, str]]:
    """Yield the parts between separators that stand outside of quotes, each with its place."""
    start = 0
    while True:
        found = pattern.match(text, start)
        stop = found.end() if found else start
        if text[stop : stop + 1] not in ("", separator):
            raise ScpiError(-151, "a quote is not closed")
        yield start, text[start:stop]
        if stop == len(text):
            return
        start = stop + 1


def _unit(body: str, start: int, blocks: Blocks) -> Unit:
    whole = blocks.get(start)
    if isinstance(whole, ScpiError):
        raise whole
    found = _HEADER.match(body)
    header = found.group() if found else body
    tail = body[len(header) :]
    if not tail:
        return Unit(header, ())
    start += len(header)
    tokens = []
    for offset, piece in _pieces(tail, _PARAMETER, ","):
        bare = piece.lstrip(_SPACE)
        tokens.append(_token(bare.rstrip(_SPACE), start + offset + len(piece) - len(bare), blocks))
    return Unit(header, tuple(tokens))


def _token(text: str, place: int, blocks: Blocks) -> Token:
    first = text[:1]
    if first in "+-.0123456789" and text:
        return Token("number", text)
    if _CHARACTER.fullmatch(text):
        return Token("character", text)
    if first in ('"', "'"):
        if not _STRING.fullmatch(text):
            raise ScpiError(-103)
        return Token("string", text[1:-1].replace(first * 2, first))
    if first == BLOCK_MARK:
        return _block_token(text, blocks[place])
    radix = _RADIX.fullmatch(text)
    if radix:
        base = (16, 8, 2)[(radix.lastindex or 1) - 1]
        return Token("number", str(int(radix[radix.lastindex or 1], base)))
    raise _complaint(text)


def _block_token(text: str, content: bytes | ScpiError) -> Token:
    if isinstance(content, ScpiError):
        raise content
    if text != BLOCK_MARK:
        raise ScpiError(-103)
    return Token("block", "", content)


def _complaint(text: str) -> ScpiError:
    if not text:
        return ScpiError(-102, "an empty parameter")
    if text.startswith("("):
        return ScpiError(-178)
    if not (text.isascii() and text.isprintable()):
        return ScpiError(-101)
    if _CHARACTER.match(text):
        return ScpiError(-103) if " " in text else ScpiError(-141)
    return ScpiError(-101)
