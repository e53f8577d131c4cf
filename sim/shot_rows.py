"""Many shots over a terrain model: from footprints to the candidates of whole windows, in compiled rows.

What `sim.chain.Chain` does for one shot with NumPy's generator, this does for rows of shots, with the keyed
generator of `sim.keyed` or with NumPy's: echoes from the posts in one compiled call, noise as a moving
average, and the receiver's own range finder on every window. A shot's numbers are found by (seed, shot,
effect), so a shot is the same alone and in any row.

What this does not model: what `sim.echo.GridEcho` leaves out, and the tilt that a wandering beam adds to the
wavefront (a slope of as many radians as it wanders).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.errors import RefusedInput
from belahil.pole_response import SampledNoise
from sim.chain_light import lasting_s
from sim.chain_noise import PoleFilter, ShotNoise, StationaryNoise
from sim.draws import Draws
from sim.echo import GridEcho
from sim.keyed import KeyedDraws, first_normals, first_uniforms, loops
from sim.light_noise import shot_noise_density, white_step_rms_v
from sim.receiver_model import small_signal_effects
from sim.reference import polyphase
from sim.relief_tiles import ReliefTiles
from sim.terrain_grid import Grid

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from sim.chain import Chain

_MOVES = 1024
"""Places in a stored window of noise at which a shot's window may begin."""

_GENERATORS = ("keyed", "numpy")

_ROW = 64
"""Shots in a compiled call."""


@dataclass(frozen=True, eq=False)
class FoundShots:
    """What the range finder found in the windows of many shots.

    Parameters
    ----------
    shots : ndarray of int64, shape (n,)
        Their numbers.
    found : ndarray of int64, shape (n,)
        Candidates of each shot; the rows below are zero beyond them.
    arrival_s : ndarray of float64, shape (n, most)
        From each shot's gate in true time, whatever the receiver's clock does, s; best first.
    fwhm_s, amplitude_v : ndarray of float64, shape (n, most)
        Full width, s; amplitude at the converter, V.
    reflectance : ndarray of float64, shape (n,)
        Weighted by the whole beam, unknown ground as black; 0: no light came back.
    saturated : ndarray of int64, shape (n,)
        Samples beyond the converter's range.
    noise : str
        Where the stationary noise came from, to be told beside any figure made of it.
    """

    shots: NDArray[np.int64]
    found: NDArray[np.int64]
    arrival_s: NDArray[np.float64]
    fwhm_s: NDArray[np.float64]
    amplitude_v: NDArray[np.float64]
    reflectance: NDArray[np.float64]
    saturated: NDArray[np.int64]
    noise: str


