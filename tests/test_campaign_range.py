"""Range campaign: the fast way against the slow and obvious one, stage by stage, and the command."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs
from scipy.stats import poisson

from belahil.campaign_run import CampaignPlan
from belahil.chunks import ChunkStore, ThisProcess, results_of_job, run_chunks, work
from belahil.cli.main import main
from belahil.errors import RefusedInput
from procedures import range_chunks, range_ground, range_parts, range_places
from procedures.arrival_gradient import VALID_SNR, fit_gradient, linear_errors
from procedures.campaign_range import RangeOptions, plan
from procedures.echo_hits import FALSE_M, corrected_m, echo_hits
from procedures.footprint_planes import EDGE, footprint_planes
from procedures.local_draws import LocalDraws, local_draws
from procedures.noise_clusters import LevelLaws, NoiseClusters, fit_clusters
from procedures.noise_colour import autocorrelation
from procedures.noise_tilt import MOST, UNTILTED, fitting_tilt, tilted_noise
from procedures.range_ground import GroundKey, Strips, flat_terrains
from procedures.range_histograms import EDGES, histogram, worth
from procedures.range_places import Places, described, footprints, places, serving
from procedures.range_points import Drawn, Point, collected
from procedures.range_scenes import (
    DISTANCES_AU,
    RISE,
    Condition,
    base_scene,
    cell_scene,
    conditions,
    noise_scene,
    text_dark_rms_v,
)
from procedures.range_statistics import (
    CHANCE,
    CellDraws,
    brute_cell,
    conditional_pfd,
    fast_pfd,
    linear_spread,
    weighted_rms,
)
from procedures.range_table import cell_draws
from procedures.window_peaks import piece_peaks, refined, window_peaks
from sim.accuracy import Accuracy
from sim.chain import Chain
from sim.constants import SPEED_OF_LIGHT_M_PER_S
from sim.draws import Draws
from sim.rfm import RangeFinder, loops
from sim.scene import as_toml
from sim.terrain_grid import Grid
from sim.terrain_statistics import plane_fit
from sim.terrain_synthesis import fractional_brownian

SIGMAS = 4.5
"""Standard errors within which chance stays, in all but some 1e-5 of cases."""


@lru_cache(maxsize=4)
def rough_heights(seed: int, posts: int = 181) -> np.ndarray:
    heights = fractional_brownian(posts, 0.8, np.random.default_rng(seed))
    return 2.0 * heights / heights.std()


@lru_cache(maxsize=1)
def flats() -> tuple[Grid, ...]:
    return tuple(Grid(rough_heights(seed), 1.5, 0.0, 0.0) for seed in (1, 2, 3))


def strips(slope_deg: float = 10.0) -> Strips:
    return Strips(flats(), slope_deg)


def on(ground: Strips, sigma_m: float, slopes_deg: tuple[float, float], count: int, seed: int) -> Places:
    planes = ground.planes(described(ground.flats, sigma_m))
    return places(serving(ground, planes, slopes_deg), count, Draws(seed, 0))


@lru_cache(maxsize=8)
def drawn(altitude_m: float, count: int, seed: int, repeats: int = 1) -> tuple[Chain, LocalDraws]:
    scene = base_scene(altitude_m)
    chain = Chain(scene, Accuracy(1e-3), strips().surface)
    at = on(strips(), 12.5e-6 * altitude_m, (5.0, 15.0), count, seed)
    curve = range_chunks.correction(scene)
    return chain, local_draws(chain, at, float(curve.at(50e-9)), Draws(seed, 1), repeats)


# ---- ground


@pytest.mark.parametrize("by_beam", [False, True])
@pytest.mark.parametrize(("sigma_m", "tilt"), [(6.25, 0.0), (10.0, 0.3)])
def test_planes_under_footprints_are_those_of_a_fit_to_each(
    sigma_m: float, tilt: float, by_beam: bool
) -> None:
    # given relief on a slope, far above the datum
    x = 1.5 * np.arange(181)
    relief = Grid(rough_heights(3) + tilt * x + 300.0, 1.5, 0.0, 0.0)

    found = footprint_planes(relief, sigma_m, 5 * sigma_m, by_beam=by_beam)

    # then at any post they are what a fit of this footprint alone finds
    for row, column in np.random.default_rng(1).integers(0, found.light_m.shape[0], (6, 2)):
        i, j = row + found.margin, column + found.margin
        squares = (x - x[j]) ** 2 + (x[:, None] - x[i]) ** 2
        beam = np.where(squares <= (4.5 * sigma_m) ** 2, np.exp(-0.5 * squares / sigma_m**2), 0.0)
        weights = beam if by_beam else (squares <= (EDGE * sigma_m) ** 2).astype(float)
        fit = plane_fit(x[None, :] - x[j], x[:, None] - x[i], relief.values, weights)
        assert found.gradient[0][row, column] == pytest.approx(fit.gradient[0], abs=1e-9)
        assert found.gradient[1][row, column] == pytest.approx(fit.gradient[1], abs=1e-9)
        assert found.roughness_m[row, column] == pytest.approx(fit.roughness_m, rel=1e-6)
        assert found.plane_m[row, column] == pytest.approx(fit.centre_m[2], abs=1e-7)
        light_m = (beam * relief.values).sum() / beam.sum()
        assert found.light_m[row, column] == pytest.approx(light_m, abs=1e-7)
        assert found.centre_m[row, column] == relief.values[i, j]


def test_a_footprint_that_crosses_the_edge_is_refused() -> None:
    with pytest.raises(RefusedInput, match="margin"):
        footprint_planes(Grid(np.zeros((50, 50)), 1.5, 0.0, 0.0), 6.25, 10.0)


@pytest.mark.parametrize("slopes", [(9.0, 11.0), (2.0, 4.0), (15.0, 20.0)])
def test_places_have_the_slope_and_their_own_true_time(slopes: tuple[float, float]) -> None:
    ground = strips(sum(slopes) / 2)

    at = on(ground, 8.0, slopes, 20, 5)

    assert np.array_equal(np.bincount(at.strip), [20, 20, 20])
    assert ((at.slope_deg >= slopes[0]) & (at.slope_deg <= slopes[1])).all()
    # and the light of a place comes when its mean height says
    whole = ground.surface.relief
    assert isinstance(whole, Grid)
    x, y = whole.posts()
    for n in (0, 25, 59):
        squares = (x - at.centre_m[n, 0]) ** 2 + (y[:, None] - at.centre_m[n, 1]) ** 2
        beam = np.where(squares <= (4.5 * 8.0) ** 2, np.exp(-0.5 * squares / 64.0), 0.0)
        mean_m = (beam * whole.values).sum() / beam.sum()
        assert at.true_s[n] == pytest.approx(-2 * mean_m / SPEED_OF_LIGHT_M_PER_S, abs=1e-15)


def test_a_slope_that_does_not_occur_is_refused_with_those_that_do() -> None:
    with pytest.raises(RefusedInput, match=r"10 to 10 deg"):
        footprints(asdict(GroundKey("plane")), (8.0, 8.0), (20.0, 22.0), 5, Draws(1, 0))


@pytest.mark.parametrize(("gradient", "sigma_m"), [((0.2, -0.1), 6.25), ((0.0, 0.5), 9.0)])
def test_a_tilt_afterwards_is_a_tilt_before(gradient: tuple[float, float], sigma_m: float) -> None:
    flat = flats()[0]
    x, y = flat.posts()
    before = Grid(flat.values + gradient[0] * x + (gradient[1] * y)[:, None], 1.5, 0.0, 0.0)
    one, tilted = (footprint_planes(grid, sigma_m, 5 * sigma_m) for grid in (flat, before))
    inner = slice(one.margin, x.size - one.margin)
    found = one.tilted(gradient, x[inner], y[inner])
    for name in ("light_m", "centre_m", "plane_m", "roughness_m"):
        assert getattr(found, name) == pytest.approx(getattr(tilted, name), abs=1e-6)
    assert found.slope_deg == pytest.approx(tilted.slope_deg, abs=1e-9)


@pytest.mark.slow
def test_a_factor_scales_the_fractals_and_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(range_ground, "LEVELS", 1)
    forget_grounds()
    rough = [flat_terrains("fractal", 5, factor)[0].values for factor in (1.0, 2.0)]
    forget_grounds()
    assert rough[1] == pytest.approx(2 * rough[0], rel=1e-12)


# ---- noise that the text implies


def test_noon_raises_the_noise_by_eighty_percent_at_the_mean_reflectance() -> None:
    scene = base_scene()
    for distance in DISTANCES_AU:
        cells = conditions(scene, (0.17,), (distance,))
        day, night = (next(one for one in cells if one.light == light) for light in ("day", "night"))
        assert day.noise_rms_v / night.noise_rms_v == pytest.approx(RISE, rel=1e-12)
        assert night.noise_rms_v == pytest.approx(text_dark_rms_v(scene, distance), rel=1e-12)
    # and at mean distance that is 0.83 mV (closed form: see sim.light_noise)
    assert text_dark_rms_v(scene) == pytest.approx(0.83e-3, abs=0.01e-3)


@pytest.mark.parametrize("altitude_m", [500e3, 1400e3])
def test_conditions_have_the_noise_of_their_chains(altitude_m: float) -> None:
    scene = structs.replace(
        base_scene(altitude_m), surface=structs.replace(base_scene().surface, kind="plane")
    )
    for one in conditions(scene, distances=tuple(DISTANCES_AU)):
        assert Chain(cell_scene(scene, one)).noise_rms_v == pytest.approx(one.noise_rms_v, rel=1e-6)


# ---- peaks


@pytest.mark.parametrize(("height", "seed"), [(0.0, 1), (4.0, 2), (20.0, 3)])
def test_pieces_have_the_peaks_that_the_range_finder_finds(height: float, seed: int) -> None:
    # given noise with a pulse in the middle of each piece
    finder, draws = RangeFinder.of(base_scene().receiver_spec), np.random.default_rng(seed)
    reach = finder.bank.reach
    pieces = np.apply_along_axis(np.convolve, 1, draws.standard_normal((60, 300)), np.ones(3), mode="same")
    pieces += height * np.exp(-0.5 * ((np.arange(300) - 150) / 2.0) ** 2)
    near = (reach, 299 - reach)

    found = piece_peaks(finder, pieces, near, 4)

    # then they are those of a search of the piece, as far as its edge bears on none
    for n, piece in enumerate(pieces):
        theirs = loops().find(piece, 0.0, finder.bank, 12, finder.exclusion_samples)
        inside = np.abs(theirs - 150) < 150 - reach - 2 * finder.exclusion_samples
        best = [lag for lag, ok in zip(theirs, inside, strict=True) if ok][:1]
        if best and theirs[0] == best[0]:
            assert found.lag[n, 0] == best[0]
            bells = finder.bank.templates.astype(float)
            scores = bells @ piece[best[0] - reach : best[0] + reach + 1]
            assert found.score[n, 0] == pytest.approx(scores.max(), rel=1e-5)
    # and what is refined is what the range finder refines
    centre, width, amplitude, first = refined(finder, pieces, found.lag)
    for n in range(0, 60, 7):
        alone = loops().refine(pieces[n], 0.0, found.lag[n], finder.bank.widths, 42, finder.refinement_steps)
        assert centre[n] == pytest.approx(alone[:, 0], abs=1e-6)
        assert width[n] == pytest.approx(alone[:, 1], rel=1e-9)
        assert amplitude[n] == pytest.approx(alone[:, 2], rel=1e-9)
        assert np.array_equal(first[n], alone[:, 3])


def test_a_window_without_peaks_has_scores_of_zero() -> None:
    finder = RangeFinder.of(base_scene().receiver_spec)
    assert np.array_equal(window_peaks(finder, np.full(500, 3e-3), 8), np.zeros(8))


# ---- the law of noise peaks


@pytest.mark.parametrize(("a", "b", "seed"), [(7.4, 0.5, 1), (7.6, 1.0, 2), (6.0, 0.7, 3)])
def test_the_law_is_found_again_in_peaks_that_follow_it(a: float, b: float, seed: int) -> None:
    # given points of a Poisson process with that mean
    draws = np.random.default_rng(seed)
    levels = np.cumsum(draws.exponential(size=(3000, 8)), axis=1)
    scores = np.sqrt(2 * (a - np.log(levels)) / b)

    law = fit_clusters(2e-3 * scores, 2e-3)

    assert abs(law.a - a) < SIGMAS * law.a_u
    assert abs(law.b - b) < SIGMAS * law.b_u
    # and the uncertainties are those of fits to parts of them
    parts = [fit_clusters(part, 1.0) for part in np.split(scores, 60)]
    spread = np.std([one.a for one in parts]) / np.sqrt(60)
    assert spread == pytest.approx(law.a_u, rel=SIGMAS / np.sqrt(2 * 60))


@pytest.mark.slow
def test_a_law_between_levels_is_that_of_noise_at_that_level() -> None:
    # given the same noise at three levels, rounded to counts
    levels_v = (0.6e-3, 1.0e-3, 3e-3)
    rows = range_chunks.noise_peaks(as_toml(noise_scene(base_scene())), levels_v, 400, 5, 0)["score_v"]
    ends = LevelLaws(tuple(fit_clusters(rows[k], levels_v[k]) for k in (0, 2)))
    own, between = fit_clusters(rows[1], levels_v[1]), ends.at(levels_v[1])
    # then the law between the outer two is that of the middle one, to 1 % in the number of peaks
    u = np.linspace(4.5, 6.0, 4) * levels_v[1]
    assert between.above(u) == pytest.approx(own.above(u), rel=0.02)
    assert ends.at(levels_v[0]).b == pytest.approx(fit_clusters(rows[0], levels_v[0]).b)
    assert ends.at(1.0).b == pytest.approx(fit_clusters(rows[2], levels_v[2]).b)


@pytest.mark.parametrize("others", [-1, 0, 1, 3])
def test_a_score_is_kept_as_often_as_few_peaks_are_larger(others: int) -> None:
    law = NoiseClusters(1e-3, 7.4, 0.5, 0.0, 0.0, 0.0, 100)
    score_v = np.array([0.0, 3e-3, 5e-3, 8e-3])

    kept = law.kept(score_v, others, 0.9)

    expected = poisson.cdf(others, 0.9 * np.exp(7.4 - 0.25 * (1e3 * score_v) ** 2))
    assert kept == pytest.approx(expected, abs=1e-12)


def test_too_few_peaks_are_refused() -> None:
    with pytest.raises(RefusedInput, match="20 windows"):
        fit_clusters(np.ones((19, 8)), 1.0)


# ---- linear propagation


@pytest.mark.parametrize(("altitude_m", "seed"), [(500e3, 1), (1100e3, 2)])
def test_gradients_are_those_of_the_fit(altitude_m: float, seed: int) -> None:
    # given echoes of relief, which are no Gaussians
    chain, draws = drawn(altitude_m, 2, seed)
    finder, size = chain.range_finder, 42
    first = draws.middle - size // 2
    volts = draws.echo_v[:, first : first + size].copy()
    lag = np.array([size // 2])

    def fit(samples: np.ndarray) -> np.ndarray:
        return loops().refine(samples, 0.0, lag, finder.bank.widths, size, 40)[0]

    fits = np.array([fit(row) for row in volts])
    by_centre, by_width = fit_gradient(
        volts, np.tile(np.arange(size), (len(volts), 1)), fits[:, 0], fits[:, 1], fits[:, 2]
    )
    # then a small change of a sample moves the fit as they say, to the square of the change
    for n in range(len(volts)):
        step = 1e-4 * volts[n].max()
        for i in (12, 19, 21, 24, 30):
            ends = []
            for sign in (1, -1):
                moved = volts[n].copy()
                moved[i] += sign * step
                ends.append(fit(moved))
            centre, width = (ends[0] - ends[1])[:2] / (2 * step)
            assert by_centre[n, i] == pytest.approx(centre, rel=1e-3, abs=1e-5 * np.abs(by_centre[n]).max())
            expected = width / fits[n, 1]
            assert by_width[n, i] == pytest.approx(expected, rel=1e-3, abs=1e-5 * np.abs(by_width[n]).max())


@pytest.mark.parametrize(("reflectance", "noise_rms_v"), [(1.0, 0.8e-3), (1.0, 4e-3), (0.3, 0.8e-3)])
def test_linear_propagation_is_the_spread_that_noise_makes(reflectance: float, noise_rms_v: float) -> None:
    # given draws about echoes well above their noise
    chain, draws = drawn(500e3, 400, 3)
    finder, curve = chain.range_finder, range_chunks.correction(chain.scene)
    linear = linear_errors(draws, finder, curve, autocorrelation(chain.scene, 42))
    spread = linear_spread(linear, reflectance, noise_rms_v, 0.0)
    assert spread.snr > VALID_SNR
    # when the range finder finds them in noise
    hits = echo_hits(draws, reflectance, noise_rms_v, 1e-7, finder, curve)
    errors_m = corrected_m(curve, hits.arrival_s[:, 0], hits.width_s[:, 0])
    of_noise = errors_m - linear.moved_m[draws.of_echo]
    # then its errors spread as the propagation says: chance, and 5 % for what is not linear
    allowed = SIGMAS / np.sqrt(2 * of_noise.size) + 0.05
    assert hits.hit[:, 0].all()
    assert abs(np.log(of_noise.std() / spread.noise_m)) < allowed
    assert abs(np.log(errors_m.std() / spread.total_m)) < allowed
    # and shot by shot they are those of its own noise, to what is not linear
    own = linear.chance_m(reflectance, noise_rms_v)
    assert np.corrcoef(own, of_noise)[0, 1] > 0.95
    assert own.std() == pytest.approx(spread.noise_m, rel=SIGMAS / np.sqrt(2 * own.size))


def test_shot_noise_has_the_variance_of_its_steps() -> None:
    _, draws = drawn(800e3, 400, 4)
    expected = (draws.shot_variance @ draws.shot_taps**2).mean(axis=0)
    bright = expected > 0.05 * expected.max()
    ratio = (draws.shot_v**2).mean(axis=0)[bright] / expected[bright]
    assert np.abs(ratio - 1).max() < SIGMAS * np.sqrt(2 / len(draws.shot_v))


# ---- the fast way against the slow


PLANE = asdict(GroundKey("plane"))


def plane_chunk(
    scene: str, cells: list[Condition], count: int, seed: int, repeats: int = 1
) -> dict[str, np.ndarray]:
    return range_chunks.echo_draws(
        scene, PLANE, (9.0, 11.0), [asdict(one) for one in cells], count, repeats, seed, 0
    )


def draws_of(made: dict[str, np.ndarray], row: int, scene) -> CellDraws:  # type: ignore[no-untyped-def]
    point = Drawn("table", "", scene, (9.0, 11.0), (), made)
    return cell_draws(point, row, range_chunks.correction(scene), 0.0)


@lru_cache(maxsize=1)
def noise(levels_v: tuple[float, ...], windows: int) -> np.ndarray:
    return range_chunks.noise_peaks(as_toml(noise_scene(base_scene())), levels_v, windows, 99, 0)["score_v"]


@pytest.mark.slow
def test_fast_probabilities_are_the_conditional_ones_and_those_of_whole_shots() -> None:
    # given cells from hardly any to nearly only false detections
    scene = base_scene(1100e3)
    cells = list(conditions(scene, (0.08, 0.17, 0.30)))
    levels_v = tuple(sorted({one.noise_rms_v for one in cells}))
    scores = dict(zip(levels_v, noise(levels_v, 600), strict=True))
    made = plane_chunk(as_toml(scene), cells, 900, 7)
    seen = []
    for row, one in enumerate(cells):
        draws, rows = draws_of(made, row, scene), scores[one.noise_rms_v]
        # when the law is fitted to one half of the windows and the other half is taken as it is
        fast = fast_pfd(draws, fit_clusters(rows[:300], one.noise_rms_v))
        conditional = conditional_pfd(draws, rows[300:])
        # then both agree as far as the windows tell, and within 5 % or half a point
        chance = SIGMAS * np.hypot(conditional.standard_uncertainty, fast.standard_uncertainty)
        assert abs(fast.value - conditional.value) < chance
        if 1e-4 < conditional.value < 0.3:
            whole = conditional_pfd(draws, rows)
            allowed = 0.05 * whole.value + SIGMAS * whole.standard_uncertainty
            assert abs(fast_pfd(draws, fit_clusters(rows, one.noise_rms_v)).value - whole.value) < allowed
        elif 0.3 <= conditional.value <= 0.997:
            assert abs(fast.value - conditional.value) < 0.005 + SIGMAS * conditional.standard_uncertainty
        seen.append(conditional.value)
    assert min(seen) < 0.01 < 0.3 < max(seen)
    # and whole shots have the same share of false ones, and the same errors
    row = 1
    whole = range_chunks.whole_shots(as_toml(scene), PLANE, (9.0, 11.0), asdict(cells[row]), 900, 8, 0)
    law = fit_clusters(scores[cells[row].noise_rms_v], cells[row].noise_rms_v)
    fast, brute = fast_pfd(draws_of(made, row, scene), law), brute_cell(whole["error_m"], 0.0)
    apart = np.hypot(fast.standard_uncertainty, brute.pfd.standard_uncertainty)
    assert abs(fast.value - brute.pfd.value) < SIGMAS * apart
    draws = draws_of(made, row, scene)
    spread = weighted_rms(draws.error_m, draws.weights(law))
    assert spread is not None
    assert brute.spread is not None
    apart = np.hypot(spread.standard_uncertainty, brute.spread.standard_uncertainty)
    assert abs(spread.value - brute.spread.value) < SIGMAS * apart


@pytest.mark.slow
@pytest.mark.parametrize("tilt", [1.0, MOST])
def test_tilted_noise_tells_the_same_with_its_weights(tilt: float) -> None:
    # given the same faint echoes with noise as it is and tilted towards peaks
    chain, plain = drawn(1400e3, 300, 6, 10)
    finder, curve = chain.range_finder, range_chunks.correction(chain.scene)
    tilted = tilted_noise(plain, autocorrelation(chain.scene, plain.unit.shape[1]), finder, tilt, Draws(6, 2))
    assert tilted.weight.max() < 1 / UNTILTED
    apart = SIGMAS * tilted.weight.std() / np.sqrt(tilted.weight.size)
    assert abs(tilted.weight.mean() - 1) < apart
    # when they are seen in noise that outbids most
    law = fit_clusters(noise((0.8e-3,), 400)[0], 0.8e-3)
    found = []
    for draws in (plain, tilted):
        hits = echo_hits(draws, 0.08, 0.8e-3, 0.49e-3, finder, curve)
        errors_m = corrected_m(curve, hits.arrival_s, hits.width_s)
        one = CellDraws(hits.hit, hits.score_v, hits.ahead, errors_m, draws.weight, 300)
        spread = weighted_rms(errors_m, one.weights(law), 300)
        assert spread is not None
        found.append((fast_pfd(one, law), spread))
    # then both tell the same, and the tilted ones tell the spread better
    for untilted, weighted in zip(*found, strict=True):
        apart = np.hypot(untilted.standard_uncertainty, weighted.standard_uncertainty)
        assert abs(untilted.value - weighted.value) < SIGMAS * apart
    assert found[1][1].standard_uncertainty < 0.8 * found[0][1].standard_uncertainty


def test_the_tilt_follows_what_an_echo_lacks() -> None:
    assert fitting_tilt(6.5) == 0.0
    assert 0 < fitting_tilt(4.0) < fitting_tilt(3.0) < fitting_tilt(0.0) == MOST
    chain, plain = drawn(500e3, 2, 1)
    assert tilted_noise(plain, np.ones(1), chain.range_finder, 0.0, Draws(1, 0)) is plain


@pytest.mark.parametrize("echoes", [40, 400])
def test_a_control_takes_off_chance_and_no_truth(echoes: int) -> None:
    # given errors that are nearly what is known of them
    draws, rms, plain = np.random.default_rng(echoes), [], []
    for _ in range(200):
        known = draws.standard_normal((echoes, 5))
        errors = 2 * known + 0.4 * draws.standard_normal((echoes, 5))
        control = (4 * known**2 - 4).sum(axis=1)
        weights = np.ones((5 * echoes, 1))
        better = weighted_rms(errors.reshape(-1, 1), weights, echoes, control)
        worse = weighted_rms(errors.reshape(-1, 1), weights, echoes)
        assert better is not None
        assert worse is not None
        rms.append((better.value, better.standard_uncertainty))
        plain.append(worse.standard_uncertainty)
    values, told = np.transpose(rms)
    # then the mean stays, the scatter is what is told, and it is smaller
    assert abs(values.mean() - np.sqrt(4.16)) < SIGMAS * values.std() / np.sqrt(200) + 0.02 / echoes
    assert values.std() == pytest.approx(told.mean(), rel=SIGMAS / np.sqrt(2 * 200) + 1 / echoes)
    assert told.mean() < 0.6 * np.mean(plain)


@pytest.mark.slow
def test_without_an_echo_only_chance_detects() -> None:
    # given ground so dark that nothing of it is seen
    scene = base_scene(1400e3)
    made = plane_chunk(as_toml(scene), [Condition("mean", "night", 1e-6, 0.8e-3)], 2000, 3)
    law = fit_clusters(noise((0.8e-3,), 400)[0], 0.8e-3)
    # then four candidates fall within 10 m as often as their number over the window says
    found = 1 - fast_pfd(draws_of(made, 0, scene), law).value
    # a refined peak wanders from its lag by a part of a sample: 10 % of the place
    expected_count = 2000 * CHANCE
    assert abs(found - CHANCE) < CHANCE * (0.1 + SIGMAS / np.sqrt(expected_count))


def test_a_condition_has_the_same_draws_alone_and_beside_others() -> None:
    text = as_toml(base_scene(800e3))
    cells = list(conditions(base_scene()))
    # given a tilt of the noise that does not follow the faintest of them
    every, one = (
        range_chunks.echo_draws(text, PLANE, (9.0, 11.0), [asdict(c) for c in some], 5, 2, 1, 0, 0.5)
        for some in (cells, cells[2:3])
    )
    for name in ("hit", "score_v", "ahead", "arrival_s", "width_s"):
        assert np.array_equal(every[name][2:3], one[name])
    assert np.array_equal(every["still_m"], one["still_m"])


def test_weights_give_the_nearer_hit_only_where_both_are_kept() -> None:
    law = NoiseClusters(1.0, 7.4, 0.5, 0.0, 0.0, 0.0, 100)
    hit = np.array([[True, True], [True, False], [False, False]])
    score_v, ahead = np.where(hit, [[6.0, 5.0]], 0.0), np.array([[0, 1], [0, 0], [0, 0]])
    draws = CellDraws(hit, score_v, ahead, np.zeros((3, 2)), np.ones(3), 3)
    kept, weights = draws.kept(law), draws.weights(law)
    assert weights.sum(axis=1) == pytest.approx(kept[:, 0])
    assert weights[0, 1] == kept[0, 1] > 0
    assert weights[1, 1] == weights[2].sum() == 0


@pytest.mark.parametrize(("sd", "count"), [(1.0, 500), (2.0, 5000)])
def test_a_brute_cell_tells_what_was_drawn(sd: float, count: int) -> None:
    draws = np.random.default_rng(count)
    true = draws.normal(0.3, sd, count)
    false = FALSE_M + draws.exponential(100.0, count // 4)
    cell = brute_cell(np.concatenate([true, false, [np.inf]]), 0.3)
    assert cell.shots == count + count // 4 + 1
    assert cell.pfd.value == pytest.approx((count // 4 + 1) / cell.shots)
    assert cell.spread is not None
    assert cell.spread.value == pytest.approx(sd, abs=SIGMAS * cell.spread.standard_uncertainty)
    assert cell.spread.standard_uncertainty == pytest.approx(sd / np.sqrt(2 * count), rel=0.15)


# ---- distributions


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_values_worth_their_weights_have_the_weighted_distribution(seed: int) -> None:
    # given draws of a wide normal distribution, weighted to a narrower one
    draws = np.random.default_rng(seed)
    values = 2.0 * draws.standard_normal((4000, 1))
    weights = np.exp(-0.5 * values**2 * (1 - 0.25))
    taken = worth(values, weights)
    assert taken.size == round(weights.sum() ** 2 / (weights**2).sum())
    assert taken.std() == pytest.approx(1.0, rel=SIGMAS / np.sqrt(2 * taken.size))
    # and with equal weights nothing changes
    assert np.array_equal(worth(values, np.ones(values.shape)), np.sort(values, axis=None))


@pytest.mark.parametrize(("tail", "normal"), [(30.0, True), (2.5, False)])
def test_a_distribution_with_tails_is_not_taken_for_normal(tail: float, normal: bool) -> None:
    values = np.random.default_rng(4).standard_t(tail, (3000, 1))
    if tail > 10:
        values = np.random.default_rng(4).standard_normal((3000, 1))
    found = histogram(5e5, "all by day", values, np.ones(values.shape), 1)
    assert found.p_value is not None
    assert (found.p_value > 1e-4) is normal
    assert found.rms_m == pytest.approx(values.std(), rel=1e-9)
    inside = np.abs(values - values.mean()) <= 4 * found.rms_m
    assert (found.density * np.diff(EDGES) * found.rms_m).sum() == pytest.approx(inside.mean(), abs=1e-9)


# ---- the campaign


def test_options_below_what_statistics_need_are_refused() -> None:
    with pytest.raises(RefusedInput, match="--noise-windows 5"):
        RangeOptions(noise_windows=5)


def test_a_plan_has_every_cell_once_and_every_window_of_noise_once() -> None:
    options = RangeOptions(("table",), echoes=3, sets=2, noise_windows=700, shots=4)
    chunks = plan(options).chunks
    noise_chunks = [one for one in chunks if one.work.endswith(":noise_peaks")]
    assert sum(one.given["windows"] for one in noise_chunks) == 700
    shots = [one for one in chunks if one.work.endswith(":whole_shots")]
    assert len({(one.given["scene"], str(one.given["condition"])) for one in shots}) == len(shots) == 24
    assert len(chunks) == len({one.key for one in chunks}) == 12 + 3 + 7 + 24
    # and first what many of them need: the correction, and the ground
    names = [one.work.partition(":")[2] for one in chunks]
    assert names[:12] == ["curve"] + 11 * ["fractal_heights"]
    assert names[12] == "noise_peaks"


def test_ground_and_correction_made_before_are_not_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a job whose first chunks were a fractal and the correction, in another process for all we know
    monkeypatch.setattr(range_ground, "LEVELS", 1)
    scene, store = base_scene(), ChunkStore(tmp_path)
    alone = flat_terrains.__wrapped__("fractal", 5, 1.0, 0.8), range_chunks.correction(scene)
    run_chunks([range_chunks.curve_chunk(scene), *range_ground.fractal_chunks(5, 0.8)], store, ThisProcess, 1)
    forget_grounds()
    range_chunks._curve.cache_clear()

    def never(*words: object) -> None:
        raise AssertionError("made again")

    monkeypatch.setattr(range_ground, "fractal", never)
    monkeypatch.setattr(range_chunks, "filter_delay_curve", never)
    # when a chunk of the job needs them, then it has them to the last bit, tilted and scaled as it likes
    with results_of_job(str(tmp_path)):
        (flat,) = flat_terrains("fractal", 5, 1.0)
        (twice,) = flat_terrains("fractal", 5, 2.0)
        read = range_chunks.correction(scene)
    assert np.array_equal(flat.values, alone[0][0].values)
    assert np.array_equal(twice.values, 2 * flat.values)
    assert read == alone[1]
    forget_grounds()


@pytest.mark.parametrize("shots", [1, 499, 500, 501, 1700])
def test_whole_shots_come_in_equal_parts_that_do_not_grow_with_their_number(shots: int) -> None:
    chunks = range_parts.brute_chunks(RangeOptions(("table",), shots=shots), 3)
    counts = [one.given["count"] for one in chunks]
    assert sum(counts) == 24 * shots
    assert max(counts) <= range_parts.SHOTS_IN_CHUNK
    assert max(counts) - min(counts) <= 1
    assert len({one.name for one in chunks}) == len({one.key for one in chunks}) == len(chunks)


def test_parts_of_a_cell_share_no_shot_whatever_their_size(monkeypatch: pytest.MonkeyPatch) -> None:
    # given two parts of which the second is the smaller
    taken: list[np.ndarray] = []
    real = range_chunks.ShotRows.candidates

    def candidates(rows, shots, centres_m=None):  # type: ignore[no-untyped-def]
        taken.append(shots)
        return real(rows, shots, centres_m)

    monkeypatch.setattr(range_chunks.ShotRows, "candidates", candidates)
    cell = asdict(conditions(base_scene(500e3))[0])
    for number, count in ((0, 4), (1, 3)):
        range_chunks.whole_shots(as_toml(base_scene(500e3)), PLANE, (9.0, 11.0), cell, count, 1, number)
    assert not np.intersect1d(*taken).size


def forget_grounds() -> None:
    for one in (range_ground.flat_terrains, range_ground.strips, range_places._flat_planes):
        one.cache_clear()


def test_the_command_predicts_the_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # given two fractals in the place of eleven, and few points
    monkeypatch.setattr(range_ground, "LEVELS", 2)
    monkeypatch.setattr(range_parts, "STUDY_ALTITUDES_M", (500e3, 1200e3))
    monkeypatch.setattr(range_parts, "MAP_SLOPES_DEG", (5.0, 10.0))
    forget_grounds()
    out = tmp_path / "range"
    small = [
        "--parts",
        "table,altitude,map",
        "--echoes",
        "12",
        "--repeats",
        "2",
        "--sets",
        "1",
        "--noise-windows",
        "30",
        "--shots",
        "3",
        "--workers",
        "1",
    ]

    assert main(["campaign", "range", "--out", str(out), *small]) == 0

    told = capsys.readouterr().out
    assert told.count(" km  mean") == 24
    results = json.loads((out / "summary.json").read_text())["results"]
    rows = results["table"]["cells"]
    assert len(rows) == 48
    low, high = (rows[row]["pfd"]["value"] for row in (4, -12))
    assert low < high
    assert (out / "data.nc").is_file()
    assert (out / "report.html").is_file()
    # and going on with a finished campaign tells the same
    assert main(["campaign", "range", "--resume", str(out)]) == 0
    assert capsys.readouterr().out == told
    forget_grounds()


def test_a_receiver_of_other_filters_has_its_own_correction() -> None:
    scene = base_scene()
    slower = structs.replace(scene, electronics=structs.replace(scene.electronics, cutoff_hz=10e6))
    ours, later = range_chunks.correction(scene), range_chunks.correction(slower)
    assert float(later.at(60e-9)) > float(ours.at(60e-9)) + 5e-9
    assert range_chunks.correction(structs.replace(scene, filter="gaussian")).at(60e-9) == 0.0


def test_draws_about_dark_ground_are_refused() -> None:
    chain, _ = drawn(500e3, 2, 1)
    grey = Chain(chain.scene, Accuracy(1e-3), replace(chain.surface, albedo=0.5))
    at = on(strips(), 6.25, (5.0, 15.0), 1, 1)
    with pytest.raises(RefusedInput, match="reflectance of 1"):
        local_draws(grey, at, 17e-9, Draws(1, 0))


def test_sets_that_look_at_fewer_conditions_are_put_together_by_condition() -> None:
    # given a point of four sets, of which the second condition is in the first two alone
    cells = conditions(base_scene(500e3))[:2]
    point = Point(
        "table", "500 km", base_scene(500e3), cells, 3, 2, 4, 1, GroundKey("plane"), shares=(1.0, 0.5)
    )
    chunks = point.chunks()
    assert [len(one.given["conditions"]) for one in chunks] == [2, 2, 1, 1]
    results = [work(one.work, one.given) for one in chunks]
    found = collected(CampaignPlan(tuple(chunks), "", 1), results).points
    # then each condition has the draws of its own sets, row by row
    assert [one.conditions for one in found] == [(cells[0],), (cells[1],)]
    assert [one.arrays["still_m"].size for one in found] == [12, 6]
    for drawn, row, sets in ((found[0], 0, 4), (found[1], 1, 2)):
        own = np.concatenate([results[n]["arrival_s"][row] for n in range(sets)])
        assert np.array_equal(drawn.arrays["arrival_s"][0], own)
        assert drawn.arrays["weight"].size == drawn.arrays["arrival_s"].shape[1]
