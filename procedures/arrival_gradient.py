"""How a corrected arrival follows small noise in the samples: linear propagation through the Gaussian fit.

The range finder's fit is where the sum of squared residuals is least, so a small change of the samples moves
it by the inverse of the curvature times the model's derivatives. The curvature keeps the residuals' part: an
echo from relief is no Gaussian. The variance that noise gives is then a quadratic form in closed form. It is
exact for small noise; `VALID_SNR` says where that ends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.pulse_fit import CURVATURE
from procedures.echo_hits import HALF_LIGHT, corrected_m
from procedures.local_draws import NEAR_SAMPLES
from procedures.window_peaks import piece_peaks, refined

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.delay_curve import DelayCurve
    from procedures.local_draws import LocalDraws
    from sim.rfm import RangeFinder

VALID_SNR = 6.0
"""Height over the largest rms of all noise on it, from which on linear propagation holds within 5 %."""

_STEPS = 8
"""Of refinement: the derivatives are those at the least sum of squares itself."""
_WIDTH_STEP = 0.01
"""Of a width: for the slope of the correction."""


@dataclass(frozen=True, slots=True, eq=False)
class LinearErrors:
    """Errors of e echoes without noise, and how noise adds to them; arrays of shape (e,).

    Parameters
    ----------
    still_m, moved_m : ndarray of float64
        Corrected one-way error without noise, m: without and with jitter of beam and energy.
    peak_v : ndarray of float64
        Height of the fitted Gaussian, V.
    width_s : ndarray of float64
        Its full width, s.
    stationary_m2, white_m2, shot_m2 : ndarray of float64
        Variance of the error that stationary noise of 1 V rms, white noise of 1 V rms after the filter, and
        the shot noise of white ground give an echo of white ground, m^2.
    shot_v2 : ndarray of float64
        Largest variance of that shot noise at a sample, V^2.
    by_unit_m, by_shot_m : ndarray of float64, shape (n,)
        Error that a shot's own stationary noise of 1 V rms, and shot noise, make of an echo of white ground.
    """

    still_m: NDArray[np.float64]
    moved_m: NDArray[np.float64]
    peak_v: NDArray[np.float64]
    width_s: NDArray[np.float64]
    stationary_m2: NDArray[np.float64]
    white_m2: NDArray[np.float64]
    shot_m2: NDArray[np.float64]
    shot_v2: NDArray[np.float64]
    by_unit_m: NDArray[np.float64]
    by_shot_m: NDArray[np.float64]

    def noise_m2(self, reflectance: float, noise_rms_v: float, white_rms_v: float) -> NDArray[np.float64]:
        """Return the variance that noise gives each shot, m^2, shape (n,).

        Parameters
        ----------
        reflectance : float
            Of the ground.
        noise_rms_v, white_rms_v : float
            Of the stationary noise; of what comes after the filter, as rounding does, V.
        """
        steady = self.stationary_m2 * noise_rms_v**2 + self.white_m2 * white_rms_v**2
        return np.asarray(steady / reflectance**2 + self.shot_m2 / reflectance)

    def chance_m(self, reflectance: float, noise_rms_v: float) -> NDArray[np.float64]:
        """Return the error that its own noise, without rounding, makes each shot to first order, m."""
        return np.asarray(
            self.by_unit_m * (noise_rms_v / reflectance) + self.by_shot_m / math.sqrt(reflectance)
        )

    def snr(self, reflectance: float, noise_rms_v: float, white_rms_v: float) -> NDArray[np.float64]:
        """Return height of the echo over the largest rms of all noise on it, shape (n,)."""
        noise_v2 = noise_rms_v**2 + white_rms_v**2 + reflectance * self.shot_v2
        return np.asarray(reflectance * self.peak_v / np.sqrt(noise_v2))


def linear_errors(
    draws: LocalDraws, finder: RangeFinder, curve: DelayCurve, autocorrelation: NDArray[np.float64]
) -> LinearErrors:
    """Propagate noise.

    Parameters
    ----------
    draws : LocalDraws
        Of white ground.
    finder : RangeFinder
        Its correlation window.
    curve : DelayCurve
        The correction of arrivals.
    autocorrelation : ndarray of float64, shape (k,)
        Of the stationary noise by lag in samples, from 1 at lag 0; at least as long as the correlation
        window.
    """
    interval_s = draws.interval_s
    still, _ = _fitted(draws.still_v, draws, finder)
    moved, first = _fitted(draws.echo_v, draws, finder)
    at = first[:, None] + np.arange(finder.correlation_window_samples)
    volts = np.take_along_axis(draws.echo_v, at, axis=1)
    by_centre, by_width = fit_gradient(volts, at, *moved)
    width_s = interval_s * moved[1]
    bend = _slope(curve, width_s) * interval_s * moved[1]
    # Metres of corrected error for a volt in each sample.
    gradient = HALF_LIGHT * (interval_s * by_centre - bend[:, None] * by_width)
    lags = np.abs(np.arange(at.shape[1])[:, None] - np.arange(at.shape[1]))
    coloured = np.einsum("ni,ij,nj->n", gradient, autocorrelation[lags], gradient, optimize=True)
    whole = np.zeros(draws.echo_v.shape)
    np.put_along_axis(whole, at, gradient, axis=1)
    by_step = whole @ draws.shot_taps.T
    return LinearErrors(
        still_m=_errors_m(draws, still, curve),
        moved_m=_errors_m(draws, moved, curve),
        peak_v=moved[2],
        width_s=width_s,
        stationary_m2=coloured,
        white_m2=np.einsum("ni,ni->n", gradient, gradient),
        shot_m2=np.einsum("nu,nu->n", by_step**2, draws.shot_variance),
        shot_v2=(draws.shot_variance @ draws.shot_taps**2).max(axis=1),
        by_unit_m=np.einsum("ni,ni->n", whole[draws.of_echo], draws.unit),
        by_shot_m=np.einsum("ni,ni->n", whole[draws.of_echo], draws.shot_v),
    )


def fit_gradient(
    volts: NDArray[np.float64],
    places: NDArray[np.int64],
    centre: NDArray[np.float64],
    width: NDArray[np.float64],
    amplitude: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how centre and logarithm of the width of least-squares Gaussians follow their samples.

    Parameters
    ----------
    volts : ndarray of float64, shape (n, m)
        Samples that were fitted, V.
    places : ndarray of int64, shape (n, m)
        Where they are, in samples.
    centre, width, amplitude : ndarray of float64, shape (n,)
        The fits: samples, samples, V.

    Returns
    -------
    by_centre, by_width : ndarray of float64, shape (n, m)
        Samples per V; 1 / V.

    Notes
    -----
    With the model A exp(-q^2 / 2), q = (i - t) / s, and u = ln s: d/dt = A b q / s, d/du = A b q^2, d/dA = b,
    and the second derivatives of them weigh the residuals in the curvature.
    """
    sigma = (width / math.sqrt(CURVATURE))[:, None]
    height = amplitude[:, None]
    q = (places - centre[:, None]) / sigma
    with np.errstate(under="ignore"):
        bell = np.exp(-0.5 * q * q)
    left = volts - height * bell
    slopes = np.stack([height * bell * q / sigma, height * bell * q * q, bell], axis=1)
    curvature = slopes @ slopes.transpose(0, 2, 1)
    second = {
        (0, 0): height * bell * (q * q - 1) / sigma**2,
        (0, 1): height * bell * q * (q * q - 2) / sigma,
        (1, 1): height * bell * q * q * (q * q - 2),
        (0, 2): bell * q / sigma,
        (1, 2): bell * q * q,
    }
    for (i, j), bends in second.items():
        part = np.einsum("nm,nm->n", left, bends)
        curvature[:, i, j] -= part
        if i != j:
            curvature[:, j, i] -= part
    moved = np.linalg.solve(curvature, slopes)
    return moved[:, 0], moved[:, 1]


def _fitted(
    volts: NDArray[np.float64], draws: LocalDraws, finder: RangeFinder
) -> tuple[tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]], NDArray[np.int64]]:
    """Least-squares Gaussians of the best peaks, and where their correlation windows begin."""
    lags = piece_peaks(finder, volts, (draws.middle - NEAR_SAMPLES, draws.middle + NEAR_SAMPLES), 1).lag
    centre, width, amplitude, first = (one[:, 0] for one in refined(finder, volts, lags, _STEPS))
    return (centre, width, amplitude), first.astype(np.int64)


def _errors_m(
    draws: LocalDraws, fit: tuple[NDArray[np.float64], ...], curve: DelayCurve
) -> NDArray[np.float64]:
    arrival_s = draws.first_s + draws.interval_s * fit[0] - draws.true_s
    return corrected_m(curve, arrival_s, draws.interval_s * fit[1])


def _slope(curve: DelayCurve, width_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Slope of the correction, 0 beyond its widths."""
    ends = [
        np.clip((1 + side * _WIDTH_STEP) * width_s, curve.narrowest_s, curve.widest_s) for side in (-1, 1)
    ]
    low, high = (curve.at(one) for one in ends)
    return np.asarray((high - low) / (2 * _WIDTH_STEP * width_s))
