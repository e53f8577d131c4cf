"""The work of the range campaign in chunks: draws about echoes, peaks of noise, and whole shots.

Everything in and out is plain, so that a chunk can be computed anywhere; see `belahil.chunks`.
"""

from __future__ import annotations

import math
from dataclasses import asdict
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec import structs

from belahil import butterworth
from belahil.delay_curve import DelayCurve
from belahil.pole_response import SampledNoise, autocovariance
from procedures.arrival_gradient import linear_errors
from procedures.echo_hits import HALF_LIGHT, corrected_m, echo_hits
from procedures.local_draws import NEAR_SAMPLES, LocalDraws, local_draws
from procedures.noise_tilt import fitting_tilt, tilted_noise
from procedures.range_ground import Places, Strips, described, fractal_strips, places, plane_strip
from procedures.range_scenes import Condition, cell_scene
from procedures.window_peaks import piece_peaks, window_peaks
from sim.accuracy import Accuracy
from sim.chain import Chain
from sim.detector import tia_poles
from sim.draws import Draws
from sim.filter_delay import filter_delay_curve
from sim.keyed import KeyedDraws
from sim.laser import beam_sigma_m
from sim.receiver_model import ReceiverModel
from sim.rfm import RangeFinder
from sim.scene import Scene, parse_scene
from sim.shot_rows import ShotRows
from sim.terrain import Surface

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from procedures.footprint_planes import FootprintPlanes

TOLERANCE = 1e-3
"""Of the echoes, relative to their peak: far below what noise and ground scatter."""
MIDDLE_WIDTH_S = 50e-9
FIT_WIDTH = "fit_s"
"""Width without noise, by which name it leaves `echo_draws`: the other is that of a hit."""
NOISE_PEAKS = 8
"""Largest of each window of noise that are kept."""

_KEEP = 2
"""Sets of ground in memory, some 15 MB each, and of what lies under the beam on them, some 30 MB."""


@lru_cache(maxsize=_KEEP)
def _ground(kind: str, seed: int, slope_deg: float) -> Strips:
    return plane_strip(slope_deg) if kind == "plane" else fractal_strips(seed, slope_deg)


@lru_cache(maxsize=8)
def _curve(poles: tuple[complex, ...], zeros: int, interval_s: float) -> DelayCurve:
    return filter_delay_curve(poles, interval_s, zeros)


def correction(scene: Scene) -> DelayCurve:
    """Return the correction of arrivals behind a scene's filter: our own curve, of Gaussian pulses."""
    truth = scene.truth
    if scene.filter == "gaussian":
        # It lies about 0 and delays nothing.
        return DelayCurve((0.0,))
    own = butterworth.poles(truth.cutoff_hz, truth.order, truth.highpass_hz)
    interval_s = scene.receiver_spec.digitizer.sample_interval_s / (1 + 1e-6 * truth.clock_ppm)
    return _curve((*tia_poles(scene.detector), *own), int(truth.highpass_hz > 0), interval_s)


@lru_cache(maxsize=_KEEP)
def _described(kind: str, seed: int, slope_deg: float, sigma_m: float) -> tuple[FootprintPlanes, ...]:
    return described(_ground(kind, seed, slope_deg), sigma_m)


def _places(
    scene: Scene, ground: tuple[str, int, float], slopes_deg: Sequence[float], count: int, draws: Draws
) -> Places:
    planes = _described(*ground, beam_sigma_m(scene.laser, scene.altitude_m)[0])
    return places(_ground(*ground), planes, (slopes_deg[0], slopes_deg[1]), count, draws)


