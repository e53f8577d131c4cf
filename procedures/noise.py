"""Measure the noise of a silent receiver at each gain code, with the laser off and with it firing.

The generator plays 0 V with its output on, so the receiver sees its source resistance. Half of the windows
start at once; the others with the receiver's shot pulse, which fires the laser, so that its interference is
in them. Divided by the gains of a known receiver the noise tells the best code.

Not modelled: noise that drifts during the measurement, bursts whose size or time changes from shot to shot,
and lines whose frequency moves.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

from belahil.errors import LimitExceeded, RefusedInput
from belahil.stimuli import NoSignal
from belahil.values import Shot, WindowRequest
from procedures.dark_noise import LEAST_SAMPLES
from procedures.known_receiver import KnownReceiver, refuse_other
from procedures.plans import Journal, PlannedShot, check_all, measure_all

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from belahil.bench import Bench
    from belahil.config import BenchConfig
    from belahil.outcome import Outcome
    from belahil.receiver import DigitizerSpec
    from belahil.recorded import RecordedWindows

DARK_WINDOWS = 16


@dataclass(frozen=True, slots=True)
class NoiseOptions:
    """What the user may choose.

    Parameters
    ----------
    codes : tuple of int or None
        Gain codes; None takes all that the receiver reports.
    dark_windows : int
        Silent windows for each gain code and condition, at least one.
    laser : {"off", "both"} or None
        "both": as many windows again that start with the receiver's shot pulse, which fires the laser. None:
        both where the receiver has such a trigger.
    receiver : KnownReceiver or None
        Whose gains refer the noise to the input; None: the preset.
    """

    codes: tuple[int, ...] | None = None
    dark_windows: int = DARK_WINDOWS
    laser: Literal["off", "both"] | None = None
    receiver: KnownReceiver | None = None

    def __post_init__(self) -> None:
        if self.codes == ():
            raise RefusedInput("gain codes: at least one is needed")
        if self.dark_windows < 1:
            raise RefusedInput(f"{self.dark_windows} dark windows a code: at least 1 is needed")


@dataclass(frozen=True, slots=True)
class NoisePlan:
    """Every shot of a noise measurement.

    Parameters
    ----------
    codes : tuple of (int or None)
        Gain codes; a single None for a receiver without them.
    windows : tuple of (shot, code, firing)
        Index, gain code, and whether the receiver's shot pulse starts the window and fires the laser.
    sample_count, converters, bits : int
        Samples a window, interleaved converters and their resolution.
    receiver : KnownReceiver or None
        As in the options.
    """

    codes: tuple[int | None, ...]
    windows: tuple[tuple[int, int | None, bool], ...]
    sample_count: int
    converters: int
    bits: int
    receiver: KnownReceiver | None = None

    @property
    def shots(self) -> tuple[PlannedShot, ...]:
        """All windows of a code, first those with the laser off, then those of the next."""
        return tuple(
            PlannedShot(
                WindowRequest(shot, code, self.sample_count, trigger="digitizer" if firing else "immediate"),
                NoSignal(),
            )
            for shot, code, firing in self.windows
        )

    def as_json(self) -> dict[str, Any]:
        """Return the plan as plain values, for the run's fingerprint."""
        return asdict(self)


def plan(bench: Bench, options: NoiseOptions) -> NoisePlan:
    """Fit the options to what this bench can do.

    Raises
    ------
    LimitExceeded
        A gain code or a trigger that the receiver does not have, or a receiver whose windows are too short.
    RefusedInput
        The known receiver is another one.
    """
    spec = bench.spec
    refuse_other(options.receiver, spec, "the receiver on the bench")
    codes = gain_codes(spec.gain_codes, options.codes)
    fires = options.laser == "both" or (options.laser is None and "digitizer" in spec.triggers)
    conditions = [False] * options.dark_windows + [True] * (options.dark_windows if fires else 0)
    wanted = [(code, firing) for code in codes for firing in conditions]
    made = NoisePlan(
        codes=codes,
        windows=tuple((shot, code, firing) for shot, (code, firing) in enumerate(wanted)),
        sample_count=window_length(spec),
        converters=spec.converters,
        bits=spec.bits,
        receiver=options.receiver,
    )
    check_all(bench, made.shots)
    return made


