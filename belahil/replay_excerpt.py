"""What was recorded and what comes now, beside each other, in hexadecimal and as text."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from belahil.recording_file import Record

_ROW_BYTES = 16
_ROWS_AFTER = 1
_TEXT_BYTES = 48
_WORDS = {
    "open": "the opening of the {}",
    "write": "a write to the {}",
    "read": "a read from the {}",
    "clear": "a clear of the {}",
    "close": "the closing of the {}",
    "closing": "the closing of the bench",
    "end": "the end of the session",
}


@dataclass(frozen=True, slots=True)
class Exchange:
    """A verb of a link with its bytes.

    Parameters
    ----------
    number : int
        Of the record, from 1 on; 0 for what was not recorded.
    record : Record
        Link and verb.
    data : bytes
        Written or read.
    """

    number: int
    record: Record
    data: bytes

    def agrees(self, now: Exchange) -> bool:
        """Whether `now` asks for what was recorded: for a write that is all its bytes."""
        return (self.record.link, self.record.kind) == (now.record.link, now.record.kind) and (
            now.record.kind != "write" or self.data == now.data
        )


def named(exchange: Exchange) -> str:
    """Say in words what an exchange is."""
    return _WORDS[exchange.record.kind].format(exchange.record.link)


def differing(recorded: bytes, now: bytes) -> int:
    """Return the index of the first byte that differs; the shorter length when one begins with the other."""
    shorter = min(len(recorded), len(now))
    return next((index for index in range(shorter) if recorded[index] != now[index]), shorter)


def excerpt(
    before: Iterable[Exchange], recorded: Exchange | None, now: Exchange, after: Iterable[Exchange] = ()
) -> list[str]:
    """Write the records about a difference, and both sides of it.

    Parameters
    ----------
    before : iterable of Exchange
        The last records that agreed.
    recorded : Exchange or None
        What was recorded next; None at the end of the recording.
    now : Exchange
        What comes in its place.
    after : iterable of Exchange
        What was recorded behind it.
    """
    lines = [_line(f"record {one.number}", one) for one in before]
    if recorded is None:
        return [*lines, "recorded      nothing more", _line("now", now)]
    lines.append(_line(f"record {recorded.number}", recorded))
    lines.append(_line("now", now))
    if recorded.record.kind == now.record.kind == "write" and recorded.record.link == now.record.link:
        lines += _aligned(recorded.data, now.data)
    return [*lines, *(_line(f"record {one.number}", one) for one in after)]


def _line(label: str, exchange: Exchange) -> str:
    record = exchange.record
    told = f"{label:<14}{record.link:<10} {record.kind:<8}"
    if record.error is not None:
        return f"{told}{record.error[0]}: {record.error[1]}"
    if record.kind == "read" and not exchange.number:
        return told.rstrip()
    if record.kind in ("write", "read"):
        more = " ..." if len(exchange.data) > _TEXT_BYTES else ""
        return f"{told}{len(exchange.data):>6} bytes  {_text(exchange.data[:_TEXT_BYTES])}{more}"
    return told.rstrip()


def _aligned(recorded: bytes, now: bytes) -> list[str]:
    at = differing(recorded, now)
    first = max(0, at // _ROW_BYTES - 1)
    longest = max(len(recorded), len(now))
    last = min(at // _ROW_BYTES + _ROWS_AFTER, max(0, longest - 1) // _ROW_BYTES)
    lines = []
    for start in range(first * _ROW_BYTES, (last + 1) * _ROW_BYTES, _ROW_BYTES):
        pair = [data[start : start + _ROW_BYTES] for data in (recorded, now)]
        lines.append(f"  byte {start:<6} recorded  {_row(pair[0])}")
        lines.append(f"  {'':11} now       {_row(pair[1])}")
        marks = _marks(*pair)
        if marks.strip():
            lines.append(f"  {'':11} {'':10}{marks.rstrip()}")
    return lines


def _text(data: bytes) -> str:
    return "".join(chr(byte) if 32 <= byte < 127 else "." for byte in data)


def _row(data: bytes) -> str:
    return f"{data.hex(' '):<{3 * _ROW_BYTES - 1}}  {_text(data)}"


def _marks(recorded: bytes, now: bytes) -> str:
    """Mark the bytes that differ, under the hexadecimal digits and under the text."""
    differ = [recorded[at : at + 1] != now[at : at + 1] for at in range(_ROW_BYTES)]
    digits = " ".join("^^" if one else "  " for one in differ)
    return f"{digits}  {''.join('^' if one else ' ' for one in differ)}"
