"""``belahil noise``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from belahil.cli.options import Codes, common, common_options, windows_option


@click.command("noise", short_help="Dark noise by gain code.")
@click.option("--codes", type=Codes(), metavar="0-15|4,5", help="Gain codes; all when left out.")
@click.option(
    "--dark-windows", type=click.IntRange(min=1), metavar="N", help="Windows for each code; 16 when left out."
)
@windows_option
@common_options
def command(
    codes: tuple[int, ...] | None, dark_windows: int | None, windows: Path | None, **given: Any
) -> int:
    """Measure the noise of a receiver by its gain codes, without a signal."""
    from belahil.cli.measuring import Job, perform

    chosen = {"codes": codes, "dark_windows": dark_windows}
    return perform(Job("noise", "NoiseOptions", _lines), common(**given), chosen, windows)


def _lines(results: dict[str, Any]) -> list[str]:
    from belahil.report.tables import one_text

    def name(code: int | None) -> str:
        return "receiver without gain codes" if code is None else f"gain code {code}"

    return [f"{name(row['code'])}: noise {one_text(row['noise_rms'])}" for row in results["gain_codes"]]
