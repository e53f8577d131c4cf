"""A library of return pulses from flat slopes, and the search for the one that is most like some samples.

The pulse that correlates best, scaled in amplitude and moved in time, is the one that leaves the least sum of
squares. What it leaves, the mean squared residual (MSR), is what a plane cannot explain (Nishiyama et al.,
section "Alternative roughness constraints using pulse shape data").

What this does not model: the pointing of the laser, which on a plane moves a pulse and does not change it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from msgspec import structs

from belahil.errors import RefusedInput
from belahil.pulse_fit import gaussian_fit
from sim.chain import Chain
from sim.scene import Scene
from sim.scene_tables import Noise, SurfaceTable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

SLOPES_DEG = tuple(float(one) for one in range(41))
AZIMUTHS_DEG = tuple(float(one) for one in range(0, 360, 30))
"""Steps of 1 and 30 degrees (paper)."""

STEPS = 32
"""Places of a pulse in a sample interval; cubic interpolation between them is exact to 3e-6 of the peak."""
_COARSE = 4
"""Shifts in a sample interval that are tried first."""
_KEPT = 12
"""Pulses that are refined."""
_ROUNDS = 4
_REACH = 1.5
"""Samples by which a pulse may be moved from where both fitted Gaussians agree: what noise does to a fit."""
_BEFORE_S, _AFTER_S = 500e-9, 700e-9
_ALIKE = 1e-6
_ROW = 128


@dataclass(frozen=True, eq=False)
class PulseLibrary:
    """Return pulses of planes.

    Parameters
    ----------
    slope_deg, azimuth_deg : ndarray of float64, shape (n,)
        Of each pulse. Of those that do not differ at all (a beam that is round) the first stands for all.
    interval_s : float
        Between the receiver's samples, s.
    volts : ndarray of float64, shape (n, m)
        At the converter, `STEPS` places in an interval, V.
    first_s : ndarray of float64, shape (n,)
        Of the first place, from the arrival of the pulse's fitted Gaussian, s.
    fwhm_s : ndarray of float64, shape (n,)
        Of that Gaussian, s.
    """

    slope_deg: NDArray[np.float64]
    azimuth_deg: NDArray[np.float64]
    interval_s: float
    volts: NDArray[np.float64]
    first_s: NDArray[np.float64]
    fwhm_s: NDArray[np.float64]

    @property
    def delay_s(self) -> NDArray[np.float64]:
        """How much later the fitted Gaussian comes than light from the middle of the plane, s, shape (n,)."""
        return -_BEFORE_S - self.first_s

    @property
    def step_s(self) -> float:
        """Between places, s."""
        return self.interval_s / STEPS

    @cached_property
    def slopes(self) -> NDArray[np.float64]:
        """Derivative of the pulses by time, V/s, shape (n, m)."""
        return np.gradient(self.volts, self.step_s, axis=1, edge_order=2)

    def at(self, pulse: NDArray[np.int64], times_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """Return pulses and their derivatives at times from their arrival.

        Parameters
        ----------
        pulse : ndarray of int64, shape (k,)
            Numbers of pulses.
        times_s : ndarray of float64, shape (k, samples)
            Zero is returned beyond what is stored.

        Returns
        -------
        volts, slopes : ndarray of float64, shape (k, samples)
            V and V/s.
        """
        place = (times_s - self.first_s[pulse, None]) / self.step_s
        inside = (place >= 0) & (place < self.volts.shape[1] - 1)
        left = np.where(inside, place, 0.0).astype(np.int64)
        u = np.where(inside, place - left, 0.0)
        row = pulse[:, None]
        begin, end = self.volts[row, left], self.volts[row, left + 1]
        rise, fall = self.slopes[row, left] * self.step_s, self.slopes[row, left + 1] * self.step_s
        # Hermite's cubic.
        a, b = 2 * (begin - end) + rise + fall, 3 * (end - begin) - 2 * rise - fall
        volts = begin + u * (rise + u * (b + u * a))
        slopes = (rise + u * (2 * b + u * 3 * a)) / self.step_s
        return np.where(inside, volts, 0.0), np.where(inside, slopes, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """The best pulse of a library for each row of samples, arrays of shape (n,).

    Parameters
    ----------
    pulse : ndarray of int64
        Its number.
    factor : ndarray of float64
        Its amplitude, as a factor of the library's.
    shift_s : ndarray of float64
        How much later it comes than the fitted Gaussians say, s.
    msr_v2 : ndarray of float64
        Mean squared residual, V^2; that of the samples themselves where no pulse correlates with them.
    """

    pulse: NDArray[np.int64]
    factor: NDArray[np.float64]
    shift_s: NDArray[np.float64]
    msr_v2: NDArray[np.float64]


def pulse_library(
    scene: Scene, slopes_deg: Sequence[float] = SLOPES_DEG, azimuths_deg: Sequence[float] = AZIMUTHS_DEG
) -> PulseLibrary:
    """Compute a library, without noise.

    Parameters
    ----------
    scene : Scene
        Altitude, laser, detector, receiver, and the reflectance of its ground.
    slopes_deg, azimuths_deg : sequence of float
        Of the planes; each with each.
    """
    bare = structs.replace(
        scene, laser=structs.replace(scene.laser, pointing_rad=(0.0, 0.0)), noise=Noise(), sun=None
    )
    found: list[tuple[float, float, NDArray[np.float64], float, float]] = []
    for slope_deg in slopes_deg:
        same: list[NDArray[np.float64]] = []
        for azimuth_deg in azimuths_deg:
            chain = plane_chain(bare, slope_deg, azimuth_deg)
            interval_s = chain.receiver.grid.interval_s
            count = round((_BEFORE_S + _AFTER_S) / interval_s) * STEPS
            volts = chain.curve(None, -_BEFORE_S, interval_s / STEPS, count)
            if any(np.abs(volts - other).max() < _ALIKE * np.abs(volts).max() for other in same):
                continue
            same.append(volts)
            arrival_s, fwhm_s, _ = mean_fit(volts, STEPS, scene.correlation_window_samples, interval_s)
            found.append((slope_deg, azimuth_deg, volts, -arrival_s, fwhm_s))
    columns = [np.array(column) for column in zip(*found, strict=True)]
    slope, azimuth, rows, first_s, width_s = columns
    return PulseLibrary(slope, azimuth, interval_s, rows, first_s, width_s)


def plane_chain(scene: Scene, slope_deg: float, azimuth_deg: float) -> Chain:
    """Return the chain of a scene over a plane in place of its ground."""
    ground = SurfaceTable(
        kind="plane",
        slope_deg=slope_deg,
        azimuth_deg=azimuth_deg,
        reflectance=scene.surface.reflectance,
        photometry=scene.surface.photometry,
        radiation_factor=scene.surface.radiation_factor,
    )
    return Chain(structs.replace(scene, surface=ground))


def mean_fit(
    curve: NDArray[np.float64], steps: int, window: int, interval_s: float
) -> tuple[float, float, float]:
    """Return arrival (s from the first point), width (s) and amplitude (V) of the Gaussian of a curve.

    Means over sampling phases.

    Parameters
    ----------
    curve : ndarray of float64, shape (n,)
        V, `steps` points in a sample interval.
    steps : int
        As said; so many phases are tried.
    window : int
        Samples round the peak that are fitted.
    interval_s : float
        Between samples, s.

    Raises
    ------
    RefusedInput
        The curve ends too near to its peak.
    """
    found = np.empty((steps, 3))
    middle = int(np.argmax(curve))
    begin = middle - (window // 2) * steps
    if begin < 0 or begin + window * steps > curve.size:
        place_ns, whole_ns = (1e9 * one * interval_s / steps for one in (middle, curve.size))
        raise RefusedInput(
            f"a pulse with its peak {place_ns:.0f} ns after the beginning of the {whole_ns:.0f} ns that are "
            f"computed has no {window} samples round it there; a gentler slope, a lower altitude or a beam "
            "nearer to nadir is needed"
        )
    for phase in range(steps):
        first = begin + phase
        fit = gaussian_fit(curve[first : first + window * steps : steps], interval_s)
        assert fit.pulse is not None  # a pulse with its peak in the middle has one
        pulse = fit.pulse
        found[phase] = first * interval_s / steps + pulse.arrival_s, pulse.fwhm_s, pulse.amplitude_v
    arrival_s, fwhm_s, amplitude_v = found.mean(axis=0).tolist()
    return arrival_s, fwhm_s, amplitude_v


def best_matches(
    library: PulseLibrary, samples_v: NDArray[np.float64], arrival_s: NDArray[np.float64]
) -> Matches:
    """Find the pulse that leaves the least squares in each row of samples.

    Parameters
    ----------
    library : PulseLibrary
        Pulses.
    samples_v : ndarray of float64, shape (n, samples)
        Correlation windows, V.
    arrival_s : ndarray of float64, shape (n,)
        Of their fitted Gaussians, from the first sample, s.

    Notes
    -----
    First all pulses at shifts of a quarter of a sample, each moved further to first order; then the twelve
    best of them, exactly. Amplitudes are positive.
    """
    parts = [
        _matched(library, samples_v[at : at + _ROW], arrival_s[at : at + _ROW])
        for at in range(0, len(samples_v), _ROW)
    ]
    return Matches(*(np.concatenate([getattr(one, name) for one in parts]) for name in Matches.__slots__))


def timed_matches(
    library: PulseLibrary, samples_v: NDArray[np.float64], zero_s: NDArray[np.float64]
) -> Matches:
    """Find the pulse that leaves the least squares where it is known when it comes; it is scaled, not moved.

    Parameters
    ----------
    library : PulseLibrary
        Pulses.
    samples_v : ndarray of float64, shape (n, samples)
        Correlation windows, V.
    zero_s : ndarray of float64, shape (n,)
        When light of zero length from the middle of the footprint would come without a filter, s from the
        first sample.

    Returns
    -------
    Matches
        All shifts are 0.
    """
    rows = len(samples_v)
    times_s = library.interval_s * np.arange(samples_v.shape[1]) - zero_s[:, None]
    pulse, factor, least = np.zeros(rows, np.int64), np.zeros(rows), np.full(rows, np.inf)
    for number, delay_s in enumerate(library.delay_s):
        volts, _ = library.at(np.full(rows, number), times_s - delay_s)
        norm = (volts**2).sum(axis=1)
        scale = np.maximum((samples_v * volts).sum(axis=1), 0.0) / np.where(norm > 0, norm, 1.0)
        left = ((samples_v - scale[:, None] * volts) ** 2).mean(axis=1)
        better = left < least
        pulse[better], factor[better], least[better] = number, scale[better], left[better]
    return Matches(pulse, factor, np.zeros(rows), least)


def _matched(
    library: PulseLibrary, samples_v: NDArray[np.float64], arrival_s: NDArray[np.float64]
) -> Matches:
    pulses, shift_s = _first_choice(library, samples_v, arrival_s)
    rows, kept = pulses.shape
    flat = np.repeat(np.arange(rows), kept)
    number, moved_s = pulses.ravel(), shift_s.ravel()
    times_s = library.interval_s * np.arange(samples_v.shape[1]) - arrival_s[flat, None]
    wanted = samples_v[flat]
    for turn in range(_ROUNDS + 1):
        volts, slopes = library.at(number, times_s - moved_s[:, None])
        products = _products(wanted, volts, slopes)
        if turn < _ROUNDS:
            step_s = _step(*products, limit_s=library.interval_s / _COARSE)
            limit_s = _REACH * library.interval_s
            moved_s = np.clip(moved_s + step_s, -limit_s, limit_s)
    along, _, norm, _, _ = products
    factor = np.maximum(along, 0.0) / np.where(norm > 0, norm, 1.0)
    left = ((wanted - factor[:, None] * volts) ** 2).mean(axis=1).reshape(rows, kept)
    best = np.argmin(left, axis=1)
    place = np.arange(rows) * kept + best
    return Matches(number[place], factor[place], moved_s[place], left[np.arange(rows), best])


def _first_choice(
    library: PulseLibrary, samples_v: NDArray[np.float64], arrival_s: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The best few pulses of each row, and their shifts, s; shapes (n, kept)."""
    count, size = len(library.volts), samples_v.shape[1]
    step_s = library.interval_s / _COARSE
    low, high = arrival_s.min() - _REACH * library.interval_s, arrival_s.max() + _REACH * library.interval_s
    places_s = np.arange(np.floor(low / step_s), np.ceil(high / step_s) + 1) * step_s
    number = np.repeat(np.arange(count), places_s.size)
    times_s = library.interval_s * np.arange(size) - np.tile(places_s, count)[:, None]
    volts, slopes = library.at(number, times_s)
    along, across = samples_v @ volts.T, -samples_v @ slopes.T
    norm, mixed, bend = ((a * b).sum(axis=1) for a, b in ((volts, volts), (volts, -slopes), (slopes, slopes)))
    moved_s = _step(along, across, norm, mixed, bend, limit_s=step_s / 2)
    gained = np.maximum(along + moved_s * across, 0.0) ** 2
    gained /= np.maximum(norm + moved_s * (2 * mixed + moved_s * bend), np.finfo(float).tiny)
    by_pulse = gained.reshape(len(samples_v), count, places_s.size)
    at = np.argmax(by_pulse, axis=2)
    scores = np.take_along_axis(by_pulse, at[..., None], axis=2)[..., 0]
    kept = np.argsort(-scores, axis=1, kind="stable")[:, :_KEPT]
    chosen = np.take_along_axis(at, kept, axis=1)
    first_s = np.take_along_axis(moved_s, kept * places_s.size + chosen, axis=1)
    return kept, places_s[chosen] + first_s - arrival_s[:, None]


def _products(
    wanted: NDArray[np.float64], volts: NDArray[np.float64], slopes: NDArray[np.float64]
) -> tuple[NDArray[np.float64], ...]:
    """Products of samples, pulse, and what a later arrival changes of it, the negative of its slope."""
    pairs = ((wanted, volts), (wanted, -slopes), (volts, volts), (volts, -slopes), (slopes, slopes))
    return tuple((a * b).sum(axis=1) for a, b in pairs)


def _step(
    along: NDArray[np.float64],
    across: NDArray[np.float64],
    norm: NDArray[np.float64],
    mixed: NDArray[np.float64],
    bend: NDArray[np.float64],
    *,
    limit_s: float,
) -> NDArray[np.float64]:
    """How much later a pulse fits best, to first order, s.

    Where ``(along + d across)^2 / (norm + 2 d mixed + d^2 bend)`` is largest.
    """
    above, below = across * norm - along * mixed, along * bend - across * mixed
    return np.clip(above / np.where(np.abs(below) > 0, below, np.inf), -limit_s, limit_s)
