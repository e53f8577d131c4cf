"""Terrain models as the ground of campaigns: squares without gaps, wherever the gaps are."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from belahil.errors import RefusedInput
from procedures.campaign_range import RangeOptions
from procedures.range_chunks import echo_draws
from procedures.range_ground import MODEL, GroundKey, flat_terrains
from procedures.range_scenes import base_scene, conditions
from procedures.range_variants import column_points
from procedures.study_ground import LEVELS, gapless_squares
from sim.scene import as_toml
from sim.terrain_grid import Grid


def model(rows: int, columns: int) -> np.ndarray:
    return np.random.default_rng(1).normal(size=(rows, columns)) + 0.3 * np.arange(columns)


def as_grid(heights: np.ndarray, spacing_m: float = 6.0) -> Grid:
    return Grid(np.nan_to_num(heights), spacing_m, 0.0, 0.0, np.isfinite(heights))


def corners_of(squares: tuple[Grid, ...], heights: np.ndarray) -> list[tuple[int, int]]:
    """Where squares were cut, by the bends of the heights, which no plane changes."""
    bends, found = np.diff(heights, 2, axis=1), []
    for one in squares:
        own, side = np.diff(one.values, 2, axis=1), one.values.shape[0]
        row, column = np.unravel_index(np.nanargmin(np.abs(bends - own[0, 0])), bends.shape)
        assert bends[row : row + side, column : column + side - 2] == pytest.approx(own, abs=1e-9)
        found.append((int(row), int(column)))
    return found


def test_a_small_model_without_gaps_is_one_square_of_all_of_it() -> None:
    (one,) = gapless_squares(as_grid(model(150, 170)))

    assert one.values.shape == (150, 150)
    # level: no plane is left in it
    assert one.values.mean() == pytest.approx(0.0, abs=1e-9)
    assert abs((one.values @ (np.arange(150) - 74.5)).sum()) < 1e-6
    assert abs(((np.arange(150) - 74.5) @ one.values).sum()) < 1e-6


def test_a_large_model_is_cut_into_squares_that_do_not_overlap() -> None:
    heights = model(330, 220)

    squares = gapless_squares(as_grid(heights))

    # 600 m are 101 posts 6 m apart
    assert {one.values.shape for one in squares} == {(101, 101)}
    corners = corners_of(squares, heights)
    assert len(set(corners)) == len(squares) == 6
    for at, (row, column) in enumerate(corners):
        assert all(max(abs(row - r), abs(column - c)) >= 101 for r, c in corners[:at])


def test_no_square_has_a_gap_in_it_and_small_ones_serve_where_large_ones_do_not() -> None:
    # given: a strip, and a hole in the middle that leaves no 600 m anywhere
    heights = model(150, 150)
    heights[70:80, 70:80] = np.nan
    heights[:5] = np.nan

    squares = gapless_squares(as_grid(heights))

    assert squares[0].values.shape == (51, 51)
    assert all(one.known is None for one in squares)
    assert len(corners_of(squares, heights)) == len(squares)


def test_a_model_that_is_mostly_gaps_is_refused_with_its_size() -> None:
    heights = model(150, 150)
    heights[::10] = np.nan

    with pytest.raises(RefusedInput, match=r"150 x 150 posts 6 m apart has no square of 300 m without gaps"):
        gapless_squares(as_grid(heights))


def test_ranges_are_predicted_on_a_high_terrain_model_with_gaps(tmp_path: Path) -> None:
    # given: 3 km of a flank that is higher than a thousandth of the altitude, with a gap at its beginning
    x_m = 4.0 * np.arange(800)
    heights = np.random.default_rng(3).normal(0.0, 0.2, (160, 800)) + math.tan(math.radians(18.0)) * x_m
    heights[:, :30] = np.nan
    file = tmp_path / "flank.npy"
    np.save(file, heights)
    scene = tmp_path / "flank.toml"
    table = f'kind = "dtm"\nfile = "{file.as_posix()}"\nspacing_m = 4.0\nextent_m = 3300.0\n'
    scene.write_text(f"[surface]\n{table}")
    flat_terrains.cache_clear()

    options = RangeOptions(("columns",), terrain=str(scene), study_echoes=2)
    model_point = next(one for one in column_points(options, 1) if one.ground.kind == MODEL + str(scene))
    cell = asdict(conditions(base_scene())[0])
    told = echo_draws(
        as_toml(base_scene()), asdict(GroundKey(MODEL + str(scene))), (9.0, 11.0), [cell], 2, 1, 1, 0, 0.0
    )

    # then: as many echoes as on the fractals, spread over its squares, and they are seen
    terrains = len(flat_terrains(str(scene), 100, 1.0))
    assert terrains == 4
    assert model_point.echoes == math.ceil(2 * LEVELS / terrains)
    assert np.all(told["hit"][:, :, 0])
    assert np.all((told["slope_deg"] > 9.0) & (told["slope_deg"] < 11.0))


def test_a_terrain_model_for_a_part_that_is_left_out_is_refused() -> None:
    with pytest.raises(RefusedInput, match=r"--terrain moon\.tif: is for the part columns"):
        RangeOptions(("table",), terrain="moon.tif")
