"""``belahil campaign orbit``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from belahil.cli.campaigning import Place, campaign_options, perform, sun_option
from belahil.cli.options import Decimals
from belahil.cli.pulse_shape import Degrees


@click.command(
    "orbit", short_help="Which part of an orbit gives good ranges, and what a lower periapsis adds."
)
@click.option("--periapsis-km", type=float, metavar="X", help="Lowest altitude; 480.")
@click.option("--apoapsis-km", type=float, metavar="X", help="Highest altitude; 1500.")
@click.option(
    "--lowered-periapsis-km",
    type=float,
    metavar="X",
    help="Of the extended mission; 200 where that is below the other.",
)
@click.option(
    "--limits-km", type=Decimals(0), metavar="LIST", help="Altitudes up to which the laser fires; 1050,1400."
)
@click.option("--rate-hz", type=float, metavar="X", help="Shots in a second; 10.")
@click.option("--reflectances", type=Decimals(0), metavar="LIST", help="Of the ground; 0.08,0.17,0.30.")
@click.option("--slopes-deg", type=Degrees(), metavar="LIST", help="Of the ground; 0,10,20,30.")
@sun_option
@click.option(
    "--periapsis-latitude-deg",
    type=float,
    metavar="X",
    help="Of a polar orbit, for the mean over local times; 0.",
)
@click.option("--step-km", type=float, metavar="X", help="Between altitudes that are computed; 100.")
@click.option("--echoes", type=click.IntRange(min=1), metavar="N", help="On each terrain at each point; 48.")
@click.option("--repeats", type=click.IntRange(min=1), metavar="N", help="Shots about each echo; 3.")
@click.option("--noise-windows", type=click.IntRange(min=20), metavar="N", help="With noise only; 2000.")
@click.option("--calibration-echoes", type=click.IntRange(min=1), metavar="N", help="Of the energy; 20.")
@click.option("--seed", type=click.IntRange(min=0), metavar="N", help="Of all draws; 1.")
@click.option("--ground-seed", type=click.IntRange(min=0), metavar="N", help="Of the fractals; 100.")
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
    """Follow an elliptical orbit and tell where detections are false, by reflectance, slope and light.

    For the orbit as planned, up to altitudes at which the laser is switched off, and with a lower periapsis.
    """
    place = Place(out, resume, workers, cluster, quiet, as_json)
    return perform("orbit", "OrbitOptions", chosen, place, _lines)


def _lines(results: dict[str, Any]) -> list[str]:
    orbits = results["orbits"]
    lines = []
    for one in orbits:
        lines.append(
            f"{one['orbit']}: {one['periapsis_m'] / 1e3:g} x {one['apoapsis_m'] / 1e3:g} km, "
            f"{one['period_s'] / 3600:.3f} h, {one['shots']:.0f} shots a turn"
        )
    for one in results["limits"]:
        lines.append(f"below {one['limit_m'] / 1e3:g} km: {100 * one['time_share']:.1f} % of the time")
    slope_deg = min({one["slope_deg"] for one in results["shares"]}, key=lambda x: abs(x - 10.0))
    lines.append(f"share of the time, slope {slope_deg:g} deg, %; good ranges in thousands a day; error, m")
    lines.append(
        "orbit                   light       reflectance  PFD < 5 %    < 50 %       < 90 %       good"
    )
    for one in results["shares"]:
        if one["slope_deg"] == slope_deg:
            cells = [_text(one[f"below_{level}"], 100.0, 1) for level in (5, 50, 90)]
            error = "" if one["error"] is None else f"  {_text(one['error'], 1.0, 2)} m"
            lines.append(
                f"{one['orbit']:22s}  {one['light']:10s}  {one['reflectance']:11g}  "
                + "  ".join(f"{cell:11s}" for cell in cells)
                + f"  {_text(one['ranges_a_day'], 1e-3, 1)}{error}"
            )
    return lines


def _text(one: dict[str, Any], factor: float, digits: int) -> str:
    value, u = factor * one["value"], factor * one["standard_uncertainty"]
    return f"{value:.{digits}f}+-{u:.{digits}f}"
