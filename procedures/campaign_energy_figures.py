"""The figures of the energy campaign."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter, PercentFormatter

from procedures.echo_energy import INTEGRALS
from procedures.energy_curves import MOST_PFD, cases, until_rare
from procedures.energy_parts import MAIN_DEG
from procedures.energy_statements import ALTITUDE_M, ERROR
from procedures.range_figures import COLOURS
from procedures.range_scenes import LIGHTS, MEAN_REFLECTANCE

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.axes import Axes

    from belahil.values import Estimate
    from procedures.energy_cells import EnergyCell
    from procedures.energy_curves import Case, Read

_OTHER = "#009E73"
_DASHES = {"day": "-", "night": "--"}
_WIDTHS = {"gaussian": 2.0, "window": 0.8}
_NAMES = {"gaussian": "E_G", "window": "E_CW"}
_APART_KM = 18.0
_TICKS = (0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0)


def error_figure(cells: Sequence[EnergyCell]) -> Figure:
    """Draw the paper's three panels: distributions by day, errors by reflectance, and by slope."""
    figure = Figure(figsize=(9.5, 12.0), layout="constrained")
    figure.set_label(
        "Errors of the energy of detected return pulses, the Sun at mean distance, until the probability of "
        "false detection reaches 90 %. (a) Distributions of single errors of E_G by day at slopes of 10 "
        "degrees: thick bars hold 68 % of them, thin ones 90 %, white lines are medians. (b) Rms errors of "
        "E_G, by day and by night. (c) by day and (d) by night: the same by slope at a reflectance of 0.17; "
        "thin: E_CW. Bands: two standard uncertainties; grey lines: 30 % and 900 km."
    )
    rows = figure.add_gridspec(3, 2, height_ratios=(1.0, 1.0, 1.15))
    upper = figure.add_subplot(rows[0, :])
    middle = figure.add_subplot(rows[1, :], sharex=upper)
    by_slope = [figure.add_subplot(rows[2, column]) for column in range(len(LIGHTS))]
    _distributions(upper, cells)
    curves = {case: row for case, row in cases(cells).items() if case.distance == "mean"}
    for case, row in curves.items():
        if case.slope_deg == MAIN_DEG:
            label = f"{case.reflectance:g}, {case.light}"
            own = COLOURS.get(case.reflectance, _OTHER)
            _curve(middle, row, lambda one: one.error(), own, _DASHES[case.light], 1.6, label)
    upper.set_title("(a) distributions of errors of E_G, day, 10 degrees", loc="left")
    middle.set_title("(b) errors of E_G by reflectance, 10 degrees", loc="left")
    for letter, light, axes in zip("cd", LIGHTS, by_slope, strict=True):
        _slopes(axes, curves, light)
        axes.set_title(f"({letter}) by slope, {light}, reflectance 0.17", loc="left")
    by_slope[1].sharey(by_slope[0])
    for axes in (middle, *by_slope):
        _errors_axis(axes)
        axes.set_xlabel("altitude, km")
    by_slope[1].set_ylabel("")
    for integral, width in _WIDTHS.items():
        by_slope[1].plot([], [], color="0.3", lw=width, label=_NAMES[integral])
    _legend(by_slope[1], ncols=2, loc="lower right", fontsize=9)
    _legend(middle, ncols=2, loc="lower right", title="reflectance, light")
    return figure


def _slopes(axes: Axes, curves: Mapping[Case, Sequence[EnergyCell]], light: str) -> None:
    """Errors by slope at the mean reflectance, with one light, by both integrals."""
    slopes = sorted({case.slope_deg for case in curves})
    for case, row in sorted(curves.items(), key=lambda pair: pair[0].slope_deg):
        if (case.reflectance, case.light) != (MEAN_REFLECTANCE, light):
            continue
        colour = colormaps["viridis"](0.9 * slopes.index(case.slope_deg) / max(1, len(slopes) - 1))
        for integral in INTEGRALS:
            label = f"{case.slope_deg:g} degrees" if integral == "gaussian" else ""
            _curve(axes, row, _reading(integral), colour, "-", _WIDTHS[integral], label)


