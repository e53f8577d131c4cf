"""What every `Digitizer` promises, as rules that are tried one by one."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from belahil.conformance.rules import NotApplicable, Rule, promised, refused, require, shown
from belahil.conformance.stand import READ_TIMEOUT_S
from belahil.errors import (
    InstrumentRefused,
    LinkClosed,
    RefusedInput,
)
from belahil.uncertainty import sized
from belahil.values import PRODUCTS, TRIGGERS, WITH_CORRELATION_WINDOWS, WITH_SAMPLES

if TYPE_CHECKING:
    from collections.abc import Callable

    from belahil.conformance.stand import Receiving
    from belahil.receiver import DigitizerSpec
    from belahil.values import RangeWindow, WindowRequest

GRID_TOLERANCE = 1e-3
"""Parts of a sample interval."""
MANY = 100
"""Samples at the ends: of fewer all may merely stand there."""
MOST_CODES = 64
"""Gain codes that are tried; of more, these are spread evenly."""


def complaint(window: RangeWindow, request: WindowRequest, spec: DigitizerSpec) -> str:
    """Say how a window contradicts its request or its digitizer's spec; empty when it does not."""
    interval_s = spec.sample_interval_s
    due = request.sample_count if request.products in WITH_SAMPLES else 0
    off_delay, off_grid = (
        abs(window.start_s - request.delay_s),
        abs(math.remainder(window.start_s, interval_s)),
    )
    checks = (
        (window.shot == request.shot, f"shot {window.shot}, asked for {request.shot}"),
        (window.counts.shape == (due,), f"counts of shape {window.counts.shape}, due is ({due},)"),
        (window.counts.dtype == np.int16, f"counts of type {window.counts.dtype}, due is int16"),
        (
            window.gain_code == request.gain_code,
            f"gain code {window.gain_code}, asked for {request.gain_code}",
        ),
        (
            math.isclose(window.sample_interval_s, interval_s, rel_tol=1e-9),
            f"a sample every {window.sample_interval_s} s, the spec says {interval_s} s",
        ),
        (
            off_delay <= (0.5 + GRID_TOLERANCE) * interval_s and off_grid <= GRID_TOLERANCE * interval_s,
            f"starts at {window.start_s} s, asked for {request.delay_s} s to the nearest {interval_s} s",
        ),
        (0 < window.volts_per_count < math.inf, f"{window.volts_per_count} V a count"),
        (math.isfinite(window.zero_count), f"zero count {window.zero_count}"),
        (
            0 <= window.saturated <= request.sample_count,
            f"{window.saturated} of {request.sample_count} samples saturated",
        ),
    )
    return "; ".join(otherwise for is_so, otherwise in checks if not is_so)


def ends_of(window: RangeWindow, spec: DigitizerSpec) -> tuple[int, int]:
    """Lowest and highest count that a converter of these bits has: about zero, or from zero."""
    half = 1 << (spec.bits - 1)
    return (0, 2 * half - 1) if window.zero_count > half / 2 else (-half, half - 1)


def window_taken(tried: Receiving, **asked: object) -> RangeWindow:
    """Take a window and see that it is the one that was asked for."""
    request = tried.request(**asked)
    window = tried.taken(request)
    wrong = complaint(window, request, tried.digitizer.spec)
    require(not wrong, f"{_asked(request)}: {wrong}")
    return window


def _asked(request: WindowRequest) -> str:
    return (
        f"{request.sample_count} samples, delay {request.delay_s:g} s, gain code {request.gain_code}, "
        f"trigger {request.trigger}, {request.source}, {request.products}"
    )


@promised("identity is one line that stays the same")
def _identity(tried: Receiving) -> str:
    said, again = tried.digitizer.identity, tried.digitizer.identity
    require(bool(said.strip()) and said.isprintable() and said == again, f"{said!r}, then {shown(again)}")
    return said


