"""From the windows of a comparison to what agrees: window by window, and echo by echo."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.receiver import receiver_preset
from belahil.stimuli import SampledPulse
from procedures.candidate_parity import Pair, ParityStatus, compare
from procedures.clipping import with_clipping
from procedures.detection_model import Prediction, Sightings, predict, signal_uncertainty, with_samples
from procedures.echo_agreement import EchoAgreement, agreements
from procedures.echo_sighting import Expectation, Sighting, expectation, pulse_places, sighting
from procedures.known_receiver import KnownReceiver, preset_receiver
from sim.rfm import RangeFinder

if TYPE_CHECKING:
    from collections.abc import Iterable

    from belahil.config import BenchConfig
    from belahil.values import Estimate, RangeWindow, Shot
    from procedures.rfm_parity import ParityPlan

FEWEST_WINDOWS = 10
"""Of one echo; below, nothing is said of it."""
SAME_INTERVAL = 1e-6
"""Relative: what is further apart is another sample interval."""

EchoStatus = Literal[
    "ok",
    "no_pulse",
    "no_marker",
    "no_candidates",
    "marker_lost",
    "saturated",
    "too_few_points",
    "not_known",
]
"""Of one echo: compared; nothing above 0 V was played; a single pulse was; no window came with candidates;
the marker is among them in none; every window clipped; fewer than ten windows; gain or noise not known."""

RunStatus = Literal["ok", "another_receiver", "no_candidates", "no_samples"]
"""Of the comparison by window: made; the windows are of another receiver; none came with candidates; none
came with its samples."""


@dataclass(frozen=True, slots=True)
class WindowRow:
    """One window: how many candidates belong together, and the largest differences of those that do.

    Parameters
    ----------
    shot : int
        Index in the plan.
    status : str
        Out of `procedures.candidate_parity.ParityStatus`, or ``another_receiver``.
    matched, missing, extra : int
        Pairs; found by us alone; reported alone.
    in_order : bool
        Whether both lists have the pairs in the same order.
    pairs : tuple of (float, float, float, int, int)
        Differences of arrival (s), width (s), amplitude (V), first sample, and how many samples differ.
    """

    shot: int
    status: ParityStatus | Literal["another_receiver"]
    matched: int = 0
    missing: int = 0
    extra: int = 0
    in_order: bool = True
    pairs: tuple[tuple[float, float, float, int, int], ...] = ()

    @property
    def reported(self) -> int:
        """Candidates that the receiver reported."""
        return self.matched + self.extra


@dataclass(frozen=True)
class EchoRow:
    """One echo.

    Parameters
    ----------
    fwhm_s, snr : float or None
        As planned; None where the plan does not say.
    code : int or None
        Gain code.
    echo_v : float or None
        Height at the converter without noise, V.
    windows, saturated, unmarked : int
        Windows; those left out because samples clipped; those in which the marker was not reported.
    status : str
        Out of `EchoStatus`.
    measured : Sightings or None
    predicted : Prediction or None
    agreement : EchoAgreement or None
        None where the status is not ``ok``.
    """

    fwhm_s: float | None
    snr: float | None
    code: int | None
    echo_v: float | None
    windows: int
    saturated: int
    unmarked: int
    status: EchoStatus
    measured: Sightings | None = None
    predicted: Prediction | None = None
    agreement: EchoAgreement | None = None


@dataclass(frozen=True)
class Findings:
    """All that a comparison found.

    Parameters
    ----------
    plan : ParityPlan
    receiver : KnownReceiver
        What was taken for known.
    status : str
        Out of `RunStatus`.
    windows : tuple of WindowRow
    echoes : tuple of EchoRow
    together : EchoAgreement
        Of all echoes whose status is ``ok``.
    """

    plan: ParityPlan
    receiver: KnownReceiver
    status: RunStatus
    windows: tuple[WindowRow, ...]
    echoes: tuple[EchoRow, ...]
    together: EchoAgreement

    @property
    def compared(self) -> tuple[WindowRow, ...]:
        """Windows in which both lists are known; one without any candidates counts where others have some."""
        if self.status != "ok":
            return ()
        return tuple(one for one in self.windows if one.status in ("ok", "differs", "no_candidates"))

    @property
    def agreeing(self) -> int:
        """Windows with the same candidates on both sides."""
        return sum(one.status == "ok" for one in self.compared)


@dataclass
class _Group:
    """The windows of one echo, as they come."""

    stimulus: SampledPulse
    example: RangeWindow
    status: EchoStatus
    expected: Expectation | None
    windows: int = 0
    saturated: int = 0
    sightings: list[Sighting] = field(default_factory=list)
    reported: int = 0


def found_in(plan: ParityPlan, shots: Iterable[Shot], config: BenchConfig) -> Findings:
    """Compare the windows of a run; see `procedures.rfm_parity.analyse`."""
    receiver = plan.receiver or preset_receiver(config)
    finder = RangeFinder.of(receiver_preset(config.digitizer.receiver))
    rows: list[WindowRow] = []
    groups: dict[tuple[object, ...], _Group] = {}
    same_spec = (plan.spec.bits, plan.spec.converters) == (receiver.bits, receiver.converters)
    for shot in shots:
        window = with_clipping(shot, plan.spec.bits).window
        intervals_s = (receiver.sample_interval_s, finder.bank.sample_interval_s)
        if not same_spec or not all(
            math.isclose(window.sample_interval_s, one, rel_tol=SAME_INTERVAL) for one in intervals_s
        ):
            rows.append(WindowRow(window.shot, "another_receiver"))
            continue
        rows.append(_row(window, finder, plan))
        if isinstance(shot.played, SampledPulse):
            _sight(groups, shot.played, window, receiver, finder, plan)
    echoes, together = _echoes(plan, groups, receiver, finder, config)
    return Findings(plan, receiver, _status(plan, rows), tuple(rows), echoes, together)


def _status(plan: ParityPlan, rows: list[WindowRow]) -> RunStatus:
    statuses = {one.status for one in rows}
    if "another_receiver" in statuses:
        return "another_receiver"
    if not statuses - {"no_samples", "too_few_samples"}:
        return "no_samples"
    if plan.products != "window_and_candidates" and not any(one.reported for one in rows):
        return "no_candidates"
    return "ok"


def _row(window: RangeWindow, finder: RangeFinder, plan: ParityPlan) -> WindowRow:
    found = compare(window, finder, plan.tolerances)
    return WindowRow(
        shot=window.shot,
        status=found.status,
        matched=len(found.pairs),
        missing=len(found.missing),
        extra=len(found.extra),
        in_order=found.in_order,
        pairs=tuple(map(_differences, found.pairs)),
    )


def _differences(pair: Pair) -> tuple[float, float, float, int, int]:
    return pair.arrival_s, pair.fwhm_s, pair.amplitude_v, pair.first_sample, pair.samples_differing


def _sight(
    groups: dict[tuple[object, ...], _Group],
    played: SampledPulse,
    window: RangeWindow,
    receiver: KnownReceiver,
    finder: RangeFinder,
    plan: ParityPlan,
) -> None:
    """Take a window to those in which the same was played."""
    key = (played, window.gain_code, window.counts.size, window.volts_per_count, window.start_s)
    if key not in groups:
        example = window if window.counts.size else with_samples(window, plan.sample_count)
        status, places_s = pulse_places(played)
        known = [one for one in receiver.codes if one.code == window.gain_code]
        if status == "ok" and not (known and known[0].noise_rms is not None):
            groups[key] = _Group(played, example, "not_known", None)
        elif status != "ok":
            groups[key] = _Group(played, example, status, None)
        else:
            expected = expectation(played, places_s, receiver, known[0].gain.value, finder)
            groups[key] = _Group(played, example, "ok", expected)
    group = groups[key]
    group.windows += 1
    group.saturated += window.saturated > 0
    group.reported += bool(window.candidates)
    if group.expected is not None and not window.saturated:
        numbers = [(one.arrival_s, one.amplitude_v) for one in window.candidates]
        group.sightings.append(sighting(numbers, group.expected))


def _echoes(
    plan: ParityPlan,
    groups: dict[tuple[object, ...], _Group],
    receiver: KnownReceiver,
    finder: RangeFinder,
    config: BenchConfig,
) -> tuple[tuple[EchoRow, ...], EchoAgreement]:
    """Compare each echo with the model, and all of them."""
    rows: list[EchoRow] = []
    for place, group in enumerate(groups.values()):
        planned = plan.echoes[place] if place < len(plan.echoes) else None
        measured = Sightings.of(group.sightings)
        row = EchoRow(
            fwhm_s=None if planned is None else planned.fwhm_s,
            snr=None if planned is None else planned.snr,
            code=group.example.gain_code,
            echo_v=None if group.expected is None else group.expected.echo_v,
            windows=group.windows,
            saturated=group.saturated,
            unmarked=sum(one.marker_s is None for one in group.sightings),
            status=_echo_status(group, measured),
            measured=measured,
        )
        rows.append(
            replace(row, predicted=_predicted(group, place, plan, receiver, finder, config, row.status))
        )
    pairs = {
        place: (one.measured, one.predicted)
        for place, one in enumerate(rows)
        if one.measured is not None and one.predicted is not None
    }
    single, together = agreements(list(pairs.values()))
    for place, told in zip(pairs, single, strict=True):
        rows[place] = replace(rows[place], agreement=told)
    return tuple(rows), together


def _echo_status(group: _Group, measured: Sightings) -> EchoStatus:
    if group.status != "ok":
        return group.status
    if group.windows < FEWEST_WINDOWS:
        return "too_few_points"
    if group.saturated == group.windows:
        return "saturated"
    if not group.reported:
        return "no_candidates"
    if all(one.marker_s is None for one in group.sightings):
        return "marker_lost"
    return "ok" if measured.used >= FEWEST_WINDOWS else "too_few_points"


def _predicted(
    group: _Group,
    place: int,
    plan: ParityPlan,
    receiver: KnownReceiver,
    finder: RangeFinder,
    config: BenchConfig,
    status: EchoStatus,
) -> Prediction | None:
    if status != "ok" or group.expected is None:
        return None
    known = receiver.at(group.example.gain_code)
    markers = [one.marker_s for one in group.sightings if one.marker_s is not None]
    moved = expectation(
        group.stimulus,
        pulse_places(group.stimulus)[1],
        _with_cutoff(receiver, receiver.cutoff.value + receiver.cutoff.standard_uncertainty),
        known.gain.value,
        finder,
    )
    declared = config.generator.uncertainty
    declared_relative = math.hypot(declared.amplitude_relative, math.log(10) / 20 * declared.attenuation_db)
    return predict(
        group.stimulus,
        group.example,
        float(np.median(markers)),
        receiver,
        finder,
        group.expected,
        plan.model_windows,
        signal_uncertainty(known, declared_relative, moved.echo_v / group.expected.echo_v - 1),
        place,
    )


def _with_cutoff(receiver: KnownReceiver, cutoff_hz: float) -> KnownReceiver:
    cutoff: Estimate = replace(receiver.cutoff, value=cutoff_hz)
    return replace(receiver, cutoff=cutoff)
