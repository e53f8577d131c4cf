"""How well two kinds of ground are told apart by measured reflectances, of one shot or the mean of many.

Criterion, assumed: a threshold between them at which false alarm and miss are equally likely; *separate*
means that both are 5 % at most. Distributions are the weighted draws themselves; means of several shots are
their convolutions, and from `_NORMAL_FROM` shots on normal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy import fft
from scipy.special import ndtr

if TYPE_CHECKING:
    from numpy.typing import NDArray

WRONG = 0.05
"""Of false alarms, and of misses, at most: assumed."""

_NORMAL_FROM = 64
_BINS = 2048
_MOST_SHOTS = 10**7
_TAIL = 1e-5
"""Weight beyond which a distribution is drawn in before it is convolved."""


@dataclass(frozen=True)
class Measured:
    """What detected shots over one kind of ground tell as its reflectance.

    Parameters
    ----------
    values, weights : ndarray of float64, shape (n, k)
        Reflectances; weights not negative, not all 0.
    """

    values: NDArray[np.float64]
    weights: NDArray[np.float64]

    @cached_property
    def mean(self) -> float:
        """Mean of single shots."""
        return float((self.weights * self.values).sum() / self.weights.sum())

    @cached_property
    def spread(self) -> float:
        """Standard deviation of single shots."""
        square = (self.weights * (self.values - self.mean) ** 2).sum() / self.weights.sum()
        return math.sqrt(float(square))

    @cached_property
    def _ordered(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Values, rising, and the share below or at each."""
        order = np.argsort(self.values, axis=None)
        share = np.cumsum(self.weights.ravel()[order])
        return self.values.ravel()[order], share / share[-1]

    def below(self, threshold: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the share of single shots at or below thresholds."""
        values, share = self._ordered
        at = np.searchsorted(values, threshold, side="right")
        return np.where(at > 0, share[np.maximum(at, 1) - 1], 0.0)

    def limits(self) -> tuple[float, float]:
        """Return values beyond which hardly anything lies."""
        values, share = self._ordered
        at = np.searchsorted(share, (_TAIL, 1 - _TAIL))
        return float(values[at[0]]), float(values[min(int(at[1]), values.size - 1)])

    def without(self, group: int, groups: int, echoes: int) -> Measured:
        """Return it without one of some groups of echoes, each with all of its shots."""
        of_echo = np.arange(echoes) % groups != group
        rows = np.repeat(of_echo, len(self.values) // echoes)
        return Measured(self.values[rows], self.weights[rows])


def wrong_share(low: Measured, high: Measured, shots: int = 1) -> float:
    """Return the share of false alarms at the threshold where that of misses is the same.

    Parameters
    ----------
    low, high : Measured
        Darker and brighter ground.
    shots : int
        Whose mean is compared with the threshold.
    """
    if shots == 1:
        at = np.sort(np.concatenate([low.values[low.weights > 0], high.values[high.weights > 0]]))
        return _equal(1 - low.below(at), high.below(at))
    if shots >= _NORMAL_FROM:
        apart = (high.mean - low.mean) * math.sqrt(shots) / (high.spread + low.spread)
        return float(ndtr(-apart))
    ends = [one.limits() for one in (low, high)]
    begin, end = min(one for one, _ in ends), max(one for _, one in ends)
    return _equal(1 - _summed(low, shots, begin, end), _summed(high, shots, begin, end))


def _equal(alarm: NDArray[np.float64], miss: NDArray[np.float64]) -> float:
    """Where a falling share meets a rising one."""
    at = int(np.argmax(miss >= alarm))
    if at == 0:
        return float(max(alarm[0], miss[0]))
    gap = alarm[at - 1] - miss[at - 1]
    share = gap / (gap + miss[at] - alarm[at])
    return float(miss[at - 1] + share * (miss[at] - miss[at - 1]))


def _summed(one: Measured, shots: int, begin: float, end: float) -> NDArray[np.float64]:
    """Share of sums of shots below the edges of bins, each a `_BINS`-th of the stretch."""
    edges = np.linspace(begin, end, _BINS + 1)
    inside = np.clip(one.values, begin, np.nextafter(end, begin))
    density, _ = np.histogram(inside, edges, weights=one.weights)
    size = fft.next_fast_len(shots * _BINS)
    with np.errstate(under="ignore"):
        summed = fft.irfft(fft.rfft(density / density.sum(), size) ** shots, size)
    return np.cumsum(summed[: shots * (_BINS - 1) + 1])


def shots_needed(low: Measured, high: Measured, wrong: float = WRONG) -> int | None:
    """Return how many shots separate two kinds of ground; None: not even ten million.

    Parameters
    ----------
    low, high : Measured
        Darker and brighter ground.
    wrong : float
        Share of false alarms and of misses at most.
    """
    if not high.mean > low.mean:
        return None
    most = 1
    while wrong_share(low, high, most) > wrong:
        most *= 2
        if most > _MOST_SHOTS:
            return None
    least = most // 2
    while most - least > 1:
        middle = (least + most) // 2
        if wrong_share(low, high, middle) > wrong:
            least = middle
        else:
            most = middle
    return most
