"""``belahil campaign reflectance``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from belahil.cli.campaigning import Place, campaign_options, echo_options, perform, sun_option


@click.command(
    "reflectance", short_help="Which kinds of ground pulses tell apart, from how high, with how many shots."
)
@echo_options
@sun_option
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
