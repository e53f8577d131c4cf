"""Slope, roughness and skewness of footprints, beside the plane fit of the physics and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from belahil.errors import RefusedInput
from procedures.footprint_moments import Disc, described, disc, even_places, moments, white_skewness
from procedures.footprint_planes import footprint_planes
from sim.terrain_fractal import monofractal
from sim.terrain_grid import Grid
from sim.terrain_statistics import plane_fit


def relief(seed: int = 3, extent_m: float = 120.0) -> Grid:
    found = monofractal(extent_m=extent_m, rms_deviation_m=4.0, baseline_m=30.0, seed=seed).relief
    assert isinstance(found, Grid)
    return found


@pytest.mark.parametrize("by_beam", [False, True])
@pytest.mark.parametrize(("seed", "across_m"), [(1, None), (2, None), (1, 2.5), (2, 5.0)])
def test_footprints_are_those_of_the_plane_fit(seed: int, across_m: float | None, by_beam: bool) -> None:
    # given footprints on relief
    ground, posts = relief(seed), disc(1.5, 4.0, across_m=across_m, by_beam=by_beam)
    row, column = even_places(ground, 25.0, 4, 1.0)

    found, whole = described(ground, row, column, posts)

    assert whole.all()
    x_m, y_m = ground.posts()
    for at in range(row.size):
        rows, columns = row[at] + posts.rows, column[at] + posts.columns
        one = plane_fit(x_m[columns], y_m[rows], ground.values[rows, columns], posts.weights)
        assert found.slope_deg[at] == pytest.approx(np.degrees(one.slope_rad), rel=1e-9)
        assert found.azimuth_deg[at] == pytest.approx(np.degrees(one.azimuth_rad), abs=1e-7)
        assert found.roughness_m[at] == pytest.approx(one.roughness_m, rel=1e-9)
        assert found.skewness[at] == pytest.approx(one.skewness, abs=1e-9)


def test_footprints_are_those_at_every_post() -> None:
    ground = relief(5)
    row, column = even_places(ground, 25.0, 5, 1.0)

    found, _ = described(ground, row, column, disc(1.5, 4.0))

    planes = footprint_planes(ground, 4.0, 25.0)
    at = row - planes.margin, column - planes.margin
    assert found.slope_deg == pytest.approx(planes.slope_deg[at], rel=1e-6)
    assert found.roughness_m == pytest.approx(planes.roughness_m[at], rel=1e-6)


@pytest.mark.parametrize(("slope", "offset"), [((0.1, -0.3), 0.0), ((0.0, 0.0), 2.4e6), ((2.0, 1.0), -50.0)])
def test_a_plane_has_no_roughness_and_no_skewness(slope: tuple[float, float], offset: float) -> None:
    posts = disc(1.0, 5.0)
    heights = (offset + slope[0] * posts.columns + slope[1] * posts.rows)[None, :]

    one = moments(heights, posts, 1.0)

    assert one.slope_deg[0] == pytest.approx(np.degrees(np.arctan(np.hypot(*slope))), abs=1e-6)
    assert one.roughness_m[0] < 1e-15 * max(abs(offset), 100.0) * 10
    assert one.skewness[0] == 0.0


def test_skewness_of_a_step_is_that_of_its_shares() -> None:
    # given a level disc with a fifth of its posts raised, evenly about both axes so that no plane leans
    posts = disc(1.0, 20.0)
    raised = posts.rows**2 + posts.columns**2 < 18.0**2
    p = raised.mean()

    one = moments(raised.astype(float)[None, :], posts, 1.0)

    assert one.slope_deg[0] == pytest.approx(0.0, abs=1e-12)
    assert one.roughness_m[0] == pytest.approx(np.sqrt(p * (1 - p)), rel=1e-12)
    assert one.skewness[0] == pytest.approx((1 - 2 * p) / np.sqrt(p * (1 - p)), rel=1e-12)
    assert one.raw_skewness[0] == pytest.approx(one.skewness[0], rel=1e-12)


def test_white_noise_has_the_spread_of_theory() -> None:
    posts = disc(1.5, 6.25)

    found = white_skewness(posts, 1.5, 5000, np.random.default_rng(4))

    # variance of the skewness of n normal numbers: 6 / n; 5000 tell it to 2 %, thrice
    assert found.std() == pytest.approx(np.sqrt(6 / (posts.rows.size - 3)), rel=0.06)
    assert found.mean() == pytest.approx(0.0, abs=4 * found.std() / np.sqrt(5000))


def test_gaps_are_told() -> None:
    ground = relief()
    known = np.ones(ground.values.shape, dtype=bool)
    known[40, 40] = False
    row, column = np.array([40, 20, 46]), np.array([42, 20, 40])

    _, whole = described(Grid(ground.values, 1.5, 0.0, 0.0, known), row, column, disc(1.5, 4.0))

    assert whole.tolist() == [False, True, True]
    assert described(Grid(ground.values, 1.5, 0.0, 0.0, known), row, column, disc(1.5, 6.0))[1].tolist() == [
        False,
        True,
        False,
    ]


def test_too_small_discs_and_terrains_are_refused() -> None:
    with pytest.raises(RefusedInput, match="at least 9"):
        disc(10.0, 2.0)
    with pytest.raises(RefusedInput, match="no room"):
        even_places(relief(), 100.0, None, 10.0)


@pytest.mark.parametrize(("per_side", "apart_m"), [(3, 1.0), (None, 20.0), (None, 7.0)])
def test_places_lie_evenly_and_apart(per_side: int | None, apart_m: float) -> None:
    ground = relief()

    row, column = even_places(ground, 15.0, per_side, apart_m)

    for one in (row, column):
        places = np.unique(one)
        assert places[0] >= 10
        assert places[-1] <= ground.values.shape[0] - 11
        if per_side is None:
            assert np.diff(places).min() * 1.5 >= apart_m - 1.5
        else:
            assert places.size == per_side


def test_an_oval_footprint_ends_where_the_beam_has_fallen_to_a_share() -> None:
    # given a beam of 8 and 5 m, and every post about it
    row, column = np.mgrid[-40:41, -40:41]
    beam = np.exp(-0.5 * ((column / 8.0) ** 2 + (row / 5.0) ** 2))

    posts = disc(1.0, 8.0, across_m=5.0)

    bright = set(zip(row[beam >= np.exp(-2.0)].tolist(), column[beam >= np.exp(-2.0)].tolist(), strict=True))
    assert set(zip(posts.rows.tolist(), posts.columns.tolist(), strict=True)) == bright


def test_a_disc_is_even_about_both_axes() -> None:
    posts: Disc = disc(1.5, 7.0, by_beam=True)

    assert posts.weights.sum() == pytest.approx(1.0)
    for odd in (posts.rows, posts.columns, posts.rows * posts.columns):
        assert float(posts.weights @ odd) == pytest.approx(0.0, abs=1e-12)
    assert posts.reach == int(4.5 * 7.0 / 1.5)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    scale=st.floats(1e-3, 1e3),
    gradient=st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
    datum=st.floats(-1e4, 1e4),
)
def test_roughness_knows_no_plane_and_scales(
    seed: int, scale: float, gradient: tuple[float, float], datum: float
) -> None:
    # given any heights, and the same higher, on another plane
    posts = disc(1.5, 5.0)
    heights = np.random.default_rng(seed).standard_normal((1, posts.rows.size))
    plane = datum + 1.5 * (gradient[0] * posts.columns + gradient[1] * posts.rows)

    one, other = moments(heights, posts, 1.5), moments(scale * heights + plane, posts, 1.5)

    # then roughness scales and the skewness stays, to the rounding of the largest height
    rounding = 1e-13 * (abs(datum) + 30 + scale) / scale
    assert other.roughness_m[0] == pytest.approx(scale * one.roughness_m[0], rel=1e-9 + rounding)
    assert other.skewness[0] == pytest.approx(one.skewness[0], abs=1e-9 + 10 * rounding)
