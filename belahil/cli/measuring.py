"""The course of every measuring command: bench, plan, run folder, shots, analysis, results."""

from __future__ import annotations

import importlib
import sys
import time
import traceback
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from belahil.cli import replaying, signals
from belahil.cli.progress import shown
from belahil.errors import BelahilError, RefusedInput
from belahil.procedure_run import (
    claimed_source,
    log_dropped,
    typed_options,
    with_receiver,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from belahil.bench import Bench
    from belahil.cli.options import Common
    from belahil.recording import RecordedSession
    from belahil.run import Run


@dataclass(frozen=True, slots=True)
class Job:
    """A measuring command.

    Parameters
    ----------
    procedure : str
        Name in the summary, and of the module in ``procedures`` with its hyphens.
    options_type : str
        Name of its class of options.
    lines : callable
        Turns the results into the lines that a reader of the terminal wants.
    """

    procedure: str
    options_type: str
    lines: Callable[[dict[str, Any]], list[str]]


def perform(job: Job, given: Common, chosen: Mapping[str, Any], windows: Path | None = None) -> int:
    """Measure, or continue to measure, or take recorded windows; and tell the results.

    Parameters
    ----------
    job : Job
        What to do.
    given : Common
        The common options.
    chosen : mapping
        The procedure's own options; None where the user said nothing. A ``receiver`` is the run folder of a
        characterization, which is read here.
    windows : Path or None
        A data file that takes the place of measuring.

    Returns
    -------
    int
        0 passed or no verdict asked, 1 failed or undecided.
    """
    from belahil.run_folder import read_json

    chosen = with_receiver(chosen)
    if given.resume is not None:
        summary, folder = _measure_on(job, given, given.resume)
    elif windows is not None:
        summary, folder = _take(job, given, chosen, windows)
    else:
        summary, folder = _measure_new(job, given, chosen)
    if given.json:
        sys.stdout.write((folder / "summary.json").read_text(encoding="utf-8"))
    elif not given.quiet:
        for line in read_json(folder / "report.json").get("said") or job.lines(summary["results"]):
            print(line)
        if summary["verdict"] not in ("pass", "none"):
            print(*_not_passed(folder), sep="\n")
        print(f"verdict: {summary['verdict']}")
        print(f"report: {folder / 'report.html'}")
    return 0 if summary["verdict"] in ("pass", "none") else 1


def _not_passed(folder: Path) -> list[str]:
    """Tell each limit that failed or is undecided, and for which values."""
    from belahil.run_folder import read_json

    found: dict[str, list[str]] = {}
    for check in read_json(folder / "report.json")["checks"]:
        if check["decision"] != "pass":
            found.setdefault(f"{check['decision']}: {check['limit']}", []).append(check["label"])
    return [f"{limit} ({', '.join(labels)})" for limit, labels in found.items()]


def _measure_new(job: Job, given: Common, chosen: Mapping[str, Any]) -> tuple[dict[str, Any], Path]:
    from belahil.bench import open_bench
    from belahil.config import load_bench
    from belahil.recording import recorded_session
    from belahil.run_folder import refuse_used

    folder = given.out or dated(job.procedure)
    refuse_used(folder)
    replaying.check_record(given.record, folder)
    procedure = _module(job)
    config = load_bench(given.bench or "emulated")
    session = recorded_session(config)
    options = _options(procedure, job, replaying.filled(session, job.procedure, chosen))
    differs = replaying.differing(session, job.procedure, asdict(options))
    with ExitStack() as stack:
        stack.enter_context(replaying.compared(session, differs, given.quiet))
        with signals.closing(open_bench(config, seed=given.seed, record=given.record)) as bench:
            plan = procedure.plan(bench, options)
            bench.links.note("run", {"procedure": job.procedure, "options": asdict(options)})
            run = stack.enter_context(_begun(job, folder, bench, plan, options, session))
            stack.enter_context(_noted(run))
            if given.record is not None:
                run.log(f"recorded in {given.record}")
            if given.out is None and not given.json:
                print(f"run folder: {folder}", flush=True)
            _measure(procedure, bench, run, plan, given)
        return _finish(procedure, job, run, plan, given), folder


def _begun(
    job: Job, folder: Path, bench: Bench, plan: Any, options: Any, session: RecordedSession | None
) -> Run:
    from belahil.run import Run

    seed = None if bench.source == "hardware" else bench.config.emulation.seed
    run = Run.create(
        folder,
        job.procedure,
        bench.config,
        asdict(options),
        session.seed if session else seed,
        plan=plan.as_json(),
        instruments=bench.identities,
        source=claimed_source(bench),
        digitizer=bench.spec,
    )
    if session is not None:
        run.log(f"replay of {session}")
    return run


def _measure_on(job: Job, given: Common, folder: Path) -> tuple[dict[str, Any], Path]:
    from belahil.bench import open_bench
    from belahil.run import Run
    from belahil.run_folder import read_json

    with Run.resume(folder) as run:
        if run.begun.procedure != job.procedure:
            raise RefusedInput(
                f"--resume {folder}: holds a run of {run.begun.procedure}; "
                f"use belahil {run.begun.procedure} --resume {folder}"
            )
        if run.finished:
            return read_json(folder / "summary.json"), folder
        procedure = _module(job)
        with _noted(run):
            if run.begun.recorded:
                return _finish_taken(procedure, job, given, run), folder
            if run.config.source == "replay":
                raise RefusedInput(
                    f"--resume {folder}: is a replay, which has to begin with its recording; "
                    f"use --bench {run.config.generator.address} with another --out"
                )
            with signals.closing(open_bench(run.config)) as bench:
                plan = procedure.plan(bench, _options(procedure, job, run.begun.options))
                run.confirm(plan.as_json(), bench.identities)
                _measure(procedure, bench, run, plan, given)
            return _finish(procedure, job, run, plan, given), folder


def _take(job: Job, given: Common, chosen: Mapping[str, Any], windows: Path) -> tuple[dict[str, Any], Path]:
    """Begin a run with the windows of a data file."""
    from belahil.config import BenchConfig, load_bench
    from belahil.recorded import read_windows
    from belahil.run import Run
    from belahil.run_folder import refuse_used

    if given.seed is not None:
        raise RefusedInput(f"--seed {given.seed}: recorded windows have no seed; leave it out")
    if given.record is not None:
        raise RefusedInput(f"--record {given.record}: windows of a file cross no link; leave it out")
    folder = given.out or dated(job.procedure)
    refuse_used(folder)
    recorded = read_windows(windows)
    procedure = _module(job)
    options = _options(procedure, job, chosen)
    beside = windows.parent / "bench.toml"
    config = BenchConfig()
    if given.bench is not None or beside.is_file():
        config = load_bench(given.bench or str(beside))
    plan = procedure.recorded_plan(recorded, options)
    run = Run.create(
        folder,
        job.procedure,
        config,
        asdict(options),
        None,
        plan=plan.as_json(),
        instruments=recorded.instruments,
        source=recorded.source,
        digitizer=recorded.spec,
        recorded=windows,
    )
    with run, _noted(run):
        if given.out is None and not given.json:
            print(f"run folder: {folder}", flush=True)
        return _finish_taken(procedure, job, given, run), folder


def _finish_taken(procedure: Any, job: Job, given: Common, run: Run) -> dict[str, Any]:
    """Copy the recorded windows that the run does not hold yet, and analyse all."""
    from belahil.recorded import read_windows

    recorded = read_windows(run.begun.recorded)
    plan = procedure.recorded_plan(recorded, _options(procedure, job, run.begun.options))
    run.confirm(plan.as_json(), recorded.instruments)
    with signals.deferred(), shown(given.quiet, kept=len(run.shots())) as progress:
        for place, shot in enumerate(recorded):
            run.shot(recorded.request(place), lambda one=shot: one)  # type: ignore[misc]
            progress(place + 1, len(recorded))
    signals.check()
    return _finish(procedure, job, run, plan, given)


def _module(job: Job) -> Any:
    return importlib.import_module(f"procedures.{job.procedure.replace('-', '_')}")


def dated(procedure: str) -> Path:
    """Return the run folder of who names none."""
    return Path(f"belahil-{procedure}-{datetime.now(UTC):%Y%m%dT%H%M%SZ}")


def _options(procedure: Any, job: Job, told: Mapping[str, Any]) -> Any:
    return typed_options(getattr(procedure, job.options_type), told)


def _measure(procedure: Any, bench: Bench, run: Run, plan: Any, given: Common) -> None:
    begun = time.monotonic()
    try:
        with signals.deferred(), shown(given.quiet, kept=len(run.shots())) as progress:

            def kept(done: int, of: int) -> None:
                bench.links.check()
                progress(done, of)

            procedure.measure(bench, run, plan, kept)
    finally:
        log_dropped(run, bench)
    signals.check()
    if run.measured:
        each_ms = 1e3 * (time.monotonic() - begun) / run.measured
        pace = (
            f"{run.measured} windows, {each_ms:.2f} ms each, "
            f"of which {1e3 * run.fsync_s / run.measured:.2f} ms waiting for the disk"
        )
        run.log(pace)
        if not given.quiet:
            print(pace, file=sys.stderr)


def _finish(procedure: Any, job: Job, run: Run, plan: Any, given: Common) -> dict[str, Any]:
    from belahil.circumstances import conditions, not_modelled
    from belahil.verdict import not_judged

    def tell(step: str) -> None:
        if not given.quiet:
            print(step, file=sys.stderr, flush=True)

    tell("analysing")
    outcome = procedure.analyse(plan, run.shots(), run.config)
    left = not_judged(run.config.limits, outcome.verdict_values)
    said = [*job.lines(outcome.results), *_assumed(run), *([left] if left else [])]
    outcome = replace(outcome, said=said, notes=[*outcome.notes, *([f"{left}."] if left else [])])
    return run.finish(outcome, conditions(run), not_modelled(run), tell)


def _assumed(run: Run) -> list[str]:
    """Tell which receiver a procedure that compares with a known one took for it."""
    from procedures.known_receiver import preset_receiver

    if "receiver" not in run.begun.options:
        return []
    known = run.begun.options["receiver"]
    return [f"receiver assumed: {known['origin'] if known else preset_receiver(run.config).origin}"]


@contextmanager
def _noted(run: Run) -> Iterator[None]:
    """Write what went wrong into the log, and say on the error how to go on."""
    try:
        yield
    except BaseException as error:
        kept = f"{len(run.shots())} shots are kept"
        if run.config.source != "replay":
            kept += f"; continue with: belahil {run.begun.procedure} --resume {run.folder}"
        if isinstance(error, signals.Interrupted):
            run.log("interrupted")
            error.add_note(kept)
        elif isinstance(error, BelahilError):
            run.log("\n".join([f"stopped: {error}", *getattr(error, "excerpt", ())]))
            error.add_note(kept)
        else:
            run.log("internal error\n" + traceback.format_exc())
            error.add_note(f"traceback in {run.folder / 'log.txt'}; {kept}")
        raise
