"""What the range campaign calls true: each definition against a direct evaluation, and in all outputs."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from belahil.cli.main import main
from belahil.errors import RefusedInput
from procedures import range_ground, range_places
from procedures.campaign_range import RangeOptions, plan
from procedures.echo_hits import HALF_LIGHT
from procedures.footprint_planes import EDGE, footprint_planes
from procedures.range_chunks import echo_draws, whole_shots
from procedures.range_ground import GroundKey, Strips
from procedures.range_places import described, footprints, places, serving
from procedures.range_scenes import Condition, base_scene
from procedures.range_truth import TRUTHS, Definitions
from sim.draws import Draws
from sim.scene import as_toml
from sim.terrain_grid import Grid
from sim.terrain_statistics import plane_fit
from sim.terrain_synthesis import fractional_brownian

POSTS, STEP_M = 121, 1.5
REACH = 4.5
"""Standard deviations to which the beam counts."""
NIGHT = asdict(Condition("mean", "night", 0.3, 0.8e-3))


def relief(kind: str) -> Grid:
    away_m = STEP_M * (np.arange(POSTS) - POSTS // 2)
    if kind == "crater":
        squares = away_m**2 + away_m[:, None] ** 2
        return Grid(-4.0 * np.maximum(1 - squares / 15.0**2, 0.0), STEP_M, away_m[0], away_m[0])
    heights = fractional_brownian(POSTS, 0.8, np.random.default_rng(4))
    return Grid(2.0 * heights / heights.std(), STEP_M, away_m[0], away_m[0])


def one_fractal(monkeypatch: pytest.MonkeyPatch) -> None:
    """The smoothest fractal in the place of eleven."""
    monkeypatch.setattr(range_ground, "LEVELS", 1)
    for one in (range_ground.flat_terrains, range_ground.strips, range_places._flat_planes):
        one.cache_clear()


def directly_m(grid: Grid, at: tuple[float, float], sigma_m: float, by_beam: bool) -> dict[str, float]:
    """Heights by each definition about a post, from all posts one by one."""
    x, y = grid.posts()
    squares = (x - at[0]) ** 2 + (y[:, None] - at[1]) ** 2
    beam = np.where(squares <= (REACH * sigma_m) ** 2, np.exp(-0.5 * squares / sigma_m**2), 0.0)
    weights = beam if by_beam else (squares <= (EDGE * sigma_m) ** 2).astype(float)
    fit = plane_fit(x[None, :] - at[0], y[:, None] - at[1], grid.values, weights)
    return {
        "light": float((beam * grid.values).sum() / beam.sum()),
        "centre": float(grid.values[squares == squares.min()][0]),
        "plane": fit.centre_m[2],
    }


@pytest.mark.parametrize("by_beam", [False, True])
@pytest.mark.parametrize(("gradient", "sigma_m"), [((0.1763, 0.0), 6.25), ((-0.3, 0.2), 9.0)])
def test_on_a_plane_all_definitions_agree(
    gradient: tuple[float, float], sigma_m: float, by_beam: bool
) -> None:
    # given a plane, whose mean under any symmetric weight is its height in the middle
    x, y = relief("crater").posts()
    plane = Grid(gradient[0] * x + (gradient[1] * y)[:, None], STEP_M, x[0], y[0])

    found = footprint_planes(plane, sigma_m, 5 * sigma_m, by_beam=by_beam)

    # then they agree to the rounding of the transforms: eps log2 of their size, times the norms of heights
    # and weights; the weights sum to 1, so their norm is below 1
    rounding_m = 2.2e-16 * math.log2(plane.values.size) * float(np.linalg.norm(plane.values))
    assert rounding_m < 1e-10
    assert np.abs(found.light_m - found.centre_m).max() < rounding_m
    assert np.abs(found.plane_m - found.centre_m).max() < rounding_m


@pytest.mark.parametrize("kind", ["crater", "fractal"])
@pytest.mark.parametrize("by_beam", [False, True])
@pytest.mark.parametrize("truth", list(TRUTHS))
def test_times_by_each_definition_are_those_of_a_direct_evaluation(
    kind: str, by_beam: bool, truth: str
) -> None:
    # given relief with a tilt, and places on it
    sigma_m, ground = 6.25, Strips((relief(kind),), 10.0)
    planes = ground.planes(described(ground.flats, sigma_m, by_beam))

    at = places(serving(ground, planes, (0.0, 40.0), truth), 5, Draws(3, 0))

    whole = ground.surface.relief
    assert isinstance(whole, Grid)
    for n, (x_m, y_m) in enumerate(at.centre_m):
        expected = directly_m(whole, (x_m, y_m), sigma_m, by_beam)
        for name in TRUTHS:
            told_m = -HALF_LIGHT * float(getattr(at, f"true_by_{name}_s")[n])
            assert told_m == pytest.approx(expected[name], abs=1e-9)
        assert -HALF_LIGHT * at.true_s[n] == pytest.approx(expected[truth], abs=1e-9)
        # and the plane weighted by the beam passes through the mean of the light
        assert not by_beam or expected["plane"] == pytest.approx(expected["light"], abs=1e-9)


def test_the_floor_of_a_crater_is_farther_than_its_light() -> None:
    sigma_m, grid = 6.25, relief("crater")
    found = footprint_planes(grid, sigma_m, 5 * sigma_m)
    middle = found.light_m.shape[0] // 2
    # given a bowl -4 (1 - r^2 / 15^2), light within r = 4.5 sigma sees it fill by 4 E[min(r, 15)^2] / 15^2
    r = np.linspace(0.0, REACH * sigma_m, 20001)
    share = r * np.exp(-0.5 * r**2 / sigma_m**2)
    expected_m = float((share * 4.0 * np.minimum(r, 15.0) ** 2 / 15.0**2).sum() / share.sum())
    raised_m = found.light_m[middle, middle] - found.centre_m[middle, middle]
    assert raised_m == pytest.approx(expected_m, rel=0.01)


def chunk(truth: str, by_beam: bool = False) -> Mapping[str, Any]:
    definitions = asdict(Definitions(truth, by_beam))
    slopes, key = (5.0, 15.0), asdict(GroundKey(factor=8.0))
    return echo_draws(as_toml(base_scene(8e5)), key, slopes, [NIGHT], 8, 1, 1, 0, 0.0, definitions)


def test_errors_and_their_bias_follow_the_truth(monkeypatch: pytest.MonkeyPatch) -> None:
    # given the same places on a fractal
    one_fractal(monkeypatch)
    made = {truth: chunk(truth) for truth in TRUTHS}
    for truth, one in made.items():
        # then the changes that are told are from the truth that holds
        assert np.array_equal(one[f"by_{truth}_m"], np.zeros(8))
        change_m = made["light"][f"by_{truth}_m"]
        for other in TRUTHS:
            from_here = made["light"][f"by_{other}_m"] - change_m
            assert one[f"by_{other}_m"] == pytest.approx(from_here, abs=1e-9)
        # and the error without noise is less by it, but for where the pulse lies between two samples, which
        # moves fits of pulses of 30 ns by some 0.02 ns
        assert one["still_m"] == pytest.approx(made["light"]["still_m"] - change_m, abs=0.01)
    assert np.abs(made["light"]["by_centre_m"]).max() > 0.2
    one_fractal(monkeypatch)


def test_whole_shots_have_the_same_truth(monkeypatch: pytest.MonkeyPatch) -> None:
    one_fractal(monkeypatch)
    scene, key, slopes = as_toml(base_scene(5e5)), asdict(GroundKey(factor=8.0)), (5.0, 15.0)
    errors_m = {
        truth: whole_shots(scene, key, slopes, NIGHT, 6, 1, 0, asdict(Definitions(truth)))["error_m"]
        for truth in TRUTHS
    }
    # given the same windows, their errors differ by what is true, and by nothing else
    _, at = footprints(key, (6.25, 6.25), slopes, 6, Draws(1, 0))
    for truth in ("centre", "plane"):
        times_s = getattr(at, f"true_by_{truth}_s") - at.true_by_light_s
        assert errors_m["light"] - errors_m[truth] == pytest.approx(HALF_LIGHT * times_s, abs=1e-6)
    one_fractal(monkeypatch)


def test_every_chunk_is_told_the_definitions() -> None:
    options = RangeOptions(study_echoes=1, sets=1, echoes=1, shots=1, truth="plane", by_beam=True)
    told = [one.given["definitions"] for one in plan(options).chunks if "slopes_deg" in one.given]
    assert told == [{"truth": "plane", "by_beam": True}] * len(told)
    assert len(told) > 300


def test_another_truth_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(RefusedInput, match="allowed are light, centre, plane"):
        RangeOptions(truth="best")
    assert main(["campaign", "range", "--truth", "best"]) == 2
    assert "--truth best" in capsys.readouterr().err


def test_every_output_says_what_is_true(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    one_fractal(monkeypatch)
    few = ["--echoes", "2", "--repeats", "1", "--sets", "1", "--noise-windows", "20", "--shots", "0"]
    few += ["--parts", "table", "--workers", "1", "--truth", "centre", "--by-beam"]
    assert main(["campaign", "range", "--out", str(tmp_path / "centre"), *few]) == 0
    terminal = capsys.readouterr().out
    results = json.loads((tmp_path / "centre" / "summary.json").read_text())["results"]
    page = (tmp_path / "centre" / "report.html").read_text()
    with h5py.File(tmp_path / "centre" / "data.nc") as data:
        attributes = dict(data.attrs)
        by_light_m, by_centre_m = (data[f"truth_by_{name}_mean"][:] for name in ("light", "centre"))
    expected = Definitions("centre", True).told()
    assert results["definitions"] == expected
    for name, sentence in expected.items():
        assert attributes[f"definition_of_{name}"] == sentence
        assert sentence in page
    assert "post in the middle" in terminal
    assert "the whole beam" in terminal
    # and the change with each other definition is told
    changes = {(one["truth"], one["altitude_m"]): one["mean_m"] for one in results["table"]["truths"]}
    assert len(changes) == 3 * 4
    assert by_light_m.tolist() == [changes["light", 1e5 * n] for n in (5, 8, 11, 14)]
    assert not by_centre_m.any()
    one_fractal(monkeypatch)
