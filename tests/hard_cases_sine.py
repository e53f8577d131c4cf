"""Hard cases of sine fits: frequencies without a phase, records too short, clocks that are off, codes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hard_cases_row import error_or_inf, worst
from sine_records import CODE_V, COUNT, RATE_HZ, Truth, filtered_noise, record

from procedures.coherent import coherent_frequency
from procedures.sine_fit import SinePlan
from procedures.sine_frequency import fit_four_parameters

BIN_HZ = RATE_HZ / COUNT
AMPLITUDE_V, NOISE_V = 30e-3, 2e-3


def near(frequency_hz: float) -> float:
    return coherent_frequency(frequency_hz, RATE_HZ, COUNT)


def columns_of(frequency_hz: float, rows: np.ndarray) -> np.ndarray:
    angle = 2 * np.pi * frequency_hz / RATE_HZ * rows
    return np.stack([np.cos(angle), np.sin(angle), np.ones(rows.size)], axis=1)


def plain_fit(volts: np.ndarray, frequency_hz: float) -> float:
    """Amplitude by three columns and least squares, without a second thought."""
    found = np.linalg.lstsq(columns_of(frequency_hz, np.arange(volts.size)), volts, rcond=None)[0]
    return math.hypot(found[0], found[1])


# ---- H21: a sample that is not a number


def missing_sample() -> float:
    """Relative, against the least squares of the other samples."""
    noise = NOISE_V * np.random.default_rng(1).standard_normal(COUNT)
    volts = record(Truth(near(10e6), AMPLITUDE_V, gain_mismatch=0.01), noise)
    with_hole = volts.copy()
    with_hole[[0, 77, 8000]] = np.nan
    fit = SinePlan(near(10e6), RATE_HZ, COUNT, interleaved=False).fit(with_hole)
    rows = np.flatnonzero(np.isfinite(with_hole))
    expected = np.linalg.lstsq(columns_of(near(10e6), rows), volts[rows], rcond=None)[0]
    assert fit.status == "masked"
    return abs(fit.amplitude.value / math.hypot(expected[0], expected[1]) - 1)


# ---- H23: frequencies without a phase


def frequencies_without_a_phase() -> float:
    """Fits that are not flagged though their columns have a condition above 1e3, or flagged below it."""
    number, wrong = np.arange(COUNT), 0
    for frequency in (RATE_HZ / 2, RATE_HZ, 1e-6 * BIN_HZ, RATE_HZ / 2 + 1e-4 * BIN_HZ, 3e6):
        angle = 2 * np.pi * ((frequency / RATE_HZ * (number - COUNT // 2)) % 1.0)
        columns = np.stack([np.cos(angle), np.sin(angle), np.ones(COUNT)])
        length = np.maximum(np.linalg.norm(columns, axis=1), 1e-6)
        size = np.linalg.svd(columns / length[:, None], compute_uv=False)
        # At fs/2 cos is (-1)^n and sin is zero; near 0 cos is 1.
        bad = bool(size[0] > 1e3 * size[-1])
        for phase in (0.0, 0.5, 1.5):
            volts = record(Truth(frequency, AMPLITUDE_V, phase))
            fit = SinePlan(frequency, RATE_HZ, COUNT, interleaved=False).fit(volts)
            wrong += (fit.status == "frequency_not_measurable") != bad
            assert math.isinf(fit.amplitude.standard_uncertainty) == bad
    return float(wrong)


def amplitudes_at_half_the_rate() -> float:
    """Unflagged amplitudes at f_s/2 that are wrong by more than a tenth: they follow the phase."""
    found = [
        plain_fit(record(Truth(RATE_HZ / 2, AMPLITUDE_V, phase)), RATE_HZ / 2) for phase in (0.5, 1.0, 1.5)
    ]
    return float(sum(abs(one / AMPLITUDE_V - 1) > 0.1 for one in found))


# ---- H24: less than a cycle in the record


def parts_of_a_cycle() -> float:
    """Error in the standard uncertainties that are told, which are the Cramer-Rao bound."""
    rng, errors = np.random.default_rng(3), []
    for cycles, status in ((1.0, "ok"), (0.5, "ok"), (0.25, "short_record"), (0.1, "short_record")):
        truth = Truth(cycles * BIN_HZ, AMPLITUDE_V, 0.7)
        columns = columns_of(cycles * BIN_HZ, np.arange(COUNT))
        along = np.array([math.cos(0.7), -math.sin(0.7), 0.0])
        bound = NOISE_V * math.sqrt(along @ np.linalg.inv(columns.T @ columns) @ along)
        for interleaved in (False, True):
            plan = SinePlan(truth.frequency_hz, RATE_HZ, COUNT, interleaved)
            fits = [plan.fit(record(truth, NOISE_V * rng.standard_normal(COUNT))) for _ in range(20)]
            assert {fit.status for fit in fits} == {status}
            told = np.array([fit.amplitude.standard_uncertainty for fit in fits])
            errors += list(np.abs([fit.amplitude.value - AMPLITUDE_V for fit in fits]) / told)
            # The claim is the bound of white noise where the linear estimate of it holds (errors below 1).
            assert bound > 0.1 * AMPLITUDE_V or np.median(told) == pytest.approx(bound, rel=0.25)
    for cycles in (0.001, 1e-6):
        noise = 1e-3 * rng.standard_normal(COUNT)
        fit = SinePlan(cycles * BIN_HZ, RATE_HZ, COUNT).fit(
            record(Truth(cycles * BIN_HZ, AMPLITUDE_V), noise)
        )
        assert fit.status == "frequency_not_measurable"
    return worst(*errors)


def uncertainty_of_whole_cycles() -> float:
    """sigma sqrt(2 / N), which holds for whole cycles, told for a tenth of one."""
    rng, truth = np.random.default_rng(3), Truth(0.1 * BIN_HZ, AMPLITUDE_V, 0.7)
    found = [plain_fit(record(truth, NOISE_V * rng.standard_normal(COUNT)), 0.1 * BIN_HZ) for _ in range(20)]
    return worst(*np.abs(np.array(found) - AMPLITUDE_V)) / (NOISE_V * math.sqrt(2 / COUNT))


# ---- H25: two converters that differ


def mismatch_near_a_quarter_of_the_rate() -> float:
    """Relative amplitude and gain mismatch, against the record's; on a quarter of the rate it is flagged."""
    errors = []
    for frequency in (20e6 + 0.05 * BIN_HZ, 20e6 + 0.3 * BIN_HZ, 40e6 - 0.2 * BIN_HZ, 60e6 + 0.3 * BIN_HZ):
        for phase in (0.0, 1.0, 2.0):
            truth = Truth(frequency, AMPLITUDE_V, phase, 1e-3, 0.01, 50e-12, 2e-3)
            fit = SinePlan(frequency, RATE_HZ, COUNT).fit(record(truth))
            assert fit.status in ("ok", "short_record")
            assert fit.gain_mismatch is not None
            errors += [abs(fit.amplitude.value / AMPLITUDE_V - 1), abs(fit.gain_mismatch.value - 0.01)]
    for quarter in (1, 2, 3, 4):
        volts = record(Truth(quarter * 20e6, AMPLITUDE_V, 0.4, gain_mismatch=0.01))
        assert SinePlan(quarter * 20e6, RATE_HZ, COUNT).fit(volts).status == "frequency_not_measurable"
    return worst(*errors)


