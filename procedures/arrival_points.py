"""From the windows of a bench to delay against detected width, beside what a model of the receiver expects.

The delay is that of the test pulses of a comb after its reference pulses. It is measured; what is common to
all widths is not in it. That constant, the delay of the reference pulses themselves, needs the time from the
generator's trigger to the receiver's, which only the bench file tells, and where the trigger falls between
two samples, which nobody tells. Of the latter one thing is known: it is within one sample. So the earliest
and the latest reference of many windows enclose the constant (`reference_delay`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil import butterworth
from belahil.errors import RefusedInput
from belahil.stimuli import SampledPulse
from belahil.values import Estimate
from procedures.arrival_comb import PlayedComb, played_comb
from procedures.arrival_fit import CombReading, aligned, expected_comb, read_comb
from procedures.clipping import with_clipping

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from belahil.values import RangeWindow, Shot
    from procedures.known_receiver import KnownReceiver

FEWEST_WINDOWS = 5
"""Of one width: fewer tell no scatter to speak of."""

_JITTER = 5.0
"""Standard deviations by which references may be spread over more than a sample before that is jitter."""


@dataclass(frozen=True, slots=True)
class WidthPoint:
    """Pulses of one width.

    Parameters
    ----------
    played_fwhm_s : float
        As played, s.
    status : str
        ``ok``, or the commonest reason why windows were not used; then the rest is None or 0.
    windows, windows_bad : int
        Used, and not usable.
    width : Estimate or None
        Detected full width at half maximum, s.
    delay : Estimate or None
        After the reference pulses, s.
    model_width_s, model_delay_s : float
        What the model expects, s.
    model_u_s : float
        What the uncertainty of the model's filter makes of `model_delay_s`, s; it has the sign of the effect,
        which all widths share.
    """

    played_fwhm_s: float
    status: str
    windows: int = 0
    windows_bad: int = 0
    width: Estimate | None = None
    delay: Estimate | None = None
    model_width_s: float = 0.0
    model_delay_s: float = 0.0
    model_u_s: float = 0.0

    @property
    def difference_s(self) -> float:
        """Measured less expected delay, s."""
        assert self.delay is not None
        return self.delay.value - self.model_delay_s


@dataclass(frozen=True, slots=True)
class BenchPoints:
    """What the windows of a bench tell.

    Parameters
    ----------
    status : str
        ``ok``; ``no_pulse``: there is no comb; ``mixed_gain_codes``; ``another_receiver``: the windows have
        another sample interval than the model; ``too_few_points``: no width is usable.
    points : tuple of WidthPoint
        By played width.
    reference : Estimate or None
        Delay of the reference pulses, s.
    reference_status : str
        ``ok``, ``trigger_jitter`` (the mean stands), or ``too_few_points``.
    reference_model : Estimate or None
        What the model expects of it, s.
    reference_fwhm_s : float
        Played width of the references, s.
    clock_ppm : Estimate or None
        Error of the receiver's clock against the generator's, 1e-6; above zero: it is fast.
    """

    status: str
    points: tuple[WidthPoint, ...] = ()
    reference: Estimate | None = None
    reference_status: str = "too_few_points"
    reference_model: Estimate | None = None
    reference_fwhm_s: float = 0.0
    clock_ppm: Estimate | None = None

    @property
    def usable(self) -> tuple[WidthPoint, ...]:
        """Points with a delay, by detected width."""
        found = [one for one in self.points if one.width is not None]
        return tuple(sorted(found, key=lambda one: one.width.value if one.width else 0.0))


@dataclass(slots=True, eq=False)
class _Group:
    """Windows of one stimulus while they are read."""

    comb: PlayedComb
    template: CombReading
    readings: list[CombReading]
    starts_s: list[float]
    first: NDArray[np.int16] | None = None
    equal: bool = True


def measure_points(
    shots: Iterable[Shot],
    known: KnownReceiver,
    trigger_s: float,
    code: int | None,
    bits: int,
    *,
    chosen: bool = False,
) -> BenchPoints:
    """Read combs of pulses.

    Parameters
    ----------
    shots : iterable of Shot
        In any order; what is no comb of pulses is left out.
    known : KnownReceiver
        The model to compare with.
    trigger_s : float
        From the generator's trigger to the receiver's, s; negative where the receiver's comes first.
    code : int or None
        Gain code of the windows.
    bits : int
        Of the converters.
    chosen : bool
        Leave out windows at another gain code; else there must be none.
    """
    groups: dict[SampledPulse, _Group] = {}
    none: set[SampledPulse] = set()
    for shot in shots:
        played = shot.played
        if not isinstance(played, SampledPulse) or played in none:
            continue
        if shot.window.gain_code != code:
            if chosen:
                continue
            return BenchPoints("mixed_gain_codes")
        if not math.isclose(shot.window.sample_interval_s, known.sample_interval_s, rel_tol=1e-9):
            return BenchPoints("another_receiver")
        if played not in groups:
            try:
                comb = played_comb(played)
            except RefusedInput:
                none.add(played)
                continue
            groups[played] = _Group(comb, _expected(played, comb, known), [], [])
        _read(groups[played], with_clipping(shot, bits).window, played, known)
    if not groups:
        return BenchPoints("no_pulse")
    found = {played: _point(one, played, known) for played, one in groups.items()}
    points = tuple(sorted(found.values(), key=lambda one: one.played_fwhm_s))
    good = {played: groups[played] for played, one in found.items() if one.status == "ok"}
    if not good:
        return BenchPoints("too_few_points", points)
    return _with_reference(points, good, known, trigger_s)


def _expected(
    played: SampledPulse, comb: PlayedComb, known: KnownReceiver, factor: float = 1.0
) -> CombReading:
    poles = butterworth.poles(factor * known.cutoff.value, known.order, known.highpass_hz)
    return expected_comb(played, comb, poles, known.zeros, known.sample_interval_s)


def _read(group: _Group, window: RangeWindow, played: SampledPulse, known: KnownReceiver) -> None:
    if group.first is None:
        group.first = window.counts
    else:
        group.equal = group.equal and np.array_equal(group.first, window.counts)
    if window.saturated:
        group.readings.append(CombReading("clipped"))
        return
    volts = window.volts
    place_s = aligned(volts, window.sample_interval_s, played, group.comb, known.poles, known.zeros)
    if place_s is None:
        group.readings.append(CombReading("no_pulse"))
        return
    found = read_comb(volts, window.sample_interval_s, group.comb, place_s, known.converters)
    group.readings.append(found)
    if found.status == "ok":
        group.starts_s.append(window.start_s)


def _point(group: _Group, played: SampledPulse, known: KnownReceiver) -> WidthPoint:
    played_s = float(group.comb.widths_s[1:-1].mean())
    good = [one for one in group.readings if one.status == "ok"]
    bad = [one.status for one in group.readings if one.status != "ok"]
    if len(good) < FEWEST_WINDOWS:
        status = max(set(bad), key=bad.count) if bad else "too_few_points"
        return WidthPoint(played_s, status, len(good), len(bad))
    if group.equal:
        return WidthPoint(played_s, "equal_windows", len(good), len(bad))
    step = known.cutoff.standard_uncertainty / known.cutoff.value
    narrower = _expected(played, group.comb, known, 1 + step) if step else group.template
    return WidthPoint(
        played_s,
        "ok",
        len(good),
        len(bad),
        width=_mean([one.width_s for one in good]),
        delay=_mean([one.delay_s for one in good]),
        model_width_s=group.template.width_s,
        model_delay_s=group.template.delay_s,
        model_u_s=narrower.delay_s - group.template.delay_s,
    )


def _mean(values_s: list[float]) -> Estimate:
    """Mean and its standard uncertainty, widened to the standard deviation of Student's t."""
    count = len(values_s)
    scatter_s = float(np.std(values_s, ddof=1)) / math.sqrt(count)
    return Estimate(float(np.mean(values_s)), scatter_s * math.sqrt((count - 1) / (count - 3)), "s")


