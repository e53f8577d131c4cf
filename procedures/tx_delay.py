"""Find which part of the transmitted pulse the fibre loses, and the delay of the pulse that is detected.

The generator is silent, and the receiver is gated on its own shot pulse, which fires the laser. Where the
pulse lies between two samples is random. The shape before the fibre is taken as known; the threshold below
which light is lost is found by the likelihood of every window with an amplitude and an arrival of its own
(`procedures.tx_likelihood`), and compared with other things that the fibre might do
(`procedures.tx_families`). Reconstruction in equivalent time is the picture, not the method: fitted to it, a
threshold comes out points too low.

Not modelled: a pulse whose shape changes from shot to shot, noise of the light, a receiver that depends on
the amplitude, interference that is locked to the shot, and what the modules of the parts leave out.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, get_args

from belahil.errors import RefusedInput
from belahil.outcome import Outcome
from belahil.receiver import receiver_preset
from belahil.stimuli import TransmittedPulse
from belahil.values import Shot, WindowRequest
from procedures.known_receiver import KnownReceiver, preset_receiver, refuse_other
from procedures.plans import Journal, PlannedShot, check_all, measure_all, usual_code
from procedures.tx_definitions import DEFINITIONS, Definition
from procedures.tx_likelihood import Baseline
from procedures.tx_pulse import KnownPulse

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from belahil.bench import Bench
    from belahil.config import BenchConfig
    from belahil.recorded import RecordedWindows

SHOTS = 200
SAMPLES = 160
"""2 microseconds at 80 MHz: the pulse, some 30 samples of noise before it, and room for its delay."""

FWHM_S, TAIL_S = 5.4e-9, 3.0e-9
"""Assumed, as in ``[emulation.transmitter]``: no measurement of the pulse before the fibre is published."""
SCALE_RELATIVE, SHAPE_RELATIVE = 0.05, 0.03
"""Assumed standard uncertainties of a measured pulse: time scales of fall and rise, and power at any time."""


@dataclass(frozen=True, slots=True)
class TxDelayOptions:
    """What the user may choose.

    Parameters
    ----------
    shots : int
        Windows of the transmitted pulse, at least two.
    code : int or None
        Gain code; None takes 4 where the receiver has it, else its first.
    sample_count : int
        Samples of a window.
    delay_s : float
        From the shot pulse to the first sample, s; not negative.
    pulse_fwhm_s, pulse_tail_s : float
        The pulse before the fibre: a Gaussian convolved with a one-sided exponential, s.
    pulse_table : str
        Instead: a file of time in s and relative power, a row each.
    fall_uncertainty, rise_uncertainty, shape_uncertainty : float
        What is not known of it, as in `procedures.tx_pulse.KnownPulse`.
    definition : str
        Of the delay that stands for the result.
    baseline : {"common", "window"}
        One level for all windows of a converter, or a free one in each window, which costs information.
    receiver : KnownReceiver or None
        What is known of the receiver; None: the preset of the bench file.
    """

    shots: int = SHOTS
    code: int | None = None
    sample_count: int = SAMPLES
    delay_s: float = 0.0
    pulse_fwhm_s: float = FWHM_S
    pulse_tail_s: float = TAIL_S
    pulse_table: str = ""
    fall_uncertainty: float = SCALE_RELATIVE
    rise_uncertainty: float = SCALE_RELATIVE
    shape_uncertainty: float = SHAPE_RELATIVE
    definition: Definition = DEFINITIONS[0]
    baseline: Baseline = "common"
    receiver: KnownReceiver | None = None

    def __post_init__(self) -> None:
        if self.shots < 2:
            raise RefusedInput(f"{self.shots} shots: at least 2 are needed")
        if not 0 <= self.delay_s < 1:
            raise RefusedInput(f"a delay of {self.delay_s!r} s: 0 to below 1 s is allowed")
        for name, allowed in (("definition", DEFINITIONS), ("baseline", get_args(Baseline))):
            if getattr(self, name) not in allowed:
                raise RefusedInput(f"{name} {getattr(self, name)!r}: allowed: {', '.join(allowed)}")


@dataclass(frozen=True, slots=True)
class TxPlan:
    """Every shot, and what is assumed in their analysis.

    Parameters
    ----------
    code : int or None
        Gain code; of recorded windows that of the first.
    windows, sample_count : int
        Shots, and samples of each.
    delay_s : float
        From the shot pulse to the first sample, s.
    bits : int
        Resolution of the converters.
    sample_interval_s : float
        Nominal, s.
    pulse : KnownPulse
        Before the fibre.
    definition, baseline, receiver
        As in `TxDelayOptions`.
    """

    code: int | None
    windows: int
    sample_count: int
    delay_s: float
    bits: int
    sample_interval_s: float
    pulse: KnownPulse
    definition: Definition
    baseline: Baseline
    receiver: KnownReceiver | None

    @property
    def shots(self) -> tuple[PlannedShot, ...]:
        """One window after the other."""
        return tuple(
            PlannedShot(
                WindowRequest(shot, self.code, self.sample_count, self.delay_s, source="transmit"),
                TransmittedPulse(),
            )
            for shot in range(self.windows)
        )

    def as_json(self) -> dict[str, Any]:
        """Return the plan as plain values, for the run's fingerprint."""
        return asdict(self)


