"""Recorded windows give the shots that were written, and a procedure takes them in place of measuring."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np
import pytest

from belahil.bench import open_bench
from belahil.cli.main import main
from belahil.config import parse_bench
from belahil.errors import RefusedInput, StorageError
from belahil.export import write_data
from belahil.recorded import read_windows
from belahil.run import Run
from belahil.stimuli import NoSignal, SampledPulse, Sine, TransmittedPulse
from belahil.values import Products, Shot, WindowRequest

BENCH = '[generator]\naddress = "simulated"\n[digitizer]\nlink = "simulated"\n'
SUMMARY: dict[str, Any] = {
    "procedure": "noise",
    "source": "simulated",
    "verdict": "none",
    "instruments": {"generator": "a generator", "digitizer": "a receiver"},
    "started": "2026-01-01",
    "finished": "2026-01-01",
    "software": {"belahil": "0"},
}
NARROW = SampledPulse(np.hanning(12) * 0.02, 250e6, 1e-6, "linear")
WIDE = SampledPulse(np.hanning(9) * 0.03, 120e6, 2e-6, "hold")


def measured(gain_code: int) -> list[Shot]:
    stimuli = (NoSignal(), Sine(5e6, 0.05, 0.001), NARROW, WIDE, NARROW, TransmittedPulse(), NoSignal())
    products: dict[int, Products] = {2: "window_and_candidates", 3: "correlation_windows"}
    with open_bench(parse_bench(BENCH)) as bench:
        shots = [
            bench.measure(
                stimulus,
                WindowRequest(
                    number,
                    gain_code,
                    300 + 7 * number,
                    source="transmit" if isinstance(stimulus, TransmittedPulse) else "return",
                    products=products.get(number, "window"),
                ),
            )
            for number, stimulus in enumerate(stimuli)
        ]
    # a generator of limited bandwidth tells the poles that a pulse has passed
    filtered = replace(NARROW, poles=(-1e8 + 1e8j, -1e8 - 1e8j))
    return [*shots[:-1], replace(shots[-1], played=filtered)]


@pytest.mark.parametrize("kept", [slice(0, 1), slice(0, 2), slice(2, 6)])
def test_a_file_with_and_without_sines_gives_what_was_played(kept: slice, tmp_path: Path) -> None:
    shots = measured(4)[kept]
    with open_bench(parse_bench(BENCH)) as bench:
        write_data(tmp_path / "data.nc", shots, {}, SUMMARY, digitizer=bench.spec)
    with h5netcdf.File(tmp_path / "data.nc") as file:
        assert ("offset_v" in file.variables) == any(isinstance(shot.played, Sine) for shot in shots)
    assert [shot.played for shot in read_windows(tmp_path / "data.nc")] == [shot.played for shot in shots]


@pytest.mark.parametrize("gain_code", [0, 4, 15])
def test_the_shots_come_back_as_they_were(tmp_path: Path, gain_code: int) -> None:
    # given windows of every stimulus, of different lengths and products
    shots = measured(gain_code)
    with open_bench(parse_bench(BENCH)) as bench:
        spec = bench.spec
    # when they are written and read
    write_data(tmp_path / "data.nc", shots, {}, SUMMARY, digitizer=spec)
    recorded = read_windows(tmp_path / "data.nc")
    # then nothing is lost, twice over
    for found in (list(recorded), list(recorded)):
        assert len(found) == len(recorded) == len(shots)
        for one, was in zip(found, shots, strict=True):
            assert one.window.equals(was.window)
            assert (one.date[:23], one.attempt) == (was.date[:23], was.attempt)
            played = SampledPulse if isinstance(was.played, SampledPulse) else type(was.played)
            assert isinstance(one.played, played)
            assert one.played == was.played
    assert (recorded.spec, recorded.source) == (spec, "simulated")
    assert recorded.instruments == SUMMARY["instruments"]
    kinds = [recorded.request(row).products for row in (0, 2, 3)]
    assert kinds == ["window", "window_and_candidates", "correlation_windows"]


def foreign(path: Path, **more: Any) -> Path:
    """Write what another program must write at the least, and what is told."""
    with h5netcdf.File(path, "w") as file:
        file.dimensions = {"shot": 3, "sample": 200}
        counts = np.arange(600, dtype=np.int16).reshape(3, 200)
        file.create_variable("counts", ("shot", "sample"), data=more.pop("counts", counts))
        for name, value in ({"volts_per_count": 5e-4, "sample_interval_s": 12.5e-9} | more).items():
            if name.startswith("digitizer"):
                file.attrs[name] = value
            elif value is not None:
                file.create_variable(name, ("shot",)[: np.ndim(value)], data=value)
    return path


def test_another_program_needs_only_a_few_variables(tmp_path: Path) -> None:
    path = foreign(tmp_path / "few.nc", digitizer_bits=12, digitizer_converters=2)
    recorded = read_windows(path)
    assert [shot.window.counts[0] for shot in recorded] == [0, 200, 400]
    assert all(isinstance(shot.played, NoSignal) and shot.window.gain_code is None for shot in recorded)
    assert recorded.source == "hardware"
    assert recorded.spec.sample_rate_hz == pytest.approx(80e6)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({}, "digitizer_bits, digitizer_converters"),
        ({"volts_per_count": None}, "has no volts_per_count"),
        ({"counts": np.zeros((3, 200))}, "int16"),
        ({"sample_interval_s": np.array([1e-9, 2e-9, 1e-9])}, "digitizer_bits"),
        ({"digitizer_bits": 12, "digitizer_converters": 0}, "0 converters"),
        ({"stimulus": np.array([0, 1, 0])}, "no frequency_hz, amplitude_vpp, offset_v"),
        ({"stimulus": np.array([0, 9, 0])}, "stimulus must be"),
        ({"stimulus": np.array([0, 2, 0])}, "pulse_of_shot"),
        ({"sample_count": np.array([200, 201, 200])}, "sample_count"),
        ({"volts_per_count": np.array([5e-4, np.nan, 5e-4])}, "finite"),
    ],
)
def test_a_file_of_another_layout_is_refused_in_one_line(
    tmp_path: Path, more: dict[str, Any], said: str
) -> None:
    path = foreign(tmp_path / "bad.nc", **more)
    with pytest.raises(RefusedInput, match=said) as refused:
        read_windows(path)
    assert "\n" not in str(refused.value)


def test_intervals_of_two_receivers_are_refused(tmp_path: Path) -> None:
    intervals_s = np.array([12.5e-9, 5e-9, 12.5e-9])
    path = foreign(
        tmp_path / "two.nc", sample_interval_s=intervals_s, digitizer_bits=12, digitizer_converters=2
    )
    with pytest.raises(RefusedInput, match="windows of one receiver"):
        read_windows(path)


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("volts_per_count", -1e-4, "above zero"),
        ("sample_interval_s", np.inf, "above zero"),
        ("zero_count", np.nan, "zero_count must be finite"),
        ("start_s", np.inf, "start_s must be finite"),
        ("date", 10**18, "year 9999"),
        ("candidate_count", 9, "candidate_count must be from 0 to 4"),
        ("candidate_count", -1, "candidate_count must be from 0 to 4"),
        ("candidate_arrival_s", np.nan, "candidate_arrival_s must be finite"),
        ("candidate_fwhm_s", None, "no candidate_fwhm_s"),
        ("pulse_of_shot", -1, "beyond the 3 of the file"),
        ("pulse_of_shot", 3, "beyond the 3 of the file"),
        ("pulse_interpolation", -1, "pulse_interpolation must be from 0 to 1"),
        ("pulse_interpolation", 2, "pulse_interpolation must be from 0 to 1"),
        ("pulse_sample_count", 10**6, "pulse_sample_count must be from 2 to"),
        ("pulse_sample_rate_hz", 0.0, "--windows .*0.0 samples per second"),
        ("pulse_volts", np.nan, "--windows .*finite volts"),
    ],
)
def test_a_damaged_value_is_refused_with_the_name_of_the_file(
    tmp_path: Path, name: str, value: Any, said: str
) -> None:
    # given a file of which the first value of a variable is spoiled, or a variable lost
    path = tmp_path / "data.nc"
    with open_bench(parse_bench(BENCH)) as bench:
        write_data(path, measured(4)[2:], {}, SUMMARY, digitizer=bench.spec)
    with h5netcdf.File(path, "r+") as file:
        assert isinstance(read_windows(path).played(0), SampledPulse)
        if value is None:
            del file._h5file[name]
        else:
            variable = file[name]
            variable[(0,) * variable.ndim] = value
    # when it is read, then one line says what and where
    with pytest.raises(RefusedInput, match=said) as refused:
        read_windows(path)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


def test_no_file_and_no_netcdf_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "text.nc").write_text("no data", encoding="utf-8")
    for name, said in (("none.nc", "there is no such file"), ("text.nc", "it is no NetCDF-4 file")):
        out = tmp_path / "out"
        assert main(["noise", "--windows", str(tmp_path / name), "--out", str(out)]) == 2
        assert said in capsys.readouterr().err
        assert not out.exists()


@pytest.mark.slow
def test_recorded_windows_give_the_results_of_the_run(tmp_path: Path) -> None:
    # given a run, when its data file is analysed in place of measuring
    bench = ["--bench", "simulated", "--quiet", "--seed", "5"]
    first, again = tmp_path / "first", tmp_path / "again"
    assert main(["noise", "--codes", "3,4", "--dark-windows", "3", *bench, "--out", str(first)]) == 0
    assert main(["noise", "--windows", str(first / "data.nc"), "--quiet", "--out", str(again)]) == 0
    # then the results are equal, and so is the source
    told = [json.loads((run / "summary.json").read_text(encoding="utf-8")) for run in (first, again)]
    assert told[0]["results"] == told[1]["results"]
    assert [one["source"] for one in told] == ["simulated", "simulated"]
    assert told[0]["instruments"] == told[1]["instruments"]
    # and the new run's own data file serves as well; of it one code can be taken
    more = tmp_path / "more"
    words = ["noise", "--codes", "4", "--windows", str(again / "data.nc"), "--quiet"]
    assert main([*words, "--out", str(more)]) == 0
    results = json.loads((more / "summary.json").read_text(encoding="utf-8"))["results"]
    assert results["gain_codes"] == told[0]["results"]["gain_codes"][1:]


def test_a_recorded_run_that_was_interrupted_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # given a run on recorded windows that broke after two of six
    first, again = tmp_path / "first", tmp_path / "again"
    words = ["noise", "--codes", "3,4", "--dark-windows", "3", "--quiet"]
    assert main([*words, "--bench", "simulated", "--out", str(first)]) == 0
    whole, seen = Run.shot, []

    def breaking(run: Run, request: WindowRequest, measure: Any) -> Shot:
        seen.append(request)
        if len(seen) == 3:
            raise StorageError("the disk is full")
        return whole(run, request, measure)

    with monkeypatch.context() as patched:
        patched.setattr(Run, "shot", breaking)
        assert main(["noise", "--windows", str(first / "data.nc"), "--quiet", "--out", str(again)]) == 4
    # when it is resumed, then the results are those of the first run
    assert main(["noise", "--resume", str(again), "--quiet"]) == 0
    told = [json.loads((run / "summary.json").read_text(encoding="utf-8")) for run in (first, again)]
    assert told[0]["results"] == told[1]["results"]
