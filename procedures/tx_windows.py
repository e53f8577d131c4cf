"""The windows of a transmitted pulse, made ready for the likelihood: checked, centred, cut to segments.

What of a window tells of the pulse is the stretch round it. The samples before it tell the baseline of each
converter and the noise. A window in which no pulse stands out, or that is clipped, is left out and counted.

What this does not model: a baseline that moves within the windows, and interference that is locked to the
shot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from belahil.pulse_bound import filtered_noise_covariance
from belahil.stimuli import TransmittedPulse
from procedures.clipping import with_clipping
from procedures.tx_likelihood import PHASES, Baseline, PulseLikelihood, SegmentGrid, whitener
from procedures.tx_response import CutResponses

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from belahil.values import RangeWindow, Shot
    from procedures.known_receiver import KnownReceiver
    from procedures.tx_pulse import OpticalPulse

STANDS_OUT = 7.0
"""A pulse is there where the matched filter is so many standard deviations above its noise."""

_ENDED = 1e-4
"""Of its peak, below which the response to the whole pulse is left out of a segment."""
_FAINT = 0.02
_LONGEST_S = 1.6e-6
_EARLY = 4
"""Samples before the pulse begins that belong to its segment."""
_LATE = 12
"""Samples after its end that belong to it: they show the undershoot of an AC coupling."""
_FEWEST_QUIET = 64
_TYPICAL = 0.2
"""Threshold of the shape that pulses are looked for with: any shape finds them."""
_SAME_INTERVAL = 1e-6
_CORRELATED = 32
_FEWEST_AT_END = 6


@dataclass(frozen=True, eq=False)
class PulseWindows:
    """Windows that hold a pulse.

    Parameters
    ----------
    status : str
        ``ok``, or why there is nothing to analyse: ``no_pulse``, ``saturated``, ``equal_windows``,
        ``mixed_gain_codes``, ``other_receiver``, ``pulse_cut_off``, ``too_few_samples``,
        ``noise_not_known``.
    gain_code : int or None
        Of all of them.
    counted : dict of str to int
        Windows in all (`windows`), used (`used`), and left out: `clipped`, `without_pulse`, `cut_off` (the
        pulse is not all inside), `too_short`.
    shots : ndarray of int64, shape (n,)
        Index of the shot of each segment.
    segments_v : ndarray of float64, shape (n, count)
        Samples round each pulse, V at the converter, baseline and mismatch of the converters taken out.
    first : ndarray of int64, shape (n,)
        Sample of its window with which each segment begins.
    grid : SegmentGrid or None
        Of the segments.
    noise_rms_v, noise_rms_u_v, white_rms_v : float
        Analog noise, its standard uncertainty, and quantization; V at the converter.
    baseline_v : tuple of float
        Of each converter, V.
    """

    status: str
    gain_code: int | None
    counted: dict[str, int]
    shots: NDArray[np.int64]
    segments_v: NDArray[np.float64]
    first: NDArray[np.int64]
    grid: SegmentGrid | None = None
    noise_rms_v: float = 0.0
    noise_rms_u_v: float = 0.0
    white_rms_v: float = 0.0
    baseline_v: tuple[float, ...] = ()

    def likelihood(self, receiver: KnownReceiver, baseline: Baseline) -> PulseLikelihood:
        """Whiten the segments; see `procedures.tx_likelihood`."""
        assert self.grid is not None
        taken = whitener(receiver, self.grid.count, self.noise_rms_v, self.white_rms_v, baseline)
        skew = receiver.interleave_skew
        return PulseLikelihood(
            self.grid,
            taken,
            self.segments_v @ taken.T,
            self.first % 2 == 1,
            0.0 if skew is None else skew.value,
        )


def segment_grids(pulse: OpticalPulse, receiver: KnownReceiver) -> tuple[SegmentGrid, SegmentGrid]:
    """Return the shortest and the longest segment round the arrival that serve.

    Parameters
    ----------
    pulse : OpticalPulse
        Before any cut.
    receiver : KnownReceiver
        A high-pass, whose undershoot lasts for microseconds, does not lengthen them.

    Returns
    -------
    tuple of SegmentGrid
        Both begin before the pulse; the first ends where the response to the whole pulse is below 2 % of its
        peak, the second 12 samples after it is below 1e-4.
    """
    interval_s = receiver.true_interval_s
    begins_s = pulse.above(_ENDED)[0][0]
    times_s = np.arange(0.0, _LONGEST_S, interval_s / 2)
    fast = tuple(sorted(receiver.poles, key=abs)[receiver.zeros :])
    response = np.abs(CutResponses(pulse, fast, 0, times_s).exact(0.0))
    before = _EARLY + math.ceil(-begins_s / interval_s)

    def until(part: float, more: int) -> SegmentGrid:
        ends_s = times_s[np.flatnonzero(response > part * response.max())[-1]]
        return SegmentGrid(interval_s, before, before + math.ceil(ends_s / interval_s) + more)

    return until(_FAINT, 1), until(_ENDED, _LATE)


def read_pulses(
    shots: Iterable[Shot], bits: int, interval_s: float, receiver: KnownReceiver, pulse: OpticalPulse
) -> PulseWindows:
    """Find the transmitted pulse in every window of it.

    Parameters
    ----------
    shots : iterable of Shot
        Those of other stimuli are passed over.
    bits : int
        Resolution of the converters that digitized.
    interval_s : float
        Nominal time between their samples, s.
    receiver : KnownReceiver
        What is assumed of them.
    pulse : OpticalPulse
        Before the cut.
    """
    ones = [with_clipping(shot, bits).window for shot in shots if isinstance(shot.played, TransmittedPulse)]
    clear = [one for one in ones if not one.saturated and one.counts.size]
    counted = {"windows": len(ones), "used": 0, "clipped": sum(one.saturated > 0 for one in ones)}
    counted |= {"without_pulse": 0, "cut_off": 0, "too_short": 0}
    code = ones[0].gain_code if ones else None
    status = _misfits(ones, clear, bits, interval_s, receiver)
    if status:
        return _none(status, code, counted)
    shortest, longest = segment_grids(pulse, receiver)
    long_enough = [one for one in clear if one.counts.size >= shortest.count]
    counted["too_short"] = len(clear) - len(long_enough)
    responses = CutResponses(pulse, receiver.poles, receiver.zeros, shortest.times_s)
    located = zip(long_enough, _located(long_enough, responses, shortest), strict=True)
    seen = [(one, first) for one, first in located if first is not None]
    # A best place at an end of the search tells only that the pulse is there or beyond.
    inside = [(one, first) for one, first in seen if 0 < first < one.counts.size - shortest.count]
    grid, kept = _longest(inside, shortest, longest)
    counted["without_pulse"] = len(long_enough) - len(seen)
    counted["cut_off"] = len(seen) - len(kept)
    counted["used"] = len(kept)
    for name, status in (("too_short", "too_few_samples"), ("cut_off", "pulse_cut_off")):
        if 2 * counted[name] > len(ones):
            return _none(status, code, counted)
    if 2 * len(kept) < len(ones):
        return _none("no_pulse", code, counted)
    return _segments(kept, counted, grid, receiver)


def _longest(
    inside: list[tuple[RangeWindow, int]], shortest: SegmentGrid, longest: SegmentGrid
) -> tuple[SegmentGrid, list[tuple[RangeWindow, int]]]:
    """Return the longest segment for which nine of ten windows reach, and these windows."""
    reach = [one.counts.size - first for one, first in inside]
    if not reach:
        return shortest, []
    count = int(np.clip(np.quantile(reach, 0.1, method="lower"), shortest.count, longest.count))
    kept = [one for one, there in zip(inside, reach, strict=True) if there >= count]
    return replace(longest, count=count), kept


def _none(status: str, code: int | None, counted: dict[str, int]) -> PulseWindows:
    nothing = np.zeros(0, np.int64)
    return PulseWindows(status, code, counted, nothing, np.zeros((0, 0)), nothing)


def _misfits(
    ones: Sequence[RangeWindow],
    clear: Sequence[RangeWindow],
    bits: int,
    interval_s: float,
    receiver: KnownReceiver,
) -> str:
    """Say why windows cannot be analysed together, or with this receiver; nothing where they can."""
    if not ones:
        return "no_pulse"
    if len({one.gain_code for one in ones}) > 1:
        return "mixed_gain_codes"
    known = {one.code for one in receiver.codes}
    told_s = {interval_s, *(one.sample_interval_s for one in ones)}
    same = bits == receiver.bits and all(
        abs(one / receiver.sample_interval_s - 1) < _SAME_INTERVAL for one in told_s
    )
    if not same or ones[0].gain_code not in known or len({one.volts_per_count for one in ones}) > 1:
        return "other_receiver"
    if 2 * len(clear) < len(ones) or not clear:
        return "saturated"
    if len(clear) > 1 and all(np.array_equal(one.counts, clear[0].counts) for one in clear[1:]):
        return "equal_windows"
    return ""


def _located(windows: list[RangeWindow], responses: CutResponses, grid: SegmentGrid) -> list[int | None]:
    """Sample with which the segment of each window's pulse begins, None where no pulse stands out."""
    response = responses.exact(_TYPICAL)
    shapes = response[grid.places[PHASES : 2 * PHASES : PHASES // 2]]
    shapes = shapes - shapes.mean(axis=1, keepdims=True)
    shapes /= np.linalg.norm(shapes, axis=1, keepdims=True)
    coloured = filtered_noise_covariance(
        responses.poles, responses.zeros, grid.sample_interval_s, grid.count, 1.0
    )
    widened = math.sqrt(float(np.einsum("kn,nm,km->k", shapes, coloured, shapes).max()))
    least = STANDS_OUT * widened * _noise_at_the_ends(windows)
    found: list[int | None] = []
    for one in windows:
        scores = np.stack([np.correlate(one.volts, shape, "valid") for shape in shapes]).max(axis=0)
        best = int(scores.argmax())
        found.append(best if scores[best] > least else None)
    return found


def _noise_at_the_ends(windows: list[RangeWindow]) -> float:
    """Rms of the first or of the last quarter of a typical window, V: the smaller, where no pulse is."""
    if not windows:
        return 0.0
    ends = []
    for side in (1, -1):
        parts = [one.volts[::side][: max(one.counts.size // 4, _FEWEST_AT_END)] for one in windows]
        ends.append(float(np.median([part.std() for part in parts])))
    return max(min(ends), _quantization_v(windows[0]))


def _segments(
    kept: list[tuple[RangeWindow, int]], counted: dict[str, int], grid: SegmentGrid, receiver: KnownReceiver
) -> PulseWindows:
    converters, code = receiver.converters, kept[0][0].gain_code
    volts = [one.volts for one, _ in kept]
    firsts = np.array([first for _, first in kept])
    quiet = [one[: first + _EARLY - 1] for one, first in zip(volts, firsts, strict=True)]
    baseline_v = _baseline(quiet, converters)
    order = [np.arange(one.size) % converters for one in volts]
    left = np.concatenate(
        [one - baseline_v[turn[: one.size]] for one, turn in zip(quiet, order, strict=True)]
    )
    white_v = _quantization_v(kept[0][0])
    noise_rms_v = math.sqrt(max(float(np.mean(left**2)) - white_v**2, 0.0)) if left.size else 0.0
    spread_v = noise_rms_v / math.sqrt(2 * _independent(left.size, receiver))
    if left.size < _FEWEST_QUIET:
        known = receiver.at(code).noise_rms
        if known is None:
            return _none("noise_not_known", code, counted)
        noise_rms_v, spread_v = known.value, known.standard_uncertainty
    gain = np.ones(converters)
    if receiver.interleave_gain is not None and converters == 2:
        gain = 1 + np.array([0.5, -0.5]) * receiver.interleave_gain.value
    segments = np.stack(
        [
            ((one - baseline_v[turn]) / gain[turn])[first : first + grid.count]
            for one, first, turn in zip(volts, firsts, order, strict=True)
        ]
    )
    firsts = np.array([first for _, first in kept])
    return PulseWindows(
        status="ok",
        gain_code=code,
        counted=counted,
        shots=np.array([one.shot for one, _ in kept]),
        segments_v=segments,
        first=firsts,
        grid=grid,
        noise_rms_v=noise_rms_v,
        noise_rms_u_v=spread_v,
        white_rms_v=white_v,
        baseline_v=tuple(baseline_v.tolist()),
    )


def _baseline(quiet: list[NDArray[np.float64]], converters: int) -> NDArray[np.float64]:
    """Mean of the samples before the pulse, for each converter; 0 where there are too few of them."""
    found = np.zeros(converters)
    for turn in range(converters):
        own = np.concatenate([one[turn::converters] for one in quiet])
        if own.size >= _FEWEST_QUIET // converters:
            found[turn] = own.mean()
    return found


def _quantization_v(window: RangeWindow) -> float:
    return window.volts_per_count / math.sqrt(12)


def _independent(samples: int, receiver: KnownReceiver) -> float:
    """Number of independent samples that tell a variance as well; at least one."""
    row = filtered_noise_covariance(
        receiver.poles, receiver.zeros, receiver.true_interval_s, _CORRELATED, 1.0
    )[0]
    return max(samples / float(1 + 2 * np.sum(row[1:] ** 2)), 1.0)
