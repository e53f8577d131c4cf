"""Answers of the receiver: the whole of its telemetry, range windows as segments."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

from belahil.errors import CorruptData
from belahil.grm_link.commands import RECEIVER_SERVICE
from belahil.grm_link.packets import CONTINUATION, FIRST, LAST, UNSEGMENTED, Telemetry
from belahil.receiver import DigitizerSpec
from belahil.values import PRODUCTS, TRIGGERS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

VERIFICATION_SERVICE = 1
MAX_TEXT_BYTES = 1024

_REQUEST_ID = struct.Struct(">I")
_SPEC = struct.Struct(">dIBBBBB")
_SEGMENT = struct.Struct(">IHHI")
SEGMENT_OVERHEAD_BYTES = _REQUEST_ID.size + _SEGMENT.size

T = TypeVar("T", bound=str)


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


def telemetry(answer: Answer, sequence_count: int, time_s: float = 0.0) -> Telemetry:
    """Return the packet of an answer."""
    grouping = UNSEGMENTED
    service = RECEIVER_SERVICE
    match answer:
        case Acknowledge():
            service, subtype, data = VERIFICATION_SERVICE, 1, b""
        case Refusal(_, reason, text):
            service, subtype, data = VERIFICATION_SERVICE, 2, reason.to_bytes(2, "big") + _octets(text)
        case IdentityReport(_, text):
            subtype, data = 129, _octets(text)
        case SpecReport(_, spec):
            subtype, data = 130, _spec_data(spec)
        case WindowSegment():
            subtype, grouping = 131, answer.grouping
            head = _SEGMENT.pack(answer.shot, answer.index, answer.count, answer.payload_crc32)
            data = head + answer.payload
        case HousekeepingReport(_, values):
            subtype, data = 132, pack_named_values(values)
    whole = _REQUEST_ID.pack(answer.request_id) + data
    return Telemetry(service, subtype, sequence_count, whole, grouping, time_s)


def _octets(text: str) -> bytes:
    return text.encode()[:MAX_TEXT_BYTES].decode(errors="ignore").encode()


def _spec_data(spec: DigitizerSpec) -> bytes:
    codes = spec.gain_codes or ()
    head = _SPEC.pack(
        spec.sample_rate_hz,
        spec.max_sample_count,
        spec.bits,
        spec.converters,
        sum(1 << TRIGGERS.index(name) for name in spec.triggers),
        sum(1 << PRODUCTS.index(name) for name in spec.products),
        len(codes),
    )
    return head + bytes(codes)


def pack_named_values(values: Mapping[str, float]) -> bytes:
    """Return the octets of a small table of numbers: count, then length, name, float64 of each.

    Raises
    ------
    ValueError
        More than 255 entries, or a name of more than 255 octets.
    """
    parts = [bytes([len(values)])]
    for name, value in values.items():
        octets = name.encode()
        parts += [bytes([len(octets)]), octets, struct.pack(">d", value)]
    return b"".join(parts)


def read_named_values(data: bytes) -> dict[str, float]:
    """Read the octets of `pack_named_values`, nothing left over.

    Raises
    ------
    CorruptData
        Not such a table.
    """
    values = {}
    try:
        at = 1
        for _ in range(data[0]):
            end = at + 1 + data[at]
            values[data[at + 1 : end].decode()] = struct.unpack_from(">d", data, end)[0]
            at = end + 8
    except (IndexError, struct.error, UnicodeDecodeError) as error:
        raise CorruptData(f"table of named values: {error}") from error
    if at != len(data) or len(values) != data[0]:
        raise CorruptData(f"table of {data[0]} named values in {len(data)} octets does not add up")
    return values


def read_answer(packet: Telemetry) -> Answer | None:
    """Return what telemetry says; None for kinds that this link does not define.

    Raises
    ------
    CorruptData
        The packet is intact but its contents do not follow the layout.
    """
    kind = (packet.service, packet.subtype)
    try:
        request_id = _REQUEST_ID.unpack_from(packet.data)[0]
        body = packet.data[_REQUEST_ID.size :]
        match kind:
            case (1, 1):
                return Acknowledge(request_id)
            case (1, 2):
                return Refusal(request_id, int.from_bytes(body[:2], "big"), body[2:].decode(errors="replace"))
            case (200, 129):
                return IdentityReport(request_id, body.decode(errors="replace"))
            case (200, 130):
                return SpecReport(request_id, _read_spec(body))
            case (200, 131):
                return _read_segment(request_id, body, packet.grouping)
            case (200, 132):
                return HousekeepingReport(request_id, read_named_values(body))
    except struct.error as error:
        raise CorruptData(f"telemetry {kind} of {len(packet.data)} octets: {error}") from error
    return None


def _read_segment(request_id: int, body: bytes, grouping: int) -> WindowSegment:
    shot, index, count, payload_crc32 = _SEGMENT.unpack_from(body)
    segment = WindowSegment(request_id, shot, index, count, payload_crc32, body[_SEGMENT.size :])
    if not segment.index < segment.count or segment.grouping != grouping:
        raise CorruptData(f"window segment {segment.index} of {segment.count} with sequence flags {grouping}")
    return segment


def _read_spec(body: bytes) -> DigitizerSpec:
    rate_hz, max_sample_count, bits, converters, triggers, products, codes = _SPEC.unpack_from(body)
    if len(body) != _SPEC.size + codes or not (math.isfinite(rate_hz) and rate_hz > 0) or not converters:
        raise CorruptData(
            f"spec of {len(body)} octets, {codes} gain codes, {rate_hz} Hz, {converters} converters"
        )
    return DigitizerSpec(
        sample_rate_hz=rate_hz,
        bits=bits,
        converters=converters,
        max_sample_count=max_sample_count,
        gain_codes=tuple(body[_SPEC.size :]) or None,
        triggers=_flagged(TRIGGERS, triggers),
        products=_flagged(PRODUCTS, products),
    )


def _flagged(names: Sequence[T], mask: int) -> tuple[T, ...]:
    return tuple(name for bit, name in enumerate(names) if mask >> bit & 1)
