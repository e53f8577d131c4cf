"""Bytes leave no faster than a line allows, and no answer before its latency has passed."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.transports.line_pace import LinePace


@given(
    baud=st.sampled_from([50.0, 9600.0, 921600.0, 1e8]),
    latency_s=st.sampled_from([0.0, 1e-3, 0.25]),
    answers=st.lists(st.tuples(st.floats(0, 0.1), st.integers(1, 400)), min_size=1, max_size=6),
    portion=st.integers(1, 300),
)
def test_no_byte_leaves_early_and_none_is_forgotten(
    baud: float, latency_s: float, answers: list[tuple[float, int]], portion: int
) -> None:
    # the oracle: when the last bit of each byte has passed a line that carries one byte after another
    allowed_s: list[float] = []
    pace, now_s, free_s, left = LinePace(baud, latency_s), 0.0, 0.0, 0

    def drain(until_s: float) -> None:
        nonlocal left
        now_s = pace.next_s(0.0)
        while now_s < until_s:
            # the time that was named was worth waiting for
            count = min(portion, pace.ready(now_s))
            assert count
            for k in range(left, left + count):
                assert now_s >= allowed_s[k] - 2e-6 * 10 / baud
            left += count
            pace.sent(count)
            now_s = now_s if pace.ready(now_s) else pace.next_s(now_s)

    for wait_s, count in answers:
        # when the device answers again, whatever is still on its way
        now_s += wait_s
        drain(now_s)
        begin_s = max(now_s + latency_s, free_s)
        allowed_s += [begin_s + 10 * (k + 1) / baud for k in range(count)]
        free_s = begin_s + 10 * count / baud
        pace.queue(count, now_s)
    drain(math.inf)
    # then every byte has left
    assert left == len(allowed_s)
    assert pace.next_s(now_s) == math.inf


def test_a_line_without_a_rate_only_waits_for_the_latency() -> None:
    pace = LinePace(math.inf, 0.2)
    pace.queue(1000, 5.0)
    assert (pace.ready(5.19), pace.next_s(5.0)) == (0, pytest.approx(5.2))
    assert pace.ready(5.2) == 1000
