"""``belahil arrival-time``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from belahil.cli.options import Decimals, common, common_options, found_again, receiver_option, windows_option


@click.command("arrival-time", short_help="Delay of a detected arrival against the detected width.")
@click.option(
    "--gain-code", "code", type=click.IntRange(min=0), metavar="N", help="Gain code; 4 when left out."
)
@click.option("--widths", type=int, metavar="N", help="Pulse widths to play, 8 to 200; 14 when left out.")
@click.option("--pulse-windows", type=int, metavar="N", help="Windows for each width; 20 when left out.")
@click.option("--peak-mv", type=Decimals(-3), metavar="X", help="Height of the pulses at the cut; 100.")
@click.option("--terrain", metavar="FILE|SCENE", help="A GeoTIFF, or a scene; made terrain when left out.")
@click.option("--altitudes-km", type=Decimals(3), metavar="LIST", help="400,700,1000,1400; or the scene's.")
@click.option("--footprints", type=int, metavar="N", help="Along each side of a terrain, 0 for none; 12.")
@click.option("--ground-seed", type=int, metavar="N", help="Of made terrain; 1 when left out.")
@receiver_option
@windows_option
@common_options
def command(
    code: int | None,
    widths: int | None,
    pulse_windows: int | None,
    peak_mv: tuple[float, ...] | None,
    terrain: str | None,
    altitudes_km: tuple[float, ...] | None,
    footprints: int | None,
    ground_seed: int | None,
    receiver: Path | None,
    windows: Path | None,
    **given: Any,
) -> int:
    """Measure how much later a receiver detects a pulse, by the width that it detects.

    Plays pulses of known width, simulates footprints on terrain, and compares both with the model of the
    receiver and with the published correction.
    """
    from belahil.cli.measuring import Job, perform

    if peak_mv is not None and len(peak_mv) != 1:
        raise click.UsageError("--peak-mv: one height is allowed")
    chosen = {
        "code": code,
        "widths": widths,
        "windows": pulse_windows,
        "peak_v": None if peak_mv is None else peak_mv[0],
        "terrain": found_again(terrain),
        "altitudes_m": altitudes_km,
        "footprints": footprints,
        "ground_seed": ground_seed,
        "receiver": receiver,
    }
    return perform(Job("arrival-time", "ArrivalOptions", _lines), common(**given), chosen, windows)


def _lines(results: dict[str, Any]) -> list[str]:
    return [*_model_lines(results["model"]), *_bench_lines(results["bench"]), *_land_lines(results)]


def _model_lines(model: dict[str, Any]) -> list[str]:
    return [
        f"model ({model['origin']}) + published polynomial with {row['linear_coefficient']:g} W: "
        f"{1e9 * row['constant']['value']:.2f} ns within {1e9 * row['rms_s']:.2f} ns rms"
        for row in model["published"]
    ]


def _bench_lines(bench: dict[str, Any]) -> list[str]:
    from belahil.report.tables import one_text

    used = sum(row["status"] == "ok" for row in bench["points"])
    lines = [f"bench: {bench['status']}, {used} of {len(bench['points'])} widths usable"]
    if bench["agreement"] is not None:
        agreement = bench["agreement"]
        lines.append(
            f"bench and model {agreement['status']} in shape (chi-square {agreement['chi_square']:.1f} for "
            f"{agreement['degrees_of_freedom']}) and {agreement['constant_status']} in the constant, which "
            f"is apart by {one_text(agreement['constant'])}"
        )
    return lines


def _land_lines(results: dict[str, Any]) -> list[str]:
    from belahil.report.tables import one_text

    land = results["footprints"]
    if land is None:
        return []
    lines = [
        f"footprints: {land['status']}, {land['footprints_inside']} of {land['footprints']} on the curve"
    ]
    if land["status"] == "too_few_points":
        lines.append("too few widths have 20 footprints for a curve; --footprints takes more")
    if land["curve"] is not None:
        side = "far" if land["bias"]["value"] > 0 else "near"
        bias = {**land["bias"], "value": abs(land["bias"]["value"])}
        lines.append(
            f"at {1e9 * land['bias_fwhm_s']:.3g} ns a pulse appears {one_text(bias)} too {side}; "
            f"the curve leaves {one_text(land['residual'])} rms, "
            f"at most {one_text(land['residual_largest'])} at one width"
        )
    return lines
