"""CCSDS space packets with PUS-shaped secondary headers.

Layout after CCSDS 133.0-B-2 (space packet), ECSS-E-ST-70-41C (PUS-C secondary headers) and
CCSDS 301.0-B-4 (unsegmented time code, 4 octets of seconds and 3 of fraction, no preamble).
"""

from __future__ import annotations

import struct
from binascii import crc_hqx
from dataclasses import dataclass
from typing import ClassVar
from zlib import crc32

from belahil.errors import CorruptData

APID = 0x064
MAX_PACKET_BYTES = 16384
SEQUENCE_COUNTS = 1 << 14

# Values of the CCSDS sequence flags.
CONTINUATION, FIRST, LAST, UNSEGMENTED = range(4)

_PRIMARY = struct.Struct(">HHH")
_TELECOMMAND = struct.Struct(">HHHBBBH")
_TELEMETRY = struct.Struct(">HHHBBBIIHB")
_CRC_BYTES = 2
_PUS_C = 2
_ACKNOWLEDGE_ACCEPTANCE = 1
# Lower half of the octet of the PUS version when there is a second check.
_TELECOMMAND_CHECKED, _TELEMETRY_CHECKED = 3, 1
# Where the second check lies: in fields that PUS calls source, and message count with destination.
_SECOND_AT = 9
_SOURCE_BYTES, _COUNT_BYTES = 2, 4
TELEMETRY_OVERHEAD_BYTES = _TELEMETRY.size + _CRC_BYTES
STATED_WITHIN = _PRIMARY.size


def crc16(data: bytes, before: int = 0xFFFF) -> int:
    """CRC-16/IBM-3740: polynomial 0x1021, start 0xFFFF, not reflected; 0 over data and its own CRC.

    Parameters
    ----------
    data : bytes
        What is summed up.
    before : int
        CRC of what comes before it.
    """
    return crc_hqx(data, before)


@dataclass(frozen=True, slots=True)
class Telecommand:
    """A packet from the client to the receiver; always unsegmented.

    Parameters
    ----------
    service, subtype : int
        What is asked, 0 to 255 each.
    sequence_count : int
        0 to 16383; the answer carries it back within its request number.
    data : bytes
        Application data.
    checked : bool
        Whether it carries a second check beside its CRC-16.
    """

    PACKET_ID: ClassVar[int] = 0x1800 | APID

    service: int
    subtype: int
    sequence_count: int
    data: bytes = b""
    checked: bool = False

    @property
    def request_id(self) -> int:
        """First four octets of the packet, by which answers refer to it."""
        return self.PACKET_ID << 16 | UNSEGMENTED << 14 | self.sequence_count

    def pack(self) -> bytes:
        """Return the whole packet."""
        head = _TELECOMMAND.pack(
            self.PACKET_ID,
            UNSEGMENTED << 14 | self.sequence_count,
            _data_length(_TELECOMMAND, self.data),
            _PUS_C << 4 | (_TELECOMMAND_CHECKED if self.checked else _ACKNOWLEDGE_ACCEPTANCE),
            self.service,
            self.subtype,
            0,
        )
        return _closed(head, self.data, _SOURCE_BYTES * self.checked)

    @classmethod
    def unpack(cls, packet: bytes) -> Telecommand:
        """Read one whole packet.

        Raises
        ------
        CorruptData
            Not a telecommand of this link, or damaged.
        """
        _check(packet, cls.PACKET_ID, _TELECOMMAND)
        _, sequence, _, version, service, subtype, second = _TELECOMMAND.unpack_from(packet)
        if sequence >> 14 != UNSEGMENTED:
            raise CorruptData(f"packet with sequence flags {sequence >> 14}, not {UNSEGMENTED}")
        _check_version(version)
        checked = version & 0xF == _TELECOMMAND_CHECKED
        _check_second(packet, second, _SOURCE_BYTES, checked)
        data = packet[_TELECOMMAND.size : -_CRC_BYTES]
        return cls(service, subtype, sequence & 0x3FFF, data, checked)


