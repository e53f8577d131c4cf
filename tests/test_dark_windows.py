"""Recorded dark noise: read from arrays and from runs, drawn by shot."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from belahil.errors import ConfigError
from sim.dark_windows import read_dark_windows
from sim.draws import Draws


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    path = tmp_path / "dark.npy"
    np.save(path, np.random.default_rng(1).normal(0.01, 0.83e-3, (5, 400)))
    return path


def test_a_shot_gets_one_window_and_always_the_same(recorded: Path) -> None:
    windows = read_dark_windows(str(recorded), 4)

    drawn = [windows.draw(Draws(3, shot), 400) for shot in range(40)]

    assert np.array_equal(windows.draw(Draws(3, 17), 400), drawn[17])
    rows = {int(np.flatnonzero((windows.volts == one).all(axis=1))[0]) for one in drawn}
    assert rows == set(range(5))
    # four standard errors of an rms of 2000 samples
    assert windows.rms_v == pytest.approx(0.83e-3, rel=4 / np.sqrt(2 * 2000))


def test_a_shorter_stretch_begins_anywhere_and_a_longer_one_is_refused(recorded: Path) -> None:
    windows = read_dark_windows(str(recorded), 4)

    first = {windows.draw(Draws(3, shot), 100)[0] for shot in range(40)}

    assert len(first) > 30
    with pytest.raises(ConfigError, match="have 400 samples; 401 are asked for"):
        windows.draw(Draws(3, 0), 401)
    with pytest.raises(ValueError, match="read-only"):
        windows.draw(Draws(3, 0), 100)[0] = 1


def test_a_file_that_changes_is_read_again(recorded: Path) -> None:
    before = read_dark_windows(str(recorded), 4)
    assert read_dark_windows(str(recorded), 4) is before

    np.save(recorded, np.zeros(7))
    import os

    os.utime(recorded, ns=(1, 1))

    assert read_dark_windows(str(recorded), 4).volts.tolist() == [[0.0] * 7]


@pytest.mark.parametrize(
    ("array", "said"),
    [
        (np.zeros((2, 2, 2)), "needs finite floating-point volts"),
        (np.array([[np.nan]]), "needs finite floating-point volts"),
        (np.zeros((2, 3), np.int16), "int16 of shape"),
        (np.zeros((0, 3)), "needs finite floating-point volts"),
    ],
)
def test_a_bad_array_is_told_in_one_line(tmp_path: Path, array: np.ndarray, said: str) -> None:
    path = tmp_path / "bad.npy"
    np.save(path, array)

    with pytest.raises(ConfigError, match=said) as caught:
        read_dark_windows(str(path), 4)
    assert str(caught.value).startswith(f"[noise] dark_windows = {path}: ")


@pytest.mark.parametrize("name", ["dark.csv", "dark.npy", "dark.nc"])
def test_a_file_that_is_something_else(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text("hello")

    with pytest.raises(ConfigError, match="dark_windows") as caught:
        read_dark_windows(str(path), 4)
    assert "\n" not in str(caught.value)


def test_windows_of_a_run_at_that_gain_code(tmp_path: Path) -> None:
    # given what a run's data file holds: three silent windows, one of another code, one with a sine
    path = tmp_path / "data.nc"
    counts = np.arange(5 * 6, dtype=np.int16).reshape(5, 6) + 2048
    with h5py.File(path, "w") as file:
        file["counts"] = counts
        file["stimulus"] = np.array([0, 1, 0, 0, 0], np.int8)
        file["stimulus"].attrs["flag_meanings"] = "no_signal sine sampled_pulse transmitted_pulse"
        file["gain_code"] = np.array([4, 4, 5, 4, 4], np.int16)
        file["sample_count"] = np.array([6, 6, 6, 5, 6], np.int32)
        file["zero_count"] = np.full(5, 2048.0)
        file["volts_per_count"] = np.full(5, 0.5e-3)

    windows = read_dark_windows(str(path), 4)

    # then those at gain code 4 are there, as long as the shortest
    assert windows.volts == pytest.approx((counts[[0, 3, 4], :5] - 2048) * 0.5e-3, rel=1e-6)
    with pytest.raises(ConfigError, match="no window without a stimulus at gain code 6"):
        read_dark_windows(str(path), 6)
