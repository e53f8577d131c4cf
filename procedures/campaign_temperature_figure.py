"""The figure of a temperature campaign: pulses of three sets as emitted, received and digitized."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from procedures.campaign_temperature import SETS, STEPS
from procedures.campaign_temperature_outcome import PUBLISHED_V, aligned, peak_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from procedures.campaign_temperature_outcome import Sets

_COLOURS = {"cold": "#0072B2", "ambient": "k", "hot": "#D55E00"}
_STYLES = {"cold": "--", "ambient": "-", "hot": "-."}


def temperature_figure(sets: Sets) -> Figure:
    """Draw the three sets: emitted, received, digitized and aligned, and their differences."""
    figure = Figure(figsize=(10.5, 7.2), layout="constrained")
    figure.set_label(
        "(a) Photons sent by the laser at three temperatures of its head, as many in each pulse. (b) "
        "Photons received from a plane; the beam points elsewhere, so the peaks move. (c) The same filtered "
        "and amplified, moved so that the peaks coincide; points: where the receiver samples the ambient "
        "pulse. (d) Differences to the ambient pulse, with the noise by night (grey) and the published "
        "2 mV (dotted)."
    )
    axes = figure.subplots(2, 2)
    _rates(axes[0, 0], sets, "emitted_rate", 1e24, "photons sent, $10^{24}$ s$^{-1}$", (-20, 45))
    axes[0, 0].set_title("(a) emitted", loc="left", fontsize=10)
    _rates(axes[0, 1], sets, "received_rate", 1e9, "photons received, $10^{9}$ s$^{-1}$", (-40, 60))
    axes[0, 1].set_title("(b) received", loc="left", fontsize=10)
    _digitized(axes[1, 0], sets)
    _differences(axes[1, 1], sets)
    return figure


def _rates(axes: Axes, sets: Sets, key: str, unit: float, label: str, span_ns: tuple[float, float]) -> None:
    for name in SETS:
        one = sets.found[name]
        axes.plot(
            1e9 * one["time_s"], one[key] / unit, _STYLES[name], color=_COLOURS[name], lw=1.6, label=name
        )
    begin, end = 1e9 * sets.found["ambient"]["time_s"][[0, -1]]
    axes.set_xlim(max(span_ns[0], begin), min(span_ns[1], end))
    if key == "received_rate":
        _show_loud(axes, sets)
    axes.set_ylim(bottom=0)
    axes.set_xlabel("time from the laser's pulse, way to the gate taken out, ns")
    axes.set_ylabel(label)
    axes.legend(fontsize=9)


def _show_loud(axes: Axes, sets: Sets) -> None:
    """Set the limits where any pulse is above a thousandth of its peak."""
    ends = []
    for name in SETS:
        one = sets.found[name]
        loud = one["time_s"][one["received_rate"] > 1e-3 * one["received_rate"].max()]
        ends += [1e9 * loud[0], 1e9 * loud[-1]]
    axes.set_xlim(min(ends), max(ends))


def _digitized(axes: Axes, sets: Sets) -> None:
    ambient = sets.found["ambient"]
    since_ns = 1e9 * (ambient["time_s"] - peak_of(ambient)[0])
    for name in SETS:
        volts = aligned(sets.found[name], ambient)
        axes.plot(since_ns, 1e3 * volts, _STYLES[name], color=_COLOURS[name], lw=1.5, label=name)
    first = int(np.argmax(ambient["volts"])) % STEPS
    axes.plot(since_ns[first::STEPS], 1e3 * ambient["volts"][first::STEPS], "ko", ms=5)
    axes.set_xlim(-60, 100)
    axes.axhline(0, color="0.8", lw=0.6, zorder=0)
    axes.set_xlabel("time from the peak, ns")
    axes.set_ylabel("voltage at the converter, mV")
    axes.set_title("(c) digitized, peaks aligned", loc="left", fontsize=10)
    axes.legend(fontsize=9)


def _differences(axes: Axes, sets: Sets) -> None:
    ambient = sets.found["ambient"]
    since_ns = 1e9 * (ambient["time_s"] - peak_of(ambient)[0])
    night_mv = 1e3 * ambient["day_night_v"][0]
    axes.axhspan(-night_mv, night_mv, color="0.9", lw=0, label="noise by night")
    for sign in (-1, 1):
        axes.axhline(
            sign * 1e3 * PUBLISHED_V, color="0.4", ls=":", lw=1.2, label="2 mV" if sign > 0 else None
        )
    for name in ("cold", "hot"):
        difference = 1e3 * (aligned(sets.found[name], ambient) - ambient["volts"])
        axes.plot(
            since_ns, difference, _STYLES[name], color=_COLOURS[name], lw=1.6, label=f"{name} - ambient"
        )
    axes.set_xlim(-60, 100)
    axes.set_xlabel("time from the peak, ns")
    axes.set_ylabel("difference, mV")
    axes.set_title("(d) differences", loc="left", fontsize=10)
    axes.legend(fontsize=8, ncols=2)
    axes.margins(y=0.2)
