"""Scenes: what there is between laser and receiver, as a TOML file, strictly checked.

A scene says what is there and never how exactly it is to be computed. A key that is missing has its default;
those of ``[laser]`` and ``[detector]`` are the preset's, at the thermal set of the laser. What is absent or
neutral is not simulated.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import msgspec
from msgspec import Meta

from belahil import strict_toml
from belahil.config import EmulatedReceiver, check_by_code
from belahil.errors import ConfigError
from belahil.receiver import ReceiverSpec, receiver_preset
from belahil.receiver_truth import ReceiverTruth, without_gaps
from belahil.strict_toml import Strict
from sim.presets import detector_preset, laser_preset
from sim.scene_checks import check_detector, check_laser, check_noise, check_range_finder, check_surface
from sim.scene_tables import Detector, Laser, Noise, RangeFinderTable, Sun, SurfaceTable, Thermal

READY = Path(__file__).parent / "scenes"
_FILES = (
    ("laser", "table"),
    ("laser", "image"),
    ("surface", "reflectance_map"),
    ("surface", "file"),
    ("noise", "dark_windows"),
)


class Scene(Strict, frozen=True):
    """A whole scene.

    Parameters
    ----------
    altitude_m : float
        Of the instrument above the plane z = 0.
    receiver : str
        Preset right of the cut, see `belahil.receiver`.
    gain_code : int
        One of the receiver's.
    filter : {"butterworth", "gaussian"}
        The receiver's low-pass; "gaussian" is that of earlier models, with the detector's `tia_bandwidth_hz`,
        without extra pole and high-pass. Dark noise keeps the colour of the receiver's own low-pass.
    seed : int
        Of every random draw.
    laser, detector : Laser, Detector
        The instrument left of the cut.
    surface : SurfaceTable
        The ground.
    electronics : EmulatedReceiver
        What differs from the receiver's preset; its noise is `noise.dark_rms_v`.
    range_finder : RangeFinderTable
        The search for pulses.
    noise : Noise
        Noise terms that are there.
    sun : Sun or None
        None at night.
    """

    altitude_m: Annotated[float, Meta(ge=1, le=1e9)] = 500e3
    receiver: str = "bela-grm"
    gain_code: Annotated[int, Meta(ge=0)] = 4
    filter: Literal["butterworth", "gaussian"] = "butterworth"
    seed: Annotated[int, Meta(ge=0)] = 1
    laser: Laser = Laser()
    surface: SurfaceTable = SurfaceTable()
    detector: Detector = Detector()
    electronics: EmulatedReceiver = EmulatedReceiver()
    range_finder: RangeFinderTable = RangeFinderTable()
    noise: Noise = Noise()
    sun: Sun | None = None

    @property
    def receiver_spec(self) -> ReceiverSpec:
        """The receiver's preset."""
        return receiver_preset(self.receiver)

    @property
    def truth(self) -> ReceiverTruth:
        """The receiver without gaps; noise at the scene's gain code only, 0 V where the scene has none."""
        truth = without_gaps(self.electronics, self.receiver_spec)
        codes = self.receiver_spec.digitizer.gain_codes or (self.gain_code,)
        dark_v = self.noise.dark_rms_v or 0.0
        by_code = tuple(dark_v if code == self.gain_code else 0.0 for code in codes)
        return msgspec.structs.replace(truth, noise_rms_v_by_code=by_code)

    @property
    def correlation_window_samples(self) -> int:
        """What the range finder keeps round a candidate."""
        return self.range_finder.correlation_window_samples or self.receiver_spec.correlation_window_samples

    @property
    def gain(self) -> float:
        """Gain from the cut to the converter at the scene's gain code, V/V."""
        codes = self.receiver_spec.digitizer.gain_codes or (self.gain_code,)
        return self.truth.gain_by_code[codes.index(self.gain_code)]


def ready_scenes() -> tuple[str, ...]:
    """Names of the scenes that come with the program."""
    return tuple(sorted(path.stem for path in READY.glob("*.toml")))


