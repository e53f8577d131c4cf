"""The figures of the range campaign."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from belahil.values import Estimate
    from procedures.range_table import Cell, Headline

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
        for reflectance in sorted({one.condition.reflectance for one in headline.cells}):
            cells = [
                one
                for one in headline.cells
                if (one.condition.distance, one.condition.light, one.condition.reflectance)
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


def _errors(axes: Axes, cells: list[Cell], colour: str, label: str) -> None:
    _line(axes, cells, [one.spread for one in cells], colour, label)
    _points(axes, cells, [None if one.brute is None else one.brute.spread for one in cells], colour)
    valid = [one for one in cells if one.linear.valid]
    axes.plot(_km(valid), [one.linear.total_m for one in valid], "x", color=colour, ms=9)


def _chances(axes: Axes, cells: list[Cell], colour: str) -> None:
    _line(axes, cells, [one.pfd for one in cells], colour, "")
    _points(axes, cells, [None if one.brute is None else one.brute.pfd for one in cells], colour)


def _km(cells: list[Cell]) -> list[float]:
    return [one.altitude_m / 1e3 for one in cells]


def _line(axes: Axes, cells: list[Cell], ones: list[Estimate | None], colour: str, label: str) -> None:
    there = [(km, one) for km, one in zip(_km(cells), ones, strict=True) if one is not None]
    values = np.maximum([one.value for _, one in there], _LEAST_PFD)
    bars = [2 * one.standard_uncertainty for _, one in there]
    axes.errorbar(
        [km for km, _ in there], values, bars, fmt=":o", ms=4, lw=1, color=colour, capsize=2, label=label
    )


def _points(axes: Axes, cells: list[Cell], ones: list[Estimate | None], colour: str) -> None:
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
