"""One linear fit for scale, delays and wobble of pairs of pulses.

With D the distance of two played pulses, t_1 and t_2 their arrivals on the receiver's clock,

    t_2 - t_1 - D = s D + d_k2 - d_k1 + w_2(t_2) - w_1(t_1)

s is the relative clock error, d_k the delay of the k-th kind of pulse against that of the reference
(d_0 = 0), and w the wobble of a width with the place between samples: harmonics of the period in which every
converter has its turn, so that a receiver of two converters may wobble with two samples.

Not modelled: a delay that depends on the distance, which the residuals would show.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.values import Estimate

if TYPE_CHECKING:
    from numpy.typing import NDArray

HARMONICS = 2
"""Of a sample, per converter: the third is below a hundredth of the first."""

_UNLIKELY = 1e-3
"""Probability of a chi-square, below which uncertainties grow by the Birge ratio."""


@dataclass(frozen=True, slots=True, eq=False)
class TofFit:
    """What the fit found.

    Parameters
    ----------
    scale_ppm : Estimate
        s, unit ``1e-6``; above zero: the receiver's clock is fast.
    delays : tuple of Estimate
        d_k of each kind, s; the first is 0, that of the reference.
    delay_covariance : ndarray, shape (k, k)
        Of the delays, s^2.
    wobble : ndarray, shape (w, 2 h)
        Cosine and sine amplitudes of the harmonics for each width, s; all zero where there are too few pairs.
    wobble_covariance : ndarray, shape (w, 2 h, 2 h)
        s^2.
    residual_s, residual_u_s : ndarray, shape (n,)
        What is left of each pair, and its uncertainty before the Birge ratio.
    chi_square : float
        Of the residuals.
    degrees_of_freedom : int
        Pairs less parameters.
    birge : float
        Factor in all uncertainties, 1 where the chi-square may be chance.
    """

    scale_ppm: Estimate
    delays: tuple[Estimate, ...]
    delay_covariance: NDArray[np.float64]
    wobble: NDArray[np.float64]
    wobble_covariance: NDArray[np.float64]
    residual_s: NDArray[np.float64]
    residual_u_s: NDArray[np.float64]
    chi_square: float
    degrees_of_freedom: int
    birge: float

    def wobble_rms(self, width: int) -> Estimate:
        """Return the rms of the wobble of a width over all phases, s, less what noise adds to it."""
        amplitudes, covariance = self.wobble[width], self.wobble_covariance[width]
        square = float(amplitudes @ amplitudes) / 2
        noise = float(np.trace(covariance)) / 2
        rms = math.sqrt(max(square - noise, 0.0))
        # variance of a quadratic form of a Gaussian vector
        variance = float(amplitudes @ covariance @ amplitudes) + float(np.sum(covariance**2)) / 2
        spread = math.sqrt(variance)
        return Estimate(rms, spread / (2 * rms) if 2 * rms * rms > spread else math.sqrt(spread / 2), "s")


def harmonics(places: NDArray[np.float64], converters: int) -> NDArray[np.float64]:
    """Return the columns of the wobble, shape (n, 2 h).

    Parameters
    ----------
    places : ndarray of float64, shape (n,)
        Arrivals in samples.
    converters : int
        Samples after which all repeats.
    """
    order = np.arange(1, HARMONICS * converters + 1)
    angle = 2 * np.pi * places[:, None] * order / converters
    return np.concatenate([np.cos(angle), np.sin(angle)], axis=1)


def fit_pairs(
    distance_s: NDArray[np.float64],
    excess_s: NDArray[np.float64],
    uncertainty_s: NDArray[np.float64],
    places: NDArray[np.float64],
    kinds: NDArray[np.int64],
    widths: NDArray[np.int64],
    converters: int,
    wobble_rms_s: NDArray[np.float64],
) -> TofFit | None:
    """Fit pairs of pulses.

    Parameters
    ----------
    distance_s, excess_s, uncertainty_s : ndarray of float64, shape (n,)
        D; t_2 - t_1 - D; its standard uncertainty, s.
    places : ndarray of float64, shape (n, 2)
        Arrivals of both pulses in samples.
    kinds : ndarray of int, shape (n, 2)
        Kind of both pulses, numbered from 0, the reference.
    widths : ndarray of int, shape (n, 2)
        Width of both pulses, numbered from 0.
    converters : int
        Interleaved.
    wobble_rms_s : ndarray of float64, shape (n,)
        Expected of both pulses together, s: added to the uncertainty where there are too few pairs to fit it.

    Returns
    -------
    TofFit or None
        None where the pairs do not determine the parameters: too few, or unequal pulses at one distance only.
    """
    if not distance_s.size:
        return None
    kind_count, width_count = int(kinds.max()) + 1, int(widths.max()) + 1
    straight = _straight(distance_s, kinds, kind_count)
    wavy = _wavy(places, widths, width_count, converters)
    solved = _solve(np.concatenate([straight, wavy], axis=1), excess_s, uncertainty_s)
    if solved is None:
        # What cannot be fitted counts as scatter.
        uncertainty_s = np.hypot(uncertainty_s, wobble_rms_s)
        solved = _solve(straight, excess_s, uncertainty_s)
    if solved is None:
        return None
    found, covariance, residual_s, chi_square = solved
    freedom = excess_s.size - found.size
    birge = _birge(chi_square, freedom)
    covariance = covariance * birge**2
    each = 2 * HARMONICS * converters
    wobble = np.zeros((width_count, each))
    wobble_covariance = np.zeros((width_count, each, each))
    if found.size > kind_count:
        for one in range(width_count):
            mine = slice(kind_count + one * each, kind_count + (one + 1) * each)
            wobble[one], wobble_covariance[one] = found[mine], covariance[mine, mine]
    spread = np.sqrt(np.diag(covariance))
    # The first column is the scale; the reference has no column of its own.
    delays = [Estimate(0.0, 0.0, "s")]
    delays += [Estimate(float(found[k]), float(spread[k]), "s") for k in range(1, kind_count)]
    return TofFit(
        Estimate(1e6 * float(found[0]), 1e6 * float(spread[0]), "1e-6"),
        tuple(delays),
        np.pad(covariance[1:kind_count, 1:kind_count], ((1, 0), (1, 0))),
        wobble,
        wobble_covariance,
        residual_s,
        uncertainty_s,
        chi_square,
        freedom,
        birge,
    )


def _straight(
    distance_s: NDArray[np.float64], kinds: NDArray[np.int64], kind_count: int
) -> NDArray[np.float64]:
    """Columns of the scale and of the delay of every kind but the reference."""
    columns = np.zeros((distance_s.size, kind_count))
    columns[:, 0] = distance_s
    for one in range(1, kind_count):
        columns[:, one] = (kinds[:, 1] == one).astype(np.float64) - (kinds[:, 0] == one)
    return columns


def _wavy(
    places: NDArray[np.float64], widths: NDArray[np.int64], width_count: int, converters: int
) -> NDArray[np.float64]:
    """Columns of the wobble of each width, of the second pulse less the first."""
    first, second = harmonics(places[:, 0], converters), harmonics(places[:, 1], converters)
    blocks = [
        np.where((widths[:, 1] == one)[:, None], second, 0.0)
        - np.where((widths[:, 0] == one)[:, None], first, 0.0)
        for one in range(width_count)
    ]
    return np.concatenate(blocks, axis=1)


def _solve(
    columns: NDArray[np.float64], excess_s: NDArray[np.float64], uncertainty_s: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], float] | None:
    """Weighted least squares, None where the columns do not leave a degree of freedom or hang together."""
    if excess_s.size <= columns.shape[1]:
        return None
    weighted = columns / uncertainty_s[:, None]
    size = np.linalg.norm(weighted, axis=0)
    if not np.all(size > 0):
        return None
    left, values, right = np.linalg.svd(weighted / size, full_matrices=False)
    if values[-1] < 1e-6 * values[0]:
        return None
    found = right.T @ ((left.T @ (excess_s / uncertainty_s)) / values) / size
    inverse = (right.T / values) / size[:, None]
    residual_s = excess_s - columns @ found
    return found, inverse @ inverse.T, residual_s, float(np.sum((residual_s / uncertainty_s) ** 2))


def _birge(chi_square: float, freedom: int) -> float:
    from scipy.stats import chi2

    if float(chi2.sf(chi_square, freedom)) >= _UNLIKELY:
        return 1.0
    return max(1.0, math.sqrt(chi_square / freedom))
