"""The colour of the stationary noise of a scene: that of its receiver's own low-pass.

What this does not model: sunlight behind an extra pole of the amplifier, whose rms is right but whose colour
is that of the receiver alone. With the Gaussian filter of earlier models all noise has its colour.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from belahil import butterworth
from belahil.pole_response import SampledNoise, autocovariance
from sim.chain_noise import GaussianFilter, PoleFilter
from sim.detector import gaussian_filter_sigma_s, tia_poles
from sim.draws import Draws
from sim.keyed import KeyedDraws

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim.chain_noise import UnitNoise
    from sim.scene import Scene


def interval_s(scene: Scene) -> float:
    """Return the true time between samples, s."""
    nominal_s = scene.receiver_spec.digitizer.sample_interval_s
    return float(nominal_s / (1 + 1e-6 * scene.truth.clock_ppm))


def own_poles(scene: Scene) -> tuple[tuple[complex, ...], int]:
    """Return poles (rad/s) and zeros of the receiver."""
    truth = scene.truth
    poles = butterworth.poles(truth.cutoff_hz, truth.order, truth.highpass_hz)
    return poles, int(truth.highpass_hz > 0)


def light_filter(scene: Scene) -> PoleFilter | GaussianFilter:
    """Return what light passes from the photodiode to the converter."""
    if scene.filter == "gaussian":
        return GaussianFilter(gaussian_filter_sigma_s(scene.detector.tia_bandwidth_hz))
    poles, zeros = own_poles(scene)
    return PoleFilter((*tia_poles(scene.detector), *poles), zeros)


def unit_noise(scene: Scene) -> UnitNoise:
    """Return a generator of noise of unit rms."""
    if scene.filter == "gaussian":
        return light_filter(scene).noise(interval_s(scene))
    return _sampled(*own_poles(scene), interval_s(scene))


@lru_cache(maxsize=4)
def _sampled(poles: tuple[complex, ...], zeros: int, every_s: float) -> SampledNoise:
    return SampledNoise(poles, zeros, every_s)


def window_noise(unit: UnitNoise, seed: int, number: int, size: int) -> NDArray[np.float64]:
    """Return a window of noise of unit rms by its number, shape (size,)."""
    if isinstance(unit, SampledNoise):
        return KeyedDraws(seed, number).coloured("noise", unit, size).astype(np.float64)
    return unit.draw(Draws(seed, number).stream("noise"), size)


def autocorrelation(scene: Scene, count: int) -> NDArray[np.float64]:
    """Return the autocorrelation of the noise at whole samples, 1 at lag 0, shape (count,)."""
    lags_s = interval_s(scene) * np.arange(count)
    if scene.filter == "gaussian":
        sigma_s = gaussian_filter_sigma_s(scene.detector.tia_bandwidth_hz)
        with np.errstate(under="ignore"):
            return np.asarray(np.exp(-0.25 * (lags_s / sigma_s) ** 2))
    poles, zeros = own_poles(scene)
    row = autocovariance(poles, lags_s, zeros)
    return np.asarray(row / row[0])
