"""Keyed random numbers: the published words, their distribution, and what keys keep apart."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from scipy.special import ndtri

from belahil import butterworth
from belahil.errors import RefusedInput
from belahil.pole_response import SampledNoise
from sim import reference_noise
from sim.keyed import KeyedDraws, first_normals, first_uniforms, first_words, key_of, loops, philox, words

INTERVAL_S = 12.5e-9
UNIT = SampledNoise(butterworth.poles(19e6, 3), 0, INTERVAL_S)


@pytest.mark.parametrize(
    ("key", "counter", "expected"),
    [
        ((0, 0), (0, 0, 0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
        ((2**32 - 1,) * 2, (2**32 - 1,) * 4, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
        (
            (0xA4093822, 0x299F31D0),
            (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
            (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
        ),
    ],
)
def test_the_words_are_the_published_ones(key, counter, expected):
    # Given the test vectors of the generator's authors, when the words are made, then they are theirs.
    assert tuple(int(word) for word in philox(key, counter)) == expected


@given(st.integers(0, 2**64 - 1), st.integers(0, 2**63 - 1), st.integers(0, 3000), st.integers(1, 1500))
def test_compiled_deviates_are_the_quantiles_of_the_words(seed, shot, first, count):
    # Given any stretch of any stream
    key = key_of(seed, shot, "noise")
    # When the loops that serve here draw it
    drawn = loops().normals(key, first, count)
    # Then each is the quantile of its word, as double precision has it
    word = words(key, first, count)
    exact = -ndtri(((word & 0x7FFFFFFF) + 0.5) / 2.0**32) * np.where(word >> 31, -1, 1)
    assert np.abs(drawn - exact).max() < 1e-5


def test_a_longer_draw_begins_as_a_shorter_one_and_any_place_is_found_alone():
    # Given a long draw, when parts of it are asked for, then they are the same numbers.
    key = key_of(5, 7, "noise")
    whole = loops().normals(key, 0, 5000)
    assert np.array_equal(loops().normals(key, 0, 300), whole[:300])
    assert np.array_equal(loops().normals(key, 1234, 2000), whole[1234:3234])


def test_deviates_are_normal_as_numpys_are():
    # Given as many deviates of ours and of NumPy's
    ours = np.concatenate([loops().normals(key_of(1, shot, "noise"), 0, 16_064) for shot in range(250)])
    theirs = np.random.default_rng(1).standard_normal(ours.size)
    # When both meet the same tests, then both pass: moments within 4.5 standard errors, the distribution
    # and the tails (p above 1e-4), and no correlation with the next numbers.
    for sample in (ours.astype(np.float64), theirs):
        n = sample.size
        assert abs(sample.mean()) < 4.5 / np.sqrt(n)
        assert abs(sample.var() - 1) < 4.5 * np.sqrt(2 / n)
        assert abs((sample**3).mean()) < 4.5 * np.sqrt(15 / n)
        assert abs((sample**4).mean() - 3) < 4.5 * np.sqrt(96 / n)
        assert stats.kstest(sample[:500_000], "norm").pvalue > 1e-4
        beyond = np.count_nonzero(np.abs(sample) > 4)
        assert stats.binomtest(beyond, n, 2 * stats.norm.sf(4)).pvalue > 1e-4
        for lag in (1, 2, 63, 64, 128, 256):
            assert abs(np.mean(sample[lag:] * sample[:-lag])) < 4.5 / np.sqrt(n - lag)


def test_shots_seeds_and_effects_have_streams_of_their_own():
    # Given streams that differ in one part of the key, when drawn, then they are not correlated.
    size = 200_000
    base = loops().normals(key_of(1, 1, "noise"), 0, size)
    for other in (key_of(2, 1, "noise"), key_of(1, 2, "noise"), key_of(1, 1, "sunlight")):
        assert abs(np.mean(base * loops().normals(other, 0, size))) < 4.5 / np.sqrt(size)


def test_neighbouring_shots_have_uniform_and_independent_first_numbers():
    # Given the first number of very many shots
    drawn = first_uniforms(3, np.arange(200_000), "sampling_phase")
    # When they are counted in 1000 classes, then chi-square does not tell them from uniform ones
    assert stats.chisquare(np.histogram(drawn, 1000, (0, 1))[0]).pvalue > 1e-4
    assert abs(np.corrcoef(drawn[1:], drawn[:-1])[0, 1]) < 4.5 / np.sqrt(drawn.size)


def test_first_numbers_of_many_shots_are_those_of_each():
    # Given draws of one shot, when many are drawn at once, then its numbers are the same.
    one = KeyedDraws(9, 12)
    many = np.array([3, 12, 500])
    assert one.uniform("sampling_phase") == first_uniforms(9, many, "sampling_phase")[1]
    assert np.array_equal(one.stream("pointing").standard_normal(2), first_normals(9, many, "pointing", 2)[1])
    assert first_words(9, many, "energy", 5).shape == (3, 5)
    assert 0 <= one.stream("dark").integers(7) < 7
    assert one.stream("energy").standard_normal().shape == ()


def test_coloured_noise_has_the_covariance_of_the_filter():
    # Given coloured noise of 200 windows
    drawn = np.array([KeyedDraws(1, shot).coloured("noise", UNIT, 16_064) for shot in range(200)])
    # When its covariance is taken at lags, then it is the exact one within 4.5 standard errors
    from belahil.pole_response import autocovariance

    lags = np.arange(6)
    exact = autocovariance(butterworth.poles(19e6, 3), lags * INTERVAL_S)
    exact = exact / exact[0]
    spread = np.sqrt(
        2 * np.sum(autocovariance(butterworth.poles(19e6, 3), np.arange(-40, 41) * INTERVAL_S) ** 2)
    )
    spread /= autocovariance(butterworth.poles(19e6, 3), 0.0)
    for lag in lags:
        found = np.mean(drawn[:, lag:].astype(np.float64) * drawn[:, : 16_064 - lag])
        assert abs(found - exact[lag]) < 4.5 * spread / np.sqrt(drawn.size)


def test_compiled_and_obvious_loops_agree():
    # Given a window of noise and an echo that clips, when both loops digitize, then they agree.
    key = key_of(1, 2, "noise")
    assert UNIT.taps is not None
    fast, slow = (one.coloured(key, UNIT.taps, 3001) for one in (loops(), reference_noise))
    assert np.abs(fast - slow).max() < 2e-5
    for count in (0, 1):
        assert [one.coloured(key, UNIT.taps, count).shape for one in (loops(), reference_noise)] == [
            (count,)
        ] * 2
    echo_v = 1.5 * np.hanning(60)
    case = (slow * np.float32(1e-3), echo_v, 77, (1.01, 0.99), (1e-3, -1e-3), 2 / 4096, 12)
    (ours, beyond), (theirs, also) = loops().digitized(*case), reference_noise.digitized(*case)
    assert np.array_equal(ours, theirs)
    assert beyond == also > 0


def test_a_filter_that_remembers_long_is_drawn_by_its_recursion():
    # Given a high-pass of 100 kHz, when noise is drawn, then it still has unit rms and needs no taps.
    slow = SampledNoise(butterworth.poles(19e6, 3, 100e3), 1, INTERVAL_S)
    assert slow.taps is None
    drawn = np.array([KeyedDraws(1, shot).coloured("noise", slow, 16_064) for shot in range(20)])
    assert drawn.std() == pytest.approx(1, abs=0.02)


@pytest.mark.parametrize(("seed", "shot"), [(-1, 0), (0, -1), (2**64, 0), (0, 2**64)])
def test_numbers_outside_the_key_are_refused(seed, shot):
    # Given a key that is too large or negative, when asked for, then one line says what is allowed.
    with pytest.raises(RefusedInput, match=r"2\^64 - 1"):
        key_of(seed, shot, "noise")
