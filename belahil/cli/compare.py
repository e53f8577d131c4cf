"""``belahil compare``."""

from __future__ import annotations

import json
from contextlib import suppress
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from belahil.cli.options import version_option

if TYPE_CHECKING:
    from belahil.comparison import Compared, Comparison, RunSide
    from belahil.config import BenchConfig
    from belahil.values import Estimate


@click.command("compare", short_help="Two runs side by side: what differs beyond chance?")
@click.argument("first", type=click.Path(path_type=Path), metavar="RUN")
@click.argument("second", type=click.Path(path_type=Path), metavar="RUN")
@click.option(
    "--level",
    type=float,
    default=0.05,
    show_default=True,
    help="Probability that two runs of one receiver are called different in any number (Holm's correction).",
)
@click.option("--independent", is_flag=True, help="Take no error for common to both runs.")
@click.option("--differing", is_flag=True, help="List only the numbers that differ or are missing.")
@click.option("--json", "as_json", is_flag=True, help="Print the comparison as JSON, and nothing else.")
@version_option
def command(
    first: Path, second: Path, level: float, independent: bool, differing: bool, as_json: bool
) -> int:
    """Compare all measured numbers of two run folders, whatever they measured.

    The status is 0 when no number differs significantly, and 1 when one does.
    """
    from belahil.comparison import compare

    one, other = sides = [run_side(folder, independent) for folder in (first, second)]
    found = compare(one, other, level)
    if as_json:
        print(json.dumps(_json(found, sides), indent=2, ensure_ascii=False))
    else:
        print("\n".join(_lines(found, sides, differing)))
    return 1 if found.differing else 0


def run_side(folder: Path, independent: bool = False) -> RunSide:
    """Read one run.

    Parameters
    ----------
    folder : Path
        A finished run folder.
    independent : bool
        Take none of its errors for one that another run may share.

    Raises
    ------
    RefusedInput
        There is no finished run.
    StorageError
        A file is damaged.
    """
    from belahil.comparison import RunSide
    from belahil.errors import RefusedInput
    from belahil.run_folder import read_bench, read_json

    path = folder / "summary.json"
    if not path.is_file():
        raise RefusedInput(f"{folder}: there is no finished run; a run folder with summary.json is needed")
    summary = read_json(path)
    if not isinstance(summary, dict) or not {"procedure", "results"} <= summary.keys():
        raise RefusedInput(f"{path}: is no summary of a run; it needs the keys procedure and results")
    report = folder / "report.json"
    budget = read_json(report).get("budget", ()) if report.is_file() else ()
    shares: dict[str, object] = {}
    if not independent and (folder / "bench.toml").is_file():
        # A bench of another version says nothing of shared errors; its numbers can be compared all the same.
        with suppress(RefusedInput):
            shares = _shared(read_bench(folder), (summary.get("instruments") or {}).get("generator"))
    return RunSide(str(folder), summary, budget, shares)


def _shared(config: BenchConfig, identity: str | None) -> dict[str, object]:
    """Tell whose errors the declared ones are: the same generator's, behind the same attenuator."""
    part = config.generator
    truth = None if config.source == "hardware" else config.emulation.generator
    whose = (identity, truth, part.bandwidth_hz, part.load_ohm)
    return {
        f"[generator] uncertainty.{name}": (whose, part.attenuation_db) if name == "attenuation_db" else whose
        for name in part.uncertainty.__struct_fields__
    }


def _json(found: Comparison, sides: list[RunSide]) -> dict[str, Any]:
    def told(one: Compared) -> dict[str, Any]:
        parts = (one.first, one.second, one.difference)
        first, second, difference = (part and part.as_json() for part in parts)
        z = None if one.z is None or abs(one.z) == float("inf") else one.z
        return {
            "name": one.name,
            "first": first,
            "second": second,
            "difference": difference,
            "z": z,
            "p_value": one.p_value,
            "verdict": one.verdict,
            "statuses": list(one.statuses),
            "common": list(one.common),
        }

    return {
        "schema": 1,
        "runs": [side.name for side in sides],
        "procedures": [side.summary["procedure"] for side in sides],
        "level": found.level,
        "correction": "Holm",
        "tested": len(found.tested),
        "differing": [one.name for one in found.differing],
        "numbers": [told(one) for one in found.numbers],
        "words": [{"name": name, "first": one, "second": other} for name, one, other in found.words],
        "notes": list(found.notes),
    }


