"""How likely noise of a whole window outbids an echo: the law of the largest noise peaks.

Peaks of the range finder's score in noise are rare where they matter, so those above a score u are Poisson,
with a mean of exp(a - b u^2 / 2) as by Rice's formula; a and b are fitted to the peaks of windows with noise
only. An echo of score s is kept where fewer than four other peaks are larger.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

_STEPS, _SETTLED = 200, 1e-10


@dataclass(frozen=True, slots=True)
class NoiseClusters:
    """The law of the largest peaks.

    Parameters
    ----------
    unit_v : float
        Unit of the scores, V: about the rms of the noise.
    a, b : float
        Of the mean number of peaks above u in a window, exp(a - b u^2 / 2).
    a_u, b_u, correlation : float
        Standard uncertainties; correlation of a and b.
    windows : int
        From which they were fitted.
    """

    unit_v: float
    a: float
    b: float
    a_u: float
    b_u: float
    correlation: float
    windows: int

    def above(self, score_v: ArrayLike) -> NDArray[np.float64]:
        """Return the mean number of peaks of a window above scores, with their shape."""
        score = np.maximum(np.asarray(score_v, dtype=np.float64), 0.0) / self.unit_v
        with np.errstate(under="ignore"):
            return np.asarray(np.exp(self.a - 0.5 * self.b * score**2))

    def kept(self, score_v: ArrayLike, others: ArrayLike, share: float) -> NDArray[np.float64]:
        """Return the probability that a peak stays among those that are kept, with the shape of `score_v`.

        Parameters
        ----------
        score_v : array_like of float
            Of the peak, V.
        others : array_like of int
            How many noise peaks may be larger, at most; below zero: none is allowed at all, and 0 comes out.
        share : float
            Part of a window from which noise peaks come.
        """
        from scipy.special import pdtr

        most = np.asarray(others)
        found = pdtr(np.maximum(most, 0), share * self.above(score_v))
        return np.where(most >= 0, found, 0.0)


@dataclass(frozen=True, slots=True)
class LevelLaws:
    """Laws at several levels of the same noise, and between them.

    Rounding to counts is white, so it changes the law where the noise is low: a and b are linear in the
    square of 1 / level, nearly.

    Parameters
    ----------
    laws : tuple of NoiseClusters
        At least one, each in units of its level.
    """

    laws: tuple[NoiseClusters, ...]

    def at(self, level_v: float) -> NoiseClusters:
        """Return the law at a level, V; beyond the levels, that of the nearest."""
        ordered = sorted(self.laws, key=lambda one: one.unit_v)
        places = np.array([one.unit_v**-2 for one in ordered])[::-1]
        values = np.array([[one.a, one.b, one.a_u, one.b_u, one.correlation] for one in ordered])[::-1]
        a, b, a_u, b_u, correlation = (float(np.interp(level_v**-2, places, row)) for row in values.T)
        return NoiseClusters(level_v, a, b, a_u, b_u, correlation, ordered[0].windows)


def fit_clusters(scores_v: NDArray[np.float64], unit_v: float) -> NoiseClusters:
    """Fit the law to the largest peaks of windows with noise only, by maximum likelihood.

    Parameters
    ----------
    scores_v : ndarray of float64, shape (windows, k)
        The k largest scores of each window, V, falling; k at least 4.
    unit_v : float
        Unit in which a and b are told, V.

    Raises
    ------
    RefusedInput
        Fewer than 4 peaks in a window, or fewer than 20 windows.

    Notes
    -----
    The k largest points of a Poisson process of mean L(u) have the density
    exp(-L(x_k)) prod b x_i L(x_i). For a given b the best a is in closed form; b is found by Newton steps.
    """
    rows = np.asarray(scores_v, dtype=np.float64) / unit_v
    if rows.ndim != 2 or rows.shape[0] < 20 or rows.shape[1] < 4 or not rows.min() > 0:
        raise RefusedInput(f"noise peaks of shape {rows.shape}: at least 4 of each of 20 windows are needed")
    windows, count = rows.shape
    squares, last = float((rows**2).sum()) / 2, rows[:, -1] ** 2 / 2
    b = 1.0
    for _ in range(_STEPS):
        weights = np.exp(-b * (last - last.min()))
        mean = float(weights @ last) / float(weights.sum())
        spread = float(weights @ (last - mean) ** 2) / float(weights.sum())
        # With a put in, the slope of the likelihood is n k / b - sum x^2 / 2 + n k mean.
        slope, bend = windows * count * (1 / b + mean) - squares, windows * count * (1 / b**2 + spread)
        step = slope / bend
        b = max(b + step, b / 2)
        if abs(step) < _SETTLED:
            break
    low = float(last.min())
    a = math.log(windows * count / float(np.exp(-b * (last - low)).sum())) + b * low
    # Fisher's information of (a, b) at the fit.
    level = np.exp(a - b * last)
    aa, ab = float(level.sum()), -float(level @ last)
    bb = float(level @ last**2) + windows * count / b**2
    determinant = aa * bb - ab * ab
    return NoiseClusters(
        unit_v,
        a,
        b,
        math.sqrt(bb / determinant),
        math.sqrt(aa / determinant),
        -ab / math.sqrt(aa * bb),
        windows,
    )
