"""The likelihood of windows with an amplitude and an arrival of their own, beside a slow and obvious one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from tx_truths import INTERVAL_S, NOISE_V, STEP_V, Truth, receiver

from belahil.errors import RefusedInput
from belahil.pulse_bound import filtered_noise_covariance
from belahil.values import Estimate
from procedures.known_receiver import KnownReceiver
from procedures.tx_families import fit_families, fit_hard, interval
from procedures.tx_likelihood import PulseLikelihood, whitener
from procedures.tx_pulse import KnownPulse, tailed_pulse
from procedures.tx_response import CutResponses
from procedures.tx_terms import threshold_bound
from procedures.tx_windows import PulseWindows, read_pulses


def windows(truth: Truth, number: int, seed: int, told: KnownReceiver | None = None) -> PulseWindows:
    known = told or receiver(truth.cutoff_hz, highpass_hz=truth.highpass_hz)
    return read_pulses(truth.shots(number, seed), 12, INTERVAL_S, known, truth.pulse)


def responses(found: PulseWindows, truth: Truth, known: KnownReceiver) -> CutResponses:
    assert found.grid is not None
    return CutResponses(truth.pulse, known.poles, known.zeros, found.grid.times_s)


def slow_chi_square(
    volts: np.ndarray, before: int, truth: Truth, threshold: float, covariance: np.ndarray
) -> tuple[float, float]:
    """Least chi-square of one window over amplitude and arrival, every response in closed form anew."""
    inverse = np.linalg.inv(covariance)
    poles = receiver(truth.cutoff_hz).poles

    def left(arrival: np.ndarray) -> float:
        times_s = (np.arange(volts.size) - before - arrival[0]) * INTERVAL_S
        shape = CutResponses(truth.pulse, poles, 0, times_s).exact(threshold)
        amplitude = shape @ inverse @ volts / (shape @ inverse @ shape)
        rest = volts - amplitude * shape
        return float(rest @ inverse @ rest)

    starts = [minimize(left, [start], method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-9})
              for start in (0.2, 0.8)]  # fmt: skip
    best = min(starts, key=lambda one: one.fun)
    return float(best.fun), float(best.x[0])


@pytest.mark.parametrize(("cutoff_hz", "tail_s", "threshold"), [(19e6, 3e-9, 0.17), (25e6, 12e-9, 0.3)])
def test_windows_are_fitted_as_by_a_slow_search(cutoff_hz: float, tail_s: float, threshold: float) -> None:
    # Given six windows and the covariance of their noise by another module
    truth = Truth(tailed_pulse(5.4e-9, tail_s), threshold, cutoff_hz=cutoff_hz)
    found, known = windows(truth, 6, 1), receiver(cutoff_hz)
    ready = found.likelihood(known, "common")
    covariance = filtered_noise_covariance(
        known.poles, 0, INTERVAL_S, found.segments_v.shape[1], found.noise_rms_v, STEP_V / np.sqrt(12)
    )
    fits = ready.fit(responses(found, truth, known).exact(threshold))
    for row, volts in enumerate(found.segments_v):
        slow, arrival = slow_chi_square(volts, found.grid.before, truth, threshold, covariance)  # type: ignore[union-attr]
        whole = volts @ np.linalg.solve(covariance, volts)
        # Then polynomials over 5 arrivals of 0.4 ns leave 3e-7 of it; noise would change it by 1
        assert whole - fits.explained[row] == pytest.approx(slow, abs=3e-7 * fits.explained[row])
        assert fits.arrival[row] == pytest.approx(arrival, abs=1e-5)


@pytest.mark.parametrize("baseline", ["common", "window"])
def test_whitened_noise_is_white(baseline: str) -> None:
    known = receiver(17e6)
    covariance = filtered_noise_covariance(known.poles, 0, INTERVAL_S, 24, NOISE_V, STEP_V / np.sqrt(12))
    found = whitener(known, 24, NOISE_V, STEP_V / np.sqrt(12), baseline)  # type: ignore[arg-type]
    turned = found @ covariance @ found.T
    if baseline == "common":
        np.testing.assert_allclose(turned, np.eye(24), atol=1e-10)
    else:
        # a constant is gone, and with it one dimension of noise
        assert np.abs(found @ np.ones(24)).max() < 1e-9 * np.abs(found).max()
        np.testing.assert_allclose(np.sort(np.linalg.eigvalsh(turned)), [0, *[1] * 23], atol=1e-9)


def test_windows_without_noise_have_no_likelihood() -> None:
    with pytest.raises(RefusedInput, match="without any noise"):
        whitener(receiver(), 24, 0.0, 0.0, "common")


@pytest.mark.parametrize("offsets_v", [(3e-3, -2e-3), (0.02, 0.02)])
def test_baselines_of_two_converters_do_not_move_the_threshold(offsets_v: tuple[float, float]) -> None:
    plain = Truth(tailed_pulse(5.4e-9, 8e-9), 0.22)
    lifted = replace(plain, baseline_v=offsets_v)
    thresholds = []
    for truth in (plain, lifted):
        found = windows(truth, 100, 5)
        ready = found.likelihood(receiver(), "common")
        thresholds.append(fit_hard(ready, responses(found, truth, receiver())).threshold)
    np.testing.assert_allclose(found.baseline_v, offsets_v, atol=1e-4)
    # offsets change which way each sample is rounded: a fraction of the noise of 0.4 points
    assert thresholds[0] == pytest.approx(thresholds[1], abs=2e-3)


def test_skew_and_gain_of_two_converters_are_taken_out() -> None:
    # Given windows whose odd and even samples have another gain and time
    truth = Truth(tailed_pulse(5.4e-9, 8e-9), 0.22, snr=400.0)
    skew_s, mismatch = 200e-12, 0.02
    rng, shots = np.random.default_rng(8), 60
    arrivals_s = rng.uniform(0, INTERVAL_S, shots)
    even, odd = (truth.clean(arrivals_s - side * skew_s / 2, 160, 40) for side in (1, -1))
    volts = np.where(np.arange(160) % 2, odd * (1 - mismatch / 2), even * (1 + mismatch / 2))
    from tx_truths import as_shots

    noisy = volts * truth.snr * NOISE_V + NOISE_V * rng.standard_normal(volts.shape)
    plain = receiver()
    known = replace(
        plain, interleave_gain=Estimate(mismatch, 0.0), interleave_skew=Estimate(skew_s, 0.0, "s")
    )
    left = []
    for told in (plain, known):
        found = read_pulses(as_shots(noisy), 12, INTERVAL_S, told, truth.pulse)
        ready = found.likelihood(told, "common")
        fits = ready.fit(responses(found, truth, told).exact(0.22))
        left.append(float(np.sum(ready.white**2) - fits.explained.sum()) / ready.white.size)
    # Then knowing them leaves the noise alone, white here and so not quite 1, and not knowing leaves more
    assert left[0] > 1.5 * left[1]


def test_a_longer_segment_does_not_change_what_is_known() -> None:
    truth = Truth(tailed_pulse(5.4e-9, 8e-9), 0.22)
    found = windows(truth, 50, 2)
    grid = found.grid
    assert grid is not None
    # from before the pulse begins to after the filter has forgotten it
    shape = responses(found, truth, receiver()).exact(0.0)
    ends = [shape[grid.places[32, place]] for place in (0, -1)]
    assert np.abs(ends).max() < 1e-3 * shape.max()


def test_the_interval_of_a_flat_likelihood_reaches_its_end() -> None:
    # Given three noisy windows of a pulse of which next to nothing is left
    truth = Truth(tailed_pulse(5.4e-9, 3e-9), 0.9, snr=10.0)
    found = windows(truth, 3, 4)
    ready, made = found.likelihood(receiver(), "common"), responses(found, truth, receiver())
    best = fit_hard(ready, made)
    low, high = interval(ready, made, best)
    assert high > 0.9
    assert low < 0.8
    assert threshold_bound(ready, made, best) > 0.05


@pytest.mark.parametrize(
    ("truth", "family"),
    [
        pytest.param(Truth(tailed_pulse(5.4e-9, 8e-9), 0.2), "hard_cut", marks=pytest.mark.slow),
        (Truth(tailed_pulse(5.4e-9, 8e-9), 0.25, width=0.4), "soft_cut"),
        (Truth(tailed_pulse(5.4e-9, 4.5e-9), 0.0), "shorter_tail"),
        pytest.param(Truth(tailed_pulse(5.4e-9, 8e-9), 0.0), "fractional_loss", marks=pytest.mark.slow),
    ],
)
def test_each_family_is_told_from_the_others(truth: Truth, family: str) -> None:
    # Given an analysis that knows a tail of 8 ns, and 400 windows at a signal-to-noise ratio of 100
    known, pulse = receiver(), KnownPulse(5.4e-9, 8e-9, 0.0, 0.0)
    shots = replace(truth, snr=100.0).shots(400, 11)
    found = read_pulses(shots, 12, INTERVAL_S, known, pulse.pulse())
    made = CutResponses(pulse.pulse(), known.poles, known.zeros, found.grid.times_s)  # type: ignore[union-attr]
    fits = fit_families(found.likelihood(known, "common"), pulse, known, made)
    best = min(fits.values(), key=lambda one: one.criterion)
    near = [one.family for one in fits.values() if one.criterion - best.criterion < 2.5]
    # Then it is the best, or equal to one that contains it
    assert family in near
    if family == "soft_cut":
        assert near == ["soft_cut"]
        assert best.threshold == pytest.approx(0.25, abs=0.02)
        assert best.width == pytest.approx(0.4, abs=0.05)
    if family == "shorter_tail":
        assert near == ["shorter_tail"]
        assert best.fall == pytest.approx(4.5 / 8, abs=0.01)
    if family == "fractional_loss":
        assert fits["hard_cut"].threshold == pytest.approx(0.0, abs=2e-3)


def test_a_window_more_is_information_more() -> None:
    truth = Truth(tailed_pulse(5.4e-9, 8e-9), 0.22)
    bounds = []
    for number in (50, 200):
        found = windows(truth, number, 3)
        ready, made = found.likelihood(receiver(), "common"), responses(found, truth, receiver())
        bounds.append(threshold_bound(ready, made, fit_hard(ready, made)))
    assert bounds[0] / bounds[1] == pytest.approx(2.0, rel=0.1)


def test_a_free_baseline_costs_information() -> None:
    truth = Truth(tailed_pulse(5.4e-9, 8e-9), 0.22)
    found = windows(truth, 100, 3)
    made = responses(found, truth, receiver())
    spent: list[float] = []
    for baseline in ("common", "window"):
        ready: PulseLikelihood = found.likelihood(receiver(), baseline)  # type: ignore[arg-type]
        spent.append(threshold_bound(ready, made, fit_hard(ready, made)))
    # Samples before and after the pulse tell the level of each window nearly as well: 1 to 3 %
    assert 1.005 < spent[1] / spent[0] < 1.1
