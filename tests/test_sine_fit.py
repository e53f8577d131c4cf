from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sine_records import CODE_V, COUNT, RATE_HZ, Truth, filtered_noise, folded_density, record

from procedures.coherent import coherent_frequency, default_frequencies
from procedures.sine_fit import SineFit, SinePlan, amplitude_from_peak_to_peak, amplitude_from_rms
from procedures.sine_frequency import common_clock, fit_four_parameters

MISMATCH = {"gain_mismatch": 0.01, "skew_s": 50e-12, "offset_difference_v": 3e-3, "offset_v": 10e-3}


def near(frequency_hz: float, count: int = COUNT) -> float:
    return coherent_frequency(frequency_hz, RATE_HZ, count)


# ---- without noise


@settings(max_examples=50)
@given(
    frequency_hz=st.floats(0.1e6, 78e6).filter(lambda f: min(abs(f - k * 20e6) for k in range(5)) > 30e3),
    phase_rad=st.floats(-3.1, 3.1),
    gain=st.floats(-0.05, 0.05),
    skew_s=st.floats(-500e-12, 500e-12),
    offset_v=st.floats(-0.5, 0.5),
)
def test_every_parameter_of_two_converters_comes_back(
    frequency_hz: float, phase_rad: float, gain: float, skew_s: float, offset_v: float
) -> None:
    # Given a clean record of any frequency, coherent or not, below or above half the sample rate
    truth = Truth(frequency_hz, 0.1, phase_rad, offset_v, gain, skew_s, offset_v / 10)
    # When it is fitted with the right frequency
    fit = SinePlan(frequency_hz, RATE_HZ, COUNT).fit(record(truth))
    # Then all parameters return. Some 3 bins from a confusing line the columns are nearly orthogonal, and
    # a phase of 2 pi f N / f_s = 1e5 rad carries a rounding error of 2e-11.
    assert fit.status == "ok"
    assert fit.amplitude.value == pytest.approx(0.1, rel=1e-9)
    assert math.remainder(fit.phase.value - phase_rad, 2 * math.pi) == pytest.approx(0, abs=1e-9)
    assert fit.offset.value == pytest.approx(offset_v, abs=1e-10)
    assert fit.gain_mismatch is not None
    assert fit.skew is not None
    assert fit.offset_difference is not None
    assert fit.gain_mismatch.value == pytest.approx(gain, abs=1e-9)
    assert fit.skew.value == pytest.approx(skew_s, abs=1e-9 / (2 * np.pi * frequency_hz))
    assert fit.offset_difference.value == pytest.approx(offset_v / 10, abs=1e-10)


def by_least_squares(volts: np.ndarray, frequency_hz: float, used: np.ndarray) -> tuple[complex, complex]:
    """Phasors of even and odd samples, each converter fitted alone, by numpy's lstsq."""
    number = np.arange(volts.size)
    angle = 2 * np.pi * frequency_hz / RATE_HZ * number
    found = []
    for parity in (0, 1):
        rows = used & (number % 2 == parity)
        columns = np.stack([np.cos(angle[rows]), np.sin(angle[rows]), np.ones(rows.sum())], axis=1)
        cos, sin, _ = np.linalg.lstsq(columns, volts[rows], rcond=None)[0]
        found.append(complex(cos, -sin))
    return found[0], found[1]


@pytest.mark.parametrize("count", [COUNT, 4001, 1000])
def test_fit_is_least_squares_of_each_converter(count: int) -> None:
    # Given a noisy record of any length, some samples not finite, some not wanted
    rng = np.random.default_rng(count)
    truth = Truth(7.1234e6, 0.05, count=count, **MISMATCH)
    volts = record(truth, 2e-3 * rng.standard_normal(count))
    volts[[3, 10, count - 1]] = [np.nan, np.inf, -np.inf]
    keep = rng.random(count) > 0.1
    # When it is fitted
    fit = SinePlan(7.1234e6, RATE_HZ, count).fit(volts, keep)
    # Then it is the fit by lstsq without these samples
    even, odd = by_least_squares(np.nan_to_num(volts), 7.1234e6, keep & np.isfinite(volts))
    assert fit.status == "masked"
    assert fit.usable
    assert fit.used == np.count_nonzero(keep & np.isfinite(volts))
    assert fit.gain_mismatch is not None
    assert fit.skew is not None
    mean = (abs(even) + abs(odd)) / 2
    assert fit.gain_mismatch.value == pytest.approx((abs(even) - abs(odd)) / mean, abs=1e-10)
    assert fit.skew.value * 2 * np.pi * 7.1234e6 == pytest.approx(np.angle(even / odd), abs=1e-10)
    # The amplitude is the mean of both, less what noise in their phase difference adds to it.
    angle_u = fit.skew.standard_uncertainty * 2 * np.pi * 7.1234e6
    assert fit.amplitude.value == pytest.approx(mean * (1 - angle_u**2 / 8), rel=1e-6)


