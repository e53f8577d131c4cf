"""``belahil pulse-shape``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from belahil.cli.options import common, common_options, receiver_option, windows_option

_OWN = (
    "slopes_deg",
    "azimuths_deg",
    "shots",
    "dark_windows",
    "gain_code",
    "shot_noise",
    "interpolation",
    "tolerance",
)
"""Options that the procedure has under the same names."""


class Degrees(click.ParamType[tuple[float, ...]]):
    """Angles with commas between, in degrees; zero and negative ones too."""

    name = "list"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """Return the angles in the order given."""
        found = []
        for part in str(value).split(","):
            try:
                found.append(float(part))
            except ValueError:
                self.fail(f"{value!r}: write angles with commas between, as 0,5,10", param, ctx)
        return tuple(found)


@click.command(
    "pulse-shape", short_help="Echoes, played into the receiver and compared with their prediction."
)
@click.argument("scenes", nargs=-1, metavar="SCENE...")
@click.option("--slopes-deg", type=Degrees(), metavar="LIST", help="Planes of these slopes, for every scene.")
@click.option("--azimuths-deg", type=Degrees(), metavar="LIST", help="And of these azimuths.")
@click.option("--shots", type=click.IntRange(min=2), metavar="N", help="Windows of each echo; 200.")
@click.option("--dark-windows", type=click.IntRange(min=1), metavar="N", help="Silent ones of each code; 16.")
@click.option("--gain-code", type=click.IntRange(min=0), metavar="N", help="In place of the scenes' own.")
@click.option(
    "--shot-noise",
    type=click.Choice(("absent", "inside")),
    help="Play the mean echo, or with each shot another realization; absent.",
)
@click.option(
    "--interpolation",
    type=click.Choice(("linear", "hold")),
    help="What the generator makes of its points: lines or steps; linear.",
)
@click.option(
    "--tolerance",
    type=float,
    metavar="X",
    help="Largest error of an echo, relative to its peak, from 1e-10 to below 1; 1e-4.",
)
@receiver_option
@windows_option
@common_options
def command(scenes: tuple[str, ...], receiver: Path | None, windows: Path | None, **given: Any) -> int:
    """Play the echo of each SCENE, a file or the name of a ready scene, and compare it with its prediction.

    SCENE is left out with --windows and with --resume.
    """
    from belahil.cli.measuring import Job, perform
    from procedures.pulse_echoes import NamedScene
    from sim.scene import as_toml, load_scene

    chosen: dict[str, Any] = {name: given.pop(name) for name in _OWN}
    chosen["scenes"] = tuple(NamedScene(name, as_toml(load_scene(name))) for name in scenes)
    chosen["receiver"] = receiver
    job = Job("pulse-shape", "PulseShapeOptions", _lines)
    return perform(job, common(**given), chosen, windows)


def _lines(results: dict[str, Any]) -> list[str]:
    from belahil.report.tables import one_text

    lines = []
    for case in results["cases"]:
        said = [f"{case['name']}: {case['verdict']}"]
        if case["status"] != "ok":
            said.append(case["status"].replace("_", " "))
        for kind in ("played", "wished"):
            if case[kind] is not None:
                said.append(
                    f"reduced chi-square for what was {kind} {one_text(case[kind]['reduced_chi_square'])}"
                )
        if case["played"] is not None and case["played"]["failed"]:
            said.append("failed: " + ", ".join(case["played"]["failed"]))
        lines.append("; ".join(said))
    return lines
