"""The figure of a test of the time of flight: scale, wobble and range walk."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

from procedures.tof_fit import harmonics

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from procedures.tof_results import TofResults

POINT, BIN, LINE = "#9A9A9A", "#D55E00", "#0072B2"


def tof_figure(found: TofResults) -> Figure:
    """Draw measured less played distance, wobble against the place between samples, and delay by height."""
    figure = Figure(figsize=(11.5, 4.0), layout="constrained")
    figure.set_label(
        "Left: measured less played distance of two pulses, without the delays of their kinds and the "
        "wobble, against the distance; orange: means with two standard uncertainties; blue: the fitted "
        "scale. Middle: wobble of the fitted arrival with the place of the pulse between samples (lines), "
        "and single pairs by their second pulse (dots). Right: delay against the reference by height, "
        "colours as in the middle (bars: two standard uncertainties; dashed: expected of the known receiver)."
    )
    left, middle, right = figure.subplots(1, 3)
    _scale(left, found)
    _wobble(middle, found)
    _walk(right, found)
    return figure


def _scale(axes: Axes, found: TofResults) -> None:
    fit = found.fit
    assert fit is not None
    scale = 1e-6 * fit.scale_ppm.value
    corrected = fit.residual_s + scale * found.distance_s
    axes.plot(1e6 * found.distance_s, 1e12 * corrected, ".", color=POINT, ms=4, label="pairs")
    for number, (distance_s, mean) in enumerate(found.residual_bins):
        axes.errorbar(
            1e6 * distance_s,
            1e12 * (mean.value + scale * distance_s),
            2e12 * mean.standard_uncertainty,
            fmt="o",
            color=BIN,
            ms=4,
            label="means" if number == 0 else None,
        )
    reach = np.array([0.0, float(found.distance_s.max())])
    label = f"{fit.scale_ppm.value:.3f} ± {fit.scale_ppm.standard_uncertainty:.3f} ppm"
    axes.plot(1e6 * reach, 1e12 * scale * reach, "-", color=LINE, lw=1, label=label)
    spread = np.quantile(np.abs(fit.residual_s), 0.9)
    low, high = np.min(scale * reach) - 2 * spread, np.max(scale * reach) + 2 * spread
    axes.set_ylim(1e12 * low, 1e12 * high)
    axes.set_xlabel("distance of the pulses, µs")
    axes.set_ylabel("measured less played distance, ps")
    axes.legend(fontsize=8)


def _wobble(axes: Axes, found: TofResults) -> None:
    fit, converters = found.fit, found.receiver.converters
    assert fit is not None
    interval_s = found.receiver.sample_interval_s
    places = np.linspace(0, converters, 201)
    shades = colormaps["viridis"](np.linspace(0, 0.85, len(found.width_pulses)))
    for number, (pulse, shade) in enumerate(zip(found.width_pulses, shades, strict=True)):
        curve = harmonics(places, converters) @ fit.wobble[number]
        mine = found.widths[:, 1] == number
        at = found.arrivals_s[mine, 1] / interval_s
        dots = fit.residual_s[mine] + harmonics(at, converters) @ fit.wobble[number]
        axes.plot(at % converters, 1e12 * dots, ".", color=shade, ms=2, alpha=0.5)
        axes.plot(places, 1e12 * curve, "-", color=shade, lw=1.5, label=f"{1e9 * pulse.width_s:.0f} ns")
    most = np.quantile(np.abs(fit.residual_s), 0.9) + np.sqrt((fit.wobble**2).sum(axis=1)).max()
    axes.set_ylim(-1e12 * most, 1.8e12 * most)
    axes.set_xlabel("place of the arrival, samples")
    axes.set_ylabel("wobble, ps")
    axes.legend(fontsize=8, title="played width", title_fontsize=8)


def _walk(axes: Axes, found: TofResults) -> None:
    fit = found.fit
    assert fit is not None
    shades = colormaps["viridis"](np.linspace(0, 0.85, len(found.width_pulses)))
    for wide, shade in zip(found.width_pulses, shades, strict=True):
        kinds = [k for k, one in enumerate(found.kind_pulses) if abs(one.width_s / wide.width_s - 1) < 0.02]
        kinds.sort(key=lambda k: found.kind_pulses[k].peak_v)
        peaks = [1e3 * found.kind_pulses[k].peak_v for k in kinds]
        axes.errorbar(
            peaks,
            [1e12 * fit.delays[k].value for k in kinds],
            [2e12 * fit.delays[k].standard_uncertainty for k in kinds],
            fmt="o",
            color=shade,
            ms=4,
            lw=1,
        )
        axes.plot(peaks, [1e12 * found.expected_s[k] for k in kinds], "--", color=shade, lw=1)
    axes.set_xscale("log")
    heights = sorted({round(1e3 * one.peak_v, 1) for one in found.kind_pulses})
    axes.set_xticks(heights if len(heights) < 6 else heights[:: len(heights) // 4])
    axes.xaxis.set_major_formatter("{x:g}")
    axes.minorticks_off()
    axes.set_xlabel("height at the cut, mV", loc="left")
    axes.set_ylabel("delay against the reference, ps")
