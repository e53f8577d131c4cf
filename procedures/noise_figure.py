"""The figure of a noise measurement: noise and input-referred noise by gain code, spectra, and the burst."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from belahil.values import Estimate
    from procedures.noise_results import CodeNoise, NoiseResults
    from procedures.shot_locked import ShotLocked

BLUE, ORANGE, GREEN, RED = "#0072B2", "#E69F00", "#009E73", "#D55E00"


def noise_figure(found: NoiseResults) -> Figure:
    """Draw noise by gain code, noise by gain, noise density by frequency, and what is locked to the shot."""
    figure = Figure(figsize=(11.0, 7.2), layout="constrained")
    figure.set_label(
        "(a) Analog noise at the converter by gain code with the laser off and firing, and the raw value "
        "with quantization and converter offsets. (b) Noise divided by gain; the least value with the laser "
        "firing marks the best code. (c) One-sided noise density at the converter with the laser off, one "
        "line for each code; dashed with the laser firing, at the best code. (d) Mean of the windows with "
        "the laser firing at one gain code, that of the clearest burst where there is one; the band is two "
        "standard uncertainties of noise alone. Bars show two standard uncertainties."
    )
    axes = figure.subplots(2, 2).ravel()
    _by_code(axes[0], found)
    _by_gain(axes[1], found)
    _spectra(axes[2], found)
    _locked(axes[3], found)
    for one, letter in zip(axes, "abcd", strict=True):
        one.set_title(f"({letter})", loc="left", fontsize=10)
    return figure


def _places(ones: tuple[CodeNoise, ...]) -> list[int]:
    return [0 if one.code is None else one.code for one in ones]


def _bars(
    axes: Axes, codes: list[int], values: list[Estimate | None], symbol: str, colour: str, label: str
) -> None:
    known = [(code, one) for code, one in zip(codes, values, strict=True) if one is not None]
    if known:
        axes.errorbar(
            [code for code, _ in known],
            [1e3 * one.value for _, one in known],
            [2e3 * one.standard_uncertainty for _, one in known],
            fmt=symbol,
            color=colour,
            ms=4,
            lw=1,
            label=label,
        )


def _by_code(axes: Axes, found: NoiseResults) -> None:
    codes = _places(found.codes)
    _bars(axes, codes, [one.off.rms for one in found.codes], "o-", BLUE, "laser off")
    firing = [one.firing.rms if one.firing else None for one in found.codes]
    _bars(axes, codes, firing, "s--", RED, "laser firing")
    raw = [1e3 * one.off.dark.rms_total.value for one in found.codes]
    axes.plot(codes, raw, "x", color="0.4", ms=5, label="laser off, raw")
    _by_integers(axes, "noise at the converter, mV rms")


def _by_gain(axes: Axes, found: NoiseResults) -> None:
    codes = _places(found.codes)
    _bars(axes, codes, [one.input_off for one in found.codes], "o-", BLUE, "laser off")
    firing = [one.input_combined if one.firing else None for one in found.codes]
    _bars(axes, codes, firing, "s--", RED, "laser firing")
    best = next((one for one in found.codes if one.code == found.best_code), None)
    if best is not None and best.input_combined is not None:
        axes.plot(
            _places((best,)),
            [1e3 * best.input_combined.value],
            "o",
            ms=11,
            mfc="none",
            color=GREEN,
            label=f"best: {best.code}",
        )
    _by_integers(axes, "noise by gain, mV rms")


def _by_integers(axes: Axes, label: str) -> None:
    axes.set_xlabel("gain code")
    axes.set_ylabel(label)
    axes.set_ylim(0, 1.05 * axes.get_ylim()[1])
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8)


def _spectra(axes: Axes, found: NoiseResults) -> None:
    shades = colormaps["viridis"](np.linspace(0, 0.92, len(found.codes)))
    for shade, one in zip(shades, found.codes, strict=True):
        density = 1e9 * np.sqrt(one.off.dark.density_v2_per_hz[1:-1])
        label = "noise" if one.code is None else f"code {one.code}"
        axes.plot(one.off.dark.frequency_hz[1:-1] / 1e6, density, color=shade, lw=1, label=label)
    shown = next((one.firing for one in found.codes if one.code in (found.best_code, None)), None)
    if shown is not None:
        density = 1e9 * np.sqrt(shown.dark.density_v2_per_hz[1:-1])
        axes.plot(shown.dark.frequency_hz[1:-1] / 1e6, density, "--", color=RED, lw=1, label="firing")
    axes.set_xlabel("frequency, MHz")
    axes.set_ylabel("noise density, nV/√Hz")
    if any(np.any(one.off.dark.density_v2_per_hz[1:-1] > 0) for one in found.codes):
        axes.set_yscale("log")
    if len(found.codes) > 6:
        # Room below the curves, which fill the rest.
        axes.set_ylim(bottom=axes.get_ylim()[0] / 5)
        axes.legend(fontsize=7, ncols=5, loc="lower left")
    else:
        axes.legend(fontsize=7)


def _locked(axes: Axes, found: NoiseResults) -> None:
    axes.set_xlabel("time after the shot pulse, µs")
    axes.set_ylabel("mean window, mV")
    known = [(one.code, one.firing.locked) for one in found.codes if one.firing and one.firing.locked]
    if not known:
        axes.text(0.5, 0.5, "the laser did not fire", transform=axes.transAxes, ha="center")
        return
    code, shown = max(known, key=lambda pair: _clarity(pair[1]))
    interval_us = 1e6 * next(one for one in found.codes if one.code == code).off.interval_s
    times = np.arange(shown.mean_v.size) * interval_us
    first, last = _stretch(shown, times)
    axes.axhspan(-2e3 * shown.mean_u_v, 2e3 * shown.mean_u_v, color=BLUE, alpha=0.15, lw=0)
    axes.plot(times[first:last], 1e3 * shown.mean_v[first:last], color="0.25", lw=0.8)
    name = "" if code is None else f"code {code}: "
    said = {"ok": "burst", "no_burst": "no burst", "too_few_windows": "a single window"}[shown.status]
    axes.annotate(f"{name}{said}", (0.97, 0.94), xycoords="axes fraction", ha="right", fontsize=9)


def _clarity(one: ShotLocked) -> float:
    return one.peak.value / one.mean_u_v if one.peak is not None and one.mean_u_v else 0.0


def _stretch(one: ShotLocked, times: np.ndarray) -> tuple[int, int]:
    """Return which samples to show: those round the burst, or the first ones."""
    if one.peak is None:
        return 0, min(times.size, 1024)
    top = int(np.argmax(np.abs(one.mean_v)))
    length = 256 if one.decay is None else int(8 * one.decay.value * 1e6 / (times[1] - times[0])) + 64
    return max(top - length // 4, 0), min(top + length, times.size)
