"""What the azimuth of a slope does to its return pulse, where the beam is not round.

A beam that is an elliptical Gaussian has a Gaussian for its profile along any line, so that a slope of one
azimuth gives the pulse that another slope gives at another azimuth: what an azimuth changes is a width, and a
pulse tells slope times beam, not both. How much of an azimuth is to be seen is tried here with the library
itself, and with footprints whose azimuth is known.

What this does not model: a beam whose profiles along two lines differ in shape, of which a pulse could tell
more.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from procedures.pulse_library import STEPS, PulseLibrary, best_matches
from procedures.roughness_statistics import mean_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from procedures.roughness_statistics import Footprints

SLOPES_DEG = (5.0, 10.0, 20.0, 25.0)
FROM_DEG = 5.0
"""Slope of the ground from which on its azimuth counts: below, the beam hardly widens a pulse. Assumed."""
_PHASES = 8


@dataclass(frozen=True, slots=True)
class AzimuthOfSlope:
    """A slope that rises along the long axis of the beam, and across it.

    Parameters
    ----------
    slope_deg : float
        Of both.
    long_s, short_s : float
        Fitted full widths, s.
    same_slope_msr_v2 : float
        What the narrower pulse, scaled and moved, leaves of the wider one, mean over places between samples,
        V^2.
    wrong_azimuth_msr_v2 : float
        What the best pulse of the narrow azimuth leaves, of any slope, V^2.
    wrong_azimuth_deg : float
        Slope of that one.
    """

    slope_deg: float
    long_s: float
    short_s: float
    same_slope_msr_v2: float
    wrong_azimuth_msr_v2: float
    wrong_azimuth_deg: float


@dataclass(frozen=True, slots=True)
class Azimuths:
    """What a library and footprints tell of azimuths.

    Parameters
    ----------
    slopes : tuple of AzimuthOfSlope
        By slope.
    error_deg : tuple of (float, float)
        Mean distance of the best pulse's azimuth from the ground's, and its uncertainty, by case. Both are
        folded to 0 to 90 degrees from the long axis: a beam that is even about its axes tells no more.
    chance_deg : float
        The same, without noise, of best pulses given to other footprints.
    """

    slopes: tuple[AzimuthOfSlope, ...]
    error_deg: tuple[tuple[float, float], ...]
    chance_deg: float


def azimuths(seen: Footprints, library: PulseLibrary, size: int) -> Azimuths:
    """Try azimuths.

    Parameters
    ----------
    seen : Footprints
        Of the first reflectance; those from `FROM_DEG` on that were detected count.
    library : PulseLibrary
        With pulses of several azimuths.
    size : int
        Samples of a correlation window.
    """
    errors = []
    for case in range(seen.width_s.shape[1]):
        at = (seen.width_s[0, case] > 0) & (seen.slope_deg >= FROM_DEG)
        best = folded_deg(seen.library_azimuth_deg[0, case][at])
        errors.append(mean_of(np.abs(best - folded_deg(seen.azimuth_deg[at])), seen.ground[at]))
    at = (seen.width_s[0, 0] > 0) & (seen.slope_deg >= FROM_DEG)
    best, true = folded_deg(seen.library_azimuth_deg[0, 0][at]), folded_deg(seen.azimuth_deg[at])
    # Those half of all away lie on other terrains.
    chance_deg = float(np.abs(best - np.roll(true, true.size // 2)).mean())
    slopes = tuple(azimuth_of_slope(library, one, size) for one in SLOPES_DEG)
    return Azimuths(slopes, tuple(errors), chance_deg)


def folded_deg(azimuth_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return angles from the x axis, 0 to 90 degrees."""
    return np.asarray(np.abs((azimuth_deg + 90) % 180 - 90))


def azimuth_of_slope(library: PulseLibrary, slope_deg: float, size: int) -> AzimuthOfSlope:
    """Compare the widest with the narrowest pulse of a slope.

    Parameters
    ----------
    library : PulseLibrary
        With that slope.
    slope_deg : float
        Whole degrees of the library.
    size : int
        Samples that are compared, the peak in their middle.
    """
    own = np.flatnonzero(library.slope_deg == slope_deg)
    wide, narrow = own[np.argmax(library.fwhm_s[own])], own[np.argmin(library.fwhm_s[own])]
    middle = int(np.argmax(library.volts[wide]))
    first = middle - size // 2 * STEPS + np.arange(0, STEPS, STEPS // _PHASES)
    samples = library.volts[wide][first[:, None] + STEPS * np.arange(size)]
    arrival_s = -library.first_s[wide] - first * library.step_s
    # Level ground has no azimuth.
    others = np.flatnonzero((library.azimuth_deg == library.azimuth_deg[narrow]) | (library.slope_deg == 0.0))
    same = best_matches(_only(library, np.array([narrow])), samples, arrival_s)
    wrong = best_matches(_only(library, others), samples, arrival_s)
    return AzimuthOfSlope(
        slope_deg,
        float(library.fwhm_s[wide]),
        float(library.fwhm_s[narrow]),
        float(same.msr_v2.mean()),
        float(wrong.msr_v2.mean()),
        float(library.slope_deg[others[wrong.pulse]].mean()),
    )


def _only(library: PulseLibrary, at: NDArray[np.int64]) -> PulseLibrary:
    return replace(
        library,
        slope_deg=library.slope_deg[at],
        azimuth_deg=library.azimuth_deg[at],
        volts=library.volts[at],
        first_s=library.first_s[at],
        fwhm_s=library.fwhm_s[at],
    )