@promised("the spec is that of a digitizer that can be")
def _spec(tried: Receiving) -> str:
    told = tried.digitizer.spec
    numbers = (
        0 < told.sample_rate_hz < math.inf and 2 <= told.bits <= 16 and told.converters >= 1,
        told.max_sample_count >= 1,
        0 < len(set(told.triggers)) == len(told.triggers) and set(told.triggers) <= set(TRIGGERS),
        0 < len(set(told.products)) == len(told.products) and set(told.products) <= set(PRODUCTS),
        told.gain_codes is None or 0 < len(set(told.gain_codes)) == len(told.gain_codes),
    )
    require(all(numbers), f"{shown(told)}")
    return f"{told.bits} bit at {sized(told.sample_rate_hz, 'Sa/s')}, up to {told.max_sample_count} samples"


@promised("a window is the one that was asked for: shot, samples, gain code, interval, start")
def _takes_a_window(tried: Receiving) -> str:
    window = window_taken(tried)
    return f"{window.counts.size} samples of {sized(window.volts_per_count, 'V', 4)}"


@promised("counts are codes of the converter, and volts per count are those of the setting")
def _counts_fit_the_converter(tried: Receiving) -> str:
    first, second = window_taken(tried), window_taken(tried)
    low, high = ends_of(first, tried.digitizer.spec)
    found = int(first.counts.min()), int(first.counts.max())
    require(low <= found[0] and found[1] <= high, f"counts {found[0]} to {found[1]}; due are {low} to {high}")
    for name in ("volts_per_count", "zero_count", "sample_interval_s"):
        told = getattr(first, name), getattr(second, name)
        require(told[0] == told[1], f"{name} = {told[0]}, and {told[1]} in the next window")
    return f"counts {found[0]} to {found[1]} of {low} to {high}"


@promised("saturated tells how many samples clipped: only such that stand at an end, and most of those")
def _counts_saturated_samples(tried: Receiving) -> str:
    codes = tried.digitizer.spec.gain_codes
    quiet = window_taken(tried)
    _check_saturated(quiet, tried.digitizer.spec)
    if tried.player is None:
        return f"{quiet.saturated}; no generator was given that drives it to an end"
    with tried.player.playing(tried.player.sine()):
        tried.clock.sleep_s(tried.settle_s)
        loud = window_taken(tried, gain_code=None if codes is None else max(codes))
    _check_saturated(loud, tried.digitizer.spec)
    return (
        f"{quiet.saturated}, and {loud.saturated} of {loud.counts.size} with a sine at the highest gain code"
    )


def _check_saturated(window: RangeWindow, told: DigitizerSpec) -> None:
    """See that what is told is the number of samples at the ends, whichever code an instrument clips at."""
    low, high = ends_of(window, told)
    lowest, highest = int(window.counts.min()), int(window.counts.max())
    at = {code: int(np.count_nonzero(window.counts == code)) for code in {lowest, highest}}
    at_ends = sum(count for code, count in at.items() if code in (low, high))
    # Some oscilloscopes keep the last code for samples that were never taken. Who can tell leaves out what
    # merely stands at an end: few of many, under a sine that is much too large.
    near = sum(count for code, count in at.items() if code <= low + 1 or code >= high - 1)
    require(
        window.saturated <= near and (near < MANY or window.saturated >= near / 2),
        f"{window.saturated} samples saturated; {at_ends} stand at {low} and {high}, {near} there or next",
    )


@promised("a delay is rounded to whole sample intervals, and the window says to which")
def _rounds_the_delay(tried: Receiving) -> str:
    interval_s = tried.digitizer.spec.sample_interval_s
    starts = [
        window_taken(tried, delay_s=parts * interval_s, sample_count=1).start_s / interval_s
        for parts in (0.0, 0.4, 0.6, 10.3, 400.7)
    ]
    return f"0, 0.4, 0.6, 10.3 and 400.7 intervals begin at {', '.join(f'{one:g}' for one in starts)}"


@promised("one sample can be asked for, and as many as the spec says")
def _takes_any_length(tried: Receiving) -> str:
    most = tried.digitizer.spec.max_sample_count
    for count in (1, 2, most):
        window_taken(tried, sample_count=count)
    return f"1, 2 and {most} samples"


