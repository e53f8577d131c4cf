"""``belahil energy-calibration``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from belahil.cli.options import Decimals, common, common_options, receiver_option, windows_option


@click.command("energy-calibration", short_help="From electrical integrals to optical energy.")
@click.option(
    "--widths-ns",
    type=Decimals(-9),
    metavar="LIST",
    help="Full widths of the played pulses; 12 from 6 to 100 when left out.",
)
@click.option(
    "--peaks-mv", type=Decimals(-3), metavar="LIST", help="Their heights at the cut; 8,25,80 when left out."
)
@click.option(
    "--shots", type=click.IntRange(min=1), metavar="N", help="Of each width and height; 8 when left out."
)
@click.option(
    "--gain-code", type=click.IntRange(min=0), metavar="N", help="4 when left out, else the receiver's first."
)
@click.option(
    "--scene",
    metavar="SCENE",
    help="Laser, detector, and the terrain model of simulated footprints; fractal when left out.",
)
@click.option(
    "--footprints",
    type=click.IntRange(min=1),
    metavar="N",
    help="Simulated at each of six altitudes; 150 when left out.",
)
@receiver_option
@windows_option
@common_options
def command(
    widths_ns: tuple[float, ...] | None,
    peaks_mv: tuple[float, ...] | None,
    receiver: Path | None,
    windows: Path | None,
    shots: int | None,
    gain_code: int | None,
    scene: str | None,
    footprints: int | None,
    **given: Any,
) -> int:
    """Find what converts the integrals of a digitized pulse to the optical energy of its echo.

    Pulses of known width and area are played; planes and footprints are simulated; both are compared with the
    published lines.
    """
    from belahil.cli.measuring import Job, perform

    chosen = {
        "widths_s": widths_ns,
        "peaks_v": peaks_mv,
        "shots": shots,
        "gain_code": gain_code,
        "scene": scene,
        "footprints": footprints,
        "receiver": receiver,
    }
    return perform(Job("energy-calibration", "EnergyOptions", _lines), common(**given), chosen, windows)


def _lines(results: dict[str, Any]) -> list[str]:
    from belahil.report.tables import counted, one_text
    from belahil.uncertainty import by_chance, sized

    if results["status"] != "ok":
        return [f"no line: {results['status']}; windows: {counted(results['points'])}"]
    lines = []
    for name, words in (("gaussian", "fitted Gaussian"), ("window", "correlation window")):
        one, printed = results["measured"][name], results["published"][name]
        unit = one["slope"]["unit"]
        lines.append(
            f"{words}: slope {one_text(one['slope'])} (published {sized(printed['slope'], unit, 3)}), "
            f"intercept by slope {one_text(one['intercept_by_slope'])} "
            f"(published {1e9 * printed['intercept_by_slope']:.2f} ns), "
            f"{100 * one['left']:.1f} % left after the curve (published {100 * printed['left']:.1f} %)"
        )
        agreement = results["agreement"][name]
        if agreement is not None:
            chi_square, freedom = agreement["chi_square"], agreement["degrees_of_freedom"]
            verb = "agrees with" if by_chance(chi_square, freedom) else "differs from"
            lines.append(
                f"{words}: {verb} the known receiver, chi-square {chi_square:.1f} for {freedom} widths"
            )
    areas = (f"{one_text(one['ratio'])} at {1e3 * one['peak_v']:.3g} mV" for one in results["linearity"])
    lines.append(f"area found by area played, 1 for a linear receiver: {', '.join(areas)}")
    if results["points"].keys() != {"ok"}:
        lines.append(f"windows: {counted(results['points'])}")
    return lines
