"""Recorded dark noise: read from arrays and from runs, drawn by shot."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from belahil.cli.main import main
from belahil.errors import ConfigError
from sim.chain import Chain
from sim.dark_windows import read_dark_windows
from sim.draws import Draws
from sim.scene import parse_scene


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


# ---- the data file of a noise measurement as the noise of a scene


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of the command on a bench whose laser disturbs its receiver."""
    folder = tmp_path_factory.mktemp("noise")
    bench = folder / "bench.toml"
    bench.write_text(
        '[generator]\naddress = "simulated"\n[digitizer]\nlink = "simulated"\n'
        "[emulation.receiver]\nemc_burst = { amplitude_v = 20e-3, delay_s = 50e-6, decay_s = 2e-6 }\n"
    )
    words = ["--codes", "4,5", "--dark-windows", "6", "--bench", str(bench), "--quiet"]
    assert main(["noise", *words, "--out", str(folder / "run")]) == 0
    return folder / "run"


@pytest.mark.parametrize("laser", ["", "off", "firing"])
def test_a_scene_takes_its_noise_from_a_measurement(measured: Path, laser: str) -> None:
    # given a scene without light but for the noise that was recorded
    scene = parse_scene(
        f'gain_code = 4\n[noise]\ndark_windows = "{measured / "data.nc"}"\ndark_laser = "{laser}"\n'
    )
    chain = Chain(scene)
    (row,) = [
        one
        for one in json.loads((measured / "summary.json").read_text())["results"]["gain_codes"]
        if one["code"] == 4
    ]
    # when whole windows are simulated
    shots = [chain.window(shot).volts for shot in range(6)]
    echo = chain.samples(None, chain.whole_window()).volts
    rest = np.array([one - echo for one in shots])
    # then their noise is what was measured, rounding of both converters included
    told = row["noise_rms"] if laser == "off" else row["firing"]["noise_rms"]
    step_v = 2.0 / 4096
    expected_v = np.sqrt(told["value"] ** 2 + 2 * step_v**2 / 12)
    assert np.sqrt(np.mean(np.var(rest, axis=1))) == pytest.approx(expected_v, rel=0.02)
    # and the burst stands where it stood after the shot pulse
    burst = slice(4000, 4030)
    assert (np.max(np.abs(rest[:, burst])) > 0.05) == (laser != "off")
    assert np.max(np.abs(rest[:, :3900])) < 0.02


def test_a_run_without_such_windows_is_told(measured: Path, tmp_path: Path) -> None:
    few = ["--codes", "4", "--dark-windows", "1", "--bench", "simulated", "--laser", "off", "--quiet"]
    assert main(["noise", *few, "--out", str(tmp_path / "off")]) == 0
    path = tmp_path / "off" / "data.nc"
    assert read_dark_windows(str(path), 4).volts.shape == (1, 16064)
    with pytest.raises(ConfigError, match=r'dark_laser = "firing": no such window at gain code 4'):
        read_dark_windows(str(path), 4, "firing")
    np.save(tmp_path / "dark.npy", np.zeros((2, 100)))
    with pytest.raises(ConfigError, match="an array does not tell when the laser fired"):
        read_dark_windows(str(tmp_path / "dark.npy"), 4, "off")
    with pytest.raises(ConfigError, match=r'dark_laser = "off" without dark_windows'):
        parse_scene('[noise]\ndark_laser = "off"\n')


def test_the_command_simulates_with_measured_noise(measured: Path, tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(f'[surface]\nslope_deg = 10.0\n[noise]\ndark_windows = "{measured / "data.nc"}"\n')
    assert main(["simulate", str(scene), "--out", str(tmp_path / "run"), "--quiet"]) == 0
    assert (tmp_path / "run" / "data.nc").is_file()
