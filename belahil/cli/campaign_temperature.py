"""``belahil campaign temperature``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from belahil.cli.campaigning import Place, campaign_options, perform

_LASER = "SCENE"


@click.command("temperature", short_help="What the temperature of the laser head does to a return pulse.")
@click.option("--scene", metavar="SCENE", help="Instrument, altitude, reflectance; BELA at 500 km.")
@click.option("--slope-deg", type=float, metavar="X", help="Of the plane; 10 when left out.")
@click.option("--azimuth-deg", type=float, metavar="X", help="In which it rises; 0 when left out.")
@click.option("--cold", metavar=_LASER, help="Its laser is the cold one; the assumed one when left out.")
@click.option("--ambient", metavar=_LASER, help="Its laser is the ambient one; that of --scene.")
@click.option("--hot", metavar=_LASER, help="Its laser is the hot one; the assumed one when left out.")
@click.option(
    "--threshold",
    type=float,
    metavar="X",
    help="Part of the peak that the fibre loses of the sent pulse; 0.17.",
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
    """Compare return pulses of a cold, an ambient and a hot laser head with equal photons."""
    place = Place(out, resume, workers, cluster, quiet, as_json)
    return perform("temperature", "TemperatureOptions", chosen, place, _lines)


def _lines(results: dict[str, Any]) -> list[str]:
    from belahil.report.tables import one_text

    lines = []
    for name, one in results["against_ambient"].items():
        left = results["sets"][name]["msr_ambient_library"]
        lines.append(
            f"{name}: pulses differ by {one_text(one['difference'])} at most (text: 2 mV), range bias "
            f"{one_text(one['range_bias'])}, amplitude {100 * one['amplitude']['value']:+.2f} %, "
            f"MSR with the ambient library {1e6 * left['value']:.3g} mV2"
        )
    lines.append(f"hot against cold: {one_text(results['hot_against_cold']['difference'])}")
    return lines