@dataclass(frozen=True, slots=True)
class Telemetry:
    """A packet from the receiver to the client.

    Parameters
    ----------
    service, subtype : int
        What is reported, 0 to 255 each.
    sequence_count : int
        0 to 16383, counts all telemetry of the receiver.
    data : bytes
        Source data.
    grouping : int
        CCSDS sequence flags: 0 continuation, 1 first, 2 last, 3 unsegmented.
    time_s : float
        The receiver's own time, 0 to 2**32 s, cut to 2**-24 s; 0 where it keeps none.
    checked : bool
        Whether it carries a second check beside its CRC-16.
    """

    PACKET_ID: ClassVar[int] = 0x0800 | APID

    service: int
    subtype: int
    sequence_count: int
    data: bytes = b""
    grouping: int = UNSEGMENTED
    time_s: float = 0.0
    checked: bool = False

    def pack(self) -> bytes:
        """Return the whole packet."""
        seconds, fraction = divmod(int(self.time_s * (1 << 24)), 1 << 24)
        head = _TELEMETRY.pack(
            self.PACKET_ID,
            self.grouping << 14 | self.sequence_count,
            _data_length(_TELEMETRY, self.data),
            _PUS_C << 4 | (_TELEMETRY_CHECKED if self.checked else 0),
            self.service,
            self.subtype,
            0,
            seconds & 0xFFFFFFFF,
            fraction >> 8,
            fraction & 0xFF,
        )
        return _closed(head, self.data, _COUNT_BYTES * self.checked)

    @classmethod
    def unpack(cls, packet: bytes) -> Telemetry:
        """Read one whole packet.

        Raises
        ------
        CorruptData
            Not telemetry of this link, or damaged.
        """
        _check(packet, cls.PACKET_ID, _TELEMETRY)
        _, sequence, _, version, service, subtype, second, seconds, high, low = _TELEMETRY.unpack_from(packet)
        _check_version(version)
        checked = version & 0xF == _TELEMETRY_CHECKED
        _check_second(packet, second, _COUNT_BYTES, checked)
        return cls(
            service,
            subtype,
            sequence & 0x3FFF,
            packet[_TELEMETRY.size : -_CRC_BYTES],
            sequence >> 14,
            seconds + (high << 8 | low) / (1 << 24),
            checked,
        )


def stated_bytes(packet: bytes | bytearray) -> int:
    """Length of the packet that begins here, as its first `STATED_WITHIN` octets state it."""
    return int.from_bytes(packet[4:6], "big") + _PRIMARY.size + 1


def _data_length(head: struct.Struct, data: bytes) -> int:
    return head.size + len(data) + _CRC_BYTES - _PRIMARY.size - 1


def _second(head: bytes, data: bytes | memoryview, size: int) -> int:
    """Second check: the last octets of the CRC-32 over a packet where it is 0."""
    return crc32(data, crc32(head)) & (1 << 8 * size) - 1


def _closed(head: bytes, data: bytes, second_bytes: int) -> bytes:
    size = len(head) + len(data) + _CRC_BYTES
    if size > MAX_PACKET_BYTES:
        raise ValueError(f"a packet of {size} octets; at most {MAX_PACKET_BYTES}")
    if second_bytes:
        second = _second(head, data, second_bytes).to_bytes(second_bytes, "big")
        head = head[:_SECOND_AT] + second + head[_SECOND_AT + second_bytes :]
    checksum = crc16(data, crc16(head))
    return b"".join((head, data, checksum.to_bytes(_CRC_BYTES, "big")))


def _check(packet: bytes, packet_id: int, head: struct.Struct) -> None:
    if not head.size + _CRC_BYTES <= len(packet) <= MAX_PACKET_BYTES:
        raise CorruptData(
            f"packet of {len(packet)} octets; allowed: {head.size + _CRC_BYTES} to {MAX_PACKET_BYTES}"
        )
    if int.from_bytes(packet[:2], "big") != packet_id:
        raise CorruptData(f"packet with identification 0x{packet[:2].hex()}, not 0x{packet_id:04x}")
    if stated_bytes(packet) != len(packet):
        raise CorruptData(f"packet of {len(packet)} octets whose length field means {stated_bytes(packet)}")
    if crc16(packet) != 0:
        due = crc16(packet[:-_CRC_BYTES])
        raise CorruptData(f"packet with CRC-16 0x{packet[-_CRC_BYTES:].hex()}, not 0x{due:04x}")


def _check_second(packet: bytes, found: int, size: int, checked: bool) -> None:
    begin = packet[:_SECOND_AT] + bytes(size)
    due = _second(begin, memoryview(packet)[len(begin) : -_CRC_BYTES], size) if checked else 0
    if found != due:
        raise CorruptData(f"packet with second check 0x{found:0{2 * size}x}, not 0x{due:0{2 * size}x}")


def _check_version(version: int) -> None:
    if version >> 4 != _PUS_C:
        raise CorruptData(f"packet of PUS version {version >> 4}, not {_PUS_C}")
