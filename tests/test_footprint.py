from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs

from belahil import butterworth
from belahil.errors import RefusedInput
from sim.accuracy import Accuracy
from sim.beam import beam_sigma_m
from sim.echo import echo
from sim.footprint import DelayGaussian, DelayHistogram, FootprintPlan, NoReturn, delays, plan_footprint
from sim.footprint_error import beam_transform, deposit_error, spacing_error
from sim.kernel import Kernel
from sim.laser import Laser, pulse_shape
from sim.pulse_shape import PulsePiece, PulseShape
from sim.reference import plane_echo
from sim.terrain import Surface, boulder, gradient_of, plane
from sim.terrain_grid import Grid

ALTITUDE_M = 500e3
INTERVAL_S = 12.5e-9
LASER = Laser(divergence_rad=50e-6)
POLES = butterworth.poles(19e6, 3)
KERNEL = Kernel(pulse_shape(LASER), POLES)
SIGMA_M = beam_sigma_m(LASER, ALTITUDE_M)[0]


def white(slope_deg: float, azimuth_deg: float = 0.0) -> Surface:
    return plane(slope_deg, azimuth_deg, reflectance=1.0)


def planned(tolerance: float, surface: Surface, kernel: Kernel = KERNEL, **more: object) -> FootprintPlan:
    return plan_footprint(
        Accuracy(tolerance),
        kernel,
        LASER,
        ALTITUDE_M,
        surface,
        INTERVAL_S,
        **more,  # type: ignore[arg-type]
    )


def worst_error(
    plan: FootprintPlan,
    slope_deg: float,
    azimuth_deg: float,
    offset_pixels: tuple[float, float],
    phase: float,
    kernel: Kernel = KERNEL,
) -> float:
    """max |dV| / peak of a plane against Fourier integration, at samples from before its echo to after it."""
    shift_m = [part * plan.pixel_m for part in offset_pixels]
    pointing = (math.atan(shift_m[0] / ALTITUDE_M), math.atan(shift_m[1] / ALTITUDE_M))
    surface, gradient = white(slope_deg, azimuth_deg), gradient_of(slope_deg, azimuth_deg)
    spread_s = 2 * SIGMA_M * math.tan(math.radians(slope_deg)) / 299792458.0
    first_s = -2 / 299792458.0 * (np.array(gradient) @ shift_m) - 5 * spread_s + (phase - 2) * INTERVAL_S
    count = max(42, math.ceil((10 * spread_s + 150e-9) / INTERVAL_S))
    light = delays(surface, LASER, ALTITUDE_M, plan, pointing, align_s=first_s)
    got = echo(kernel, light, first_s, INTERVAL_S, count)
    times_s = first_s + INTERVAL_S * np.arange(count)
    true = plane_echo(kernel, gradient, (shift_m[0], shift_m[1]), SIGMA_M, ALTITUDE_M, times_s)
    # The peak may lie between samples.
    about_s = times_s[np.abs(true).argmax()] + INTERVAL_S * np.linspace(-1, 1, 33)
    peak = np.abs(plane_echo(kernel, gradient, (shift_m[0], shift_m[1]), SIGMA_M, ALTITUDE_M, about_s)).max()
    return float(np.abs(got - true).max() / peak)


def worst_of_directions(
    plan: FootprintPlan, slope_deg: float, kernel: Kernel = KERNEL, seed: int = 1
) -> float:
    draw = np.random.default_rng(seed)
    azimuths = (0.0, 0.0, 45.0, float(draw.uniform(0, 90)))
    offsets = [(0.0, 0.0), *(tuple(draw.uniform(0, 1, 2)) for _ in range(3))]
    return max(
        worst_error(plan, slope_deg, azimuth, offset, float(draw.uniform()), kernel)
        for azimuth, offset in zip(azimuths, offsets, strict=True)
    )


SLOPES = [0.0, 1.0, 10.0, 30.0, 45.0, 60.0]


