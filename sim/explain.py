"""Every number of a scene with its unit, its source, and whether it is assumed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from belahil.config import EmulatedReceiver
from belahil.strict_toml import numbers
from sim.detector import multiplication
from sim.laser import beam_sigma_m, pulse_shape
from sim.link_budget import link_budget
from sim.presets import (
    DETECTOR_SOURCES,
    DETECTORS,
    LASER_SOURCES,
    LASERS,
    RECEIVER_SOURCES,
    THERMAL_SOURCE,
    Source,
    laser_preset,
)
from sim.scene_checks import is_idle
from sim.scene_tables import Noise, RangeFinderTable, Sun, SurfaceTable

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from belahil.strict_toml import Strict
    from sim.scene import Scene

Value = float | int | str | tuple[float, ...]

_UNITS = {
    "_w_per_m3": "W/m3",
    "_v_per_k": "V/K",
    "_v_s": "V s",
    "_m": "m",
    "_s": "s",
    "_j": "J",
    "_rad": "rad",
    "_deg": "deg",
    "_hz": "Hz",
    "_ohm": "ohm",
    "_au": "au",
    "_sr": "sr",
    "_v": "V",
    "_a": "A",
    "_c": "degC",
}
_SCENE = Source("scene")
PAPER = 'paper: Nishiyama et al., "Prospects for Mercury Observations with the BepiColombo Laser Altimeter"'
_CHOICE = Source("choice of the scene")
_DEFAULT = Source("default of a scene")
_DEFAULTS = {
    "surface.reflectance": Source("mean of Mercury at 1064 nm (Neumann et al. 2013)"),
    "surface.hurst": Source("Landais et al. 2019"),
    "surface.rms_deviation_m": Source("0.3 to 8 m spans Mercury", True),
    "surface.depth_m": Source("example", True),
    "surface.height_m": Source("example", True),
    "surface.diameter_m": Source("example", True),
    "surface.alpha": Source("no number for Mercury was found", True),
    "surface.c1": Source("no number for Mercury was found", True),
    "range_finder.template_count": Source("4 to 32 are possible", True),
    "range_finder.narrowest_s": Source("paper: detectable widths of 20 to 110 ns; with a margin", True),
    "range_finder.widest_s": Source("paper: detectable widths of 20 to 110 ns; with a margin", True),
    "range_finder.exclusion_samples": Source("no rule is published", True),
    "range_finder.refinement_steps": Source("the paper fits a Gaussian and does not say how", True),
    "sun.distance_au": Source("mean distance of Mercury"),
    "sun.irradiance_1au_w_per_m3": Source("ASTM G173-03, extraterrestrial, 1063 to 1065 nm"),
}


@dataclass(frozen=True, slots=True)
class Explained:
    """One line of the explanation.

    Parameters
    ----------
    key : str
        Table and key as in a scene file; "computed" and "receiver" for what no scene file says.
    value : float, int, str or tuple of float
        In SI units, or a word.
    unit : str
        "1" for a pure number, empty for a word.
    source : str
        Author and place, "scene" for what the scene file itself says, or the reason.
    assumed : bool
        No published number was found.
    """

    key: str
    value: Value
    unit: str
    source: str
    assumed: bool


def explain(scene: Scene) -> str:
    """Return `explained` as a table to print: value, unit, assumed or not, source."""
    lines = [
        (line.key, _shown(line.value), line.unit, "assumed" if line.assumed else "", line.source)
        for line in explained(scene)
    ]
    lines.insert(0, ("quantity", "value", "unit", "", "source"))
    widths = [max(len(line[column]) for line in lines) for column in range(5)]
    return (
        PAPER
        + "\n\n"
        + "\n".join(
            "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
            for line in lines
        )
    )


def explained(scene: Scene) -> tuple[Explained, ...]:
    """Return every quantity that acts in a scene, with its source; keys that do nothing are left out."""
    return tuple(_lines(scene))


def _lines(scene: Scene) -> Iterator[Explained]:
    for key in ("altitude_m", "gain_code", "filter", "seed"):
        same = getattr(scene, key) == getattr(type(scene)(), key)
        yield _line(key, getattr(scene, key), _DEFAULT if same else _SCENE)
    laser, detector = scene.laser, scene.detector
    at_temperature = laser_preset(laser.preset, laser.thermal)
    known = LASER_SOURCES[laser.preset]
    yield from _preset_lines("laser", laser, LASERS[laser.preset], at_temperature, known)
    usual, known = DETECTORS[detector.preset], DETECTOR_SOURCES[detector.preset]
    yield from _preset_lines("detector", detector, usual, usual, known)
    yield from _table_lines("surface", scene.surface, SurfaceTable())
    yield from _receiver_lines(scene)
    yield from _table_lines("range_finder", scene.range_finder, RangeFinderTable())
    yield from _table_lines("noise", scene.noise, Noise())
    if scene.sun is not None:
        yield from _table_lines("sun", scene.sun, Sun())
    yield from _computed_lines(scene)


def _preset_lines(
    name: str, table: Strict, preset: Strict, at_temperature: Strict, sources: Mapping[str, Source]
) -> Iterator[Explained]:
    for key, value in _acting(table):
        source = _SCENE
        if value == getattr(preset, key):
            source = sources.get(key, _CHOICE)
        elif value == getattr(at_temperature, key):
            source = THERMAL_SOURCE
        yield _line(f"{name}.{key}", value, source)


def _table_lines(name: str, table: Strict, default: Strict) -> Iterator[Explained]:
    for key, value in _acting(table):
        same = value == getattr(default, key)
        yield _line(f"{name}.{key}", value, _DEFAULTS.get(f"{name}.{key}", _DEFAULT) if same else _SCENE)


def _acting(table: Strict) -> Iterator[tuple[str, Value]]:
    for key in table.__struct_fields__:
        value = getattr(table, key)
        if value is not None and value != "" and not is_idle(table, key):
            yield key, value


def _receiver_lines(scene: Scene) -> Iterator[Explained]:
    spec, truth, sources = scene.receiver_spec, scene.truth, RECEIVER_SOURCES[scene.receiver]
    yield _line("receiver", spec.name, _SCENE)
    preset: dict[str, Value] = {
        "cutoff_hz": spec.cutoff_hz,
        "order": spec.order,
        "highpass_hz": 0.0,
        "adc_full_scale_v": spec.adc_full_scale_v,
        "adc_bits": spec.digitizer.bits,
    }
    for key, usual in preset.items():
        value = getattr(truth, key)
        if scene.filter == "butterworth" or key not in ("cutoff_hz", "order"):
            yield _line(f"receiver.{key}", value, sources[key] if value == usual else _SCENE)
    gain_source = sources["gain_at_code_4" if scene.gain_code == 4 else "gain"]
    if scene.electronics.gain_by_code is not None:
        gain_source = _SCENE
    yield _line("receiver.gain", scene.gain, gain_source)
    fixed: dict[str, Value] = {
        "sample_interval_s": spec.digitizer.sample_interval_s,
        "window_samples": spec.digitizer.max_sample_count,
        "correlation_window_samples": scene.correlation_window_samples,
        "candidates": spec.candidate_count,
    }
    for key, value in fixed.items():
        set_by_scene = getattr(scene.range_finder, key, None) is not None
        yield _line(f"receiver.{key}", value, _SCENE if set_by_scene else sources[key])
    yield from _electronics_lines(scene)


def _electronics_lines(scene: Scene) -> Iterator[Explained]:
    """What the scene changes in the receiver beside the lines before."""
    shown = ("cutoff_hz", "highpass_hz", "adc_full_scale_v", "gain_by_code")
    default = dict(numbers(EmulatedReceiver()))
    for key, row in numbers(scene.electronics):
        if key not in shown and row != default.get(key):
            yield _line(f"electronics.{key}", row[0] if len(row) == 1 else row, _SCENE)


def _computed_lines(scene: Scene) -> Iterator[Explained]:
    budget = link_budget(scene)
    shape = pulse_shape(scene.laser)
    major_m, _ = beam_sigma_m(scene.laser, scene.altitude_m)
    gain_source = "detector.multiplication"
    if scene.detector.multiplication is None:
        gain_source = "Miller's equation at bias_v and the breakdown voltage"
        if scene.detector == DETECTORS["bela"]:
            gain_source += "; paper, table 1: 48.4"
    computed: dict[str, tuple[Value, str]] = {
        "multiplication": (multiplication(scene.detector), gain_source),
        "transmitted_photons": (budget.transmitted_photons, "E lambda / (h c)"),
        "pulse_fwhm_s": (shape.fwhm_s, "of the whole transmitted pulse"),
        "footprint_m": (4 * major_m, "diameter at 1/e^2 of the peak, along the major axis"),
        "solid_angle_sr": (budget.solid_angle_sr, "of the aperture, from the ground"),
        "photons": (budget.photons, "on the photodiode; level ground within the field of view"),
        "energy_j": (budget.energy_j, "of those"),
        "primary_electrons": (budget.primary_electrons, "before multiplication"),
        "area_at_converter_v_s": (budget.area_at_converter_v_s, "integral of the echo's voltage"),
    }
    for key, (value, text) in computed.items():
        yield _line(f"computed.{key}", value, Source(text))


def _line(key: str, value: Value, source: Source) -> Explained:
    unit = "1"
    if isinstance(value, str):
        unit = ""
    elif not isinstance(value, int):
        unit = next((unit for suffix, unit in _UNITS.items() if key.endswith(suffix)), "1")
    return Explained(key, value, unit, source.text, source.assumed)


def _shown(value: Value) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return "(" + ", ".join(f"{number:.6g}" for number in value) + ")"
    if isinstance(value, float) and math.isfinite(value):
        return f"{value:.6g}"
    return str(value)