def _distributions(axes: Axes, cells: Sequence[EnergyCell]) -> None:
    here = [
        one
        for one in cells
        if (one.condition.distance, one.condition.light, one.slope_deg) == ("mean", "day", MAIN_DEG)
        and one.pfd.value <= MOST_PFD
        and ("gaussian", "own") in one.errors
    ]
    reflectances = sorted({one.condition.reflectance for one in here})
    for number, reflectance in enumerate(reflectances):
        rows = [one for one in here if one.condition.reflectance == reflectance]
        colour = COLOURS.get(reflectance, _OTHER)
        km = np.array([one.altitude_m / 1e3 for one in rows]) + _APART_KM * (
            number - (len(reflectances) - 1) / 2
        )
        levels = np.array([one.errors["gaussian", "own"].levels for one in rows])
        axes.vlines(km, levels[:, 0], levels[:, 4], color=colour, lw=1.2)
        axes.vlines(
            km, levels[:, 1], levels[:, 3], color=colour, lw=5.0, label=f"reflectance {reflectance:g}"
        )
        axes.plot(km, levels[:, 2], "_", color="w", ms=5, mew=1.2)
    axes.axhline(0.0, color="0.6", lw=0.8)
    axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    axes.set_ylim(-0.75, 2.0)
    axes.set_ylabel("error of the energy")
    _legend(axes, loc="upper left")
    axes.grid(alpha=0.25)


def integral_figure(cells: Sequence[EnergyCell]) -> Figure:
    """Draw the error of E_CW over that of E_G, and what noise adds to the mean of E_G."""
    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    figure.set_label(
        "At slopes of 10 degrees, the Sun at mean distance: (a) rms error of E_CW over that of E_G; (b) mean "
        "error of E_G over detected pulses beside the calibrated bias: where echoes are hardly above the "
        "noise, those are detected that noise makes larger. Until the probability of false detection reaches "
        "90 %; bands: two standard uncertainties."
    )
    left, right = figure.subplots(1, 2)
    for case, row in cases(cells).items():
        if (case.distance, case.slope_deg) != ("mean", MAIN_DEG):
            continue
        colour, style = COLOURS.get(case.reflectance, _OTHER), _DASHES[case.light]
        label = f"{case.reflectance:g}, {case.light}"
        _curve(left, row, lambda one: one.window_by_gaussian, colour, style, 1.6, label)
        _curve(right, row, _mean_error, colour, style, 1.6, "")
    left.axhline(1.0, color="0.6", lw=0.8)
    left.set_title("(a) E_CW over E_G", loc="left")
    left.set_ylabel("ratio of rms errors")
    _legend(left, title="reflectance, light", ncols=2)
    left.set_ylim(0.0, 3.6)
    right.axhline(0.0, color="0.6", lw=0.8)
    right.set_title("(b) mean error of E_G", loc="left")
    right.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    right.set_ylabel("mean error")
    for axes in (left, right):
        axes.set_xlabel("altitude, km")
        axes.grid(alpha=0.25)
    return figure


def _mean_error(one: EnergyCell) -> Estimate | None:
    found = one.errors.get(("gaussian", "own"))
    return None if found is None else found.error.mean


def _reading(integral: str) -> Read:
    return lambda one: one.error(integral)


def _curve(
    axes: Axes,
    row: Sequence[EnergyCell],
    read: Read,
    colour: str | tuple[float, float, float, float],
    style: str,
    width: float,
    label: str,
) -> None:
    curve = until_rare(row, read)
    if not curve:
        return
    km = np.array([place for place, _ in curve]) / 1e3
    value = np.array([one.value for _, one in curve])
    wide = 2 * np.array([one.standard_uncertainty for _, one in curve])
    axes.plot(km, value, style, color=colour, lw=width, label=label or None)
    axes.fill_between(km, value - wide, value + wide, color=colour, alpha=0.2, lw=0)


def _legend(axes: Axes, **options: Any) -> None:
    """Add a legend, unless so little was detected that there is nothing to explain."""
    if axes.get_legend_handles_labels()[0]:
        axes.legend(frameon=False, **options)


def _errors_axis(axes: Axes) -> None:
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(FixedLocator(_TICKS))
    axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.axhline(ERROR, color="0.6", lw=0.8)
    axes.axvline(ALTITUDE_M / 1e3, color="0.6", lw=0.8)
    axes.set_ylim(0.04, 2.5)
    axes.set_ylabel("rms error of the energy")
    axes.grid(alpha=0.25)
