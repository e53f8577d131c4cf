"""Comparing windows with predicted pulses, part by part, beside dense matrices and simulated noise."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs
from numpy.typing import NDArray
from scipy import optimize

from belahil import butterworth
from belahil.config import (
    BenchConfig,
    EmulatedReceiver,
    GeneratorTable,
    GeneratorUncertainty,
    Interleave,
    simulated,
)
from belahil.errors import RefusedInput
from belahil.pole_response import SampledNoise, autocovariance
from belahil.receiver import BELA_GRM
from belahil.receiver_truth import receiver_truth
from belahil.stimuli import NoSignal, SampledPulse
from belahil.values import Estimate, RangeWindow, WindowRequest
from procedures.known_receiver import preset_receiver
from procedures.noise_covariance import FEWEST_TIMES, stretch_noise
from procedures.pulse_prediction import Path, known_path, uncertain_numbers
from procedures.pulse_shape_fit import ShapeFit, binned, fit_shape
from sim.draws import Draws
from sim.receiver_model import ReceiverModel

NS, INTERVAL_S = 1e-9, 12.5e-9
POLES = butterworth.poles(19e6, 3)
COUNT_V = 2.0 / 4096


def bell(sigma_ns: float = 12.0, peak_v: float = 5e-3, poles: tuple[complex, ...] = ()) -> SampledPulse:
    times = np.arange(-70.0, 71.0, 4.0)
    volts = peak_v * np.exp(-0.5 * (times / sigma_ns) ** 2)
    volts[[0, -1]] = 0.0
    return SampledPulse(volts, 250e6, 200 * NS, "linear", poles)


# ---- the prediction


@pytest.mark.parametrize("number", range(6))
def test_the_prediction_is_what_a_hidden_receiver_digitizes_without_noise(number: int) -> None:
    # given a receiver with a high-pass, a fast clock and two converters that differ
    rng = np.random.default_rng([7, number])
    truth = receiver_truth(
        structs.replace(
            simulated(),
            emulation=structs.replace(
                simulated().emulation,
                receiver=EmulatedReceiver(
                    cutoff_hz=rng.uniform(12e6, 25e6),
                    order=int(rng.integers(2, 5)),
                    highpass_hz=float(rng.choice([0.0, 30e3])),
                    noise_rms_v_by_code=(0.0,) * 16,
                    adc_bits=16,
                    adc_full_scale_v=0.2,
                    clock_ppm=rng.uniform(-50, 50),
                    interleave=Interleave(gain=rng.uniform(-0.02, 0.02), skew_s=rng.uniform(-1, 1) * 2e-10),
                ),
            ),
        )
    )
    model = ReceiverModel(truth, BELA_GRM.digitizer)
    pulse = bell(poles=(complex(-2 * math.pi * 30e6),))
    draws = Draws(number, 3)
    window = model.window(pulse, WindowRequest(3, 5, 42), draws)
    # when the same numbers are known
    known = replace(
        preset_receiver(simulated()),
        order=truth.order,
        cutoff=Estimate(truth.cutoff_hz, 1e5, "Hz"),
        highpass=Estimate(truth.highpass_hz, 1e3, "Hz") if truth.highpass_hz else None,
        clock_ppm=Estimate(truth.clock_ppm, 1.0),
        interleave_gain=Estimate(truth.interleave.gain, 1e-4),
        interleave_skew=Estimate(truth.interleave.skew_s, 1e-12, "s"),
    )
    path = known_path(known, 5)
    first_s = draws.uniform("sampling_phase") * path.interval_s
    volts = path.volts(pulse, np.array([first_s]), 42)[0]
    # then they predict every count to its rounding
    assert np.max(np.abs(window.volts - volts)) <= window.volts_per_count * (0.5 + 1e-6)
    assert np.ptp(window.counts) > 1000


def test_uncertain_numbers_join_what_is_declared_and_leave_out_what_is_certain() -> None:
    # given a receiver whose gain is known to 0.3 %, and a generator with an attenuator
    known = replace(
        preset_receiver(simulated()),
        cutoff=Estimate(19e6, 0.0, "Hz"),
        interleave_skew=Estimate(0.0, 2e-12, "s"),
    )
    known = replace(known, codes=tuple(replace(one, gain=Estimate(5.0, 0.015)) for one in known.codes))
    declared = GeneratorUncertainty(0.004, 1e-3, 0.0, 0.05, 0.02)
    config = BenchConfig(generator=GeneratorTable(bandwidth_hz=30e6, uncertainty=declared))
    # when they are asked for, at a setting of 200 mVpp
    found = uncertain_numbers(known, 4, config, 0.2)
    # then gain, amplitude and attenuation are one number, and the cut-off none
    parts = (0.003, 0.004, 1e-3 / 0.2, 0.05 * math.log(10) / 20)
    assert found["gain"] == pytest.approx(5.0 * math.hypot(*parts), rel=1e-12)
    assert found["output"] == 0.02
    assert found.keys() == {"gain", "output", "interleave_skew_s"}
    # and without a declared bandwidth its uncertainty says nothing
    assert "output" not in uncertain_numbers(known, 4, BenchConfig(), 0.2)


# ---- the noise


def silent(count: int, length: int, rms_v: float, seed: int, offset_v: float = 0.0) -> list[RangeWindow]:
    """Silent windows of the model with these parameters."""
    config = simulated()
    receiver = EmulatedReceiver(noise_rms_v_by_code=(rms_v,) * 16, interleave=Interleave(offset_v=offset_v))
    emulation = structs.replace(config.emulation, receiver=receiver)
    model = ReceiverModel(receiver_truth(structs.replace(config, emulation=emulation)), BELA_GRM.digitizer)
    return [
        model.window(NoSignal(), WindowRequest(shot, 4, length), Draws(seed, shot)) for shot in range(count)
    ]


@pytest.mark.parametrize(
    ("rms_v", "offset_v", "seed"), [(0.83e-3, 0.0, 1), (2e-3, 3e-3, 2), (0.4e-3, -1e-3, 3)]
)
def test_the_covariance_is_that_of_the_filter_and_of_rounding(
    rms_v: float, offset_v: float, seed: int
) -> None:
    # given silent windows of coloured noise, with converters of different offsets
    windows = silent(16, 16064, rms_v, seed, offset_v)
    # when the noise of a stretch is measured
    noise = stretch_noise(windows, 42, 2)
    # then every lag is that of white noise behind the filter, and lag 0 has the variance of rounding too; a
    # lag of N products of Gaussians is uncertain by sqrt(2 sum(rho^2) / N) of the variance at most (Bartlett)
    lags = autocovariance(POLES, np.arange(42) * INTERVAL_S)
    expected = rms_v**2 * lags / lags[0]
    expected[0] += COUNT_V**2 / 12
    u_v2 = rms_v**2 * math.sqrt(2 * (1 + 2 * np.sum((lags[1:] / lags[0]) ** 2)) / (16 * 16064))
    assert noise.status == "ok"
    assert np.max(np.abs(noise.covariance[0] - expected)) < 5 * u_v2 + 0.02 * COUNT_V**2 / 12
    assert noise.offset_v[0] - noise.offset_v[1] == pytest.approx(offset_v, abs=1e-5)
    # and white is what it makes of it
    white = noise.whitener()
    assert np.allclose(white @ noise.covariance @ white.T, np.eye(42), atol=1e-9)


@pytest.mark.parametrize(
    ("windows", "status"),
    [
        (silent(4, 16064, 0.0, 1), "noise_no_signal"),
        (silent(4, 16064, 0.05e-3, 1, 0.24e-3), "noise_below_dither"),
        (silent(1, 42 * FEWEST_TIMES - 1, 0.83e-3, 1), "too_few_samples"),
        ([], "too_few_samples"),
        ([replace(one, saturated=3) for one in silent(2, 4000, 0.83e-3, 1)], "noise_clipped"),
        (silent(90, 41, 0.83e-3, 1), "too_few_samples"),
    ],
)
def test_noise_that_tells_no_covariance_has_a_status(windows: list[RangeWindow], status: str) -> None:
    assert stretch_noise(windows, 42, 2).status == status


def test_silent_windows_of_two_scales_are_refused() -> None:
    one, other = silent(2, 4000, 0.83e-3, 1)
    with pytest.raises(RefusedInput, match="2 different scales"):
        stretch_noise([one, replace(other, gain_code=5)], 42, 2)


# ---- the fit


PATH = Path(gain=5.19, order=3, cutoff_hz=19e6)
UNCERTAIN = {"gain": 0.03, "cutoff_hz": 2e5, "interleave_skew_s": 1e-11}


def measured(
    count: int, seed: int, path: Path = PATH, rms_v: float = 0.8e-3
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Windows with noise as the filter colours it, where they are expected, and the whitener."""
    rng = np.random.default_rng(seed)
    noise = SampledNoise(POLES, 0, INTERVAL_S)
    first_s = 20 * NS + INTERVAL_S * rng.random(count)
    volts = path.volts(bell(), first_s, 42)
    volts += rms_v * np.stack([noise.draw(rng, 42) for _ in range(count)])
    lags = autocovariance(POLES, np.arange(42) * INTERVAL_S)
    covariance = rms_v**2 * (lags / lags[0])[np.abs(np.subtract.outer(np.arange(42), np.arange(42)))]
    whitener = np.linalg.inv(np.linalg.cholesky(covariance))
    return volts, np.full(count, 20 * NS + INTERVAL_S / 2), whitener


