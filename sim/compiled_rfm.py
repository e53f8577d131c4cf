"""The range finder's compiled loops; what each does, and its NumPy form, is in `sim.reference_rfm`.

Here is the search for candidates; their refinement is in `sim.compiled_refine`.

Of what numba calls fast math only the freedoms of rounding are given, and in the largest of many that there
is no NaN: windows with one are refused before.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from sim.compiled_refine import refine
from sim.reference_rfm import RISING

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim.template_bank import TemplateBank

__all__ = ("find", "find_in_pieces", "refine")

_CLASSES = 256
"""Lags are searched in classes of equal remainder, so that the largest of each is found in vectors."""
_LINE = 4096
"""Samples of many pieces that are searched together: all stages' outputs lie in the fastest memory."""

_ROUNDING = {"reassoc", "contract", "nsz"}
_LARGEST = {"nnan", "nsz", "contract", "reassoc"}


def find(
    samples: NDArray[np.float64], mean: float, bank: TemplateBank, count: int, exclusion: int
) -> NDArray[np.int64]:
    """As `sim.reference_rfm.find`."""
    return _find(samples, mean, *bank.plan, bank.reach, count, exclusion)


@njit(cache=True, nogil=True, fastmath=_ROUNDING)
def _find(
    samples: NDArray[np.float64],
    mean: float,
    source: NDArray[np.int64],
    stride: NDArray[np.int64],
    taps: NDArray[np.float32],
    scale: NDArray[np.float32],
    reach: int,
    count: int,
    exclusion: int,
) -> NDArray[np.int64]:
    size = samples.size
    # The samples and every stage's output, each between two stretches of zeros as long as a stage reaches.
    margin = 2 * reach
    lines = np.empty((source.size + 1, size + 2 * margin), dtype=np.float32)
    lines[:, :reach] = 0.0
    lines[:, size + 2 * margin - reach :] = 0.0
    lines[0, :margin] = 0.0
    lines[0, margin + size :] = 0.0
    inside, squares = lines[0, margin : margin + size], 0.0
    for i in range(size):
        inside[i] = samples[i] - mean
        squares += samples[i] * samples[i]
    best = np.zeros(size + 2 * reach, dtype=np.float32)
    for stage in range(source.size):
        before, after = lines[source[stage] + 1], lines[stage + 1]
        _filter(before, after, best, stride[stage], taps[stage], scale[stage], reach)
    return _peaks(best[reach : reach + size], count, exclusion, RISING * math.sqrt(squares / size))


def find_in_pieces(
    pieces: NDArray[np.float64], near: tuple[int, int], bank: TemplateBank, count: int, exclusion: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """As `sim.reference_rfm.find_in_pieces`."""
    found = np.full((len(pieces), count), -1), np.zeros((len(pieces), count))
    _find_in_pieces(pieces, near[0], near[1], *bank.plan, bank.reach, bank.tap_reach, exclusion, *found)
    return found


@njit(cache=True, nogil=True, fastmath=_LARGEST)
def _find_in_pieces(
    pieces: NDArray[np.float64],
    first: int,
    last: int,
    source: NDArray[np.int64],
    stride: NDArray[np.int64],
    taps: NDArray[np.float32],
    scale: NDArray[np.float32],
    reach: int,
    lit: int,
    exclusion: int,
    lags: NDArray[np.int64],
    heights: NDArray[np.float64],
) -> None:
    # Pieces one after the other in a line, so far apart that none bears on the lags of another.
    size, apart = last - first + 1 + 2 * lit, last - first + 1 + lit + reach
    at_once = max(_LINE // apart, 1)
    lines = np.zeros((source.size + 1, at_once * apart + 2 * reach), dtype=np.float32)
    best = np.empty(at_once * apart, dtype=np.float32)
    for begin in range(0, pieces.shape[0], at_once):
        rows = min(at_once, pieces.shape[0] - begin)
        for row in range(rows):
            piece = pieces[begin + row, first - lit :][:size]
            line = lines[0, reach + row * apart :][:size]
            for i in range(size):
                line[i] = piece[i]
        best[:] = 0.0
        for stage in range(source.size):
            before, after = lines[source[stage] + 1], lines[stage + 1]
            _filter(before, after, best, stride[stage], taps[stage], scale[stage], reach)
        for row in range(rows):
            scores = best[row * apart + lit :][: size - 2 * lit]
            for k in range(lags.shape[1]):
                lag = int(np.argmax(scores))
                if not scores[lag] > 0:
                    break
                lags[begin + row, k], heights[begin + row, k] = first + lag, scores[lag]
                scores[max(lag - exclusion, 0) : lag + exclusion + 1] = 0.0


@njit(cache=True, nogil=True, fastmath=_LARGEST)
def _filter(
    before: NDArray[np.float32],
    after: NDArray[np.float32],
    best: NDArray[np.float32],
    stride: int,
    taps: NDArray[np.float32],
    scale: np.float32,
    reach: int,
) -> None:
    """Filter all but the outer margins, and keep the best; slices begin at 0 so that the loops vectorize."""
    size = before.size - 2 * reach
    c0, c1, c2, c3, c4 = taps[0], taps[1], taps[2], taps[3], taps[4]
    out, a0 = after[reach : reach + size], before[reach : reach + size]
    a1, b1 = before[reach - stride :][:size], before[reach + stride :][:size]
    a2, b2 = before[reach - 2 * stride :][:size], before[reach + 2 * stride :][:size]
    if c3 == 0:
        for i in range(size):
            out[i] = c0 * a0[i] + c1 * (a1[i] + b1[i]) + c2 * (a2[i] + b2[i])
            best[i] = max(best[i], scale * out[i])
        return
    a3, b3 = before[reach - 3 * stride :][:size], before[reach + 3 * stride :][:size]
    if c4 == 0:
        for i in range(size):
            near = c0 * a0[i] + c1 * (a1[i] + b1[i]) + c2 * (a2[i] + b2[i])
            out[i] = near + c3 * (a3[i] + b3[i])
            best[i] = max(best[i], scale * out[i])
        return
    a4, b4 = before[reach - 4 * stride :][:size], before[reach + 4 * stride :][:size]
    for i in range(size):
        near = c0 * a0[i] + c1 * (a1[i] + b1[i]) + c2 * (a2[i] + b2[i])
        out[i] = near + c3 * (a3[i] + b3[i]) + c4 * (a4[i] + b4[i])
        best[i] = max(best[i], scale * out[i])


@njit(cache=True, nogil=True, fastmath=_LARGEST)
def _peaks(scores: NDArray[np.float32], count: int, exclusion: int, floor: float) -> NDArray[np.int64]:
    """As `sim.reference_rfm.peaks`, which leaves the scores as they are; this one does not."""
    tops = np.zeros(_CLASSES, dtype=np.float32)
    for begin in range(0, scores.size, _CLASSES):
        row = scores[begin : begin + _CLASSES]
        for i in range(row.size):
            tops[i] = max(tops[i], row[i])
    found = np.empty(count, dtype=np.int64)
    for k in range(count):
        first = int(np.argmax(tops))
        if not tops[first] > floor:
            return found[:k]
        lag = first + _CLASSES * int(np.argmax(scores[first::_CLASSES]))
        found[k] = lag
        low, high = max(lag - exclusion, 0), min(lag + exclusion + 1, scores.size)
        scores[low:high] = 0.0
        for i in range(low, min(high, low + _CLASSES)):
            class_ = scores[i % _CLASSES :: _CLASSES]
            top = np.float32(0.0)
            for j in range(class_.size):
                top = max(top, class_[j])
            tops[i % _CLASSES] = top
    return found
