"""Telemetry of a receiver on the GRM link beside recorded one: by kind, fields and sizes."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import CorruptData, InstrumentRefused, StaleData
from belahil.grm_link import (
    Acknowledge,
    HousekeepingReport,
    IdentityReport,
    Reason,
    Refusal,
    SpecReport,
    Telecommand,
    Telemetry,
    WindowAssembler,
    WindowSegment,
    packet_stream,
    read_answer,
    read_command,
)
from belahil.parity import Difference
from belahil.parity_talk import Answering, Exchange, Talk

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from belahil.grm_link import Answer, Framing
    from belahil.parity import DifferenceKind
    from belahil.parity_tally import Tally
    from belahil.recording_file import Record
    from belahil.values import RangeWindow

_NO_COUNTS: NDArray[np.int16] = np.empty(0, np.int16)
_WINDOW = ("shot", "gain_code", "volts_per_count", "zero_count", "sample_interval_s", "start_s")


@dataclass(frozen=True, slots=True)
class Told:
    """One answer of a receiver, taken apart.

    Parameters
    ----------
    kind : str
        Of the telemetry.
    shape : mapping
        What has to be equal.
    measured : mapping
        What may differ, since it was measured.
    counts : ndarray of int16
        Samples of a window.
    """

    kind: str
    shape: Mapping[str, object]
    measured: Mapping[str, object] = field(default_factory=dict)
    counts: NDArray[np.int16] = field(default_factory=lambda: _NO_COUNTS)


class GrmTalk(Talk):
    """The link of a receiver.

    Parameters
    ----------
    link, instrument, tally, real_clock
        See `Talk`.
    framing : {"cobs", "raw"}
        How packets lie on the link.
    """

    takes_all = True

    def __init__(
        self, link: str, instrument: Answering, tally: Tally, real_clock: bool, framing: Framing
    ) -> None:
        super().__init__(link, instrument, tally, real_clock)
        self._framing: Framing = framing
        self._recorded = packet_stream(Telemetry, framing)
        self._emulated = packet_stream(Telemetry, framing)

    def compare(self, exchange: Exchange) -> None:
        """Count the telemetry that answers one telecommand."""
        damaged = self._recorded.damaged
        recorded = self._recorded.feed(exchange.recorded)
        emulated = self._emulated.feed(exchange.emulated)
        if self._recorded.damaged > damaged:
            self.tally.event(exchange.record, self.link, f"damaged: {self._recorded.complaint}")
            self.tally.passed_over += 1
            return
        if not exchange.asked:
            return
        verb = self._verb(exchange.sent)
        ours, theirs = _told(recorded), _told(emulated)
        if exchange.recorded:
            window = any(one.kind == "window" for one in ours)
            kind = f"{verb}, with its window" if window else verb
            self.tally.took(self.link, kind, exchange.recorded_s, exchange.emulated_s)
        kinds = [", ".join(_name(one) for one in told) or "(no answer)" for told in (ours, theirs)]
        if [one.kind for one in ours] != [one.kind for one in theirs]:
            refused = any(one.kind == "refusal" for one in (*ours, *theirs))
            silent = not ours or not theirs
            self._differs(
                exchange.record, verb, "error" if refused else "silence" if silent else "shape", *kinds
            )
            return
        for one, other in zip(ours, theirs, strict=True):
            self._count(exchange.record, f"{verb}: {one.kind}", one, other)

    def clear(self, number: int, record: Record) -> None:
        """Clear, and forget packets that came in part."""
        super().clear(number, record)
        self._recorded = packet_stream(Telemetry, self._framing)
        self._emulated = packet_stream(Telemetry, self._framing)

    def _verb(self, sent: bytes) -> str:
        stream = packet_stream(Telecommand, self._framing)
        commands = [*stream.feed(sent), *stream.end()]
        if len(commands) != 1:
            return f"{len(commands)} telecommands"
        try:
            return read_command(commands[0])[0].name
        except InstrumentRefused:
            return f"service {commands[0].service}, subtype {commands[0].subtype}"

    def _count(self, record: int, question: str, ours: Told, theirs: Told) -> None:
        shape = _apart(ours.shape, theirs.shape)
        if shape is not None:
            kind: DifferenceKind = "shape"
            if ours.kind == "refusal":
                same = ours.shape["reason"] == theirs.shape["reason"]
                kind = "wording" if same else "error"
            elif ours.kind == "identity":
                kind = "text"
            self._differs(record, question, kind, *shape)
        elif ours.counts.size:
            self.tally.window(self.link, record, question, _name(ours), ours.counts, theirs.counts)
        elif (noise := _apart(ours.measured, theirs.measured)) is not None:
            self._differs(record, question, "measured", *noise)
        else:
            self.tally.equal(self.link, question, _name(ours))
        if ours.kind == "refusal" and ours.shape["reason"] == theirs.shape["reason"]:
            self.tally.error(self.link, int(str(ours.shape["reason"])))

    def _differs(
        self, record: int, question: str, kind: DifferenceKind, recorded: str, emulated: str
    ) -> None:
        self.tally.differs(self.link, question, Difference(record, kind, recorded, emulated))


def _apart(ours: Mapping[str, object], theirs: Mapping[str, object]) -> tuple[str, str] | None:
    """Return the fields that differ, of both; None when none does."""
    names = [name for name in {**ours, **theirs} if ours.get(name) != theirs.get(name)]
    if not names:
        return None
    recorded, emulated = (", ".join(f"{name} {said.get(name)}" for name in names) for said in (ours, theirs))
    return recorded, emulated


def _name(told: Told) -> str:
    if told.kind == "refusal":
        return f"refusal {told.shape['reason']}"
    if told.kind in ("identity", "unreadable"):
        return f"{told.kind} {told.shape['text']}"
    size = f" of {told.counts.size} samples" if told.kind == "window" else ""
    return told.kind + size


def _told(packets: Sequence[Telemetry]) -> list[Told]:
    """Take telemetry apart, and put the segments of a window together."""
    found: list[Told] = []
    assembler: WindowAssembler | None = None
    for packet in packets:
        try:
            answer = read_answer(packet)
            if isinstance(answer, WindowSegment):
                if answer.index == 0 or assembler is None:
                    assembler = WindowAssembler(answer.request_id, answer.shot)
                window = assembler.add(answer)
                if window is not None:
                    found.append(_window(window, answer.count))
            elif answer is not None:
                found.append(_report(answer))
            else:
                found.append(
                    Told(f"telemetry {packet.service}, {packet.subtype}", {"bytes": len(packet.data)})
                )
        except (CorruptData, StaleData) as error:
            found.append(Told("unreadable", {"text": str(error)}))
    return found


def _report(answer: Answer) -> Told:
    match answer:
        case Acknowledge():
            return Told("acknowledge", {})
        case Refusal(_, reason, text):
            return Told("refusal", {"reason": reason, "text": text})
        case IdentityReport(_, text):
            return Told("identity", {"text": text})
        case SpecReport(_, spec):
            return Told("spec", {one.name: getattr(spec, one.name) for one in fields(spec)})
        case HousekeepingReport(_, values):
            return Told("housekeeping", {"names": sorted(values)}, dict(values))
    raise TypeError(f"{type(answer).__name__} is no answer in one packet")


def _window(window: RangeWindow, segments: int) -> Told:
    shape = {name: getattr(window, name) for name in _WINDOW}
    shape |= {"samples": window.counts.size, "segments": segments, "names": sorted(window.housekeeping)}
    measured = {
        "saturated": window.saturated,
        "candidates": len(window.candidates),
        **{name: value for name, value in window.housekeeping.items()},
    }
    return Told("window", shape, measured, window.counts)


def reason_name(code: int) -> str:
    """Return the name of a reason to refuse; empty for a receiver's own."""
    return Reason(code).name if code in set(Reason) else ""
