"""Noise tilted towards a peak about an echo, with the weights that undo it: importance sampling.

Where few echoes outbid the noise, most draws tell nothing of the errors of those that do. In a share of the
shots the noise is moved by some standard deviations along a template at some lag, both at random. The noise
stays Gaussian, so the ratio of densities is closed: with z the product with such a template, a standard
normal number, it is the mean of exp(t z - t^2 / 2). What is left untilted bounds the weights.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from procedures.local_draws import LocalDraws
    from sim.draws import Draws
    from sim.rfm import RangeFinder

UNTILTED = 0.3
"""Share of shots whose noise is left as it is: no weight is above 1 / 0.3."""
MOST = 2.0
"""Standard deviations: more wins little where one detection in fifty is true, and loses elsewhere."""

_SURE, _PART = 6.3, 0.6
_LAGS, _EACH = range(-6, 7), 3
"""Where about the echo, in samples; every third template of the bank."""


def fitting_tilt(faintest: float) -> float:
    """Return the tilt for echoes whose score, over the noise, is at least so large.

    The fourth noise peak of a window has a score of about 5, and what decides a spread are echoes about
    there: three fifths of what an echo lacks to 6.3, the best of those tried for the headline table.
    """
    return min(max(_PART * (_SURE - faintest), 0.0), MOST)


def tilted_noise(
    drawn: LocalDraws, row: NDArray[np.float64], finder: RangeFinder, tilt: float, draws: Draws
) -> LocalDraws:
    """Return the same draws with their stationary noise tilted, and weights.

    Parameters
    ----------
    drawn : LocalDraws
        Without a tilt.
    row : ndarray of float64, shape (m,)
        Autocorrelation of the noise by lag in samples, as long as a piece.
    finder : RangeFinder
        Its templates.
    tilt : float
        Standard deviations; 0: the draws as they are.
    draws : Draws
        "tilt".
    """
    if not tilt:
        return drawn
    count, size = drawn.unit.shape
    covariance = row[np.abs(np.subtract.outer(np.arange(size), np.arange(size)))]
    towards = _towards(finder, drawn.middle, covariance)
    stream = draws.stream("tilt")
    moved = stream.random(count) >= UNTILTED
    chosen = stream.integers(len(towards), size=count)
    unit = drawn.unit + np.where(moved, tilt, 0.0)[:, None] * (towards @ covariance)[chosen]
    ratio = np.exp(tilt * (unit @ towards.T) - 0.5 * tilt**2).mean(axis=1)
    return replace(drawn, unit=unit, weight=1 / (UNTILTED + (1 - UNTILTED) * ratio))


def _towards(finder: RangeFinder, middle: int, covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Templates whose product with the noise is standard normal, shape (tilts, samples)."""
    bank, found = finder.bank, []
    for lag in _LAGS:
        for bell in bank.lit_templates[1::_EACH]:
            template = np.zeros(covariance.shape[0])
            begin = middle + lag - bank.tap_reach
            template[begin : begin + bell.size] = bell
            found.append(template / math.sqrt(template @ covariance @ template))
    return np.array(found)
