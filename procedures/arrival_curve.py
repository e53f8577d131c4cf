"""Arrival curves, and how they compare: the model's, the bench's, that of footprints, the published one.

All are delays of a fitted centre in seconds against the detected width, and none is continued beyond the
widths from which it was made. The published polynomial is the other way round: a delay of the transmitted
pulse less that of a received one. So `published_curve` plus a delay curve is a constant, if both are right.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from belahil import butterworth
from belahil.delay_curve import NARROWEST_S, WIDEST_S, DelayCurve, fit_delay_curve, published_curve
from belahil.errors import RefusedInput
from belahil.values import Estimate
from sim.constants import SPEED_OF_LIGHT_M_PER_S
from sim.filter_delay import filter_delay_curve

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from procedures.arrival_footprints import Footprints
    from procedures.known_receiver import KnownReceiver

DEGREE = 5
"""As the published polynomial."""

BIN_S = 2e-9
FEWEST_IN_BIN = 20
FEWEST_BINS = 12
"""Twice as many as the polynomial has numbers."""

_STEP_S = 0.5e-9
PUBLISHED_CONSTANT_S = 11.84e-9
"""What the published polynomial with 9.37e-2 and the delay of a 19 MHz Butterworth filter sum to."""

_ONE_WAY = SPEED_OF_LIGHT_M_PER_S / 2


@dataclass(frozen=True, slots=True)
class PublishedComparison:
    """A delay curve beside the published polynomial.

    Parameters
    ----------
    linear_coefficient : float
        Of the polynomial in ns: 0.937 as printed, or 0.0937.
    constant_s : float
        Mean of polynomial and delay together, s.
    rms_s : float
        How far that sum is from its mean, s rms over the widths below.
    rms_about_known_s : float
        How far it is from 11.84 ns, s rms.
    narrowest_s, widest_s : float
        Widths that both curves have, s.
    """

    linear_coefficient: float
    constant_s: float
    rms_s: float
    rms_about_known_s: float
    narrowest_s: float
    widest_s: float


@lru_cache(maxsize=8)
def model_curve(known: KnownReceiver, factor: float = 1.0) -> DelayCurve:
    """Return the curve of Gaussian pulses behind the filter of a receiver, its cut-off times `factor`.

    Raises
    ------
    RefusedInput
        As `sim.filter_delay.filter_delay_curve`.
    """
    poles = butterworth.poles(factor * known.cutoff.value, known.order, known.highpass_hz)
    return filter_delay_curve(poles, known.sample_interval_s, known.zeros, DEGREE)


def with_published(curve: DelayCurve, *, as_printed: bool) -> PublishedComparison | None:
    """Compare a curve with the published polynomial; None where they have no width in common."""
    narrowest_s, widest_s = max(NARROWEST_S, curve.narrowest_s), min(WIDEST_S, curve.widest_s)
    if not narrowest_s < widest_s:
        return None
    widths_s = np.linspace(narrowest_s, widest_s, math.ceil((widest_s - narrowest_s) / _STEP_S) + 1)
    total_s = published_curve(as_printed=as_printed).at(widths_s) + curve.at(widths_s)
    return PublishedComparison(
        linear_coefficient=0.937 if as_printed else 0.0937,
        constant_s=float(total_s.mean()),
        rms_s=float(total_s.std()),
        rms_about_known_s=float(np.sqrt(np.mean((total_s - PUBLISHED_CONSTANT_S) ** 2))),
        narrowest_s=narrowest_s,
        widest_s=widest_s,
    )


def curve_through(widths_s: NDArray[np.float64], delays_s: NDArray[np.float64]) -> DelayCurve | None:
    """Fit a polynomial over just the widths that are there; None where they do not determine one."""
    if widths_s.size <= DEGREE:
        return None
    try:
        return fit_delay_curve(widths_s, delays_s, DEGREE, float(widths_s.min()), float(widths_s.max()))
    except RefusedInput:
        return None


@dataclass(frozen=True, slots=True, eq=False)
class BinMeans:
    """Shifts of footprints by detected width, arrays of shape (bins,); bins with few footprints are left out.

    Parameters
    ----------
    low_s : ndarray of float64
        Where each bin begins, s; it is `BIN_S` wide.
    width_s : ndarray of float64
        Mean detected width, s.
    shift_s, shift_u_s, spread_s : ndarray of float64
        Mean shift, its standard uncertainty, and the standard deviation, s.
    count : ndarray of int64
        Footprints.
    """

    low_s: NDArray[np.float64]
    width_s: NDArray[np.float64]
    shift_s: NDArray[np.float64]
    shift_u_s: NDArray[np.float64]
    spread_s: NDArray[np.float64]
    count: NDArray[np.int64]


def bin_means(found: Footprints) -> BinMeans:
    """Take means by width, from 20 to 110 ns."""
    edges_s = np.arange(NARROWEST_S, WIDEST_S + BIN_S / 2, BIN_S)
    place = np.digitize(found.width_s, edges_s) - 1
    rows = []
    for one, low_s in enumerate(edges_s[:-1]):
        inside = place == one
        count = int(inside.sum())
        if count >= FEWEST_IN_BIN:
            shifts_s = found.shift_s[inside]
            spread_s = float(shifts_s.std(ddof=1))
            width_s = float(found.width_s[inside].mean())
            rows.append(
                (low_s, width_s, float(shifts_s.mean()), spread_s / math.sqrt(count), spread_s, count)
            )
    columns = np.array(rows).reshape(-1, 6).T
    low, width, shift, shift_u, spread, count_of = columns
    return BinMeans(low, width, shift, shift_u, spread, count_of.astype(np.int64))


@dataclass(frozen=True, slots=True, eq=False)
class FootprintCurve:
    """The correction that footprints call for, and what it leaves.

    Parameters
    ----------
    status : str
        ``ok``, or ``too_few_points``: bins with enough footprints do not determine a polynomial; then the
        curve and the rest are None.
    bins : BinMeans
        Means by width.
    inside : int
        Footprints with a width of the curve.
    curve : DelayCurve or None
        Polynomial through the means.
    residual : Estimate or None
        Standard deviation of the shifts about the curve, one-way m.
    residual_largest : Estimate or None
        The largest of a bin, one-way m.
    bias : Estimate or None
        Curve at the widest width up to 100 ns less the delay of the transmitted pulse, one-way m; below zero:
        without correction a wide pulse appears too near.
    bias_width_s : float
        That width, s.
    transmitted_width_s, transmitted_delay_s : float
        Of the laser's own pulse: detected width, and delay from its centroid, s.
    """

    status: str
    bins: BinMeans
    inside: int
    transmitted_width_s: float
    transmitted_delay_s: float
    curve: DelayCurve | None = None
    residual: Estimate | None = None
    residual_largest: Estimate | None = None
    bias: Estimate | None = None
    bias_width_s: float = 0.0


def footprint_curve(found: Footprints, transmitted: tuple[float, float]) -> FootprintCurve:
    """Make the correction curve of footprints.

    Parameters
    ----------
    found : Footprints
        Their echoes.
    transmitted : tuple of float
        Detected width and delay of the laser's own pulse, s.
    """
    bins = bin_means(found)
    curve = curve_through(bins.width_s, bins.shift_s) if bins.count.size >= FEWEST_BINS else None
    if curve is None:
        return FootprintCurve("too_few_points", bins, 0, *transmitted)
    inside = (found.width_s >= curve.narrowest_s) & (found.width_s <= curve.widest_s)
    left_m = _ONE_WAY * (found.shift_s[inside] - curve.at(found.width_s[inside]))
    count = int(inside.sum())
    worst = int(np.argmax(bins.spread_s))
    width_s = min(curve.widest_s, 100e-9)
    last = int(np.argmin(np.abs(bins.width_s - width_s)))
    return FootprintCurve(
        "ok",
        bins,
        count,
        *transmitted,
        curve=curve,
        residual=_spread(float(left_m.std(ddof=1)), count),
        residual_largest=_spread(_ONE_WAY * float(bins.spread_s[worst]), int(bins.count[worst])),
        bias=Estimate(
            _ONE_WAY * (float(curve.at(width_s)) - transmitted[1]),
            _ONE_WAY * float(bins.shift_u_s[last]),
            "m",
        ),
        bias_width_s=width_s,
    )


def _spread(value_m: float, count: int) -> Estimate:
    """A standard deviation and what chance makes of it, as for a normal distribution."""
    return Estimate(value_m, value_m / math.sqrt(2 * (count - 1)), "m")
