"""Shifts of footprints, beside echoes that are summed one by one; the curve through them, what it leaves."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from belahil.config import simulated
from belahil.delay_curve import published_curve
from belahil.errors import RefusedInput
from belahil.pulse_fit import gaussian_fit
from belahil.values import Estimate
from procedures.arrival_curve import bin_means, footprint_curve, model_curve, with_published
from procedures.arrival_footprints import (
    Footprints,
    echo_kernel,
    footprints,
    mean_delays,
    transmitted,
)
from procedures.arrival_ground import ALTITUDES_M, Ground, grounds
from procedures.known_receiver import KnownReceiver, preset_receiver
from sim.accuracy import Accuracy
from sim.constants import SPEED_OF_LIGHT_M_PER_S
from sim.echo import echo
from sim.footprint import DelayGaussian, DelayHistogram, delays, plan_footprint
from sim.laser import Laser
from sim.terrain import Surface, plane, tilted
from sim.terrain_dtm import from_array
from sim.terrain_fractal import monofractal
from sim.terrain_grid import Grid

NS = 1e-9
T_S = 12.5e-9


def known() -> KnownReceiver:
    return preset_receiver(simulated())


def rough(seed: int, slope_deg: float = 12.0, extent_m: float = 150.0) -> Surface:
    made = monofractal(extent_m=extent_m, spacing_m=1.5, rms_deviation_m=3.0, seed=seed)
    return tilted(made, slope_deg, 30.0)


def moved(surface: Surface, x_m: float, y_m: float) -> Surface:
    """The same ground with nadir at another place."""
    relief = surface.relief
    assert isinstance(relief, Grid)
    return replace(
        surface, relief=replace(relief, x_min_m=relief.x_min_m - x_m, y_min_m=relief.y_min_m - y_m)
    )


@pytest.mark.parametrize(("altitude_m", "seed"), [(400e3, 1), (700e3, 2)])
@pytest.mark.parametrize("elliptical", [False, True])
def test_shift_and_width_are_those_of_echoes_summed_one_by_one(
    altitude_m: float, seed: int, elliptical: bool
) -> None:
    # given rough ground on a slope
    laser = Laser(beam="elliptical", ellipticity=0.2, beam_azimuth_deg=90.0) if elliptical else Laser()
    ground = Ground("rough", rough(seed), laser)
    # when
    found = footprints((ground,), (altitude_m,), 3, known(), seed)
    # then every footprint agrees with its histogram of delays, a closed-form kernel and a fit to all samples
    kernel = echo_kernel(laser, known())
    plan = plan_footprint(Accuracy(1e-4), kernel, laser, altitude_m, ground.surface, T_S, method="grid")
    coarse = plan_footprint(Accuracy(1e-3), kernel, laser, altitude_m, ground.surface, T_S, method="grid")
    edge_m = 75.0 - coarse.radius_m
    places = [(x, y) for y in np.linspace(-edge_m, edge_m, 3) for x in np.linspace(-edge_m, edge_m, 3)]
    assert found.shift_s.size == 9
    for (x_m, y_m), shift_s, width_s in zip(places, found.shift_s, found.width_s, strict=True):
        light = delays(moved(ground.surface, x_m, y_m), laser, altitude_m, plan)
        assert isinstance(light, DelayHistogram)
        true_s = light.mean_s + kernel.pulse.mean_s
        best = []
        for phase in np.arange(8) / 8:
            first_s = true_s + (phase - 20) * T_S
            fit = gaussian_fit(echo(kernel, light, first_s, T_S, 42), T_S)
            assert fit.pulse is not None
            best.append((first_s + fit.pulse.arrival_s - true_s, fit.pulse.fwhm_s))
        # the place between two samples is a draw: the fit lies within what the places give
        low, high = np.min(best, axis=0), np.max(best, axis=0)
        assert low[0] - 0.05 * NS < shift_s < high[0] + 0.05 * NS
        assert low[1] - 0.1 * NS < width_s < high[1] + 0.1 * NS


@pytest.mark.parametrize("altitude_m", ALTITUDES_M)
def test_the_mean_delay_of_the_light_is_that_of_its_histogram(altitude_m: float) -> None:
    # given ground with gaps and a map of reflectance
    rng = np.random.default_rng(1)
    base = rough(3, extent_m=400.0).relief
    assert isinstance(base, Grid)
    gaps = rng.random(base.values.shape) > 0.1
    relief = replace(base, known=gaps)
    albedo = replace(base, values=rng.uniform(0.1, 0.3, base.values.shape))
    surface = Surface("dtm", relief=relief, albedo=albedo)
    ground = Ground("gaps", surface, Laser())
    kernel = echo_kernel(ground.laser, known())
    plan = plan_footprint(Accuracy(1e-6), kernel, ground.laser, altitude_m, surface, T_S, method="grid")
    posts = replace(plan, pixel_m=1.5)
    places = (np.array([-7.5, 20.3]), np.array([11.1]))
    # when
    found_s, lit = mean_delays(ground, altitude_m, places, plan.reach)
    # then
    for k, x_m in enumerate(places[0]):
        light = delays(moved_map(surface, x_m, places[1][0]), ground.laser, altitude_m, posts)
        assert isinstance(light, DelayHistogram)
        assert found_s[0, k] == pytest.approx(light.mean_s, abs=0.01 * NS)
        assert lit[0, k] == pytest.approx(light.lit, abs=1e-4)


def moved_map(surface: Surface, x_m: float, y_m: float) -> Surface:
    shifted = moved(surface, x_m, y_m)
    albedo = moved(replace(surface, relief=surface.albedo, albedo=0.2), x_m, y_m).relief
    assert isinstance(albedo, Grid)
    return replace(shifted, albedo=albedo)


def test_flat_ground_has_the_delay_of_the_laser_pulse_itself() -> None:
    # given flat ground, seen from so near that nothing widens the pulse
    flat = from_array(np.zeros((81, 81)), 1.0)
    # when
    found = footprints((Ground("flat", flat, Laser()),), (400e3,), 8, known(), 4)
    # then
    width_s, delay_s = transmitted(Laser(), known())
    assert found.width_s.mean() == pytest.approx(width_s, abs=0.15 * NS)
    assert found.shift_s.mean() == pytest.approx(delay_s, abs=0.15 * NS)


@pytest.mark.parametrize("slope_deg", [15.0, 25.0, 35.0])
def test_slopes_have_the_closed_form_of_a_tilted_plane(slope_deg: float) -> None:
    # given a plane, sampled at posts
    posts = tilted(from_array(np.zeros((201, 201)), 1.0), slope_deg, 20.0)
    # when
    found = footprints((Ground("plane", posts, Laser()),), (700e3,), 6, known(), 7)
    # then width and shift are those of the pulse behind a Gaussian of delays, in closed form
    kernel = echo_kernel(Laser(), known())
    place = (Laser(), 700e3)
    plan = plan_footprint(Accuracy(1e-2), kernel, *place, plane(slope_deg, 20.0), T_S)
    light = delays(plane(slope_deg, 20.0), *place, plan)
    assert isinstance(light, DelayGaussian)
    shape = kernel.widened(light.std_s)
    fits = []
    for phase in np.arange(10) / 10:
        first_s = kernel.pulse.mean_s + (phase - 20) * T_S
        fit = gaussian_fit(shape.exact(first_s + T_S * np.arange(42)), T_S)
        assert fit.pulse is not None
        fits.append((first_s + fit.pulse.arrival_s - kernel.pulse.mean_s, fit.pulse.fwhm_s))
    delay_s, width_s = np.mean(fits, axis=0)
    assert found.width_s == pytest.approx(np.full(36, width_s), abs=0.05 * NS)
    assert found.shift_s == pytest.approx(np.full(36, delay_s), abs=0.02 * NS)


def test_footprints_with_gaps_are_left_out_and_counted() -> None:
    # given ground of which a corner has no data
    base = rough(5).relief
    assert isinstance(base, Grid)
    there = np.ones(base.values.shape, dtype=bool)
    there[:35, :35] = False
    ground = Ground("corner", Surface("dtm", relief=replace(base, known=there)), Laser())
    # when
    found = footprints((ground,), (400e3,), 4, known(), 1)
    # then
    assert 0 < found.dark < 16
    assert found.shift_s.size == 16 - found.dark
    assert np.all(np.abs(found.shift_s - 18 * NS) < 15 * NS)


def made(shift_s: np.ndarray, width_s: np.ndarray) -> Footprints:
    return Footprints(shift_s, width_s, np.full(width_s.shape, 5e5), np.zeros(width_s.size, int), ("one",))


@pytest.mark.parametrize(("spread_ns", "tilt"), [(0.5, -0.02), (2.0, 0.03)])
def test_the_curve_of_footprints_comes_back_with_what_it_leaves(spread_ns: float, tilt: float) -> None:
    # given shifts about a straight line
    rng = np.random.default_rng(8)
    width_s = rng.uniform(20 * NS, 110 * NS, 20_000)
    line_s = 18 * NS + tilt * (width_s - 20 * NS)
    shift_s = line_s + spread_ns * NS * rng.standard_normal(width_s.size)
    # when
    found = footprint_curve(made(shift_s, width_s), (21 * NS, 18.5 * NS))
    # then
    assert found.status == "ok"
    assert found.curve is not None
    assert found.bias is not None
    assert found.residual is not None
    assert found.residual_largest is not None
    ranges_m = SPEED_OF_LIGHT_M_PER_S / 2
    assert found.residual.value == pytest.approx(ranges_m * spread_ns * NS, rel=0.02)
    assert found.residual_largest.value < 1.3 * found.residual.value
    bias_m = ranges_m * ((18 + 80 * tilt) * NS - 18.5 * NS)
    assert found.bias.value == pytest.approx(bias_m, abs=4 * found.bias.standard_uncertainty)
    some_s = np.linspace(found.curve.narrowest_s, found.curve.widest_s, 50)
    off_s = found.curve.at(some_s) - (18 * NS + tilt * (some_s - 20 * NS))
    assert np.abs(off_s).max() < 0.15 * spread_ns * NS
    # and nothing is said beyond the widths that there were
    with pytest.raises(RefusedInput):
        found.curve.at(found.curve.widest_s + NS)


@pytest.mark.parametrize("widths_ns", [(20, 40, 5000), (20, 110, 200), (150, 200, 5000)])
def test_widths_that_do_not_make_a_curve_have_a_status(widths_ns: tuple[float, float, int]) -> None:
    low, high, count = widths_ns
    rng = np.random.default_rng(9)
    width_s = rng.uniform(low * NS, high * NS, count)

    found = footprint_curve(made(np.full(count, 18 * NS), width_s), (21 * NS, 18.5 * NS))

    assert found.status == "too_few_points"
    assert found.curve is found.bias is found.residual is None
    assert bin_means(made(np.full(count, 18 * NS), width_s)).count.min(initial=20) >= 20


def test_the_model_and_the_published_polynomial_sum_to_11_84_ns_with_the_smaller_coefficient() -> None:
    # given the published filter
    curve = model_curve(known())
    # when
    likely, printed = (with_published(curve, as_printed=one) for one in (False, True))
    # then
    assert likely is not None
    assert printed is not None
    assert likely.rms_about_known_s < 0.15 * NS
    assert likely.constant_s == pytest.approx(11.84 * NS, abs=0.05 * NS)
    assert printed.rms_s > 20 * NS
    # and another filter does not do that
    other = model_curve(replace(known(), cutoff=Estimate(13e6, 1e5, "Hz")))
    apart = with_published(other, as_printed=False)
    assert apart is not None
    assert apart.rms_about_known_s > 1 * NS


def test_widths_outside_the_published_range_are_not_compared() -> None:
    slow = replace(known(), cutoff=Estimate(4.4e6, 1e4, "Hz"))
    curve = model_curve(slow)
    found = with_published(curve, as_printed=False)

    assert found is not None
    assert found.narrowest_s == curve.narrowest_s > 80 * NS
    with pytest.raises(RefusedInput):
        published_curve().at(120 * NS)


def test_made_terrain_is_found_again_by_its_seed() -> None:
    first = next(iter(grounds(None, 1)))
    again = next(iter(grounds(None, 1)))
    other = next(iter(grounds(None, 2)))

    assert isinstance(first.surface.relief, Grid)
    assert np.array_equal(first.surface.relief.values, again.surface.relief.values)  # type: ignore[union-attr]
    assert not np.array_equal(first.surface.relief.values, other.surface.relief.values)  # type: ignore[union-attr]


def test_a_scene_gives_its_laser_its_ground_and_its_altitude(tmp_path: Path) -> None:
    found = list(grounds("fractal", 1))

    assert [one.altitudes_m for one in found] == [(500e3,)]
    path = tmp_path / "mine.toml"
    path.write_text("altitude_m = 3e5\n[laser]\nfwhm_s = 8e-9\n[surface]\nkind = 'fractal'\nextent_m = 90\n")
    (mine,) = grounds(str(path), 1)
    assert (mine.altitudes_m, mine.laser.fwhm_s) == ((3e5,), 8e-9)


def test_large_terrain_is_cut_into_parts_with_their_own_zero(tmp_path: Path) -> None:
    # given a mountain side, far higher than the series for the slant path allows
    heights = np.linspace(0, 3000, 700)[:, None] + np.zeros((700, 400))
    np.save(tmp_path / "side.npy", heights)
    scene = tmp_path / "side.toml"
    scene.write_text("[surface]\nkind = 'dtm'\nfile = 'side.npy'\nspacing_m = 4\nextent_m = 4000\n")
    # when
    found = list(grounds(str(scene), 1))
    # then
    assert len(found) == 8
    assert all(one.surface.relief.values.shape == (150, 150) for one in found)  # type: ignore[union-attr]
    assert all(np.abs(one.surface.relief.values).max() < 350 for one in found)  # type: ignore[union-attr]
    corners = {one.surface.bounds for one in found}
    assert len(corners) == 8


@pytest.mark.parametrize(
    ("surface", "altitude_m", "words"),
    [
        (from_array(np.zeros((21, 21)), 1.0), 400e3, "needs"),
        (from_array(np.zeros((90, 90)), 5.0), 400e3, "posts 5 m apart"),
        (from_array(np.linspace(0, 4000, 300)[:, None] + np.zeros((300, 300)), 1.0), 400e3, "heights"),
    ],
)
def test_ground_that_cannot_serve_is_refused_in_a_line(
    surface: Surface, altitude_m: float, words: str
) -> None:
    with pytest.raises(RefusedInput, match=words) as refusal:
        footprints((Ground("some", surface, Laser()),), (altitude_m,), 3, known(), 1)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("terrain", ["plane", "boulder", "no-such-scene", "no-such.tif"])
def test_terrain_that_is_none_is_refused(terrain: str) -> None:
    with pytest.raises(RefusedInput):
        list(grounds(terrain, 1))


def test_lunar_footprints_follow_the_curve_of_the_filter() -> None:
    path = os.environ.get("BELAHIL_LUNAR_DTM")
    if not path:
        pytest.skip("BELAHIL_LUNAR_DTM does not name a terrain model")
    # given a real terrain model
    (ground,) = grounds(path, 1)
    # when
    found = footprints((ground,), None, 30, known(), 1)
    # then the means follow the filter where there are enough, and the rest scatters by decimetres
    bins, curve = bin_means(found), model_curve(known())
    many = bins.count > 60
    assert many.sum() >= 8
    off_s = bins.shift_s[many] - curve.at(bins.width_s[many])
    # the curve's polynomial leaves 0.12 ns at its narrow end
    assert np.all(np.abs(off_s) < 0.15 * NS + 4 * bins.shift_u_s[many])
    assert 0.02 < SPEED_OF_LIGHT_M_PER_S / 2 * bins.spread_s[many].max() < 1.0
