"""``belahil noise``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from belahil.cli.options import Codes, common, common_options, receiver_option, windows_option


@click.command("noise", short_help="Dark noise by gain code, laser off and firing, and the best code.")
@click.option("--codes", type=Codes(), metavar="0-15|4,5", help="Gain codes; all when left out.")
@click.option(
    "--dark-windows",
    type=click.IntRange(min=1),
    metavar="N",
    help="Windows for each code; 16 when left out, and as many with the laser firing.",
)
@click.option(
    "--laser",
    type=click.Choice(["off", "both"]),
    help="off: never fire it. both, when left out: as many windows again with the laser firing.",
)
@receiver_option
@windows_option
@common_options
def command(
    codes: tuple[int, ...] | None,
    dark_windows: int | None,
    laser: str | None,
    receiver: Path | None,
    windows: Path | None,
    **given: Any,
) -> int:
    """Measure the noise of a receiver by its gain codes, without a signal.

    The receiver's shot pulse starts half of the windows, and FIRES THE LASER that it is wired to; use --laser
    off where it must not.
    """
    from belahil.cli.measuring import Job, perform

    chosen: dict[str, Any] = {
        "codes": codes,
        "dark_windows": dark_windows,
        "laser": laser,
        "receiver": receiver,
    }
    return perform(Job("noise", "NoiseOptions", _lines), common(**given), chosen, windows)


def _lines(results: dict[str, Any]) -> list[str]:
    from belahil.report.tables import one_text

    def name(code: int | None) -> str:
        return "receiver without gain codes" if code is None else f"gain code {code}"

    lines = []
    for row in results["gain_codes"]:
        firing = row["firing"]
        more = ""
        if firing is not None:
            more = f", firing {one_text(firing['noise_rms'])}"
            if firing["burst"] and firing["burst"]["status"] == "ok":
                more += f" with a burst of {one_text(firing['burst']['peak'])}"
        lines.append(f"{name(row['code'])}: noise {one_text(row['noise_rms'])}{more}")
    if results["best_code"] is not None:
        lines.append(f"best gain code: {results['best_code']}{_near(results['best_code_runner_up'])}")
        lacking = [str(row["code"]) for row in results["gain_codes"] if not row["combined_input_noise_rms"]]
        if lacking:
            lines.append(f"not compared, for want of a gain or of noise: code {', '.join(lacking)}")
    elif [row["code"] for row in results["gain_codes"]] != [None]:
        lines.append(f"no best gain code{_why(results['gain_codes'])}")
    return lines


def _why(rows: list[dict[str, Any]]) -> str:
    """Tell which status keeps which gain codes from having a combined noise."""
    codes: dict[str, list[str]] = {}
    for row in rows:
        status = (row["firing"] or row)["status"]
        if status == "ok" and row["combined_input_noise_rms"] is None:
            status = "no gain is known"
        if status != "ok":
            codes.setdefault(status, []).append(str(row["code"]))
    told = "; ".join(f"{status} at code {', '.join(ones)}" for status, ones in codes.items())
    return told and f": {told}"


def _near(runner_up: dict[str, Any] | None) -> str:
    """Tell of a second code that may be the best as well."""
    if runner_up is None:
        return ""
    more = runner_up["difference"]
    within = more["value"] <= 2 * more["standard_uncertainty"]
    return f"; code {runner_up['code']} is within the uncertainty" if within else ""
