"""Intervals: exact against the distributions that define them, and by how often they cover."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from belahil.errors import RefusedInput
from procedures.intervals import (
    Interval,
    clopper_pearson,
    deviation_interval,
    difference,
    effective_freedom,
    mean_interval,
    mean_of,
    normal_factor,
)

levels = st.sampled_from([0.5, 0.9, 0.95, 0.999])
counts = st.integers(1, 400).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


@given(counts, levels)
def test_ends_of_a_proportion_are_where_the_tails_have_their_share(of: tuple[int, int], level: float) -> None:
    count, trials = of
    found = clopper_pearson(count, trials, level)
    tail = (1 - level) / 2
    assert found.low <= count / trials <= found.high
    # Then so many or more have the tail's probability at the lower end, so many or fewer at the upper one
    if count:
        assert stats.binom.sf(count - 1, trials, found.low) == pytest.approx(tail, rel=1e-9)
    else:
        assert found.low == 0
    if count < trials:
        assert stats.binom.cdf(count, trials, found.high) == pytest.approx(tail, rel=1e-9)
    else:
        assert found.high == 1


def wilson(count: int, trials: int, level: float) -> Interval:
    z = normal_factor(level)
    share = count / trials
    middle, reach = (
        share + z**2 / (2 * trials),
        z * math.sqrt(share * (1 - share) / trials + z**2 / (4 * trials**2)),
    )
    return Interval(share, (middle - reach) / (1 + z**2 / trials), (middle + reach) / (1 + z**2 / trials))


@pytest.mark.parametrize("trials", [5, 30, 100])
@pytest.mark.parametrize("level", [0.9, 0.95])
def test_a_proportion_is_covered_at_least_as_often_as_said_everywhere(trials: int, level: float) -> None:
    # Given the exact probability of every count at many proportions
    places = np.linspace(0.002, 0.998, 499)
    weights = stats.binom.pmf(np.arange(trials + 1)[:, None], trials, places)

    def coverage(interval: object) -> np.ndarray:
        ends = [interval(count, trials, level) for count in range(trials + 1)]  # type: ignore[operator]
        inside = [(one.low <= places) & (places <= one.high) for one in ends]
        return np.asarray((weights * np.array(inside)).sum(axis=0))

    # Then Clopper and Pearson's covers as often as said or more, and the score interval does not
    assert coverage(clopper_pearson).min() >= level
    assert coverage(wilson).min() < level - 0.02


@given(st.integers(2, 500), levels, st.floats(1e-12, 1e3))
def test_the_interval_of_a_deviation_is_that_of_chi_square(
    count: int, level: float, deviation: float
) -> None:
    found = deviation_interval(deviation, count - 1, level)
    low, high = (
        deviation * math.sqrt((count - 1) / stats.chi2.ppf(at, count - 1))
        for at in (1 - (1 - level) / 2, (1 - level) / 2)
    )
    # of a few values the likeliest deviation lies outside an interval of little level
    assert found.low == pytest.approx(min(low, deviation), rel=1e-9)
    assert found.high == pytest.approx(max(high, deviation), rel=1e-9)


def test_normal_values_have_one_degree_of_freedom_less_than_values() -> None:
    assert effective_freedom(50, 3.0) == pytest.approx(49)
    # and a long tail leaves fewer: a Laplace distribution has a kurtosis of 6
    assert effective_freedom(50, 6.0) == pytest.approx(100 / (6 - 47 / 49))


@pytest.mark.parametrize(
    ("draw", "kurtosis"),
    [("normal", 3.0), ("laplace", 6.0), ("uniform", 1.8)],
)
@pytest.mark.parametrize("count", [40, 200])
def test_a_deviation_is_covered_whatever_the_tails(draw: str, kurtosis: float, count: int) -> None:
    # Given 2000 samples of a distribution with known deviation
    rng = np.random.default_rng(count)
    truth = {"normal": 1.0, "laplace": math.sqrt(2), "uniform": 1 / math.sqrt(12)}[draw]
    found = getattr(rng, draw)(size=(2000, count)).std(axis=1, ddof=1)
    freedom = effective_freedom(count, kurtosis)
    covered = np.mean([deviation_interval(one, freedom).holds(truth) for one in found])
    # Then the share is 95 % within four standard deviations of 2000 trials; the second moment of a sample
    # variance is matched, its skewness is not: that leaves 1 % for a Laplace distribution
    assert covered == pytest.approx(0.95, abs=4 * math.sqrt(0.95 * 0.05 / 2000) + 0.01 * (draw == "laplace"))
    if draw == "laplace":
        plain = np.mean([deviation_interval(one, count - 1).holds(truth) for one in found])
        assert plain < 0.85


@given(st.floats(-1e3, 1e3), st.floats(1e-6, 1e3), st.integers(2, 500), levels)
def test_the_interval_of_a_mean_is_students(mean: float, deviation: float, count: int, level: float) -> None:
    found = mean_interval(mean, deviation, count, level)
    expected = stats.t.interval(level, count - 1, mean, deviation / math.sqrt(count))
    assert (found.low, found.high) == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(("measured", "model"), [(30, 30), (20, 300), (100, 1000)])
def test_equal_proportions_have_zero_in_the_interval_of_their_difference(measured: int, model: int) -> None:
    # Given the exact probability of every pair of counts at a proportion
    level = 0.95
    ends = [[clopper_pearson(k, n, level) for k in range(n + 1)] for n in (measured, model)]
    for place in (0.01, 0.1, 0.35, 0.5, 0.9, 0.999):
        few, many = (stats.binom.pmf(np.arange(n + 1), n, place) for n in (measured, model))
        likely = [(i, j) for i in np.flatnonzero(few > 1e-7) for j in np.flatnonzero(many > 1e-7)]
        missed = sum(few[i] * many[j] for i, j in likely if not difference(ends[0][i], ends[1][j]).holds(0.0))
        # Then zero is left out no oftener than said
        assert missed <= 1 - level


@pytest.mark.parametrize("level", [0.9, 0.95, 0.999])
def test_the_mean_of_proportions_is_covered_as_often_as_said(level: float) -> None:
    # Given 3000 draws of six proportions of 60 trials each, from seldom to always
    rng, places = np.random.default_rng(2), np.array([0.02, 0.2, 0.5, 0.8, 0.98, 1.0])
    ends = [clopper_pearson(count, 60, level) for count in range(61)]
    counts = rng.binomial(60, places, size=(3000, places.size))
    covered = np.mean([mean_of([ends[count] for count in row]).holds(places.mean()) for row in counts])
    # Then their mean is covered at least as often, but for chance
    assert covered >= level - 3 * math.sqrt(level * (1 - level) / 3000)


def test_a_known_error_widens_in_squares() -> None:
    found = Interval(0.5, 0.2, 0.9).widened(0.1, 0.95)
    assert found.low == pytest.approx(0.5 - math.hypot(0.3, 0.196), abs=1e-4)
    assert found.high == pytest.approx(0.5 + math.hypot(0.4, 0.196), abs=1e-4)
    assert Interval(0.5, 0.2, 0.9).widened(0.0, 0.95) == Interval(0.5, 0.2, 0.9)


def test_what_is_no_interval_is_refused() -> None:
    for count, trials in ((-1, 3), (4, 3), (0, 0)):
        with pytest.raises(RefusedInput, match="at least 1"):
            clopper_pearson(count, trials)
    with pytest.raises(RefusedInput, match="level"):
        clopper_pearson(1, 3, 1.0)
    with pytest.raises(RefusedInput, match="both above 0"):
        deviation_interval(0.0, 3)
