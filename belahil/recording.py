"""Recording: every byte that crosses the links of a bench goes into one file (``docs/recording.md``)."""

from __future__ import annotations

import json
import time
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import msgspec
from msgspec.structs import replace

from belahil.config import REPLAY, BenchConfig, EmulationTable, as_toml, parse_bench
from belahil.errors import ConfigError, StorageError
from belahil.fingerprint import plain
from belahil.link_source import LEFT_ON
from belahil.provenance import belahil_version, command_line
from belahil.recording_file import Record, RecordingReader, RecordingWriter

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from belahil.interfaces import Clock, Link
    from belahil.recording_file import Kind

CONVERSATION = 2
"""What drivers say, and in which order: another number cannot be replayed. 1 opened the generator first."""

T = TypeVar("T")


class Recorder:
    """A source of links that writes down what crosses them.

    Parameters
    ----------
    path : str or Path
        A file that is not there yet.
    config : BenchConfig
        The bench; its ``[emulation]``, but for the seed, is left out.
    clock : Clock
        Of the bench; `clock` is the one to use instead.

    Attributes
    ----------
    clock : Clock
        Tells the time of the bench, and writes down what it told.

    Raises
    ------
    RefusedInput
        The file is there already.
    StorageError
        It cannot be made.
    """

    left_on = LEFT_ON

    def __init__(self, path: str | Path, config: BenchConfig, clock: Clock) -> None:
        self.clock = _RecordedClock(clock)
        self._begun = time.perf_counter()
        self._closed = False
        self._file = RecordingWriter(Path(path))
        self.note("header", plain(_header(config)))

    def opened(self, name: str, open_link: Callable[[], tuple[Link, str]]) -> tuple[Link, str]:
        """Open a link and record it from then on."""
        began_s = self.clock.real.now_s()
        try:
            link, framing = open_link()
        except BaseException as error:
            self._put(Record("open", name, began_s, error=_told(error)))
            raise
        self._put(Record("open", name, began_s), framing.encode())
        return _RecordedLink(self, name, link), framing

    def note(self, kind: Kind, facts: Mapping[str, Any]) -> None:
        """Write a record of facts, as JSON in its bytes."""
        self._put(Record(kind, began_s=self.clock.real.now_s()), json.dumps(plain(facts)).encode())

    def leaving(self) -> None:
        """Write that the bench is being closed."""
        self._put(Record("closing", began_s=self.clock.real.now_s()))

    def check(self) -> None:
        """Raise when the file could not be written."""
        if self._file.failed is not None:
            raise self._file.failed

    def close(self) -> None:
        """Write the last record and let go of the file."""
        if not self._closed:
            self._closed = True
            self._put(Record("end", began_s=self.clock.real.now_s()))
            self._file.close()

    def carried_out(self, verb: Callable[[], T], kind: Kind, link: str, sent: bytes = b"", **asked: Any) -> T:
        """Carry out a verb of a link and write down what came of it."""
        began_s = self.clock.real.now_s()
        try:
            answer = verb()
        except BaseException as error:
            self._put(Record(kind, link, began_s, error=_told(error), **asked), sent)
            raise
        self._put(Record(kind, link, began_s, **asked), answer if isinstance(answer, bytes) else sent)
        return answer

    def _put(self, record: Record, data: bytes = b"") -> None:
        self._file.append(
            Record(
                record.kind,
                record.link,
                record.began_s,
                self.clock.real.now_s(),
                time.perf_counter() - self._begun,
                record.count,
                record.timeout_s,
                self.clock.taken(),
                record.error,
            ),
            data,
        )


def _told(error: BaseException) -> tuple[str, str]:
    return type(error).__name__, str(error).encode("utf-8", "replace").decode()


class _RecordedClock:
    def __init__(self, real: Clock) -> None:
        self.real = real
        self._told: list[float] = []

    def now_s(self) -> float:
        self._told.append(self.real.now_s())
        return self._told[-1]

    def sleep_s(self, duration_s: float) -> None:
        self.real.sleep_s(duration_s)

    def taken(self) -> tuple[float, ...]:
        """Return what was told since this was asked last."""
        told = tuple(self._told)
        self._told.clear()
        return told


class _RecordedLink:
    def __init__(self, recorder: Recorder, name: str, link: Link) -> None:
        self._recorder = recorder
        self._name = name
        self._link = link

    def write(self, data: bytes) -> None:
        self._recorder.carried_out(partial(self._link.write, data), "write", self._name, data)

    def read(self, count: int, timeout_s: float) -> bytes:
        verb = partial(self._link.read, count, timeout_s)
        return self._recorder.carried_out(verb, "read", self._name, count=count, timeout_s=timeout_s)

    def clear(self) -> None:
        self._recorder.carried_out(self._link.clear, "clear", self._name)

    def close(self) -> None:
        self._recorder.carried_out(self._link.close, "close", self._name)