def test_one_converter_is_the_standards_three_parameter_fit() -> None:
    rng = np.random.default_rng(0)
    volts = record(Truth(3.21e6, 0.05, 1.1, 0.02), 2e-3 * rng.standard_normal(COUNT))
    angle = 2 * np.pi * 3.21e6 / RATE_HZ * np.arange(COUNT)
    columns = np.stack([np.cos(angle), np.sin(angle), np.ones(COUNT)], axis=1)
    cos, sin, offset = np.linalg.lstsq(columns, volts, rcond=None)[0]
    fit = SinePlan(3.21e6, RATE_HZ, COUNT, interleaved=False).fit(volts)
    assert fit.amplitude.value == pytest.approx(math.hypot(cos, sin), rel=1e-12)
    assert fit.phase.value == pytest.approx(math.atan2(-sin, cos), abs=1e-10)
    assert fit.offset.value == pytest.approx(offset, abs=1e-14)
    assert fit.gain_mismatch is fit.skew is fit.offset_difference is None
    assert fit.noise_rms_v == pytest.approx(
        math.sqrt(np.sum((volts - columns @ [cos, sin, offset]) ** 2) / (COUNT - 3)), rel=1e-10
    )


def test_mismatch_does_not_leak_into_the_amplitude_near_a_quarter_of_the_rate() -> None:
    frequency = 20e6 + 0.3 * RATE_HZ / COUNT
    truth = Truth(frequency, 0.03, gain_mismatch=0.01)
    joint = SinePlan(frequency, RATE_HZ, COUNT).fit(record(truth)).amplitude.value
    alone = SinePlan(frequency, RATE_HZ, COUNT, interleaved=False).fit(record(truth)).amplitude.value
    assert joint == pytest.approx(0.03, rel=1e-10)
    assert abs(alone / 0.03 - 1) > 1e-4  # what one converter's model makes of it


# ---- uncertainty


def pulls(fit: SineFit, truth: Truth) -> list[float]:
    assert fit.gain_mismatch is not None
    assert fit.skew is not None
    assert fit.offset_difference is not None
    turned = math.remainder(fit.phase.value - truth.phase_rad, 2 * math.pi)
    known = [
        (fit.amplitude, fit.amplitude.value - truth.amplitude_v),
        (fit.phase, turned),
        (fit.offset, fit.offset.value - truth.offset_v),
        (fit.gain_mismatch, fit.gain_mismatch.value - truth.gain_mismatch),
        (fit.skew, fit.skew.value - truth.skew_s),
        (fit.offset_difference, fit.offset_difference.value - truth.offset_difference_v),
        (fit.frequency_error, fit.frequency_error.value),
    ]
    return [error / estimate.standard_uncertainty for estimate, error in known]


