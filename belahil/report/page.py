"""The page itself: from the summary, what else the procedure told, and the figures' files."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from belahil.errors import RefusedInput, StorageError
from belahil.report.figures import LABELS
from belahil.report.tables import MISSING, Grid, grids, named, one_text, span_text, unit_text
from belahil.run_folder import read_json
from belahil.storage import write_whole
from belahil.uncertainty import prefix_power

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from belahil.outcome import Outcome
    from belahil.verdict import Check

LONG = 20  # rows of a table that a page shows at once
ROUNDING = 1e-20  # share of a variance
DENSE = 5  # columns from which on a table is set in small letters


def material(
    outcome: Outcome, checks: Sequence[Check], conditions: Mapping[str, str], not_modelled: Sequence[str]
) -> dict[str, Any]:
    """Collect, as plain values, what the page shows beside the summary.

    Parameters
    ----------
    outcome : Outcome
        From the procedure.
    checks : sequence of Check
        Values beside their limits.
    conditions : mapping of str to str
        Circumstances by name.
    not_modelled : sequence of str
        What an emulated or simulated bench leaves out.
    """
    return {
        "said": list(outcome.said),
        "budget": [asdict(line) for line in outcome.budget],
        "checks": [
            # As in the summary, whose JSON knows no infinity.
            asdict(check)
            | {key: check.as_json()[key] for key in ("low", "high")}
            | {"estimate": check.estimate.as_json() if check.estimate else None}
            for check in checks
        ],
        "notes": list(outcome.notes),
        "conditions": dict(conditions),
        "not_modelled": list(not_modelled),
    }


def write_page(folder: Path, summary: Mapping[str, Any], told: Mapping[str, Any]) -> Path:
    """Write ``report.html``.

    Parameters
    ----------
    folder : Path
        The run folder, with the figures' files and ``bench.toml`` or ``scene.toml`` in it.
    summary : mapping
        As ``summary.json`` says it.
    told : mapping
        From `material`, with ``figures`` from `belahil.report.save_figures`.

    Raises
    ------
    StorageError
        A figure cannot be read, or the page not be written.
    """
    import jinja2

    subject = "scene" if (folder / "scene.toml").is_file() else "bench"
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "named": named,
        "one_text": one_text,
        "span": _allowed,
        "moment": lambda date: date[:19].replace("T", " "),
    }
    text = environment.get_template("page.html.jinja").render(
        summary=summary,
        told=told,
        LONG=LONG,
        DENSE=DENSE,
        label=LABELS[summary["source"]],
        grids=grids(summary["results"]),
        figures=[{**figure, "drawing": _drawing(folder / figure["svg"])} for figure in told["figures"]],
        budget=_budget(told["budget"]),
        budget_in_words=_budget_in_words(told["budget"]),
        subject=subject,
        given=_read(folder / f"{subject}.toml"),
    )
    path = folder / "report.html"
    write_whole(path, text)
    return path


def remake(folder: Path) -> Path:
    """Write the page of a finished run again, from the files in its folder.

    Raises
    ------
    RefusedInput
        The folder holds no finished run.
    StorageError
        A file is missing or damaged.
    """
    if not (folder / "summary.json").is_file():
        hint = "continue it with --resume" if (folder / "journal").is_dir() else "is it a run folder?"
        raise RefusedInput(f"{folder}: holds no finished run ({hint})")
    return write_page(folder, read_json(folder / "summary.json"), read_json(folder / "report.json"))


def _allowed(check: Mapping[str, Any]) -> str:
    low, high = check["low"], check["high"]
    return span_text(check["limit"], -math.inf if low is None else low, math.inf if high is None else high)


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise StorageError(f"{path}: cannot be read") from error


def _drawing(path: Path) -> str:
    """Read the svg element without the declarations that belong to a file of its own."""
    _, begin, rest = _read(path).partition("<svg")
    if not begin:
        raise StorageError(f"{path}: is no drawing")
    return begin + rest


def _quantity(value: float, unit: str) -> str:
    power = prefix_power(value, unit)
    return f"{value / 10**power:.3g} {unit_text(unit, power)}".strip()


def _budget(lines: Sequence[Mapping[str, Any]]) -> Grid | None:
    """Lay out all budget lines as one table: a row for each quantity, a column for each source."""
    if not lines or _budget_in_words(lines):
        return None
    sources = tuple(dict.fromkeys(line["source"] for line in lines))
    cells: dict[str, dict[str, str]] = {}
    for line in lines:
        told = f"{_quantity(line['value'], line['unit'])} ({100 * line['share']:.1f} %)"
        # What moves a result by rounding alone does not move it.
        cells.setdefault(line["quantity"], {})[line["source"]] = told if line["share"] > ROUNDING else "0"
    rows = ((name, *(row.get(source, MISSING) for source in sources)) for name, row in cells.items())
    return Grid("Uncertainty budget", ("quantity", *sources), tuple(rows))


def _budget_in_words(lines: Sequence[Mapping[str, Any]]) -> str:
    """Say in a sentence what a table would repeat in each row: that every uncertainty has one source alone.

    Empty where one of them has several, and a table is needed.
    """
    acting = [line for line in lines if line["share"] > ROUNDING]
    alone = {line["quantity"]: line["source"] for line in acting}
    if not acting or len(alone) < len(acting):
        return ""
    found: dict[str, list[str]] = {}
    for quantity, source in alone.items():
        found.setdefault(source, []).append(quantity)
    if len(alone) == 1:
        return f"The uncertainty of {acting[0]['quantity']} has one source alone: {acting[0]['source']}."
    told = [f"{source} ({len(names)})" for source, names in found.items()]
    if len(found) == 1:
        told = list(found)
    return f"Each of the {len(alone)} uncertainties has one source alone: {', '.join(told)}."
