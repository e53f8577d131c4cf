"""The delay of the transmitted pulse in each definition, and the shape that a hard cut leaves."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2
from tx_truths import INTERVAL_S, Truth, receiver

from belahil import butterworth
from procedures.tx_definitions import (
    DEFINITIONS,
    PUBLISHED,
    CorrelationWindow,
    delays_s,
    needed_falls,
    references_s,
)
from procedures.tx_families import fit_hard
from procedures.tx_misfit import misfit
from procedures.tx_pulse import KnownPulse, tailed_pulse
from procedures.tx_response import CutResponses
from procedures.tx_windows import read_pulses
from sim.filter_delay import detected
from sim.kernel import Kernel
from sim.pulse_shape import FWHM_OF_SIGMA, PulsePiece, PulseShape

GATE = CorrelationWindow(INTERVAL_S, 42)


def found(cutoff_hz: float, fwhm_s: float, tail_s: float, threshold: float) -> dict[str, float]:
    pulse = tailed_pulse(fwhm_s, tail_s)
    response = CutResponses(pulse, butterworth.poles(cutoff_hz, 3), 0, GATE.times_s).exact(threshold)
    late_s = delays_s(GATE, response, pulse, threshold)
    assert late_s is not None
    return {one: late_s[one] for one in DEFINITIONS}


@pytest.mark.parametrize("fwhm_s", [4e-9, 12e-9, 40e-9])
@pytest.mark.parametrize("cutoff_hz", [17e6, 20e6])
def test_without_tail_and_cut_it_is_the_delay_of_the_filter(cutoff_hz: float, fwhm_s: float) -> None:
    # Given the delay of a Gaussian pulse behind the filter by another module, with windows of its own
    poles = butterworth.poles(cutoff_hz, 3)
    _, expected_s = detected(poles, 0, INTERVAL_S, fwhm_s)
    late_s = found(cutoff_hz, fwhm_s, 0.0, 0.0)
    # Then all that refer to peak or centroid are the same; windows of other lengths and other places of the
    # pulse between samples, of which 16 are a mean, move a narrow one
    allowed_s = 30e-12 if fwhm_s > 10e-9 else 0.1e-9
    for one in DEFINITIONS[:3]:
        assert late_s[one] == pytest.approx(expected_s, abs=allowed_s)
    # and the peak is that of the closed form
    kernel = Kernel(PulseShape((PulsePiece(1.0, fwhm_s / FWHM_OF_SIGMA),)), poles)
    fine_s = np.arange(0, 60e-9, 1e-12)
    peak_s = fine_s[kernel.exact(fine_s).argmax()]
    assert late_s["filtered_peak_minus_peak"] == pytest.approx(peak_s, abs=5e-12)


def test_published_numbers_of_a_19_mhz_filter() -> None:
    # Behind 19 MHz a narrow pulse is delayed by some 18.6 ns to its centre, and no definition gives 5.5 ns
    late_s = found(19e6, 4e-9, 0.0, 0.0)
    assert late_s["centre_minus_peak"] == pytest.approx(18.6e-9, abs=0.1e-9)
    assert references_s(receiver())["dc_group_delay"] == pytest.approx(16.753e-9, abs=1e-12)
    for threshold in (0.0, 0.17, 0.22, 0.6):
        for one in found(19e6, 5.4e-9, 3e-9, threshold).values():
            assert one > 15e-9


def half_gaussian(tail_s: float) -> KnownPulse:
    """A rise of half a Gaussian, 2 ns, and then at once an exponential."""
    times_s = np.concatenate([np.arange(-12e-9, 0, 0.02e-9), np.arange(0, 12 * tail_s, 0.02e-9)])
    power = np.where(
        times_s < 0, np.exp(-0.5 * (times_s / 2e-9) ** 2), np.exp(-np.maximum(times_s, 0) / tail_s)
    )
    return KnownPulse(5e-9, 0.0, 0.0, 0.0, 0.0, tuple(times_s.tolist()), tuple(power.tolist()))


def delays_of(known: KnownPulse, threshold: float) -> dict[str, float]:
    pulse = known.pulse()
    response = CutResponses(pulse, butterworth.poles(19e6, 3), 0, GATE.times_s).exact(threshold)
    late_s = delays_s(GATE, response, pulse, threshold)
    assert late_s is not None
    return {one: late_s[one] for one in DEFINITIONS}


def test_the_delay_falls_slowly_with_the_threshold() -> None:
    # An independent program found 0.077 ns a point for this pulse and a tail of 8 ns: 1.2 cm of range
    early, late = (delays_of(half_gaussian(8e-9), one)["centre_minus_peak"] for one in (0.22, 0.17))
    assert (late - early) / 5 == pytest.approx(0.077e-9, abs=0.005e-9)


@pytest.mark.parametrize("tail_s", [4e-9, 8e-9])
def test_which_tail_would_give_the_published_delays(tail_s: float) -> None:
    # Given that an independent program found 8.6 ns for this pulse
    known = half_gaussian(tail_s)
    needed = needed_falls(GATE, known, receiver())
    fall = needed["main"]["centre_minus_peak"]["dc_group_delay"]
    assert fall is not None
    assert fall * tail_s == pytest.approx(8.6e-9, abs=0.2e-9)
    assert needed["main"]["centre_minus_peak"]["none"] is None
    # Then a pulse with that tail has that delay
    threshold, published_s = PUBLISHED["main"]
    late_s = delays_of(half_gaussian(fall * tail_s), threshold)["centre_minus_peak"]
    assert late_s - references_s(receiver())["dc_group_delay"] == pytest.approx(published_s, abs=0.02e-9)


@pytest.mark.parametrize(
    ("cutoff_hz", "tail_s", "threshold"),
    [(19e6, 3e-9, 0.3), pytest.param(16e6, 15e-9, 0.1, marks=pytest.mark.slow)],
)
def test_chance_alone_leaves_what_chi_square_says(cutoff_hz: float, tail_s: float, threshold: float) -> None:
    # Given 25 analyses of windows that are just as assumed
    pulse, known = KnownPulse(5.4e-9, tail_s, 0.0, 0.0), receiver(cutoff_hz)
    truth = Truth(pulse.pulse(), threshold, cutoff_hz=cutoff_hz)
    gains, freedom, made = [], 0, None
    for seed in range(25):
        windows = read_pulses(truth.shots(60, seed), 12, INTERVAL_S, known, pulse.pulse())
        ready = windows.likelihood(known, "common")
        made = made or CutResponses(pulse.pulse(), known.poles, 0, ready.grid.times_s)
        left = misfit(ready, pulse, known, made, fit_hard(ready, made))
        gains.append(left.gain)
        freedom += left.freedom
    # Then their sum is a chi-square of all degrees of freedom
    assert 1e-4 < chi2.cdf(float(np.sum(gains)), freedom) < 1 - 1e-4
    assert freedom >= 50
