"""The figures of the range campaign."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from procedures.range_histograms import EDGES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from belahil.values import Estimate
    from procedures.range_histograms import Histogram
    from procedures.range_table import Headline, TableCell

COLOURS = {0.08: "#000000", 0.17: "#0072B2", 0.30: "#D55E00"}
_OTHER = "#009E73"
_LEAST_PFD = 1e-4


def table_figure(headline: Headline) -> Figure:
    """Draw error and probability of false detection of the cells against altitude, by day and by night."""
    figure = Figure(figsize=(11.0, 7.6), layout="constrained")
    figure.set_label(
        "Headline table, Sun at mean distance: rms range error of detections (a, b) and probability of false "
        "detection (c, d) at slopes of 9 to 11 degrees, by day (left) and by night (right). Lines: the fast "
        "way, two standard uncertainties are narrower than the markers where none show; open circles: whole "
        "shots, bars of two standard uncertainties; crosses: linear propagation, where it is valid. Below "
        f"{_LEAST_PFD:g} a probability is drawn at the lower edge."
    )
    grid = figure.subplots(2, 2, sharex=True, sharey="row")
    for column, light in enumerate(("day", "night")):
        for reflectance in sorted({one.cell.condition.reflectance for one in headline.cells}):
            cells = [
                one
                for one in headline.cells
                if (one.cell.condition.distance, one.cell.condition.light, one.cell.condition.reflectance)
                == ("mean", light, reflectance)
            ]
            colour = COLOURS.get(reflectance, _OTHER)
            _errors(grid[0, column], cells, colour, f"reflectance {reflectance:g}")
            _chances(grid[1, column], cells, colour)
        grid[0, column].set_title(f"({'ab'[column]}) {light}", loc="left")
        grid[1, column].set_title(f"({'cd'[column]}) {light}", loc="left")
        grid[1, column].set_xlabel("altitude, km")
    grid[0, 0].set_ylabel("range error, m rms")
    grid[1, 0].set_ylabel("probability of false detection")
    grid[0, 0].set_yscale("log")
    grid[0, 0].yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    grid[0, 0].yaxis.set_major_formatter("{x:g}")
    grid[0, 0].yaxis.set_minor_formatter("")
    grid[1, 0].set_yscale("log")
    grid[1, 0].set_ylim(_LEAST_PFD, 1.5)
    grid[0, 0].legend(frameon=False)
    for axes in grid.flat:
        axes.grid(alpha=0.25)
    return figure


def _errors(axes: Axes, cells: list[TableCell], colour: str, label: str) -> None:
    _line(axes, cells, [one.cell.spread for one in cells], colour, label)
    _points(axes, cells, [None if one.brute is None else one.brute.spread for one in cells], colour)
    valid = [one for one in cells if one.cell.linear.valid]
    axes.plot(_km(valid), [one.cell.linear.total_m for one in valid], "x", color=colour, ms=9)


def _chances(axes: Axes, cells: list[TableCell], colour: str) -> None:
    _line(axes, cells, [one.cell.pfd for one in cells], colour, "")
    _points(axes, cells, [None if one.brute is None else one.brute.pfd for one in cells], colour)


def _km(cells: list[TableCell]) -> list[float]:
    return [one.cell.altitude_m / 1e3 for one in cells]


def _line(axes: Axes, cells: list[TableCell], ones: list[Estimate | None], colour: str, label: str) -> None:
    there = [(km, one) for km, one in zip(_km(cells), ones, strict=True) if one is not None]
    values = np.maximum([one.value for _, one in there], _LEAST_PFD)
    bars = [2 * one.standard_uncertainty for _, one in there]
    axes.errorbar(
        [km for km, _ in there], values, bars, fmt=":o", ms=4, lw=1, color=colour, capsize=2, label=label
    )


def _points(axes: Axes, cells: list[TableCell], ones: list[Estimate | None], colour: str) -> None:
    there = [(km, one) for km, one in zip(_km(cells), ones, strict=True) if one is not None and one.value > 0]
    axes.errorbar(
        [km + 12 for km, _ in there],
        [one.value for _, one in there],
        [2 * one.standard_uncertainty for _, one in there],
        fmt="o",
        ms=7,
        mfc="none",
        color=colour,
        capsize=3,
        lw=1,
    )


_SOURCES = {
    "shape": ("#009E73", "-"),
    "pointing": ("#CC79A7", "-"),
    "noise by night": ("#0072B2", "-"),
    "noise by day": ("#D55E00", "-"),
    "all by night": ("#0072B2", ":"),
    "all by day": ("#D55E00", ":"),
}


def histogram_figure(shapes: Sequence[Histogram]) -> Figure:
    """Draw the distributions of errors by source, one panel for an altitude."""
    altitudes_m = sorted({one.altitude_m for one in shapes})
    figure = Figure(figsize=(12.5, 4.6), layout="constrained")
    figure.set_label(
        "Distributions of range errors by source at a reflectance of 0.17, slopes of 9 to 11 degrees, about "
        "their means. In the legends: standard deviation, and the probability that a normal distribution "
        "looks as little normal (D'Agostino and Pearson)."
    )
    for axes, altitude_m in zip(
        figure.subplots(1, len(altitudes_m), squeeze=False)[0], altitudes_m, strict=True
    ):
        here = [one for one in shapes if one.altitude_m == altitude_m and one.errors_m.size > 1]
        for one in here:
            colour, style = _SOURCES[one.source]
            chance = "" if one.p_value is None else f", p {one.p_value:.2g}"
            label = f"{one.source}: {one.rms_m:.2f} m{chance}"
            relative = one.density / one.density.max()
            axes.stairs(relative, EDGES * one.rms_m, color=colour, ls=style, lw=1.3, label=label)
        axes.set_title(f"{altitude_m / 1e3:g} km", loc="left")
        axes.set_xlabel("range error, m")
        axes.set_xlim(-3.5 * max(one.rms_m for one in here), 3.5 * max(one.rms_m for one in here))
        axes.set_ylim(0, 1.75)
        axes.legend(frameon=False, fontsize=8, loc="upper center")
    figure.axes[0].set_ylabel("density, relative to its largest")
    return figure
