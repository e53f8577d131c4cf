"""What every `Digitizer` refuses, never gives, or gives up; and that it works afterwards."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from belahil.conformance.digitizer import window_taken
from belahil.conformance.rules import NotApplicable, promised, refused, require
from belahil.conformance.stand import READ_TIMEOUT_S
from belahil.errors import InstrumentError, InstrumentRefused, LinkTimeout, RefusedInput
from belahil.values import PRODUCTS, TRIGGERS

if TYPE_CHECKING:
    from belahil.conformance.rules import Rule
    from belahil.conformance.stand import Receiving

TIMEOUT_S = 0.3
LATE_PART, LATE_S = 0.1, 0.5
"""How much later than its time-out a read may give up."""
PROMPT_S = 0.5


@promised("a read with nothing armed is an error at once")
def _refuses_unarmed_read(tried: Receiving) -> str:
    begun_s = tried.clock.now_s()
    seen = refused("a read before arm", lambda: tried.digitizer.read(10.0), InstrumentError)
    took_s = tried.clock.now_s() - begun_s
    require(took_s <= PROMPT_S, f"{seen}, after {took_s:g} s")
    return seen


def _refused_request(tried: Receiving, name: str, **asked: object) -> str:
    request = tried.request(**asked)
    return refused(name, lambda: tried.digitizer.arm(request), RefusedInput, InstrumentRefused)


@promised("a gain code that the spec does not have is refused")
def _refuses_gain_code(tried: Receiving) -> str:
    codes = tried.digitizer.spec.gain_codes
    if codes is None:
        return _refused_request(tried, "gain code 0 where there are none", gain_code=0)
    _refused_request(tried, "no gain code where there are some", gain_code=None)
    return _refused_request(tried, f"gain code {max(codes) + 1}", gain_code=max(codes) + 1)


@promised("a window of no sample, or of more than the spec says, is refused")
def _refuses_length(tried: Receiving) -> str:
    most = tried.digitizer.spec.max_sample_count
    _refused_request(tried, "no sample", sample_count=0)
    _refused_request(tried, "-1 samples", sample_count=-1)
    return _refused_request(tried, f"{most + 1} samples", sample_count=most + 1)


@promised("a delay that is no number is refused; a negative one too, or the window begins there")
def _refuses_delay(tried: Receiving) -> str:
    _refused_request(tried, "a delay of nan", delay_s=math.nan)
    _refused_request(tried, "a delay of inf", delay_s=math.inf)
    delay_s = -3 * tried.digitizer.spec.sample_interval_s
    try:
        window_taken(tried, delay_s=delay_s, sample_count=1)
    except (RefusedInput, InstrumentRefused) as error:
        return f"refused: {error}"
    return f"the window begins at {delay_s:g} s"


@promised("a trigger and products that the spec does not have are refused")
def _refuses_foreign_words(tried: Receiving) -> str:
    told = tried.digitizer.spec
    asked: list[tuple[str, str]] = [("trigger", one) for one in TRIGGERS if one not in told.triggers]
    asked += [("products", one) for one in PRODUCTS if one not in told.products]
    if not asked:
        raise NotApplicable("the spec has every trigger and every product")
    return [_refused_request(tried, f"{key} {word}", **{key: word}) for key, word in asked][-1]


@promised("after a refused arm nothing is armed, and the next arm gives its window")
def _works_after_refusal(tried: Receiving) -> str:
    tried.digitizer.arm(tried.request())
    _refused_request(tried, "no sample", sample_count=0)
    seen = refused(
        "a read after a refused arm", lambda: tried.digitizer.read(READ_TIMEOUT_S), InstrumentError
    )
    window_taken(tried)
    return f"{seen}; then a window"


@promised("a window is read once")
def _reads_once(tried: Receiving) -> str:
    window_taken(tried)
    return refused("a second read", lambda: tried.digitizer.read(READ_TIMEOUT_S), InstrumentError)


@promised("arming again replaces the window: the older one never comes")
def _rearms(tried: Receiving) -> str:
    most = tried.digitizer.spec.max_sample_count
    older = tried.request(sample_count=most)
    tried.digitizer.arm(older)
    newer = window_taken(tried, sample_count=min(10, most))
    return f"armed with shots {older.shot} and {newer.shot}, {newer.shot} came"


@promised("without a trigger a read ends with LinkTimeout when its time is over, and the next window comes")
def _times_out(tried: Receiving) -> str:
    if "generator" not in tried.digitizer.spec.triggers:
        raise NotApplicable("no trigger of this digitizer waits for anybody")
    tried.digitizer.arm(tried.request(trigger="generator"))
    begun_s = tried.clock.now_s()
    seen = refused("a read without a trigger", lambda: tried.digitizer.read(TIMEOUT_S), LinkTimeout)
    took_s = tried.clock.now_s() - begun_s
    in_time = (1 - LATE_PART) * TIMEOUT_S <= took_s <= (1 + LATE_PART) * TIMEOUT_S + LATE_S
    require(in_time, f"{seen}, after {took_s:.3g} s; asked for {TIMEOUT_S:g} s")
    newer = window_taken(tried)
    return f"after {took_s:.3g} s of {TIMEOUT_S:g} s: {seen}; then shot {newer.shot}"


RULES: tuple[Rule[Receiving], ...] = (
    _refuses_gain_code,
    _refuses_length,
    _refuses_delay,
    _refuses_foreign_words,
    _refuses_unarmed_read,
    _works_after_refusal,
    _reads_once,
    _rearms,
    _times_out,
)
