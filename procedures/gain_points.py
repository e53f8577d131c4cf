"""From windows to points: one gain for each sine, what silence tells of each code, and one clock for all."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from heapq import nlargest
from typing import TYPE_CHECKING

import numpy as np

from belahil.stimuli import Sine
from belahil.values import Estimate, RangeWindow, Shot
from procedures.clipping import with_clipping
from procedures.dark_noise import DarkNoise, dark_noise
from procedures.sine_fit import (
    SineFit,
    SinePlan,
    amplitude_from_peak_to_peak,
    amplitude_from_rms,
)
from procedures.sine_frequency import common_clock
from procedures.sine_noise import Leftover, noise_beside_sines

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from procedures.characterize import GainPlan

CLOCK_RECORDS = 48
"""Records that decide the clock; more add nothing to a figure that is not the limit of anything."""


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """One row for each sine window, all arrays of shape (n,).

    Parameters
    ----------
    shot : ndarray of int
        Index in the plan.
    code : ndarray of int
        -1 for a receiver without gain codes.
    amplitude_vpp, frequency_hz, played_vpp : ndarray of float
        As planned at the cut, as played, as played at the cut.
    gain, gain_u, gain_rms, gain_peak : ndarray of float
        By the sine fit with its statistical standard uncertainty, from the RMS, from peak to peak; V/V.
    status : ndarray of str
        "ok", or why the row is not used.
    """

    shot: NDArray[np.int64]
    code: NDArray[np.int64]
    amplitude_vpp: NDArray[np.float64]
    frequency_hz: NDArray[np.float64]
    played_vpp: NDArray[np.float64]
    gain: NDArray[np.float64]
    gain_u: NDArray[np.float64]
    gain_rms: NDArray[np.float64]
    gain_peak: NDArray[np.float64]
    status: NDArray[np.str_]

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Rows that a fit may use, shape (n,)."""
        result: NDArray[np.bool_] = self.status == "ok"
        return result

    def chosen(self, code: int | None, amplitude_vpp: float | None = None) -> NDArray[np.bool_]:
        """Rows of one gain code and, when given, one planned amplitude, shape (n,)."""
        mine: NDArray[np.bool_] = self.code == (-1 if code is None else code)
        return mine if amplitude_vpp is None else mine & (self.amplitude_vpp == amplitude_vpp)


@dataclass(frozen=True, slots=True)
class Interleave:
    """Differences between two interleaved converters; None where nothing could tell.

    Parameters
    ----------
    gain, offset_v, skew_s : Estimate or None
        Even minus odd: relative gain, offset at the converter, sampling time.
    """

    gain: Estimate | None = None
    offset_v: Estimate | None = None
    skew_s: Estimate | None = None


@dataclass(frozen=True, slots=True)
class WindowReadings:
    """Everything the windows of a characterization tell.

    Parameters
    ----------
    points : Points
        Gains.
    dark : dict of (int or None) to DarkNoise
        By gain code.
    clock_ppm : Estimate or None
        One clock error for the whole sweep; above zero the receiver's clock is fast.
    interleave : Interleave
        From all windows.
    beside_sines : dict of (int or None) to Estimate
        Noise of the gain codes whose dark windows have too little of it, from what the sine fits leave.
    """

    points: Points
    dark: dict[int | None, DarkNoise]
    clock_ppm: Estimate | None
    interleave: Interleave
    beside_sines: dict[int | None, Estimate]


def read_windows(plan: GainPlan, shots: Iterable[Shot]) -> WindowReadings:
    """Read every window of a plan.

    Parameters
    ----------
    plan : GainPlan
        What was measured.
    shots : iterable of Shot
        Gone through more than once; an iterator is turned into a list first.
    """
    kept = list(shots) if isinstance(shots, Iterator) else shots
    clock = clock_error(kept, plan.converters, plan.bits)
    dark: dict[int | None, list[RangeWindow]] = {code: [] for code in plan.codes}
    sines = []
    plans: dict[float, SinePlan] = {}
    wanted = {one.request.shot for one in plan.shots}
    for shot in (with_clipping(one, plan.bits) for one in kept if one.window.shot in wanted):
        if isinstance(shot.played, Sine):
            sines.append(_read_sine(plan, shot, clock, plans))
        else:
            dark[shot.window.gain_code].append(shot.window)
    noise = {code: dark_noise(windows, plan.converters) for code, windows in dark.items()}
    return WindowReadings(
        _points(plan, sines),
        noise,
        clock,
        _interleave([one.fit for one in sines], noise),
        _beside_sines(
            sines, [code for code, one in noise.items() if one.status in ("below_dither", "no_signal")]
        ),
    )


@dataclass(frozen=True, slots=True)
class _Reading:
    shot: int
    code: int | None
    played: Sine
    fit: SineFit
    volts_per_count: float
    rms_v: float
    peak_v: float


def _true_rate(window: RangeWindow, clock_ppm: float) -> float:
    return (1 + clock_ppm * 1e-6) / window.sample_interval_s


