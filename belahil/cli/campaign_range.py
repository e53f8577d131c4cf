"""``belahil campaign range``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from belahil.cli.campaigning import Place, campaign_options, perform
from belahil.cli.options import found_again


@click.command(
    "range", short_help="Range errors and false detections by altitude, reflectance, day and night."
)
@click.option("--parts", metavar="LIST", help="Of table,altitude,map,budget,ladder,bias,columns; all.")
@click.option("--echoes", type=click.IntRange(min=1), metavar="N", help="On each terrain in each set; 60.")
@click.option("--repeats", type=click.IntRange(min=1), metavar="N", help="Shots about each echo; 6.")
@click.option("--sets", type=click.IntRange(min=1), metavar="N", help="Sets of echoes at each altitude; 8.")
@click.option(
    "--study-echoes", type=click.IntRange(min=1), metavar="N", help="On each terrain, other parts; 24."
)
@click.option("--noise-windows", type=click.IntRange(min=20), metavar="N", help="With noise only; 2000.")
@click.option(
    "--shots", type=click.IntRange(min=0), metavar="N", help="Whole shots on each terrain in each cell; 100."
)
@click.option("--seed", type=click.IntRange(min=0), metavar="N", help="Of all draws; 1.")
@click.option("--ground-seed", type=click.IntRange(min=0), metavar="N", help="Of the fractals; 100.")
@click.option("--terrain", metavar="FILE|SCENE", help="A terrain model for a column of its own.")
@click.option(
    "--truth",
    metavar="NAME",
    help="What is the true range: light (mean under the beam), centre (post in the middle) or plane; light.",
)
@click.option("--by-beam", is_flag=True, default=None, help="Weigh planes by the beam, not the disc.")
@campaign_options
def command(
    parts: str | None,
    echoes: int | None,
    repeats: int | None,
    sets: int | None,
    study_echoes: int | None,
    noise_windows: int | None,
    shots: int | None,
    seed: int | None,
    ground_seed: int | None,
    terrain: str | None,
    truth: str | None,
    by_beam: bool | None,
    out: Path | None,
    resume: Path | None,
    workers: int | None,
    cluster: str | None,
    quiet: bool,
    as_json: bool,
) -> int:
    """Predict the errors of ranges and the probability of false detection.

    By draws about the echo and the law of the largest noise peaks; beside it stand whole shots.
    """
    chosen = {
        "parts": None if parts is None else tuple(parts.split(",")),
        "echoes": echoes,
        "repeats": repeats,
        "sets": sets,
        "study_echoes": study_echoes,
        "noise_windows": noise_windows,
        "shots": shots,
        "seed": seed,
        "ground_seed": ground_seed,
        "terrain": found_again(terrain),
        "truth": truth,
        "by_beam": by_beam,
    }
    place = Place(out, resume, workers, cluster, quiet, as_json)
    return perform("range", "RangeOptions", chosen, place, _lines)


def _lines(results: dict[str, Any]) -> list[str]:
    from procedures.paper_statements import told as statements_told

    definitions = [results["definitions"][name] for name in ("true_range", "slope_and_roughness")]
    stated = statements_told(results["statements"])
    if "table" not in results:
        parts = [key for key in results if isinstance(results[key], dict) and key != "definitions"]
        return [*definitions, f"parts: {', '.join(parts)}", *stated]
    lines = [
        *definitions,
        "altitude  Sun         light  reflectance  error, m          PFD, %           by whole shots",
    ]
    for one in results["table"]["cells"]:
        error, pfd, brute = one["error"], one["pfd"], one["brute"]
        told = "" if error is None else f"{error['value']:.3f} +- {error['standard_uncertainty']:.3f}"
        chance = f"{100 * pfd['value']:.2f} +- {100 * pfd['standard_uncertainty']:.2f}"
        whole = ""
        if brute is not None:
            whole = "none detected" if brute["error"] is None else f"{brute['error']['value']:.2f} m"
            whole += f", {100 * brute['pfd']['value']:.1f} %"
        lines.append(
            f"{one['altitude_m'] / 1e3:5g} km  {one['sun']:10s}  {one['light']:5s}  "
            f"{one['reflectance']:11g}  {told:16s}  {chance:15s}  {whole}"
        )
    return [*lines, *stated]
