"""A burst behind the receiver's filter, against the same burst as a finely sampled pulse."""

from __future__ import annotations

import numpy as np
import pytest

from belahil import butterworth
from belahil.config import EmcBurst
from belahil.errors import ConfigError
from belahil.pole_response import response
from sim.emc_burst import FilteredBurst
from sim.scene import parse_scene


@pytest.mark.parametrize("highpass_hz", [0.0, 20e3])
@pytest.mark.parametrize(
    "truth",
    [
        EmcBurst(3e-3, 8e6, 0.5e-6, 1e-6),
        EmcBurst(-1e-3, 1e6, 2e-6, 0.0),
        EmcBurst(1e-3, 25e6, 50e-9, 3.21e-6),
    ],
)
def test_the_sum_of_modes_is_the_filtered_burst(truth: EmcBurst, highpass_hz: float) -> None:
    # given straight lines of 0.25 ns, whose error is (w dt)^2 / 12 of the peak at most
    poles, zeros = butterworth.poles(19e6, 3, highpass_hz), int(highpass_hz > 0)
    times_s = np.arange(0.0, 12e-6, 12.5e-9)
    rate_hz = 4e9
    since_s = np.arange(0, 25 * truth.decay_s, 1 / rate_hz)
    fine = (
        truth.amplitude_v
        * np.exp(-since_s / truth.decay_s)
        * np.sin(2 * np.pi * truth.frequency_hz * since_s)
    )
    expected = response(fine, rate_hz, truth.delay_s, "linear", poles, times_s, zeros=zeros)
    found = FilteredBurst(truth, poles, zeros).at(times_s)
    allowed = abs(truth.amplitude_v) * (2 * np.pi * truth.frequency_hz / rate_hz) ** 2 / 6
    np.testing.assert_allclose(found, expected, atol=allowed, rtol=0)
    # and there is nothing before it begins
    assert not np.any(found[times_s < truth.delay_s])
    assert np.max(np.abs(found)) > 0.2 * abs(truth.amplitude_v)


def test_a_burst_slower_than_the_high_pass_is_refused() -> None:
    poles = butterworth.poles(19e6, 3, 100e3)
    with pytest.raises(ConfigError, match="must be above highpass_hz"):
        FilteredBurst(EmcBurst(1e-3, 2e3, 1e-3, 0.0), poles, 1)


def test_a_scene_has_no_burst_of_its_own() -> None:
    with pytest.raises(ConfigError, match=r"\[electronics\] emc_burst"):
        parse_scene("[electronics]\nemc_burst = { amplitude_v = 1e-3 }\n")
