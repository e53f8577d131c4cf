from __future__ import annotations

import numpy as np
import pytest
from sine_records import COUNT, RATE_HZ, filtered_noise

from belahil.butterworth import magnitude
from belahil.values import Estimate
from procedures.coherent import default_frequencies
from procedures.sine_fit import SinePlan
from procedures.sine_noise import LEAST_AMPLITUDE_COUNTS, Leftover, noise_beside_sines

FREQUENCIES = default_frequencies(RATE_HZ, COUNT, 30e6, 12)
PLANS = [SinePlan(one, RATE_HZ, COUNT) for one in FREQUENCIES]


def swept(seed: int, codes: float) -> list[Leftover]:
    """Fit a sweep at two amplitudes, any offsets within a code, with noise of so many codes; all in codes."""
    rng, noise = np.random.default_rng(seed), filtered_noise()
    amplitude, offset, difference = rng.uniform(50, 200), rng.uniform(-0.5, 0.5), rng.uniform(-1, 1)
    number = np.arange(COUNT)
    found = []
    for part in (0.26, 1.0):
        for frequency, plan in zip(FREQUENCIES, PLANS, strict=True):
            size = part * amplitude * float(magnitude(frequency, 19e6, 3))
            counts = size * np.sin(2 * np.pi * (frequency / RATE_HZ * number + rng.random()))
            counts += offset + np.where(number % 2, -difference, difference) / 2
            fit = plan.fit(np.rint(counts + codes * noise.draw(rng, COUNT)), volts_per_count=1.0)
            found.append(Leftover(fit.amplitude.value, fit.noise_rms_v**2))
    return found


@pytest.mark.parametrize("codes", [0.12, 0.25])
def test_sines_show_the_noise_that_silence_hides(codes: float) -> None:
    # Given 12 sweeps with less noise than a dark window can tell
    found = [noise_beside_sines(swept(seed, codes)) for seed in range(12)]
    # Then each is told to 6 %, and within 3.5 standard uncertainties (one in 2000)
    for one in found:
        assert isinstance(one, Estimate)
        assert one.standard_uncertainty < 0.06 * codes
        assert abs(one.value - codes) < 3.5 * one.standard_uncertainty


def test_noise_that_sines_do_not_show_either_is_not_told() -> None:
    assert noise_beside_sines(swept(1, 0.0)) is None
    assert noise_beside_sines(swept(2, 0.02)) is None


def test_small_or_single_sines_tell_nothing() -> None:
    small = [Leftover(LEAST_AMPLITUDE_COUNTS, 0.2)] * 50
    assert noise_beside_sines(small) is None
    assert noise_beside_sines([Leftover(100.0, 0.2)]) is None
    assert noise_beside_sines([]) is None
