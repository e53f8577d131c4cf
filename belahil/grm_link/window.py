"""The range window: its payload, its segments, and putting them together again."""

from __future__ import annotations

import math
import struct
from types import MappingProxyType
from typing import TYPE_CHECKING
from zlib import crc32

import numpy as np

from belahil.errors import CorruptData, StaleData
from belahil.grm_link.answers import SEGMENT_OVERHEAD_BYTES, WindowSegment
from belahil.grm_link.commands import NO_GAIN_CODE
from belahil.grm_link.named_values import pack_named_values, read_named_values
from belahil.grm_link.octets import Octets
from belahil.grm_link.packets import MAX_PACKET_BYTES, TELEMETRY_OVERHEAD_BYTES
from belahil.values import Candidate, RangeWindow

if TYPE_CHECKING:
    from numpy.typing import NDArray

MAX_CANDIDATES = 4
MAX_SEGMENT_BYTES = MAX_PACKET_BYTES - TELEMETRY_OVERHEAD_BYTES - SEGMENT_OVERHEAD_BYTES

# Counts travel in offset binary: small ones would be full of zero bytes, which cost COBS half its speed.
_OFFSET = np.uint16(0x8000)
_HEAD = struct.Struct(">IBBBxIIdddd")
_CANDIDATE = struct.Struct(">dddIH")
_CANDIDATE_FORM = 1
_SCALES = ("volts per count", "zero count", "sample interval", "start")


def pack_window(window: RangeWindow) -> bytes:
    """Return the payload of a window: header, counts, candidates, housekeeping.

    Raises
    ------
    ValueError
        Counts are not int16 of shape (n,), there are more than four candidates, or a number does not
        fit its field.
    """
    if window.counts.dtype != np.int16 or window.counts.ndim != 1:
        raise ValueError(f"counts of {window.counts.dtype}, shape {window.counts.shape}; int16 (n,) wanted")
    if len(window.candidates) > MAX_CANDIDATES:
        raise ValueError(f"{len(window.candidates)} candidates; at most {MAX_CANDIDATES}")
    if window.gain_code == NO_GAIN_CODE:
        raise ValueError(f"gain code {NO_GAIN_CODE} means none")
    try:
        head = _HEAD.pack(
            window.shot,
            NO_GAIN_CODE if window.gain_code is None else window.gain_code,
            len(window.candidates),
            _CANDIDATE_FORM if window.candidates else 0,
            window.counts.size,
            window.saturated,
            window.volts_per_count,
            window.zero_count,
            window.sample_interval_s,
            window.start_s,
        )
        candidates = b"".join(map(_candidate, window.candidates))
    except struct.error as error:
        raise ValueError(f"window of shot {window.shot}: {error}") from error
    counts = (window.counts.view(np.uint16) ^ _OFFSET).astype(">u2").tobytes()
    return b"".join((head, counts, candidates, pack_named_values(window.housekeeping)))


def _candidate(found: Candidate) -> bytes:
    counts = found.correlation_window
    head = _CANDIDATE.pack(found.arrival_s, found.fwhm_s, found.amplitude_v, found.first_sample, len(counts))
    return head + struct.pack(f">{len(counts)}h", *counts)


def unpack_window(payload: bytes) -> RangeWindow:
    """Read the payload of a window.

    Returns
    -------
    RangeWindow
        Its counts cannot be written to.

    Raises
    ------
    CorruptData
        The payload does not follow the layout, or a scale is not a usable number.
    """
    octets = Octets(payload, "window")
    shot, code, found, form, count, saturated, *scales = octets.take(_HEAD, "its head")
    octets.name = f"window of shot {shot}"
    volts_per_count, zero_count, sample_interval_s, start_s = scales
    for name, value, lowest in zip(_SCALES, scales, (0.0, -math.inf, 0.0, -math.inf), strict=True):
        if not lowest < value < math.inf:
            raise CorruptData(f"{octets.name}: {name} {value}; allowed: finite{', above 0' * (lowest == 0)}")
    if found > MAX_CANDIDATES:
        raise CorruptData(f"{octets.name}: {found} candidates; allowed: at most {MAX_CANDIDATES}")
    if found and form != _CANDIDATE_FORM:
        raise CorruptData(f"{octets.name}: candidates of form {form}; allowed: {_CANDIDATE_FORM}")
    # Without its samples a window still tells how many were clipped.
    if count and saturated > count:
        raise CorruptData(f"{octets.name}: {saturated} of {count} samples saturated")
    counts = _read_counts(octets.take_bytes(2 * count, f"its {count} counts"))
    candidates = tuple(_read_candidate(octets, number) for number in range(1, found + 1))
    octets.name += f", behind {count} counts and {found} candidates"
    return RangeWindow(
        counts=counts,
        volts_per_count=volts_per_count,
        zero_count=zero_count,
        sample_interval_s=sample_interval_s,
        start_s=start_s,
        gain_code=None if code == NO_GAIN_CODE else code,
        shot=shot,
        saturated=saturated,
        candidates=candidates,
        housekeeping=MappingProxyType(read_named_values(octets)),
    )


