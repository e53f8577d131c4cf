"""Frames of files that only grow: a whole one can be told from a torn and from a damaged one.

A frame is three little-endian 32-bit words (length of the payload, CRC-32 of the payload, CRC-32 of the two
words before) and the payload.
"""

from __future__ import annotations

import struct
import zlib

HEAD = struct.Struct("<III")


def framed(payload: bytes) -> bytes:
    """Put the three words before a payload."""
    words = HEAD.pack(len(payload), zlib.crc32(payload), 0)[:8]
    return words + struct.pack("<I", zlib.crc32(words)) + payload


def whole_head(head: bytes) -> tuple[int, int] | None:
    """Return length and CRC-32 of the payload that a frame's head announces; None when it is damaged.

    Parameters
    ----------
    head : bytes
        As many as `HEAD` has.
    """
    length, checksum, of_head = HEAD.unpack(head)
    return (length, checksum) if zlib.crc32(head[:8]) == of_head else None
