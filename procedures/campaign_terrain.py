"""Campaign: how rough analog terrains and Mercury's own terrain models are, by baseline.

One analog terrain is shown whole and in three areas, with a map of its slopes. Beside it stand the eleven
fractals of the campaigns, and quantiles of any number of terrain models, as they are or in tiles.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.campaign_run import CampaignPlan
from belahil.chunks import Chunk
from belahil.errors import RefusedInput
from procedures.arrival_ground import EXTENT_M
from procedures.campaign_options import refuse_few
from procedures.range_ground import SPACING_M
from procedures.relief_profile import (
    BLOCKS,
    Area,
    part_of,
    profile,
    tile_counts,
    tiles_of,
    typical_areas,
)
from procedures.study_ground import LEVELS, digest, fractal, terrain_file
from sim.scene import Scene, as_toml
from sim.terrain_fractal import multifractal
from sim.terrain_grid import Grid
from sim.terrain_statistics import slope_map

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.outcome import Outcome
    from procedures.relief_profile import Profile
    from sim.terrain_statistics import SlopeMap

BASELINES_M = tuple(float(one) for one in np.geomspace(1.0, 16384.0, 29))
"""At which deviations are told, where a terrain has them."""
STAND_IN_M = 4.0
"""RMS deviation at 65 m of the made analog, that of a lunar terrain model at hand (3.9 m): assumed."""
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
"""Of slopes."""
_PROFILE = ("baseline_m", "rms_m", "u_m", "pairs", "hurst")
_MAP_POSTS = 400
_TILES = 400
"""So many tiles of one model at most are a chunk's work."""


@dataclass(frozen=True, slots=True)
class TerrainOptions:
    """What a user may choose.

    Parameters
    ----------
    terrain : str or None
        The analog: a GeoTIFF, or a scene over a grid of posts. None: a made multifractal stands in.
    areas : tuple of str
        ``NAME=X,Y,SIDE``, m from the middle of the analog; none: three are chosen.
    models : tuple of str
        Terrain models whose quantiles are shown, as `terrain`.
    tile_m : float or None
        Side of the tiles into which models are cut, m; None: each is one.
    slope_baseline_m : float or None
        Of the map of slopes, m; None: the analog's spacing.
    seed : int
        Of made terrain.

    Raises
    ------
    RefusedInput
        An area that cannot be read, or a length or seed outside its range.
    """

    terrain: str | None = None
    areas: tuple[str, ...] = ()
    models: tuple[str, ...] = ()
    tile_m: float | None = None
    slope_baseline_m: float | None = None
    seed: int = 1

    def __post_init__(self) -> None:
        for text in self.areas:
            parsed_area(text)
        for name, value in (("tile", self.tile_m), ("slope-baseline", self.slope_baseline_m)):
            if value is not None and not 0 < value < np.inf:
                raise RefusedInput(f"--{name}-m {value:g}: must be positive and finite")
        if self.tile_m is not None and not self.models:
            raise RefusedInput(f"--tile-m {self.tile_m:g}: cuts terrain models, and no --model is given")
        refuse_few(self, {"seed": 0})


def parsed_area(text: str) -> Area:
    """Read ``NAME=X,Y,SIDE``.

    Raises
    ------
    RefusedInput
        It is something else.
    """
    name, equals, numbers = text.partition("=")
    try:
        x_m, y_m, side_m = map(float, numbers.split(","))
    except ValueError:
        x_m = y_m = side_m = np.nan
    if not (name and equals and np.isfinite([x_m, y_m, side_m]).all() and side_m > 0):
        raise RefusedInput(f"--area {text}: allowed is NAME=X,Y,SIDE, m from the middle of the terrain")
    return Area(name, x_m, y_m, side_m)


