"""From packets to the bytes on a line, and back out of a damaged stream."""

from __future__ import annotations

from typing import Generic, Literal, Protocol, TypeVar

from cobs import cobs

from belahil.errors import CorruptData
from belahil.grm_link.packets import (
    MAX_PACKET_BYTES,
    STATED_WITHIN,
    Telecommand,
    Telemetry,
    stated_bytes,
)

Framing = Literal["cobs", "raw"]
P = TypeVar("P", Telecommand, Telemetry)

_SHOWN_BYTES = 12
_LONGEST_FRAME = MAX_PACKET_BYTES + MAX_PACKET_BYTES // 254 + 1


def framed(packet: bytes, framing: Framing) -> bytes:
    """Return what goes on the line for one packet.

    Parameters
    ----------
    packet : bytes
        One whole packet.
    framing : {"cobs", "raw"}
        On a serial line: consistent overhead byte stuffing (Cheshire and Baker 1999) between two zero
        bytes, so that damage to any one byte costs one packet. On USB: the packet itself.
    """
    return b"".join((b"\0", cobs.encode(packet), b"\0")) if framing == "cobs" else packet


class PacketStream(Protocol[P]):
    """Takes bytes in any portions and gives the intact packets among them.

    Damage costs the packets that it hits; those behind them come through.
    """

    damaged: int
    """Frames, or runs of bytes between packets, that were dropped since the beginning."""
    complaint: str
    """Of the last one that was dropped: the rule that refused it, and its first octets."""

    def feed(self, data: bytes) -> list[P]:
        """Take the next bytes and return the packets that they complete."""
        ...

    def end(self) -> list[P]:
        """Give up on an incomplete packet, as after a time-out; return what lay behind it."""
        ...


def packet_stream(kind: type[P], framing: Framing) -> PacketStream[P]:
    """Return the stream for one direction of a link.

    Parameters
    ----------
    kind : type
        `Telemetry` at the client, `Telecommand` at the receiver.
    framing : {"cobs", "raw"}
        How packets lie in the stream.
    """
    return _CobsStream(kind) if framing == "cobs" else _RawStream(kind)


class _Held:
    """What both streams keep: bytes of an incomplete packet, and what was dropped."""

    def __init__(self) -> None:
        self._held = bytearray()
        self.damaged = 0
        self.complaint = ""

    def _drop(self, rule: str, octets: bytes | bytearray) -> None:
        self.damaged += 1
        self.complaint = f"{rule}; it begins with {octets[:_SHOWN_BYTES].hex(' ')}"


class _CobsStream(_Held, Generic[P]):
    """Frames between zero bytes: a new one begins at each zero, whatever came before."""

    def __init__(self, kind: type[P]) -> None:
        super().__init__()
        self._kind: type[P] = kind

    def feed(self, data: bytes) -> list[P]:
        packets = []
        start = 0
        while (stop := data.find(0, start)) >= 0:
            frame = data[start:stop]
            if self._held:
                frame = bytes(self._held) + frame
                self._held.clear()
            start = stop + 1
            if frame:
                packets += self._unstuffed(frame)
        self._held += data[start:]
        if len(self._held) > _LONGEST_FRAME:
            self.end()
        return packets

    def end(self) -> list[P]:
        if self._held:
            self._drop(f"frame of {len(self._held)} octets without a zero byte behind them", self._held)
            self._held.clear()
        return []

    def _unstuffed(self, frame: bytes) -> list[P]:
        packet = b""
        try:
            packet = cobs.decode(frame)
            return [self._kind.unpack(packet)]
        except cobs.DecodeError as error:
            self._drop(f"frame of {len(frame)} octets that are not COBS ({error})", frame)
        except CorruptData as error:
            self._drop(str(error), packet)
        return []


class _RawStream(_Held, Generic[P]):
    """Packets end to end: after damage, the next one is found by its identification and its CRC."""

    def __init__(self, kind: type[P]) -> None:
        super().__init__()
        self._kind: type[P] = kind
        self._mark = kind.PACKET_ID.to_bytes(2, "big")

    def feed(self, data: bytes) -> list[P]:
        self._held += data
        return self._scan(final=False)

    def end(self) -> list[P]:
        return self._scan(final=True)

    def _scan(self, final: bool) -> list[P]:
        packets: list[P] = []
        at, searching = 0, False
        while at < len(self._held):
            size = self._stated(at)
            if size and at + size > len(self._held) and not final:
                break
            found = self._packet(at, size)
            if not isinstance(found, CorruptData):
                packets.append(found)
                at, searching = at + size, False
                continue
            ends = bool(size) and self._begins(at + size)
            if ends or not searching:
                self._drop(str(found), self._held[at : at + _SHOWN_BYTES])
            at = at + size if ends else self._next_mark(at + 1)
            searching = not ends
        del self._held[:at]
        return packets

    def _stated(self, at: int) -> int:
        """Size of what begins here, 0 when that is no packet; the largest while its header is short."""
        head = self._held[at : at + STATED_WITHIN]
        if head[:2] != self._mark[: len(head)]:
            return 0
        size = stated_bytes(head) if len(head) == STATED_WITHIN else MAX_PACKET_BYTES
        return size if size <= MAX_PACKET_BYTES else 0

    def _packet(self, at: int, size: int) -> P | CorruptData:
        head = bytes(self._held[at : at + STATED_WITHIN])
        if head[:2] != self._mark[: len(head)]:
            return CorruptData(f"packet with identification 0x{head[:2].hex()}, not 0x{self._mark.hex()}")
        if not size:
            return CorruptData(
                f"packet whose length field means {stated_bytes(head)} octets; "
                f"allowed: at most {MAX_PACKET_BYTES}"
            )
        try:
            return self._kind.unpack(bytes(self._held[at : at + size]))
        except CorruptData as error:
            return error

    def _begins(self, at: int) -> bool:
        """Whether a packet, or nothing more, begins where a damaged one says that it ends."""
        return at == len(self._held) or self._held[at : at + 2] == self._mark

    def _next_mark(self, at: int) -> int:
        found = self._held.find(self._mark, at)
        if found >= 0:
            return found
        end = len(self._held)
        # The last byte may be the first half of a mark.
        return end - 1 if at < end and self._held[-1] == self._mark[0] else end
