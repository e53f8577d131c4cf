"""Compare a receiver's range finder with ours: window by window, and by how well it sees weak echoes.

Does it find what ours finds in the same samples, and does it see echoes as often as it should? In each window
that came with its candidates, the search is repeated on the very samples and what was found is compared
candidate by candidate. And weak echoes behind a strong marker are played, many times each: how often they are
found, and how their arrival scatters, is compared with simulated windows of a receiver with the known filter,
gain and noise.

Not modelled: noise that is not stationary or not white before the filter, a receiver that is not linear, a
generator that jitters against itself. The modules of the two parts say what else they leave out.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.errors import LimitExceeded, RefusedInput
from belahil.oscilloscopes import SCOPES
from belahil.pole_response import response
from belahil.uncertainty import sized
from belahil.values import Products, WindowRequest
from procedures.candidate_parity import Tolerances
from procedures.gaussian_pulses import TrainPulse, earliest_centre_s, gaussian_train
from procedures.known_receiver import KnownReceiver, preset_receiver, refuse_other
from procedures.plans import Journal, PlannedShot, check_all, measure_all

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from belahil.bench import Bench
    from belahil.config import BenchConfig
    from belahil.outcome import Outcome
    from belahil.receiver import DigitizerSpec
    from belahil.recorded import RecordedWindows
    from belahil.stimuli import SampledPulse
    from belahil.values import Shot

WIDTHS_S = (30e-9, 60e-9)
SNRS = (2.5, 3.0, 4.0, 6.0, 10.0)
"""From seldom found to always."""
SHOTS = 100
MODEL_WINDOWS = 1000
MARKER_SNR = 40.0
"""High enough to tell where the echo must be; the flanks of a higher one take candidates of their own."""
APART_S = 3e-6
_LEAD_S = 1e-6
_BEHIND_S = 1e-6
PREFERRED: tuple[Products, ...] = ("window_and_candidates", "correlation_windows", "candidates", "window")


@dataclass(frozen=True, slots=True)
class ParityOptions:
    """What the user may choose.

    Parameters
    ----------
    receiver : KnownReceiver or None
        What is known of the receiver; None takes the preset of the bench file.
    code : int or None
        Gain code; None takes the one with the least noise at the input.
    widths_s : tuple of float
        Full widths at half maximum of the echoes at the cut, s.
    snrs : tuple of float
        Heights of the echoes behind the receiver's filter, over the rms of its noise.
    shots : int
        Windows for each echo, at least 2.
    samples : int or None
        Of a window; None takes the longest.
    marker_snr : float
        Height of the marker, likewise; above every echo's by a factor of two or more.
    model_windows : int
        Simulated windows for each echo, at least 100.
    tolerances : Tolerances
        Between candidates that count as the same.

    Raises
    ------
    RefusedInput
        Values outside these ranges.
    """

    receiver: KnownReceiver | None = None
    code: int | None = None
    widths_s: tuple[float, ...] = WIDTHS_S
    snrs: tuple[float, ...] = SNRS
    shots: int = SHOTS
    samples: int | None = None
    marker_snr: float = MARKER_SNR
    model_windows: int = MODEL_WINDOWS
    tolerances: Tolerances = field(default_factory=Tolerances)

    def __post_init__(self) -> None:
        if not self.widths_s or not self.snrs:
            raise RefusedInput("widths and signal-to-noise ratios: each list needs at least one value")
        if not all(0 < one < math.inf for one in (*self.widths_s, *self.snrs, self.marker_snr)):
            raise RefusedInput("widths and signal-to-noise ratios: all must be above zero and finite")
        if self.marker_snr < 2 * max(self.snrs):
            raise RefusedInput(
                f"a marker at {self.marker_snr:g} times the noise: at least twice the highest echo, "
                f"{2 * max(self.snrs):g}, is allowed"
            )
        if self.shots < 2 or self.model_windows < 100:
            raise RefusedInput(
                f"{self.shots} windows and {self.model_windows} simulated ones for each echo: at least 2 and "
                "100 are allowed"
            )


@dataclass(frozen=True)
class Echo:
    """A kind of echo that is played.

    Parameters
    ----------
    fwhm_s, snr : float
        Full width at the cut, s; height behind the filter over the rms of the noise.
    stimulus : SampledPulse
        Marker and echo, V at the cut.
    """

    fwhm_s: float
    snr: float
    stimulus: SampledPulse


@dataclass(frozen=True)
class ParityPlan:
    """Every shot of a comparison.

    Parameters
    ----------
    receiver : KnownReceiver or None
        What is known; None, for recorded windows, the preset of the bench file.
    code : int or None
        Gain code; None also for recorded windows, which tell their own.
    echoes : tuple of Echo
        What is played; none for recorded windows, whose played pulses tell.
    shots_each, sample_count, model_windows : int
        Windows for each echo, samples of a window, simulated windows for each echo.
    products : str
        What the receiver is asked for.
    tolerances : Tolerances
        Between candidates that count as the same.
    spec : DigitizerSpec
        Of the receiver that answers or answered.
    """

    receiver: KnownReceiver | None
    code: int | None
    echoes: tuple[Echo, ...]
    shots_each: int
    sample_count: int
    model_windows: int
    products: Products
    tolerances: Tolerances
    spec: DigitizerSpec

    @property
    def shots(self) -> tuple[PlannedShot, ...]:
        """All windows of an echo, then those of the next."""
        stimuli = [echo.stimulus for echo in self.echoes for _ in range(self.shots_each)]
        return tuple(
            PlannedShot(WindowRequest(shot, self.code, self.sample_count, products=self.products), stimulus)
            for shot, stimulus in enumerate(stimuli)
        )

    def as_json(self) -> dict[str, Any]:
        """Return the plan as plain values, for the run's fingerprint."""
        played = [
            {
                "fwhm_s": one.fwhm_s,
                "snr": one.snr,
                "peak_v": float(one.stimulus.volts.max()),
                "points": int(one.stimulus.volts.size),
            }
            for one in self.echoes
        ]
        names = ("receiver", "tolerances", "spec")
        values = {name: None if (one := getattr(self, name)) is None else asdict(one) for name in names}
        plain = ("code", "shots_each", "sample_count", "model_windows", "products")
        return {"echoes": played} | values | {name: getattr(self, name) for name in plain}