def fitted(
    volts: NDArray[np.float64], expected_s: NDArray[np.float64], white: NDArray[np.float64]
) -> ShapeFit:
    return fit_shape(PATH, UNCERTAIN, [bell()] * volts.shape[0], volts, expected_s, white)


@pytest.mark.parametrize("seed", range(3))
def test_the_delays_are_those_of_a_brute_search(seed: int) -> None:
    # given some windows
    volts, expected_s, white = measured(5, seed)
    # when they are placed
    fit = fitted(volts, expected_s, white)
    # then no other delay within half a sample fits better, by a search that knows no derivative
    total = 0.0
    for row in range(5):

        def chi_square(late_s: float, row: int = row) -> float:
            left = volts[row] - PATH.volts(bell(), expected_s[row : row + 1] + late_s, 42)[0]
            return float(np.sum((white @ left) ** 2))

        grid = np.arange(-100.0, 100.0, 0.5) * NS
        best = grid[int(np.argmin([chi_square(one) for one in grid]))]
        found = optimize.minimize_scalar(
            chi_square, bounds=(best - NS, best + NS), method="bounded", options={"xatol": 1e-14}
        )
        assert fit.late_s[row] == pytest.approx(found.x, abs=2e-12)
        total += found.fun
    assert fit.chi_square == pytest.approx(total, rel=1e-5)
    assert fit.freedom == 5 * 41
    assert fit.placement.within.all()


