"""The range finder's loops in NumPy: slow and obvious. `sim.compiled_rfm` has the same, compiled."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from belahil.pulse_fit import CURVATURE, moments, newton_step

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim.template_bank import TemplateBank

RISING = 1e-6
"""Of the rms of the samples: a score that is not above it comes of rounding."""

_BLOCK = 64


def best_scores(samples: NDArray[np.float32], bank: TemplateBank) -> NDArray[np.float32]:
    """Return at every lag the largest correlation with a template of unit energy, 0 where none is positive.

    Parameters
    ----------
    samples : ndarray of float32, shape (n,)
        Zero outside.
    bank : TemplateBank
        Its `templates`.
    """
    reach, bells = bank.reach, bank.templates
    blocks = -(-samples.size // _BLOCK)
    padded = np.pad(samples, (reach, reach + blocks * _BLOCK - samples.size))
    size = _BLOCK + 2 * reach
    rows = np.ascontiguousarray(np.lib.stride_tricks.sliding_window_view(padded, size)[::_BLOCK])
    best = np.zeros((blocks, _BLOCK), dtype=np.float32)
    for bell in bells:
        # The template at every place in a block, as one matrix: a product of matrices does many lags at once.
        toeplitz = np.lib.stride_tricks.sliding_window_view(np.pad(bell, _BLOCK - 1), _BLOCK)[:, ::-1]
        np.maximum(best, rows @ np.ascontiguousarray(toeplitz), out=best)
    return best.ravel()[: samples.size]


def peaks(scores: NDArray[np.float32], count: int, exclusion: int, floor: float) -> NDArray[np.int64]:
    """Return the lags of the largest scores, one after the other, none within `exclusion` of an earlier one.

    Parameters
    ----------
    scores : ndarray of float32, shape (n,)
    count : int
        At most so many.
    exclusion : int
        Samples on either side of a lag that are out of the question afterwards.
    floor : float
        Scores up to here do not count.
    """
    left = scores.copy()
    found: list[int] = []
    for _ in range(count):
        lag = int(np.argmax(left))
        if not left[lag] > floor:
            break
        found.append(lag)
        left[max(lag - exclusion, 0) : lag + exclusion + 1] = 0
    return np.array(found, dtype=np.int64)


def find(
    samples: NDArray[np.float64], mean: float, bank: TemplateBank, count: int, exclusion: int
) -> NDArray[np.int64]:
    """Search a whole window: remove its mean, correlate, choose.

    Parameters
    ----------
    samples : ndarray of float64, shape (n,)
        V; finite.
    mean : float
        Their mean, V.
    bank, count, exclusion
        As in `best_scores` and `peaks`.

    Returns
    -------
    ndarray of int64, shape (m,)
        Lags, best first; fewer than `count` where no more scores are positive.
    """
    floor = RISING * math.sqrt(float(samples @ samples) / samples.size)
    return peaks(best_scores((samples - mean).astype(np.float32), bank), count, exclusion, floor)


def find_in_pieces(
    pieces: NDArray[np.float64], near: tuple[int, int], bank: TemplateBank, count: int, exclusion: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Search a stretch of lags in many pieces of windows, as one product of matrices.

    Parameters
    ----------
    pieces : ndarray of float64, shape (n, m)
        V, of zero mean.
    near : tuple of int
        First and last lag; the templates reach from there within the pieces.
    bank, count, exclusion
        As in `find`.

    Returns
    -------
    lags : ndarray of int64, shape (n, count)
        Best first; -1: there are no more peaks.
    scores : ndarray of float64, shape (n, count)
        At these lags, V; 0 without a peak.
    """
    (first, last), bells, reach = near, bank.lit_templates, bank.tap_reach
    part = pieces[:, first - reach : last + reach + 1].astype(np.float32)
    lags = np.arange(last - first + 1)
    # Each template at each lag: shape (samples, templates, lags).
    at = np.arange(part.shape[1])[:, None, None] - lags
    inside = (at >= 0) & (at <= 2 * reach)
    columns = np.where(inside, bells[np.arange(len(bells))[:, None], np.where(inside, at, 0)], np.float32(0))
    scores = (part @ columns.reshape(part.shape[1], -1)).reshape(len(part), len(bells), -1).max(axis=1)
    rows = np.arange(len(scores))
    found, heights = np.full((len(scores), count), -1), np.zeros((len(scores), count))
    for k in range(count):
        best = scores.argmax(axis=1)
        there = scores[rows, best] > 0
        found[there, k], heights[there, k] = first + best[there], scores[rows, best][there]
        scores[np.abs(lags - best[:, None]) <= exclusion] = 0.0
    return found, heights


