"""Shot noise of an echo behind the receiver: how well its rms follows Campbell's theorem at every sample.

Nothing here depends on chance: the variance of independent draws behind a filter can be summed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from belahil.butterworth import noise_bandwidth
from belahil.pole_modes import modes, ordered_poles
from belahil.receiver import BELA_GRM
from procedures.accuracy_footprint import INTERVAL_S, SAMPLES, SIGMA_M, kernel
from procedures.accuracy_rows import Measured, Setting
from sim.detector import Detector
from sim.light_noise import shot_noise_density, white_step_rms_v
from sim.reference import polyphase

if TYPE_CHECKING:
    from numpy.typing import NDArray

UNIT = "of the largest rms"
ASKED = 1e-2
STEPS = (1, 2, 4, 8, 16)
"""Draws in a sample interval."""

_CASE = "shot noise"
_REFERENCE = "Campbell's theorem by quadrature, echo of a slope of 10 deg; worst of 42 samples and of phases"
_PHOTONS = 1300.0
_SLOPE = math.tan(math.radians(10.0))
_BEFORE_S = 60e-9
_RESPONSE_S = 300e-9
_PHASES = 5
_NODES = 400
_DETECTOR = Detector()


def shot_noise_settings() -> Iterator[Setting]:
    """List what is measured."""
    for steps in STEPS:
        text = f"{steps} a sample"
        yield _setting("drawn before the filter", text, partial(_drawn, steps))
    yield _setting("from the filtered echo", "at the samples", _from_filtered)


def _setting(method: str, setting: str, measure: Callable[[], Measured]) -> Setting:
    return Setting("noise", _CASE, method, setting, _REFERENCE, UNIT, measure, ASKED)


def _echo_rate_hz(times_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Photon rate on the photodiode, from a plane; the Gaussian of its delays is about 0."""
    spread_s = 2 / 299792458.0 * SIGMA_M * _SLOPE
    return _PHOTONS * replace(kernel(1e-4), poles=()).widened(spread_s).exact(times_s)


def _impulse(since_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Response of the receiver to an impulse, 1/s."""
    total = np.zeros(since_s.shape)
    after = np.maximum(since_s, 0.0)
    for pole, weight in modes(ordered_poles(kernel(1e-4).poles, 0), 0):
        total += (weight * np.exp(pole * after)).real
    return np.where(since_s >= 0, total, 0.0)


def _sampled(phase: float) -> NDArray[np.float64]:
    return INTERVAL_S * (phase + np.arange(SAMPLES, dtype=np.float64)) - _BEFORE_S


def true_rms_v(times_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the root of the integral of S(t) h(t_i - t)^2 / 2, S the one-sided density in V^2/Hz."""
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    begin_s = np.maximum(-_BEFORE_S, times_s - _RESPONSE_S)
    half_s = np.maximum(times_s - begin_s, 0.0) / 2
    at_s = begin_s[:, None] + half_s[:, None] * (1 + nodes)
    density = shot_noise_density(_DETECTOR, _echo_rate_hz(at_s))
    variance = half_s * ((density**2 / 2 * _impulse(times_s[:, None] - at_s) ** 2) @ weights)
    return np.asarray(np.sqrt(variance))


def _worst(rms_v: Callable[[float], NDArray[np.float64]]) -> float:
    worst = 0.0
    for phase in (np.arange(_PHASES) + 1 / math.e) / _PHASES:
        true = true_rms_v(_sampled(phase))
        worst = max(worst, float(np.abs(rms_v(phase) - true).max() / true.max()))
    return worst


def _drawn(steps: int) -> Measured:
    """Independent draws in the middle of steps, each with the density of its time."""
    step_s = INTERVAL_S / steps
    count = steps * SAMPLES
    taps = step_s * _impulse(step_s * (np.arange(math.ceil(_RESPONSE_S / step_s), dtype=np.float64) + 0.5))

    def step_rms_v(phase: float) -> NDArray[np.float64]:
        middle_s = _sampled(phase)[0] + step_s * (np.arange(count) + 0.5)
        return white_step_rms_v(shot_noise_density(_DETECTOR, _echo_rate_hz(middle_s)), step_s)

    def rms_v(phase: float) -> NDArray[np.float64]:
        return np.asarray(np.sqrt(polyphase(step_rms_v(phase) ** 2, taps**2, -1, steps, SAMPLES)))

    rng, scale = np.random.Generator(np.random.SFC64(1)), step_rms_v(0.3)
    return Measured(
        _worst(rms_v),
        lambda: polyphase(scale * rng.standard_normal(count), taps, -1, steps, SAMPLES),
        work={"draws": count},
    )


def _from_filtered() -> Measured:
    """Noise in proportion to the root of the filtered echo: the light as it is seen, not as it came."""
    bandwidth_hz = noise_bandwidth(BELA_GRM.cutoff_hz, BELA_GRM.order)
    spread_s = 2 / 299792458.0 * SIGMA_M * _SLOPE
    seen = kernel(1e-4).widened(spread_s)

    def rms_v(phase: float) -> NDArray[np.float64]:
        rate_hz = np.maximum(_PHOTONS * seen.exact(_sampled(phase)), 0.0)
        return np.asarray(shot_noise_density(_DETECTOR, rate_hz) * math.sqrt(bandwidth_hz))

    rng, scale = np.random.Generator(np.random.SFC64(1)), rms_v(0.3)
    return Measured(_worst(rms_v), lambda: scale * rng.standard_normal(SAMPLES))
