"""The figure of an arrival curve: bench and model, footprints, and the published polynomial."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from belahil.delay_curve import NARROWEST_S, WIDEST_S, published_curve

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from belahil.delay_curve import DelayCurve
    from procedures.arrival_outcome import Arrival

_MODEL, _BENCH, _LAND, _PUBLISHED = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
_SHOWN_PERCENT = (0.5, 99.5)


def arrival_figure(arrival: Arrival) -> Figure:
    """Draw delay against width: bench beside model, footprints, all beside the published polynomial."""
    figure = Figure(figsize=(11.0, 7.8), layout="constrained")
    figure.set_label(
        "(a) Delay of the detected centre of a pulse against its detected width. Line: the model of the "
        "receiver; points: the bench, with the delay of its reference pulses, whose two standard "
        "uncertainties are the band. (b) Bench less model at the same pulses, delays after the reference "
        "pulses; bars: two standard uncertainties; band: what the uncertainty of the model's cut-off makes. "
        "(c) Shift of footprints on terrain by detected width, as a share of each width; points: means; "
        "lines: polynomial through them, and the model; dashed: plus and minus the standard deviation. "
        "(d) The published polynomial with either linear coefficient plus a delay, which is a constant where "
        "both are right; the mean is taken off."
    )
    grid = figure.subplots(2, 2)
    _delays(grid[0, 0], arrival)
    _differences(grid[0, 1], arrival)
    _land(grid[1, 0], arrival)
    _published(grid[1, 1], arrival)
    for axes in grid.flat:
        # Left, since the lower right corner has the mark of emulated data.
        axes.set_xlabel("detected full width at half maximum, ns", loc="left")
    return figure


def _line(axes: Axes, curve: DelayCurve | None, colour: str, label: str, style: str = "-") -> None:
    if curve is None:
        return
    widths_s = np.linspace(curve.narrowest_s, curve.widest_s, 300)
    axes.plot(1e9 * widths_s, 1e9 * curve.at(widths_s), style, color=colour, lw=1.5, label=label)


def _delays(axes: Axes, arrival: Arrival) -> None:
    points = arrival.points
    _line(axes, arrival.model, _MODEL, "model, polynomial through Gaussian pulses")
    if points.reference is not None and points.usable:
        widths_ns = [1e9 * one.width.value for one in points.usable if one.width]
        delays_ns = np.array([1e9 * one.delay.value for one in points.usable if one.delay])
        delays_ns += 1e9 * points.reference.value
        width_ns = 2e9 * points.reference.standard_uncertainty
        axes.fill_between(
            widths_ns, delays_ns - width_ns, delays_ns + width_ns, color=_BENCH, alpha=0.2, lw=0
        )
        expected_ns = np.array([1e9 * one.model_delay_s for one in points.usable])
        if points.reference_model is not None:
            expected_ns += 1e9 * points.reference_model.value
        axes.plot(widths_ns, expected_ns, "+", color=_MODEL, ms=9, label="model at the pulses of the bench")
        axes.plot(widths_ns, delays_ns, "o", color=_BENCH, ms=4, label="bench")
    axes.set_ylabel("delay, ns")
    axes.set_title("(a) bench and model", loc="left", fontsize=10)
    axes.legend(fontsize=9)


def _differences(axes: Axes, arrival: Arrival) -> None:
    usable = arrival.points.usable
    axes.set_title("(b) bench less model, after the reference pulses", loc="left", fontsize=10)
    axes.axhline(0, color="k", lw=0.8)
    axes.set_ylabel("difference, ps")
    if not usable:
        axes.text(
            0.5, 0.5, f"no point: {arrival.points.status}", ha="center", va="center", transform=axes.transAxes
        )
        return
    widths_ns = [1e9 * one.width.value for one in usable if one.width]
    band_ps = np.array([1e12 * abs(one.model_u_s) for one in usable])
    axes.fill_between(
        widths_ns, -band_ps, band_ps, color=_MODEL, alpha=0.2, lw=0, label="cut-off of the model"
    )
    axes.errorbar(
        widths_ns,
        [1e12 * one.difference_s for one in usable],
        [2e12 * one.delay.standard_uncertainty for one in usable if one.delay],
        fmt="o",
        color=_BENCH,
        ms=4,
        lw=1,
        label="bench",
    )
    axes.margins(y=0.25)
    axes.legend(fontsize=9, ncols=2, loc="upper right")


def _land(axes: Axes, arrival: Arrival) -> None:
    axes.set_title("(c) footprints on terrain, without noise", loc="left", fontsize=10)
    axes.set_ylabel("shift, ns")
    found, terrain = arrival.found, arrival.terrain
    if found is None or terrain is None or not terrain.bins.count.size:
        axes.text(0.5, 0.5, "none", ha="center", va="center", transform=axes.transAxes)
        return
    inside = (found.width_s >= NARROWEST_S) & (found.width_s <= WIDEST_S)
    shifts_ns = 1e9 * found.shift_s[inside]
    low, high = np.percentile(shifts_ns, _SHOWN_PERCENT)
    edges = np.arange(1e9 * NARROWEST_S, 1e9 * WIDEST_S + 1, 2.0), np.linspace(low, high, 61)
    counts, *_ = np.histogram2d(1e9 * found.width_s[inside], shifts_ns, edges)
    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    shown = axes.pcolormesh(*edges, np.ma.masked_equal(share, 0).T, cmap="Greys", vmax=0.25, rasterized=True)
    axes.figure.colorbar(shown, ax=axes, label="share of a width", extend="max")
    bins = terrain.bins
    axes.plot(1e9 * bins.width_s, 1e9 * bins.shift_s, "o", color=_LAND, ms=3, label="mean")
    for sign in (-1, 1):
        axes.plot(1e9 * bins.width_s, 1e9 * (bins.shift_s + sign * bins.spread_s), "--", color=_LAND, lw=1)
    _line(axes, terrain.curve, _LAND, "polynomial")
    _line(axes, arrival.model, _MODEL, "model, Gaussian pulses")
    axes.set_ylim(low, high)
    axes.legend(fontsize=9, loc="lower left")


def _published(axes: Axes, arrival: Arrival) -> None:
    axes.set_title("(d) published polynomial + delay, less their mean", loc="left", fontsize=10)
    axes.set_ylabel("departure from a constant, ns")
    terrain = None if arrival.terrain is None else arrival.terrain.curve
    for curve, colour, label in (
        (arrival.model, _MODEL, "model"),
        (arrival.bench, _BENCH, "bench"),
        (terrain, _LAND, "footprints"),
    ):
        if curve is None:
            continue
        begin_s, end_s = max(NARROWEST_S, curve.narrowest_s), min(WIDEST_S, curve.widest_s)
        widths_s = np.linspace(begin_s, end_s, 300)
        for as_printed, style in ((False, "-"), (True, ":")):
            total_ns = 1e9 * (published_curve(as_printed=as_printed).at(widths_s) + curve.at(widths_s))
            words = "" if as_printed else f"{label}, 9.37e-2"
            axes.plot(1e9 * widths_s, total_ns - total_ns.mean(), style, color=colour, lw=1.5, label=words)
    axes.plot([], [], "k:", lw=1.5, label="9.37e-1, as printed")
    axes.set_ylim(-1.0, 1.0)
    axes.legend(fontsize=9)
