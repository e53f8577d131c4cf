"""``belahil campaign reflectance``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from belahil.cli.campaigning import Place, campaign_options, perform


@click.command(
    "reflectance", short_help="Which kinds of ground pulses tell apart, from how high, with how many shots."
)
@click.option("--echoes", type=click.IntRange(min=1), metavar="N", help="On each terrain in each set; 40.")
@click.option("--repeats", type=click.IntRange(min=1), metavar="N", help="Shots about each echo; 6.")
@click.option("--sets", type=click.IntRange(min=1), metavar="N", help="Sets of echoes at each altitude; 2.")
@click.option("--noise-windows", type=click.IntRange(min=20), metavar="N", help="With noise only; 1000.")
@click.option(
    "--calibration-echoes",
    type=click.IntRange(min=1),
    metavar="N",
    help="Without noise, on each terrain; 20.",
)
@click.option("--sun", metavar="mean|perihelion", help="Distance of the Sun; mean.")
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
    """Tell from which altitudes, and with how many shots, kinds of ground are told apart by their energy."""
    place = Place(out, resume, workers, cluster, quiet, as_json)
    return perform("reflectance", "ReflectanceOptions", chosen, place, _lines)


def _lines(results: dict[str, Any]) -> list[str]:
    from procedures.paper_statements import told

    lines = ["separate (5 % confusions) up to, km:                  1 shot   10 shots  100 shots"]
    for one in results["reach"]:
        name = f"{one['contrast']}, {one['light']}"
        reached = "  ".join(f"{_km(one[f'shots_{shots}']):>8s}" for shots in (1, 10, 100))
        lines.append(f"  {name:46s}  {reached}")
    lines.append("share of ice to 0.1 up to, km:")
    for one in results["mixing"]:
        name = f"{one['mixture']} mixture, {one['light']}"
        reached = "  ".join(f"{_km(one[f'shots_{shots}']):>8s}" for shots in (1, 10, 100))
        lines.append(f"  {name:46s}  {reached}")
    return [*lines, *told(results["statements"])]


def _km(one: dict[str, Any]) -> str:
    words = {"below": "> all", "above": "< all", "not_known": "-"}
    if one["altitude"] is None:
        return words[one["status"]]
    return f"{one['altitude']['value'] / 1e3:.0f}"
