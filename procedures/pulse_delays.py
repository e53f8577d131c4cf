"""Where in its window each pulse lies: a delay for every window, which nobody knows.

The trigger falls anywhere between two samples of the receiver, and cables add a constant. Where a pulse
stands out of the noise of a single window its delay is free: the least squares in the measured noise, by
Gauss-Newton from the best place of a search. A fainter pulse cannot tell its delay. Then what is known of
it is used: about one common delay, which all windows together do tell, the delays spread uniformly over one
sample interval, with a variance of a twelfth of its square; each window may leave the common delay at the
price of its square over this variance. Both are the same to first order once the pulse stands out.

Not modelled: a trigger that jitters by more than a sample interval, where pulses are faint.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from belahil.stimuli import SampledPulse
    from procedures.pulse_prediction import Path

SEARCHED = 8
"""Sample intervals before and after the expected place in which a pulse is looked for."""
FREE_FROM = 36.0
"""Mean square of a prediction in the noise of one window, in standard deviations, from which on delays are
free: those of fainter pulses are so far off that a test of the shape would err by a standard deviation."""
_PLACES = 4
"""Places of the search in a sample interval."""
_STEPS, _CLOSE = 8, 1e-4
"""Of Gauss-Newton, at most; sample intervals below which a step ends it. Three are needed where a pulse
stands out, and its delay is uncertain by a hundredth of an interval at best."""


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """Where the pulses of m windows of n samples lie.

    Parameters
    ----------
    first_s : ndarray of float64, shape (m,)
        Time of each window's first sample on the time axis of its pulse, s.
    common_s : ndarray of float64, shape (m,)
        What this would be with the common delay alone; equal to `first_s` where delays are free.
    spread_s : float
        Standard deviation of the delays about the common one; ``inf`` where they are free.
    within : ndarray of bool, shape (m,)
        False where the best place is at an end of the search.
    predicted_v : ndarray of float64, shape (m, n)
        Prediction there, V at the converter.
    slope_v_per_s : ndarray of float64, shape (m, n)
        Its change with `first_s`.
    """

    first_s: NDArray[np.float64]
    common_s: NDArray[np.float64]
    spread_s: float
    within: NDArray[np.bool_]
    predicted_v: NDArray[np.float64]
    slope_v_per_s: NDArray[np.float64]

    @property
    def is_free(self) -> bool:
        """Whether every window has a delay of its own, whatever it is."""
        return math.isinf(self.spread_s)


def alike(pulses: Sequence[SampledPulse], expected_s: NDArray[np.float64]) -> list[slice]:
    """Return the stretches of windows that have one pulse at one expected place."""
    ends = [
        row
        for row in range(1, len(pulses))
        if expected_s[row] != expected_s[row - 1]
        or not (pulses[row] is pulses[row - 1] or pulses[row] == pulses[row - 1])
    ]
    return [slice(begin, end) for begin, end in zip([0, *ends], [*ends, len(pulses)], strict=True)]


def placed(
    path: Path,
    pulses: Sequence[SampledPulse],
    windows_v: NDArray[np.float64],
    expected_s: NDArray[np.float64],
    whitener: NDArray[np.float64],
) -> Placement:
    """Find the delays; parameters as in `procedures.pulse_shape_fit.fit_shape`."""
    groups, white = alike(pulses, expected_s), windows_v @ whitener.T
    offsets_s = (path.interval_s / _PLACES) * np.arange(-SEARCHED * _PLACES, SEARCHED * _PLACES + 1.0)
    misfit = np.empty((white.shape[0], offsets_s.size))
    energy = 0.0
    for rows in groups:
        places_s = expected_s[rows.start] + offsets_s
        bank = path.volts(pulses[rows.start], places_s, white.shape[1]) @ whitener.T
        power = np.sum(bank**2, axis=1)
        misfit[rows] = power - 2 * white[rows] @ bank.T
        energy += float(power[offsets_s.size // 2]) * (rows.stop - rows.start)
    if energy >= FREE_FROM * white.shape[0]:
        best = np.argmin(misfit, axis=1)
        common_s, spread_s = expected_s + offsets_s[best], math.inf
    else:
        total = np.sum(misfit, axis=0)
        best = np.full(white.shape[0], np.argmin(total))
        common_s, spread_s = expected_s + _lowest(offsets_s, total), path.interval_s / math.sqrt(12)
    first_s = np.array(common_s)
    predicted_v, slope = np.empty(white.shape), np.empty(white.shape)
    for rows in groups:
        first_s[rows] = _refined(path, pulses[rows.start], white[rows], common_s[rows], spread_s, whitener)
        predicted_v[rows], slope[rows] = _with_slope(path, pulses[rows.start], first_s[rows], white.shape[1])
    return Placement(
        first_s=first_s,
        common_s=first_s if math.isinf(spread_s) else common_s,
        spread_s=spread_s,
        within=(best > 0) & (best < offsets_s.size - 1),
        predicted_v=predicted_v,
        slope_v_per_s=slope,
    )


def _lowest(places: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """Place of the lowest value, by a parabola through it and its neighbours."""
    at = int(np.argmin(values))
    if not 0 < at < values.size - 1:
        return float(places[at])
    before, here, after = values[at - 1 : at + 2]
    bend = before - 2 * here + after
    shift = 0.5 * (before - after) / bend if bend > 0 else 0.0
    return float(places[at] + shift * (places[1] - places[0]))


def _refined(
    path: Path,
    pulse: SampledPulse,
    white: NDArray[np.float64],
    common_s: NDArray[np.float64],
    spread_s: float,
    whitener: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Time of the first samples, shape (m,), by Gauss-Newton; `white` are the whitened windows."""
    first_s, count, weight = np.array(common_s), white.shape[1], spread_s**-2
    for _ in range(_STEPS):
        volts, slope = _with_slope(path, pulse, first_s, count)
        left, slope = white - volts @ whitener.T, slope @ whitener.T
        power = np.sum(slope**2, axis=1) + weight
        pull = np.sum(left * slope, axis=1) - (first_s - common_s) * weight
        step_s = np.divide(pull, power, out=np.zeros(power.size), where=power > 0)
        first_s += np.clip(step_s, -path.interval_s / 4, path.interval_s / 4)
        if np.max(np.abs(step_s)) < _CLOSE * path.interval_s:
            break
    return first_s


def _with_slope(
    path: Path, pulse: SampledPulse, first_s: NDArray[np.float64], count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Predictions, V, and their change with the time of the first sample, V/s."""
    little_s = 1e-3 * path.interval_s
    places_s = np.concatenate([first_s, first_s + little_s, first_s - little_s])
    volts, later, sooner = np.split(path.volts(pulse, places_s, count), 3)
    return volts, (later - sooner) / (2 * little_s)