def three_columns_for_two_converters() -> float:
    """The image of the mismatch lies on the sine: an error that follows the phase."""
    frequency = 20e6 + 0.05 * BIN_HZ
    return worst(
        *(
            abs(
                plain_fit(record(Truth(frequency, AMPLITUDE_V, phase, gain_mismatch=0.01)), frequency) / 0.03
                - 1
            )
            for phase in (0.0, 1.0, 2.0)
        )
    )


# ---- H26, H27: a frequency that is not known


def clock_that_is_off() -> float:
    """Relative amplitude of four parameters, against the record's."""
    frequency, errors = near(10e6), []
    for ppm in (1.0, 10.0, 50.0, 100.0, 250.0):
        volts = record(Truth(frequency, AMPLITUDE_V, clock_ppm=ppm))
        # Three parameters lose the sinc of the phase that drifts over the record.
        turns = frequency * COUNT / RATE_HZ * (1 - 1 / (1 + ppm * 1e-6))
        three = SinePlan(frequency, RATE_HZ, COUNT).fit(volts).amplitude.value / AMPLITUDE_V
        # (1 / N is what N samples differ from an integral by.)
        assert three == pytest.approx(float(np.sinc(turns)), abs=2 / COUNT)
        four = fit_four_parameters(volts, RATE_HZ, near_hz=frequency)
        errors.append(abs(four.amplitude.value / AMPLITUDE_V - 1))
    return worst(*errors)


def clock_that_is_believed() -> float:
    """Three parameters at the nominal frequency, 250 ppm off."""
    return abs(
        plain_fit(record(Truth(near(10e6), AMPLITUDE_V, clock_ppm=250.0)), near(10e6)) / AMPLITUDE_V - 1
    )


SHORT = 2008


def frequency_bound() -> float:
    return RATE_HZ / (2 * np.pi) * math.sqrt(24 * NOISE_V**2 / (AMPLITUDE_V**2 * SHORT**3))


def start_between_bins() -> float:
    """Spread of the frequency from 300 records over its Cramer-Rao bound."""
    rng, ratios = np.random.default_rng(6), []
    for off in (0.4, 0.8, 1.2):
        frequency = (201 + off) * RATE_HZ / SHORT
        errors = []
        for _ in range(300):
            truth = Truth(frequency, AMPLITUDE_V, rng.uniform(-3, 3), count=SHORT)
            fit = fit_four_parameters(record(truth, NOISE_V * rng.standard_normal(SHORT)), RATE_HZ)
            errors.append(fit.frequency.value - frequency)
        ratios.append(float(np.sqrt(np.mean(np.square(errors)))) / frequency_bound())
    # A nominal frequency two bins away is as good.
    truth = Truth(near(10e6), AMPLITUDE_V)
    fit = fit_four_parameters(record(truth), RATE_HZ, near_hz=truth.frequency_hz + 2 * BIN_HZ)
    assert fit.frequency.value == pytest.approx(truth.frequency_hz, rel=1e-12)
    return worst(*ratios)