def _with_reference(
    points: tuple[WidthPoint, ...],
    groups: dict[SampledPulse, _Group],
    known: KnownReceiver,
    trigger_s: float,
) -> BenchPoints:
    read = [
        # AC coupling moves the last reference against the first; the model tells by how much.
        (one.reference_s + start_s, group.comb.middle_s, one.clock - group.template.clock)
        for group in groups.values()
        for one, start_s in zip(
            [each for each in group.readings if each.status == "ok"], group.starts_s, strict=True
        )
    ]
    arrivals_s, middles_s, clocks = np.transpose(read)
    played, group = next(iter(groups.items()))
    lasts_s = float(group.comb.centres_s[-1] - group.comb.centres_s[0])
    # Half of the difference of two independent arrivals scatters as their mean does.
    noise_s = float(np.std(clocks, ddof=1)) * lasts_s / 2
    fast = 1 + float(clocks.mean())
    since_s, interval_s = arrivals_s / fast + trigger_s - middles_s, known.sample_interval_s / fast
    reference, status = reference_delay(since_s, interval_s, noise_s)
    step = known.cutoff.standard_uncertainty / known.cutoff.value
    moved = _expected(played, group.comb, known, 1 + step) if step else group.template
    expected = Estimate(group.template.reference_s, abs(moved.reference_s - group.template.reference_s), "s")
    clock = Estimate(
        float(1e6 * clocks.mean()), float(1e6 * np.std(clocks, ddof=1) / math.sqrt(clocks.size)), "1e-6"
    )
    widths_s = group.comb.widths_s
    return BenchPoints("ok", points, reference, status, expected, float(widths_s[[0, -1]].mean()), clock)


