"""Candidates of a range finder with their scores: of whole windows, and of many pieces of windows at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sim.rfm import loops

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim.rfm import RangeFinder


@dataclass(frozen=True, slots=True, eq=False)
class Peaks:
    """The best peaks of n windows, best first, arrays of shape (n, k).

    Parameters
    ----------
    lag : ndarray of int64
        Sample of the window; -1: there are no more peaks.
    score : ndarray of float64
        Largest correlation with a template of unit energy at the lag, V; 0 without a peak.
    """

    lag: NDArray[np.int64]
    score: NDArray[np.float64]


def window_peaks(finder: RangeFinder, volts: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Return the largest scores of a whole window as its range finder sees it, best first, V.

    Parameters
    ----------
    finder : RangeFinder
        Its bank and its exclusion.
    volts : ndarray of float64, shape (n,)
        V; the mean is taken off.
    count : int
        Peaks at most.

    Returns
    -------
    ndarray of float64, shape (count,)
        0 where there are no more.
    """
    mean, bank = float(volts.mean()), finder.bank
    lags = loops().find(volts, mean, bank, count, finder.exclusion_samples)
    bells = bank.templates.astype(np.float64)
    padded = np.pad(volts - mean, bank.reach)
    around = np.arange(bells.shape[1])
    found = np.zeros(count)
    found[: lags.size] = (padded[lags[:, None] + around] @ bells.T).max(axis=1)
    return found


def piece_peaks(finder: RangeFinder, pieces: NDArray[np.float64], near: tuple[int, int], count: int) -> Peaks:
    """Search a stretch of lags in many pieces of windows of zero mean.

    Parameters
    ----------
    finder : RangeFinder
        Its bank and its exclusion.
    pieces : ndarray of float64, shape (n, m)
        V.
    near : tuple of int
        First and last lag; the templates reach from there within the pieces.
    count : int
        Peaks in each.
    """
    return Peaks(*loops().find_in_pieces(pieces, near, finder.bank, count, finder.exclusion_samples))


def refined(
    finder: RangeFinder, pieces: NDArray[np.float64], lags: NDArray[np.int64], steps: int | None = None
) -> tuple[NDArray[np.float64], ...]:
    """Return centre and full width in samples, amplitude in V and first sample of the correlation window.

    Parameters
    ----------
    finder : RangeFinder
        Its bank and its correlation window.
    pieces : ndarray of float64, shape (n, m)
        Pieces of windows of zero mean, V.
    lags : ndarray of int64, shape (n, k)
        With their correlation windows within the pieces; -1: none, and zeros come out.
    steps : int or None
        Of refinement; None: the range finder's.

    Returns
    -------
    tuple of ndarray of float64, each of shape (n, k)
    """
    row, column = np.nonzero(lags >= 0)
    begin = row * pieces.shape[1]
    taken = finder.refinement_steps if steps is None else steps
    # One long row of samples: correlation windows do not reach from one piece into the next.
    found = loops().refine(
        np.ascontiguousarray(pieces).ravel(),
        0.0,
        begin + lags[row, column],
        finder.bank.widths,
        finder.correlation_window_samples,
        taken,
    )
    told = tuple(np.zeros(lags.shape) for _ in range(4))
    for array, values in zip(told, found.T, strict=True):
        array[row, column] = values
    for array in (told[0], told[3]):
        array[row, column] -= begin
    return told


def window_areas(
    finder: RangeFinder, pieces: NDArray[np.float64], first: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the trapezoids over correlation windows, the integral E_CW, V times samples.

    Parameters
    ----------
    finder : RangeFinder
        Its correlation window.
    pieces : ndarray of float64, shape (n, m)
        Pieces of windows of zero mean, V.
    first : ndarray of int64, shape (n, k)
        First sample of each correlation window, which lies within its piece.

    Returns
    -------
    ndarray of float64, shape (n, k)
    """
    sums = np.cumsum(np.pad(pieces, ((0, 0), (1, 0))), axis=1)
    last = first + finder.correlation_window_samples - 1
    begin, end, low, high = (
        np.take_along_axis(rows, at, axis=1)
        for rows, at in ((sums, first), (sums, last + 1), (pieces, first), (pieces, last))
    )
    return end - begin - (low + high) / 2
