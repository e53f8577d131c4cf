"""Campaign: what the temperature of the laser head does to a return pulse, over a plane, with equal photons.

Three sets of the laser, each emitted, received, digitized: how much the digitized pulses differ when they are
aligned at their peaks, how far the range is off when nobody corrects for the temperature, how much the
amplitude changes, and what a library of pulses of the wrong set leaves. Each change that makes a set is tried
alone too, and the sets weaker and stronger than assumed.

What this does not model: a beam whose profile changes other than in size, a pulse whose energy depends on the
temperature, and a receiver that does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec import structs

from belahil.campaign_run import CampaignPlan
from belahil.chunks import Chunk
from belahil.errors import RefusedInput
from procedures.campaign_options import refuse_outside
from procedures.pulse_library import best_matches, mean_fit, plane_chain, pulse_library
from sim.footprint import NoReturn
from sim.kernel import Kernel
from sim.laser import PulseShape, photon_number
from sim.presets import THERMAL, ThermalSet
from sim.scene import Scene, as_toml, load_scene, parse_scene

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.outcome import Outcome
    from sim.chain import Chain
    from sim.scene_tables import Laser, Thermal

SETS: tuple[Thermal, ...] = ("cold", "ambient", "hot")
PARTS = ("fwhm", "tail", "divergence", "pointing")
STRENGTHS = (0.5, 1.5, 2.0, 3.0, 4.0)
"""Of the assumed changes, as a factor."""
AZIMUTHS_DEG = tuple(float(one) for one in range(0, 360, 30))
HALF_STEP_DEG = 0.5
STEPS = 40
"""Places of a curve in a sample interval."""
PHASES = 20
_BEFORE_S, _AFTER_S = 300e-9, 500e-9


@dataclass(frozen=True, slots=True)
class TemperatureOptions:
    """What a user may choose.

    Parameters
    ----------
    scene : str or None
        Instrument, altitude, reflectance; its ground is replaced by a plane. None: BELA at 500 km.
    slope_deg : float
        Of the plane, 0 to 89, and less where its echo would be longer than what is computed.
    azimuth_deg : float
        In which it rises; the assumed sets point along azimuth 0.
    cold, ambient, hot : str or None
        Scenes of which the laser is taken for a set; None: the assumed change of the scene's own laser.
    threshold : float
        Part of its peak below which the transmitted pulse is lost in the fibre, 0 to below 1.

    Raises
    ------
    RefusedInput
        A number outside its range.
    """

    scene: str | None = None
    slope_deg: float = 10.0
    azimuth_deg: float = 0.0
    cold: str | None = None
    ambient: str | None = None
    hot: str | None = None
    threshold: float = 0.17

    def __post_init__(self) -> None:
        refuse_outside("slope-deg", (self.slope_deg,), 0.0, 89.0)
        if not np.isfinite(self.azimuth_deg):
            raise RefusedInput(f"--azimuth-deg {self.azimuth_deg:g}: must be finite")
        if not 0 <= self.threshold < 1:
            raise RefusedInput(f"--threshold {self.threshold:g}: allowed is 0 to below 1")


def plan(options: TemperatureOptions) -> CampaignPlan:
    """Plan a campaign: a chunk for each set, for each change alone, for each strength, and for the library.

    Raises
    ------
    ConfigError
        A scene cannot be read.
    """
    scene = Scene() if options.scene is None else load_scene(options.scene)
    _refuse_unchanged(options, scene.laser)
    own: dict[Thermal, str | None] = {name: getattr(options, name) for name in SETS}
    lasers: dict[str, Laser] = {
        name: changed(scene.laser, THERMAL[name]) if given is None else load_scene(given).laser
        for name, given in own.items()
    }
    common = {"slope_deg": options.slope_deg, "azimuth_deg": options.azimuth_deg}
    lasers |= variations(scene.laser, own)
    scenes = {name: as_toml(_equal(scene, laser)) for name, laser in lasers.items()}
    for name in SETS:
        _refuse_late(parse_scene(scenes[name]), options)
    where = "procedures.campaign_temperature"
    chunks = [
        Chunk(name, f"{where}:one_set", {"scene": text, "threshold": options.threshold} | common)
        for name, text in scenes.items()
    ]
    matched = {"scenes": list(scenes.values()), "library": scenes["ambient"]}
    chunks.append(Chunk("library", f"{where}:wrong_library", matched | common))
    instruments = {"laser": "as assumed" if not any(own.values()) else "of scenes, where they were given"}
    return CampaignPlan(tuple(chunks), as_toml(scene), scene.seed, instruments)


def _refuse_unchanged(options: TemperatureOptions, laser: Laser) -> None:
    """Refuse a laser whose shapes come from files, where an assumed set is to change them."""
    if options.cold is not None and options.hot is not None:
        return
    if laser.pulse == "table" or laser.beam == "image":
        raise RefusedInput(
            f'--scene {options.scene}: pulse = "{laser.pulse}" and beam = "{laser.beam}" of its laser; the '
            "assumed sets change widths of other shapes: give --cold and --hot"
        )


def _refuse_late(scene: Scene, options: TemperatureOptions) -> None:
    """Refuse ground so steep that pulses end beyond what is computed, uphill or downhill of the pointing."""
    for turn_deg in (0.0, 180.0):
        steepest_deg = options.slope_deg + HALF_STEP_DEG
        chain = plane_chain(scene, steepest_deg, options.azimuth_deg + turn_deg)
        interval_s = chain.receiver.grid.interval_s
        volts = chain.curve(None, -_BEFORE_S, interval_s, round((_BEFORE_S + _AFTER_S) / interval_s))
        try:
            mean_fit(volts, 1, scene.correlation_window_samples, interval_s)
        except RefusedInput as error:
            raise RefusedInput(f"--slope-deg {options.slope_deg:g}: {error}") from error


def variations(laser: Laser, own: dict[Thermal, str | None]) -> dict[str, Laser]:
    """Each change of an assumed set alone, and the assumed sets at other strengths, by name."""
    found = {}
    changes: tuple[Thermal, ...] = ("cold", "hot")
    for name in changes:
        if own[name] is not None or own["ambient"] is not None:
            continue
        whole = THERMAL[name]
        for part in PARTS:
            key = "pointing_rad" if part == "pointing" else part
            found[f"{name}, {part} alone"] = changed(laser, ThermalSet(**{key: getattr(whole, key)}))
        for strength in STRENGTHS:
            found[f"{name}, times {strength:g}"] = changed(laser, scaled(whole, strength))
    return found


def scaled(change: ThermalSet, strength: float) -> ThermalSet:
    """Return a set whose changes are so many times as large; of factors, their logarithms."""
    return ThermalSet(
        change.fwhm**strength,
        change.tail**strength,
        change.divergence**strength,
        (change.pointing_rad[0] * strength, change.pointing_rad[1] * strength),
    )


def changed(laser: Laser, change: ThermalSet) -> Laser:
    """Return a laser at a thermal set, whatever set it was labelled with."""
    return structs.replace(
        laser,
        fwhm_s=laser.fwhm_s * change.fwhm,
        # Only where it acts: a scene says nothing that does nothing.
        tail_s=laser.tail_s * (change.tail if laser.pulse == "tailed" else 1.0),
        divergence_rad=laser.divergence_rad * change.divergence,
        pointing_rad=(
            laser.pointing_rad[0] + change.pointing_rad[0],
            laser.pointing_rad[1] + change.pointing_rad[1],
        ),
    )


def _equal(scene: Scene, laser: Laser) -> Scene:
    """The scene with a laser of the scene's own energy and wavelength: equal photons."""
    same = structs.replace(laser, energy_j=scene.laser.energy_j, wavelength_m=scene.laser.wavelength_m)
    return structs.replace(scene, laser=same)


