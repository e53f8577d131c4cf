"""Play the echo of a scene into the receiver, and compare its windows with what a known receiver makes of it.

The echo is a voltage at the cut, before the receiver's gain and filter. It becomes a waveform that the
generator of the bench can play (`procedures.playable`), is played many times, and each window is compared
with the prediction for what was *really* played. Where the trigger falls between two samples nobody knows:
it is found for each shot. The noise is measured in the same run, in silent windows.

With shot noise inside the waveform each shot plays a realization of its own, and the prediction of each shot
is that of its own waveform; without, all shots play the mean echo.

Not modelled: noise that differs between silent and played windows; a gain that depends on amplitude; the
frequency response of attenuator and cables; jitter of the generator within a pulse.
"""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

from belahil.errors import RefusedInput
from belahil.stimuli import NoSignal, SampledPulse, largest_volts
from belahil.values import WindowRequest
from procedures.known_receiver import KnownReceiver, preset_receiver
from procedures.noise import window_length
from procedures.plans import Journal, PlannedShot, check_all, measure_all
from procedures.playable import Playable, advised_attenuation_db, check_not_too_faint, is_too_faint, playable
from procedures.pulse_echoes import Echo, NamedScene, check_grid, echoes
from sim.accuracy import Accuracy

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from belahil.bench import Bench
    from belahil.config import BenchConfig
    from belahil.outcome import Outcome
    from belahil.recorded import RecordedWindows
    from belahil.values import Shot

ShapeStatus = Literal[
    "ok",
    "no_pulse",
    "echo_too_faint",
    "pulse_below_noise",
    "not_converged",
    "saturated",
    "equal_windows",
    "mixed_gain_codes",
    "another_receiver",
    "noise_clipped",
    "noise_no_signal",
    "noise_below_dither",
    "too_few_samples",
]
"""What an echo may say in place of a verdict; `docs/pulse-shape.md` tells what each means."""

SHOTS, DARK_WINDOWS = 200, 16
LONGEST_STRETCH = 64
"""Samples round a pulse that are compared, at most: correlation windows have 42 or 64."""


@dataclass(frozen=True, slots=True)
class PulseShapeOptions:
    """What the user may choose.

    Parameters
    ----------
    scenes : tuple of NamedScene
        Whose echoes are played; none with recorded windows.
    slopes_deg, azimuths_deg : tuple of float or None
        Planes in place of the scenes' own, all combinations.
    shots, dark_windows : int
        Windows of each echo; silent windows of each gain code.
    gain_code : int or None
        In place of the scenes' own.
    shot_noise : {"absent", "inside"}
        Whether each shot plays the mean echo or a realization with shot noise, sunlight and jitter. Of
        recorded windows: whether the pulses of a file are realizations of one echo, or echoes of their own.
    tolerance : float
        Of the echo, as in `sim.accuracy.Accuracy`.
    receiver : KnownReceiver or None
        What is known of the receiver; None: its preset.
    """

    scenes: tuple[NamedScene, ...] = ()
    slopes_deg: tuple[float, ...] | None = None
    azimuths_deg: tuple[float, ...] | None = None
    shots: int = SHOTS
    dark_windows: int = DARK_WINDOWS
    gain_code: int | None = None
    shot_noise: Literal["absent", "inside"] = "absent"
    tolerance: float = Accuracy().tolerance
    receiver: KnownReceiver | None = None

    def __post_init__(self) -> None:
        Accuracy(self.tolerance)
        check_grid(self.slopes_deg, self.azimuths_deg)
        if self.shots < 2:
            raise RefusedInput(f"{self.shots} shots of an echo: at least 2 are needed")
        if self.dark_windows < 1:
            raise RefusedInput(f"{self.dark_windows} dark windows a code: at least 1 is needed")


@dataclass(frozen=True, slots=True)
class ShapeCase:
    """One echo of the plan.

    Parameters
    ----------
    name : str
        Of its scene and ground, or of a recorded pulse.
    gain_code : int or None
        Of its windows.
    sample_count : int
        Of each window.
    delay_s : float
        From the trigger to the first sample, s.
    members : tuple of int
        Indexes of its shots; none where it cannot be played.
    pulses : tuple of Playable
        One for all shots or one for each; empty for recorded windows, which hold what was played.
    status : str
        "ok", "no_pulse" where there is no light, "echo_too_faint" for this generator and attenuator, or
        "mixed_gain_codes".
    echo : Echo or None
        None for recorded windows.
    """

    name: str
    gain_code: int | None
    sample_count: int
    delay_s: float
    members: tuple[int, ...]
    pulses: tuple[Playable, ...] = ()
    status: ShapeStatus = "ok"
    echo: Echo | None = None

    def pulse_of(self, place: int) -> Playable | None:
        """Return the pulse of a member by its place among them; None for recorded windows."""
        return self.pulses[place % len(self.pulses)] if self.pulses else None


