"""Light with an edge: the field of view cuts the footprint, a crater has a rim."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scenes import BARE, with_
from scipy.stats import ncx2

from belahil.errors import RefusedInput
from sim.accuracy import Accuracy
from sim.chain import Chain
from sim.footprint import NoReturn
from sim.footprint_error import beam_transform
from sim.scene import load_scene

MET_WITHIN = 3.0
"""The prediction is an estimate from pixels that were tried."""


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize(
    ("view_rad", "off_rad"), [(12.5e-6, 0.0), (30e-6, 25e-6), (247.5e-6, 240e-6), (247.5e-6, 250e-6)]
)
@pytest.mark.parametrize("azimuth_rad", [0.0, 0.3, pytest.param(math.pi / 4, marks=pytest.mark.slow)])
def test_a_field_of_view_passes_its_share_of_the_beam(
    tolerance: float, view_rad: float, off_rad: float, azimuth_rad: float
) -> None:
    # Given level ground, and a field of view whose edge lies in the footprint
    boresight = (off_rad * math.cos(azimuth_rad), off_rad * math.sin(azimuth_rad))
    scene = with_(
        BARE,
        detector={"field_of_view_rad": view_rad, "boresight_rad": boresight},
        surface={"slope_deg": 0.0, "reflectance": 1.0},
    )
    # When the light is planned to a tolerance
    chain = Chain(scene, Accuracy(tolerance))
    # Then its share is that of a normal distribution in a circle beside its centre
    sigma_rad = BARE.laser.divergence_rad / 4
    share = ncx2.cdf((view_rad / sigma_rad) ** 2, 2, max(off_rad / sigma_rad, 1e-9) ** 2)
    assert chain.plan.predicted_error <= tolerance
    assert abs(chain.lit().delays.total / share - 1) < MET_WITHIN * chain.plan.predicted_error


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize("divergence_rad", [50e-6, 1e-2])
@pytest.mark.parametrize("view_rad", [1e-7, 1e-6, 30e-6, 247.5e-6])
@pytest.mark.parametrize("off_sigma", [0.0, 0.5, 2.0])
def test_a_field_of_view_much_smaller_than_the_beam_passes_its_share(
    off_sigma: float, view_rad: float, divergence_rad: float, tolerance: float
) -> None:
    # Given level ground, and a field of view that is a small part of the footprint, or beside its middle
    sigma_rad = divergence_rad / 4
    off = np.array([math.cos(0.3), math.sin(0.3)]) * off_sigma * sigma_rad
    detector = {"field_of_view_rad": view_rad, "boresight_rad": (float(off[0]), float(off[1]))}
    surface = {"slope_deg": 0.0, "reflectance": 1.0}
    laser = {"divergence_rad": divergence_rad}
    # When the light is planned to a tolerance
    chain = Chain(with_(BARE, detector=detector, surface=surface, laser=laser), Accuracy(tolerance))
    # Then its share is that of the normal distribution, and so few pixels are enough
    sigma = math.tan(sigma_rad)
    away, wide = math.hypot(*np.tan(off)) / sigma, math.tan(view_rad) / sigma
    share = ncx2.cdf(wide**2, 2, max(away, 1e-9) ** 2)
    assert chain.plan.predicted_error <= tolerance
    assert abs(chain.lit().delays.total / share - 1) < tolerance
    assert chain.plan.pixels < 1e6


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
@pytest.mark.parametrize("slope_deg", [10.0, 50.0])
def test_samples_of_a_small_field_of_view_keep_the_tolerance(slope_deg: float, tolerance: float) -> None:
    # Given a slope, seen through a small field of view beside the middle of a wide beam
    detector = {"field_of_view_rad": 20e-6, "boresight_rad": (1e-4, -2e-4)}
    scene = with_(BARE, detector=detector, surface={"slope_deg": slope_deg}, laser={"divergence_rad": 1e-3})
    chain = Chain(scene, Accuracy(tolerance))
    # When its samples are computed as planned, and ten times as well
    better = Chain(scene, Accuracy(tolerance / 10))
    request = better.correlation_window(0, 64)
    volts, exact = (one.samples(None, request).volts for one in (chain, better))
    # Then they agree, and no light is said to be lost beside the ground
    assert np.abs(volts - exact).max() < 1.1 * tolerance * exact.max()
    assert chain.lit().delays.lit == 1.0


def test_a_small_field_of_view_that_the_beam_never_meets_sees_no_light() -> None:
    detector = {"field_of_view_rad": 1e-6, "boresight_rad": (1e-2, 0.0)}
    chain = Chain(with_(BARE, detector=detector))
    assert isinstance(chain.lit().delays, NoReturn)
    assert chain.echo().status != "ok"


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
@pytest.mark.parametrize("wandered", [0.0, 2.0, 4.0, 5.9])
@pytest.mark.parametrize("what", ["view", "near crater", "far crater"])
def test_pixels_serve_shots_whose_beam_has_wandered_far(what: str, wandered: float, tolerance: float) -> None:
    # Given a beam that jitters by its own width, with an edge in the light on the ground, or one that only
    # a shot meets that has wandered four standard deviations towards it
    jitter_rad = 12e-6
    detector = {"field_of_view_rad": 40e-6, "boresight_rad": (-20e-6, 0.0)} if what == "view" else {}
    surface = {"kind": "crater", "diameter_m": 4.0, "depth_m": 1.0} if what != "view" else {}
    if what == "far crater":
        surface["centre_m"] = (4 * jitter_rad * BARE.altitude_m, 0.0)
    jitters = with_(BARE, laser={"jitter_rad": (jitter_rad, jitter_rad)}, detector=detector, surface=surface)
    chain = Chain(jitters, Accuracy(tolerance))
    # When a shot has wandered, and is computed with pixels planned for it alone, ten times as well
    away = with_(jitters, laser={"jitter_rad": (0.0, 0.0), "pointing_rad": (wandered * jitter_rad, 0.0)})
    alone = Chain(away, Accuracy(tolerance / 10))
    steps = copy(alone)
    steps.plan = chain.plan
    request = alone.correlation_window(0, 64)
    volts, exact = (one.samples(None, request).volts for one in (steps, alone))
    # Then they agree to the tolerance of the mean shot
    mean_v = chain.samples(None, chain.correlation_window(0, 64)).volts.max()
    assert np.abs(volts - exact).max() < 1.1 * tolerance * mean_v


@pytest.mark.parametrize("tolerance", [0.2, 1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize(("diameter_m", "height_m"), [(2.0, 0.5), (5.0, 2.0), (20.0, 3.0)])
@pytest.mark.parametrize("kind", ["crater", "boulder"])
def test_rims_and_feet_keep_the_tolerance(
    kind: str, diameter_m: float, height_m: float, tolerance: float
) -> None:
    # Given a body with a sharp foot, or rim, off the middle of the footprint
    key = "depth_m" if kind == "crater" else "height_m"
    surface = {"kind": kind, "diameter_m": diameter_m, key: height_m, "centre_m": (1.0, 0.5)}
    scene = with_(BARE, surface=surface | {"slope_deg": 5.0})
    # When its samples are computed to a tolerance, and ten times as well
    chain, better = (Chain(scene, Accuracy(one)) for one in (tolerance, min(tolerance / 10, 1e-4)))
    request = better.correlation_window(0, 64)
    volts, exact = (one.samples(None, request).volts for one in (chain, better))
    # Then they agree to the tolerance, of which they tell at most all
    assert chain.plan.predicted_error <= tolerance
    assert np.abs(volts - exact).max() < (tolerance + better.accuracy.tolerance) * np.abs(exact).max()


def test_what_pixels_cannot_do_is_refused_with_the_error_that_they_leave() -> None:
    with pytest.raises(
        RefusedInput, match=r"edge or a kink in the light on the ground: \d+ pixels, .* error"
    ):
        Chain(load_scene("boulder"), Accuracy(1e-9))


def pictures() -> dict[str, np.ndarray]:
    x = np.arange(15) - 7
    return {
        "flat 2 x 2": np.ones((2, 2)),
        "gaussian 15 x 15": np.exp(-(x[:, None] ** 2 + x**2) / (2 * 2.0**2)),
        "rough 5 x 7": np.random.default_rng(2).random((5, 7)),
        "rough 64 x 64": np.random.default_rng(3).random((64, 64)),
    }


def image_chain(folder: Path, name: str, slope_deg: float, tolerance: float) -> Chain:
    picture = pictures()[name]
    np.save(folder / "beam.npy", picture)
    laser = {"beam": "image", "image": str(folder / "beam.npy"), "image_pixel_rad": 60e-6 / len(picture)}
    surface = {"slope_deg": slope_deg, "azimuth_deg": 20.0, "reflectance": 1.0}
    return Chain(with_(BARE, laser=laser, surface=surface), Accuracy(tolerance))


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize("slope_deg", [0.0, 3.0, 10.0, 60.0])
@pytest.mark.parametrize("name", ["flat 2 x 2", "gaussian 15 x 15", "rough 5 x 7"])
def test_the_kinks_between_the_pixels_of_an_image_keep_the_tolerance(
    tmp_path: Path, name: str, slope_deg: float, tolerance: float
) -> None:
    # Given a beam from an image, which is linear between its pixels
    chain = image_chain(tmp_path, name, slope_deg, 10 * tolerance if slope_deg > 45 else tolerance)
    # When its samples are computed as planned, and with pixels that are no simple fraction of those
    request = chain.correlation_window(0, 64)
    volts = chain.samples(None, request).volts
    exact = copy(chain)
    exact.plan = replace(chain.plan, pixel_m=chain.plan.pixel_m / 2.37, bin_s=chain.plan.bin_s / 4)
    # Then they agree to the tolerance, and level ground returns all light of the image
    assert np.abs(volts - exact.samples(None, request).volts).max() < chain.plan.tolerance * volts.max()
    if not slope_deg:
        assert chain.lit().delays.total == pytest.approx(1.0, abs=tolerance)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_a_large_image_is_served(tmp_path: Path, tolerance: float) -> None:
    chain = image_chain(tmp_path, "rough 64 x 64", 0.0, tolerance)
    assert chain.lit().delays.total == pytest.approx(1.0, abs=tolerance)


@pytest.mark.parametrize("name", ["flat 2 x 2", "gaussian 15 x 15", "rough 64 x 64"])
def test_an_image_that_needs_too_many_pixels_is_refused_with_the_error_that_they_leave(
    tmp_path: Path, name: str
) -> None:
    with pytest.raises(RefusedInput, match=r"at a slope of 60 deg: 4000000 pixels.* predicted error of \d"):
        image_chain(tmp_path, name, 60.0, 1e-7)


def test_the_hull_of_an_images_transform_is_above_the_transform(tmp_path: Path) -> None:
    # Given images, and their transforms by the direct sum
    for name, picture in pictures().items():
        laser = image_chain(tmp_path, name, 0.0, 1e-2).scene.laser
        hull, pixel_m = beam_transform(laser, 500e3), laser.image_pixel_rad * 500e3
        turns = np.random.default_rng(1).uniform(0, 7, 400)
        for axis in (0, 1):
            row = picture.sum(axis=axis) / picture.sum()
            direct = np.abs(np.exp(-2j * np.pi * np.outer(turns, np.arange(row.size))) @ row)
            # When they are compared, then the hull is above, but for its interpolation
            assert (hull(turns / pixel_m) > direct * np.sinc(turns) ** 2 - 3e-3 / (1 + turns**2)).all(), name
