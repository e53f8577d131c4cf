"""The figure of a comparison with our range finder."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from procedures.rfm_parity_results import EchoRow, Findings

# Okabe and Ito (2008): told apart by colour-blind readers and in grey.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")


def parity_figure(found: Findings) -> Figure:
    """Draw detection probability and spread against signal to noise, and the differences by window."""
    figure = Figure(figsize=(12.0, 4.1), layout="constrained")
    figure.set_label(
        "Left: share of windows in which the echo was among the candidates, with intervals of Clopper and "
        "Pearson; middle: standard deviation of the time from marker to echo, with chi-square intervals; "
        "points as measured, bands and lines by the model, with what its parameters are uncertain by (all at "
        "95 %). Right: arrival as reported minus arrival as found again in the same samples, for every "
        "candidate; crosses: candidates that were not reported (lower edge), or were reported and not found "
        "again (upper edge); grey: what is tolerated. Squares: comparisons that failed."
    )
    left, middle, right = figure.subplots(1, 3)
    groups = _by_width(found)
    _comparison(left, groups, found, "probability", 1.0)
    left.set_ylabel("detection probability")
    left.set_ylim(-0.03, 1.03)
    _comparison(middle, groups, found, "spread", 1e9)
    middle.set_ylabel("spread of the arrival, ns rms")
    if middle.has_data():
        middle.set_yscale("log")
        middle.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        low, high = middle.get_ylim()
        # Within a narrow span no 2 and no 5 may lie.
        shown = "123456789" if high < 4 * low else "25"
        middle.yaxis.set_minor_formatter(lambda value, _: f"{value:.3g}" if f"{value:e}"[0] in shown else "")
        middle.set_xlim(left.get_xlim())
    if groups:
        left.legend(fontsize=9)
    _differences(right, found)
    for axes, letter in zip((left, middle, right), "abc", strict=True):
        axes.set_title(f"({letter})", loc="left", fontsize=10)
    return figure


def _by_width(found: Findings) -> dict[str, list[EchoRow]]:
    groups: dict[str, list[EchoRow]] = {}
    for row in found.echoes:
        if row.agreement is not None:
            width = "as recorded" if row.fwhm_s is None else f"{1e9 * row.fwhm_s:.3g} ns"
            groups.setdefault(width, []).append(row)
    return groups


def _snr(row: EchoRow, found: Findings) -> float:
    if row.snr is not None:
        return row.snr
    noise = found.receiver.at(row.code).noise_rms
    assert noise is not None
    assert row.echo_v is not None
    return row.echo_v / noise.value


def _comparison(
    axes: Axes, groups: dict[str, list[EchoRow]], found: Findings, name: str, factor: float
) -> None:
    for place, ((width, rows), colour) in enumerate(zip(groups.items(), COLOURS, strict=False)):
        ones = [(_snr(row, found), getattr(row.agreement, name)) for row in rows]
        known = sorted(((snr, one) for snr, one in ones if one is not None), key=lambda pair: pair[0])
        if not known:
            continue
        # A little beside each other, so that no bar hides another.
        snrs = np.array([snr for snr, _ in known]) * (1 + 0.02 * (place - (len(groups) - 1) / 2))
        models, measured = ([getattr(one, side) for _, one in known] for side in ("model", "measured"))
        axes.plot(snrs, [factor * one.value for one in models], "-", color=colour, lw=1)
        low, high = ([factor * getattr(one, end) for one in models] for end in ("low", "high"))
        axes.fill_between(snrs, low, high, color=colour, alpha=0.18, lw=0)
        values = np.array([one.value for one in measured])
        away = [values - [one.low for one in measured], [one.high for one in measured] - values]
        axes.errorbar(
            snrs,
            factor * values,
            factor * np.abs(away),
            fmt="o",
            color=colour,
            ms=4,
            lw=1,
            capsize=2,
            label=width,
        )
        failed = [one.decision == "fail" for _, one in known]
        axes.plot(
            snrs[failed], factor * values[failed], "s", mfc="none", mec="k", ms=10, mew=1.4, label="_failed"
        )
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.xaxis.set_minor_formatter(lambda value, _: f"{value:g}" if f"{value:e}"[0] in "235" else "")
    axes.tick_params(axis="x", which="minor", length=3.5)
    axes.set_xlabel("height over noise")


def _differences(axes: Axes, found: Findings) -> None:
    rows = found.compared
    tolerance_ps = 1e12 * found.plan.tolerances.arrival_s
    axes.set_xlabel("shot")
    axes.set_ylabel("arrival, reported minus found, ps")
    if not rows:
        axes.text(0.5, 0.5, found.status.replace("_", " "), ha="center", transform=axes.transAxes)
        axes.set_xticks([])
        axes.set_yticks([])
        return
    axes.axhspan(-tolerance_ps, tolerance_ps, color="0.9", lw=0)
    shots = [row.shot for row in rows for _ in row.pairs]
    axes.plot(shots, [1e12 * pair[0] for row in rows for pair in row.pairs], ".", color=COLOURS[0], ms=3)
    largest = max((abs(1e12 * pair[0]) for row in rows for pair in row.pairs), default=0.0)
    axes.set_yscale("symlog", linthresh=max(tolerance_ps, 1e-3))
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    top = 3 * max(largest, 3 * tolerance_ps, 1e-3)
    axes.set_ylim(-top, top)
    lonely = [
        (row.shot, place)
        for row in rows
        for count, place in ((row.missing, -top / 1.3), (row.extra, top / 1.3))
        if count
    ]
    if lonely:
        axes.plot(*zip(*lonely, strict=True), "x", color=COLOURS[1], ms=4)
    axes.set_title(f"{found.agreeing} of {len(rows)} windows agree", loc="right", fontsize=9)
