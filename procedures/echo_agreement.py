"""Compare how often, how steadily and when a receiver sees an echo with what the model predicts.

Three comparisons for each echo, each by the interval of a difference: of the detection probability, of the
logarithm of the arrival's standard deviation, and of its mean; and two for all echoes together, of the mean
probability and the mean logarithm. The intervals that are shown hold at 95 %.
Decisions are made at a level that is stricter by the number of comparisons (Bonferroni), so that an honest
receiver fails one of them all in at most one run of a hundred.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from procedures.intervals import (
    Interval,
    clopper_pearson,
    deviation_interval,
    difference,
    effective_freedom,
    mean_interval,
    mean_of,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from procedures.detection_model import Prediction, Sightings

LEVEL = 0.95
FALSE_ALARMS = 0.01
"""Share of runs in which a receiver that is as the model says fails any comparison."""
FEWEST_DETECTED = 20
"""Below, a standard deviation says nothing: its interval spans a factor of two."""

Decision = Literal["pass", "fail"]


@dataclass(frozen=True, slots=True)
class Comparison:
    """One number of the receiver beside that of the model.

    Parameters
    ----------
    measured, model, between : Interval
        At 95 %; the model's with what its parameters are uncertain by; measured minus model, for standard
        deviations measured over model.
    low, high : float
        Between these `between` may lie without a failure: the half-widths of its interval at the stricter
        level about no difference.
    """

    measured: Interval
    model: Interval
    between: Interval
    low: float
    high: float

    @property
    def decision(self) -> Decision:
        """``fail`` where the interval at the stricter level leaves out that both are the same."""
        return "pass" if self.low <= self.between.value <= self.high else "fail"


@dataclass(frozen=True, slots=True)
class EchoAgreement:
    """What was compared for one echo, or for all together; None where too few windows tell.

    Parameters
    ----------
    probability, spread, apart : Comparison or None
        Detection probability; standard deviation of the time from the marker, s; its mean, s. For all echoes
        together means over them: of probabilities, of standard deviations (geometric), and of nothing else.
    """

    probability: Comparison | None
    spread: Comparison | None
    apart: Comparison | None = None


@dataclass(frozen=True, slots=True)
class _Pair:
    """One number, measured and by the model, by level; and what the model's parameters move it by."""

    at: Callable[[float], tuple[Interval, Interval]]
    shift: float = 0.0


COMPARISONS = 3
"""For each echo."""
COMPARISONS_TOGETHER = 2
"""For all echoes: what all miss a little, none may miss by enough to tell."""


def agreements(
    echoes: Sequence[tuple[Sightings, Prediction]],
) -> tuple[tuple[EchoAgreement, ...], EchoAgreement]:
    """Compare what was measured of echoes with what the model says.

    Parameters
    ----------
    echoes : sequence of (Sightings, Prediction)
        Of the receiver under test and of the model, for each echo.

    Returns
    -------
    tuple of EchoAgreement, EchoAgreement
        Of each echo; of all together.
    """
    strict = 1 - FALSE_ALARMS / (COMPARISONS * len(echoes) + COMPARISONS_TOGETHER) if echoes else LEVEL
    probabilities, spreads, means = (
        [make(*echo) for echo in echoes] for make in (_probability, _spread, _apart)
    )
    single = tuple(
        EchoAgreement(
            _compared(probability, strict, (0.0, 1.0)),
            _exponential(_compared(spread, strict)),
            _compared(mean, strict),
        )
        for probability, spread, mean in zip(probabilities, spreads, means, strict=True)
    )
    together = EchoAgreement(
        _compared(_mean_of(probabilities), strict, (0.0, 1.0)),
        _exponential(_compared(_mean_of(spreads), strict)),
    )
    return single, together


def _probability(measured: Sightings, predicted: Prediction) -> _Pair | None:
    model = predicted.sightings
    if not measured.used or not model.used:
        return None

    def at(level: float) -> tuple[Interval, Interval]:
        found, due = (clopper_pearson(one.detected, one.used, level) for one in (measured, model))
        return found, due

    return _Pair(at, _shift(predicted, lambda one: one.detected / max(one.used, 1)))