def plan(options: TerrainOptions) -> CampaignPlan:
    """Plan a campaign: a chunk for the analog, for each fractal, and for each terrain model.

    Raises
    ------
    RefusedInput
        A file cannot be read, an area is not on the terrain, or tiles are too many.
    """
    _refuse_analog(options)
    for path in options.models:
        grid = _grid(path)
        if options.tile_m is not None:
            _refuse_tiles(path, grid, options.tile_m)
    given = {
        "path": _absolute(options.terrain),
        "content": None if options.terrain is None else digest(options.terrain),
        "areas": [asdict(parsed_area(text)) for text in options.areas],
        "slope_baseline_m": options.slope_baseline_m,
        "seed": options.seed,
    }
    chunks = [Chunk("analog", "procedures.campaign_terrain:analog", given)]
    for level in range(LEVELS):
        made = {"level": level, "seed": options.seed}
        chunks.append(Chunk(f"fractal {level}", "procedures.campaign_terrain:one_fractal", made))
    for number, path in enumerate(options.models):
        model = {"path": _absolute(path), "content": digest(path), "tile_m": options.tile_m}
        name = f"model {number}, {Path(path).name}"
        chunks.append(Chunk(name, "procedures.campaign_terrain:one_model", model))
    return CampaignPlan(
        tuple(chunks), as_toml(Scene()), options.seed, {"ground": options.terrain or "made terrain"}
    )


def _refuse_analog(options: TerrainOptions) -> None:
    """Refuse areas and baselines that the analog has not; a made one is not made for it."""
    if options.terrain is not None:
        grid = _grid(options.terrain)
    else:
        posts = round(EXTENT_M / SPACING_M) + 1
        grid = Grid(np.zeros((posts, posts)), SPACING_M, -EXTENT_M / 2, -EXTENT_M / 2)
    for area in _placed(grid, [asdict(parsed_area(text)) for text in options.areas]):
        part_of(grid, area)
    longest_m = (min(grid.values.shape) - 1) * grid.spacing_m
    if options.slope_baseline_m is not None and options.slope_baseline_m > longest_m:
        raise RefusedInput(
            f"--slope-baseline-m {options.slope_baseline_m:g}: the terrain is {longest_m:g} m wide"
        )


def _refuse_tiles(path: str, grid: Grid, tile_m: float) -> None:
    """Refuse more tiles than are a chunk's work, before any is cut, and tiles without posts."""
    x_min, x_max, y_min, y_max = grid.bounds
    count = math.prod(tile_counts(grid, tile_m))
    # Anywhere between the posts a tile must have two along each side.
    least_m = max(math.sqrt((x_max - x_min) * (y_max - y_min) / _TILES), 2 * grid.spacing_m)
    if count <= _TILES and tile_m >= 2 * grid.spacing_m:
        return
    if math.prod(tile_counts(grid, least_m)) > _TILES:
        raise RefusedInput(f"--tile-m {tile_m:g}: {path} is too narrow to be cut; leave the option out")
    raise RefusedInput(
        f"--tile-m {tile_m:g}: makes {count} tiles of {path}, with posts {grid.spacing_m:g} m apart; allowed "
        f"is {math.ceil(least_m)} and more, for up to {_TILES} tiles"
    )


def _absolute(path: str | None) -> str | None:
    """A path that a worker with another working directory finds; the name of a ready scene as it is."""
    return path if path is None or not Path(path).exists() else str(Path(path).absolute())


