"""The optical energy of an echo from what the range finder tells of it: by its Gaussian, and by its samples.

With the amplitude A, the width W and the trapezoids E_CW over the correlation window, x is 1.06447 W or
E_CW / A, and the energy A (a x + b) times the curve about that line: `procedures.energy_fit`, of echoes
without noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.delay_curve import NARROWEST_S, WIDEST_S
from belahil.errors import RefusedInput
from procedures.energy_fit import EnergyFit
from procedures.energy_model import EnergyPoints, at_reference
from procedures.energy_results import PUBLISHED
from procedures.local_draws import NEAR_SAMPLES
from procedures.played_pulses import GAUSSIAN_AREA
from procedures.window_peaks import piece_peaks, refined, window_areas

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from procedures.local_draws import LocalDraws
    from sim.rfm import RangeFinder
    from sim.scene import Scene

INTEGRALS = ("gaussian", "window")
"""E_G and E_CW."""

_FEWEST = 24
"""Pulses: three groups of eight."""


@dataclass(frozen=True, slots=True, eq=False)
class PlainPulses:
    """What the range finder tells of e echoes of white ground without noise, arrays of shape (e,).

    Parameters
    ----------
    plain_amplitude_v, plain_width_s, plain_area_v_s : ndarray of float64
        Height and full width of the Gaussian, V and s; trapezoids over the correlation window, V s.
    optical_j : ndarray of float64
        Energy of the light at the photodiode, J.
    """

    plain_amplitude_v: NDArray[np.float64]
    plain_width_s: NDArray[np.float64]
    plain_area_v_s: NDArray[np.float64]
    optical_j: NDArray[np.float64]


def plain_pulses(draws: LocalDraws, finder: RangeFinder) -> PlainPulses:
    """Fit and integrate echoes without noise as the receiver does those with noise."""
    near = (draws.middle - NEAR_SAMPLES, draws.middle + NEAR_SAMPLES)
    lags = piece_peaks(finder, draws.echo_v, near, 1).lag
    _, width, amplitude_v, first = refined(finder, draws.echo_v, lags)
    areas = window_areas(finder, draws.echo_v, first.astype(np.int64))
    interval_s = draws.interval_s
    return PlainPulses(amplitude_v[:, 0], interval_s * width[:, 0], interval_s * areas[:, 0], draws.optical_j)


@dataclass(frozen=True, slots=True, eq=False)
class Conversion:
    """From the integral of a pulse to its optical energy, for one scene's gains.

    Parameters
    ----------
    fits : mapping of str to EnergyFit
        Of each of `INTEGRALS`, at the reference gains.
    factor : float
        The scene's gains over the reference ones.
    """

    fits: Mapping[str, EnergyFit]
    factor: float

    def energy_j(
        self,
        integral: str,
        amplitude_v: NDArray[np.float64],
        width_s: NDArray[np.float64],
        area_v_s: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Return optical energies, J, with the shape of the arrays; 0 where the amplitude is 0.

        Parameters
        ----------
        integral : str
            One of `INTEGRALS`.
        amplitude_v, width_s, area_v_s : ndarray of float64
            As in `PlainPulses`.
        """
        x = _normalized(integral, amplitude_v, width_s, area_v_s)
        return amplitude_v * self.fits[integral].energy_per_volt(x) / self.factor

    def published_j(
        self,
        integral: str,
        amplitude_v: NDArray[np.float64],
        width_s: NDArray[np.float64],
        area_v_s: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Return the same by the published line alone, whose curve is not printed as numbers."""
        slope, intercept, _ = PUBLISHED[integral]
        x = _normalized(integral, amplitude_v, width_s, area_v_s)
        return amplitude_v * (slope * x + intercept) / self.factor


def conversion(pulses: Sequence[PlainPulses], scene: Scene) -> Conversion:
    """Calibrate by echoes without noise.

    Parameters
    ----------
    pulses : sequence of PlainPulses
        Those within the widths that the receiver is to detect, 20 to 110 ns, count.
    scene : Scene
        Whose detector and receiver they have passed.

    Raises
    ------
    RefusedInput
        Pulses of too few widths for a line and a curve.
    """
    factor = at_reference(scene, scene.gain)
    amplitude_v, width_s, area_v_s, optical_j = (
        np.concatenate([getattr(one, name) for one in pulses]) for name in PlainPulses.__slots__
    )
    points = EnergyPoints(
        gaussian_s=GAUSSIAN_AREA * width_s,
        window_s=area_v_s / amplitude_v,
        rectified_s=np.zeros(width_s.shape),
        energy_j_per_v=factor * optical_j / amplitude_v,
        fwhm_s=width_s,
        amplitude_v=amplitude_v,
    ).within(NARROWEST_S, WIDEST_S)
    few = points.fwhm_s.size < _FEWEST
    fits = {name: None if few else points.fit(name) for name in INTEGRALS}
    found = {name: fit for name, fit in fits.items() if fit is not None}
    if len(found) < len(INTEGRALS):
        raise RefusedInput(
            f"an energy calibration from {points.fwhm_s.size} pulses of 20 to 110 ns: "
            f"at least {_FEWEST} are needed"
        )
    return Conversion(found, factor)


def _normalized(
    integral: str,
    amplitude_v: NDArray[np.float64],
    width_s: NDArray[np.float64],
    area_v_s: NDArray[np.float64],
) -> NDArray[np.float64]:
    if integral == "gaussian":
        return GAUSSIAN_AREA * width_s
    return np.divide(area_v_s, amplitude_v, out=np.zeros(area_v_s.shape), where=amplitude_v > 0)
