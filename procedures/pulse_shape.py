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

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from belahil.errors import RefusedInput
from belahil.stimuli import Interpolation, NoSignal, SampledPulse, largest_volts
from procedures.known_receiver import KnownReceiver, preset_receiver, refuse_other
from procedures.noise import window_length
from procedures.plans import Journal, check_all, measure_all
from procedures.playable import advised_attenuation_db, check_not_too_faint, is_too_faint, playable
from procedures.pulse_echoes import Echo, NamedScene, check_grid, echoes
from procedures.pulse_shape_plan import PulseShapePlan, ShapeCase, ShapeStatus, trigger_late_s
from sim.accuracy import Accuracy

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from belahil.bench import Bench
    from belahil.config import BenchConfig
    from belahil.outcome import Outcome
    from belahil.recorded import RecordedWindows
    from belahil.values import Shot

SHOTS, DARK_WINDOWS = 200, 16


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
    interpolation : {"linear", "hold"}
        What the generator makes of its points: straight lines or steps.
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
    interpolation: Interpolation = "linear"
    tolerance: float = Accuracy().tolerance
    receiver: KnownReceiver | None = None

    def __post_init__(self) -> None:
        Accuracy(self.tolerance)
        check_grid(self.slopes_deg, self.azimuths_deg)
        if self.shots < 2:
            raise RefusedInput(f"{self.shots} shots of an echo: at least 2 are needed")
        if self.dark_windows < 1:
            raise RefusedInput(f"{self.dark_windows} dark windows a code: at least 1 is needed")


def plan(bench: Bench, options: PulseShapeOptions) -> PulseShapePlan:
    """Compute the echoes and fit them to what this bench can play.

    Raises
    ------
    RefusedInput
        No scene; a scene for another receiver, or of which nothing can be computed; echoes of which none can
        be played, with the attenuator that would serve; a known receiver that is another one.
    """
    if not options.scenes:
        raise RefusedInput("pulse-shape: name at least one SCENE, or recorded windows with --windows FILE")
    config, model, spec = bench.config, bench.generator_model, bench.spec
    refuse_other(options.receiver, spec, "the receiver on the bench")
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
    peaks_v = [largest_volts(one) for echo in found for one in echo.wished]
    if not peaks_v:
        raise RefusedInput(f"scene {found[0].name}: no light comes back, there is nothing to play")
    cases = _cases(found, bench, options)
    if all(case.status != "ok" for case in cases):
        check_not_too_faint([one for echo in found for one in echo.wished], model, config)
    codes = tuple(dict.fromkeys(case.gain_code for case in cases if case.pulses))
    known = options.receiver or preset_receiver(config)
    for code in codes:
        known.at(code)
    made = PulseShapePlan(
        cases=cases,
        dark=tuple(
            (code, tuple(range(row * options.dark_windows, (row + 1) * options.dark_windows)))
            for row, code in enumerate(codes)
        ),
        dark_samples=window_length(spec),
        converters=spec.converters,
        bits=spec.bits,
        shot_noise=options.shot_noise,
        receiver=options.receiver,
        advised_db=advised_attenuation_db(peaks_v, model, config),
    )
    check_all(bench, made.shots)
    return made


def _cases(found: Sequence[Echo], bench: Bench, options: PulseShapeOptions) -> tuple[ShapeCase, ...]:
    """Turn echoes into cases, with shots for those that can be played; silent windows come before them."""
    config, model = bench.config, bench.generator_model
    statuses = [_status(echo, bench) for echo in found]
    codes = {echo.gain_code for echo, status in zip(found, statuses, strict=True) if status == "ok"}
    shot = len(codes) * options.dark_windows
    cases = []
    for echo, status in zip(found, statuses, strict=True):
        wished = echo.wished if status == "ok" else ()
        members = tuple(range(shot, shot + options.shots)) if wished else ()
        pulses = tuple(playable(one, model, config, options.interpolation) for one in wished)
        # The window lies where the echo is: the receiver's trigger may come later than the generator's.
        delay_s = max(0.0, echo.delay_s - trigger_late_s(config))
        cases.append(
            ShapeCase(echo.name, echo.gain_code, echo.sample_count, delay_s, members, pulses, status, echo)
        )
        shot += len(members)
    return tuple(cases)


def _status(echo: Echo, bench: Bench) -> ShapeStatus:
    if not echo.wished:
        return "no_pulse"
    faint = any(is_too_faint(one, bench.generator_model, bench.config) for one in echo.wished)
    return "echo_too_faint" if faint else "ok"


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
