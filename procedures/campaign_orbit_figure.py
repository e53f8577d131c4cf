"""The figure of an orbit campaign."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from procedures.orbit_curves import along, probability
from procedures.orbit_shares import LEVELS, LIGHTS
from procedures.range_figures import COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from procedures.orbit_results import OrbitStudy, Row

_OTHER = ("#009E73", "#CC79A7", "#56B4E9", "#E69F00")
_STYLES = {"day": "-", "night": "--"}
_CLASSES = ("#0072B2", "#56B4E9", "#E69F00", "#D55E00")
"""Of time, from the best to the worst."""


def orbit_figure(made: OrbitStudy) -> Figure:
    """Draw orbits, curves and shares of time."""
    figure = Figure(figsize=(14.0, 9.0), layout="constrained")
    slope_deg, reflectance = made.usual
    figure.set_label(
        "(a) Altitude over one turn; dotted: limits. (b) Probability of false detection and (c) range error "
        f"of detections against altitude, slope {slope_deg:g} degrees, by day (solid) and by night (dashed), "
        "by reflectance; bands: two standard uncertainties; dotted: 5, 50 and 90 %. (d) Shares of the "
        f"nominal orbit's time by probability of false detection, slope {slope_deg:g} degrees. (e) By slope, "
        f"reflectance {reflectance:g}. (f) By orbit, at both of these."
    )
    above, below = figure.subplots(2, 3)
    _altitudes(above[0], made)
    _curves(above[1], made, slope_deg)
    _errors(above[2], made, slope_deg)
    first = next(iter(made.orbits))
    shines, slopes = sorted(made.options.reflectances), sorted(made.options.slopes_deg)
    _bars(
        below[0],
        [
            (f"{light}, {one:g}", made.share(first, slope_deg, one, light))
            for light in LIGHTS
            for one in shines
        ],
    )
    _bars(
        below[1],
        [
            (f"{light}, {one:g} deg", made.share(first, one, reflectance, light))
            for light in LIGHTS
            for one in slopes
        ],
    )
    _bars(
        below[2],
        [
            (f"{light}, {_size(made, name)}", made.share(name, slope_deg, reflectance, light))
            for light in LIGHTS
            for name in made.orbits
        ],
    )
    titles = ("by reflectance", "by slope", "by orbit")
    for axes, letter, title in zip(below, "def", titles, strict=True):
        axes.set_title(f"({letter}) {title}", loc="left")
    handles, labels = below[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    return figure


def _size(made: OrbitStudy, name: str) -> str:
    orbit = made.orbits[name]
    return f"{orbit.periapsis_m / 1e3:g} x {orbit.apoapsis_m / 1e3:g} km"


def _altitudes(axes: Axes, made: OrbitStudy) -> None:
    part = np.linspace(-0.5, 0.5, 401)
    for n, (name, orbit) in enumerate(made.orbits.items()):
        hours = part * orbit.period_s / 3600
        style = "-" if n == 0 else ("--", "-.")[(n - 1) % 2]
        axes.plot(hours, orbit.altitude_m(2 * np.pi * part) / 1e3, style, color="k", label=_size(made, name))
    for km in made.options.limits_km:
        axes.axhline(km, color="0.5", ls=":", lw=1)
        share = next(iter(made.orbits.values())).time_below(1e3 * km)
        axes.annotate(
            f"{km:g} km: {100 * share:.1f} % below",
            (0.5, km),
            xycoords=("axes fraction", "data"),
            ha="center",
            va="bottom",
            fontsize=8,
            color="0.3",
        )
    axes.set_xlabel("time after periapsis, h")
    axes.set_ylabel("altitude, km")
    axes.set_title("(a) orbits", loc="left")
    axes.set_ylim(0, None)
    axes.legend(frameon=False, fontsize=8, loc="lower right")


def _colour(made: OrbitStudy, reflectance: float) -> str:
    known = COLOURS.get(reflectance)
    if known is not None:
        return known
    others = [one for one in made.options.reflectances if one not in COLOURS]
    return _OTHER[others.index(reflectance) % len(_OTHER)]


def _curves(axes: Axes, made: OrbitStudy, slope_deg: float) -> None:
    for reflectance in made.options.reflectances:
        nodes, colour = made.curves[slope_deg, reflectance], _colour(made, reflectance)
        at_m = np.linspace(nodes.altitude_m[0], nodes.altitude_m[-1], 400)
        copies = along(nodes.altitude_m, nodes.logit, at_m)
        for light, style in _STYLES.items():
            row = -1 if light == "day" else 0
            percent = 100 * probability(copies[:, :, row])
            middle, wide = percent[0], 2 * percent[1:].std(axis=0)
            axes.plot(at_m / 1e3, middle, style, color=colour, lw=1.4)
            axes.fill_between(at_m / 1e3, middle - wide, middle + wide, color=colour, alpha=0.2, lw=0)
        axes.plot([], [], color=colour, label=f"reflectance {reflectance:g}")
    for level in LEVELS:
        axes.axhline(100 * level, color="0.5", ls=":", lw=1)
    axes.set_ylim(0, 100)
    axes.set_xlabel("altitude, km")
    axes.set_ylabel("probability of false detection, %")
    axes.set_title("(b) false detection", loc="left")
    axes.legend(frameon=False, fontsize=8, loc="upper left")


def _errors(axes: Axes, made: OrbitStudy, slope_deg: float) -> None:
    for reflectance in made.options.reflectances:
        nodes, colour = made.curves[slope_deg, reflectance], _colour(made, reflectance)
        at_m = np.linspace(nodes.altitude_m[0], nodes.altitude_m[-1], 400)
        copies = along(nodes.altitude_m, nodes.log_error, at_m)
        for light, style in _STYLES.items():
            row = -1 if light == "day" else 0
            if nodes.known[row]:
                middle, wide = copies[0, :, row], 2 * copies[1:, :, row].std(axis=0)
                axes.plot(at_m / 1e3, np.exp(middle), style, color=colour, lw=1.4)
                axes.fill_between(
                    at_m / 1e3, np.exp(middle - wide), np.exp(middle + wide), color=colour, alpha=0.2, lw=0
                )
    axes.set_yscale("log")
    axes.set_yticks([0.05, 0.1, 0.2, 0.5, 1, 2, 5])
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("")
    axes.grid(alpha=0.25)
    axes.set_xlabel("altitude, km")
    axes.set_ylabel("range error of detections, m rms")
    axes.set_title("(c) error", loc="left")


def _bars(axes: Axes, rows: list[tuple[str, Row]]) -> None:
    names = (
        f"below {100 * LEVELS[0]:g} %",
        *(f"{100 * low:g} to {100 * high:g} %" for low, high in pairwise(LEVELS)),
        f"{100 * LEVELS[-1]:g} % and more",
    )
    edges = np.array([[0.0, *(one.value for one in row.told.below), 1.0] for _, row in rows])
    u = np.array([[one.standard_uncertainty for one in row.told.below] for _, row in rows])
    at = np.arange(len(rows))[::-1]
    for n, (name, colour) in enumerate(zip(names, _CLASSES, strict=True)):
        wide = 100 * (edges[:, n + 1] - edges[:, n])
        axes.barh(
            at, wide, left=100 * edges[:, n], height=0.75, color=colour, label=f"false detection {name}"
        )
    for n in range(len(LEVELS)):
        axes.errorbar(
            100 * edges[:, n + 1], at, xerr=200 * u[:, n], fmt="none", ecolor="k", elinewidth=0.8, capsize=2
        )
    axes.set_yticks(at, [name for name, _ in rows], fontsize=8)
    axes.set_xlim(0, 100)
    axes.set_xlabel("share of the time, %")