def reference_delay(
    arrivals_s: NDArray[np.float64], sample_interval_s: float, noise_s: float
) -> tuple[Estimate, str]:
    """Return the delay that arrivals of an unknown, uniform fraction of a sample less enclose.

    Parameters
    ----------
    arrivals_s : ndarray of float64, shape (n,)
        Each is the delay less 0 to 1 sample intervals, s.
    sample_interval_s : float
        s.
    noise_s : float
        Standard deviation of one arrival, s.

    Returns
    -------
    Estimate, str
        The delay lies between the largest arrival and the smallest and a sample: the middle, and the standard
        deviation of a uniform distribution there, with the noise of an arrival. Status ``trigger_jitter``
        where they spread over more than a sample: the mean and half a sample, and the scatter of the mean.
    """
    low_s, high_s = float(arrivals_s.min()), float(arrivals_s.max())
    slack_s = low_s + sample_interval_s - high_s
    if slack_s < -_JITTER * noise_s:
        scatter_s = float(np.std(arrivals_s, ddof=1)) / math.sqrt(arrivals_s.size)
        return Estimate(float(arrivals_s.mean()) + sample_interval_s / 2, scatter_s, "s"), "trigger_jitter"
    middle_s = (low_s + sample_interval_s + high_s) / 2
    return Estimate(middle_s, math.hypot(max(slack_s, 0.0) / math.sqrt(12), noise_s), "s"), "ok"


def relative_to_model(points: tuple[WidthPoint, ...]) -> tuple[float, int]:
    """Return chi-square of the differences to the model, and its degrees of freedom.

    The uncertainty of the filter moves all widths together; it enters as one common factor.
    """
    differences = np.array([one.difference_s for one in points])
    spread = np.array([one.delay.standard_uncertainty for one in points if one.delay is not None])
    common = np.array([one.model_u_s for one in points])
    covariance = np.diag(spread**2) + np.outer(common, common)
    scale = float(spread.max())
    solved = np.linalg.solve(covariance / scale**2, differences / scale)
    return float(differences @ solved / scale), differences.size