def plan(bench: Bench, options: TxDelayOptions) -> TxPlan:
    """Fit the options to what this bench can do.

    Raises
    ------
    LimitExceeded
        A gain code or a window that the receiver does not have, or one that its shot pulse cannot start.
    RefusedInput
        A gain code of which the characterization knows nothing, or a characterization of another receiver.
    ConfigError
        A table that cannot be used.
    """
    spec = bench.spec
    refuse_other(options.receiver, spec, "the receiver on the bench")
    code = usual_code(spec, options.code)
    if options.receiver is not None:
        # Before the laser fires: windows at another code could not be analysed.
        options.receiver.at(code)
    made = _plan(options, code, options.shots, options.sample_count, spec.bits, spec.sample_interval_s)
    check_all(bench, made.shots)
    return made


def recorded_plan(recorded: RecordedWindows, options: TxDelayOptions) -> TxPlan:
    """Take the windows of a transmitted pulse out of a data file.

    Raises
    ------
    RefusedInput
        The file has none, or none of the gain code that was asked for.
    """
    rows = [row for row in range(len(recorded)) if isinstance(recorded.played(row), TransmittedPulse)]
    asked = [recorded.request(row) for row in rows]
    if options.code is not None:
        asked = [one for one in asked if one.gain_code == options.code]
    if not asked:
        code = "" if options.code is None else f" at gain code {options.code}"
        raise RefusedInput(f"{recorded.path}: no window of a transmitted pulse{code}")
    spec = recorded.spec
    return _plan(options, options.code, len(asked), asked[0].sample_count, spec.bits, spec.sample_interval_s)


def _plan(
    options: TxDelayOptions, code: int | None, windows: int, samples: int, bits: int, interval_s: float
) -> TxPlan:
    return TxPlan(
        code=code,
        windows=windows,
        sample_count=samples,
        delay_s=options.delay_s,
        bits=bits,
        sample_interval_s=interval_s,
        pulse=KnownPulse.of(options),
        definition=options.definition,
        baseline=options.baseline,
        receiver=options.receiver,
    )


def measure(
    bench: Bench, run: Journal, plan: TxPlan, progress: Callable[[int, int], None] | None = None
) -> None:
    """Measure what the run does not hold yet; see `procedures.plans.measure_all`."""
    measure_all(bench, run, plan.shots, progress)


def analyse(plan: TxPlan, shots: Iterable[Shot], config: BenchConfig) -> Outcome:
    """Turn the recorded windows into results.

    Parameters
    ----------
    plan : TxPlan
        What was measured, and what is assumed.
    shots : iterable of Shot
        Those of other stimuli, and of another gain code than the plan's, are passed over.
    config : BenchConfig
        Names the preset of the receiver; ``[emulation]`` is not read.
    """
    from procedures.tx_analysis import analysed
    from procedures.tx_outcome import nothing_found, outcome
    from procedures.tx_windows import read_pulses

    receiver = plan.receiver or preset_receiver(config)
    own = (shot for shot in shots if plan.code is None or shot.window.gain_code == plan.code)
    found = read_pulses(own, plan.bits, plan.sample_interval_s, receiver, plan.pulse.pulse())
    if found.status != "ok":
        return nothing_found(found, plan, receiver)
    samples = receiver_preset(config.digitizer.receiver).correlation_window_samples
    return outcome(analysed(found, plan.pulse, receiver, plan.baseline, samples), found, plan, receiver)
