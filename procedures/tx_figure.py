"""The figure of a transmitted pulse: equivalent time, what the fit leaves, and the likelihood."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from procedures.tx_families import COVERAGE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from procedures.tx_analysis import TxFound
    from procedures.tx_picture import EquivalentTime

_FIT, _UNCUT, _DATA = "#D55E00", "#000000", "#8A8A8A"
_MOST_SAMPLES = 6000
_SHOWN_NS = (-40, 160)


def tx_figure(found: TxFound, picture: EquivalentTime) -> Figure:
    """Draw the detected pulse with its fit, what is left, and the likelihood of thresholds."""
    figure = Figure(figsize=(10.0, 5.2), layout="constrained")
    figure.set_label(
        "Left: all windows laid over one another by their fitted arrivals, with the best hard cut and the "
        "uncut pulse; below, means over 2 ns of what the hard cut leaves (bars: two standard uncertainties) "
        "and by how much the uncut pulse would differ. Right: how far each threshold is from the best one by "
        "likelihood, the root of twice the loss; dark, the interval of 95 % from noise alone, light, with "
        "the uncertainties of pulse and receiver."
    )
    shares = figure.add_gridspec(2, 2, width_ratios=(1.5, 1), height_ratios=(2, 1))
    top, below = figure.add_subplot(shares[0, 0]), figure.add_subplot(shares[1, 0])
    _pulse(top, picture)
    _left(below, picture)
    below.sharex(top)
    top.set_xlim(_SHOWN_NS)
    top.tick_params(labelbottom=False)
    _likelihood(figure.add_subplot(shares[:, 1]), found, picture)
    return figure


def _pulse(axes: Axes, picture: EquivalentTime) -> None:
    # Not every so many, which would be the same samples of each window.
    some = np.random.default_rng(0).permutation(picture.samples.size)[:_MOST_SAMPLES]
    axes.plot(picture.samples_s[some] * 1e9, picture.samples[some], ".", ms=1.5, color=_DATA, label="samples")
    axes.plot(picture.times_s * 1e9, picture.uncut, "--", lw=1, color=_UNCUT, label="uncut pulse")
    axes.plot(picture.times_s * 1e9, picture.hard, lw=1.2, color=_FIT, label="hard cut, fitted")
    axes.set_ylabel("voltage / peak before cut")
    axes.legend(fontsize=9, markerscale=4)


def _left(axes: Axes, picture: EquivalentTime) -> None:
    axes.plot(picture.times_s * 1e9, 1e2 * picture.missing, "--", lw=1, color=_UNCUT)
    axes.errorbar(
        picture.bins_s * 1e9, 1e2 * picture.left, 2e2 * picture.left_u, fmt=".", ms=3, lw=0.8, color=_FIT
    )
    axes.axhline(0, lw=0.6, color=_DATA)
    first, last = (1e-9 * one for one in _SHOWN_NS)
    inside = (picture.bins_s > first) & (picture.bins_s < last)
    shown = np.abs(picture.left[inside]) + 3 * picture.left_u[inside]
    reach = 1e2 * max(float(np.median(shown)) * 4, float(shown.max()) * 1.1)
    axes.set_ylim(-reach, reach)
    axes.set_xlabel("time after the peak of the light, ns")
    axes.set_ylabel("left, % of peak")


def _likelihood(axes: Axes, found: TxFound, picture: EquivalentTime) -> None:
    whole, noise = found.threshold, found.noise_interval
    axes.axvspan(100 * whole.low, 100 * whole.high, color=_FIT, alpha=0.15, lw=0, label="95 %, all")
    axes.axvspan(100 * noise[0], 100 * noise[1], color=_FIT, alpha=0.5, lw=0, label="95 %, noise alone")
    away = np.sqrt(np.maximum(-2 * picture.log_likelihood, 0.0))
    axes.plot(100 * picture.thresholds, away, lw=1.2, color="#0072B2", label="likelihood")
    axes.axhline(math.sqrt(COVERAGE), lw=0.6, ls=":", color=_DATA)
    reach = max(whole.high - whole.low, 0.02)
    low, high = max(whole.low - 0.3 * reach, 0.0), min(whole.high + 0.3 * reach, 1.0)
    axes.set_xlim(100 * low, 100 * high)
    inside = away[(picture.thresholds >= low) & (picture.thresholds <= high)]
    axes.set_ylim(0, max(1.05 * float(inside.max(initial=0.0)), 4.0))
    axes.set_xlabel("threshold, % of peak", loc="left")
    axes.set_ylabel("standard deviations of noise from the best threshold")
    axes.legend(fontsize=9, loc="upper right", framealpha=1)
