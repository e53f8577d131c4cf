from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from belahil import butterworth
from belahil.delay_curve import DelayCurve
from belahil.errors import RefusedInput
from belahil.pulse_fit import gaussian_fit
from belahil.values import Estimate
from procedures.range_reduction import (
    FIXED_OFFSETS,
    ReceiverDelays,
    delays_from_published,
    reduce_range,
)
from procedures.tx_definitions import CorrelationWindow, delays_s
from procedures.tx_pulse import tailed_pulse
from procedures.tx_response import CutResponses
from sim.filter_delay import detected, filter_delay_curve
from sim.kernel import Kernel
from sim.pulse_shape import FWHM_OF_SIGMA, PulsePiece, PulseShape

LIGHT_M_PER_S = 299_792_458.0
INTERVAL_S = 12.5e-9


def exactly(value: float, unit: str = "s") -> Estimate:
    return Estimate(value, 0.0, unit)


def arrival(
    fwhm_s: float, true_s: float, poles: tuple[complex, ...], interval_s: float
) -> tuple[float, float]:
    """Fitted arrival and width of a Gaussian behind a filter, sampled by a clock of `interval_s`."""
    kernel = Kernel(PulseShape((PulsePiece(1.0, fwhm_s / FWHM_OF_SIGMA),)), poles)
    first = math.floor((true_s - 150e-9) / interval_s)
    samples = kernel.exact((first + np.arange(42)) * interval_s - true_s)
    pulse = gaussian_fit(samples, INTERVAL_S).pulse
    assert pulse is not None
    return first * INTERVAL_S + pulse.arrival_s, pulse.fwhm_s


@pytest.mark.parametrize("threshold", [0.0, 0.17, 0.3])
@pytest.mark.parametrize("broadened_s", [25e-9, 60e-9])
def test_a_pulse_that_a_fibre_cuts_is_timed_from_the_centroid_of_the_whole(
    threshold: float, broadened_s: float
) -> None:
    # Given a pulse with a tail, cut by a fibre on its way to the receiver, and its whole echo from a slope
    poles, range_m = butterworth.poles(19e6, 3, 0.0), 500e3
    gate = CorrelationWindow(INTERVAL_S, 42)
    sent, echo = tailed_pulse(5.4e-9, 3e-9), tailed_pulse(math.hypot(5.4e-9, broadened_s), 3e-9)
    late_s = delays_s(gate, CutResponses(sent, poles, 0, gate.times_s).exact(threshold), sent, threshold)
    came_s = gate.centre_s(CutResponses(echo, poles, 0, gate.times_s).exact(0.0))
    assert late_s is not None
    assert came_s is not None
    # Seen from the peak of the sent light, the centroid of the echo is a flight after that of the whole pulse
    received_s = 2 * range_m / LIGHT_M_PER_S + sent.centroid_s() - echo.centroid_s() + came_s

    def reduced_m(delay_s: float) -> float:
        delays = ReceiverDelays(filter_delay_curve(poles, INTERVAL_S), exactly(delay_s))
        width = exactly(math.hypot(broadened_s, 20e-9))
        found = reduce_range(exactly(received_s), width, exactly(late_s["centre_minus_peak"]), delays, ())
        assert found.range is not None
        return found.range.value

    # Then the range comes back, but for what the tail of the echo adds to the curve of Gaussian pulses
    assert reduced_m(late_s["centre_minus_full_centroid"]) == pytest.approx(range_m, abs=0.02)
    # And that from the peak would be too long
    assert reduced_m(late_s["centre_minus_peak"]) > range_m + 0.1


