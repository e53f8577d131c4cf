"""The Butterworth low-pass with an optional first-order high-pass: one formula for the fit and for the model.

With x = f / f_c and y = f_h / f::

    |H(f)|^2 = 1 / (1 + x^(2 n)) * 1 / (1 + y^2)

The first factor is Butterworth's (1930) maximally flat filter of order n with its -3 dB frequency f_c, the
second an AC coupling with its -3 dB frequency f_h (0: none). Magnitude and noise bandwidth take a real order,
so that a fit can measure it; phase, delay and poles exist for whole orders only.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


def poles(cutoff_hz: float, order: int, highpass_hz: float = 0.0) -> tuple[complex, ...]:
    """Return the poles in the s-plane, rad/s.

    Parameters
    ----------
    cutoff_hz : float
        -3 dB frequency of the low-pass, Hz; above zero.
    order : int
        Whole, at least 1.
    highpass_hz : float
        Corner of the high-pass, Hz; 0 for none.

    Returns
    -------
    tuple of complex
        Conjugate pairs side by side, exactly conjugate. With a high-pass its pole comes last; the filter then
        has one zero at s = 0, which `belahil.pole_response` takes as ``zeros=1``.

    Raises
    ------
    RefusedInput
        A cut-off, order or corner outside its range.
    """
    _check(cutoff_hz, order, highpass_hz, whole=True)
    radius = 2 * math.pi * cutoff_hz
    found: list[complex] = []
    for k in range(order // 2):
        angle = math.pi * (2 * k + 1) / (2 * order)
        upper = radius * complex(-math.sin(angle), math.cos(angle))
        found += [upper, upper.conjugate()]
    if order % 2:
        found.append(complex(-radius, 0.0))
    if highpass_hz:
        found.append(complex(-2 * math.pi * highpass_hz, 0.0))
    return tuple(found)


def magnitude(
    frequency_hz: ArrayLike, cutoff_hz: float, order: float, highpass_hz: float = 0.0
) -> NDArray[np.float64]:
    """Return the gain relative to the pass band.

    Parameters
    ----------
    frequency_hz : array_like of float, shape (n,)
        Hz, not negative; 0 and infinity are allowed.
    cutoff_hz, order, highpass_hz : float
        As in `poles`, but the order may be any real number above zero.

    Returns
    -------
    ndarray of float64, shape (n,)
        0 to 1.

    Raises
    ------
    RefusedInput
        A cut-off, order or corner outside its range.

    Examples
    --------
    >>> magnitude([0.0, 19e6], 19e6, 3).round(6).tolist()
    [1.0, 0.707107]
    """
    _check(cutoff_hz, order, highpass_hz)
    frequency = np.asarray(frequency_hz, dtype=np.float64)
    with np.errstate(divide="ignore"):
        # logaddexp neither overflows far above the cut-off nor loses the last digits far below it.
        lowpass = np.exp(-0.5 * np.logaddexp(0.0, 2 * order * np.log(frequency / cutoff_hz)))
    if not highpass_hz:
        return np.asarray(lowpass)
    with np.errstate(divide="ignore"):
        return np.asarray(lowpass / np.hypot(1.0, highpass_hz / frequency))


def phase(
    frequency_hz: ArrayLike, cutoff_hz: float, order: int, highpass_hz: float = 0.0
) -> NDArray[np.float64]:
    """Return the phase, rad: continuous in frequency, 0 at 0 Hz (with a high-pass: pi/2).

    Parameters and errors are those of `poles`; the result has the shape of `frequency_hz`.

    Examples
    --------
    >>> (phase([0.0, 19e6], 19e6, 3) / 3.141592653589793).round(6).tolist()
    [0.0, -0.75]
    """
    omega = 2 * np.pi * np.asarray(frequency_hz, dtype=np.float64)
    total = np.full(omega.shape, np.pi / 2 if highpass_hz else 0.0)
    for pole in poles(cutoff_hz, order, highpass_hz):
        total -= np.arctan2(omega - pole.imag, -pole.real)
    return total


def group_delay(
    frequency_hz: ArrayLike, cutoff_hz: float, order: int, highpass_hz: float = 0.0
) -> NDArray[np.float64]:
    """Return minus the derivative of the phase with respect to angular frequency, s.

    Parameters and errors are those of `poles`; the result has the shape of `frequency_hz`.

    Examples
    --------
    >>> float((group_delay(0.0, 19e6, 3) * 1e9).round(3))
    16.753
    """
    omega = 2 * np.pi * np.asarray(frequency_hz, dtype=np.float64)
    total = np.zeros(omega.shape)
    for pole in poles(cutoff_hz, order, highpass_hz):
        total += -pole.real / (pole.real**2 + (omega - pole.imag) ** 2)
    return total


def noise_bandwidth(cutoff_hz: float, order: float, highpass_hz: float = 0.0) -> float:
    """Return the one-sided noise bandwidth: the integral of ``|H|^2`` over positive frequencies, Hz.

    Parameters
    ----------
    cutoff_hz, highpass_hz : float
        As in `poles`.
    order : float
        Real, above 1/2: with less the integral does not exist.

    Notes
    -----
    Closed form for the low-pass; the part that a high-pass takes away by the trapezoid rule in log frequency,
    which converges geometrically for this integrand. The error is below 1e-12 of the bandwidth without
    high-pass.

    Examples
    --------
    >>> round(noise_bandwidth(19e6, 3) / 1e6, 4)
    19.8968
    """
    _check(cutoff_hz, order, highpass_hz)
    if order <= 0.5:
        raise RefusedInput(f"order {order!r}: a noise bandwidth needs more than 1/2")
    angle = math.pi / (2 * order)
    whole = cutoff_hz * angle / math.sin(angle)
    if not highpass_hz:
        return whole
    corner = highpass_hz / cutoff_hz
    step = 0.02
    low, high = min(0.0, math.log(corner)) - 40.0, max(0.0, math.log(corner)) + 40.0
    t = np.arange(low, high, step)
    # x = e^t; the integrand is corner^2 / (x^2 + corner^2) / (1 + x^(2n)) dx.
    taken = np.exp(t - np.logaddexp(0.0, 2 * (t - math.log(corner))) - np.logaddexp(0.0, 2 * order * t))
    return whole - cutoff_hz * step * float(np.sum(taken))


def _check(cutoff_hz: float, order: float, highpass_hz: float, whole: bool = False) -> None:
    if not 0 < cutoff_hz < math.inf:
        raise RefusedInput(f"cut-off {cutoff_hz!r} Hz: must be positive and finite")
    if not 0 < order < math.inf or (whole and order != int(order)):
        raise RefusedInput(f"order {order!r}: must be a {'whole' if whole else 'finite'} number above zero")
    if not 0 <= highpass_hz < math.inf:
        raise RefusedInput(f"high-pass corner {highpass_hz!r} Hz: must be zero or positive, and finite")
