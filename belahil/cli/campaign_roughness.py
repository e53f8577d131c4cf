"""``belahil campaign roughness``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from belahil.cli.campaigning import Place, campaign_options, perform


@click.command("roughness", short_help="What width and shape of a return pulse tell of roughness.")
@click.option("--altitude-km", type=float, metavar="X", help="From which ground is seen; 500.")
@click.option("--sets", type=click.IntRange(min=2), metavar="N", help="Sets of eleven fractals; 3.")
@click.option(
    "--per-side", type=click.IntRange(min=2), metavar="N", help="Footprints along each side of a terrain; 22."
)
@click.option("--terrain", metavar="FILE|SCENE", help="A terrain model whose footprints are shown beside.")
@click.option("--altitudes/--no-altitudes", default=None, help="Study other altitudes; yes when left out.")
@click.option("--slope-deg", type=float, metavar="X", help="Of the ground whose residuals are compared; 10.")
@click.option("--ellipticity", type=float, metavar="X", help="Of the beam, along x; 0, a round one.")
@click.option("--by-beam", is_flag=True, default=None, help="Weigh planes by the beam, not the disc.")
@click.option("--seed", type=click.IntRange(min=0), metavar="N", help="Of all draws; 1.")
@click.option("--ground-seed", type=click.IntRange(min=0), metavar="N", help="Of the fractals; 100.")
@campaign_options
def command(
    altitude_km: float | None,
    out: Path | None,
    resume: Path | None,
    workers: int | None,
    cluster: str | None,
    quiet: bool,
    as_json: bool,
    **chosen: Any,
) -> int:
    """Compare roughness from return pulses with that of the ground, by width and by shape."""
    given = chosen | {"altitude_m": None if altitude_km is None else 1e3 * altitude_km}
    place = Place(out, resume, workers, cluster, quiet, as_json)
    return perform("roughness", "RoughnessOptions", given, place, _lines)


def _lines(results: dict[str, Any]) -> list[str]:
    from belahil.report.tables import one_text

    width, library = results["width"], results["library"]
    lines = [
        f"width: {one_text(width['share_negative'])} of {width['footprints']} squares are negative, "
        f"correlation with the ground {width['correlation']:.2f}",
        f"library: slope of the best pulse less the ground's {one_text(library['slope_bias_deg'])}",
    ]
    for case, one in results["shape"].items():
        if one["pulse_power"] is not None:
            share = one_text(one["pulse_power"]["share"])
            lines.append(f"shape of the pulse, {case}: {share} of rough footprints beyond 99 % of smooth")
    if results["reach"] is not None:
        for how, by_reflectance in results["reach"]["highest"]["pulse"].items():
            for reflectance, one in by_reflectance.items():
                at = "" if one["altitude_m"] is None else f" up to {1e-3 * one['altitude_m']:.0f} km"
                lines.append(f"reflectance {reflectance}, {how}: tells roughness{at} ({one['status']})")
    return lines
