"""From draws to contrasts: how often kinds of ground are confused, and how many shots separate them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.values import Estimate
from procedures.class_separation import Measured, shots_needed, wrong_share
from procedures.energy_cells import energy_draws
from procedures.energy_curves import MOST_PFD
from procedures.energy_statistics import worth
from procedures.range_scenes import LIGHTS, noise_scene
from procedures.range_statistics import fast_pfd
from procedures.reflectance_kinds import (
    CONTRASTS,
    ICE_IN_MIXTURE,
    KINDS,
    Contrast,
)
from sim.scene import as_toml

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from procedures.echo_energy import Conversion
    from procedures.noise_clusters import LevelLaws
    from procedures.range_points import Drawn

GROUPS = 10
"""Of echoes: of the jackknife."""
SHARE_U = 0.10
"""Of ice in a mixture: what the paper says is reached."""
_SURE_ONE = 1.6448536269514722
"""Standard deviations beyond which 5 % of a normal distribution lie."""
_FLOOR = 1e-4
"""Smaller shares of confusions than so many are not told by as many draws."""

MIXTURES = {"areal": ("regolith", "ice", 1.0), "intimate": ("regolith", "icy mixture", ICE_IN_MIXTURE)}
"""Ice beside regolith, whose reflectances add by area (assumed); grains of both, from the paper's one point
on a straight line. The two ends, and the share of ice between them."""


@dataclass(frozen=True, slots=True)
class KindCell:
    """One kind of ground from one altitude.

    Parameters
    ----------
    kind : str
        Key of `KINDS`.
    altitude_m : float
        m.
    light : str
        "day" or "night".
    pfd : Estimate
        Probability of false detection.
    mean, spread : float or None
        Measured reflectance of single detected shots, and its standard deviation; None where none is
        detected.
    """

    kind: str
    altitude_m: float
    light: str
    pfd: Estimate
    mean: float | None
    spread: float | None


@dataclass(frozen=True, slots=True)
class ContrastCell:
    """Two kinds of ground from one altitude.

    Parameters
    ----------
    contrast : Contrast
        Which.
    altitude_m : float
        m.
    light : str
        "day" or "night".
    wrong : Estimate
        Share of false alarms, and of misses, with one shot.
    shots : Estimate or None
        Detected shots of either that separate them; None where ten million do not.
    pulses : Estimate or None
        Pulses to be fired for that, over the kind that is seen less often.
    apart : float
        Difference of the means over the standard deviation of the first kind.
    """

    contrast: Contrast
    altitude_m: float
    light: str
    wrong: Estimate
    shots: Estimate | None
    pulses: Estimate | None
    apart: float


@dataclass(frozen=True, slots=True)
class MixtureCell:
    """Share of ice in a mixture from one altitude.

    Parameters
    ----------
    mixture : str
        Key of `MIXTURES`.
    altitude_m : float
        m.
    light : str
        "day" or "night".
    share_u : Estimate
        Standard deviation of the share of ice from one shot, at the worse end.
    shots : Estimate
        Shots whose mean has 0.1.
    """

    mixture: str
    altitude_m: float
    light: str
    share_u: Estimate
    shots: Estimate


@dataclass(frozen=True, slots=True)
class ReflectanceCells:
    """All cells."""

    kinds: tuple[KindCell, ...]
    contrasts: tuple[ContrastCell, ...]
    mixtures: tuple[MixtureCell, ...]


def reflectance_cells(
    points: tuple[Drawn, ...], laws: Mapping[str, LevelLaws], convert: Conversion
) -> ReflectanceCells:
    """Reduce the points of the campaign.

    Pairs of kinds are compared until nine detections of the fainter in ten are false. Beyond, the energies
    are those of noise, and by day bright ground has more of it: sunlight would tell two kinds apart.
    """
    kinds: list[KindCell] = []
    contrasts: list[ContrastCell] = []
    mixtures: list[MixtureCell] = []
    for drawn in points:
        for light in LIGHTS:
            measured, cells = _measured(drawn, light, laws, convert)
            kinds += cells.values()
            echoes, altitude_m = drawn.arrays["optical_j"].size, drawn.scene.altitude_m
            for one in CONTRASTS:
                most = max(cells[one.low].pfd.value, cells[one.high].pfd.value)
                if one.low in measured and one.high in measured and most <= MOST_PFD:
                    pair = measured[one.low], measured[one.high]
                    contrasts.append(_contrast(one, altitude_m, light, pair, echoes, most))
            for name, (low, high, share) in MIXTURES.items():
                most = max(cells[low].pfd.value, cells[high].pfd.value)
                if low in measured and high in measured and most <= MOST_PFD:
                    pair = measured[low], measured[high]
                    mixtures.append(_mixture(name, altitude_m, light, pair, echoes, share))
    return ReflectanceCells(tuple(kinds), tuple(contrasts), tuple(mixtures))


def _measured(
    drawn: Drawn, light: str, laws: Mapping[str, LevelLaws], convert: Conversion
) -> tuple[dict[str, Measured], dict[str, KindCell]]:
    """What shots over each kind of ground tell as its reflectance.

    The energy that is told, over that of white ground: the calibrated bias is taken off, the laser's jitter
    is not known shot by shot and stays in.
    """
    law = laws[as_toml(noise_scene(drawn.scene))]
    white_j = drawn.arrays["optical_j"]
    names = {reflectance: name for name, reflectance in KINDS.items()}
    measured, cells = {}, {}
    for row, condition in enumerate(drawn.conditions):
        if condition.light != light:
            continue
        draws, own = energy_draws(drawn, row, convert), law.at(condition.noise_rms_v)
        weights, name = draws.hits.weights(own), names[condition.reflectance]
        of_echo = np.repeat(np.arange(white_j.size), draws.hits.weight.size // white_j.size)
        jitter = (white_j / white_j.mean())[of_echo, None]
        kept = 1 + float((draws.plain["gaussian", "own"] - 1).mean())
        values = condition.reflectance * jitter * draws.ratio["gaussian", "own"] / kept
        there = worth(weights, white_j.size) >= 2 * GROUPS
        if there:
            measured[name] = Measured(values, weights)
        cells[name] = KindCell(
            name,
            drawn.scene.altitude_m,
            light,
            fast_pfd(draws.hits, own),
            measured[name].mean if there else None,
            measured[name].spread if there else None,
        )
    return measured, cells


def _contrast(
    contrast: Contrast,
    altitude_m: float,
    light: str,
    pair: tuple[Measured, Measured],
    echoes: int,
    pfd: float,
) -> ContrastCell:
    needed = shots_needed(*pair)
    shots = pulses = None
    if needed is not None:
        relative = _jackknifed(_by_width, pair, echoes).standard_uncertainty / max(_by_width(*pair), 1e-300)
        shots = Estimate(float(needed), needed * relative)
        if pfd < 1:
            fired = needed / (1 - pfd)
            pulses = Estimate(fired, fired * relative)
    wrong = _jackknifed(wrong_share, pair, echoes)
    apart = (pair[1].mean - pair[0].mean) / pair[0].spread
    told = Estimate(max(wrong.value, _FLOOR), wrong.standard_uncertainty)
    return ContrastCell(contrast, altitude_m, light, told, shots, pulses, apart)


def _mixture(
    name: str, altitude_m: float, light: str, pair: tuple[Measured, Measured], echoes: int, share: float
) -> MixtureCell:
    def of_share(low: Measured, high: Measured) -> float:
        return share * max(low.spread, high.spread) / abs(high.mean - low.mean)

    one = _jackknifed(of_share, pair, echoes)
    shots = max((one.value / SHARE_U) ** 2, 1.0)
    relative = 2 * one.standard_uncertainty / one.value
    return MixtureCell(name, altitude_m, light, one, Estimate(shots, shots * relative))


def _by_width(low: Measured, high: Measured) -> float:
    """Shots that would separate normal distributions: only for how well their number is known."""
    return (_SURE_ONE * (low.spread + high.spread) / (high.mean - low.mean)) ** 2


def _jackknifed(
    tell: Callable[[Measured, Measured], float], pair: tuple[Measured, Measured], echoes: int
) -> Estimate:
    """Return a number of a pair; its uncertainty by leaving out each tenth of the echoes in turn."""
    parts = np.array([tell(*(one.without(group, GROUPS, echoes) for one in pair)) for group in range(GROUPS)])
    return Estimate(tell(*pair), math.sqrt((GROUPS - 1) * float(parts.var())))


def allowed_scale_u(contrast: Contrast) -> float:
    """Return how well the scale must be known, relative, that any number of shots separates two kinds.

    The threshold is half way in the logarithm, and an error of the scale may cross it once in twenty times.
    """
    return math.log(contrast.ratio) / (2 * _SURE_ONE)


def crossovers_needed(spread: float, albedo_u: float, scale_u: float) -> float:
    """Return how many cross-overs tell a change of the scale between two times.

    Parameters
    ----------
    spread : float
        Of the energy of single shots, relative, laser's jitter included.
    albedo_u : float
        Difference of the ground under the two footprints of a cross-over, relative.
    scale_u : float
        Standard uncertainty of the change, relative.
    """
    return (2 * spread**2 + albedo_u**2) / scale_u**2
