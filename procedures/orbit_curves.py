"""Probability of false detection and errors as curves over altitude, with what chance makes of them.

Chance comes as copies of the curves: each echo's influence on every number is multiplied by a normal deviate
of its own, the same at all altitudes and under any Sun, since the same draws served there; and so are the two
parameters of the law of noise peaks. Whatever is made of the curves is made of each copy, and their scatter
is its uncertainty.

Between altitudes the logit of the probability and the logarithm of the error follow a monotone cubic
(Fritsch and Carlson, SIAM J. Numer. Anal. 17, 1980). What that leaves open is told by straight lines in its
place.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from procedures.range_chunks import correction
from procedures.range_scenes import noise_scene
from procedures.range_statistics import influences, law_slopes
from procedures.range_table import cell_draws
from sim.scene import as_toml

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike, NDArray

    from belahil.values import Estimate
    from procedures.energy_cells import EnergyCell
    from procedures.noise_clusters import LevelLaws
    from procedures.range_points import Drawn
    from procedures.range_table import Cell
    from sim.draws import Draws

    BothCells = tuple[Cell, EnergyCell]

COPIES = 48
LEAST_PFD = 1e-4
"""Probabilities are told from here to 1 less as much."""
PARAMETERS = 2
"""Of the law of noise peaks."""


@dataclass(frozen=True, slots=True, eq=False)
class Nodes:
    """Numbers where they were computed, of one reflectance and slope.

    Parameters
    ----------
    altitude_m : ndarray of float64, shape (a,)
        Growing.
    level_v : ndarray of float64, shape (s,)
        Noise at the converter, growing: from night to noon.
    logit : ndarray of float64, shape (1 + copies, a, s)
        Of the probability of false detection; the first is the estimate.
    log_error, log_energy : ndarray of float64, shape (1 + copies, a, s)
        Logarithms of the rms range error of detections, m, and of the relative rms error of their energy E_G;
        where nothing is detected, of the nearest altitude.
    known : ndarray of bool, shape (s,)
        Whether anything is detected at any altitude.
    """

    altitude_m: NDArray[np.float64]
    level_v: NDArray[np.float64]
    logit: NDArray[np.float64]
    log_error: NDArray[np.float64]
    log_energy: NDArray[np.float64]
    known: NDArray[np.bool_]

    @property
    def estimate(self) -> Nodes:
        """The estimate without its copies."""
        every = {name: getattr(self, name)[:1] for name in ("logit", "log_error", "log_energy")}
        return replace(self, **every)


def logit(probability: ArrayLike) -> NDArray[np.float64]:
    """Return log(p / (1 - p)), of p within `LEAST_PFD` and 1 less as much."""
    held = np.clip(probability, LEAST_PFD, 1 - LEAST_PFD)
    return np.asarray(np.log(held / (1 - held)))


def probability(logits: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return p of its logit."""
    return np.asarray(1 / (1 + np.exp(-logits)))


def nodes(
    points: Sequence[Drawn],
    told: Sequence[Sequence[BothCells]],
    laws: Mapping[str, LevelLaws],
    reflectance: float,
    draws: Draws,
) -> Nodes:
    """Reduce the points of one slope.

    Parameters
    ----------
    points : sequence of Drawn
        By altitude, growing.
    told : sequence of sequence of Cell
        Their cells, of range and of energy.
    laws : mapping of str to LevelLaws
        From `procedures.range_points.Collected.laws`.
    reflectance : float
        One of their conditions'.
    draws : Draws
        "copies".
    """
    rows = [n for n, one in enumerate(points[0].conditions) if one.reflectance == reflectance]
    echoes = max(one.arrays["still_m"].size for one in points)
    stream = draws.stream("copies")
    chance = stream.standard_normal((COPIES, echoes)), stream.standard_normal((COPIES, PARAMETERS))
    every = [
        [_copies(one, row, cell_row[row], laws, chance) for row in rows]
        for one, cell_row in zip(points, told, strict=True)
    ]
    false, errors, energies = (np.stack([[one[n] for one in ones] for ones in every]) for n in range(3))
    known = np.isfinite(errors[:, :, 0])
    return Nodes(
        altitude_m=np.array([one.scene.altitude_m for one in points]),
        level_v=np.array([points[0].conditions[row].noise_rms_v for row in rows]),
        logit=logit(np.moveaxis(false, 2, 0)),
        log_error=np.moveaxis(_filled(errors, known), 2, 0),
        log_energy=np.moveaxis(_filled(energies, np.isfinite(energies[:, :, 0])), 2, 0),
        known=np.asarray(known.any(axis=0)),
    )