def load_scene(name: str | Path) -> Scene:
    """Read a scene: one that comes with the program, by name, or a file.

    Parameters
    ----------
    name : str or Path
        A name from `ready_scenes`, or the path of a TOML file. Paths in it are relative to its folder.

    Raises
    ------
    ConfigError
        It is not there, or says something that is not allowed: one line.
    """
    path = Path(name)
    if str(name) in ready_scenes():
        path = READY / f"{name}.toml"
    elif path.suffix != ".toml" and not path.exists():
        raise ConfigError(f"scene {name}: no such file; ready scenes: {', '.join(ready_scenes())}")
    return parse_scene(strict_toml.read(path, "scene file"), str(name), path.parent)


def parse_scene(text: str, name: str = "scene file", folder: Path | None = None) -> Scene:
    """Read a scene from its text and check it whole.

    Parameters
    ----------
    text : str
        TOML.
    name : str
        How to call it in messages.
    folder : Path or None
        Where relative paths in it begin; None: the working directory.

    Raises
    ------
    ConfigError
        One line: where, what was found, what is allowed.
    """
    tables = strict_toml.parse(text, name)
    _resolve_files(tables, folder)
    with strict_toml.about(name):
        _fill_from_presets(tables)
    scene = strict_toml.typed(tables, Scene, name)
    with strict_toml.about(name):
        check_scene(scene)
    return scene


def check_scene(scene: Scene) -> None:
    """Check what a type cannot say.

    Raises
    ------
    ConfigError
        With the key and what is allowed.
    """
    for where, numbers in strict_toml.numbers(scene):
        if not all(map(math.isfinite, numbers)):
            raise ConfigError(f"{where} is not a finite number")
    spec = receiver_preset(scene.receiver)
    codes = spec.digitizer.gain_codes
    if codes is not None and scene.gain_code not in codes:
        raise ConfigError(f"gain_code = {scene.gain_code}; {spec.name} has {codes[0]} to {codes[-1]}")
    check_by_code(scene.electronics, spec, "electronics")
    if scene.electronics.emc_burst.amplitude_v:
        raise ConfigError(
            "[electronics] emc_burst: it rings with the shot and is over long before an echo; noise recorded "
            "with the laser firing is [noise] dark_windows"
        )
    if scene.electronics.noise_rms_v_by_code is not None:
        raise ConfigError("[electronics] noise_rms_v_by_code: the noise of a scene is [noise] dark_rms_v")
    check_laser(scene.laser)
    check_surface(scene.surface)
    check_detector(scene.detector)
    check_noise(scene.noise)
    check_range_finder(scene.range_finder, spec.digitizer.sample_interval_s)


def as_toml(scene: Scene) -> str:
    """Write a scene file that says every key; `parse_scene` gives the same scene back."""
    return strict_toml.as_text(scene)


def _resolve_files(tables: dict[str, Any], folder: Path | None) -> None:
    for table, key in _FILES:
        given = tables.get(table)
        if isinstance(given, dict) and isinstance(given.get(key), str) and given[key]:
            given[key] = str(((folder or Path()) / given[key]).absolute())


def _fill_from_presets(tables: dict[str, Any]) -> None:
    """Put the preset's values where ``[laser]`` and ``[detector]`` are silent."""
    laser = tables.get("laser", {})
    if isinstance(laser, dict):
        preset, thermal = laser.get("preset", "bela"), laser.get("thermal", "ambient")
        # A wrong word or type is left for the strict check, which knows how to say it.
        if isinstance(preset, str) and thermal in get_args(Thermal):
            jitter = laser.get("jitter_rad")
            if isinstance(jitter, int | float):
                laser = laser | {"jitter_rad": (jitter, jitter)}
            tables["laser"] = _plain(laser_preset(preset, thermal)) | laser
    detector = tables.get("detector", {})
    if isinstance(detector, dict) and isinstance(preset := detector.get("preset", "bela"), str):
        tables["detector"] = _plain(detector_preset(preset)) | detector


def _plain(table: Strict) -> dict[str, Any]:
    plain: dict[str, Any] = msgspec.to_builtins(table)
    return plain
