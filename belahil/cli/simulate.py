"""``belahil simulate``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from belahil.cli.options import version_option


@click.command("simulate", short_help="A scene's echo, from the ground to the samples.")
@click.argument("scene")
@click.option(
    "--tolerance",
    type=float,
    metavar="X",
    help="Largest error, relative to the peak, from 1e-10 to below 1; 1e-4.",
)
@click.option("--shots", type=click.IntRange(min=1), metavar="N", help="Whole windows with noise; 10.")
@click.option(
    "--products",
    type=click.Choice(("window", "candidates", "correlation_windows", "window_and_candidates")),
    help="What the receiver reports of each window into data.nc; window.",
)
@click.option("--seed", type=click.IntRange(min=0), metavar="N", help="Goes before the scene's seed.")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="Run folder; new or empty.")
@click.option("--quiet", is_flag=True, help="Say nothing but errors.")
@click.option("--json", "as_json", is_flag=True, help="Print summary.json.")
@version_option
def command(
    scene: str,
    tolerance: float | None,
    shots: int | None,
    products: str | None,
    seed: int | None,
    out: Path | None,
    quiet: bool,
    as_json: bool,
) -> int:
    """Simulate SCENE: a TOML file, or the name of a scene that comes with the program.

    `belahil scene list` says what they are, `belahil scene show` what is in one.

    Ready: ambient, boulder, boulder-example, cold, crater, day, fractal, gala-like, hot, night, plane,
    previous-model.
    """
    from msgspec import structs

    from belahil.circumstances import left_out
    from belahil.cli.measuring import dated
    from belahil.cli.progress import shown
    from belahil.provenance import command_line
    from belahil.run_folder import refuse_used
    from belahil.scene_run import SceneRun
    from procedures.simulate import SimulateOptions, simulate
    from procedures.simulate_outcome import analyse, remarks
    from sim.accuracy import Accuracy
    from sim.chain import Chain
    from sim.scene import load_scene
    from sim.scene_text import commented

    loaded = load_scene(scene)
    if seed is not None:
        loaded = structs.replace(loaded, seed=seed)
    told: dict[str, Any] = {"tolerance": tolerance, "shots": shots, "products": products}
    options = SimulateOptions(**{key: value for key, value in told.items() if value is not None})
    folder = out or dated("simulate")
    refuse_used(folder)
    chain = Chain(loaded, Accuracy(options.tolerance))
    if not (quiet or as_json):
        print(chain.explain(), end="\n\n", flush=True)
    with shown(quiet, kept=0) as progress:
        simulation = simulate(loaded, options, progress, chain)
    instruments = {
        "laser": loaded.laser.preset,
        "detector": loaded.detector.preset,
        "receiver": loaded.receiver,
    }
    run = SceneRun(folder, "simulate", commented(loaded), loaded.seed, instruments)
    conditions = {"scene": scene, "windows": str(options.shots), "command": command_line()}
    spec = loaded.receiver_spec.digitizer
    summary = run.finish(analyse(simulation), simulation.reported, conditions, left_out(), spec)
    if as_json:
        sys.stdout.write((folder / "summary.json").read_text(encoding="utf-8"))
    elif not quiet:
        for line in [*_lines(summary["results"]), *(f"note: {one}" for one in remarks(simulation))]:
            print(line)
        print(f"report: {folder / 'report.html'}")
    return 0


def _lines(results: dict[str, Any]) -> list[str]:
    from belahil.report.tables import one_text
    from belahil.uncertainty import sized

    echo = results["echo"]
    lines = [
        f"echo: {echo['photons']:.4g} photons, {sized(echo['energy_j'], 'J', 3)}, "
        f"{sized(echo['peak_at_converter_v'], 'V', 3)} at the converter",
        "one shot, compared without noise, by night and by day:",
    ]
    lines += [
        f"  {row['case']}: noise {sized(row['noise_rms_v'], 'V', 3)} rms; {_fitted(row)}"
        for row in results["cases"]
    ]
    lines.append("every shot, with the noise of the scene:")
    shots = results["shots"]
    if results["status"] == "no_light":
        return [*lines, f"  no light comes back, so that there is no echo to find in {shots['count']} shots"]
    lines.append(
        f"  range finder: echo among its candidates in {shots['detected']} of {shots['count']} shots"
    )
    if shots["arrival_spread"] is not None:
        spread = one_text(shots["arrival_spread"])
        lines.append(
            f"  Gaussian: fits {shots['fitted']} of {shots['count']} shots, arrival varies by {spread}"
        )
    return lines


def _fitted(row: dict[str, Any]) -> str:
    from belahil.uncertainty import sized

    if row["status"] == "no_light":
        return "no light, no Gaussian"
    if row["arrival_s"] is None:
        return f"Gaussian {row['status']}"
    return (
        f"Gaussian {row['status']}, arrival {sized(row['arrival_s'], 's', 4)}, "
        f"fwhm {sized(row['fwhm_s'], 's', 4)}, amplitude {sized(row['amplitude_v'], 'V', 4)}"
    )
