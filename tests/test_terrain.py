"""Shapes in closed form, grids between their posts, and ground that is not there."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from belahil.errors import RefusedInput
from sim.terrain import Surface, boulder, crater, plane, tilted
from sim.terrain_dtm import albedo_map, from_array
from sim.terrain_grid import Grid, OffTerrain

RIPPLES = np.random.default_rng(4).standard_normal((7, 9))


def within(surface: Surface, count: int = 401) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places within 20 m of the origin, or on the grid."""
    x_min, x_max, y_min, y_max = surface.bounds if surface.spacing_m else (-20.0, 20.0, -20.0, 20.0)
    x, y = np.meshgrid(np.linspace(x_min, x_max, count), np.linspace(y_min, y_max, count))
    return x, y


# ---- shapes


@pytest.mark.parametrize("azimuth_deg", [0.0, 45.0, 137.0, 270.0])
def test_a_plane_rises_towards_its_azimuth(azimuth_deg: float) -> None:
    surface = plane(10.0, azimuth_deg)
    uphill = math.radians(azimuth_deg)

    height_m = surface.height(100 * math.cos(uphill), 100 * math.sin(uphill))

    assert height_m == pytest.approx(100 * math.tan(math.radians(10)), rel=1e-14)
    assert surface.steepest(3.0, 4.0, 50.0) == pytest.approx(math.radians(10), rel=1e-14)
    assert (surface.spacing_m, surface.kind) == (0.0, "plane")
    assert surface.bounds == (-math.inf, math.inf, -math.inf, math.inf)


def test_a_crater_has_floor_crest_and_ejecta() -> None:
    surface = crater(20.0, 3.0, rim_height_m=0.5, centre_m=(2.0, 0.0))

    # given on the axis, half way up the wall, at the crest from both sides, at two and three radii
    x_m = np.array([2.0, 7.0, 12.0 - 1e-9, 12.0, 22.0, 32.0])

    expected_m = [-2.5, -2.5 + 3 * 0.25, 0.5, 0.5, 0.5 / 8, 0.5 / 27]
    np.testing.assert_allclose(surface.height(x_m, 0.0), expected_m, atol=1e-9)


def test_the_rim_of_a_crater_follows_its_diameter_and_never_exceeds_its_depth() -> None:
    assert crater(20.0, 3.0).height(10.0, 0.0) == pytest.approx(0.036 * 20.0)
    assert crater(200.0, 3.0).height(100.0, 0.0) == pytest.approx(3.0)


def test_a_boulder_stands_on_its_slope() -> None:
    surface = boulder(12.0, 4.0, exponent=3.0, slope_deg=10.0, azimuth_deg=90.0)
    rise = math.tan(math.radians(10))

    y_m = np.array([-8.0, -6.0, -3.0, 0.0, 3.0, 6.0])

    np.testing.assert_allclose(surface.height(0.0, y_m), rise * y_m + [0, 0, 3.5, 4, 3.5, 0], atol=1e-14)


def test_a_crater_without_a_rim_is_the_boulder_upside_down() -> None:
    x, y = np.meshgrid(np.linspace(-15, 15, 61), np.linspace(-15, 15, 61))
    hole = crater(20.0, 5.0, rim_height_m=0.0, slope_deg=10.0, azimuth_deg=30.0 + 180.0)
    bump = boulder(20.0, 5.0, slope_deg=10.0, azimuth_deg=30.0)

    np.testing.assert_allclose(hole.height(x, y), -bump.height(x, y), rtol=0, atol=1e-14)


SURFACES = {
    "plane": plane(30.0, 20.0),
    "crater": crater(20.0, 4.0, slope_deg=10.0),
    "crater off centre": crater(8.0, 1.0, centre_m=(14.0, -3.0)),
    "boulder": boulder(10.0, 5.0, exponent=3.0, slope_deg=10.0, azimuth_deg=200.0),
    "grid": from_array(RIPPLES, 2.0),
}


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize("disc", [(0.0, 0.0, 25.0), (1.0, -2.0, 3.0), (5.0, 0.0, 0.5), (0.0, 0.0, 1e-3)])
def test_nothing_in_a_disc_is_steeper_than_said(name: str, disc: tuple[float, float, float]) -> None:
    surface = SURFACES[name]
    x_m, y_m, radius_m = disc
    along = np.linspace(-1, 1, 201) * radius_m
    dx, dy = np.meshgrid(along, along)
    step_m = 1e-4 * radius_m

    # when the slope between neighbours is measured inside of the disc, in every direction
    steepest = 0.0
    for direction in np.linspace(0, np.pi, 25):
        x, y = x_m + dx, y_m + dy
        x2, y2 = x + step_m * np.cos(direction), y + step_m * np.sin(direction)
        x_min, x_max, y_min, y_max = surface.bounds
        inside = np.hypot(np.maximum(abs(dx), abs(x2 - x_m)), np.maximum(abs(dy), abs(y2 - y_m))) < radius_m
        inside &= (x > x_min) & (x2 < x_max) & (y > y_min) & (y2 < y_max) & (x2 > x_min)
        rise = surface.height(x2[inside], y2[inside]) - surface.height(x[inside], y[inside])
        steepest = max(steepest, float(np.abs(rise).max()) / step_m)

    # then it is below the bound, up to the digits that a difference over such a step has
    digits = 8 * np.finfo(float).eps * 20 / step_m
    assert steepest <= math.tan(surface.steepest(*disc)) + digits


