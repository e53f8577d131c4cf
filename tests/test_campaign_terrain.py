"""Terrain campaigns: deviations, their uncertainties, areas, quantiles, and the command."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from belahil.cli.campaign_terrain import _lines
from belahil.cli.main import main
from belahil.errors import RefusedInput
from procedures.arrival_ground import ROUGHNESS_M
from procedures.campaign_terrain import BASELINES_M, TerrainOptions, one_fractal, parsed_area, plan
from procedures.campaign_terrain_outcome import Terrains, bands_of, law_m
from procedures.relief_profile import Area, block_sums, part_of, profile, tiles_of, typical_areas
from procedures.study_ground import LEVELS, digest
from sim.terrain import plane, tilted
from sim.terrain_dtm import from_array
from sim.terrain_grid import Grid
from sim.terrain_statistics import rms_deviation
from sim.terrain_synthesis import fractional_brownian


def grid_of(surface) -> Grid:  # type: ignore[no-untyped-def]
    assert isinstance(surface.relief, Grid)
    return surface.relief


def gappy(seed: int, rows: int = 40, columns: int = 53, spacing_m: float = 2.0) -> Grid:
    draws = np.random.default_rng(seed)
    heights = draws.standard_normal((rows, columns)).cumsum(0).cumsum(1)
    heights[draws.random(heights.shape) < 0.1] = np.nan
    return grid_of(from_array(heights, spacing_m))


@pytest.mark.parametrize(("seed", "lag"), [(1, 1), (2, 3), (3, 10), (4, 38), (5, 45)])
def test_blocks_add_up_to_all_pairs(seed: int, lag: int) -> None:
    grid = gappy(seed)

    sums, counts = block_sums(grid, lag)

    # then they are those of the measured RMS deviation
    whole = rms_deviation(grid, (lag * grid.spacing_m,))
    assert counts.sum() == whole.pairs[0]
    assert np.sqrt(sums.sum() / counts.sum()) == pytest.approx(whole.rms_m[0], rel=1e-12)


@pytest.mark.parametrize("spacing_m", [1.0, 1.5, 5.0, 220.0])
def test_a_profile_has_each_baseline_once(spacing_m: float) -> None:
    grid = gappy(7, 60, 60, spacing_m)

    found = profile(grid, BASELINES_M)

    own = found.baseline_m[found.pairs > 0]
    assert np.all(np.diff(own) > 0)
    assert own[0] == spacing_m
    assert own[-1] <= 0.25 * 59 * spacing_m
    # and no baseline is further from what was asked for than half a spacing
    asked = np.array(BASELINES_M)[found.pairs > 0]
    assert np.all(np.abs(own - asked) <= 0.5 * spacing_m + 1e-9)
    assert found.rms_m[found.pairs > 0] == pytest.approx(rms_deviation(grid, own.tolist()).rms_m, rel=1e-12)


@pytest.mark.parametrize(("slope_deg", "azimuth_deg"), [(5.0, 0.0), (20.0, 33.0)])
def test_a_plane_has_its_climb_and_an_exponent_of_one(slope_deg: float, azimuth_deg: float) -> None:
    flat = from_array(np.zeros((64, 64)), 1.5)
    found = profile(grid_of(tilted(flat, slope_deg, azimuth_deg)), BASELINES_M)

    have = found.pairs > 0
    # Half of the pairs lie along x, half along y.
    climb = np.tan(np.radians(slope_deg)) / np.sqrt(2)
    assert found.rms_m[have] == pytest.approx(climb * found.baseline_m[have], rel=1e-9)
    # Blocks hold unequal numbers of pairs along x and y, where whole posts do not part evenly.
    assert np.all(found.u_m[have] < 0.03 * found.rms_m[have])
    assert found.hurst == pytest.approx([1.0, 0.0], abs=5e-3)


@pytest.mark.parametrize("hurst", [0.3, 0.65, 0.8])
def test_the_uncertainty_is_what_pieces_of_ground_differ_by(hurst: float) -> None:
    # given pieces of grounds with one law, of another size and seeds than those of the table
    made = [fractional_brownian(81, hurst, np.random.default_rng(5000 + n)) for n in range(60)]
    found = [profile(Grid(one, 1.0, 0.0, 0.0), (1.0, 3.0, 9.0, 20.0)) for one in made]

    # when their scatter is compared with what each tells of itself
    rms_m = np.array([[*one.rms_m, one.hurst[0]] for one in found])
    u_m = np.array([[*one.u_m, one.hurst[1]] for one in found])
    ratio = np.sqrt((u_m**2).mean(axis=0)) / rms_m.std(axis=0, ddof=1)

    # then both agree, to the 9 % that 60 pieces tell of a scatter, twice, and as much for what they tell
    assert ratio == pytest.approx(1.0, abs=0.36)
    assert rms_m[:, 4].mean() == pytest.approx(hurst, abs=0.03)


@pytest.mark.parametrize("level", [0, 5, 10])
def test_a_fractal_has_its_level_and_its_exponent(level: int) -> None:
    found = one_fractal(level, seed=3)

    have = found["pairs"][0] > 0
    near = np.interp(np.log(65.0), np.log(found["baseline_m"][0, have]), np.log(found["rms_m"][0, have]))
    assert np.exp(near) == pytest.approx(ROUGHNESS_M[level], rel=0.02)
    exponent, u = found["hurst"][0]
    assert abs(exponent - 0.8) < 3 * u
    assert 0 < u < 0.12


def test_areas_are_what_they_are_called() -> None:
    # given a slope in the west, a flat north-east, and craters in the south-east
    y, x = np.mgrid[0:200, 0:200] * 1.0
    heights = np.where(x < 100, 0.3 * (100 - x), 0.0)
    heights += np.where((x >= 100) & (y < 100), 3 * np.sin(x / 4) * np.sin(y / 4), 0.0)
    grid = grid_of(from_array(heights, 1.0))

    areas = {one.name: one for one in typical_areas(grid, 50.0)}

    assert areas["sloped"].x_m < 0
    assert areas["smooth"].x_m > 0
    assert areas["smooth"].y_m > 0
    assert areas["cratered"].x_m > 0
    assert areas["cratered"].y_m < 0


@pytest.mark.parametrize(
    ("side_m", "step", "count"), [(50.0, 1.0, 2 * 1), (25.0, 1.0, 4 * 3), (200.0, 1.0, 1)]
)
def test_tiles_cover_a_terrain(side_m: float, step: float, count: int) -> None:
    grid = grid_of(from_array(np.zeros((81, 101)), 1.0))

    tiles = tiles_of(grid, side_m, step)

    assert len(tiles) == count
    for one in tiles:
        piece = part_of(grid, one)
        assert min(piece.values.shape) >= one.side_m
        assert piece.bounds[0] >= grid.bounds[0]
        assert piece.bounds[3] <= grid.bounds[3]


@pytest.mark.parametrize("text", ["smooth", "smooth=1,2", "=1,2,3", "a=1,2,-3", "a=1,nan,3", "a=x,2,3"])
def test_an_area_that_cannot_be_read_is_refused(text: str) -> None:
    with pytest.raises(RefusedInput, match="NAME=X,Y,SIDE"):
        TerrainOptions(areas=(text,))


def test_an_area_off_the_terrain_is_refused_with_both_places() -> None:
    with pytest.raises(
        RefusedInput, match=r"area far of 30 m about \(900, 5\) m holds 15 x 0 posts; the terrain"
    ):
        part_of(gappy(3), Area("far", 900.0, 5.0, 30.0))


def test_an_area_too_small_for_a_baseline_is_told_in_words() -> None:
    row = {"baseline_m": 16.0, "rms": {"value": 1.0, "standard_uncertainty": 0.1, "unit": "m"}}
    whole = {"name": "whole", "deviations": [row], "hurst": None}
    tiny = {"name": "tiny", "deviations": [], "hurst": None}

    lines = _lines({"analog": whole | {"areas": [tiny]}, "models": None})

    assert lines[1] == "tiny: too few posts for any baseline"


def test_an_area_is_read() -> None:
    assert parsed_area("a b=-1,2.5,3e2") == Area("a b", -1.0, 2.5, 300.0)


@pytest.mark.parametrize("given", [{"tile_m": 0.0}, {"slope_baseline_m": float("inf")}, {"seed": -1}])
def test_an_option_outside_its_range_is_refused(given: dict[str, float]) -> None:
    with pytest.raises(RefusedInput):
        TerrainOptions(**given)  # type: ignore[arg-type]


def test_quantiles_are_those_of_the_pieces() -> None:
    # given 101 pieces whose deviation at every baseline is 1, 1.01 ... 2 m
    count, width = 101, len(BASELINES_M)
    rms_m = np.repeat(np.linspace(1.0, 2.0, count)[:, None], width, axis=1)
    pairs = np.ones((count, width), dtype=np.int64)
    pairs[:, 0] = 0
    every = np.tile(BASELINES_M, (count, 1))
    names = tuple(f"piece {n}" for n in range(count))
    found = Terrains(names, ("model",) * count, every, rms_m, rms_m, pairs, np.zeros((count, 2)), {})

    bands = bands_of(found, seed=1)

    assert bands is not None
    assert bands["pieces"][:2].tolist() == [0, count]
    assert bands["quantiles_m"][1:] == pytest.approx(np.tile([1.01, 1.25, 1.5, 1.75, 1.99], (width - 1, 1)))
    # and the median of uniform pieces is as uncertain as theory says, sqrt(1/4/n) over their density, to 20 %
    assert bands["u_m"][5, 2] == pytest.approx(np.sqrt(0.25 / count), rel=0.2)


def test_a_model_whose_content_changed_is_another_chunk(tmp_path: Path) -> None:
    scene = tmp_path / "ground.toml"
    scene.write_text('[surface]\nkind = "fractal"\nextent_m = 60.0\nbaseline_m = 24.0\n')
    before = plan(TerrainOptions(models=(str(scene),)))
    scene.write_text('[surface]\nkind = "fractal"\nextent_m = 90.0\nbaseline_m = 24.0\n')
    after = plan(TerrainOptions(models=(str(scene),)))

    assert [one.name for one in before.chunks] == [one.name for one in after.chunks]
    same = [a.key == b.key for a, b in zip(before.chunks, after.chunks, strict=True)]
    assert same == [True] * (1 + LEVELS) + [False]


def test_a_file_that_is_not_there_is_refused() -> None:
    with pytest.raises(RefusedInput, match="nowhere: cannot be read"):
        digest("nowhere")


def test_ground_without_posts_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [
        "campaign",
        "terrain",
        "--terrain",
        "plane",
        "--workers",
        "1",
        "--out",
        str(tmp_path / "run"),
    ]

    assert main([*arguments, "--quiet"]) == 2

    said = capsys.readouterr().err
    assert "its ground is a plane" in said
    assert not (tmp_path / "run").exists()


def test_the_command_keeps_what_it_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # given a rough ground as analog and as model, cut into tiles
    scene = tmp_path / "ground.toml"
    scene.write_text(
        '[surface]\nkind = "fractal"\nextent_m = 192.0\nrms_deviation_m = 3.0\nbaseline_m = 24.0\n'
    )
    words = ["campaign", "terrain", "--terrain", str(scene), "--model", str(scene), "--tile-m", "48"]
    words += [
        "--area",
        "middle=0,0,90",
        "--workers",
        "1",
        "--quiet",
        "--json",
        "--out",
        str(tmp_path / "run"),
    ]

    # when the campaign runs, then its summary holds what was asked for
    assert main(words) == 0
    results = json.loads(capsys.readouterr().out)["results"]
    assert [one["name"] for one in results["analog"]["areas"]] == ["middle"]
    assert len(results["fractals"]) == LEVELS
    assert results["models"]["pieces"] == 16
    assert 0 < results["models"]["below_analog"] < 1
    at_24 = min(results["analog"]["deviations"], key=lambda row: abs(row["baseline_m"] - 24.0))
    assert at_24["rms"]["value"] == pytest.approx(3.0 * (at_24["baseline_m"] / 24.0) ** 0.8, rel=0.03)
    assert 0 < at_24["rms"]["standard_uncertainty"] < 2.0
    # and the data file has every deviation
    xarray = pytest.importorskip("xarray")
    with xarray.open_dataset(tmp_path / "run" / "data.nc") as data:
        assert data["rms_deviation"].dims == ("terrain", "baseline")
        assert data["rms_deviation"].shape[0] == 1 + 1 + LEVELS + 16
        assert float(data["slope"].max()) > 0
    assert (tmp_path / "run" / "figure-terrain.png").stat().st_size > 10_000


def test_the_law_of_a_fractal() -> None:
    assert law_m(0, np.array([65.0, 130.0])) == pytest.approx(ROUGHNESS_M[0] * np.array([1.0, 2**0.8]))


def test_a_plane_in_closed_form_has_no_profile() -> None:
    with pytest.raises(RefusedInput, match="grid"):
        rms_deviation(plane(3.0), (1.0,))


@settings(max_examples=100, deadline=None)
@given(text=st.text(max_size=30))
def test_any_text_is_an_area_or_refused(text: str) -> None:
    try:
        found = parsed_area(text)
    except RefusedInput:
        return
    assert found.name
    assert found.side_m > 0
    assert np.isfinite([found.x_m, found.y_m, found.side_m]).all()
