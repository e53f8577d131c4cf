"""Figures of a characterization, after those of Nishiyama et al., appendix C.

Their margins are given: to find them from the labels takes as long as to draw all three.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from procedures.butterworth_fit import ButterworthFit
    from procedures.gain_results import Characterization, CodeResult

# Okabe and Ito (2008): told apart by colour-blind readers and in grey.
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#000000")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")


def gain_figure(found: Characterization) -> Figure:
    """Draw gain against frequency with fits, gain and noise by code, and input noise by code."""
    figure = Figure(figsize=(11.5, 4.0))
    figure.set_label(
        "Left: gain against frequency at the shown gain code, one colour for each amplitude at the cut, with "
        "the fitted Butterworth filter (line) and the fits of all other codes scaled to the same gain "
        "(grey). Middle: gain and noise at the converter against gain code. Right: noise divided by "
        "gain; its least value marks the best code. Bars show two standard uncertainties."
    )
    # Left edge and width; the middle one has a second scale at its right.
    left, middle, right = (
        figure.add_axes((edge, 0.15, width, 0.785))
        for edge, width in ((0.05, 0.25), (0.352, 0.245), (0.748, 0.245))
    )
    _gain_against_frequency(left, found)
    _gain_and_noise(middle, found)
    _input_noise(right, found)
    for axes, letter in zip((left, middle, right), "abc", strict=True):
        axes.set_title(f"({letter})", loc="left", fontsize=10)
    return figure


def _megahertz(axes: Axes) -> None:
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.set_xlabel("frequency, MHz")


def _shown(found: Characterization) -> CodeResult | None:
    known = [one for one in found.codes if one.gain is not None]
    chosen = [one for one in known if one.fit is not None] or known
    return next((one for one in chosen if one.code == found.best_code), chosen[0] if chosen else None)


def _gain_against_frequency(axes: Axes, found: Characterization) -> None:
    _megahertz(axes)
    axes.set_ylabel("gain, V/V")
    shown = _shown(found)
    if shown is None:
        axes.text(0.5, 0.5, "no usable point", transform=axes.transAxes, ha="center")
        return
    if shown.fit is not None:
        _filters(axes, found, shown.fit)
    for number, amplitude in enumerate(np.unique(found.points.amplitude_vpp)):
        mine = found.points.chosen(shown.code, float(amplitude)) & found.points.usable
        axes.errorbar(
            found.points.frequency_hz[mine] / 1e6,
            found.points.gain[mine],
            2 * found.points.gain_u[mine],
            fmt=MARKERS[number % len(MARKERS)],
            color=COLOURS[number % len(COLOURS)],
            ms=4,
            lw=1,
            label=f"{amplitude * 1e3:g} mVpp",
            zorder=2,
        )
    axes.set_ylim(bottom=0)
    order = _order_text(shown.fit)
    code = "" if shown.code is None else f"gain code {shown.code}, "
    axes.legend(fontsize=8, loc="lower left", title=code + order, title_fontsize=8)


def _order_text(fit: ButterworthFit | None) -> str:
    if fit is None:
        return "cut-off unknown"
    return f"order {fit.order:g}" if fit.status == "ok" else "order unknown"


def _filters(axes: Axes, found: Characterization, shown: ButterworthFit) -> None:
    """Draw the fitted filter, and those of the other codes scaled to its gain."""
    measured = found.points.frequency_hz
    frequencies = np.geomspace(measured.min() / 1.3, measured.max() * 1.3, 400)
    for other in found.codes:
        if other.fit is not None and other.fit is not shown:
            axes.plot(
                frequencies / 1e6, shown.gain * other.fit.shape(frequencies), color="0.82", lw=2, zorder=1
            )
    axes.plot(frequencies / 1e6, shown.gain * shown.shape(frequencies), color="k", lw=1.2, zorder=3)


def _positions(found: Characterization) -> np.ndarray:
    return np.array([0 if one.code is None else one.code for one in found.codes])


def _gain_and_noise(axes: Axes, found: Characterization) -> None:
    codes = _positions(found)
    gain = [(code, one.gain) for code, one in zip(codes, found.codes, strict=True) if one.gain is not None]
    noise = [(code, one.noise) for code, one in zip(codes, found.codes, strict=True) if one.noise is not None]
    twin = axes.twinx()
    axes.errorbar(
        [code for code, _ in gain],
        [one.value for _, one in gain],
        [2 * one.standard_uncertainty for _, one in gain],
        fmt="o-",
        color=COLOURS[0],
        ms=4,
        lw=1,
    )
    twin.errorbar(
        [code for code, _ in noise],
        [1e3 * one.value for _, one in noise],
        [2e3 * one.standard_uncertainty for _, one in noise],
        fmt="s--",
        color=COLOURS[4],
        ms=4,
        lw=1,
    )
    axes.set_xlabel("gain code")
    axes.set_ylabel("gain, V/V", color=COLOURS[0])
    twin.set_ylabel("noise, mV rms", color=COLOURS[4])
    for one in (axes, twin):
        one.set_ylim(0, 1.05 * one.get_ylim()[1])
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))


def _input_noise(axes: Axes, found: Characterization) -> None:
    pairs = [
        (code, one.input_noise)
        for code, one in zip(_positions(found), found.codes, strict=True)
        if one.input_noise is not None
    ]
    axes.set_xlabel("gain code")
    axes.set_ylabel("input-referred noise, µV rms")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    if not pairs:
        axes.text(0.5, 0.5, "no usable point", transform=axes.transAxes, ha="center")
        return
    axes.errorbar(
        [code for code, _ in pairs],
        [1e6 * one.value for _, one in pairs],
        [2e6 * one.standard_uncertainty for _, one in pairs],
        fmt="o-",
        color=COLOURS[0],
        ms=4,
        lw=1,
    )
    best = next((one for code, one in pairs if code == found.best_code), None)
    if best is not None and found.best_code is not None:
        axes.plot(found.best_code, 1e6 * best.value, "o", ms=11, mfc="none", color=COLOURS[4], mew=1.5)
        axes.annotate(
            f"best: code {found.best_code}",
            (found.best_code, 1e6 * best.value),
            xytext=(0, -18),
            textcoords="offset points",
            ha="center",
            fontsize=9,
            bbox={"fc": "white", "ec": "none", "alpha": 0.8, "pad": 0.5},
            color=COLOURS[4],
        )
        axes.margins(y=0.15)


def estimator_figure(found: Characterization) -> Figure:
    """Draw pass-band gain against amplitude for the sine fit beside RMS and peak-to-peak estimators."""
    figure = Figure(figsize=(6.5, 4.0))
    figure.set_label(
        "Pass-band gain against amplitude at the cut, relative to the gain from the fit over all "
        "amplitudes, by three estimators from the same windows. Where only the RMS and peak-to-peak "
        "gains rise at small amplitudes, the rise belongs to the estimator and not to the receiver."
    )
    axes = figure.subplots(gridspec_kw={"left": 0.12, "right": 0.98, "bottom": 0.13, "top": 0.97})
    shown = _shown(found)
    rows = [] if shown is None else [row for row in found.by_amplitude if row.code == shown.code]
    if shown is None or shown.gain is None or not rows:
        axes.text(0.5, 0.5, "no usable point", transform=axes.transAxes, ha="center")
        return figure
    amplitude = np.array([row.amplitude_vpp for row in rows]) * 1e3
    for number, (name, label) in enumerate(
        (("sine_fit", "sine fit"), ("rms", "RMS √2"), ("peak_to_peak", "peak to peak"))
    ):
        value = np.array([getattr(row, name) for row in rows]) / shown.gain.value
        spread = np.array([row.sine_fit_u for row in rows]) / shown.gain.value if name == "sine_fit" else None
        axes.errorbar(
            amplitude,
            value,
            None if spread is None else 2 * spread,
            fmt=MARKERS[number] + "-",
            color=COLOURS[number],
            ms=5,
            lw=1,
            label=label,
        )
    axes.axhline(1, color="0.6", lw=0.8, zorder=0)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks(amplitude, [f"{one:g}" for one in amplitude])
    axes.minorticks_off()
    ticks = [one for one in (0.5, 0.8, 0.9, 1, 1.1, 1.2, 1.5, 2, 3, 5, 10, 20, 50) if _within(axes, one)]
    axes.set_yticks(ticks, [f"{one:g}" for one in ticks])
    axes.set_xlabel("amplitude at the cut, mVpp")
    axes.set_ylabel("gain relative to the fit")
    code = "" if shown.code is None else f"gain code {shown.code}"
    axes.legend(fontsize=9, title=code)
    return figure


def _within(axes: Axes, value: float) -> bool:
    low, high = axes.get_ylim()
    return low <= value <= high


def residual_figure(found: Characterization) -> Figure:
    """Draw what the fits leave over, in standard uncertainties, for all codes and amplitudes."""
    figure = Figure(figsize=(6.5, 3.6))
    figure.set_label(
        "Residuals of all usable points from the fit of their gain code, in their statistical standard "
        "uncertainties. A pattern in frequency points to another filter shape or to the generator's "
        "flatness; a colour that stands apart points to an amplitude error."
    )
    axes = figure.subplots(gridspec_kw={"left": 0.1, "right": 0.985, "bottom": 0.14, "top": 0.89})
    points = found.points
    expected = np.full(points.gain.shape, np.nan)
    for one in found.codes:
        if one.fit is not None:
            mine = points.chosen(one.code)
            expected[mine] = one.fit.gain * one.fit.shape(points.frequency_hz[mine])
    for number, amplitude in enumerate(np.unique(points.amplitude_vpp)):
        mine = (points.amplitude_vpp == amplitude) & points.usable & np.isfinite(expected)
        axes.plot(
            points.frequency_hz[mine] / 1e6,
            (points.gain[mine] - expected[mine]) / points.gain_u[mine],
            MARKERS[number % len(MARKERS)],
            color=COLOURS[number % len(COLOURS)],
            ms=3,
            alpha=0.6,
            label=f"{amplitude * 1e3:g} mVpp",
        )
    axes.axhspan(-2, 2, color="0.92", zorder=0)
    _megahertz(axes)
    axes.set_ylabel("residual / standard uncertainty")
    if axes.lines:
        axes.legend(fontsize=8, ncols=5, loc="upper center", bbox_to_anchor=(0.5, 1.16), frameon=False)
    return figure
