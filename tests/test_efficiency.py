"""Gain and cut-off scatter no more than the coloured noise demands: the Cramer-Rao bound."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hidden_receivers import found

from belahil.butterworth import magnitude, noise_bandwidth
from belahil.config import EmulatedReceiver, EmulationTable, simulated
from procedures.characterize import GainOptions

GAIN, CUTOFF_HZ, ORDER, NOISE_V = 5.19, 19e6, 3, 2e-3
SAMPLES, RATE_HZ, STEP_V = 16064, 80e6, 2.0 / 4096
SHIFT = 100_000


def _bound(frequency_hz: np.ndarray, amplitude_vpp: float) -> tuple[float, float]:
    """Return the least possible standard deviations of gain and cut-off, order known, no high-pass.

    A sine of known frequency in noise of one-sided density S has var(A) = S fs / N; the density is that of
    white noise through the filter, folded at the sample rate, plus that of rounding.
    """
    folded = sum(
        magnitude(np.abs(frequency_hz + fold * RATE_HZ), CUTOFF_HZ, ORDER) ** 2 for fold in range(-4, 5)
    )
    density = NOISE_V**2 * folded / noise_bandwidth(CUTOFF_HZ, ORDER) + STEP_V**2 / 12 / (RATE_HZ / 2)
    gain_u = np.sqrt(density * RATE_HZ / SAMPLES) / (amplitude_vpp / 2)
    shape = magnitude(frequency_hz, CUTOFF_HZ, ORDER)
    step = 1e3
    by_cutoff = GAIN * (
        (magnitude(frequency_hz, CUTOFF_HZ + step, ORDER) - magnitude(frequency_hz, CUTOFF_HZ - step, ORDER))
        / (2 * step)
    )
    jacobian = np.stack([shape, by_cutoff]) / gain_u
    gain, cutoff = np.sqrt(np.diag(np.linalg.inv(jacobian @ jacobian.T)))
    return float(gain), float(cutoff)


def _trials(amplitude_vpp: float, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    receiver = EmulatedReceiver(noise_rms_v_by_code=(NOISE_V,) * 16)
    gains, cutoffs = [], []
    for trial in range(count):
        config = msgspec.structs.replace(
            simulated(), emulation=EmulationTable(seed=SHIFT + trial, receiver=receiver)
        )
        outcome = found(config, GainOptions(codes=(4,), amplitudes_vpp=(amplitude_vpp,), dark_windows=1))
        (one,) = outcome.results["gain_codes"]
        gains.append(one["gain"]["value"])
        cutoffs.append(one["cutoff"]["value"])
    frequency: np.ndarray = outcome.tables["points"].columns["point_frequency_hz"][0]
    return np.array(gains), np.array(cutoffs), frequency


def _check(amplitude_vpp: float, count: int, most: float, bias: float) -> None:
    gains, cutoffs, frequency = _trials(amplitude_vpp, count)
    gain_bound, cutoff_bound = _bound(frequency, amplitude_vpp)
    print(
        f"{amplitude_vpp * 1e3:g} mVpp, {count} trials: gain {np.std(gains) / gain_bound:.3f}, "
        f"cut-off {np.std(cutoffs) / cutoff_bound:.3f} of the bound; bias "
        f"{(np.mean(gains) - GAIN) / np.std(gains):+.3f}, "
        f"{(np.mean(cutoffs) - CUTOFF_HZ) / np.std(cutoffs):+.3f}"
    )
    assert np.std(gains) <= most * gain_bound
    assert np.std(cutoffs) <= most * cutoff_bound
    assert abs(np.mean(gains) - GAIN) < bias * np.std(gains)
    assert abs(np.mean(cutoffs) - CUTOFF_HZ) < bias * np.std(cutoffs)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("amplitude_vpp", [3e-3, 50e-3])
def test_spread_is_within_a_fifth_of_the_bound(amplitude_vpp: float) -> None:
    _check(amplitude_vpp, 400, 1.2, 0.2)


@pytest.mark.slow
def test_spread_is_near_the_bound_in_a_few_trials() -> None:
    # 60 trials know a spread to 9 %, and a mean to 0.13 of it: bounds at three times that beside 1.2 and 0.2
    _check(50e-3, 60, 1.2 * (1 + 3 * 0.09), 0.2 + 3 * 0.13)
