"""Answers of the receiver: the whole of its telemetry, range windows as segments."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

from belahil.errors import CorruptData
from belahil.grm_link.commands import RECEIVER_SERVICE
from belahil.grm_link.named_values import pack_named_values, read_named_values
from belahil.grm_link.octets import Octets
from belahil.grm_link.packets import CONTINUATION, FIRST, LAST, UNSEGMENTED, Telemetry
from belahil.grm_link.spec import pack_spec, read_spec

if TYPE_CHECKING:
    from collections.abc import Mapping

    from belahil.receiver import DigitizerSpec

VERIFICATION_SERVICE = 1
MAX_TEXT_BYTES = 1024

_REQUEST_ID = struct.Struct(">I")
_REASON = struct.Struct(">H")
_SEGMENT = struct.Struct(">IHHI")
SEGMENT_OVERHEAD_BYTES = _REQUEST_ID.size + _SEGMENT.size


@dataclass(frozen=True, slots=True)
class Acknowledge:
    """The command was accepted."""

    request_id: int


@dataclass(frozen=True, slots=True)
class Refusal:
    """The command was not carried out, or an accepted one came to nothing."""

    request_id: int
    reason: int
    text: str


@dataclass(frozen=True, slots=True)
class IdentityReport:
    """Who answers."""

    request_id: int
    text: str


@dataclass(frozen=True, slots=True)
class SpecReport:
    """What the receiver says of its converters."""

    request_id: int
    spec: DigitizerSpec


@dataclass(frozen=True, slots=True)
class HousekeepingReport:
    """Named numbers, SI units in the names."""

    request_id: int
    values: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class WindowSegment:
    """One part of a window; see `belahil.grm_link.window`."""

    request_id: int
    shot: int
    index: int
    count: int
    payload_crc32: int
    payload: bytes

    @property
    def grouping(self) -> int:
        """The CCSDS sequence flags that belong to index and count."""
        if self.count == 1:
            return UNSEGMENTED
        if self.index == 0:
            return FIRST
        return LAST if self.index == self.count - 1 else CONTINUATION


Answer = Acknowledge | Refusal | IdentityReport | SpecReport | HousekeepingReport | WindowSegment


def telemetry(
    answer: Answer, sequence_count: int, time_s: float = 0.0, *, checked: bool = False
) -> Telemetry:
    """Return the packet of an answer."""
    grouping = UNSEGMENTED
    service = RECEIVER_SERVICE
    head = _REQUEST_ID.pack(answer.request_id)
    match answer:
        case Acknowledge():
            service, subtype, data = VERIFICATION_SERVICE, 1, b""
        case Refusal(_, reason, text):
            service, subtype, data = VERIFICATION_SERVICE, 2, _REASON.pack(reason) + _octets(text)
        case IdentityReport(_, text):
            subtype, data = 129, _octets(text)
        case SpecReport(_, spec):
            subtype, data = 130, pack_spec(spec)
        case WindowSegment():
            subtype, grouping = 131, answer.grouping
            head += _SEGMENT.pack(answer.shot, answer.index, answer.count, answer.payload_crc32)
            data = answer.payload
        case HousekeepingReport(_, values):
            subtype, data = 132, pack_named_values(values)
    return Telemetry(service, subtype, sequence_count, head + data, grouping, time_s, checked)


def _octets(text: str) -> bytes:
    return text.encode()[:MAX_TEXT_BYTES].decode(errors="ignore").encode()


def read_answer(packet: Telemetry) -> Answer | None:
    """Return what telemetry says; None for kinds that this link does not define.

    Raises
    ------
    CorruptData
        The packet is intact but its contents do not follow the page.
    """
    match packet.service, packet.subtype:
        case (1, 1):
            octets, request_id = _begun(packet, "acknowledge")
            octets.end()
            return Acknowledge(request_id)
        case (1, 2):
            octets, request_id = _begun(packet, "refusal")
            (reason,) = octets.take(_REASON, "the reason")
            return Refusal(request_id, reason, octets.rest().decode(errors="replace"))
        case (200, 129):
            octets, request_id = _begun(packet, "identity")
            return IdentityReport(request_id, _identity(octets.rest()))
        case (200, 130):
            octets, request_id = _begun(packet, "spec")
            return SpecReport(request_id, read_spec(octets))
        case (200, 131):
            return _read_segment(packet)
        case (200, 132):
            octets, request_id = _begun(packet, "housekeeping")
            return HousekeepingReport(request_id, read_named_values(octets))
    return None


def _begun(packet: Telemetry, name: str) -> tuple[Octets, int]:
    """Return the data of an answer that comes in one packet, behind its request number, and that number."""
    if packet.grouping != UNSEGMENTED:
        raise CorruptData(f"{name} with sequence flags {packet.grouping}; allowed: {UNSEGMENTED}")
    octets = Octets(packet.data, name)
    (request_id,) = octets.take(_REQUEST_ID, "the request number")
    return octets, request_id


def _identity(octets: bytes) -> str:
    if len(octets) > MAX_TEXT_BYTES:
        raise CorruptData(f"identity of {len(octets)} octets; allowed: at most {MAX_TEXT_BYTES}")
    try:
        text = octets.decode()
    except UnicodeDecodeError as error:
        raise CorruptData(f"identity is not UTF-8: {error.reason} at octet {error.start}") from error
    if not text.strip():
        raise CorruptData(f"identity {text!r} is blank")
    return text


def _read_segment(packet: Telemetry) -> WindowSegment:
    octets = Octets(packet.data, "window segment")
    (request_id,) = octets.take(_REQUEST_ID, "the request number")
    shot, index, count, payload_crc32 = octets.take(_SEGMENT, "the CRC-32")
    segment = WindowSegment(request_id, shot, index, count, payload_crc32, octets.rest())
    if not index < count:
        raise CorruptData(f"window segment {index} of {count}: segments are numbered from 0")
    if packet.grouping != segment.grouping:
        raise CorruptData(
            f"window segment {index} of {count} with sequence flags {packet.grouping}; "
            f"{segment.grouping} are due"
        )
    return segment
