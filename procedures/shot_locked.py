"""Interference that follows the shot: the part of the noise that is the same in each window.

The windows of one gain code, without the means of their converters, are averaged sample by sample. Noise that
does not know of the shot averages out; a burst of the laser's drivers, locked to the shot, stays. Its energy
is sought in stretches of several lengths against what averaged noise leaves there (a chi square with as many
degrees as the coloured noise has independent samples, Satterthwaite 1946; Bonferroni over all stretches).

Since the receiver's clock does not know of the shot either, a burst is found a part of a sample early or
late. So the mean shows it weaker, by sin(x)/x with x = pi f / fs for its frequency f; the rest counts as
noise.

Not modelled: bursts whose size or time changes from shot to shot; what they add counts as noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.values import Estimate
from procedures.dark_noise import centred

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from belahil.values import RangeWindow

    Array = NDArray[np.float64]

BurstStatus = Literal["ok", "no_burst", "too_few_windows"]

PROBABILITY = 1e-3
"""Below it chance does not explain a stretch of the mean window."""
_LENGTHS = (16, 64, 256, 1024)
_PADDING = 8
_TRANSIENT = 5
_KNOWN = 0.5
"""Largest relative standard uncertainty with which a decay time is told."""


@dataclass(frozen=True, slots=True, eq=False)
class ShotLocked:
    """What windows of one gain code have in common.

    Parameters
    ----------
    status : {"ok", "no_burst", "too_few_windows"}
        "ok": there is a burst. "no_burst": chance explains the mean. One window has nothing to compare with.
    p_value : float or None
        Probability that noise alone gives such a stretch anywhere.
    locked_rms : Estimate or None
        Rms of the part locked to the shot, over the whole window, V at the converter.
    peak, peak_at : Estimate or None
        Largest magnitude of the mean, V; its time after the trigger, s.
    frequency, decay : Estimate or None
        Of the sine that rings behind the peak, Hz; the time in which it falls to 1/e, s. None where the burst
        does not ring so.
    random_v2, random_u_v2 : float
        Mean square of what differs between windows, rounding included, V^2; its standard uncertainty.
    mean_v : ndarray of float64, shape (n,)
        Mean window, V.
    mean_u_v : float
        Standard uncertainty of each of its samples, V.
    """

    status: BurstStatus
    p_value: float | None
    locked_rms: Estimate | None
    peak: Estimate | None
    peak_at: Estimate | None
    frequency: Estimate | None
    decay: Estimate | None
    random_v2: float
    random_u_v2: float
    mean_v: Array
    mean_u_v: float


def shot_locked(windows: Sequence[RangeWindow], converters: int, effective: float) -> ShotLocked:
    """Look for what is locked to the shot.

    Parameters
    ----------
    windows : sequence of RangeWindow
        Silent, of one gain code, unclipped, all alike; at least one.
    converters : int
        Interleaved converters.
    effective : float
        Samples of white noise that would tell as much of a variance as all of these; see
        `procedures.dark_noise`.
    """
    scale = windows[0].volts_per_count
    volts = np.array([centred(one.counts, converters) for one in windows]) * scale
    count, size = volts.shape
    mean = volts.mean(axis=0)
    if count < 2:
        square = float(np.mean(volts**2))
        return _without("too_few_windows", None, square, square * math.sqrt(2 / effective), mean, 0.0)
    random = float(np.sum((volts - mean) ** 2)) / ((count - 1) * size)
    random_u = random * math.sqrt(2 / effective * count / (count - 1))
    mean_u = math.sqrt(random / count)
    if random == 0:
        return _without("no_burst", 1.0, 0.0, 0.0, mean, 0.0)
    alike = count * size / effective
    p_value, first, last = _strongest(mean / mean_u, alike)
    if p_value >= PROBABILITY:
        return _without("no_burst", p_value, random, random_u, mean, mean_u)
    excess = float(np.mean(mean**2)) - mean_u**2
    locked = math.sqrt(max(excess, 0.0))
    locked_u = mean_u * math.sqrt(alike / size) * math.sqrt(2 * mean_u**2 + 4 * max(excess, 0.0))
    top = int(np.argmax(np.abs(mean)))
    window = windows[0]
    interval_s = window.sample_interval_s
    frequency, decay = _ringing(mean, first, last, mean_u**2 * alike, interval_s)
    return ShotLocked(
        status="ok",
        p_value=p_value,
        locked_rms=Estimate(locked, locked_u / (2 * locked) if locked else mean_u, "V"),
        peak=Estimate(float(np.abs(mean[top])), mean_u, "V"),
        # Anywhere between two samples, since the clock does not know of the shot.
        peak_at=Estimate(window.start_s + top * interval_s, interval_s / math.sqrt(12), "s"),
        frequency=frequency,
        decay=decay,
        random_v2=random,
        random_u_v2=random_u,
        mean_v=mean,
        mean_u_v=mean_u,
    )


def _without(
    status: BurstStatus, p_value: float | None, random: float, random_u: float, mean: Array, mean_u: float
) -> ShotLocked:
    return ShotLocked(status, p_value, None, None, None, None, None, random, random_u, mean, mean_u)


def _strongest(standard: Array, alike: float) -> tuple[float, int, int]:
    """Return the probability of the least likely stretch, and where it begins and ends.

    Parameters
    ----------
    standard : ndarray of float64, shape (n,)
        Mean window in its standard uncertainties.
    alike : float
        Samples for each independent one.
    """
    energy = np.concatenate([[0.0], np.cumsum(standard**2)])
    best, first, last, tried = 0.0, 0, standard.size, 0
    for length in _LENGTHS:
        if length > standard.size:
            continue
        starts = np.arange(0, standard.size - length + 1, length // 2)
        found = energy[starts + length] - energy[starts]
        # The squares of coloured samples vary together: fewer degrees, each of more weight.
        chance = _log_chance(length / alike / 2, found / alike / 2)
        tried += starts.size
        place = int(np.argmin(chance))
        if chance[place] < best:
            best, first, last = float(chance[place]), int(starts[place]), int(starts[place]) + length
    return min(1.0, math.exp(best) * tried), first, last


def _log_chance(half_freedom: float, half_square: Array) -> Array:
    """Logarithm of the probability that a chi square is larger, in its far tail too."""
    from scipy.special import gammaincc, gammaln

    chance = gammaincc(half_freedom, half_square)
    square = np.maximum(half_square, 1.0)
    tail = (half_freedom - 1) * np.log(square) - square - gammaln(half_freedom)
    return np.asarray(np.where(chance > 1e-200, np.log(np.maximum(chance, 1e-200)), tail))


def _ringing(
    mean: Array, first: int, last: int, density: float, interval_s: float
) -> tuple[Estimate | None, Estimate | None]:
    """Fit a damped sine behind the peak of a burst; return its frequency and decay time, or None.

    Parameters
    ----------
    mean : ndarray of float64, shape (n,)
        Mean window, V.
    first, last : int
        Stretch that shows the burst best.
    density : float
        Variance of each sample if all noise were as dense as where the receiver passes it, V^2.
    interval_s : float
        Between samples, s.
    """
    from scipy.optimize import least_squares

    top = first + int(np.argmax(np.abs(mean[first:last])))
    # What the receiver's filter adds to the ringing of others is over by then.
    burst = mean[top + _TRANSIENT : top + _TRANSIENT + 2 * (last - first)]
    if burst.size < 16:
        return None, None
    number = np.arange(burst.size)
    power = np.abs(np.fft.rfft(burst, burst.size * _PADDING)) ** 2
    cycles = min((1 + int(np.argmax(power[1:]))) / (burst.size * _PADDING), 0.49)

    def left(values: Array) -> Array:
        decay = np.exp(-number * math.exp(min(values[1], 3.0)))
        angle = 2 * np.pi * values[0] * number
        columns = np.stack([decay * np.cos(angle), decay * np.sin(angle)], axis=1)
        return np.asarray(burst - columns @ np.linalg.lstsq(columns, burst, rcond=None)[0])

    bounds, scale = ([0.0, -12.0], [0.5, 3.0]), [0.1 / burst.size, 1.0]
    starts = (np.array([cycles, math.log(part / (last - first))]) for part in (1.0, 4.0, 16.0))
    found = [least_squares(left, start, bounds=bounds, x_scale=scale) for start in starts]
    solved = min(found, key=lambda one: one.cost)
    slopes = np.asarray(solved.jac, dtype=np.float64)
    normal = slopes.T @ slopes
    if not solved.success or np.linalg.cond(normal) > 1e14:
        return None, None
    spread = np.sqrt(density * np.linalg.inv(normal).diagonal())
    decay_s = math.exp(-solved.x[1]) * interval_s
    frequency = Estimate(float(solved.x[0]) / interval_s, float(spread[0]) / interval_s, "Hz")
    known = spread[1] < _KNOWN and frequency.standard_uncertainty < frequency.value
    return (frequency, Estimate(decay_s, float(spread[1]) * decay_s, "s")) if known else (None, None)
