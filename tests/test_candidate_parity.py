"""Candidates as reported and as found again: every kind of difference is told for what it is."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from belahil.errors import RefusedInput
from belahil.pulse_fit import GaussianPulse
from belahil.receiver import BELA_GRM, GALA_LIKE, ReceiverSpec
from belahil.values import Candidate, RangeWindow
from procedures.candidate_parity import Tolerances, compare
from sim.rfm import RangeFinder

WITHIN = Tolerances()
FINDERS = {spec.name: RangeFinder.of(spec) for spec in (BELA_GRM, GALA_LIKE)}


def searched(seed: int, spec: ReceiverSpec = BELA_GRM, samples: int = 1500) -> RangeWindow:
    """A window with a few pulses in noise, and with what our range finder reports of it."""
    rng = np.random.default_rng(seed)
    interval_s = spec.digitizer.sample_interval_s
    volts = 1e-3 * rng.standard_normal(samples)
    for _ in range(rng.integers(0, 4)):
        pulse = GaussianPulse(
            rng.uniform(0, samples) * interval_s, rng.uniform(20e-9, 90e-9), rng.uniform(3e-3, 0.1)
        )
        volts += pulse.at(np.arange(samples) * interval_s)
    counts = np.round(volts / 0.5e-3 + 2048).astype(np.int16)
    window = RangeWindow(counts, 0.5e-3, 2048.0, interval_s, 0.0, 4, seed)
    return FINDERS[spec.name].report(window, "window_and_candidates")


seeds = st.integers(0, 10**6)


@given(seeds)
@settings(max_examples=20)
def test_loops_that_round_otherwise_find_the_same(seed: int) -> None:
    # Given what the compiled loops report, where numba is there, and the plain ones that search again
    plain = replace(FINDERS["bela-grm"], compiled=False)
    found = compare(searched(seed), plain, Tolerances(1e-15, 1e-9, 1e-9))
    assert found.status == "ok"


def changed(window: RangeWindow, place: int, **words: object) -> RangeWindow:
    candidates = list(window.candidates)
    candidates[place] = replace(candidates[place], **words)  # type: ignore[arg-type]
    return replace(window, candidates=tuple(candidates))


@given(seeds, st.sampled_from([BELA_GRM, GALA_LIKE]), st.integers(4, 1500))
def test_what_we_report_we_find_again(seed: int, spec: ReceiverSpec, samples: int) -> None:
    window = searched(seed, spec, samples)
    found = compare(window, FINDERS[spec.name], Tolerances(0.0, 0.0, 0.0))
    assert found.status == "ok"
    assert len(found.pairs) == len(window.candidates)
    assert found.in_order
    # and candidates without their samples, as some receivers report them, agree as well
    bare = tuple(replace(one, correlation_window=(), first_sample=0) for one in window.candidates)
    assert compare(replace(window, candidates=bare), FINDERS[spec.name], WITHIN).status == "ok"


@given(seeds, st.integers(0, 3), st.sampled_from(["arrival_s", "fwhm_s", "amplitude_v"]), st.floats(0.1, 10))
def test_a_number_that_is_off_differs_from_its_tolerance_on(
    seed: int, place: int, name: str, times: float
) -> None:
    # Given one candidate with one number that is off by so many tolerances
    window = searched(seed)
    place %= len(window.candidates)
    value = getattr(window.candidates[place], name)
    step = WITHIN.arrival_s if name == "arrival_s" else 1e-3 * value
    told = changed(window, place, **{name: value + times * step})
    found = compare(told, FINDERS["bela-grm"], WITHIN)
    # Then the window differs if it is more than one, by that much and in no other number
    if not math.isclose(times, 1.0, rel_tol=1e-3):
        assert found.status == ("differs" if times > 1 else "ok")
    assert (found.missing, found.extra) == ((), ())
    (pair,) = (one for one in found.pairs if one.reported == told.candidates[place])
    assert getattr(pair, name) == pytest.approx(times * step, rel=1e-3)
    others = {"arrival_s", "fwhm_s", "amplitude_v", "first_sample", "samples_differing"} - {name}
    assert all(getattr(pair, other) == 0 for other in others)


@given(seeds, st.integers(0, 3))
def test_a_candidate_that_one_side_lacks_is_missing_or_extra(seed: int, place: int) -> None:
    window = searched(seed)
    place %= len(window.candidates)
    left = window.candidates[:place] + window.candidates[place + 1 :]
    found = compare(replace(window, candidates=left), FINDERS["bela-grm"], WITHIN)
    assert found.status == ("differs" if left else "no_candidates")
    assert [one.arrival_s for one in found.missing] == [window.candidates[place].arrival_s]
    # and the other way round: one far from all that we find
    far_s = max(
        np.linspace(0, 1499 * 12.5e-9, 60),
        key=lambda at_s: min(abs(at_s - one.arrival_s) for one in window.candidates),
    )
    more = (*window.candidates, Candidate(float(far_s), 30e-9, 5e-3))
    found = compare(replace(window, candidates=more), FINDERS["bela-grm"], WITHIN)
    assert (found.status, found.missing, found.extra) == ("differs", (), more[-1:])


@given(seeds, st.permutations(range(4)))
def test_another_order_is_told_and_is_no_difference(seed: int, order: list[int]) -> None:
    window = searched(seed)
    kept = [place for place in order if place < len(window.candidates)]
    told = replace(window, candidates=tuple(window.candidates[place] for place in kept))
    found = compare(told, FINDERS["bela-grm"], Tolerances(0.0, 0.0, 0.0))
    assert found.status == "ok"
    assert found.in_order == (kept == sorted(kept))


@given(seeds, st.integers(0, 3), st.integers(0, 41), st.integers(1, 2000))
@settings(max_examples=50)
def test_every_sample_of_a_correlation_window_counts(seed: int, place: int, at: int, by: int) -> None:
    window = searched(seed)
    place %= len(window.candidates)
    one = window.candidates[place]
    counts = list(one.correlation_window)
    counts[at] += by
    found = compare(changed(window, place, correlation_window=tuple(counts)), FINDERS["bela-grm"], WITHIN)
    assert found.status == "differs"
    assert [pair.samples_differing for pair in found.pairs].count(1) == 1
    # and so do its place and its length
    moved = changed(window, place, first_sample=one.first_sample + (1 if one.first_sample == 0 else -1))
    assert compare(moved, FINDERS["bela-grm"], WITHIN).status == "differs"
    short = changed(window, place, correlation_window=one.correlation_window[:-1])
    assert compare(short, FINDERS["bela-grm"], WITHIN).status == "differs"


def test_what_cannot_be_compared_has_a_status() -> None:
    window, finder = searched(5), FINDERS["bela-grm"]
    assert compare(replace(window, counts=window.counts[:0]), finder, WITHIN).status == "no_samples"
    assert compare(replace(window, counts=window.counts[:3]), finder, WITHIN).status == "too_few_samples"
    assert compare(replace(window, candidates=()), finder, WITHIN).status == "no_candidates"
    # and a window in which both find nothing agrees
    flat = replace(window, counts=np.full(100, 2048, np.int16), candidates=())
    assert compare(flat, finder, WITHIN).status == "ok"


@pytest.mark.parametrize("wrong", [-1e-12, math.nan, math.inf])
def test_a_tolerance_that_is_none_is_refused(wrong: float) -> None:
    with pytest.raises(RefusedInput, match="arrival_s"):
        Tolerances(arrival_s=wrong)
