from __future__ import annotations

import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from belahil.errors import RefusedInput
from procedures.coherent import DISTANCE_BINS, alias_hz, coherent_frequency, default_frequencies

RATE_HZ, COUNT = 80e6, 16064


def cycles(frequency_hz: float, rate_hz: float = RATE_HZ, count: int = COUNT) -> int:
    number = frequency_hz * count / rate_hz
    assert number == pytest.approx(round(number), abs=1e-6)
    return round(number)


@given(st.floats(1e4, 120e6))
def test_every_sample_of_a_coherent_sine_has_its_own_phase(wanted_hz: float) -> None:
    # Given any wanted frequency
    made = coherent_frequency(wanted_hz, RATE_HZ, COUNT)
    # Then it is near, and the phases of all samples differ
    whole = cycles(made)
    assert len({whole * n % COUNT for n in range(COUNT)}) == COUNT
    assert abs(made - wanted_hz) <= 8 * RATE_HZ / COUNT


@given(st.floats(1e4, 120e6))
def test_lines_of_two_converters_stay_away(wanted_hz: float) -> None:
    made = coherent_frequency(wanted_hz, RATE_HZ, COUNT)
    own = alias_hz(made, RATE_HZ)
    lines = [alias_hz(k * RATE_HZ / 4, RATE_HZ) for k in range(4)]
    lines += [alias_hz(RATE_HZ / 2 - own, RATE_HZ), *(alias_hz(k * made, RATE_HZ) for k in (2, 3))]
    assert min(abs(own - line) for line in lines) > DISTANCE_BINS * RATE_HZ / COUNT * 0.999


@pytest.mark.parametrize(("max_hz", "beyond"), [(10e6, 0), (30e6, 0), (45e6, 0), (58e6, 4), (120e6, 4)])
def test_default_grid_covers_what_the_generator_reaches(max_hz: float, beyond: int) -> None:
    made = default_frequencies(RATE_HZ, COUNT, max_hz, 24)
    assert len(made) == len(set(made)) == 24
    assert list(made) == sorted(made)
    assert made[0] == pytest.approx(0.1e6, abs=5 * RATE_HZ / COUNT)
    assert made[-1] <= max_hz
    below = [one for one in made if one < RATE_HZ / 2]
    assert len(made) - len(below) == beyond
    assert below[-1] == pytest.approx(min(max_hz, 38e6), abs=10 * RATE_HZ / COUNT)
    assert all(42e6 - 5e4 < one < 58e6 + 5e4 for one in made if one > RATE_HZ / 2)
    assert all(math.gcd(cycles(one), COUNT) == 1 and cycles(one) % 2 for one in made)


def test_default_grid_of_another_receiver() -> None:
    made = default_frequencies(200e6, 32000, 120e6, 12)
    assert [cycles(one, 200e6, 32000) % 2 for one in made] == [1] * 12
    assert made[-1] == pytest.approx(95e6, rel=1e-3)


@given(st.fractions(Fraction(1, 900), Fraction(3), max_denominator=997))
def test_alias_is_the_distance_to_the_nearest_multiple(ratio: Fraction) -> None:
    expected = min(ratio % 1, 1 - ratio % 1)
    assert alias_hz(float(ratio) * 80e6, 80e6) == pytest.approx(float(expected) * 80e6, abs=1e-6)


def test_impossible_grids_are_refused() -> None:
    with pytest.raises(RefusedInput, match="too few"):
        coherent_frequency(10e6, 80e6, 12)
    with pytest.raises(RefusedInput, match="at least 3"):
        default_frequencies(RATE_HZ, COUNT, 30e6, 2)
    with pytest.raises(RefusedInput, match="generator above"):
        default_frequencies(RATE_HZ, COUNT, 50e3)
