"""The scenes of the range campaign: altitudes, reflectances, day and night, and a dark noise from the text.

The paper does not print the dark noise. It says that sunlight at noon raises the noise by some 80 % at the
mean reflectance. So the dark noise is the chain's own solar noise over sqrt(1.8^2 - 1), at Mercury's mean
distance from the Sun and a reflectance of 0.17. Which distance was meant is not said: a second column has
perihelion in its place, for the dark noise and for the days.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

from msgspec import structs

from procedures.noise_colour import light_filter
from sim.light_noise import background_density, noise_rms_v
from sim.presets import detector_preset, laser_preset
from sim.scene import Scene
from sim.scene_tables import Noise, Sun, SurfaceTable

RISE = 1.8
"""Noise at noon over that at night (paper, "Noise model"), at `MEAN_REFLECTANCE`."""
MEAN_REFLECTANCE = 0.17
REFLECTANCES = (0.08, 0.17, 0.30)
"""Dark deposits and mean regolith (paper); ice exposed in shadow: assumed, its value is not printed."""
ALTITUDES_M = (500e3, 800e3, 1100e3, 1400e3)
SLOPES_DEG = (9.0, 11.0)
DISTANCES_AU = {"mean": 0.3871, "perihelion": 0.3075}
LIGHTS = ("day", "night")


@dataclass(frozen=True, slots=True)
class Condition:
    """A cell of the table at any altitude.

    Parameters
    ----------
    distance : str
        Key of `DISTANCES_AU`.
    light : str
        "day" (noon) or "night".
    reflectance : float
        Of the ground.
    noise_rms_v : float
        Stationary noise at the converter before it rounds, V.
    """

    distance: str
    light: str
    reflectance: float
    noise_rms_v: float


def base_scene(altitude_m: float = ALTITUDES_M[0]) -> Scene:
    """Return the scene that the campaign varies: presets, shot noise, night."""
    return Scene(
        altitude_m=altitude_m,
        laser=laser_preset(),
        detector=detector_preset(),
        surface=SurfaceTable(kind="fractal", reflectance=MEAN_REFLECTANCE),
        noise=Noise(dark_rms_v=text_dark_rms_v(Scene()), shot=True),
    )


def solar_rms_v(scene: Scene, distance_au: float, reflectance: float) -> float:
    """Return the noise of sunlight at noon at the converter, V rms.

    Parameters
    ----------
    scene : Scene
        Telescope, detector and receiver.
    distance_au, reflectance : float
        Of the planet from the Sun; of the ground.
    """
    detector = structs.replace(scene.detector, surface_dark_a=0.0, bulk_dark_a=0.0)
    surface = structs.replace(scene.surface, reflectance=reflectance)
    sunny = structs.replace(scene, sun=Sun(distance_au=distance_au), surface=surface, detector=detector)
    return scene.gain * noise_rms_v(background_density(sunny), light_filter(scene).bandwidth_hz)


def text_dark_rms_v(scene: Scene, distance: str = "mean") -> float:
    """Return the dark noise that the paper's text implies, V rms at the converter."""
    return solar_rms_v(scene, DISTANCES_AU[distance], MEAN_REFLECTANCE) / math.sqrt(RISE**2 - 1)


def conditions(
    scene: Scene, reflectances: tuple[float, ...] = REFLECTANCES, distances: tuple[str, ...] = ("mean",)
) -> tuple[Condition, ...]:
    """Return the cells by distance, light and reflectance.

    Parameters
    ----------
    scene : Scene
        Its dark noise stands for the mean distance; other distances have that which the text implies there,
        by the same factor.
    reflectances : tuple of float
        Of the ground.
    distances : tuple of str
        Keys of `DISTANCES_AU`.
    """
    text_v = text_dark_rms_v(scene)
    found = []
    for distance, light, reflectance in itertools.product(distances, LIGHTS, reflectances):
        dark_v = (scene.noise.dark_rms_v or 0.0) * text_dark_rms_v(scene, distance) / text_v
        sun_v = solar_rms_v(scene, DISTANCES_AU[distance], reflectance) if light == "day" else 0.0
        found.append(Condition(distance, light, reflectance, math.hypot(dark_v, sun_v)))
    return tuple(found)


def noise_scene(scene: Scene) -> Scene:
    """Return a scene that has of another only what the law of its noise peaks depends on."""
    unlike, usual = structs.replace(scene.electronics.interleave, skew_s=0.0), Scene().range_finder
    finder = structs.replace(
        scene.range_finder,
        correlation_window_samples=usual.correlation_window_samples,
        refinement_steps=usual.refinement_steps,
    )
    plain = Scene(
        receiver=scene.receiver,
        gain_code=scene.gain_code,
        filter=scene.filter,
        electronics=structs.replace(scene.electronics, interleave=unlike),
        range_finder=finder,
        surface=SurfaceTable(kind="plane"),
        detector=structs.replace(Scene().detector, tia_bandwidth_hz=scene.detector.tia_bandwidth_hz),
    )
    return plain


def cell_scene(scene: Scene, condition: Condition) -> Scene:
    """Return the scene of a cell by itself, for a chain of its own."""
    surface = structs.replace(scene.surface, reflectance=condition.reflectance)
    dark_v = scene.noise.dark_rms_v or 0.0
    dark_v *= text_dark_rms_v(scene, condition.distance) / text_dark_rms_v(scene)
    sun = Sun(distance_au=DISTANCES_AU[condition.distance]) if condition.light == "day" else None
    noise = structs.replace(scene.noise, dark_rms_v=dark_v)
    return structs.replace(scene, surface=surface, sun=sun, noise=noise)
