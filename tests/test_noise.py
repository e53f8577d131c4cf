"""`belahil noise`: two conditions, bursts that follow the shot, Gaussianity, lines, and the best code."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hidden_receivers import InMemory, hidden
from scipy import stats
from sine_records import CODE_V, COUNT, RATE_HZ, filtered_noise

from belahil.bench import open_bench
from belahil.cli.main import main
from belahil.config import (
    BenchConfig,
    EmcBurst,
    EmulatedReceiver,
    EmulationTable,
    emulated,
    parse_bench,
    simulated,
)
from belahil.errors import LimitExceeded, RefusedInput
from belahil.receiver import receiver_preset
from belahil.recorded import read_windows
from belahil.stimuli import NoSignal, Sine
from belahil.values import Estimate, RangeWindow, WindowRequest
from procedures import noise
from procedures.dark_noise import dark_noise
from procedures.gaussianity import gaussianity
from procedures.known_receiver import KnownCode, KnownReceiver, preset_receiver
from procedures.noise import NoiseOptions
from procedures.noise_results import condition
from procedures.shot_locked import shot_locked


def found(config: BenchConfig, **options: Any) -> dict[str, Any]:
    """Measure noise in memory."""
    run = InMemory([])
    with open_bench(config) as bench:
        plan = noise.plan(bench, NoiseOptions(**options))
        noise.measure(bench, run, plan)
    return noise.analyse(plan, run.shots, config).results


def with_receiver(seed: int = 1, **truth: Any) -> BenchConfig:
    receiver = EmulatedReceiver(**truth)
    return msgspec.structs.replace(simulated(), emulation=EmulationTable(seed=seed, receiver=receiver))


def pull(told: dict[str, Any], true: float) -> float:
    return float((told["value"] - true) / told["standard_uncertainty"])


def windows(volts: np.ndarray) -> list[RangeWindow]:
    """Windows as a converter gives them, one a row."""
    counts = (np.rint(volts / CODE_V) + 2048).astype(np.int16)
    return [RangeWindow(one, CODE_V, 2048.0, 1 / RATE_HZ, 0.0, 4, 0) for one in counts]


# ---- two conditions


def test_the_laser_fires_in_the_second_half_of_the_windows() -> None:
    # given a burst that only a shot pulse can start
    config = with_receiver(emc_burst=EmcBurst(amplitude_v=5e-3))
    results = found(config, codes=(4,), dark_windows=8)
    (row,) = results["gain_codes"]
    # then the noise with the laser off is the preset's
    true = receiver_preset("bela-grm").noise_rms_v_by_code[4]
    assert abs(pull(row["noise_rms"], true)) < 4
    assert row["windows"] == row["firing"]["windows"] == 8
    # and with the laser firing there is more of it, in a burst, and that is the combined noise
    assert row["firing"]["burst"]["status"] == "ok"
    assert row["firing"]["noise_rms"]["value"] > 1.1 * row["noise_rms"]["value"]
    assert row["combined_noise_rms"] == row["firing"]["noise_rms"]
    json.dumps(results, allow_nan=False)


def test_with_the_laser_off_it_never_fires() -> None:
    with open_bench(simulated()) as bench:
        plan = noise.plan(bench, NoiseOptions(codes=(4,), laser="off"))
        assert {one.request.trigger for one in plan.shots} == {"immediate"}
    (row,) = found(with_receiver(emc_burst=EmcBurst(amplitude_v=5e-3)), codes=(4,), laser="off")["gain_codes"]
    assert row["firing"] is None
    assert row["combined_noise_rms"] == row["noise_rms"]


def test_without_a_burst_firing_changes_nothing() -> None:
    (row,) = found(simulated(), codes=(4,))["gain_codes"]
    assert row["firing"]["burst"]["status"] == "no_burst"
    assert row["firing"]["gaussianity"]["status"] == "ok"
    difference = row["firing"]["noise_rms"]["value"] - row["noise_rms"]["value"]
    assert abs(difference) < 4 * math.sqrt(2) * row["noise_rms"]["standard_uncertainty"]


def test_a_receiver_without_a_shot_pulse_is_measured_with_the_laser_off(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with open_bench(simulated()) as bench:
        poor = dataclasses.replace(bench.spec, triggers=("immediate", "generator"))
        monkeypatch.setattr(type(bench), "spec", property(lambda self: poor))
        assert not any(firing for _, _, firing in noise.plan(bench, NoiseOptions(codes=(4,))).windows)
        with pytest.raises(LimitExceeded, match="trigger = digitizer"):
            noise.plan(bench, NoiseOptions(codes=(4,), laser="both"))


def test_both_kinds_of_bench_give_equal_counts_when_the_laser_fires() -> None:
    kept = []
    for base in (emulated(), simulated()):
        config = msgspec.structs.replace(
            base,
            emulation=EmulationTable(seed=9, receiver=EmulatedReceiver(emc_burst=EmcBurst(amplitude_v=1e-3))),
        )
        with open_bench(config) as bench:
            request = WindowRequest(3, 4, trigger="digitizer")
            kept.append(bench.measure(NoSignal(), request).window)
            # a sine keeps its own trigger, so that the laser stays off
            sine = bench.measure(Sine(1e6, 0.01), request).window
            assert sine.equals(bench.measure(Sine(1e6, 0.01), WindowRequest(3, 4)).window)
    assert kept[0].equals(kept[1])


# ---- bursts


def test_a_hidden_burst_comes_back() -> None:
    pulls = []
    for number in range(12):
        # given a random burst in a random receiver
        rng = np.random.default_rng([5, number])
        burst = EmcBurst(
            amplitude_v=float(rng.uniform(2e-3, 10e-3)),
            frequency_hz=float(rng.uniform(2e6, 12e6)),
            decay_s=float(rng.uniform(0.3e-6, 2e-6)),
            delay_s=float(rng.uniform(0, 100e-6)),
        )
        base = hidden(number)
        receiver = msgspec.structs.replace(base.emulation.receiver, emc_burst=burst)
        config = msgspec.structs.replace(
            base, emulation=msgspec.structs.replace(base.emulation, receiver=receiver)
        )
        # when the noise is measured at one gain code
        (row,) = found(config, codes=(6,))["gain_codes"]
        told = row["firing"]["burst"]
        # then the burst is there, where it was, and rings as it rang
        assert told["status"] == "ok"
        assert -20e-9 < told["peak_at"]["value"] - burst.delay_s < 2 / burst.frequency_hz + 60e-9
        pulls.append([pull(told["frequency"], burst.frequency_hz), pull(told["decay"], burst.decay_s)])
    assert np.max(np.abs(pulls)) < 4.5
    assert 0.5 < math.sqrt(float(np.mean(np.square(pulls)))) < 1.7


def test_noise_and_burst_together_are_what_was_hidden() -> None:
    pulls = []
    for seed in range(10):
        # given a burst whose mean square follows from its formula; the receiver hardly filters it
        burst = EmcBurst(amplitude_v=4e-3, frequency_hz=1e6, decay_s=4e-6, delay_s=10e-6)
        config = with_receiver(seed=seed, emc_burst=burst, noise_rms_v_by_code=(1e-3,) * 16)
        (row,) = found(config, codes=(4,))["gain_codes"]
        # integral of e^(-2t/T) sin^2(wt) = T/4 (1 - 1 / (1 + (wT)^2))
        turns = (2 * math.pi * burst.frequency_hz * burst.decay_s) ** 2
        energy = (5.19 * burst.amplitude_v) ** 2 * burst.decay_s / 4 * (1 - 1 / (1 + turns))
        true = math.sqrt(1e-6 + energy * RATE_HZ / COUNT)
        pulls.append(pull(row["combined_noise_rms"], true))
    assert np.max(np.abs(pulls)) < 4
    assert abs(np.mean(pulls)) < 4 / math.sqrt(10)


@pytest.mark.parametrize("codes", [0.5, 3.0])
def test_noise_alone_rarely_looks_like_a_burst(codes: float) -> None:
    rng, made = np.random.default_rng(2), filtered_noise()
    p_values = []
    for _ in range(60):
        count = int(rng.integers(2, 9))
        ones = windows(codes * CODE_V * np.array([made.draw(rng, COUNT) for _ in range(count)]))
        told = shot_locked(ones, 2, dark_noise(ones).effective).p_value
        assert told is not None
        p_values.append(told)
    # then small p-values are no more frequent than they say (three of 60 below 0.3 % by chance: 1e-3)
    assert np.count_nonzero(np.array(p_values) < 3e-3) <= 2
    assert np.median(p_values) > 0.1


def test_one_window_has_nothing_in_common_with_itself() -> None:
    (row,) = found(with_receiver(emc_burst=EmcBurst(amplitude_v=5e-3)), codes=(4,), dark_windows=1)[
        "gain_codes"
    ]
    assert row["firing"]["burst"]["status"] == "too_few_windows"
    assert row["firing"]["burst"]["p_value"] is None


# ---- Gaussianity


@pytest.mark.parametrize(
    ("cutoff_hz", "order", "codes"), [(19e6, 3, 0.5), (12e6, 4, 1.0), (19e6, 3, 5.0), (30e6, 1, 0.7)]
)
def test_p_values_of_rounded_coloured_noise_are_uniform(cutoff_hz: float, order: int, codes: float) -> None:
    # given noise that is Gaussian before it is rounded, with any offset within a code
    rng, made = np.random.default_rng(3), filtered_noise(cutoff_hz, order)
    p_values, pulls = [], []
    for _ in range(120):
        offsets = rng.uniform(-0.5, 0.5, 2)
        volts = codes * made.draw(rng, COUNT) + np.where(np.arange(COUNT) % 2, *offsets)
        ones = windows(CODE_V * volts[None])
        fit = dark_noise(ones).fit
        assert fit is not None
        told = gaussianity(ones, fit)
        p_values.append(told.p_value)
        pulls.append([one.value / one.standard_uncertainty for one in (told.skewness, told.excess_kurtosis)])
    # then Kolmogorov and Smirnov see a uniform distribution, and the pulls have width 1
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3
    np.testing.assert_allclose(np.mean(pulls, axis=0), 0.0, atol=4 / math.sqrt(120))
    np.testing.assert_allclose(np.std(pulls, axis=0), 1.0, atol=4 / math.sqrt(240))


def test_uncorrected_the_test_would_accuse_good_noise() -> None:
    """What scipy says of the same counts: correlation alone makes it reject far too often."""
    rng, made = np.random.default_rng(4), filtered_noise(12e6, 4)
    naive, ours = 0, 0
    for _ in range(60):
        ones = windows(2 * CODE_V * made.draw(rng, COUNT)[None])
        naive += stats.normaltest(ones[0].volts).pvalue < 0.05
        fit = dark_noise(ones).fit
        assert fit is not None
        ours += gaussianity(ones, fit).p_value < 0.05
    assert naive >= 10
    assert ours <= 9  # 3 expected; 10 or more once in 600 tries


@pytest.mark.parametrize("kind", ["skewed", "heavy"])
def test_noise_that_is_not_gaussian_is_told(kind: str) -> None:
    # given white noise of known skewness and kurtosis, 3 codes wide
    rng = np.random.default_rng(5)
    shape = 50.0
    white = {
        "skewed": (rng.gamma(shape, size=(8, COUNT)) - shape) / math.sqrt(shape),
        "heavy": rng.standard_t(20, size=(8, COUNT)) * math.sqrt(18 / 20),
    }[kind]
    ones = windows(3 * CODE_V * white)
    fit = dark_noise(ones).fit
    assert fit is not None
    told = gaussianity(ones, fit)
    assert told.status == "not_gaussian"
    skewness, kurtosis = (2 / math.sqrt(shape), 6 / shape) if kind == "skewed" else (0.0, 6 / (20 - 4))
    # the uncertainties are those of Gaussian noise; such noise scatters a little more
    assert abs(told.skewness.value - skewness) < 6 * told.skewness.standard_uncertainty
    assert abs(told.excess_kurtosis.value - kurtosis) < 8 * told.excess_kurtosis.standard_uncertainty


# ---- lines


def test_an_interference_line_is_told_with_its_frequency() -> None:
    rng, made = np.random.default_rng(6), filtered_noise()
    noise_v = 1e-3 * np.array([made.draw(rng, COUNT) for _ in range(8)])
    time = np.arange(COUNT) / RATE_HZ
    phases = rng.uniform(0, 2 * np.pi, (8, 1))
    assert condition(windows(noise_v), 2, firing=False).lines == ()
    one = condition(windows(noise_v + 0.2e-3 * np.sin(2 * np.pi * 7.1234e6 * time + phases)), 2, firing=False)
    (line,) = one.lines
    assert abs(line.frequency.value - 7.1234e6) < 4 * line.frequency.standard_uncertainty
    assert abs(line.rms.value - 0.2e-3 / math.sqrt(2)) < 4 * line.rms.standard_uncertainty


# ---- the best code


def receiver_of(gains: dict[int, float], relative: float = 1e-3) -> KnownReceiver:
    base = preset_receiver(simulated())
    codes = tuple(KnownCode(code, Estimate(gain, relative * gain)) for code, gain in gains.items())
    return dataclasses.replace(base, codes=codes, origin="a test")


def test_the_best_code_is_that_of_the_combined_noise() -> None:
    # given noise whose best code is 4, and a burst at the input, which is the same for all codes by gain
    results = found(simulated(), dark_windows=8)
    assert results["best_code"] == 4
    rows = results["gain_codes"]
    ranked = sorted(rows, key=lambda row: row["combined_input_noise_rms"]["value"])
    assert [row["code"] for row in ranked[:2]] == [4, results["best_code_runner_up"]["code"]]
    more = ranked[1]["combined_input_noise_rms"]["value"] - ranked[0]["combined_input_noise_rms"]["value"]
    assert results["best_code_runner_up"]["difference"]["value"] == pytest.approx(more, rel=1e-12)


def test_a_known_receiver_gives_the_gains() -> None:
    known = receiver_of({4: 5.0, 5: 50.0})
    results = found(simulated(), codes=(4, 5, 6), receiver=known)
    four, _, six = results["gain_codes"]
    assert results["best_code"] == 5
    assert four["input_noise_rms"]["value"] == pytest.approx(four["noise_rms"]["value"] / 5, rel=1e-12)
    relative = math.hypot(four["noise_rms"]["standard_uncertainty"] / four["noise_rms"]["value"], 1e-3)
    assert four["input_noise_rms"]["standard_uncertainty"] == pytest.approx(
        relative * four["input_noise_rms"]["value"], rel=1e-9
    )
    # a code whose gain nobody knows has no noise at the input
    assert six["combined_input_noise_rms"] is None
    assert six["combined_noise_rms"] is not None


def test_a_code_whose_noise_is_hidden_may_be_the_best() -> None:
    config = with_receiver(noise_rms_v_by_code=(1e-9,) + (1e-3,) * 15)
    results = found(config, codes=(0, 4), dark_windows=2)
    assert [row["status"] for row in results["gain_codes"]] == ["no_signal", "ok"]
    assert results["best_code"] is None
    assert results["best_code_runner_up"] is None
    assert results["gain_codes"][0]["gaussianity"] is None
    json.dumps(results, allow_nan=False)


def test_a_burst_over_the_steps_of_quiet_noise_is_told_without_a_number() -> None:
    config = with_receiver(noise_rms_v_by_code=(0.05e-3,) * 16, emc_burst=EmcBurst(amplitude_v=5e-3))
    (row,) = found(config, codes=(4,), dark_windows=4)["gain_codes"]
    assert row["firing"]["noise_rms"] is None
    assert row["combined_input_noise_rms"] is None


# ---- recorded windows


@pytest.mark.slow
def test_recorded_windows_keep_their_conditions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("bench.toml").write_text(
        '[generator]\naddress = "simulated"\n[digitizer]\nlink = "simulated"\n'
        "[emulation.receiver]\nemc_burst = { amplitude_v = 3e-3 }\n"
    )
    few = ["--codes", "4,5", "--dark-windows", "4", "--quiet"]
    assert main(["noise", "--bench", "bench.toml", *few, "--out", "run"]) == 0
    # when its windows are analysed
    assert main(["noise", "--windows", "run/data.nc", "--quiet", "--out", "again"]) == 0
    first, second = (json.loads(Path(run, "summary.json").read_text())["results"] for run in ("run", "again"))
    assert second == first
    assert first["gain_codes"][0]["firing"]["burst"]["status"] == "ok"
    # and a window with the laser firing never counts as one with it off
    assert main(["noise", "--windows", "run/data.nc", "--laser", "off", "--quiet", "--out", "off"]) == 0
    off = json.loads(Path("off", "summary.json").read_text())["results"]
    assert off["gain_codes"][0]["noise_rms"] == first["gain_codes"][0]["noise_rms"]
    assert off["gain_codes"][0]["firing"] is None
    # and a gain code without such windows is refused
    assert main(["noise", "--windows", "run/data.nc", "--codes", "7", "--out", "none"]) == 2


@pytest.mark.slow
def test_dark_windows_of_a_characterization_serve_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    sweep = ["--amplitudes-mvpp", "30", "--frequencies-mhz", "1,5,12,17,22,28"]
    assert (
        main(["characterize", "--codes", "4", *sweep, "--bench", "simulated", "--quiet", "--out", "run"]) == 0
    )
    assert main(["noise", "--windows", "run/data.nc", "--receiver", "run", "--quiet", "--out", "noise"]) == 0
    (row,) = json.loads(Path("noise", "summary.json").read_text())["results"]["gain_codes"]
    (other,) = json.loads(Path("run", "summary.json").read_text())["results"]["gain_codes"]
    assert row["noise_rms"] == other["noise_rms"]
    assert row["input_noise_rms"]["value"] == pytest.approx(other["input_noise_rms"]["value"], rel=1e-12)


def test_windows_of_another_receiver_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert (
        main(
            [
                "noise",
                "--bench",
                "simulated",
                "--codes",
                "4",
                "--dark-windows",
                "1",
                "--quiet",
                "--out",
                "run",
            ]
        )
        == 0
    )
    other = dataclasses.replace(preset_receiver(simulated()), bits=14)
    with pytest.raises(
        RefusedInput, match=r"12 bit and .* 12.5 ns; preset bela-grm: 2 converters with 14 bit"
    ):
        noise.recorded_plan(read_windows("run/data.nc"), NoiseOptions(receiver=other))


def test_windows_that_are_not_the_presets_have_no_noise_at_the_input() -> None:
    # given silent windows of a receiver that samples as the preset does, and of one that does not
    with open_bench(simulated()) as bench:
        plan = noise.plan(bench, NoiseOptions(codes=(4,), dark_windows=2, laser="off"))
        shots = [bench.measure(one.stimulus, one.request) for one in plan.shots]
    other = [
        dataclasses.replace(one, window=dataclasses.replace(one.window, sample_interval_s=5e-9))
        for one in shots
    ]
    # when they are analysed without a characterization, then the gains of the preset are not taken for theirs
    (row,), (strange,) = (
        noise.analyse(plan, ones, simulated()).results["gain_codes"] for ones in (shots, other)
    )
    assert row["input_noise_rms"]["value"] == pytest.approx(row["noise_rms"]["value"] / 5.19)
    assert (strange["noise_rms"], strange["input_noise_rms"]) == (row["noise_rms"], None)


# ---- a burst in the bench file


def test_a_burst_that_is_not_there_changes_nothing() -> None:
    request = WindowRequest(3, 4, trigger="digitizer")
    counts = []
    for burst in (EmcBurst(), EmcBurst(amplitude_v=0.0, frequency_hz=3e6, delay_s=0.0)):
        with open_bench(with_receiver(emc_burst=burst)) as bench:
            counts.append(bench.measure(NoSignal(), request).window)
    assert counts[0].equals(counts[1])
    with open_bench(simulated()) as bench:
        assert bench.measure(NoSignal(), request).window.equals(counts[0])


def test_a_bench_file_may_have_a_burst() -> None:
    config = parse_bench("[emulation.receiver]\nemc_burst = { amplitude_v = 2e-3, decay_s = 1e-6 }\n")
    assert config.emulation.receiver.emc_burst == EmcBurst(amplitude_v=2e-3, decay_s=1e-6)