def analog(
    path: str | None,
    content: str | None,
    areas: list[dict[str, Any]],
    slope_baseline_m: float | None,
    seed: int,
) -> dict[str, NDArray[Any]]:
    """Measure the analog, whole and by areas, and map its slopes; `content` is in the chunk's key."""
    grid = _stand_in(seed) if path is None else _grid(path)
    x_min, x_max, y_min, y_max = grid.bounds
    middle = ((x_min + x_max) / 2, (y_min + y_max) / 2)
    side_m = min(x_max - x_min, y_max - y_min)
    chosen = _placed(grid, areas) or typical_areas(grid, side_m / 4)
    found = [profile(grid, BASELINES_M), *(profile(part_of(grid, one), BASELINES_M) for one in chosen)]
    slopes = slope_map(grid, slope_baseline_m or grid.spacing_m)
    known = slopes.slope_rad[slopes.known]
    every = max(1, -(-max(slopes.known.shape) // _MAP_POSTS))
    shown, have = _coarser(slopes.slope_rad, slopes.known, every)
    margin_m = slopes.baseline_m / 2
    return {
        "names": np.array(["whole", *(one.name for one in chosen)]),
        "boxes_m": np.array(
            [(*middle, side_m)] + [(one.x_m, one.y_m, one.side_m) for one in chosen], dtype=np.float64
        )
        - np.array([*middle, 0.0]),
        **_stacked(found),
        "slope_rad": shown,
        "slope_known": have,
        "slope_bounds_m": np.array(grid.bounds)
        + margin_m * np.array([1, -1, 1, -1])
        - np.repeat(np.array(middle), 2),
        "slope_baseline_m": np.array(slopes.baseline_m),
        "slope_quantiles_rad": np.quantile(known, QUANTILES),
        "slope_quantiles_u_rad": _scatter(slopes),
        "spacing_m": np.array(grid.spacing_m),
        "extent_m": np.array([x_max - x_min, y_max - y_min]),
        "known": np.array(1.0 if grid.known is None else grid.known.mean()),
    }


def _placed(grid: Grid, areas: list[dict[str, Any]]) -> tuple[Area, ...]:
    """Areas from the middle of a terrain, in its own coordinates."""
    x_min, x_max, y_min, y_max = grid.bounds
    x_m, y_m = (x_min + x_max) / 2, (y_min + y_max) / 2
    return tuple(Area(one["name"], x_m + one["x_m"], y_m + one["y_m"], one["side_m"]) for one in areas)


def one_fractal(level: int, seed: int) -> dict[str, NDArray[Any]]:
    """Measure one of the eleven fractals."""
    relief = fractal(level, seed).relief
    assert isinstance(relief, Grid)
    return _stacked([profile(relief, BASELINES_M)])


def one_model(path: str, content: str, tile_m: float | None) -> dict[str, NDArray[Any]]:
    """Measure a terrain model, whole or in tiles; tiles without any pair are left out."""
    grid = _grid(path)
    pieces = [grid]
    if tile_m is not None:
        pieces = [part_of(grid, one) for one in tiles_of(grid, tile_m) if _has_data(grid, one)]
    return _stacked([profile(one, BASELINES_M) for one in pieces])


def _has_data(grid: Grid, area: Area) -> bool:
    if grid.known is None:
        return True
    x_m, y_m = grid.posts()
    rows = np.abs(y_m - area.y_m) <= area.side_m / 2
    return bool(grid.known[np.ix_(rows, np.abs(x_m - area.x_m) <= area.side_m / 2)].any())


def _stacked(found: list[Profile]) -> dict[str, NDArray[Any]]:
    return {name: np.stack([getattr(one, name) for one in found]) for name in _PROFILE}


def _stand_in(seed: int) -> Grid:
    relief = multifractal(extent_m=EXTENT_M, rms_deviation_m=STAND_IN_M, seed=seed).relief
    assert isinstance(relief, Grid)
    return relief


def _grid(path: str) -> Grid:
    relief = terrain_file(path).relief
    assert isinstance(relief, Grid)
    return relief


def _scatter(slopes: SlopeMap) -> NDArray[np.float64]:
    """Standard uncertainty of the quantiles of slopes, from those of blocks; 0 with fewer than two."""
    edges = [np.linspace(0, size, BLOCKS + 1).astype(int) for size in slopes.known.shape]
    found = []
    for row, column in np.ndindex(BLOCKS, BLOCKS):
        part = np.s_[edges[0][row] : edges[0][row + 1], edges[1][column] : edges[1][column + 1]]
        inside = slopes.slope_rad[part][slopes.known[part]]
        if inside.size:
            found.append(np.quantile(inside, QUANTILES))
    if len(found) < 2:
        return np.zeros(len(QUANTILES))
    return np.asarray(np.std(found, axis=0, ddof=1) / np.sqrt(len(found)))


def _coarser(
    values: NDArray[np.float64], known: NDArray[np.bool_], every: int
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Means of blocks of `every` x `every`; what is left over at the ends is cut off."""
    rows, columns = (size // every for size in values.shape)
    blocks = (rows, every, columns, every)
    part = np.s_[: rows * every, : columns * every]
    count = known[part].reshape(blocks).sum(axis=(1, 3))
    total = np.where(known, values, 0.0)[part].reshape(blocks).sum(axis=(1, 3))
    return total / np.maximum(count, 1), count > 0


def analyse(plan: CampaignPlan, results: list[dict[str, NDArray[Any]]]) -> Outcome:
    """Bring the profiles together."""
    from procedures.campaign_terrain_outcome import outcome

    return outcome(plan, results)
