from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import signal
from sine_records import CODE_V, COUNT, RATE_HZ, filtered_noise, folded_density

from belahil.errors import RefusedInput
from belahil.pole_response import SampledNoise
from belahil.values import RangeWindow
from procedures.dark_noise import dark_noise
from procedures.noise import noise_note


def window(volts: np.ndarray, saturated: int = 0, code_v: float = CODE_V) -> RangeWindow:
    counts = (np.rint(volts / code_v) + 2048).astype(np.int16)
    return RangeWindow(counts, code_v, 2048.0, 1 / RATE_HZ, 0.0, 4, 0, saturated)


def silent(
    rng: np.random.Generator,
    noise: SampledNoise,
    sigma_v: float,
    offset_v: float = 0.0,
    difference_v: float = 0.0,
    gain: float = 0.0,
) -> RangeWindow:
    sign = np.where(np.arange(COUNT) % 2, -1.0, 1.0)
    volts = sigma_v * noise.draw(rng, COUNT) * (1 + sign * gain / 2) + offset_v + sign * difference_v / 2
    return window(volts)


@pytest.mark.parametrize("codes", [0.3, 0.5, 1.0, 4.0])
def test_noise_is_unbiased_from_a_third_of_a_code_upwards(codes: float) -> None:
    # Given 60 pairs of windows of filtered noise with any offsets within a code
    rng, noise = np.random.default_rng(1), filtered_noise()
    found, raw = [], []
    for _ in range(60):
        offset, difference = rng.uniform(-0.5, 0.5) * CODE_V, rng.uniform(-3, 3) * CODE_V
        pair = [silent(rng, noise, codes * CODE_V, offset, difference, gain=0.01) for _ in range(2)]
        one = dark_noise(pair)
        assert one.status == "ok"
        assert one.rms is not None
        assert one.offset_difference is not None
        found.append(
            [
                (one.rms.value - codes * CODE_V) / one.rms.standard_uncertainty,
                (one.offset_difference.value - difference) / one.offset_difference.standard_uncertainty,
            ]
        )
        expected = CODE_V * math.sqrt(codes**2 + 1 / 12 + (difference / CODE_V) ** 2 / 4)
        raw.append(one.rms_total.value / expected - 1)
    # Then the mean of 60 pulls is 0 within 4 of its standard deviations, and their width 1 within 3.5
    np.testing.assert_allclose(np.mean(found, axis=0), 0.0, atol=4 / math.sqrt(60))
    np.testing.assert_allclose(np.std(found, axis=0), 1.0, atol=3.5 / math.sqrt(120))
    # and the raw rms holds quantization and offsets; with less noise what rounding adds depends on the mean.
    if codes >= 1:
        assert abs(np.mean(raw)) < 4 * np.std(raw) / math.sqrt(60)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cutoff_hz", "order", "highpass_hz"), [(12e6, 4, 0.0), (28e6, 2, 0.0), (19e6, 3, 20e3)]
)
@pytest.mark.parametrize("codes", [0.35, 0.8, 3.0])
def test_pulls_have_width_one_for_any_colour(
    cutoff_hz: float, order: int, highpass_hz: float, codes: float
) -> None:
    rng, noise = np.random.default_rng(2), filtered_noise(cutoff_hz, order, highpass_hz)
    found = []
    for _ in range(600):
        one = dark_noise([silent(rng, noise, codes * CODE_V, rng.uniform(-0.5, 0.5) * CODE_V)])
        assert one.rms is not None
        assert one.offset_difference is not None
        found.append(
            [
                (one.rms.value - codes * CODE_V) / one.rms.standard_uncertainty,
                one.offset_difference.value / one.offset_difference.standard_uncertainty,
            ]
        )
    np.testing.assert_allclose(np.std(found, axis=0), 1.0, atol=0.1)
    np.testing.assert_allclose(np.mean(found, axis=0), 0.0, atol=4 / math.sqrt(600))


def test_the_uncertainty_of_coloured_noise_is_larger_than_of_white() -> None:
    # For Gaussian noise var(rms) = rms^2 sum(rho^2) / (2 N); rho of the sampled noise from its own spectrum
    frequency = np.arange(COUNT) * RATE_HZ / COUNT
    density = folded_density(np.minimum(frequency, RATE_HZ - frequency), 1.0, 12e6, 4)
    squares = np.mean(density**2) / np.mean(density) ** 2
    one = dark_noise(
        [silent(np.random.default_rng(3), filtered_noise(12e6, 4), 5 * CODE_V) for _ in range(4)]
    )
    assert one.rms is not None
    expected = one.rms.value * math.sqrt(squares / (2 * 4 * COUNT))
    assert squares > 2
    assert one.rms.standard_uncertainty == pytest.approx(expected, rel=0.05)


