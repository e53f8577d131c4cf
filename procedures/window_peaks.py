"""Candidates of a range finder with their scores, in whole windows and in pieces of them."""

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


def peaks(finder: RangeFinder, windows: NDArray[np.float64], count: int, *, mean: bool) -> Peaks:
    """Search windows as the range finder does, and tell the scores of what it finds.

    Parameters
    ----------
    finder : RangeFinder
        Its bank and its exclusion.
    windows : ndarray of float64, shape (n, m)
        V.
    count : int
        Peaks in each.
    mean : bool
        Take the mean of each window off, as of a whole one; else they are pieces of windows of zero mean.
    """
    use, bank = loops(), finder.bank
    lags = np.full((len(windows), count), -1)
    means = windows.mean(axis=1) if mean else np.zeros(len(windows))
    for row, volts, middle in zip(lags, windows, means.tolist(), strict=True):
        found = use.find(volts, middle, bank, count, finder.exclusion_samples)
        row[: found.size] = found
    return Peaks(lags, scores(finder, windows - means[:, None], lags))


def scores(finder: RangeFinder, windows: NDArray[np.float64], lags: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the largest correlation with a template at lags of windows, V, shape (n, k); 0 at lag -1."""
    bells = finder.bank.templates.astype(np.float64)
    reach, found = finder.bank.reach, np.zeros(lags.shape)
    padded = np.pad(windows, ((0, 0), (reach, reach)))
    around = np.arange(bells.shape[1])
    for row, at in zip(*np.nonzero(lags >= 0), strict=True):
        found[row, at] = (bells @ padded[row, lags[row, at] + around]).max()
    return found


def refined(
    finder: RangeFinder, windows: NDArray[np.float64], lags: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return centre and full width at the lags of windows of zero mean, in samples, shape (n, k).

    Where the lag is -1 both are 0.
    """
    use, bank = loops(), finder.bank
    centre, width = np.zeros(lags.shape), np.zeros(lags.shape)
    for number, (volts, row) in enumerate(zip(windows, lags, strict=True)):
        there = row >= 0
        found = use.refine(
            volts, 0.0, row[there], bank.widths, finder.correlation_window_samples, finder.refinement_steps
        )
        centre[number, there], width[number, there] = found[:, 0], found[:, 1]
    return centre, width
