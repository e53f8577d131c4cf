"""The figure of statements: our number over the published one, a row each."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from procedures.paper_statements import Statement

COLOURS = {"agrees": "#009E73", "open": "#E69F00", "differs": "#D55E00"}
_LEAST, _MOST = 0.08, 12.0
_ROW_INCH = 0.24


def statements_figure(stated: Sequence[Statement]) -> Figure:
    """Draw statements from top to bottom, each with its allowed side of the published number."""
    figure = Figure(figsize=(10.0, 1.3 + _ROW_INCH * len(stated)), layout="constrained")
    figure.set_label(
        "Our numbers over those of the study's text, or over the assumed limits, by statement. Grey: where "
        "a statement holds, rounding included. Bars: two standard uncertainties. Thin lines: what "
        "the assumed constants leave open, where the budget was computed. Arrows: beyond the scale."
    )
    axes = figure.subplots()
    for row, one in enumerate(stated):
        _draw(axes, -row, one)
    axes.axvline(1.0, color="#000000", lw=0.8)
    axes.set_xscale("log")
    axes.set_xlim(_LEAST, _MOST)
    ticks = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
    axes.set_xticks(ticks, [f"{one:g}" for one in ticks])
    axes.set_xticks((), minor=True)
    axes.set_yticks([-row for row in range(len(stated))], [f"{one.key}  {one.says}" for one in stated])
    axes.set_ylim(-len(stated) + 0.4, 0.6)
    axes.set_xlabel("ours / published or assumed limit")
    axes.tick_params(axis="y", length=0, labelsize=8)
    figure.legend(
        [Line2D([], [], color=colour, marker="o", ls="") for colour in COLOURS.values()],
        list(COLOURS),
        loc="outside upper right",
        ncols=len(COLOURS),
        frameon=False,
    )
    return figure


def _draw(axes: Axes, place: float, one: Statement) -> None:
    low, high = (1.0 + sign * one.rounding / one.published for sign in (-1, 1))
    ends = {"about": (low, high), "at most": (_LEAST, high), "at least": (low, _MOST)}[one.criterion]
    axes.barh(place, ends[1] - ends[0], left=ends[0], height=0.8, color="#DDDDDD", lw=0, zorder=0)
    colour = COLOURS[one.verdict]
    ours, spread = (
        number / one.published for number in (one.ours.value, 2.0 * one.ours.standard_uncertainty)
    )
    if one.interval is not None:
        axes.plot([end / one.published for end in one.interval], (place, place), color=colour, lw=1)
    if _LEAST < ours < _MOST:
        axes.errorbar(ours, place, xerr=spread, fmt="o", ms=4.5, lw=3, color=colour)
    else:
        at, marker = (_LEAST * 1.05, "<") if ours <= _LEAST else (_MOST / 1.05, ">")
        axes.plot(at, place, marker, ms=6, color=colour)
