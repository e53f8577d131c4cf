"""Octets that are read field by field."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from belahil.errors import CorruptData

if TYPE_CHECKING:
    import struct


class Octets:
    """Reads a block from its beginning; says by name what is missing where it ends too early.

    Parameters
    ----------
    data : bytes
        The whole block.
    name : str
        What it is, for messages; may be changed when more is known.
    """

    def __init__(self, data: bytes, name: str) -> None:
        self._data = data
        self._at = 0
        self.name = name

    def take(self, fields: struct.Struct, what: str) -> tuple[Any, ...]:
        """Return the next fields.

        Raises
        ------
        CorruptData
            The block ends before they do.
        """
        return fields.unpack(self.take_bytes(fields.size, what))

    def take_bytes(self, count: int, what: str) -> bytes:
        """Return the next octets.

        Raises
        ------
        CorruptData
            The block ends before they do.
        """
        end = self._at + count
        if end > len(self._data):
            raise CorruptData(
                f"{self.name}: {what} would end at octet {end}, but there are {len(self._data)} octets"
            )
        taken = self._data[self._at : end]
        self._at = end
        return taken

    def rest(self) -> bytes:
        """Return all that is left."""
        taken = self._data[self._at :]
        self._at = len(self._data)
        return taken

    def end(self) -> None:
        """Check that nothing is left.

        Raises
        ------
        CorruptData
            Something is.
        """
        if self._at < len(self._data):
            raise CorruptData(
                f"{self.name}: ends at octet {self._at}, but there are {len(self._data)} octets"
            )
