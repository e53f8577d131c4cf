"""Points of the range campaign: a scene over some ground, its chunks, and what they gave, put together."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.chunks import Chunk
from procedures.arrival_gradient import LinearErrors
from procedures.echo_hits import EchoHits
from procedures.noise_clusters import LevelLaws, fit_clusters
from procedures.range_ground import GroundKey
from procedures.range_scenes import SLOPES_DEG, Condition, noise_scene
from procedures.range_truth import USUAL, Definitions
from sim.scene import Scene, as_toml, parse_scene

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from belahil.campaign_run import CampaignPlan

    Results = Mapping[str, NDArray[Any]]

WINDOWS_IN_CHUNK = 250
_SET, _PART = ", set ", ": "


@dataclass(frozen=True, slots=True)
class Point:
    """A scene over some ground.

    Parameters
    ----------
    part : str
        Of the campaign.
    label : str
        What it is in that part.
    scene : Scene
        Altitude, laser, detector, receiver.
    conditions : tuple of Condition
        Reflectance and noise.
    echoes, repeats, sets : int
        On each terrain; shots for each; chunks.
    seed : int
        Of the draws: the same for points that are to be compared.
    ground : GroundKey
        Terrains and their tilt.
    slopes_deg : tuple of float
        Of the footprints.
    tilt : float or None
        Of the noise, see `procedures.noise_tilt`; None: what fits the faintest condition.
    shares : tuple of float
        Part of the sets in which each condition is looked at, the first ones; empty: all of all.
    definitions : Definitions
        Of true range and planes.
    """

    part: str
    label: str
    scene: Scene
    conditions: tuple[Condition, ...]
    echoes: int
    repeats: int
    sets: int
    seed: int
    ground: GroundKey = field(default_factory=GroundKey)
    slopes_deg: tuple[float, float] = SLOPES_DEG
    tilt: float | None = None
    shares: tuple[float, ...] = ()
    definitions: Definitions = USUAL

    def chunks(self) -> list[Chunk]:
        """Return the work of this point."""
        given = {
            "scene": as_toml(self.scene),
            "ground": asdict(self.ground),
            "slopes_deg": list(self.slopes_deg),
            "count": self.echoes,
            "repeats": self.repeats,
            "seed": self.seed,
            "tilt": self.tilt,
            "definitions": asdict(self.definitions),
        }
        work, name = "procedures.range_chunks:echo_draws", f"{self.part}{_PART}{self.label}"
        return [
            Chunk(f"{name}{_SET}{n}", work, given | {"number": n, "conditions": self._in_set(n)})
            for n in range(self.sets)
        ]

    def _in_set(self, number: int) -> list[dict[str, Any]]:
        shares = self.shares or (1.0,) * len(self.conditions)
        both = zip(self.conditions, shares, strict=True)
        return [asdict(one) for one, share in both if number < share * self.sets]


def noise_chunks(
    scene: Scene, levels_v: Sequence[float], windows: int, seed: int, number: int = 0
) -> list[Chunk]:
    """Return the work of the law of noise peaks of a scene's receiver, by its number, at some levels, V."""
    chunks, text, levels = [], as_toml(noise_scene(scene)), sorted(set(levels_v))
    for first in range(0, windows, WINDOWS_IN_CHUNK):
        given = {
            "scene": text,
            "noise_rms_v": levels,
            "windows": min(WINDOWS_IN_CHUNK, windows - first),
            "seed": seed,
            "first": first,
        }
        name = f"noise, receiver {number}, {scene.filter} filter, from window {first}"
        chunks.append(Chunk(name, "procedures.range_chunks:noise_peaks", given))
    return chunks


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """What the chunks of a point gave.

    Parameters
    ----------
    part, label : str
        As of `Point`.
    scene : Scene
        As there.
    slopes_deg : tuple of float
        As there.
    conditions : tuple of Condition
        As there.
    arrays : mapping of str to ndarray
        Of `procedures.range_chunks.echo_draws`, all sets.
    """

    part: str
    label: str
    scene: Scene
    slopes_deg: tuple[float, float]
    conditions: tuple[Condition, ...]
    arrays: Results

    @property
    def linear(self) -> LinearErrors:
        """Its linear errors."""
        return LinearErrors(**{name: self.arrays[fit_name(name)] for name in LinearErrors.__slots__})