@pytest.mark.parametrize("seed", range(3))
def test_moved_numbers_and_free_curve_are_those_of_dense_matrices(seed: int) -> None:
    # given windows of a receiver whose gain and cut-off are not as they are known
    other = replace(PATH, gain=5.22, cutoff_hz=19.3e6)
    volts, expected_s, white = measured(4, 10 + seed, other)
    fit = fitted(volts, expected_s, white)
    # when the same is done with one covariance of all samples, to which each unknown delay adds without bound
    # and each uncertain number its variance
    size = volts.size
    dense = np.zeros((size, size))
    left = np.zeros(size)
    columns = np.zeros((size, 3))
    curve = np.zeros((size, 46))
    start = fit.placement.first_s.min()
    for row in range(4):
        part = slice(42 * row, 42 * row + 42)
        dense[part, part] = np.linalg.inv(white.T @ white)
        at = fit.placement.first_s[row : row + 1]
        slope = (PATH.volts(bell(), at + 1e-12, 42) - PATH.volts(bell(), at - 1e-12, 42))[0] / 2e-12
        dense[part, part] += 1e-6**2 * np.outer(slope, slope)  # a microsecond: as good as unknown
        left[part] = volts[row] - PATH.volts(bell(), at, 42)[0]
        columns[part] = PATH.derivatives(bell(), at, 42, UNCERTAIN)[:, 0].T
        for sample in range(42):
            place = (at[0] - start) / INTERVAL_S + sample
            curve[42 * row + sample, int(place)] = 1 - place % 1
            curve[42 * row + sample, int(place) + 1] = place % 1
    whole = dense + columns @ columns.T
    # then chi-square, its minimum over the numbers, their pulls, and the gain of the curve are the same
    assert fit.chi_square == pytest.approx(left @ np.linalg.solve(dense, left), rel=1e-4)
    assert fit.adjusted == pytest.approx(left @ np.linalg.solve(whole, left), rel=1e-4)
    pulls = columns.T @ np.linalg.solve(whole, left)
    assert list(fit.pulls.values()) == pytest.approx(pulls.tolist(), abs=1e-3)
    inverse = np.linalg.inv(whole)
    used = curve[:, np.any(curve, axis=0)]
    information = used.T @ inverse @ used
    pushed = used.T @ inverse @ left
    assert fit.shape == pytest.approx(pushed @ np.linalg.pinv(information, rcond=1e-9) @ pushed, rel=1e-3)