def refine(
    samples: NDArray[np.float64],
    mean: float,
    lags: NDArray[np.int64],
    widths: NDArray[np.float64],
    window: int,
    steps: int,
) -> NDArray[np.float64]:
    """Turn lags into centres, widths and amplitudes.

    Parameters
    ----------
    samples : ndarray of float64, shape (n,)
        V.
    mean : float
        Taken off, V.
    lags : ndarray of int64, shape (m,)
        From `find`.
    widths : ndarray of float64, shape (k,)
        Full widths of the templates, in samples, in geometric steps.
    window : int
        Samples in the correlation window.
    steps : int
        Refinement steps after the interpolation.

    Returns
    -------
    ndarray of float64, shape (m, 4)
        Centre and full width in samples, amplitude in V, first sample of the correlation window.
    """
    found = np.zeros((lags.size, 4))
    for row, lag in zip(found, lags, strict=True):
        first = window_start(int(lag), window, samples.size)
        volts = samples[first : first + window] - mean
        places = np.arange(float(volts.size))
        centre, width = interpolated(volts, places, float(lag - first), widths)
        for _ in range(steps):
            norm, product = moments(volts, places, centre, width)
            if product[0] <= 0:
                break
            step_t, step_w = newton_step(norm, product, width)
            centre = min(max(centre + step_t, 0.0), volts.size - 1.0)
            width = min(max(width * math.exp(step_w), 0.5 * widths[0]), 2 * widths[-1])
        norm, product = moments(volts, places, centre, width)
        row[:] = first + centre, width, product[0] / norm[0], first
    return found


def window_start(lag: int, window: int, sample_count: int) -> int:
    """Return the first sample of a correlation window: `lag` in its middle, all of it inside."""
    return max(min(lag - (window - 1) // 2, sample_count - window), 0)


def interpolated(
    volts: NDArray[np.float64], places: NDArray[np.float64], lag: float, widths: NDArray[np.float64]
) -> tuple[float, float]:
    """Interpolate the scores about the best whole lag and template.

    Parameters
    ----------
    volts, places : ndarray of float64, shape (n,)
        Samples and where they are.
    lag : float
        Whole.
    widths : ndarray of float64, shape (k,)
        As in `refine`.

    Returns
    -------
    centre, width : float
        In samples.

    Notes
    -----
    In the lag a parabola through logarithms: exact for a Gaussian pulse. In the width a score of a Gaussian
    goes with 1 / sqrt(cosh u), u = ln(width / true width), which three templates determine exactly as well.
    Where a score is not positive, the whole lag or the template stands.
    """
    ratio = math.log(widths[1] / widths[0])
    best = max((score(volts, places, lag, width), -k) for k, width in enumerate(widths))
    k = min(max(-best[1], 1), widths.size - 2)
    shift, top = np.zeros(3), np.zeros(3)
    for j in range(3):
        before, at, after = (score(volts, places, lag + d, widths[k - 1 + j]) for d in (-1, 0, 1))
        shift[j], top[j] = vertex(before, at, after)
    if not (top > 0).all():
        return lag, float(widths[-best[1]])
    below, middle, above = 1 / top**2
    slope = (above - below) / (2 * middle * math.sinh(ratio))
    limit = math.tanh(1.5 * ratio)
    off = -math.atanh(min(max(slope, -limit), limit)) / ratio
    # The lag of the top moves a little with the width where the pulse is not symmetric.
    moved = shift[1] + off * ((shift[2] - shift[0]) / 2 + off * ((shift[2] + shift[0]) / 2 - shift[1]))
    return lag + min(max(float(moved), -1.0), 1.0), float(widths[k] * math.exp(off * ratio))


def score(volts: NDArray[np.float64], places: NDArray[np.float64], lag: float, width: float) -> float:
    """Return the correlation with a Gaussian of unit energy."""
    with np.errstate(under="ignore"):
        bell = np.exp(-0.5 * CURVATURE * ((places - lag) / width) ** 2)
    return float(bell @ volts) / math.sqrt(float(bell @ bell))


def vertex(before: float, at: float, after: float) -> tuple[float, float]:
    """Return where a parabola through three logarithms is highest, at most 1 from the middle, and its height.

    (0, `at`) where a value is not positive or the parabola has no top.
    """
    if not (before > 0 and at > 0 and after > 0):
        return 0.0, at
    left, middle, right = math.log(before), math.log(at), math.log(after)
    bend, tilt = left - 2 * middle + right, (right - left) / 2
    if not bend < 0:
        return 0.0, at
    shift = min(max(-tilt / bend, -1.0), 1.0)
    return shift, math.exp(middle + tilt * shift + 0.5 * bend * shift * shift)