def plan(bench: Bench, options: ParityOptions) -> ParityPlan:
    """Fit the options to what this bench can do.

    Raises
    ------
    RefusedInput
        A gain code of which gain or noise are not known; pulses that do not fit into a window; a known
        receiver that is another one.
    LimitExceeded
        What generator or receiver cannot do; an oscilloscope, which reports no candidates.
    """
    spec = bench.spec
    driver = bench.config.digitizer.driver
    if driver in SCOPES:
        raise LimitExceeded(
            f"[digitizer] driver = {driver}: an oscilloscope reports no candidates to compare; "
            "needed is a receiver that searches its windows"
        )
    refuse_other(options.receiver, spec, "the receiver on the bench")
    receiver = options.receiver or preset_receiver(bench.config)
    code = _code(receiver, options.code)
    samples = options.samples or spec.max_sample_count
    # A window that the generator starts begins so much later; one that starts the generator, so much earlier.
    delay_s = bench.config.bench.trigger_delay_s
    window_s = delay_s if bench.config.bench.trigger == "generator" else -delay_s
    echoes = tuple(
        Echo(fwhm_s, snr, _train(bench, receiver, code, fwhm_s, snr, options.marker_snr, max(window_s, 0.0)))
        for fwhm_s in options.widths_s
        for snr in options.snrs
    )
    made = ParityPlan(
        receiver=receiver,
        code=code,
        echoes=echoes,
        shots_each=options.shots,
        sample_count=samples,
        model_windows=options.model_windows,
        products=next(one for one in PREFERRED if one in spec.products),
        tolerances=options.tolerances,
        spec=spec,
    )
    _check_length(made, window_s)
    check_all(bench, made.shots)
    return made


