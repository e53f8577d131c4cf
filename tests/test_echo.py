from __future__ import annotations

import math
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from belahil import butterworth
from belahil.errors import RefusedInput
from sim import reference
from sim.accuracy import Accuracy
from sim.echo import GridEcho, echo, posts_error
from sim.footprint import DelayHistogram, NoReturn, delays, plan_footprint
from sim.footprint_plan import FootprintPlan
from sim.kernel import Kernel
from sim.laser import Laser, pulse_shape
from sim.loops import Loops, loops
from sim.terrain import Surface, plane
from sim.terrain_grid import Grid

pytest.importorskip("numba", reason="without numba the loops are the reference itself")
from sim import compiled

ALTITUDE_M = 500e3
INTERVAL_S = 12.5e-9
LASER = Laser(divergence_rad=50e-6)
KERNEL = Kernel(pulse_shape(LASER), butterworth.poles(19e6, 3))
COUPLED = Kernel(pulse_shape(LASER), butterworth.poles(19e6, 3, 100e3), 1)


def light_of(weights: np.ndarray, first_s: float, bin_s: float) -> DelayHistogram:
    return DelayHistogram(first_s, bin_s, weights, float(weights.sum()), 1.0)


def directly(kernel: Kernel, light: DelayHistogram, times_s: np.ndarray) -> np.ndarray:
    return np.asarray(
        sum(
            weight * kernel.exact(times_s - light.first_s - k * light.bin_s)
            for k, weight in enumerate(light.weights)
        )
    )


@pytest.mark.parametrize("kernel", [KERNEL, COUPLED])
@pytest.mark.parametrize("bins_per_sample", [1, 7, 3.3, 0.25, 1 / 3])
@pytest.mark.parametrize("start_bins", [-40.0, 0.0, 12.25, 4000.0])
def test_samples_are_the_sum_over_bins(kernel: Kernel, bins_per_sample: float, start_bins: float) -> None:
    # Given a histogram at any place against the samples, near or far
    bin_s = INTERVAL_S / bins_per_sample
    light = light_of(np.random.default_rng(3).standard_normal(60), 1.7e-7, bin_s)
    first_s = light.first_s + start_bins * bin_s

    samples = echo(kernel, light, first_s, INTERVAL_S, 42)

    true = directly(kernel, light, first_s + INTERVAL_S * np.arange(42))
    peak = np.abs(kernel.exact(np.linspace(0, 6e-8, 601))).max()
    # The table's tolerance, for each of 60 bins of about 1.
    np.testing.assert_allclose(samples, true, rtol=0, atol=1e-7 * peak * np.abs(light.weights).sum())


def test_where_a_histogram_is_aligned_does_not_matter() -> None:
    surface = plane(12.0, 20.0, reflectance=1.0)
    plan = plan_footprint(Accuracy(1e-6), KERNEL, LASER, ALTITUDE_M, surface, INTERVAL_S, "grid")
    first_s = -7.123e-8

    one, other = (
        echo(KERNEL, delays(surface, LASER, ALTITUDE_M, plan, align_s=at), first_s, INTERVAL_S, 42)
        for at in (first_s, 0.0)
    )

    np.testing.assert_allclose(one, other, rtol=0, atol=2e-6 * one.max())


# ---- the loops

PLACES = st.lists(
    st.tuples(st.floats(1, 28, exclude_max=True), st.floats(-10, 10, allow_subnormal=False)),
    min_size=1,
    max_size=50,
)


@given(PLACES)
def test_the_linear_deposit_conserves_two_moments(pairs: list[tuple[float, float]]) -> None:
    places, weights = np.array(pairs).T.copy()

    histogram = reference.cic_deposit(places, weights, 30)

    for power in range(2):
        assert histogram @ np.arange(30.0) ** power == pytest.approx(
            weights @ places**power, abs=1e-13 * 30**power * np.abs(weights).sum() + 1e-300
        )


@given(PLACES)
def test_the_cubic_deposit_conserves_four_moments(pairs: list[tuple[float, float]]) -> None:
    places, weights = np.array(pairs).T.copy()

    histogram = reference.lag4_deposit(places, weights, 30)

    for power in range(4):
        assert histogram @ np.arange(30.0) ** power == pytest.approx(
            weights @ places**power, abs=1e-13 * 30**power * np.abs(weights).sum() + 1e-300
        )