def test_the_three_tests_have_the_laws_that_they_claim() -> None:
    # given 60 sets of windows whose prediction is true
    fits = [fitted(*measured(20, 100 + seed)) for seed in range(60)]
    # then the level has its degrees of freedom, and so has the free curve, to five standard errors
    freedom = fits[0].freedom
    level = np.mean([one.chi_square for one in fits])
    assert abs(level - freedom) < 5 * math.sqrt(2 * freedom / 60)
    shapes = np.array([one.shape for one in fits])
    curve = np.mean([one.shape_freedom for one in fits])
    assert abs(shapes.mean() - curve) < 5 * math.sqrt(2 * curve / 60)
    assert 0.6 < shapes.var(ddof=1) / (2 * curve) < 1.6  # five standard errors of a variance of 60
    # and no number moves by more than its uncertainty allows
    pulls = np.array([[*one.pulls.values()] for one in fits])
    assert np.all(pulls.var(axis=0) < 1.0)


def faint(count: int, seed: int, peak_v: float) -> tuple[SampledPulse, ShapeFit]:
    """Windows of a pulse that hides in their noise, fitted."""
    rng = np.random.default_rng(seed)
    noise = SampledNoise(POLES, 0, INTERVAL_S)
    pulse = SampledPulse(bell().volts * (peak_v / 5e-3), 250e6, bell().start_s)
    _, expected_s, white = measured(count, seed)
    volts = PATH.volts(pulse, 20 * NS + INTERVAL_S * rng.random(count), 42)
    volts += 0.8e-3 * np.stack([noise.draw(rng, 42) for _ in range(count)])
    return pulse, fit_shape(PATH, UNCERTAIN, [pulse] * count, volts, expected_s, white)


