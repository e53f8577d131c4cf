"""The figure of a simulation: ground, light, voltages, samples."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from procedures.simulate import Simulation

_COLOURS = {"noise-free": "#0072B2", "night": "#009E73", "day": "#D55E00"}
_MARGIN_NS = 70.0
_MARKERS = {"noise-free": "o", "night": "s", "day": "^"}


def simulation_figure(simulation: Simulation) -> Figure:
    """Draw the ground with its footprint, the photon rates, and the voltages with samples and Gaussians."""
    figure = Figure(figsize=(11.0, 7.6), layout="constrained")
    figure.set_label(
        "(a) Height of the ground; the line is the footprint, where the beam has 1/e\N{SUPERSCRIPT TWO} of "
        "its peak. (b) Photons sent, and photons received by the photodiode; the time of flight to the gate "
        "is taken out. (c) Grey: voltage before the amplifier with shot noise; black: filtered, amplified, "
        "without noise; points: samples in three cases of noise, each with its Gaussian (dashed)."
    )
    grid = figure.add_gridspec(2, 2, height_ratios=(1.0, 1.15), width_ratios=(1.0, 1.35))
    _ground(figure.add_subplot(grid[0, 0]), simulation)
    _light(figure.add_subplot(grid[0, 1]), simulation)
    _volts(figure.add_subplot(grid[1, :]), simulation)
    return figure


def _ground(axes: Axes, simulation: Simulation) -> None:
    ground = simulation.ground
    shown = axes.pcolormesh(ground.x_m, ground.y_m, ground.height_m, cmap="cividis", rasterized=True)
    if np.ptp(ground.height_m) > 0:
        axes.contour(ground.x_m, ground.y_m, ground.height_m, 10, colors="k", linewidths=0.4, alpha=0.6)
    width, height = 2 * ground.radii_m[0], 2 * ground.radii_m[1]
    axes.add_patch(
        Ellipse(ground.centre_m, width, height, angle=ground.azimuth_deg, fill=False, edgecolor="w", lw=2)
    )
    axes.set_aspect("equal")
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")
    wide_m = 2 * ground.radii_m[0]
    axes.set_title(f"(a) ground, and the footprint of {wide_m:.3g} m", loc="left", fontsize=10)
    axes.figure.colorbar(shown, ax=axes, label="height, m", shrink=0.9)


def _light(axes: Axes, simulation: Simulation) -> None:
    curves, times_ns = simulation.curves, 1e9 * simulation.times_s
    sent, received = curves["transmitted_rate"], curves["received_rate"]
    right = axes.twinx()
    handles = []
    for side, rate, colour, what in (
        (axes, sent, "#AA4499", "sent"),
        (right, received, "k", "received"),
    ):
        peak = float(rate.max())
        power = math.floor(math.log10(peak)) if peak > 0 else 0
        handles += side.plot(times_ns, rate / 10**power, color=colour, lw=1.6, label=f"photons {what}")
        side.set_ylim(0, 1.15 * peak / 10**power or 1)
        side.set_ylabel(f"photons {what}, $10^{{{power}}}$ s$^{{-1}}$", color=colour)
        side.tick_params(axis="y", colors=colour)
    begin_ns, end_ns = _where_loud(times_ns, (sent, received), 1e-3)
    axes.set_xlim(begin_ns - 15, end_ns + 15)
    axes.set_xlabel("time from the gate, ns")
    axes.legend(handles=handles, fontsize=9, loc="upper right")
    axes.set_title("(b) photon rates", loc="left", fontsize=10)


def _where_loud(
    times_ns: NDArray[np.float64], rows: Sequence[NDArray[np.float64]], share: float
) -> tuple[float, float]:
    """First and last time at which one of the rows is above a share of its own peak."""
    loud = np.any([np.abs(row) > share * np.abs(row).max() for row in rows], axis=0)
    places = np.flatnonzero(loud)
    if not places.size:
        return float(times_ns[0]), float(times_ns[-1])
    return float(times_ns[places[0]]), float(times_ns[places[-1]])


def _volts(axes: Axes, simulation: Simulation) -> None:
    curves, times_ns = simulation.curves, 1e9 * simulation.times_s
    axes.plot(
        times_ns,
        1e3 * curves["before_amplifier"],
        color="0.65",
        lw=0.8,
        label="before the amplifier, with shot noise",
    )
    axes.plot(times_ns, 1e3 * curves["amplified"], color="k", lw=1.6, label="filtered and amplified")
    for case in simulation.cases:
        colour = _COLOURS[case.name]
        axes.plot(
            1e9 * case.times_s,
            1e3 * case.volts,
            _MARKERS[case.name],
            color=colour,
            ms=6,
            mec="w",
            mew=0.4,
            label=f"samples, {case.name}",
        )
        if case.fit.pulse is not None:
            receiver = simulation.chain.receiver
            # A fit counts in nominal intervals, the axis in true time.
            nominal = receiver.spec.sample_interval_s / receiver.grid.interval_s
            since_s = (simulation.times_s - case.times_s[0]) * nominal
            axes.plot(times_ns, 1e3 * case.fit.pulse.at(since_s), "--", color=colour, lw=1.1)
    axes.axhline(0, color="0.8", lw=0.6, zorder=0)
    begin_ns, end_ns = _where_loud(times_ns, [curves["amplified"]], 1e-2)
    sampled_ns = 1e9 * simulation.cases[0].times_s
    axes.set_xlim(max(begin_ns - _MARGIN_NS, sampled_ns[0]), min(end_ns + _MARGIN_NS, sampled_ns[-1]))
    axes.set_xlabel("time from the gate, ns")
    axes.set_ylabel("voltage, mV")
    axes.legend(fontsize=9, loc="upper right")
    axes.set_title("(c) voltages and samples; dashed: Gaussian fits", loc="left", fontsize=10)
