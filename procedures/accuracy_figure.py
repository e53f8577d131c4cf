"""The work-precision picture: error against the time of a shot, a panel for each stage."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.axes import Axes

    from procedures.accuracy import WorkPrecision
    from procedures.accuracy_rows import Row

# Okabe and Ito: told apart with any colour vision.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#7F7F7F")
_MARKERS = "osD^vP*X"
_FAINTEST = 1e-16


def accuracy_figure(table: WorkPrecision) -> Figure:
    """Draw the rows that have an error and a time; the rest is named in the title of its panel."""
    stages = list(dict.fromkeys(row.stage for row in table.rows))
    figure = Figure(figsize=(10.0, 3.7 * len(stages) + 0.3), layout="constrained")
    figure.set_label(
        "Error against time of a shot, on logarithmic axes; further down and to the left is better. A line "
        "joins the settings of a method for one case. Rings: no other method for the case is both as fast "
        "and as exact. Crosses: error above what was asked for."
    )
    panels = figure.subplots(len(stages), 1, squeeze=False).ravel()
    for panel, stage in zip(panels, stages, strict=True):
        _draw(panel, stage, [row for row in table.rows if row.stage == stage])
    machine = table.machine
    where = (
        f"belahil {machine.versions['belahil']}",
        machine.processor,
        machine.threads,
        f"loops {machine.loops}",
    )
    figure.suptitle("; ".join(where), fontsize=9)
    return figure


def _draw(panel: Axes, stage: str, rows: list[Row]) -> None:
    shown = [row for row in rows if row.error is not None and row.microseconds is not None]
    cases, methods = _names(shown, lambda row: row.case), _names(shown, lambda row: row.method)
    by_case = len(cases) > 1
    for (case, method), group in itertools.groupby(shown, lambda row: (row.case, row.method)):
        members = list(group)
        number = cases.index(case) if by_case else methods.index(method)
        colour, marker = _COLOURS[number % len(_COLOURS)], _MARKERS[methods.index(method) % len(_MARKERS)]
        label = f"{case}: {method}" if by_case else method
        panel.plot(
            [_time(row) for row in members],
            [_error(row) for row in members],
            color=colour,
            marker=marker,
            ms=4,
            lw=1,
            label=label,
        )
        for row in members:
            if row.failure:
                panel.plot(_time(row), _error(row), "x", color="#a00000", ms=9, mew=1.6, zorder=4)
            elif row.pareto:
                panel.plot(_time(row), _error(row), "o", mfc="none", mec=colour, ms=9, mew=1.0, zorder=3)
    asked = {row.requested for row in rows}
    if len(asked) == 1 and (only := asked.pop()) is not None:
        panel.axhline(only, color="#555555", lw=0.8, ls=":", label="asked for")
    _frame(panel, shown)
    units = {row.unit for row in rows}
    panel.set_ylabel(f"error, {units.pop()}" if len(units) == 1 else "error, in the unit of its case")
    missing = len(rows) - len(shown)
    panel.set_title(stage + (f" ({missing} refused: see the table)" if missing else ""), fontsize=11)
    _legend(panel, any(row.failure for row in shown))


def _names(rows: list[Row], of: Callable[[Row], str]) -> list[str]:
    return list(dict.fromkeys(map(of, rows)))


def _frame(panel: Axes, shown: list[Row]) -> None:
    """Whole decades on both axes: ticks between them would run into each other."""
    panel.set_xscale("log")
    panel.set_yscale("log")
    for limit, values in ((panel.set_xlim, map(_time, shown)), (panel.set_ylim, map(_error, shown))):
        powers = [math.log10(value) for value in values] or [0.0]
        limit(10 ** math.floor(min(powers) - 0.2), 10 ** math.ceil(max(powers) + 0.2))
    panel.set_xlabel("time of a shot, \N{MICRO SIGN}s")
    panel.grid(alpha=0.25, lw=0.5)


def _legend(panel: Axes, failures: bool) -> None:
    handles, labels = panel.get_legend_handles_labels()
    handles.append(Line2D([], [], ls="", marker="o", mfc="none", mec="#555555", ms=9))
    labels.append("unbeaten in its case")
    if failures:
        handles.append(Line2D([], [], ls="", marker="x", color="#a00000", ms=8, mew=1.6))
        labels.append("above what was asked for")
    panel.legend(
        handles,
        labels,
        fontsize=8,
        loc="upper left",
        bbox_to_anchor=(1.01, 1.02),
        frameon=False,
    )


def _time(row: Row) -> float:
    return row.microseconds or _FAINTEST


def _error(row: Row) -> float:
    return max(row.error or 0.0, _FAINTEST)
