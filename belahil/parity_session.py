"""A whole recording beside emulated instruments, in the order of its records."""

from __future__ import annotations

import re
from contextlib import closing
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from belahil.errors import RefusedInput, StorageError
from belahil.oscilloscopes import SCOPES
from belahil.parity_grm import GrmTalk
from belahil.parity_scpi import SAMPLES, ScpiTalk
from belahil.parity_talk import Answering, Talk
from belahil.parity_tally import Tally
from belahil.recording_file import Record, RecordingReader

if TYPE_CHECKING:
    from belahil.interfaces import Clock
    from belahil.parity import Parity
    from belahil.recording import RecordedSession

_IDENTITY = re.compile(rb"(?:^|;)([^;\n]*,[^;\n]*,[^;\n]*,[^;\n]*)\r?\n")
_VERBS = ("open", "write", "read", "clear", "close")


@dataclass(frozen=True, slots=True)
class Introduced:
    """Who answered in a recording, and how.

    Parameters
    ----------
    identities : dict
        By link; empty where nobody said who he is.
    framings : dict
        By link, as the links were opened: ``lines``, ``cobs`` or ``raw``.
    """

    identities: dict[str, str]
    framings: dict[str, str]


class Instruments(Protocol):
    """Emulated instruments on one plant."""

    @property
    def clock(self) -> Clock:
        """Time of the plant."""
        ...

    @property
    def generator(self) -> Answering:
        """Stands for the recorded generator."""
        ...

    @property
    def digitizer(self) -> Answering:
        """Stands for the recorded receiver or oscilloscope."""
        ...


def introduced(session: RecordedSession) -> Introduced:
    """Find out who answered in a recording.

    Raises
    ------
    StorageError
        It is damaged before the instruments had answered.
    """
    identities: dict[str, str] = dict(session.instruments)
    framings: dict[str, str] = {}
    asked: dict[str, bytes] = {}
    with closing(RecordingReader(session.path)) as reader:
        for record, data in reader:
            if record.kind == "open" and record.error is None:
                framings[record.link] = data.decode("ascii", "replace")
            elif record.kind == "write":
                asked[record.link] = data
            elif record.kind == "read" and b"*IDN?" in asked.get(record.link, b""):
                found = _IDENTITY.search(data)
                if found is not None:
                    identities.setdefault(record.link, found[1].decode("latin-1").strip())
            if len(framings) == 2 and len(identities) == 2:
                break
    return Introduced(identities, framings)


def compared(session: RecordedSession, framings: dict[str, str], there: Instruments, examples: int) -> Parity:
    """Write what was written to emulated instruments, and compare what they answer with what was read.

    Parameters
    ----------
    session : RecordedSession
        Of the recording.
    framings : dict
        See `Introduced`.
    there : Instruments
        Fresh ones.
    examples : int
        Differences that are kept for each question.

    Returns
    -------
    Parity
        A recording that was cut short or is damaged is compared as far as it goes.

    Raises
    ------
    RefusedInput
        Nothing was answered in it.
    """
    tally = Tally(examples)
    talks = _talks(session, framings, there, tally)
    begun_s: float | None = None
    whole, last = False, ""
    with closing(RecordingReader(session.path)) as reader:
        try:
            for record, data in reader:
                whole = whole or record.kind == "end"
                if record.kind not in _VERBS or record.link not in talks:
                    continue
                begun_s = record.began_s if begun_s is None else begun_s
                there.clock.sleep_s(record.began_s - begun_s - there.clock.now_s())
                last = record.link
                _follow(talks, reader.count, record, data, tally)
            if not whole:
                cut = "in the middle of a record" if reader.torn else "without its last record"
                tally.event(reader.count, "", f"the recording ends {cut}: it was cut short")
        except StorageError as error:
            tally.event(reader.count, "", str(error))
        if not whole and last:
            talks[last].drop()
    for talk in talks.values():
        talk.finish()
        talk.flush()
    found = tally.parity()
    if not found.count and not found.events:
        raise RefusedInput(f"{session.path}: holds no answer to compare")
    return found


def _talks(
    session: RecordedSession, framings: dict[str, str], there: Instruments, tally: Tally
) -> dict[str, Talk]:
    real = session.source == "hardware"
    talks: dict[str, Talk] = {"generator": ScpiTalk("generator", there.generator, tally, real)}
    driver = session.config.digitizer.driver
    if driver in SCOPES:
        talks["digitizer"] = ScpiTalk("digitizer", there.digitizer, tally, real, SAMPLES[driver])
    else:
        framing = "raw" if framings.get("digitizer") == "raw" else "cobs"
        talks["digitizer"] = GrmTalk("digitizer", there.digitizer, tally, real, framing)  # type: ignore[arg-type]
    return talks


def _follow(talks: dict[str, Talk], number: int, record: Record, data: bytes, tally: Tally) -> None:
    """Do to the emulated instrument what was done to the recorded one."""
    talk = talks[record.link]
    if record.kind == "read":
        return talk.read(number, record, data)
    if record.kind == "write":
        for other in talks.values():
            if other is not talk:
                # What one instrument is told may end what the other one waits for.
                other.end_wait()
        return talk.write(number, record, data)
    if record.kind == "clear":
        return talk.clear(number, record)
    if record.error is not None:
        tally.event(number, record.link, f"{record.kind}: {record.error[0]}: {record.error[1]}")
    talk.finish()
    talk.flush()
