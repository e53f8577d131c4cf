"""A scene as a file to read and to edit: every key that acts, with its unit and where its number is from."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import tomli_w

from belahil.config import EmulatedReceiver
from belahil.strict_toml import Strict
from sim.explain import PAPER, Explained, explained
from sim.presets import DETECTORS, laser_preset
from sim.scene import READY
from sim.scene_checks import is_idle
from sim.scene_tables import SurfaceTable

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from sim.scene import Scene

_HEADER = f"""\
# In SI units. What stands behind a comment sign has no value here, or the one of the receiver's preset.
# {PAPER}.
"""
_TOP = ("altitude_m", "receiver", "gain_code", "filter", "seed")
_TABLES = ("laser", "surface", "noise", "sun", "detector", "range_finder")
_WITHOUT = {
    "surface.reflectance_map": "a file on the grid of the heights, in place of `reflectance`",
    "surface.rim_height_m": "m above the plane; without it that of fresh craters",
    "surface.datum_m": "m, the height that is z = 0; without it the height at nadir",
    "noise.dark_rms_v": "V rms at the converter; without it there is no such noise",
    "noise.dark_windows": "a file of recorded dark noise, in place of `dark_rms_v`",
    "noise.dark_laser": '"off" or "firing"; without it the latter, where the file has any',
    "detector.multiplication": "gain of the photodiode, in place of Miller's equation",
    "range_finder.correlation_window_samples": "without it that of the receiver's preset",
    "electronics.cutoff_hz": "Hz; without it that of the receiver's preset",
    "electronics.order": "without it that of the receiver's preset",
    "electronics.gain_by_code": "V/V; without it that of the receiver's preset",
}
"""What a key does that has no value, and may be given one."""
_UNSAID = ("scene", "choice of the scene")
_COLUMN = 34


def commented(scene: Scene) -> str:
    """Write a scene file with every key that acts, and comments: unit, source, and what is assumed.

    Keys that do nothing beside the others are left out. Those that may have a value and have none, the
    numbers of the receiver's preset, and what follows from the scene, are comments.
    `sim.scene.parse_scene` gives the same scene back.
    """
    told = {line.key: line for line in explained(scene)}
    lines = [_HEADER, *(_line(f"{key} = {_text(getattr(scene, key))}", _note(told, key)) for key in _TOP)]
    for name in _TABLES:
        table = getattr(scene, name)
        lines += ["", f"# [{name}]: without this table it is night" if table is None else f"[{name}]"]
        lines += _of_table(scene, name, table, told) if table is not None else ()
    lines += ["", "[electronics]", *_of_electronics(scene, told), "", "# What is fixed, and what follows:"]
    settable = {f"receiver.{key}" for key in EmulatedReceiver.__struct_fields__}
    for key, line in told.items():
        if key.startswith(("receiver.", "computed.")) and key not in settable:
            value = float(f"{line.value:.6g}") if isinstance(line.value, float) else line.value
            lines.append(_line(f"# {key} = {_text(value)}", _note(told, key)))
    return "\n".join(lines) + "\n"


def described(name: str) -> str:
    """Return the line with which a ready scene says what it is."""
    with open(READY / f"{name}.toml", encoding="utf-8") as file:
        return file.readline().removeprefix("#").strip()


def _of_table(scene: Scene, name: str, table: Strict, told: Mapping[str, Explained]) -> Iterator[str]:
    usual = {
        "laser": laser_preset(scene.laser.preset, scene.laser.thermal),
        "surface": SurfaceTable(),
        "detector": DETECTORS[scene.detector.preset],
    }.get(name, table)
    for key in table.__struct_fields__:
        value, idle = getattr(table, key), is_idle(table, key)
        if value is None or value == "":
            if not idle and (key != "dark_laser" or scene.noise.dark_windows):
                yield _line(f"# {key}", _WITHOUT[f"{name}.{key}"])
        elif not idle:
            yield _line(f"{key} = {_text(value)}", _note(told, f"{name}.{key}"))
        elif value != getattr(usual, key):
            yield _line(f"{key} = {_text(value)}", "does nothing beside the other keys")


def _of_electronics(scene: Scene, told: Mapping[str, Explained]) -> Iterator[str]:
    usual = EmulatedReceiver()
    for key in usual.__struct_fields__:
        value = getattr(scene.electronics, key)
        preset = told.get(f"receiver.{key}")
        if value != getattr(usual, key):
            yield _line(f"{key} = {_text(value)}", _note(told, f"receiver.{key}"))
        elif preset is not None:
            yield _line(f"# {key} = {_text(preset.value)}", _note(told, preset.key))
        elif value is not None:
            yield _line(f"# {key} = {_text(value)}", "")
        elif f"electronics.{key}" in _WITHOUT:
            yield _line(f"# {key}", _WITHOUT[f"electronics.{key}"])


def _line(code: str, note: str) -> str:
    return f"{code:<{_COLUMN}}  # {note}" if note else code


def _note(told: Mapping[str, Explained], key: str) -> str:
    """Unit and source of a key, as far as there is something to say."""
    if key not in told:
        return ""
    line = told[key]
    source = "" if line.source in _UNSAID else line.source.removesuffix(" of a scene")
    if line.assumed:
        source = f"assumed: {source}"
    return "; ".join(part for part in ("" if line.unit == "1" else line.unit, source) if part)


def _text(value: Any) -> str:
    """Write a value as TOML, in one line."""
    if isinstance(value, Strict):
        keys = (f"{key} = {_text(getattr(value, key))}" for key in value.__struct_fields__)
        return "{ " + ", ".join(keys) + " }"
    if isinstance(value, tuple):
        return "[" + ", ".join(map(_text, value)) + "]"
    return tomli_w.dumps({"v": value}).removeprefix("v = ").rstrip("\n")
