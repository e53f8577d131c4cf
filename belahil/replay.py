"""Replay: the drivers of a bench run on a recording, and the first difference stops them."""

from __future__ import annotations

from collections import deque
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from belahil import errors
from belahil.errors import InstrumentError, RecordingEnds, ReplayDiffers, StorageError
from belahil.link_source import LEFT_ON
from belahil.recording_file import Record, RecordingReader
from belahil.replay_excerpt import Exchange, differing, excerpt, named

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from belahil.interfaces import Link
    from belahil.recording_file import Kind

_BEFORE, _AFTER = 3, 2
_TELLING = ("header", "instruments", "run")


class Replay:
    """A source of links that answer as recorded, to those who ask as recorded.

    Nothing is opened, and nothing sleeps: the clock tells what it told when the session was recorded.

    Parameters
    ----------
    path : str or Path
        A recording.

    Attributes
    ----------
    clock : Clock
        Of the recorded session.

    Raises
    ------
    ConfigError
        It is no recording, or one in another version of the format.
    StorageError
        It is damaged at its beginning.
    """

    def __init__(self, path: str | Path) -> None:
        self.clock = _RecordedTime()
        self._reader = RecordingReader(Path(path))
        self._records = iter(self._reader)
        self._before: deque[Exchange] = deque(maxlen=_BEFORE)
        self._failure: InstrumentError | None = None
        self._next: Exchange | None = None
        try:
            self._advance()
        except StorageError:
            self._reader.close()
            raise

    @property
    def left_on(self) -> str:
        """What the recorded session told of its output; nothing when the replay itself failed."""
        return "" if self._failure else f"in the recorded session {LEFT_ON}"

    def opened(self, name: str, open_link: Callable[[], tuple[Link, str]]) -> tuple[Link, str]:
        """Return the recorded link of that name and its framing."""
        return _ReplayedLink(self, name), self.answer("open", name).decode()

    def note(self, kind: Any, facts: Mapping[str, Any]) -> None:
        """Nothing is noted."""

    def leaving(self) -> None:
        """Go on behind the mark where the recorded bench began to be closed."""
        if self._failure is None:
            if self._next is not None and self._next.record.kind == "closing":
                self._advance_or_fail()
            else:
                self._failure = self._other(Exchange(0, Record("closing"), b""))

    def check(self) -> None:
        """Raise the difference that could not be raised where it was found."""
        if self._failure is not None:
            raise self._failure

    def close(self) -> None:
        """Let go of the file; what was not replayed is kept for `check`."""
        if self._failure is None:
            if self._next is None or self._next.record.kind != "end":
                self._failure = self._other(Exchange(0, Record("end"), b""))
            else:
                self._advance_or_fail()
        if self._failure is None and self._next is not None:
            self._failure = InstrumentError(f"{self._reader.path}: goes on behind the end of its session")
        self._reader.close()

    def answer(self, kind: Kind, link: str, sent: bytes = b"") -> bytes:
        """Return what was recorded for a verb of a link.

        Raises
        ------
        ReplayDiffers
            Another verb, another link or other bytes were recorded here.
        InstrumentError
            As recorded; or the replay has failed before.
        """
        self.check()
        found, now = self._next, Exchange(0, Record(kind, link), sent)
        if found is None or not found.agrees(now):
            self._failure = self._other(now)
            raise self._failure
        self._advance_or_fail()
        self.clock.passed(found.record.ended_s)
        if found.record.error is not None:
            raise self._as_recorded(found, *found.record.error)
        return found.data

    def _as_recorded(self, found: Exchange, name: str, message: str) -> BaseException:
        kind = getattr(errors, name, None)
        if isinstance(kind, type) and issubclass(kind, errors.BelahilError):
            return kind(message)
        self._failure = RecordingEnds(
            f"{self._reader.path}, record {found.number}: the recorded session was broken off here by {name}"
        )
        return self._failure

    def _advance_or_fail(self) -> None:
        try:
            self._advance()
        except StorageError as error:
            # Drivers let an InstrumentError pass on their way to switching an output off.
            self._failure, self._next = InstrumentError(str(error)), None

    def _advance(self) -> None:
        if self._next is not None:
            self._before.append(self._next)
        self.clock.forget()
        for record, data in self._records:
            self.clock.told(record.clock_s)
            if record.kind not in _TELLING:
                self._next = Exchange(self._reader.count, record, data)
                return
        self._next = None

    def _other(self, now: Exchange) -> ReplayDiffers:
        """Tell how what comes now differs from what was recorded next."""
        path, found = self._reader.path, self._next
        if found is None:
            how = "in the middle of a record" if self._reader.torn else "without its last record"
            return RecordingEnds(
                f"{path}: the recording ends after record {self._reader.count}, {how}: it was cut short; "
                f"now comes {named(now)}",
                excerpt(self._before, None, now),
            )
        place = f"{path}, record {found.number}"
        if found.record.kind in ("closing", "end"):
            return RecordingEnds(
                f"{place}: the recorded session ends here, and now comes {named(now)}",
                excerpt(self._before, found, now),
            )
        lines = excerpt(self._before, found, now, self._following())
        if (found.record.link, found.record.kind) != (now.record.link, now.record.kind):
            return ReplayDiffers(f"{place}: recorded is {named(found)}, and now comes {named(now)}", lines)
        at = differing(found.data, now.data)
        return ReplayDiffers(f"{place}: {named(now)} differs from the recorded one at byte {at}", lines)

    def _following(self) -> list[Exchange]:
        with suppress(StorageError):
            return [Exchange(self._reader.count, *one) for one in islice(self._records, _AFTER)]
        return []


class _ReplayedLink:
    def __init__(self, replay: Replay, name: str) -> None:
        self._replay = replay
        self._name = name

    def write(self, data: bytes) -> None:
        self._replay.answer("write", self._name, data)

    def read(self, count: int, timeout_s: float) -> bytes:
        return self._replay.answer("read", self._name)

    def clear(self) -> None:
        self._replay.answer("clear", self._name)

    def close(self) -> None:
        try:
            self._replay.answer("close", self._name)
        except InstrumentError:
            return  # kept by the replay, and told when its bench is closed


class _RecordedTime:
    """Tells again what the recorded clock told, reading by reading; what is asked beyond stands still."""

    def __init__(self) -> None:
        self._now_s = 0.0
        self._readings: deque[float] = deque()

    def now_s(self) -> float:
        if self._readings:
            self._now_s = self._readings.popleft()
        return self._now_s

    def sleep_s(self, duration_s: float) -> None:
        self._now_s += max(0.0, duration_s)

    def told(self, readings: tuple[float, ...]) -> None:
        self._readings.extend(readings)

    def forget(self) -> None:
        self._readings.clear()

    def passed(self, now_s: float) -> None:
        self._now_s = now_s