@pytest.mark.parametrize("cutoff_hz", [15e6, 17e6, 19e6])
@pytest.mark.parametrize(("range_m", "ppm"), [(400e3, 0.0), (731_234.5, 3.7), (1.4e6, -12.0)])
def test_a_hidden_range_comes_back_from_filtered_pulses(cutoff_hz: float, range_m: float, ppm: float) -> None:
    # Given pulses at a true distance, behind a filter, on a clock that is off, with the instrument's offsets
    poles = butterworth.poles(cutoff_hz, 3, 0.0)
    interval_s = INTERVAL_S / (1 + ppm * 1e-6)
    offset_s = sum(one.time.value for one in FIXED_OFFSETS)
    sent_width_s = 30e-9
    curve = filter_delay_curve(poles, INTERVAL_S)
    delays = ReceiverDelays(curve, exactly(detected(poles, 0, INTERVAL_S, sent_width_s)[1]))
    for fwhm_s in (31e-9, 50e-9, 85e-9, 105e-9):
        sent_s, _ = arrival(sent_width_s, 3e-6, poles, interval_s)
        came_s, width_s = arrival(fwhm_s, 3e-6 + 2 * range_m / LIGHT_M_PER_S - offset_s, poles, interval_s)

        found = reduce_range(
            exactly(came_s), exactly(width_s), exactly(sent_s), delays, clock_ppm=exactly(ppm, "1e-6")
        )

        # Then nothing is left but what the polynomial of degree 5 misses, and 1 ps of wobble of each pulse
        exact_width_s, exact_s = detected(poles, 0, INTERVAL_S, fwhm_s)
        missed_s = exact_s - float(curve.at(exact_width_s))
        assert abs(missed_s) < 40e-12
        assert found.status == "ok"
        assert found.range is not None
        left_m = found.range.value - range_m
        assert left_m == pytest.approx(LIGHT_M_PER_S / 2 * missed_s, abs=0.4e-3)


def test_without_the_shift_wide_pulses_come_out_too_near() -> None:
    poles = butterworth.poles(19e6, 3, 0.0)
    narrow_s = detected(poles, 0, INTERVAL_S, 6e-9)[1]
    constant = ReceiverDelays(DelayCurve((narrow_s,)), exactly(narrow_s))
    true_s = 2 * 500e3 / LIGHT_M_PER_S
    came_s, width_s = arrival(100e-9, true_s, poles, INTERVAL_S)

    naive = reduce_range(exactly(came_s), exactly(width_s), exactly(narrow_s), constant, offsets=())

    assert naive.range is not None
    assert naive.range.value - 500e3 == pytest.approx(-0.26, abs=0.03)


def test_the_uncertainty_is_the_spread_of_the_reduction() -> None:
    # Given every input drawn from its own uncertainty
    rng = np.random.default_rng(4)
    poles = butterworth.poles(19e6, 3, 0.0)
    curve = filter_delay_curve(poles, INTERVAL_S)
    inputs = {
        "received": Estimate(4e-3, 0.9e-9, "s"),
        "width": Estimate(35e-9, 8e-9, "s"),
        "transmitted": Estimate(1e-6, 0.5e-9, "s"),
        "d_t": Estimate(18e-9, 0.7e-9, "s"),
        "ppm": Estimate(4.0, 0.3, "1e-6"),
    }
    offset = FIXED_OFFSETS[0]
    stated = reduce_range(
        inputs["received"],
        inputs["width"],
        inputs["transmitted"],
        ReceiverDelays(curve, inputs["d_t"], 0.3e-9),
        [offset],
        inputs["ppm"],
    )
    found = []
    for _ in range(1500):
        draw = {
            name: exactly(one.value + one.standard_uncertainty * rng.standard_normal(), one.unit)
            for name, one in inputs.items()
        }
        draw["width"] = exactly(min(max(draw["width"].value, 21e-9), 100e-9))
        d_r = exactly(draw["d_t"].value + 0.3e-9 * rng.standard_normal())
        delays = ReceiverDelays(curve, d_r)
        one = reduce_range(
            draw["received"], draw["width"], draw["transmitted"], delays, [offset], draw["ppm"]
        )
        assert one.range is not None
        found.append(one.range.value)

    assert stated.range is not None
    # 1500 draws tell a spread to 1.8 %; the curve bends over 8 ns by less than that
    assert np.std(found) == pytest.approx(stated.range.standard_uncertainty, rel=0.06)
    assert math.hypot(*(line.value for line in stated.budget)) == pytest.approx(
        stated.range.standard_uncertainty
    )
    assert stated.budget[0].source == "clock of the receiver"
    assert sum(line.share for line in stated.budget) == pytest.approx(1.0)