def _read_sine(plan: GainPlan, shot: Shot, clock: Estimate | None, plans: dict[float, SinePlan]) -> _Reading:
    window, played = shot.window, shot.played
    assert isinstance(played, Sine)
    if played.frequency_hz not in plans:
        rate = _true_rate(window, clock.value if clock else 0.0)
        plans[played.frequency_hz] = SinePlan(
            played.frequency_hz, rate, window.counts.size, plan.converters == 2
        )
    volts = window.volts
    fit = plans[played.frequency_hz].fit(
        volts, saturated=window.saturated, volts_per_count=window.volts_per_count
    )
    return _Reading(
        window.shot,
        window.gain_code,
        played,
        fit,
        window.volts_per_count,
        amplitude_from_rms(volts),
        amplitude_from_peak_to_peak(window.counts) * window.volts_per_count,
    )


def _points(plan: GainPlan, sines: list[_Reading]) -> Points:
    planned = {one.request.shot: one.stimulus for one in plan.shots}
    wanted = [planned[one.shot] for one in sines]
    half_vpp = np.array([one.played.amplitude_vpp for one in sines]) / 2

    def column(values: list[float]) -> NDArray[np.float64]:
        return np.array(values) / half_vpp

    usable = [one.fit.usable for one in sines]
    return Points(
        shot=np.array([one.shot for one in sines], np.int64),
        code=np.array([-1 if one.code is None else one.code for one in sines]),
        amplitude_vpp=np.array([one.amplitude_vpp for one in wanted if isinstance(one, Sine)]),
        frequency_hz=np.array([one.played.frequency_hz for one in sines]),
        played_vpp=2 * half_vpp,
        gain=column([one.fit.amplitude.value for one in sines]),
        gain_u=column(
            [
                one.fit.amplitude.standard_uncertainty if ok else 0.0
                for one, ok in zip(sines, usable, strict=True)
            ]
        ),
        gain_rms=column([one.rms_v for one in sines]),
        gain_peak=column([one.peak_v for one in sines]),
        status=np.array(["ok" if ok else one.fit.status for one, ok in zip(sines, usable, strict=True)]),
    )


def _interleave(fits: list[SineFit], dark: dict[int | None, DarkNoise]) -> Interleave:
    usable = [one for one in fits if one.usable]
    offsets = [one.offset_difference for one in usable] + [one.offset_difference for one in dark.values()]
    return Interleave(
        weighted_mean([one.gain_mismatch for one in usable]),
        weighted_mean(offsets),
        weighted_mean([one.skew for one in usable]),
    )


def _beside_sines(sines: list[_Reading], codes: list[int | None]) -> dict[int | None, Estimate]:
    found = {}
    for code in codes:
        mine = [one for one in sines if one.code == code and one.fit.usable]
        noise = noise_beside_sines(
            [
                Leftover(
                    one.fit.amplitude.value / one.volts_per_count,
                    (one.fit.noise_rms_v / one.volts_per_count) ** 2,
                )
                for one in mine
            ]
        )
        if noise is not None:
            scale = mine[0].volts_per_count
            found[code] = Estimate(scale * noise.value, scale * noise.standard_uncertainty, "V")
    return found


def weighted_mean(estimates: Iterable[Estimate | None]) -> Estimate | None:
    """Return the mean of independent estimates by their weights; None when there is none of finite weight.

    Parameters
    ----------
    estimates : iterable of (Estimate or None)
        All in one unit; None and infinite uncertainties are passed over.
    """
    known = [one for one in estimates if one is not None and 0 < one.standard_uncertainty < np.inf]
    if not known:
        return None
    weight = np.array([one.standard_uncertainty for one in known]) ** -2.0
    value = float(np.average([one.value for one in known], weights=weight))
    return Estimate(value, float(weight.sum() ** -0.5), known[0].unit)


def _shows_a_sine(shot: Shot) -> bool:
    return isinstance(shot.played, Sine) and not shot.window.saturated


def _clock_strength(shot: Shot) -> float:
    """How much a record tells of the clock: the rate at which its sine crosses zero, in counts by time."""
    assert isinstance(shot.played, Sine)
    return float(np.std(shot.window.counts[:1024])) * shot.played.frequency_hz


def clock_error(shots: Iterable[Shot], converters: int, bits: int) -> Estimate | None:
    """Return the clock error in ppm from the records that tell most of it; None when there is none.

    Parameters
    ----------
    shots : iterable of Shot
        Those with a sine count.
    converters, bits : int
        Interleaved converters and their resolution.
    """
    whole = (one for one in shots if _shows_a_sine(with_clipping(one, bits)))
    strongest = nlargest(CLOCK_RECORDS, whole, key=_clock_strength)
    records = sorted(strongest, key=lambda one: one.window.shot)
    if not records:
        return None
    found = common_clock(
        [(one.played.frequency_hz, one.window.volts) for one in records if isinstance(one.played, Sine)],
        1 / records[0].window.sample_interval_s,
        converters == 2,
    )
    if found.status == "not_measurable":
        return None
    return Estimate(found.ppm, found.standard_uncertainty_ppm, "1e-6")
