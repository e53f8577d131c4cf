"""Other range finders, converters and beams in the range campaign: against whole shots, and part by part."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs
from scipy.interpolate import CubicSpline

from belahil.config import Interleave
from procedures.footprint_planes import EDGE, footprint_planes
from procedures.local_draws import LocalDraws, alternating, local_draws, mismatched
from procedures.noise_clusters import fit_clusters
from procedures.range_chunks import correction, echo_draws, noise_peaks, whole_shots
from procedures.range_constants import CONSTANTS, OTHER_GROUND
from procedures.range_ground import GroundKey
from procedures.range_places import footprints
from procedures.range_points import Drawn
from procedures.range_scenes import base_scene, conditions, noise_scene
from procedures.range_statistics import brute_cell, fast_pfd, weighted_rms
from procedures.range_table import cell_draws
from procedures.window_peaks import piece_peaks
from sim.accuracy import Accuracy
from sim.chain import Chain
from sim.draws import Draws
from sim.rfm import RangeFinder
from sim.scene import Scene, as_toml
from sim.scene_tables import RangeFinderTable
from sim.terrain_grid import Grid
from sim.terrain_statistics import plane_fit
from sim.terrain_synthesis import fractional_brownian

SIGMAS = 4.5
PLANE = asdict(GroundKey("plane"))
SLOPES = (9.0, 11.0)


def with_finder(scene: Scene, **keys: float) -> Scene:
    return structs.replace(scene, range_finder=structs.replace(RangeFinderTable(), **keys))


def with_interleave(scene: Scene, **keys: float) -> Scene:
    return structs.replace(
        scene, electronics=structs.replace(scene.electronics, interleave=Interleave(**keys))
    )


def about_echoes(scene: Scene, count: int = 6) -> LocalDraws:
    land, at = footprints(PLANE, (10.0, 10.0), SLOPES, count, Draws(1, 0))
    chain = Chain(scene, Accuracy(1e-3), land.surface)
    return local_draws(chain, at, 17e-9, Draws(1, 0), 2)


@pytest.mark.parametrize("other", ["range finder", pytest.param("electronics", marks=pytest.mark.slow)])
def test_the_fast_way_agrees_with_whole_shots_of_another_receiver(other: str) -> None:
    # given a range finder, or converters and a high-pass, far from the assumed ones, and no round beam
    scene = base_scene(1100e3)
    scene = structs.replace(
        scene, laser=structs.replace(scene.laser, beam="elliptical", ellipticity=0.3, beam_azimuth_deg=90.0)
    )
    if other == "range finder":
        scene = with_finder(
            scene, template_count=5, widest_s=150e-9, exclusion_samples=4, correlation_window_samples=64
        )
    else:
        scene = with_interleave(scene, gain=0.1, offset_v=2.5e-3)
        scene = structs.replace(scene, electronics=structs.replace(scene.electronics, highpass_hz=200e3))
    cell = next(one for one in conditions(scene) if (one.light, one.reflectance) == ("day", 0.30))
    rows = noise_peaks(as_toml(noise_scene(scene)), [cell.noise_rms_v], 300, 9, 0)["score_v"][0]
    law = fit_clusters(rows, cell.noise_rms_v)
    made = echo_draws(as_toml(scene), PLANE, SLOPES, [asdict(cell)], 600, 1, 7, 0)
    whole = whole_shots(as_toml(scene), PLANE, SLOPES, asdict(cell), 600, 8, 0)
    # then both have the same share of false ones, and the same errors
    draws = cell_draws(Drawn("table", "", scene, SLOPES, (), made), 0, correction(scene), 0.0)
    brute, fast = brute_cell(whole["error_m"], 0.0), fast_pfd(draws, law)
    assert 0.03 < brute.pfd.value < 0.97
    apart = np.hypot(fast.standard_uncertainty, brute.pfd.standard_uncertainty)
    assert abs(fast.value - brute.pfd.value) < SIGMAS * apart
    spread = weighted_rms(draws.error_m, draws.weights(law))
    assert spread is not None
    assert brute.spread is not None
    apart = np.hypot(spread.standard_uncertainty, brute.spread.standard_uncertainty)
    assert abs(spread.value - brute.spread.value) < SIGMAS * apart


@pytest.mark.parametrize(("gain", "offset_v"), [(0.02, 0.0), (0.0, 2.44e-3), (0.05, -1e-3)])
def test_two_converters_differ_in_every_other_sample(gain: float, offset_v: float) -> None:
    usual = about_echoes(base_scene(800e3))
    found = about_echoes(with_interleave(base_scene(800e3), gain=gain, offset_v=offset_v))
    # given the same draws, but for which converter takes the first sample
    plain, volts = (one.windows(0.17, 1e-3) for one in (usual, found))
    assert set(found.even.tolist()) == {0, 1}
    for n, row in enumerate(volts):
        even = int(found.even[found.of_echo[n]])
        expected = plain[n].copy()
        expected[even::2] = expected[even::2] * (1 + gain / 2) + offset_v / 2
        expected[1 - even :: 2] = expected[1 - even :: 2] * (1 - gain / 2) - offset_v / 2
        assert row == pytest.approx(expected, abs=1e-15)
    assert mismatched(plain, alternating(found.even, plain.shape[1])[:1], Interleave(skew_s=1e-10)) is plain


def test_a_skew_moves_every_other_sample_of_an_echo() -> None:
    skew_s = 2e-9
    usual, found = (
        about_echoes(one) for one in (base_scene(800e3), with_interleave(base_scene(800e3), skew_s=skew_s))
    )
    # given a curve through the samples of an echo, each is taken half of the skew later or earlier on it
    at = np.arange(usual.echo_v.shape[1])
    for plain, moved, even in zip(usual.echo_v, found.echo_v, found.even, strict=True):
        side = alternating(np.array([even]), at.size)[0]
        expected = CubicSpline(at, plain)(at + side * skew_s / 2 / usual.interval_s)
        # then it is that, as far as a cubic follows the rise of 34 ns: a tenth of what the skew does
        assert moved == pytest.approx(expected, abs=0.1 * np.abs(expected - plain).max())
        assert np.abs(moved - plain).max() > 0.02 * plain.max()


@pytest.mark.parametrize(
    "keys", [{"template_count": 32}, {"template_count": 4}, {"widest_s": 150e-9}, {"exclusion_samples": 20}]
)
def test_every_range_finder_of_the_budget_meets_the_same_noise(keys: dict[str, float]) -> None:
    usual, other = (about_echoes(one) for one in (base_scene(800e3), with_finder(base_scene(800e3), **keys)))
    assert np.array_equal(usual.unit, other.unit)
    assert np.array_equal(usual.shot_v, other.shot_v)


@pytest.mark.parametrize("count", [4, 12, 32])
def test_taps_that_are_nothing_change_no_score(count: int) -> None:
    finder = RangeFinder.of(base_scene().receiver_spec, RangeFinderTable(template_count=count))
    bank, draws = finder.bank, np.random.default_rng(count)
    assert bank.tap_reach < bank.reach
    pieces = draws.standard_normal((20, 2 * bank.reach + 9))
    found = piece_peaks(finder, pieces, (bank.reach, bank.reach + 8), 1)
    rows = np.arange(20)[:, None]
    whole = pieces[rows, found.lag - bank.reach + np.arange(2 * bank.reach + 1)] @ bank.templates.T
    assert found.score[:, 0] == pytest.approx(whole.max(axis=1), rel=1e-5)


@pytest.mark.parametrize("by_beam", [False, True])
@pytest.mark.parametrize("sigma_m", [(6.25, 9.0), (11.0, 7.0)])
def test_planes_under_an_ellipse_are_those_of_a_fit(sigma_m: tuple[float, float], by_beam: bool) -> None:
    x = 1.5 * np.arange(121)
    heights = fractional_brownian(121, 0.8, np.random.default_rng(2))
    relief = Grid(heights / heights.std() + 0.2 * x, 1.5, 0.0, 0.0)

    found = footprint_planes(relief, sigma_m, 5 * max(sigma_m), by_beam=by_beam)

    for row, column in np.random.default_rng(1).integers(0, found.light_m.shape[0], (4, 2)):
        i, j = row + found.margin, column + found.margin
        squares = ((x - x[j]) / sigma_m[0]) ** 2 + ((x[:, None] - x[i]) / sigma_m[1]) ** 2
        beam = np.where(squares <= 4.5**2, np.exp(-0.5 * squares), 0.0)
        weights = beam if by_beam else (squares <= EDGE**2).astype(float)
        fit = plane_fit(x[None, :] - x[j], x[:, None] - x[i], relief.values, weights)
        assert found.gradient[0][row, column] == pytest.approx(fit.gradient[0], abs=1e-9)
        assert found.gradient[1][row, column] == pytest.approx(fit.gradient[1], abs=1e-9)
        assert found.roughness_m[row, column] == pytest.approx(fit.roughness_m, rel=1e-6)
        assert found.light_m[row, column] == pytest.approx(
            (beam * relief.values).sum() / beam.sum(), abs=1e-7
        )


def test_the_law_of_peaks_knows_the_range_finder_and_the_converters() -> None:
    # given scenes that differ in what no noise peak depends on, and in what it does
    base = noise_scene(base_scene())
    alike = (
        with_finder(base_scene(), refinement_steps=4, correlation_window_samples=64),
        with_interleave(base_scene(), skew_s=2e-10),
    )
    assert [noise_scene(one) for one in alike] == [base, base]
    others = (
        with_finder(base_scene(), template_count=32),
        with_finder(base_scene(), exclusion_samples=20),
        with_interleave(base_scene(), offset_v=2.44e-3),
    )
    usual, *found = (
        noise_peaks(as_toml(noise_scene(one)), [1e-3], 10, 3, 0)["score_v"][0] for one in (base, *others)
    )
    # then more templates and an offset raise the peaks, and a wide exclusion leaves out some
    assert (found[0] >= usual - 1e-6).mean() > 0.8
    assert found[0].mean() > usual.mean()
    assert (found[1] <= usual + 1e-12).all()
    assert found[2].mean() > usual.mean()


def test_the_page_has_every_constant_with_its_range() -> None:
    page = (Path(__file__).parents[1] / "docs" / "campaign-range.md").read_text(encoding="utf-8")
    for one in CONSTANTS:
        row = next(line for line in page.splitlines() if line.startswith(f"| {one.name} |"))
        assert one.why in row
        if one.name != OTHER_GROUND:
            low, assumed, high = (cell.strip() for cell in row.split("|")[2:5])
            assert float(low) == one.low
            # an end that is none is no number
            assert (float(assumed) if math.isfinite(one.assumed) else math.inf) == one.assumed
            assert (float(high) if math.isfinite(one.high) else math.inf) == one.high