def one_set(scene: str, threshold: float, slope_deg: float, azimuth_deg: float) -> dict[str, NDArray[Any]]:
    """Follow the pulse of one set from the laser to the converter, without noise."""
    what = parse_scene(scene)
    chain = plane_chain(what, slope_deg, azimuth_deg)
    interval_s = chain.receiver.grid.interval_s
    step_s = interval_s / STEPS
    count = round((_BEFORE_S + _AFTER_S) / step_s)
    times_s = -_BEFORE_S + step_s * np.arange(count)
    volts = chain.curve(None, -_BEFORE_S, step_s, count)
    window = what.correlation_window_samples
    arrival_s, fwhm_s, amplitude_v = mean_fit(volts, STEPS, window, interval_s)
    light = chain.echo()
    pulse = chain.light_kernel.pulse
    sent_s, sent_fwhm_s = _transmitted(pulse, chain.kernel, threshold, window, interval_s)
    ground_s = [_ground_s(plane_chain(what, slope_deg, azimuth_deg + one)) for one in AZIMUTHS_DEG]
    return {
        "time_s": times_s,
        "emitted_rate": photon_number(what.laser) * pulse.density(times_s),
        "received_rate": light.photon_rate_hz(-_BEFORE_S, step_s, count),
        "volts": volts,
        "photons": np.array([photon_number(what.laser), light.photons]),
        "fit": np.array([-_BEFORE_S + arrival_s, fwhm_s, amplitude_v]),
        "transmitted_fit": np.array([sent_s, sent_fwhm_s]),
        # Without what the pulse adds: where on the ground the light falls.
        "ground_s": np.array(ground_s),
        "day_night_v": np.array(noises_v(what)),
    }


