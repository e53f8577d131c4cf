"""The spot of light on the ground: when the light of each part of it comes back, as a histogram of delays.

Delays are 2 (R - altitude) / c, relative to a gate at 2 altitude / c, with R the way from the instrument to
the ground. Weights are shares of the beam times reflectance, so that a whole beam on white ground sums to 1.

What this does not model: ground that hides other ground, light that is reflected twice, and the motion of the
instrument while the light travels.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Literal

import numpy as np
from msgspec import structs

from belahil.errors import RefusedInput
from belahil.uncertainty import sized
from sim.beam import beam_image, beam_sigma_m, beam_weights
from sim.constants import SPEED_OF_LIGHT_M_PER_S
from sim.footprint_plan import FootprintPlan, plan_footprint
from sim.reference import cic_deposit, lag4_deposit, slant_delay
from sim.terrain_grid import OffTerrain

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim.laser import Laser
    from sim.terrain import Surface

    Factor = Callable[["NDArray[np.float64]", "NDArray[np.float64]"], "NDArray[np.float64]"]

__all__ = [
    "DelayGaussian",
    "DelayHistogram",
    "Delays",
    "FootprintPlan",
    "NoReturn",
    "delays",
    "plan_footprint",
]

_MOST_BINS = 5_000_000


@dataclass(frozen=True, slots=True, eq=False)
class DelayHistogram:
    """Light by delay, on equal bins.

    Parameters
    ----------
    first_s : float
        Delay of bin 0, s.
    bin_s : float
        s.
    weights : ndarray of float64, shape (n,)
        After the cubic deposit a bin may be slightly negative.
    total : float
        Sum of the weights: the mean reflectance, where the whole beam meets known ground.
    lit : float
        Share of the beam that meets known ground.
    """

    first_s: float
    bin_s: float
    weights: NDArray[np.float64]
    total: float
    lit: float

    @property
    def mean_s(self) -> float:
        """Mean delay, s."""
        return self.first_s + self.bin_s * float(self._places @ self.weights) / self.total

    @property
    def std_s(self) -> float:
        """Standard deviation of the delays, s."""
        off = self._places - (self.mean_s - self.first_s) / self.bin_s
        return self.bin_s * math.sqrt(max(float(off**2 @ self.weights) / self.total, 0.0))

    @property
    def _places(self) -> NDArray[np.float64]:
        return np.arange(self.weights.size, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class DelayGaussian:
    """The delays of a plane under a Gaussian beam; `total` and `lit` are those of `DelayHistogram`."""

    mean_s: float
    std_s: float
    total: float
    lit: float = 1.0


@dataclass(frozen=True, slots=True)
class NoReturn:
    """No light comes back.

    Parameters
    ----------
    reason : str
        One line.
    total, lit : float
        0.
    """

    reason: str
    total: float = 0.0
    lit: float = 0.0


Delays = DelayHistogram | DelayGaussian | NoReturn


def delays(
    surface: Surface,
    laser: Laser,
    altitude_m: float,
    plan: FootprintPlan,
    pointing_rad: tuple[float, float] = (0.0, 0.0),
    *,
    align_s: float = 0.0,
    factor: Factor | None = None,
    deposit: Literal["lag4", "cic"] = "lag4",
) -> Delays:
    """Find the delays of the light of one shot.

    Parameters
    ----------
    surface : Surface
        The ground.
    laser : Laser
        The beam.
    altitude_m : float
        Of the instrument above z = 0, m.
    plan : FootprintPlan
        From `plan_footprint`. Pixels lie at multiples of `plan.pixel_m` from the origin, or from a post.
    pointing_rad : tuple of float
        Of this shot, beside the laser's own, rad.
    align_s : float
        A bin lies there, s: with the first sample, taps of the kernel serve every shot.
    factor : callable or None
        Of x and y, m from nadir: what else weights the light, as a field of view or a law of scattering.
    deposit : {"lag4", "cic"}
        "lag4" conserves four moments; "cic" two, but is never negative, which a rate needs.

    Returns
    -------
    DelayHistogram, DelayGaussian or NoReturn
        The last where no ground is lit, or it reflects nothing.

    Raises
    ------
    RefusedInput
        A factor, or a positive deposit, with a plan for the closed form; or delays that spread over more than
        five million bins.
    """
    pointing = (laser.pointing_rad[0] + pointing_rad[0], laser.pointing_rad[1] + pointing_rad[1])
    centre = (altitude_m * math.tan(pointing[0]), altitude_m * math.tan(pointing[1]))
    if plan.method == "closed form":
        if factor is not None or deposit != "lag4":
            raise RefusedInput('a factor or a positive deposit needs a plan with method = "grid"')
        return _plane_delays(surface, laser, altitude_m, centre)
    x, y, share = _pixels(surface, structs.replace(laser, pointing_rad=pointing), altitude_m, plan, centre)
    if not x.size:
        return NoReturn("the field of view sees nothing of the beam")
    try:
        ground = surface.sample(x, y)
    except OffTerrain as nothing:
        return NoReturn(str(nothing))
    # What a field of view leaves out is lit, too.
    lit = float(share[ground.known].sum() if plan.centre_m is None else 1 - share[~ground.known].sum())
    weights = share * ground.reflectance
    if factor is not None:
        weights = weights * factor(x, y)
    total = float(weights.sum())
    if total <= 0:
        where = f"{plan.radius_m:.3g} m of ({centre[0]:.4g}, {centre[1]:.4g}) m"
        return NoReturn(f"the ground within {where} is black")
    bright = weights > 0
    delay_s = slant_delay(ground.height_m[bright], x[bright] ** 2 + y[bright] ** 2, altitude_m)
    return _deposited(delay_s, weights[bright], plan.bin_s, align_s, total, lit, deposit)


def _plane_delays(surface: Surface, laser: Laser, altitude_m: float, centre: tuple[float, float]) -> Delays:
    """Gaussian of the delays; the mean has what the curved wavefront adds."""
    if surface.relief is not None or not isinstance(surface.albedo, float | int):
        raise RefusedInput("a plan for the closed form serves a plane of one reflectance only")
    if not surface.albedo:
        return NoReturn("the ground is black")
    height_m = surface.gradient[0] * centre[0] + surface.gradient[1] * centre[1]
    down_m = altitude_m - height_m
    slant_m = math.hypot(*centre, down_m)
    tilt = [(place - climb * down_m) / slant_m for place, climb in zip(centre, surface.gradient, strict=True)]
    major_m, minor_m = beam_sigma_m(laser, altitude_m)
    angle = math.radians(laser.beam_azimuth_deg)
    along = math.cos(angle) * tilt[0] + math.sin(angle) * tilt[1]
    across = math.cos(angle) * tilt[1] - math.sin(angle) * tilt[0]
    bend_m = (major_m**2 + minor_m**2) / (2 * slant_m)
    to_centre = slant_delay(np.array(height_m), np.array(centre[0] ** 2 + centre[1] ** 2), altitude_m)
    return DelayGaussian(
        mean_s=float(to_centre) + 2 / SPEED_OF_LIGHT_M_PER_S * bend_m,
        std_s=2 / SPEED_OF_LIGHT_M_PER_S * math.hypot(along * major_m, across * minor_m),
        total=float(surface.albedo),
    )


def _pixels(
    surface: Surface, laser: Laser, altitude_m: float, plan: FootprintPlan, centre: tuple[float, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Places of the pixels and their shares of the beam, shape (n,) each."""
    bounds = surface.bounds
    corner = (bounds[0], bounds[2]) if surface.spacing_m else (0.0, 0.0)
    middle = plan.centre_m or centre
    begin = [math.floor((place - first) / plan.pixel_m) for place, first in zip(middle, corner, strict=True)]
    columns, rows = _square(math.ceil(plan.radius_m / plan.pixel_m) + 1)
    x = corner[0] + plan.pixel_m * (begin[0] + columns)
    y = corner[1] + plan.pixel_m * (begin[1] + rows)
    share = beam_weights(laser, altitude_m, x, y) * (plan.pixel_m**2 / beam_area_m2(laser, altitude_m))
    # An image ends by itself; the others are cut along a line of equal brightness.
    least = 0.0
    if laser.beam != "image" and math.isfinite(plan.reach):
        least = math.exp(-0.5 * plan.reach**2) * plan.pixel_m**2 / beam_area_m2(laser, altitude_m)
    within = share > least
    across, along = np.broadcast_arrays(x, y)
    return across[within], along[within], share[within]


