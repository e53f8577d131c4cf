"""Characterize a receiver by its gain codes: gain, cut-off, noise, best code.

The generator plays sines over gain codes, amplitudes and frequencies, and silence for the dark windows. The
analysis is a function of the recorded windows alone, so a run that was resumed, or read back years later,
gives the same numbers.

Not modelled: drift of gain or temperature during the sweep, harmonic distortion (see ``digitizer``), and any
difference between the filter of one gain code and another beyond a cut-off of its own.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from belahil.errors import RefusedInput
from belahil.outcome import Outcome
from belahil.stimuli import NoSignal, Sine, Stimulus
from belahil.uncertainty import sized
from belahil.values import Shot, WindowRequest
from procedures.coherent import default_frequencies
from procedures.dark_noise import LEAST_SAMPLES
from procedures.noise import gain_codes, window_length
from procedures.plans import Journal, PlannedShot, check_all, measure_all
from procedures.sine_fit import SinePlan

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from belahil.bench import Bench
    from belahil.config import BenchConfig
    from belahil.recorded import RecordedWindows

AMPLITUDES_VPP = (3e-3, 13e-3, 30e-3, 50e-3, 200e-3)
"""Default amplitudes at the cut, those of Nishiyama et al., appendix C."""

FREQUENCY_COUNT = 24
DARK_WINDOWS = 4


@dataclass(frozen=True, slots=True)
class GainOptions:
    """What the user may choose.

    Parameters
    ----------
    codes : tuple of int or None
        Gain codes; None takes all that the receiver reports.
    amplitudes_vpp : tuple of float
        At the cut, V peak to peak.
    frequencies_hz : tuple of float or None
        None takes 24 coherent ones from 0.1 MHz to 38 MHz or the generator's limit.
    dark_windows : int
        Silent windows for each gain code, at least one.
    """

    codes: tuple[int, ...] | None = None
    amplitudes_vpp: tuple[float, ...] = AMPLITUDES_VPP
    frequencies_hz: tuple[float, ...] | None = None
    dark_windows: int = DARK_WINDOWS

    def __post_init__(self) -> None:
        if self.codes == () or not self.amplitudes_vpp or self.frequencies_hz == ():
            raise RefusedInput("gain codes, amplitudes and frequencies: each list needs at least one value")
        if self.dark_windows < 1:
            raise RefusedInput(f"{self.dark_windows} dark windows a code: at least 1 is needed")


@dataclass(frozen=True, slots=True)
class GainPlan:
    """Every shot of a characterization.

    Parameters
    ----------
    codes : tuple of (int or None)
        Gain codes; a single None for a receiver without them.
    amplitudes_vpp, frequencies_hz : tuple of float
        Volts at the cut, Hz.
    dark_windows, sample_count, converters, bits : int
        Windows a code, samples a window, interleaved converters and their resolution.
    recorded : tuple of (shot, code, frequency_hz, amplitude_vpp)
        Of windows that were not measured but read from a file; amplitude 0 for silence.
    """

    codes: tuple[int | None, ...]
    amplitudes_vpp: tuple[float, ...]
    frequencies_hz: tuple[float, ...]
    dark_windows: int
    sample_count: int
    converters: int
    bits: int
    recorded: tuple[tuple[int, int | None, float, float], ...] = ()

    @property
    def shots(self) -> tuple[PlannedShot, ...]:
        """Dark windows first, then the sines with the gain code changing fastest; or what was recorded."""
        if self.recorded:
            return tuple(
                PlannedShot(
                    WindowRequest(shot, code, self.sample_count),
                    Sine(frequency_hz, amplitude_vpp) if amplitude_vpp else NoSignal(),
                )
                for shot, code, frequency_hz, amplitude_vpp in self.recorded
            )
        stimuli: list[tuple[Stimulus, int | None]] = [
            (NoSignal(), code) for code in self.codes for _ in range(self.dark_windows)
        ]
        for amplitude_vpp in self.amplitudes_vpp:
            for frequency_hz in self.frequencies_hz:
                sine = Sine(frequency_hz, amplitude_vpp)
                stimuli += [(sine, code) for code in self.codes]
        return tuple(
            PlannedShot(WindowRequest(shot, code, self.sample_count), stimulus)
            for shot, (stimulus, code) in enumerate(stimuli)
        )

    def as_json(self) -> dict[str, Any]:
        """Return the plan as plain values, for the run's fingerprint."""
        return asdict(self)


