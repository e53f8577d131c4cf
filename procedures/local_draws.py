"""Echoes of many shots in a few samples about where they should arrive, with noise, apart from each other.

An echo, its shot noise and the stationary noise add up, and each scales with the scene: by the reflectance,
by its root, and by the noise of the receiver and the sunlight. So one set of draws serves all reflectances by
day and by night, and what differs between two of them is no chance of the draw.

What this does not model: what `sim.shot_rows` leaves out, and the window's mean, which the range finder takes
off and an echo raises by some 1e-4 of its height.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from belahil.config import Interleave
from belahil.errors import RefusedInput
from procedures.noise_colour import unit_noise
from sim.chain_noise import ShotNoise
from sim.echo import GridEcho
from sim.laser import photon_energy_j
from sim.light_noise import shot_noise_density, white_step_rms_v

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from procedures.range_places import Places
    from sim.chain import Chain
    from sim.draws import Draws
    from sim.rfm import RangeFinder

NEAR_SAMPLES = 20
"""On either side of the place where an echo is looked for; false is more than 10 m, 5.3 samples, away."""

_HALF_SAMPLES = 81
"""Of a piece at least: so much serves any range finder of the assumption budget, so that all meet the same
noise."""
_AT_ONCE = 256
"""Rows of shot noise in one product of matrices."""
_FORGOTTEN_SAMPLES = 40
"""Between two rows of one stretch of noise: so many forget what was before."""


@dataclass(frozen=True, slots=True, eq=False)
class LocalDraws:
    """Draws about the echo, at the converter: e echoes, n = e x repeats shots, m samples.

    Parameters
    ----------
    echo_v, still_v : ndarray of float64, shape (e, m)
        Without noise, of white ground; the second without jitter of beam and energy.
    first_s : ndarray of float64, shape (e,)
        First sample from the gate, s.
    true_s : ndarray of float64, shape (e,)
        Arrival of the middle of the light, from the gate, s.
    optical_j : ndarray of float64, shape (e,)
        Energy of the light of white ground at the photodiode, with the jitter of the laser's energy, J.
    shot_variance : ndarray of float64, shape (e, u)
        Of the steps before the filter from which shot noise is made, of white ground, V^2.
    shot_taps : ndarray of float64, shape (u, m)
        What the filter makes of a step.
    shot_v : ndarray of float64, shape (n, m)
        Shot noise of white ground.
    unit : ndarray of float64, shape (n, m)
        Stationary noise of unit rms.
    weight : ndarray of float64, shape (n,)
        Of the shots: 1, unless their noise is tilted, see `procedures.noise_tilt`.
    of_echo : ndarray of int64, shape (n,)
        Which echo a shot has.
    interval_s : float
        Between samples, s.
    middle : int
        Sample next to which an echo arrives behind the filter.
    even : ndarray of int64, shape (e,)
        The first sample of the converter that takes the even samples of a window: 0 or 1.
    mismatch : Interleave
        Of the two converters, as `sim.converter` has it; echoes have its skew already.
    """

    echo_v: NDArray[np.float64]
    still_v: NDArray[np.float64]
    first_s: NDArray[np.float64]
    true_s: NDArray[np.float64]
    optical_j: NDArray[np.float64]
    shot_variance: NDArray[np.float64]
    shot_taps: NDArray[np.float64]
    shot_v: NDArray[np.float64]
    unit: NDArray[np.float64]
    weight: NDArray[np.float64]
    of_echo: NDArray[np.int64]
    interval_s: float
    middle: int
    even: NDArray[np.int64]
    mismatch: Interleave

    def windows(
        self, reflectance: float, noise_rms_v: float, part: slice = slice(None)
    ) -> NDArray[np.float64]:
        """Return the samples of some shots of a scene before they are rounded, V."""
        found = reflectance * self.echo_v[self.of_echo[part]] + noise_rms_v * self.unit[part]
        found += math.sqrt(reflectance) * self.shot_v[part]
        if self.mismatch == Interleave():
            return found
        side = alternating(self.even[self.of_echo[part]], found.shape[1])
        return mismatched(found, side, self.mismatch)


def alternating(even: NDArray[np.int64], size: int) -> NDArray[np.float64]:
    """Return 1 for samples of the converter of the even ones and -1 for the others, shape (n, size)."""
    return np.asarray(1.0 - 2.0 * ((np.arange(size) - even[:, None]) % 2))


def mismatched(
    volts: NDArray[np.float64], side: NDArray[np.float64], mismatch: Interleave
) -> NDArray[np.float64]:
    """Return samples with the gains and offsets of two converters, which `side` tells as `alternating`, V."""
    if not (mismatch.gain or mismatch.offset_v):
        return volts
    return volts * (1 + mismatch.gain / 2 * side) + mismatch.offset_v / 2 * side


def local_draws(chain: Chain, places: Places, late_s: float, draws: Draws, repeats: int = 1) -> LocalDraws:
    """Draw shots.

    Parameters
    ----------
    chain : Chain
        Over a grid with a reflectance of 1 and with shot noise; its own dark noise and sun do not matter.
    places : Places
        One echo at each.
    late_s : float
        By how much an echo is late behind the receiver's filter, to a sample, s.
    draws : Draws
        "phase", "pointing", "energy", "shot_noise" and "noise"; "converter" where two of them differ.
    repeats : int
        Shots with noise of their own for each echo.

    Raises
    ------
    RefusedInput
        Ground that is not white, no shot noise, or what `sim.echo.GridEcho` refuses.
    """
    laser, altitude_m, gain = chain.scene.laser, chain.scene.altitude_m, chain.scene.gain
    shot_noise = next((one for one in chain.light_noise if isinstance(one, ShotNoise)), None)
    if chain.surface.albedo != 1.0 or shot_noise is None:
        raise RefusedInput("draws about an echo need a reflectance of 1 and shot noise")
    count, interval_s = places.true_s.size, chain.receiver.grid.interval_s
    half = max(_HALF_SAMPLES, _needed(chain.range_finder))
    size = 2 * half + 1
    true_s = places.true_s + chain.kernel.pulse.mean_s
    phase = draws.stream("phase").random(count)
    first_s = true_s + late_s - (half + phase) * interval_s
    wandered = draws.stream("pointing").standard_normal((count, 2)) * np.array(laser.jitter_rad)
    centres_m = places.centre_m + altitude_m * np.tan(wandered)
    energy = 1 + laser.energy_jitter * draws.stream("energy").standard_normal(count)
    plan = replace(chain.plan, pixel_m=chain.surface.spacing_m)
    volts = GridEcho(chain.surface, laser, altitude_m, plan, chain.kernel, interval_s, size)
    echo_v, lit = volts.samples(centres_m, first_s)
    photon_j = photon_energy_j(laser.wavelength_m)
    variance, taps = _shot_steps(chain, shot_noise, centres_m, first_s, energy, size)
    of_echo = np.repeat(np.arange(count), repeats)
    mismatch, even = chain.scene.truth.interleave, np.zeros(count, dtype=np.int64)
    if mismatch != Interleave():
        even = draws.stream("converter").integers(2, size=count)
    if mismatch.skew_s:
        late = volts.samples(centres_m, first_s + mismatch.skew_s / 2)[0]
        early = volts.samples(centres_m, first_s - mismatch.skew_s / 2)[0]
        echo_v = np.where(alternating(even, size) > 0, late, early)
    return LocalDraws(
        echo_v=echo_v * (gain * energy[:, None]),
        still_v=volts.samples(places.centre_m, first_s)[0] * gain,
        first_s=first_s,
        true_s=true_s,
        optical_j=chain.light_kernel.gain * photon_j * lit * energy,
        shot_variance=gain**2 * variance,
        shot_taps=taps,
        shot_v=gain * _shot_volts(variance[of_echo], taps, draws.stream("shot_noise")),
        unit=_stationary(chain, of_echo.size, size, draws.stream("noise")),
        weight=np.ones(of_echo.size),
        of_echo=of_echo,
        interval_s=interval_s,
        middle=half,
        even=even,
        mismatch=mismatch,
    )


def _needed(finder: RangeFinder) -> int:
    """Samples on either side of the middle that a search, and a fit about what it finds, may touch."""
    searched = finder.exclusion_samples + finder.bank.tap_reach
    return NEAR_SAMPLES + max(searched, finder.correlation_window_samples // 2 + 1)


def _shot_steps(
    chain: Chain,
    noise: ShotNoise,
    centres_m: NDArray[np.float64],
    first_s: NDArray[np.float64],
    energy: NDArray[np.float64],
    size: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Variance of the steps before the filter, shape (n, u), and its response to each, shape (u, size)."""
    bin_s = noise.step_s / max(1, math.ceil(noise.step_s / chain.plan.bin_s - 1e-9))
    plan = replace(chain.plan, bin_s=bin_s, pixel_m=chain.surface.spacing_m)
    place = (chain.scene.laser, chain.scene.altitude_m, plan, chain.light_kernel)
    light = GridEcho(chain.surface, *place, noise.step_s, 1)
    steps = size * noise.steps
    rates, lit = light.samples(centres_m, first_s, steps)
    np.maximum(rates, 0.0, out=rates)
    photons, counted = chain.light_kernel.gain * lit * energy, rates.sum(axis=1) * noise.step_s
    rates *= np.divide(photons, counted, out=np.zeros_like(counted), where=counted > 0)[:, None]
    bright = np.flatnonzero(rates.max(axis=0) > 0)
    part = slice(int(bright[0]), int(bright[-1]) + 1) if bright.size else slice(0, 1)
    variance = white_step_rms_v(shot_noise_density(noise.detector, rates[:, part]), noise.step_s) ** 2
    first, taps = noise.taps
    after = noise.steps * np.arange(size) - np.arange(steps)[part, None] - first
    inside = (after >= 0) & (after < taps.size)
    return variance, np.where(inside, taps[np.where(inside, after, 0)], 0.0)


def _shot_volts(
    variance: NDArray[np.float64], taps: NDArray[np.float64], stream: np.random.Generator
) -> NDArray[np.float64]:
    volts = np.empty((variance.shape[0], taps.shape[1]))
    for begin in range(0, len(volts), _AT_ONCE):
        part = np.sqrt(variance[begin : begin + _AT_ONCE])
        volts[begin : begin + _AT_ONCE] = (part * stream.standard_normal(part.shape)) @ taps
    return volts


def _stationary(chain: Chain, count: int, size: int, stream: np.random.Generator) -> NDArray[np.float64]:
    """Noise of unit rms, shape (count, size): one long stretch, cut."""
    apart = size + _FORGOTTEN_SAMPLES
    return unit_noise(chain.scene).draw(stream, count * apart).reshape(count, apart)[:, :size]
