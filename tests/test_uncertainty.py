"""Uncertainties and verdicts: numbers as JCGM 100 writes them, decisions with a guard band."""

from __future__ import annotations

import math
import re
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from belahil.config import LimitsTable
from belahil.uncertainty import budget, combined, prefix_power, written
from belahil.values import Estimate
from belahil.verdict import checks, decide, overall


@pytest.mark.parametrize(
    ("value", "spread", "power", "text"),
    [
        (100.02147e-3, 0.35e-6, -3, "100.02147(35)"),  # the example of JCGM 100, 7.2.2, in g
        (19.01234e6, 3456.0, 6, "19.0123(35)"),
        (0.0996, 0.00996, 0, "0.100(10)"),  # the uncertainty rounds up into a new figure
        (-0.1234, 0.056, 0, "-0.123(56)"),
        (1234.5, 321.0, 0, "1230(320)"),
        (5.2, 1.26, 0, "5.2(1.3)"),
        (0.0, 1.0, 0, "0.0(1.0)"),
        (1e-9, 5e-3, 0, "0.0000(50)"),
        (5.19, 0.0, 0, "5.19"),
        (5.19, math.inf, 0, "5.19(?)"),
    ],
)
def test_a_number_is_written_to_two_figures_of_its_uncertainty(
    value: float, spread: float, power: int, text: str
) -> None:
    assert written(value, spread, power) == text


@given(
    st.floats(-1e12, 1e12),
    st.floats(1e-15, 1e12),
    st.sampled_from([-9, -6, -3, 0, 3, 6]),
)
def test_what_is_written_is_within_half_a_last_digit(value: float, spread: float, power: int) -> None:
    # when a result is written
    text = written(value, spread, power)
    number, inside = re.fullmatch(r"(-?[\d.]+)\(([\d.]+)\)", text).groups()  # type: ignore[union-attr]
    # then the uncertainty has two figures, both numbers are within half a unit of the last one
    place = Decimal(inside) if "." in inside else Decimal(inside).scaleb(Decimal(number).as_tuple().exponent)  # type: ignore[arg-type]
    step = Decimal(10) ** (place.adjusted() - 1)
    assert abs(place - Decimal(repr(spread)).scaleb(-power)) <= step / 2
    assert abs(Decimal(number) - Decimal(repr(value)).scaleb(-power)) <= step / 2
    assert place % step == 0


@given(st.floats(1e-15, 1e11))
def test_a_prefix_leaves_one_to_three_digits_before_the_point(size: float) -> None:
    assert 1 - 1e-9 <= size / 10 ** prefix_power(size, "V") < 1000


def test_a_budget_adds_up() -> None:
    lines = budget("gain, code 4", "1", {"noise": 3e-3, "attenuator": 4e-3, "nothing": 0.0})
    assert [line.source for line in lines] == ["attenuator", "noise", "nothing"]
    assert combined(line.value for line in lines) == pytest.approx(5e-3, rel=1e-15)
    assert sum(line.share for line in lines) == pytest.approx(1, rel=1e-15)
    assert budget("gain", "1", {"nothing": 0.0})[0].share == 0


@pytest.mark.parametrize(
    ("value", "spread", "decision"),
    [
        (19e6, 0.5e6, "pass"),  # exactly at the guard band
        (19e6, 0.51e6, "undecided"),
        (20.5e6, 0.1e6, "fail"),
        (20.5e6, 0.25e6, "undecided"),  # the limit is not outside the guard band
        (17e6, 0.4e6, "fail"),
        (20e6, 0.0, "pass"),
        (19e6, math.inf, "undecided"),
        (math.nan, 0.1e6, "undecided"),
    ],
)
def test_a_decision_keeps_two_standard_uncertainties_from_the_limit(
    value: float, spread: float, decision: str
) -> None:
    assert decide(18e6, 20e6, Estimate(value, spread, "Hz")) == decision


def test_the_worst_decision_is_the_verdict() -> None:
    good, bad, open_ = Estimate(5.0, 0.01), Estimate(9.0, 0.01), Estimate(6.0, 0.01)
    limits = LimitsTable(gain=(4.0, 6.0), cutoff_hz=(18e6, 20e6))
    assert overall(checks(limits, {"gain": [("code 1", good)]})) == "pass"
    assert overall(checks(limits, {"gain": [("code 1", good), ("code 2", open_)]})) == "undecided"
    assert overall(checks(limits, {"gain": [("code 1", bad), ("code 2", open_)]})) == "fail"


def test_what_could_not_be_measured_is_undecided() -> None:
    limits = LimitsTable(gain=(4.0, 6.0))
    assert overall(checks(limits, {"gain": [("code 1", None)]})) == "undecided"
    assert overall(checks(limits, {"gain": []})) == "undecided"


def test_without_a_limit_that_applies_there_is_no_verdict() -> None:
    values = {"gain": [("code 1", Estimate(5.0, 0.1))]}
    assert overall(checks(None, values)) == "none"
    assert overall(checks(LimitsTable(), values)) == "none"
    assert overall(checks(LimitsTable(cutoff_hz=(1.0, 2.0)), values)) == "none"