@pytest.mark.parametrize(
    "peak_v",
    [0.2e-3, pytest.param(0.5e-3, marks=pytest.mark.slow), pytest.param(0.9e-3, marks=pytest.mark.slow)],
)
def test_pulses_that_hide_in_the_noise_are_judged_with_delays_about_a_common_one(peak_v: float) -> None:
    # given 24 sets of windows with a pulse that no single window shows
    fits = [faint(100, 300 + seed, peak_v)[1] for seed in range(24)]
    assert not any(one.placement.is_free for one in fits)
    # then the level has its degrees of freedom to five standard errors
    freedom = 100 * 42 - 1
    assert {one.freedom for one in fits} == {freedom}
    level = np.mean([one.chi_square for one in fits])
    assert abs(level - freedom) < 5 * math.sqrt(2 * freedom / 24)
    # and so has the free curve, with a twentieth of its width for what is not linear in the delays
    shapes = np.array([one.shape for one in fits])
    curve = np.mean([one.shape_freedom for one in fits])
    assert abs(shapes.mean() - curve) < 5 * math.sqrt(2 * curve / 24) + 0.05 * math.sqrt(2 * curve)
    # and the common delay is right to what all windows tell
    common = np.array([one.placement.common_s[0] - (20 * NS + INTERVAL_S / 2) for one in fits])
    assert abs(common.mean()) < 5 * common.std(ddof=1) / math.sqrt(24) + 0.1 * NS
    assert common.std() < INTERVAL_S / 4


def test_delays_about_a_common_one_are_those_of_a_dense_covariance() -> None:
    # given four windows of a faint pulse
    pulse, fit = faint(4, 7, 0.4e-3)
    place = fit.placement
    white = measured(1, 7)[2]
    # when the spread of the delays is put into one covariance, about the common delay, instead of the windows
    total = 0.0
    for row in range(4):
        at = place.common_s[row : row + 1]
        slope = (PATH.volts(pulse, at + 1e-12, 42) - PATH.volts(pulse, at - 1e-12, 42))[0] / 2e-12
        dense = np.linalg.inv(white.T @ white) + INTERVAL_S**2 / 12 * np.outer(slope, slope)
        left = place.predicted_v[row] + fit.residual_v[row] - PATH.volts(pulse, at, 42)[0]
        total += float(left @ np.linalg.solve(dense, left))
    # then chi-square is the same to what is not linear in the delays
    assert fit.chi_square == pytest.approx(total, rel=2e-3)


def test_each_test_sees_what_it_is_for() -> None:
    white = measured(1, 1)[2]
    # given more noise than was measured, another receiver, and an echo of the cable 60 ns behind the pulse
    loud = fitted(*measured(100, 1, rms_v=0.8e-3 * 1.1)[:2], white)
    wide = fitted(*measured(100, 2, replace(PATH, cutoff_hz=21e6)))
    volts, expected_s, _ = measured(100, 3)
    again = SampledPulse(0.04 * bell().volts, 250e6, bell().start_s + 60 * NS)
    volts += PATH.volts(again, expected_s, 42)
    cable = fitted(volts, expected_s, white)
    # then the level sees the first, the numbers the second, and the curve the third, which the level misses
    u = math.sqrt(2 / loud.freedom)
    assert loud.adjusted / loud.freedom - 1 > 5 * u
    assert abs(wide.pulls["cutoff_hz"]) > 5
    assert cable.shape > cable.shape_freedom + 5 * math.sqrt(2 * cable.shape_freedom)
    assert cable.adjusted / cable.freedom - 1 < 5 * u


def test_means_by_place_are_those_of_a_loop() -> None:
    rng = np.random.default_rng(4)
    places, values = rng.uniform(0, 10, (6, 20)), rng.normal(size=(6, 20))
    found = binned(places, values, 1.0)
    low = places.min()
    for middle, mean, u in zip(found.places, found.means, found.uncertainties, strict=True):
        inside = values[np.floor(places - low) == round(middle - low - 0.5)]
        assert mean == pytest.approx(inside.mean(), abs=1e-12)
        assert u == pytest.approx(inside.std(ddof=1) / math.sqrt(inside.size), abs=1e-12)