@given(
    flight_s=st.floats(1e-6, 1e-2),
    width_s=st.floats(20e-9, 110e-9),
    d_t=st.floats(-30e-9, 30e-9),
    offset_s=st.lists(st.floats(-5e-9, 5e-9), max_size=4),
    ppm=st.floats(-500, 500),
)
def test_the_terms_sum_to_the_range(
    flight_s: float, width_s: float, d_t: float, offset_s: list[float], ppm: float
) -> None:
    delays = delays_from_published(exactly(d_t))
    offsets = [type(FIXED_OFFSETS[0])("one", exactly(time_s)) for time_s in offset_s]

    found = reduce_range(
        exactly(flight_s), exactly(width_s), exactly(0.0), delays, offsets, exactly(ppm, "1e-6")
    )

    assert found.range is not None
    # d_T cancels: the published shift holds it already
    shift_s = delays.transmitted.value - float(delays.received.at(width_s))
    expected_s = flight_s / (1 + ppm * 1e-6) + shift_s + sum(offset_s)
    assert found.range.value == pytest.approx(LIGHT_M_PER_S / 2 * expected_s, abs=1e-6)
    assert found.range.value == pytest.approx(math.fsum(term.range_m.value for term in found.terms), abs=1e-6)


def test_the_published_shift_is_that_of_the_filter_with_the_smaller_coefficient_only() -> None:
    transmitted = exactly(11.84e-9)
    curve = filter_delay_curve(butterworth.poles(19e6, 3, 0.0), INTERVAL_S)
    widths_s = np.linspace(21e-9, 110e-9, 60)

    def misfit_s(as_printed: bool) -> float:
        read = delays_from_published(transmitted, as_printed=as_printed).received
        return float(np.std(read.at(widths_s) - curve.at(widths_s)))

    assert misfit_s(as_printed=False) < 0.15e-9
    assert misfit_s(as_printed=True) > 15e-9


def test_the_table_of_fixed_offsets_lists_paths_where_it_says_ranges() -> None:
    assert [round(one.path_m, 3) for one in FIXED_OFFSETS] == [1.021, -0.281, 0.044]
    assert [round(one.one_way_m, 3) for one in FIXED_OFFSETS] == [0.511, -0.140, 0.022]
    assert sum(one.time.value for one in FIXED_OFFSETS) == pytest.approx(2.617e-9, abs=1e-15)


@pytest.mark.parametrize(
    ("received_s", "width_s", "status"),
    [
        (1e-3, 19e-9, "width_outside_curve"),
        (1e-3, 111e-9, "width_outside_curve"),
        (0.0, 50e-9, "not_after_transmitted"),
        (-1e-6, 50e-9, "not_after_transmitted"),
    ],
)
def test_what_cannot_be_reduced_has_a_status_and_no_range(
    received_s: float, width_s: float, status: str
) -> None:
    found = reduce_range(
        exactly(received_s), exactly(width_s), exactly(0.0), delays_from_published(exactly(0.0))
    )

    assert (found.status, found.range, found.terms) == (status, None, ())
    assert found.budget == []


@pytest.mark.parametrize(
    ("odd", "clock"),
    [
        (Estimate(math.nan, 0.0, "s"), None),
        (Estimate(1e-3, math.inf, "s"), None),
        (Estimate(1e-3, -1e-9, "s"), None),
        (Estimate(1e-3, 0.0, "s"), Estimate(-1e6, 0.0, "1e-6")),
    ],
)
def test_odd_numbers_are_refused_in_one_line(odd: Estimate, clock: Estimate | None) -> None:
    with pytest.raises(RefusedInput) as refused:
        reduce_range(odd, exactly(50e-9), exactly(0.0), delays_from_published(exactly(0.0)), clock_ppm=clock)
    assert "\n" not in str(refused.value)
    with pytest.raises(RefusedInput, match="spread"):
        delays_from_published(exactly(0.0), -1e-9)
