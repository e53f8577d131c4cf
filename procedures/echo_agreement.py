"""Compare how often, how steadily and when a receiver sees an echo with what the model predicts.

Three comparisons for each echo, each by the interval of a difference: of the detection probability, of the
logarithm of the arrival's standard deviation, and of its mean. The intervals that are shown hold at 95 %.
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
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from procedures.detection_model import Prediction, Sightings

LEVEL = 0.95
FALSE_ALARMS = 0.01
"""Share of runs in which a receiver that is as the model says fails any comparison."""
FEWEST_DETECTED = 20
"""Below, a standard deviation says nothing: its interval spans a factor of two."""

Decision = Literal["pass", "fail", "undecided"]


@dataclass(frozen=True, slots=True)
class Comparison:
    """One number of the receiver beside that of the model.

    Parameters
    ----------
    measured, model, between : Interval
        At 95 %; the model's with what its parameters are uncertain by; measured minus model, for standard
        deviations measured over model.
    decision : str
        ``fail`` where the interval at the stricter level excludes that both are the same.
    """

    measured: Interval
    model: Interval
    between: Interval
    decision: Decision


@dataclass(frozen=True, slots=True)
class EchoAgreement:
    """What was compared for one echo; None where too few windows tell.

    Parameters
    ----------
    probability, spread, apart : Comparison or None
        Detection probability; standard deviation of the time from the marker, s; its mean, s.
    """

    probability: Comparison | None
    spread: Comparison | None
    apart: Comparison | None


COMPARISONS = 3
"""For each echo."""


def agreement(measured: Sightings, predicted: Prediction, comparisons: int) -> EchoAgreement:
    """Compare what was measured of one echo with what the model says.

    Parameters
    ----------
    measured : Sightings
        Of the receiver under test.
    predicted : Prediction
        Of the model.
    comparisons : int
        That are made in the whole run.
    """
    strict = 1 - FALSE_ALARMS / comparisons
    model, shifted = predicted.sightings, predicted.shifted
    if not measured.used or not model.used:
        return EchoAgreement(None, None, None)

    def moved(number: Callable[[Sightings], float]) -> float:
        """By how much one standard uncertainty of signal to noise moves a number of the model."""
        return 0.0 if shifted is None else abs(number(shifted[0]) - number(shifted[1])) / 2

    def probability(level: float) -> tuple[Interval, Interval]:
        shift = moved(lambda one: one.detected / max(one.used, 1))
        found, due = (clopper_pearson(one.detected, one.used, level) for one in (measured, model))
        return found, _within(due.widened(shift, level), 0.0, 1.0)

    told = _compared(probability, strict)
    of_shifts = (one.detected for one in shifted or ())
    if min(measured.detected, model.detected, *of_shifts) < FEWEST_DETECTED:
        return EchoAgreement(told, None, None)

    kurtosis = _kurtosis(model)

    def spread(level: float) -> tuple[Interval, Interval]:
        found, due = (_log_deviation(one, kurtosis, level) for one in (measured, model))
        return found, due.widened(moved(lambda one: math.log(_deviation(one))), level)

    def apart(level: float) -> tuple[Interval, Interval]:
        found, due = (
            mean_interval(float(one.apart_s.mean()), _deviation(one), one.detected, level)
            for one in (measured, model)
        )
        return found, due.widened(moved(lambda one: float(one.apart_s.mean())), level)

    return EchoAgreement(told, _exponential(_compared(spread, strict)), _compared(apart, strict))


def _compared(pair: Callable[[float], tuple[Interval, Interval]], strict: float) -> Comparison:
    measured, model = pair(LEVEL)
    same = difference(*pair(strict)).holds(0.0)
    return Comparison(measured, model, difference(measured, model), "pass" if same else "fail")


def _exponential(one: Comparison) -> Comparison:
    def back(interval: Interval) -> Interval:
        return Interval(*(math.exp(end) for end in (interval.value, interval.low, interval.high)))

    return Comparison(back(one.measured), back(one.model), back(one.between), one.decision)


def _log_deviation(one: Sightings, kurtosis: float, level: float) -> Interval:
    ends = deviation_interval(_deviation(one), effective_freedom(one.detected, kurtosis), level)
    return Interval(*(math.log(end) for end in (ends.value, ends.low, ends.high)))


def _deviation(one: Sightings) -> float:
    """Standard deviation; of arrivals that are all equal the smallest number, so that logarithms stand."""
    return max(float(one.apart_s.std(ddof=1)), np.finfo(float).tiny)


def _kurtosis(one: Sightings) -> float:
    """Fourth central moment over squared variance, at least 1.8 as of a uniform spread."""
    away = one.apart_s - one.apart_s.mean()
    square = float(np.mean(away**2))
    return max(float(np.mean(away**4)) / square**2, 1.8) if square > 0 else 3.0


def _within(one: Interval, low: float, high: float) -> Interval:
    return Interval(one.value, max(one.low, low), min(one.high, high))
