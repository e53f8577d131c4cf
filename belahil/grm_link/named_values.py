"""A small table of numbers with names, as housekeeping is sent."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from belahil.errors import CorruptData
from belahil.grm_link.octets import Octets

if TYPE_CHECKING:
    from collections.abc import Mapping

_SIZE = struct.Struct(">B")
_VALUE = struct.Struct(">d")


def pack_named_values(values: Mapping[str, float]) -> bytes:
    """Return the octets of a table: number of entries, then length, name, float64 of each.

    Raises
    ------
    ValueError
        More than 255 entries, or a name of more than 255 octets.
    """
    parts = [bytes([len(values)])]
    for name, value in values.items():
        octets = name.encode()
        parts += [bytes([len(octets)]), octets, _VALUE.pack(value)]
    return b"".join(parts)


def read_named_values(octets: Octets) -> dict[str, float]:
    """Read a table that is the rest of a block.

    Raises
    ------
    CorruptData
        Not such a table, or something behind it.
    """
    values: dict[str, float] = {}
    (entries,) = octets.take(_SIZE, "the number of named values")
    for number in range(1, entries + 1):
        which = f"of named value {number} of {entries}"
        (size,) = octets.take(_SIZE, f"the length of the name {which}")
        name = octets.take_bytes(size, f"the name {which}")
        try:
            values[name.decode()] = octets.take(_VALUE, f"the number {which}")[0]
        except UnicodeDecodeError as error:
            raise CorruptData(f"{octets.name}: the name {which} is not UTF-8: {name!r}") from error
    octets.end()
    if len(values) != entries:
        raise CorruptData(f"{octets.name}: {entries} named values with only {len(values)} different names")
    return values
