"""Weighted moments and quantiles of relative errors over draws about echoes, with what each echo adds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.values import Estimate

if TYPE_CHECKING:
    from numpy.typing import NDArray


FEWEST = 8
"""Echoes, as many as their weights are worth: fewer do not tell how well they know anything."""


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """Of a weighted distribution of e independent echoes.

    Parameters
    ----------
    rms, mean, spread : Estimate
        Root of the mean square, mean, and standard deviation about it.
    by_echo : ndarray of float64, shape (e,)
        By how much the logarithm of the rms would be wrong by each echo alone. The root of the sum of squares
        is its relative uncertainty; of a ratio of two with the same echoes, that of the differences.
    """

    rms: Estimate
    mean: Estimate
    spread: Estimate
    by_echo: NDArray[np.float64]


def moments(errors: NDArray[np.float64], weights: NDArray[np.float64], echoes: int) -> Moments | None:
    """Return the moments; None where the weights are worth fewer than `FEWEST` echoes.

    Parameters
    ----------
    errors, weights : ndarray of float64, shape (n, k)
        Relative; weights not negative, those of an echo in n / e rows that follow each other.
    echoes : int
        How many are independent, e.
    """
    if worth(weights, echoes) < FEWEST:
        return None
    total = float(weights.sum())

    def mean_of(values: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        mean = float((weights * values).sum()) / total
        return mean, (weights * (values - mean)).reshape(echoes, -1).sum(axis=1) / total

    mean, of_mean = mean_of(errors)
    square, of_square = mean_of(errors**2)
    variance, of_variance = mean_of((errors - mean) ** 2)
    return Moments(
        _root(square, of_square),
        Estimate(mean, _length(of_mean)),
        _root(variance, of_variance),
        of_square / (2 * square) if square > 0 else np.zeros(echoes),
    )


def worth(weights: NDArray[np.float64], echoes: int) -> float:
    """Return how many echoes of equal weight some of different ones are worth (Kish's effective number)."""
    by_echo = weights.reshape(echoes, -1).sum(axis=1)
    with np.errstate(under="ignore"):
        squares = float(by_echo @ by_echo)
    return float(by_echo.sum()) ** 2 / squares if squares > 0 else 0.0


def ratio(one: Moments, other: Moments) -> Estimate:
    """Return the rms of one over that of the other, of the same echoes."""
    value = one.rms.value / other.rms.value
    return Estimate(value, value * _length(one.by_echo - other.by_echo))


def quantiles(
    errors: NDArray[np.float64], weights: NDArray[np.float64], levels: tuple[float, ...]
) -> NDArray[np.float64]:
    """Return weighted quantiles, shape of the levels; the weights are not all 0."""
    order = np.argsort(errors, axis=None)
    below = np.cumsum(weights.ravel()[order])
    return np.asarray(errors.ravel()[order][np.searchsorted(below, np.array(levels) * below[-1])])


def _root(square: float, of_square: NDArray[np.float64]) -> Estimate:
    if not square > 0:
        return Estimate(0.0, 0.0)
    value = math.sqrt(square)
    return Estimate(value, _length(of_square) / (2 * value))


def _length(of_echo: NDArray[np.float64]) -> float:
    return math.sqrt(float(of_echo @ of_echo))
