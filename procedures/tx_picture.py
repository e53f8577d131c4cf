"""The detected pulse in equivalent time: all windows laid over one another by their fitted arrivals.

This is a picture of the fit. It is no data to fit to, since its times and scale come from the fit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from procedures.tx_likelihood import PHASES
from procedures.tx_response import HIGHEST

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from procedures.tx_analysis import TxFound

_BIN_S = 2e-9
_TRIED, _TRIED_NEAR = 98, 21


@dataclass(frozen=True, slots=True, eq=False)
class EquivalentTime:
    """What is drawn.

    Parameters
    ----------
    samples_s, samples : ndarray of float64, shape (n,)
        Every sample: time after the peak of the light, s; of the height before the cut.
    times_s, hard, uncut : ndarray of float64, shape (m,)
        Fitted hard cut, and the uncut pulse at the same peak.
    bins_s, left, left_u : ndarray of float64, shape (k,)
        Means over 2 ns of samples less the hard cut, and their standard uncertainties for white noise.
    thresholds, log_likelihood : ndarray of float64, shape (l,)
        Log-likelihood less its maximum.
    """

    samples_s: NDArray[np.float64]
    samples: NDArray[np.float64]
    times_s: NDArray[np.float64]
    hard: NDArray[np.float64]
    uncut: NDArray[np.float64]
    bins_s: NDArray[np.float64]
    left: NDArray[np.float64]
    left_u: NDArray[np.float64]
    thresholds: NDArray[np.float64]
    log_likelihood: NDArray[np.float64]

    @property
    def missing(self) -> NDArray[np.float64]:
        """Uncut pulse less hard cut."""
        return self.uncut - self.hard


def equivalent_time(found: TxFound) -> EquivalentTime:
    """Lay the windows over one another."""
    grid, fits = found.windows.grid, found.fits
    step_s = grid.sample_interval_s
    there = fits.amplitude_v > 0
    place = np.arange(grid.count) - grid.before - fits.arrival[there, None]
    volts = found.segments_v[there] / fits.amplitude_v[there, None]
    times_s, hard = grid.times_s, found.hard.response
    keep = slice(PHASES, -PHASES)
    uncut = found.responses.hard(0.0)
    samples_s, samples = (place * step_s).ravel(), volts.ravel()
    left = samples - np.interp(samples_s, times_s, hard)
    bins = np.floor(samples_s / _BIN_S).astype(np.int64)
    numbers, where = np.unique(bins, return_inverse=True)
    count = np.bincount(where)
    mean = np.bincount(where, left) / count
    spread = np.sqrt(np.maximum(np.bincount(where, left**2) / count - mean**2, 0.0) / count)
    near = np.linspace(*found.noise_interval, _TRIED_NEAR)
    thresholds = np.unique([*np.linspace(0.0, HIGHEST, _TRIED), *near, found.threshold.value])
    merits = np.array([found.windows.fit(found.responses.hard(float(one))).merit for one in thresholds])
    return EquivalentTime(
        samples_s,
        samples,
        times_s[keep],
        hard[keep],
        (uncut * hard.max() / uncut.max())[keep],
        np.asarray((numbers + 0.5) * _BIN_S, dtype=np.float64),
        mean,
        spread,
        thresholds,
        (merits - found.hard.merit) / 2,
    )