class _Header(msgspec.Struct, frozen=True):
    belahil: str
    started: str
    command: str
    source: str
    seed: int | None
    bench: str
    conversation: int = 1


def _header(config: BenchConfig) -> _Header:
    return _Header(
        belahil_version(),
        datetime.now(UTC).isoformat(timespec="milliseconds"),
        command_line(),
        config.source,
        None if config.source == "hardware" else config.emulation.seed,
        as_toml(config, without=("emulation",)),
        CONVERSATION,
    )


@dataclass(frozen=True, slots=True)
class RecordedSession:
    """What a recording tells of the session that it holds.

    Parameters
    ----------
    path : Path
        Of the file.
    belahil, started, command : str
        Version that recorded it, UTC date in ISO 8601, what the user typed.
    source : str
        ``emulated`` or ``hardware``.
    seed : int or None
        Of the emulation; None where real addresses answered.
    config : BenchConfig
        The bench with its recording in place of its instruments.
    recorded : BenchConfig
        The bench as it was used; of its ``[emulation]`` only the seed is known.
    instruments : dict
        Who answered, by link; empty where the bench did not open.
    procedure : str
        Empty when none was begun.
    options : dict
        Of the procedure, as plain values.
    conversation : int
        See `CONVERSATION`.
    """

    path: Path
    belahil: str
    started: str
    command: str
    source: str
    seed: int | None
    config: BenchConfig
    recorded: BenchConfig
    instruments: dict[str, str]
    procedure: str = ""
    options: dict[str, Any] | None = None
    conversation: int = CONVERSATION

    def check_replayable(self) -> None:
        """Refuse a session whose drivers spoke otherwise than those of today.

        Raises
        ------
        ConfigError
            With what to do.
        """
        if self.conversation != CONVERSATION:
            raise ConfigError(
                f"{self.path}: its drivers spoke otherwise (conversation {self.conversation}) than those of "
                f"today ({CONVERSATION}), so it cannot be replayed; a belahil of {self.started[:10]} can "
                f"(it says {self.belahil}), and `belahil bench parity` reads it"
            )

    def __str__(self) -> str:
        """One line for people."""
        return (
            f"{self.path}, begun {self.started} on the {self.source} bench with belahil {self.belahil}: "
            f"{self.command}"
        )


def read_session(path: str | Path) -> RecordedSession:
    """Read what a recording tells of its session.

    Raises
    ------
    ConfigError
        It is no recording, or one in another version of the format.
    StorageError
        It has no complete header, or is damaged there.
    """
    path = Path(path).absolute()
    run: dict[str, Any] = {}
    with closing(RecordingReader(path)) as reader:
        records = iter(reader)
        record, data = next(records, (Record("end"), b""))
        if record.kind != "header":
            raise StorageError(f"{path}: has no complete header; nothing was recorded")
        try:
            header = msgspec.json.decode(data, type=_Header)
        except msgspec.DecodeError as error:
            raise StorageError(f"{path}: its header is damaged: {error}") from error
        instruments: dict[str, str] = {}
        for record, data in records:
            if record.kind == "run":
                run = json.loads(data)
            if record.kind == "instruments":
                instruments = json.loads(data)
            # A run is noted between the opening of the bench and its first exchange.
            if run or (instruments and record.link) or record.kind == "closing":
                break
    bench = parse_bench(header.bench, f"bench in {path}")
    if header.seed is not None:
        bench = replace(bench, emulation=EmulationTable(seed=header.seed))
    return RecordedSession(
        path,
        header.belahil,
        header.started,
        header.command,
        header.source,
        header.seed,
        _replaying(bench, path),
        bench,
        instruments,
        run.get("procedure", ""),
        run.get("options"),
        header.conversation,
    )


def _replaying(config: BenchConfig, path: Path) -> BenchConfig:
    """Return a bench with a recording in place of its instruments."""
    place = f"{REPLAY}{path}"
    return replace(
        config,
        generator=replace(config.generator, address=place, visa_library=""),
        digitizer=replace(config.digitizer, link=place),
    )


def recorded_session(config: BenchConfig) -> RecordedSession | None:
    """Return what the recording that a bench replays tells of itself; None for any other bench."""
    if config.source != "replay":
        return None
    return read_session(config.generator.address.removeprefix(REPLAY))