def recorded_plan(recorded: RecordedWindows, options: ParityOptions) -> ParityPlan:
    """Take all windows of a data file; which echoes there are, their played pulses tell.

    Raises
    ------
    RefusedInput
        A gain code was asked for.
    """
    if options.code is not None:
        raise RefusedInput(f"gain code {options.code}: recorded windows tell their own; leave it out")
    return ParityPlan(
        receiver=options.receiver,
        code=None,
        echoes=(),
        shots_each=0,
        sample_count=recorded.spec.max_sample_count,
        model_windows=options.model_windows,
        products="window",
        tolerances=options.tolerances,
        spec=recorded.spec,
    )


def measure(
    bench: Bench, run: Journal, plan: ParityPlan, progress: Callable[[int, int], None] | None = None
) -> None:
    """Measure what the run does not hold yet; see `procedures.plans.measure_all`."""
    measure_all(bench, run, plan.shots, progress)


def analyse(plan: ParityPlan, shots: Iterable[Shot], config: BenchConfig) -> Outcome:
    """Compare the recorded windows with our own range finder.

    Parameters
    ----------
    plan : ParityPlan
        What was measured.
    shots : iterable of Shot
        In the order of the plan.
    config : BenchConfig
        Names the receiver, and what is declared of the generator.
    """
    from procedures.rfm_parity_outcome import outcome
    from procedures.rfm_parity_results import found_in

    return outcome(found_in(plan, shots, config))


def _code(receiver: KnownReceiver, wanted: int | None) -> int | None:
    known = [one for one in receiver.codes if one.noise_rms is not None and one.noise_rms.value > 0]
    if wanted is not None:
        receiver.at(wanted)
        known = [one for one in known if one.code == wanted]
    if not known:
        raise RefusedInput(
            f"gain code {'any' if wanted is None else wanted}: {receiver.origin} knows no noise there, "
            "which the heights of the echoes are counted in"
        )
    quietest = min(known, key=lambda one: one.noise_rms.value / one.gain.value if one.noise_rms else math.inf)
    return quietest.code


def _train(
    bench: Bench,
    receiver: KnownReceiver,
    code: int | None,
    fwhm_s: float,
    snr: float,
    marker_snr: float,
    begin_s: float,
) -> SampledPulse:
    """Return marker and echo with these heights behind the receiver's filter."""
    model, known = bench.generator_model, receiver.at(code)
    assert known.noise_rms is not None
    first_s = begin_s + max(_LEAD_S, earliest_centre_s(fwhm_s, model))
    single = gaussian_train([TrainPulse(fwhm_s, 1.0, first_s)], model)
    times_s = single.start_s + np.arange(20 * single.volts.size) / (10 * single.sample_rate_hz)
    filtered = response(
        single.volts,
        single.sample_rate_hz,
        single.start_s,
        single.interpolation,
        receiver.poles,
        times_s,
        zeros=receiver.zeros,
    )
    noise_v = known.noise_rms.value / (known.gain.value * float(filtered.max()))
    pulses = [
        TrainPulse(fwhm_s, marker_snr * noise_v, first_s),
        TrainPulse(fwhm_s, snr * noise_v, first_s + APART_S),
    ]
    return gaussian_train(pulses, model)


def _check_length(plan: ParityPlan, window_s: float) -> None:
    lasts_s = plan.sample_count * plan.spec.sample_interval_s
    for one in plan.echoes:
        end_s = one.stimulus.start_s + one.stimulus.volts.size / one.stimulus.sample_rate_hz
        needed_s = end_s - window_s + _BEHIND_S
        if needed_s > lasts_s:
            raise LimitExceeded(
                f"windows of {plan.sample_count} samples last {sized(lasts_s, 's', 4)}: marker and echo of "
                f"{sized(one.fwhm_s, 's', 4)} take {sized(needed_s, 's', 4)}"
            )
