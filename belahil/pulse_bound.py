"""The Cramer-Rao bound of a pulse: how well its arrival, width and amplitude can be known at best."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput
from belahil.pole_response import autocovariance
from belahil.pulse_fit import CURVATURE, GaussianPulse

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray


def white_bound(pulse: GaussianPulse, sample_interval_s: float, noise_rms_v: float) -> GaussianPulse:
    """Return the least standard deviations of a Gaussian's parameters in white noise.

    Parameters
    ----------
    pulse : GaussianPulse
        At least about two samples wide, and inside the window: sums over samples are taken as integrals.
    sample_interval_s, noise_rms_v : float
        s; of each sample, V.

    Returns
    -------
    GaussianPulse
        Standard deviations in the place of the parameters: of the arrival sqrt(2 s dt / sqrt(pi)) sigma / A
        with s the standard deviation of the pulse; of s the same; of the amplitude
        sqrt(3 dt / (2 sqrt(pi) s)) sigma (Kay, Fundamentals of Statistical Signal Processing, 1993, eq. 3.31
        for these three parameters, all unknown).
    """
    sigma_s = pulse.fwhm_s / math.sqrt(CURVATURE)
    arrival_s = (
        math.sqrt(2 * sigma_s * sample_interval_s / math.sqrt(math.pi)) * noise_rms_v / pulse.amplitude_v
    )
    amplitude_v = math.sqrt(1.5 * sample_interval_s / (math.sqrt(math.pi) * sigma_s)) * noise_rms_v
    return GaussianPulse(arrival_s, arrival_s * math.sqrt(CURVATURE), amplitude_v)


def filtered_noise_covariance(
    poles: Sequence[complex],
    zeros: int,
    sample_interval_s: float,
    sample_count: int,
    noise_rms_v: float,
    white_rms_v: float = 0.0,
) -> NDArray[np.float64]:
    """Return the covariance of samples of white noise behind a filter, V^2, shape (n, n).

    Parameters
    ----------
    poles, zeros
        As in `belahil.pole_response`.
    sample_interval_s : float
        s.
    sample_count : int
        n.
    noise_rms_v : float
        Of the filtered noise, V.
    white_rms_v : float
        Of noise that comes after the filter, as quantization does, V.

    Raises
    ------
    RefusedInput
        Poles that are not stable or not conjugate.
    """
    lags = np.arange(sample_count)
    row = autocovariance(poles, lags * sample_interval_s, zeros)
    row *= noise_rms_v**2 / row[0]
    row[0] += white_rms_v**2
    return np.asarray(row[np.abs(lags[:, None] - lags)])


def bound(gradient: ArrayLike, noise_covariance: ArrayLike) -> NDArray[np.float64]:
    """Return the least covariance of unbiased estimates in Gaussian noise, the inverse Fisher information.

    Parameters
    ----------
    gradient : array_like of float, shape (p, n)
        Derivative of the samples by each of p parameters that are all unknown.
    noise_covariance : array_like of float, shape (n, n) or ()
        Of the noise, V^2; a number: the variance of white noise.

    Returns
    -------
    ndarray of float64, shape (p, p)

    Raises
    ------
    RefusedInput
        The covariance is not positive definite, or the parameters cannot be told apart.
    """
    slopes = np.atleast_2d(np.asarray(gradient, dtype=np.float64))
    noise = np.asarray(noise_covariance, dtype=np.float64)
    try:
        if noise.ndim == 0:
            whitened = slopes.T / np.sqrt(noise)
        else:
            whitened = np.linalg.solve(np.linalg.cholesky(noise), slopes.T)
        scale = np.linalg.norm(whitened, axis=0)
        scale = np.where(scale > 0, scale, 1.0)
        inverse = np.linalg.inv(np.linalg.qr(whitened / scale, mode="r"))
    except np.linalg.LinAlgError:
        raise RefusedInput(
            "a bound for a noise covariance that is not positive definite, or for parameters of equal effect"
        ) from None
    return np.asarray(inverse @ inverse.T / np.multiply.outer(scale, scale))


def gaussian_gradient(pulse: GaussianPulse, times_s: ArrayLike) -> NDArray[np.float64]:
    """Return the derivatives of a Gaussian by arrival (V/s), width (V/s) and amplitude, shape (3, n)."""
    volts = pulse.at(times_s)
    away = (np.asarray(times_s, dtype=np.float64) - pulse.arrival_s) / pulse.fwhm_s
    return np.stack(
        [
            CURVATURE * away / pulse.fwhm_s * volts,
            CURVATURE * away**2 / pulse.fwhm_s * volts,
            volts / pulse.amplitude_v,
        ]
    )
