"""Intervals for a proportion, a standard deviation and a mean, and for the difference of two of them.

All are two-sided, with half of what is left out on either side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from belahil.errors import RefusedInput

if TYPE_CHECKING:
    from collections.abc import Sequence


@dataclass(frozen=True, slots=True)
class Interval:
    """An estimate with its confidence interval.

    Parameters
    ----------
    value, low, high : float
        ``low <= value <= high``.
    """

    value: float
    low: float
    high: float

    def holds(self, value: float) -> bool:
        """Tell whether a value lies inside, ends included."""
        return self.low <= value <= self.high

    def widened(self, standard_uncertainty: float, level: float) -> Interval:
        """Add an error of Gaussian shape that the sample does not show, in squares.

        Parameters
        ----------
        standard_uncertainty : float
            Of that error, in the unit of the interval.
        level : float
            Of the interval.
        """
        added = normal_factor(level) * standard_uncertainty
        low = self.value - math.hypot(self.value - self.low, added)
        return Interval(self.value, low, self.value + math.hypot(self.high - self.value, added))


def clopper_pearson(count: int, trials: int, level: float = 0.95) -> Interval:
    """Return the exact interval of a proportion.

    It covers the true proportion at least as often as `level` says, at every proportion and number of
    trials. Score intervals (Wilson 1927) are narrower, and cover less often than they say near 0 and 1, which
    is where a range finder is meant to work.

    Parameters
    ----------
    count, trials : int
        0 to `trials`; at least 1.
    level : float
        Between 0 and 1.

    Raises
    ------
    RefusedInput
        Other numbers.

    Notes
    -----
    Clopper and Pearson 1934: the proportions at which so many or more, so many or fewer, have the probability
    ``(1 - level) / 2``; quantiles of beta distributions.
    """
    from scipy.special import betaincinv

    if not 0 <= count <= trials or trials < 1:
        raise RefusedInput(f"{count} of {trials}: 0 to all of at least 1 are allowed")
    tail = _tail(level)
    low = 0.0 if count == 0 else float(betaincinv(count, trials - count + 1, tail))
    high = 1.0 if count == trials else float(betaincinv(count + 1, trials - count, 1 - tail))
    return Interval(count / trials, low, high)


def deviation_interval(deviation: float, freedom: float, level: float = 0.95) -> Interval:
    """Return the chi-square interval of a standard deviation.

    Parameters
    ----------
    deviation : float
        As found, above 0.
    freedom : float
        Degrees of freedom, above 0; those of `effective_freedom` where the values are not normal.
    level : float
        Between 0 and 1.
    """
    from scipy.special import gammaincinv

    if not (deviation > 0 and freedom > 0):
        raise RefusedInput(f"a deviation of {deviation!r} with {freedom!r} degrees of freedom: both above 0")
    tail, half = _tail(level), freedom / 2
    low, high = (deviation * math.sqrt(half / float(gammaincinv(half, at))) for at in (1 - tail, tail))
    # With few degrees of freedom both ends may lie above the value.
    return Interval(deviation, min(low, deviation), high)


def effective_freedom(count: int, kurtosis: float) -> float:
    """Return the degrees of freedom of a sample variance of values that are not normal.

    Parameters
    ----------
    count : int
        Values, at least 2.
    kurtosis : float
        Fourth central moment over squared variance, at least 1; 3 for normal values, which gives
        ``count - 1``.

    Notes
    -----
    The variance of a sample variance is ``sigma**4 (kurtosis - (n - 3) / (n - 1)) / n``; a chi-square
    variable with ``f`` degrees of freedom over f has the relative variance ``2 / f``.
    """
    return 2 * count / (kurtosis - (count - 3) / (count - 1))


def mean_interval(mean: float, deviation: float, count: int, level: float = 0.95) -> Interval:
    """Return the interval of Student's t of a mean of `count` values, at least 2."""
    from scipy.special import stdtrit

    reach = float(stdtrit(count - 1, 1 - _tail(level))) * deviation / math.sqrt(count)
    return Interval(mean, mean - reach, mean + reach)


def difference(one: Interval, other: Interval) -> Interval:
    """Return the interval of ``one - other``, from two independent intervals of one level.

    Notes
    -----
    The distances from the values to the ends that count for one end of the difference are added in squares
    (Newcombe 1998, method 10, there with score intervals; Zou and Donner 2008 in general).
    """
    value = one.value - other.value
    return Interval(
        value,
        value - math.hypot(one.value - one.low, other.high - other.value),
        value + math.hypot(one.high - one.value, other.value - other.low),
    )


def mean_of(ones: Sequence[Interval]) -> Interval:
    """Return the interval of the mean of independent numbers, by the same rule as `difference`."""
    value = sum(one.value for one in ones) / len(ones)
    below = math.hypot(*(one.value - one.low for one in ones)) / len(ones)
    above = math.hypot(*(one.high - one.value for one in ones)) / len(ones)
    return Interval(value, value - below, value + above)


def normal_factor(level: float) -> float:
    """Return how many standard deviations on either side of a normal mean hold a share `level`."""
    from scipy.special import ndtri

    return float(ndtri(1 - _tail(level)))


def _tail(level: float) -> float:
    if not 0 < level < 1:
        raise RefusedInput(f"a level of {level!r}: between 0 and 1")
    return (1 - level) / 2
