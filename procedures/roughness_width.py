"""Roughness from the width of a return pulse, beside that of the ground: the terms, and how they fail.

``sigma_obs = W_G / (2 sqrt(2 ln 2))`` of the fitted Gaussian. What a flat slope of the same tilt makes of it
is taken off in squares; the rest is read as roughness, ``sigma_rough = 2/c Std(dz)`` (Gardner 1992; Nishiyama
et al., section "Difficulty of pulse-width usage as a roughness indicator").
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from procedures.roughness_statistics import mean_of
from sim.constants import SPEED_OF_LIGHT_M_PER_S
from sim.laser import beam_sigma_m, pulse_shape

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from procedures.pulse_library import PulseLibrary
    from procedures.roughness_statistics import Footprints
    from sim.scene import Scene

FWHM_OF_SIGMA = 2 * math.sqrt(2 * math.log(2))
BINS = 12


@dataclass(frozen=True, slots=True, eq=False)
class WidthRoughness:
    """Squares of sigma, s^2, arrays of shape (n,) by footprint; of shape (b,) by bins of the ground's.

    Parameters
    ----------
    observed_s2, ground_s2 : ndarray of float64
        From the width, after the flat slope was taken off; 2/c Std of the heights, squared.
    cluster : ndarray of int64
        Terrain of each.
    middle_s2, mean_s2, mean_u_s2, spread_s2, negative : ndarray of float64
        Of bins with equally many: mean of the ground's; mean of the observed, its uncertainty, standard
        deviation, and share below zero.
    """

    observed_s2: NDArray[np.float64]
    ground_s2: NDArray[np.float64]
    cluster: NDArray[np.int64]
    middle_s2: NDArray[np.float64]
    mean_s2: NDArray[np.float64]
    mean_u_s2: NDArray[np.float64]
    spread_s2: NDArray[np.float64]
    negative: NDArray[np.float64]

    @property
    def correlation(self) -> float:
        """Of both squares."""
        return float(np.corrcoef(self.observed_s2, self.ground_s2)[0, 1])

    @property
    def share_negative(self) -> tuple[float, float]:
        """Share of negative squares, and its uncertainty."""
        return mean_of((self.observed_s2 < 0).astype(np.float64), self.cluster)


def flat_width_s(library: PulseLibrary, slope_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the fitted width of flat slopes, means over azimuths, cubic between the library's slopes, s.

    Beyond the library's steepest its end is taken.
    """
    from scipy.interpolate import CubicSpline

    slopes = np.unique(library.slope_deg)
    means = np.array([library.fwhm_s[library.slope_deg == one].mean() for one in slopes])
    return np.asarray(CubicSpline(slopes, means)(np.clip(slope_deg, slopes[0], slopes[-1])))


def width_roughness(seen: Footprints, library: PulseLibrary, case: int) -> WidthRoughness:
    """Compare roughness from the width with that of the ground.

    Footprints that are steeper than the library or were not detected are left out.
    """
    serves = (seen.width_s[0, case] > 0) & (seen.slope_deg <= library.slope_deg.max())
    flat_s = flat_width_s(library, seen.slope_deg[serves])
    observed_s2 = (seen.width_s[0, case][serves] ** 2 - flat_s**2) / FWHM_OF_SIGMA**2
    ground_s2 = (2 / SPEED_OF_LIGHT_M_PER_S * seen.roughness_m[serves]) ** 2
    cluster = seen.ground[serves]
    groups = np.array_split(np.argsort(ground_s2, kind="stable"), BINS)
    means = [mean_of(observed_s2[at], cluster[at]) for at in groups]
    return WidthRoughness(
        observed_s2,
        ground_s2,
        cluster,
        np.array([ground_s2[at].mean() for at in groups]),
        np.array([mean for mean, _ in means]),
        np.array([u for _, u in means]),
        np.array([observed_s2[at].std() for at in groups]),
        np.array([(observed_s2[at] < 0).mean() for at in groups]),
    )


def terms_s(scene: Scene, library: PulseLibrary, slope_deg: float) -> dict[str, float]:
    """Return the terms of the width over a flat slope as standard deviations, s.

    Returns
    -------
    dict
        ``transmitted``, ``beam`` (curvature of the wavefront), ``slope``; ``filter``: what makes up the rest
        of ``observed``, the fitted width.
    """
    sigma_m = math.sqrt(math.prod(beam_sigma_m(scene.laser, scene.altitude_m)))
    terms = {
        "transmitted": pulse_shape(scene.laser).std_s,
        "beam": 2 * sigma_m**2 / (SPEED_OF_LIGHT_M_PER_S * scene.altitude_m),
        "slope": 2 * sigma_m * math.tan(math.radians(slope_deg)) / SPEED_OF_LIGHT_M_PER_S,
    }
    observed_s = float(flat_width_s(library, np.array([slope_deg]))[0]) / FWHM_OF_SIGMA
    rest = observed_s**2 - sum(one**2 for one in terms.values())
    return terms | {"filter": math.copysign(math.sqrt(abs(rest)), rest), "observed": observed_s}
