"""What a window on the GRM link must agree with: the request it answers and the spec of its receiver."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from belahil.errors import CorruptData
from belahil.values import WITH_CORRELATION_WINDOWS, WITH_SAMPLES

if TYPE_CHECKING:
    from collections.abc import Iterator

    from belahil.receiver import DigitizerSpec
    from belahil.values import RangeWindow, WindowRequest

SMALLEST_SPAN_V, LARGEST_SPAN_V = 1e-3, 1e3
LARGEST_ZERO_COUNT = 65536
INTERVAL_TOLERANCE = 1e-12
"""Relative: both ends calculate in float64."""
GRID_TOLERANCE = 1e-3
"""Parts of a sample interval: so near to a whole number lie products of up to 10^9 such intervals."""


def check_window(window: RangeWindow, request: WindowRequest, spec: DigitizerSpec) -> None:
    """Refuse a window that contradicts its request or its receiver's spec.

    Parameters
    ----------
    window : RangeWindow
        Its layout is right, and its shot is that of the request.
    request : WindowRequest
        What the receiver was armed with.
    spec : DigitizerSpec
        What the receiver reported.

    Raises
    ------
    CorruptData
        Naming the window and the rule of ``docs/grm-link.md`` that it breaks.
    """
    for rules in (
        _of_the_request(window, request),
        _of_the_spec(window, spec),
        _of_the_start(window, request, spec),
    ):
        for broken in rules:
            raise CorruptData(f"window of shot {window.shot}: {broken}")


def _of_the_request(window: RangeWindow, request: WindowRequest) -> Iterator[str]:
    if window.gain_code != request.gain_code:
        yield f"asked for gain code {request.gain_code}, it has {window.gain_code}"
    due = request.sample_count if request.products in WITH_SAMPLES else 0
    if window.counts.size != due:
        yield f"asked for {due} samples, {window.counts.size} came"
    if window.saturated > request.sample_count:
        yield f"{window.saturated} of {request.sample_count} samples saturated"
    for number, found in enumerate(window.candidates, 1):
        size, end = len(found.correlation_window), found.first_sample + len(found.correlation_window)
        if end > request.sample_count:
            yield (
                f"candidate {number} with the samples from {found.first_sample} to before {end}; "
                f"allowed: within the {request.sample_count} that were asked for"
            )
        if request.products != "window" and (size > 0) != (request.products in WITH_CORRELATION_WINDOWS):
            yield f"asked for products {request.products}, candidate {number} has {size} counts"


def _of_the_spec(window: RangeWindow, spec: DigitizerSpec) -> Iterator[str]:
    counts = [window.counts] if window.counts.size else []
    extremes = [int(end) for part in counts for end in (part.min(), part.max())]
    for candidate in window.candidates:
        extremes += candidate.correlation_window
    spans = spans_of(spec.bits)
    if extremes and not any(low <= min(extremes) and max(extremes) <= high for low, high in spans):
        allowed = " or ".join(f"{low} to {high}" for low, high in spans)
        yield (
            f"counts from {min(extremes)} to {max(extremes)}; allowed with {spec.bits} bits: {allowed}; "
            "are they right-justified, and sent as count + 32768?"
        )
    interval_s = spec.sample_interval_s
    if not math.isclose(window.sample_interval_s, interval_s, rel_tol=INTERVAL_TOLERANCE):
        yield (
            f"sample interval {window.sample_interval_s} s; the spec's {spec.sample_rate_hz} Hz "
            f"mean {interval_s} s"
        )
    span_v = window.volts_per_count * 2.0**spec.bits
    if not SMALLEST_SPAN_V <= span_v <= LARGEST_SPAN_V:
        yield (
            f"volts per count {window.volts_per_count}, with {spec.bits} bits a span of {span_v:g} V; "
            f"allowed: {SMALLEST_SPAN_V:g} to {LARGEST_SPAN_V:g} V"
        )
    if not abs(window.zero_count) <= LARGEST_ZERO_COUNT:
        yield f"zero count {window.zero_count}; allowed: -{LARGEST_ZERO_COUNT} to {LARGEST_ZERO_COUNT}"


def spans_of(bits: int) -> tuple[tuple[int, int], ...]:
    """Return the lowest and highest count of each way to number the codes of a converter in 16 bits."""
    half = 1 << (bits - 1)
    about_zero, from_zero = (-half, half - 1), (0, 2 * half - 1)
    return (about_zero, from_zero) if from_zero[1] < 1 << 15 else (about_zero,)


def _of_the_start(window: RangeWindow, request: WindowRequest, spec: DigitizerSpec) -> Iterator[str]:
    interval_s = spec.sample_interval_s
    off_grid = abs(math.remainder(window.start_s, interval_s))
    off_delay = abs(window.start_s - request.delay_s)
    if off_grid > GRID_TOLERANCE * interval_s or off_delay > (0.5 + GRID_TOLERANCE) * interval_s:
        yield (
            f"start {window.start_s} s; asked for a delay of {request.delay_s} s, which is to be rounded to "
            f"whole intervals of {interval_s} s"
        )
