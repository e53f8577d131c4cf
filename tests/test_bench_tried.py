"""``belahil bench check``: what it measures, how well, and what it makes of a bench in disorder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from belahil.bench import open_bench
from belahil.cli.bench_tried import amplitude, amplitude_uncertainty, tried
from belahil.cli.main import main
from belahil.config import (
    BenchConfig,
    EmulatedReceiver,
    EmulationTable,
    GeneratorUncertainty,
    load_bench,
    simulated,
)
from belahil.errors import InstrumentError
from belahil.stimuli import NoSignal, Sine
from belahil.values import WindowRequest

Captured = pytest.CaptureFixture[str]


def bench_of(**receiver: Any) -> BenchConfig:
    truth = EmulatedReceiver(**receiver)
    return msgspec.structs.replace(simulated(), emulation=EmulationTable(receiver=truth))


def lines(config: BenchConfig) -> list[str]:
    with open_bench(config) as bench:
        return [fact.line for fact in tried(bench)]


def test_the_uncertainty_of_a_sine_is_the_scatter_of_sines() -> None:
    # given sixty sines of 30 mVpp in noise that the filter coloured, and one dark window
    with open_bench(simulated()) as bench:
        dark = bench.measure(NoSignal(), WindowRequest(0, 4, 4000)).window
        sines = [
            bench.measure(Sine(1e6, 30e-3), WindowRequest(shot, 4, 4000)).window for shot in range(1, 61)
        ]
    scatter_v = float(np.std([amplitude(window, 1e6) for window in sines], ddof=1))
    # when their uncertainty is taken from the dark window
    told_v = amplitude_uncertainty(dark, 1e6)
    # then it is the scatter: sixty values tell that to 9 %, 64 neighbours with two components to 6 %
    assert told_v == pytest.approx(scatter_v, rel=3 * np.hypot(0.09, 0.06))


def test_declared_errors_are_in_the_uncertainty_of_the_gain() -> None:
    config = simulated()
    declared = GeneratorUncertainty(amplitude_relative=0.01, attenuation_db=0.1)
    config = msgspec.structs.replace(
        config, generator=msgspec.structs.replace(config.generator, uncertainty=declared)
    )
    # then 1 % and 0.1 dB (1.16 %) of 5.19 make 0.079
    assert any(line.startswith("gain 5.190(79), preset") for line in lines(config))


def test_a_receiver_unlike_its_preset_is_told_and_is_no_failure() -> None:
    gains = tuple(1.1 * 5.19 for _ in range(16))
    assert any(
        "differs by +10." in line or "differs by +9." in line for line in lines(bench_of(gain_by_code=gains))
    )


@pytest.mark.parametrize("trigger", ["generator", "digitizer"])
@pytest.mark.parametrize("delay_s", [0.0, 3e-6])
def test_a_pulse_is_found_where_its_trigger_puts_it(trigger: str, delay_s: float) -> None:
    # given either trigger, with a delay that the bench file tells
    config = simulated()
    table = msgspec.structs.replace(config.bench, trigger=trigger, trigger_delay_s=delay_s)
    told = lines(msgspec.structs.replace(config, bench=table))
    # then each window has its pulse, and none comes late
    assert f"trigger by the {trigger}: a pulse of 15 mV and 100 ns is in 3 of 3 windows" in told[-1]


def test_a_delay_that_the_bench_file_does_not_tell_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    # given windows that begin 1 us later than the bench file says
    config = simulated()
    measure = type(open_bench(config)).measure

    def later(self: Any, stimulus: Any, request: WindowRequest) -> Any:
        from dataclasses import replace

        shifted = request if isinstance(stimulus, NoSignal | Sine) else replace(request, delay_s=0.5e-6)
        return measure(self, stimulus, shifted)

    monkeypatch.setattr("belahil.bench.Bench.measure", later)
    told = lines(config)
    # then the pulses come earlier in them
    assert told[-1].startswith("the pulses come 5")
    assert "ns earlier than [bench] trigger_delay_s = 0" in told[-1]


def test_a_trigger_that_does_not_start_windows_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    # given a generator whose pulses the windows do not see
    config = simulated()
    measure = type(open_bench(config)).measure

    def missed(self: Any, stimulus: Any, request: WindowRequest) -> Any:
        return measure(self, stimulus if isinstance(stimulus, NoSignal | Sine) else NoSignal(), request)

    monkeypatch.setattr("belahil.bench.Bench.measure", missed)
    with pytest.raises(InstrumentError, match="no pulse in the window that trigger = generator started"):
        lines(config)


def test_a_pulse_that_wanders_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    from dataclasses import replace

    config = simulated()
    measure = type(open_bench(config)).measure

    def wandering(self: Any, stimulus: Any, request: WindowRequest) -> Any:
        pulse = not isinstance(stimulus, NoSignal | Sine)
        return measure(
            self, stimulus, replace(request, delay_s=2e-7 * (request.shot - 2)) if pulse else request
        )

    monkeypatch.setattr("belahil.bench.Bench.measure", wandering)
    with pytest.raises(InstrumentError, match="trigger = generator does not start the windows"):
        lines(config)


def test_with_a_run_a_gain_that_differs_is_status_1(tmp_path: Path, capsys: Captured) -> None:
    # given a characterization, and the same bench with 1 % more gain
    few = ["--codes", "3", "--amplitudes-mvpp", "50", "--frequencies-mhz", "1,5,11,19,25", "--quiet"]
    run = str(tmp_path / "run")
    assert main(["characterize", "--bench", "simulated", "--out", run, *few]) == 0
    gain = json.loads((tmp_path / "run" / "summary.json").read_text())["results"]["gain_codes"][0]["gain"]
    file = tmp_path / "other.toml"
    head = '[generator]\naddress = "simulated"\n[digitizer]\nlink = "simulated"\n[emulation.receiver]\n'
    file.write_text(f"{head}gain_by_code = {[1.01 * gain['value']] * 16}\n")
    # then the bench agrees with its run, at the gain code that the run measured
    assert main(["bench", "check", "simulated", "--receiver", run]) == 0
    assert "dark window at gain code 3" in capsys.readouterr().out
    # and the other one does not
    assert main(["bench", "check", str(file), "--receiver", run]) == 1
    assert "differs by +" in capsys.readouterr().out


def test_a_check_is_recorded_and_comes_again(tmp_path: Path, capsys: Captured) -> None:
    # given a check of the emulated bench, recorded
    file = tmp_path / "check.rec"
    assert main(["bench", "check", "--record", str(file)]) == 0
    told = capsys.readouterr().out
    # when the recording is checked
    assert main(["bench", "check", f"replay:{file}"]) == 0
    # then it tells the same
    assert capsys.readouterr().out == told
    # and neither it nor a bench without links is recorded
    for bench in ("simulated", f"replay:{file}"):
        assert main(["bench", "check", bench, "--record", str(tmp_path / "again.rec")]) == 2
    assert "has no links to record" in capsys.readouterr().err
    assert not (tmp_path / "again.rec").exists()


def test_a_recording_of_something_else_is_told_first(tmp_path: Path, capsys: Captured) -> None:
    # given a recording of another command
    file = tmp_path / "day.rec"
    with open_bench(load_bench("emulated"), record=file) as bench:
        bench.links.note("run", {"procedure": "noise", "options": {}})
    # when it is checked
    assert main(["bench", "check", f"replay:{file}"]) == 3
    # then what it is of stands before the difference, and again with it
    err = capsys.readouterr().err
    first, said, error = err.splitlines()[:3]
    assert first.startswith(f"replay of {file}")
    assert said == "recorded was noise, and this is bench check"
    assert "the recorded session ends here" in error