@lru_cache(maxsize=16)
def _square(half: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    numbers = np.arange(-half, half + 2, dtype=np.float64)
    numbers.setflags(write=False)
    return numbers[None, :], numbers[:, None]


def beam_area_m2(laser: Laser, altitude_m: float) -> float:
    """Return the integral of `beam_weights` over the ground, m^2."""
    if laser.beam == "image":
        image = beam_image(laser)
        return float(image.pixels.sum()) * (image.pixel_rad * altitude_m) ** 2
    major_m, minor_m = beam_sigma_m(laser, altitude_m)
    return 2 * math.pi * major_m * minor_m


def _deposited(
    delay_s: NDArray[np.float64],
    weights: NDArray[np.float64],
    bin_s: float,
    align_s: float,
    total: float,
    lit: float,
    deposit: Literal["lag4", "cic"],
) -> DelayHistogram:
    places = (delay_s - align_s) / bin_s
    first = math.floor(places.min()) - 1
    count = math.floor(places.max()) - first + 3
    if count > _MOST_BINS:
        raise RefusedInput(
            f"delays over {count} bins of {sized(bin_s, 's', 3)}: "
            f"at most {_MOST_BINS} are allowed; is a height wrong?"
        )
    put = lag4_deposit if deposit == "lag4" else cic_deposit
    return DelayHistogram(align_s + first * bin_s, bin_s, put(places - first, weights, count), total, lit)
