"""Covariance of the noise in a short stretch of samples, measured in silent windows.

The noise is taken for stationary, so its covariance is that of every lag; a lag is averaged over all pairs of
samples of all silent windows. Quantization is in it as the silent windows have it. Each converter's mean is
taken out, and is told as its offset.

Not modelled: noise that is not stationary, or locked to the trigger; noise that differs between the
converters.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.errors import RefusedInput
from procedures.dark_noise import LEAST_SIGMA_COUNTS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from belahil.values import RangeWindow

NoiseStatus = Literal["ok", "noise_clipped", "noise_no_signal", "noise_below_dither", "too_few_samples"]

FEWEST_TIMES = 50
"""Silent samples for each sample of the stretch, at least: the mean chi-square of a stretch of n samples is
then wrong by at most some 2 / sqrt(50 n), 4 % for 42 samples."""


@dataclass(frozen=True, slots=True, eq=False)
class StretchNoise:
    """Noise of a stretch of samples.

    Parameters
    ----------
    status : str
        The covariance serves only where it is "ok".
    covariance : ndarray of float64, shape (n, n)
        At the converter, V^2; Toeplitz.
    offset_v : ndarray of float64, shape (converters,)
        Mean of each converter, V.
    rms_v : float
        Of a sample, quantization included, V.
    samples : int
        Silent samples that it is made of.
    """

    status: NoiseStatus
    covariance: NDArray[np.float64]
    offset_v: NDArray[np.float64]
    rms_v: float
    samples: int

    @property
    def relative_u(self) -> float:
        """Standard uncertainty of a mean chi-square that the measured covariance alone gives, relative.

        Every frequency of a spectrum measured in N samples errs by itself; the mean of chi-square runs over
        all of them, so it errs by sqrt(2 / N).
        """
        return math.sqrt(2 / self.samples) if self.samples else math.inf

    def whitener(self) -> NDArray[np.float64]:
        """Return W, shape (n, n), with W^T W the inverse of the covariance."""
        from scipy.linalg import cholesky, solve_triangular

        lower = cholesky(self.covariance, lower=True)
        white: NDArray[np.float64] = solve_triangular(lower, np.eye(lower.shape[0]), lower=True)
        return white


def stretch_noise(windows: Sequence[RangeWindow], length: int, converters: int) -> StretchNoise:
    """Measure the noise of a stretch from silent windows of one gain code.

    Parameters
    ----------
    windows : sequence of RangeWindow
        All with the same scale; those shorter than `length` are not used.
    length : int
        Samples of the stretch, at least 1.
    converters : int
        Interleaved converters: sample n belongs to converter ``n % converters``.

    Raises
    ------
    RefusedInput
        Windows of different scales.
    """
    scales = {(one.volts_per_count, one.sample_interval_s, one.gain_code) for one in windows}
    if len(scales) > 1:
        raise RefusedInput(f"silent windows of {len(scales)} different scales: they must be alike")
    clipped = any(one.saturated for one in windows)
    rows = [one.volts for one in windows if one.counts.size >= max(length, converters)]
    count = sum(row.size for row in rows)
    if clipped or count < FEWEST_TIMES * length:
        status: NoiseStatus = "noise_clipped" if clipped else "too_few_samples"
        return StretchNoise(status, np.zeros((length, length)), np.zeros(converters), 0.0, count)
    offset_v = np.array(
        [np.mean(np.concatenate([row[k::converters] for row in rows])) for k in range(converters)]
    )
    for row in rows:
        row -= np.resize(offset_v, row.size)
    lags = np.array([_lag(rows, lag) for lag in range(length)])
    rms_v = math.sqrt(lags[0])
    covariance = lags[np.abs(np.subtract.outer(np.arange(length), np.arange(length)))]
    status = "ok"
    if rms_v == 0:
        status = "noise_no_signal"
    elif rms_v < math.hypot(LEAST_SIGMA_COUNTS, math.sqrt(1 / 12)) * windows[0].volts_per_count:
        # The error of rounding then follows the signal instead of a law of its own.
        status = "noise_below_dither"
    elif np.linalg.eigvalsh(covariance)[0] <= 0:
        status = "too_few_samples"
    return StretchNoise(status, covariance, offset_v, rms_v, count)


def _lag(rows: Sequence[NDArray[np.float64]], lag: int) -> float:
    """Mean product of samples `lag` apart."""
    total = sum(float(row[: row.size - lag] @ row[lag:]) for row in rows)
    return total / sum(row.size - lag for row in rows)
