"""What a user may choose of the campaigns of energy and of reflectance alike, and their plan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from belahil.campaign_run import CampaignPlan
from procedures.campaign_options import refuse_few
from procedures.energy_parts import calibration_chunks
from procedures.range_ground import GroundKey
from procedures.range_parts import levels_chunks, shared_chunks
from procedures.range_scenes import base_scene
from sim.scene import as_toml

if TYPE_CHECKING:
    from collections.abc import Sequence

    from procedures.range_points import Point

_NOISE_SEED = 0x6E6F0000
"""Added to the seed of draws, so that noise windows have draws of their own."""
_LEAST = {
    "echoes": 1,
    "repeats": 1,
    "sets": 1,
    "noise_windows": 20,
    "calibration_echoes": 1,
    "seed": 0,
    "ground_seed": 0,
}


@dataclass(frozen=True, slots=True)
class EchoOptions:
    """How many echoes are drawn, and from which seeds.

    Parameters
    ----------
    echoes, sets : int
        On each of the eleven terrains, in each of `sets` sets at each altitude.
    repeats : int
        Shots drawn about each echo, with noise of their own.
    noise_windows : int
        Windows of noise for the law of its peaks.
    calibration_echoes : int
        Without noise, on each terrain at each altitude and slope.
    seed, ground_seed : int
        Of all draws; of the fractals.

    Raises
    ------
    RefusedInput
        A number below what statistics need.
    """

    echoes: int = 40
    repeats: int = 6
    sets: int = 2
    noise_windows: int = 1000
    calibration_echoes: int = 20
    seed: int = 1
    ground_seed: int = 100

    def __post_init__(self) -> None:
        refuse_few(self, _LEAST)

    @property
    def ground(self) -> GroundKey:
        """The eleven fractals."""
        return GroundKey(seed=self.ground_seed)


def echo_plan(options: EchoOptions, points: Sequence[Point]) -> CampaignPlan:
    """Plan the chunks: noise, calibration, and draws about the echoes of points."""
    chunks = shared_chunks(points) + levels_chunks(points, options.noise_windows, options.seed + _NOISE_SEED)
    chunks += calibration_chunks(options.calibration_echoes, options.seed, options.ground)
    for point in points:
        chunks += point.chunks()
    return CampaignPlan(
        tuple(chunks),
        as_toml(base_scene()),
        options.seed,
        {"laser": "bela", "detector": "bela", "receiver": "bela-grm"},
    )
