"""From the points of a digitizer test to what is told of each gain code and of the two converters."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.values import Estimate
from procedures.gain_points import Interleave, weighted_mean

if TYPE_CHECKING:
    from collections.abc import Iterable

    from procedures.digitizer_points import SinePoint

CONSISTENT_PROBABILITY = 1e-3
"""Below this chi-square probability the points contradict each other."""
NEAR_DB = 0.5
"""Levels that differ by less count as the same."""


@dataclass(frozen=True, slots=True)
class Converters:
    """How two interleaved converters differ, from all points.

    Parameters
    ----------
    interleave : Interleave
        None in it where nothing could be told.
    status : {"ok", "inconsistent", "one_converter", "no_signal"}
        "inconsistent": the points contradict each other, and the uncertainties are widened by Birge's ratio.
    """

    interleave: Interleave
    status: Literal["ok", "inconsistent", "one_converter", "no_signal"]


def of_all_converters(points: Iterable[SinePoint], converters: int) -> Converters:
    """Average what differs between two converters over all points by their weights."""
    usable = [one.interleave for one in points if one.status == "ok"]
    if converters != 2:
        return Converters(Interleave(), "one_converter")
    if not usable:
        return Converters(Interleave(), "no_signal")
    gain, gain_agrees = _joined([one.gain for one in usable])
    offset, offset_agrees = _joined([one.offset_v for one in usable])
    skew, skew_agrees = _joined([one.skew_s for one in usable])
    agree = gain_agrees and offset_agrees and skew_agrees
    return Converters(Interleave(gain, offset, skew), "ok" if agree else "inconsistent")


def _joined(estimates: list[Estimate | None]) -> tuple[Estimate | None, bool]:
    """Return the weighted mean, widened where chance does not explain the scatter, and whether it does."""
    from scipy.special import gammaincc

    mean = weighted_mean(estimates)
    known = [one for one in estimates if one is not None and 0 < one.standard_uncertainty < math.inf]
    if mean is None or len(known) < 2:
        return mean, True
    pulls = np.array([(one.value - mean.value) / one.standard_uncertainty for one in known])
    freedom, chi_square = len(known) - 1, float(pulls @ pulls)
    if float(gammaincc(freedom / 2, chi_square / 2)) >= CONSISTENT_PROBABILITY:
        return mean, True
    spread = mean.standard_uncertainty * math.sqrt(chi_square / freedom)
    return Estimate(mean.value, spread, mean.unit), False


def shown_of_code(points: Iterable[SinePoint], code: int | None) -> SinePoint | None:
    """Return the point that stands for a gain code; None without any.

    It is that of the lowest frequency among those of the highest level that has figures; where none has,
    the first.
    """
    mine = [one for one in points if one.code == code]
    levels = [one.level_dbfs.value for one in mine if one.level_dbfs is not None]
    if not levels:
        return mine[0] if mine else None
    near = max(levels) - NEAR_DB
    high = [one for one in mine if one.level_dbfs is not None and one.level_dbfs.value >= near]
    return min(high, key=lambda one: one.frequency_hz)
