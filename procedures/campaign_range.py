"""Campaign: errors of ranges and probability of false detection, by altitude, reflectance, day and night."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from belahil.campaign_run import CampaignPlan
from belahil.errors import RefusedInput
from procedures.campaign_options import refuse_few
from procedures.range_ground import GroundKey
from procedures.range_parts import PARTS, brute_chunks, levels_chunks, points, shared_chunks
from procedures.range_points import collected
from procedures.range_scenes import base_scene
from procedures.range_truth import Definitions
from sim.scene import as_toml

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.outcome import Outcome

_NOISE_SEED, _SHOT_SEED = 0x6E6F0000, 0x73680000
"""Added to the seed of draws, so that noise windows and whole shots have numbers of their own."""
_LEAST = {
    "echoes": 1,
    "repeats": 1,
    "sets": 1,
    "study_echoes": 1,
    "noise_windows": 20,
    "shots": 0,
    "seed": 0,
    "ground_seed": 0,
}


@dataclass(frozen=True, slots=True)
class RangeOptions:
    """What a user may choose.

    Parameters
    ----------
    parts : tuple of str
        Of `procedures.range_parts.PARTS`.
    echoes : int
        Of the table: on each of the eleven terrains, in each of `sets` sets.
    repeats : int
        Shots drawn about each echo, with noise of their own.
    sets : int
        Chunks of echoes for each altitude of the table.
    study_echoes : int
        Of the other parts: on each terrain at each point.
    noise_windows : int
        Windows of noise for the law of its peaks.
    shots : int
        Whole shots on each terrain in each cell of the table, by brute force; 0: none.
    seed : int
        Of all draws; the ground has one of its own.
    ground_seed : int
        Of the fractals.
    terrain : str or None
        A GeoTIFF, or a scene over a grid of posts, for a column of its own; None: none.
    truth, by_beam
        As in `procedures.range_truth.Definitions`.

    Raises
    ------
    RefusedInput
        A number below what statistics need, or a part or a truth that is none.
    """

    parts: tuple[str, ...] = PARTS
    echoes: int = 60
    repeats: int = 6
    sets: int = 8
    study_echoes: int = 24
    noise_windows: int = 2000
    shots: int = 100
    seed: int = 1
    ground_seed: int = 100
    terrain: str | None = None
    truth: str = "light"
    by_beam: bool = False

    def __post_init__(self) -> None:
        refuse_few(self, _LEAST)
        unknown = [one for one in self.parts if one not in PARTS]
        if unknown or not self.parts:
            raise RefusedInput(f"--parts {','.join(self.parts)}: allowed are {', '.join(PARTS)}")
        if self.terrain is not None and "columns" not in self.parts:
            raise RefusedInput(f"--terrain {self.terrain}: is for the part columns, which --parts leaves out")
        Definitions(self.truth, self.by_beam)

    @property
    def definitions(self) -> Definitions:
        """Of true range, slope and roughness."""
        return Definitions(self.truth, self.by_beam)

    @property
    def ground(self) -> GroundKey:
        """The eleven fractals, tilted for the headline table."""
        return GroundKey(seed=self.ground_seed)


def plan(options: RangeOptions) -> CampaignPlan:
    """Plan the chunks of all parts."""
    every = tuple(points(options))
    # The noise lies between the ground and those that need it: by then the ground is there.
    chunks = shared_chunks(every) + levels_chunks(every, options.noise_windows, options.seed + _NOISE_SEED)
    for point in every:
        chunks += point.chunks()
    if options.shots and "table" in options.parts:
        chunks += brute_chunks(options, options.seed + _SHOT_SEED)
    return CampaignPlan(
        tuple(chunks),
        as_toml(base_scene()),
        options.seed,
        {"laser": "bela", "detector": "bela", "receiver": "bela-grm"},
    )


def analyse(plan: CampaignPlan, results: list[dict[str, NDArray[Any]]]) -> Outcome:
    """Make the outcome of the chunks' results."""
    from procedures.range_outcome import outcome

    return outcome(collected(plan, results))
