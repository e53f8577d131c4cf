"""The work of the roughness campaign in chunks: footprints, their echoes, widths and best pulses.

Everything in and out is plain, so that a chunk can be computed anywhere; see `belahil.chunks`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from procedures.echo_hits import FALSE_M, corrected_m
from procedures.footprint_moments import described, disc, even_places
from procedures.local_draws import local_draws
from procedures.pulse_library import best_matches, pulse_library, timed_matches
from procedures.range_chunks import MIDDLE_WIDTH_S, TOLERANCE, correction
from procedures.range_places import Places
from procedures.range_scenes import conditions
from procedures.roughness_statistics import COLUMNS, ECHOES
from procedures.study_ground import fractal, terrain_file
from sim.accuracy import Accuracy
from sim.chain import Chain
from sim.constants import SPEED_OF_LIGHT_M_PER_S
from sim.draws import Draws
from sim.laser import beam_sigma_m
from sim.rfm import loops
from sim.scene import parse_scene
from sim.terrain import Surface, tilted
from sim.terrain_grid import Grid

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.delay_curve import DelayCurve
    from procedures.footprint_moments import Disc
    from procedures.local_draws import LocalDraws
    from procedures.pulse_library import Matches, PulseLibrary
    from sim.converter import Quantizer
    from sim.rfm import RangeFinder
    from sim.scene import Scene

CASES = ("free", "night", "day")
TURN_DEG = 36.0
"""From the azimuth of one terrain's tilt to the next one's."""
MARGIN = 4.9
"""Standard deviations of the beam that no footprint lies nearer to an edge: room for the jitter."""
_WHOLE = 0.999
_OF_PULSE = 0.1
_SHOWN_M = 40.0
"""Of ground about the roughest footprint, on either side."""


@lru_cache(maxsize=4)
def library_of(scene: str) -> PulseLibrary:
    """Return the library of a scene."""
    return pulse_library(parse_scene(scene))


def over_fractal(
    scene: str,
    level: int,
    height_factor: float,
    ground_seed: int,
    tilt_deg: float,
    per_side: int,
    cases: list[str],
    reflectances: list[float],
    by_beam: bool,
    seed: int,
    number: int,
) -> dict[str, NDArray[Any]]:
    """Follow footprints over one fractal, tilted.

    Parameters
    ----------
    scene : str
        TOML: instrument and altitude; reflectance of the library.
    level, ground_seed : int
        Of `procedures.study_ground.fractal`.
    height_factor : float
        By which its heights are multiplied.
    tilt_deg : float
        Of the plane that is added.
    per_side : int
        Footprints along each side.
    cases : list of str
        Out of `CASES`.
    reflectances : list of float
        Of the ground.
    by_beam : bool
        As in `procedures.footprint_moments.disc`.
    seed, number : int
        Key of the draws.

    Returns
    -------
    dict
        Those of `footprints`.
    """
    flat = fractal(level, ground_seed).relief
    assert isinstance(flat, Grid)
    higher = replace(flat, values=height_factor * flat.values)
    relief = tilted(Surface("fractal", relief=higher), tilt_deg, TURN_DEG * level).relief
    assert isinstance(relief, Grid)
    return footprints(scene, relief, per_side, cases, reflectances, by_beam, Draws(seed, number))


def over_terrain(
    scene: str,
    path: str,
    content: str,
    rows: tuple[int, int],
    columns: tuple[int, int],
    cases: list[str],
    reflectances: list[float],
    by_beam: bool,
    seed: int,
    number: int,
) -> dict[str, NDArray[Any]]:
    """Follow footprints over a block of posts of a terrain model."""
    piece = terrain_block(_terrain(path, content), rows, columns)
    return footprints(scene, piece, None, cases, reflectances, by_beam, Draws(seed, number))


@lru_cache(maxsize=1)
def _terrain(path: str, content: str) -> Grid:
    """A terrain model, read once by a worker; `content` tells apart what the same path held."""
    relief = terrain_file(path).relief
    assert isinstance(relief, Grid)
    return relief


def terrain_block(relief: Grid, rows: tuple[int, int], columns: tuple[int, int]) -> Grid:
    """Cut a block of posts out, its heights about the middle of their range."""
    part = np.s_[rows[0] : rows[1], columns[0] : columns[1]]
    known = None if relief.known is None else relief.known[part]
    values = relief.values[part]
    inside = values if known is None else values[known]
    datum_m = float(inside.min() + inside.max()) / 2
    middle = (size // 2 for size in values.shape)
    return _with_nadir_at(Grid(values - datum_m, relief.spacing_m, 0.0, 0.0, known), *middle)


def footprints(
    scene: str,
    relief: Grid,
    per_side: int | None,
    cases: list[str],
    reflectances: list[float],
    by_beam: bool,
    draws: Draws,
) -> dict[str, NDArray[Any]]:
    """Describe footprints, detect their echoes, and match them with the library.

    Parameters
    ----------
    relief : Grid
        The ground.
    per_side : int or None
        None: as many footprints as fit side by side.

    Returns
    -------
    dict
        ``spacing_m`` between posts. Of shape (n,), footprints with data everywhere, maybe none: ``slope_deg,
        azimuth_deg, roughness_m, skewness, raw_skewness``. Of shape
        (reflectances, cases, n): ``width_s, amplitude`` (factor of the library's pulse), ``msr_v2,
        library_deg, library_azimuth_deg``, ``pulse_msr_v2`` (of samples where the best pulse is above a tenth
        of its peak), ``largest_v2`` (largest squared residual), ``timed_msr_v2, timed_deg`` (of the best
        pulse that is not moved, its plane through the middle of the footprint); zero width where the echo was
        not detected. ``example_*``: what belongs to the footprint with the largest MSR of the first case and
        reflectance.
    """
    read = parse_scene(scene)
    along_m, across_m = beam_sigma_m(read.laser, read.altitude_m)
    posts = disc(relief.spacing_m, along_m, across_m=across_m, by_beam=by_beam)
    row, column = even_places(relief, MARGIN * along_m, per_side, 4 * along_m)
    found, whole = described(relief, row, column, posts)
    beam = disc(relief.spacing_m, along_m, across_m=across_m, by_beam=True)
    light_m, lit = _light(relief, row, column, beam)
    whole &= lit > _WHOLE
    row, column, light_m = row[whole], column[whole], light_m[whole]
    told = {name: getattr(found, name)[whole] for name in COLUMNS}
    told["spacing_m"] = np.array(relief.spacing_m)
    shape = (len(reflectances), len(cases), row.size)
    results = {name: np.zeros(shape) for name in ECHOES}
    if not row.size:
        return told | results
    if relief.known is not None:
        relief = _with_nadir_at(relief, int(row[row.size // 2]), int(column[row.size // 2]))
    chain = Chain(read, Accuracy(TOLERANCE), Surface("dtm", relief=relief, albedo=1.0))
    curve, finder = correction(read), chain.range_finder
    at = _places(relief, row, column, light_m)
    drawn = local_draws(chain, at, float(curve.at(MIDDLE_WIDTH_S)), draws)
    quantizer = chain.receiver.quantizer
    middle_s = -2 / SPEED_OF_LIGHT_M_PER_S * relief.values[row, column]
    example: dict[str, NDArray[Any]] = {}
    for first, second in np.ndindex(*shape[:2]):
        windows = _windows(read, drawn, cases[second], reflectances[first], quantizer)
        centre, width = _detected(windows, drawn, finder, curve)
        used = np.where(width > 0, centre, drawn.middle)
        cut = _cut(windows, drawn, used, finder)
        library = library_of(scene)
        matched = best_matches(library, *cut)
        # From the first sample of each correlation window.
        zero_s = middle_s - drawn.first_s + cut[1] - drawn.interval_s * used
        timed = timed_matches(library, cut[0], zero_s)
        off_v = cut[0] - _best_v(library, cut[1], cut[0].shape[1], matched)
        there = width > 0
        results["width_s"][first, second] = drawn.interval_s * width
        results["msr_v2"][first, second] = matched.msr_v2
        results["pulse_msr_v2"][first, second] = _pulse_msr_v2(cut[0] - off_v, off_v)
        results["largest_v2"][first, second] = (off_v**2).max(axis=1)
        results["library_deg"][first, second] = library.slope_deg[matched.pulse]
        results["library_azimuth_deg"][first, second] = library.azimuth_deg[matched.pulse]
        results["timed_msr_v2"][first, second] = timed.msr_v2
        results["timed_deg"][first, second] = library.slope_deg[timed.pulse]
        results["amplitude"][first, second] = matched.factor
        if not example:
            worst = int(np.argmax(np.where(there, matched.msr_v2, -1.0)))
            example = _example(scene, relief, (row, column), worst, cut, matched, told)
    return told | results | example


def _with_nadir_at(relief: Grid, row: int, column: int) -> Grid:
    """The same ground with a post at (0, 0), where a chain is planned: there must be light."""
    return replace(relief, x_min_m=-relief.spacing_m * column, y_min_m=-relief.spacing_m * row)


def _windows(
    scene: Scene, drawn: LocalDraws, case: str, reflectance: float, quantizer: Quantizer
) -> NDArray[np.float64]:
    """Samples about the echoes; without noise also without a converter and without jitter."""
    if case == "free":
        return reflectance * drawn.still_v
    noise_v = noise_rms_v(scene, case, reflectance)
    volts = drawn.windows(reflectance, noise_v)
    counts = quantizer.counts(volts.reshape(-1))[0].reshape(volts.shape)
    return (counts.astype(np.float64) - quantizer.zero_count) * quantizer.volts_per_count


def noise_rms_v(scene: Scene, case: str, reflectance: float) -> float:
    """Return the stationary noise of a case, V."""
    return next(
        one.noise_rms_v
        for one in conditions(scene, (reflectance,))
        if one.light == case and one.distance == "mean"
    )


def _detected(
    windows: NDArray[np.float64], drawn: LocalDraws, finder: RangeFinder, curve: DelayCurve
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centre and width of the candidate nearest to the truth, samples; 0 where that is more than 10 m off."""
    use, found = loops(), np.zeros((len(windows), 2))
    for row, volts, first_s, true_s in zip(found, windows, drawn.first_s, drawn.true_s, strict=True):
        lags = use.find(volts, 0.0, finder.bank, finder.candidate_count, finder.exclusion_samples)
        if not lags.size:
            continue
        size, steps = finder.correlation_window_samples, finder.refinement_steps
        pulses = use.refine(volts, 0.0, lags, finder.bank.widths, size, steps)[:, :2]
        arrival_s = first_s - true_s + drawn.interval_s * pulses[:, 0]
        off_m = np.abs(corrected_m(curve, arrival_s, drawn.interval_s * pulses[:, 1]))
        if off_m.min() <= FALSE_M:
            row[:] = pulses[np.argmin(off_m)]
    return found[:, 0], found[:, 1]


def _cut(
    windows: NDArray[np.float64], drawn: LocalDraws, centre: NDArray[np.float64], finder: RangeFinder
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Correlation windows about pulses, and where the pulses are in them, s from the first sample."""
    size = finder.correlation_window_samples
    first = np.clip(np.round(centre).astype(np.int64) - size // 2, 0, windows.shape[1] - size)
    samples = np.take_along_axis(windows, first[:, None] + np.arange(size), axis=1)
    return samples, drawn.interval_s * (centre - first)


def _best_v(
    library: PulseLibrary, arrival_s: NDArray[np.float64], size: int, matched: Matches
) -> NDArray[np.float64]:
    """The best pulses at the samples, V."""
    times_s = library.interval_s * np.arange(size) - (arrival_s + matched.shift_s)[:, None]
    return matched.factor[:, None] * library.at(matched.pulse, times_s)[0]


def _pulse_msr_v2(best_v: NDArray[np.float64], off_v: NDArray[np.float64]) -> NDArray[np.float64]:
    counts = best_v > _OF_PULSE * best_v.max(axis=1)[:, None]
    left = np.where(counts, off_v**2, 0.0)
    return np.asarray(left.sum(axis=1) / np.maximum(counts.sum(axis=1), 1))


def _light(
    relief: Grid, row: NDArray[np.int64], column: NDArray[np.int64], beam: Disc
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean height under the beam, m, and the share of it on ground with data."""
    heights, lit = np.empty(row.size), np.ones(row.size)
    for begin in range(0, row.size, 512):
        part = slice(begin, begin + 512)
        at = row[part, None] + beam.rows, column[part, None] + beam.columns
        heights[part] = relief.values[at] @ beam.weights
        if relief.known is not None:
            lit[part] = relief.known[at] @ beam.weights
    return heights, lit


def _places(
    relief: Grid, row: NDArray[np.int64], column: NDArray[np.int64], light_m: NDArray[np.float64]
) -> Places:
    centre_m = np.stack(
        [relief.x_min_m + relief.spacing_m * column, relief.y_min_m + relief.spacing_m * row], axis=1
    )
    true_s = -2 / SPEED_OF_LIGHT_M_PER_S * light_m
    nothing = np.zeros(row.size)
    return Places(centre_m, np.zeros(row.size, dtype=np.int64), *(4 * (true_s,)), nothing, nothing)


def _example(
    scene: str,
    relief: Grid,
    posts: tuple[NDArray[np.int64], NDArray[np.int64]],
    worst: int,
    cut: tuple[NDArray[np.float64], NDArray[np.float64]],
    matched: Matches,
    told: dict[str, NDArray[Any]],
) -> dict[str, NDArray[Any]]:
    """Ground, samples and best pulse of one footprint."""
    library, samples, arrival_s = library_of(scene), cut[0][worst], cut[1][worst]
    row, column = int(posts[0][worst]), int(posts[1][worst])
    reach = math.floor(_SHOWN_M / relief.spacing_m)
    times_s = library.interval_s * np.arange(samples.size) - arrival_s
    best = _best_v(library, cut[1], samples.size, matched)[worst]
    return {
        "example_heights_m": _square(relief.values, row, column, reach),
        "example_spacing_m": np.array(relief.spacing_m),
        "example_samples_v": samples,
        "example_best_v": best,
        "example_time_s": times_s,
        "example_slopes_deg": np.array([told["slope_deg"][worst], library.slope_deg[matched.pulse[worst]]]),
        "example_roughness_m": np.array(told["roughness_m"][worst]),
        "example_msr_v2": np.array(matched.msr_v2[worst]),
    }


def _square(values: NDArray[np.float64], row: int, column: int, reach: int) -> NDArray[np.float64]:
    """Posts about one; NaN beyond the terrain."""
    padded = np.pad(values, reach, constant_values=np.nan)
    return padded[row : row + 2 * reach + 1, column : column + 2 * reach + 1]
