"""``belahil simulate``: its run folder, its numbers, its refusals."""

from __future__ import annotations

import html
import json
import os
import re
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from belahil.cli.main import main
from belahil.errors import RefusedInput
from belahil.outcome import STATUSES
from belahil.pulse_fit import gaussian_fit
from belahil.report import remake
from procedures.simulate import SimulateOptions, simulate
from procedures.simulate_outcome import analyse, remarks
from sim.accuracy import FLOOR, Accuracy
from sim.chain import Chain
from sim.scene import load_scene, parse_scene


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "night"
    status = main(
        ["simulate", "night", "--shots", "4", "--tolerance", "1e-3", "--quiet", "--out", str(folder)]
    )
    assert status == 0
    return folder


def test_the_run_folder_holds_what_a_run_folder_holds(folder: Path) -> None:
    for name in ("summary.json", "data.nc", "report.html", "scene.toml", "log.txt", "figure-simulation.svg"):
        assert (folder / name).is_file(), name
    summary = json.loads((folder / "summary.json").read_text())
    assert list(summary) == [
        "schema",
        "procedure",
        "source",
        "verdict",
        "seed",
        "software",
        "instruments",
        "started",
        "finished",
        "results",
    ]
    assert (summary["procedure"], summary["source"], summary["verdict"]) == ("simulate", "simulated", "none")


def test_the_scene_of_the_folder_is_the_scene(folder: Path) -> None:
    assert parse_scene((folder / "scene.toml").read_text()) == load_scene("night")


def test_the_numbers_are_those_of_the_chain(folder: Path) -> None:
    results = json.loads((folder / "summary.json").read_text())["results"]
    echo = Chain(load_scene("night")).echo()

    assert results["status"] == "ok"
    assert results["echo"]["photons"] == pytest.approx(echo.photons)
    assert results["echo"]["energy_j"] == pytest.approx(0.243e-15, rel=2e-3)
    assert results["echo"]["peak_at_converter_v"] == pytest.approx(29.2e-3, rel=0.05)
    assert 0 < results["predicted_error"] <= results["tolerance"] == 1e-3
    free, night, day = results["cases"]
    assert [case["case"] for case in results["cases"]] == ["noise-free", "night", "day"]
    assert free["noise_rms_v"] == 0
    assert day["noise_rms_v"] / night["noise_rms_v"] == pytest.approx(1.8, rel=0.01)
    # The link budget's width behind the filter; a Gaussian fitted to 12-bit samples comes near it.
    assert free["fwhm_s"] == pytest.approx(28e-9, rel=0.05)
    assert [results["shots"][key] for key in ("count", "detected", "fitted")] == [4, 4, 4]
    assert results["shots"]["arrival"]["value"] == pytest.approx(free["arrival_s"], abs=10e-9)


def test_the_data_file_holds_windows_and_curves(folder: Path) -> None:
    xarray = pytest.importorskip("xarray")

    with xarray.open_dataset(folder / "data.nc") as data:
        assert data["counts"].shape == (4, 16064)
        assert {"curve_received_rate", "samples_night", "fit_arrival_s", "ground_height"} <= set(data)
        assert data["ground_height"].dims == ("ground_y", "ground_x")
        there = {"ground_x": 7.0, "ground_y": -9.0}
        nearest = data["ground_height"].sel(there, method="nearest")
        # The plane of the scene rises by 10 degrees along x.
        assert float(nearest) == pytest.approx(np.tan(np.radians(10)) * float(nearest["ground_x"]), abs=1e-9)
        assert abs(float(nearest["ground_y"]) + 9) < 1
        assert data["candidate_arrival_s"].shape == (4, 4)
        rate, time = data["curve_received_rate"].values, data["time"].values
        assert "SIMULATED" in data.attrs["source"]
    window = Chain(load_scene("night")).window(2)
    assert (rate.sum() * (time[1] - time[0])) == pytest.approx(1300, rel=0.05)
    assert window.counts.max() > window.zero_count + 20


def test_the_page_tells_of_a_scene_and_can_be_made_again(folder: Path) -> None:
    page = (folder / "report.html").read_text()

    assert "SIMULATED DATA" in page
    assert "belahil simulate scene.toml" in page
    assert "bench.toml" not in page
    assert "Verdict" not in page
    assert remake(folder).read_text() == page


def test_results_depend_on_the_seed_alone() -> None:
    scene, options = load_scene("night"), SimulateOptions(1e-3, 2)
    one, other = (analyse(simulate(scene, options)).results for _ in range(2))

    assert json.dumps(one, allow_nan=False) == json.dumps(other)


