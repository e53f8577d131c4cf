"""The light that returns, behind a receiver: delays and a kernel, put together at the sample instants.

Only the samples that are asked for are computed; there is no fine time grid.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput
from sim.beam import beam_sigma_m, beam_weights
from sim.footprint import DelayGaussian, DelayHistogram, Delays, NoReturn, delays
from sim.loops import loops
from sim.reference import polyphase
from sim.terrain_grid import Grid
from sim.terrain_statistics import plane_fit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim.footprint_plan import FootprintPlan
    from sim.kernel import Kernel
    from sim.laser import Laser
    from sim.terrain import Surface

_ON_GRID = 1e-9
_NOTHING = 1e-3
"""Of the tolerance: what may be left out without a word."""


def echo(
    kernel: Kernel, light: Delays, first_sample_s: float, interval_s: float, count: int
) -> NDArray[np.float64]:
    """Sample the response to an echo.

    Parameters
    ----------
    kernel : Kernel
        Pulse and receiver.
    light : DelayHistogram, DelayGaussian or NoReturn
        From `sim.footprint.delays`. Taps of the kernel are kept from shot to shot where the bins divide the
        interval and `first_sample_s` lies on a bin.
    first_sample_s, interval_s : float
        On the axis of the delays, from the gate, s.
    count : int
        Number of samples.

    Returns
    -------
    ndarray of float64, shape (count,)
        Volts for one photon a second times one second of light on the ground and a reflectance of 1.
    """
    if isinstance(light, NoReturn):
        return np.zeros(count)
    times = first_sample_s + interval_s * np.arange(count)
    if isinstance(light, DelayGaussian):
        return light.total * kernel.widened(light.std_s).exact(times - light.mean_s)
    bins = (first_sample_s - light.first_s) / light.bin_s
    stride, whole = interval_s / light.bin_s, math.floor(bins + _ON_GRID)
    within = round(1 / stride)
    if within > 1 and abs(within * stride - 1) < _ON_GRID:
        # Several samples in a bin: as many echoes with a sample a bin, one after the other.
        volts = np.empty(count)
        for one in range(min(within, count)):
            late_s, size = first_sample_s + one * interval_s, len(range(one, count, within))
            volts[one::within] = echo(kernel, light, late_s, light.bin_s, size)
        return volts
    if abs(stride - round(stride)) > _ON_GRID:
        lags = times[:, None] - (light.first_s + light.bin_s * np.arange(light.weights.size))
        return np.asarray(kernel.at(lags) @ light.weights)
    phase_s = max(0.0, bins - whole) * light.bin_s
    if phase_s < _ON_GRID * light.bin_s:
        phase_s = 0.0
    # The last lag, rounded up, so that the taps of one shot serve the next.
    longest = whole + round(stride) * (count - 1) + 1
    last_s = 2.0 ** math.ceil(math.log2(max(longest, 1))) * light.bin_s
    taps, first = kernel.taps(light.bin_s, phase_s, last_s)
    return polyphase(light.weights, taps, whole - first, round(stride), count)


class GridEcho:
    """Echoes from the posts of a terrain model, one compiled call for many shots.

    Parameters
    ----------
    surface : Surface
        Over a grid, with a number or a map on the same posts as its reflectance.
    laser : Laser
        A Gaussian or an ellipse along x or y. Its pointing does not matter here: each shot has its place.
    altitude_m : float
        Large against the heights: the slant path is a series, to (height / altitude)^3.
    plan : FootprintPlan
        With pixels at the posts.
    kernel : Kernel
        Pulse and receiver.
    interval_s, count
        Of the samples.

    Raises
    ------
    RefusedInput
        What this path cannot do; `sim.footprint.delays` can.
    """

    def __init__(
        self,
        surface: Surface,
        laser: Laser,
        altitude_m: float,
        plan: FootprintPlan,
        kernel: Kernel,
        interval_s: float,
        count: int,
    ) -> None:
        relief = surface.relief
        if not isinstance(relief, Grid) or plan.method != "grid" or plan.pixel_m != relief.spacing_m:
            raise RefusedInput("echoes from posts need a terrain model, and a plan with pixels at its posts")
        turned = laser.beam_azimuth_deg % 180 if laser.beam == "elliptical" else 0.0
        if laser.beam == "image" or turned not in (0.0, 90.0):
            raise RefusedInput("echoes from posts need a Gaussian beam, or an ellipse along x or y")
        # The series of the slant path is then wrong by 1e-12 of the altitude at most.
        if np.abs(relief.values).max() + plan.radius_m > 4e-3 * altitude_m:
            raise RefusedInput("echoes from posts need heights and a footprint below 4e-3 of the altitude")
        sigma_m = beam_sigma_m(laser, altitude_m)
        self._sigma_m = sigma_m[::-1] if turned else sigma_m
        self._brightness, self._reflectance = _brightness(surface, relief)
        self._relief, self._plan, self._altitude_m = relief, plan, altitude_m
        bins = interval_s / plan.bin_s
        self._stride, self._count = round(bins), count
        if self._stride < 1 or abs(bins - self._stride) > _ON_GRID * self._stride:
            raise RefusedInput(f"echoes from posts need whole bins in an interval: {bins:.9g} were asked for")
        taps, first = kernel.taps(plan.bin_s, 0.0, kernel.ends_s)
        counts = np.flatnonzero(np.abs(taps) > _NOTHING * plan.tolerance * np.abs(taps).max())
        # Light counts from a whole response before the first sample to its rise after the last.
        before = first + int(counts[-1]) + 1
        self._bins_after = before + math.ceil(-kernel.starts_s / plan.bin_s) + 2
        self._taps = taps[: counts[-1] + 1]
        self._before_s, self._offset = before * plan.bin_s, before - first

    def samples(
        self,
        centres_m: NDArray[np.float64],
        first_sample_s: NDArray[np.float64],
        count: int | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Sample a row of echoes.

        Parameters
        ----------
        centres_m : ndarray of float64, shape (shots, 2)
            x and y below the instrument, m; the beam points there.
        first_sample_s : ndarray of float64, shape (shots,)
            From each gate, s.
        count : int or None
            Of samples; None: as the constructor was told.

        Returns
        -------
        samples : ndarray of float64, shape (shots, count)
            As `echo`.
        energies : ndarray of float64, shape (shots,)
            Reflectance weighted by the whole beam; unknown ground counts as black.
        """
        relief = self._relief
        count = count or self._count
        found, energies = loops().grid_echo(
            relief.values,
            self._brightness,
            (relief.x_min_m, relief.y_min_m),
            relief.spacing_m,
            np.ascontiguousarray(centres_m, dtype=np.float64),
            self._sigma_m,
            self._plan.reach,
            self._altitude_m,
            np.asarray(first_sample_s, dtype=np.float64) - self._before_s,
            self._plan.bin_s,
            self._bins_after + self._stride * (count - 1),
            self._taps,
            self._offset,
            self._stride,
            count,
        )
        if self._reflectance != 1.0:
            found *= self._reflectance
            energies *= self._reflectance
        return found, energies


