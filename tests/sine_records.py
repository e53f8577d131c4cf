"""Records of sines as two interleaved converters take them, written down directly from their definition."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from belahil import butterworth
from belahil.pole_response import SampledNoise

RATE_HZ = 80e6
COUNT = 16064
CODE_V = 2.0 / 4096


@dataclass(frozen=True)
class Truth:
    """What a record is made of; even samples get the first half of each mismatch."""

    frequency_hz: float
    amplitude_v: float
    phase_rad: float = 0.3
    offset_v: float = 0.0
    gain_mismatch: float = 0.0
    skew_s: float = 0.0
    offset_difference_v: float = 0.0
    clock_ppm: float = 0.0
    count: int = COUNT

    def but(self, **changes: float) -> Truth:
        return replace(self, **changes)


def record(truth: Truth, noise_v: np.ndarray | float = 0.0, code_v: float = 0.0) -> np.ndarray:
    number = np.arange(truth.count)
    sign = np.where(number % 2, -1.0, 1.0)
    time = number / (RATE_HZ * (1 + truth.clock_ppm * 1e-6)) + sign * truth.skew_s / 2
    # Whole turns are dropped before the sine, as its argument would lose digits.
    turns = truth.frequency_hz * time
    volts = truth.amplitude_v * np.cos(2 * np.pi * (turns - np.rint(turns)) + truth.phase_rad) + noise_v
    volts = (
        volts * (1 + sign * truth.gain_mismatch / 2) + truth.offset_v + sign * truth.offset_difference_v / 2
    )
    return np.rint(volts / code_v) * code_v if code_v else volts


def filtered_noise(cutoff_hz: float = 19e6, order: int = 3, highpass_hz: float = 0.0) -> SampledNoise:
    """White noise behind the receiver's filter, unit rms."""
    poles = butterworth.poles(cutoff_hz, order, highpass_hz)
    return SampledNoise(poles, int(highpass_hz > 0), 1 / RATE_HZ)


def folded_density(
    frequency_hz: float | np.ndarray,
    rms_v: float,
    cutoff_hz: float = 19e6,
    order: int = 3,
    code_v: float = 0.0,
) -> np.ndarray:
    """One-sided density of sampled, filtered noise and of rounding (white), V^2/Hz."""
    folds = np.arange(-40, 41)[:, None] * RATE_HZ
    power = np.sum(
        butterworth.magnitude(np.abs(np.atleast_1d(frequency_hz) + folds), cutoff_hz, order) ** 2, axis=0
    )
    white = code_v**2 / 12 / (RATE_HZ / 2)
    return rms_v**2 / butterworth.noise_bandwidth(cutoff_hz, order) * power + white
