"""``belahil accuracy``."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from belahil.cli import signals
from belahil.cli.options import version_option
from belahil.cli.progress import PLAIN_EVERY_S

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from procedures.accuracy import WorkPrecision
    from procedures.accuracy_rows import Stage


STAGES: tuple[Stage, ...] = ("footprint", "filter", "detection", "noise")
"""Those of `procedures.accuracy_rows`, told here so that the help need not load them."""


@click.command("accuracy", short_help="What accuracy costs in time, on this machine.")
@click.option(
    "--stage",
    "stages",
    type=click.Choice(STAGES),
    multiple=True,
    help="Only this one; may be given again. All when left out.",
)
@click.option(
    "--csv",
    "csv_file",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Write the rows there too.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Folder for table, picture and JSON; new or empty.",
)
@click.option("--quiet", is_flag=True, help="Say nothing but errors.")
@click.option("--json", "as_json", is_flag=True, help="Print the table as JSON.")
@version_option
def command(
    stages: tuple[str, ...], csv_file: Path | None, out: Path | None, quiet: bool, as_json: bool
) -> int:
    """Measure error and time of every stage on this machine: the work-precision table.

    Each row is a method at a setting. Settings that fail stay in the table, with the reason; the status is 0
    all the same. Takes less than a minute.
    """
    import json

    from belahil.errors import RefusedInput
    from belahil.run_folder import refuse_used
    from belahil.storage import write_whole
    from procedures import accuracy, accuracy_text

    if out is not None:
        refuse_used(out)
    if csv_file is not None and not csv_file.parent.is_dir():
        raise RefusedInput(f"--csv {csv_file}: {csv_file.parent} is no folder")
    chosen = tuple(stage for stage in STAGES if not stages or stage in stages)
    with _shown(quiet) as progress:
        table = accuracy.measure(accuracy.AccuracyOptions(chosen), progress)
    text = json.dumps(accuracy_text.as_json(table), indent=1, allow_nan=False) + "\n"
    if csv_file is not None:
        write_whole(csv_file, accuracy_text.as_csv(table))
    if out is not None:
        _save(out, table, text)
    if as_json:
        sys.stdout.write(text)
    elif not quiet:
        print("\n".join(accuracy_text.lines(table)))
        if out is not None:
            print(f"\ntable and picture: {out}")
    return 0


def _save(folder: Path, table: WorkPrecision, text: str) -> None:
    from belahil.report.figures import save_figures
    from belahil.storage import storage_error, write_whole
    from procedures import accuracy_text
    from procedures.accuracy_figure import accuracy_figure

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise storage_error(f"--out {folder}: cannot be made", error) from error
    write_whole(folder / "accuracy.json", text)
    write_whole(folder / "accuracy.csv", accuracy_text.as_csv(table))
    write_whole(folder / "accuracy.txt", "\n".join(accuracy_text.lines(table)) + "\n")
    # What is shown was measured on real hardware, this machine: no label that says otherwise.
    save_figures(folder, {"accuracy": lambda: accuracy_figure(table)}, "hardware")


@contextmanager
def _shown(quiet: bool) -> Iterator[Callable[[int, int], None]]:
    """Tell the progress now and then, and stop between two rows when asked to."""
    import time

    last = time.monotonic()

    def progress(done: int, total: int) -> None:
        nonlocal last
        signals.check()
        now = time.monotonic()
        if not quiet and now - last >= PLAIN_EVERY_S:
            last = now
            print(f"{done} of {total} rows in two rounds", file=sys.stderr, flush=True)

    with signals.deferred():
        yield progress
    signals.check()
