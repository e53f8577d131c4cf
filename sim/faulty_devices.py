"""Devices whose links fail as a plan says; each has the same face as the device that it wraps."""

from __future__ import annotations

import random
from collections import deque
from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

from belahil.grm_link import Framing, Telemetry, WindowSegment, framed, packet_stream, read_answer, telemetry
from belahil.grm_link.packets import stated_bytes

if TYPE_CHECKING:
    from sim.faults import Direction, Fault, FaultPlan, LinkName

_ALL_BYTES = 1 << 24


class Messages(Protocol):
    """What `FaultyMessages` wraps: an instrument of IEEE 488.2."""

    def write(self, data: bytes, end: bool = True) -> None:
        """Take bytes."""
        ...

    def read(self) -> bytes | None:
        """Give the next message."""
        ...

    def clear(self) -> None:
        """Do what a device clear does."""
        ...

    def read_stb(self) -> int:
        """Give the status byte."""
        ...


class Line(Protocol):
    """What `FaultyLine` wraps: the far end of a line."""

    def write(self, data: bytes) -> None:
        """Take bytes."""
        ...

    def read(self, max_bytes: int) -> bytes:
        """Give bytes that are ready."""
        ...

    def clear(self) -> None:
        """Drop what is ready."""
        ...


class _Cable:
    """Both directions of a link: what arrives of each message, and what is still on its way.

    A late message to the device arrives before the next one, a late message from it after the first write
    that follows an expired time-out; no clearing reaches either.
    """

    def __init__(self, plan: FaultPlan, link: LinkName) -> None:
        self._plan = plan
        self._link: LinkName = link
        self._late: dict[Direction, list[bytes]] = {"to_device": [], "from_device": []}
        self._closed = False
        self.expired = False
        self.aging: list[Fault] = []

    def check(self) -> None:
        """Raise `ConnectionResetError` when the plan has closed the link."""
        if self._closed:
            raise ConnectionResetError("closed by the fault plan")

    def carry(self, direction: Direction, message: bytes) -> list[bytes]:
        """Return what arrives when a message is sent."""
        fault = self._plan.next(self._link, direction)
        before = self.overdue("to_device") if direction == "to_device" else []
        return before + ([message] if fault is None else self._struck(fault, direction, message))

    def _struck(self, fault: Fault, direction: Direction, message: bytes) -> list[bytes]:
        if fault.kind == "old_shot":
            self.aging.append(fault)
            return [message]
        self._plan.fired[fault] += 1
        if fault.kind == "late":
            self._late[direction].append(message)
            return []
        if fault.kind == "close":
            self._closed = True
            self.check()
        return fault.struck(message)

    def overdue(self, direction: Direction) -> list[bytes]:
        """Return the late messages that arrive now."""
        arrived, self._late[direction] = self._late[direction], []
        return arrived


class FaultyMessages:
    """An instrument at the end of a bus that fails.

    Parameters
    ----------
    device : Messages
        Is reached when the plan lets it be.
    plan : FaultPlan
        Its faults of link "visa".
    """

    def __init__(self, device: Messages, plan: FaultPlan) -> None:
        self._device = device
        self._cable = _Cable(plan, "visa")
        self._ready: deque[bytes] = deque()

    def write(self, data: bytes, end: bool = True) -> None:
        """Send a message; one that is cut to an odd length has lost its END too."""
        self._cable.check()
        for message in self._cable.carry("to_device", data):
            self._device.write(message, end and not (len(message) < len(data) and len(message) % 2))
        if self._cable.expired:
            self._ready.extendleft(reversed(self._cable.overdue("from_device")))
            self._cable.expired = False

    def read(self) -> bytes | None:
        """Give the next message that has arrived."""
        self._cable.check()
        while (message := self._device.read()) is not None:
            self._ready += filter(None, self._cable.carry("from_device", message))
        if not self._ready:
            self._cable.expired = True
            return None
        return self._ready.popleft()

    def clear(self) -> None:
        """Do what a device clear does."""
        self._cable.check()
        self._ready.clear()
        self._device.clear()

    def read_stb(self) -> int:
        """Give the status byte."""
        self._cable.check()
        return self._device.read_stb()


class FaultyLine:
    """A receiver at the end of a line that fails; its messages are packets.

    Parameters
    ----------
    device : Line
        Is reached when the plan lets it be.
    framing : {"cobs", "raw"}
        Of the line.
    plan : FaultPlan
        Its faults of link "serial" or "usb".
    """

    def __init__(self, device: Line, framing: Framing, plan: FaultPlan) -> None:
        self._device = device
        self._framing: Framing = framing
        self._cable = _Cable(plan, "serial" if framing == "cobs" else "usb")
        self._plan = plan
        self._older: Telemetry | None = None
        self._ready = bytearray()

    def write(self, data: bytes) -> None:
        """Send a message."""
        self._cable.check()
        for message in self._cable.carry("to_device", data):
            self._device.write(message)
        if self._cable.expired:
            self._ready[:0] = b"".join(self._cable.overdue("from_device"))
            self._cable.expired = False

    def read(self, max_bytes: int) -> bytes:
        """Give what has arrived."""
        self._gather()
        self._cable.expired = not self._ready
        taken = bytes(self._ready[:max_bytes])
        del self._ready[:max_bytes]
        return taken

    @property
    def waiting(self) -> int:
        """Bytes that have arrived."""
        self._gather()
        return len(self._ready)

    def clear(self) -> None:
        """Drop what has arrived."""
        self._cable.check()
        self._device.clear()
        self._ready.clear()

    def _gather(self) -> None:
        self._cable.check()
        while data := self._device.read(_ALL_BYTES):
            for frame in _frames(data, self._framing):
                for arrived in self._cable.carry("from_device", frame):
                    self._ready += self._aged(arrived)

    def _aged(self, frame: bytes) -> bytes:
        """Replace the window in a frame by an earlier one, when that is due."""
        packets = packet_stream(Telemetry, self._framing).feed(frame)
        if not packets or not isinstance(read_answer(packets[0]), WindowSegment):
            return frame
        older, self._older = self._older, packets[0]
        if older is None or not self._cable.aging:
            return frame
        fault = self._cable.aging.pop(0)
        self._plan.fired[fault] += 1
        return framed(_forged(older, packets[0], fault.seed).pack(), self._framing)


def _frames(data: bytes, framing: Framing) -> list[bytes]:
    """Cut what an intact device says into frames."""
    if framing == "cobs":
        return [b"\0" + stuffed + b"\0" for stuffed in data.split(b"\0") if stuffed]
    frames = []
    while data:
        size = stated_bytes(data)
        frames.append(data[:size])
        data = data[size:]
    return frames


def _forged(older: Telemetry, newer: Telemetry, seed: int) -> Telemetry:
    """Return the older window as it was, or as an answer to the newer question, or with its shot too."""
    old, new = read_answer(older), read_answer(newer)
    assert isinstance(old, WindowSegment)
    assert isinstance(new, WindowSegment)
    moved = replace(old, request_id=new.request_id)
    forged = (
        older,
        *(
            telemetry(segment, newer.sequence_count, newer.time_s, checked=newer.checked)
            for segment in (moved, replace(moved, shot=new.shot))
        ),
    )
    return forged[random.Random(seed).randrange(len(forged))]
