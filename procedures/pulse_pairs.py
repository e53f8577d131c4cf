"""Windows with two pulses: what was played, what was detected, and how well.

Not modelled: noise that changes within a window; the second derivatives of a Gaussian in the uncertainty of
its fit, which count where noise is a tenth of a pulse.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.pulse_bound import gaussian_gradient
from belahil.pulse_fit import FitStatus, GaussianPulse, gaussian_fit
from belahil.stimuli import SampledPulse
from procedures.clipping import with_clipping
from procedures.played_pulses import PlayedPulse, played_pulses
from sim.rfm import RangeFinder
from sim.template_bank import TemplateBank

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from belahil.values import RangeWindow, Shot
    from procedures.known_receiver import KnownReceiver

PairStatus = FitStatus | Literal["not_two_pulses", "another_receiver"]

_SAME_INTERVAL = 1e-6
"""Relative difference of nominal sample intervals; the true ones differ by the clock's error."""

_STRAY = 6
"""Samples by which two candidates may miss the played distance, beside a clock error of 500 ppm."""
_QUIET_FROM = 100
"""Samples from a pulse, after which its filter has settled."""
_LEAST_QUIET = 512
_RECENTRINGS = 3


@dataclass(frozen=True, slots=True)
class PulsePair:
    """One window.

    Parameters
    ----------
    shot : int
        Index in the plan.
    status : str
        ``ok``; ``not_two_pulses``: the played waveform or the window does not have two; ``another_receiver``:
        sampled at another rate than the known receiver does; or the status of the fit that failed, that of
        the first pulse first. Only ``ok`` has numbers.
    played : tuple of PlayedPulse
        Empty with ``not_two_pulses`` in what was played.
    detected : tuple of GaussianPulse
        From the first sample, s by the receiver's clock.
    arrival_u_s : tuple of float
        Standard uncertainty of each arrival by the noise of the window, s.
    """

    shot: int
    status: PairStatus
    played: tuple[PlayedPulse, ...] = ()
    detected: tuple[GaussianPulse, ...] = ()
    arrival_u_s: tuple[float, ...] = ()

    @property
    def distance_s(self) -> float:
        """From one played pulse to the other, s."""
        return self.played[1].centre_s - self.played[0].centre_s

    @property
    def excess_s(self) -> float:
        """What the receiver measures in excess of that, s."""
        return self.detected[1].arrival_s - self.detected[0].arrival_s - self.distance_s


def read_pairs(
    shots: Iterable[Shot], receiver: KnownReceiver, window_samples: int, converters: int, bits: int
) -> list[PulsePair]:
    """Find both pulses of each window of a sampled pulse.

    Parameters
    ----------
    shots : iterable of Shot
        Those of other stimuli are left out.
    receiver : KnownReceiver
        Its sample interval.
    window_samples : int
        Of a correlation window.
    converters, bits : int
        As in `procedures.pulse_energy.window_energy`.
    """
    finder = RangeFinder(TemplateBank(receiver.sample_interval_s), 4, window_samples)
    last: SampledPulse | None = None
    played: tuple[PlayedPulse, ...] = ()
    found = []
    for shot in shots:
        if not isinstance(shot.played, SampledPulse):
            continue
        window = with_clipping(shot, bits).window
        if abs(window.sample_interval_s / receiver.sample_interval_s - 1) > _SAME_INTERVAL:
            found.append(PulsePair(window.shot, "another_receiver"))
            continue
        if shot.played != last:
            last, played = shot.played, played_pulses(shot.played)
        if len(played) != 2:
            found.append(PulsePair(window.shot, "not_two_pulses"))
        else:
            found.append(read_pair(window, played, finder, converters))
    return found


def counted(pairs: list[PulsePair]) -> dict[str, int]:
    """Return how many windows have each status."""
    return dict(sorted(Counter(one.status for one in pairs).items()))


def read_pair(
    window: RangeWindow, played: tuple[PlayedPulse, ...], finder: RangeFinder, converters: int
) -> PulsePair:
    """Find two pulses of known distance in a window."""
    if window.saturated:
        return PulsePair(window.shot, "saturated", played)
    volts, interval_s = window.volts, window.sample_interval_s
    distance = (played[1].centre_s - played[0].centre_s) / interval_s
    firsts = _candidates(volts, finder, distance) if volts.size >= finder.correlation_window_samples else None
    if firsts is None:
        return PulsePair(window.shot, "not_two_pulses", played)
    quiet = _longest_quiet(volts.size, firsts, finder.correlation_window_samples)
    if quiet.stop - quiet.start < _LEAST_QUIET:
        return PulsePair(window.shot, "too_few_samples", played)
    for one in range(converters):
        inside = slice(quiet.start + (one - quiet.start) % converters, quiet.stop, converters)
        volts[one::converters] -= volts[inside].mean()
    covariance = noise_covariance(volts[quiet], finder.correlation_window_samples, window.volts_per_count)
    pulses, uncertainties = [], []
    for first in firsts:
        status, pulse, uncertainty_s = fitted(volts, first, interval_s, covariance)
        if pulse is None or status != "ok":
            return PulsePair(window.shot, status, played)
        pulses.append(pulse)
        uncertainties.append(uncertainty_s)
    return PulsePair(window.shot, "ok", played, tuple(pulses), tuple(uncertainties))


