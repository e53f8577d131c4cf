"""What a scene's tables may not say, beyond what their types forbid: idle keys, files that are missing."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from belahil.errors import ConfigError, RefusedInput
from sim.presets import laser_preset
from sim.scene_tables import Detector, Laser, RangeFinderTable, SurfaceTable

if TYPE_CHECKING:
    from belahil.strict_toml import Strict
    from sim.scene_tables import Noise

_MADE = ("fractal", "multifractal")
_GRID = (*_MADE, "dtm")

_OF_MILLER = (
    "bias_v",
    "breakdown_v",
    "breakdown_v_per_k",
    "breakdown_reference_c",
    "apd_temperature_c",
    "miller_exponent",
)

# A key, the key that must have one of the words for it to act, and those words.
Needs = Mapping[str, tuple[str, tuple[str, ...]]]
_LASER: Needs = {
    "fwhm_s": ("pulse", ("gaussian", "tailed")),
    "tail_s": ("pulse", ("tailed",)),
    "table": ("pulse", ("table",)),
    "divergence_rad": ("beam", ("gaussian", "elliptical")),
    "ellipticity": ("beam", ("elliptical",)),
    "beam_azimuth_deg": ("beam", ("elliptical",)),
    "image": ("beam", ("image",)),
    "image_pixel_rad": ("beam", ("image",)),
}
_SURFACE: Needs = {
    "slope_deg": ("kind", ("plane", "crater", "boulder", *_MADE)),
    "azimuth_deg": ("kind", ("plane", "crater", "boulder", *_MADE)),
    "reflectance_map": ("kind", _GRID),
    "radiation_factor": ("photometry", ("factor",)),
    "centre_m": ("kind", ("crater", "boulder", "dtm")),
    "diameter_m": ("kind", ("crater", "boulder")),
    "depth_m": ("kind", ("crater",)),
    "height_m": ("kind", ("boulder",)),
    "exponent": ("kind", ("crater", "boulder")),
    "rim_height_m": ("kind", ("crater",)),
    "hurst": ("kind", _MADE),
    "rms_deviation_m": ("kind", _MADE),
    "baseline_m": ("kind", _MADE),
    "alpha": ("kind", ("multifractal",)),
    "c1": ("kind", ("multifractal",)),
    "seed": ("kind", _MADE),
    "extent_m": ("kind", _GRID),
    "spacing_m": ("kind", _GRID),
    "file": ("kind", ("dtm",)),
    "datum_m": ("kind", ("dtm",)),
}


def check_laser(laser: Laser) -> None:
    """Refuse keys that would do nothing and files that are not there.

    Raises
    ------
    ConfigError
        With the key and what is allowed.
    """
    _refuse_idle(laser, laser_preset(laser.preset, laser.thermal), "laser", _LASER)
    _need_file(laser, "laser", "table", laser.pulse == "table", 'pulse = "table"')
    _need_file(laser, "laser", "image", laser.beam == "image", 'beam = "image"')


def check_surface(surface: SurfaceTable) -> None:
    """Refuse keys that would do nothing and files that are not there; errors as `check_laser`."""
    _refuse_idle(surface, SurfaceTable(), "surface", _SURFACE)
    _need_file(surface, "surface", "file", surface.kind == "dtm", 'kind = "dtm"')
    _need_file(surface, "surface", "reflectance_map", False, "")


def check_detector(detector: Detector) -> None:
    """Refuse a bias at or above breakdown, where Miller's equation has no gain.

    Raises
    ------
    ConfigError
        With both voltages.
    """
    breakdown_v = detector.breakdown_now_v
    if detector.multiplication is None and not detector.bias_v < breakdown_v:
        raise ConfigError(
            f"[detector] bias_v = {detector.bias_v:g}: must be below the breakdown voltage, "
            f"{breakdown_v:.2f} V at apd_temperature_c = {detector.apd_temperature_c:g}"
        )


def check_noise(noise: Noise) -> None:
    """Refuse two kinds of dark noise at once, and a file that is not there; errors as `check_laser`."""
    if noise.dark_windows and noise.dark_rms_v is not None:
        raise ConfigError("[noise] dark_rms_v and dark_windows: allowed is one of them")
    if noise.dark_laser and not noise.dark_windows:
        raise ConfigError(f'[noise] dark_laser = "{noise.dark_laser}" without dark_windows: needs both')
    _need_file(noise, "noise", "dark_windows", False, "")


def check_range_finder(table: RangeFinderTable, sample_interval_s: float) -> None:
    """Refuse templates that a bank cannot have; errors as `check_laser`."""
    if table == RangeFinderTable():
        return
    from sim.template_bank import TemplateBank

    try:
        TemplateBank(sample_interval_s, table.template_count, table.narrowest_s, table.widest_s)
    except RefusedInput as error:
        raise ConfigError(f"[range_finder] {error}") from error


def is_idle(table: Strict, key: str) -> bool:
    """Tell whether a key of a table does nothing beside what the table's other keys say."""
    if isinstance(table, Detector):
        return key in _OF_MILLER and table.multiplication is not None
    needs = _LASER if isinstance(table, Laser) else _SURFACE if isinstance(table, SurfaceTable) else {}
    if key not in needs:
        return False
    selector, words = needs[key]
    return getattr(table, selector) not in words


def _refuse_idle(table: Strict, usual: Strict, name: str, needs: Needs) -> None:
    for key, (selector, words) in needs.items():
        value = getattr(table, key)
        if is_idle(table, key) and value != getattr(usual, key):
            word = getattr(table, selector)
            allowed = " or ".join(f'"{one}"' for one in words)
            raise ConfigError(
                f'[{name}] {key} = {value!r} does nothing with {selector} = "{word}"; '
                f"it acts with {selector} = {allowed}"
            )


def _need_file(table: Strict, name: str, key: str, needed: bool, why: str) -> None:
    path = getattr(table, key)
    if needed and not path:
        raise ConfigError(f"[{name}] {key}: {why} needs a file")
    if path and not Path(path).is_file():
        raise ConfigError(f"[{name}] {key} = {path}: no such file")
