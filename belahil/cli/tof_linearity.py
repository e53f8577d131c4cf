"""``belahil tof-linearity``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from belahil.cli.options import Decimals, common, common_options, receiver_option, windows_option


@click.command("tof-linearity", short_help="Scale, wobble and range walk of the time of flight.")
@click.option(
    "--widths-ns",
    type=Decimals(-9),
    metavar="LIST",
    help="Full widths of the second pulse; 8,20,40,80 when left out.",
)
@click.option(
    "--peaks-mv", type=Decimals(-3), metavar="LIST", help="Its heights at the cut; 10,30,90 when left out."
)
@click.option(
    "--separations",
    type=click.IntRange(min=2),
    metavar="N",
    help="Distances from 1 to 199 us, for each such pulse; 8 when left out.",
)
@click.option("--shots", type=click.IntRange(min=1), metavar="N", help="Of each distance; 4 when left out.")
@click.option(
    "--gain-code", type=click.IntRange(min=0), metavar="N", help="4 when left out, else the receiver's first."
)
@receiver_option
@windows_option
@common_options
def command(
    widths_ns: tuple[float, ...] | None,
    peaks_mv: tuple[float, ...] | None,
    separations: int | None,
    shots: int | None,
    gain_code: int | None,
    receiver: Path | None,
    windows: Path | None,
    **given: Any,
) -> int:
    """Measure how linear a receiver's time of flight is, with two pulses in each window."""
    from belahil.cli.measuring import Job, perform

    chosen = {
        "widths_s": widths_ns,
        "peaks_v": peaks_mv,
        "separations": separations,
        "shots": shots,
        "gain_code": gain_code,
        "receiver": receiver,
    }
    return perform(Job("tof-linearity", "TofOptions", _lines), common(**given), chosen, windows)


def _rms(told: dict[str, Any] | None) -> str:
    from belahil.report.tables import one_text

    if told is None:
        return "not determined"
    if told["value"] < told["standard_uncertainty"]:
        return f"below {2e12 * told['standard_uncertainty']:.0f} ps rms"
    return f"{one_text(told)} rms"


def _lines(results: dict[str, Any]) -> list[str]:
    from belahil.report.tables import counted, one_text
    from belahil.uncertainty import by_chance

    if results["status"] != "ok":
        return [f"no scale: {results['status']}; windows: {counted(results['points'])}"]
    lines = [f"clock error {one_text(results['clock_ppm'])}"]
    for one in results["wobble"]:
        lines.append(f"pulses of {1e9 * one['width_s']:.0f} ns: wobble {_rms(one['rms'])}")
    lines += [
        f"pulses of {1e9 * one['width_s']:.0f} ns, {1e3 * one['peak_v']:.0f} mV: "
        f"delay {one_text(one['delay'])}, range {one_text(one['range'])}"
        for one in results["range_walk"][1:]
    ]
    agreement, bins = results["agreement"], results["linearity"]
    if agreement is not None:
        chi_square, freedom = agreement["chi_square"], agreement["degrees_of_freedom"]
        verb = "agree with" if by_chance(chi_square, freedom) else "differ from"
        lines.append(f"delays {verb} those of the known receiver: chi-square {chi_square:.1f} for {freedom}")
    if bins is not None:
        chi_square, freedom = bins["chi_square"], bins["bins"]
        verb = "is linear" if by_chance(chi_square, freedom) else "is not linear"
        lines.append(f"the clock {verb}: chi-square {chi_square:.1f} for {freedom} distances")
    if results["points"].keys() != {"ok"}:
        lines.append(f"windows: {counted(results['points'])}")
    return lines
