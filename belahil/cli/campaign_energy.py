"""``belahil campaign energy``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from belahil.cli.campaigning import Place, campaign_options, echo_options, perform


@click.command(
    "energy", short_help="Errors of the energy of return pulses by altitude, reflectance and slope."
)
@echo_options
@click.option(
    "--slope-echoes", type=click.IntRange(min=1), metavar="N", help="On each terrain at other slopes; 24."
)
@campaign_options
def command(
    out: Path | None,
    resume: Path | None,
    workers: int | None,
    cluster: str | None,
    quiet: bool,
    as_json: bool,
    **chosen: Any,
) -> int:
    """Tell how wrong the energy of a detected return pulse is, by its Gaussian and by its samples."""
    place = Place(out, resume, workers, cluster, quiet, as_json)
    return perform("energy", "EnergyErrorOptions", chosen, place, _lines)


def _lines(results: dict[str, Any]) -> list[str]:
    from belahil.report.tables import one_text
    from procedures.paper_statements import told

    lines = ["altitude  slope   light  reflectance  false, %   E_G error  mean error   E_CW error"]
    for one in results["cells"]:
        if one["sun"] != "mean" or one["slope_deg"] != 10.0 or one["altitude_m"] % 200e3:
            continue
        numbers = []
        for integral, name in (("gaussian", "error"), ("gaussian", "mean_error"), ("window", "error")):
            found = one["errors"][integral].get("own")
            numbers.append("" if found is None else f"{100 * found[name]['value']:.1f} %")
        lines.append(
            f"{one['altitude_m'] / 1e3:5g} km  {one['slope_deg']:g} deg  {one['light']:5s}  "
            f"{one['reflectance']:11g}  {100 * one['pfd']['value']:8.2f}   "
            f"{numbers[0]:9s}  {numbers[1]:11s}  {numbers[2]}"
        )
    for one in results["reach"]:
        at = one["error"]["altitude"]
        if at is not None and (one["sun"], one["slope_deg"], one["integral"]) == ("mean", 10.0, "gaussian"):
            case = f"reflectance {one['reflectance']:g}, {one['light']}"
            lines.append(f"error of E_G reaches 30 % at {one_text(at)}: {case}")
    return [*lines, *told(results["statements"])]
