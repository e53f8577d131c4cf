"""The work of the range campaign in chunks: draws about echoes, peaks of noise, and whole shots.

Everything in and out is plain, so that a chunk can be computed anywhere; see `belahil.chunks`.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from functools import lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec import structs

from belahil.chunks import Chunk, shared
from belahil.delay_curve import DelayCurve
from procedures.arrival_gradient import linear_errors
from procedures.echo_energy import plain_pulses
from procedures.echo_hits import HALF_LIGHT, corrected_m, echo_hits
from procedures.local_draws import NEAR_SAMPLES, LocalDraws, alternating, local_draws, mismatched
from procedures.noise_colour import autocorrelation, interval_s, own_poles, unit_noise, window_noise
from procedures.noise_tilt import fitting_tilt, tilted_noise
from procedures.range_ground import Strips
from procedures.range_places import Places, footprints
from procedures.range_points import fit_name
from procedures.range_scenes import Condition, cell_scene
from procedures.range_truth import Definitions
from procedures.window_peaks import piece_peaks, window_peaks
from sim.accuracy import Accuracy
from sim.chain import Chain
from sim.detector import tia_poles
from sim.draws import Draws
from sim.filter_delay import filter_delay_curve
from sim.laser import beam_sigma_m
from sim.rfm import RangeFinder
from sim.scene import Scene, parse_scene
from sim.shot_rows import ShotRows
from sim.terrain import Surface

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

TOLERANCE = 1e-3
"""Of the echoes, relative to their peak: far below what noise and ground scatter."""
MIDDLE_WIDTH_S = 50e-9
NOISE_PEAKS = 8
"""Largest of each window of noise that are kept."""
_CURVE = "procedures.range_chunks:curve"
_SHOTS_APART = 2**32
"""Between the numbers of the first shots of chunks, whatever their size: none shares the noise of another."""


def curve(poles: Sequence[Sequence[float]], zeros: int, interval_s: float) -> dict[str, NDArray[np.float64]]:
    """Work out a delay curve, as the work of a chunk.

    Parameters
    ----------
    poles : sequence of two floats
        Real and imaginary parts, rad/s; with zeros and interval as `sim.filter_delay` takes them.
    zeros, interval_s
        As there.

    Returns
    -------
    dict
        ``coefficients_s`` and ``range_s`` of a `DelayCurve`.
    """
    found = filter_delay_curve([complex(*one) for one in poles], interval_s, zeros)
    return {
        "coefficients_s": np.array(found.coefficients_s),
        "range_s": np.array([found.narrowest_s, found.widest_s]),
    }


def curve_chunk(scene: Scene) -> Chunk:
    """Return the work of a scene's correction of arrivals."""
    return Chunk("correction of arrivals", _CURVE, _curve_of(scene))


def _curve_of(scene: Scene) -> dict[str, Any]:
    own, zeros = own_poles(scene)
    poles = (*tia_poles(scene.detector), *own)
    return {
        "poles": [[one.real, one.imag] for one in poles],
        "zeros": zeros,
        "interval_s": interval_s(scene),
    }


def correction(scene: Scene) -> DelayCurve:
    """Return the correction of arrivals behind a scene's filter: our own curve, of Gaussian pulses."""
    if scene.filter == "gaussian":
        # It lies about 0 and delays nothing.
        return DelayCurve((0.0,))
    return _curve(json.dumps(_curve_of(scene)))


@lru_cache(maxsize=8)
def _curve(given: str) -> DelayCurve:
    made = shared(_CURVE, json.loads(given))
    return DelayCurve(tuple(made["coefficients_s"].tolist()), *made["range_s"].tolist())


def _footprints(
    scene: Scene,
    ground: Mapping[str, Any],
    slopes_deg: Sequence[float],
    count: int,
    draws: Draws,
    definitions: Mapping[str, Any],
) -> tuple[Strips, Places]:
    sigma_m = beam_sigma_m(scene.laser, scene.altitude_m)
    # Echoes from posts take an ellipse along x or y, and refuse others.
    if scene.laser.beam == "elliptical" and scene.laser.beam_azimuth_deg % 180 == 90:
        sigma_m = sigma_m[::-1]
    slopes = (slopes_deg[0], slopes_deg[1])
    return footprints(ground, sigma_m, slopes, count, draws, Definitions(**definitions))


