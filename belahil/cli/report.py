"""``belahil report``."""

from __future__ import annotations

from pathlib import Path

import click

from belahil.cli.options import version_option


@click.command("report", short_help="Write the report of a run folder again.")
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--quiet", is_flag=True, help="Say nothing but errors.")
@version_option
def command(run: Path, quiet: bool) -> int:
    """Write report.html of the run folder RUN again, from the files in it; nothing is computed."""
    from belahil.report import remake

    path = remake(run)
    if not quiet:
        print(f"report: {path}")
    return 0
