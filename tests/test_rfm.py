from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from belahil import butterworth
from belahil.errors import RefusedInput
from belahil.pole_response import SampledNoise
from belahil.pulse_bound import bound, filtered_noise_covariance, white_bound
from belahil.pulse_fit import GaussianPulse, gaussian_fit
from belahil.receiver import BELA_GRM, GALA_LIKE
from belahil.values import RangeWindow
from sim import reference_rfm
from sim.kernel import Kernel
from sim.pulse_shape import PulsePiece, PulseShape
from sim.rfm import RangeFinder, loops
from sim.template_bank import TemplateBank
from sim.whitened_fit import WhitenedFit

INTERVAL_S = 12.5e-9
SIGMA = 1 / np.sqrt(8 * np.log(2))
POLES = butterworth.poles(19e6, 3, 0.0)
FINDER = RangeFinder(TemplateBank(INTERVAL_S))
HALF_C = 299792458.0 / 2


def echo(fwhm_s: float) -> Kernel:
    """A Gaussian echo behind the receiver's filter."""
    return Kernel(PulseShape((PulsePiece(1.0, fwhm_s * SIGMA, 0.0, 0.0),)), POLES)


def peak_of(kernel: Kernel) -> float:
    return float(kernel.exact(np.linspace(-50e-9, 300e-9, 7001)).max())


def noisy_window(seed: int, count: int = 16064) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(count)


@pytest.mark.parametrize(
    ("interval_s", "count", "widest_s"),
    [
        (12.5e-9, 12, 120e-9),
        (12.5e-9, 3, 120e-9),
        (12.5e-9, 64, 120e-9),
        (5e-9, 12, 120e-9),
        (5e-9, 12, 2e-6),
    ],
)
def test_the_stages_make_the_templates(interval_s: float, count: int, widest_s: float) -> None:
    # Given banks that are fine, coarse, or of a faster receiver
    bank = TemplateBank(interval_s, count, widest_s=widest_s)
    places = np.arange(-bank.reach, bank.reach + 1.0)
    for width, template in zip(bank.widths, bank.templates, strict=True):
        with np.errstate(under="ignore"):
            true = np.exp(-4 * np.log(2) * (places / width) ** 2)
        # Then each is a Gaussian of its width but for what costs 0.3 % of the signal-to-noise ratio
        assert template @ true / np.linalg.norm(true) > 0.997
        assert np.linalg.norm(template) == pytest.approx(1, abs=1e-6)


def test_default_widths_are_geometric_from_18_to_120_ns() -> None:
    widths_s = TemplateBank(INTERVAL_S).widths * INTERVAL_S
    assert (widths_s.size, widths_s[0], widths_s[-1]) == (12, pytest.approx(18e-9), pytest.approx(120e-9))
    np.testing.assert_allclose(np.diff(np.log(widths_s)), np.log(120 / 18) / 11, rtol=1e-12)


