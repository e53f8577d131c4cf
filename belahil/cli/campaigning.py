"""The course of every campaign command: plan, folder, chunks, analysis, results."""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from belahil.cli import signals
from belahil.cli.measuring import dated
from belahil.cli.options import version_option
from belahil.cli.progress import shown
from belahil.errors import RefusedInput
from belahil.run_folder import read_json, refuse_used

if TYPE_CHECKING:
    from collections.abc import Iterator

    from belahil.campaign_run import CampaignPlan, CampaignRun
    from belahil.executors import Workers

F = TypeVar("F", bound=Callable[..., Any])


@dataclass(frozen=True, slots=True)
class Place:
    """Where a campaign is computed and kept; None where the user said nothing."""

    out: Path | None
    resume: Path | None
    workers: int | None
    cluster: str | None
    quiet: bool
    as_json: bool


def campaign_options(function: F) -> F:
    """Add ``--out --resume --workers --cluster --quiet --json --version`` to a campaign."""
    for option in reversed(
        (
            click.option(
                "--out",
                type=click.Path(path_type=Path),
                metavar="DIR",
                help="Folder, new or empty; a dated one here when left out.",
            ),
            click.option(
                "--resume",
                type=click.Path(path_type=Path),
                metavar="DIR",
                help="Go on with the campaign in this folder; its options are taken from it.",
            ),
            click.option(
                "--workers", type=click.IntRange(min=1), metavar="N", help="Processes; one for each core."
            ),
            click.option(
                "--cluster", metavar="tcp://HOST:PORT", help="Compute on the workers of a dask scheduler."
            ),
            click.option("--quiet", is_flag=True, help="Say nothing but errors."),
            click.option("--json", "as_json", is_flag=True, help="Print summary.json and nothing else."),
            version_option,
        )
    ):
        function = option(function)
    return function


def echo_options(function: F) -> F:
    """Add what `procedures.echo_options.EchoOptions` holds to a campaign."""
    for name, least, text in (
        ("echoes", 1, "On each terrain in each set; 40."),
        ("repeats", 1, "Shots about each echo; 6."),
        ("sets", 1, "Sets of echoes at each altitude; 2."),
        ("noise-windows", 20, "With noise only; 1000."),
        ("calibration-echoes", 1, "Without noise, on each terrain; 20."),
        ("seed", 0, "Of all draws; 1."),
        ("ground-seed", 0, "Of the fractals; 100."),
    )[::-1]:
        function = click.option(f"--{name}", type=click.IntRange(min=least), metavar="N", help=text)(function)
    return function


def sun_option(function: F) -> F:
    """Add ``--sun`` to a campaign."""
    return click.option("--sun", metavar="mean|perihelion", help="Distance of the Sun; mean.")(function)


def perform(
    campaign: str, options_type: str, chosen: Mapping[str, Any], place: Place, lines: Callable[..., list[str]]
) -> int:
    """Compute a campaign, or go on with one, and tell the results.

    Parameters
    ----------
    campaign : str
        Its module is ``procedures.campaign_<campaign>``, with `plan` and `analyse`.
    options_type : str
        Name of its class of options there.
    chosen : mapping
        The campaign's own options; None where the user said nothing.
    place : Place
        From the common options.
    lines : callable
        Turns the results into what a reader of the terminal wants.
    """
    if place.workers is not None and place.cluster is not None:
        raise click.UsageError("--workers and --cluster: one of them")
    given = {key: value for key, value in chosen.items() if value is not None}
    if place.resume is not None and (place.out is not None or given):
        raise click.UsageError(f"--resume {place.resume} takes everything from that folder")
    procedure = importlib.import_module(f"procedures.campaign_{campaign}")
    kind = getattr(procedure, options_type)
    with _opened(campaign, procedure, kind, given, place) as (run, job):
        summary = read_json(run.folder / "summary.json") if job is None else _performed(procedure, run, job)
    if place.as_json:
        sys.stdout.write((run.folder / "summary.json").read_text(encoding="utf-8"))
    elif not place.quiet:
        for line in lines(summary["results"]):
            print(line)
        print(f"report: {run.folder / 'report.html'}")
    return 0


@dataclass(frozen=True, slots=True)
class _Job:
    """What is left to be done, and by whom."""

    plan: CampaignPlan
    workers: Workers
    quiet: bool


@contextmanager
def _opened(
    campaign: str, procedure: Any, kind: Any, given: Mapping[str, Any], place: Place
) -> Iterator[tuple[CampaignRun, _Job | None]]:
    """Open a new folder or that of a run; no job where that has its results already."""
    from msgspec import convert

    from belahil.campaign_run import CampaignRun

    job: _Job | None = None
    if place.resume is None:
        # All that can be refused is, before there is a folder: one without a plan could not be resumed.
        folder = place.out or dated(f"campaign-{campaign}")
        refuse_used(folder)
        options = convert(dict(given), kind)
        job = _job(procedure.plan(options), place)
        run = CampaignRun.create(folder, campaign, asdict(options))
    else:
        run = CampaignRun.resume(place.resume, campaign)
    with run:
        try:
            if job is None and not run.finished:
                job = _job(procedure.plan(convert(run.begun["options"], kind)), place)
            yield run, job
        except BaseException as error:
            run.log(f"stopped: {type(error).__name__}: {error}")
            if not isinstance(error, RefusedInput):
                error.add_note(f"continue with: belahil campaign {campaign} --resume {run.folder}")
            raise


def _job(plan: CampaignPlan, place: Place) -> _Job:
    from belahil.executors import cluster_workers, local_workers

    workers = local_workers(place.workers) if place.cluster is None else cluster_workers(place.cluster)
    return _Job(plan, workers, place.quiet)


def _performed(procedure: Any, run: CampaignRun, job: _Job) -> dict[str, Any]:
    _compute(job, run)
    return _finish(procedure, job.plan, run, job.quiet)


def _compute(job: _Job, run: CampaignRun) -> None:
    from belahil.chunks import run_chunks

    workers, begun = job.workers, time.monotonic()
    with shown(job.quiet, things="chunks") as progress:
        done = run_chunks(job.plan.chunks, run.store, workers.open, workers.in_flight, progress, run.log)
    signals.check()
    pace = f"{done} chunks on {workers.count} workers in {time.monotonic() - begun:.1f} s"
    run.log(pace)
    if not job.quiet:
        print(pace, file=sys.stderr)


def _finish(procedure: Any, plan: CampaignPlan, run: CampaignRun, quiet: bool) -> dict[str, Any]:
    from belahil.circumstances import left_out

    if not quiet:
        print("analysing", file=sys.stderr, flush=True)
    outcome = procedure.analyse(plan, list(run.store.results(plan.chunks)))
    told = "; ".join(f"{key}: {value}" for key, value in run.begun["options"].items())
    conditions = {"chunks": str(len(plan.chunks)), "options": told, "command": run.begun["command"]}
    return run.finish(plan, outcome, conditions, left_out())
