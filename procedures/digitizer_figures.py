"""The figure of a digitizer test: a spectrum, the figures by gain code, and the two converters."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from procedures.gain_points import weighted_mean

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from belahil.values import Estimate
    from procedures.digitizer_points import DigitizerReadings, SinePoint
    from procedures.digitizer_summary import Converters
    from procedures.gain_points import Interleave

BLUE, ORANGE, GREEN, RED = "#0072B2", "#E69F00", "#009E73", "#D55E00"
_LEAST_DBFS = -140.0


def digitizer_figure(readings: DigitizerReadings, by_code: list[SinePoint], found: Converters) -> Figure:
    """Draw a spectrum, SINAD, SFDR and THD by gain code, and the skew by frequency."""
    figure = Figure(figsize=(12.0, 4.2), layout="constrained")
    figure.set_label(
        "Left: spectrum of one record of the highest level, Hann taper, in dB of a full-scale sine; "
        "triangles mark harmonics 2 to 10, circles what differs between the converters. Middle: "
        "spurious-free range, SINAD and harmonic distortion (sign turned) by gain code, at the lowest "
        "frequency that reached the highest level; open marks are bounds, where noise hides the "
        "lines. Right: gain and sampling time of even less odd samples, mean at each frequency and of all "
        "(line). Bars show two standard uncertainties."
    )
    left, middle, right = figure.subplots(1, 3, width_ratios=(1.3, 1, 1))
    _spectrum(left, readings)
    _by_code(middle, by_code)
    _between(figure, right, readings, found)
    for axes, letter in zip((left, middle), "ab", strict=True):
        axes.set_title(f"({letter})", loc="left", fontsize=10)
    return figure


def _spectrum(axes: Axes, readings: DigitizerReadings) -> None:
    axes.set_xlabel("frequency, MHz")
    axes.set_ylabel("dBFS in a bin")
    if readings.shown is None:
        axes.text(0.5, 0.5, "no sine with figures", transform=axes.transAxes, ha="center")
        return
    point, window = readings.shown
    volts = window.volts - window.volts.mean()
    count = volts.size
    taper = np.hanning(count + 1)[:-1]
    size = np.abs(np.fft.rfft(volts * taper)) / taper.sum() * 2
    assert point.level_dbfs is not None
    # The level of the sine sets the scale, so that the span need not be known here.
    span_v = 10 ** ((point.level_dbfs.value - 20 * np.log10(size.max())) / 20)
    level = np.maximum(20 * np.log10(np.maximum(size * span_v, 1e-30)), _LEAST_DBFS)
    megahertz = np.arange(size.size) / (count * window.sample_interval_s) / 1e6
    axes.plot(megahertz, level, color="0.45", lw=0.5)
    rate_hz = 1 / window.sample_interval_s

    def mark(frequency_hz: float, symbol: str, colour: str, label: str | None) -> None:
        turns = frequency_hz / rate_hz
        place = round(abs(turns - round(turns)) * count)
        near = level[max(place - 2, 0) : place + 3]
        axes.plot(
            megahertz[min(place, size.size - 1)],
            near.max() + 3,
            symbol,
            ms=5,
            mfc="none",
            color=colour,
            label=label,
        )

    for harmonic in range(2, 11):
        mark(harmonic * point.frequency_hz, "v", RED, "harmonics" if harmonic == 2 else None)
    if point.interleave.gain is not None:
        mark(rate_hz / 2 - point.frequency_hz, "o", BLUE, "converters differ")
        mark(rate_hz / 2, "o", BLUE, None)
    name = "" if point.code is None else f"code {point.code}, "
    axes.annotate(
        f"{name}{point.frequency_hz / 1e6:.3g} MHz",
        (0.97, 0.95),
        xycoords="axes fraction",
        ha="right",
        fontsize=8,
    )
    axes.set_xlim(0, megahertz[-1] * 1.02)
    axes.set_ylim(max(float(np.percentile(level, 1)) - 8, _LEAST_DBFS), 8)
    axes.legend(fontsize=8, loc="upper center")


def _by_code(axes: Axes, by_code: list[SinePoint]) -> None:
    seen = [one for one in by_code if one.quality is not None]
    codes = [0 if one.code is None else one.code for one in seen]
    qualities = [one.quality for one in seen if one.quality is not None]
    _marks(
        axes,
        codes,
        [one.sfdr.value for one in qualities],
        [one.sfdr.bound for one in qualities],
        "D",
        GREEN,
        "SFDR",
        1,
    )
    _marks(
        axes,
        codes,
        [one.thd.value for one in qualities],
        [one.thd.bound for one in qualities],
        "v",
        RED,
        "THD, sign turned",
        -1,
    )
    _marks(axes, codes, [one.sinad for one in qualities], [0.0] * len(codes), "o", BLUE, "SINAD", 1)
    axes.set_xlabel("gain code")
    axes.set_ylabel("dB")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    if seen:
        axes.legend(fontsize=8)
    else:
        axes.text(0.5, 0.5, "no sine with figures", transform=axes.transAxes, ha="center")


def _marks(
    axes: Axes,
    codes: list[int],
    values: list[Estimate | None] | list[Estimate],
    bounds: list[float],
    symbol: str,
    colour: str,
    label: str,
    sign: int,
) -> None:
    known = [(code, one) for code, one in zip(codes, values, strict=True) if one is not None]
    hidden = [(code, bound) for code, one, bound in zip(codes, values, bounds, strict=True) if one is None]
    axes.errorbar(
        [code for code, _ in known],
        [sign * one.value for _, one in known],
        [2 * one.standard_uncertainty for _, one in known],
        fmt=symbol,
        color=colour,
        ms=4,
        lw=1,
        label=label,
    )
    axes.plot(
        [code for code, _ in hidden],
        [sign * one for _, one in hidden],
        symbol,
        mfc="none",
        color=colour,
        ms=4,
    )


def _between(figure: Figure, axes: Axes, readings: DigitizerReadings, found: Converters) -> None:
    """Draw mean gain mismatch and mean skew at each frequency, one above the other."""
    by_frequency: dict[float, list[Interleave]] = {}
    for one in readings.points:
        if one.status == "ok":
            by_frequency.setdefault(one.frequency_hz, []).append(one.interleave)
    if found.interleave.gain is None:
        axes.text(0.5, 0.5, found.status.replace("_", " "), transform=axes.transAxes, ha="center")
        return
    axes.remove()
    place_of = axes.get_subplotspec()
    assert place_of is not None
    grid = place_of.subgridspec(2, 1)
    upper, lower = figure.add_subplot(grid[0]), figure.add_subplot(grid[1])
    upper.set_title("(c)", loc="left", fontsize=10)
    for place, name, scale, label in (
        (upper, "gain", 1e3, "gain, even less odd, ‰"),
        (lower, "skew_s", 1e12, "time, even less odd, ps"),
    ):
        means = [weighted_mean(getattr(one, name) for one in ones) for ones in by_frequency.values()]
        _row(place, means, getattr(found.interleave, name), scale)
        place.set_ylabel(label, fontsize=9)
        place.set_xticks(range(len(means)), [f"{hz / 1e6:.3g}" for hz in by_frequency])
        place.margins(x=0.2)
    lower.set_xlabel("frequency, MHz")
    upper.tick_params(labelbottom=False)


def _row(axes: Axes, means: list[Estimate | None], whole: Estimate | None, scale: float) -> None:
    known = [(place, one) for place, one in enumerate(means) if one is not None]
    axes.errorbar(
        [place for place, _ in known],
        [scale * one.value for _, one in known],
        [2 * scale * one.standard_uncertainty for _, one in known],
        fmt="o",
        color=BLUE,
        ms=4,
        lw=1,
    )
    if whole is not None:
        axes.axhline(scale * whole.value, color=ORANGE, lw=1, zorder=0)
