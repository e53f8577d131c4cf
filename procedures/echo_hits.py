"""Which peak about an echo is the echo, how wrong it is, and how many larger ones lie beside it.

*False detection*: the candidate nearest to the truth is more than 10 m off. Of a piece of a window about the
echo, peaks within 10 m are hits; larger peaks beside them take places of the four as well. In noise as high
as the echo there may be two hits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from procedures.local_draws import NEAR_SAMPLES
from procedures.window_peaks import piece_peaks, refined, window_areas
from sim.constants import SPEED_OF_LIGHT_M_PER_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.delay_curve import DelayCurve
    from procedures.local_draws import LocalDraws
    from sim.rfm import RangeFinder

FALSE_M = 10.0
HALF_LIGHT = SPEED_OF_LIGHT_M_PER_S / 2

_LIKELY_SAMPLES = 10
"""From the middle, within which a peak may be refined to within 10 m: those are 5.3, the refinement moves by
3 at most, and the arrival lies within one of the middle."""
_AT_ONCE = 2048


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
    amplitude_v, area_v_s : ndarray of float64
        Of the same: height of the Gaussian, V; trapezoids over the correlation window, E_CW, V s.
    """

    hit: NDArray[np.bool_]
    score_v: NDArray[np.float64]
    ahead: NDArray[np.int64]
    arrival_s: NDArray[np.float64]
    width_s: NDArray[np.float64]
    amplitude_v: NDArray[np.float64]
    area_v_s: NDArray[np.float64]


def corrected_m(
    curve: DelayCurve, arrival_s: NDArray[np.float64], width_s: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return one-way errors, m: arrivals less the delay that belongs to their width.

    Widths beyond the curve's take its end: there no correction is known.
    """
    known_s = np.clip(width_s, curve.narrowest_s, curve.widest_s)
    return np.asarray(HALF_LIGHT * (arrival_s - curve.at(known_s)))


def echo_hits(
    draws: LocalDraws,
    reflectance: float,
    noise_rms_v: float,
    step_v: float,
    finder: RangeFinder,
    curve: DelayCurve,
) -> EchoHits:
    """Find the echo in pieces of windows.

    Parameters
    ----------
    draws : LocalDraws
        n shots.
    reflectance, noise_rms_v : float
        Of the ground; of the stationary noise at the converter, V.
    step_v : float
        To which the converter rounds, V.
    finder : RangeFinder
        The receiver's.
    curve : DelayCurve
        The correction of arrivals. What it leaves on the average is some mm, far from 10 m.
    """
    parts = []
    for begin in range(0, len(draws.unit), _AT_ONCE):
        part = slice(begin, begin + _AT_ONCE)
        volts = np.rint(draws.windows(reflectance, noise_rms_v, part) / step_v) * step_v
        parts.append(_hits(draws, volts, part, finder, curve))
    return EchoHits(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _hits(
    draws: LocalDraws, volts: NDArray[np.float64], part: slice, finder: RangeFinder, curve: DelayCurve
) -> tuple[NDArray[np.generic], ...]:
    # Within the range finder's exclusion a peak keeps others from being seen.
    wide = NEAR_SAMPLES + finder.exclusion_samples
    # More do not fit next to each other.
    most = math.ceil((2 * wide + 1) / (finder.exclusion_samples + 1))
    found = piece_peaks(finder, volts, (draws.middle - wide, draws.middle + wide), most)
    away = np.abs(found.lag - draws.middle)
    there = (found.lag >= 0) & (away <= NEAR_SAMPLES)
    likely = there & (away <= _LIKELY_SAMPLES)
    centre, width, amplitude_v, first_sample = refined(finder, volts, np.where(likely, found.lag, -1))
    interval_s = draws.interval_s
    shift_s = (draws.first_s - draws.true_s)[draws.of_echo[part], None]
    arrival_s, width_s = shift_s + interval_s * centre, interval_s * width
    off_m = np.where(likely, np.abs(corrected_m(curve, arrival_s, width_s)), np.inf)
    near = off_m <= FALSE_M
    rows = np.arange(len(near))
    first = near.argmax(axis=1)
    later = near & (np.arange(near.shape[1]) > first[:, None])
    at = np.stack([first, later.argmax(axis=1)], axis=1)
    hit = np.stack([near.any(axis=1), later.any(axis=1)], axis=1)
    nearer = np.where(off_m[rows, at[:, 1]] < off_m[rows, first], at[:, 1], first)
    told, each = np.stack([first, nearer], axis=1), rows[:, None]
    ahead = (there[:, None, :] & (np.arange(near.shape[1]) < at[:, :, None])).sum(axis=2)
    area_v_s = interval_s * window_areas(finder, volts, first_sample[each, told].astype(np.int64))
    return (
        hit,
        np.where(hit, found.score[each, at], 0.0),
        ahead,
        np.where(hit, arrival_s[each, told], 0.0),
        np.where(hit, width_s[each, told], 0.0),
        np.where(hit, amplitude_v[each, told], 0.0),
        np.where(hit, area_v_s, 0.0),
    )
