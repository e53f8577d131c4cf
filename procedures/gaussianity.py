"""Whether dark noise is Gaussian, told from counts that are coarse and samples that are not independent.

Skewness and excess kurtosis are the third and fourth coefficients of the noise in Hermite polynomials
(Neyman's smooth test, 1937; without correlation and rounding that of Bowman and Shenton, 1975). Both
corrections are exact to first order:

- *Rounding.* What a count tells of the polynomial He_n is its mean over the count's cell from a to b, in
  standard deviations: ``(He_{n-1}(a) phi(a) - He_{n-1}(b) phi(b)) / (Phi(b) - Phi(a))``. What mean and width,
  which are fitted, explain of it is taken out.
- *Correlation.* For Gaussian noise ``E[He_n(x_i) He_n(x_j)] = n! rho^n`` (Mehler), so the mean of N samples
  has the variance ``v (1 + 2 v / n! sum rho_k^n) / N``, with v that of one sample.

Below 0.4 codes of noise the test is cautious: standard uncertainties are too large by up to a fifth.

Not modelled: noise whose width changes from window to window, which is not Gaussian as a whole and is told
so; departures that leave skewness and kurtosis as they are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.values import Estimate
from procedures.dark_noise import RoundedGaussian

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from belahil.values import RangeWindow

    Array = NDArray[np.float64]

GaussianStatus = Literal["ok", "not_gaussian"]

PROBABILITY = 1e-3
"""Below it chance does not explain the departure."""
_LAGS = 256
_FAR = 9.0
"""Standard deviations from which a cell is taken for its middle: the density there rounds to nothing."""


@dataclass(frozen=True, slots=True)
class Gaussianity:
    """How far noise is from a Gaussian.

    Parameters
    ----------
    status : {"ok", "not_gaussian"}
        "ok": chance explains it.
    p_value : float
        Probability that Gaussian noise, rounded and coloured like this, departs so far.
    skewness, excess_kurtosis : Estimate
        Of the analog noise; 0 for a Gaussian.
    """

    status: GaussianStatus
    p_value: float
    skewness: Estimate
    excess_kurtosis: Estimate


def gaussianity(windows: Sequence[RangeWindow], fit: RoundedGaussian) -> Gaussianity:
    """Test the noise of silent windows.

    Parameters
    ----------
    windows : sequence of RangeWindow
        Those of the fit.
    fit : RoundedGaussian
        From `procedures.dark_noise`.
    """
    weights = fit.histogram.sum(axis=1) / fit.histogram.sum()
    # Cells of the model, to ten standard deviations; the histogram may have fewer or more.
    reach = math.ceil(10 * fit.sigma) + 2
    low = min(fit.lowest, math.floor(float(fit.means.min())) - reach)
    top = max(fit.lowest + fit.histogram.shape[1], math.ceil(float(fit.means.max())) + reach)
    codes = np.arange(low, top + 1, dtype=np.float64)
    chance, scores = _scores(codes, fit)
    share = weights[:, None] * chance
    seen = np.zeros(share.shape)
    first = fit.lowest - low
    seen[:, first : first + fit.histogram.shape[1]] = fit.histogram / fit.histogram.sum()
    rests = _without_fitted(scores, share)
    number = float(fit.histogram.sum())
    products = np.einsum("nck,mck,ck->nm", rests, rests, share)
    correlation = _correlation(windows, fit)
    spread = products / number
    for place, order in enumerate((3, 4)):
        repeated = 2 * float(np.sum(correlation**order)) / math.factorial(order)
        spread[place, place] += products[place, place] ** 2 * repeated / number
    means = np.einsum("nck,ck->n", rests, seen)
    statistic = float(means @ np.linalg.solve(spread, means))
    p_value = math.exp(-statistic / 2)
    size = np.array([math.factorial(3), math.factorial(4)]) / products.diagonal()
    values, uncertainties = means * size, np.sqrt(spread.diagonal()) * size
    return Gaussianity(
        "ok" if p_value >= PROBABILITY else "not_gaussian",
        p_value,
        Estimate(float(values[0]), float(uncertainties[0])),
        Estimate(float(values[1]), float(uncertainties[1])),
    )


def _scores(codes: Array, fit: RoundedGaussian) -> tuple[Array, Array]:
    """Return the chance of each cell, shape (converters, codes), and means of He_1 ... He_4 over it."""
    from scipy.special import ndtr

    low = (codes - 0.5 - fit.means[:, None]) / fit.sigma
    high = (codes + 0.5 - fit.means[:, None]) / fit.sigma
    middle = (low + high) / 2
    above = low > 0
    chance = np.where(above, ndtr(-low) - ndtr(-high), ndtr(high) - ndtr(low))
    density_low, density_high = _density(low), _density(high)
    far = np.abs(middle) > _FAR
    safe = np.where(far, 1.0, np.maximum(chance, 1e-300))
    scores = []
    for order in range(1, 5):
        mean = (_hermite(order - 1, low) * density_low - _hermite(order - 1, high) * density_high) / safe
        scores.append(np.where(far, _hermite(order, middle), mean))
    return chance, np.array(scores)


def _density(z: Array) -> Array:
    return np.asarray(np.exp(-0.5 * np.minimum(z**2, 1400.0)) / math.sqrt(2 * math.pi))


def _hermite(order: int, z: Array) -> Array:
    """Probabilists' Hermite polynomials 0 to 4."""
    forms = (np.ones_like(z), z, z**2 - 1, z**3 - 3 * z, z**4 - 6 * z**2 + 3)
    return np.asarray(forms[order])


def _without_fitted(scores: Array, share: Array) -> Array:
    """Take out of He_3 and He_4 what a mean for each converter and one width explain, shape (2, c, codes)."""
    converters = share.shape[0]
    fitted = np.zeros((converters + 1, *share.shape))
    for converter in range(converters):
        fitted[converter, converter] = scores[0, converter]
    fitted[-1] = scores[1]
    inner = np.einsum("ick,jck,ck->ij", fitted, fitted, share)
    cross = np.einsum("nck,jck,ck->nj", scores[2:], fitted, share)
    return np.asarray(scores[2:] - np.einsum("nj,jck->nck", np.linalg.solve(inner, cross.T).T, fitted))


def _correlation(windows: Sequence[RangeWindow], fit: RoundedGaussian) -> Array:
    """Return the autocorrelation of the analog noise at lags 1, 2, ..., up to 256."""
    count = windows[0].counts.size
    lags = min(_LAGS, count - 1)
    total = np.zeros(lags)
    padded = 1 << (count + lags).bit_length()
    for window in windows:
        centred = window.counts.astype(np.float64)
        for converter, mean in enumerate(fit.means):
            centred[converter :: fit.means.size] -= mean
        power = np.abs(np.fft.rfft(centred, padded)) ** 2
        total += np.fft.irfft(power)[1 : lags + 1] / np.arange(count - 1, count - lags - 1, -1)
    # Rounding adds to the variance alone where noise spreads over the codes; what chance adds is cut off.
    found = total / len(windows) / fit.sigma**2
    return np.asarray(np.clip(found, -1.0, 1.0))
