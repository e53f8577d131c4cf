"""Made relief: fractional Brownian surfaces, and universal multifractals with the same law of RMS deviation.

Both are made by Fourier synthesis on a torus that is larger than the surface, by circulant embedding (Stein,
2002): between any two posts of the surface that is made, the mean square difference of heights is *exactly*
the power law, over many seeds. A surface synthesized on its own periodic square has neither the law at small
nor at large distances.

What this does not model: any process that forms real relief (craters, boulders, slopes at the angle of
repose), anisotropy, and, with a monofractal, intermittence: its smooth and its rough places differ by chance
only. The parameters of Mercury at footprint scale are not known; all defaults are assumed.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput
from sim.draws import Draws
from sim.terrain import REFLECTANCE, Kind, Surface, tilted
from sim.terrain_dtm import from_array
from sim.terrain_statistics import rms_deviation
from sim.terrain_synthesis import fractional_brownian, integrated_flux, moment_exponent

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim.terrain_grid import Grid


def monofractal(
    *,
    extent_m: float = 768.0,
    spacing_m: float = 1.5,
    hurst: float = 0.8,
    rms_deviation_m: float = 1.0,
    baseline_m: float = 65.0,
    seed: int = 1,
    slope_deg: float = 0.0,
    azimuth_deg: float = 0.0,
    reflectance: float | Grid = REFLECTANCE,
) -> Surface:
    """Make a fractional Brownian surface.

    Parameters
    ----------
    extent_m, spacing_m : float
        Side of the square and distance of the posts, m; nadir is in the middle, at z = 0.
    hurst : float
        H, above 0 and below 1: RMS deviation grows with the baseline to this power. 0.8 at kilometres on
        Mercury (Landais et al., 2019).
    rms_deviation_m, baseline_m : float
        This surface, before the slope below is added, is scaled to have this RMS deviation, m, at this
        baseline, m. The baseline is taken at the nearest whole number of spacings and converted with H.
    seed : int
        Not negative; the same seed makes the same relief at every height scale.
    slope_deg, azimuth_deg : float
        Of a plane to be added, as in `sim.terrain.gradient_of`. The relief has a random slope of its own.
    reflectance : float or Grid
        Normal albedo.

    Raises
    ------
    RefusedInput
        When a parameter is not allowed, or the grid is too large.
    """
    count = _posts(extent_m, spacing_m)
    heights = fractional_brownian(count, hurst, Draws(seed, 0).stream("terrain"))
    surface = _scaled("fractal", heights, spacing_m, hurst, rms_deviation_m, baseline_m)
    return replace(tilted(surface, slope_deg, azimuth_deg), albedo=reflectance)


def multifractal(
    *,
    extent_m: float = 768.0,
    spacing_m: float = 1.5,
    hurst: float = 0.8,
    alpha: float = 1.8,
    c1: float = 0.1,
    rms_deviation_m: float = 1.0,
    baseline_m: float = 65.0,
    seed: int = 1,
    slope_deg: float = 0.0,
    azimuth_deg: float = 0.0,
    reflectance: float | Grid = REFLECTANCE,
) -> Surface:
    """Make a universal multifractal surface: a log-stable cascade, fractionally integrated.

    Parameters
    ----------
    extent_m, spacing_m, rms_deviation_m, baseline_m, seed, slope_deg, azimuth_deg, reflectance
        As for `monofractal`.
    hurst : float
        Order H of the integration, which is the exponent of the *mean* absolute difference. That of the RMS
        deviation is ``H - K(2) / 2`` and must be above 0 and below 1.
    alpha : float
        Index of the cascade, 0.5 to 2, and not within 0.01 of 1; 2 is log-normal.
    c1 : float
        Codimension of its mean; 0 gives a monofractal.

    Raises
    ------
    RefusedInput
        When a parameter is not allowed, or the grid is too large.
    """
    if c1 == 0:
        return replace(
            monofractal(
                extent_m=extent_m,
                spacing_m=spacing_m,
                hurst=hurst,
                rms_deviation_m=rms_deviation_m,
                baseline_m=baseline_m,
                seed=seed,
                slope_deg=slope_deg,
                azimuth_deg=azimuth_deg,
                reflectance=reflectance,
            ),
            kind="multifractal",
        )
    exponent = hurst - moment_exponent(2.0, alpha, c1) / 2
    count = _posts(extent_m, spacing_m)
    heights = integrated_flux(count, hurst, alpha, c1, Draws(seed, 0).stream("terrain"))
    surface = _scaled("multifractal", heights, spacing_m, exponent, rms_deviation_m, baseline_m)
    return replace(tilted(surface, slope_deg, azimuth_deg), albedo=reflectance)


def _posts(extent_m: float, spacing_m: float) -> int:
    if not (0 < spacing_m < np.inf and spacing_m <= extent_m < np.inf):
        raise RefusedInput(
            f"extent_m = {extent_m:g}, spacing_m = {spacing_m:g}: both must be positive, "
            "the extent not below the spacing"
        )
    return round(extent_m / spacing_m) + 1


def _scaled(
    kind: Kind,
    heights: NDArray[np.float64],
    spacing_m: float,
    exponent: float,
    rms_deviation_m: float,
    baseline_m: float,
) -> Surface:
    """Bring the RMS deviation to what was asked for, and nadir to z = 0."""
    extent_m = (heights.shape[0] - 1) * spacing_m
    if not (0 < rms_deviation_m < np.inf and spacing_m <= baseline_m <= extent_m):
        raise RefusedInput(
            f"rms_deviation_m = {rms_deviation_m:g} at baseline_m = {baseline_m:g}: must be positive, the "
            f"baseline {spacing_m:g} to {extent_m:g}"
        )
    found = rms_deviation(from_array(heights, spacing_m), [baseline_m])
    wanted_m = rms_deviation_m * (found.baseline_m[0] / baseline_m) ** exponent
    return from_array(heights * (wanted_m / found.rms_m[0]), spacing_m, datum_m=None, kind=kind)