class ShotRows:
    """Rows of shots of a chain.

    Parameters
    ----------
    chain : Chain
        Over a terrain model, without skew between the converters, with a receiver of poles.
    pool_windows : int
        0: every shot has noise of its own. Else so many windows of stationary noise are drawn once, 68 kB
        each, and a shot takes one of them from a random place on. Shots that share a window are correlated: a
        share of false detections is then known no better than from so many independent windows.
    generator : {"keyed", "numpy"}
        Of the random numbers: `sim.keyed`, or NumPy's as `sim.draws` keys it. Without shot noise and beam
        jitter the latter gives the shots of `Chain` one by one, else shots of the same distribution.

    Raises
    ------
    RefusedInput
        A chain that needs another path: `Chain.candidates` serves every scene, a shot at a time; or a pool of
        fewer than no windows.
    """

    def __init__(
        self, chain: Chain, pool_windows: int = 0, generator: Literal["keyed", "numpy"] = "keyed"
    ) -> None:
        if generator not in _GENERATORS:
            raise RefusedInput(f"generator {generator!r}: allowed are {', '.join(_GENERATORS)}")
        if pool_windows < 0:
            raise RefusedInput(f"a pool of {pool_windows} windows: 0 (no pool) or more are allowed")
        scene, plan = chain.scene, chain.plan
        self._chain, relief = chain, _relief(chain)
        self._pool_windows, self._generator = pool_windows, generator
        self._interval_s = chain.receiver.grid.interval_s
        # The range finder counts in nominal intervals.
        self._true_interval = self._interval_s / chain.receiver.spec.sample_interval_s
        place = (scene.laser, scene.altitude_m, plan)
        self._echo = GridEcho(chain.surface, *place, chain.kernel, self._interval_s, 1)
        self._shot_noise: ShotNoise | None = None
        self._stationary: list[tuple[str, float, SampledNoise]] = []
        self._gain, mismatch = scene.gain, scene.truth.interleave
        self._factors = (1 + mismatch.gain / 2, 1 - mismatch.gain / 2)
        self._offsets_v = (mismatch.offset_v / 2, -mismatch.offset_v / 2)
        dark_v = scene.truth.noise_rms_v_by_code[_index(chain)]
        if dark_v:
            unit = SampledNoise(chain.receiver.poles, chain.receiver.zeros, self._interval_s)
            self._stationary.append(("noise", dark_v, unit))
        for noise in chain.light_noise:
            if isinstance(noise, ShotNoise):
                self._shot_noise = noise
                # Bins no longer than planned, and a whole number of them in a step of the noise.
                bin_s = noise.step_s / max(1, math.ceil(noise.step_s / plan.bin_s - 1e-9))
                finer = (scene.laser, scene.altitude_m, replace(plan, bin_s=bin_s))
                self._light = GridEcho(chain.surface, *finer, chain.light_kernel, noise.step_s, 1)
            else:
                self._stationary.append(_light_source(noise, scene.gain, self._interval_s))
        self._small = small_signal_effects(scene.truth)
        if self._small and len(self._stationary) > bool(dark_v):
            raise RefusedInput("rows of shots: sunlight before a small-signal effect needs Chain.candidates")
        self._tiles = ReliefTiles(relief)

    def candidates(self, shots: ArrayLike, centres_m: ArrayLike | None = None) -> FoundShots:
        """Find the candidates of many shots.

        Parameters
        ----------
        shots : array_like of int, shape (n,)
            Not negative: keys of their random numbers.
        centres_m : array_like of float, shape (n, 2), or None
            x and y of nadir, m; None: the origin for all.

        Returns
        -------
        FoundShots
        """
        given = np.atleast_1d(np.asarray(shots))
        if given.ndim != 1 or (given.size and (given.dtype.kind not in "iu" or given.min() < 0)):
            raise RefusedInput(
                f"shots of type {given.dtype} and shape {given.shape}: "
                "a row of whole numbers from 0 on is allowed"
            )
        numbers = given.astype(np.int64)
        places = np.zeros((numbers.size, 2))
        places += 0.0 if centres_m is None else np.asarray(centres_m, dtype=np.float64)
        if not np.isfinite(places).all():
            raise RefusedInput("centres_m of rows of shots: every number must be finite")
        most = self._chain.range_finder.candidate_count
        rows, counts = np.zeros((numbers.size, most, 3)), np.zeros(numbers.size, dtype=np.int64)
        lit, saturated = np.zeros(numbers.size), np.zeros(numbers.size, dtype=np.int64)
        for begin in range(0, numbers.size, _ROW):
            part = slice(begin, begin + _ROW)
            lit[part] = self._row(numbers[part], places[part], rows[part], counts[part], saturated[part])
        return FoundShots(
            numbers, counts, rows[..., 0], rows[..., 1], rows[..., 2], lit, saturated, self.noise
        )

    def _row(
        self,
        shots: NDArray[np.int64],
        places_m: NDArray[np.float64],
        rows: NDArray[np.float64],
        counts: NDArray[np.int64],
        saturated: NDArray[np.int64],
    ) -> NDArray[np.float64]:
        chain, laser = self._chain, self._chain.scene.laser
        first_s = self._uniforms(shots, "sampling_phase") * self._interval_s - chain.gate_s
        centres_m = places_m
        if any(laser.jitter_rad):
            wandered = self._normals(shots, "pointing", 2) * np.array(laser.jitter_rad)
            centres_m = places_m + chain.scene.altitude_m * np.tan(wandered)
        energy = np.ones(shots.size)
        if laser.energy_jitter:
            energy += laser.energy_jitter * self._normals(shots, "energy", 1)[:, 0]
        early_s, late_s = self._tiles.spread_s(centres_m, chain.plan.radius_m, chain.scene.altitude_m)
        size = chain.receiver.spec.max_sample_count
        low, high = self._between(lasting_s(chain.kernel), early_s, late_s, first_s, self._interval_s)
        width = int((high - low).max())
        volts, lit = self._echo.samples(centres_m, first_s + low * self._interval_s, width)
        volts *= energy[:, None]
        if self._shot_noise is not None:
            self._add_shot_noise(volts, low, (early_s, late_s), centres_m, first_s, energy, shots)
        pooled = self._places_in_pool(shots)
        for k in range(shots.size):
            for effect in self._small:
                effect(volts[k], Draws(chain.scene.seed, int(shots[k])))
            volts[k] *= self._gain
            begin, end = max(0, int(low[k])), min(size, int(low[k]) + width)
            inside = volts[k, begin - int(low[k]) : max(end, begin) - int(low[k])]
            window, saturated[k] = self._window(int(shots[k]), pooled[k], inside, min(begin, size), size)
            found = chain.range_finder.search(window)
            counts[k] = len(found)
            rows[k, : len(found)] = found[:, :3]
            rows[k, : len(found), 0] *= self._true_interval
            rows[k, : len(found), 0] += first_s[k]
        return lit

    def _draws(self, shot: int) -> KeyedDraws | Draws:
        seed = self._chain.scene.seed
        return KeyedDraws(seed, shot) if self._generator == "keyed" else Draws(seed, shot)

    def _uniforms(self, shots: NDArray[np.int64], effect: str) -> NDArray[np.float64]:
        if self._generator == "keyed":
            return first_uniforms(self._chain.scene.seed, shots, effect)
        return np.array([self._draws(int(shot)).uniform(effect) for shot in shots])

    def _normals(self, shots: NDArray[np.int64], effect: str, count: int) -> NDArray[np.float64]:
        if self._generator == "keyed":
            return first_normals(self._chain.scene.seed, shots, effect, count)
        return np.array([self._draws(int(shot)).normals(effect, 0, count) for shot in shots])

    def _places_in_pool(self, shots: NDArray[np.int64]) -> NDArray[np.int64]:
        """Which stored window each shot takes, and from which sample on, shape (n, 2)."""
        places = np.zeros((shots.size, 2), dtype=np.int64)
        if self._pool_windows:
            places[:, 0] = self._uniforms(shots, "pool window") * self._pool_windows
            places[:, 1] = self._uniforms(shots, "pool place") * (_MOVES + 1)
        return places

    @property
    def noise(self) -> str:
        """Where the stationary noise comes from."""
        if not self._stationary:
            return "none"
        if self._pool_windows:
            return f"pool of {self._pool_windows} windows, shared by the shots"
        return "independent for each shot"

    @cached_property
    def _pool(self) -> list[NDArray[np.float32]]:
        size = self._chain.receiver.spec.max_sample_count + _MOVES
        return [self._drawn(number, size, "pool ") for number in range(self._pool_windows)]

    def _drawn(self, shot: int, size: int, prefix: str = "") -> NDArray[np.float32]:
        """Stationary noise at the converter."""
        draws, noise = self._draws(shot), None
        for effect, rms_v, unit in self._stationary:
            drawn = draws.coloured(prefix + effect, unit, size)
            drawn *= np.float32(rms_v)
            noise = drawn if noise is None else noise + drawn
        return np.zeros(size, dtype=np.float32) if noise is None else noise

    def _window(
        self, shot: int, place: NDArray[np.int64], echo_v: NDArray[np.float64], begin: int, size: int
    ) -> tuple[NDArray[np.float64], int]:
        """Digitized volts of a whole window."""
        if self._pool_windows and self._stationary:
            noise = self._pool[place[0]][place[1] :][:size]
        else:
            noise = self._drawn(shot, size)
        quantizer = self._chain.receiver.quantizer
        return loops().digitized(
            noise,
            echo_v,
            begin,
            self._factors,
            self._offsets_v,
            quantizer.volts_per_count,
            quantizer.bits,
        )

    def _add_shot_noise(
        self,
        volts: NDArray[np.float64],
        low: NDArray[np.int64],
        spread_s: tuple[NDArray[np.float64], NDArray[np.float64]],
        centres_m: NDArray[np.float64],
        first_s: NDArray[np.float64],
        energy: NDArray[np.float64],
        shots: NDArray[np.int64],
    ) -> None:
        """Add it to rows of input-referred volts that begin at sample `low`."""
        noise = self._shot_noise
        assert noise is not None
        begin, end = self._between(lasting_s(self._chain.light_kernel), *spread_s, first_s, noise.step_s)
        width = int((end - begin).max())
        rates, lit = self._light.samples(centres_m, first_s + begin * noise.step_s, width)
        np.maximum(rates, 0.0, out=rates)
        photons, counted = self._chain.light_kernel.gain * lit * energy, rates.sum(axis=1) * noise.step_s
        rates *= np.divide(photons, counted, out=np.zeros_like(counted), where=counted > 0)[:, None]
        rms_v = white_step_rms_v(shot_noise_density(noise.detector, rates), noise.step_s)
        first, taps = noise.taps
        for k in range(shots.size):
            draws = self._draws(int(shots[k]))
            # With keyed numbers found by the step in the window: a longer row draws the same.
            white = rms_v[k] * draws.normals("shot_noise", int(begin[k]), width)
            offset = int(low[k]) * noise.steps - int(begin[k]) - first
            volts[k] += polyphase(white, taps, offset, noise.steps, volts.shape[1])

    def _between(
        self,
        response_s: tuple[float, float],
        early_s: NDArray[np.float64],
        late_s: NDArray[np.float64],
        first_s: NDArray[np.float64],
        step_s: float,
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Steps from a window's first sample between which the response to some light lies."""
        low = np.floor((early_s + response_s[0] - first_s) / step_s).astype(np.int64)
        high = np.ceil((late_s + response_s[1] - first_s) / step_s).astype(np.int64) + 1
        return low, high


def _relief(chain: Chain) -> Grid:
    scene = chain.scene
    for wanted, why in (
        (isinstance(chain.surface.relief, Grid), "ground that is no terrain model"),
        (isinstance(chain.passed, PoleFilter), "a Gaussian filter"),
        (not scene.truth.interleave.skew_s, "skew between the converters"),
        (not scene.noise.dark_windows, "recorded dark noise"),
        (not any(scene.laser.pointing_rad), "a beam off nadir"),
        (not chain.has_factor, "light that a field of view or a law of scattering weighs"),
    ):
        if not wanted:
            raise RefusedInput(f"rows of shots: {why} needs Chain.candidates")
    assert isinstance(chain.surface.relief, Grid)
    return chain.surface.relief


def _index(chain: Chain) -> int:
    codes = chain.receiver.spec.gain_codes
    return codes.index(chain.scene.gain_code) if codes else 0


def _light_source(noise: StationaryNoise, gain: float, interval_s: float) -> tuple[str, float, SampledNoise]:
    return noise.effect, gain * noise.rms_v, noise.passed.noise(interval_s)  # type: ignore[return-value]
