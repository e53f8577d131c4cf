"""What ``belahil bench conform`` does: try every promise of both drivers, print a table, write the report."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Any

from belahil.errors import RefusedInput

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from belahil.config import BenchConfig
    from belahil.conformance import ConformanceReport

PASSED, FAILED, LINK_LOST = 0, 1, 3
SCHEMA = 1


def conformed(config: BenchConfig, seed: int | None, record: Path | None, out: Path | None) -> int:
    """Try a bench out, print what was seen of each rule, and return the exit status.

    Parameters
    ----------
    config : BenchConfig
        Of any kind; its ``max_vpp`` is kept.
    seed : int or None
        In place of ``[emulation] seed``.
    record, out : Path or None
        Take the bytes of the links, and the report as JSON.

    Raises
    ------
    RefusedInput
        `out` cannot be written where it is asked for; nothing was opened.
    InstrumentError
        An instrument does not answer, or a replay went another way.
    """
    from belahil.bench import open_bench
    from belahil.cli.signals import closing
    from belahil.conformance import check_bench, played_on
    from belahil.recording import recorded_session

    if out is not None and (out.is_dir() or not out.absolute().parent.is_dir()):
        raise RefusedInput(f"--out {out}: name a file in a folder that is there")
    session = recorded_session(config)
    if session is not None:
        print(f"replay of {session}", file=sys.stderr, flush=True)
    with closing(open_bench(config, seed=seed, record=record)) as bench:
        source = bench.source
        print(f"{source} bench; with the output on is played:")
        print(*(f"  {line}" for line in played_on(bench)), sep="\n", flush=True)
        reports = check_bench(bench)
    for report in reports:
        print(*table(report), sep="\n", flush=True)
    if out is not None:
        from belahil.storage import write_whole

        write_whole(out, json.dumps(as_json(source, reports), indent=2) + "\n")
    if any(report.link_lost for report in reports):
        return LINK_LOST
    return PASSED if all(report.holds for report in reports) else FAILED


def table(report: ConformanceReport) -> Iterator[str]:
    """Yield a line for each rule, what it promises where it fails, and how many hold."""
    width = max(len(one.rule) for one in report.results)
    yield f"{report.instrument}: {report.identity}"
    for one in report.results:
        status = one.status.replace("_", " ")
        yield f"  {one.rule:{width}}  {status:14}  {one.seen}"
        if one.status == "fails":
            yield f"  {'':{width}}  {'':14}  promised: {one.promise}"
    count = {status: 0 for status in ("holds", "fails", "not_applicable")}
    for one in report.results:
        count[one.status] += 1
    yield (
        f"  {count['holds']} of {len(report.results)} rules hold, {count['fails']} fail, "
        f"{count['not_applicable']} do not apply"
    )


def as_json(source: str, reports: tuple[ConformanceReport, ...]) -> dict[str, Any]:
    """Return what ``--out`` writes."""
    from belahil.provenance import software

    return {
        "schema": SCHEMA,
        "source": source,
        "software": software(),
        "reports": [report.as_json() for report in reports],
    }