def _read_counts(octets: bytes) -> NDArray[np.int16]:
    sent = np.frombuffer(octets, dtype=">u2").astype(np.uint16)
    sent ^= _OFFSET
    counts = sent.view(np.int16)
    counts.flags.writeable = False
    return counts


def _read_candidate(octets: Octets, number: int) -> Candidate:
    arrival_s, fwhm_s, amplitude_v, first_sample, size = octets.take(_CANDIDATE, f"candidate {number}")
    for value in (arrival_s, fwhm_s, amplitude_v):
        if not math.isfinite(value):
            raise CorruptData(f"{octets.name}: candidate {number} has a number {value}; allowed: finite ones")
    counts = octets.take(struct.Struct(f">{size}h"), f"the {size} counts of candidate {number}")
    return Candidate(arrival_s, fwhm_s, amplitude_v, counts, first_sample)


def segments(
    window: RangeWindow, request_id: int, segment_bytes: int = MAX_SEGMENT_BYTES
) -> list[WindowSegment]:
    """Cut a window into segments of at most `segment_bytes` octets of payload each."""
    payload = pack_window(window)
    checksum = crc32(payload)
    count = -(-len(payload) // segment_bytes)
    return [
        WindowSegment(
            request_id,
            window.shot,
            index,
            count,
            checksum,
            payload[index * segment_bytes : (index + 1) * segment_bytes],
        )
        for index in range(count)
    ]


class WindowAssembler:
    """Puts the segments of one window together and proves that they are that window.

    Parameters
    ----------
    request_id : int
        Of the arm command.
    shot : int
        That it carried.
    """

    def __init__(self, request_id: int, shot: int) -> None:
        self._request_id = request_id
        self._shot = shot
        self._segments: list[WindowSegment] = []

    def add(self, segment: WindowSegment) -> RangeWindow | None:
        """Take the next segment; return the window when it was the last.

        Raises
        ------
        StaleData
            The segment belongs to another request or shot.
        CorruptData
            A gap, a double, segments of two windows, a wrong checksum or a wrong layout.
        """
        if (segment.request_id, segment.shot) != (self._request_id, self._shot):
            raise StaleData(
                f"asked for shot {self._shot} (request {self._request_id:08x}), "
                f"a segment came of shot {segment.shot} (request {segment.request_id:08x})"
            )
        if segment.index != len(self._segments):
            raise CorruptData(
                f"window of shot {self._shot}: segment {segment.index} came where "
                f"{len(self._segments)} was due"
            )
        first = self._segments[0] if self._segments else segment
        if (segment.count, segment.payload_crc32) != (first.count, first.payload_crc32):
            raise CorruptData(
                f"window of shot {self._shot}: segments of two windows, "
                f"{first.count} with CRC-32 0x{first.payload_crc32:08x} and "
                f"{segment.count} with 0x{segment.payload_crc32:08x}"
            )
        self._segments.append(segment)
        return self._window() if len(self._segments) == segment.count else None

    def _window(self) -> RangeWindow:
        payload = b"".join(segment.payload for segment in self._segments)
        if crc32(payload) != self._segments[0].payload_crc32:
            raise CorruptData(
                f"window of shot {self._shot}: its segments say CRC-32 "
                f"0x{self._segments[0].payload_crc32:08x}, its {len(payload)} octets have "
                f"0x{crc32(payload):08x}"
            )
        window = unpack_window(payload)
        if window.shot != self._shot:
            raise StaleData(f"asked for shot {self._shot}, the window says shot {window.shot}")
        return window