def _copies(
    drawn: Drawn,
    row: int,
    both: BothCells,
    laws: Mapping[str, LevelLaws],
    chance: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> tuple[NDArray[np.float64], ...]:
    """Probability and logarithms of both errors at one altitude and level: the estimate, and its copies."""
    cell, energy = both
    law = laws[as_toml(noise_scene(drawn.scene))].at(drawn.conditions[row].noise_rms_v)
    draws = cell_draws(drawn, row, correction(drawn.scene), cell.bias.value)
    (_, of_error), (_, of_false) = influences(draws, law)
    of_echoes, of_law = chance
    of_echoes = of_echoes[:, : draws.echoes]
    by_a, by_b = law_slopes(draws, law)
    a = of_law[:, 0]
    b = law.correlation * a + np.sqrt(1 - law.correlation**2) * of_law[:, 1]
    moved = of_echoes @ of_false + by_a * law.a_u * a + by_b * law.b_u * b
    false = np.concatenate([[cell.pfd.value], cell.pfd.value + moved])
    return false, _logarithms(cell.spread, of_error, of_echoes), _energies(energy, of_echoes)


def _energies(cell: EnergyCell, of_echoes: NDArray[np.float64]) -> NDArray[np.float64]:
    found = cell.errors.get(("gaussian", "own"))
    if found is None:
        return _logarithms(None, np.zeros(of_echoes.shape[1]), of_echoes)
    return _logarithms(found.error.rms, found.error.by_echo, of_echoes)


def _logarithms(
    error: Estimate | None, influence: NDArray[np.float64], of_echoes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Logarithm of an error and its copies; minus infinity where there is none."""
    if error is None or not error.value > 0:
        return np.full(1 + COPIES, -np.inf)
    size = float(np.sqrt(influence @ influence))
    # As large as the uncertainty of the error, which takes off what is known of chance.
    scale = error.standard_uncertainty / error.value / size if size > 0 else 0.0
    return np.asarray(np.log(error.value) + np.concatenate([[0.0], scale * (of_echoes @ influence)]))


def _filled(errors: NDArray[np.float64], known: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Take the nearest altitude where nothing was detected; 0 where nothing is at any."""
    found = np.where(known[:, :, None], errors, 0.0)
    for level in range(known.shape[1]):
        there = np.flatnonzero(known[:, level])
        for at in np.flatnonzero(~known[:, level]) if there.size else ():
            found[at, level] = errors[there[np.abs(there - at).argmin()], level]
    return found


def along(
    altitude_m: NDArray[np.float64],
    values: NDArray[np.float64],
    at_m: NDArray[np.float64],
    straight: bool = False,
) -> NDArray[np.float64]:
    """Interpolate over altitude.

    Parameters
    ----------
    altitude_m : ndarray of float64, shape (a,)
        Growing; with a single one all is as there.
    values : ndarray of float64, shape (r, a, s)
        There.
    at_m : ndarray of float64, shape (n,)
        Within them.
    straight : bool
        By straight lines, not by monotone cubics.

    Returns
    -------
    ndarray of float64, shape (r, n, s)
    """
    from scipy.interpolate import PchipInterpolator, make_interp_spline

    if altitude_m.size == 1:
        return np.repeat(values, at_m.size, axis=1)
    held_m = np.clip(at_m, altitude_m[0], altitude_m[-1])
    if straight:
        return np.asarray(make_interp_spline(altitude_m, values, 1, axis=1)(held_m))
    return np.asarray(PchipInterpolator(altitude_m, values, axis=1)(held_m))
