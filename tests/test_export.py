"""The data file: everything of the shots and the results, as xarray reads it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import h5netcdf
import numpy as np
import pytest
import xarray
from small_run import SAMPLES, begin, made, measure, outcome, requested

from belahil.export import write_data
from belahil.outcome import STATUSES, Table
from belahil.run import Run
from belahil.stimuli import NoSignal, SampledPulse, Sine, TransmittedPulse
from belahil.values import Candidate, RangeWindow, Shot, WindowRequest

COUNT = 130  # more than two batches


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> xarray.Dataset:
    folder = tmp_path_factory.mktemp("export") / "run"
    with begin(folder, sync=False) as run:
        measure(run, COUNT)
        run.finish(outcome(figures={}))
    with xarray.open_dataset(folder / "data.nc") as opened:
        return opened.load()


def test_counts_are_integers_and_equal(data: xarray.Dataset) -> None:
    assert data["counts"].dtype == np.int16
    assert data["counts"].dims == ("shot", "sample")
    assert np.array_equal(data["counts"], np.stack([made(number).window.counts for number in range(COUNT)]))
    assert data["counts"].encoding["chunksizes"] == (1, SAMPLES)


def test_what_belongs_to_a_shot_is_equal(data: xarray.Dataset) -> None:
    shots = [made(number) for number in range(COUNT)]
    for name in (
        "shot",
        "gain_code",
        "volts_per_count",
        "zero_count",
        "sample_interval_s",
        "start_s",
        "saturated",
    ):
        assert data[name].dims == ("shot",)
        assert data[name].values.tolist() == [getattr(shot.window, name) for shot in shots]
    assert data["attempt"].values.tolist() == [shot.attempt for shot in shots]
    assert np.all(data["sample_count"] == SAMPLES)
    assert data["housekeeping_board_k"].values.tolist() == [290.0 + number for number in range(COUNT)]
    assert data["housekeeping_board_k"].attrs["units"] == "K"
    dates = [np.datetime64(shot.date.removesuffix("+00:00")) for shot in shots]
    assert np.array_equal(data["date"], np.array(dates, "datetime64[ns]"))


def test_the_stimulus_is_told(data: xarray.Dataset) -> None:
    meanings = data["stimulus"].attrs["flag_meanings"].split()
    assert data["stimulus"].attrs["flag_values"].tolist() == [0, 1, 2, 3]
    assert [meanings[kind] for kind in data["stimulus"].values[:3]] == ["no_signal", "sine", "sine"]
    assert data["frequency_hz"].values[1:4].tolist() == [2e6, 3e6, 4e6]
    assert np.isnan(data["frequency_hz"].values[0])
    assert data["amplitude_vpp"].values[1] == 0.05
    assert data["offset_v"].values[1] == 1e-3
    assert data["largest_v"].values[:2].tolist() == [0.0, 0.025 + 1e-3]


def test_results_are_there_with_units_and_status(data: xarray.Dataset) -> None:
    assert data["code"].values.tolist() == [0, 1, 2]
    assert data["gain"].dims == ("code",)
    assert data["gain"].values[:2].tolist() == [5.1, 5.2]
    assert np.isnan(data["gain"].values[2])
    assert data["gain"].attrs == {"long_name": "gain", "units": "1"}
    status = data["status"]
    assert status.attrs["flag_meanings"].split() == list(STATUSES)
    assert status.attrs["flag_values"].tolist() == list(range(len(STATUSES)))
    assert [STATUSES[value] for value in status.values] == ["ok", "ok", "no_usable_point"]
    assert STATUSES[0] == "ok"


def test_every_variable_says_what_it_is(data: xarray.Dataset) -> None:
    assert data.attrs["Conventions"].startswith("CF-1.")
    for name, variable in data.variables.items():
        assert variable.attrs["long_name"], name
        said = {"units", "flag_meanings"} & (variable.attrs.keys() | variable.encoding.keys())
        assert said, name


@pytest.mark.parametrize(
    ("source", "word"), [("emulated", "EMULATED"), ("simulated", "SIMULATED"), ("hardware", "on hardware")]
)
def test_the_file_says_where_the_data_are_from(tmp_path: Path, source: str, word: str) -> None:
    with begin(tmp_path / "run", source=source) as run:
        run.finish(outcome(figures={}))
    with h5netcdf.File(tmp_path / "run" / "data.nc") as file:
        for attribute in ("source", "history", "comment"):
            assert word in file.attrs[attribute]
        assert ("no hardware" in file.attrs["comment"]) == (source != "hardware")


@pytest.mark.parametrize("sines", [0, 1, 3])
def test_what_only_a_sine_has_is_left_out_without_one(tmp_path: Path, sines: int) -> None:
    # Given silent shots, and some with a sine; the file names its coordinates
    shots = [replace(made(number), played=NoSignal()) for number in range(3)]
    shots[:sines] = [replace(shots[0], played=Sine(2e6 + number, 0.05, 1e-3)) for number in range(sines)]
    with with_windows(tmp_path / "run", *shots) as run:
        run.finish(outcome(figures={}))
    with h5netcdf.File(tmp_path / "run" / "data.nc") as file:
        # Then what a sine has is there for one sine, and not for none
        there = {"frequency_hz", "amplitude_vpp", "offset_v"} & set(file.variables)
        assert len(there) == (3 if sines else 0)
        assert set(file["counts"].attrs["coordinates"].split()) <= set(file.variables)


def with_windows(folder: Path, *shots: Shot) -> Run:
    run = begin(folder)
    for number, shot in enumerate(shots):
        run.shot(requested(number), lambda shot=shot: shot)  # type: ignore[misc]
    return run


def test_windows_of_different_lengths_are_filled_up(tmp_path: Path) -> None:
    # given windows of 5, 0 and 8 samples
    lengths = (5, 0, 8)
    with with_windows(tmp_path / "run", *(made(n, samples) for n, samples in enumerate(lengths))) as run:
        run.finish(outcome(figures={}))
    # when they are read as they are in the file
    with xarray.open_dataset(tmp_path / "run" / "data.nc", mask_and_scale=False) as data:
        # then each is whole, and the rest is the fill value
        assert data["sample_count"].values.tolist() == [5, 0, 8]
        for row, length in enumerate(lengths):
            assert np.array_equal(data["counts"][row, :length], made(row, length).window.counts)
            assert np.all(data["counts"][row, length:] == data["counts"].attrs["_FillValue"])


def test_a_run_without_a_single_shot_has_a_file_too(tmp_path: Path) -> None:
    with begin(tmp_path / "run") as run:
        run.finish(outcome(figures={}))
    with xarray.open_dataset(tmp_path / "run" / "data.nc") as data:
        assert data.sizes["shot"] == 0


def test_a_receiver_without_gain_codes_and_other_stimuli(tmp_path: Path) -> None:
    window = RangeWindow(np.arange(4, dtype=np.int16), 1.0, 0.0, 1e-9, 0.0, None, 0)
    pulse = SampledPulse(np.array([0.0, -0.2, 0.1]), 80e6)
    shots = [Shot(played, window, made(0).date) for played in (pulse, TransmittedPulse(), NoSignal())]
    with begin(tmp_path / "run") as run:
        for number, shot in enumerate(shots):
            run.shot(WindowRequest(number), lambda shot=shot: shot)  # type: ignore[misc]
        run.finish(outcome(figures={}))
    with xarray.open_dataset(tmp_path / "run" / "data.nc") as data:
        assert np.all(np.isnan(data["gain_code"]))
        assert data["stimulus"].values.tolist() == [2, 3, 0]
        assert data["largest_v"].values.tolist() == [0.2, 0.0, 0.0]


def with_candidates(number: int, *candidates: Candidate) -> Shot:
    shot = made(number, 0)
    return replace(shot, window=replace(shot.window, candidates=candidates))


def test_candidates_are_there_as_they_were_reported(tmp_path: Path) -> None:
    # given shots with two candidates, none, and one with a correlation window
    shots = (
        with_candidates(0, Candidate(1e-6, 2e-8, 0.1, (), 7), Candidate(2e-6, 3e-8, 0.05, (), 15)),
        with_candidates(1),
        with_candidates(2, Candidate(3e-6, 4e-8, 0.2, (5, -6, 7), 23)),
    )
    with with_windows(tmp_path / "run", *shots) as run:
        # then the journal gives them back
        assert [run.shot(requested(n), _never).window.candidates for n in range(3)] == [
            shot.window.candidates for shot in shots
        ]
        run.finish(outcome(figures={}))
    # and so does the file
    with xarray.open_dataset(tmp_path / "run" / "data.nc", mask_and_scale=False) as data:
        assert data["candidate_count"].values.tolist() == [2, 0, 1]
        for name, field in (
            ("candidate_arrival_s", "arrival_s"),
            ("candidate_fwhm_s", "fwhm_s"),
            ("candidate_amplitude_v", "amplitude_v"),
            ("candidate_first_sample", "first_sample"),
        ):
            assert data[name].dims == ("shot", "candidate")
            for row, shot in enumerate(shots):
                told = [getattr(one, field) for one in shot.window.candidates]
                assert data[name].values[row, : len(told)].tolist() == told
                assert np.all(data[name].values[row, len(told) :] == data[name].attrs["_FillValue"])
            assert data[name].attrs["long_name"]
        counts = data["candidate_counts"]
        assert counts.dims == ("shot", "candidate", "candidate_sample")
        assert counts.values[2, 0].tolist() == [5, -6, 7]
        assert np.all(counts.values[0] == counts.attrs["_FillValue"])


def test_candidates_without_correlation_windows_have_no_counts(tmp_path: Path) -> None:
    with with_windows(tmp_path / "run", with_candidates(0, Candidate(1e-6, 2e-8, 0.1))) as run:
        run.finish(outcome(figures={}))
    with xarray.open_dataset(tmp_path / "run" / "data.nc") as data:
        assert "candidate_counts" not in data
        assert data["candidate_first_sample"].values.tolist() == [[0]]
        assert np.issubdtype(data["candidate_first_sample"].dtype, np.integer)


def test_the_page_lists_the_variables_of_candidates(tmp_path: Path) -> None:
    with with_windows(tmp_path / "run", with_candidates(0, Candidate(1e-6, 2e-8, 0.1, (1,)))) as run:
        run.finish(outcome(figures={}))
    page = (Path(__file__).resolve().parent.parent / "docs/data-file.md").read_text(encoding="utf-8")
    with xarray.open_dataset(tmp_path / "run" / "data.nc") as data:
        named = [name for name in data.variables if str(name).startswith("candidate")]
        assert len(named) == 6
        for name in named:
            one = data[name]
            row = f"| `{name}` | {', '.join(map(str, one.dims))} | {one.units} | {one.long_name} |"
            assert row in page


def _never() -> Shot:
    raise AssertionError("the shot is in the journal")


def test_tables_share_a_dimension_of_one_size(tmp_path: Path) -> None:
    short = Table({"other": (np.arange(2), "1", "something else")}, "code")
    with begin(tmp_path / "run") as run:
        measure(run, 1)
        with pytest.raises(ValueError, match="2 rows, dimension code has 3"):
            run.finish(outcome(tables={**outcome().tables, "more": short}, figures={}))


def test_columns_of_one_table_have_one_length() -> None:
    with pytest.raises(ValueError, match="need one row count"):
        Table({"a": (np.zeros(2), "1", "a"), "b": (np.zeros(3), "1", "b")}, "row")


def test_integers_and_flags_of_a_table_stay_what_they_are(tmp_path: Path) -> None:
    table = Table(
        {
            "number": (np.ma.masked_array([3, 4], [False, True]), "1", "some number"),
            "usable": (np.array([True, False]), "1", "whether it counts"),
            "level": (np.array([np.nan, 2.0]), "V", "a level"),
        },
        "row",
    )
    with begin(tmp_path / "run") as run:
        summary = run.finish(outcome(figures={}))
        write_data(tmp_path / "data.nc", run.shots(), {"t": table}, summary)
    with xarray.open_dataset(tmp_path / "data.nc", mask_and_scale=False) as data:
        assert data["number"].values[0] == 3
        assert data["number"].values[1] == data["number"].attrs["_FillValue"]
        assert data["usable"].values.tolist() == [1, 0]
        assert data["level"].values.tolist() == [data["level"].attrs["_FillValue"], 2.0]