@given(st.integers(1, 40), st.integers(1, 60), st.integers(-80, 120), st.integers(1, 12), st.integers(1, 20))
def test_products_are_sums_over_bins(bins: int, taps: int, offset: int, stride: int, count: int) -> None:
    draw = np.random.default_rng(bins)
    histogram, tap = draw.standard_normal(bins), draw.standard_normal(taps)

    made = reference.polyphase(histogram, tap, offset, stride, count)

    for i in range(count):
        places = [(offset + i * stride - j, weight) for j, weight in enumerate(histogram)]
        true = sum(weight * tap[k] for k, weight in places if 0 <= k < taps)
        assert made[i] == pytest.approx(true, abs=1e-13 * bins)


def terrain(albedo: float | Grid = 0.2, known: np.ndarray | None = None) -> Surface:
    z = 0.3 * np.random.default_rng(4).standard_normal((90, 80)) + 0.2 * np.arange(80)
    return Surface("dtm", relief=Grid(z, 1.5, -60.0, -67.5, known), albedo=albedo)


def mapped() -> Surface:
    values = np.random.default_rng(6).uniform(0.1, 0.3, (90, 80))
    known = np.random.default_rng(7).uniform(size=(90, 80)) > 0.2
    return terrain(Grid(values, 1.5, -60.0, -67.5), known)


PLAN = FootprintPlan("grid", 1e-4, 0.2, reach=4.6, radius_m=28.8, pixel_m=1.5, bin_s=INTERVAL_S / 10)
CENTRES_M = np.array([[0.0, 0.0], [3.1, -7.7], [-55.0, 60.0], [58.0, 0.3], [500.0, 0.0]])


@pytest.mark.parametrize("surface", [terrain(), mapped(), terrain(known=mapped().relief.known)])  # type: ignore[union-attr]
@pytest.mark.parametrize("kernel", [KERNEL, COUPLED])
@pytest.mark.parametrize("which", [compiled, reference])
def test_echoes_from_posts_are_those_of_the_general_way(
    surface: Surface, kernel: Kernel, which: Loops, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Given beams on the terrain, half beside it and far beside it
    monkeypatch.setattr("sim.echo.loops", lambda: which)
    fast = GridEcho(surface, LASER, ALTITUDE_M, PLAN, kernel, INTERVAL_S, 42)
    first_s = np.array([-1.5e-7, -1.11e-7, -2e-7, -1e-7, 0.0])

    samples, energies = fast.samples(CENTRES_M, first_s)

    for k, (x, y) in enumerate(CENTRES_M):
        # The general way looks down from the origin; so the ground is moved under it.
        moved = replace(surface, relief=shifted(surface.relief, x, y), albedo=shifted(surface.albedo, x, y))
        light = delays(moved, LASER, ALTITUDE_M, PLAN, align_s=first_s[k])
        true = echo(kernel, light, first_s[k], INTERVAL_S, 42)
        # What is left out without a word, and the circle's edge at rounding.
        np.testing.assert_allclose(samples[k], true, rtol=0, atol=1e-7 * kernel_peak(kernel))
        assert energies[k] == pytest.approx(light.total, abs=1e-6)
    assert energies[4] == 0


def kernel_peak(kernel: Kernel) -> float:
    return float(np.abs(kernel.exact(np.linspace(0, 6e-8, 601))).max())


def shifted(grid: object, x: float, y: float) -> object:
    if not isinstance(grid, Grid):
        return grid
    return replace(grid, x_min_m=grid.x_min_m - x, y_min_m=grid.y_min_m - y)


def test_an_altitude_just_above_the_heights_keeps_the_slant_path() -> None:
    # Given ground and footprint that are 3.9e-3 of the altitude, under the same spot of light
    altitude_m = 11.8e3
    laser = structs.replace(LASER, divergence_rad=LASER.divergence_rad * ALTITUDE_M / altitude_m)
    fast = GridEcho(terrain(), laser, altitude_m, PLAN, KERNEL, INTERVAL_S, 42)

    samples, _ = fast.samples(CENTRES_M[:1], np.array([-1.5e-7]))

    true = echo(KERNEL, delays(terrain(), laser, altitude_m, PLAN, align_s=-1.5e-7), -1.5e-7, INTERVAL_S, 42)
    np.testing.assert_allclose(samples[0], true, rtol=0, atol=1e-7 * kernel_peak(KERNEL))


def test_light_outside_of_the_window_does_not_reach_it() -> None:
    fast = GridEcho(terrain(), LASER, ALTITUDE_M, PLAN, KERNEL, INTERVAL_S, 42)

    for first_s in (-1e-4, 1e-4):
        samples, energies = fast.samples(CENTRES_M[:1], np.array([first_s]))
        assert not samples.any()
        assert energies[0] == 0


def test_shots_do_not_depend_on_their_neighbours() -> None:
    fast = GridEcho(terrain(), LASER, ALTITUDE_M, PLAN, KERNEL, INTERVAL_S, 42)
    first_s = np.array([-1.5e-7, 3e-8, -2e-7, -1e-7, 0.0])

    together, _ = fast.samples(CENTRES_M, first_s)

    for k in range(5):
        alone, _ = fast.samples(CENTRES_M[k : k + 1], first_s[k : k + 1])
        np.testing.assert_array_equal(alone[0], together[k])


@pytest.mark.parametrize("azimuth_deg", [0.0, 90.0])
def test_an_ellipse_along_an_axis_is_let_through(azimuth_deg: float) -> None:
    laser = structs.replace(LASER, beam="elliptical", ellipticity=0.4, beam_azimuth_deg=azimuth_deg)
    fast = GridEcho(terrain(), laser, ALTITUDE_M, PLAN, KERNEL, INTERVAL_S, 42)

    samples, _ = fast.samples(CENTRES_M[:1], np.array([-1.5e-7]))

    light = delays(terrain(), laser, ALTITUDE_M, replace(PLAN, radius_m=60.0), align_s=-1.5e-7)
    true = echo(KERNEL, light, -1.5e-7, INTERVAL_S, 42)
    np.testing.assert_allclose(samples[0], true, rtol=0, atol=1e-7 * kernel_peak(KERNEL))


@pytest.mark.parametrize(
    ("surface", "laser", "plan", "why"),
    [
        (plane(5.0), LASER, PLAN, "terrain model"),
        (terrain(), LASER, replace(PLAN, pixel_m=0.75), "terrain model"),
        (
            terrain(),
            structs.replace(LASER, beam="elliptical", beam_azimuth_deg=20.0),
            PLAN,
            "ellipse along x or y",
        ),
        (terrain(Grid(np.ones((5, 5)), 1.5, 0.0, 0.0)), LASER, PLAN, "same posts"),
    ],
)
def test_what_posts_cannot_do_is_refused(
    surface: Surface, laser: Laser, plan: FootprintPlan, why: str
) -> None:
    with pytest.raises(RefusedInput, match=why):
        GridEcho(surface, laser, ALTITUDE_M, plan, KERNEL, INTERVAL_S, 42)


def test_an_altitude_near_the_heights_is_refused() -> None:
    with pytest.raises(RefusedInput, match="altitude"):
        GridEcho(terrain(), LASER, 1e4, PLAN, KERNEL, INTERVAL_S, 42)


def test_without_numba_the_reference_serves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "numba", None)
    monkeypatch.delitem(sys.modules, "sim.compiled")
    monkeypatch.delattr("sim.compiled", raising=False)
    loops.cache_clear()

    try:
        assert loops() is reference
    finally:
        loops.cache_clear()


