"""A run: the folder that holds everything of one execution of a procedure, and the only way to resume it.

A run is complete when ``summary.json`` is there, which is written last. Until then the journal holds the
shots, and `Run.resume` goes on with them.
"""

from __future__ import annotations

import json
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec import Struct, convert

from belahil.errors import RefusedInput, StorageError
from belahil.fingerprint import difference, facts, fingerprint, plain
from belahil.journal import Journal
from belahil.provenance import belahil_version, command_line, software
from belahil.receiver import DigitizerSpec
from belahil.run_folder import claim, journal_of, lock, read_bench, write_bench
from belahil.storage import write_whole
from belahil.verdict import checks, overall

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from types import TracebackType

    from belahil.config import BenchConfig
    from belahil.outcome import Outcome
    from belahil.storage import FolderLock
    from belahil.values import Shot, WindowRequest

SCHEMA = 1


def utc_now() -> str:
    """Now, ISO 8601, in UTC, to the millisecond."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


@dataclass(frozen=True, slots=True)
class Shots:
    """The shots of a run in the order of the plan, read from the disk one at a time, as often as asked."""

    journal: Journal

    def __len__(self) -> int:
        return len(self.journal)

    def __iter__(self) -> Iterator[Shot]:
        return (self.journal.read(shot)[1] for shot in self.journal)


class Begun(Struct, frozen=True):
    """What a run was begun with: the header of its journal.

    Parameters
    ----------
    procedure, seed, started, command
        Name, seed of the emulation if there is one, UTC date in ISO 8601, what the user typed.
    options : dict
        What the user chose, as plain values.
    source : str
        ``simulated``, ``emulated`` or ``hardware``.
    instruments : dict
        Who answered.
    facts : dict
        What must be unchanged in a resume; see `belahil.fingerprint`.
    digitizer : DigitizerSpec or None
        What the receiver reported of itself.
    recorded : str
        Data file whose windows this run analyses in place of measuring; else empty.
    """

    procedure: str
    seed: int | None
    started: str
    command: str
    options: dict[str, Any]
    source: str
    instruments: dict[str, str]
    facts: dict[str, Any]
    digitizer: DigitizerSpec | None = None
    recorded: str = ""


class Run:
    """A run folder, open for measuring; made by `create` or `resume`.

    Attributes
    ----------
    folder : Path
        Holds everything.
    config : BenchConfig
        The bench as used, seed included.
    begun : Begun
        What the run was begun with.
    measured : int
        Shots that were measured since this object was made, not read from the journal.
    """

    def __init__(self, folder: Path, lock: FolderLock, journal: Journal, config: BenchConfig) -> None:
        self.folder = folder
        self.config = config
        self.measured = 0
        self.begun = convert(journal.header, Begun)
        self._lock = lock
        self._journal = journal

    @classmethod
    def create(
        cls,
        folder: str | Path,
        procedure: str,
        config: BenchConfig,
        options: Mapping[str, Any],
        seed: int | None,
        *,
        plan: Mapping[str, Any] | None = None,
        instruments: Mapping[str, str] | None = None,
        source: str = "",
        digitizer: DigitizerSpec | None = None,
        recorded: str | Path = "",
        sync: bool = True,
    ) -> Run:
        """Begin a run in a new or empty folder.

        Parameters
        ----------
        folder : str or Path
            The run folder itself.
        procedure : str
            Name of the procedure.
        config : BenchConfig
            The bench as used.
        options : mapping
            What the user chose, as plain values; a resume reads it back.
        seed : int or None
            Of the emulation; None where real addresses answer.
        plan : mapping or None
            The plan as plain values; a resume must make an equal one.
        instruments : mapping or None
            Who answered.
        source : str
            ``simulated``, ``emulated`` or ``hardware``; that of `config` when empty.
        digitizer : DigitizerSpec or None
            What the receiver reported of itself.
        recorded : str or Path
            Data file whose windows are analysed in place of measuring.
        sync : bool
            Wait for the disk after each shot.

        Raises
        ------
        RefusedInput
            The folder has something in it.
        StorageError
            The folder cannot be made or written.
        """
        folder = Path(folder)
        with ExitStack() as undo:
            held = claim(folder)
            undo.callback(held.release)
            write_bench(folder, config)
            begun = Begun(
                procedure=procedure,
                seed=seed,
                started=utc_now(),
                command=command_line(),
                options=plain(options),
                source=source or config.source,
                instruments=dict(instruments or {}),
                facts=facts(procedure, plan or {}, config, seed),
                digitizer=digitizer,
                recorded=str(Path(recorded).absolute()) if recorded else "",
            )
            journal = Journal.create(journal_of(folder), plain(begun), sync=sync)
            undo.pop_all()
        run = cls(folder, held, journal, config)
        run.log(f"begun with belahil {belahil_version()}: {command_line()}")
        for part, identity in run.begun.instruments.items():
            run.log(f"{part}: {identity}")
        return run

    @classmethod
    def resume(cls, folder: str | Path, *, sync: bool = True) -> Run:
        """Go on with the run in a folder; everything is taken from it.

        Raises
        ------
        RefusedInput
            There is no run, another process has it, or an unfinished one was begun with another bench file
            or another version of belahil.
        StorageError
            It cannot be read.
        """
        folder = Path(folder)
        if not (folder / "journal").is_dir():
            raise RefusedInput(f"--resume {folder}: there is no run in this folder")
        with ExitStack() as undo:
            held = lock(folder)
            undo.callback(held.release)
            if not journal_of(folder).exists():
                raise RefusedInput(
                    f"--resume {folder}: the run ended before its first shot; "
                    "remove the folder and begin again"
                )
            journal = Journal(journal_of(folder), sync=sync)
            undo.callback(journal.close)
            run = cls(folder, held, journal, read_bench(folder))
            if not run.finished:
                run._confirm(facts(run.begun.procedure, None, run.config, run.begun.seed))
            undo.pop_all()
        if not run.finished:
            cut = f"; {journal.cut_bytes} bytes of a torn shot were cut" if journal.cut_bytes else ""
            run.log(f"resumed with {len(journal)} shots: {command_line()}{cut}")
        return run

    @property
    def fingerprint(self) -> str:
        """SHA-256 of everything that the shots depend on."""
        return fingerprint(self.begun.facts)

    @property
    def fsync_s(self) -> float:
        """Time spent waiting for the disk, s."""
        return self._journal.fsync_s

    @property
    def finished(self) -> bool:
        """Whether the results are there."""
        return (self.folder / "summary.json").is_file()

    def confirm(self, plan: Mapping[str, Any], instruments: Mapping[str, str]) -> None:
        """Refuse to go on with another plan, or with other instruments than the run was begun with.

        Raises
        ------
        RefusedInput
            With what differs.
        """
        self._confirm(facts(self.begun.procedure, plan, self.config, self.begun.seed))
        for part, identity in self.begun.instruments.items():
            if instruments.get(part) != identity:
                raise RefusedInput(
                    f"--resume {self.folder}: begun with the {part} {identity!r}; "
                    f"now {instruments.get(part)!r} answers"
                )

    def _confirm(self, now: Mapping[str, Any]) -> None:
        found = difference(self.begun.facts, now)
        if found is not None:
            raise RefusedInput(f"--resume {self.folder}: the run was begun otherwise: {found}")

    def shot(self, request: WindowRequest, measure: Callable[[], Shot], why: Callable[[], str] = str) -> Shot:
        """Return the kept shot of this request, or measure it and keep it.

        Parameters
        ----------
        request : WindowRequest
            Its `shot` is the index in the plan.
        measure : callable
            Called when the journal does not hold the shot.
        why : callable
            Tells the log why a shot had to be repeated.

        Raises
        ------
        StorageError
            The shot could not be written, or the journal holds the answer to another request.
        """
        if request.shot in self._journal:
            asked, kept = self._journal.read(request.shot)
            if asked != request:
                raise StorageError(
                    f"{self._journal.path}: shot {request.shot} answers {asked}, not {request}"
                )
            return kept
        shot = measure()
        self._journal.append(request, shot)
        self.measured += 1
        if shot.attempt > 1:
            reason = f": {why()}" if why() else ""
            self.log(f"shot {request.shot} came at attempt {shot.attempt}{reason}")
        return shot

    def shots(self) -> Shots:
        """All shots kept so far, in the order of their indexes; memory holds one at a time."""
        return Shots(self._journal)

    def log(self, line: str) -> None:
        """Add a line to ``log.txt``; a full disk must not end a run here."""
        with suppress(OSError), open(self.folder / "log.txt", "a", encoding="utf-8") as file:
            file.write(f"{utc_now()} {line}\n")

    def finish(
        self,
        outcome: Outcome,
        conditions: Mapping[str, str] | None = None,
        not_modelled: Sequence[str] = (),
        tell: Callable[[str], None] = lambda step: None,
    ) -> dict[str, Any]:
        """Write data file, figures, report and, last, the summary; return the summary.

        Parameters
        ----------
        outcome : Outcome
            From the procedure's analysis.
        conditions : mapping or None
            What else the report tells of the measurement, by name.
        not_modelled : sequence of str
            What an emulated or simulated bench leaves out, for the report.
        tell : callable
            Told "writing" and "drawing" when that begins.

        Raises
        ------
        StorageError
            A file could not be written; the journal is untouched.
        """
        from belahil.results import write_results

        found = [*outcome.checks, *checks(self.config.limits, outcome.verdict_values)]
        summary = {
            "schema": SCHEMA,
            "procedure": self.begun.procedure,
            "source": self.begun.source,
            "verdict": overall(found),
            "checks": [check.as_json() for check in found],
            "seed": self.begun.seed,
            "software": software(),
            "instruments": self.begun.instruments,
            "started": self.begun.started,
            "finished": utc_now(),
            "results": outcome.results,
        }
        text = json.dumps(summary, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
        conditions = {"fingerprint": self.fingerprint, **(conditions or {})}
        shots = self.shots()
        write_results(
            self.folder, summary, shots, outcome, found, conditions, not_modelled, tell, self.begun.digitizer
        )
        self.log(f"finished with {len(self._journal)} shots, verdict {summary['verdict']}")
        write_whole(self.folder / "summary.json", text)
        return summary

    def close(self) -> None:
        """Let go of the folder."""
        self._journal.close()
        self._lock.release()

    def __enter__(self) -> Run:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
