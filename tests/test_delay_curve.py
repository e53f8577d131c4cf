"""Delay curves and thresholds; their hard cases are H35 to H37 and H40."""

from __future__ import annotations

import math

import numpy as np
import pytest

from belahil import butterworth
from belahil.delay_curve import DelayCurve, fit_delay_curve
from belahil.errors import RefusedInput
from sim.filter_delay import detected, filter_delay_curve
from sim.pulse_shape import PulsePiece, PulseShape
from sim.pulse_threshold import cut_pulse, threshold_bound

POLES = butterworth.poles(19e6, 3)
INTERVAL_S = 12.5e-9
TAILED = PulseShape((PulsePiece(1.0, 2e-9, 8e-9),))


def test_a_wide_pulse_is_delayed_by_the_group_delay() -> None:
    # Given a pulse of 300 ns behind a filter with a delay of 2 / w_c at 0 Hz
    width_s, delay_s = detected(POLES, 0, INTERVAL_S, 300e-9)
    # Then what is left is of second order: (20 ns / 300 ns)^2 of it
    assert delay_s == pytest.approx(2 / (2 * math.pi * 19e6), rel=(20 / 300) ** 2)
    assert width_s == pytest.approx(300e-9, rel=(20 / 300) ** 2)


def test_the_simulated_curve_goes_through_its_pulses() -> None:
    curve = filter_delay_curve(POLES, INTERVAL_S)
    for optical_s in (5e-9, 20e-9, 50e-9, 100e-9):
        width_s, delay_s = detected(POLES, 0, INTERVAL_S, optical_s)
        # A polynomial of degree 5 misses the steep end by 0.1 ns, the others by less.
        assert curve.at(width_s) == pytest.approx(delay_s, abs=0.11e-9)


def test_a_slow_filter_has_a_curve_from_its_own_width_on() -> None:
    poles = butterworth.poles(8e6, 3)
    curve = filter_delay_curve(poles, INTERVAL_S)
    assert curve.narrowest_s == detected(poles, 0, INTERVAL_S, 0.5e-9)[0] > 40e-9
    with pytest.raises(RefusedInput, match="are known from"):
        curve.at(40e-9)


def test_a_filter_without_such_widths_is_refused() -> None:
    with pytest.raises(RefusedInput, match="every pulse is"):
        filter_delay_curve(butterworth.poles(2e6, 3), INTERVAL_S)


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda: DelayCurve((), 20e-9, 110e-9), "at least one, all finite"),
        (lambda: DelayCurve((math.nan,)), "at least one, all finite"),
        (lambda: DelayCurve((1.0,), 2e-9, 2e-9), "must be a range above 0"),
        (lambda: fit_delay_curve([30e-9, 40e-9], [0.0]), "two equal rows"),
        (lambda: fit_delay_curve([30e-9, 40e-9], [0.0, math.nan]), "all finite"),
        (lambda: fit_delay_curve([30e-9, 40e-9], [0.0, 0.0], 2), "below their number"),
        (lambda: threshold_bound(TAILED, 0.2, POLES, INTERVAL_S, 0.0), "must be above zero"),
    ],
)
def test_what_cannot_be_is_refused(made, said: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(RefusedInput, match=said):
        made()


def test_a_cut_pulse_is_the_pulse_between_its_crossings() -> None:
    cut = cut_pulse(TAILED, 0.17)
    inside = np.linspace(cut.times_s[0], cut.times_s[-1], 999)[1:-1]
    ratio = cut.density(inside) / TAILED.density(inside)
    # One factor, which makes up for what is cut away
    assert ratio == pytest.approx(ratio[0], rel=1e-5)
    assert ratio[0] > 1
    ends = TAILED.density(cut.times_s[[0, -1]])
    assert ends == pytest.approx(0.17 * TAILED.density(np.linspace(0, 20e-9, 20_001)).max(), rel=1e-6)
    assert cut_pulse(TAILED, 0.0) is TAILED


def test_two_peaks_have_no_one_threshold() -> None:
    two = PulseShape((PulsePiece(0.5, 1e-9), PulsePiece(0.5, 1e-9, offset_s=20e-9)))
    with pytest.raises(RefusedInput, match="several peaks"):
        cut_pulse(two, 0.3)


def test_the_spread_of_a_threshold_falls_with_the_noise_and_grows_with_it() -> None:
    found = [threshold_bound(TAILED, one, POLES, INTERVAL_S, 0.02) for one in (0.1, 0.17, 0.4, 0.9)]
    assert [one.status for one in found] == ["ok", "ok", "ok", "flat"]
    assert np.all(np.diff([one.standard_deviation for one in found]) > 0)
    less = threshold_bound(TAILED, 0.17, POLES, INTERVAL_S, 0.002)
    assert less.standard_deviation == pytest.approx(found[1].standard_deviation / 10, rel=1e-12)
