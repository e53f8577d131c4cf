"""Arrival of a pulse in a correlation window: against least squares, and in noise against the bound."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from typing import TYPE_CHECKING

import numpy as np

from belahil.pulse_bound import white_bound
from belahil.pulse_fit import CURVATURE, GaussianPulse, gaussian_fit
from procedures.accuracy_footprint import INTERVAL_S, SAMPLES, kernel
from procedures.accuracy_rows import Measured, Setting

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Arrival = Callable[[NDArray[np.float64]], float]

UNIT = "mm of range"
MM_PER_S = 1e3 * 299792458.0 / 2
ABOVE_BOUND = 1.1
"""How far above the Cramer-Rao bound a fit may lie."""

FWHM_S = 45e-9
SNRS = (10.0, 30.0, 100.0)
_TRIALS = 1000
_CENTRE_S = SAMPLES / 2 * INTERVAL_S

WIDTHS_S = (30e-9, 45e-9, 65e-9, 100e-9)
PHASES = tuple((k + 1 / math.e) / 5 for k in range(5))
"""Parts of a sample: echoes are placed so."""

NOISE_FREE = "echo without noise"
_CONVERGED = "least squares to the last digit (SciPy); worst of filtered echoes, FWHM 30 to 100 ns"


def detection_settings() -> Iterator[Setting]:
    """List what is measured."""
    quiet = partial(Setting, "detection", NOISE_FREE)
    yield quiet("Gaussian fit", "converged", _CONVERGED, UNIT, partial(_noise_free, fitted), 1e-3)
    yield quiet("least squares of SciPy", "default", _CONVERGED, UNIT, partial(_noise_free, by_scipy), 1e-3)
    yield quiet("largest sample", "no fit", _CONVERGED, UNIT, partial(_noise_free, largest))
    for snr in SNRS:
        noisy = partial(Setting, "detection", white_case(snr))
        reference, asked = white_reference(_TRIALS), ABOVE_BOUND * bound_mm(snr)
        yield noisy("Gaussian fit", "converged", reference, UNIT, partial(_noisy, fitted, snr), asked)
        yield noisy("largest sample", "no fit", reference, UNIT, partial(_noisy, largest, snr), asked)


def white_case(snr: float) -> str:
    """Name the case of Gaussians in white noise."""
    return f"white noise, SNR {snr:g}"


def white_reference(trials: int) -> str:
    """Say what its errors are measured against."""
    return (
        f"the true arrival, rms of {trials} Gaussians, FWHM {1e9 * FWHM_S:g} ns; "
        f"predicted is the Cramer-Rao bound, asked for {ABOVE_BOUND} times it"
    )


def fitted(volts: NDArray[np.float64]) -> float:
    """Arrival by `belahil.pulse_fit`, s."""
    pulse = gaussian_fit(volts, INTERVAL_S).pulse
    if pulse is None:
        raise RuntimeError("the fit found no pulse")
    return pulse.arrival_s


def by_scipy(volts: NDArray[np.float64], tolerance: float = 1e-8) -> float:
    """Arrival by a general least-squares program, s."""
    from scipy.optimize import least_squares

    places = np.arange(volts.size, dtype=np.float64)
    begin = (float(volts.argmax()), 4.0, float(volts.max()))

    def residual(at: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(at[2] * np.exp(-0.5 * CURVATURE * ((places - at[0]) / at[1]) ** 2) - volts)

    found = least_squares(residual, begin, method="lm", xtol=tolerance, ftol=tolerance, gtol=tolerance)
    return float(found.x[0]) * INTERVAL_S


def largest(volts: NDArray[np.float64]) -> float:
    """Time of the largest sample, s."""
    return float(volts.argmax()) * INTERVAL_S


@lru_cache(maxsize=1)
def _echoes() -> tuple[NDArray[np.float64], ...]:
    """Samples of echoes of slopes behind the receiver, of unit peak."""
    one = kernel(1e-4)
    times_s = INTERVAL_S * np.arange(SAMPLES, dtype=np.float64)
    found = []
    for fwhm_s in WIDTHS_S:
        echo = one.widened(fwhm_s / math.sqrt(CURVATURE))
        for phase in PHASES:
            volts = echo.exact(times_s - _CENTRE_S + phase * INTERVAL_S)
            found.append(volts / volts.max())
    return tuple(found)


def _noise_free(arrival: Arrival) -> Measured:
    """Return the worst difference from converged least squares."""
    echoes = _echoes()
    errors = [abs(arrival(volts) - by_scipy(volts, 1e-15)) for volts in echoes]
    return Measured(max(errors) * MM_PER_S, lambda: arrival(echoes[0]))


def bound_mm(snr: float) -> float:
    """Return the Cramer-Rao bound of the arrival in white noise."""
    return white_bound(GaussianPulse(_CENTRE_S, FWHM_S, 1.0), INTERVAL_S, 1 / snr).arrival_s * MM_PER_S


def _noisy(arrival: Arrival, snr: float) -> Measured:
    """Return the rms error over noisy Gaussians at random phases."""
    rng = np.random.default_rng(1)
    times_s = INTERVAL_S * np.arange(SAMPLES, dtype=np.float64)
    errors = np.empty(_TRIALS)
    for trial in range(_TRIALS):
        pulse = GaussianPulse(_CENTRE_S + INTERVAL_S * float(rng.uniform()), FWHM_S, 1.0)
        volts = pulse.at(times_s) + rng.standard_normal(SAMPLES) / snr
        errors[trial] = arrival(volts) - pulse.arrival_s
    rms_mm = MM_PER_S * math.sqrt(float(np.mean(errors**2)))
    return Measured(rms_mm, lambda: arrival(volts), predicted=bound_mm(snr))