def fit_name(field_name: str) -> str:
    """Return the name by which a field of `LinearErrors` leaves its chunk: hits have a width as well."""
    return "fit_s" if field_name == "width_s" else field_name


@dataclass(frozen=True, slots=True, eq=False)
class Collected:
    """All that the chunks of a plan gave.

    Parameters
    ----------
    points : tuple of Drawn
        In the order of the plan.
    noise : mapping of (str, float) to ndarray
        Largest peaks by the TOML of `noise_scene` and level, V, shape (windows, k).
    shots : mapping of (str, Condition) to ndarray
        Errors of whole shots by the TOML of the scene and condition, m.
    definitions : Definitions
        Of true range and planes.
    """

    points: tuple[Drawn, ...]
    noise: Mapping[tuple[str, float], NDArray[np.float64]]
    shots: Mapping[tuple[str, Condition], NDArray[np.float64]]
    definitions: Definitions = USUAL

    def laws(self) -> dict[str, LevelLaws]:
        """Fit the law of noise peaks of each receiver at its levels."""
        found: dict[str, list[Any]] = {}
        for (text, level_v), rows in self.noise.items():
            found.setdefault(text, []).append(fit_clusters(rows, level_v))
        return {text: LevelLaws(tuple(laws)) for text, laws in found.items()}

    def of(self, part: str) -> tuple[Drawn, ...]:
        """Return the points of a part."""
        return tuple(one for one in self.points if one.part == part)


def collected(plan: CampaignPlan, results: Sequence[Results]) -> Collected:
    """Put the results of chunks together."""
    noise: dict[tuple[str, float], list[NDArray[np.float64]]] = {}
    echoes: dict[str, list[tuple[Mapping[str, Any], Results]]] = {}
    shots: dict[tuple[str, Condition], list[NDArray[np.float64]]] = {}
    definitions = USUAL
    for chunk, result in zip(plan.chunks, results, strict=True):
        work, given = chunk.work.partition(":")[2], chunk.given
        if "definitions" in given:
            definitions = Definitions(**given["definitions"])
        if work == "noise_peaks":
            for level_v, rows in zip(given["noise_rms_v"], result["score_v"], strict=True):
                noise.setdefault((given["scene"], level_v), []).append(rows)
        elif work == "echo_draws":
            echoes.setdefault(chunk.name.rpartition(_SET)[0], []).append((given, result))
        elif work == "whole_shots":
            shots.setdefault((given["scene"], Condition(**given["condition"])), []).append(result["error_m"])
    return Collected(
        tuple(drawn for name, parts in echoes.items() for drawn in _drawn(name, parts)),
        {key: np.concatenate(rows) for key, rows in noise.items()},
        {key: np.concatenate(rows) for key, rows in shots.items()},
        definitions,
    )


def _drawn(name: str, parts: list[tuple[Mapping[str, Any], Results]]) -> list[Drawn]:
    """Put sets together, apart for conditions that are in different ones; those in most sets first."""
    part, _, label = name.partition(_PART)
    sets: dict[Condition, list[tuple[int, int]]] = {}
    for number, (given, _) in enumerate(parts):
        for row, one in enumerate(given["conditions"]):
            sets.setdefault(Condition(**one), []).append((number, row))
    alike: dict[tuple[int, ...], list[Condition]] = {}
    for condition, places in sets.items():
        alike.setdefault(tuple(number for number, _ in places), []).append(condition)
    given = parts[0][0]
    slopes_deg = (given["slopes_deg"][0], given["slopes_deg"][1])
    found = []
    for numbers, conditions in sorted(alike.items(), key=lambda pair: -len(pair[0])):
        arrays: dict[str, NDArray[Any]] = {}
        for key in parts[0][1]:
            if key in EchoHits.__slots__:
                rows = [
                    np.concatenate([parts[number][1][key][row] for number, row in sets[one]])
                    for one in conditions
                ]
                arrays[key] = np.stack(rows)
            else:
                arrays[key] = np.concatenate([parts[number][1][key] for number in numbers])
        found.append(Drawn(part, label, parse_scene(given["scene"]), slopes_deg, tuple(conditions), arrays))
    return found
