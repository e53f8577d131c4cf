"""Score and information of the common shape, amplitude and arrival of every window taken out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from procedures.tx_likelihood import PHASES
from procedures.tx_response import HIGHEST

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from procedures.tx_families import FamilyFit
    from procedures.tx_likelihood import PulseLikelihood
    from procedures.tx_response import CutResponses

_STEP = 2e-3


def threshold_slope(responses: CutResponses, threshold: float) -> NDArray[np.float64]:
    """Return the derivative of the response by the threshold, shape (m,)."""
    low, high = max(threshold - _STEP, 0.0), min(threshold + _STEP, HIGHEST)
    return (responses.exact(high) - responses.exact(low)) / (high - low)


def score_of(
    windows: PulseLikelihood, best: FamilyFit, moved: list[NDArray[np.float64]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return score, shape (d,), and information, shape (d, d), of changes of the common response.

    Parameters
    ----------
    windows : PulseLikelihood
        Of the windows.
    best : FamilyFit
        Where they are taken.
    moved : list of ndarray of float64, shape (m,)
        Change of the response by one unit of each parameter, at `SegmentGrid.times_s`.
    """
    fits = windows.fit(best.response)
    near = np.clip(np.rint(fits.arrival * PHASES).astype(np.intp) + PHASES, 1, 3 * PHASES - 1)
    score, information = np.zeros(len(moved)), np.zeros((len(moved), len(moved)))
    for odd in (False, True):
        mine = windows.odd == odd if windows.skew_s else np.full(len(windows), not odd)
        if not mine.any():
            continue
        shape = windows.templates(best.response, odd)
        free, _ = np.linalg.qr(np.stack([shape, np.gradient(shape, axis=0)], axis=2))
        each = np.stack([windows.templates(one, odd) for one in moved], axis=1)
        # Rows: arrivals of the grid, departures, samples.
        each = each - np.einsum("gkp,gdp->gdk", free, np.einsum("gkp,gdk->gdp", free, each))
        amplitude, at = fits.amplitude_v[mine], near[mine]
        score += np.einsum("n,ndk,nk->d", amplitude, each[at], windows.white[mine])
        square = np.einsum("gdk,gek->gde", each, each)
        information += np.einsum("n,nde->de", amplitude**2, square[at])
    return score, information