def fitted(
    volts: NDArray[np.float64], first: int, interval_s: float, covariance: NDArray[np.float64]
) -> tuple[FitStatus, GaussianPulse | None, float]:
    """Fit a Gaussian to a correlation window that is moved until the pulse is in its middle.

    Parameters
    ----------
    volts : ndarray of float64, shape (n,)
        V.
    first : int
        Where the correlation window begins.
    interval_s : float
        s.
    covariance : ndarray, shape (m, m)
        Of the noise of m samples, V^2; m are in a correlation window.

    Returns
    -------
    status : str
        Of the fit.
    pulse : GaussianPulse or None
        From the first of `volts`.
    uncertainty_s : float
        Of its arrival, by the noise: the fit is unweighted, so with J its gradient the covariance is
        (J J')^-1 J C J' (J J')^-1.
    """
    size = covariance.shape[0]
    for _ in range(_RECENTRINGS):
        fit = gaussian_fit(volts[first : first + size], interval_s)
        pulse = fit.pulse
        if pulse is None:
            return fit.status, None, 0.0
        lag = first + round(pulse.arrival_s / interval_s)
        middle = max(min(lag - (size - 1) // 2, volts.size - size), 0)
        if middle == first:
            break
        first = middle
    assert pulse is not None
    gradient = gaussian_gradient(pulse, interval_s * np.arange(size))
    scale = np.linalg.norm(gradient, axis=1, keepdims=True)
    unit = gradient / scale
    solved = np.linalg.solve(unit @ unit.T, unit)
    variance = float(solved[0] @ covariance @ solved[0]) / float(scale[0, 0]) ** 2
    begin_s = first * interval_s
    moved = GaussianPulse(pulse.arrival_s + begin_s, pulse.fwhm_s, pulse.amplitude_v)
    return fit.status, moved, math.sqrt(max(variance, 0.0))


def noise_covariance(quiet_v: NDArray[np.float64], size: int, count_v: float) -> NDArray[np.float64]:
    """Return the covariance of `size` samples of stationary noise, V^2, from a quiet stretch.

    Parameters
    ----------
    quiet_v : ndarray of float64, shape (n,)
        Without its mean, V; much longer than `size`.
    size : int
        m of the result, shape (m, m).
    count_v : float
        A step of the converter, V: where less than half of one is seen, rounding counts as white noise.
    """
    row = np.array([float(quiet_v[: quiet_v.size - lag] @ quiet_v[lag:]) for lag in range(size)])
    row /= quiet_v.size
    if row[0] < (count_v / 2) ** 2:
        row[1:] = 0.0
        row[0] = max(float(row[0]), count_v**2 / 12)
    lags = np.arange(size)
    return np.asarray(row[np.abs(lags[:, None] - lags)])


def _candidates(volts: NDArray[np.float64], finder: RangeFinder, distance: float) -> tuple[int, int] | None:
    """Where the correlation windows of the two candidates begin that are as far apart as was played."""
    rows = finder.search(volts)
    places = rows[:, 0] / finder.bank.sample_interval_s
    allowed = _STRAY + 5e-4 * distance
    best, found = allowed, None
    for one in range(len(rows)):
        for other in range(len(rows)):
            miss = abs(places[other] - places[one] - distance)
            if one != other and miss < best:
                best, found = miss, (int(rows[one, 3]), int(rows[other, 3]))
    return found


def _longest_quiet(count: int, firsts: tuple[int, int], size: int) -> slice:
    """The longest stretch of samples without a pulse."""
    edges = [0]
    for first in sorted(firsts):
        edges += [max(0, first - _QUIET_FROM // 2), min(count, first + size + _QUIET_FROM)]
    edges.append(count)
    stretches = [slice(edges[k], max(edges[k], edges[k + 1])) for k in range(0, len(edges), 2)]
    return max(stretches, key=lambda one: one.stop - one.start)