@pytest.mark.parametrize("tolerance", [1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("slope_deg", SLOPES)
def test_a_planned_footprint_is_as_good_as_asked_for_and_not_much_better(
    tolerance: float, slope_deg: float
) -> None:
    plan = planned(tolerance, white(slope_deg), method="grid")

    error = worst_of_directions(plan, slope_deg)

    assert error <= plan.predicted_error * 1.05 <= tolerance
    assert slope_deg < 10 or error >= 0.02 * tolerance


@pytest.mark.parametrize("tolerance", [1e-1, 1e-3, 1e-5])
@pytest.mark.parametrize("slope_deg", [0.0, 10.0, 60.0])
@pytest.mark.parametrize(
    "kernel",
    [
        pytest.param(Kernel(PulseShape((PulsePiece(1.0, 2.2e-9),)), POLES), id="no tail"),
        pytest.param(Kernel(PulseShape((PulsePiece(1.0, 8e-9),)), POLES), id="long pulse"),
        pytest.param(Kernel(PulseShape((PulsePiece(1.0, 2.2e-9),))), id="no filter"),
        pytest.param(
            Kernel(PulseShape((PulsePiece(1.0, 0.9e-9),)), butterworth.poles(60e6, 3)), id="fast receiver"
        ),
        pytest.param(
            Kernel(PulseShape((PulsePiece(1.0, 2.2e-9),)), butterworth.poles(19e6, 3, 1e5), 1), id="coupled"
        ),
        pytest.param(
            Kernel(
                PulseShape(times_s=np.array([-4e-9, 0, 3e-9, 20e-9]), relative=np.array([0, 1, 0.5, 0])),
                POLES,
            ),
            id="table",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_the_plan_follows_the_bandwidth(tolerance: float, slope_deg: float, kernel: Kernel) -> None:
    plan = planned(tolerance, white(slope_deg), kernel, method="grid")

    error = worst_of_directions(plan, slope_deg, kernel)

    assert error <= plan.predicted_error * 1.05 <= tolerance
    assert slope_deg < 10 or error >= 0.02 * tolerance


@pytest.mark.parametrize("slope_deg", [0.0, 1.0, 10.0, 60.0, 89.0])
def test_the_closed_form_is_used_where_it_is_good_enough(slope_deg: float) -> None:
    surface = white(slope_deg, 30.0)

    plan = planned(1e-4, surface)

    assert plan.method == "closed form"
    assert worst_error(plan, slope_deg, 30.0, (0.0, 0.0), 0.3) <= 1.05 * plan.predicted_error <= 1e-4
    assert isinstance(delays(surface, LASER, ALTITUDE_M, plan), DelayGaussian)


def test_the_closed_form_gives_way_to_a_tolerance_below_the_curvature_of_the_wavefront() -> None:
    assert planned(1e-7, white(10.0)).method == "grid"


@pytest.mark.parametrize(("slope_deg", "pixel_m"), [(75.0, 0.5), (75.0, 1.5), (85.0, 0.5), (89.0, 1.5)])
def test_the_error_of_a_coarse_grid_is_predicted(slope_deg: float, pixel_m: float) -> None:
    plan = replace(planned(1e-4, white(10.0), method="grid"), pixel_m=pixel_m)
    tilt = 2 * math.tan(math.radians(slope_deg)) / 299792458.0

    predicted = spacing_error(KERNEL, beam_transform(LASER, ALTITUDE_M), (SIGMA_M, SIGMA_M), tilt, pixel_m)

    measured = max(worst_error(plan, slope_deg, 0.0, (part, 0.0), 0.0) for part in (0.0, 0.25))
    assert predicted / 2 <= measured <= predicted


def test_a_cliff_on_a_grid_is_refused_with_the_error() -> None:
    with pytest.raises(RefusedInput, match=r"89 deg.*predicted error of 0\.00"):
        planned(1e-4, white(89.0), method="grid")


def test_a_finer_tolerance_costs_more_and_never_less() -> None:
    plans = [planned(10.0**-k, white(20.0), method="grid") for k in range(1, 10)]

    for coarse, fine in itertools.pairwise(plans):
        assert fine.pixels >= coarse.pixels
        assert fine.bin_s <= coarse.bin_s
        assert fine.predicted_error <= 10 * coarse.predicted_error


def test_work_is_counted() -> None:
    # Plans of early prototypes had 147 pixels and 10 bins a sample here.
    plan = planned(1e-4, white(10.0), method="grid")

    assert plan.pixels <= 150
    assert round(INTERVAL_S / plan.bin_s) <= 15
    assert INTERVAL_S / plan.bin_s == pytest.approx(round(INTERVAL_S / plan.bin_s), abs=1e-9)


def test_a_jump_that_nothing_smooths_is_refused() -> None:
    box = Kernel(PulseShape(times_s=np.array([0.0, 1e-8]), relative=np.array([1.0, 1.0])))

    with pytest.raises(RefusedInput, match="pulse jumps"):
        planned(1e-3, white(10.0), box, method="grid")


def test_the_deposit_error_is_that_of_a_flat_footprint() -> None:
    # Given all light at one delay, half way between two bins
    for bin_s in (5e-9, 2.5e-9, 1.25e-9):
        light = DelayHistogram(0.0, bin_s, np.array([-1, 9, 9, -1]) / 16, 1.0, 1.0)
        times_s = np.linspace(-1e-8, 1e-7, 1001)
        got = sum(w * KERNEL.exact(times_s - k * bin_s) for k, w in enumerate(light.weights))
        true = KERNEL.exact(times_s - 1.5 * bin_s)

        measured = np.abs(got - true).max() / true.max()

        assert deposit_error(KERNEL, bin_s) == pytest.approx(measured, rel=0.02)


def terrain(rows: int = 81, spacing_m: float = 1.5, gap: bool = False) -> Surface:
    z = 0.3 * np.random.default_rng(4).standard_normal((rows, rows)) + 0.1 * np.arange(rows)
    half = spacing_m * (rows - 1) / 2
    known = None
    if gap:
        known = np.ones((rows, rows), dtype=bool)
        known[:, : rows // 2] = False
    return Surface("dtm", relief=Grid(z, spacing_m, -half, -half, known), albedo=0.2)


def test_every_post_is_used_and_places_between_them_when_asked_for() -> None:
    flat = Surface("dtm", relief=Grid(np.zeros((81, 81)), 1.5, -60.0, -60.0), albedo=0.2)

    assert planned(1e-2, flat).pixel_m == 1.5
    finer = planned(1e-4, terrain()).pixel_m
    assert finer < 1.5
    assert 1.5 / finer == pytest.approx(round(1.5 / finer))


def test_light_beside_known_ground_is_lost() -> None:
    plan = planned(1e-2, terrain())

    whole = delays(terrain(), LASER, ALTITUDE_M, plan)
    half = delays(terrain(gap=True), LASER, ALTITUDE_M, plan)

    assert isinstance(whole, DelayHistogram)
    assert isinstance(half, DelayHistogram)
    assert whole.lit == pytest.approx(1, abs=5e-3)
    assert whole.total == pytest.approx(0.2 * whole.lit)
    assert half.lit == pytest.approx(0.5, abs=0.1)


def test_a_factor_weights_the_light() -> None:
    plan = planned(1e-3, white(5.0), method="grid")

    dark = delays(white(5.0), LASER, ALTITUDE_M, plan, factor=lambda x, y: 0.0 * x)
    half = delays(white(5.0), LASER, ALTITUDE_M, plan, factor=lambda x, y: (x > 0) + 0.0 * y)

    assert isinstance(dark, NoReturn)
    assert half.total == pytest.approx(0.5, abs=0.3)


def test_a_closed_form_takes_no_factor() -> None:
    with pytest.raises(RefusedInput, match="factor"):
        delays(white(5.0), LASER, ALTITUDE_M, planned(1e-3, white(5.0)), factor=lambda x, y: x)


@pytest.mark.parametrize("surface", [white(0.0), boulder(reflectance=1.0)])
def test_black_ground_returns_nothing(surface: Surface) -> None:
    black = replace(surface, albedo=0.0)

    nothing = delays(black, LASER, ALTITUDE_M, planned(1e-3, black))

    assert isinstance(nothing, NoReturn)
    assert not echo(KERNEL, nothing, 0.0, INTERVAL_S, 5).any()


def test_an_elliptical_beam_on_a_slope_has_the_spread_of_its_axis() -> None:
    laser = structs.replace(LASER, beam="elliptical", ellipticity=0.5, beam_azimuth_deg=30.0)
    major_m, minor_m = beam_sigma_m(laser, ALTITUDE_M)
    for azimuth_deg, sigma_m in ((30.0, major_m), (120.0, minor_m)):
        surface = white(20.0, azimuth_deg)
        plan = plan_footprint(Accuracy(1e-6), KERNEL, laser, ALTITUDE_M, surface, INTERVAL_S, "grid")
        expected = 2 * sigma_m * math.tan(math.radians(20.0)) / 299792458.0

        light = delays(surface, laser, ALTITUDE_M, plan)
        closed = delays(surface, laser, ALTITUDE_M, FootprintPlan("closed form", 1e-4, 0.3))

        assert isinstance(light, DelayHistogram)
        assert light.std_s == pytest.approx(expected, rel=1e-5)
        assert isinstance(closed, DelayGaussian)
        assert closed.std_s == pytest.approx(expected, rel=1e-9)
        assert closed.mean_s == pytest.approx(light.mean_s, abs=1e-15)


def test_an_image_of_a_gaussian_lights_like_one(tmp_path: object) -> None:
    # Out to 4.8 standard deviations: a picture is normalised to the light that is in it.
    angles = 1e-6 * np.arange(-60, 61)
    picture = np.exp(-0.5 * ((angles[:, None] ** 2 + angles**2) / 12.5e-6**2))
    np.save(f"{tmp_path}/beam.npy", picture)
    laser = structs.replace(LASER, beam="image", image=f"{tmp_path}/beam.npy", image_pixel_rad=1e-6)
    surface = white(10.0)
    plan = plan_footprint(Accuracy(1e-3), KERNEL, laser, ALTITUDE_M, surface, INTERVAL_S)

    light = delays(surface, laser, ALTITUDE_M, plan, align_s=-1e-7)

    got = echo(KERNEL, light, -1e-7, INTERVAL_S, 42)
    times_s = -1e-7 + INTERVAL_S * np.arange(42)
    # Straight lines between its pixels widen the picture, by a sixth of a pixel squared.
    wider_m = math.hypot(SIGMA_M, 1e-6 * ALTITUDE_M / math.sqrt(6))
    true = plane_echo(KERNEL, gradient_of(10.0), (0.0, 0.0), wider_m, ALTITUDE_M, times_s)
    assert light.total == pytest.approx(1.0, abs=1e-3)
    assert np.abs(got - true).max() <= 1e-3 * true.max()


@pytest.mark.parametrize("tolerance", [0.0, -1e-3, 1e-11, 1.0, math.nan, math.inf])
def test_a_tolerance_outside_its_range_is_refused(tolerance: float) -> None:
    with pytest.raises(RefusedInput, match="tolerance"):
        Accuracy(tolerance)


def test_the_floor_can_be_asked_for() -> None:
    plan = planned(1e-10, white(10.0), method="grid")

    assert plan.predicted_error <= 1e-10
    # The reference itself ends at some 1e-10: the third order of the wavefront's curvature.
    assert worst_error(plan, 10.0, 0.0, (0.3, 0.2), 0.4) <= 3e-10


def test_shares_of_a_tolerance_are_the_whole() -> None:
    one = Accuracy(1e-3)

    assert one.beam_cut + one.deposit + one.kernel + one.spacing == pytest.approx(1e-3)


@pytest.mark.parametrize("altitude_m", [0.0, -1.0, math.nan, math.inf])
def test_no_altitude_is_refused(altitude_m: float) -> None:
    with pytest.raises(RefusedInput, match="altitude"):
        plan_footprint(Accuracy(1e-3), KERNEL, LASER, altitude_m, white(1.0), INTERVAL_S)


@pytest.mark.parametrize("tolerance", [1e-1, 1e-2, 1e-3])
@pytest.mark.parametrize("slope_deg", [0.0, 30.0])
@pytest.mark.parametrize(
    "picture",
    [np.ones((5, 5)), np.ones((2, 3)), np.pad([[1.0]], 1), np.pad([[1.0, 1.0, 1.0]], 1)],
    ids=["bright to its edge", "2 x 3", "one pixel", "a line"],
)
def test_no_light_of_an_image_is_lost(
    tmp_path: object, picture: np.ndarray, slope_deg: float, tolerance: float
) -> None:
    np.save(f"{tmp_path}/beam.npy", picture)
    laser = structs.replace(LASER, beam="image", image=f"{tmp_path}/beam.npy", image_pixel_rad=5e-6)
    surface = white(slope_deg)

    plan = plan_footprint(Accuracy(tolerance), KERNEL, laser, ALTITUDE_M, surface, INTERVAL_S)

    light = delays(surface, laser, ALTITUDE_M, plan)
    assert light.total == pytest.approx(1.0, abs=2 * tolerance)