def test_the_spectrum_is_the_folded_one_and_sums_to_the_variance() -> None:
    rng, noise = np.random.default_rng(4), filtered_noise()
    one = dark_noise([silent(rng, noise, 2e-3, 1e-3, 4e-3) for _ in range(8)])
    inner = slice(2, -2)
    expected = folded_density(one.frequency_hz[inner], 2e-3, code_v=CODE_V)
    # Some 1000 half-overlapping segments: 3.5 % a bin; the taper smears over 3 bins of 0.3 MHz.
    np.testing.assert_allclose(one.density_v2_per_hz[inner], expected, rtol=5 * 0.04)
    whole = np.sum(one.density_v2_per_hz[1:-1]) * (one.frequency_hz[1] - one.frequency_hz[0])
    assert whole == pytest.approx(2e-3**2 + CODE_V**2 / 12, rel=0.03)
    # scipy's own estimate, as a judge of the scale
    volts = silent(rng, noise, 2e-3).volts
    made = dark_noise([window(volts)]).density_v2_per_hz[inner]
    judged = signal.welch(volts, RATE_HZ, "hann", 256)[1][inner]
    np.testing.assert_allclose(made, judged, rtol=0.02)


def test_offsets_do_not_count_as_noise() -> None:
    noise = filtered_noise()
    plain = dark_noise([silent(np.random.default_rng(6), noise, 2e-3)])
    moved = dark_noise([silent(np.random.default_rng(6), noise, 2e-3, 10 * CODE_V, 20 * CODE_V)])
    assert plain.rms is not None
    assert moved.rms is not None
    assert moved.rms.value == pytest.approx(plain.rms.value, rel=1e-9)
    assert moved.rms_total.value == pytest.approx(math.hypot(plain.rms_total.value, 10 * CODE_V), rel=1e-3)


def test_a_single_converter_has_no_offset_difference() -> None:
    one = dark_noise([silent(np.random.default_rng(7), filtered_noise(), 2e-3)], converters=1)
    assert one.status == "ok"
    assert one.offset_difference is None


@pytest.mark.parametrize(("converters", "plural"), [(1, False), (2, True), (4, True)])
def test_a_single_converter_is_not_called_several(converters: int, plural: bool) -> None:
    assert ("converters' offsets and the interleave line are" in noise_note(converters)) == plural
    assert ("the converter's offset are" in noise_note(converters)) != plural


def test_noise_as_wide_as_the_span_of_16_bits_is_measured() -> None:
    # Given counts whose differences int16 does not hold
    counts = np.clip(np.rint(9000 * np.random.default_rng(12).standard_normal(COUNT)), -32768, 32767)
    assert np.ptp(counts) > 40000
    wide = RangeWindow(counts.astype(np.int16), CODE_V, 0.0, 1 / RATE_HZ, 0.0, 4, 0)

    one = dark_noise([wide])

    assert one.rms is not None
    assert one.rms.value == pytest.approx(9000 * CODE_V, abs=4 * one.rms.standard_uncertainty)


@pytest.mark.parametrize(
    ("made", "status"),
    [
        (window(np.zeros(COUNT)), "no_signal"),
        (window(np.where(np.arange(COUNT) % 2, 0.3, -0.3)), "below_dither"),  # offsets, no noise
        (
            window(0.1 * CODE_V * np.random.default_rng(8).standard_normal(COUNT) + 0.4 * CODE_V),
            "below_dither",
        ),
        (silent(np.random.default_rng(11), filtered_noise(), 0.16 * CODE_V, 0, 0.6 * CODE_V), "below_dither"),
        (
            window(np.clip(0.5 * np.random.default_rng(9).standard_normal(COUNT), -1, 1), saturated=700),
            "clipped",
        ),
    ],
)
def test_what_cannot_be_told_has_a_status_and_no_number(made: RangeWindow, status: str) -> None:
    one = dark_noise([made])
    assert one.status == status
    assert one.rms is None
    assert one.offset_difference is None
    assert math.isfinite(one.rms_total.value)


def test_windows_that_do_not_belong_together_are_refused() -> None:
    one = silent(np.random.default_rng(10), filtered_noise(), 2e-3)
    with pytest.raises(RefusedInput, match="no window"):
        dark_noise([])
    with pytest.raises(RefusedInput, match="different scales"):
        dark_noise([one, window(np.zeros(COUNT), code_v=2 * CODE_V)])
    with pytest.raises(RefusedInput, match="at least 512"):
        dark_noise([window(np.zeros(100))])
