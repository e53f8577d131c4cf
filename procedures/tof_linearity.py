"""Measure how linear a receiver's time of flight is: scale, wobble with the sampling phase, and range walk.

Two pulses of known distance are played in one window, from 1 to 199 us apart and at all places between two
samples. The first is always the reference pulse; the second has every width and height. The time between both
fitted arrivals less the time between both played pulses then is

    (clock error) times the distance + delay of this pulse less that of the reference + wobble of both

and one linear fit tells these apart (`procedures.tof_fit`).

Not modelled: pulses that overlap; jitter of the generator between its points; a clock that changes within a
window; range walk by the shape of a pulse, which `belahil arrival-time` measures.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import LimitExceeded, RefusedInput
from belahil.outcome import Outcome
from belahil.receiver import receiver_preset
from belahil.stimuli import SampledPulse
from belahil.uncertainty import sized
from belahil.values import Shot, WindowRequest
from procedures.gaussian_pulses import TrainPulse, earliest_centre_s, gaussian_train
from procedures.known_receiver import KnownReceiver, preset_receiver, refuse_other
from procedures.plans import Journal, PlannedShot, RecordablePlan, check_all, measure_all, usual_code
from procedures.pulse_place import first_sample

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from belahil.bench import Bench
    from belahil.config import BenchConfig
    from belahil.generators import GeneratorModel
    from belahil.recorded import RecordedWindows

WIDTHS_S = (8e-9, 20e-9, 40e-9, 80e-9)
PEAKS_V = (10e-3, 30e-3, 90e-3)
SEPARATIONS = 8
SHOTS = 4
SHORTEST_S, LONGEST_S = 1e-6, 199e-6
"""From one pulse to the other."""

_AFTER_S = 1.1e-6
"""From the second pulse to the end of the window, at least: half a correlation window, and the filter."""
_FAST_HZ = 250e6
"""Points a second that are enough: what is played is known to the point, and more of them, most of them
silent, would fill memories and disks."""
_GOLDEN = (math.sqrt(5) - 1) / 2
"""Its multiples fill the places between two samples evenly, however many there are."""


@dataclass(frozen=True, slots=True)
class TofOptions:
    """What the user may choose.

    Parameters
    ----------
    widths_s, peaks_v : tuple of float
        Full widths, s, and heights at the cut, V, of the second pulse, in every combination. The reference
        has the middle width and the largest height.
    separations : int
        Distances of the pulses for each such pulse, evenly from 1 us to 199 us or to the end of the window.
    shots : int
        Of each distance.
    gain_code : int or None
        None: 4 where the receiver has it, else its first.
    receiver : KnownReceiver or None
        None: the preset that the bench file names.

    Raises
    ------
    RefusedInput
        No width or height, fewer than two distances, or a number that is not positive.
    """

    widths_s: tuple[float, ...] = WIDTHS_S
    peaks_v: tuple[float, ...] = PEAKS_V
    separations: int = SEPARATIONS
    shots: int = SHOTS
    gain_code: int | None = None
    receiver: KnownReceiver | None = None

    def __post_init__(self) -> None:
        if not self.widths_s or not self.peaks_v:
            raise RefusedInput("widths and heights: at least one of each is needed")
        for one in (*self.widths_s, *self.peaks_v):
            if not 0 < one < math.inf:
                raise RefusedInput(f"widths and heights: {one!r} must be positive and finite")
        if max(self.widths_s) > SHORTEST_S / 6:
            raise RefusedInput(
                f"a width of {sized(max(self.widths_s), 's', 4)}: at most {sized(SHORTEST_S / 6, 's', 4)} "
                "is allowed, so that pulses 1 us apart do not overlap"
            )
        if self.separations < 2 or self.shots < 1:
            raise RefusedInput(
                f"{self.separations} distances, {self.shots} shots: at least 2 and 1 are needed"
            )

    @property
    def reference(self) -> tuple[float, float]:
        """Width, s, and height, V, of the first pulse."""
        widths = sorted(set(self.widths_s))
        return widths[len(widths) // 2], max(self.peaks_v)


TofPlan = RecordablePlan[TofOptions]
"""By the second pulse, then by distance."""


def plan(bench: Bench, options: TofOptions) -> TofPlan:
    """Fit the options to what this bench can do.

    Raises
    ------
    LimitExceeded
        A gain code, width or height that receiver or generator does not have, or windows too short for two
        pulses.
    InterlockRefused
        A height over ``max_vpp``.
    RefusedInput
        A width below the generator's interval, or a known receiver that is another one.
    """
    spec, model = bench.spec, bench.generator_model
    refuse_other(options.receiver, spec, "the receiver on the bench")
    enough_hz = max(_FAST_HZ, 2 / min(options.widths_s))
    model = replace(model, max_arb_rate_hz=min(model.max_arb_rate_hz, enough_hz))
    code = usual_code(spec, options.gain_code)
    delay_s, begin_s = first_sample(bench.config)
    interval_s = spec.sample_interval_s
    lead_s = max(0.5e-6, earliest_centre_s(max(options.widths_s), model))
    window_s = spec.max_sample_count * interval_s
    longest_s = min(LONGEST_S, window_s - lead_s - _AFTER_S)
    if longest_s < 2 * SHORTEST_S:
        raise LimitExceeded(
            f"the receiver's longest window lasts {sized(window_s, 's', 4)}: "
            f"{lead_s + _AFTER_S + 2 * SHORTEST_S:.4g} s are needed for two pulses"
        )
    planned: list[PlannedShot] = []
    kinds = [(width_s, peak_v) for width_s in options.widths_s for peak_v in options.peaks_v]
    turn_s = spec.converters * interval_s
    for number, (width_s, peak_v) in enumerate(dict.fromkeys(kinds)):
        for place, distance_s in enumerate(distances_s(options.separations, longest_s, turn_s, number)):
            # Each converter in its turn is the one that the first pulse meets.
            moved_s = place % spec.converters * interval_s
            first = TrainPulse(*options.reference, begin_s + on_points(lead_s + moved_s, model))
            second = TrainPulse(width_s, peak_v, first.centre_s + on_points(distance_s, model))
            pair = gaussian_train((first, second), model)
            for _ in range(options.shots):
                request = WindowRequest(len(planned), code, spec.max_sample_count, delay_s)
                planned.append(PlannedShot(request, pair))
    made = TofPlan(tuple(planned), spec.converters, spec.bits, options)
    check_all(bench, made.shots)
    return made


def on_points(time_s: float, model: GeneratorModel) -> float:
    """Round a time to whole intervals of a generator, so that equal pulses are played as equal points."""
    return round(time_s * model.max_arb_rate_hz) / model.max_arb_rate_hz


def distances_s(count: int, longest_s: float, turn_s: float, number: int = 0) -> list[float]:
    """Return distances from 1 us on, evenly, each moved within a turn so that all phases are there.

    Parameters
    ----------
    count : int
        At least two.
    longest_s, turn_s : float
        The last distance, and the time in which every converter takes one sample, s.
    number : int
        Of a kind of pulse: others begin at another phase.
    """
    whole_s = np.ceil(np.linspace(SHORTEST_S, longest_s, count) / turn_s) * turn_s
    parts = (np.arange(count) + 1) * _GOLDEN + number * _GOLDEN**2
    found: list[float] = (whole_s + (parts % 1) * turn_s).tolist()
    return [distance_s if distance_s < longest_s else longest_s for distance_s in found]


def recorded_plan(recorded: RecordedWindows, options: TofOptions) -> TofPlan:
    """Take the windows of a data file in which a sampled pulse was played.

    Raises
    ------
    RefusedInput
        There are none, or none at the gain code that was asked for.
    """
    code = options.gain_code
    own = [row for row in range(len(recorded)) if code in (None, recorded.request(row).gain_code)]
    if not any(isinstance(recorded.played(row), SampledPulse) for row in own):
        at = "" if code is None else f" at gain code {code}"
        raise RefusedInput(
            f"{recorded.path}: no window with a sampled pulse{at}; needed are windows with two known pulses "
            "each"
        )
    return TofPlan((), recorded.spec.converters, recorded.spec.bits, options)


def measure(
    bench: Bench, run: Journal, plan: TofPlan, progress: Callable[[int, int], None] | None = None
) -> None:
    """Measure what the run does not hold yet; see `procedures.plans.measure_all`."""
    measure_all(bench, run, plan.shots, progress)


def analyse(plan: TofPlan, shots: Iterable[Shot], config: BenchConfig) -> Outcome:
    """Turn the recorded windows into scale, wobble and range walk.

    Parameters
    ----------
    plan : TofPlan
        What was measured.
    shots : iterable of Shot
        In any order. Shots without a sampled pulse, and of another gain code than the one that was asked
        for, are left out.
    config : BenchConfig
        The receiver's preset; ``[emulation]`` is not read.
    """
    from procedures.pulse_pairs import read_pairs
    from procedures.tof_outcome import outcome

    receiver = plan.options.receiver or preset_receiver(config)
    samples = receiver_preset(config.digitizer.receiver).correlation_window_samples
    code, codes = plan.options.gain_code, set()

    def own() -> Iterator[Shot]:
        for shot in shots:
            if isinstance(shot.played, SampledPulse) and code in (None, shot.window.gain_code):
                codes.add(shot.window.gain_code)
                yield shot

    pairs = read_pairs(own(), receiver, samples, plan.converters, plan.bits)
    return outcome(pairs, receiver, mixed=len(codes) > 1)
