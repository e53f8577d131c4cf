"""The refinement of the range finder's candidates, compiled; its NumPy form is in `sim.reference_rfm`.

Of what numba calls fast math only the freedoms of rounding are given.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from belahil import pulse_fit
from belahil.pulse_fit import CURVATURE
from sim import reference_rfm

if TYPE_CHECKING:
    from numpy.typing import NDArray

_ROUNDING = {"reassoc", "contract", "nsz"}

# The same source as the reference's, compiled.
_newton_step = njit(cache=True, nogil=True)(pulse_fit.newton_step)
_vertex = njit(cache=True, nogil=True)(reference_rfm.vertex)
_window_start = njit(cache=True, nogil=True)(reference_rfm.window_start)


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