def _brightness(surface: Surface, relief: Grid) -> tuple[NDArray[np.float64], float]:
    """Factors of the posts, and one for all."""
    albedo = surface.albedo
    if isinstance(albedo, Grid):
        if albedo.values.shape != relief.values.shape or albedo.bounds != relief.bounds:
            raise RefusedInput("echoes from posts need a map of reflectance on the same posts as the heights")
        known = np.ones(relief.values.shape, dtype=np.bool_)
        for grid in (relief, albedo):
            if grid.known is not None:
                known = known & grid.known
        return np.where(known, albedo.values, 0.0), 1.0
    if relief.known is not None:
        return relief.known.astype(np.float64), float(albedo)
    return np.ones((1, 1)), float(albedo)


def posts_error(
    surface: Surface,
    laser: Laser,
    altitude_m: float,
    plan: FootprintPlan,
    kernel: Kernel,
    interval_s: float,
) -> float:
    """Estimate what relief between the posts of a terrain model would have done, max |dV| / peak.

    The echo of all posts is compared with the four of every other post in each direction, summed in the same
    way: over posts where the plan's pixels lie at posts, else over the plan's pixels between them. What the
    coarser pixels do to the plane through the ground is taken off, since that is no relief. Half of the
    difference is told. An error that grows as the square of the spacing, as on rounded ground, is a third of
    it; on rough ground it grows more slowly and nearly at random. So one estimate may be too small where
    details as large as a few posts meet them badly; over the places of a kind of ground it is 1 to 3 times
    the rms of the error. No bound, and no tolerance makes it less.

    Returns
    -------
    float
        0 where the surface is known everywhere, or nothing returns. 1 where the model has fewer than four
        posts in a direction, which tell nothing of what lies between them.
    """
    relief = surface.relief
    if not isinstance(relief, Grid):
        return 0.0
    whole = delays(surface, laser, altitude_m, plan)
    if not isinstance(whole, DelayHistogram):
        return 0.0
    if min(relief.values.shape) < 4:
        return 1.0
    lead_s = 10 * kernel.finest_s
    span_s = whole.bin_s * whole.weights.size + min(kernel.ends_s, 1e-6) + 2 * lead_s
    first_s, count = whole.first_s - lead_s, math.ceil(span_s / interval_s)
    at_posts = plan.pixel_m == relief.spacing_m
    coarse = replace(plan, pixel_m=2 * relief.spacing_m) if at_posts else plan

    def samples(ground: Grid, steps: FootprintPlan) -> NDArray[np.float64]:
        light = delays(replace(surface, relief=ground), laser, altitude_m, steps, align_s=first_s)
        return echo(kernel, light, first_s, interval_s, count)

    def lost_v2(ground: Grid) -> float:
        fine = samples(ground, plan)
        worst = [float(np.abs(samples(one, coarse) - fine).max()) for one in _every_other(ground)]
        return float(np.mean(np.square(worst)))

    centre = plan.centre_m or tuple(altitude_m * math.tan(angle) for angle in laser.pointing_rad)
    near = _about(relief, centre, plan.radius_m)
    lost = lost_v2(near)
    if at_posts:
        lost = max(lost - lost_v2(_plane_through(near, laser, altitude_m)), 0.0)
    peak_v = float(np.abs(echo(kernel, whole, first_s, interval_s, count)).max())
    return math.sqrt(lost) / peak_v / 2