def echo_draws(
    scene: str,
    ground: Mapping[str, Any],
    slopes_deg: Sequence[float],
    conditions: Sequence[dict[str, Any]],
    count: int,
    repeats: int,
    seed: int,
    number: int,
    tilt: float | None = None,
    definitions: Mapping[str, Any] = MappingProxyType({}),
) -> dict[str, NDArray[Any]]:
    """Draw shots about their echoes, for all conditions at once.

    Parameters
    ----------
    scene : str
        TOML; its reflectance and sun do not matter.
    ground : mapping
        Fields of `procedures.range_ground.GroundKey`.
    slopes_deg : sequence of float
        Least and largest slope of the planes under the footprints.
    conditions : sequence of dict
        Fields of `procedures.range_scenes.Condition`.
    count : int
        Echoes on each terrain.
    repeats : int
        Shots for each echo.
    seed, number : int
        Key of the draws.
    tilt : float or None
        Of the noise; None: what fits the faintest condition.
    definitions : mapping
        Fields of `procedures.range_truth.Definitions` that are not its defaults.

    Returns
    -------
    dict
        ``hit, score_v, ahead, arrival_s, width_s, amplitude_v, area_v_s`` of shape (conditions, n, 2),
        `EchoHits`, and ``weight`` of shape (n,); of shape (echoes,): the fields of `PlainPulses`, of
        `LinearErrors`, its ``width_s`` by the name ``fit_s``, and ``slope_deg, roughness_m, by_light_m,
        by_centre_m, by_plane_m``, the last three the one-way change of the true range with each of the
        definitions.
    """
    read = parse_scene(scene)
    draws, curve = Draws(seed, number), correction(read)
    land, at = _footprints(read, ground, slopes_deg, count, draws, definitions)
    chain = Chain(read, Accuracy(TOLERANCE), land.surface)
    finder = chain.range_finder
    drawn = local_draws(chain, at, float(curve.at(MIDDLE_WIDTH_S)), draws, repeats)
    row = autocorrelation(read, drawn.unit.shape[1])
    moved = _tilt(drawn, finder, conditions) if tilt is None else tilt
    # Towards the same templates whatever the range finder's are: all that are compared meet the same noise.
    drawn = tilted_noise(drawn, row, RangeFinder.of(read.receiver_spec), moved, draws)
    linear, plain = linear_errors(drawn, finder, curve, row), plain_pulses(drawn, finder)
    step_v = chain.receiver.quantizer.volts_per_count
    rows = [
        echo_hits(drawn, one["reflectance"], one["noise_rms_v"], step_v, finder, curve) for one in conditions
    ]
    made = {name: np.stack([getattr(row, name) for row in rows]) for name in rows[0].__slots__}
    told = {fit_name(name): array for name, array in asdict(linear).items()}
    other = {
        "weight": drawn.weight,
        "slope_deg": at.slope_deg,
        "roughness_m": at.roughness_m,
        "by_light_m": HALF_LIGHT * (at.true_by_light_s - at.true_s),
        "by_centre_m": HALF_LIGHT * (at.true_by_centre_s - at.true_s),
        "by_plane_m": HALF_LIGHT * (at.true_by_plane_s - at.true_s),
    }
    return made | told | asdict(plain) | other


def plain_echoes(
    scene: str, ground: Mapping[str, Any], slopes_deg: Sequence[float], count: int, seed: int, number: int
) -> dict[str, NDArray[Any]]:
    """Fit and integrate echoes without noise: the fields of `PlainPulses`; parameters as of `echo_draws`."""
    read = parse_scene(scene)
    draws, curve = Draws(seed, number), correction(read)
    land, at = _footprints(read, ground, slopes_deg, count, draws, {})
    chain = Chain(read, Accuracy(TOLERANCE), land.surface)
    drawn = local_draws(chain, at, float(curve.at(MIDDLE_WIDTH_S)), draws)
    return asdict(plain_pulses(drawn, chain.range_finder))


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
    finder, unit, spec = (
        RangeFinder.of(read.receiver_spec, read.range_finder),
        unit_noise(read),
        read.receiver_spec.digitizer,
    )
    step_v = read.truth.adc_full_scale_v / 2**read.truth.adc_bits
    found = np.empty((len(noise_rms_v), windows, NOISE_PEAKS))
    side = alternating(np.zeros(1, dtype=np.int64), spec.max_sample_count)[0]
    for number in range(windows):
        drawn = window_noise(unit, seed, first + number, spec.max_sample_count)
        for level, rms_v in enumerate(noise_rms_v):
            volts = mismatched(rms_v * drawn, side, read.truth.interleave)
            volts = np.rint(volts / step_v) * step_v
            found[level, number] = window_peaks(finder, volts, NOISE_PEAKS)
    return {"score_v": found}


def whole_shots(
    scene: str,
    ground: Mapping[str, Any],
    slopes_deg: Sequence[float],
    condition: dict[str, Any],
    count: int,
    seed: int,
    number: int,
    definitions: Mapping[str, Any] = MappingProxyType({}),
) -> dict[str, NDArray[Any]]:
    """Take whole shots of one cell: brute force.

    Parameters
    ----------
    scene, ground, slopes_deg, count, seed, number, definitions
        As in `echo_draws`.
    condition : dict
        Fields of `procedures.range_scenes.Condition`.

    Returns
    -------
    dict
        ``error_m``: corrected one-way error of the candidate nearest to the truth, shape (n,).
    """
    read = cell_scene(parse_scene(scene), Condition(**condition))
    land, at = _footprints(read, ground, slopes_deg, count, Draws(seed, number), definitions)
    own = Surface(land.surface.kind, relief=land.surface.relief, albedo=read.surface.reflectance)
    chain = Chain(structs.replace(read, seed=seed), Accuracy(TOLERANCE), own)
    shots = number * _SHOTS_APART + np.arange(at.true_s.size)
    found = ShotRows(chain).candidates(shots, at.centre_m)
    true_s = (at.true_s + chain.kernel.pulse.mean_s)[:, None]
    errors_m = corrected_m(correction(read), found.arrival_s - true_s, found.fwhm_s)
    errors_m[np.arange(errors_m.shape[1]) >= found.found[:, None]] = math.inf
    nearest = np.abs(errors_m).argmin(axis=1)
    return {"error_m": errors_m[np.arange(nearest.size), nearest]}