def _spread(measured: Sightings, predicted: Prediction) -> _Pair | None:
    """Of logarithms, whose differences do not depend on the unit."""
    model = predicted.sightings
    if not _enough(measured, predicted):
        return None
    kurtosis = _kurtosis(model)

    def at(level: float) -> tuple[Interval, Interval]:
        found, due = (_log_deviation(one, kurtosis, level) for one in (measured, model))
        return found, due

    return _Pair(at, _shift(predicted, lambda one: math.log(_deviation(one))))


def _apart(measured: Sightings, predicted: Prediction) -> _Pair | None:
    if not _enough(measured, predicted):
        return None

    def mean(one: Sightings) -> float:
        return float(one.apart_s.mean())

    def at(level: float) -> tuple[Interval, Interval]:
        found, due = (
            mean_interval(mean(one), _deviation(one), one.detected, level)
            for one in (measured, predicted.sightings)
        )
        return found, due

    return _Pair(at, _shift(predicted, mean))


def _enough(measured: Sightings, predicted: Prediction) -> bool:
    ones = (measured, predicted.sightings, *(predicted.shifted or ()))
    return all(one.detected >= FEWEST_DETECTED for one in ones)


def _shift(predicted: Prediction, number: Callable[[Sightings], float]) -> float:
    """By how much a number of the model grows with signal to noise larger by its standard uncertainty."""
    if predicted.shifted is None:
        return 0.0
    larger, smaller = predicted.shifted
    return (number(larger) - number(smaller)) / 2


def _mean_of(pairs: Sequence[_Pair | None]) -> _Pair | None:
    """Return the mean over echoes; what the model is uncertain by is common to all, chance is not."""
    there = [one for one in pairs if one is not None]
    if not there:
        return None

    def at(level: float) -> tuple[Interval, Interval]:
        found, due = zip(*(one.at(level) for one in there), strict=True)
        return mean_of(found), mean_of(due)

    return _Pair(at, sum(one.shift for one in there) / len(there))


def _compared(
    pair: _Pair | None, strict: float, within: tuple[float, float] = (-math.inf, math.inf)
) -> Comparison | None:
    if pair is None:
        return None

    def at(level: float) -> tuple[Interval, Interval]:
        measured, model = pair.at(level)
        wide = model.widened(abs(pair.shift), level)
        return measured, Interval(wide.value, max(wide.low, within[0]), min(wide.high, within[1]))

    measured, model = at(LEVEL)
    wide = difference(*at(strict))
    return Comparison(
        measured, model, difference(measured, model), wide.value - wide.high, wide.value - wide.low
    )


def _exponential(one: Comparison | None) -> Comparison | None:
    def back(interval: Interval) -> Interval:
        return Interval(*(math.exp(end) for end in (interval.value, interval.low, interval.high)))

    if one is None:
        return None
    ends = (math.exp(end) for end in (one.low, one.high))
    return Comparison(back(one.measured), back(one.model), back(one.between), *ends)


def _log_deviation(one: Sightings, kurtosis: float, level: float) -> Interval:
    ends = deviation_interval(_deviation(one), effective_freedom(one.detected, kurtosis), level)
    return Interval(*(math.log(end) for end in (ends.value, ends.low, ends.high)))


def _deviation(one: Sightings) -> float:
    """Standard deviation; of arrivals that are all equal the smallest number, so that logarithms stand."""
    return max(float(one.apart_s.std(ddof=1)), np.finfo(float).tiny)


def _kurtosis(one: Sightings) -> float:
    """Fourth central moment over squared variance, at least 1.8 as of a uniform spread.

    One standard error is added, that of normal values: intervals that are too narrow are the worse mistake.
    """
    away = one.apart_s - one.apart_s.mean()
    square = float(np.mean(away**2))
    found = float(np.mean(away**4)) / square**2 if square > 0 else 3.0
    return max(found, 1.8) + math.sqrt(24 / one.detected)
