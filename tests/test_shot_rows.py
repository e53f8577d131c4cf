"""Rows of shots against the chain that takes one at a time."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs

from belahil.errors import RefusedInput
from sim.accuracy import Accuracy
from sim.chain import Chain
from sim.scene import load_scene
from sim.shot_rows import ShotRows


def fractal(**noise):
    scene = load_scene("fractal")
    return structs.replace(scene, altitude_m=700e3, noise=structs.replace(scene.noise, **noise))


def steady_fractal():
    scene = fractal(shot=False, dark_rms_v=None)
    return structs.replace(
        scene, laser=structs.replace(scene.laser, jitter_rad=(0.0, 0.0), energy_jitter=0.0)
    )


def test_without_noise_and_jitter_rows_find_what_the_chain_finds():
    # Given a scene of which only the sampling phase changes from shot to shot
    scene = steady_fractal()
    chain = Chain(scene, Accuracy(1e-4))
    # When rows and chain find the pulse of some shots
    rows = ShotRows(chain).candidates(np.arange(12))
    found = [chain.candidates(shot)[0] for shot in range(12)]
    # Then the means agree within 4.5 standard errors of what phase and rounding to counts make
    first_s = [chain.first_sample_s(shot, chain.whole_window(shot)) for shot in range(12)]
    arrivals = np.array([one.arrival_s + t for one, t in zip(found, first_s, strict=True)])
    widths, amplitudes = [one.fwhm_s for one in found], [one.amplitude_v for one in found]
    for ours, theirs in (
        (rows.arrival_s[:, 0], arrivals),
        (rows.fwhm_s[:, 0], np.array(widths)),
        (rows.amplitude_v[:, 0], np.array(amplitudes)),
    ):
        error = np.hypot(ours.std(ddof=1), theirs.std(ddof=1)) / np.sqrt(12)
        assert abs(ours.mean() - theirs.mean()) < 4.5 * error
    # And the spread is small: no error of a whole sample can hide in it.
    assert arrivals.std() < 0.4e-9
    assert rows.arrival_s[:, 0].std() < 0.4e-9
    assert (rows.found >= 1).all()
    assert not rows.saturated.any()


def test_arrivals_are_in_true_time_whatever_the_clock_does():
    # Given a receiver whose clock is fast, so that it counts 10 ns more on the way to the echo
    scene = steady_fractal()
    fast = structs.replace(scene, electronics=structs.replace(scene.electronics, clock_ppm=100.0))
    # When rows find the echo with it, and with a true clock
    with_error, true = (ShotRows(Chain(one)).candidates(np.arange(12)) for one in (fast, scene))
    # Then both tell the same arrivals, to what sampling phase and rounding make
    assert with_error.arrival_s[:, 0].mean() == pytest.approx(true.arrival_s[:, 0].mean(), abs=0.5e-9)


@pytest.mark.parametrize("tolerance", [0.2, 1e-2, 2e-3, 1e-3, 1e-6])
def test_the_light_of_rows_is_the_chains_at_every_tolerance(tolerance):
    # Given any number of time bins in a sample, of which few divide a step of the shot noise
    scene = fractal(shot=True, dark_rms_v=None)
    scene = structs.replace(
        scene, laser=structs.replace(scene.laser, jitter_rad=(0.0, 0.0), energy_jitter=0.0)
    )
    chain = Chain(scene, Accuracy(tolerance))
    rows, step_s = ShotRows(chain), chain.light_noise[0].step_s
    # When both take the photon rate on those steps
    light = chain.optical(chain.lit())
    begin_s, end_s = light.span_s
    count = math.ceil((end_s - begin_s) / step_s)
    ours = rows._noise.light.samples(np.zeros((1, 2)), np.array([begin_s]), count)[0][0]
    theirs = light.photon_rate_hz(begin_s, step_s, count)
    # Then they agree where bins are fine, and in the photons at any tolerance
    assert ours.sum() == pytest.approx(theirs.sum(), rel=1e-3)
    if tolerance <= 1e-3:
        assert np.abs(ours - theirs).max() < 0.02 * theirs.max()


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [0.2, 1e-2, 1e-3])
def test_shot_noise_spreads_rows_as_it_spreads_the_chain(tolerance):
    # Given shot noise alone
    scene = fractal(shot=True, dark_rms_v=None)
    scene = structs.replace(
        scene, laser=structs.replace(scene.laser, jitter_rad=(0.0, 0.0), energy_jitter=0.0)
    )
    chain = Chain(scene, Accuracy(tolerance))
    # When 150 shots are taken either way
    rows = ShotRows(chain).candidates(np.arange(150)).amplitude_v[:, 0]
    single = np.array([chain.candidates(shot)[0].amplitude_v for shot in range(150)])
    # Then the spread agrees within 4.5 standard errors
    assert abs(np.log(rows.std() / single.std())) < 4.5 / np.sqrt(150)


def test_with_numpys_numbers_rows_find_what_the_chain_finds_shot_by_shot():
    # Given a scene with jitter of the energy and dark noise, and the chain's own generator
    scene = fractal(shot=False)
    scene = structs.replace(scene, laser=structs.replace(scene.laser, jitter_rad=(0.0, 0.0)))
    chain = Chain(scene, Accuracy(1e-5))
    # When rows and chain search the same windows
    rows = ShotRows(chain, generator="numpy").candidates(np.arange(40))
    # Then every best candidate is the same, but for the few counts that fall to the other side
    for shot in range(40):
        best = chain.candidates(shot)[0]
        arrival_s = best.arrival_s + chain.first_sample_s(shot, chain.whole_window(shot))
        assert rows.arrival_s[shot, 0] == pytest.approx(arrival_s, abs=0.1e-9)
        assert rows.amplitude_v[shot, 0] == pytest.approx(best.amplitude_v, rel=0.01)


def test_a_generator_that_is_not_there_is_refused():
    # Given a name, when it is none of the two, then the line names both.
    with pytest.raises(RefusedInput, match="keyed, numpy"):
        ShotRows(Chain(fractal(), Accuracy(1e-3)), generator="legacy")


def test_over_posts_that_are_not_known_no_light_comes_back():
    # Given a terrain model without data in one half, and noise
    chain = Chain(fractal(shot=False), Accuracy(1e-3))
    relief = chain.surface.relief
    known = np.ones(relief.values.shape, dtype=np.bool_)
    known[:, : known.shape[1] // 2] = False
    values = np.where(known, relief.values, np.nan)
    surface = replace(chain.surface, relief=replace(relief, values=values, known=known))
    rows = ShotRows(Chain(chain.scene, Accuracy(1e-3), surface))
    # When shots fall into either half, and far off the model
    found = rows.candidates([0, 1, 2], [(200.0, 0.0), (-200.0, 0.0), (1e5, 0.0)])
    # Then only the first has light, and every number is finite
    assert found.reflectance[0] == pytest.approx(0.17, rel=1e-2)
    assert found.reflectance[1] == found.reflectance[2] == 0
    assert np.isfinite(found.arrival_s).all()
    assert found.amplitude_v[0, 0] > 3 * found.amplitude_v[1:, 0].max()


def test_a_shot_is_the_same_alone_and_in_any_row():
    # Given all effects, when shot 77 is drawn alone and among others, then its numbers are equal.
    rows = ShotRows(Chain(fractal(), Accuracy(1e-3)))
    places_m = np.random.default_rng(1).uniform(-100, 100, (130, 2))
    many = rows.candidates(np.arange(130), places_m)
    alone = rows.candidates([77], places_m[77:78])
    for name in ("found", "saturated"):
        assert getattr(many, name)[77] == getattr(alone, name)[0]
    for name in ("arrival_s", "fwhm_s", "amplitude_v"):
        np.testing.assert_allclose(getattr(many, name)[77], getattr(alone, name)[0], rtol=1e-9)


@pytest.mark.slow
def test_the_spread_of_arrivals_is_the_chains():
    # Given night with shot noise, jitter of beam and energy, and dark noise
    chain = Chain(fractal(), Accuracy(1e-3))
    count = 600
    # When as many shots are taken either way
    rows = ShotRows(chain).candidates(np.arange(count))
    single = np.array(
        [
            chain.candidates(shot)[0].arrival_s + chain.first_sample_s(shot, chain.whole_window(shot))
            for shot in range(count)
        ]
    )
    # Then mean and spread agree within 4.5 standard errors
    ours = rows.arrival_s[:, 0]
    spread = np.hypot(ours.std(), single.std()) / np.sqrt(count)
    assert abs(ours.mean() - single.mean()) < 4.5 * spread
    assert abs(np.log(ours.std() / single.std())) < 4.5 / np.sqrt(count)


def test_shot_noise_widens_the_spread_and_absent_noise_draws_nothing(monkeypatch):
    # Given the same scene with and without shot noise, and no other noise
    without = ShotRows(Chain(fractal(shot=False, dark_rms_v=None), Accuracy(1e-3)))
    with_ = ShotRows(Chain(fractal(shot=True, dark_rms_v=None), Accuracy(1e-3)))
    # When both find the same shots, then shot noise alone makes the difference
    a, b = (rows.candidates(np.arange(64)).amplitude_v[:, 0] for rows in (without, with_))
    assert b.mean() == pytest.approx(a.mean(), rel=0.05)
    assert b.std() > 1.2 * a.std()

    # And where no noise is called for, none is drawn
    def never(*_):
        raise AssertionError("drew noise that the scene does not name")

    monkeypatch.setattr("sim.keyed.KeyedDraws.coloured", never)
    monkeypatch.setattr("sim.keyed.KeyedDraws.normals", never)
    without.candidates([0, 1])


@pytest.mark.parametrize("name", ["plane", "previous-model"])
def test_scenes_without_a_terrain_model_are_refused_in_one_line(name):
    # Given a scene that rows cannot serve, when asked for, then the line names what can.
    with pytest.raises(RefusedInput, match=r"Chain\.candidates"):
        ShotRows(Chain(load_scene(name)))


@pytest.mark.slow
def test_a_pool_of_noise_says_so_and_finds_what_independent_noise_finds():
    # Given 64 stored windows of noise, and noise of its own for each shot
    chain = Chain(fractal(shot=False), Accuracy(1e-3))
    pooled, own = ShotRows(chain, pool_windows=64), ShotRows(chain)
    # When both find the pulses of 400 shots
    a, b = pooled.candidates(np.arange(400)), own.candidates(np.arange(400))
    # Then each says where its noise came from, spreads agree within 4.5 standard errors of 64 windows, and
    # shots that share a window are not the same shot
    assert a.noise == "pool of 64 windows, shared by the shots"
    assert b.noise == "independent for each shot"
    assert abs(np.log(a.arrival_s[:, 0].std() / b.arrival_s[:, 0].std())) < 4.5 / np.sqrt(2 * 64)
    assert np.unique(a.arrival_s[:, 0]).size == 400


def test_a_pool_of_less_than_nothing_is_refused():
    # Given -1 windows, when asked for, then it is refused in one line.
    with pytest.raises(RefusedInput, match="0 \\(no pool\\)"):
        ShotRows(Chain(fractal(), Accuracy(1e-3)), pool_windows=-1)


def test_shots_below_zero_are_refused():
    # Given a negative shot, when asked for, then it is refused.
    with pytest.raises(RefusedInput, match="from 0 on"):
        ShotRows(Chain(fractal(), Accuracy(1e-3))).candidates([-1])


def test_shots_that_are_no_whole_numbers_are_refused_and_no_shots_are_none():
    # Given 1.5 as the number of a shot, when asked for, then it is refused; no shots at all are fine.
    rows = ShotRows(Chain(fractal(), Accuracy(1e-3)))
    with pytest.raises(RefusedInput, match="whole numbers"):
        rows.candidates([0.0, 1.5])
    assert rows.candidates([]).found.size == 0


@pytest.mark.parametrize("place", [np.nan, np.inf])
def test_a_place_that_is_none_is_refused(place):
    with pytest.raises(RefusedInput, match="centres_m of rows of shots: every number must be finite"):
        ShotRows(Chain(steady_fractal())).candidates([0], [[place, 0.0]])
