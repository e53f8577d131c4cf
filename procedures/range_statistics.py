"""From draws and shots of one cell to its probability of false detection and its spread.

*Error* is the rms after the calibrated bias was taken off, over detections; the bias is told apart. It is the
mean that the correction of arrivals leaves without noise, at that altitude. *False detection* is a candidate
nearest to the truth that is more than 10 m off.

Fast: every draw about an echo counts with its probability to be kept, so that the spread is that of what is
kept, and hardly any draw tells nothing. Conditional: the same with the peaks of the very windows of noise in
place of their law. Linear: closed form, within its validity. Brute: whole shots.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from belahil.values import Estimate
from procedures.arrival_gradient import VALID_SNR, LinearErrors
from procedures.echo_hits import FALSE_M
from procedures.error_mixture import Mixture, fit_mixture
from procedures.local_draws import NEAR_SAMPLES

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from procedures.noise_clusters import NoiseClusters

KEPT = 4
"""Candidates of the receiver."""
WINDOW = 16064
OUTSIDE = 1 - (2 * NEAR_SAMPLES + 1) / WINDOW
"""Part of a window from which noise peaks come that are not looked at one by one."""
CHANCE = KEPT * 2 * FALSE_M / (WINDOW * 12.5e-9 * 149896229.0)
"""Chance that noise alone puts one of four candidates within 10 m."""


@dataclass(frozen=True, slots=True, eq=False)
class CellDraws:
    """Draws about the echoes of one cell, arrays of shape (n, 2); see `procedures.echo_hits.EchoHits`.

    Parameters
    ----------
    hit, score_v, ahead
        As there.
    error_m : ndarray of float64
        Corrected and without the calibrated bias.
    weight : ndarray of float64, shape (n,)
        Of the draws.
    echoes : int
        Those of one echo follow each other, n / echoes of them.
    """

    hit: NDArray[np.bool_]
    score_v: NDArray[np.float64]
    ahead: NDArray[np.int64]
    error_m: NDArray[np.float64]
    weight: NDArray[np.float64]
    echoes: int

    def kept(self, law: NoiseClusters) -> NDArray[np.float64]:
        """Return the probability of each hit to be among the candidates, shape (n, 2)."""
        return np.where(self.hit, law.kept(self.score_v, KEPT - 1 - self.ahead, OUTSIDE), 0.0)

    def weights(self, law: NoiseClusters) -> NDArray[np.float64]:
        """Return the weight of each draw's ending with each of its errors, shape (n, 2)."""
        kept = self.kept(law)
        # Where both hits are kept, the nearer one is told; else the first.
        return self.weight[:, None] * np.stack([kept[:, 0] - kept[:, 1], kept[:, 1]], axis=1)

    def by_echo(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return sums over all that belongs to an echo, shape (echoes,)."""
        return np.asarray(values.reshape(self.echoes, -1).sum(axis=1))


def law_slopes(draws: CellDraws, law: NoiseClusters) -> tuple[float, float]:
    """Return the derivatives of the probability of false detection by a and b of the law."""
    total, step = float(draws.weight.sum()), 1e-3

    def false(a: float = 0.0, b: float = 0.0) -> float:
        kept = draws.kept(replace(law, a=law.a + a, b=law.b + b))[:, 0]
        return -float(draws.weight @ kept) / total

    by_a = (false(step) - false(-step)) / (2 * step)
    return by_a, (false(0.0, step) - false(0.0, -step)) / (2 * step)


def fast_pfd(draws: CellDraws, law: NoiseClusters) -> Estimate:
    """Return the probability of false detection; the law's own uncertainty is in it."""
    total = float(draws.weight.sum())
    share = float(draws.weight @ draws.kept(law)[:, 0]) / total
    by_a, by_b = law_slopes(draws, law)
    u_a, u_b = by_a * law.a_u, by_b * law.b_u
    of_law = max(u_a**2 + u_b**2 + 2 * law.correlation * u_a * u_b, 0.0)
    away = draws.by_echo(draws.weight * (draws.kept(law)[:, 0] - share))
    # Weights leave a sum that rounds to a little more than all of it.
    return Estimate(max(1 - share, 0.0), math.sqrt(float(away @ away) / total**2 + of_law), "1")


def conditional_pfd(draws: CellDraws, scores_v: NDArray[np.float64]) -> Estimate:
    """Return the same by the peaks of windows of noise, shape (windows, k), as they are.

    The uncertainty is that of the windows alone: draws are shared with `fast_pfd`.
    """
    hit, score_v, ahead = draws.hit[:, 0], draws.score_v[:, 0], draws.ahead[:, 0]
    by_window = np.zeros(len(scores_v))
    for larger in range(KEPT):
        able = hit & (ahead == larger)
        order = np.argsort(score_v[able])
        below = np.concatenate([[0.0], np.cumsum(draws.weight[able][order])])
        # Kept are those above the window's peak that would be the fourth.
        place = np.searchsorted(score_v[able][order], scores_v[:, KEPT - 1 - larger], side="right")
        by_window += below[-1] - below[place]
    by_window /= draws.weight.sum()
    return Estimate(1 - float(by_window.mean()), float(by_window.std()) / math.sqrt(len(scores_v) - 1), "1")


def weighted_rms(
    errors_m: NDArray[np.float64],
    weights: NDArray[np.float64],
    echoes: int | None = None,
    control: NDArray[np.float64] | None = None,
) -> Estimate | None:
    """Return the root of the weighted mean square, m; None where fewer than two echoes have a weight.

    Parameters
    ----------
    errors_m : ndarray of float64
        m; of the shape of the weights, or one that broadcasts to it.
    weights : ndarray of float64, shape (n, k)
        Not negative.
    echoes : int or None
        Independent are so many groups of rows; None: all rows.
    control : ndarray of float64, shape (echoes,), or None
        Of known mean 0 and like the squares of the errors: what chance makes of it is taken off.
    """
    groups, total = weights.shape[0] if echoes is None else echoes, float(weights.sum())
    if groups < 2 or np.count_nonzero(weights.reshape(groups, -1).sum(axis=1)) < 2:
        return None
    squares = np.broadcast_to(errors_m**2, weights.shape)
    mean = float((weights * squares).sum()) / total
    away = (weights * (squares - mean)).reshape(groups, -1).sum(axis=1)
    if control is not None and control.any():
        away = away - float(away @ control / (control @ control)) * control
        mean = max(mean + float(away.sum()) / total, 0.0)
    if not mean > 0:
        return Estimate(0.0, 0.0, "m")
    of_mean = math.sqrt(float(((away - away.mean()) ** 2).sum())) / total
    return Estimate(math.sqrt(mean), of_mean / (2 * math.sqrt(mean)), "m")


def influences(draws: CellDraws, law: NoiseClusters) -> tuple[tuple[float, NDArray[np.float64]], ...]:
    """Return what each echo adds to the error of a cell's numbers, to compare cells with the same draws.

    Parameters
    ----------
    draws : CellDraws
        Of the cell.
    law : NoiseClusters
        Of the noise peaks there.

    Returns
    -------
    tuple of (float, ndarray of float64, shape (echoes,))
        For the logarithm of the rms error, m, and for the probability of false detection: the value, and by
        how much it would be wrong by this echo alone. The root of the sum of squares is the uncertainty; of a
        difference, that of the differences.
    """
    weights, total = draws.weights(law), float(draws.weight.sum())
    kept = draws.kept(law)[:, 0]
    share = float(draws.weight @ kept) / total
    false = (1 - share, -draws.by_echo(draws.weight * (kept - share)) / total)
    detected = float(weights.sum())
    if not detected > 0:
        return (-math.inf, np.zeros(draws.echoes)), false
    squares = draws.error_m**2
    mean = float((weights * squares).sum()) / detected
    away = draws.by_echo(weights * (squares - mean)) / (2 * mean * detected)
    return (0.5 * math.log(mean), away), false


@dataclass(frozen=True, slots=True)
class LinearSpread:
    """Spread by source, without selection by detection.

    Parameters
    ----------
    shape_m, jitter_m, noise_m, total_m : float
        Standard deviations, m.
    snr : float
        Median height over noise.
    """

    shape_m: float
    jitter_m: float
    noise_m: float
    total_m: float
    snr: float

    @property
    def valid(self) -> bool:
        """Whether the echo is high enough over its noise."""
        return self.snr >= VALID_SNR


def linear_spread(
    linear: LinearErrors, reflectance: float, noise_rms_v: float, step_v: float
) -> LinearSpread:
    """Return the spread by linear propagation.

    Parameters
    ----------
    linear : LinearErrors
        Of white ground.
    reflectance, noise_rms_v : float
        Of the cell.
    step_v : float
        Of the converter; its rounding is taken for white noise.
    """
    white_v = step_v / math.sqrt(12)
    noise_m2 = float(linear.noise_m2(reflectance, noise_rms_v, white_v).mean())
    steady_m2 = float(linear.moved_m.var())
    return LinearSpread(
        shape_m=float(linear.still_m.std()),
        jitter_m=float((linear.moved_m - linear.still_m).std()),
        noise_m=math.sqrt(noise_m2),
        total_m=math.sqrt(steady_m2 + noise_m2),
        snr=float(np.median(linear.snr(reflectance, noise_rms_v, white_v))),
    )


@dataclass(frozen=True, slots=True)
class BruteCell:
    """What whole shots tell of a cell.

    Parameters
    ----------
    shots : int
        How many.
    pfd : Estimate
        Share of false detections.
    spread : Estimate or None
        Rms of the others; None with fewer than two.
    mixture : Mixture or None
        Normal and uniform errors instead of the rule of 10 m.
    """

    shots: int
    pfd: Estimate
    spread: Estimate | None
    mixture: Mixture | None


def brute_cell(errors_m: NDArray[np.float64], bias_m: float) -> BruteCell:
    """Reduce whole shots; `errors_m` are those of the nearest candidates, infinite where there is none."""
    count = errors_m.size
    true = errors_m[np.abs(errors_m) <= FALSE_M] - bias_m
    share = 1 - true.size / count
    # One more of either kind, so that none at all is no certainty.
    smoothed = (count - true.size + 1) / (count + 2)
    pfd_u = math.sqrt(smoothed * (1 - smoothed) / count)
    spread = weighted_rms(true[:, None], np.ones((true.size, 1)))
    return BruteCell(count, Estimate(share, pfd_u, "1"), spread, fit_mixture(errors_m - bias_m))
