"""What a window may say beside the request it answers and the spec of its receiver."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from grm_bench import SPEC, window_for
from hypothesis import assume, given
from hypothesis import strategies as st

from belahil.errors import CorruptData
from belahil.grm_link.window import pack_window, unpack_window
from belahil.receiver import DigitizerSpec
from belahil.values import Candidate, Products, RangeWindow, WindowRequest
from drivers.grm_rules import check_window

REQUEST = WindowRequest(shot=5, gain_code=4, sample_count=4)


def with_counts(*counts: int) -> RangeWindow:
    return replace(window_for(REQUEST), counts=np.array(counts, np.int16), candidates=())


def accepted(window: RangeWindow, request: WindowRequest = REQUEST, spec: DigitizerSpec = SPEC) -> bool:
    try:
        check_window(window, request, spec)
    except CorruptData:
        return False
    return True


@pytest.mark.parametrize(
    ("bits", "lowest", "highest"),
    [
        (12, -2048, 2047),
        (12, 0, 4095),
        (1, -1, 0),
        (1, 0, 1),
        (15, 0, 32767),
        (15, -16384, 16383),
        (16, -32768, 32767),
    ],
)
def test_counts_fill_either_span_of_their_bits_and_no_more(bits: int, lowest: int, highest: int) -> None:
    spec = replace(SPEC, bits=bits)
    scaled = {"volts_per_count": 2.0 / 2**bits}

    assert accepted(replace(with_counts(lowest, 0, 0, highest), **scaled), spec=spec)

    for low, high in [(lowest - 1, highest), (lowest, highest + 1)]:
        if low >= -32768 and high <= 32767:
            assert not accepted(replace(with_counts(low, 0, 0, high), **scaled), spec=spec)


def test_counts_in_twos_complement_are_noticed() -> None:
    # Given counts about zero that were sent as they are, so that 32768 was taken from each
    sent = np.array([3, 65533, 0, 65534], np.uint16)
    read = (sent ^ np.uint16(0x8000)).view(np.int16)

    with pytest.raises(CorruptData, match=r"counts from -32768 to 32766; .*right-justified.*count [+] 32768"):
        check_window(replace(window_for(REQUEST), counts=read), REQUEST, SPEC)


def test_counts_of_a_candidate_keep_to_the_same_span() -> None:
    window = with_counts(0, 1, 2, 4095)

    assert accepted(replace(window, candidates=(Candidate(0, 1e-8, 0.1, (4000, 0)),)))
    assert not accepted(replace(window, candidates=(Candidate(0, 1e-8, 0.1, (4000, -1)),)))


@pytest.mark.parametrize(
    ("products", "found", "said"),
    [
        ("candidates", Candidate(1e-8, 1e-8, 0.1), None),
        (
            "candidates",
            Candidate(1e-8, 1e-8, 0.1, (1,)),
            "asked for products candidates, candidate 1 has 1 co",
        ),
        ("correlation_windows", Candidate(1e-8, 1e-8, 0.1, (1, 2), 2), None),
        ("correlation_windows", Candidate(1e-8, 1e-8, 0.1), "correlation_windows, candidate 1 has 0 counts"),
        (
            "correlation_windows",
            Candidate(1e-8, 1e-8, 0.1, (1, 2), 3),
            "candidate 1 with the samples from 3 to before 5; allowed: within the 4 that were asked for",
        ),
        ("window", Candidate(1e-8, 1e-8, 0.1, (), 4), None),
        ("window_and_candidates", Candidate(1e-8, 1e-8, 0.1, (1, 2), 2), None),
        ("window_and_candidates", Candidate(1e-8, 1e-8, 0.1), "candidate 1 has 0 counts"),
        ("window", Candidate(1e-8, 1e-8, 0.1, (), 5), "candidate 1 with the samples from 5 to before 5"),
    ],
)
def test_a_candidate_brings_what_was_asked_for_from_inside_the_window(
    products: Products, found: Candidate, said: str | None
) -> None:
    request = replace(REQUEST, products=products)
    window = replace(window_for(request), candidates=(found,))
    if said is None:
        check_window(window, request, SPEC)
        return
    with pytest.raises(CorruptData, match=said):
        check_window(window, request, SPEC)


def test_clipped_samples_are_told_without_the_samples() -> None:
    # Given candidates of a window of which every sample was clipped
    request = replace(REQUEST, products="candidates")
    window = unpack_window(pack_window(replace(window_for(request), saturated=4)))
    # Then that is known, and five of four cannot be
    check_window(window, request, SPEC)
    assert (window.counts.size, window.saturated) == (0, 4)
    with pytest.raises(CorruptData, match="5 of 4 samples saturated"):
        check_window(replace(window, saturated=5), request, SPEC)


@pytest.mark.parametrize("bits", [1, 12, 16])
def test_a_span_from_1_mv_to_1_kv_is_believed(bits: int) -> None:
    spec = replace(SPEC, bits=bits)
    window = with_counts(0, 0, 0, 0)
    for span_v, fine in [(1e-3, True), (1e3, True), (0.999e-3, False), (1001.0, False), (5e-324, False)]:
        assert accepted(replace(window, volts_per_count=span_v / 2**bits), spec=spec) == fine


rates = st.floats(1.0, 1e12)


@given(rates, st.floats(0, 1.0))
def test_a_start_that_is_the_rounded_delay_is_accepted_however_it_was_calculated(
    rate_hz: float, delay_s: float
) -> None:
    # Given a receiver that rounds exactly, of up to 10^9 intervals
    edges = round(Fraction(delay_s) * Fraction(rate_hz))
    assume(edges <= 10**9)
    interval_s = 1 / rate_hz
    for start_s in (edges / rate_hz, edges * interval_s, round(delay_s * rate_hz) * interval_s):
        window = replace(window_for(REQUEST), sample_interval_s=interval_s, start_s=start_s)

        assert accepted(window, replace(REQUEST, delay_s=delay_s), replace(SPEC, sample_rate_hz=rate_hz))

        for wrong_s in (start_s + interval_s, start_s - interval_s, start_s + 0.01 * interval_s):
            off = replace(window, start_s=wrong_s)
            exact = abs(Fraction(delay_s) * Fraction(rate_hz) - edges)
            # Half a sample may be rounded to either side.
            if abs(exact - Fraction(1, 2)) > 2e-3:
                assert not accepted(
                    off, replace(REQUEST, delay_s=delay_s), replace(SPEC, sample_rate_hz=rate_hz)
                )


@given(st.floats(allow_nan=False, allow_infinity=False), st.floats(allow_nan=False, allow_infinity=False))
def test_no_start_and_no_delay_is_too_large_to_be_compared(start_s: float, delay_s: float) -> None:
    window = replace(window_for(REQUEST), start_s=start_s)

    assert accepted(window, replace(REQUEST, delay_s=delay_s)) <= (abs(start_s - delay_s) < 1e-8)


@given(rates, st.floats(1e-11, 1.0))
def test_an_interval_is_one_over_the_rate(rate_hz: float, error: float) -> None:
    spec = replace(SPEC, sample_rate_hz=rate_hz)
    window = replace(window_for(REQUEST), sample_interval_s=1 / rate_hz)

    assert accepted(window, spec=spec)
    assert accepted(replace(window, sample_interval_s=math.nextafter(1 / rate_hz, 1)), spec=spec)
    assert not accepted(replace(window, sample_interval_s=(1 + error) / rate_hz), spec=spec)
