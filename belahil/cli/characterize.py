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
    elif [row["code"] for row in rows] != [None]:
        said = "no best gain code" if lines or rows[0]["gain"] else "no gain code could be characterized"
        lines.append(f"{said}: {_why(rows)}")
    elif rows[0]["gain"] is None:
        lines.append(f"the receiver could not be characterized: {rows[0]['status']}")
    else:
        lines.append(f"receiver without gain codes: {numbers(rows[0])}")
    return [*lines, *_imperfections(results)]


def _imperfections(results: dict[str, Any]) -> list[str]:
    """Tell what a perfect receiver has not, where it is beyond three standard uncertainties."""
    from belahil.report.tables import one_text

    def listed(about: str, parts: dict[str, dict[str, Any] | None]) -> list[str]:
        seen = [f"{name} {one_text(one)}".strip() for name, one in parts.items() if one and _seen(one)]
        return [f"{about}: {', '.join(seen)}"] if seen else []

    small, twins = results.get("small_signal") or {}, results.get("interleave") or {}
    corners = {
        f"at code {row['code']}" if row["code"] is not None else "": row["highpass"]
        for row in results["gain_codes"]
        if row.get("highpass") and _seen(row["highpass"])
    }
    # All codes share one coupling; the code that tells it best stands for it.
    best = min(corners, key=lambda name: float(corners[name]["standard_uncertainty"]), default=None)
    coupling = [] if best is None else [f"AC coupling: corner {one_text(corners[best])} {best}".strip()]
    return [
        *listed(
            "not linear",
            {"dead zone": small.get("deadband_v"), "cubic term": small.get("cubic_per_v2")},
        ),
        *listed("clock error", {"": results.get("clock_ppm")}),
        *coupling,
        *listed(
            "converters differ, even minus odd",
            {
                name: twins.get(key)
                for name, key in (("gain", "gain"), ("offset", "offset_v"), ("skew", "skew_s"))
            },
        ),
    ]


def _seen(measured: dict[str, Any]) -> bool:
    return bool(abs(measured["value"]) > 3 * measured["standard_uncertainty"])


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