def test_explanation_and_numbers_are_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "plane", "--shots", "1", "--out", str(tmp_path / "run")]) == 0

    told = capsys.readouterr().out
    for words in (
        "because",
        "predicted error",
        "cost of a shot",
        "photons",
        "noise-free: noise 0 V",
        "report:",
    ):
        assert words in told


@pytest.mark.parametrize(
    "text", ["", "altitude_m = 1000.0\n", "altitude_m = 3e6\n[electronics]\ncutoff_hz = 4e6\n"]
)
def test_numbers_on_the_terminal_have_the_prefix_of_their_size(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # Given echoes from far below a millivolt to kilovolts
    (tmp_path / "mine.toml").write_text(text + "[noise]\ndark_rms_v = 0.83e-3\n")
    arguments = ["simulate", str(tmp_path / "mine.toml"), "--shots", "3", "--out", str(tmp_path / "run")]
    assert main(arguments) == 0
    # Then no number with a unit has an exponent or four digits before its point
    said = capsys.readouterr().out
    sized_numbers = re.findall(r"(?<![\w.])-?([0-9.]+(?:e[+-]?\d+)?) ([fpnµmkMG]?(?:Hz|V|J|s))\b", said)
    assert len(sized_numbers) > 6
    assert {unit[-1] for _, unit in sized_numbers} >= {"z", "V", "J"}
    for number, unit in sized_numbers:
        assert "e" not in number, (number, unit)
        least = 1e-3 if unit == "fJ" else 1
        assert least <= float(number) < 1000 or float(number) == 0, (number, unit)


@pytest.mark.parametrize("more", [[], ["--quiet"], ["--json"]])
def test_the_plan_stands_there_before_a_shot_is_computed(
    more: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # Given a chain that fails at its first shot
    def fails(chain: Chain, shot: int) -> None:
        raise RefusedInput(f"no shot {shot}")

    monkeypatch.setattr(Chain, "window", fails)
    # When a scene is simulated
    assert main(["simulate", "night", "--out", str(tmp_path / "run"), *more]) == 2
    # Then the whole plan has been told, unless nobody wants it
    assert capsys.readouterr().out.rstrip() == ("" if more else Chain(load_scene("night")).explain())


def test_the_summary_is_printed_as_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["simulate", "plane", "--shots", "1", "--seed", "5", "--json", "--out", str(tmp_path / "run")]

    assert main(arguments) == 0

    summary = json.loads(capsys.readouterr().out)
    assert summary["seed"] == 5
    assert summary["results"]["shots"]["arrival_spread"] is None


@pytest.mark.parametrize(
    "text",
    [
        "[surface]\nreflectance = 0.0\n",
        "[detector]\nboresight_rad = [0.01, 0.0]\n[sun]\nincidence_deg = 20.0\n",
    ],
)
def test_without_light_nothing_is_fitted_to_noise(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # Given scenes from which no light of the laser comes back, with noise in which a Gaussian could be found
    (tmp_path / "black.toml").write_text(text + "[noise]\ndark_rms_v = 0.83e-3\nshot = true\n")
    # When they are simulated
    arguments = ["simulate", str(tmp_path / "black.toml"), "--shots", "5", "--out", str(tmp_path / "run")]
    assert main(arguments) == 0
    # Then every fit says that there was no light, and none has a number
    results = json.loads((tmp_path / "run" / "summary.json").read_text())["results"]
    assert results["status"] == "no_light"
    numbers = ("arrival_s", "fwhm_s", "amplitude_v")
    for case in results["cases"]:
        assert [case["status"], *(case[key] for key in numbers)] == ["no_light", None, None, None]
    shots = results["shots"]
    assert (shots["detected"], shots["fitted"], shots["arrival"], shots["arrival_spread"]) == (
        0,
        0,
        None,
        None,
    )
    with h5py.File(tmp_path / "run" / "data.nc") as file:
        assert (file["fit_status"][()] == STATUSES.index("no_light")).all()
        assert (file["fit_arrival_s"][()] == file["fit_arrival_s"].attrs["_FillValue"]).all()
    said = capsys.readouterr().out
    assert said.count("no light, no Gaussian") == 3
    assert "Gaussian ok" not in said
    assert "no echo to find in 5 shots" in said


def test_an_echo_beyond_the_span_is_still_looked_for() -> None:
    # Given an echo of 9 kV at a converter of 2 V, which clips at both ends, and of 3 V
    for text, tops in (("altitude_m = 1000.0\n", 1e3), ("altitude_m = 55e3\n", 2.0)):
        results = analyse(simulate(parse_scene(text), SimulateOptions(1e-2, 3))).results
        assert results["echo"]["peak_at_converter_v"] > tops
        assert results["shots"]["detected"] == 3


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        ("[laser]\nenergy = 1.0\n", [], "unknown key `energy`"),
        ("altitude_m = 0.0\n", [], "altitude_m"),
        ("[detector]\nbias_v = 500.0\n", [], "breakdown"),
        ("", ["--tolerance", "-1e-3"], "tolerance -0.001"),
        ("", ["--tolerance", "1e-15"], "floor"),
        ("[surface]\nslope_deg = 89.9\nkind = 'crater'\n", ["--tolerance", "1e-6"], "predicted error"),
    ],
)
def test_bad_input_is_one_line_and_no_folder(
    text: str, options: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "scene.toml").write_text(text)

    status = main(["simulate", str(tmp_path / "scene.toml"), *options, "--out", str(tmp_path / "run")])

    said = capsys.readouterr().err
    assert status == 2
    assert words in said
    assert said.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_an_unknown_scene_names_the_ready_ones(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "moon"]) == 2

    assert "boulder-example" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["simulate", "pulse-shape"])
