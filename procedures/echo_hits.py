"""Which peak about an echo is the echo, how wrong it is, and how many larger ones lie beside it.

*False detection*: the candidate nearest to the truth is more than 10 m off. Of a piece of a window about the
echo, peaks within 10 m are hits; larger peaks beside them take places of the four as well. In noise as high
as the echo there may be two hits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from procedures.local_draws import NEAR_SAMPLES
from procedures.window_peaks import peaks, refined
from sim.constants import SPEED_OF_LIGHT_M_PER_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.delay_curve import DelayCurve
    from procedures.local_draws import LocalDraws
    from sim.rfm import RangeFinder

FALSE_M = 10.0
HALF_LIGHT = SPEED_OF_LIGHT_M_PER_S / 2

_PEAKS = 8
"""Looked at in a piece of a window."""


@dataclass(frozen=True, slots=True, eq=False)
class EchoHits:
    """What n pieces of windows told, arrays of shape (n, 2): the first hit, and the next where there is one.

    Parameters
    ----------
    hit : ndarray of bool
        Whether there is one.
    score_v : ndarray of float64
        Of it, V; 0 without one.
    ahead : ndarray of int64
        Larger peaks beside it.
    arrival_s, width_s : ndarray of float64
        Arrival less that of the middle of the light, before any correction, and full width, s: of the first
        hit; and of the one of both that is nearer to the truth.
    """

    hit: NDArray[np.bool_]
    score_v: NDArray[np.float64]
    ahead: NDArray[np.int64]
    arrival_s: NDArray[np.float64]
    width_s: NDArray[np.float64]


def corrected_m(
    curve: DelayCurve, arrival_s: NDArray[np.float64], width_s: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return one-way errors, m: arrivals less the delay that belongs to their width.

    Widths beyond the curve's take its end: there no correction is known.
    """
    known_s = np.clip(width_s, curve.narrowest_s, curve.widest_s)
    return np.asarray(HALF_LIGHT * (arrival_s - curve.at(known_s)))


def echo_hits(
    draws: LocalDraws, windows: NDArray[np.float64], finder: RangeFinder, curve: DelayCurve
) -> EchoHits:
    """Find the echo in pieces of windows.

    Parameters
    ----------
    draws : LocalDraws
        Where they lie.
    windows : ndarray of float64, shape (n, m)
        V, rounded as the converter does.
    finder : RangeFinder
        The receiver's.
    curve : DelayCurve
        The correction of arrivals. What it leaves on the average is some mm, far from 10 m.
    """
    found = peaks(finder, windows, _PEAKS, mean=False)
    lags = np.where(np.abs(found.lag - draws.middle) <= NEAR_SAMPLES, found.lag, -1)
    centre, width = refined(finder, windows, lags)
    interval_s = draws.interval_s
    arrival_s = draws.first_s[:, None] + interval_s * centre - draws.true_s[:, None]
    width_s = interval_s * width
    there = lags >= 0
    off_m = np.where(there, np.abs(corrected_m(curve, arrival_s, width_s)), np.inf)
    near = off_m <= FALSE_M
    rows = np.arange(len(lags))
    first = near.argmax(axis=1)
    later = near & (np.arange(near.shape[1]) > first[:, None])
    at = np.stack([first, later.argmax(axis=1)], axis=1)
    hit = np.stack([near.any(axis=1), later.any(axis=1)], axis=1)
    nearer = np.where(off_m[rows, at[:, 1]] < off_m[rows, first], at[:, 1], first)
    told = np.stack([first, nearer], axis=1)
    ahead = (there[:, None, :] & (np.arange(near.shape[1]) < at[:, :, None])).sum(axis=2)
    each = rows[:, None]
    return EchoHits(
        hit=np.asarray(hit),
        score_v=np.where(hit, found.score[each, at], 0.0),
        ahead=ahead,
        arrival_s=np.where(hit, arrival_s[each, told], 0.0),
        width_s=np.where(hit, width_s[each, told], 0.0),
    )
