"""Roughness campaigns: statistics with known answers, width and shape over known ground, and the command."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Literal, cast

import numpy as np
import pytest
from msgspec import structs

from belahil.cli.main import main
from belahil.errors import RefusedInput
from procedures import roughness_chunks, roughness_figures
from procedures.campaign_roughness import ALTITUDES_M, FACTORS, RoughnessOptions, plan
from procedures.footprint_moments import disc, white_skewness
from procedures.library_azimuths import azimuth_of_slope, folded_deg
from procedures.pulse_library import pulse_library
from procedures.range_scenes import base_scene
from procedures.roughness_chunks import footprints, library_of, noise_rms_v, over_fractal, over_terrain
from procedures.roughness_curves import StackedCurves
from procedures.roughness_region import GRID_M, Simulated, Trial, estimate, trial
from procedures.roughness_results import WHITE, RoughnessResults
from procedures.roughness_shape import LEVELS_V2, power, shape
from procedures.roughness_statistics import (
    COLUMNS,
    ECHOES,
    Footprints,
    cumulative,
    gathered,
    joined,
    mean_of,
    quantile_of,
)
from procedures.roughness_width import FWHM_OF_SIGMA, flat_width_s, terms_s, width_roughness
from procedures.study_ground import LEVELS
from sim.constants import SPEED_OF_LIGHT_M_PER_S
from sim.draws import Draws
from sim.laser import beam_sigma_m
from sim.scene import as_toml, parse_scene
from sim.terrain import Surface, boulder, tilted
from sim.terrain_grid import Grid

SCENE = as_toml(base_scene())


def flat_ground(slope_deg: float, azimuth_deg: float = 0.0, posts: int = 101) -> Grid:
    half_m = 0.75 * (posts - 1)
    level = Surface("dtm", relief=Grid(np.zeros((posts, posts)), 1.5, -half_m, -half_m))
    found = tilted(level, slope_deg, azimuth_deg).relief
    assert isinstance(found, Grid)
    return found


def made(
    roughness_m: np.ndarray, msr_v2: np.ndarray, ground: np.ndarray, library_deg: float = 10.0
) -> Footprints:
    """Footprints with given residuals in one case."""
    one = np.ones(roughness_m.size)
    row = one[None, None, :]
    return Footprints(
        ground, ground, 10 * one, 0 * one, roughness_m, 0 * one, 0 * one,
        30e-9 * row, row, *(msr_v2[None, None, :] for _ in range(4)), library_deg * row, 0 * row,
        library_deg * row,
    )  # fmt: skip


# ---- statistics


def test_a_mean_over_clusters_is_as_uncertain_as_the_clusters_scatter() -> None:
    # given 40 clusters of 25 equal values each
    draws = np.random.default_rng(3)
    values, cluster = np.repeat(draws.standard_normal(40), 25), np.repeat(np.arange(40), 25)

    mean, u = mean_of(values, cluster)

    # then 25 equal values are worth one
    assert mean == pytest.approx(values.mean())
    assert u == pytest.approx(values[::25].std(ddof=1) / math.sqrt(40), rel=1e-12)
    # and strangers are worth themselves
    assert mean_of(values, np.zeros(values.size))[1] == pytest.approx(values.std() / math.sqrt(1000))


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_a_share_of_nothing_or_all_is_not_known_exactly(value: float) -> None:
    mean, u = mean_of(np.full(50, value), np.arange(50) % 5)

    assert (mean, u) == (value, pytest.approx(0.1 / math.sqrt(50)))


def test_cumulative_shares_and_quantiles() -> None:
    values = np.arange(1.0, 101.0)

    assert cumulative(values, np.array([0.5, 1.0, 50.0, 200.0])).tolist() == [0.0, 0.01, 0.5, 1.0]
    middle, u = quantile_of(values, np.arange(100), 0.5, np.random.default_rng(1))
    assert middle == 50.5
    # The median of n uniform values: sqrt(1/4/n) of their span, to the 20 % that 200 draws and steps allow.
    assert u == pytest.approx(100 * math.sqrt(0.25 / 100), rel=0.25)


def test_shape_sorts_residuals_by_roughness() -> None:
    draws = np.random.default_rng(2)
    rough = np.repeat([0.05, 0.5, 1.0], 200)
    msr = np.concatenate(
        [np.full(200, 1e-8), np.full(200, 5e-7), draws.choice([0.5e-6, 2e-6], 200, p=(0.8, 0.2))]
    )

    one = shape(made(rough, msr, np.arange(600) % 10), 0)

    assert one.counts.tolist() == [200, 200, 200]
    for shares in one.above.values():
        assert [share[0] if share else None for share in shares][:2] == [0.0, 0.0]
        assert shares[2] is not None
        assert shares[2][0] == pytest.approx((msr[400:] > 1e-6).mean())
    assert one.contours_v2[:, 0] == pytest.approx(1e-8)
    assert np.isnan(one.contours_v2[0, 1])
    assert one.curves[0][np.searchsorted(LEVELS_V2, 1.1e-8)] == 1.0


def test_power_is_chance_where_roughness_does_not_matter() -> None:
    draws = np.random.default_rng(8)
    rough = np.where(np.arange(6000) % 3 == 0, 1.0, 0.05)
    msr = np.exp(draws.standard_normal(6000))

    one = power(made(rough, msr, np.arange(6000) % 12), 0, 0, "window", np.random.default_rng(1))

    assert one is not None
    assert one.share == pytest.approx(0.01, abs=4 * one.share_u)
    assert abs(one.separation) < 4 * one.separation_u
    # and everything where all rough residuals are larger
    more = power(
        made(rough, msr + 100 * (rough > 0.5), np.arange(6000) % 12), 0, 0, "window", np.random.default_rng(1)
    )
    assert more is not None
    assert more.share == 1.0
    assert more.separation > 10


def test_power_needs_enough_of_both() -> None:
    few = made(np.full(150, 0.05), np.ones(150), np.arange(150))

    assert power(few, 0, 0, "window", np.random.default_rng(1)) is None


# ---- width


@pytest.fixture(scope="module")
def library():  # type: ignore[no-untyped-def]
    return library_of(SCENE)


@pytest.mark.parametrize("slope_deg", [0.0, 7.5, 20.0])
def test_the_terms_of_the_width_add_up(library, slope_deg: float) -> None:  # type: ignore[no-untyped-def]
    terms = terms_s(base_scene(), library, slope_deg)

    parts = sum(terms[name] ** 2 for name in ("transmitted", "beam", "slope", "filter"))
    assert terms["observed"] == pytest.approx(math.sqrt(parts), rel=1e-12)
    # 12.5 urad from 500 km are 6.25 m rms
    expected_s = 2 * 6.25 * math.tan(math.radians(slope_deg)) / SPEED_OF_LIGHT_M_PER_S
    assert terms["slope"] == pytest.approx(expected_s, rel=1e-3)


@pytest.mark.parametrize("slope_deg", [3.3, 12.0, 25.0])
def test_flat_ground_has_no_roughness_by_width(library, slope_deg: float) -> None:  # type: ignore[no-untyped-def]
    # given planes with 25 footprints
    found = footprints(SCENE, flat_ground(slope_deg), 5, ["free"], [0.17], False, Draws(1, 1))
    assert found["roughness_m"].max() < 1e-9

    # then the width is that of the library, but for the place between two samples, 2 ns or so
    assert found["width_s"][0, 0].mean() == pytest.approx(
        float(flat_width_s(library, np.array([slope_deg]))[0]), abs=0.4e-9
    )


def test_white_relief_has_its_roughness_by_width() -> None:
    # given relief that is white noise, for which the formula was made
    draws = np.random.default_rng(11)
    level = flat_ground(10.0, posts=121)
    rough = Grid(
        level.values + 0.8 * draws.standard_normal(level.values.shape), 1.5, level.x_min_m, level.y_min_m
    )
    found = footprints(SCENE, rough, 12, ["free"], [0.17], False, Draws(1, 2))
    seen = Footprints(np.arange(144), np.arange(144), *(found[name] for name in (*COLUMNS, *ECHOES)))

    width = width_roughness(seen, library_of(SCENE), 0)

    # then the mean of its squares is that of the ground, times what the fit makes of any wider light: the
    # derivative of the square of flat slopes' widths
    near = np.array([9.5, 10.5])
    wider = np.diff(flat_width_s(library_of(SCENE), near) ** 2) / FWHM_OF_SIGMA**2
    light = np.diff([terms_s(base_scene(), library_of(SCENE), slope)["slope"] ** 2 for slope in near])
    mean, u = mean_of(width.observed_s2, seen.chunk)
    assert 0.7 < float(wider[0] / light[0]) < 0.95
    assert mean == pytest.approx(width.ground_s2.mean() * float(wider[0] / light[0]), abs=4 * u)
    assert u < 0.05 * mean
    assert width.ground_s2.mean() == pytest.approx((2 * 0.8 / SPEED_OF_LIGHT_M_PER_S) ** 2, rel=0.05)


def test_the_width_of_a_gaussian() -> None:
    assert pytest.approx(2.3548, abs=1e-4) == FWHM_OF_SIGMA


# ---- shape over ground that is known


@pytest.mark.parametrize(("slope_deg", "altitude_m"), [(10.0, 500e3), (17.0, 500e3), (10.0, 800e3)])
def test_flat_ground_is_found_in_its_library(slope_deg: float, altitude_m: float) -> None:
    scene = as_toml(base_scene(altitude_m))
    found = footprints(
        scene, flat_ground(slope_deg, 20.0, 161), 3, ["free", "night"], [0.17], False, Draws(2, 1)
    )

    # then without noise the slope is the library's and nothing but the tolerance of the echoes is left
    assert np.all(found["library_deg"][0, 0] == slope_deg)
    assert found["msr_v2"][0, 0].max() < 1e-9
    assert found["amplitude"][0, 0] == pytest.approx(1.0, abs=2e-3)
    # and a pulse that is not moved is at its place
    assert np.all(found["timed_deg"][0, 0] == slope_deg)
    assert found["timed_msr_v2"][0, 0].max() < 1e-9
    # and by night what is left is the noise, three of whose 42 degrees of freedom were fitted
    noise_v2 = noise_rms_v(base_scene(altitude_m), "night", 0.17) ** 2
    assert 0.5 < found["msr_v2"][0, 1].mean() / (noise_v2 * 39 / 42) < 1.6


def test_a_darker_ground_gives_a_fainter_pulse() -> None:
    found = footprints(SCENE, flat_ground(10.0), 3, ["free"], [0.17, 0.34, 0.085], False, Draws(1, 1))

    assert found["amplitude"][:, 0].mean(axis=1) == pytest.approx([1.0, 2.0, 0.5], rel=2e-3)


def test_a_cliff_leaves_what_no_slope_explains() -> None:
    # given level ground, and the same with a cliff of 4 m through the footprint
    level = flat_ground(0.0)
    x_m, _ = level.posts()
    cliff = Grid(
        np.broadcast_to(np.where(x_m > 0, 4.0, 0.0), level.values.shape), 1.5, level.x_min_m, level.y_min_m
    )

    flat, broken = (footprints(SCENE, one, 1, ["free"], [0.17], False, Draws(1, 1)) for one in (level, cliff))

    assert flat["msr_v2"][0, 0, 0] < 1e-9
    assert broken["msr_v2"][0, 0, 0] > 1e-7
    assert broken["pulse_msr_v2"][0, 0, 0] > broken["msr_v2"][0, 0, 0]
    assert broken["example_msr_v2"] == broken["msr_v2"][0, 0, 0]
    left = broken["example_samples_v"] - broken["example_best_v"]
    assert float(np.mean(left**2)) == pytest.approx(float(broken["example_msr_v2"]), rel=1e-9)
    assert broken["largest_v2"][0, 0, 0] == pytest.approx(float((left**2).max()), rel=1e-9)


@pytest.mark.parametrize(("across_m", "least_v2", "most_v2"), [(5.0, 0.5e-6, 2e-6), (-5.0, 0.0, 0.2e-6)])
def test_an_edge_in_the_footprint_leaves_a_square_millivolt(
    across_m: float, least_v2: float, most_v2: float
) -> None:
    # given a flat boulder of 4 m, and the beam on its upper or its lower edge on a slope
    made_m = boulder(25.0, 4.0, centre_m=(across_m, 0.0), slope_deg=10.0, exponent=4.0)
    x_m = np.arange(-60.0, 60.1, 0.75)
    ground = Grid(made_m.height(x_m[None, :], x_m[:, None]), 0.75, -60.0, -60.0)

    found = footprints(SCENE, ground, 1, ["free"], [0.17], False, Draws(1, 1))

    # then both are 1 m rough, but only one has a shape that no slope has
    assert found["roughness_m"][0] == pytest.approx(0.98, abs=0.02)
    assert least_v2 < found["msr_v2"][0, 0, 0] < most_v2


def test_higher_ground_is_rougher_in_proportion() -> None:
    one, other = (
        over_fractal(SCENE, 9, factor, 100, 0.0, 4, ["free"], [0.17], False, 1, 1) for factor in (1.0, 2.0)
    )

    assert other["roughness_m"] == pytest.approx(2 * one["roughness_m"], rel=1e-9)
    assert other["skewness"] == pytest.approx(one["skewness"], abs=1e-9)


# ---- regions


def region_truth(draws: np.random.Generator, middle_m: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Footprints of a region, residuals with a noise of 20 % about a law of roughness."""
    rough = middle_m * np.exp(0.25 * draws.standard_normal(count))
    return rough, 0.6e-6 * (1 + (rough / 0.9) ** 2) * np.exp(0.2 * draws.standard_normal(count))