@pytest.mark.parametrize("name", ["plane", "crater", "grid"])
def test_the_steepest_place_is_found(name: str) -> None:
    surface = SURFACES[name]
    x, y = within(surface, 1601)
    height_m = surface.height(x, y)
    step_m = (x[0, 1] - x[0, 0], y[1, 0] - y[0, 0])

    along_y, along_x = np.gradient(height_m, step_m[1], step_m[0])

    measured = np.arctan(np.hypot(along_x, along_y).max())
    assert measured == pytest.approx(surface.steepest(0.0, 0.0, 40.0), rel=0.01)


# ---- grids


@given(
    seed=st.integers(0, 2**32 - 1),
    rows=st.integers(2, 6),
    columns=st.integers(2, 6),
    spacing_m=st.sampled_from([0.1, 1.0, 1.5, 93.0]),
)
def test_between_the_posts_it_is_bilinear(seed: int, rows: int, columns: int, spacing_m: float) -> None:
    stream = np.random.default_rng(seed)
    surface = from_array(stream.standard_normal((rows, columns)), spacing_m)
    assert isinstance(surface.relief, Grid)
    x_posts, y_posts = surface.relief.posts()
    x_m, y_m = stream.uniform(x_posts[0], x_posts[-1], 50), stream.uniform(y_posts[0], y_posts[-1], 50)

    judge = RegularGridInterpolator((y_posts, x_posts), surface.relief.values)

    np.testing.assert_allclose(surface.height(x_m, y_m), judge(np.column_stack([y_m, x_m])), atol=1e-12)


def test_a_post_has_its_own_height_up_to_the_last_row_and_column() -> None:
    surface = from_array(RIPPLES, 0.1)  # 0.1 m is no binary fraction
    assert isinstance(surface.relief, Grid)
    x_m, y_m = surface.relief.posts()

    np.testing.assert_allclose(surface.height(x_m, y_m[:, None]), RIPPLES, atol=1e-12)
    assert surface.bounds == pytest.approx((-0.4, 0.4, -0.3, 0.3))


def test_tilting_a_grid_adds_the_plane_everywhere() -> None:
    ground = from_array(RIPPLES, 2.0)
    x, y = within(ground, 50)

    leaning = tilted(ground, 25.0, 60.0)

    expected_m = ground.height(x, y) + plane(25.0, 60.0).height(x, y)
    np.testing.assert_allclose(leaning.height(x, y), expected_m, atol=1e-13)
    assert leaning.gradient == (0.0, 0.0)
    assert tilted(plane(10.0), 5.0).gradient[0] == pytest.approx(
        math.tan(math.radians(10)) + math.tan(math.radians(5))
    )


def test_a_grid_keeps_its_own_read_only_copy() -> None:
    heights = RIPPLES.copy()
    surface = from_array(heights, 1.0)
    heights[:] = 1e9

    assert isinstance(surface.relief, Grid)
    assert np.array_equal(surface.relief.values, RIPPLES)
    with pytest.raises(ValueError, match="read-only"):
        surface.relief.values[0, 0] = 0.0


@pytest.mark.parametrize("where", [(0.0, 0.0), (1.5, 0.5), (4.0, 3.0)])
def test_scalars_give_one_height(where: tuple[float, float]) -> None:
    surface = from_array(RIPPLES, 1.0)

    assert np.shape(surface.height(*where)) == ()
    assert surface.height(*where) == surface.height([where[0]], [where[1]])[0]


# ---- ground that is not there

GAPS = np.ones((5, 5), dtype=bool)
GAPS[2, 3] = False


def test_a_missing_post_takes_its_four_cells_and_no_more() -> None:
    grid = Grid(np.ones((5, 5)), 1.0, 0.0, 0.0, GAPS)
    x, y = np.meshgrid(np.linspace(0, 4, 41), np.linspace(0, 4, 41))

    values, known = grid.sample(x, y)

    near = (np.abs(x - 3) < 1 - 1e-9) & (np.abs(y - 2) < 1 - 1e-9)
    assert np.array_equal(known, ~near)
    assert np.array_equal(values, known.astype(float))


def test_ground_beyond_the_edge_or_in_a_gap_is_a_typed_error_or_a_mask() -> None:
    surface = from_array(np.where(GAPS, 7.0, np.nan), 1.0)
    x_m, y_m = np.array([-2.0, 2.1, 1.0, 0.0]), np.zeros(4)

    with pytest.raises(OffTerrain, match="not every one of the places has ground"):
        surface.height(x_m, y_m)
    sample = surface.sample(x_m, y_m)

    assert sample.known.tolist() == [True, False, False, True]
    assert sample.height_m.tolist() == [7.0, 0.0, 0.0, 7.0]
    assert sample.reflectance.tolist() == [0.17, 0.0, 0.0, 0.17]


