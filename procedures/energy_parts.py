"""The work of the campaigns of energy and of reflectance, and what its chunks gave.

Draws about echoes and the law of noise peaks are those of the range campaign; echoes without noise, of other
places, calibrate the energy.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

from belahil.campaign_run import CampaignPlan
from belahil.chunks import Chunk
from procedures.echo_energy import Conversion, PlainPulses, conversion
from procedures.range_points import Collected, Point, collected
from procedures.range_scenes import base_scene
from sim.scene import as_toml

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from procedures.range_ground import GroundKey
    from procedures.range_scenes import Condition

CALIBRATION_ALTITUDES_M = (400e3, 600e3, 800e3, 1000e3, 1200e3, 1400e3)
SLOPES_DEG = (0.0, 10.0, 20.0, 30.0, 40.0)
MAIN_DEG = 10.0

_CALIBRATION_WORK = "procedures.range_chunks:plain_echoes"
_CALIBRATION_SEED = 0x63610000
"""Added to the seed of draws: the places of the calibration are none of those that it serves."""
_HALF_DEG = 1.0
"""Footprints have their slope within so much."""


@dataclass(frozen=True, slots=True)
class Sampling:
    """How many draws.

    Parameters
    ----------
    echoes, repeats, sets : int
        On each terrain; shots about each; chunks.
    seed : int
        Of the draws.
    ground : GroundKey
        The fractals; their tilt is that of the slope.
    """

    echoes: int
    repeats: int
    sets: int
    seed: int
    ground: GroundKey


def slope_point(
    part: str, altitude_m: float, slope_deg: float, conditions: tuple[Condition, ...], how: Sampling
) -> Point:
    """Return draws about echoes of footprints of one slope from one altitude."""
    return Point(
        part=part,
        label=f"{slope_deg:g} deg, {altitude_m / 1e3:g} km",
        scene=base_scene(altitude_m),
        conditions=conditions,
        echoes=how.echoes,
        repeats=how.repeats,
        sets=how.sets,
        seed=how.seed,
        ground=replace(how.ground, tilt_deg=slope_deg),
        slopes_deg=_about(slope_deg),
    )


def calibration_chunks(count: int, seed: int, ground: GroundKey) -> list[Chunk]:
    """Return the work of the calibration: `count` echoes on each terrain at each altitude and slope.

    Altitude by altitude, since slopes share what lies under a beam.
    """
    chunks = []
    for altitude_m in CALIBRATION_ALTITUDES_M:
        for slope_deg in SLOPES_DEG:
            given = {
                "scene": as_toml(base_scene(altitude_m)),
                "ground": asdict(replace(ground, tilt_deg=slope_deg)),
                "slopes_deg": list(_about(slope_deg)),
                "count": count,
                "seed": seed + _CALIBRATION_SEED,
                "number": 0,
            }
            name = f"calibration, {slope_deg:g} deg, {altitude_m / 1e3:g} km"
            chunks.append(Chunk(name, _CALIBRATION_WORK, given))
    return chunks


def _about(slope_deg: float) -> tuple[float, float]:
    return max(0.0, slope_deg - _HALF_DEG), slope_deg + _HALF_DEG


def slope_of(label: str) -> float:
    """Return the slope in the label of a point of `slope_point`, degrees."""
    return float(label.partition(" ")[0])


def read_results(
    plan: CampaignPlan, results: Iterable[dict[str, NDArray[Any]]]
) -> tuple[Collected, Conversion]:
    """Put the results of chunks together, and calibrate."""
    plain: list[tuple[float, PlainPulses]] = []
    chunks: list[Chunk] = []
    others: list[dict[str, NDArray[Any]]] = []
    for chunk, result in zip(plan.chunks, results, strict=True):
        if chunk.work == _CALIBRATION_WORK:
            plain.append((chunk.given["ground"]["tilt_deg"], PlainPulses(**result)))
        else:
            chunks.append(chunk)
            others.append(result)
    # Slope by slope, whatever the order of the work: sums are rounded in their order.
    pulses = [one for _, one in sorted(plain, key=lambda pair: pair[0])]
    return collected(replace(plan, chunks=tuple(chunks)), others), conversion(pulses, base_scene())
