"""How much light a scene returns, in closed form: photons, energy, electrons, and the voltage at the cut."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sim.detector import (
    multiplication,
    optical_transmission,
    solid_angle_sr,
    volts_per_photon_rate,
)
from sim.laser import photon_energy_j, photon_number

if TYPE_CHECKING:
    from sim.scene import Scene


@dataclass(frozen=True, slots=True)
class LinkBudget:
    """The echo of level ground that lies within the field of view.

    Parameters
    ----------
    transmitted_photons : float
        N_0.
    solid_angle_sr : float
        Of the telescope, seen from the ground.
    photons, energy_j : float
        On the photodiode.
    primary_electrons : float
        Before multiplication.
    multiplication : float
        M.
    area_at_cut_v_s, area_at_converter_v_s : float
        Integral of the voltage, before and after the receiver's gain; a low-pass leaves it as it is.
    """

    transmitted_photons: float
    solid_angle_sr: float
    photons: float
    energy_j: float
    primary_electrons: float
    multiplication: float
    area_at_cut_v_s: float
    area_at_converter_v_s: float


def link_budget(scene: Scene) -> LinkBudget:
    """Return the link budget, N = N_0 alpha / pi xi Omega eps_0 eps_t (paper, "BELA measurement model").

    Parameters
    ----------
    scene : Scene
        Relief and slope do not change it; Lambert's radiation factor is that of the mean slope. A reflectance
        map, and light that misses the field of view, are left to the echo.
    """
    sent = photon_number(scene.laser)
    solid_angle = solid_angle_sr(scene.detector.telescope_radius_m, scene.altitude_m)
    surface = scene.surface
    factor = {
        "lommel-seeliger": 1.0,
        "lambert": math.cos(math.radians(surface.slope_deg)),
        "factor": surface.radiation_factor,
    }[surface.photometry]
    photons = (
        sent * surface.reflectance / math.pi * factor * solid_angle * optical_transmission(scene.detector)
    )
    at_cut = photons * volts_per_photon_rate(scene.detector)
    return LinkBudget(
        transmitted_photons=sent,
        solid_angle_sr=solid_angle,
        photons=photons,
        energy_j=photons * photon_energy_j(scene.laser.wavelength_m),
        primary_electrons=photons * scene.detector.quantum_efficiency,
        multiplication=multiplication(scene.detector),
        area_at_cut_v_s=at_cut,
        area_at_converter_v_s=at_cut * scene.gain,
    )
