"""Noise of rows of shots: stationary noise of each shot or from a pool, and the shot noise of the echoes."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.pole_response import SampledNoise
from sim.chain_noise import ShotNoise, StationaryNoise
from sim.draws import Draws
from sim.echo import GridEcho
from sim.keyed import KeyedDraws, first_normals, first_uniforms
from sim.light_noise import shot_noise_density, white_step_rms_v
from sim.optical_echo import lasting_s
from sim.reference import polyphase

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim.chain import Chain

_MOVES = 1024
"""Places in a stored window of noise at which a shot's window may begin."""


class RowNoise:
    """The random numbers and the noise of rows of shots.

    Parameters
    ----------
    chain, pool_windows, generator
        As in `sim.shot_rows.ShotRows`.
    """

    def __init__(self, chain: Chain, pool_windows: int, generator: Literal["keyed", "numpy"]) -> None:
        scene, plan = chain.scene, chain.plan
        self._chain, self._seed = chain, scene.seed
        self._pool_windows, self._generator = pool_windows, generator
        self._interval_s = chain.receiver.grid.interval_s
        self.shot_noise: ShotNoise | None = None
        self._stationary: list[tuple[str, float, SampledNoise]] = []
        dark_v = scene.truth.noise_rms_v_by_code[_index(chain)]
        if dark_v:
            unit = SampledNoise(chain.receiver.poles, chain.receiver.zeros, self._interval_s)
            self._stationary.append(("noise", dark_v, unit))
        for noise in chain.light_noise:
            if isinstance(noise, ShotNoise):
                self.shot_noise = noise
                # Bins no longer than planned, and a whole number of them in a step of the noise.
                bin_s = noise.step_s / max(1, math.ceil(noise.step_s / plan.bin_s - 1e-9))
                finer = (scene.laser, scene.altitude_m, replace(plan, bin_s=bin_s))
                self.light = GridEcho(chain.surface, *finer, chain.light_kernel, noise.step_s, 1)
            else:
                self._stationary.append(_light_source(noise, scene.gain, self._interval_s))
        self.has_light = len(self._stationary) > bool(dark_v)

    def _draws(self, shot: int) -> KeyedDraws | Draws:
        return KeyedDraws(self._seed, shot) if self._generator == "keyed" else Draws(self._seed, shot)

    def uniforms(self, shots: NDArray[np.int64], effect: str) -> NDArray[np.float64]:
        """Return one number from 0 to 1 of an effect for each shot, shape (n,)."""
        if self._generator == "keyed":
            return first_uniforms(self._seed, shots, effect)
        return np.array([self._draws(int(shot)).uniform(effect) for shot in shots])

    def normals(self, shots: NDArray[np.int64], effect: str, count: int) -> NDArray[np.float64]:
        """Return standard normal numbers of an effect for each shot, shape (n, count)."""
        if self._generator == "keyed":
            return first_normals(self._seed, shots, effect, count)
        return np.array([self._draws(int(shot)).normals(effect, 0, count) for shot in shots])

    def places_in_pool(self, shots: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return which stored window each shot takes, and from which sample on, shape (n, 2)."""
        places = np.zeros((shots.size, 2), dtype=np.int64)
        if self._pool_windows:
            places[:, 0] = self.uniforms(shots, "pool window") * self._pool_windows
            places[:, 1] = self.uniforms(shots, "pool place") * (_MOVES + 1)
        return places

    @property
    def source(self) -> str:
        """Where the stationary noise comes from."""
        if not self._stationary:
            return "none"
        if self._pool_windows:
            return f"pool of {self._pool_windows} windows, shared by the shots"
        return "independent for each shot"

    def stationary(self, shot: int, place: NDArray[np.int64], size: int) -> NDArray[np.float32]:
        """Return the stationary noise of a shot's window, V at the converter, shape (size,).

        Parameters
        ----------
        shot : int
            Its number.
        place : ndarray of int64, shape (2,)
            From `places_in_pool`.
        size : int
            Samples.
        """
        if self._pool_windows and self._stationary:
            window, first = (int(number) for number in place)
            return self._pool[window][first : first + size]
        return self._drawn(shot, size)

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

    def add_shot_noise(
        self,
        volts: NDArray[np.float64],
        low: NDArray[np.int64],
        spread_s: tuple[NDArray[np.float64], NDArray[np.float64]],
        centres_m: NDArray[np.float64],
        first_s: NDArray[np.float64],
        energy: NDArray[np.float64],
        shots: NDArray[np.int64],
    ) -> None:
        """Add it to rows of input-referred volts.

        Parameters
        ----------
        volts : ndarray of float64, shape (n, width)
            One row a shot.
        low : ndarray of int64, shape (n,)
            Sample of the window with which each begins.
        spread_s : tuple of ndarray of float64, shape (n,)
            From `sim.relief_tiles.ReliefTiles.spread_s`.
        centres_m : ndarray of float64, shape (n, 2)
            Of the footprints.
        first_s : ndarray of float64, shape (n,)
            First sample of each window from the gate, s.
        energy : ndarray of float64, shape (n,)
            Of each pulse, relative.
        shots : ndarray of int64, shape (n,)
            Their numbers.
        """
        noise = self.shot_noise
        assert noise is not None
        begin, end = steps_between(lasting_s(self._chain.light_kernel), *spread_s, first_s, noise.step_s)
        width = int((end - begin).max())
        rates, lit = self.light.samples(centres_m, first_s + begin * noise.step_s, width)
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


def steps_between(
    response_s: tuple[float, float],
    early_s: NDArray[np.float64],
    late_s: NDArray[np.float64],
    first_s: NDArray[np.float64],
    step_s: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the steps from a window's first sample between which the response to some light lies."""
    low = np.floor((early_s + response_s[0] - first_s) / step_s).astype(np.int64)
    high = np.ceil((late_s + response_s[1] - first_s) / step_s).astype(np.int64) + 1
    return low, high


def _index(chain: Chain) -> int:
    codes = chain.receiver.spec.gain_codes
    return codes.index(chain.scene.gain_code) if codes else 0


def _light_source(noise: StationaryNoise, gain: float, interval_s: float) -> tuple[str, float, SampledNoise]:
    return noise.effect, gain * noise.rms_v, noise.passed.noise(interval_s)  # type: ignore[return-value]