@pytest.mark.parametrize(
    ("frequency_hz", "amplitude_v"), [(0.1e6, 0.03), (19.9e6, 0.03), (38e6, 1e-3), (58e6, 0.3e-3)]
)
def test_uncertainties_are_those_of_the_coloured_noise_at_each_line(
    frequency_hz: float, amplitude_v: float
) -> None:
    # Given 400 records with 2 mV of filtered noise and 12 bits
    frequency = near(frequency_hz)
    plan, noise, rng = SinePlan(frequency, RATE_HZ, COUNT), filtered_noise(), np.random.default_rng(11)
    found = []
    density = []
    for _ in range(400):
        truth = Truth(frequency, amplitude_v, rng.uniform(-3.1, 3.1), **MISMATCH)
        fit = plan.fit(record(truth, 2e-3 * noise.draw(rng, COUNT), CODE_V), volts_per_count=CODE_V)
        found.append(pulls(fit, truth))
        density.append(fit.noise_density)
    # Then each pull has width 1 and no bias; a width from 400 has a standard deviation of 3.5 %, a mean 5 %
    np.testing.assert_allclose(np.std(found, axis=0), 1.0, atol=3.5 * 0.036)
    np.testing.assert_allclose(np.mean(found, axis=0), 0.0, atol=4 * 0.05)
    # and the density is the folded one; one record tells it to 12 %
    expected = folded_density(frequency, 2e-3, code_v=CODE_V)[0]
    assert np.mean(density) == pytest.approx(expected, rel=5 * 0.13 / 20)


def test_a_record_that_was_fitted_with_a_wrong_frequency_says_so() -> None:
    # Given a clock 10 ppm off that the plan does not know
    frequency = near(38e6)
    rng = np.random.default_rng(2)
    truth = Truth(frequency, 0.1, clock_ppm=10.0)
    fit = SinePlan(frequency, RATE_HZ, COUNT).fit(record(truth, 1e-3 * rng.standard_normal(COUNT)))
    # Then the amplitude is too small, but within its uncertainty, and the drift of the phase shows the error
    assert fit.amplitude.value < 0.0995
    assert abs(fit.amplitude.value - 0.1) < 2 * fit.amplitude.standard_uncertainty
    assert -fit.frequency_error.value == pytest.approx(10e-6, rel=0.1)


@pytest.mark.parametrize("amplitude_counts", [0.8, 1.7, 5.3])
def test_rounding_without_dither_is_in_the_uncertainty(amplitude_counts: float) -> None:
    # Given records with next to no noise and any offset within a code
    rng = np.random.default_rng(4)
    plan = SinePlan(near(5e6), RATE_HZ, COUNT)
    truth = Truth(near(5e6), amplitude_counts * CODE_V)
    errors, claimed = [], []
    for _ in range(60):
        volts = record(truth.but(offset_v=rng.uniform(0, CODE_V)), 0.05 * CODE_V * rng.standard_normal(COUNT))
        fit = plan.fit(np.rint(volts / CODE_V) * CODE_V, volts_per_count=CODE_V)
        errors.append(fit.amplitude.value - truth.amplitude_v)
        claimed.append(fit.amplitude.standard_uncertainty)
    # Then the error is never beyond sqrt(2) times what is claimed, as for a cosine of known size
    assert np.max(np.abs(errors)) < 1.5 * np.mean(claimed)
    # and the noise alone would claim far less
    assert np.mean(claimed) > 10 * 0.05 * CODE_V * math.sqrt(2 / COUNT)


# ---- statuses


def test_a_clipped_record_is_not_fitted() -> None:
    fit = SinePlan(near(5e6), RATE_HZ, COUNT).fit(np.clip(record(Truth(near(5e6), 1.2)), -1, 1), saturated=10)
    assert (fit.status, fit.usable, fit.amplitude.standard_uncertainty) == ("clipped", False, math.inf)


@pytest.mark.parametrize("interleaved", [True, False])
@pytest.mark.parametrize("volts", [np.zeros(COUNT), np.full(COUNT, 0.7), np.full(COUNT, np.nan)])
def test_a_record_that_does_not_move_has_no_signal(interleaved: bool, volts: np.ndarray) -> None:
    fit = SinePlan(near(5e6), RATE_HZ, COUNT, interleaved).fit(volts)
    assert (fit.status, fit.usable) == ("no_signal", False)
    assert fit.amplitude.value == 0.0
    assert fit.amplitude.standard_uncertainty == math.inf