def newton_from_a_bin_away() -> float:
    """Newton's steps from 1.2 bins away, with times from the first sample, end anywhere."""
    frequency = 202.2 * RATE_HZ / SHORT
    volts, trial = record(Truth(frequency, AMPLITUDE_V, count=SHORT)), 201 * RATE_HZ / SHORT
    time_s = np.arange(SHORT) / RATE_HZ
    for _ in range(20):
        columns = columns_of(trial, np.arange(SHORT))
        a, b, _ = np.linalg.lstsq(columns, volts, rcond=None)[0]
        drift = 2 * np.pi * time_s * (b * columns[:, 0] - a * columns[:, 1])
        every = np.column_stack([columns, drift])
        trial += np.linalg.lstsq(every, volts, rcond=None)[0][3]
    return abs(trial - frequency) / frequency_bound()


# ---- H28, H29, H30: codes, clips, and nothing


def sine_below_a_code() -> float:
    """Relative bias with 0.5 codes of noise, against the sine before rounding; flagged with less."""
    rng, noise, plan = np.random.default_rng(7), filtered_noise(), SinePlan(near(5e6), RATE_HZ, COUNT)
    biases = []
    for sigma, dithered in ((0.5, True), (0.3, False), (0.1, False)):
        for offset in (0.0, 0.25, 0.5):
            truth = Truth(near(5e6), 0.3 * CODE_V, 0.4, offset * CODE_V)
            fits = [
                plan.fit(
                    record(truth, sigma * CODE_V * noise.draw(rng, COUNT), CODE_V), volts_per_count=CODE_V
                )
                for _ in range(60 if dithered else 3)
            ]
            if dithered:
                # 60 records tell the mean to 0.3 %.
                assert {fit.status for fit in fits} == {"ok"}
                biases.append(abs(np.mean([fit.amplitude.value for fit in fits]) / truth.amplitude_v - 1))
            else:
                assert not any(fit.usable for fit in fits)
                assert {fit.status for fit in fits} <= {"below_dither", "no_signal"}
    return worst(*biases)


def sine_below_a_code_without_noise() -> float:
    """0 or 0.64 codes of amplitude, as the offset lies."""
    found = [
        plain_fit(record(Truth(near(5e6), 0.3 * CODE_V, 0.4, offset * CODE_V), code_v=CODE_V), near(5e6))
        for offset in (0.0, 0.5)
    ]
    return worst(*(abs(one / (0.3 * CODE_V) - 1) for one in found))


def clipped_sine() -> float:
    """Amplitudes that are given in spite of clipped samples."""
    given = []
    for clip in (0.8, 0.5):
        volts = record(Truth(near(5e6), 1.0), NOISE_V * np.random.default_rng(8).standard_normal(COUNT))
        clipped = np.clip(volts, -clip, clip)
        saturated = int(np.count_nonzero(np.abs(volts) > clip))
        fit = SinePlan(near(5e6), RATE_HZ, COUNT).fit(clipped, saturated=saturated)
        assert (fit.status, fit.usable) == ("clipped", False)
        assert math.isinf(fit.amplitude.standard_uncertainty)
        given.append(fit.amplitude.value)
    return worst(*given)


def clipped_sine_that_is_fitted() -> float:
    """An amplitude 39 % too small, without a flag."""
    found = plain_fit(np.clip(record(Truth(near(5e6), 1.0)), -0.5, 0.5), near(5e6))
    assert found < 0.65
    return found


def record_that_does_not_move() -> float:
    """Amplitude of records of zeros and of one value; it has no weight and no frequency."""
    given = []
    for volts in (np.zeros(COUNT), np.full(COUNT, 0.25)):
        for fit in (SinePlan(near(5e6), RATE_HZ, COUNT).fit(volts), fit_four_parameters(volts, RATE_HZ)):
            assert (fit.status, fit.usable) == ("no_signal", False)
            assert math.isinf(fit.amplitude.standard_uncertainty)
            given.append(abs(fit.amplitude.value))
        assert math.isinf(fit_four_parameters(volts, RATE_HZ).frequency.standard_uncertainty)
    return worst(*given)


def peak_of_an_empty_spectrum() -> float:
    """The logarithm of nothing for a start, and least squares that do not converge from there."""
    level = np.abs(np.fft.rfft(np.zeros(SHORT) * np.hanning(SHORT)))
    best = max(1, int(np.argmax(level)))
    with np.errstate(all="ignore"):
        below, here, above = np.log(level[best - 1 : best + 2])
        frequency = (best + (below - above) / (2 * (below - 2 * here + above))) * RATE_HZ / SHORT
    return error_or_inf(
        lambda: plain_fit(np.zeros(SHORT), frequency), np.linalg.LinAlgError, "SVD did not converge"
    )
