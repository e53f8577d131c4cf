"""Fractal relief: the laws that hold exactly, and draws judged by their own standard errors."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.fft import idctn, irfft2

from belahil.errors import RefusedInput
from sim.terrain import plane
from sim.terrain_fractal import monofractal, multifractal
from sim.terrain_grid import Grid
from sim.terrain_statistics import hurst_exponent, rms_deviation
from sim.terrain_synthesis import (
    LogStableCascade,
    Torus,
    extremal_stable,
    fractional_brownian,
    integrated_flux,
    moment_exponent,
    quadrant_distance,
)

Array = NDArray[np.float64]

# Standard errors; one number in 16 000 is farther off by chance. Seeds are fixed: no test fails now and then.
ERRORS = 4.0


def stream(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def mean_and_error(draws: Array) -> tuple[Array, Array]:
    """Over the first axis."""
    return draws.mean(axis=0), draws.std(axis=0, ddof=1) / np.sqrt(len(draws))


def mean_square(heights: Array, lag: int) -> float:
    """The oracle of small grids: one increment along the rows, one along the columns, one diagonal."""
    return float(np.mean((heights[:, lag:] - heights[:, :-lag]) ** 2))


# ---- fractional Brownian surfaces


@pytest.mark.parametrize("hurst", [0.05, 0.3, 0.5, 0.75, 0.751, 0.8, 0.95, 0.99])
@pytest.mark.parametrize("count", [2, 9, 17, 40])
def test_the_embedding_holds_the_law_between_any_two_posts(hurst: float, count: int) -> None:
    torus = Torus(count, hurst)

    # given the covariance of the torus, by the transform that the synthesis uses, and the random slope
    covariance = idctn(torus.power, type=1)[:count, :count]
    distance = quadrant_distance(torus.posts)[:count, :count]
    slope_variance = np.var([torus.slope(stream(seed))[1, 0] for seed in range(400)])
    farthest = distance[-1, -1]
    slope_exact = (farthest ** (2 * hurst) - 2 * (covariance[0, 0] - covariance[-1, -1])) / farthest**2

    # then all increments are a power of the distance, with one and the same variance of the slope
    increments = 2 * (covariance[0, 0] - covariance) + slope_exact * distance**2
    roundings = 16 * np.finfo(float).eps * max(covariance[0, 0], increments.max())
    np.testing.assert_allclose(increments, distance ** (2 * hurst), rtol=0, atol=roundings)
    assert slope_variance == pytest.approx(slope_exact, rel=ERRORS * np.sqrt(2 / 400))


def test_a_spectrum_cut_out_of_white_noise_has_the_covariance_asked_for() -> None:
    torus = Torus(5, 0.6)
    impulse = np.zeros((torus.posts, torus.posts))
    impulse[0, 0] = 1.0

    response = torus.cut_out(impulse, torus.power)

    np.testing.assert_allclose(response, idctn(torus.power, type=1)[:5, :5], atol=1e-12)


@pytest.mark.parametrize("hurst", [0.3, 0.8])
def test_drawn_surfaces_follow_the_law(hurst: float) -> None:
    lags = np.array([1, 2, 4, 8, 16, 32])
    draws = np.array(
        [
            [mean_square(heights, lag) for lag in lags]
            for heights in (fractional_brownian(33, hurst, stream(seed)) for seed in range(300))
        ]
    )

    mean, error = mean_and_error(draws)

    assert np.all(np.abs(mean - lags ** (2 * hurst)) < ERRORS * error)
    assert np.all(error < 0.15 * mean)


def test_plain_synthesis_on_a_periodic_square_does_not() -> None:
    """The naive form, kept to show what the embedding is for: exact expectation, no draws."""
    hurst, posts = 0.8, 128
    k = np.hypot(np.fft.fftfreq(posts)[:, None], np.fft.rfftfreq(posts))
    k[0, 0] = np.inf
    covariance = irfft2(k ** -(2 * hurst + 2), s=(posts, posts))
    lags = np.array([2, 4, 8, 16, 32])

    rms = np.sqrt(2 * (covariance[0, 0] - covariance[0, lags]))

    exponents = np.diff(np.log(rms)) / np.diff(np.log(lags))
    # then it is too small already at a fortieth of the side, and far too small at a fifth
    assert exponents[0] < hurst - 0.04
    assert exponents[-1] < hurst - 0.2


def test_a_fractal_surface_has_the_deviation_that_was_asked_for() -> None:
    surface = monofractal(
        extent_m=150.0, spacing_m=1.5, hurst=0.7, rms_deviation_m=0.8, baseline_m=25.0, seed=5
    )

    found = rms_deviation(surface, [25.0])

    assert found.baseline_m.tolist() == [25.5]
    assert found.rms_m[0] == pytest.approx(0.8 * (25.5 / 25.0) ** 0.7, rel=1e-12)
    assert surface.height(0.0, 0.0) == 0.0
    assert (surface.kind, surface.spacing_m) == ("fractal", 1.5)
    assert surface.bounds == (-75.0, 75.0, -75.0, 75.0)


def test_the_estimated_exponent_is_the_one_asked_for() -> None:
    surfaces = [
        monofractal(extent_m=64.0, spacing_m=1.0, hurst=0.6, baseline_m=8.0, seed=seed) for seed in range(60)
    ]
    found = [hurst_exponent(rms_deviation(surface, [1, 2, 4, 8])).exponent for surface in surfaces]

    mean, error = mean_and_error(np.array(found))

    assert error < 0.006
    # Logarithms of noisy means, each too small by half a relative variance, bend the line by less than this.
    assert abs(mean - 0.6) < ERRORS * error + 0.003


def test_seeds_scale_and_slope_do_not_reshuffle_the_relief() -> None:
    small = {"extent_m": 40.0, "spacing_m": 2.0, "baseline_m": 10.0}
    one = monofractal(**small, seed=3)
    x, y = np.meshgrid(np.linspace(-20, 20, 7), np.linspace(-20, 20, 7))

    same, other = monofractal(**small, seed=3), monofractal(**small, seed=4)
    double = monofractal(**small, seed=3, rms_deviation_m=2.0)
    leaning = monofractal(**small, seed=3, slope_deg=10.0, azimuth_deg=70.0)

    assert np.array_equal(one.height(x, y), same.height(x, y))
    assert not np.allclose(one.height(x, y), other.height(x, y))
    np.testing.assert_allclose(double.height(x, y), 2 * one.height(x, y), atol=1e-12)
    np.testing.assert_allclose(
        leaning.height(x, y), one.height(x, y) + plane(10.0, 70.0).height(x, y), atol=1e-12
    )
    assert monofractal(**small, reflectance=0.3).reflectance(0.0, 0.0) == 0.3


# ---- universal multifractals


@pytest.mark.parametrize("alpha", [0.5, 0.8, 1.2, 1.8, 2.0])
def test_extremal_stable_numbers_have_their_laplace_transform(alpha: float) -> None:
    numbers = extremal_stable(alpha, (400_000,), stream(2))

    for order in (0.25, 0.5, 1.0):
        mean, error = mean_and_error(np.exp(order * numbers))
        assert abs(mean - np.exp(np.sign(alpha - 1) * order**alpha)) < ERRORS * error


def test_index_two_is_normal() -> None:
    numbers = extremal_stable(2.0, (200_000,), stream(3))

    assert np.var(numbers) == pytest.approx(2.0, rel=ERRORS * np.sqrt(2 / 200_000))
    assert np.mean(numbers**4) == pytest.approx(12.0, rel=ERRORS * np.sqrt(32 / 3 / 200_000))


@pytest.mark.parametrize(("alpha", "c1"), [(0.7, 0.1), (1.5, 0.15), (1.8, 0.1), (2.0, 0.05)])
def test_the_moments_of_the_flux_scale_with_k_of_q(alpha: float, c1: float) -> None:
    cascade = LogStableCascade(64, alpha, c1)
    draws = stream(8)
    orders = np.array([0.25, 0.5, 1.0, 1.5, 2.0])

    moments = np.array(
        [[np.mean(flux**order) for order in orders] for flux in (cascade.draw(draws) for _ in range(250))]
    )

    mean, error = mean_and_error(moments)
    exact = np.exp([cascade.log_ratio * moment_exponent(order, alpha, c1) for order in orders])
    assert np.all(np.abs(mean - exact) < ERRORS * error)
    assert np.all(error < 0.1 * exact)


@pytest.mark.parametrize(("alpha", "c1"), [(1.5, 0.15), (1.8, 0.1), (2.0, 0.05)])
def test_the_flux_averaged_over_boxes_scales_with_k_of_two(alpha: float, c1: float) -> None:
    """Exact: the mean square over a box is the mean of the two-point moment over its pairs."""
    posts = 256
    cascade = LogStableCascade(posts, alpha, c1)
    two_point = 1 + idctn(cascade.power, type=1)

    def mean_square_of_box(side: int) -> float:
        lag = np.arange(side)
        pairs = (side - lag) * np.where(lag == 0, 1, 2) / side**2
        return float(pairs @ two_point[:side, :side] @ pairs)

    boxes = np.array([4, 8, 16, 32, 64])
    logs = np.log([mean_square_of_box(side) for side in boxes])

    assert two_point[0, 0] == pytest.approx(np.exp(cascade.log_ratio * moment_exponent(2, alpha, c1)))
    # A disc of few posts is no circle: 3 % from 4 to 8 posts, 1 % beyond.
    slopes = -np.diff(logs) / np.log(2) / moment_exponent(2.0, alpha, c1)
    np.testing.assert_allclose(slopes, 1.0, atol=0.03)
    np.testing.assert_allclose(slopes[1:], 1.0, atol=0.01)


def test_the_spectrum_of_the_flux_is_that_of_its_draws() -> None:
    cascade = LogStableCascade(32, 1.8, 0.1)
    draws = stream(12)
    lags = np.array([0, 1, 3, 8, 16])

    products = np.array(
        [
            [np.mean(flux * np.roll(flux, lag, axis=1)) for lag in lags]
            for flux in (cascade.draw(draws) for _ in range(600))
        ]
    )

    mean, error = mean_and_error(products)
    assert np.all(np.abs(mean - 1 - idctn(cascade.power, type=1)[0, lags]) < ERRORS * error)


def test_the_integration_is_of_order_h_between_spacing_and_extent() -> None:
    hurst, alpha, c1 = 0.8, 1.8, 0.1
    torus = Torus(257, hurst - moment_exponent(2.0, alpha, c1) / 2)
    cascade = LogStableCascade(torus.posts, alpha, c1)
    waves = np.arange(4, 129)

    amplitude = np.sqrt(torus.power / cascade.power)[0, waves]

    slope = np.polyfit(np.log(waves), np.log(amplitude), 1)[0]
    assert slope == pytest.approx(-hurst, abs=0.02)


@pytest.mark.slow
def test_multifractal_increments_follow_the_law_and_are_intermittent() -> None:
    hurst, alpha, c1 = 0.8, 1.8, 0.1
    exponent = hurst - moment_exponent(2.0, alpha, c1) / 2
    lags = np.array([1, 2, 4, 8, 16])
    draws = stream(21)

    def absolute(heights: Array, order: float) -> list[float]:
        return [float(np.mean(np.abs(heights[:, lag:] - heights[:, :-lag]) ** order)) for lag in lags]

    many = [integrated_flux(33, hurst, alpha, c1, draws) for _ in range(300)]
    gaussian = [fractional_brownian(33, exponent, draws) for _ in range(300)]

    # then the mean square follows its law
    mean, error = mean_and_error(np.array([absolute(heights, 2.0) for heights in many]))
    assert np.all(np.abs(mean - lags ** (2 * exponent)) < ERRORS * error)
    # and large increments are more frequent at short distances, which those of a monofractal are not
    flatness = [
        np.mean([absolute(heights, 4.0) for heights in surfaces], axis=0)
        / np.mean([absolute(heights, 2.0) for heights in surfaces], axis=0) ** 2
        for surfaces in (many, gaussian)
    ]
    assert flatness[0][0] > 2 * flatness[0][-1]
    assert flatness[1][0] == pytest.approx(flatness[1][-1], rel=0.3)


def test_a_multifractal_surface_has_the_deviation_that_was_asked_for() -> None:
    options = {"extent_m": 96.0, "spacing_m": 1.5, "rms_deviation_m": 0.5, "baseline_m": 24.0, "seed": 2}
    surface = multifractal(**options, hurst=0.7, alpha=1.6, c1=0.1, slope_deg=5.0, reflectance=0.1)
    level = multifractal(**options, hurst=0.7, alpha=1.6, c1=0.1)

    assert surface.kind == "multifractal"
    assert isinstance(level.relief, Grid)
    assert rms_deviation(level, [24.0]).rms_m[0] == pytest.approx(0.5, rel=1e-12)
    assert surface.height(30.0, 10.0) - level.height(30.0, 10.0) == pytest.approx(
        float(plane(5.0).height(30.0, 0.0))
    )
    assert surface.reflectance(0.0, 0.0) == 0.1


def test_without_intermittence_it_is_the_monofractal() -> None:
    options = {"extent_m": 30.0, "spacing_m": 1.5, "baseline_m": 6.0}

    surface = multifractal(**options, c1=0.0)

    assert surface.kind == "multifractal"
    assert surface.height(3.0, 4.0) == monofractal(**options).height(3.0, 4.0)


# ---- what is refused


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: monofractal(hurst=1.0), "an exponent of 1 on 513 posts"),
        (lambda: monofractal(hurst=0.0), "above 0 and below 1"),
        (lambda: monofractal(spacing_m=0.0), "spacing_m = 0"),
        (lambda: monofractal(extent_m=1.0), "not below the spacing"),
        (lambda: monofractal(spacing_m=0.1), r"allowed are 8192, so make extent_m smaller"),
        (lambda: monofractal(extent_m=30, baseline_m=65), "the baseline 1.5 to 30"),
        (lambda: monofractal(extent_m=30, baseline_m=6, rms_deviation_m=0), "rms_deviation_m = 0"),
        (lambda: multifractal(extent_m=30, alpha=1.0), "alpha = 1, c1 = 0.1"),
        (lambda: multifractal(extent_m=30, alpha=2.1), "not within 0.01 of 1"),
        (lambda: multifractal(extent_m=30, c1=-0.1), "c1 must not be negative"),
        (lambda: multifractal(extent_m=30, c1=1.5), "the RMS deviation must grow"),
        (lambda: integrated_flux(5, 0.8, 1.8, 0.0, stream(1)), "c1 = 0: a flux that varies"),
    ],
)
def test_an_impossible_fractal_is_refused_in_one_line(build: object, words: str) -> None:
    assert callable(build)
    with pytest.raises(RefusedInput, match=words) as refusal:
        build()
    assert "\n" not in str(refusal.value)
