"""Scenes for tests of chains."""

from __future__ import annotations

from typing import Any

from msgspec import structs

from sim.presets import laser_preset
from sim.scene import Scene
from sim.scene_tables import Noise, Sun, SurfaceTable

STEADY = laser_preset("bela", jitter_rad=(0.0, 0.0), energy_jitter=0.0)
BARE = Scene(laser=STEADY, surface=SurfaceTable(slope_deg=10.0))
NIGHT = structs.replace(BARE, noise=Noise(dark_rms_v=0.83e-3, shot=True))
DAY = structs.replace(NIGHT, sun=Sun())


def with_(scene: Scene, **tables: dict[str, Any]) -> Scene:
    """Return a scene with some keys of some tables changed."""
    changed = {name: structs.replace(getattr(scene, name), **keys) for name, keys in tables.items()}
    return structs.replace(scene, **changed)
