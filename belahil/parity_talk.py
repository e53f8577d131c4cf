"""One link of a recording beside an emulated instrument: the same bytes go in, both answers are kept."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from belahil.parity_tally import Tally
    from belahil.recording_file import Record


class Answering(Protocol):
    """An emulated instrument without a line before it."""

    def write(self, data: bytes) -> None:
        """Take bytes as they were written."""
        ...

    def read(self) -> bytes:
        """Give what it has to say now, one whole message where it knows messages; empty: nothing."""
        ...

    def clear(self) -> None:
        """Drop what is on its way."""
        ...

    @property
    def error_count(self) -> int:
        """Entries in its error queue."""
        ...


@dataclass
class Exchange:
    """What was written at once, and what both instruments said to it.

    Parameters
    ----------
    record : int
        Number of the record that wrote it.
    sent : bytes
        What was written.
    recorded, emulated : bytes
        What was read until something else was written; what the emulated instrument says.
    asked : bool
        Whether anybody read.
    recorded_s, emulated_s : float
        Real time from the write to the last byte, s; how long the emulated instrument took, s.
    raised_by : tuple of str
        For each emulated error that waited when this was written: the message that raised it.
    ends_wait : bool
        Whether the other instrument was told something before this one was asked again.
    """

    record: int
    sent: bytes
    recorded: bytes = b""
    emulated: bytes = b""
    asked: bool = False
    recorded_s: float = 0.0
    emulated_s: float = 0.0
    raised_by: tuple[str, ...] = ()
    ends_wait: bool = False


class Talk:
    """One link; what answers mean is for those who derive from it.

    Parameters
    ----------
    link : str
        Name of the link.
    instrument : Answering
        Stands for the recorded one.
    tally : Tally
        Counts.
    real_clock : bool
        Whether the clock of the recorded bench was a real one, so that a verb's own duration is known.
    """

    takes_all = False
    """Whether each read takes all that the emulated instrument has to say by then."""

    def __init__(self, link: str, instrument: Answering, tally: Tally, real_clock: bool) -> None:
        self.link = link
        self.instrument = instrument
        self.tally = tally
        self._real_clock = real_clock
        self._in_step = True
        self._open: Exchange | None = None
        self._written_s = 0.0

    def write(self, number: int, record: Record, data: bytes) -> None:
        """Write what was written; what a failed write brought to the recorded instrument is not known."""
        self.finish()
        if record.error is not None:
            return self._lose(number, record)
        begun_s = time.perf_counter()
        self.instrument.write(data)
        spent_s = time.perf_counter() - begun_s
        self._written_s = record.elapsed_s - self._duration_s(record)
        self._open = Exchange(number, data, emulated_s=spent_s, raised_by=self.raised_by(data))

    def read(self, number: int, record: Record, data: bytes) -> None:
        """Keep what was read, and read of the emulated instrument what it has to say."""
        if record.error is not None:
            return self._lose(number, record)
        found = self._open
        if found is None:
            return
        found.asked = True
        if data:
            found.recorded += data
            found.recorded_s = record.elapsed_s - self._written_s
        # A message comes whole here, and in pieces from a bus; once it is there, nothing more is asked for.
        if self.takes_all or not found.emulated:
            begun_s = time.perf_counter()
            found.emulated += self.instrument.read()
            found.emulated_s += time.perf_counter() - begun_s

    def clear(self, number: int, record: Record) -> None:
        """Clear the emulated instrument too: from here on both are in step again."""
        self.finish()
        if record.error is not None:
            return self._lose(number, record)
        self.instrument.clear()
        self._in_step = True

    def finish(self) -> None:
        """Compare what has been answered since the last write."""
        found, self._open = self._open, None
        if found is None:
            return
        if self._in_step:
            self.compare(found)
        elif found.asked:
            self.tally.passed_over += 1

    def flush(self) -> None:
        """Compare what was held back."""

    def end_wait(self) -> None:
        """Take notice that the other instrument is told something, which may be what this one waits for."""
        self.flush()
        if self._open is not None:
            self._open.ends_wait = True

    def drop(self) -> None:
        """Forget the exchange that the end of the recording cut short."""
        if self._open is not None and self._open.asked:
            self.tally.passed_over += 1
        self._open = None

    def raised_by(self, data: bytes) -> tuple[str, ...]:
        """Return which messages raised the emulated errors that waited when `data` was written."""
        return ()

    def compare(self, exchange: Exchange) -> None:
        """Count what both said."""
        raise NotImplementedError

    def _lose(self, number: int, record: Record) -> None:
        assert record.error is not None
        kind, message = record.error
        self.tally.event(number, self.link, f"{record.kind}: {kind}: {message}")
        if self._open is not None and self._open.asked:
            self.tally.passed_over += 1
        self._open = None
        self.flush()
        self._in_step = False

    def _duration_s(self, record: Record) -> float:
        return record.ended_s - record.began_s if self._real_clock else 0.0