@dataclass(frozen=True, slots=True)
class PulseShapePlan:
    """Every shot of a campaign: silent windows of each gain code, then echo by echo.

    Parameters
    ----------
    cases : tuple of ShapeCase
        Echoes.
    dark : tuple of (int or None, tuple of int)
        Gain codes with the indexes of their silent windows.
    dark_samples : int
        Of a silent window.
    converters, bits : int
        Of the receiver.
    shot_noise : {"absent", "inside"}
        As in the options.
    receiver : KnownReceiver or None
        As in the options.
    advised_db : float or None
        Attenuation that would serve all echoes; None where no single one does, or nothing is known of the
        generator.
    """

    cases: tuple[ShapeCase, ...]
    dark: tuple[tuple[int | None, tuple[int, ...]], ...]
    dark_samples: int
    converters: int
    bits: int
    shot_noise: Literal["absent", "inside"]
    receiver: KnownReceiver | None = None
    advised_db: float | None = None

    @property
    def shots(self) -> tuple[PlannedShot, ...]:
        """In the order of their indexes; only echoes that can be played have any."""
        found = [
            PlannedShot(WindowRequest(shot, code, self.dark_samples), NoSignal())
            for code, members in self.dark
            for shot in members
        ]
        for case in self.cases:
            for place, shot in enumerate(case.members):
                pulse = case.pulse_of(place)
                assert pulse is not None
                request = WindowRequest(shot, case.gain_code, case.sample_count, case.delay_s)
                found.append(PlannedShot(request, pulse.stimulus))
        return tuple(found)

    def as_json(self) -> dict[str, Any]:
        """Return the plan as plain values, for the run's fingerprint; of pulses their digest."""
        cases = [
            {
                "name": case.name,
                "gain_code": case.gain_code,
                "sample_count": case.sample_count,
                "delay_s": case.delay_s,
                "members": list(case.members),
                "pulses": [_digest(one.stimulus) for one in case.pulses],
                "status": case.status,
            }
            for case in self.cases
        ]
        known = None if self.receiver is None else asdict(self.receiver)
        return {
            "cases": cases,
            "dark": [[code, list(members)] for code, members in self.dark],
            "dark_samples": self.dark_samples,
            "shot_noise": self.shot_noise,
            "receiver": known,
        }


def _digest(pulse: SampledPulse) -> str:
    words = f"{pulse.sample_rate_hz!r} {pulse.start_s!r} {pulse.interpolation} {pulse.poles!r}"
    return hashlib.sha256(pulse.volts.tobytes() + words.encode()).hexdigest()


def plan(bench: Bench, options: PulseShapeOptions) -> PulseShapePlan:
    """Compute the echoes and fit them to what this bench can play.

    Raises
    ------
    RefusedInput
        No scene; a scene for another receiver, or of which nothing can be computed; echoes of which none can
        be played, with the attenuator that would serve.
    """
    if not options.scenes:
        raise RefusedInput("pulse-shape: name at least one SCENE, or recorded windows with --windows FILE")
    config, model, spec = bench.config, bench.generator_model, bench.spec
    found = echoes(
        options.scenes,
        options.slopes_deg,
        options.azimuths_deg,
        shots=options.shots,
        shot_noise=options.shot_noise == "inside",
        tolerance=options.tolerance,
        gain_code=options.gain_code,
        receiver=config.digitizer.receiver,
    )
    lit = [echo for echo in found if echo.wished]
    strong = [echo for echo in lit if not any(is_too_faint(one, model, config) for one in echo.wished)]
    if not lit:
        raise RefusedInput(f"scene {found[0].name}: no light comes back, there is nothing to play")
    if not strong:
        check_not_too_faint([one for echo in lit for one in echo.wished], model, config)
    late_s = trigger_late_s(config)
    codes = tuple(dict.fromkeys(echo.gain_code for echo in strong))
    dark = tuple(
        (code, tuple(range(row * options.dark_windows, (row + 1) * options.dark_windows)))
        for row, code in enumerate(codes)
    )
    known = options.receiver or preset_receiver(config)
    for code in codes:
        known.at(code)
    cases, shot = [], len(codes) * options.dark_windows
    for echo in found:
        status: ShapeStatus = "ok" if echo in strong else "echo_too_faint" if echo.wished else "no_pulse"
        count = options.shots if status == "ok" else 0
        pulses = tuple(playable(one, model, config) for one in echo.wished) if count else ()
        members = tuple(range(shot, shot + count))
        # The window lies where the echo is: the receiver's trigger may come later than the generator's.
        delay_s = max(0.0, echo.delay_s - late_s)
        cases.append(
            ShapeCase(echo.name, echo.gain_code, echo.sample_count, delay_s, members, pulses, status, echo)
        )
        shot += count
    made = PulseShapePlan(
        cases=tuple(cases),
        dark=dark,
        dark_samples=window_length(spec),
        converters=spec.converters,
        bits=spec.bits,
        shot_noise=options.shot_noise,
        receiver=options.receiver,
        advised_db=advised_attenuation_db(
            [largest_volts(one) for echo in lit for one in echo.wished], model, config
        ),
    )
    check_all(bench, made.shots)
    return made


