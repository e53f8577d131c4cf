"""What lies under a beam at every post of a terrain model: mean height, plane, slope, roughness.

Definitions of the campaigns. *Slope* and *roughness* are the tilt of, and the standard deviation about, the
least-squares plane over the disc within which the beam is above 1/e^2 of its peak; every post in it counts
alike, or, as an option, by the beam.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim.terrain_grid import Grid

EDGE = 2.0
"""Standard deviations of a Gaussian beam at 1/e^2 of its peak."""

_REACH = 4.5
"""Standard deviations after which the beam counts as dark: 4e-5 of its light."""


@dataclass(frozen=True, slots=True, eq=False)
class FootprintPlanes:
    """Footprints about the posts of a grid that lie far enough from its edge, arrays of one shape.

    Parameters
    ----------
    margin : int
        Posts left out on every side.
    light_m : ndarray of float64
        Mean height under the whole beam, weighted by it, m.
    centre_m : ndarray of float64
        Height of the post in the middle, m.
    plane_m : ndarray of float64
        Height of the least-squares plane in the middle, m.
    gradient : tuple of ndarray of float64
        Its dz/dx and dz/dy, m/m.
    roughness_m : ndarray of float64
        Standard deviation about it, m.
    """

    margin: int
    light_m: NDArray[np.float64]
    centre_m: NDArray[np.float64]
    plane_m: NDArray[np.float64]
    gradient: tuple[NDArray[np.float64], NDArray[np.float64]]
    roughness_m: NDArray[np.float64]

    def tilted(
        self, gradient: tuple[float, float], x_m: NDArray[np.float64], y_m: NDArray[np.float64]
    ) -> FootprintPlanes:
        """Return the same with a plane through the origin added to the heights.

        Parameters
        ----------
        gradient : tuple of float
            dz/dx and dz/dy of the plane.
        x_m, y_m : ndarray of float64
            Of the columns, and of the rows, of these footprints, m.

        Notes
        -----
        Beam and disc are symmetric, so heights in the middle gain what the plane has there; the roughness
        stays.
        """
        gx, gy = gradient
        raised = gx * x_m + (gy * y_m)[:, None]
        return replace(
            self,
            light_m=self.light_m + raised,
            centre_m=self.centre_m + raised,
            plane_m=self.plane_m + raised,
            gradient=(self.gradient[0] + gx, self.gradient[1] + gy),
        )

    @property
    def slope_deg(self) -> NDArray[np.float64]:
        """Tilt of the plane, degrees."""
        return np.degrees(np.arctan(np.hypot(*self.gradient)))


def footprint_planes(
    relief: Grid, sigma_m: float | tuple[float, float], margin_m: float, *, by_beam: bool = False
) -> FootprintPlanes:
    """Describe the footprint about each post.

    Parameters
    ----------
    relief : Grid
        Heights without gaps.
    sigma_m : float or tuple of float
        Standard deviation of a round Gaussian beam on the ground, or of an ellipse along x and along y, m;
        the disc is then an ellipse too.
    margin_m : float
        Distance from the edge of the grid within which no footprint is described, at least 4.5 standard
        deviations, m.
    by_beam : bool
        Weigh the posts by the beam where a plane is fitted; else all of the 1/e^2 disc alike.

    Raises
    ------
    RefusedInput
        Gaps, a margin that the beam crosses or that leaves no post, or a disc of fewer than 9 posts.
    """
    step = relief.spacing_m
    along_m, across_m = sigma_m if isinstance(sigma_m, tuple) else (sigma_m, sigma_m)
    wide_m = max(along_m, across_m)
    margin, reach = math.ceil(margin_m / step), math.ceil(_REACH * wide_m / step)
    if relief.known is not None:
        raise RefusedInput("planes under footprints need a terrain model without gaps")
    if margin < reach or min(relief.values.shape) <= 2 * margin:
        raise RefusedInput(
            f"footprints of {wide_m:.3g} m rms on {relief.values.shape[0]} x {relief.values.shape[1]} posts "
            f"{step:g} m apart with a margin of {margin_m:.4g} m: allowed are margins from "
            f"{reach * step:.4g} m on that leave a post"
        )
    inner = np.s_[margin : relief.values.shape[0] - margin, margin : relief.values.shape[1] - margin]
    part = relief.values[
        margin - reach : relief.values.shape[0] - margin + reach,
        margin - reach : relief.values.shape[1] - margin + reach,
    ]
    datum = float(part.mean())
    kernels = _kernels(step, reach, (along_m, across_m), by_beam, part.shape)
    light, flat, east, north, bent = kernels.sums(part - datum)
    along_m2, across_m2 = kernels.spread_m2
    along, across = east / along_m2, north / across_m2
    variance = bent - flat**2 - (along_m2 * along**2 + across_m2 * across**2)
    return FootprintPlanes(
        margin,
        light + datum,
        relief.values[inner],
        flat + datum,
        (along, across),
        np.sqrt(np.maximum(variance, 0.0)),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Kernels:
    """Beam and disc as spectra, for sums over a moving window of a terrain of one shape.

    Parameters
    ----------
    size : tuple of int
        Of the transforms.
    valid : tuple of slice
        Of what comes back: windows within the terrain.
    spectra : tuple of ndarray of complex128
        Of the beam, of the weights, and of these times x and y, conjugate.
    spread_m2 : tuple of float
        Mean squares of x and of y by the weights, m^2.
    """

    size: tuple[int, ...]
    valid: tuple[slice, ...]
    spectra: tuple[NDArray[np.complex128], ...]
    spread_m2: tuple[float, float]

    def sums(self, values: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        """Sums with each kernel, and of the squares with the weights."""
        from scipy import fft

        plain, squared = fft.rfft2(values, self.size), fft.rfft2(values**2, self.size)
        pairs = [(plain, one) for one in self.spectra] + [(squared, self.spectra[1])]
        return [fft.irfft2(one * kernel, self.size)[self.valid] for one, kernel in pairs]


@lru_cache(maxsize=1)
def _kernels(
    step_m: float, reach: int, sigma_m: tuple[float, float], by_beam: bool, shape: tuple[int, ...]
) -> _Kernels:
    """Return those of all terrains that differ by their heights alone."""
    from scipy import fft

    along_m, across_m = sigma_m
    away = step_m * np.arange(-reach, reach + 1)
    squares = away**2 + (away * (along_m / across_m))[:, None] ** 2
    beam = np.where(squares <= (_REACH * along_m) ** 2, np.exp(-0.5 * squares / along_m**2), 0.0)
    weights = beam if by_beam else (squares <= (EDGE * along_m) ** 2).astype(np.float64)
    if np.count_nonzero(weights) < 9:
        raise RefusedInput(
            f"a footprint of {max(sigma_m):.3g} m rms on posts {step_m:g} m apart holds too few"
        )
    beam, weights = beam / beam.sum(), weights / weights.sum()
    size = tuple(fft.next_fast_len(count, real=True) for count in shape)
    return _Kernels(
        size,
        tuple(slice(count - away.size + 1) for count in shape),
        tuple(
            fft.rfft2(kernel, size).conj()
            for kernel in (beam, weights, weights * away, weights * away[:, None])
        ),
        (float((weights * away**2).sum()), float((weights * away[:, None] ** 2).sum())),
    )
