"""The range finder's compiled loops; what each does, and its NumPy form, is in `sim.reference_rfm`.

Of what numba calls fast math only the freedoms of rounding are given, and in the largest of many that there
is no NaN: windows with one are refused before.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from belahil import pulse_fit
from belahil.pulse_fit import CURVATURE
from sim import reference_rfm
from sim.reference_rfm import RISING

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim.template_bank import TemplateBank

_CLASSES = 256
"""Lags are searched in classes of equal remainder, so that the largest of each is found in vectors."""
_LINE = 4096
"""Samples of many pieces that are searched together: all stages' outputs lie in the fastest memory."""

_ROUNDING = {"reassoc", "contract", "nsz"}
_LARGEST = {"nnan", "nsz", "contract", "reassoc"}

# The same source as the reference's, compiled.
_newton_step = njit(cache=True, nogil=True)(pulse_fit.newton_step)
_vertex = njit(cache=True, nogil=True)(reference_rfm.vertex)
_window_start = njit(cache=True, nogil=True)(reference_rfm.window_start)


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


@njit(cache=True, nogil=True, fastmath=_ROUNDING)
def _bells(widths: NDArray[np.float64], size: int) -> NDArray[np.float64]:
    """Gaussians at whole distances from -size to size, shape (widths, 2 size + 1)."""
    bells = np.empty((widths.size, 2 * size + 1))
    for k in range(widths.size):
        for i in range(size + 1):
            bells[k, size + i] = bells[k, size - i] = math.exp(-0.5 * CURVATURE * (i / widths[k]) ** 2)
    return bells


@njit(cache=True, nogil=True, fastmath=_ROUNDING)
def _product(volts: NDArray[np.float64], lag: int, bell: NDArray[np.float64]) -> float:
    total = 0.0
    near = bell[bell.size // 2 - lag :][: volts.size]
    for i in range(volts.size):
        total += near[i] * volts[i]
    return total


@njit(cache=True, nogil=True, fastmath=_ROUNDING)
def _norms(size: int, lag: int, bells: NDArray[np.float64], norms: NDArray[np.float64]) -> None:
    """Roots of the energies of the templates about a lag within a window, shape (3, widths)."""
    for j in range(3):
        for k in range(bells.shape[0]):
            near = bells[k, bells.shape[1] // 2 - (lag - 1 + j) :][:size]
            energy = 0.0
            for i in range(size):
                energy += near[i] * near[i]
            norms[j, k] = math.sqrt(energy)


@njit(cache=True, nogil=True, fastmath=_ROUNDING)
def _bell(centre: float, scale: float, bell: NDArray[np.float64]) -> None:
    """A Gaussian at whole places: outwards from the one next to its middle, each from its neighbour."""
    middle = min(max(round(centre), 0), bell.size - 1)
    q = (middle - centre) * scale
    top, fall = math.exp(-0.5 * q * q), math.exp(-scale * scale)
    up, down = math.exp(-scale * (0.5 * scale + q)), math.exp(-scale * (0.5 * scale - q))
    value, step = top, up
    for i in range(middle, bell.size):
        bell[i] = value
        value, step = value * step, step * fall
    value, step = top * down, down * fall
    for i in range(middle - 1, -1, -1):
        bell[i] = value
        value, step = value * step, step * fall


@njit(cache=True, nogil=True, fastmath=_ROUNDING)
def _moments(
    volts: NDArray[np.float64],
    centre: float,
    fwhm: float,
    bell: NDArray[np.float64],
    norm: NDArray[np.float64],
    product: NDArray[np.float64],
) -> None:
    scale = math.sqrt(CURVATURE) / fwhm
    _bell(centre, scale, bell)
    n0, n1, n2, n3, n4 = 0.0, 0.0, 0.0, 0.0, 0.0
    p0, p1, p2, p3, p4 = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(volts.size):
        q = (i - centre) * scale
        left, right, square = bell[i] * bell[i], bell[i] * volts[i], q * q
        n0, p0 = n0 + left, p0 + right
        n1, p1 = n1 + left * q, p1 + right * q
        n2, p2 = n2 + left * square, p2 + right * square
        n3, p3 = n3 + left * square * q, p3 + right * square * q
        n4, p4 = n4 + left * square * square, p4 + right * square * square
    norm[0], norm[1], norm[2], norm[3], norm[4] = n0, n1, n2, n3, n4
    product[0], product[1], product[2], product[3], product[4] = p0, p1, p2, p3, p4


@njit(cache=True, nogil=True)
def _interpolated(
    volts: NDArray[np.float64],
    lag: int,
    widths: NDArray[np.float64],
    bells: NDArray[np.float64],
    norms: NDArray[np.float64],
) -> tuple[float, float]:
    """As `sim.reference_rfm.interpolated`, with the samples at whole places and the templates as a table."""
    best, highest = 0, -math.inf
    for i in range(widths.size):
        found = _product(volts, lag, bells[i]) / norms[1, i]
        if found > highest:
            best, highest = i, found
    k = min(max(best, 1), widths.size - 2)
    ratio = math.log(widths[1] / widths[0])
    shift, top = np.empty(3), np.empty(3)
    for j in range(3):
        n, bell = k - 1 + j, bells[k - 1 + j]
        before, after = (
            _product(volts, lag - 1, bell) / norms[0, n],
            _product(volts, lag + 1, bell) / norms[2, n],
        )
        shift[j], top[j] = _vertex(before, _product(volts, lag, bell) / norms[1, n], after)
    if not (top[0] > 0 and top[1] > 0 and top[2] > 0):
        return float(lag), widths[best]
    slope = (top[2] ** -2 - top[0] ** -2) / (2 * top[1] ** -2 * math.sinh(ratio))
    limit = math.tanh(1.5 * ratio)
    off = -math.atanh(min(max(slope, -limit), limit)) / ratio
    moved = shift[1] + off * ((shift[2] - shift[0]) / 2 + off * ((shift[2] + shift[0]) / 2 - shift[1]))
    return lag + min(max(moved, -1.0), 1.0), widths[k] * math.exp(off * ratio)


@njit(cache=True, nogil=True)
def refine(
    samples: NDArray[np.float64],
    mean: float,
    lags: NDArray[np.int64],
    widths: NDArray[np.float64],
    window: int,
    steps: int,
) -> NDArray[np.float64]:
    """As `sim.reference_rfm.refine`."""
    found = np.zeros((lags.size, 4))
    norm, product, bell = np.empty(5), np.empty(5), np.empty(min(window, samples.size))
    bells, norms, about = _bells(widths, window + 1), np.empty((3, widths.size)), -1
    for row in range(lags.size):
        first = _window_start(lags[row], window, samples.size)
        volts = samples[first : first + window] - mean
        if lags[row] - first != about:
            about = lags[row] - first
            _norms(volts.size, about, bells, norms)
        centre, width = _interpolated(volts, about, widths, bells, norms)
        for _ in range(steps):
            _moments(volts, centre, width, bell, norm, product)
            if product[0] <= 0:
                break
            step_t, step_w = _newton_step(norm, product, width)
            centre = min(max(centre + step_t, 0.0), volts.size - 1.0)
            width = min(max(width * math.exp(step_w), 0.5 * widths[0]), 2 * widths[-1])
        _moments(volts, centre, width, bell, norm, product)
        found[row, 0], found[row, 1] = first + centre, width
        found[row, 2], found[row, 3] = product[0] / norm[0], first
    return found
