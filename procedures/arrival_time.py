"""Delay of the detected arrival of a pulse against its detected width.

A fitted Gaussian comes later behind a receiver's filter when its pulse is narrow than when it is wide. The
curve of that is found three times: from the model of the receiver, by playing pulses of known width into the
receiver, and over footprints of terrain whose echoes are not Gaussian. The published correction polynomial is
compared with all three.

What a bench cannot tell: what is common to pulses of all widths, but for what the bench file says of the
trigger; see `procedures.arrival_points`.

Not modelled: what `procedures.arrival_footprints` leaves out; jitter of the generator; behaviour of the
receiver that is not linear, and mismatch of its converters in gain and sampling time (offsets are removed),
of which the comb takes the mean.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from belahil.errors import LimitExceeded, RefusedInput
from belahil.stimuli import SampledPulse
from belahil.values import WindowRequest
from procedures.arrival_comb import PulseComb, comb_spacing_s, played_comb
from procedures.arrival_fit import window_shape
from procedures.arrival_ground import grounds
from procedures.arrival_points import FEWEST_WINDOWS
from procedures.gaussian_pulses import earliest_centre_s
from procedures.known_receiver import KnownReceiver, preset_receiver, refuse_other
from procedures.plans import Journal, PlannedShot, check_all, measure_all, usual_code
from sim.filter_delay import spread_widths_s

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from belahil.bench import Bench
    from belahil.config import BenchConfig
    from belahil.generator_models import GeneratorModel
    from belahil.outcome import Outcome
    from belahil.recorded import RecordedWindows
    from belahil.values import Shot

WIDTHS = 14
WINDOWS = 20
FOOTPRINTS = 12
TESTS = 8
REFERENCE_S = 60e-9
"""Width of the reference pulses: so wide that their arrival does not depend on where samples lie."""

PEAK_V = 0.1
_HALF_USED = 0.5
"""Of what the converter can take: no pulse is higher where the user says nothing."""
_MOST_PER_SIDE = 500


@dataclass(frozen=True, slots=True)
class ArrivalOptions:
    """What the user may choose.

    Parameters
    ----------
    code : int or None
        Gain code; None: 4 where the receiver has it, else its first.
    widths : int
        Number of pulse widths, at least 8: a polynomial of degree 5 goes through them.
    windows : int
        For each width, at least 5.
    peak_v : float or None
        Height of the pulses at the cut, V; None: 0.1 V, or less where the converter would be half full.
    terrain : str or None
        GeoTIFF, or scene; None: made terrain.
    altitudes_m : tuple of float or None
        From which it is seen, m; None: 400, 700, 1000 and 1400 km, or the scene's.
    footprints : int
        Along each side of a terrain; 0: none.
    ground_seed : int
        Of made terrain, and of where echoes lie between two samples.
    receiver : KnownReceiver or None
        What is known of the receiver; None: its preset.

    Raises
    ------
    RefusedInput
        A number outside these ranges.
    """

    code: int | None = None
    widths: int = WIDTHS
    windows: int = WINDOWS
    peak_v: float | None = None
    terrain: str | None = None
    altitudes_m: tuple[float, ...] | None = None
    footprints: int = FOOTPRINTS
    ground_seed: int = 1
    receiver: KnownReceiver | None = None

    def __post_init__(self) -> None:
        if not 8 <= self.widths <= 200:
            raise RefusedInput(f"{self.widths} widths: 8 to 200 are allowed")
        if self.windows < FEWEST_WINDOWS:
            raise RefusedInput(f"{self.windows} windows a width: at least {FEWEST_WINDOWS} are needed")
        if self.peak_v is not None and not 0 < self.peak_v < math.inf:
            raise RefusedInput(f"pulses {self.peak_v!r} V high: must be above zero")
        if not 0 <= self.footprints <= _MOST_PER_SIDE:
            raise RefusedInput(
                f"{self.footprints} footprints along a side: 0 (none) to {_MOST_PER_SIDE} are allowed"
            )
        if self.ground_seed < 0:
            raise RefusedInput(f"ground seed {self.ground_seed}: must not be negative")
        if self.altitudes_m is not None:
            if not self.altitudes_m:
                raise RefusedInput("altitudes: at least one is needed")
            for altitude_m in self.altitudes_m:
                if not 1e3 <= altitude_m <= 1e8:
                    raise RefusedInput(f"an altitude of {altitude_m!r} m: 1 km to 100 000 km are allowed")


@dataclass(frozen=True)
class ArrivalPlan:
    """Every shot of an arrival curve, and what is simulated beside it.

    Parameters
    ----------
    options : ArrivalOptions
        As chosen.
    code : int or None
        Gain code of all shots.
    bits : int
        Of the converters.
    combs : tuple of PulseComb
        By width; none where windows were recorded.
    model : GeneratorModel or None
        That plays them.
    delay_s : float
        From the trigger to the first sample, s.
    sample_count : int
        Of a window.
    """

    options: ArrivalOptions
    code: int | None
    bits: int
    combs: tuple[PulseComb, ...] = ()
    model: GeneratorModel | None = None
    delay_s: float = 0.0
    sample_count: int = 0

    @property
    def shots(self) -> tuple[PlannedShot, ...]:
        """All windows of a width, then those of the next."""
        found: list[PlannedShot] = []
        for comb in self.combs:
            assert self.model is not None
            stimulus = comb.stimulus(self.model)
            for _ in range(self.options.windows):
                request = WindowRequest(len(found), self.code, self.sample_count, self.delay_s)
                found.append(PlannedShot(request, stimulus))
        return tuple(found)

    def as_json(self) -> dict[str, Any]:
        """Return the plan as plain values, for the run's fingerprint."""
        return asdict(self)