@pytest.mark.parametrize("stacked", [Simulated, StackedCurves])
@pytest.mark.parametrize("residual", ["window", "pulse"])
def test_intervals_of_regions_hold_what_they_promise(
    residual: Literal["window", "pulse"], stacked: type[Simulated | StackedCurves]
) -> None:
    # given regions of 0.02 to 1 m, in two sets
    draws = np.random.default_rng(21)
    parts = [region_truth(draws, middle, 150) for middle in np.tile(np.geomspace(0.02, 1.0, 30), 2)]
    ground = np.repeat(np.arange(60), 150)
    seen = made(*(np.concatenate(one) for one in zip(*parts, strict=True)), ground)

    found = trial(seen, ground // 30, 0, residual, stacked)

    # then 68 and 95 % of the truths lie inside, to what 60 regions tell, or more: there is a lowest roughness
    assert found.truth_m.size == 60
    assert 0.68 - 3 * math.sqrt(0.68 * 0.32 / 60) < found.inside("inside_68_m").mean()
    assert 0.95 - 3 * math.sqrt(0.95 * 0.05 / 60) < found.inside("inside_95_m").mean()
    # and rough ones are told from smooth ones
    rough = found.truth_m > 0.7
    assert np.median([one.roughness_m for one, at in zip(found.found, rough, strict=True) if at]) > 0.5
    assert all(
        one.inside_95_m[1] < 0.5 for one, at in zip(found.found, found.truth_m < 0.1, strict=True) if at
    )


def test_a_stacked_curve_is_that_of_a_region() -> None:
    # given many terrains, and a region of 0.4 m with many footprints
    draws = np.random.default_rng(6)
    parts = [region_truth(draws, middle, 400) for middle in np.geomspace(0.1, 1.2, 80)]
    simulated = StackedCurves(
        *(np.concatenate(one) for one in zip(*parts, strict=True)), np.repeat(np.arange(80), 400)
    )
    _, msr_v2 = region_truth(draws, 0.4, 20_000)

    expected = simulated.shares[np.argmin(np.abs(GRID_M - 0.4))]

    # then its residuals fall into the classes as the stacked curve tells, to what 400 footprints a terrain do
    shares = np.histogram(msr_v2, [0.0, *simulated.levels_v2, np.inf])[0] / msr_v2.size
    assert expected == pytest.approx(shares, abs=0.02)
    # and strangers scatter no more than they should
    assert simulated.dispersion == pytest.approx(1.0, abs=0.3)


def test_smooth_ground_has_an_upper_limit_only() -> None:
    draws = np.random.default_rng(5)
    parts = [region_truth(draws, middle, 200) for middle in np.geomspace(0.02, 1.0, 20)]
    simulated = Simulated(
        *(np.concatenate(one) for one in zip(*parts, strict=True)), np.repeat(np.arange(20), 200)
    )

    smooth = estimate(simulated, np.full(300, 0.55e-6))
    rough = estimate(simulated, region_truth(draws, 0.8, 300)[1])

    assert smooth.inside_95_m[0] < 1.02 * GRID_M[0]
    assert smooth.inside_95_m[1] < 0.4
    assert rough.inside_95_m[0] < 0.8 < rough.inside_95_m[1]
    assert rough.inside_68_m[1] / rough.inside_68_m[0] < rough.inside_95_m[1] / rough.inside_95_m[0]


def test_collections_are_joined() -> None:
    one = made(np.ones(3), np.ones(3), np.arange(3))

    both = joined([one, one])

    assert both.size == 6
    assert both.msr_v2.shape == (1, 1, 6)


# ---- plan and command


def test_a_plan_gives_each_relief_a_seed_of_its_own() -> None:
    chunks = plan(RoughnessOptions()).chunks

    assert len({one.key for one in chunks}) == len(chunks)
    reliefs = {
        (one.given["ground_seed"] + one.given["level"], one.given["height_factor"])
        for one in chunks
        if one.name.startswith(("fractal", "extra"))
    }
    # sets of eleven and of the rougher ones, each at two tilts
    assert len(reliefs) == RoughnessOptions().sets * (LEVELS + len(FACTORS))
    assert len({seed for seed, _ in reliefs}) == len(reliefs)
    assert sum(one.name.startswith("altitude") for one in chunks) == 12 * len({*ALTITUDES_M, 500e3})
    footprint_count = sum(
        one.given["per_side"] ** 2
        for one in chunks
        if one.name.startswith("fractal") and one.given["tilt_deg"] == 0
    )
    assert footprint_count >= 9801


def test_residuals_are_compared_at_the_slope_of_the_tilted_ground() -> None:
    # given ground at another slope
    steep = plan(RoughnessOptions(sets=2, per_side=2, slope_deg=20.0))
    tilts = {one.given["tilt_deg"] for one in steep.chunks if not one.name.startswith("altitude")}
    assert tilts == {0.0, 20.0}
    assert {one.given["tilt_deg"] for one in steep.chunks if one.name.startswith("altitude")} == {20.0}

    # when its footprints are put together, whose best pulses have 18.9 to 21.1 degrees
    best_deg = np.array([[[18.9, 19.0, 20.0, 21.0, 21.1]]])
    none = np.zeros(5)
    one = {name: none for name in COLUMNS} | {name: best_deg for name in ECHOES}
    chunks = tuple(chunk for chunk in steep.chunks if chunk.name.startswith("fractal"))
    seen = gathered(replace(steep, chunks=chunks), [one] * len(chunks), "fractal")

    # then those within a degree are compared, of all collections of them
    assert seen is not None
    assert joined([seen, seen]).compared(0).tolist() == [False, True, True, True, False] * 2 * len(chunks)


def test_a_terrain_model_is_cut_into_blocks(tmp_path: Path) -> None:
    scene = tmp_path / "ground.toml"
    scene.write_text('[surface]\nkind = "fractal"\nextent_m = 900.0\nspacing_m = 3.0\n')

    chunks = plan(RoughnessOptions(terrain=str(scene), altitudes=False)).chunks

    blocks = [one.given for one in chunks if one.name.startswith("terrain")]
    for along in ("rows", "columns"):
        spans = sorted({tuple(one[along]) for one in blocks})
        assert spans[0][0] == 0
        assert spans[-1][1] == 301
        # each begins where the footprints of the one before end
        assert all(low[1] > high[0] for low, high in itertools.pairwise(spans))


@pytest.mark.slow
def test_blocks_of_a_terrain_model_with_gaps_are_seen_wherever_they_lie(tmp_path: Path) -> None:
    # given: a long flank, higher than a thousandth of the altitude, without data at nadir and at one end
    x_m = 3.0 * np.arange(1100)
    heights = np.random.default_rng(2).normal(0.0, 0.3, (60, 1100)) + math.tan(math.radians(20.0)) * x_m
    heights[:, 540:560] = np.nan
    heights[:, :40] = np.nan
    file = tmp_path / "ground.npy"
    np.save(file, heights)
    scene = tmp_path / "ground.toml"
    table = f'kind = "dtm"\nfile = "{file.as_posix()}"\nspacing_m = 3.0\nextent_m = 3300.0\n'
    scene.write_text(f"[surface]\n{table}")

    chunks = plan(RoughnessOptions(terrain=str(scene), altitudes=False)).chunks
    blocks = [one.given for one in chunks if one.name.startswith("terrain")]
    first, whole, gappy, last = (over_terrain(**blocks[at]) for at in (0, 1, 2, 5))

    # then: far ones are seen too, and no footprint has a gap in it
    assert len(blocks) == 6
    assert 0 < first["slope_deg"].size < whole["slope_deg"].size
    assert 0 < gappy["slope_deg"].size < whole["slope_deg"].size
    for one in (first, whole, gappy, last):
        assert np.all(one["width_s"][0, 0] > 0)
        assert one["slope_deg"] == pytest.approx(20.0, abs=2.0)
        assert one["roughness_m"].max() < 0.5


@pytest.mark.parametrize(
    "spacing_m", [pytest.param(1.0, marks=pytest.mark.slow), pytest.param(1.5, marks=pytest.mark.slow), 2.5]
)
def test_white_ground_is_white_at_every_spacing_of_a_terrain_model(spacing_m: float) -> None:
    # given footprints of white ground over posts of one spacing, as the terrain model of a campaign
    options = RoughnessOptions(altitudes=False)
    level = plan(options)
    sigma_m, count = beam_sigma_m(base_scene().laser, options.altitude_m)[0], 3000
    posts = disc(spacing_m, sigma_m)
    own = white_skewness(posts, spacing_m, count, np.random.default_rng(5))
    one = made(np.ones(count), np.ones(count), np.arange(count))
    seen = replace(one, skewness=own, chunk=np.zeros(count, dtype=np.int64))
    found = RoughnessResults(level, [{"spacing_m": np.array(spacing_m)} for _ in level.chunks])
    found.__dict__.update(terrain=seen, fractals=seen)

    beyond = found.skewness["terrain"].beyond

    # then 1 % of it lie beyond 99 % of white noise, 5 standard errors of both samples
    assert beyond == pytest.approx(0.01, abs=5 * math.sqrt(0.01 / count + 0.01 / WHITE))


def test_a_near_and_bright_echo_is_clipped_as_by_the_converter(monkeypatch: pytest.MonkeyPatch) -> None:
    # given level ice from 100 km, whose pulse would reach 1.6 V at a converter of +-1 V, and a short library
    scene, short = as_toml(base_scene(100e3)), pulse_library(base_scene(100e3), (0.0, 10.0), (0.0,))
    monkeypatch.setattr(roughness_chunks, "library_of", lambda scene: short)
    ground = flat_ground(0.0, posts=61)

    found = footprints(scene, ground, 3, ["night"], [0.3], False, Draws(1, 0))

    top_v = found["example_samples_v"].max()
    assert top_v == pytest.approx(1.0, abs=2 * base_scene().truth.adc_full_scale_v / 2**12)
    assert np.all(found["width_s"] > 23e-9)  # too wide, as a clipped pulse is; 21.7 ns without


def test_a_block_without_a_whole_footprint_tells_nothing() -> None:
    known = np.zeros((60, 60), dtype=bool)
    known[:5] = True
    relief = Grid(np.ones((60, 60)), 1.5, 0.0, 0.0, known)

    found = footprints(as_toml(base_scene()), relief, None, ["free"], [0.17], False, Draws(1, 0))

    assert found["slope_deg"].size == 0
    assert found["width_s"].shape == (1, 1, 0)


@pytest.mark.parametrize(
    "given",
    [
        {"altitude_m": 99e3},
        {"sets": 1},
        {"per_side": 1},
        {"seed": -1},
        {"ground_seed": -1},
        {"ellipticity": -0.1},
        {"ellipticity": 0.95},
        {"slope_deg": 0.5},
        {"slope_deg": 31.0},
    ],
)
def test_an_option_outside_its_range_is_refused(given: dict[str, float]) -> None:
    with pytest.raises(RefusedInput):
        RoughnessOptions(**given)  # type: ignore[arg-type]


def test_the_library_of_a_lopsided_beam_has_its_azimuths() -> None:
    scene = base_scene()
    scene = structs.replace(scene, laser=structs.replace(scene.laser, beam="elliptical", ellipticity=0.2))

    assert pulse_library(scene, (10.0,)).azimuth_deg.size == 4


def test_an_oval_beam_reaches_every_chunk_of_the_campaign() -> None:
    chunks = plan(RoughnessOptions(ellipticity=0.3)).chunks

    lasers = {parse_scene(one.given["scene"]).laser for one in chunks}
    assert {(one.beam, one.ellipticity) for one in lasers} == {("elliptical", 0.3)}


def test_a_slope_of_another_azimuth_is_taken_for_another_slope() -> None:
    # given an elliptical Gaussian, whose profile along any line is a Gaussian
    scene = base_scene()
    laser = structs.replace(scene.laser, beam="elliptical", ellipticity=0.2)
    oval = pulse_library(structs.replace(scene, laser=laser), tuple(range(8, 16)), (0.0, 90.0))

    found = azimuth_of_slope(oval, 10.0, 42)

    # then a slope along the short axis gives the pulse of tan(slope) times long over short axis, to a step
    across_deg = math.degrees(math.atan(math.tan(math.radians(10.0)) / (1 - 0.2)))
    assert abs(found.wrong_azimuth_deg - across_deg) <= 0.5
    assert found.long_s > found.short_s
    # and leaves less than between two slopes of the library, but for the slope held much more
    assert found.wrong_azimuth_msr_v2 < 0.01e-6 < 5 * found.wrong_azimuth_msr_v2 + 0.05e-6
    assert found.same_slope_msr_v2 > 10 * found.wrong_azimuth_msr_v2


def test_azimuths_are_folded_to_a_quarter() -> None:
    assert folded_deg(np.array([0.0, 30.0, 90.0, 150.0, 180.0, -135.0, 350.0])) == pytest.approx(
        [0.0, 30.0, 90.0, 30.0, 0.0, 45.0, 10.0]
    )


@pytest.mark.parametrize(("means", "label"), [(4, "means, too few to fit"), (5, "polynomial through means")])
def test_a_polynomial_goes_through_means_that_are_enough(means: int, label: str) -> None:
    # given mean slopes of a small campaign
    deg = np.arange(5.0, 5.0 + means)
    example = {f"example_{name}": np.ones(2) for name in ("time_s", "samples_v", "best_v")}
    example |= {"example_heights_m": np.ones((3, 3)), "example_spacing_m": 1.5, "example_roughness_m": 1.0}
    found = SimpleNamespace(
        example=example,
        sigma_m=(5.0, 5.0),
        noise_v={"night": 1e-3, "day": 1e-3},
        beyond_noise=lambda case: 0,
        everything=made(np.ones(means), np.ones(means), np.arange(means)),
        slopes={name: deg for name in ("library_deg", "mean_deg", "mean_u_deg")},
        slope_bias_deg=(0.0, 0.1),
    )

    # when they are drawn, where a warning is an error
    drawn = roughness_figures.library_figure(cast("RoughnessResults", found))

    # then a curve that is no fit is not drawn
    assert label in drawn.axes[2].get_legend_handles_labels()[1]


def test_panels_of_what_was_not_computed_say_so() -> None:
    none = Trial(np.zeros(0), (), ())
    found = SimpleNamespace(reaches=(), trials={"pulse": {"night": none, "day": none}})

    drawn = roughness_figures.reach_figure(cast("RoughnessResults", found))

    told = [[text.get_text() for text in axes.texts] for axes in drawn.axes]
    assert told == [["altitudes were not computed"]] * 2 + [["too few footprints for a region"]]


@pytest.mark.slow
def test_the_command_keeps_what_it_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = [
        "campaign",
        "roughness",
        "--per-side",
        "8",
        "--no-altitudes",
        "--workers",
        "1",
        "--quiet",
        "--json",
    ]

    assert main([*words, "--out", str(tmp_path / "run")]) == 0

    results = json.loads(capsys.readouterr().out)["results"]
    assert results["footprints"]["fractals"] == 3 * 2 * 11 * 64
    assert 0.1 < results["width"]["share_negative"]["value"] < 0.6
    assert results["skewness"]["fractals"]["spread"] > 1.5 * results["skewness"]["white_noise_spread"]
    assert results["reach"] is None
    xarray = pytest.importorskip("xarray")
    with xarray.open_dataset(tmp_path / "run" / "data.nc") as data:
        assert data["msr_v2_night"].shape == (results["footprints"]["all"],)
    for name in ("width", "skewness", "library", "shape", "reach"):
        assert (tmp_path / "run" / f"figure-{name}.png").stat().st_size > 10_000
