from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from belahil.errors import RefusedInput
from procedures.energy_fit import bins, clusters, fit_energy


@given(
    slope=st.floats(1e-8, 1e-6),
    intercept=st.floats(-3e-16, 3e-16),
    count=st.integers(3, 12),
    each=st.integers(1, 4),
)
def test_points_on_a_line_give_the_line(slope: float, intercept: float, count: int, each: int) -> None:
    x = np.repeat(np.linspace(20e-9, 110e-9, count), each)

    found = fit_energy(x, slope * x + intercept, np.repeat(np.arange(count), each))

    assert found is not None
    assert found.slope.value == pytest.approx(slope, rel=1e-9)
    assert found.intercept.value == pytest.approx(intercept, abs=1e-9 * slope * 1e-7)
    assert np.abs(found.ratios - 1).max() < 1e-9
    assert found.left_rms < 1e-9


def test_numpys_weighted_line_is_the_judge() -> None:
    rng = np.random.default_rng(1)
    group = rng.integers(0, 7, 200)
    x = (20 + 12 * group + rng.normal(0, 0.5, 200)) * 1e-9
    y = 3e-7 * x + 1e-16 + 1e-16 * rng.normal(size=200)
    weight = rng.uniform(0.5, 4, 200)

    found = fit_energy(x, y, group, weight)

    # polyfit squares its weights
    share = weight / np.bincount(group, weight)[group]
    slope, intercept = np.polyfit(x, y, 1, w=np.sqrt(share))
    assert found is not None
    assert found.slope.value == pytest.approx(slope, rel=1e-9)
    assert found.intercept.value == pytest.approx(intercept, rel=1e-6)
    assert np.array_equal(found.places_s, np.sort(found.places_s))


@pytest.mark.parametrize("each", [4, 12])
def test_the_uncertainty_is_the_spread_over_repetitions(each: int) -> None:
    # Given a curve that is no line, and noise that falls with the amplitude
    rng = np.random.default_rng(each)
    group = np.repeat(np.arange(8), each)
    x = (20 + 12 * group) * 1e-9
    curve = (3e-7 * x + 1e-16) * (1 + 0.05 * np.sin(group))
    amplitude = np.tile([1.0, 3.0], x.size // 2)
    slopes, stated, worst = [], [], []
    for _ in range(400):
        y = curve + 2e-16 / amplitude * rng.normal(size=x.size)
        found = fit_energy(x, y, group, amplitude**2)
        assert found is not None
        slopes.append(found.slope.value)
        stated.append(found.slope.standard_uncertainty)
        worst.append((found.ratios, found.ratio_u))

    # 400 repetitions tell a spread to 3.5 %, and a variance of few points has a mean that is right
    assert np.std(slopes) == pytest.approx(np.sqrt(np.mean(np.square(stated))), rel=4 * 0.036)
    ratios, ratio_u = (np.array(one) for one in zip(*worst, strict=True))
    np.testing.assert_allclose(np.std(ratios, axis=0), np.sqrt(np.mean(ratio_u**2, axis=0)), rtol=0.35)


def test_what_is_left_after_the_curve_is_the_scatter_and_not_the_curve() -> None:
    rng = np.random.default_rng(3)
    x = rng.uniform(20e-9, 110e-9, 4000)
    curve = 1 + 0.1 * np.cos(x / 30e-9)
    y = 3e-7 * x * curve * (1 + 0.02 * rng.normal(size=x.size))

    found = fit_energy(x, y, bins(x, 40))

    assert found is not None
    assert abs(found.largest_deviation.value) > 0.05
    assert found.left_rms == pytest.approx(0.02, rel=0.06)
    np.testing.assert_allclose(found.energy_per_volt(x) / (3e-7 * x * curve), 1, atol=0.03)


def test_beyond_the_last_group_the_curve_stays_as_it_is() -> None:
    x = np.repeat([20e-9, 50e-9, 100e-9], 2)
    found = fit_energy(x, 3e-7 * x * np.repeat([0.9, 1.0, 1.1], 2), np.repeat([0, 1, 2], 2))

    assert found is not None
    beyond = found.energy_per_volt([10e-9, 150e-9]) / found.line([10e-9, 150e-9])
    assert beyond.tolist() == pytest.approx([found.ratios[0], found.ratios[-1]])


def test_too_few_groups_have_no_fit() -> None:
    assert fit_energy([1e-8, 1e-8, 2e-8], [1e-15, 1e-15, 2e-15], [0, 0, 1]) is None
    assert fit_energy([], [], []) is None


@pytest.mark.parametrize(
    ("x", "y", "weights"),
    [
        ([1e-8, 2e-8], [1e-15], None),
        ([1e-8, np.nan, 3e-8], [1e-15] * 3, None),
        ([1e-8, 2e-8, 3e-8], [1e-15] * 3, [1.0, 0.0, 1.0]),
    ],
)
def test_what_is_no_row_of_points_is_refused(x: list[float], y: list[float], weights: list[float]) -> None:
    with pytest.raises(RefusedInput):
        fit_energy(x, y, range(len(x)), weights)


def test_widths_are_told_apart_where_they_differ() -> None:
    widths = np.array([40e-9, 20e-9, 20.1e-9, 40.2e-9, 80e-9, 19.95e-9])
    assert clusters(widths).tolist() == [1, 0, 0, 1, 2, 0]
    assert clusters([]).tolist() == []
    assert np.bincount(bins(np.arange(100.0), 8)).tolist() == pytest.approx([12.5] * 8, abs=1)
