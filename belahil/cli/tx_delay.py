"""``belahil tx-delay``."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path
from typing import Any

import click

from belahil.cli.options import common, common_options, receiver_option, windows_option

# As in procedures.tx_definitions and procedures.tx_likelihood, which a help text must not import numpy for.
_DEFINITIONS = (
    "centre_minus_peak",
    "centre_minus_cut_centroid",
    "centre_minus_full_centroid",
    "filtered_peak_minus_peak",
)
_BASELINES = ("common", "window")
_POSITIVE = click.FloatRange(min=0, min_open=True)
_PART = click.FloatRange(min=0, max=0.5, max_open=True)


@click.command("tx-delay", short_help="Threshold and delay of the transmitted pulse.")
@click.option("--shots", type=click.IntRange(min=2), metavar="N", help="Windows; 200 when left out.")
@click.option(
    "--gain-code", "--code", "code", type=click.IntRange(min=0), metavar="N", help="4 when left out."
)
@click.option(
    "--samples",
    "sample_count",
    type=click.IntRange(min=4),
    metavar="N",
    help="Samples of a window; 160 when left out.",
)
@click.option(
    "--delay-ns",
    type=click.FloatRange(min=0),
    metavar="T",
    help="From the shot pulse to the first sample; 0 when left out.",
)
@click.option(
    "--pulse-fwhm-ns",
    type=_POSITIVE,
    metavar="T",
    help="Pulse before the fibre: width of its Gaussian; 5.4 when left out, assumed.",
)
@click.option(
    "--pulse-tail-ns",
    type=click.FloatRange(min=0),
    metavar="T",
    help="Time constant of its exponential; 3 when left out, assumed.",
)
@click.option(
    "--pulse-table",
    type=click.Path(dir_okay=False),
    metavar="FILE",
    help="Instead: rows of time in s and relative power.",
)
@click.option(
    "--fall-uncertainty", type=_PART, metavar="X", help="Relative, of the time scale of its fall; 0.05."
)
@click.option(
    "--rise-uncertainty", type=_PART, metavar="X", help="Relative, of the time scale of its rise; 0.05."
)
@click.option(
    "--shape-uncertainty", type=_PART, metavar="X", help="Relative, of the power at any time; 0.03."
)
@click.option(
    "--definition", type=click.Choice(_DEFINITIONS), help="Of the delay; centre_minus_peak when left out."
)
@click.option(
    "--baseline",
    type=click.Choice(_BASELINES),
    help="One for all windows (common, when left out) or a free one in each.",
)
@receiver_option
@windows_option
@common_options
def command(
    shots: int | None,
    code: int | None,
    sample_count: int | None,
    delay_ns: float | None,
    pulse_fwhm_ns: float | None,
    pulse_tail_ns: float | None,
    pulse_table: str | None,
    fall_uncertainty: float | None,
    rise_uncertainty: float | None,
    shape_uncertainty: float | None,
    definition: str | None,
    baseline: str | None,
    receiver: Path | None,
    windows: Path | None,
    **given: Any,
) -> int:
    """Find the threshold below which a fibre loses the laser's pulse, and the delay of what is detected.

    The generator is silent; the receiver fires the laser.
    """
    from belahil.cli.measuring import Job, perform

    told = common(**given)
    chosen: dict[str, Any] = {
        "shots": shots,
        "code": code,
        "sample_count": sample_count,
        "delay_s": _seconds(delay_ns),
        "pulse_fwhm_s": _seconds(pulse_fwhm_ns),
        "pulse_tail_s": _seconds(pulse_tail_ns),
        "pulse_table": None if pulse_table is None else str(Path(pulse_table).resolve()),
        "fall_uncertainty": fall_uncertainty,
        "rise_uncertainty": rise_uncertainty,
        "shape_uncertainty": shape_uncertainty,
        "definition": definition,
        "baseline": baseline,
        "receiver": receiver,
    }
    return perform(Job("tx-delay", "TxDelayOptions", _lines), told, chosen, windows)


def _seconds(nanoseconds: float | None) -> float | None:
    """As a person would write it: 9 ns are 9e-09 s, not 9.000000000000001e-09."""
    return None if nanoseconds is None else float(Decimal(repr(nanoseconds)).scaleb(-9))


def _lines(results: dict[str, Any]) -> list[str]:
    from belahil.report.tables import one_text
    from procedures.tx_outcome import MEANINGS

    said = [f"status: {one}{f' ({MEANINGS[one]})' if one in MEANINGS else ''}" for one in results["statuses"]]
    if results["threshold"] is None:
        return said
    ends = results["threshold_interval"]
    span = f"{100 * ends['low']:.3g} to {100 * ends['high']:.3g} % of the peak with 95 %"
    lines = [f"threshold: {one_text(results['threshold'])}, {span}"]
    if results["threshold_bound"] is not None:
        lines.append(f"bound from noise alone: {100 * results['threshold_bound']:.2g} points")
    if results["joint"]["threshold"] is not None:
        lines.append(f"with cut-off and pulse free as well: {one_text(results['joint']['threshold'])}")
    if results["delay"] is not None:
        lines.append(f"delay ({results['definition']}): {one_text(results['delay'])}")
    fit = ", ".join(one.replace("_", " ") for one in results["families_that_fit"])
    return [*lines, f"what fits, with pulse and receiver taken as known: {fit}", *said]
