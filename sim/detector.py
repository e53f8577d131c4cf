"""From light on the ground to volts at the cut: telescope, avalanche photodiode, transimpedance amplifier.

What this does not model: saturation and dead time of the photodiode, a gain that falls under strong light, a
responsivity that depends on frequency beyond `tia_pole_hz`, vignetting within the field of view, and stray
light.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput
from sim.constants import ELEMENTARY_CHARGE_C
from sim.scene_tables import Detector

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = [
    "Detector",
    "amperes_per_photon_rate",
    "excess_noise_factor",
    "field_of_view_m2",
    "gaussian_filter_sigma_s",
    "in_field_of_view",
    "miller_gain",
    "multiplication",
    "optical_transmission",
    "solid_angle_sr",
    "tia_poles",
    "volts_per_photon_rate",
]


def solid_angle_sr(radius_m: float, altitude_m: float) -> float:
    """Return the solid angle of a telescope's aperture as the ground sees it, sr.

    Parameters
    ----------
    radius_m, altitude_m : float
        Above zero. Single precision in gives single precision out.

    Raises
    ------
    RefusedInput
        A radius or altitude that is not positive and finite.

    Notes
    -----
    2 pi r^2 / (R (R + H)) with R^2 = r^2 + H^2. It equals 4 pi sin^2(atan(r / H) / 2) and loses no digit,
    where 2 pi (1 - cos) loses all of them.
    """
    if not (0 < radius_m < math.inf and 0 < altitude_m < math.inf):
        raise RefusedInput(
            f"solid angle of radius {radius_m!r} m at {altitude_m!r} m: both must be positive and finite"
        )
    distance_m: float = (radius_m * radius_m + altitude_m * altitude_m) ** 0.5
    return 2 * math.pi * radius_m * radius_m / (distance_m * (distance_m + altitude_m))


def optical_transmission(detector: Detector) -> float:
    """Return what telescope and optical filter let through."""
    return detector.optical_efficiency * detector.filter_transmission


def field_of_view_m2(detector: Detector, altitude_m: float) -> float:
    """Return the area on level ground that the detector sees, m^2."""
    return math.pi * (altitude_m * math.tan(detector.field_of_view_rad)) ** 2


def in_field_of_view(
    detector: Detector,
    altitude_m: float,
    x_m: NDArray[np.float64],
    y_m: NDArray[np.float64],
    pixel_m: float = 0.0,
) -> NDArray[np.float64]:
    """Tell how much of each pixel on the ground the detector sees.

    Parameters
    ----------
    detector : Detector
        Its field of view and boresight.
    altitude_m : float
        Above zero.
    x_m, y_m : ndarray of float64
        Centres of the pixels, of shapes that broadcast.
    pixel_m : float
        Their size, m. 0: a place is seen or not.

    Returns
    -------
    ndarray of float64
        0 to 1, of the broadcast shape: linear across the edge, over the size of a pixel.
    """
    along = x_m - altitude_m * math.tan(detector.boresight_rad[0])
    across = y_m - altitude_m * math.tan(detector.boresight_rad[1])
    inside_m = altitude_m * math.tan(detector.field_of_view_rad) - np.hypot(along, across)
    if not pixel_m:
        return np.asarray(inside_m >= 0, dtype=np.float64)
    return np.clip(0.5 + inside_m / pixel_m, 0.0, 1.0)


def miller_gain(bias_v: float, breakdown_v: float, exponent: float) -> float:
    """Return the gain of an avalanche photodiode, M = 1 / (1 - (V / V_br)^n) (Miller, Phys. Rev. 99, 1955).

    Parameters
    ----------
    bias_v, breakdown_v : float
        V; 0 <= V < V_br.
    exponent : float
        n, above zero.

    Raises
    ------
    RefusedInput
        A voltage or exponent outside its range: at breakdown the gain has no limit, above it the formula is
        negative.

    Examples
    --------
    >>> round(miller_gain(320.0, 391.4255820210866, 0.103624), 9)
    48.4
    """
    if not (0 <= bias_v < breakdown_v < math.inf and 0 < exponent < math.inf):
        raise RefusedInput(
            f"bias {bias_v!r} V with breakdown at {breakdown_v!r} V and exponent {exponent!r}: "
            "allowed are 0 <= bias < breakdown and a positive exponent"
        )
    if bias_v < 0.1 * breakdown_v:
        power: float = (bias_v / breakdown_v) ** exponent
        return 1.0 / (1.0 - power)
    # Near breakdown 1 - (V / V_br)^n is a small difference; the difference of the voltages is exact.
    return -1.0 / math.expm1(exponent * math.log1p((bias_v - breakdown_v) / breakdown_v))


def multiplication(detector: Detector) -> float:
    """Return M: as given, or Miller's at the photodiode's bias and temperature.

    Raises
    ------
    RefusedInput
        A bias at or above breakdown.
    """
    if detector.multiplication is not None:
        return detector.multiplication
    return miller_gain(detector.bias_v, detector.breakdown_now_v, detector.miller_exponent)


def excess_noise_factor(detector: Detector) -> float:
    """Return F = M^x: how much the spread of single avalanches adds to the shot noise."""
    factor: float = multiplication(detector) ** detector.excess_noise_exponent
    return factor


def amperes_per_photon_rate(detector: Detector) -> float:
    """Return q eps_qe M: photocurrent per photon rate on the photodiode, A s."""
    return ELEMENTARY_CHARGE_C * detector.quantum_efficiency * multiplication(detector)


def volts_per_photon_rate(detector: Detector) -> float:
    """Return q eps_qe M R_f: voltage at the cut per photon rate on the photodiode, V s."""
    return amperes_per_photon_rate(detector) * detector.feedback_ohm


def tia_poles(detector: Detector) -> tuple[complex, ...]:
    """Return the poles that a signal has passed at the cut, rad/s: none, or one."""
    if not detector.tia_pole_hz:
        return ()
    return (complex(-2 * math.pi * detector.tia_pole_hz),)


def gaussian_filter_sigma_s(bandwidth_hz: float) -> float:
    """Return the width that earlier models give the receiver, 1 / (2 sqrt(2 pi) B_0), s (paper).

    Examples
    --------
    >>> round(gaussian_filter_sigma_s(20e6) * 1e9, 2)
    9.97
    """
    return 1 / (2 * math.sqrt(2 * math.pi) * bandwidth_hz)