def echo_draws(
    scene: str,
    ground: str,
    ground_seed: int,
    slopes_deg: Sequence[float],
    conditions: Sequence[dict[str, Any]],
    count: int,
    repeats: int,
    seed: int,
    number: int,
) -> dict[str, NDArray[Any]]:
    """Draw shots about their echoes, for all conditions at once.

    Parameters
    ----------
    scene : str
        TOML; its reflectance and sun do not matter.
    ground : {"fractal", "plane"}
        Kind of ground.
    ground_seed : int
        Of the fractals.
    slopes_deg : sequence of float
        Least and largest slope of the planes; their mean is the tilt that is added.
    conditions : sequence of dict
        Fields of `procedures.range_scenes.Condition`.
    count : int
        Echoes on each terrain.
    repeats : int
        Shots for each echo.
    seed, number : int
        Key of the draws.

    Returns
    -------
    dict
        ``hit, score_v, ahead, arrival_s, width_s`` of shape (conditions, n, 2), `EchoHits`, and ``weight`` of
        shape (n,); the fields of `LinearErrors`, its ``width_s`` by the name ``fit_s``; ``slope_deg,
        roughness_m, by_centre_m, by_plane_m`` of shape (echoes,), the last two the one-way change of the true
        range with the other definitions.
    """
    read = parse_scene(scene)
    key = (ground, ground_seed, sum(slopes_deg) / 2)
    land = _ground(*key)
    chain = Chain(read, Accuracy(TOLERANCE), land.surface)
    finder, curve, draws = chain.range_finder, correction(read), Draws(seed, number)
    at = _places(read, key, slopes_deg, count, draws)
    drawn = local_draws(chain, at, float(curve.at(MIDDLE_WIDTH_S)), draws, repeats)
    drawn = tilted_noise(drawn, chain.receiver, finder, _tilt(drawn, finder, conditions), draws)
    lags = chain.receiver.grid.interval_s * np.arange(finder.correlation_window_samples)
    unit = autocovariance(chain.receiver.poles, lags, chain.receiver.zeros)
    linear = linear_errors(drawn, finder, curve, unit / unit[0])
    step_v = chain.receiver.quantizer.volts_per_count
    rows = [
        echo_hits(drawn, one["reflectance"], one["noise_rms_v"], step_v, finder, curve) for one in conditions
    ]
    made = {name: np.stack([getattr(row, name) for row in rows]) for name in rows[0].__slots__}
    told = {FIT_WIDTH if name == "width_s" else name: array for name, array in asdict(linear).items()}
    other = {
        "weight": drawn.weight,
        "slope_deg": at.slope_deg,
        "roughness_m": at.roughness_m,
        "by_centre_m": HALF_LIGHT * (at.true_by_centre_s - at.true_s),
        "by_plane_m": HALF_LIGHT * (at.true_by_plane_s - at.true_s),
    }
    return made | told | other


def _tilt(drawn: LocalDraws, finder: RangeFinder, conditions: Sequence[dict[str, Any]]) -> float:
    """The tilt for the faintest of some conditions."""
    near = (drawn.middle - NEAR_SAMPLES, drawn.middle + NEAR_SAMPLES)
    score_v = float(np.median(piece_peaks(finder, drawn.still_v, near, 1).score))
    return fitting_tilt(min(one["reflectance"] / one["noise_rms_v"] for one in conditions) * score_v)


def noise_peaks(
    scene: str, noise_rms_v: Sequence[float], windows: int, seed: int, first: int
) -> dict[str, NDArray[Any]]:
    """Find the largest peaks of windows with noise only, at several levels of the same noise.

    Parameters
    ----------
    scene : str
        TOML; its receiver.
    noise_rms_v : sequence of float
        Levels, V at the converter.
    windows, seed, first : int
        How many; key and number of the first.

    Returns
    -------
    dict
        ``score_v`` of shape (levels, windows, 8).
    """
    read = parse_scene(scene)
    finder = RangeFinder.of(read.receiver_spec)
    receiver = ReceiverModel(read.truth, read.receiver_spec.digitizer)
    unit = SampledNoise(receiver.poles, receiver.zeros, receiver.grid.interval_s)
    size, step_v = receiver.spec.max_sample_count, receiver.quantizer.volts_per_count
    found = np.empty((len(noise_rms_v), windows, NOISE_PEAKS))
    for number in range(windows):
        drawn = KeyedDraws(seed, first + number).coloured("noise", unit, size).astype(np.float64)
        for level, rms_v in enumerate(noise_rms_v):
            volts = np.rint(rms_v / step_v * drawn) * step_v
            found[level, number] = window_peaks(finder, volts, NOISE_PEAKS)
    return {"score_v": found}


def whole_shots(
    scene: str,
    ground: str,
    ground_seed: int,
    slopes_deg: Sequence[float],
    condition: dict[str, Any],
    count: int,
    seed: int,
    number: int,
) -> dict[str, NDArray[Any]]:
    """Take whole shots of one cell: brute force.

    Parameters
    ----------
    scene, ground, ground_seed, slopes_deg, count, seed, number
        As in `echo_draws`.
    condition : dict
        Fields of `procedures.range_scenes.Condition`.

    Returns
    -------
    dict
        ``error_m``: corrected one-way error of the candidate nearest to the truth, shape (n,).
    """
    read = cell_scene(parse_scene(scene), Condition(**condition))
    key = (ground, ground_seed, sum(slopes_deg) / 2)
    land = _ground(*key)
    own = Surface(land.surface.kind, relief=land.surface.relief, albedo=read.surface.reflectance)
    chain = Chain(structs.replace(read, seed=seed), Accuracy(TOLERANCE), own)
    at = _places(read, key, slopes_deg, count, Draws(seed, number))
    shots = number * at.true_s.size + np.arange(at.true_s.size)
    found = ShotRows(chain).candidates(shots, at.centre_m)
    true_s = (at.true_s + chain.kernel.pulse.mean_s)[:, None]
    errors_m = corrected_m(correction(read), found.arrival_s - true_s, found.fwhm_s)
    errors_m[np.arange(errors_m.shape[1]) >= found.found[:, None]] = math.inf
    nearest = np.abs(errors_m).argmin(axis=1)
    return {"error_m": errors_m[np.arange(nearest.size), nearest]}