@pytest.mark.parametrize("quarter", [1, 2, 3, 4])
def test_frequencies_that_interleaving_confuses_are_not_measurable(quarter: int) -> None:
    volts = record(Truth(quarter * RATE_HZ / 4, 0.1))
    assert SinePlan(quarter * RATE_HZ / 4, RATE_HZ, COUNT).fit(volts).status == "frequency_not_measurable"
    alone = SinePlan(quarter * RATE_HZ / 4, RATE_HZ, COUNT, interleaved=False).fit(volts)
    assert alone.status == ("ok" if quarter % 2 else "frequency_not_measurable")


def test_less_than_half_a_cycle_is_flagged_with_numbers() -> None:
    plan = SinePlan(0.4 * RATE_HZ / COUNT, RATE_HZ, COUNT)
    fit = plan.fit(
        record(Truth(plan.frequency_hz, 0.03), 2e-3 * np.random.default_rng(1).standard_normal(COUNT))
    )
    assert (fit.status, fit.usable) == ("short_record", False)
    assert abs(fit.amplitude.value - 0.03) < 5 * fit.amplitude.standard_uncertainty


def test_a_record_of_another_length_is_a_mistake_of_the_caller() -> None:
    with pytest.raises(ValueError, match="plan is for 16064"):
        SinePlan(1e6, RATE_HZ, COUNT).fit(np.zeros(100))


# ---- unknown frequency


@pytest.mark.parametrize("ppm", [-250.0, -1.0, 10.0, 250.0])
@pytest.mark.parametrize("frequency_hz", [2e6, 38e6, 58e6])
def test_four_parameters_find_frequency_and_amplitude_through_the_alias(
    ppm: float, frequency_hz: float
) -> None:
    truth = Truth(near(frequency_hz), 0.1, clock_ppm=ppm, **MISMATCH)
    fit = fit_four_parameters(record(truth), RATE_HZ, near_hz=truth.frequency_hz)
    assert fit.frequency.value == pytest.approx(truth.frequency_hz / (1 + ppm * 1e-6), rel=1e-12)
    assert fit.amplitude.value == pytest.approx(0.1, rel=1e-9)
    assert fit.phase.value == pytest.approx(truth.phase_rad, abs=1e-7)


def test_four_parameters_without_a_nominal_frequency_take_the_highest_peak() -> None:
    fit = fit_four_parameters(record(Truth(12.3456e6, 0.1, **MISMATCH)), RATE_HZ)
    assert fit.frequency.value == pytest.approx(12.3456e6, rel=1e-12)


def test_four_parameters_of_silence_find_nothing() -> None:
    fit = fit_four_parameters(np.zeros(COUNT), RATE_HZ)
    assert (fit.status, fit.frequency.standard_uncertainty) == ("no_signal", math.inf)


def test_fitted_frequency_and_phase_have_pulls_of_width_one() -> None:
    rng = np.random.default_rng(6)
    found = []
    for _ in range(300):
        truth = Truth(3.2e6 + rng.uniform(-2e4, 2e4), 0.01, rng.uniform(-3.1, 3.1), count=4016)
        volts = record(truth, 2e-3 * rng.standard_normal(4016))
        fit = fit_four_parameters(volts, RATE_HZ, near_hz=3.2e6)
        turned = math.remainder(fit.phase.value - truth.phase_rad, 2 * math.pi)
        error = fit.frequency.value - truth.frequency_hz
        found.append([error / fit.frequency.standard_uncertainty, turned / fit.phase.standard_uncertainty])
    np.testing.assert_allclose(np.std(found, axis=0), 1.0, atol=4 * 0.041)


# ---- one clock


def sweep(
    ppm: float, rng: np.random.Generator, count: int, amplitude_v: float
) -> list[tuple[float, np.ndarray]]:
    records = []
    for frequency in default_frequencies(RATE_HZ, count, 120e6, 6):
        truth = Truth(frequency, amplitude_v, rng.uniform(-3, 3), clock_ppm=ppm, count=count, **MISMATCH)
        records.append((frequency, record(truth, 2e-3 * rng.standard_normal(count), CODE_V)))
    return records


