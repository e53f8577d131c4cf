"""Figures of played echoes: a pulse with its residuals, and the echoes of a campaign side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from procedures.pulse_shape_fit import binned

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from procedures.pulse_shape_fit import ShapeFit
    from procedures.pulse_shape_results import CaseResult, Compared

PLAYED, WISHED, SAMPLES = "#0072B2", "#D55E00", "0.55"
_BINS, _FINE = 4, 8
"""Bins of the mean residual, and of a prediction, in a sample interval."""


def pulse_figure(one: CaseResult) -> Figure:
    """Draw the samples of all windows of an echo over its predictions, and what they leave.

    Parameters
    ----------
    one : CaseResult
        With a comparison.
    """
    assert one.played is not None
    fit = one.played.fit
    figure = Figure(figsize=(7.5, 6.2), layout="constrained")
    wished = "" if one.wished is None else " and for what was wished (dashed)"
    figure.set_label(
        f"{one.case.name}: samples of {one.windows} windows, each shifted to where its prediction fits best, "
        f"over the mean prediction for what was played (line){wished}. Below: measured minus predicted; "
        "points: every sample, for what was played; curves: means in quarters of a sample interval, two "
        "standard uncertainties about them."
    )
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    interval_s = one.interval_s
    zero_s = _peak_s(fit, interval_s)
    times_ns = _times_ns(fit, interval_s, zero_s)
    measured = fit.placement.predicted_v + fit.residual_v
    top.plot(times_ns.ravel(), 1e3 * measured.ravel(), ".", color=SAMPLES, ms=2, alpha=0.4, label="samples")
    told = f"predicted for what was played: {_told(one, one.played.reduced)}"
    _curve(top, fit, times_ns, interval_s, "-", PLAYED, told)
    if one.wished is not None:
        other = one.wished.fit
        shift_ns = 1e9 * float(np.mean(other.late_s - fit.late_s))
        wished_ns = _times_ns(other, interval_s, zero_s) - shift_ns
        told = f"predicted for what was wished: {_told(one, one.wished.reduced)}"
        _curve(top, other, wished_ns, interval_s, "--", WISHED, told)
    top.set_ylabel("at the converter, mV")
    top.legend(fontsize=8, loc="upper right")
    bottom.plot(times_ns.ravel(), 1e3 * fit.residual_v.ravel(), ".", color=SAMPLES, ms=2, alpha=0.25)
    if one.wished is not None:
        _means(bottom, one.wished.fit, wished_ns, interval_s, WISHED, "wished")
    _means(bottom, fit, times_ns, interval_s, PLAYED, "played")
    bottom.axhline(0, color="0.3", lw=0.6)
    spread = float(np.quantile(np.abs(1e3 * fit.residual_v), 0.999))
    bottom.set_ylim(-1.15 * spread or None, 1.15 * spread or None)
    bottom.set_ylabel("measured - predicted, mV")
    bottom.set_xlabel("time from the peak of the prediction, ns")
    return figure


def _curve(
    axes: Axes,
    fit: ShapeFit,
    times_ns: NDArray[np.float64],
    interval_s: float,
    line: str,
    colour: str,
    label: str,
) -> None:
    """Draw the predictions of all windows as one curve: their mean, where each has a waveform of its own."""
    means = binned(times_ns, fit.placement.predicted_v, 1e9 * interval_s / _FINE)
    axes.plot(means.places, 1e3 * means.means, line, color=colour, lw=1.3, label=label)


def _told(one: CaseResult, reduced: float) -> str:
    return f"reduced χ² {reduced:.3f}" if one.status == "ok" else one.status.replace("_", " ")


def _times_ns(fit: ShapeFit, interval_s: float, zero_s: float) -> NDArray[np.float64]:
    steps = np.arange(fit.placement.predicted_v.shape[1]) * interval_s
    times: NDArray[np.float64] = 1e9 * (np.add.outer(fit.placement.first_s, steps) - zero_s)
    return times


def _peak_s(fit: ShapeFit, interval_s: float) -> float:
    volts = np.abs(fit.placement.predicted_v)
    row, column = np.unravel_index(np.argmax(volts), volts.shape)
    return float(fit.placement.first_s[row] + column * interval_s)


def _means(
    axes: Axes, fit: ShapeFit, times_ns: NDArray[np.float64], interval_s: float, colour: str, label: str
) -> None:
    means = binned(times_ns, fit.residual_v, 1e9 * interval_s / _BINS)
    axes.errorbar(
        means.places,
        1e3 * means.means,
        2e3 * means.uncertainties,
        color=colour,
        fmt=".-",
        ms=3,
        lw=0.9,
        elinewidth=0.7,
        label=f"mean, {label}",
    )
    axes.legend(fontsize=8, loc="upper right")


def cases_figure(found: Compared) -> Figure:
    """Draw the reduced chi-square of every echo, for what was played and for what was wished."""
    figure = Figure(figsize=(7.5, 1.6 + 0.26 * len(found.cases)), layout="constrained")
    figure.set_label(
        "Reduced chi-square of each echo: for what was played (dots, with two standard uncertainties; hollow "
        "where it differs) and for what was wished (crosses). Shaded: three standard uncertainties about 1. "
        "An echo without points says why."
    )
    axes = figure.subplots()
    axes.plot([], [], "o", ms=5, color=PLAYED, label="for what was played")
    if any(one.wished is not None for one in found.cases):
        axes.plot([], [], "x", ms=6, color=WISHED, label="for what was wished")
    places = np.arange(len(found.cases))[::-1]
    for place, one in zip(places, found.cases, strict=True):
        if one.played is None or one.status != "ok":
            axes.text(1.0, place, one.status.replace("_", " "), fontsize=8, va="center", ha="center")
            continue
        filled = PLAYED if one.verdict == "agrees" else "white"
        axes.errorbar(
            one.played.reduced,
            place,
            xerr=2 * one.played.level_u,
            fmt="o",
            ms=5,
            color=PLAYED,
            mfc=filled,
            zorder=3,
        )
        band = 3 * one.played.level_u
        axes.fill_betweenx([place - 0.4, place + 0.4], 1 - band, 1 + band, color="0.9", zorder=0)
        if one.wished is not None:
            axes.plot(one.wished.reduced, place, "x", color=WISHED, ms=6)
    axes.set_yticks(places, [one.case.name for one in found.cases], fontsize=8)
    axes.set_ylim(-0.7, len(found.cases) - 0.3)
    axes.axvline(1, color="0.6", lw=0.8, zorder=1)
    low, high = axes.get_xlim()
    axes.set_xlim(min(low, 0.9), max(high, 1.1))
    axes.set_xlabel("reduced chi-square")
    axes.legend(fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
    return figure
