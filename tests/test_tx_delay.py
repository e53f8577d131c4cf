"""`belahil tx-delay` on benches without hardware and on recorded windows; every case has a status."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import xarray
from hidden_receivers import InMemory
from tx_truths import INTERVAL_S, STEP_V, Truth, as_shots, receiver

from belahil.bench import open_bench
from belahil.cli.main import main
from belahil.config import BenchConfig, EmulatedReceiver, EmulatedTransmitter, EmulationTable, parse_bench
from belahil.errors import LimitExceeded, RefusedInput
from belahil.outcome import Outcome
from belahil.stimuli import NoSignal
from belahil.values import Estimate, Shot
from procedures import tx_delay
from procedures.known_receiver import preset_receiver
from procedures.tx_delay import TxDelayOptions, TxPlan
from procedures.tx_pulse import KnownPulse, tailed_pulse

EXACT = {"fall_uncertainty": 0.0, "rise_uncertainty": 0.0, "shape_uncertainty": 0.0}


def hidden(link: str = "simulated", seed: int = 3, **transmitter: Any) -> BenchConfig:
    config = parse_bench(f'[generator]\naddress = "{link.partition(":")[0]}"\n[digitizer]\nlink = "{link}"\n')
    truth = EmulationTable(seed=seed, transmitter=EmulatedTransmitter(**transmitter))
    return msgspec.structs.replace(config, emulation=truth)


def found(config: BenchConfig, options: TxDelayOptions) -> Outcome:
    run = InMemory([])
    with open_bench(config) as bench:
        plan = tx_delay.plan(bench, options)
        tx_delay.measure(bench, run, plan)
    return tx_delay.analyse(plan, run.shots, config)


def analysed(shots: list[Shot], **more: Any) -> dict[str, Any]:
    """Analyse shots that were made here, with the pulse and the receiver known."""
    given: dict[str, Any] = {
        "code": None,
        "windows": len(shots),
        "sample_count": 160,
        "delay_s": 0.0,
        "bits": 12,
        "sample_interval_s": INTERVAL_S,
        "pulse": KnownPulse(5.4e-9, 8e-9, 0.0, 0.0),
        "definition": "centre_minus_peak",
        "baseline": "common",
        "receiver": receiver(),
    }
    outcome = tx_delay.analyse(TxPlan(**(given | more)), shots, BenchConfig())
    json.dumps(outcome.results, allow_nan=False)
    return outcome.results


# ---- a hidden truth comes back


@pytest.mark.parametrize(("link", "threshold", "tail_ns", "seed"), [
    ("simulated", 0.17, 8.0, 3), pytest.param("simulated", 0.08, 20.0, 4, marks=pytest.mark.slow),
    ("emulated:serial", 0.35, 12.0, 5),
])  # fmt: skip
def test_a_hidden_threshold_comes_back(link: str, threshold: float, tail_ns: float, seed: int) -> None:
    # Given a bench whose fibre loses what is below a threshold, and the pulse before it known
    truth = hidden(link, seed, threshold=threshold, tail_s=tail_ns * 1e-9, peak_v=30e-3)
    known = replace(
        preset_receiver(truth), cutoff=replace(preset_receiver(truth).cutoff, standard_uncertainty=2e3)
    )
    options = TxDelayOptions(shots=150, pulse_tail_s=tail_ns * 1e-9, receiver=known, **EXACT)
    # When it is measured
    results = found(truth, options).results
    # Then the threshold is right to a point, the bound being less than 0.4, and inside its interval
    assert results["threshold_bound"] < 4e-3
    assert results["threshold"]["value"] == pytest.approx(threshold, abs=0.01)
    ends = results["threshold_interval"]
    assert ends["low"] < threshold < ends["high"]
    assert results["threshold"]["standard_uncertainty"] < 6e-3
    # and so are the height and the scatter of the pulse, which code 4 amplifies
    assert results["peak"]["value"] == pytest.approx(30e-3, rel=0.02)
    assert results["peak_scatter"] == pytest.approx(0.014, abs=0.004)
    assert "hard_cut" in results["families_that_fit"]


@pytest.mark.slow
def test_the_link_makes_no_difference() -> None:
    options = TxDelayOptions(shots=10)
    direct, serial, usb = (
        found(hidden(link), options).results for link in ("simulated", "emulated:serial", "emulated:usb")
    )
    assert direct == serial == usb


def test_the_uncertainty_of_the_cutoff_dominates_unless_it_was_measured() -> None:
    # Given the same windows, and a cut-off known to 1 % or to 0.01 %
    truth = hidden(tail_s=8e-9, threshold=0.2)
    known = preset_receiver(truth)
    wide, narrow = (
        found(truth, TxDelayOptions(shots=50, pulse_tail_s=8e-9, receiver=replace(known, cutoff=replace(
            known.cutoff, standard_uncertainty=part * known.cutoff.value)), **EXACT))
        for part in (0.01, 1e-4)
    )  # fmt: skip
    terms = [{one["source"]: one["threshold_standard_uncertainty"] for one in outcome.results["model_terms"]}
             for outcome in (wide, narrow)]  # fmt: skip
    # Then 1 % is about two points
    assert 0.015 < terms[0]["cutoff"] < 0.03
    assert terms[1]["cutoff"] == pytest.approx(terms[0]["cutoff"] / 100, rel=0.2)
    assert wide.results["threshold"]["value"] == narrow.results["threshold"]["value"]
    first = wide.budget[0]
    assert (first.quantity, first.source) == ("threshold", "cutoff")


@pytest.mark.parametrize("off", [-0.006, 0.006])
def test_a_joint_fit_finds_a_cutoff_that_was_told_wrong(off: float) -> None:
    # Given windows of a cut-off that is told 0.6 % wrong, as its uncertainty of 1 % allows
    known = receiver(19e6 * (1 + off), relative=0.01)
    results = analysed(replace(TRUTH, snr=80.0).shots(200, 4), receiver=known)
    hard, joint = results["threshold"]["value"], results["joint"]["threshold"]
    # Then the best cut is a point wrong and says that it may be; the joint fit is right, and sure of it
    assert abs(hard - 0.2) > 0.008
    assert results["threshold_interval"]["low"] < 0.2 < results["threshold_interval"]["high"]
    assert joint["standard_uncertainty"] < 0.5 * results["threshold"]["standard_uncertainty"]
    assert joint["value"] == pytest.approx(0.2, abs=3 * joint["standard_uncertainty"])
    cutoff = results["joint"]["cutoff"]
    assert cutoff["value"] == pytest.approx(19e6, abs=3 * cutoff["standard_uncertainty"])
    assert cutoff["standard_uncertainty"] < 0.5 * 190e3


@pytest.mark.slow
def test_a_free_baseline_gives_the_same_threshold_within_noise() -> None:
    truth = hidden(tail_s=8e-9)
    both = [found(truth, TxDelayOptions(shots=50, pulse_tail_s=8e-9, baseline=one)).results
            for one in ("common", "window")]  # fmt: skip
    apart = both[0]["threshold"]["value"] - both[1]["threshold"]["value"]
    assert abs(apart) < both[0]["threshold_noise_uncertainty"]
    assert both[1]["threshold_bound"] > both[0]["threshold_bound"]


@pytest.mark.slow
def test_a_table_stands_for_the_pulse(tmp_path: Path) -> None:
    # Given a laser whose pulse nobody could describe by two numbers, hidden and told as the same table
    times_s = np.arange(-12e-9, 70e-9, 0.1e-9)
    power = np.exp(-0.5 * (times_s / 2.2e-9) ** 2)
    power += 0.35 * np.exp(-0.5 * ((times_s - 7e-9) / 5e-9) ** 2) + 0.1 * (times_s > 0) * np.exp(
        -times_s / 15e-9
    )
    path = tmp_path / "pulse.txt"
    np.savetxt(path, np.stack([times_s, power], axis=1))
    truth = hidden(pulse="table", table=str(path), threshold=0.12, peak_v=30e-3)
    known = replace(
        preset_receiver(truth), cutoff=replace(preset_receiver(truth).cutoff, standard_uncertainty=0.0)
    )
    told = found(truth, TxDelayOptions(shots=300, pulse_table=str(path), receiver=known, **EXACT)).results
    assert told["threshold"]["value"] == pytest.approx(0.12, abs=4 * told["threshold_bound"])
    assert told["statuses"] == ["ok"]
    # and an analysis that takes it for a tailed pulse is told that it is none
    other = found(truth, TxDelayOptions(shots=300, pulse_tail_s=8e-9, receiver=known, **EXACT)).results
    assert other["misfit"]["shows"]
    assert other["misfit"]["beyond_model_terms"]


# ---- what cannot be told


TRUTH = Truth(tailed_pulse(5.4e-9, 8e-9), 0.2)


def test_silence_is_no_pulse() -> None:
    noise = as_shots(0.8e-3 * np.random.default_rng(1).standard_normal((40, 160)))
    for shots in (noise, as_shots(np.zeros((1, 160))), noise[:1]):
        results = analysed(shots)
        assert (results["status"], results["threshold"], results["delay"]) == ("no_pulse", None, None)


def test_a_pulse_in_few_windows_is_none_and_in_most_is_one() -> None:
    noise = as_shots(0.8e-3 * np.random.default_rng(2).standard_normal((40, 160)))
    pulses = TRUTH.shots(40, 3)
    assert analysed(noise[:25] + pulses[:15])["status"] == "no_pulse"
    results = analysed(noise[:10] + pulses)
    assert results["windows"] == {
        "windows": 50,
        "used": 40,
        "clipped": 0,
        "without_pulse": 10,
        "cut_off": 0,
        "too_short": 0,
    }


def test_clipped_windows_are_left_out_and_too_many_are_no_measurement() -> None:
    strong = replace(TRUTH, snr=2000.0).shots(30, 1)
    assert all(shot.window.saturated for shot in strong)
    assert analysed(strong)["status"] == "saturated"
    results = analysed(TRUTH.shots(40, 1) + strong)
    assert (results["windows"]["clipped"], results["windows"]["used"]) == (30, 40)
    # a receiver that does not count them makes no difference
    silent = [replace(one, window=replace(one.window, saturated=0)) for one in strong]
    assert analysed(silent)["status"] == "saturated"


def test_one_window_many_times_is_no_measurement() -> None:
    one = TRUTH.shots(1, 1)[0]
    copies = [replace(one, window=replace(one.window, shot=number)) for number in range(20)]
    assert analysed(copies)["status"] == "equal_windows"


def test_two_gain_codes_are_not_mixed() -> None:
    known = receiver()
    both = replace(known, codes=(*known.codes, replace(known.codes[0], code=5)))
    shots = TRUTH.shots(20, 1)
    other = [replace(one, window=replace(one.window, gain_code=5)) for one in TRUTH.shots(20, 2)]
    assert analysed(shots + other, receiver=both)["status"] == "mixed_gain_codes"
    assert analysed(shots + other, receiver=both, code=5)["windows"]["windows"] == 20


@pytest.mark.parametrize("more", [
    {"bits": 14}, {"sample_interval_s": 5e-9}, {"receiver": replace(receiver(), codes=(
        replace(receiver().codes[0], code=7),))},
])  # fmt: skip
def test_windows_of_another_receiver_are_told(more: dict[str, Any]) -> None:
    assert analysed(TRUTH.shots(20, 1), **more)["status"] == "other_receiver"


def test_a_window_sampled_at_another_rate_is_of_another_receiver() -> None:
    shots = TRUTH.shots(20, 1)
    shots[7] = replace(shots[7], window=replace(shots[7].window, sample_interval_s=2 * INTERVAL_S))
    assert analysed(shots)["status"] == "other_receiver"


def test_windows_of_two_scales_are_of_two_receivers() -> None:
    shots = TRUTH.shots(20, 1)
    shots[7] = replace(shots[7], window=replace(shots[7].window, volts_per_count=2 * STEP_V))
    assert analysed(shots)["status"] == "other_receiver"


def test_a_pulse_without_a_sample_before_it_needs_a_known_noise() -> None:
    shots = TRUTH.shots(20, 1, samples=60, start=5)
    known = receiver()
    unknown = replace(known, codes=(replace(known.codes[0], noise_rms=None),))
    assert analysed(shots[:2], receiver=unknown)["status"] == "noise_not_known"
    assert analysed(shots[:2])["noise_rms"]["value"] == pytest.approx(0.83e-3)


def test_a_pulse_at_the_edge_and_a_window_too_short_are_counted() -> None:
    results = analysed(
        TRUTH.shots(30, 1) + TRUTH.shots(5, 2, start=155) + TRUTH.shots(4, 3, samples=10, start=6)
    )
    assert results["windows"] == {
        "windows": 39,
        "used": 30,
        "clipped": 0,
        "without_pulse": 5,
        "cut_off": 0,
        "too_short": 4,
    }
    assert analysed(TRUTH.shots(4, 3, samples=10, start=6))["status"] == "too_few_samples"


@pytest.mark.parametrize("start", [3, 154])
def test_a_pulse_at_an_edge_is_not_taken_for_a_whole_one(start: int) -> None:
    # Given a pulse of which only the end, or only the beginning, is in the windows
    results = analysed(TRUTH.shots(30, 1, start=start))
    assert results["status"] in ("pulse_cut_off", "no_pulse")
    assert results["windows"]["used"] == 0


@pytest.mark.parametrize("tail_s", [pytest.param(3e-9, marks=pytest.mark.slow), 20e-9])
def test_a_correlation_window_is_long_enough(tail_s: float) -> None:
    # Given the 42 samples that the range finder keeps round a pulse
    truth = replace(TRUTH, pulse=tailed_pulse(5.4e-9, tail_s))
    results = analysed(truth.shots(150, 3, samples=42, start=20), pulse=KnownPulse(5.4e-9, tail_s, 0.0, 0.0))
    assert results["windows"]["used"] == 150
    assert results["threshold"]["value"] == pytest.approx(0.2, abs=3.5 * results["threshold_bound"])
    whole = analysed(truth.shots(150, 3), pulse=KnownPulse(5.4e-9, tail_s, 0.0, 0.0))
    assert results["threshold_bound"] < 1.2 * whole["threshold_bound"]


def test_a_known_ac_coupling_is_part_of_the_model() -> None:
    known = replace(receiver(), highpass=Estimate(80e3, 500.0, "Hz"))
    results = analysed(replace(TRUTH, highpass_hz=80e3).shots(200, 6), receiver=known)
    assert results["statuses"] == ["ok"]
    assert not results["misfit"]["beyond_model_terms"]
    assert results["threshold"]["value"] == pytest.approx(0.2, abs=4 * results["threshold_bound"])
    (term,) = [one for one in results["model_terms"] if one["source"] == "ac_coupling"]
    assert term["standard_uncertainty"] == 500.0


PLACE = np.arange(160.0)
JUNK: dict[str, Callable[[np.random.Generator], np.ndarray]] = {
    "spikes": lambda rng: 0.3 * (rng.random((20, 160)) < 0.01),
    "a step": lambda rng: 0.1 * (PLACE > 80),
    "a sine": lambda rng: 0.2 * np.sin(PLACE / 5 + rng.uniform(0, 6, (20, 1))),
    "an inverted pulse": lambda rng: -0.3 * np.exp(-0.5 * ((PLACE - 80) / 1.5) ** 2),
    "two pulses": lambda rng: 0.3 * (np.abs(PLACE - 50) < 2) + 0.25 * (np.abs(PLACE - 110) < 2),
    "one sample": lambda rng: 0.3 * (PLACE == 80),
}


@pytest.mark.parametrize("kind", JUNK)
def test_what_is_no_such_pulse_is_told(kind: str) -> None:
    rng = np.random.default_rng(4)
    shots = as_shots(0.8e-3 * rng.standard_normal((20, 160)) + JUNK[kind](rng))
    assert analysed(shots)["status"] in ("no_pulse", "model_misfit", "other_family", "residual_not_noise")


@pytest.mark.parametrize(
    ("pulse", "cutoff_hz"),
    [
        (KnownPulse(5e-9, 0.0, 0.05, 0.05, 0.03, (0.0, 1e-8), (1.0, 0.0)), 19e6),  # begins with its peak
        (KnownPulse(5.4e-9, 8e-9, 0.05, 0.05, 0.03), 80e6),  # as fast as the samples
    ],
)
def test_assumptions_far_from_the_truth_give_a_misfit(pulse: KnownPulse, cutoff_hz: float) -> None:
    results = analysed(TRUTH.shots(20, 2), pulse=pulse, receiver=receiver(cutoff_hz, 0.01))
    assert results["status"] in ("model_misfit", "residual_not_noise", "other_family")


def test_a_receiver_without_gain_codes_and_with_one_converter_is_measured() -> None:
    known = replace(receiver(), converters=1, codes=(replace(receiver().codes[0], code=None),))
    shots = [replace(one, window=replace(one.window, gain_code=None)) for one in TRUTH.shots(100, 2)]
    results = analysed(shots, receiver=known)
    assert (results["status"], results["gain_code"]) == ("ok", None)
    assert results["threshold"]["value"] == pytest.approx(0.2, abs=0.012)


def test_no_cut_at_all_gives_an_upper_limit() -> None:
    results = analysed(replace(TRUTH, threshold=0.0).shots(200, 1))
    assert "threshold_not_seen" in results["statuses"]
    assert results["threshold_interval"]["low"] == 0.0
    assert 0 <= results["threshold"]["value"] < 5e-3
    assert results["threshold_interval"]["high"] < 0.02
    assert "fractional_loss" in results["families_that_fit"]


@pytest.mark.parametrize(("threshold", "shots"), [(0.9, 30), (0.99, 20)])
def test_a_pulse_of_which_little_is_left_has_a_weak_threshold(threshold: float, shots: int) -> None:
    results = analysed(replace(TRUTH, threshold=threshold).shots(shots, 1))
    assert "threshold_weakly_determined" in results["statuses"]
    assert results["threshold_interval"]["low"] < threshold
    assert results["threshold_interval"]["high"] > 0.9
    assert results["delay"] is not None


def test_noise_free_windows_have_the_noise_of_quantization() -> None:
    results = analysed(replace(TRUTH, noise_v=0.0).shots(60, 1))
    assert results["noise_rms"]["value"] < 0.1 * STEP_V
    assert results["threshold"]["value"] == pytest.approx(0.2, abs=5e-3)


@pytest.mark.parametrize(("corner_hz", "shows"), [(0.0, False), (60e3, True)])
def test_an_unknown_ac_coupling_is_told_and_its_corner_found(corner_hz: float, shows: bool) -> None:
    left = analysed(replace(TRUTH, highpass_hz=corner_hz).shots(200, 6))["misfit"]
    assert left["shows"] == shows
    if shows:
        assert left["looks_like"] == "ac_coupling"
        assert left["size"] == pytest.approx(corner_hz, rel=0.2)


def test_a_soft_edge_is_another_family() -> None:
    results = analysed(replace(TRUTH, threshold=0.25, width=0.45, snr=100.0).shots(300, 6))
    assert results["status"] == "other_family"
    assert results["preferred_family"] == "soft_cut"
    assert results["families_that_fit"] == ["soft_cut"]
    # the delay is robust: that of the hard cut is right to 0.2 ns though its edge is not
    late_s = {one["family"]: one["centre_minus_peak_s"] for one in results["families"]}
    assert late_s["hard_cut"] == pytest.approx(results["delay"]["value"])
    assert late_s["hard_cut"] == pytest.approx(late_s["soft_cut"], abs=0.2e-9)
    assert late_s["fractional_loss"] > late_s["soft_cut"] + 0.2e-9


@pytest.mark.parametrize(("uncertainty", "status"), [(0.0, "other_family"), (0.05, "ok")])
def test_a_pulse_wrong_by_its_uncertainty_is_no_other_family(uncertainty: float, status: str) -> None:
    # Given a hard cut of a pulse that is told 5 % too long, to which a soft edge is nearest
    told = KnownPulse(1.05 * 5.4e-9, 1.05 * 8e-9, uncertainty, uncertainty)
    results = analysed(replace(TRUTH, snr=200.0).shots(300, 3), pulse=told)
    # Then it is another family only where the pulse is said to be known better
    assert results["preferred_family"] == "soft_cut"
    assert results["status"] == status


# ---- the course of a run


def test_options_are_checked() -> None:
    for given, message in (
        ({"shots": 1}, "at least 2"),
        ({"delay_s": -1e-9}, "0 to below 1 s"),
        ({"definition": "later"}, "allowed: centre_minus_peak"),
        ({"baseline": "none"}, "allowed: common, window"),
    ):
        with pytest.raises(RefusedInput, match=message):
            TxDelayOptions(**given)  # type: ignore[arg-type]


def test_a_gain_code_that_is_not_there_is_refused() -> None:
    with open_bench(hidden()) as bench, pytest.raises(LimitExceeded, match="gain code 16"):
        tx_delay.plan(bench, TxDelayOptions(code=16))


@pytest.mark.parametrize("code", [0, 9])
def test_a_gain_code_of_which_a_characterization_knows_nothing_is_refused_before_the_laser_fires(
    code: int,
) -> None:
    known = preset_receiver(BenchConfig())
    few = replace(known, codes=tuple(one for one in known.codes if one.code in (4, 5)))
    with open_bench(hidden()) as bench, pytest.raises(RefusedInput, match=f"gain code {code}: .* of 4, 5$"):
        tx_delay.plan(bench, TxDelayOptions(code=code, receiver=few))


@pytest.mark.parametrize(
    ("status", "line"),
    [
        ("no_pulse", "status: no_pulse (no pulse stands out of the noise in half of the windows)"),
        ("ok", "status: ok"),
    ],
)
def test_the_terminal_says_what_a_status_means(status: str, line: str) -> None:
    from belahil.cli.tx_delay import _lines

    assert _lines({"statuses": [status], "threshold": None}) == [line]


def test_the_command_writes_a_run_and_takes_its_windows_again(tmp_path: Path, capsys: Any) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text('[generator]\naddress = "simulated"\n[digitizer]\nlink = "simulated"\n')
    first, again = tmp_path / "first", tmp_path / "again"
    told = ["tx-delay", "--bench", str(bench), "--shots", "60", "--out", str(first), "--definition",
            "filtered_peak_minus_peak"]  # fmt: skip
    assert main(told) == 0
    printed = capsys.readouterr().out
    assert "threshold: " in printed
    assert "delay (filtered_peak_minus_peak): " in printed
    one = json.loads((first / "summary.json").read_text())["results"]
    # When its data file is analysed in place of measuring
    assert main(["tx-delay", "--windows", str(first / "data.nc"), "--out", str(again), "--definition",
                 "filtered_peak_minus_peak", "--quiet"]) == 0  # fmt: skip
    # Then the results are the same, and the data file holds what was found of each window
    assert json.loads((again / "summary.json").read_text())["results"] == one
    with xarray.open_dataset(again / "data.nc") as data:
        assert data["tx_threshold"].item() == one["threshold"]["value"]
        assert data["tx_shot"].values.tolist() == list(range(60))
        # the emulated laser fires 500 ns after the shot pulse
        late_s = data["tx_arrival"].values - (500e-9 + 2e-9)
        assert np.abs(late_s).max() < INTERVAL_S
    assert (first / "figure-tx-delay.png").stat().st_size > 20_000


@pytest.mark.parametrize("option", ["--gain-code", "--code"])
def test_a_gain_code_is_named_either_way(option: str, capsys: Any) -> None:
    assert main(["tx-delay", "--bench", "simulated", option, "77"]) == 2
    assert "gain code 77" in capsys.readouterr().err


def test_recorded_windows_without_such_a_pulse_are_refused(tmp_path: Path, capsys: Any) -> None:
    run = tmp_path / "noise"
    bench = tmp_path / "bench.toml"
    bench.write_text('[generator]\naddress = "simulated"\n[digitizer]\nlink = "simulated"\n')
    assert (
        main(
            [
                "noise",
                "--bench",
                str(bench),
                "--codes",
                "4",
                "--dark-windows",
                "1",
                "--quiet",
                "--out",
                str(run),
            ]
        )
        == 0
    )
    assert main(["tx-delay", "--windows", str(run / "data.nc"), "--out", str(tmp_path / "no")]) == 2
    assert "no window of a transmitted pulse" in capsys.readouterr().err


def test_other_stimuli_between_them_are_passed_over() -> None:
    shots = TRUTH.shots(20, 1)
    mixed = [*shots[:10], replace(shots[10], played=NoSignal()), *shots[11:]]
    assert analysed(mixed)["windows"]["windows"] == 19


@pytest.mark.slow
def test_a_characterization_is_what_is_known(tmp_path: Path) -> None:
    # Given a receiver with another cut-off than its preset, characterized, and its transmitted pulse
    bench = tmp_path / "bench.toml"
    bench.write_text(
        '[generator]\naddress = "simulated"\n[digitizer]\nlink = "simulated"\n'
        "[emulation.receiver]\ncutoff_hz = 21.5e6\nclock_ppm = 20.0\n"
        "interleave = { gain = 0.004, offset_v = 1e-3, skew_s = 30e-12 }\n"
        "[emulation.transmitter]\ntail_s = 9e-9\nthreshold = 0.22\n"
    )
    run, out = tmp_path / "receiver", tmp_path / "tx"
    assert main(["characterize", "--bench", str(bench), "--codes", "4", "--amplitudes-mvpp", "50,200",
                 "--dark-windows", "2", "--quiet", "--out", str(run)]) == 0  # fmt: skip
    told = ["tx-delay", "--bench", str(bench), "--receiver", str(run), "--pulse-tail-ns", "9", "--quiet"]
    exact = ["--fall-uncertainty", "0", "--rise-uncertainty", "0", "--shape-uncertainty", "0"]
    assert main([*told, *exact, "--out", str(out)]) == 0
    results = json.loads((out / "summary.json").read_text())["results"]
    assert results["statuses"] == ["ok"]
    assert results["threshold"]["value"] == pytest.approx(0.22, abs=0.01)
    assert results["threshold_interval"]["low"] < 0.22 < results["threshold_interval"]["high"]


def test_the_emulated_receiver_is_that_of_the_preset() -> None:
    # the assumption behind the truths above
    assert preset_receiver(hidden()).cutoff.value == 19e6
    assert EmulatedReceiver().order in (3, None)
