"""The figure of a terrain campaign: slopes of the analog, and RMS deviations of everything."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke

from procedures.arrival_ground import ROUGHNESS_M
from procedures.campaign_terrain import BASELINES_M
from procedures.study_ground import BASELINE_M

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from procedures.campaign_terrain_outcome import Terrains

_STYLES = (":", "--", "-.", (0, (1, 3)), (0, (6, 1, 1, 1, 1, 1)))


def terrain_figure(found: Terrains, bands: dict[str, NDArray[Any]] | None, source: str) -> Figure:
    """Draw the map of slopes with its areas, and deviations against baseline."""
    figure = Figure(figsize=(11.0, 4.9), layout="constrained")
    models = ""
    if bands is not None:
        models = (
            f" Green: {len(found.rows('model'))} pieces of terrain models, their median with its bootstrap "
            "uncertainty, 25-75 % and 1-99 % of them."
        )
    figure.set_label(
        f"(a) Slopes of the analog at a baseline of {found.analog['slope_baseline_m']:g} m, with the areas "
        "of (b) in the same line styles. (b) RMS deviation of heights against their distance. Black: the "
        "analog, whole (solid, with its uncertainty) and by area; grey: the eleven fractals." + models
    )
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.15))
    _map(left, found, source)
    _deviations(right, found, bands)
    return figure


def _map(axes: Axes, found: Terrains, source: str) -> None:
    own = found.analog
    x_min, x_max, y_min, y_max = own["slope_bounds_m"]
    slopes = np.ma.masked_array(np.degrees(own["slope_rad"]), ~own["slope_known"])
    top = max(float(np.percentile(slopes.compressed(), 99.5)), 1e-3)
    shown = axes.imshow(
        slopes, origin="lower", extent=(x_min, x_max, y_min, y_max), cmap="magma", vmin=0, vmax=top
    )
    for at, row in enumerate(found.rows("area")):
        x_m, y_m, side_m = own["boxes_m"][row]
        axes.add_patch(
            Rectangle(
                (x_m - side_m / 2, y_m - side_m / 2),
                side_m,
                side_m,
                fill=False,
                edgecolor="w",
                lw=1.8,
                ls=_STYLES[at % len(_STYLES)],
            )
        )
        name = axes.text(x_m, y_m, found.names[row], color="w", fontsize=9, ha="center", va="center")
        name.set_path_effects([withStroke(linewidth=2.5, foreground="k")])
    axes.set_xlabel("x from the middle, m")
    axes.set_ylabel("y from the middle, m")
    what = "made terrain that stands in" if source == "made terrain" else "analog terrain"
    axes.set_title(f"(a) {what}: slopes over {own['slope_baseline_m']:g} m", loc="left", fontsize=10)
    axes.figure.colorbar(shown, ax=axes, label="slope, deg", shrink=0.85, extend="max")


def _deviations(axes: Axes, found: Terrains, bands: dict[str, NDArray[Any]] | None) -> None:
    for at, row in enumerate(found.rows("fractal")):
        have = found.pairs[row] > 0
        label = f"11 fractals, {ROUGHNESS_M[0]:g} to {ROUGHNESS_M[-1]:g} m at {BASELINE_M:g} m"
        axes.loglog(
            found.baseline_m[row, have],
            found.rms_m[row, have],
            color="0.7",
            lw=1.0,
            label=None if at else label,
        )
    if bands is not None:
        _bands(axes, bands)
    for at, row in enumerate([*found.rows("analog"), *found.rows("area")]):
        have = found.pairs[row] > 0
        baseline_m, rms_m, u_m = (one[row, have] for one in (found.baseline_m, found.rms_m, found.u_m))
        style = "-" if row == 0 else _STYLES[(at - 1) % len(_STYLES)]
        axes.loglog(baseline_m, rms_m, color="k", ls=style, lw=1.6, label=f"analog, {found.names[row]}")
        if row == 0:
            axes.fill_between(
                baseline_m, np.maximum(rms_m - u_m, rms_m / 10), rms_m + u_m, color="k", alpha=0.15, lw=0
            )
    axes.grid(True, which="major", alpha=0.3)
    axes.set_xlabel("baseline, m")
    axes.set_ylabel("RMS deviation, m")
    axes.set_title("(b) RMS deviation", loc="left", fontsize=10)
    axes.legend(fontsize=8, loc="lower right")


def _bands(axes: Axes, bands: dict[str, NDArray[Any]]) -> None:
    have = bands["pieces"] > 0
    baseline_m, values = np.array(BASELINES_M)[have], bands["quantiles_m"][have]
    for low, high, alpha, label in ((0, 4, 0.18, "models, 1-99 %"), (1, 3, 0.35, "models, 25-75 %")):
        axes.fill_between(
            baseline_m, values[:, low], values[:, high], color="#009E73", alpha=alpha, lw=0, label=label
        )
    axes.errorbar(
        baseline_m,
        values[:, 2],
        bands["u_m"][have, 2],
        fmt="o",
        ms=4,
        color="#00694d",
        lw=1,
        label="models, median",
    )
