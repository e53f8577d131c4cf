"""How much later than its light an echo is detected, over many footprints on relief, without noise.

The light of a footprint has a mean delay: that of the ground, weighted by the beam. The transmitted pulse
has a centroid. An echo whose Gaussian were centred on the sum of both would need no correction; its shift is
how much later it is. The receiver's filter makes the part of it that depends on the width. What the relief
makes, echoes that are not Gaussian, scatters about that.

Not modelled: noise, quantization, relief between the posts, ground that hides other ground, wandering of the
beam, and a field of view or law of scattering that would weigh the light of a place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput
from belahil.pulse_fit import gaussian_fit
from procedures.arrival_fit import FIT_SPAN_S
from sim.accuracy import Accuracy
from sim.constants import SPEED_OF_LIGHT_M_PER_S
from sim.draws import Draws
from sim.echo import GridEcho
from sim.footprint import plan_footprint
from sim.kernel import Kernel
from sim.laser import beam_sigma_m, pulse_shape
from sim.rfm import EXCLUSION_SAMPLES, loops
from sim.template_bank import TemplateBank
from sim.terrain_grid import Grid

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from procedures.arrival_ground import Ground
    from procedures.known_receiver import KnownReceiver
    from sim.laser import Laser

TOLERANCE = 1e-3
"""Of the echoes, relative to their peak: 0.02 ns of an arrival at most."""

_ROUND_S = 1e-6
"""Samples of so much time on either side of the light are searched."""
_COARSEST = 0.7
"""Standard deviations of the beam between two posts: coarser ones miss what a footprint sees."""
_LIT = 0.999
_STEPS = 2
_PHASES = 20


@dataclass(frozen=True, slots=True, eq=False)
class Footprints:
    """Echoes of many footprints, arrays of shape (n,).

    Parameters
    ----------
    shift_s : ndarray of float64
        Detected arrival less mean delay of the light and centroid of the transmitted pulse, s.
    width_s : ndarray of float64
        Detected full width at half maximum, s.
    altitude_m : ndarray of float64
        m.
    ground : ndarray of int64
        Number of the terrain.
    names : tuple of str
        Of the terrains.
    dark : int
        Footprints left out because part of them has no data.
    """

    shift_s: NDArray[np.float64]
    width_s: NDArray[np.float64]
    altitude_m: NDArray[np.float64]
    ground: NDArray[np.int64]
    names: tuple[str, ...]
    dark: int = 0


def echo_kernel(laser: Laser, known: KnownReceiver) -> Kernel:
    """Return what a receiver makes of a laser's pulse."""
    return Kernel(pulse_shape(laser), known.poles, known.zeros)


def footprints(
    lands: tuple[Ground, ...],
    altitudes_m: tuple[float, ...] | None,
    per_side: int,
    known: KnownReceiver,
    seed: int,
) -> Footprints:
    """Detect the echoes of footprints on a square grid over each terrain, at each altitude.

    Parameters
    ----------
    lands : tuple of Ground
        Terrains.
    altitudes_m : tuple of float or None
        m; None: each terrain's own.
    per_side : int
        Footprints along each side of a terrain.
    known : KnownReceiver
        The receiver: its filter and its sample interval.
    seed : int
        Of where each echo lies between two samples.

    Raises
    ------
    RefusedInput
        A terrain smaller than a footprint, or with posts too far apart for it, and what `sim.echo.GridEcho`
        refuses.
    """
    rows: list[tuple[NDArray[np.float64], ...]] = []
    dark = 0
    for number, ground in enumerate(lands):
        for altitude_m in altitudes_m or ground.altitudes_m:
            draws = Draws(seed, len(rows))
            shift_s, width_s, lost = _over(ground, altitude_m, per_side, known, draws)
            dark += lost
            rows.append((shift_s, width_s, np.full(shift_s.size, altitude_m), np.full(shift_s.size, number)))
    shift, width, altitude, place = (np.concatenate(column) for column in zip(*rows, strict=True))
    return Footprints(shift, width, altitude, place.astype(np.int64), tuple(one.name for one in lands), dark)


def _over(
    ground: Ground, altitude_m: float, per_side: int, known: KnownReceiver, draws: Draws
) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """Shifts and widths over one terrain from one altitude, and how many footprints lack data."""
    laser, relief, interval_s = ground.laser, ground.surface.relief, known.sample_interval_s
    assert isinstance(relief, Grid)
    kernel = echo_kernel(laser, known)
    plan = plan_footprint(
        Accuracy(TOLERANCE), kernel, laser, altitude_m, ground.surface, interval_s, method="grid"
    )
    sigma_m = beam_sigma_m(laser, altitude_m)
    if relief.spacing_m > _COARSEST * min(sigma_m):
        raise RefusedInput(
            f"{ground.name}: posts {relief.spacing_m:g} m apart under a beam of {min(sigma_m):.3g} m rms "
            f"from {altitude_m / 1e3:g} km; allowed: up to {_COARSEST * min(sigma_m):.3g} m"
        )
    count = 2 * math.ceil(_ROUND_S / interval_s)
    echoes = GridEcho(
        ground.surface, laser, altitude_m, replace(plan, pixel_m=relief.spacing_m), kernel, interval_s, count
    )
    places_m = _places(ground, altitude_m, plan.radius_m, per_side)
    light_s, lit = mean_delays(ground, altitude_m, places_m, plan.reach)
    x_m, y_m = (grid.ravel() for grid in np.meshgrid(*places_m))
    whole = lit.ravel() > _LIT
    centres_m = np.stack([x_m[whole], y_m[whole]], axis=1)
    true_s = light_s.ravel()[whole] + kernel.pulse.mean_s
    phases = draws.stream("sampling_phase").random(true_s.size)
    first_s = true_s - _ROUND_S + interval_s * phases
    volts, _ = echoes.samples(centres_m, first_s)
    found = _detected(volts, interval_s)
    return first_s + found[:, 0] - true_s, found[:, 1], int((~whole).sum())


