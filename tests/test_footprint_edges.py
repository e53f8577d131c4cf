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
from sim.footprint_error import beam_transform
from sim.scene import load_scene

MET_WITHIN = 3.0
"""The prediction is an estimate from pixels that were tried."""


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize(
    ("view_rad", "off_rad"), [(12.5e-6, 0.0), (30e-6, 25e-6), (247.5e-6, 240e-6), (247.5e-6, 250e-6)]
)
@pytest.mark.parametrize("azimuth_rad", [0.0, 0.3, math.pi / 4])
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
