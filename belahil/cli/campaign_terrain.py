"""``belahil campaign terrain``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from belahil.cli.campaigning import Place, campaign_options, perform


@click.command("terrain", short_help="How rough analog terrains and terrain models are, by baseline.")
@click.option(
    "--terrain",
    metavar="FILE|SCENE",
    help="The analog: a GeoTIFF, or a scene over a grid of posts; a made multifractal when left out.",
)
@click.option(
    "--area",
    "areas",
    multiple=True,
    metavar="NAME=X,Y,SIDE",
    help="A square of it, m from its middle; may be repeated. Three are chosen when left out.",
)
@click.option(
    "--model",
    "models",
    multiple=True,
    metavar="FILE|SCENE",
    help="A terrain model whose quantiles are shown; may be repeated.",
)
@click.option("--tile-m", type=float, metavar="X", help="Cut models into squares; whole when left out.")
@click.option(
    "--slope-baseline-m", type=float, metavar="X", help="Of the map of slopes; one spacing when left out."
)
@click.option("--seed", type=click.IntRange(min=0), metavar="N", help="Of made terrain; 1.")
@campaign_options
def command(
    terrain: str | None,
    areas: tuple[str, ...],
    models: tuple[str, ...],
    tile_m: float | None,
    slope_baseline_m: float | None,
    seed: int | None,
    out: Path | None,
    resume: Path | None,
    workers: int | None,
    cluster: str | None,
    quiet: bool,
    as_json: bool,
) -> int:
    """Measure RMS deviations and slopes of an analog terrain, of eleven fractals and of terrain models."""
    chosen = {
        "terrain": terrain,
        "areas": areas or None,
        "models": models or None,
        "tile_m": tile_m,
        "slope_baseline_m": slope_baseline_m,
        "seed": seed,
    }
    place = Place(out, resume, workers, cluster, quiet, as_json)
    return perform("terrain", "TerrainOptions", chosen, place, _lines)


def _lines(results: dict[str, Any]) -> list[str]:
    from belahil.report.tables import one_text

    analog = results["analog"]
    lines = []
    for one in (analog, *analog["areas"]):
        if not one["deviations"]:
            lines.append(f"{one['name']}: too few posts for any baseline")
            continue
        near = min(one["deviations"], key=lambda row: abs(row["baseline_m"] - 25.0))
        lines.append(
            f"{one['name']}: RMS deviation {one_text(near['rms'])} at {near['baseline_m']:g} m, "
            f"Hurst exponent {one_text(one['hurst'])}"
        )
    models = results["models"]
    if models is not None:
        below = models["below_analog"]
        told = "none at the analog's baselines" if below is None else f"{100 * below:.1f} % below the analog"
        lines.append(
            f"{models['pieces']} pieces of models: {told}, {100 * models['within_fractals']:.1f} % "
            "within the fractals"
        )
    return lines
