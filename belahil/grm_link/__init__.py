"""The GRM link: bytes to packets and back, nothing else.

``docs/grm-link.md`` describes the link completely; this package is its codec, used by the driver and by
the emulated receiver alike. Packets are in `packets`, their way over a line in `framing`, commands in
`commands`, answers in `answers` with `spec` and `named_values`, range windows in `window`.
"""

from belahil.grm_link.answers import (
    Acknowledge,
    Answer,
    HousekeepingReport,
    IdentityReport,
    Refusal,
    SpecReport,
    WindowSegment,
    read_answer,
    telemetry,
)
from belahil.grm_link.commands import RECEIVER_SERVICE, Reason, Verb, read_command, telecommand
from belahil.grm_link.framing import Framing, PacketStream, framed, packet_stream
from belahil.grm_link.packets import MAX_PACKET_BYTES, SEQUENCE_COUNTS, Telecommand, Telemetry, crc16
from belahil.grm_link.window import (
    MAX_CANDIDATES,
    MAX_SEGMENT_BYTES,
    WindowAssembler,
    pack_window,
    segments,
    unpack_window,
)

__all__ = [
    "MAX_CANDIDATES",
    "MAX_PACKET_BYTES",
    "MAX_SEGMENT_BYTES",
    "RECEIVER_SERVICE",
    "SEQUENCE_COUNTS",
    "Acknowledge",
    "Answer",
    "Framing",
    "HousekeepingReport",
    "IdentityReport",
    "PacketStream",
    "Reason",
    "Refusal",
    "SpecReport",
    "Telecommand",
    "Telemetry",
    "Verb",
    "WindowAssembler",
    "WindowSegment",
    "crc16",
    "framed",
    "pack_window",
    "packet_stream",
    "read_answer",
    "read_command",
    "segments",
    "telecommand",
    "telemetry",
    "unpack_window",
]
