"""Campaign: what a return pulse tells of the roughness of its footprint, by its width and by its shape.

Footprints over eleven fractals, level on the average and tilted, seen from one altitude: roughness from the
width beside that of the ground; skewness of heights beside white noise; the best pulse of a library of flat
slopes, and what it leaves. From more altitudes: how far up the shape tells rough from smooth ground.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec import structs

from belahil.campaign_run import CampaignPlan
from belahil.chunks import Chunk
from belahil.errors import RefusedInput
from procedures.campaign_options import refuse_few, refuse_outside
from procedures.footprint_moments import even_places
from procedures.range_scenes import MEAN_REFLECTANCE, REFLECTANCES, base_scene
from procedures.roughness_chunks import CASES, MARGIN
from procedures.roughness_statistics import SLOPE_DEG
from procedures.study_ground import LEVELS, digest, terrain_file
from sim.laser import beam_sigma_m
from sim.scene import as_toml
from sim.terrain_grid import Grid

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.outcome import Outcome
    from sim.scene import Scene

FACTORS = (1.5, 2.0, 3.0)
"""Times the heights of the roughest fractal: without them footprints of 1 m and more are too few. Assumed."""
ALTITUDES_M = (400e3, 600e3, 700e3, 800e3, 900e3, 1000e3, 1100e3)
"""For how far up the shape tells; the campaign's own altitude comes with them."""
_SPARSE = ((0, 1.0, 0), (3, 1.0, 0), (5, 1.0, 0), (8, 1.0, 0), (10, 1.0, 0), (10, 1.0, 1))
_ROUGH = tuple((LEVELS - 1, factor, number) for factor in FACTORS[:2] for number in range(3))
"""Levels there, times what, and number of the set: the rough ones, of which few footprints serve, again."""
_FOOTPRINTS_A_SIDE = 20
"""Of a block of a terrain model that is one chunk's work: so small that the heights in it are small against
the altitude, for the slant path is a series."""

_LEAST = {"sets": 2, "per_side": 2, "seed": 0, "ground_seed": 0}


@dataclass(frozen=True, slots=True)
class RoughnessOptions:
    """What a user may choose.

    Parameters
    ----------
    altitude_m : float
        From which ground is seen, 100 to 1500 km.
    sets : int
        Sets of eleven fractals, at least 2: regions of one are judged by the others.
    per_side : int
        Footprints along each side of each terrain, at least 2.
    terrain : str or None
        A terrain model whose footprints are shown beside: a GeoTIFF, or a scene over posts.
    altitudes : bool
        Whether other altitudes are studied.
    slope_deg : float
        By which the fractals are tilted beside level ones, so that it occurs at every roughness, and of the
        best pulse of footprints whose residuals are compared, 1 to 30. Default 10, the mean slope of Mercury
        at this scale (paper).
    ellipticity : float
        Of the beam, 1 - minor / major axis, 0 to 0.9; 0: the round beam of the preset. The major axis is
        along x, the geometric mean of both axes that of the preset.
    by_beam : bool
        Plane, roughness and skewness weighted by the beam in place of the 1/e^2 disc.
    seed, ground_seed : int
        Of all draws; of the fractals.

    Raises
    ------
    RefusedInput
        A number outside its range.
    """

    altitude_m: float = 500e3
    sets: int = 3
    per_side: int = 22
    terrain: str | None = None
    altitudes: bool = True
    slope_deg: float = SLOPE_DEG
    ellipticity: float = 0.0
    by_beam: bool = False
    seed: int = 1
    ground_seed: int = 100

    def __post_init__(self) -> None:
        refuse_few(self, _LEAST)
        refuse_outside("altitude-km", (self.altitude_m / 1e3,), 100.0, 1500.0)
        refuse_outside("slope-deg", (self.slope_deg,), 1.0, 30.0)
        refuse_outside("ellipticity", (self.ellipticity,), 0.0, 0.9)


