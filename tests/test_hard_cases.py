from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hard_cases import HARD_CASES
from sine_records import CODE_V, COUNT, RATE_HZ, Truth, filtered_noise, record

from belahil.butterworth import magnitude
from procedures.butterworth_fit import fit_filter
from procedures.coherent import coherent_frequency, default_frequencies
from procedures.sine_fit import SinePlan
from procedures.sine_frequency import fit_four_parameters

Check = Callable[[float], None]
CLAIMS: dict[str, list[Check]] = {}
BIN_HZ = RATE_HZ / COUNT


def claims(name: str) -> Callable[[Check], Check]:
    """Let a function be the run of a row; it gets the row's limit."""

    def keep(check: Check) -> Check:
        CLAIMS.setdefault(name, []).append(check)
        return check

    return keep


def near(frequency_hz: float) -> float:
    return coherent_frequency(frequency_hz, RATE_HZ, COUNT)


@claims("H21")
def a_missing_sample(limit: float) -> None:
    volts = record(
        Truth(near(10e6), 0.03, gain_mismatch=0.01), 2e-3 * np.random.default_rng(1).standard_normal(COUNT)
    )
    with_hole = volts.copy()
    with_hole[[0, 77, 8000]] = np.nan
    fit = SinePlan(near(10e6), RATE_HZ, COUNT, interleaved=False).fit(with_hole)
    rows = np.isfinite(with_hole)
    angle = 2 * np.pi * near(10e6) / RATE_HZ * np.arange(COUNT)[rows]
    columns = np.stack([np.cos(angle), np.sin(angle), np.ones(angle.size)], axis=1)
    expected = np.linalg.lstsq(columns, volts[rows], rcond=None)[0]
    assert fit.status == "masked"
    assert abs(fit.amplitude.value / math.hypot(expected[0], expected[1]) - 1) < limit


