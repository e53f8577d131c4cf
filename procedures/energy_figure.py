"""The figure of an energy calibration: energy against both integrals, and the ratio to the line."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from procedures.energy_results import PUBLISHED

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from procedures.energy_results import EnergyResults

MEASURED, PLANES, FOOTPRINTS, LINE = "#D55E00", "#0072B2", "#9A9A9A", "#000000"
_FJ_PER_MV = 1e12
_TITLES = {"gaussian": "Gaussian, $E_G$", "window": "correlation window, $E_{CW}$"}


def energy_figure(found: EnergyResults) -> Figure:
    """Draw optical energy against the integrals, above, and its ratio to the fitted line, below."""
    figure = Figure(figsize=(9.5, 6.4), layout="constrained")
    figure.set_label(
        "Above: optical energy against the integral of the pulse, both divided by the detected amplitude, at "
        "the reference gains. Orange: played pulses, measured, with their line. Blue: simulated echoes of "
        "planes. Grey: simulated footprints. Dashed: the published line. Below: the same divided by the line "
        "of the measured pulses (bars: two standard uncertainties of the mean of a width)."
    )
    axes = figure.subplots(2, 2, sharex="col", gridspec_kw={"height_ratios": (1.25, 1)})
    for column, name in enumerate(("gaussian", "window")):
        _draw(axes[0][column], axes[1][column], found, name)
    axes[0][0].set_ylabel("optical energy / amplitude, fJ/mV")
    axes[1][0].set_ylabel("energy / line")
    axes[0][1].legend(fontsize=8, loc="upper left")
    low = min(axes[1][0].get_ylim()[0], axes[1][1].get_ylim()[0])
    high = max(axes[1][0].get_ylim()[1], axes[1][1].get_ylim()[1])
    for one in axes[1]:
        one.set_ylim(low, high)
    return figure


def _draw(above: Axes, below: Axes, found: EnergyResults, name: str) -> None:
    fit, points = found.measured[name], found.points
    assert fit is not None
    every = [points.of(name), *(one.of(name) for one in found.model.values())]
    reach = np.linspace(
        min(one.min() for one in every if one.size), max(one.max() for one in every if one.size)
    )
    for echoes, colour, size in (("footprints", FOOTPRINTS, 3), ("planes", PLANES, 2)):
        if echoes in found.model:
            cloud = found.model[echoes]
            x, y = cloud.of(name), cloud.energy_j_per_v
            above.plot(1e9 * x, _FJ_PER_MV * y, ".", color=colour, ms=size, label=f"{echoes}, simulated")
            below.plot(1e9 * x, y / fit.line(x), ".", color=colour, ms=size)
    above.plot(
        1e9 * points.of(name),
        _FJ_PER_MV * points.energy_j_per_v,
        "o",
        color=MEASURED,
        ms=3,
        alpha=0.5,
        label="played, measured",
    )
    above.plot(
        1e9 * reach, _FJ_PER_MV * fit.line(reach), "-", color=MEASURED, lw=1, label="line through them"
    )
    slope, intercept, _ = PUBLISHED[name]
    printed = slope * reach + intercept
    above.plot(1e9 * reach, _FJ_PER_MV * printed, "--", color=LINE, lw=1, label="published line")
    below.errorbar(
        1e9 * fit.places_s, fit.ratios, 2 * fit.ratio_u, fmt="o", color=MEASURED, ms=4, lw=1, zorder=3
    )
    below.plot(1e9 * reach, printed / fit.line(reach), "--", color=LINE, lw=1)
    below.axhline(1, color=MEASURED, lw=0.8)
    below.set_xlabel("integral / amplitude, ns")
    above.set_title(_TITLES[name], fontsize=10)
    above.text(
        0.97,
        0.04,
        f"measured {1e7 * fit.slope.value:.3f} x {_sign(fit.intercept.value)}\n"
        f"published {1e7 * slope:.3f} x {_sign(intercept)}\n$10^{{-4}}$ fJ/mV, x in ns",
        transform=above.transAxes,
        ha="right",
        fontsize=8,
    )


def _sign(intercept_j_per_v: float) -> str:
    scaled = 1e4 * _FJ_PER_MV * intercept_j_per_v
    sign = "+" if scaled >= 0 else "\u2212"
    return f"{sign} {abs(scaled):.2f}"