def _ground_s(chain: Chain) -> float:
    """Mean delay of the light from the ground, s."""
    light = chain.lit().delays
    if isinstance(light, NoReturn):
        raise RefusedInput(f"no light comes back: {light.reason}")
    return light.mean_s


def noises_v(scene: Scene) -> tuple[float, float]:
    """Noise by night and by day: dark noise of the receiver's preset, and sunlight at noon that adds 80 %.

    The latter is the paper's statement for a reflectance of 0.17.
    """
    spec = scene.receiver_spec
    codes = spec.digitizer.gain_codes or (scene.gain_code,)
    night_v = scene.noise.dark_rms_v or spec.noise_rms_v_by_code[codes.index(scene.gain_code)]
    return night_v, 1.8 * night_v


def _transmitted(
    pulse: PulseShape, kernel: Kernel, threshold: float, window: int, interval_s: float
) -> tuple[float, float]:
    """Arrival and width of the Gaussian of the laser's own pulse behind fibre and receiver, s."""
    times_s = np.linspace(-40e-9, 80e-9, 4801)
    relative = pulse.density(times_s)
    relative = np.where(relative >= threshold * relative.max(), relative, 0.0)
    through = Kernel(PulseShape(times_s=times_s, relative=relative), kernel.poles, kernel.zeros)
    step_s = interval_s / STEPS
    lags_s = -_BEFORE_S + step_s * np.arange(round((_BEFORE_S + _AFTER_S) / step_s))
    arrival_s, fwhm_s, _ = mean_fit(through.exact(lags_s), STEPS, window, interval_s)
    return -_BEFORE_S + arrival_s, fwhm_s


def wrong_library(
    scenes: list[str], library: str, slope_deg: float, azimuth_deg: float
) -> dict[str, NDArray[Any]]:
    """Match the pulses of sets with the library of one of them.

    Each set over planes that rise in all azimuths, and lying between two samples anywhere. Last, the
    library's own set over a plane half a step of the library steeper: what its steps leave.
    """
    pulses = pulse_library(parse_scene(library))
    found = []
    for text, steeper_deg in [*((one, 0.0) for one in scenes), (library, HALF_STEP_DEG)]:
        rows, arrivals_s = _windows(parse_scene(text), slope_deg + steeper_deg, azimuth_deg)
        found.append(best_matches(pulses, rows, arrivals_s))
    return {
        "msr_v2": np.stack([one.msr_v2 for one in found]),
        "slope_deg": np.stack([pulses.slope_deg[one.pulse] for one in found]),
        "factor": np.stack([one.factor for one in found]),
    }


def _windows(
    scene: Scene, slope_deg: float, azimuth_deg: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Correlation windows without noise, and where the Gaussian of each is, s from its first sample."""
    window = scene.correlation_window_samples
    rows, arrivals_s = [], []
    for turn_deg in AZIMUTHS_DEG:
        chain = plane_chain(scene, slope_deg, azimuth_deg + turn_deg)
        step_s = chain.receiver.grid.interval_s / PHASES
        volts = chain.curve(None, -_BEFORE_S, step_s, round((_BEFORE_S + _AFTER_S) / step_s))
        arrival_s = mean_fit(volts, PHASES, window, chain.receiver.grid.interval_s)[0]
        for phase in range(PHASES):
            first = round(arrival_s / step_s) - (window // 2) * PHASES + phase
            rows.append(volts[first : first + window * PHASES : PHASES])
            arrivals_s.append(arrival_s - first * step_s)
    return np.array(rows), np.array(arrivals_s)


def analyse(plan: CampaignPlan, results: list[dict[str, NDArray[Any]]]) -> Outcome:
    """Compare the sets."""
    from procedures.campaign_temperature_outcome import outcome

    return outcome(plan, results)