def _lines(found: Comparison, sides: list[RunSide], differing: bool) -> list[str]:
    from belahil.comparison import AGREES

    head = [
        f"{place}: {side.name} ({side.summary['procedure']})" for place, side in zip("12", sides, strict=True)
    ]
    shown = [one for one in found.numbers if not differing or one.verdict != AGREES]
    lines = [*head, *_table(shown)]
    lines += [f"{name}: {one} and {other} (no uncertainty, not tested)" for name, one, other in found.words]
    common = sorted({source for one in found.numbers for source in one.common})
    if common:
        lines.append(f"taken for one error of both runs: {', '.join(common)}")
    lines += [f"note: {note}" for note in found.notes]
    largest = max(found.tested, key=lambda one: abs(one.z or 0.0))
    missing = len(found.numbers) - len(found.tested)
    lines.append(f"largest difference: {largest.name}, {abs(largest.z or 0.0):.2f} standard uncertainties")
    if missing:
        lines.append(f"{missing} numbers could not be compared")
    count = len(found.differing)
    lines.append(
        f"{count or 'none'} of {len(found.tested)} numbers {'differs' if count < 2 else 'differ'} "
        f"at level {found.level:g} (corrected after Holm)"
    )
    return lines


def _table(rows: list[Compared]) -> list[str]:
    """Lay the numbers out in columns; what a list lacks for one reason is one line."""
    from belahil.comparison import ONLY_FIRST, ONLY_SECOND

    cells: list[tuple[str, ...]] = [("", "1", "2", "2 - 1", "z", "")]
    for (_, lacking, _), some in groupby(rows, key=_row_and_lack):
        ones = list(some)
        whole = lacking in (ONLY_FIRST, ONLY_SECOND) and len(ones) > 1
        cells += [_lacking(ones)] if whole else [_cells(one) for one in ones]
    if len(cells) == 1:
        return []
    widths = [max(len(row[place]) for row in cells) for place in range(6)]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in cells
    ]


def _row_and_lack(one: Compared) -> tuple[str, str, tuple[str | None, ...]]:
    """Tell apart what is one line in the table: each number, and what one list lacks for one reason."""
    if one.difference is not None:
        return one.name, "", ()
    return one.name.partition("[")[0] if "[" in one.name else one.name, one.verdict, one.statuses


def _lacking(ones: list[Compared]) -> tuple[str, ...]:
    rows = list(dict.fromkeys(one.name.rpartition("]")[0] + "]" for one in ones))
    name = rows[0] if len(rows) == 1 else f"{rows[0]} to [{rows[-1].partition('[')[2]}"
    counted, said = (
        f"{len(ones)} numbers",
        [f"\N{EN DASH} ({one or 'not there'})" for one in ones[0].statuses],
    )
    first, second = (counted, said[1]) if ones[0].first is not None else (said[0], counted)
    return (name, first, second, "", "", ones[0].verdict.replace("_", " "))


def _cells(one: Compared) -> tuple[str, ...]:
    from belahil.report.tables import one_text

    def text(number: Estimate | None, status: str | None) -> str:
        return one_text(number.as_json()) if number else f"\N{EN DASH} ({status or 'not there'})"

    return (
        one.name,
        text(one.first, one.statuses[0]),
        text(one.second, one.statuses[1]),
        "" if one.difference is None else one_text(one.difference.as_json()),
        "" if one.z is None else f"{one.z:+.2f}",
        one.verdict.replace("_", " "),
    )