# ---- what the posts of a terrain model leave out


def test_the_error_of_the_posts_is_estimated_within_a_factor_of_three() -> None:
    # Given fractal-like ground, known every 0.375 m, and models of it with posts 1.5 m apart
    size, spacing_m = 512, 0.375
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(size), np.fft.fftfreq(size)))
    frequency[0, 0] = np.inf
    estimates, errors = [], []
    for seed in range(6):
        noise = np.fft.fft2(np.random.default_rng(seed).standard_normal((size, size)))
        z = np.fft.ifft2(noise * frequency**-1.8).real
        z *= 0.7 / np.std(z[:, 40:] - z[:, :-40])
        z -= z.mean()
        fine = Surface("dtm", relief=Grid(z, spacing_m, -96.0, -96.0), albedo=1.0)
        posts = Surface("dtm", relief=Grid(z[::4, ::4], 4 * spacing_m, -96.0, -96.0), albedo=1.0)
        true = echo(
            KERNEL,
            delays(fine, LASER, ALTITUDE_M, replace(PLAN, pixel_m=spacing_m), align_s=-1e-7),
            -1e-7,
            INTERVAL_S,
            42,
        )
        got = echo(KERNEL, delays(posts, LASER, ALTITUDE_M, PLAN, align_s=-1e-7), -1e-7, INTERVAL_S, 42)

        estimates.append(posts_error(posts, LASER, ALTITUDE_M, PLAN, KERNEL, INTERVAL_S))
        errors.append(np.abs(got - true).max() / true.max())

    # Then their sizes agree; one by one they need not.
    assert 1 < np.sqrt(np.mean(np.square(estimates)) / np.mean(np.square(errors))) < 3
    assert min(errors) > 1e-5


def test_ground_in_closed_form_leaves_nothing_out() -> None:
    assert posts_error(plane(5.0), LASER, ALTITUDE_M, PLAN, KERNEL, INTERVAL_S) == 0


def test_no_return_has_no_samples() -> None:
    assert math.fsum(echo(KERNEL, NoReturn("night"), 0.0, INTERVAL_S, 42)) == 0
