"""From what was drawn at a point to its cells, and the headline table."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.values import Estimate
from procedures.echo_hits import corrected_m
from procedures.range_chunks import correction
from procedures.range_scenes import DISTANCES_AU, LIGHTS, Condition, noise_scene
from procedures.range_statistics import (
    BruteCell,
    CellDraws,
    LinearSpread,
    brute_cell,
    conditional_pfd,
    fast_pfd,
    linear_spread,
    weighted_rms,
)
from procedures.range_truth import TRUTHS
from sim.scene import as_toml

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from belahil.delay_curve import DelayCurve
    from procedures.noise_clusters import LevelLaws, NoiseClusters
    from procedures.range_points import Collected, Drawn


@dataclass(frozen=True, slots=True)
class Cell:
    """One cell.

    Parameters
    ----------
    altitude_m : float
        m.
    condition : Condition
        The others of its circumstances.
    pfd : Estimate
        Probability of false detection.
    spread : Estimate or None
        Rms error of detections, calibrated bias taken off, m; None where nothing is detected.
    shape, jitter, noise : Estimate or None
        Of detections, by source, m: of the shape of pulse and ground without noise, of the wandering beam,
        and of all noise.
    bias, mean_error : Estimate or None
        The calibrated bias; the mean error of detections that is left with noise, m.
    linear : LinearSpread
        By linear propagation.
    """

    altitude_m: float
    condition: Condition
    pfd: Estimate
    spread: Estimate | None
    shape: Estimate | None
    jitter: Estimate | None
    noise: Estimate | None
    bias: Estimate
    mean_error: Estimate | None
    linear: LinearSpread


@dataclass(frozen=True, slots=True)
class TableCell:
    """A cell of the headline table, with what it is compared with.

    Parameters
    ----------
    cell : Cell
        By draws about the echo and the law of noise peaks.
    conditional : Estimate
        Probability of false detection by the very windows of noise.
    brute : BruteCell or None
        By whole shots, where some were taken.
    """

    cell: Cell
    conditional: Estimate
    brute: BruteCell | None


def cells(drawn: Drawn, laws: Mapping[str, LevelLaws]) -> tuple[Cell, ...]:
    """Reduce the draws of a point, one cell for each condition.

    Parameters
    ----------
    drawn : Drawn
        The point.
    laws : mapping of str to LevelLaws
        From `Collected.laws`.
    """
    own, curve = laws[as_toml(noise_scene(drawn.scene))], correction(drawn.scene)
    return tuple(
        _cell(drawn, row, curve, own.at(one.noise_rms_v)) for row, one in enumerate(drawn.conditions)
    )


def cell_draws(drawn: Drawn, row: int, curve: DelayCurve, bias_m: float) -> CellDraws:
    """Return the draws of one condition of a point."""
    arrays = drawn.arrays
    errors_m = corrected_m(curve, arrays["arrival_s"][row], arrays["width_s"][row]) - bias_m
    hits = (arrays["hit"][row], arrays["score_v"][row], arrays["ahead"][row])
    return CellDraws(*hits, errors_m, arrays["weight"], arrays["still_m"].size)


def _cell(drawn: Drawn, row: int, curve: DelayCurve, law: NoiseClusters) -> Cell:
    linear, condition = drawn.linear, drawn.conditions[row]
    bias_m = float(linear.still_m.mean())
    draws = cell_draws(drawn, row, curve, bias_m)
    weights, echoes = draws.weights(law), draws.echoes
    noise_rms_v, reflectance = condition.noise_rms_v, condition.reflectance
    of_echo = np.repeat(np.arange(echoes), draws.weight.size // echoes)
    moved_m = (linear.moved_m - bias_m)[of_echo]
    # The square of the linear error less its own mean: of mean 0, and like that of the error.
    expected_m2 = moved_m**2 + linear.noise_m2(reflectance, noise_rms_v, 0.0)[of_echo]
    linear_m = moved_m + linear.chance_m(reflectance, noise_rms_v)
    control = draws.by_echo(draws.weight * (linear_m**2 - expected_m2))
    spread = weighted_rms(draws.error_m, weights, echoes, control)
    truth = drawn.scene.truth
    return Cell(
        altitude_m=drawn.scene.altitude_m,
        condition=condition,
        pfd=fast_pfd(draws, law),
        spread=spread,
        shape=weighted_rms((linear.still_m - bias_m)[of_echo, None], weights, echoes),
        jitter=weighted_rms((linear.moved_m - linear.still_m)[of_echo, None], weights, echoes),
        noise=weighted_rms(draws.error_m - moved_m[:, None], weights, echoes),
        bias=Estimate(bias_m, float(linear.still_m.std()) / math.sqrt(echoes), "m"),
        mean_error=None if spread is None else _mean(draws, weights),
        linear=linear_spread(linear, reflectance, noise_rms_v, truth.adc_full_scale_v / 2**truth.adc_bits),
    )


def _mean(draws: CellDraws, weights: NDArray[np.float64]) -> Estimate:
    total = float(weights.sum())
    mean_m = float((weights * draws.error_m).sum()) / total
    away_m = draws.by_echo(weights * (draws.error_m - mean_m))
    return Estimate(mean_m, math.sqrt(float(away_m @ away_m)) / total, "m")


@dataclass(frozen=True, slots=True)
class Headline:
    """The headline table.

    Parameters
    ----------
    cells : tuple of TableCell
        By altitude and condition.
    laws : tuple of NoiseClusters
        Of the noise peaks, by the level.
    truths : mapping of float to mapping of str to tuple of float
        By altitude and definition: mean and standard deviation of the change of the true range with it, m.
    """

    cells: tuple[TableCell, ...]
    laws: tuple[NoiseClusters, ...]
    truths: Mapping[float, Mapping[str, tuple[float, float]]]


def headline(found: Collected, laws: Mapping[str, LevelLaws]) -> Headline:
    """Make the headline table of what was drawn."""
    rows: list[TableCell] = []
    truths: dict[float, dict[str, tuple[float, float]]] = {}
    used: dict[float, NoiseClusters] = {}
    for drawn in found.of("table"):
        text, key = as_toml(drawn.scene), as_toml(noise_scene(drawn.scene))
        altitude_m, curve = drawn.scene.altitude_m, correction(drawn.scene)
        # The first of an altitude has most echoes.
        truths.setdefault(altitude_m, {key: _two(drawn.arrays[f"by_{key}_m"]) for key in TRUTHS})
        for row, cell in enumerate(cells(drawn, laws)):
            level_v = cell.condition.noise_rms_v
            used[level_v] = laws[key].at(level_v)
            draws = cell_draws(drawn, row, curve, cell.bias.value)
            shots = found.shots.get((text, cell.condition))
            rows.append(
                TableCell(
                    cell,
                    conditional_pfd(draws, found.noise[key, level_v]),
                    None if shots is None else brute_cell(shots, cell.bias.value),
                )
            )
    return Headline(tuple(sorted(rows, key=_place)), tuple(used.values()), truths)


def _two(values: NDArray[np.float64]) -> tuple[float, float]:
    return float(values.mean()), float(values.std())


def _place(one: TableCell) -> tuple[float, int, int, float]:
    condition = one.cell.condition
    distance, light = list(DISTANCES_AU).index(condition.distance), LIGHTS.index(condition.light)
    return one.cell.altitude_m, distance, light, condition.reflectance
