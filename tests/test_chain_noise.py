"""The noise of chains against analytic densities and against counted photons."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from msgspec import structs
from scenes import BARE, DAY, NIGHT, with_
from scipy.signal import butter, freqs, residue

from belahil.errors import RefusedInput
from sim.accuracy import Accuracy
from sim.chain import Chain
from sim.chain_noise import PoleFilter, ShotNoise, fewest_steps, steps_for
from sim.constants import ELEMENTARY_CHARGE_C
from sim.detector import excess_noise_factor, multiplication
from sim.draws import Draws
from sim.light_noise import background_density, shot_noise_density
from sim.scene import Scene

RATE_HZ, COUNT, BANDS = 80e6, 16064, 40
WINDOWS = 900
"""With 200 frequencies in a band, the mean over so many windows has a standard error of 0.24 %."""


def folded(frequency_hz: np.ndarray) -> np.ndarray:
    """Squared magnitude of the filter with all that sampling folds back, by another library."""
    b, a = butter(3, 2 * math.pi * 19e6, analog=True)
    shifted = [frequency_hz + k * RATE_HZ for k in range(-20, 21)]
    return np.asarray(sum(np.abs(freqs(b, a, 2 * math.pi * one)[1]) ** 2 for one in shifted))


def bands(spectrum: np.ndarray) -> np.ndarray:
    frequency_hz = np.fft.rfftfreq(COUNT, 1 / RATE_HZ)
    band = np.minimum((frequency_hz / 1e6).astype(int), BANDS - 1)
    keep = frequency_hz > 0
    return np.bincount(band[keep], spectrum[keep]) / np.bincount(band[keep])


@pytest.mark.parametrize("scene", [pytest.param(DAY, marks=pytest.mark.slow), NIGHT], ids=["day", "night"])
def test_noise_has_the_analytic_spectrum_before_and_after_quantization(scene: Scene) -> None:
    # Given a scene whose echo is too faint to matter
    scene = with_(scene, laser={"energy_j": 1e-12})
    chain = Chain(scene)
    before, after = np.zeros(COUNT // 2 + 1), np.zeros(COUNT // 2 + 1)

    for shot in range(WINDOWS):
        request = chain.whole_window(shot)
        volts = chain.samples(shot, request).volts
        before += np.abs(np.fft.rfft(volts)) ** 2
        after += np.abs(np.fft.rfft(chain.receiver.digitized(volts, request).volts)) ** 2

    # Then each 1 MHz holds the density of sunlight and dark noise, and of quantization
    scale = 2 / (RATE_HZ * COUNT * WINDOWS)
    frequency_hz = np.fft.rfftfreq(COUNT, 1 / RATE_HZ)
    shape = folded(frequency_hz)
    dark = 0.83e-3**2 / (shape.mean() * RATE_HZ / 2)
    expected = (dark + (5.19 * background_density(scene)) ** 2) * shape
    step_v = 2.0 / 4096
    quantized = expected + step_v**2 / 12 / (RATE_HZ / 2)
    assert np.abs(bands(before * scale) / bands(expected) - 1).max() < 0.01
    assert np.abs(bands(after * scale) / bands(quantized) - 1).max() < 0.01
    # And the variance is their sum.
    assert before[1:].sum() * scale == pytest.approx(expected[1:].sum(), rel=2e-3)


def test_a_weak_echo_has_the_mean_and_variance_of_counted_photons() -> None:
    # Given the echo from 1400 km: 56 photoelectrons, each multiplied at random, and a filter in partial
    # fractions by another library
    scene = structs.replace(BARE, altitude_m=1400e3, noise=structs.replace(BARE.noise, shot=True))
    chain = Chain(scene)
    detector, light = scene.detector, chain.echo()
    weights, poles, _ = residue(*butter(3, 2 * math.pi * 19e6, analog=True))
    begin_s, end_s = light.span_s
    step_s = 1e-10
    places_s = np.arange(begin_s, end_s, step_s)
    share = light.photon_rate_hz(begin_s, step_s, places_s.size)
    share /= share.sum()
    gain, factor = multiplication(detector), excess_noise_factor(detector)
    volts_s = ELEMENTARY_CHARGE_C * detector.feedback_ohm
    rng, shots = np.random.default_rng(8), 6000
    times_s = np.arange(-60e-9, 180e-9, 12.5e-9)

    # When photons are counted one by one
    counted = np.zeros((shots, times_s.size))
    for row in counted:
        electrons = rng.poisson(light.photons * detector.quantum_efficiency)
        at_s = rng.choice(places_s, electrons, p=share) + rng.uniform(-0.5, 0.5, electrons) * step_s
        multiplied = rng.gamma(1 / (factor - 1), gain * (factor - 1), electrons)
        since = times_s[:, None] - at_s
        after = np.maximum(since, 0.0)
        h = sum((w * np.exp(p * after)).real for w, p in zip(weights, poles, strict=True)) * (since > 0)
        row[:] = volts_s * (h @ multiplied)

    # Then mean and variance are those of the chain
    mean_v = chain.curve(None, times_s[0], 12.5e-9, times_s.size) / 5.19
    (noise,) = chain.light_noise
    assert isinstance(noise, ShotNoise)
    density = shot_noise_density(detector, share * light.photons / step_s)
    since = times_s[:, None] - places_s
    h = noise.passed.impulse(since)
    variance = (0.5 * density**2 * h**2).sum(axis=1) * step_s
    loud = variance > 0.02 * variance.max()
    error = np.sqrt(variance[loud] / shots)
    assert np.abs((counted.mean(axis=0) - mean_v)[loud] / error).max() < 4.5
    # Of a compound Poisson sum the variance itself varies more than of a Gaussian: take it from the sample.
    away = (counted - counted.mean(axis=0))[:, loud] ** 2
    assert np.abs((away.mean(axis=0) - variance[loud]) / (away.std(axis=0) / math.sqrt(shots))).max() < 4.5


def test_a_filter_of_one_pole_keeps_the_noise_of_its_jump() -> None:
    # Given light of constant density through one pole, where the variance is density^2 pole / 4
    passed = PoleFilter((complex(-2 * math.pi * 10e6),))
    noise = ShotNoise(BARE.detector, passed, 12.5e-9)
    _, taps = noise.taps

    variance = (taps**2).sum() / (2 * noise.step_s)

    assert variance == pytest.approx(2 * math.pi * 10e6 / 4, rel=2e-3)
    assert passed.bandwidth_hz == pytest.approx(2 * math.pi * 10e6 / 4, rel=1e-12)


def test_high_passed_shot_noise_is_cut_where_it_no_longer_counts() -> None:
    chain = Chain(with_(NIGHT, electronics={"highpass_hz": 100e3}))
    passed = chain.light_noise[0].passed
    times_s = passed.ends_s + np.linspace(0, 1e-5, 50)

    peak = np.abs(passed.impulse(np.linspace(0, 1e-7, 1000))).max()
    assert np.abs(passed.impulse(times_s)).max() < 1e-6 * peak


@pytest.mark.parametrize(("bins", "steps"), [(0, 16), (14, 14), (32, 16), (5, 16), (1, 16), (40, 20), (8, 8)])
def test_draws_lie_on_time_bins_where_they_can(bins: int, steps: int) -> None:
    assert steps_for(bins) == steps


class Ones(Draws):
    """Draws that are all 1."""

    def stream(self, effect: str) -> Any:
        return self

    def standard_normal(self, count: int) -> np.ndarray:
        return np.ones(count)


@pytest.mark.parametrize(
    ("laser", "electronics", "tolerance"),
    [
        ({}, {}, 1e-4),
        ({"pulse": "gaussian", "fwhm_s": 1e-9}, {}, 1e-4),
        ({"pulse": "gaussian", "fwhm_s": 1e-9}, {}, 1e-2),
        ({"pulse": "gaussian", "fwhm_s": 0.3e-9}, {}, 1e-2),
        ({}, {"cutoff_hz": 200e6}, 1e-4),
        ({}, {"cutoff_hz": 1e9}, 1e-3),
        ({}, {"order": 1}, 1e-4),
    ],
    ids=["usual", "1 ns", "1 ns coarse", "0.3 ns coarse", "200 MHz", "1 GHz", "one pole"],
)
def test_shot_noise_follows_short_pulses_and_fast_receivers(
    laser: dict[str, object], electronics: dict[str, object], tolerance: float
) -> None:
    # Given nearly level ground with pixels, so that the light lies on time bins as coarse as is allowed
    scene = with_(NIGHT, laser=laser, electronics=electronics)
    scene = with_(scene, surface={"kind": "boulder", "slope_deg": 0.0, "height_m": 0.05})
    chain = Chain(scene, Accuracy(tolerance))
    (noise,) = (one for one in chain.light_noise if isinstance(one, ShotNoise))
    # When all deviates are 1, and the variances behind the filter are summed at samples about the echo
    begin, rms_v = noise.before_filter(chain.optical(chain.lit(0)), 0.0, Ones(1, 0))
    first, taps = noise.taps
    every = max(1, round(2e-9 / noise.step_s))
    samples = np.arange(round(-10e-9 / noise.step_s), round(60e-9 / noise.step_s), every)
    lags = samples[:, None] - (begin + np.arange(rms_v.size)) - first
    squares = np.where((lags >= 0) & (lags < taps.size), taps[np.clip(lags, 0, taps.size - 1)] ** 2, 0.0)
    found_v = np.sqrt(squares @ rms_v**2)
    # Then it is Campbell's integral over the exact light, to 0.5 % of the largest rms, or the tolerance
    fine_s = min(0.02e-9, noise.step_s / 8)
    since_s = np.arange(fine_s / 2, 160e-9, fine_s)
    response2 = noise.passed.impulse(since_s) ** 2 * fine_s
    exact = Chain(scene, Accuracy(1e-6)).echo(0)
    begins_s = samples * noise.step_s - since_s[-1]
    rates_hz = np.array([exact.photon_rate_hz(at_s, fine_s, since_s.size)[::-1] for at_s in begins_s])
    expected_v = np.sqrt(shot_noise_density(scene.detector, rates_hz) ** 2 / 2 @ response2)
    assert np.abs(found_v - expected_v).max() < max(5e-3, tolerance) * expected_v.max()


def test_a_pulse_too_short_for_its_shot_noise_is_refused() -> None:
    chain = Chain(with_(BARE, laser={"pulse": "gaussian", "fwhm_s": 1e-12}, surface={"slope_deg": 0.0}))

    with pytest.raises(RefusedInput, match="in a sample interval, at most 4096 are allowed"):
        fewest_steps(chain.light_kernel, chain.passed, 12.5e-9)
