"""From draws about echoes to the error of the energy of one cell: altitude, slope, reflectance, day or night.

*Error* is that of a detected pulse's energy, relative to the energy of its own light: rms after the bias was
taken off that the calibration leaves there without noise. What noise adds to the mean is in it, and told
apart. False detections are left out as in the range campaign.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.values import Estimate
from procedures.echo_energy import INTEGRALS
from procedures.energy_parts import slope_of
from procedures.energy_statistics import Moments, moments, quantiles, ratio
from procedures.range_chunks import correction
from procedures.range_scenes import noise_scene
from procedures.range_statistics import fast_pfd
from procedures.range_table import cell_draws
from sim.scene import as_toml

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from procedures.echo_energy import Conversion
    from procedures.noise_clusters import LevelLaws
    from procedures.range_points import Drawn
    from procedures.range_scenes import Condition
    from procedures.range_statistics import CellDraws

LEVELS = (0.05, 0.16, 0.50, 0.84, 0.95)
"""Quantiles that are told of a distribution."""
CONVERSIONS = ("own", "published")


@dataclass(frozen=True, slots=True, eq=False)
class EnergyError:
    """Of one integral with one conversion; all relative.

    Parameters
    ----------
    error : Moments
        Of detections, about `bias`: its rms is the error, its mean what noise and the choice of the detected
        add to the bias.
    bias : Estimate
        What the conversion leaves on the average without noise.
    shape : float
        Standard deviation about it of echoes without noise.
    levels : ndarray of float64, shape (5,)
        Quantiles `LEVELS` of the errors, with the bias in them.
    """

    error: Moments
    bias: Estimate
    shape: float
    levels: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class EnergyCell:
    """One cell.

    Parameters
    ----------
    altitude_m, slope_deg : float
        m; degrees, about which the footprints' slopes are.
    condition : Condition
        Reflectance and noise.
    pfd : Estimate
        Probability of false detection.
    errors : mapping of (str, str) to EnergyError
        By integral and conversion; empty where nothing is detected.
    window_by_gaussian : Estimate or None
        Error of E_CW over that of E_G, own conversions.
    """

    altitude_m: float
    slope_deg: float
    condition: Condition
    pfd: Estimate
    errors: Mapping[tuple[str, str], EnergyError]
    window_by_gaussian: Estimate | None

    def error(self, integral: str = "gaussian", by: str = "own") -> Estimate | None:
        """Return an error, relative rms; None where nothing is detected."""
        found = self.errors.get((integral, by))
        return None if found is None else found.error.rms

    def spread(self, integral: str = "gaussian", by: str = "own") -> Estimate | None:
        """Return a standard deviation about the mean error; None where nothing is detected."""
        found = self.errors.get((integral, by))
        return None if found is None else found.error.spread


@dataclass(frozen=True, slots=True, eq=False)
class EnergyDraws:
    """Draws of one cell, told as energies.

    Parameters
    ----------
    hits : CellDraws
        Of the range campaign, for their weights.
    ratio : mapping of (str, str) to ndarray of float64, shape (n, 2)
        Estimated over true energy by integral and conversion.
    plain : mapping of (str, str) to ndarray of float64, shape (echoes,)
        The same of the echoes without noise.
    """

    hits: CellDraws
    ratio: Mapping[tuple[str, str], NDArray[np.float64]]
    plain: Mapping[tuple[str, str], NDArray[np.float64]]


def energy_draws(drawn: Drawn, row: int, convert: Conversion) -> EnergyDraws:
    """Return the draws of one condition of a point as energies."""
    arrays, reflectance = drawn.arrays, drawn.conditions[row].reflectance
    hits = cell_draws(drawn, row, correction(drawn.scene), float(drawn.linear.still_m.mean()))
    of_echo = np.repeat(np.arange(hits.echoes), hits.weight.size // hits.echoes)
    true_j = reflectance * arrays["optical_j"]
    noisy = arrays["amplitude_v"][row], arrays["width_s"][row], arrays["area_v_s"][row]
    still = arrays["plain_amplitude_v"], arrays["plain_width_s"], arrays["plain_area_v_s"]
    ratios, plain = {}, {}
    for integral in INTEGRALS:
        for by, energy_j in zip(CONVERSIONS, (convert.energy_j, convert.published_j), strict=True):
            ratios[integral, by] = energy_j(integral, *noisy) / true_j[of_echo, None]
            plain[integral, by] = energy_j(integral, *still) / arrays["optical_j"]
    return EnergyDraws(hits, ratios, plain)


def energy_cells(drawn: Drawn, laws: Mapping[str, LevelLaws], convert: Conversion) -> tuple[EnergyCell, ...]:
    """Reduce the draws of a point, one cell for each condition.

    Parameters
    ----------
    drawn : Drawn
        A point of `procedures.energy_parts.slope_point`.
    laws : mapping of str to LevelLaws
        From `Collected.laws`.
    convert : Conversion
        From integrals to energy.
    """
    own, slope_deg = laws[as_toml(noise_scene(drawn.scene))], slope_of(drawn.label)
    found = []
    for row, condition in enumerate(drawn.conditions):
        draws, law = energy_draws(drawn, row, convert), own.at(condition.noise_rms_v)
        weights = draws.hits.weights(law)
        errors = {}
        for key in draws.ratio:
            one = _error(draws, key, weights)
            if one is not None:
                errors[key] = one
        pair = [errors.get((integral, "own")) for integral in INTEGRALS]
        found.append(
            EnergyCell(
                drawn.scene.altitude_m,
                slope_deg,
                condition,
                fast_pfd(draws.hits, law),
                errors,
                None if pair[0] is None or pair[1] is None else ratio(pair[1].error, pair[0].error),
            )
        )
    return tuple(found)


def _error(draws: EnergyDraws, key: tuple[str, str], weights: NDArray[np.float64]) -> EnergyError | None:
    plain = draws.plain[key] - 1
    bias, shape = float(plain.mean()), float(plain.std())
    errors = draws.ratio[key] - 1
    found = moments(errors - bias, weights, draws.hits.echoes)
    if found is None:
        return None
    return EnergyError(
        found, Estimate(bias, shape / math.sqrt(plain.size)), shape, quantiles(errors, weights, LEVELS)
    )
