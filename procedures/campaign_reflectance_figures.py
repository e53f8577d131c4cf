"""The figures of the reflectance campaign."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter

from procedures.class_separation import WRONG
from procedures.range_scenes import LIGHTS
from procedures.reflectance_kinds import CONTRASTS, KINDS
from procedures.reflectance_reach import contrast_curve, mixture_curve
from procedures.reflectance_results import MIXTURES, SHARE_U

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from procedures.reflectance_reach import Curve
    from procedures.reflectance_results import ReflectanceCells

_COLOURS = ("#000000", "#D55E00", "#0072B2", "#009E73")
_DASHES = {"day": "-", "night": "--"}
_MOST_SHOTS = 1000.0


def contrast_figure(cells: ReflectanceCells) -> Figure:
    """Draw confusions with one shot, and shots that separate, against altitude."""
    figure = Figure(figsize=(11.5, 5.0), layout="constrained")
    figure.set_label(
        "Two kinds of ground against altitude, by day and by night, slopes of 10 degrees: (a) share of false "
        "alarms, and of misses, from one shot, at the threshold where both are alike; grey: 5 %, where they "
        "count as separate. (b) Detected shots whose mean separates them. Until nine detections of the "
        "fainter kind in ten are false. Bands: two standard uncertainties."
    )
    left, right = figure.subplots(1, 2)
    for one, colour in zip(CONTRASTS, _COLOURS, strict=True):
        for light in LIGHTS:
            label = f"{one.name} ({KINDS[one.low]:g}, {KINDS[one.high]:.3g})" if light == LIGHTS[0] else ""
            _curve(left, contrast_curve(cells, one.name, light, "wrong"), colour, light, label)
            _curve(right, contrast_curve(cells, one.name, light, "shots"), colour, light, "")
    left.axhline(WRONG, color="0.6", lw=0.8)
    left.set_yscale("log")
    left.set_ylim(1e-3, 0.6)
    left.yaxis.set_major_locator(FixedLocator([0.001, 0.01, 0.05, 0.1, 0.2, 0.5]))
    left.yaxis.set_major_formatter(FuncFormatter(lambda share, _: f"{100 * share:g}%"))
    left.yaxis.set_minor_formatter(NullFormatter())
    left.set_ylabel("false alarms and misses")
    left.set_title("(a) confusions with one shot", loc="left")
    for light, style in _DASHES.items():
        left.plot([], [], style, color="0.3", label=light)
    left.legend(frameon=False, fontsize=8.5, loc="lower right")
    right.set_yscale("log")
    right.set_ylim(0.8, _MOST_SHOTS)
    right.yaxis.set_major_locator(FixedLocator([1, 2, 5, 10, 20, 50, 100, 200, 500, 1000]))
    right.yaxis.set_major_formatter("{x:g}")
    right.yaxis.set_minor_formatter(NullFormatter())
    right.set_ylabel("shots")
    right.set_title("(b) shots that separate", loc="left")
    for axes in (left, right):
        axes.set_xlabel("altitude, km")
        axes.grid(alpha=0.25)
    return figure


def mixture_figure(cells: ReflectanceCells) -> Figure:
    """Draw how well single shots tell the share of ice in regolith against altitude."""
    figure = Figure(figsize=(7.0, 4.6), layout="constrained")
    figure.set_label(
        "Standard deviation of the share of ice from one shot, at the worse end of the mixture: ice beside "
        "regolith, and grains of both. Grey: 0.1 from one, ten and a hundred shots. Until nine detections of "
        "regolith in ten are false. Bands: two standard uncertainties."
    )
    axes = figure.subplots()
    for name, colour in zip(MIXTURES, _COLOURS[1:], strict=False):
        for light in LIGHTS:
            _curve(axes, mixture_curve(cells, name, light), colour, light, f"{name}, {light}")
    for shots in (1, 10, 100):
        axes.axhline(SHARE_U * np.sqrt(shots), color="0.6", lw=0.8)
        axes.annotate(
            f"{shots} shot{'s' if shots > 1 else ''}",
            (1.0, SHARE_U * np.sqrt(shots)),
            xycoords=("axes fraction", "data"),
            xytext=(-4, 3),
            textcoords="offset points",
            ha="right",
            color="0.4",
            fontsize=8,
        )
    axes.set_yscale("log")
    axes.set_ylim(0.05, 5.0)
    axes.yaxis.set_major_locator(FixedLocator([0.05, 0.1, 0.2, 0.5, 1, 2, 5]))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("altitude, km")
    axes.set_ylabel("standard deviation of the share of ice")
    axes.legend(frameon=False, loc="upper left")
    axes.grid(alpha=0.25)
    return figure


def _curve(axes: Axes, curve: Curve, colour: str, light: str, label: str) -> None:
    km = np.array([place for place, _ in curve]) / 1e3
    value = np.array([one.value for _, one in curve])
    wide = 2 * np.array([one.standard_uncertainty for _, one in curve])
    axes.plot(km, value, _DASHES[light], color=colour, lw=1.6, label=label or None)
    axes.fill_between(km, np.maximum(value - wide, 0.5 * value), value + wide, color=colour, alpha=0.2, lw=0)