def test_the_help_tells_the_tolerances_that_are_taken(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, "--help"]) == 0

    said = " ".join(capsys.readouterr().out.split())
    lowest, highest = re.findall(r"relative to (?:the|its) peak, from (\S+) to below (\S+);", said)[0]
    assert Accuracy(float(lowest)).tolerance == FLOOR
    assert Accuracy(float(highest) * (1 - 1e-9))
    for beyond in (float(lowest) * (1 - 1e-9), float(highest)):
        with pytest.raises(RefusedInput):
            Accuracy(beyond)


@pytest.mark.parametrize("words", [{"products": "windows"}, {"shots": 0}, {"tolerance": -1.0}])
def test_options_that_do_not_exist_are_refused(words: dict[str, Any]) -> None:
    with pytest.raises(RefusedInput):
        SimulateOptions(**words)


def test_a_used_folder_is_refused_before_anything_is_computed(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Chain, "__init__", lambda *_: pytest.fail("computed"))

    assert main(["simulate", "plane", "--out", str(folder)]) == 2


@pytest.mark.parametrize(("products", "samples"), [("candidates", 0), ("correlation_windows", 42)])
def test_a_receiver_reports_the_products_that_are_asked_for(
    products: str, samples: int, tmp_path: Path
) -> None:
    # Given two shots of a scene, whole and as reported products
    line = ["simulate", "plane", "--shots", "2", "--seed", "3", "--quiet"]
    assert main([*line, "--out", str(tmp_path / "whole")]) == 0
    # When the products are asked for
    assert main([*line, "--products", products, "--out", str(tmp_path / "run")]) == 0
    # Then results are equal, candidates too, and only the samples asked for are in the file
    results = [
        json.loads((tmp_path / one / "summary.json").read_text())["results"] for one in ("whole", "run")
    ]
    assert results[0] == results[1]
    with h5py.File(tmp_path / "whole" / "data.nc") as whole, h5py.File(tmp_path / "run" / "data.nc") as file:
        assert np.array_equal(file["candidate_arrival_s"][()], whole["candidate_arrival_s"][()])
        assert (file["sample_count"][()] == 0).all()
        kept = [name for name in file if name.startswith("candidate") and "counts" in name]
        assert bool(kept) == bool(samples)
        if kept:
            assert file[kept[0]].shape[-1] == samples