@promised("each gain code of the spec gives a window")
def _takes_every_gain_code(tried: Receiving) -> str:
    codes = tried.digitizer.spec.gain_codes
    if codes is None:
        raise NotApplicable("the digitizer has no gain codes")
    chosen = codes[:: math.ceil(len(codes) / MOST_CODES)]
    for code in chosen:
        window_taken(tried, gain_code=code, sample_count=1)
    return f"{len(chosen)} of {len(codes)} codes"


@promised("each trigger of the spec starts a window")
def _takes_every_trigger(tried: Receiving) -> str:
    told = []
    for trigger in tried.digitizer.spec.triggers:
        if trigger == "generator" and not tried.can_start:
            told.append("not generator: nobody was given who starts it")
            continue
        window_taken(tried, trigger=trigger)
        told.append(trigger)
    return ", ".join(told)


@promised("each product of the spec is what it says: samples, candidates, samples round them")
def _gives_every_product(tried: Receiving) -> str:
    told = tried.digitizer.spec
    for products in told.products:
        found = window_taken(tried, products=products, sample_count=told.max_sample_count).candidates
        if products == "window":
            continue
        with_samples = products in WITH_CORRELATION_WINDOWS
        wrong = [one for one in found if bool(one.correlation_window) != with_samples]
        require(not wrong, f"products {products}: candidates {shown(wrong)}")
        outside = [
            one for one in found if one.first_sample + len(one.correlation_window) > told.max_sample_count
        ]
        require(not outside, f"products {products}: candidates beyond the window, {shown(outside)}")
    return ", ".join(told.products)


@promised("the laser's own pulse gives a window, or is refused")
def _takes_or_refuses_transmit(tried: Receiving) -> str:
    if "digitizer" not in tried.digitizer.spec.triggers:
        asked = tried.request(source="transmit")
        return refused("source transmit", lambda: tried.digitizer.arm(asked), RefusedInput, InstrumentRefused)
    try:
        window_taken(tried, source="transmit", trigger="digitizer")
    except (RefusedInput, InstrumentRefused) as error:
        return f"refused: {error}"
    return "a window"


@promised("every shot index from 0 to 2**32 - 1 comes back")
def _returns_every_shot(tried: Receiving) -> str:
    for shot in (2**32 - 1, 0, 2**31, 65536):
        window_taken(tried, shot=shot, sample_count=1)
    return "4294967295, 0, 2147483648, 65536"


@promised("what the link dropped never becomes less")
def _counts_what_it_dropped(tried: Receiving) -> str:
    before = tried.digitizer.dropped
    window_taken(tried)
    after = tried.digitizer.dropped
    seen = f"{before.damaged} and {before.stale}, after a window {after.damaged} and {after.stale}"
    require(0 <= before.damaged <= after.damaged and 0 <= before.stale <= after.stale, seen)
    return seen


@promised("a second close raises nothing")
def _closes_twice(tried: Receiving) -> str:
    tried.digitizer.close()
    tried.digitizer.close()
    return "closed twice"


@promised("after close arm and read raise LinkClosed; identity and spec still answer")
def _closed_stays_closed(tried: Receiving) -> str:
    digitizer = tried.digitizer
    request = tried.request()
    digitizer.close()
    verbs: tuple[tuple[str, Callable[[], object]], ...] = (
        ("arm", lambda: digitizer.arm(request)),
        ("read", lambda: digitizer.read(READ_TIMEOUT_S)),
    )
    for name, verb in verbs:
        seen = refused(f"{name} after close", verb, LinkClosed)
    require(bool(digitizer.identity) and digitizer.spec.bits > 0, "identity or spec are gone")
    return seen


RULES: tuple[Rule[Receiving], ...] = (
    _identity,
    _spec,
    _takes_a_window,
    _counts_fit_the_converter,
    _counts_saturated_samples,
    _rounds_the_delay,
    _takes_any_length,
    _takes_every_gain_code,
    _takes_every_trigger,
    _gives_every_product,
    _takes_or_refuses_transmit,
    _returns_every_shot,
    _counts_what_it_dropped,
)
CLOSING_RULES: tuple[Rule[Receiving], ...] = (_closes_twice, _closed_stays_closed)
