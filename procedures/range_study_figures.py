"""Figures of the range campaign against altitude and slope."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator

from procedures.range_scenes import LIGHTS, MEAN_REFLECTANCE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from belahil.values import Estimate
    from procedures.range_table import Cell

_LINES = {"all": "#000000", "noise": "#0072B2", "shape of pulse and ground": "#009E73", "pointing": "#CC79A7"}
_PFD = "#D55E00"
CONTOURS = ((0.05, "thin dotted"), (0.50, "thick dotted"), (0.90, "dashed"), (0.97, "solid"))
_STYLES = {"thin dotted": (":", 0.9), "thick dotted": (":", 2.0), "dashed": ("--", 1.3), "solid": ("-", 1.3)}
_LARGEST_M = 4.0


def altitude_figure(cells: Sequence[Cell]) -> Figure:
    """Draw the spread by source, and the probability of false detection, against altitude."""
    figure = Figure(figsize=(11.5, 4.8), layout="constrained")
    figure.set_label(
        "Range error by source against altitude by day (a) and by night (b), reflectance 0.17, slopes of 9 "
        "to 11 degrees; bands: two standard uncertainties. Dashed, right axis: probability of false "
        "detection."
    )
    left = figure.subplots(1, 2, sharey=True)
    for axes, light, letter in zip(left, LIGHTS, "ab", strict=True):
        here = [
            one
            for one in cells
            if one.condition.light == light and one.condition.reflectance == MEAN_REFLECTANCE
        ]
        km = [one.altitude_m / 1e3 for one in here]
        parts = {
            "all": [one.spread for one in here],
            "noise": [one.noise for one in here],
            "shape of pulse and ground": [one.shape for one in here],
            "pointing": [one.jitter for one in here],
        }
        for name, ones in parts.items():
            _band(axes, km, ones, _LINES[name], name)
        axes.set_title(f"({letter}) {light}", loc="left")
        axes.set_xlabel("altitude, km")
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter("")
        axes.grid(alpha=0.25)
        right = axes.twinx()
        right.plot(km, [100 * one.pfd.value for one in here], "--", color=_PFD, lw=1.5)
        right.set_ylim(0, 100)
        right.tick_params(axis="y", colors=_PFD)
        if light == LIGHTS[-1]:
            right.set_ylabel("probability of false detection, %", color=_PFD)
        else:
            right.set_yticklabels([])
    left[0].set_ylabel("range error, m rms")
    left[0].legend(frameon=False)
    return figure


def _band(axes: Axes, km: list[float], ones: list[Estimate | None], colour: str, label: str) -> None:
    there = [(x, one) for x, one in zip(km, ones, strict=True) if one is not None]
    x = [place for place, _ in there]
    value = np.array([one.value for _, one in there])
    wide = 2 * np.array([one.standard_uncertainty for _, one in there])
    axes.plot(x, value, color=colour, lw=1.5, label=label)
    axes.fill_between(x, np.maximum(value - wide, 0.2 * value), value + wide, color=colour, alpha=0.2, lw=0)


def map_figure(slopes_deg: Sequence[float], cells: Sequence[Cell]) -> Figure:
    """Draw the range error over slope and altitude with contours of the probability of false detection."""
    reflectances = sorted({one.condition.reflectance for one in cells})
    figure = Figure(figsize=(10.5, 3.5 * len(reflectances)), layout="constrained")
    lines = ", ".join(f"{style} {100 * level:g} %" for level, style in CONTOURS)
    figure.set_label(
        f"Range error of detections over slope and altitude. Contours of the probability of false detection: "
        f"{lines}; grey where it is above 97 %. Slopes are those of planes under the footprints; white dots: "
        "computed points."
    )
    grid = figure.subplots(len(reflectances), 2, sharex=True, sharey=True, squeeze=False)
    image = None
    for row, reflectance in enumerate(reflectances):
        for axes, light in zip(grid[row], LIGHTS, strict=True):
            here = [
                (slope, one)
                for slope, one in zip(slopes_deg, cells, strict=True)
                if (one.condition.light, one.condition.reflectance) == (light, reflectance)
            ]
            image = _panel(axes, here)
            axes.set_title(f"{light}, reflectance {reflectance:g}", loc="left")
    for axes in grid[-1]:
        axes.set_xlabel("slope, degrees")
    for axes in grid[:, 0]:
        axes.set_ylabel("altitude, km")
    handles: list[Line2D | Patch] = [
        Line2D([], [], color="k", ls=_STYLES[name][0], lw=_STYLES[name][1], label=f"{100 * level:g} %")
        for level, name in CONTOURS
    ]
    handles.append(Patch(color="0.6", label=f"above {100 * CONTOURS[-1][0]:g} %"))
    title = "probability of false detection:"
    figure.legend(
        [Line2D([], [], lw=0), *handles],
        [title, *(str(one.get_label()) for one in handles)],
        loc="outside lower center",
        ncols=len(handles) + 1,
        frameon=False,
    )
    assert image is not None
    figure.colorbar(image, ax=grid, label="range error, m rms", extend="max", shrink=0.8)
    return figure


def _panel(axes: Axes, here: list[tuple[float, Cell]]):  # type: ignore[no-untyped-def]
    slopes = sorted({slope for slope, _ in here})
    altitudes = sorted({one.altitude_m for _, one in here})
    error, pfd = (np.full((len(altitudes), len(slopes)), np.nan) for _ in range(2))
    for slope, one in here:
        at = altitudes.index(one.altitude_m), slopes.index(slope)
        pfd[at] = one.pfd.value
        if one.spread is not None:
            error[at] = one.spread.value
    km = np.array(altitudes) / 1e3
    levels = np.linspace(0, _LARGEST_M, 17)
    image = axes.contourf(slopes, km, np.ma.masked_invalid(error), levels, cmap="viridis", extend="max")
    axes.contourf(slopes, km, pfd, [CONTOURS[-1][0], 1.1], colors="0.6")
    for level, name in CONTOURS:
        style, width = _STYLES[name]
        axes.contour(slopes, km, pfd, [level], colors="k", linestyles=style, linewidths=width)
    axes.plot(*np.meshgrid(slopes, km), ".", color="w", ms=1.5)
    return image
