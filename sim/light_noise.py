"""Noise of the light, left of the cut: shot noise of the echo, sunlight, and the photodiode's dark current.

All three are shot noise. A primary current I_p, multiplied by M with excess noise M^x, has the one-sided
density 2 q I_p M^(2+x) in A^2/Hz, before any filter. A density is given here as its square root, in
V/sqrt(Hz) at the cut, so that no intermediate number leaves the range of single precision.

The paper prints dV^2 = 2 q^2 eps_qe I M^(2+x) B R_f^2 with a current I. It has the unit of a voltage only if
I is a photon rate; that is what is built here. It adds such noise at a fine step before the filter, which
counts the band twice; here the density is right within the band, whatever the step. It leaves out the gain
that follows, and 1/pi in the sunlight.

What this does not model: noise of the gain in time (1/f), speckle, sunlight that enters past the baffle, and
the discreteness of photons: shot noise is Gaussian here, see `shot_noise_density`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.errors import RefusedInput
from sim.constants import ELEMENTARY_CHARGE_C
from sim.detector import (
    excess_noise_factor,
    field_of_view_m2,
    multiplication,
    optical_transmission,
    solid_angle_sr,
)
from sim.laser import photon_energy_j

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from sim.scene import Scene
    from sim.scene_tables import Detector, Sun


def shot_noise_density(detector: Detector, photon_rate_hz: ArrayLike) -> NDArray[Any]:
    """Return the shot noise of light on the photodiode, V/sqrt(Hz) at the cut.

    Parameters
    ----------
    detector : Detector
        Quantum efficiency, gain, excess noise and transimpedance.
    photon_rate_hz : array_like of float, shape (n,)
        Photons per second before any filter, not negative. Single precision is kept.

    Returns
    -------
    ndarray, shape (n,)
        One-sided: q R_f sqrt(2 eps_qe n M^(2+x)). Variance and spectrum are exact for any rate (Campbell's
        theorem); the distribution is Gaussian only when many photoelectrons fall within the filter's
        response, which sees some 20 to 30 of an echo at 1400 km.

    Raises
    ------
    RefusedInput
        A rate below zero, as behind a filter: shot noise is that of the light, before it.
    """
    rate = np.asarray(photon_rate_hz)
    if rate.size and not rate.min() >= 0:
        raise RefusedInput(
            f"shot noise of a photon rate of {float(rate.min())!r} 1/s: must not be negative; "
            "take the rate before any filter"
        )
    scale = multiplication(detector) * math.sqrt(
        2 * detector.quantum_efficiency * excess_noise_factor(detector)
    )
    return np.asarray(scale * ELEMENTARY_CHARGE_C * detector.feedback_ohm * np.sqrt(rate))


def dark_current_density(detector: Detector) -> float:
    """Return the shot noise of the photodiode's dark currents, V/sqrt(Hz) at the cut.

    The surface current is not multiplied, the bulk current is: 2 q (I_s + I_b M^(2+x)).
    """
    grown = multiplication(detector) ** 2 * excess_noise_factor(detector)
    current_a = detector.surface_dark_a + detector.bulk_dark_a * grown
    return detector.feedback_ohm * math.sqrt(2 * ELEMENTARY_CHARGE_C * current_a)


def solar_power_w(detector: Detector, altitude_m: float, sun: Sun, reflectance: float) -> float:
    """Return the sunlight on the photodiode, W.

    Parameters
    ----------
    detector : Detector
        Aperture, field of view and optical filter.
    altitude_m : float
        The result hardly depends on it: the area that is seen grows as the solid angle shrinks.
    sun : Sun
        Incidence, distance, and irradiance at the laser's wavelength.
    reflectance : float
        alpha_N of level ground, which returns alpha_N / pi per steradian.
    """
    at_planet = sun.irradiance_1au_w_per_m3 / sun.distance_au**2
    lit_w_per_m2 = at_planet * detector.filter_width_m * math.cos(math.radians(sun.incidence_deg))
    seen_m2_sr = field_of_view_m2(detector, altitude_m) * solid_angle_sr(
        detector.telescope_radius_m, altitude_m
    )
    return lit_w_per_m2 * reflectance / math.pi * seen_m2_sr * optical_transmission(detector)


def background_density(scene: Scene) -> float:
    """Return the stationary noise of the light, V/sqrt(Hz) at the cut: sunlight and dark current.

    Zero at night with a detector without dark current; then there is nothing to draw.
    """
    dark = dark_current_density(scene.detector)
    if scene.sun is None:
        return dark
    power_w = solar_power_w(scene.detector, scene.altitude_m, scene.sun, scene.surface.reflectance)
    rate_hz = power_w / photon_energy_j(scene.laser.wavelength_m)
    return math.hypot(dark, float(shot_noise_density(scene.detector, rate_hz)))


def noise_rms_v(density: float, bandwidth_hz: float) -> float:
    """Return the rms, V, that white noise of a density in V/sqrt(Hz) has behind a filter.

    Parameters
    ----------
    density : float
        One-sided, V/sqrt(Hz); times the gain, where the rms at the converter is wanted.
    bandwidth_hz : float
        Noise bandwidth of the filter, `belahil.butterworth.noise_bandwidth`. Sampling keeps the whole of it:
        what lies above half of the sample rate is folded back.
    """
    return density * math.sqrt(bandwidth_hz)


def white_step_rms_v(density: NDArray[Any], step_s: float) -> NDArray[Any]:
    """Return the rms of independent draws, one a step, that stand for white noise before the filter, V.

    Parameters
    ----------
    density : ndarray, shape (n,)
        One-sided, V/sqrt(Hz), at each step.
    step_s : float
        s; the density is then right up to 1 / (2 step), so the filter must have ended there.

    Returns
    -------
    ndarray, shape (n,)
        density / sqrt(2 step). A longer step has smaller draws; behind the filter nothing changes.
    """
    return np.asarray(density / math.sqrt(2 * step_s))
