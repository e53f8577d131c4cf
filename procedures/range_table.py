"""The headline table: from the results of chunks to its cells."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.values import Estimate
from procedures.arrival_gradient import LinearErrors
from procedures.echo_hits import EchoHits, corrected_m
from procedures.noise_clusters import NoiseClusters, fit_clusters
from procedures.range_chunks import FIT_WIDTH, correction
from procedures.range_scenes import Condition
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
from sim.scene import Scene, parse_scene

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from belahil.campaign_run import CampaignPlan
    from belahil.delay_curve import DelayCurve

    Results = Mapping[str, NDArray[Any]]

LINEAR_FIELDS = {name: FIT_WIDTH if name == "width_s" else name for name in LinearErrors.__slots__}


@dataclass(frozen=True, slots=True)
class Cell:
    """One cell.

    Parameters
    ----------
    altitude_m : float
        m.
    condition : Condition
        The others of its circumstances.
    pfd, conditional : Estimate
        Probability of false detection, fast and by the very windows of noise.
    spread : Estimate or None
        Rms error of detections, calibrated bias taken off, m; None where nothing is detected.
    shape, jitter, noise : Estimate or None
        Of detections, by source, m: of the shape of pulse and ground without noise, of the wandering beam,
        and of all noise.
    bias, mean_error : Estimate or None
        The calibrated bias; the mean error of detections that is left with noise, m.
    linear : LinearSpread
        By linear propagation.
    brute : BruteCell or None
        By whole shots, where some were taken.
    """

    altitude_m: float
    condition: Condition
    pfd: Estimate
    conditional: Estimate
    spread: Estimate | None
    shape: Estimate | None
    jitter: Estimate | None
    noise: Estimate | None
    bias: Estimate
    mean_error: Estimate | None
    linear: LinearSpread
    brute: BruteCell | None


@dataclass(frozen=True, slots=True)
class Headline:
    """The table, and what it rests on.

    Parameters
    ----------
    scene : Scene
        That is varied.
    cells : tuple of Cell
        By altitude and condition.
    laws : mapping of float to NoiseClusters
        By the level of noise, V.
    by_centre, by_plane : mapping of float to tuple of float
        By altitude: mean and standard deviation of the change of the true range with the other definitions,
        m.
    """

    scene: Scene
    cells: tuple[Cell, ...]
    laws: Mapping[float, NoiseClusters]
    by_centre: Mapping[float, tuple[float, float]]
    by_plane: Mapping[float, tuple[float, float]]


def headline(plan: CampaignPlan, results: Sequence[Results]) -> Headline:
    """Reduce the results of the chunks of a plan."""
    noise: dict[float, list[NDArray[np.float64]]] = {}
    echoes: dict[str, list[tuple[list[dict[str, Any]], Results]]] = {}
    shots: dict[tuple[str, Condition], list[NDArray[np.float64]]] = {}
    for chunk, result in zip(plan.chunks, results, strict=True):
        work = chunk.work.partition(":")[2]
        if work == "noise_peaks":
            for level_v, rows in zip(chunk.given["noise_rms_v"], result["score_v"], strict=True):
                noise.setdefault(level_v, []).append(rows)
        elif work == "echo_draws":
            echoes.setdefault(chunk.given["scene"], []).append((chunk.given["conditions"], result))
        elif work == "whole_shots":
            one = Condition(**chunk.given["condition"])
            shots.setdefault((chunk.given["scene"], one), []).append(result["error_m"])
    peaks = {level_v: np.concatenate(rows) for level_v, rows in noise.items()}
    laws = {level_v: fit_clusters(rows, level_v) for level_v, rows in peaks.items()}
    cells, by_centre, by_plane = [], {}, {}
    for text, parts in echoes.items():
        scene = parse_scene(text)
        drawn = {key: _joined(key, [part[key] for _, part in parts]) for key in parts[0][1]}
        curve = correction(scene)
        by_centre[scene.altitude_m] = _two(drawn["by_centre_m"])
        by_plane[scene.altitude_m] = _two(drawn["by_plane_m"])
        for row, given in enumerate(parts[0][0]):
            one = Condition(**given)
            whole = shots.get((text, one))
            errors_m = None if whole is None else np.concatenate(whole)
            level = peaks[one.noise_rms_v], laws[one.noise_rms_v]
            cells.append(cell(scene, one, curve, drawn, row, *level, errors_m))
    return Headline(parse_scene(plan.scene), tuple(cells), laws, by_centre, by_plane)


def _joined(key: str, parts: list[NDArray[Any]]) -> NDArray[Any]:
    """Sets one after the other; hits have the condition before the draw."""
    return np.concatenate(parts, axis=1 if key in EchoHits.__slots__ else 0)


def _two(values: NDArray[np.float64]) -> tuple[float, float]:
    return float(values.mean()), float(values.std())


def cell(
    scene: Scene,
    condition: Condition,
    curve: DelayCurve,
    drawn: Results,
    row: int,
    peaks_v: NDArray[np.float64],
    law: NoiseClusters,
    whole_m: NDArray[np.float64] | None,
) -> Cell:
    """Reduce the draws of one cell.

    Parameters
    ----------
    scene, condition
        Where it is.
    curve : DelayCurve
        The correction of arrivals.
    drawn, row
        From `procedures.range_chunks.echo_draws`, and which of its conditions.
    peaks_v, law
        Of the noise.
    whole_m : ndarray of float64, or None
        Errors of whole shots.
    """
    linear = LinearErrors(**{name: drawn[key] for name, key in LINEAR_FIELDS.items()})
    bias_m = float(linear.still_m.mean())
    draws = cell_draws(drawn, row, curve, bias_m)
    weights, echoes = draws.weights(law), draws.echoes
    noise_rms_v, reflectance = condition.noise_rms_v, condition.reflectance
    of_echo = np.repeat(np.arange(echoes), draws.weight.size // echoes)
    expected_m2 = linear.noise_m2(reflectance, noise_rms_v, 0.0)
    chance_m = linear.chance_m(reflectance, noise_rms_v)
    moved_m = (linear.moved_m - bias_m)[of_echo]
    control = draws.by_echo(draws.weight * ((moved_m + chance_m) ** 2 - moved_m**2 - expected_m2[of_echo]))
    spread = weighted_rms(draws.error_m, weights, echoes, control)
    mean_m = float((weights * draws.error_m).sum() / weights.sum()) if spread else 0.0
    away_m = draws.by_echo(weights * (draws.error_m - mean_m))
    mean_u_m = math.sqrt(float(away_m @ away_m)) / float(weights.sum()) if spread else 0.0
    step_v = scene.truth.adc_full_scale_v / 2**scene.truth.adc_bits
    return Cell(
        altitude_m=scene.altitude_m,
        condition=condition,
        pfd=fast_pfd(draws, law),
        conditional=conditional_pfd(draws, peaks_v),
        spread=spread,
        shape=weighted_rms((linear.still_m - bias_m)[of_echo, None], weights, echoes),
        jitter=weighted_rms((linear.moved_m - linear.still_m)[of_echo, None], weights, echoes),
        noise=weighted_rms(draws.error_m - moved_m[:, None], weights, echoes),
        bias=Estimate(bias_m, float(linear.still_m.std()) / math.sqrt(echoes), "m"),
        mean_error=Estimate(mean_m, mean_u_m, "m") if spread else None,
        linear=linear_spread(linear, reflectance, noise_rms_v, step_v),
        brute=None if whole_m is None else brute_cell(whole_m, bias_m),
    )


def cell_draws(drawn: Results, row: int, curve: DelayCurve, bias_m: float) -> CellDraws:
    """Return the draws of one condition, of what `procedures.range_chunks.echo_draws` gives."""
    errors_m = corrected_m(curve, drawn["arrival_s"][row], drawn["width_s"][row]) - bias_m
    hits = (drawn["hit"][row], drawn["score_v"][row], drawn["ahead"][row])
    return CellDraws(*hits, errors_m, drawn["weight"], drawn["still_m"].size)