@claims("H23")
def frequencies_without_a_phase(limit: float) -> None:
    number = np.arange(COUNT)
    for frequency in (RATE_HZ / 2, RATE_HZ, 1e-6 * BIN_HZ, RATE_HZ / 2 + 1e-4 * BIN_HZ, 3e6):
        angle = 2 * np.pi * ((frequency / RATE_HZ * (number - COUNT // 2)) % 1.0)
        columns = np.stack([np.cos(angle), np.sin(angle), np.ones(COUNT)])
        length = np.maximum(np.linalg.norm(columns, axis=1), 1e-6)
        size = np.linalg.svd(columns / length[:, None], compute_uv=False)
        # At fs/2 cos is (-1)^n and sin is zero; near 0 cos is 1.
        bad = size[0] > limit * size[-1]
        for phase in (0.0, 0.5, 1.5):
            fit = SinePlan(frequency, RATE_HZ, COUNT, interleaved=False).fit(
                record(Truth(frequency, 0.03, phase))
            )
            assert (fit.status == "frequency_not_measurable") == bad
            assert math.isinf(fit.amplitude.standard_uncertainty) == bad


@claims("H24")
def parts_of_a_cycle(limit: float) -> None:
    rng = np.random.default_rng(3)
    for cycles, status in ((1.0, "ok"), (0.5, "ok"), (0.25, "short_record"), (0.1, "short_record")):
        truth = Truth(cycles * BIN_HZ, 30e-3, 0.7)
        angle = 2 * np.pi * cycles / COUNT * np.arange(COUNT)
        columns = np.stack([np.cos(angle), np.sin(angle), np.ones(COUNT)])
        inverse = np.linalg.inv(columns @ columns.T)
        along = np.array([math.cos(0.7), -math.sin(0.7), 0.0])
        bound = 2e-3 * math.sqrt(along @ inverse @ along)
        for interleaved in (False, True):
            plan = SinePlan(truth.frequency_hz, RATE_HZ, COUNT, interleaved)
            fits = [plan.fit(record(truth, 2e-3 * rng.standard_normal(COUNT))) for _ in range(20)]
            assert {fit.status for fit in fits} == {status}
            for fit in fits:
                assert abs(fit.amplitude.value - 30e-3) < limit * fit.amplitude.standard_uncertainty
            # The claim is the bound of white noise where the linear estimate of it holds (errors below 1).
            claimed = np.median([fit.amplitude.standard_uncertainty for fit in fits])
            assert bound > 0.1 * 30e-3 or claimed == pytest.approx(bound, rel=0.25)
    for cycles in (0.001, 1e-6):
        fit = SinePlan(cycles * BIN_HZ, RATE_HZ, COUNT).fit(
            record(Truth(cycles * BIN_HZ, 30e-3), 1e-3 * rng.standard_normal(COUNT))
        )
        assert fit.status == "frequency_not_measurable"


@claims("H25")
def mismatch_near_a_quarter_of_the_rate(limit: float) -> None:
    for frequency in (20e6 + 0.05 * BIN_HZ, 20e6 + 0.3 * BIN_HZ, 40e6 - 0.2 * BIN_HZ, 60e6 + 0.3 * BIN_HZ):
        for phase in (0.0, 1.0, 2.0):
            truth = Truth(frequency, 0.03, phase, 1e-3, 0.01, 50e-12, 2e-3)
            fit = SinePlan(frequency, RATE_HZ, COUNT).fit(record(truth))
            assert fit.status in ("ok", "short_record")
            assert abs(fit.amplitude.value / 0.03 - 1) < limit
            assert fit.gain_mismatch is not None
            assert abs(fit.gain_mismatch.value - 0.01) < limit
    for quarter in (1, 2, 3, 4):
        volts = record(Truth(quarter * 20e6, 0.03, 0.4, gain_mismatch=0.01))
        assert SinePlan(quarter * 20e6, RATE_HZ, COUNT).fit(volts).status == "frequency_not_measurable"


@claims("H26")
def a_clock_that_is_off(limit: float) -> None:
    frequency = near(10e6)
    for ppm in (1.0, 10.0, 50.0, 100.0, 250.0):
        volts = record(Truth(frequency, 0.03, clock_ppm=ppm))
        # Three parameters lose the sinc of the phase that drifts over the record.
        turns = frequency * COUNT / RATE_HZ * (1 - 1 / (1 + ppm * 1e-6))
        three = SinePlan(frequency, RATE_HZ, COUNT).fit(volts).amplitude.value / 0.03
        # (1 / N is what N samples differ from an integral by.)
        assert three == pytest.approx(float(np.sinc(turns)), abs=2 / COUNT)
        four = fit_four_parameters(volts, RATE_HZ, near_hz=frequency)
        assert abs(four.amplitude.value / 0.03 - 1) < limit


@claims("H27")
def a_start_between_bins(limit: float) -> None:
    rng, count = np.random.default_rng(6), 2008
    for off in (0.4, 0.8, 1.2):
        frequency = (201 + off) * RATE_HZ / count
        errors = []
        for _ in range(300):
            truth = Truth(frequency, 30e-3, rng.uniform(-3, 3), count=count)
            fit = fit_four_parameters(record(truth, 2e-3 * rng.standard_normal(count)), RATE_HZ)
            errors.append(fit.frequency.value - frequency)
        bound = RATE_HZ / (2 * np.pi) * math.sqrt(24 * 2e-3**2 / (30e-3**2 * count**3))
        assert np.sqrt(np.mean(np.square(errors))) < limit * bound
    # A nominal frequency two bins away is as good.
    truth = Truth(near(10e6), 30e-3)
    fit = fit_four_parameters(record(truth), RATE_HZ, near_hz=truth.frequency_hz + 2 * BIN_HZ)
    assert fit.frequency.value == pytest.approx(truth.frequency_hz, rel=1e-12)


@claims("H28")
def a_sine_below_a_code(limit: float) -> None:
    rng, noise, plan = np.random.default_rng(7), filtered_noise(), SinePlan(near(5e6), RATE_HZ, COUNT)
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
                assert abs(np.mean([fit.amplitude.value for fit in fits]) / truth.amplitude_v - 1) < limit
            else:
                assert not any(fit.usable for fit in fits)
                assert {fit.status for fit in fits} <= {"below_dither", "no_signal"}


@claims("H29")
def a_clipped_sine(limit: float) -> None:
    for clip in (0.8, 0.5):
        volts = record(Truth(near(5e6), 1.0), 2e-3 * np.random.default_rng(8).standard_normal(COUNT))
        clipped = np.clip(volts, -clip, clip)
        plan = SinePlan(near(5e6), RATE_HZ, COUNT)
        unflagged = plan.fit(clipped).amplitude.value
        assert unflagged < 1 - 0.1  # what the flag is for
        fit = plan.fit(clipped, saturated=int(np.count_nonzero(np.abs(volts) > clip)))
        assert (fit.status, fit.usable) == ("clipped", False)
        assert fit.amplitude.value == limit
        assert math.isinf(fit.amplitude.standard_uncertainty)


@claims("H30")
def a_record_that_does_not_move(limit: float) -> None:
    for volts in (np.zeros(COUNT), np.full(COUNT, 0.25)):
        for fit in (SinePlan(near(5e6), RATE_HZ, COUNT).fit(volts), fit_four_parameters(volts, RATE_HZ)):
            assert (fit.status, fit.usable) == ("no_signal", False)
            assert fit.amplitude.value == limit
            assert math.isinf(fit.amplitude.standard_uncertainty)
        assert math.isinf(fit_four_parameters(volts, RATE_HZ).frequency.standard_uncertainty)


def gains_of_a_sweep(
    rng: np.random.Generator, frequency: np.ndarray, vpp: float
) -> tuple[np.ndarray, np.ndarray]:
    """Gains as sines in 2 mV of white noise give them, with their uncertainty."""
    u = np.full(frequency.size, 2e-3 * math.sqrt(2 / COUNT) / (vpp / 2))
    return 5.19 * magnitude(frequency, 19e6, 3) + u * rng.standard_normal(frequency.size), u


def filter_bound(frequency: np.ndarray, vpp: float) -> float:
    """Cramer-Rao bound of the cut-off with gain unknown and order known, Hz."""
    step = 1e3
    slope = 5.19 * (magnitude(frequency, 19e6 + step, 3) - magnitude(frequency, 19e6 - step, 3)) / (2 * step)
    rows = np.stack([magnitude(frequency, 19e6, 3), slope]) / (2e-3 * math.sqrt(2 / COUNT) / (vpp / 2))
    return float(np.sqrt(np.linalg.inv(rows @ rows.T)[1, 1]))


@claims("H31")
def a_sweep_that_ends_early(limit: float) -> None:
    rng = np.random.default_rng(10)
    short = np.linspace(1e6, 5e6, 20)
    for _ in range(10):
        assert (
            fit_filter(short, *gains_of_a_sweep(rng, short, 50e-3)).integer.status == "cutoff_not_identified"
        )
    # Up to 10 MHz, with the order known, the claim is the bound. (A span of 10 leaves the high-pass out.)
    longer = np.linspace(1e6, 10e6, 20)
    claimed = []
    for _ in range(10):
        fits = fit_filter(longer, *gains_of_a_sweep(rng, longer, 200e-3))
        assert fits.integer.status == "ok"
        if fits.integer.order == 3:
            claimed.append(fits.integer.cutoff_u_hz)
    assert len(claimed) >= 5
    assert abs(np.mean(claimed) / filter_bound(longer, 200e-3) - 1) < limit


@claims("H32")
def no_starting_value(limit: float) -> None:
    rng = np.random.default_rng(11)
    # A span of 19 leaves the high-pass out of the model, as the reference does.
    frequency = np.geomspace(2e6, 38e6, 24)
    for cutoff in (1e6, 5e6, 19e6, 45e6):
        shape = 7.0 * magnitude(frequency, cutoff, 3)
        u = np.full(frequency.size, 1e-4)
        gains = shape + u * rng.standard_normal(frequency.size)

        def misfit(log_cutoff: float, gains: np.ndarray = gains) -> float:
            trial = magnitude(frequency, math.exp(log_cutoff), 3)
            return float(np.sum((gains - trial * (gains @ trial) / (trial @ trial)) ** 2))

        grid = np.linspace(math.log(1e5), math.log(1e9), 20_001)
        best = int(np.argmin([misfit(one) for one in grid]))
        low, high = grid[best - 1], grid[best + 1]
        golden = (math.sqrt(5) - 1) / 2
        for _ in range(60):
            left, right = high - golden * (high - low), low + golden * (high - low)
            low, high = (low, right) if misfit(left) < misfit(right) else (left, high)
        fits = fit_filter(frequency, gains, u)
        assert fits.integer.order == 3
        # A minimum of a sum of squares is known to the root of its rounding error.
        assert abs(fits.integer.cutoff_hz / math.exp((low + high) / 2) - 1) < limit


@claims("H33")
def outliers(limit: float) -> None:
    rng = np.random.default_rng(12)
    frequency = np.array(default_frequencies(RATE_HZ, COUNT, 38e6, 20))
    for wrong in ([3], [14], [5, 12], [9, 18]):
        gains, u = gains_of_a_sweep(rng, frequency, 50e-3)
        gains[wrong] *= 0.8
        robust = fit_filter(frequency, gains, u, "soft_l1").integer
        plain = fit_filter(frequency, gains, u).integer
        assert robust.order == 3
        assert abs(robust.cutoff_hz - 19e6) < limit
        assert abs(plain.cutoff_hz - 19e6) > limit or plain.order != 3  # what the robust loss is for


@claims("H34")
def the_order(limit: float) -> None:
    rng = np.random.default_rng(13)
    whole = np.array(default_frequencies(RATE_HZ, COUNT, 38e6, 20))
    early = whole[whole < 10e6]
    for vpp in (3e-3, 13e-3):
        fits = fit_filter(whole, *gains_of_a_sweep(rng, whole, vpp))
        assert fits.integer.order == 3
        assert abs(fits.free.order - 3) < limit * fits.free.order_u
        assert set(fits.chi_square_by_order) == {1, 2, 3, 4, 5, 6}
        others = [chi for order, chi in fits.chi_square_by_order.items() if order != 3]
        assert min(others) > fits.chi_square_by_order[3] + 100
    # A sweep that ends early fits other orders nearly as well, and the free order says how little it knows.
    fits = fit_filter(early, *gains_of_a_sweep(rng, early, 13e-3))
    assert fits.free.status != "ok" or abs(fits.free.order - 3) < limit * fits.free.order_u


@pytest.mark.parametrize("name", sorted(HARD_CASES))
def test_hard_case(name: str) -> None:
    assert name in CLAIMS, f"nothing claims {name}: {HARD_CASES[name].case}"
    for check in CLAIMS[name]:
        check(HARD_CASES[name].limit)


def test_every_claim_is_a_row() -> None:
    assert set(CLAIMS) <= set(HARD_CASES)
