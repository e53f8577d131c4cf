"""`belahil digitizer` on benches with a hidden truth, on recorded windows, and where nothing can be told."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hidden_receivers import CODES, InMemory, hidden

from belahil.bench import open_bench
from belahil.cli.main import main
from belahil.config import (
    BenchConfig,
    BenchTable,
    EmulatedReceiver,
    EmulationTable,
    GeneratorTable,
    GeneratorUncertainty,
    Interleave,
    SmallSignal,
    simulated,
)
from belahil.errors import RefusedInput
from procedures import digitizer
from procedures.digitizer import DigitizerOptions


def found(config: BenchConfig, **options: Any) -> dict[str, Any]:
    """Test the digitizer in memory."""
    run = InMemory([])
    with open_bench(config) as bench:
        plan = digitizer.plan(bench, DigitizerOptions(**options))
        digitizer.measure(bench, run, plan)
    return digitizer.analyse(plan, run.shots, config).results


def with_receiver(**truth: Any) -> BenchConfig:
    return msgspec.structs.replace(simulated(), emulation=EmulationTable(receiver=EmulatedReceiver(**truth)))


def pull(told: dict[str, Any], true: float) -> float:
    return float((told["value"] - true) / told["standard_uncertainty"])


@pytest.mark.parametrize("codes", [(4,), pytest.param((0, 8, 15), marks=pytest.mark.slow)])
def test_hidden_gain_offset_and_skew_come_back(codes: tuple[int, ...]) -> None:
    pulls = []
    for number in range(8):
        # given a receiver whose truth is drawn, clock and filter included
        config = hidden(number)
        truth = config.emulation.receiver.interleave
        # when its digitizer is tested, with gains of the preset that are wrong by up to a factor of ten
        between = found(config, codes=codes)["interleave"]
        assert between["status"] == "ok"
        pulls.append([pull(between[name], getattr(truth, name)) for name in ("gain", "offset_v", "skew_s")])
        # and what is stated is small beside what was hidden: the least of it is 1e-3 of the range
        assert between["gain"]["standard_uncertainty"] < 1e-4
        assert between["offset_v"]["standard_uncertainty"] < 5e-5
        assert between["skew_s"]["standard_uncertainty"] < 2e-12
    # then the pulls are those of a normal distribution: 24 below 4, mean 0, width 1
    assert np.max(np.abs(pulls)) < 4
    np.testing.assert_allclose(np.mean(pulls, axis=0), 0.0, atol=4 / math.sqrt(8))
    assert 0.6 < math.sqrt(float(np.mean(np.square(pulls)))) < 1.5


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_a_hundred_hidden_receivers_come_back() -> None:
    pulls = []
    for number in range(100):
        config = hidden(number)
        between = found(config, codes=CODES)["interleave"]
        truth = config.emulation.receiver.interleave
        pulls.append([pull(between[name], getattr(truth, name)) for name in ("gain", "offset_v", "skew_s")])
    np.testing.assert_allclose(np.mean(pulls, axis=0), 0.0, atol=4 / math.sqrt(100))
    np.testing.assert_allclose(np.std(pulls, axis=0), 1.0, atol=3.5 / math.sqrt(200))


def test_figures_of_a_known_receiver() -> None:
    # given a cubic term, noise and a converter of 12 bit over 2 V
    cubic, noise_v = 0.5, 1e-3
    config = with_receiver(small_signal=SmallSignal(cubic_per_v2=cubic), noise_rms_v_by_code=(noise_v,) * 16)
    (row,) = found(config, codes=(4,), frequencies_hz=(1.0009960159362548e6,))["gain_codes"]
    # then what follows from them comes back
    peak = row["amplitude_vpp"] / 2
    sine = peak + 0.75 * cubic * peak**3
    third = cubic * peak**3 / 4
    assert row["status"] == "ok"
    assert abs(pull(row["gain"], 5.19 * sine / peak)) < 4
    assert abs(pull(row["thd"], 20 * math.log10(third / sine))) < 4
    assert abs(pull(row["sfdr"], 20 * math.log10(sine / third))) < 4
    assert abs(pull(row["noise_rms"], math.hypot(noise_v, 2.0 / 4096 / math.sqrt(12)))) < 4
    rest = noise_v**2 + (2.0 / 4096) ** 2 / 12 + (5.19 * third) ** 2 / 2
    assert abs(pull(row["enob"], math.log2(2.0 / math.sqrt(12 * rest)))) < 4
    assert abs(pull(row["sinad"], 10 * math.log10((5.19 * sine) ** 2 / 2 / rest))) < 4
    assert abs(pull(row["offset"], 0.0)) < 4


def test_levels_are_reached_as_far_as_the_interlock_lets_them() -> None:
    # given a limit at the cut that the lowest gain code needs more than
    with open_bench(simulated()) as bench:
        plan = digitizer.plan(bench, DigitizerOptions(codes=(0, 4), levels_dbfs=(-1.0, -3.0, -60.0)))
    for frequency_hz, amplitudes in plan.sines:
        for amplitude_vpp, places in amplitudes:
            assert amplitude_vpp <= 0.5
            if frequency_hz < 2e6 and places == (1,):
                # then code 4 has what was asked: 2 V times -1, -3 or -60 dB by 5.19
                level = 20 * math.log10(amplitude_vpp * 5.19 / 2)
                assert min(abs(level - one) for one in (-1, -3, -60)) < 0.01
    # and code 0 has one amplitude for the two levels it cannot reach
    low = [vpp for vpp, places in plan.sines[0][1] if 0 in places]
    assert len(low) == 2
    assert low[-1] == pytest.approx(0.5, rel=2e-3)


def test_declared_errors_of_the_generator_enter_the_gain_alone() -> None:
    declared = GeneratorUncertainty(amplitude_relative=0.02)
    plain = found(simulated(), codes=(4,))
    config = msgspec.structs.replace(
        simulated(), generator=GeneratorTable(address="simulated", uncertainty=declared)
    )
    wide = found(config, codes=(4,))
    (one,), (other,) = plain["gain_codes"], wide["gain_codes"]
    assert other["gain"]["standard_uncertainty"] == pytest.approx(0.02 * other["gain"]["value"], rel=1e-3)
    assert one["sinad"] == other["sinad"]
    assert plain["interleave"] == wide["interleave"]


# ---- where nothing can be told


def test_a_sine_that_clips_has_a_status_and_a_lower_level_serves() -> None:
    # given a receiver with half the span that its preset promises
    config = with_receiver(adc_full_scale_v=1.0)
    results = found(config, codes=(4,), levels_dbfs=(-1.0, -20.0), frequencies_hz=(1e6, 5e6))
    statuses = {(one["frequency_hz"], one["amplitude_vpp"] > 0.1): one["status"] for one in results["points"]}
    assert set(statuses.values()) == {"clipped", "ok"}
    (row,) = results["gain_codes"]
    assert row["status"] == "ok"
    assert row["level_dbfs"]["value"] == pytest.approx(-14, abs=0.1)


def test_a_receiver_that_sees_nothing() -> None:
    # given a pad of 200 dB
    config = msgspec.structs.replace(
        simulated(), generator=GeneratorTable(address="simulated", attenuation_db=150.0)
    )
    results = found(config, codes=(4, 5))
    for row in results["gain_codes"]:
        assert row["status"] == "no_signal"
        assert row["sinad"] is None
        assert row["thd_status"] is None
    assert results["interleave"] == {"gain": None, "offset_v": None, "skew_s": None, "status": "no_signal"}
    json.dumps(results, allow_nan=False)


def test_a_receiver_without_noise_is_limited_by_its_steps() -> None:
    config = with_receiver(noise_rms_v_by_code=(0.0,) * 16)
    (row,) = found(config, codes=(4,))["gain_codes"]
    assert row["status"] == "ok"
    # rounding of a large sine adds a twelfth of a squared code
    assert row["enob"]["value"] == pytest.approx(12, abs=0.05)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"frequencies_hz": (20e6,)}, "multiple of fs/4"),
        ({"frequencies_hz": (1e3,)}, "away from 0"),
        ({"levels_dbfs": (3.0,)}, "allowed: -120 to 0"),
        ({"levels_dbfs": ()}, "at least one value"),
        ({"records": 1}, "at least 2 are needed"),
    ],
)
def test_what_cannot_be_measured_is_refused(options: dict[str, Any], said: str) -> None:
    with open_bench(simulated()) as bench, pytest.raises(RefusedInput, match=said):
        digitizer.plan(bench, DigitizerOptions(**options))


# ---- the command


@pytest.mark.slow
def test_recorded_windows_give_the_results_of_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a run of the command with a receiver that is known from a characterization
    monkeypatch.chdir(tmp_path)
    few = ["--codes", "4,5", "--quiet", "--bench", "simulated"]
    sweep = ["--amplitudes-mvpp", "30", "--frequencies-mhz", "1,5,12,17,22,28"]
    assert main(["characterize", *few, *sweep, "--out", "known"]) == 0
    assert main(["digitizer", *few, "--receiver", "known", "--records", "2", "--out", "run"]) == 0
    # when its own windows are analysed
    assert main(["digitizer", "--windows", "run/data.nc", "--quiet", "--out", "again"]) == 0
    # then the results are the same
    first, second = (json.loads(Path(run, "summary.json").read_text()) for run in ("run", "again"))
    assert second["results"] == first["results"]
    assert first["procedure"] == "digitizer"
    # and a resumed run is a finished one
    assert main(["digitizer", "--resume", "run", "--quiet"]) == 0
    # and windows without a sine are refused in one line
    assert main(["noise", *few, "--dark-windows", "1", "--out", "dark"]) == 0
    assert main(["digitizer", "--windows", "dark/data.nc", "--out", "none"]) == 2


def test_limits_of_effective_bits_make_a_verdict(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(
        '[generator]\naddress = "simulated"\n[digitizer]\nlink = "simulated"\n[limits]\nenob = [11.0, 12.0]\n'
    )
    answer = main(["digitizer", "--bench", str(bench), "--codes", "4", "--out", str(tmp_path / "run")])
    assert answer == 1
    assert "fail: enob (code 4)" in capsys.readouterr().out


def test_equal_counts_on_both_kinds_of_bench() -> None:
    options = {"codes": (4,), "levels_dbfs": (-1.0,), "records": 2}
    assert found(BenchConfig(), **options) == found(simulated(), **options)


def test_the_interleave_of_another_receiver_is_consistent() -> None:
    # given a receiver of another rate and filter behind a generator of 120 MHz
    config = msgspec.structs.replace(
        simulated(),
        bench=BenchTable(),
        generator=GeneratorTable(address="simulated", driver="keysight-33600"),
        digitizer=msgspec.structs.replace(simulated().digitizer, receiver="gala-like"),
        emulation=EmulationTable(
            receiver=EmulatedReceiver(interleave=Interleave(gain=-0.003, offset_v=0.5e-3, skew_s=-10e-12))
        ),
    )
    between = found(config, codes=(3, 6))["interleave"]
    assert between["status"] == "ok"
    for name, true in (("gain", -0.003), ("offset_v", 0.5e-3), ("skew_s", -10e-12)):
        assert abs(pull(between[name], true)) < 4
