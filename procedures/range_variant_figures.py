"""Figures of the variants of the range campaign: budget, ladder, bias, corrections, other ground."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator

from procedures.range_constants import OTHER_GROUND
from procedures.range_corrections import NAMES
from procedures.range_scenes import LIGHTS, MEAN_REFLECTANCE

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.axes import Axes

    from belahil.values import Estimate
    from procedures.range_budget import BudgetCell, Shift
    from procedures.range_constants import Constant
    from procedures.range_corrections import Corrected
    from procedures.range_table import Cell

_DAY, _NIGHT = "#D55E00", "#0072B2"
_LEAST_POINTS = 1.0
"""Of a probability that the axis of a panel has on either side: less is nothing to be seen."""
_SEEN_POINTS = 0.05
"""A panel in which nothing changes by as much is left out."""
_ALPHAS = {"low": 0.4, "high": 1.0}
_ROUNDING = 1e-9
_LEAST_M = 0.01
_COLOURS = {"day": _DAY, "night": _NIGHT}
_ALTITUDE_COLOURS = ("#000000", "#0072B2", "#009E73", "#D55E00", "#CC79A7")


def tornado_figure(budget: Sequence[BudgetCell]) -> Figure:
    """Draw how each assumed constant moves error and false detection at a reflectance of 0.17."""
    here = [one for one in budget if one.cell.condition.reflectance == MEAN_REFLECTANCE]
    altitudes_m = sorted({one.cell.altitude_m for one in here})
    figure = Figure(figsize=(14.0, 15.0), layout="constrained")
    figure.set_label(
        "What each assumed constant does over its range, low end (light) and high end (dark), at a "
        "reflectance of 0.17 and slopes of 9 to 11 degrees: change of the rms range error (upper row) and of "
        "the probability of false detection (lower row), by day (orange, upper bar) and by night (blue). "
        "Constants are sorted by what they do to the error by day at the highest altitude; those that do "
        "nothing at this reflectance are left out."
    )
    last = next(
        one for one in here if one.cell.altitude_m == altitudes_m[-1] and one.cell.condition.light == "day"
    )
    moving = [k for k in range(len(last.shifts)) if any(_moves(one.shifts[k]) for one in here)]
    order = sorted(
        moving,
        key=lambda k: max(abs(last.shifts[k].low[0].value), abs(last.shifts[k].high[0].value)),
    )
    grid = figure.subplots(2, len(altitudes_m), sharey=True, squeeze=False)
    for column, altitude_m in enumerate(altitudes_m):
        cells = [one for one in here if one.cell.altitude_m == altitude_m]
        for which in (0, 1):
            axes = grid[which, column]
            if which == 1 and not any(_shows(one) for one in cells):
                axes.set_axis_off()
                axes.set_title(f"{altitude_m / 1e3:g} km", loc="left")
                axes.text(0.0, 0.97, "no change", transform=axes.transAxes)
                continue
            for one in cells:
                _bars(axes, one, order, which)
            axes.axvline(0.0, color="k", lw=0.8)
            axes.grid(axis="x", alpha=0.25)
            axes.set_xlabel(("change of the error, %", "change of the PFD, points")[which])
            axes.set_title(f"{altitude_m / 1e3:g} km", loc="left")
            if which == 1:
                low, high = axes.get_xlim()
                axes.set_xlim(min(low, -_LEAST_POINTS), max(high, _LEAST_POINTS))
    labels = [_constant_text(last.shifts[k].constant) for k in order]
    for row in grid:
        row[0].set_yticks(range(len(order)), labels, fontsize=7.5)
        row[0].set_ylim(-0.7, len(order) - 0.3)
        first = next((axes for axes in row if axes.axison), row[0])
        if first is not row[0]:
            # They have the room of panels that are left out, and take none of the others'.
            _beside(first, labels)
    figure.legend(handles=_ends(), loc="outside upper center", ncols=4, frameon=False)
    return figure


def _beside(axes: Axes, labels: Sequence[str]) -> None:
    for place, label in enumerate(labels):
        axes.text(
            -0.03,
            place,
            label,
            transform=axes.get_yaxis_transform(),
            ha="right",
            va="center",
            fontsize=7.5,
            in_layout=False,
        )


def _constant_text(constant: Constant) -> str:
    if constant.name == OTHER_GROUND:
        return constant.name
    if not np.isfinite(constant.high):
        return f"{constant.name}\n{constant.low:g} {constant.unit}"
    return f"{constant.name}\n{constant.low:g} to {constant.high:g} {constant.unit}"


def _ends() -> list[Patch]:
    """What the colours of the bars mean."""
    return [
        Patch(color=_COLOURS[light], alpha=alpha, label=f"{light}, {end} end of the range")
        for light in LIGHTS
        for end, alpha in _ALPHAS.items()
    ]


def _shows(one: BudgetCell) -> bool:
    """Whether any constant moves the PFD by more than nothing to be seen."""
    points = [100 * abs(end[1].value) for shift in one.shifts for end in (shift.low, shift.high)]
    return max(points, default=0.0) > _SEEN_POINTS


def _moves(shift: Shift) -> bool:
    return any(abs(one.value) > _ROUNDING for one in (*shift.low, *shift.high))


def _bars(axes: Axes, one: BudgetCell, order: list[int], which: int) -> None:
    day = one.cell.condition.light == "day"
    colour, up = _COLOURS[one.cell.condition.light], 0.19 if day else -0.19
    for place, k in enumerate(order):
        for end, alpha in zip((one.shifts[k].low, one.shifts[k].high), _ALPHAS.values(), strict=True):
            value = 100 * (np.expm1(end[0].value) if which == 0 else end[1].value)
            axes.barh(place + up, value, 0.36, color=colour, alpha=alpha)


def ladder_figure(cells: Sequence[tuple[str, Cell]]) -> Figure:
    """Draw error and probability of false detection from rung to rung."""
    rungs = list(dict.fromkeys(label for label, _ in cells))
    figure = Figure(figsize=(11.5, 7.2), layout="constrained")
    figure.set_label(
        "From an earlier model to this one, reflectance 0.17, slopes of 9 to 11 degrees: rms range error "
        "(upper row) and probability of false detection (lower row), by day and by night, by altitude. Bars: "
        "two standard uncertainties."
    )
    grid = figure.subplots(2, 2, sharex=True, sharey="row")
    altitudes_m = sorted({one.altitude_m for _, one in cells})
    for column, light in enumerate(LIGHTS):
        for colour, altitude_m in zip(_ALTITUDE_COLOURS, altitudes_m, strict=False):
            here = [
                (rungs.index(label), one)
                for label, one in cells
                if (one.altitude_m, one.condition.light, one.condition.reflectance)
                == (altitude_m, light, MEAN_REFLECTANCE)
            ]
            _lines(grid[:, column], here, "o-", colour, f"{altitude_m / 1e3:g} km")
        grid[0, column].set_title(light, loc="left")
        grid[1, column].set_xticks(range(len(rungs)), rungs, rotation=25, ha="right", fontsize=8)
    grid[0, 0].set_ylabel("range error, m rms")
    _plain_log(grid[0, 0])
    grid[1, 0].set_ylabel("probability of false detection, %")
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside right upper", frameon=False)
    for axes in grid.flat:
        axes.grid(alpha=0.25)
    return figure


def bias_figure(cells: Sequence[tuple[float, float, Cell]]) -> Figure:
    """Draw error and probability of false detection against bias, and against temperature."""
    figure = Figure(figsize=(11.5, 7.2), layout="constrained")
    figure.set_label(
        "Rms range error (upper row) and probability of false detection (lower row) at a reflectance of 0.17 "
        "against the photodiode's bias at 20 C, and against its temperature at 320 V; by day (solid) and by "
        "night (dashed). The dark noise is held. Bars: two standard uncertainties."
    )
    grid = figure.subplots(2, 2, sharey="row")
    altitudes_m = sorted({one.altitude_m for _, _, one in cells})
    for column, (axis, fixed, value) in enumerate(((0, 1, 20.0), (1, 0, 320.0))):
        for colour, altitude_m in zip(_ALTITUDE_COLOURS, altitudes_m, strict=False):
            for light, style in (("day", "-"), ("night", "--")):
                here = [
                    ((bias_v, celsius)[axis], one)
                    for bias_v, celsius, one in sorted(cells, key=lambda setting: setting[:2])
                    if (bias_v, celsius)[fixed] == value
                    and (one.altitude_m, one.condition.light) == (altitude_m, light)
                ]
                _lines(grid[:, column], here, f".{style}", colour, f"{altitude_m / 1e3:g} km, {light}")
    grid[1, 0].set_xlabel("bias, V")
    grid[1, 1].set_xlabel("temperature of the photodiode, C")
    grid[0, 0].set_ylabel("range error, m rms")
    grid[1, 0].set_ylabel("probability of false detection, %")
    figure.legend(*grid[0, 1].get_legend_handles_labels(), loc="outside right upper", frameon=False)
    for axes in grid.flat:
        axes.grid(alpha=0.25)
    return figure


def _lines(
    axes: Sequence[Axes], here: Sequence[tuple[float, Cell]], style: str, colour: str, label: str
) -> None:
    """Draw errors in the first axes and false detections in the second, with their uncertainties."""
    _bars_at(axes[0], [(place, one.spread) for place, one in here], style, colour, label)
    _bars_at(axes[1], [(place, one.pfd) for place, one in here], style, colour, label, 100.0)


def _bars_at(
    axes: Axes,
    ones: Sequence[tuple[float, Estimate | None]],
    style: str,
    colour: str,
    label: str,
    scale: float = 1.0,
) -> None:
    there = [(place, one) for place, one in ones if one is not None]
    axes.errorbar(
        [place for place, _ in there],
        [scale * one.value for _, one in there],
        [2 * scale * one.standard_uncertainty for _, one in there],
        fmt=style,
        color=colour,
        capsize=2,
        lw=1.4,
        elinewidth=0.9,
        ms=4,
        label=label,
    )


def _plain_log(axes: Axes) -> None:
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("")


def columns_figure(cells: Sequence[tuple[str, Cell]]) -> Figure:
    """Draw error and probability of false detection over different ground against altitude."""
    figure = Figure(figsize=(11.5, 7.2), layout="constrained")
    figure.set_label(
        "Rms range error, dashed: its part of the shape of pulse and ground (upper row), and probability of "
        "false detection (lower row), over other ground with slopes of 9 to 11 degrees, reflectance 0.17, by "
        "day and by night. Bars: two standard uncertainties; what is below 1 cm is not drawn."
    )
    grid = figure.subplots(2, 2, sharex=True, sharey="row")
    grounds = list(dict.fromkeys(label for label, _ in cells))
    for column, light in enumerate(LIGHTS):
        for colour, ground in zip(_ALTITUDE_COLOURS, grounds, strict=False):
            here = [
                (one.altitude_m / 1e3, one)
                for label, one in cells
                if (label, one.condition.light, one.condition.distance, one.condition.reflectance)
                == (ground, light, "mean", MEAN_REFLECTANCE)
            ]
            here.sort(key=lambda pair: pair[0])
            _lines(grid[:, column], here, "o-", colour, ground)
            _bars_at(grid[0, column], [(place, one.shape) for place, one in here], ".--", colour, "")
        grid[0, column].set_title(light, loc="left")
        grid[1, column].set_xlabel("altitude, km")
    grid[0, 0].set_ylabel("range error, m rms")
    _plain_log(grid[0, 0])
    grid[0, 0].set_ylim(bottom=_LEAST_M)
    grid[1, 0].set_ylabel("probability of false detection, %")
    grid[0, 0].legend(frameon=False)
    for axes in grid.flat:
        axes.grid(alpha=0.25)
    return figure


def correction_figure(ones: Sequence[Corrected]) -> Figure:
    """Draw the range error with each correction of arrivals against altitude."""
    figure = Figure(figsize=(11.5, 4.8), layout="constrained")
    figure.set_label(
        "Rms range error about its own calibrated bias with each way to correct arrivals, reflectance 0.17, "
        "slopes of 9 to 11 degrees, by day and by night. Detections are those with our own curve."
    )
    styles: Mapping[str, tuple[str, str]] = dict(
        zip(NAMES, (("#000000", "-"), ("#0072B2", "--"), ("#D55E00", "-"), ("#009E73", ":")), strict=True)
    )
    for axes, light in zip(figure.subplots(1, 2, sharey=True), LIGHTS, strict=True):
        for name in NAMES:
            here = [one for one in ones if (one.light, one.name) == (light, name) and one.error is not None]
            colour, style = styles[name]
            axes.plot(
                [one.altitude_m / 1e3 for one in here],
                [one.error.value for one in here if one.error is not None],
                style,
                color=colour,
                lw=1.6,
                label=name,
            )
        axes.set_title(light, loc="left")
        axes.set_xlabel("altitude, km")
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.grid(alpha=0.25, which="both")
    figure.axes[0].set_ylabel("range error, m rms")
    figure.axes[0].legend(frameon=False)
    return figure
