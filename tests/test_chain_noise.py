"""The noise of chains against analytic densities and against counted photons."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec import structs
from scenes import BARE, DAY, NIGHT, with_
from scipy.signal import butter, freqs, residue

from sim.chain import Chain
from sim.chain_noise import PoleFilter, ShotNoise, steps_for
from sim.constants import ELEMENTARY_CHARGE_C
from sim.detector import excess_noise_factor, multiplication
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


@pytest.mark.parametrize("scene", [DAY, NIGHT], ids=["day", "night"])
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