def _places(
    ground: Ground, altitude_m: float, radius_m: float, per_side: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return x and y of the footprints, all of which lie on the terrain, m."""
    x_min, x_max, y_min, y_max = ground.surface.bounds
    room_m = min(x_max - x_min, y_max - y_min) - 2 * radius_m
    if room_m <= 0:
        raise RefusedInput(
            f"{ground.name}: covers {x_max - x_min:g} m x {y_max - y_min:g} m; a footprint from "
            f"{altitude_m / 1e3:g} km needs {2 * radius_m:.4g} m"
        )
    return (
        np.linspace(x_min + radius_m, x_max - radius_m, per_side),
        np.linspace(y_min + radius_m, y_max - radius_m, per_side),
    )


def mean_delays(
    ground: Ground,
    altitude_m: float,
    places_m: tuple[NDArray[np.float64], NDArray[np.float64]],
    reach: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the mean delay of the light of footprints on a grid, s from the gate, and how much is lit.

    Parameters
    ----------
    ground : Ground
        The terrain; a Gaussian beam, or an ellipse along x or y.
    altitude_m : float
        m.
    places_m : tuple of ndarray of float64, shapes (n,) and (m,)
        x and y of the footprints, m.
    reach : float
        Standard deviations of the beam after which it is cut.

    Returns
    -------
    delay_s, lit : ndarray of float64, shape (m, n)
        The second is the share of the beam on known ground.

    Notes
    -----
    A Gaussian beam along the axes is a product: two products of matrices do all footprints of a terrain. The
    way is that of `sim.echo.GridEcho`, ``-z + r**2 / (2 altitude)``, to (height / altitude)^2.
    """
    relief, laser = ground.surface.relief, ground.laser
    assert isinstance(relief, Grid)
    sigma_m = beam_sigma_m(laser, altitude_m)
    if laser.beam == "elliptical" and laser.beam_azimuth_deg % 180 == 90:
        sigma_m = sigma_m[::-1]
    posts = relief.posts()
    weights, bends = [], []
    for place_m, post_m, spread_m in zip(places_m, posts, sigma_m, strict=True):
        away = (post_m - place_m[:, None]) / spread_m
        with np.errstate(under="ignore"):
            share = np.where(np.abs(away) <= reach, np.exp(-0.5 * away**2), 0.0)
        share *= relief.spacing_m / (spread_m * math.sqrt(2 * math.pi))
        weights.append(share)
        bends.append(share * (away * spread_m) ** 2 / (2 * altitude_m))
    known = np.ones(relief.values.shape) if relief.known is None else relief.known.astype(np.float64)
    bright = known * (ground.surface.albedo.values if isinstance(ground.surface.albedo, Grid) else 1.0)
    (along, down), (bend_along, bend_down) = weights, bends
    total = down @ bright @ along.T
    height = down @ (bright * relief.values) @ along.T
    bend = down @ bright @ bend_along.T + bend_down @ bright @ along.T
    safe = np.where(total > 0, total, 1.0)
    way_m = np.where(total > 0, (bend - height) / safe, 0.0)
    return 2 / SPEED_OF_LIGHT_M_PER_S * way_m, down @ known @ along.T


def _detected(volts: NDArray[np.float64], interval_s: float) -> NDArray[np.float64]:
    """Arrival from the first sample and width of the best pulse of each row, s, by the range finder."""
    bank, use, window = TemplateBank(interval_s), loops(), round(FIT_SPAN_S / interval_s)
    found = np.empty((len(volts), 2))
    for row, samples in zip(found, volts, strict=True):
        lags = use.find(samples, 0.0, bank, 1, EXCLUSION_SAMPLES)
        row[:] = use.refine(samples, 0.0, lags, bank.widths, window, _STEPS)[0, :2]
    return found * interval_s


def transmitted(laser: Laser, known: KnownReceiver) -> tuple[float, float]:
    """Return detected width of a laser's own pulse and its delay from its centroid, s, mean over phases.

    Raises
    ------
    RefusedInput
        It has no fit behind this filter.
    """
    kernel, interval_s = echo_kernel(laser, known), known.sample_interval_s
    count = round(FIT_SPAN_S / interval_s)
    pulses = []
    for phase in range(_PHASES):
        first_s = (phase / _PHASES - count // 2) * interval_s
        fit = gaussian_fit(kernel.exact(first_s + interval_s * np.arange(count)), interval_s)
        if fit.status != "ok" or fit.pulse is None:
            raise RefusedInput(f"the laser's own pulse behind this filter: the fit says {fit.status}")
        pulses.append((fit.pulse.fwhm_s, first_s + fit.pulse.arrival_s - kernel.pulse.mean_s))
    width_s, delay_s = np.mean(pulses, axis=0).tolist()
    return width_s, delay_s