def plan(bench: Bench, options: GainOptions) -> GainPlan:
    """Fit the options to what this bench can do.

    Raises
    ------
    LimitExceeded
        A gain code, frequency or amplitude that receiver or generator does not have, or a receiver whose
        windows are too short.
    InterlockRefused
        An amplitude over ``max_vpp``.
    RefusedInput
        Fewer than two frequencies at which a sine can be measured.
    """
    spec = bench.spec
    sample_count = window_length(spec)
    frequencies = options.frequencies_hz
    if frequencies is None:
        frequencies = default_frequencies(
            spec.sample_rate_hz, sample_count, bench.generator_model.max_sine_hz, FREQUENCY_COUNT
        )
    made = GainPlan(
        codes=gain_codes(spec.gain_codes, options.codes),
        amplitudes_vpp=tuple(dict.fromkeys(options.amplitudes_vpp)),
        frequencies_hz=tuple(dict.fromkeys(frequencies)),
        dark_windows=options.dark_windows,
        sample_count=sample_count,
        converters=spec.converters,
        bits=spec.bits,
    )
    check_all(bench, made.shots)
    _refuse_unmeasurable(made, spec.sample_rate_hz)
    return made


def recorded_plan(recorded: RecordedWindows, options: GainOptions) -> GainPlan:
    """Take the sines and the silent windows of a data file, at the wanted gain codes or at all that it has.

    Raises
    ------
    RefusedInput
        A gain code without a sine or without silence, windows of several lengths, too short ones, or fewer
        than two frequencies at which a sine can be measured.
    """
    found = []
    for row in range(len(recorded)):
        played, request = recorded.played(row), recorded.request(row)
        if options.codes is not None and request.gain_code not in options.codes:
            continue
        if isinstance(played, NoSignal) and request.trigger == "immediate":
            found.append((row, request.gain_code, 0.0, 0.0, request.sample_count))
        elif isinstance(played, Sine):
            # Generators round: what was meant to be one amplitude is one to three digits.
            amplitude_vpp = float(f"{played.amplitude_vpp:.3g}")
            found.append((row, request.gain_code, played.frequency_hz, amplitude_vpp, request.sample_count))
    codes = tuple(dict.fromkeys(code for _, code, _, _, _ in found))
    for kind, there in (
        ("a sine", {code for _, code, _, volts, _ in found if volts}),
        ("silence", {code for _, code, _, volts, _ in found if not volts}),
    ):
        lacking = [code for code in (options.codes or codes or (None,)) if code not in there]
        if lacking:
            told = ", ".join(str(code) for code in lacking if code is not None)
            where = told and f" at gain code {told}"
            raise RefusedInput(
                f"{recorded.path}: no window with {kind}{where}; needed are windows of belahil characterize"
            )
    lengths = sorted({count for _, _, _, _, count in found})
    if len(lengths) > 1 or lengths[0] < LEAST_SAMPLES:
        raise RefusedInput(
            f"{recorded.path}: windows of {lengths[0]} to {lengths[-1]} samples: they must be of one length, "
            f"at least {LEAST_SAMPLES}"
        )
    spec = recorded.spec
    made = GainPlan(
        codes=codes,
        amplitudes_vpp=tuple(sorted({volts for _, _, _, volts, _ in found if volts})),
        frequencies_hz=tuple(sorted({hz for _, _, hz, volts, _ in found if volts})),
        dark_windows=sum(not volts for _, _, _, volts, _ in found) // len(codes),
        sample_count=lengths[0],
        converters=spec.converters,
        bits=spec.bits,
        recorded=tuple(one[:4] for one in found),
    )
    _refuse_unmeasurable(made, spec.sample_rate_hz)
    return made


def _refuse_unmeasurable(plan: GainPlan, rate_hz: float) -> None:
    """Refuse a sweep that can give no gain: it needs two frequencies, and some can never be measured."""
    measurable = 0
    for frequency_hz in plan.frequencies_hz:
        sine = SinePlan(frequency_hz, rate_hz, plan.sample_count, plan.converters == 2)
        measurable += sine.foreseen == "ok"
        if measurable == 2:
            return
    step, half_hz = (4 if plan.converters == 2 else 2), rate_hz / plan.sample_count / 2
    told = ", ".join(f"{one / 1e6:g}" for one in plan.frequencies_hz)
    raise RefusedInput(
        f"frequencies {told} MHz: {measurable} of them can be measured, a gain needs 2; allowed: at least "
        f"{sized(half_hz, 'Hz', 3)} away from 0 and not a multiple of fs/{step} = "
        f"{rate_hz / step / 1e6:g} MHz"
    )


def measure(
    bench: Bench, run: Journal, plan: GainPlan, progress: Callable[[int, int], None] | None = None
) -> None:
    """Measure what the run does not hold yet; see `procedures.plans.measure_all`."""
    measure_all(bench, run, plan.shots, progress)


def analyse(plan: GainPlan, shots: Iterable[Shot], config: BenchConfig) -> Outcome:
    """Turn the recorded windows into results.

    Parameters
    ----------
    plan : GainPlan
        What was measured.
    shots : iterable of Shot
        Gone through more than once; an iterator is turned into a list first.
    config : BenchConfig
        Attenuation, load and declared uncertainties; ``[emulation]`` is not read.

    Returns
    -------
    Outcome
        Results as the contract names them, tables, figures and the uncertainty budget.
    """
    from procedures.gain_outcome import outcome
    from procedures.gain_points import read_windows

    return outcome(plan, read_windows(plan, shots), config)