def trigger_late_s(config: BenchConfig) -> float:
    """Return when the receiver's trigger comes on the time axis of a pulse, as the bench file has it, s."""
    return config.bench.trigger_delay_s * (1 if config.bench.trigger == "generator" else -1)


def recorded_plan(recorded: RecordedWindows, options: PulseShapeOptions) -> PulseShapePlan:
    """Return the plan of a file: its silent windows, and its pulses as played.

    Raises
    ------
    RefusedInput
        Scenes beside the file, which holds the pulses itself; or a file without any window of a pulse.
    """
    if options.scenes:
        raise RefusedInput(
            f"--windows {recorded.path}: the file holds the pulses that were played; leave out SCENE"
        )
    columns = recorded.columns
    codes = [None if code < 0 else int(code) for code in columns["gain_code"]]
    counts = [int(count) for count in columns["sample_count"]]
    dark: dict[int | None, list[int]] = {}
    pulses: dict[SampledPulse | None, list[int]] = {}
    for place in range(len(recorded)):
        stimulus = recorded.played(place)
        if isinstance(stimulus, NoSignal):
            dark.setdefault(codes[place], []).append(place)
        elif isinstance(stimulus, SampledPulse) and counts[place]:
            pulses.setdefault(None if options.shot_noise == "inside" else stimulus, []).append(place)
    if not pulses:
        raise RefusedInput(f"--windows {recorded.path}: holds no window of a sampled pulse")
    cases = []
    for number, members in enumerate(pulses.values(), start=1):
        mixed = len({codes[place] for place in members}) > 1
        cases.append(
            ShapeCase(
                name=f"pulse {number}",
                gain_code=codes[members[0]],
                sample_count=min(counts[place] for place in members),
                delay_s=float(columns["start_s"][members[0]]),
                members=tuple(members),
                status="mixed_gain_codes" if mixed else "ok",
            )
        )
    return PulseShapePlan(
        cases=tuple(cases),
        dark=tuple((code, tuple(places)) for code, places in dark.items()),
        dark_samples=max((counts[place] for places in dark.values() for place in places), default=0),
        converters=recorded.spec.converters,
        bits=recorded.spec.bits,
        shot_noise=options.shot_noise,
        receiver=options.receiver,
    )


def measure(
    bench: Bench, run: Journal, plan: PulseShapePlan, progress: Callable[[int, int], None] | None = None
) -> None:
    """Measure what the run does not hold yet; see `procedures.plans.measure_all`."""
    measure_all(bench, run, plan.shots, progress)


def analyse(plan: PulseShapePlan, shots: Iterable[Shot], config: BenchConfig) -> Outcome:
    """Compare the windows of every echo with its prediction.

    Parameters
    ----------
    plan : PulseShapePlan
        What was measured.
    shots : iterable of Shot
        In any order; those that no case and no gain code names are left alone.
    config : BenchConfig
        Attenuation, declared uncertainties, trigger, and the receiver's preset.
    """
    from procedures.pulse_shape_outcome import outcome
    from procedures.pulse_shape_results import compared

    return outcome(plan, compared(plan, shots, config), config)