@pytest.mark.parametrize("place", [(50.0, 0.0), (0.0, -1e300), (math.nan, 0.0), (0.0, math.inf), (1.0, 0.0)])
def test_a_footprint_with_no_ground_at_all_is_off_the_terrain(place: tuple[float, float]) -> None:
    surface = from_array(np.where(GAPS, 7.0, np.nan), 1.0)
    x_m, y_m = np.full(3, place[0]), np.full(3, place[1])

    with pytest.raises(OffTerrain, match=r"none of the places has ground; the dtm covers x -2 to 2 m"):
        surface.sample(x_m, y_m)
    if place[0] != 1.0:
        with pytest.raises(OffTerrain):
            surface.steepest(*place, 0.1)


def test_a_place_that_is_no_number_is_off_a_plane_too() -> None:
    with pytest.raises(OffTerrain):
        plane(10.0).height([0.0, math.nan], [0.0, 0.0])
    with pytest.raises(OffTerrain, match="no place"):
        plane(10.0).sample([], [])
    with pytest.raises(OffTerrain, match="x nan"):
        crater().steepest(math.nan, 0.0, 1.0)
    with pytest.raises(OffTerrain):
        Grid(np.zeros((2, 2)), 1.0, 0.0, 0.0).steepest(0.5, math.nan, 1.0)


def test_a_cell_with_a_gap_is_not_steep() -> None:
    heights = np.zeros((5, 5))
    heights[2, 3] = 1e6  # what stands in the gap
    heights[4, :] = 1.0
    surface = Surface("dtm", relief=Grid(heights, 1.0, -2.0, -2.0, GAPS))

    assert surface.steepest(0.0, 0.0, 5.0) == pytest.approx(math.radians(45))
    with pytest.raises(OffTerrain, match=r"within 0\.1 m"):
        surface.steepest(1.5, 0.5, 0.1)


# ---- reflectance


def test_reflectance_is_one_number_or_a_map() -> None:
    bright = albedo_map([[0.1, 0.3], [0.1, 0.3]], 10.0)

    assert plane(reflectance=0.08).reflectance(np.zeros(3), 0.0) == 0.08
    np.testing.assert_allclose(plane(reflectance=bright).reflectance([-5.0, 0.0, 5.0], 0.0), [0.1, 0.2, 0.3])
    with pytest.raises(OffTerrain):
        plane(reflectance=bright).reflectance([0.0, 6.0], 0.0)
    sample = plane(10.0, reflectance=bright).sample([0.0, 6.0], [0.0, 0.0])
    assert (sample.known.tolist(), sample.reflectance.tolist()) == ([True, False], [pytest.approx(0.2), 0.0])


def test_no_reflectance_is_allowed() -> None:
    assert plane(reflectance=0.0).sample([0.0], [0.0]).reflectance.tolist() == [0.0]


# ---- what is refused


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: plane(90.0), "slope_deg = 90"),
        (lambda: plane(-1.0), "0 to below 90"),
        (lambda: plane(math.nan), "slope_deg = nan"),
        (lambda: plane(reflectance=-0.1), "reflectance = -0.1: must be finite and not negative"),
        (lambda: plane(reflectance=math.nan), "reflectance = nan"),
        (lambda: plane(reflectance=albedo_map(-np.ones((2, 2)), 1.0)), "reflectance = -1"),
        (lambda: crater(0.0), "diameter_m = 0"),
        (lambda: crater(20.0, -1.0), "rim_height_m"),
        (lambda: crater(20.0, 3.0, rim_height_m=4.0), "must be 0 to depth_m = 3"),
        (lambda: boulder(20.0, math.inf), "height_m = inf"),
        (lambda: boulder(centre_m=(0.0, math.nan)), "centre_m"),
        (lambda: boulder(exponent=0.5), "exponent = 0.5: must be at least 1"),
        (lambda: from_array(np.zeros(5), 1.0), r"shape \(5,\)"),
        (lambda: from_array(np.zeros((1, 5)), 1.0), "at least 2 x 2"),
        (lambda: from_array(np.zeros((3, 3)), 0.0), "spacing_m = 0.0"),
        (lambda: from_array([[0.0, math.inf], [0.0, 0.0]], 1.0), "not finite"),
        (lambda: Grid(np.zeros((2, 2)), 1.0, math.nan, 0.0), "must be finite"),
        (lambda: Grid(np.zeros((2, 2)), 1.0, 0.0, 0.0, np.ones((3, 3), dtype=bool)), "known of shape"),
        (lambda: Surface("dtm", (0.1, 0.0), Grid(np.zeros((2, 2)), 1.0, 0.0, 0.0)), "beside a grid"),
        (lambda: Surface("plane", (math.inf, 0.0)), "must be finite"),
    ],
)
def test_an_impossible_surface_is_refused_in_one_line(build: object, words: str) -> None:
    assert callable(build)
    with pytest.raises(RefusedInput, match=words) as refusal:
        build()
    assert "\n" not in str(refusal.value)
