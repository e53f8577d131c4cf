"""``belahil characterize``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from belahil.cli.options import Codes, Decimals, common, common_options, windows_option


@click.command("characterize", short_help="Gain, cut-off and noise by gain code, and the best code.")
@click.option("--codes", type=Codes(), metavar="0-15|4,5", help="Gain codes; all when left out.")
@click.option(
    "--amplitudes-mvpp",
    "amplitudes_vpp",
    type=Decimals(-3),
    metavar="LIST",
    help="Amplitudes at the receiver's input, mV peak to peak; 3,13,30,50,200 when left out.",
)
@click.option(
    "--frequencies-mhz",
    "frequencies_hz",
    type=Decimals(6),
    metavar="LIST",
    help="Frequencies, MHz; 24 up to 38 MHz or the generator's limit when left out.",
)
@click.option(
    "--dark-windows",
    type=click.IntRange(min=1),
    metavar="N",
    help="Windows without a signal, for each code; 4 when left out.",
)
@windows_option
@common_options
def command(
    codes: tuple[int, ...] | None,
    amplitudes_vpp: tuple[float, ...] | None,
    frequencies_hz: tuple[float, ...] | None,
    dark_windows: int | None,
    windows: Path | None,
    **given: Any,
) -> int:
    """Measure gain, cut-off and noise of a receiver by its gain codes, and find the best code.

    Sines over gain codes, amplitudes and frequencies, and windows without a signal.
    """
    from belahil.cli.measuring import Job, perform

    chosen = {
        "codes": codes,
        "amplitudes_vpp": amplitudes_vpp,
        "frequencies_hz": frequencies_hz,
        "dark_windows": dark_windows,
    }
    return perform(Job("characterize", "GainOptions", _lines), common(**given), chosen, windows)


def _lines(results: dict[str, Any]) -> list[str]:
    from belahil.report.tables import one_text

    def numbers(row: dict[str, Any]) -> str:
        return (
            f"gain {one_text(row['gain'])}, cut-off {one_text(row['cutoff'])}, "
            f"input noise {one_text(row['input_noise_rms'])}"
        )

    rows, best = results["gain_codes"], results["best_code"]
    lines = [f"gain code {row['code']}: {numbers(row)}" for row in rows if len(rows) > 1 and row["gain"]]
    if best is not None:
        near = _near(results["best_code_runner_up"])
        lines += [f"best gain code: {best} ({numbers(row)}){near}" for row in rows if row["code"] == best]
        return lines
    if [row["code"] for row in rows] != [None]:
        said = "no best gain code" if lines or rows[0]["gain"] else "no gain code could be characterized"
        return [*lines, f"{said}: {_why(rows)}"]
    if rows[0]["gain"] is None:
        return [f"the receiver could not be characterized: {rows[0]['status']}"]
    return [f"receiver without gain codes: {numbers(rows[0])}"]


def _near(runner_up: dict[str, Any] | None) -> str:
    """Tell of a second code that may be the best as well."""
    if runner_up is None:
        return ""
    more = runner_up["difference"]
    within = more["value"] <= 2 * more["standard_uncertainty"]
    return f"; code {runner_up['code']} is within the uncertainty" if within else ""


def _why(rows: list[dict[str, Any]]) -> str:
    """Tell which status keeps which gain codes from being judged."""
    codes: dict[str, list[str]] = {}
    for row in rows:
        if row["status"] != "ok":
            codes.setdefault(row["status"], []).append(str(row["code"]))
    return "; ".join(f"{status} at code {', '.join(ones)}" for status, ones in codes.items())
