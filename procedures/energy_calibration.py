"""Find what converts the electrical integrals of a pulse to the optical energy of its echo.

Pulses of known width and area are played at the cut; the area, divided by the responsivity of the scene's
detector, is an optical energy. Each window gives two integrals: over the samples of the correlation window
(E_CW), and over the Gaussian fitted to them (E_G). Both are divided by the detected amplitude, fitted with a
line, and compared with the same pulses behind the known receiver, with echoes of planes and of a terrain
model, and with the published lines.

Not modelled: the photodiode itself, which no bench has, so its gain and the transimpedance are those of the
scene; the noise of light; pulses on a slope of another pulse.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from belahil.errors import LimitExceeded, RefusedInput
from belahil.outcome import Outcome
from belahil.receiver import receiver_preset
from belahil.stimuli import SampledPulse
from belahil.values import Shot, WindowRequest
from procedures.gaussian_pulses import gaussian_pulse
from procedures.known_receiver import KnownReceiver, preset_receiver, refuse_other
from procedures.plans import Journal, PlannedShot, RecordablePlan, check_all, measure_all, usual_code
from procedures.pulse_place import first_sample

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from belahil.bench import Bench
    from belahil.config import BenchConfig
    from belahil.recorded import RecordedWindows
    from sim.scene import Scene

WIDTHS_S = (6e-9, 12e-9, 18e-9, 25e-9, 32e-9, 40e-9, 50e-9, 60e-9, 70e-9, 80e-9, 90e-9, 100e-9)
"""Full widths before the receiver's filter, behind which they are 20 to 100 ns."""
PEAKS_V = (8e-3, 25e-3, 80e-3)
SHOTS = 8
ALTITUDES_M = (400e3, 600e3, 800e3, 1000e3, 1200e3, 1400e3)
FOOTPRINTS = 150

_SAMPLES = 2048
"""Of a window: a baseline, and the pulse in the last quarter."""
_AFTER_SAMPLES = 512


@dataclass(frozen=True, slots=True)
class EnergyOptions:
    """What the user may choose.

    Parameters
    ----------
    widths_s, peaks_v : tuple of float
        Full widths of the played pulses, s; heights at the cut, V. Every width is played at every height.
    shots : int
        Of each such pulse, each with its own place between two samples.
    gain_code : int or None
        None: 4 where the receiver has it, else its first.
    scene : str
        A ready scene or a scene file: laser and detector, and the ground of the simulated footprints.
    altitudes_m : tuple of float
        Of the simulated footprints, m; empty: none are simulated.
    footprints : int
        At each altitude.
    receiver : KnownReceiver or None
        None: the preset that the bench file names.

    Raises
    ------
    RefusedInput
        Fewer than three widths, or a number that is not positive.
    """

    widths_s: tuple[float, ...] = WIDTHS_S
    peaks_v: tuple[float, ...] = PEAKS_V
    shots: int = SHOTS
    gain_code: int | None = None
    scene: str = "fractal"
    altitudes_m: tuple[float, ...] = ALTITUDES_M
    footprints: int = FOOTPRINTS
    receiver: KnownReceiver | None = None

    def __post_init__(self) -> None:
        if len(set(self.widths_s)) < 3 or not self.peaks_v:
            raise RefusedInput(
                f"{len(set(self.widths_s))} widths and {len(self.peaks_v)} heights: a line with a curve "
                "about it needs at least 3 widths and 1 height"
            )
        for one in (*self.widths_s, *self.peaks_v, *self.altitudes_m):
            if not 0 < one < math.inf:
                raise RefusedInput(f"widths, heights, altitudes: {one!r} must be positive and finite")
        if self.shots < 1 or self.footprints < 1:
            raise RefusedInput(
                f"{self.shots} shots, {self.footprints} footprints: at least 1 of each is needed"
            )


EnergyPlan = RecordablePlan[EnergyOptions]
"""By width, then by height."""


def plan(bench: Bench, options: EnergyOptions) -> EnergyPlan:
    """Fit the options to what this bench can do.

    Raises
    ------
    LimitExceeded
        A gain code, width or height that receiver or generator does not have, or a receiver whose windows
        are too short.
    InterlockRefused
        A height over ``max_vpp``.
    RefusedInput
        A width below the generator's interval, a scene that is not there or has no terrain model, or a known
        receiver that is another one.
    """
    _refuse_scene(options)
    spec = bench.spec
    refuse_other(options.receiver, spec, "the receiver on the bench")
    if spec.max_sample_count < _SAMPLES:
        raise LimitExceeded(
            f"the receiver's longest window has {spec.max_sample_count} samples: {_SAMPLES} are needed"
        )
    code = usual_code(spec, options.gain_code)
    delay_s, begin_s = first_sample(bench.config)
    centre_s = begin_s + (_SAMPLES - _AFTER_SAMPLES) * spec.sample_interval_s
    planned: list[PlannedShot] = []
    for width_s in dict.fromkeys(options.widths_s):
        for peak_v in dict.fromkeys(options.peaks_v):
            pulse = gaussian_pulse(width_s, peak_v, bench.generator_model, centre_s)
            for _ in range(options.shots):
                request = WindowRequest(len(planned), code, _SAMPLES, delay_s)
                planned.append(PlannedShot(request, pulse))
    made = EnergyPlan(tuple(planned), spec.converters, spec.bits, options)
    check_all(bench, made.shots)
    return made


def recorded_plan(recorded: RecordedWindows, options: EnergyOptions) -> EnergyPlan:
    """Take the windows of a data file in which a sampled pulse was played.

    Raises
    ------
    RefusedInput
        There are none, or the scene is not there or has no terrain model.
    """
    _refuse_scene(options)
    if not any(isinstance(recorded.played(row), SampledPulse) for row in range(len(recorded))):
        raise RefusedInput(
            f"{recorded.path}: no window with a sampled pulse; needed are some whose area at the cut is known"
        )
    return EnergyPlan((), recorded.spec.converters, recorded.spec.bits, options)


def measure(
    bench: Bench, run: Journal, plan: EnergyPlan, progress: Callable[[int, int], None] | None = None
) -> None:
    """Measure what the run does not hold yet; see `procedures.plans.measure_all`."""
    measure_all(bench, run, plan.shots, progress)


def analyse(plan: EnergyPlan, shots: Iterable[Shot], config: BenchConfig) -> Outcome:
    """Turn the recorded windows into conversions, and compare them.

    Parameters
    ----------
    plan : EnergyPlan
        What was measured.
    shots : iterable of Shot
        In any order. Shots without a sampled pulse are left out.
    config : BenchConfig
        Declared uncertainties; ``[emulation]`` is not read.
    """
    from procedures.energy_outcome import outcome
    from procedures.energy_points import read_shots

    preset = receiver_preset(config.digitizer.receiver)
    receiver = plan.options.receiver or preset_receiver(config)
    scene = _scene_of(plan.options)
    readings = read_shots(shots, receiver, scene, preset, plan.converters, plan.bits)
    return outcome(readings, receiver, scene, plan.options, config)


def _scene_of(options: EnergyOptions) -> Scene:
    from sim.scene import load_scene

    return load_scene(options.scene)


def _refuse_scene(options: EnergyOptions) -> None:
    """Refuse a scene before anything is measured."""
    scene = _scene_of(options)
    if options.altitudes_m:
        from procedures.energy_model import refuse_ground
        from sim.chain import Chain

        refuse_ground(Chain(scene))
