"""Closed forms behind `sim.pulse_shape`: exponentially modified Gaussian, transform of a straight line."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


def modified_gaussian(times_s: NDArray[np.float64], sigma_s: float, tau_s: float) -> NDArray[np.float64]:
    """Return the density of a Gaussian about 0 convolved with a one-sided exponential, 1/s.

    Parameters
    ----------
    times_s : ndarray of float64
        s.
    sigma_s, tau_s : float
        Standard deviation, above zero; time constant, 0 for the Gaussian itself.

    Notes
    -----
    With z = (sigma / tau - t / sigma) / sqrt(2), the scaled complementary error function serves for z >= 0
    and the plain one below; neither form can overflow on its side. The usual single form fails for short
    tails (Kalambet et al., J. Chemometrics 25, 2011).
    """
    if tau_s < 1e-12 * sigma_s:
        # So short a tail moves the Gaussian and does no more: the next term is (tau / sigma)^2.
        with np.errstate(under="ignore"):
            gaussian = np.exp(-0.5 * ((times_s - tau_s) / sigma_s) ** 2)
        return np.asarray(gaussian / (math.sqrt(2 * math.pi) * sigma_s))
    from scipy.special import erfc, erfcx

    ratio, place = sigma_s / tau_s, times_s / sigma_s
    z = (ratio - place) / math.sqrt(2)
    early = z >= 0
    with np.errstate(under="ignore"):
        rise = np.exp(-0.5 * place**2) * erfcx(np.where(early, z, 0.0))
        decay = np.exp(np.where(early, 0.0, ratio * (ratio / 2 - place))) * erfc(np.where(early, 0.0, z))
    return np.asarray(np.where(early, rise, decay) / (2 * tau_s))


def line_transform(
    times: NDArray[np.float64], values: NDArray[np.float64], s: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Return the integral of a table times e^(-s t), with the shape of `s`.

    Parameters
    ----------
    times, values : ndarray of float64, shape (n,)
        Break points with straight lines between them.
    s : ndarray of complex128
        1 / unit of the times; any, also 0.
    """
    total = np.zeros(s.shape, dtype=np.complex128)
    for start, width, left, right in zip(times, np.diff(times), values, values[1:], strict=False):
        level, ramp = _line_moments(-s * width)
        total += np.exp(-s * start) * width * (left * level + (right - left) * ramp)
    return total


def _line_moments(z: NDArray[np.complex128]) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return the integrals over u from 0 to 1 of e^(z u) and u e^(z u), without cancellation at small z."""
    small = np.abs(z) < 1
    near, far = np.where(small, z, 0.0), np.where(small, 1.0, z)
    level, ramp = np.zeros(z.shape, dtype=np.complex128), np.zeros(z.shape, dtype=np.complex128)
    for k in range(19, -1, -1):
        level = level * near + 1 / math.factorial(k + 1)
        ramp = ramp * near + 1 / (math.factorial(k) * (k + 2))
    grown = np.exp(far)
    return (
        np.where(small, level, (grown - 1) / far),
        np.where(small, ramp, (grown * (far - 1) + 1) / far**2),
    )