def plan(options: RoughnessOptions) -> CampaignPlan:
    """Plan a campaign: a chunk for each fractal, tilt and altitude, and for blocks of a terrain model.

    Raises
    ------
    RefusedInput
        A file that cannot be read, or a terrain that is too small.
    """
    scene = _scene(options, options.altitude_m)
    fractals = [(level, 1.0) for level in range(LEVELS)]
    more = [(LEVELS - 1, factor) for factor in FACTORS]
    jobs: list[tuple[str, str, dict[str, Any]]] = []
    here = {"cases": list(CASES), "reflectances": [MEAN_REFLECTANCE]}
    for number in range(options.sets):
        for tilt_deg in (0.0, options.slope_deg):
            for level, factor in fractals + more:
                given = _fractal(scene, options, (level, factor), number, tilt_deg) | here
                kind = "extra" if factor != 1.0 else "fractal"
                jobs.append((kind, f"{kind} {level} x {factor:g}, set {number}, {tilt_deg:g} deg", given))
    if options.altitudes:
        # Every altitude with the same few terrains, this one among them.
        for altitude_m in sorted({*ALTITUDES_M, options.altitude_m}):
            for level, factor, number in (*_SPARSE, *_ROUGH):
                ground, tilt_deg = (level, factor), options.slope_deg
                given = _fractal(
                    _scene(options, altitude_m), options, ground, options.sets + number, tilt_deg
                )
                given |= {"cases": ["night"], "reflectances": list(REFLECTANCES)}
                name = f"altitude {altitude_m:g} m, {level} x {factor:g}, ground {number}"
                jobs.append(("altitude", name, given))
    chunks = [
        Chunk(name, "procedures.roughness_chunks:over_fractal", given | {"seed": options.seed, "number": at})
        for at, (_, name, given) in enumerate(jobs)
    ]
    chunks += _terrain(scene, options, here, len(chunks))
    instruments = {"ground": "eleven fractals", "terrain": options.terrain or ""}
    return CampaignPlan(tuple(chunks), as_toml(scene), options.seed, instruments)


def _scene(options: RoughnessOptions, altitude_m: float) -> Scene:
    scene = base_scene(altitude_m)
    if options.ellipticity == 0:
        return scene
    oval = structs.replace(scene.laser, beam="elliptical", ellipticity=options.ellipticity)
    return structs.replace(scene, laser=oval)


def _fractal(
    scene: Scene, options: RoughnessOptions, ground: tuple[int, float], number: int, tilt_deg: float
) -> dict[str, Any]:
    return {
        "scene": as_toml(scene),
        "level": ground[0],
        "height_factor": ground[1],
        # Each terrain of each set has a seed of its own.
        "ground_seed": options.ground_seed
        + number * (LEVELS + len(FACTORS))
        + (1.0, *FACTORS).index(ground[1]),
        "tilt_deg": tilt_deg,
        "per_side": options.per_side,
        "by_beam": options.by_beam,
    }


def _terrain(scene: Scene, options: RoughnessOptions, here: dict[str, Any], first: int) -> list[Chunk]:
    """Blocks of a terrain model, each with some footprints side by side; those without data are left out."""
    if options.terrain is None:
        return []
    relief = terrain_file(options.terrain).relief
    assert isinstance(relief, Grid)
    sigma_m = beam_sigma_m(scene.laser, scene.altitude_m)[0]
    try:
        even_places(relief, MARGIN * sigma_m, None, 4 * sigma_m)
    except RefusedInput as error:
        raise RefusedInput(f"--terrain {options.terrain}: {error}") from error
    margin, apart = (math.ceil(wide * sigma_m / relief.spacing_m) for wide in (MARGIN, 4.0))
    wide = 2 * margin + 1 + (_FOOTPRINTS_A_SIDE - 1) * apart
    path = Path(options.terrain)
    where, content = str(path.absolute()) if path.exists() else options.terrain, digest(options.terrain)
    chunks: list[Chunk] = []
    begins = (range(0, max(size - 2 * margin, 1), _FOOTPRINTS_A_SIDE * apart) for size in relief.values.shape)
    for row, column in itertools.product(*begins):
        rows, columns = (
            [begin, min(begin + wide, size)]
            for begin, size in zip((row, column), relief.values.shape, strict=True)
        )
        if relief.known is not None and not relief.known[slice(*rows), slice(*columns)].any():
            continue
        given = {
            "scene": as_toml(scene),
            "path": where,
            "content": content,
            "rows": rows,
            "columns": columns,
            "by_beam": options.by_beam,
            "seed": options.seed,
            "number": first + len(chunks),
        }
        name = f"terrain, rows from {row}, columns from {column}"
        chunks.append(Chunk(name, "procedures.roughness_chunks:over_terrain", given | here))
    return chunks


def analyse(plan: CampaignPlan, results: list[dict[str, NDArray[Any]]]) -> Outcome:
    """Bring footprints together."""
    from procedures.roughness_outcome import outcome

    return outcome(plan, results)
