"""``belahil rfm-parity``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from belahil.cli.options import Decimals, common, common_options, receiver_option, windows_option


@click.command(
    "rfm-parity", short_help="The receiver's range finder against ours, and how well it sees echoes."
)
@click.option(
    "--gain-code",
    "--code",
    "code",
    type=click.IntRange(min=0),
    metavar="N",
    help="The quietest when left out.",
)
@click.option(
    "--widths-ns",
    "widths_s",
    type=Decimals(-9),
    metavar="LIST",
    help="Full widths of the echoes at the receiver's input, ns; 30,60 when left out.",
)
@click.option(
    "--snrs",
    type=Decimals(0),
    metavar="LIST",
    help="Heights of the echoes over the noise, behind the filter; 2.5,3,4,6,10 when left out.",
)
@click.option("--shots", type=click.IntRange(min=2), metavar="N", help="Windows for each echo; 100.")
@click.option("--samples", type=click.IntRange(min=1), metavar="N", help="Of a window; the longest.")
@click.option("--marker-snr", type=float, metavar="X", help="Height of the marker before each echo; 40.")
@click.option(
    "--model-windows",
    type=click.IntRange(min=100),
    metavar="N",
    help="Simulated windows for each echo; 1000.",
)
@click.option("--arrival-tolerance-ps", type=float, metavar="X", help="Between equal candidates; 10.")
@click.option(
    "--relative-tolerance", type=float, metavar="X", help="Of width and amplitude of equal candidates; 1e-3."
)
@receiver_option
@windows_option
@common_options
def command(
    receiver: Path | None,
    windows: Path | None,
    arrival_tolerance_ps: float | None,
    relative_tolerance: float | None,
    **given: Any,
) -> int:
    """Repeat the receiver's search for pulses, and measure how often it sees weak echoes.

    Status 1 where a window holds other candidates than the receiver reported, or echoes are seen less often,
    more often, or with another spread than a receiver with the known filter, gain and noise would see them.
    """
    from belahil.cli.measuring import Job, perform

    own = ("code", "widths_s", "snrs", "shots", "samples", "marker_snr", "model_windows")
    chosen: dict[str, Any] = {name: given.pop(name) for name in own}
    told = {
        "arrival_s": None if arrival_tolerance_ps is None else 1e-12 * arrival_tolerance_ps,
        "fwhm_relative": relative_tolerance,
        "amplitude_relative": relative_tolerance,
    }
    within = {name: value for name, value in told.items() if value is not None}
    chosen["tolerances"] = within or None
    chosen["receiver"] = receiver
    return perform(Job("rfm-parity", "ParityOptions", _lines), common(**given), chosen, windows)


def _lines(results: dict[str, Any]) -> list[str]:
    from belahil.report.tables import one_text

    parity = results["parity"]
    counts = parity["candidates"]
    lines = [
        f"{parity['agreeing']} of {parity['compared']} windows have the candidates that we find: "
        f"{counts['matched']} matched, {counts['missing']} missing, {counts['extra']} extra"
        if results["status"] == "ok"
        else f"no window could be compared: {results['status']}"
    ]
    for row in results["echoes"]:
        width = "echo" if row["fwhm_s"] is None else f"{1e9 * row['fwhm_s']:.3g} ns, SNR {row['snr']:.3g}"
        found = row["detection_probability"]
        if found is None:
            lines.append(f"{width}: {row['status']}")
            continue
        spread = row["arrival_spread"]
        scatter = (
            ""
            if spread is None
            else (f", spread {one_text(spread['measured'])} (model {one_text(spread['model'])})")
        )
        lines.append(
            f"{width}: detected {one_text(found['measured'])} (model {one_text(found['model'])}){scatter}"
        )
    return lines