def test_the_dtm_of_a_file_is_simulated(tmp_path: Path) -> None:
    heights = np.random.default_rng(4).normal(0, 0.3, (60, 60))
    np.save(tmp_path / "ground.npy", heights)
    (tmp_path / "dtm.toml").write_text("[surface]\nkind = 'dtm'\nfile = 'ground.npy'\nspacing_m = 1.5\n")

    status = main(
        ["simulate", str(tmp_path / "dtm.toml"), "--shots", "1", "--quiet", "--out", str(tmp_path / "run")]
    )

    assert status == 0
    results = json.loads((tmp_path / "run" / "summary.json").read_text())["results"]
    assert results["terrain_posts_error"] > 1e-3


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "[surface]\nkind = 'dtm'\nfile = 'ground.npy'\ncentre_m = [44.0, 0.0]\n",
            "of the beam meets no known ground",
        ),
        ("altitude_m = 500.0\n", "2 of 2 windows have samples beyond the converter's span of 2 V"),
        ("[noise]\ndark_rms_v = 0.83\n", "2 of 2 windows have samples beyond the converter's span of 2 V"),
        ("[surface]\nreflectance = 0.0\n", "no light comes back: the ground is black"),
    ],
)
def test_what_a_user_may_not_have_meant_is_told(
    text: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    np.save(tmp_path / "ground.npy", np.zeros((60, 60)))
    (tmp_path / "mine.toml").write_text(text)

    arguments = ["simulate", str(tmp_path / "mine.toml"), "--shots", "2", "--out", str(tmp_path / "run")]
    assert main(arguments) == 0

    assert words in capsys.readouterr().out.partition("note: ")[2]
    assert words in html.unescape((tmp_path / "run" / "report.html").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("text", "seen"),
    [
        ("altitude_m = 1000.0\n", ["noise-free", "night", "day"]),
        ("[noise]\ndark_rms_v = 3.0\n", ["night", "day"]),
    ],
)
def test_a_window_beyond_both_ends_of_the_span_is_saturated(text: str, seen: list[str]) -> None:
    # Given an echo of kilovolts, whose undershoot clips too, or noise beyond the span of 2 V
    results = analyse(simulate(parse_scene(text), SimulateOptions(1e-2, 3))).results

    # Then the cases are called what they are, and no number is told
    rows = [case for case in results["cases"] if case["case"] in seen]
    assert [(row["case"], row["status"], row["arrival_s"]) for row in rows] == [
        (one, "saturated", None) for one in seen
    ]
    assert results["shots"]["fitted"] == 0


@pytest.mark.parametrize("name", ["plane", "day", "fractal"])
def test_of_a_scene_as_it_should_be_nothing_is_remarked(name: str) -> None:
    assert remarks(simulate(load_scene(name), SimulateOptions(1e-2, 2))) == []


def test_a_real_terrain_model_runs_from_end_to_end(tmp_path: Path) -> None:
    path = os.environ.get("BELAHIL_LUNAR_DTM")
    if not path:
        pytest.skip("BELAHIL_LUNAR_DTM does not name a terrain model")
    pytest.importorskip("rasterio")
    (tmp_path / "moon.toml").write_text(
        f"[surface]\nkind = 'dtm'\nfile = '{path}'\nextent_m = 200.0\n[noise]\nshot = true\n"
    )

    status = main(
        ["simulate", str(tmp_path / "moon.toml"), "--shots", "2", "--quiet", "--out", str(tmp_path / "run")]
    )

    assert status == 0
    results = json.loads((tmp_path / "run" / "summary.json").read_text())["results"]
    assert (results["status"], results["method"]) == ("ok", "grid")
    assert results["echo"]["photons"] == pytest.approx(1300, rel=0.01)
    assert 0 < results["predicted_error"] <= 1e-4
    assert 0 < results["terrain_posts_error"] < 0.01


@pytest.mark.parametrize("clock_ppm", [-250.0, 0.0, 250.0])
def test_arrivals_and_widths_are_in_true_time_whatever_the_clock_of_the_receiver_does(
    clock_ppm: float,
) -> None:
    # Given a receiver whose clock is wrong by as much as is allowed
    scene = parse_scene(f"seed = 3\n[electronics]\nclock_ppm = {clock_ppm}\n")
    # When a few shots are simulated
    done = simulate(scene, SimulateOptions(tolerance=1e-3, shots=3))
    results = analyse(done).results
    # Then arrivals and widths are those of Gaussians fitted to the samples at their true times
    for case, told in zip(done.cases, results["cases"], strict=True):
        fit = gaussian_fit(case.volts, float(case.times_s[1] - case.times_s[0]))
        assert fit.pulse is not None
        assert told["arrival_s"] == pytest.approx(case.times_s[0] + fit.pulse.arrival_s, abs=1e-13)
        assert told["fwhm_s"] == pytest.approx(fit.pulse.fwhm_s, abs=1e-13)
    request, chain = done.chain.correlation_window(), done.chain
    first, step_s, expected = chain.receiver.edges(request), chain.receiver.grid.interval_s, []
    for index, shot in enumerate(done.shots):
        fit = gaussian_fit(shot.window.volts[first : first + request.sample_count], step_s)
        assert fit.pulse is not None
        expected.append(chain.first_sample_s(index, request) + fit.pulse.arrival_s)
    assert results["shots"]["arrival"]["value"] == pytest.approx(np.mean(expected), abs=1e-13)
