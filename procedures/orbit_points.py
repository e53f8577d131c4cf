"""What the orbit campaign computes: echoes from altitudes and over slopes, under the Sun at several heights.

Day and night are the ends of one scale: the noise of sunlight has a variance in proportion to the cosine of
the Sun's angle of incidence on level ground, and whatever is between is interpolated.
"""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.chunks import Chunk
from procedures.energy_parts import Sampling, calibration_chunks, slope_point
from procedures.range_points import noise_chunks
from procedures.range_scenes import Condition, base_scene, conditions

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from procedures.campaign_orbit import OrbitOptions
    from procedures.range_points import Point

SLOPES_DEG = (0.0, 10.0, 20.0, 30.0)
SUN_PARTS = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Cosine of the Sun's angle of incidence, that is of the variance of its noise at noon: from night to day."""
TIMES = 361
"""Of an orbit that are told."""
_NOISE_SEED = 0x6E6F0000
_LEVELS = 8


def orbit_chunks(options: OrbitOptions) -> Iterator[Chunk]:
    """Return the chunks of a campaign, the orbits first, then what calibrates the energy."""
    yield Chunk("orbits", "procedures.orbit_points:orbit_times", asdict(options))
    yield from calibration_chunks(options.calibration_echoes, options.seed, options.ground)
    every = tuple(orbit_points(options))
    levels_v = [one.noise_rms_v for one in every[0].conditions]
    between = np.geomspace(min(levels_v), max(levels_v), _LEVELS).tolist()
    yield from noise_chunks(base_scene(), between, options.noise_windows, options.seed + _NOISE_SEED)
    for point in every:
        yield from point.chunks()


def orbit_points(options: OrbitOptions) -> Iterator[Point]:
    """Return the points by altitude and slope; one altitude's share what lies under its beam."""
    lit = sun_conditions(options.reflectances, options.sun)
    how = Sampling(options.echoes, options.repeats, 1, options.seed, options.ground)
    for altitude_m in options.altitudes_m:
        for slope_deg in options.slopes_deg:
            yield slope_point("orbit", altitude_m, slope_deg, lit, how)


def sun_conditions(reflectances: tuple[float, ...], distance: str) -> tuple[Condition, ...]:
    """Return conditions by reflectance and by `SUN_PARTS`, from night to noon.

    Parameters
    ----------
    reflectances : tuple of float
        Of the ground.
    distance : str
        Key of `procedures.range_scenes.DISTANCES_AU`.
    """
    ends = {
        (one.light, one.reflectance): one.noise_rms_v
        for one in conditions(base_scene(), reflectances, (distance,))
    }
    found = []
    for reflectance in reflectances:
        night_v, day_v = ends["night", reflectance], ends["day", reflectance]
        for part in SUN_PARTS:
            light = {0.0: "night", 1.0: "day"}.get(part, f"sun {part:g}")
            found.append(Condition(distance, light, reflectance, sun_level_v(night_v, day_v, part)))
    return tuple(found)


def sun_level_v(night_v: float, day_v: float, part: float) -> float:
    """Return the noise where the Sun gives a part of its variance at noon, V rms."""
    return math.sqrt(night_v**2 + part * (day_v**2 - night_v**2))


def orbit_times(**given: Any) -> dict[str, NDArray[Any]]:
    """Follow the orbits over one turn, in equal steps of time from one periapsis to the next.

    Parameters
    ----------
    **given
        Fields of `procedures.campaign_orbit.OrbitOptions`.

    Returns
    -------
    dict
        ``part`` of the turn, shape (361,); ``altitude_m, true_anomaly_rad`` of shape (orbits, 361).
    """
    from msgspec import convert

    from procedures.campaign_orbit import OrbitOptions

    part = np.linspace(0.0, 1.0, TIMES)
    orbits = convert(given, OrbitOptions).orbits().values()
    return {
        "part": part,
        "altitude_m": np.stack([one.altitude_m(2 * np.pi * part) for one in orbits]),
        "true_anomaly_rad": np.stack([one.true_anomaly_rad(2 * np.pi * part) for one in orbits]),
    }
