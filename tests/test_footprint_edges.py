"""Light with an edge: the field of view cuts the footprint, a crater has a rim."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scenes import BARE, with_
from scipy.stats import ncx2

from belahil.errors import RefusedInput
from sim.accuracy import Accuracy
from sim.chain import Chain
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
    with pytest.raises(RefusedInput, match=r"an edge in the light on the ground: \d+ pixels, .* error of \d"):
        Chain(load_scene("boulder"), Accuracy(1e-9))
