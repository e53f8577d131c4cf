"""A work-precision table as text, as CSV and as JSON."""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from procedures.accuracy_rows import number

if TYPE_CHECKING:
    from procedures.accuracy import WorkPrecision
    from procedures.accuracy_machine import Machine
    from procedures.accuracy_rows import Row

SCHEMA = "belahil-accuracy-1"
LEGEND = (
    "P  no other method for the same case is both as fast and as exact      x  failed",
    "asked: allowed error;  predicted: error that the method foretells;  a dash: there is none",
)
_HEADING = ("", "method", "setting", "error", "asked", "predicted", "error/pred.", "us/shot", "work")
_COLUMNS = (
    "stage",
    "case",
    "method",
    "setting",
    "error",
    "unit",
    "requested",
    "predicted",
    "error_of_predicted",
    "error_of_requested",
    "us_per_shot",
    "pareto",
    "work",
    "failure",
    "reference",
)
_LEFT = (0, 1, 2, 8)


def lines(table: WorkPrecision) -> list[str]:
    """Write the table for a terminal or a page: circumstances, then each case with its reference."""
    found = [*machine_lines(table.machine), *startup_lines(table.startup_s), *LEGEND]
    widths = _widths(table.rows)
    for (stage, case), group in itertools.groupby(table.rows, lambda row: (row.stage, row.case)):
        rows = list(group)
        found += ["", f"{stage.upper()}: {case}. Error {rows[0].unit}"]
        found.append(f"  against: {rows[0].reference}")
        found.append(_line(_HEADING, widths))
        for row in rows:
            found.append(_line(_cells(row), widths))
            if row.failure:
                found.append(f"     failed: {row.failure}")
    return found


def machine_lines(machine: Machine) -> list[str]:
    """Write the circumstances."""
    versions = ", ".join(f"{name} {number}" for name, number in machine.versions.items())
    loops = "; ".join(f"{name}: {us / 1e3:.3g} ms" for name, us in machine.reference_loop_us.items())
    return [
        f"machine         {machine.processor}; {machine.cpus} CPUs; {machine.system}",
        f"threads         {machine.threads}; loops {machine.loops}",
        f"versions        {versions}",
        f"times           {machine.repeats}",
        f"reference loop  {loops}",
    ]


def startup_lines(startup_s: dict[str, float]) -> list[str]:
    """Write what a fresh process pays, which no row contains."""
    if not startup_s:
        return ["once a process  not measured: no process could be started", ""]
    width = max(map(len, startup_s))
    return [
        "once a process, in no row below:",
        *(f"  {name.ljust(width)}  {seconds:6.3f} s" for name, seconds in startup_s.items()),
        "",
    ]


def as_csv(table: WorkPrecision) -> str:
    """Write the rows as comma-separated values with a heading; a number that is not there is empty."""
    out = io.StringIO()
    writer = csv.DictWriter(out, _COLUMNS, lineterminator="\n")
    writer.writeheader()
    for row in table.rows:
        cells = _plain(row)
        cells["work"] = _work(row)
        writer.writerow({name: "" if cells[name] is None else cells[name] for name in _COLUMNS})
    return out.getvalue()


def as_json(table: WorkPrecision) -> dict[str, Any]:
    """Return the whole table in types that JSON has; a number that is not there is None."""
    return {
        "schema": SCHEMA,
        "machine": asdict(table.machine),
        "startup_s": table.startup_s,
        "rows": [_plain(row) for row in table.rows],
    }


def _plain(row: Row) -> dict[str, Any]:
    cells = asdict(row)
    cells["us_per_shot"] = cells.pop("microseconds")
    cells["error_of_predicted"] = row.of_predicted
    cells["error_of_requested"] = row.of_requested
    return {name: cells[name] for name in _COLUMNS}


def _cells(row: Row) -> tuple[str, ...]:
    return (
        "x" if row.failure else "P" if row.pareto else "",
        row.method,
        row.setting,
        _number(row.error, number),
        _number(row.requested, number),
        _number(row.predicted, number),
        _number(row.of_predicted, "{:.2g}".format),
        _number(row.microseconds, _significant),
        _work(row),
    )


def _number(value: float | None, how: Callable[[float], str]) -> str:
    return "-" if value is None else how(value)


def _significant(value: float) -> str:
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}"


def _work(row: Row) -> str:
    return ", ".join(f"{count} {name}" for name, count in row.work.items())


def _widths(rows: Iterable[Row]) -> tuple[int, ...]:
    every: Iterator[tuple[str, ...]] = itertools.chain([_HEADING], map(_cells, rows))
    return tuple(max(map(len, column)) for column in zip(*every, strict=True))


def _line(cells: tuple[str, ...], widths: tuple[int, ...]) -> str:
    aligned = (
        cell.ljust(width) if number in _LEFT else cell.rjust(width)
        for number, (cell, width) in enumerate(zip(cells, widths, strict=True))
    )
    return ("  " + "  ".join(aligned)).rstrip()
