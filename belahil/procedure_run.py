"""A procedure from Python: measured on an open bench, into a run folder, with a verdict.

It is what a measuring command of the command line does, without a terminal.
"""

from __future__ import annotations

import importlib
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from belahil.errors import BelahilError, RefusedInput

if TYPE_CHECKING:
    from collections.abc import Mapping

    from belahil.bench import Bench
    from belahil.config import BenchConfig, LimitsTable
    from belahil.run import Run

PROCEDURES = (
    "characterize",
    "noise",
    "tx-delay",
    "digitizer",
    "arrival-time",
    "energy-calibration",
    "rfm-parity",
    "pulse-shape",
    "tof-linearity",
)
"""All procedures that measure on a bench, by the names of their commands."""

_TOLD = 3


@dataclass(frozen=True, slots=True)
class ProcedureRun:
    """What a procedure left.

    Parameters
    ----------
    folder : Path
        The run folder.
    summary : dict
        As in its ``summary.json``.
    """

    folder: Path
    summary: dict[str, Any]

    @property
    def procedure(self) -> str:
        """Name of the procedure."""
        return str(self.summary["procedure"])

    @property
    def results(self) -> dict[str, Any]:
        """What was measured."""
        found: dict[str, Any] = self.summary["results"]
        return found

    @property
    def verdict(self) -> str:
        """``pass``, ``fail``, ``undecided``, or ``none`` where nobody asked."""
        return str(self.summary["verdict"])

    @property
    def passed(self) -> bool:
        """Whether nothing failed and nothing is undecided; also where no verdict was asked for."""
        return self.verdict in ("pass", "none")

    def __str__(self) -> str:
        """Say procedure, verdict, what did not pass, and the run folder, in one line."""
        open_ones = [check for check in self.summary["checks"] if check["verdict"] != "pass"]
        told = [_told(check) for check in open_ones[:_TOLD]]
        more = len(open_ones) - len(told)
        told += [f"and {more} more"] if more else []
        why = f": {'; '.join(told)}" if told else ""
        return f"{self.procedure}: verdict {self.verdict}{why}; run folder: {self.folder}"


def _told(check: Mapping[str, Any]) -> str:
    from belahil.report.tables import one_text, span_text

    low, high = (
        bound if check[end] is None else check[end]
        for end, bound in (("low", float("-inf")), ("high", float("inf")))
    )
    measured = "nothing measured" if check["measured"] is None else one_text(check["measured"])
    return (
        f"{check['limit']} ({check['label']}) = {measured}, "
        f"allowed {span_text(check['limit'], low, high)} ({check['verdict']})"
    )


def run_procedure(
    procedure: str,
    bench: Bench,
    folder: str | Path,
    options: Mapping[str, Any] | None = None,
    *,
    limits: LimitsTable | None = None,
) -> ProcedureRun:
    """Measure a procedure on an open bench, analyse it, and write its run folder.

    Parameters
    ----------
    procedure : str
        One of `PROCEDURES`.
    bench : Bench
        Open; it stays so.
    folder : str or Path
        The run folder, new or empty.
    options : mapping or None
        Those of the procedure, by the names and in the units of its class of options. A ``receiver`` is the
        run folder of a characterization.
    limits : LimitsTable or None
        In place of those of the bench.

    Raises
    ------
    RefusedInput
        There is no such procedure or option, the folder is not empty, or bench or interlock refuse the plan.
    InstrumentError
        An instrument or a link failed; the windows so far are in the folder.
    StorageError
        The folder could not be written.
    """
    from belahil.circumstances import conditions, not_modelled
    from belahil.recording import recorded_session
    from belahil.run import Run
    from belahil.run_folder import refuse_used
    from belahil.verdict import not_judged

    folder = Path(folder)
    refuse_used(folder)
    module = _module(procedure)
    # The type that its plan takes: the module's own class of options.
    kind = getattr(module, module.plan.__annotations__["options"])
    chosen = typed_options(kind, with_receiver(options or {}))
    plan = module.plan(bench, chosen)
    config = bench.config if limits is None else _with_limits(bench, limits)
    session = recorded_session(config)
    seed = None if bench.source == "hardware" else config.emulation.seed
    bench.links.note("run", {"procedure": procedure, "options": asdict(chosen)})
    with Run.create(
        folder,
        procedure,
        config,
        asdict(chosen),
        session.seed if session else seed,
        plan=plan.as_json(),
        instruments=bench.identities,
        source=claimed_source(bench),
        digitizer=bench.spec,
    ) as run:
        try:
            module.measure(bench, run, plan, lambda done, of: bench.links.check())
            outcome = module.analyse(plan, run.shots(), config)
            left = not_judged(config.limits, outcome.verdict_values)
            outcome = replace(outcome, notes=[*outcome.notes, *([f"{left}."] if left else [])])
            summary = run.finish(outcome, conditions(run), not_modelled(run))
        except BelahilError as error:
            run.log(f"stopped: {error}")
            error.add_note(f"{len(run.shots())} shots are kept in {folder}")
            raise
        finally:
            log_dropped(run, bench)
    return ProcedureRun(folder, summary)


def _module(procedure: str) -> Any:
    if procedure not in PROCEDURES:
        raise RefusedInput(f"procedure {procedure!r} is unknown; allowed: {', '.join(PROCEDURES)}")
    # By name: belahil imports none of the other rooms.
    return importlib.import_module(f"procedures.{procedure.replace('-', '_')}")


def with_receiver(options: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the options with what a characterization found, as plain values, as a resumed run reads them."""
    folder = options.get("receiver")
    if folder is None:
        return options
    known = importlib.import_module("procedures.known_receiver").characterized_receiver(Path(folder))
    return {**options, "receiver": asdict(known)}


def typed_options(kind: type[Any], told: Mapping[str, Any]) -> Any:
    """Make a procedure's options of plain values; None where the user said nothing.

    Raises
    ------
    RefusedInput
        No option has that name, or a value is of another type.
    """
    from msgspec import ValidationError, convert

    names = [field.name for field in fields(kind)]
    for name in told:
        if name not in names:
            raise RefusedInput(f"option {name!r} is unknown; allowed: {', '.join(names)}")
    try:
        return convert({key: value for key, value in told.items() if value is not None}, kind)
    except ValidationError as error:
        raise RefusedInput(f"options {dict(told)}: {error}") from error


def _with_limits(bench: Bench, limits: LimitsTable) -> BenchConfig:
    """Return a bench's configuration with other ``[limits]``."""
    from msgspec.structs import replace as replaced

    from belahil.config import check_bench

    config = replaced(bench.config, limits=limits)
    check_bench(config)
    return config


def claimed_source(bench: Bench) -> str:
    """Tell emulated instruments behind a real address by the name that they give themselves."""
    named = " ".join(bench.identities.values()).lower()
    return "emulated" if bench.source == "hardware" and "emulat" in named else bench.source


def log_dropped(run: Run, bench: Bench) -> None:
    """Note in the log what the receiver's link dropped, if anything."""
    dropped = bench.link_counts
    if dropped.damaged or dropped.stale:
        run.log(f"the receiver's link dropped {dropped.damaged} damaged and {dropped.stale} stale packets")