@pytest.mark.parametrize("count", [16064, 1000, 257, 64, 42, 10])
@pytest.mark.parametrize("interval_s", [12.5e-9, 5e-9])
def test_compiled_and_plain_loops_find_the_same(count: int, interval_s: float) -> None:
    pytest.importorskip("numba")
    from sim import compiled_rfm

    # Given noise with a pulse in it
    bank = TemplateBank(interval_s)
    samples = noisy_window(count, count)
    samples[count // 2 - 2 : count // 2 + 2] += 6
    mean = samples.mean()
    lags = reference_rfm.find(samples, mean, bank, 4, 10)
    # Then the chosen lags are the same, and the refined numbers to rounding
    np.testing.assert_array_equal(compiled_rfm.find(samples, mean, bank, 4, 10), lags)
    window = min(42, count)
    np.testing.assert_allclose(
        compiled_rfm.refine(samples, mean, lags, bank.widths, window, 1),
        reference_rfm.refine(samples, mean, lags, bank.widths, window, 1),
        rtol=1e-9,
        atol=1e-9,
    )


@pytest.mark.parametrize("interval_s", [12.5e-9, 5e-9])
@pytest.mark.parametrize(("rows", "spare"), [(1, 0), (70, 0), (70, 9)])
def test_compiled_and_plain_loops_find_the_same_in_pieces(interval_s: float, rows: int, spare: int) -> None:
    pytest.importorskip("numba")
    from sim import compiled_rfm

    # given pieces of noise with a pulse, more than are searched together, and one without anything
    bank = TemplateBank(interval_s)
    near = (bank.reach + spare, bank.reach + spare + 60)
    pieces = np.array([noisy_window(seed, near[1] + bank.reach + spare + 1) for seed in range(rows)])
    pieces[:, near[0] + 28 : near[0] + 32] += np.linspace(0, 9, rows)[:, None]
    pieces[-1] = 0.0
    # when four peaks are looked for, then both find the same, to single precision
    lags, scores = reference_rfm.find_in_pieces(pieces, near, bank, 4, 10)
    found_lags, found_scores = compiled_rfm.find_in_pieces(pieces, near, bank, 4, 10)
    np.testing.assert_array_equal(found_lags, lags)
    np.testing.assert_allclose(found_scores, scores, rtol=1e-5, atol=2e-5)
    assert (lags[-1] == -1).all()
    assert (scores[-1] == 0).all()
    # and a piece has the best scores of a search of it alone
    for piece, best in zip(pieces, scores, strict=True):
        alone = reference_rfm.best_scores(piece.astype(np.float32), bank)[near[0] : near[1] + 1]
        assert best[0] == pytest.approx(alone.max(), abs=2e-5)


@pytest.mark.parametrize("centre", [0.0, 0.49, 13.5, 20.3, 41.0])
@pytest.mark.parametrize("width", [0.7, 1.4, 4.0, 19.0])
def test_a_gaussian_from_neighbour_to_neighbour_is_that_of_its_formula(centre: float, width: float) -> None:
    compiled_refine = pytest.importorskip("sim.compiled_refine")
    scale, bell = np.sqrt(8 * np.log(2)) / width, np.empty(42)
    compiled_refine._bell(centre, scale, bell)
    q = (np.arange(42) - centre) * scale
    with np.errstate(under="ignore"):
        expected = np.exp(-0.5 * q * q)
    # 42 steps, each with the roundings of all steps before: 42^2 / 2 of them; below lies nothing
    np.testing.assert_allclose(bell, expected, rtol=42**2 / 2 * 2.3e-16, atol=1e-300)


def test_scores_are_the_correlations_with_every_template_at_every_lag() -> None:
    bank = TemplateBank(INTERVAL_S)
    samples = noisy_window(3, 500).astype(np.float32)
    rows = [np.correlate(samples, row, "full")[bank.reach : bank.reach + 500] for row in bank.templates]
    expected = np.maximum(np.max(rows, axis=0), 0)
    # Single precision: about 100 products
    np.testing.assert_allclose(reference_rfm.best_scores(samples, bank), expected, rtol=0, atol=2e-5)


def test_without_numba_the_plain_loops_serve(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sim.compiled_rfm", None)
    monkeypatch.delattr("sim.compiled_rfm", raising=False)
    loops.cache_clear()
    try:
        assert loops() is reference_rfm
    finally:
        loops.cache_clear()
    samples = noisy_window(4)
    plain = RangeFinder(FINDER.bank, compiled=False)
    np.testing.assert_allclose(plain.search(samples), FINDER.search(samples), rtol=1e-9)


@pytest.mark.parametrize(("steps", "one_way_m"), [(1, 0.2e-3), (2, 1e-8)])
def test_one_refinement_step_is_within_a_fifth_of_a_millimetre_of_the_least_squares(
    steps: int, one_way_m: float
) -> None:
    # Given filtered echoes of 30 to 100 ns at any phase, without noise
    finder = RangeFinder(FINDER.bank, refinement_steps=steps)
    for fwhm_s in np.linspace(30e-9, 100e-9, 8):
        kernel = echo(fwhm_s)
        for phase in np.arange(0, 1, 1 / 8):
            volts = kernel.exact((np.arange(2000) - 1000 - phase) * INTERVAL_S)
            # When the range finder and the converged least squares see the same correlation window
            arrival_s, width_s, amplitude_v, first = finder.search(volts)[0]
            window = slice(int(first), int(first) + 42)
            fit = gaussian_fit(volts[window] - volts.mean(), INTERVAL_S)
            assert fit.pulse is not None
            assert abs(arrival_s - first * INTERVAL_S - fit.pulse.arrival_s) * HALF_C < one_way_m
            assert width_s == pytest.approx(fit.pulse.fwhm_s, rel=1e-4)
            assert amplitude_v == pytest.approx(fit.pulse.amplitude_v, rel=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("snr", [10, 30, 100])
def test_in_white_noise_the_arrival_reaches_the_cramer_rao_bound(snr: float) -> None:
    # Given Gaussian pulses at random phases in white noise
    rng = np.random.default_rng(int(snr))
    shots, pulse = 2000, GaussianPulse(0.0, 45e-9, float(snr))
    errors = np.empty(shots)
    for shot in range(shots):
        at_s = (100 + rng.random()) * INTERVAL_S
        volts = pulse.at(np.arange(200) * INTERVAL_S - at_s) + rng.standard_normal(200)
        errors[shot] = FINDER.search(volts)[0][0] - at_s
    # Then the spread is at most 1.1 times the bound; it is known to 1.6 %, and less than 0.95 would be a bug
    assert 0.95 < errors.std() / white_bound(pulse, INTERVAL_S, 1.0).arrival_s < 1.1


def spread_over_bound(fwhm_s: float, snr: float, shots: int, whitened: bool) -> float:
    """Spread of the arrival in filter-coloured noise over the bound for a known response."""
    kernel = echo(fwhm_s)
    peak = peak_of(kernel)
    covariance = filtered_noise_covariance(POLES, 0, INTERVAL_S, 42, 1 / snr)
    fit = WhitenedFit(lambda times_s: kernel.at(times_s) / peak, covariance, INTERVAL_S)
    noise, rng, times_s = (
        SampledNoise(POLES, 0, INTERVAL_S),
        np.random.default_rng(7),
        np.arange(42) * INTERVAL_S,
    )
    errors, bounds = np.empty(shots), np.empty(shots)
    for shot in range(shots):
        at_s = (19 + rng.random()) * INTERVAL_S
        volts = kernel.at(times_s - at_s) / peak + noise.draw(rng, 42) / snr
        if whitened:
            found = fit.fit(volts)
            assert found.status == "ok"
            arrival_s = found.arrival_s
        else:
            # The window of the range finder holds the noise of 42 samples, and nothing else.
            arrival_s = FINDER.search(np.concatenate([np.zeros(400), volts, np.zeros(400)]))[0][0]
            arrival_s -= 400 * INTERVAL_S
        errors[shot], bounds[shot] = arrival_s - at_s, fit.bound(at_s, 1.0)[0]
    return float(errors.std() / np.sqrt(np.mean(bounds**2)))


@pytest.mark.parametrize("fwhm_s", [45e-9, pytest.param(100e-9, marks=pytest.mark.slow)])
@pytest.mark.parametrize("snr", [10, pytest.param(100, marks=pytest.mark.slow)])
def test_in_coloured_noise_wide_echoes_reach_the_bound(fwhm_s: float, snr: float) -> None:
    # 1000 shots give the spread to 2.2 %
    assert 0.92 < spread_over_bound(fwhm_s, snr, 1000, whitened=False) < 1.1


def narrow_ratios(fwhm_s: float, snr: float, shots: int = 1000) -> tuple[float, float]:
    """Error of the range finder's arrival over the bound: with, and about, its bias at each phase.

    A Gaussian is not the shape of a narrow echo behind the filter. What that does to the arrival depends on
    the sampling phase alone, is known from the echo without noise, and does not get less with less noise.
    """
    kernel = echo(fwhm_s)
    peak, rest, times_s = peak_of(kernel), np.zeros(400), np.arange(42) * INTERVAL_S
    covariance = filtered_noise_covariance(POLES, 0, INTERVAL_S, 42, 1 / snr)
    fit = WhitenedFit(lambda since_s: kernel.at(since_s) / peak, covariance, INTERVAL_S)
    noise, rng = SampledNoise(POLES, 0, INTERVAL_S), np.random.default_rng(7)
    phases = (np.arange(20) + 0.5) / 20
    errors, biases, bounds = [], [], []
    for phase in phases:
        at_s = (19 + phase) * INTERVAL_S
        clean = kernel.at(times_s - at_s) / peak
        volts = [clean, *(clean + noise.draw(rng, 42) / snr for _ in range(shots // phases.size))]
        found = [FINDER.search(np.concatenate([rest, one, rest]))[0][0] - 400 * INTERVAL_S for one in volts]
        biases.append(found[0] - at_s)
        errors.append(np.array(found[1:]) - at_s)
        bounds.append(fit.bound(at_s, 1.0)[0])
    least_s = np.sqrt(np.mean(np.square(bounds)))
    about_s = np.sqrt(np.mean(np.square(np.array(errors) - np.array(biases)[:, None])))
    return float(np.std(errors) / least_s), float(about_s / least_s)


@pytest.mark.slow
def test_of_narrow_echoes_the_ratio_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    # What a Gaussian template can do for echoes that are narrower than the filter
    for fwhm_ns in (3, 5, 10, 20, 30):
        ratios = [narrow_ratios(fwhm_ns * 1e-9, snr) for snr in (10, 30, 100)]
        with capsys.disabled():
            print(
                f"\noptical FWHM {fwhm_ns} ns, SNR 10, 30, 100: error / bound "
                + ", ".join(f"{whole:.2f}" for whole, _ in ratios)
                + "; about the bias at the phase "
                + ", ".join(f"{about:.2f}" for _, about in ratios)
            )
        # About its bias it does the same at every signal-to-noise ratio: 1.6 times the bound at worst
        about = [one for _, one in ratios]
        assert min(about) > 0.92
        assert max(about) < 1.75
        assert max(about) / min(about) < 1.1


@pytest.mark.slow
def test_the_bias_of_narrow_echoes_is_the_templates_and_no_noise() -> None:
    # Given the shortest echo at a high and a low signal-to-noise ratio
    (whole, about), (whole_at_10, about_at_10) = narrow_ratios(3e-9, 100), narrow_ratios(3e-9, 10)

    # Then 0.5 ns rms of bias hide the bound at the high one, and without it both come out the same
    assert whole > 5
    assert whole_at_10 < 2.2
    assert about == pytest.approx(about_at_10, rel=0.1)
    assert 1.3 < about < 1.75


@pytest.mark.parametrize(
    ("fwhm_s", "rms_s"), [(3e-9, 0.55e-9), (10e-9, 0.25e-9), (20e-9, 0.025e-9), (45e-9, 1e-12)]
)
def test_the_bias_over_sampling_phases_falls_with_the_width(fwhm_s: float, rms_s: float) -> None:
    kernel, places = echo(fwhm_s), np.arange(800.0)
    found = [
        FINDER.search(kernel.exact((places - 400 - phase) * INTERVAL_S))[0][0] - (400 + phase) * INTERVAL_S
        for phase in np.arange(0, 1, 1 / 16)
    ]

    assert 0.4 * rms_s * (fwhm_s < 45e-9) < np.std(found) < rms_s


@pytest.mark.parametrize("fwhm_s", [3e-9, 20e-9, 100e-9])
@pytest.mark.parametrize("snr", [10, 100])
def test_the_whitened_fit_reaches_the_bound_from_3_ns_up(fwhm_s: float, snr: float) -> None:
    # 1000 shots give the spread to 2.2 %
    assert 0.92 < spread_over_bound(fwhm_s, snr, 1000, whitened=True) < 1.1


def test_the_whitened_fit_is_exact_without_noise_and_tells_its_uncertainty() -> None:
    kernel = echo(5e-9)
    covariance = filtered_noise_covariance(POLES, 0, INTERVAL_S, 42, 1e-3)
    fit = WhitenedFit(kernel.exact, covariance, INTERVAL_S)
    times_s = np.arange(42) * INTERVAL_S
    found = fit.fit(2e-9 * kernel.exact(times_s - 243.21e-9))
    assert found.status == "ok"
    assert found.arrival_s == pytest.approx(243.21e-9, abs=1e-14)
    assert found.amplitude == pytest.approx(2e-9, rel=1e-6)
    # The bound is the inverse information with slopes from a wider difference quotient
    step_s = 1e-11
    slope = kernel.exact(times_s - 243.21e-9 - step_s) - kernel.exact(times_s - 243.21e-9 + step_s)
    gradient = np.stack([2e-9 * slope / (2 * step_s), kernel.exact(times_s - 243.21e-9)])
    expected = np.sqrt(np.diag(bound(gradient, covariance)))
    np.testing.assert_allclose(
        [found.arrival_uncertainty_s, found.amplitude_uncertainty], expected, rtol=1e-4
    )


def test_the_whitened_fit_tells_when_there_is_nothing() -> None:
    fit = WhitenedFit(echo(5e-9).exact, np.eye(42), INTERVAL_S)
    assert fit.fit(np.zeros(42)).status == "no_pulse"
    with pytest.raises(RefusedInput, match="finite"):
        fit.fit(np.full(42, np.nan))
    with pytest.raises(RefusedInput, match="positive definite"):
        WhitenedFit(echo(5e-9).exact, -np.eye(42), INTERVAL_S)
    with pytest.raises(RefusedInput, match="square"):
        WhitenedFit(echo(5e-9).exact, np.ones(42), INTERVAL_S)
    with pytest.raises(RefusedInput, match="zero"):
        WhitenedFit(np.zeros_like, np.eye(42), INTERVAL_S)


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(4, 400))
def test_candidates_are_best_first_apart_and_inside(seed: int, count: int) -> None:
    found = RangeFinder(FINDER.bank, compiled=False).search(noisy_window(seed, count))
    lags = reference_rfm.find(noisy_window(seed, count), noisy_window(seed, count).mean(), FINDER.bank, 4, 10)
    assert 1 <= len(found) <= 4
    assert np.isfinite(found).all()
    assert all(abs(a - b) > 10 for i, a in enumerate(lags) for b in lags[:i])
    assert ((found[:, 3] >= 0) & (found[:, 3] + min(42, count) <= count)).all()


@pytest.mark.parametrize("level", [0.0, 0.1, -3e-3])
def test_a_constant_window_has_no_candidates(level: float) -> None:
    for finder in (FINDER, RangeFinder(FINDER.bank, compiled=False)):
        assert finder.search(np.full(16064, level)).shape == (0, 4)


def test_an_offset_does_not_matter() -> None:
    samples = noisy_window(9)
    np.testing.assert_allclose(FINDER.search(samples + 50.0), FINDER.search(samples), rtol=0, atol=2e-4)


@pytest.mark.parametrize("at", [0, 3, 300, 996, 999])
def test_a_pulse_at_an_edge_keeps_its_place_and_its_correlation_window_inside(at: int) -> None:
    volts = GaussianPulse(at * INTERVAL_S, 50e-9, 1.0).at(np.arange(1000) * INTERVAL_S)
    arrival_s, _, _, first = FINDER.search(volts)[0]
    # Removing the mean of a short window moves it a little where half the pulse is missing
    assert abs(arrival_s / INTERVAL_S - at) < 0.5
    assert 0 <= first <= 1000 - 42


def test_wrong_windows_and_settings_are_refused_in_one_line() -> None:
    with pytest.raises(RefusedInput, match="every sample must be finite"):
        FINDER.search([1.0, np.nan, 2.0, 3.0])
    with pytest.raises(RefusedInput, match="at least 4 samples"):
        FINDER.search([1.0])
    with pytest.raises(RefusedInput, match="candidates"):
        RangeFinder(FINDER.bank, candidate_count=0)
    with pytest.raises(RefusedInput, match="negative"):
        RangeFinder(FINDER.bank, refinement_steps=-1)
    with pytest.raises(RefusedInput, match="3 to 64"):
        TemplateBank(INTERVAL_S, 2)
    with pytest.raises(RefusedInput, match="rising widths"):
        TemplateBank(INTERVAL_S, narrowest_s=5e-9)
    with pytest.raises(RefusedInput, match="above zero"):
        TemplateBank(0.0)


def window_of(counts: np.ndarray) -> RangeWindow:
    return RangeWindow(counts.astype(np.int16), 0.5e-3, 2048.0, INTERVAL_S, 0.0, 4, 7)


def test_products_are_what_was_asked_for() -> None:
    # Given a digitized window with one strong pulse
    volts = GaussianPulse(5000.25 * INTERVAL_S, 40e-9, 0.2).at(np.arange(16064) * INTERVAL_S)
    counts = np.round(2048 + (volts + 1e-3 * noisy_window(1)) / 0.5e-3)
    window = window_of(counts)
    finder = RangeFinder.of(BELA_GRM)
    whole, bare, cut = (finder.report(window, p) for p in ("window", "candidates", "correlation_windows"))
    # Then the whole window keeps its counts; the others have none
    assert whole.counts is window.counts
    assert (bare.counts.size, cut.counts.size) == (0, 0)
    assert whole.candidates == bare.candidates
    both = finder.report(window, "window_and_candidates")
    assert both.counts is window.counts
    assert both.candidates == cut.candidates
    # and the first candidate is the pulse, with the counts round it
    first = cut.candidates[0]
    assert first.arrival_s == pytest.approx(5000.25 * INTERVAL_S, abs=0.2e-9)
    assert first.amplitude_v == pytest.approx(0.2, abs=5e-3)
    assert first.correlation_window == tuple(int(c) for c in counts[4980:5022])
    assert all(found.correlation_window == () for found in whole.candidates)
    assert len(whole.candidates) == 4


def test_the_gala_like_receiver_has_its_own_rate_and_windows() -> None:
    finder = RangeFinder.of(GALA_LIKE)
    assert finder.correlation_window_samples == 64
    volts = GaussianPulse(1000.3 * 5e-9, 40e-9, 0.2).at(np.arange(4000) * 5e-9)
    assert finder.search(volts)[0][0] == pytest.approx(1000.3 * 5e-9, abs=1e-12)
