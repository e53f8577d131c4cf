"""RMS deviation, Hurst exponent, slopes and plane fits against slow and obvious forms."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from belahil.errors import RefusedInput
from sim.terrain import boulder, plane
from sim.terrain_dtm import from_array
from sim.terrain_grid import OffTerrain
from sim.terrain_statistics import (
    RmsDeviation,
    hurst_exponent,
    plane_fit,
    rms_deviation,
    slope_map,
)

Array = NDArray[np.float64]


def sloping(rows: int = 30, columns: int = 40, spacing_m: float = 0.5) -> Array:
    x, y = np.meshgrid(np.arange(columns) * spacing_m, np.arange(rows) * spacing_m)
    return 0.3 * x - 0.1 * y


# ---- RMS deviation and Hurst exponent


def test_the_rms_deviation_of_a_plane_is_its_climb() -> None:
    found = rms_deviation(from_array(sloping(30, 30), 0.5), [0.5, 3.0, 14.5])

    expected_m = found.baseline_m * math.sqrt((0.3**2 + 0.1**2) / 2)
    np.testing.assert_allclose(found.rms_m, expected_m, rtol=1e-12)
    assert found.pairs.tolist() == [2 * 30 * 29, 2 * 30 * 24, 2 * 30]
    hurst = hurst_exponent(found)
    assert (hurst.status, hurst.exponent) == ("ok", pytest.approx(1.0, rel=1e-12))
    assert hurst.scatter < 1e-12


def deviation_by_loops(heights: Array, lag: int) -> tuple[float, int]:
    total, count = 0.0, 0
    rows, columns = heights.shape
    for row in range(rows):
        for column in range(columns):
            for other in ((row, column + lag), (row + lag, column)):
                if other[0] < rows and other[1] < columns:
                    climb = heights[other] - heights[row, column]
                    if not math.isnan(climb):
                        total += climb**2
                        count += 1
    return math.sqrt(total / count), count


@given(seed=st.integers(0, 2**32 - 1), gaps=st.sampled_from([0.0, 0.2, 0.6]), lag=st.integers(1, 7))
def test_rms_deviation_counts_each_pair_with_data_once(seed: int, gaps: float, lag: int) -> None:
    stream = np.random.default_rng(seed)
    heights = 1e3 + stream.standard_normal((6, 9))
    heights[stream.random((6, 9)) < gaps] = np.nan
    heights[0, 0], heights[0, lag] = 1000.0, 1001.0

    found = rms_deviation(from_array(heights, 2.0), [2.0 * lag])

    expected_m, pairs = deviation_by_loops(heights, lag)
    assert found.rms_m[0] == pytest.approx(expected_m, rel=1e-9)
    assert found.pairs[0] == pairs


def test_baselines_are_rounded_to_the_grid_and_told() -> None:
    found = rms_deviation(from_array(sloping(), 0.5), [3.1, 0.01, 2.9, 1.0])

    assert found.baseline_m.tolist() == [0.5, 1.0, 3.0]


@given(exponent=st.floats(0.05, 0.95), factor=st.floats(1e-3, 1e3))
def test_the_exponent_of_a_power_law_is_found(exponent: float, factor: float) -> None:
    baseline_m = np.array([1.0, 2.0, 5.0, 30.0])

    found = hurst_exponent(
        RmsDeviation(baseline_m, factor * baseline_m**exponent, np.ones(4, dtype=np.int64))
    )

    assert found.exponent == pytest.approx(exponent, abs=1e-12)


def test_the_scatter_about_the_line_is_told() -> None:
    rms_m = np.exp([0.1, 1.0 - 0.2, 2.0 + 0.1])
    found = hurst_exponent(RmsDeviation(np.exp([0.0, 1.0, 2.0]), rms_m, np.ones(3, dtype=np.int64)))

    assert found.exponent == pytest.approx(1.0)
    assert found.scatter == pytest.approx(math.sqrt((0.01 + 0.04 + 0.01) / 3))


def test_what_has_no_exponent_has_a_status() -> None:
    flat = rms_deviation(from_array(np.full((5, 5), 8.0), 1.0), [1, 2])
    one = rms_deviation(from_array(sloping(), 0.5), [1.0])

    assert (hurst_exponent(flat).exponent, hurst_exponent(flat).status) == (None, "flat")
    assert (hurst_exponent(one).exponent, hurst_exponent(one).status) == (None, "too few baselines")


def test_statistics_that_cannot_be_had_are_refused() -> None:
    islands = np.full((4, 4), np.nan)
    islands[0, 0] = islands[3, 3] = 1.0
    with pytest.raises(OffTerrain, match="baseline 1 m: no two posts"):
        rms_deviation(from_array(islands, 1.0), [1.0])
    with pytest.raises(OffTerrain, match="no four posts with data"):
        slope_map(from_array(islands, 1.0), 1.0)
    with pytest.raises(OffTerrain, match="baseline 40 m"):
        rms_deviation(from_array(np.zeros((4, 4)), 1.0), [40.0])
    with pytest.raises(OffTerrain, match="slopes over 40 m: the grid has 4 x 4 posts"):
        slope_map(from_array(np.zeros((4, 4)), 1.0), 40.0)
    with pytest.raises(RefusedInput, match="not a shape in closed form"):
        rms_deviation(plane(10.0), [1.0])
    with pytest.raises(RefusedInput, match="at no baseline"):
        rms_deviation(from_array(np.zeros((4, 4)), 1.0), [])
    with pytest.raises(RefusedInput, match="baseline nan m"):
        rms_deviation(from_array(np.zeros((4, 4)), 1.0), [math.nan])


# ---- slopes


def test_the_slope_map_of_a_plane_is_its_slope_where_it_is_known() -> None:
    heights = sloping()
    heights[10, 20] = np.nan

    found = slope_map(from_array(heights, 0.5), 2.0)

    assert found.baseline_m == 2.0
    assert found.slope_rad.shape == (26, 36)
    np.testing.assert_allclose(found.slope_rad[found.known], math.atan(math.hypot(0.3, 0.1)), rtol=1e-12)
    assert np.argwhere(~found.known).tolist() == [[6, 18], [8, 16], [8, 20], [10, 18]]
    assert found.slope_rad[6, 18] == 0.0


def test_the_slope_map_does_not_depend_on_the_direction_of_the_axes() -> None:
    heights = np.random.default_rng(6).standard_normal((20, 24))

    for baseline_m in (2.0, 6.0):  # an odd number of spacings has its middle between two posts
        there = slope_map(from_array(heights, 1.0), baseline_m).slope_rad
        back = slope_map(from_array(heights[::-1, ::-1], 1.0), baseline_m).slope_rad
        np.testing.assert_allclose(back[::-1, ::-1], there, rtol=1e-12)


# ---- plane fit


def exact_fit(x: Array, y: Array, z: Array, weight: Array) -> tuple[Fraction, Fraction, Fraction, Fraction]:
    """dz/dx, dz/dy, variance and third central moment in exact arithmetic on the very numbers given."""
    rows = [tuple(Fraction(float(value)) for value in row) for row in zip(x, y, z, weight, strict=True)]
    total = sum(row[3] for row in rows)

    def mean(index: int) -> Fraction:
        return sum((row[3] * row[index] for row in rows), Fraction(0)) / total

    means = [mean(index) for index in range(3)]
    moved = [(*(row[index] - means[index] for index in range(3)), row[3]) for row in rows]

    def moment(first: int, second: int) -> Fraction:
        return sum((row[3] * row[first] * row[second] for row in moved), Fraction(0)) / total

    xx, xy, yy, xz, yz = moment(0, 0), moment(0, 1), moment(1, 1), moment(0, 2), moment(1, 2)
    determinant = xx * yy - xy * xy
    gx, gy = (yy * xz - xy * yz) / determinant, (xx * yz - xy * xz) / determinant
    left = [(row[2] - gx * row[0] - gy * row[1], row[3]) for row in moved]
    second = sum((w * r**2 for r, w in left), Fraction(0)) / total
    third = sum((w * r**3 for r, w in left), Fraction(0)) / total
    return gx, gy, second, third


def footprint(datum_m: float, relief_m: float = 0.3) -> tuple[Array, Array, Array, Array]:
    stream = np.random.default_rng(11)
    x, y = stream.uniform(-25, 25, (2, 120))
    bumps = stream.exponential(relief_m, 120)
    weight = np.exp(-(x**2 + y**2) / (2 * 6.25**2))
    return x, y, datum_m + 0.18 * x - 0.05 * y + bumps, weight


# The names of the hard cases: large offsets, and heights in single precision.
@pytest.mark.parametrize("datum_m", [0.0, 1737.4e3, -2439.7e3, 1e9])
@pytest.mark.parametrize("place_m", [0.0, 1.587e5])
def test_h10_moments_keep_their_digits_on_any_datum(datum_m: float, place_m: float) -> None:
    x, y, z, weight = footprint(datum_m)
    x = x + place_m

    found = plane_fit(x, y, z, weight)

    gx, gy, second, third = exact_fit(x, y, z, weight)
    assert found.gradient == pytest.approx((float(gx), float(gy)), rel=1e-12)
    assert found.roughness_m == pytest.approx(math.sqrt(second), rel=1e-12)
    assert found.skewness == pytest.approx(float(third) / math.sqrt(second) ** 3, rel=1e-11)
    assert found.status == "ok"


def test_h10_raw_moments_do_not() -> None:
    """The naive form, kept to show why the heights are centred first."""
    _, _, z, weight = footprint(1e9)
    share = weight / weight.sum()
    centred = z - share @ z

    naive = share @ z**2 - (share @ z) ** 2

    assert abs(naive / (share @ centred**2) - 1) > 1.0


def test_h09_heights_in_single_precision_are_taken_as_they_are() -> None:
    x, y, z, weight = footprint(1049.0)
    single = z.astype(np.float32)

    found = plane_fit(x, y, single, weight)

    _, _, second, _ = exact_fit(x, y, single.astype(np.float64), weight)
    assert found.roughness_m == pytest.approx(math.sqrt(second), rel=1e-12)


def test_h17_weights_of_a_distant_beam_do_not_vanish() -> None:
    x, y, z, weight = footprint(0.0)

    near, far = plane_fit(x, y, z, weight), plane_fit(x, y, z, weight * 1e-290)

    assert far.roughness_m == pytest.approx(near.roughness_m, rel=1e-9)
    assert far.gradient == pytest.approx(near.gradient, rel=1e-9)


def test_a_weight_counts_like_that_many_points() -> None:
    x, y, z, _ = footprint(0.0)
    times = np.arange(x.size) % 3

    weighted = plane_fit(x, y, z, times)
    repeated = plane_fit(*(np.repeat(values, times) for values in (x, y, z)))

    assert weighted.roughness_m == pytest.approx(repeated.roughness_m, rel=1e-12)
    assert weighted.skewness == pytest.approx(repeated.skewness, rel=1e-12)
    assert weighted.centre_m == pytest.approx(repeated.centre_m, rel=1e-12)


@pytest.mark.parametrize("azimuth_deg", [0.0, 30.0, 90.0, -120.0])
def test_a_boulder_at_the_centre_leaves_the_mean_slope(azimuth_deg: float) -> None:
    along = np.linspace(-20, 20, 81)
    x, y = np.meshgrid(along, along)
    weight = np.exp(-(x**2 + y**2) / (2 * 6.25**2))

    found = plane_fit(x, y, boulder(12.0, 4.0, slope_deg=10.0, azimuth_deg=azimuth_deg).height(x, y), weight)

    assert math.degrees(found.slope_rad) == pytest.approx(10.0, rel=1e-12)
    assert math.degrees(found.azimuth_rad) == pytest.approx(azimuth_deg, abs=1e-10)
    assert found.skewness is not None
    assert found.skewness > 0.5


@pytest.mark.parametrize("datum_m", [0.0, 1e6])
def test_a_plane_has_no_skewness(datum_m: float) -> None:
    x, y, _, weight = footprint(0.0)

    found = plane_fit(x, y, datum_m + plane(10.0, 20.0).height(x, y), weight)

    assert (found.status, found.skewness) == ("flat", None)
    assert found.roughness_m < 4 * np.finfo(float).eps * (datum_m + 10)
    assert math.degrees(found.slope_rad) == pytest.approx(10.0, abs=1e-9 + 1e-13 * datum_m)


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (([0, 1, 2], [0, 1, 2], [0, 5, 1]), "3 points with a weight: needs three, not on a line"),
        (([0, 1], [0, 1], [0, 5]), "2 points"),
        (([3, 3, 3], [4, 4, 4], [0, 5, 1]), "needs three"),
        (([0, 1, 0, 1], [0, 0, 1, 1], [0, 0, 0, 1], [1, 1, 0, 0]), "2 points with a weight"),
        (([0, 1, 0], [0, 0, 1], [0, 0, 0], [0, 0, 0]), "3 points: none of them has a weight"),
        (([0, 1, 0], [0, 0, 1], [0, 0, 0], [1, 1, -1]), "not negative"),
        (([0, 1, 0], [0, 0, 1], [0, 0, math.nan]), "must be finite"),
        (([], [], []), "0 points"),
    ],
)
def test_no_plane_through_points_that_span_none(points: tuple[list[float], ...], words: str) -> None:
    with pytest.raises(RefusedInput, match=words):
        plane_fit(*points)