def test_the_clock_of_a_sweep_has_pulls_of_width_one_over_its_whole_range() -> None:
    # Given 150 short sweeps with clocks up to 250 ppm off
    rng = np.random.default_rng(8)
    found = []
    for _ in range(150):
        ppm = rng.uniform(-250, 250)
        clock = common_clock(sweep(ppm, rng, 4016, 0.02), RATE_HZ)
        assert (clock.status, clock.records) == ("ok", 6)
        found.append((clock.ppm - ppm) / clock.standard_uncertainty_ppm)
    # Then no sweep is taken for another (a pull of hundreds), and the width of 150 pulls is 1 within 6 %
    assert np.max(np.abs(found)) < 5
    assert np.std(found) == pytest.approx(1.0, abs=4 * 0.058)


def test_the_clock_is_exact_without_noise_and_gives_the_true_rate() -> None:
    records = [(f, record(Truth(f, 0.1, clock_ppm=-77.7, **MISMATCH))) for f in (near(0.1e6), near(38e6))]
    clock = common_clock(records, RATE_HZ)
    assert clock.ppm == pytest.approx(-77.7, abs=1e-6)
    assert clock.sample_rate_hz(RATE_HZ) == pytest.approx(RATE_HZ * (1 - 77.7e-6), rel=1e-12)


def test_one_record_that_contradicts_the_others_is_noticed() -> None:
    rng = np.random.default_rng(9)
    records = sweep(20.0, rng, 4016, 0.1)
    frequency = records[3][0]
    records[3] = frequency, record(Truth(frequency, 0.1, clock_ppm=-20.0, count=4016))
    assert common_clock(records, RATE_HZ).status == "inconsistent"


def test_no_usable_record_gives_no_clock() -> None:
    noise = 2e-3 * np.random.default_rng(10).standard_normal((2, COUNT))
    for records in ([], [(near(5e6), np.zeros(COUNT))], [(near(5e6), noise[0]), (near(30e6), noise[1])]):
        clock = common_clock(records, RATE_HZ)
        assert (clock.status, clock.ppm, clock.standard_uncertainty_ppm) == ("not_measurable", 0.0, math.inf)


def test_records_of_noise_do_not_disturb_the_clock() -> None:
    rng = np.random.default_rng(12)
    records = sweep(-140.0, rng, 4016, 0.05)
    alone = common_clock(records, RATE_HZ)
    records += [(f, 2e-3 * rng.standard_normal(4016)) for f in default_frequencies(RATE_HZ, 4016, 120e6, 20)]
    together = common_clock(records, RATE_HZ)
    assert together.records == alone.records == 6
    assert together.ppm == pytest.approx(alone.ppm, abs=0.02 * alone.standard_uncertainty_ppm)


# ---- what other estimators make of the same records


def test_rms_and_peak_to_peak_are_biased_by_noise_and_the_fit_is_not() -> None:
    # Given 3 mVpp at a gain of 5.19 with 2 mV of noise
    frequency, amplitude = near(10e6), 1.5e-3 * 5.19
    plan, noise, rng = SinePlan(frequency, RATE_HZ, COUNT), filtered_noise(), np.random.default_rng(3)
    volts = [
        record(Truth(frequency, amplitude, rng.uniform(-3, 3)), 2e-3 * noise.draw(rng, COUNT), CODE_V)
        for _ in range(40)
    ]
    fitted = np.mean([plan.fit(one).amplitude.value for one in volts]) / amplitude - 1
    by_rms = np.mean([amplitude_from_rms(one) for one in volts]) / amplitude - 1
    by_peaks = np.mean([amplitude_from_peak_to_peak(one) for one in volts]) / amplitude - 1
    # Then the rms is too large by sigma^2 / A^2 = 6.6 % (12 bits add 0.3 %), the peaks by some 80 %
    assert by_rms == pytest.approx((2e-3**2 + CODE_V**2 / 12) / amplitude**2, rel=0.1)
    assert 0.5 < by_peaks < 1.2
    # and the fit within 5 standard deviations of its mean: 0.37 % for one record of white noise
    assert abs(fitted) < 5 * 0.0037 / math.sqrt(40)


def test_without_noise_all_estimators_agree() -> None:
    volts = record(Truth(near(3e6), 0.2))
    assert amplitude_from_rms(volts) == pytest.approx(0.2, rel=1e-9)
    assert amplitude_from_peak_to_peak(volts) == pytest.approx(0.2, rel=1e-6)