def _plane_through(relief: Grid, laser: Laser, altitude_m: float) -> Grid:
    """Heights of the plane that fits the lit posts best, at all of them."""
    x, y = relief.posts()
    share = beam_weights(laser, altitude_m, x[None, :], y[:, None])
    if relief.known is not None:
        share = np.where(relief.known, share, 0.0)
    try:
        fit = plane_fit(x[None, :], y[:, None], relief.values, share)
    except RefusedInput:  # a single row of posts is lit
        return relief
    (x0, y0, z0), (along, across) = fit.centre_m, fit.gradient
    return replace(relief, values=z0 + along * (x - x0) + (across * (y - y0))[:, None])


def _about(relief: Grid, centre: tuple[float, ...], radius_m: float) -> Grid:
    """The posts about a place and four more; at least four in each direction."""
    begin, end = [], []
    for place, first, size in zip(
        centre, (relief.x_min_m, relief.y_min_m), relief.values.shape[::-1], strict=True
    ):
        middle, reach = (place - first) / relief.spacing_m, radius_m / relief.spacing_m + 4
        begin.append(int(np.clip(middle - reach, 0, size - 4)))
        end.append(int(np.clip(middle + reach, 4, size)))
    return _part(relief, slice(begin[1], end[1]), slice(begin[0], end[0]))


def _every_other(relief: Grid) -> list[Grid]:
    """Every other post, from odd or even rows and columns; those that have data."""
    found = []
    for row, column in itertools.product((0, 1), (0, 1)):
        if relief.known is None or relief.known[row::2, column::2].any():
            found.append(_part(relief, slice(row, None, 2), slice(column, None, 2)))
    return found


def _part(relief: Grid, rows: slice, columns: slice) -> Grid:
    return Grid(
        relief.values[rows, columns],
        relief.spacing_m * (rows.step or 1),
        relief.x_min_m + columns.start * relief.spacing_m,
        relief.y_min_m + rows.start * relief.spacing_m,
        None if relief.known is None else relief.known[rows, columns],
    )