def recorded_plan(recorded: RecordedWindows, options: NoiseOptions) -> NoisePlan:
    """Take the silent windows of a data file, at the wanted gain codes or at all that it has.

    Raises
    ------
    RefusedInput
        It has none at a code that is wanted, none with the laser off, windows of several lengths, or windows
        of a receiver that is not the known one.
    LimitExceeded
        They are too short.
    """
    silent = [row for row in range(len(recorded)) if isinstance(recorded.played(row), NoSignal)]
    there = {row: recorded.request(row) for row in silent}
    codes = tuple(dict.fromkeys(one.gain_code for one in there.values()))
    wanted = codes if options.codes is None else tuple(dict.fromkeys(options.codes))
    windows = tuple(
        (row, one.gain_code, one.trigger == "digitizer")
        for row, one in there.items()
        if one.gain_code in wanted and not (options.laser == "off" and one.trigger == "digitizer")
    )
    missing = [code for code in wanted if (code, False) not in {one[1:] for one in windows}]
    if missing or not codes:
        told = ", ".join(str(code) for code in missing if code is not None)
        where = told and f" at gain code {told}"
        raise RefusedInput(
            f"{recorded.path}: no window without a signal{where}; needed are dark windows with the laser off"
        )
    lengths = {there[row].sample_count for row, _, _ in windows}
    if min(lengths) < LEAST_SAMPLES:
        raise LimitExceeded(
            f"{recorded.path}: windows of {min(lengths)} samples: at least {LEAST_SAMPLES} are needed"
        )
    if len(lengths) > 1:
        raise RefusedInput(
            f"{recorded.path}: silent windows of {sorted(lengths)} samples: must be of one length"
        )
    spec, known = recorded.spec, options.receiver
    refuse_other(known, spec, str(recorded.path))
    return NoisePlan(wanted, windows, lengths.pop(), spec.converters, spec.bits, known)


def gain_codes(known: tuple[int, ...] | None, wanted: tuple[int, ...] | None) -> tuple[int | None, ...]:
    """Return the gain codes to measure: the wanted ones, all known ones, or a single None.

    Raises
    ------
    LimitExceeded
        Codes were asked of a receiver without them.
    """
    if known is None:
        if wanted is not None:
            raise LimitExceeded(f"gain codes {', '.join(map(str, wanted))}: this receiver has no gain codes")
        return (None,)
    return tuple(dict.fromkeys(known if wanted is None else wanted))


def window_length(spec: DigitizerSpec) -> int:
    """Return how many samples to ask for: the receiver's longest window.

    Raises
    ------
    LimitExceeded
        That is too short for a noise spectrum.
    """
    if spec.max_sample_count < LEAST_SAMPLES:
        raise LimitExceeded(
            f"the receiver's longest window has {spec.max_sample_count} samples: "
            f"at least {LEAST_SAMPLES} are needed"
        )
    return spec.max_sample_count


def measure(
    bench: Bench, run: Journal, plan: NoisePlan, progress: Callable[[int, int], None] | None = None
) -> None:
    """Measure what the run does not hold yet; see `procedures.plans.measure_all`."""
    measure_all(bench, run, plan.shots, progress)


def analyse(plan: NoisePlan, shots: Iterable[Shot], config: BenchConfig) -> Outcome:
    """Turn the recorded windows into results.

    Parameters
    ----------
    plan : NoisePlan
        What was measured.
    shots : iterable of Shot
        In any order.
    config : BenchConfig
        The preset of the receiver, where the plan knows none; ``[emulation]`` is not read.
    """
    from procedures.known_receiver import preset_receiver
    from procedures.noise_outcome import outcome
    from procedures.noise_results import noise_results

    known = plan.receiver or preset_receiver(config)
    return outcome(plan, noise_results(plan, shots, known), known)


def noise_note(converters: int) -> str:
    """Say what the two noises of a receiver with so many converters are."""
    taken_out = (
        "quantization and the converter's offset are"
        if converters == 1
        else "quantization, the converters' offsets and the interleave line are"
    )
    return (
        f"noise_rms is the analog noise at the converter; {taken_out} taken out. "
        "noise_rms_total is the raw value."
    )
