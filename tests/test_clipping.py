"""Receivers that do not count what they clip: a window at the end of its span takes no part in a fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hidden_receivers import InMemory

from belahil.bench import open_bench
from belahil.config import simulated
from belahil.stimuli import NoSignal, Sine
from belahil.values import RangeWindow, Shot
from procedures import characterize, noise
from procedures.characterize import GainOptions
from procedures.clipping import span_of, with_clipping
from procedures.noise import NoiseOptions


def _shot(counts: list[int], zero_count: float = 0.0, saturated: int = 0) -> Shot:
    window = RangeWindow(np.array(counts, np.int16), 1e-3, zero_count, 12.5e-9, 0.0, 4, 0, saturated)
    return Shot(Sine(1e6, 0.1), window, "2030-01-01T00:00:00.000+00:00")


@pytest.mark.parametrize(
    ("counts", "zero_count", "bits", "saturated"),
    [
        ([0, 2047, 2047, 5], 0.0, 12, 2),
        ([-2048, 0, -2048, 2047], 0.0, 12, 3),
        ([0, 2047, 2046, 5], 0.0, 12, 0),  # one may be an extreme of the noise
        ([0, 2047, 2047, 5], 2048.0, 12, 0),  # numbered from zero, that is the middle
        ([0, 0, 100, 300], 2048.0, 12, 2),
        ([4095, 4095, 4095, 1000], 0.0, 12, 3),  # counts above 2047 are numbered from zero
        ([0, 0, 100, 300], 0.0, 12, 0),
        ([32767, 32767, 0, 1], 20000.0, 16, 2),  # 16 bits are numbered about zero only
        ([], 0.0, 12, 0),
    ],
)
def test_samples_at_an_end_code_count_as_clipped(
    counts: list[int], zero_count: float, bits: int, saturated: int
) -> None:
    assert with_clipping(_shot(counts, zero_count), bits).window.saturated == saturated


def test_what_the_receiver_counts_is_left_alone() -> None:
    shot = _shot([2047, 2047, 2047], saturated=1)
    assert with_clipping(shot, 12) is shot


def test_windows_that_clip_unsaid_are_not_fitted() -> None:
    # given a sweep with amplitudes that clip, and the same windows of a receiver that counts no clipped one
    options = GainOptions(
        codes=(4,), amplitudes_vpp=(50e-3, 480e-3), frequencies_hz=(1e6, 5e6, 15e6, 20e6, 29e6)
    )
    run = InMemory([])
    with open_bench(simulated()) as bench:
        plan = characterize.plan(bench, options)
        characterize.measure(bench, run, plan)
    silent = [replace(one, window=replace(one.window, saturated=0)) for one in run.shots]
    assert any(one.window.saturated for one in run.shots)
    # when both are analysed
    said, unsaid = (characterize.analyse(plan, shots, simulated()).results for shots in (run.shots, silent))
    # then the same windows are left out, and the numbers are equal
    assert said["points"]["clipped"] >= 3
    assert unsaid == said


def test_dark_windows_that_clip_unsaid_give_no_noise() -> None:
    run = InMemory([])
    with open_bench(simulated()) as bench:
        plan = noise.plan(bench, NoiseOptions(codes=(4,), dark_windows=1, laser="off"))
        noise.measure(bench, run, plan)
    (shot,) = run.shots
    assert isinstance(shot.played, NoSignal)
    # given an offset that pushes half of the noise beyond the highest code
    _, high = span_of(shot.window, plan.bits)
    noisy = shot.window.counts - np.median(shot.window.counts)
    counts = np.minimum(noisy + high, high).astype(np.int16)
    at_the_end = replace(shot, window=replace(shot.window, counts=counts))
    assert noise.analyse(plan, [shot], simulated()).results["gain_codes"][0]["status"] == "ok"
    (row,) = noise.analyse(plan, [at_the_end], simulated()).results["gain_codes"]
    assert (row["status"], row["noise_rms"]) == ("clipped", None)