def plan(bench: Bench, options: ArrivalOptions) -> ArrivalPlan:
    """Fit the options to what this bench can do.

    Raises
    ------
    LimitExceeded
        A gain code that the receiver does not have, or pulses that do not fit into its windows.
    InterlockRefused
        Pulses over ``max_vpp``.
    RefusedInput
        A receiver behind which every pulse is too wide, terrain that cannot be read, or a known receiver
        that is another one.
    """
    spec, model = bench.spec, bench.generator_model
    refuse_other(options.receiver, spec, "the receiver on the bench")
    known = options.receiver or preset_receiver(bench.config)
    code = usual_code(spec, options.code)
    peak_v = options.peak_v
    if peak_v is None:
        most_v = _HALF_USED * known.adc_full_scale_v / 2 / known.at(code).gain.value
        peak_v = min(PEAK_V, most_v, bench.config.generator.max_vpp / 2 * 0.99)
    filtered = (known.poles, known.zeros, known.sample_interval_s)
    widths_s = spread_widths_s(*filtered, 1 / model.max_arb_rate_hz, options.widths)
    spacing_s = comb_spacing_s(spec.sample_interval_s, spec.converters, TESTS)
    lead_s, count = window_shape((TESTS + 1) * spacing_s, spec.sample_interval_s)
    if count > spec.max_sample_count:
        raise LimitExceeded(
            f"a comb of {TESTS + 2} pulses needs a window of {count} samples: the receiver takes "
            f"{spec.max_sample_count}"
        )
    trigger_s = _trigger_s(bench.config)
    first_s = max(earliest_centre_s(max(widths_s), model), lead_s + spec.sample_interval_s + trigger_s)
    before_s = first_s - lead_s - trigger_s
    _load(options)
    made = ArrivalPlan(
        options,
        code,
        spec.bits,
        tuple(PulseComb(one, REFERENCE_S, peak_v, TESTS, first_s, spacing_s) for one in widths_s),
        model,
        max(0.0, round(before_s / spec.sample_interval_s) * spec.sample_interval_s),
        count,
    )
    check_all(bench, made.shots)
    return made


def recorded_plan(recorded: RecordedWindows, options: ArrivalOptions) -> ArrivalPlan:
    """Take the windows of a data file in which combs of pulses were played.

    Raises
    ------
    RefusedInput
        It has none, or none at the gain code that is wanted.
    """
    codes: list[int | None] = []
    combs: dict[SampledPulse, bool] = {}
    for row in range(len(recorded)):
        played = recorded.played(row)
        if isinstance(played, SampledPulse) and combs.setdefault(played, _is_comb(played)):
            codes.append(recorded.request(row).gain_code)
    if not codes:
        raise RefusedInput(
            f"{recorded.path}: has no comb of pulses; needed are windows of belahil arrival-time"
        )
    if options.code is not None and options.code not in codes:
        raise RefusedInput(f"{recorded.path}: has no comb of pulses at gain code {options.code}")
    _load(options)
    return ArrivalPlan(options, codes[0] if options.code is None else options.code, recorded.spec.bits)


def _is_comb(played: SampledPulse) -> bool:
    try:
        played_comb(played)
    except RefusedInput:
        return False
    return True


def _load(options: ArrivalOptions) -> None:
    """Refuse terrain that cannot be read before anything is measured; made terrain can always be made."""
    if options.footprints and options.terrain is not None:
        next(iter(grounds(options.terrain, options.ground_seed)))


def _trigger_s(config: BenchConfig) -> float:
    """Return when the receiver is triggered, s after the generator, as the bench file tells it."""
    delay_s = config.bench.trigger_delay_s
    return delay_s if config.bench.trigger == "generator" else -delay_s


def measure(
    bench: Bench, run: Journal, plan: ArrivalPlan, progress: Callable[[int, int], None] | None = None
) -> None:
    """Measure what the run does not hold yet; see `procedures.plans.measure_all`."""
    measure_all(bench, run, plan.shots, progress)


def analyse(plan: ArrivalPlan, shots: Iterable[Shot], config: BenchConfig) -> Outcome:
    """Turn the recorded windows into results, and simulate what they are compared with.

    Parameters
    ----------
    plan : ArrivalPlan
        What was measured.
    shots : iterable of Shot
        In any order.
    config : BenchConfig
        Its receiver's preset, where nothing better is known, and who triggers when.
    """
    from procedures.arrival_outcome import outcome
    from procedures.arrival_points import measure_points

    known = plan.options.receiver or preset_receiver(config)
    chosen = plan.options.code is not None
    points = measure_points(shots, known, _trigger_s(config), plan.code, plan.bits, chosen=chosen)
    return outcome(plan.options, known, points)
