"""From windows of sines to points: the figures of each sine at each gain code."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from belahil.bench import setting_per_cut_volt
from belahil.generators import bandwidth_sensitivity
from belahil.stimuli import Sine
from belahil.values import Estimate, RangeWindow, Shot
from procedures.clipping import with_clipping
from procedures.gain_points import Interleave, clock_error, weighted_mean
from procedures.sine_fit import SineFit, SinePlan
from procedures.sine_harmonics import HarmonicPlan
from procedures.sine_quality import SineQuality, sine_quality

if TYPE_CHECKING:
    from belahil.config import BenchConfig, GeneratorTable
    from procedures.digitizer import DigitizerPlan

LEAST_SEEN = 10.0
"""Standard uncertainties of its amplitude that a sine must have; with less there is no figure of merit."""


@dataclass(frozen=True, slots=True)
class SinePoint:
    """One sine at one gain code; None where its status tells why there is no number.

    Parameters
    ----------
    code : int or None
        Gain code.
    frequency_hz, amplitude_vpp : float
        As played; V at the cut.
    records : int
        Windows that were used.
    status : str
        "ok", "clipped", "no_signal", "below_dither", "short_record", "frequency_not_measurable".
    level_dbfs : Estimate or None
        Peak at the converter, dB of half its span.
    gain : Estimate or None
        Amplitude at the converter by that at the cut, declared errors of the generator included.
    gain_scatter : float
        Standard uncertainty of `gain` without those.
    offset : Estimate or None
        Mean of both converters, V.
    interleave : Interleave
        How the converters differ.
    quality : SineQuality or None
        The figures of IEEE Std 1057-2017.
    """

    code: int | None
    frequency_hz: float
    amplitude_vpp: float
    records: int
    status: str
    level_dbfs: Estimate | None = None
    gain: Estimate | None = None
    gain_scatter: float = 0.0
    offset: Estimate | None = None
    interleave: Interleave = field(default_factory=Interleave)
    quality: SineQuality | None = None


@dataclass(frozen=True, slots=True)
class DigitizerReadings:
    """Everything the windows of a digitizer test tell.

    Parameters
    ----------
    points : tuple of SinePoint
        By gain code, then frequency, then amplitude.
    clock_ppm : Estimate or None
        Error of the receiver's clock; above zero it is fast.
    shown : tuple of (SinePoint, RangeWindow) or None
        A point and one of its windows, for the picture of its spectrum.
    """

    points: tuple[SinePoint, ...]
    clock_ppm: Estimate | None
    shown: tuple[SinePoint, RangeWindow] | None


def read_points(plan: DigitizerPlan, shots: Iterable[Shot], config: BenchConfig) -> DigitizerReadings:
    """Read every window.

    Parameters
    ----------
    plan : DigitizerPlan
        What was measured.
    shots : iterable of Shot
        Gone through more than once; an iterator is turned into a list first.
    config : BenchConfig
        Attenuation, load and declared uncertainties.
    """
    kept = list(shots) if isinstance(shots, Iterator) else shots
    clock = clock_error(kept, plan.converters, plan.bits)
    groups: dict[tuple[int, float, float], list[Shot]] = {}
    for shot in (with_clipping(one, plan.bits) for one in kept):
        played, code = shot.played, shot.window.gain_code
        if isinstance(played, Sine):
            key = -1 if code is None else code, played.frequency_hz, played.amplitude_vpp
            groups.setdefault(key, []).append(shot)
    reader = _Reader(plan, config, clock.value if clock else 0.0)
    points = tuple(reader.point([one.window for one in mine], key) for key, mine in sorted(groups.items()))
    shown = max(
        (one for one in points if one.quality is not None),
        key=lambda one: one.level_dbfs.value if one.level_dbfs else -math.inf,
        default=None,
    )
    window = None
    if shown is not None:
        key = -1 if shown.code is None else shown.code, shown.frequency_hz, shown.amplitude_vpp
        window = shown, groups[key][0].window
    return DigitizerReadings(points, clock, window)


class _Reader:
    """Holds the prepared fits of the frequency in hand."""

    def __init__(self, plan: DigitizerPlan, config: BenchConfig, clock_ppm: float) -> None:
        self._plan = plan
        self._rate_factor = 1 + clock_ppm * 1e-6
        self._generator = config.generator
        self._per_cut_volt = setting_per_cut_volt(config)
        self._prepared: dict[tuple[float, float, int], tuple[SinePlan, HarmonicPlan]] = {}

    def _plans(self, frequency_hz: float, window: RangeWindow) -> tuple[SinePlan, HarmonicPlan]:
        rate = self._rate_factor / window.sample_interval_s
        key = frequency_hz, rate, window.counts.size
        if key not in self._prepared:
            both = self._plan.converters == 2
            self._prepared[key] = SinePlan(*key, both), HarmonicPlan(*key, both)
        return self._prepared[key]

    def point(self, windows: list[RangeWindow], key: tuple[int, float, float]) -> SinePoint:
        """Read the windows of one sine at one gain code."""
        _, frequency_hz, amplitude_vpp = key
        plain, harmonics = self._plans(frequency_hz, windows[0])
        fits = [
            plain.fit(one.volts, saturated=one.saturated, volts_per_count=one.volts_per_count)
            for one in windows
        ]
        status = next((one.status for one in fits if one.status != "ok"), "ok")
        amplitude = weighted_mean(one.amplitude for one in fits)
        if status == "ok" and not _is_seen(amplitude):
            status = "no_signal"
        point = SinePoint(windows[0].gain_code, frequency_hz, amplitude_vpp, len(fits), status)
        if status != "ok":
            return point
        assert amplitude is not None
        span_v = windows[0].volts_per_count * 2**self._plan.bits
        found = harmonics.fit(np.stack([one.volts for one in windows]))
        return self._described(
            point, fits, amplitude, span_v, sine_quality(found, span_v, plain.sample_rate_hz)
        )

    def _described(
        self, point: SinePoint, fits: list[SineFit], amplitude: Estimate, span_v: float, quality: SineQuality
    ) -> SinePoint:
        relative = amplitude.standard_uncertainty / amplitude.value
        gain = amplitude.value / (point.amplitude_vpp / 2)
        declared = _declared(self._generator, point, self._per_cut_volt)
        level = 20 * math.log10(amplitude.value / (span_v / 2))
        return SinePoint(
            code=point.code,
            frequency_hz=point.frequency_hz,
            amplitude_vpp=point.amplitude_vpp,
            records=point.records,
            status=point.status,
            level_dbfs=Estimate(level, 20 / math.log(10) * relative, "dB"),
            gain=Estimate(gain, gain * math.hypot(relative, declared), "1"),
            gain_scatter=gain * relative,
            offset=weighted_mean(one.offset for one in fits),
            interleave=Interleave(
                weighted_mean(one.gain_mismatch for one in fits),
                weighted_mean(one.offset_difference for one in fits),
                weighted_mean(one.skew for one in fits),
            ),
            quality=quality,
        )


def _is_seen(amplitude: Estimate | None) -> bool:
    return amplitude is not None and amplitude.value > LEAST_SEEN * amplitude.standard_uncertainty


def _declared(generator: GeneratorTable, point: SinePoint, setting_per_volt: float) -> float:
    """Return the relative standard uncertainty of a gain by all that the bench file declares."""
    declared = generator.uncertainty
    bandwidth = float(bandwidth_sensitivity(point.frequency_hz, generator.bandwidth_hz))
    return math.hypot(
        declared.amplitude_relative,
        declared.amplitude_v / (point.amplitude_vpp * setting_per_volt),
        declared.flatness_relative * point.frequency_hz / 40e6,
        declared.attenuation_db * math.log(10) / 20,
        declared.bandwidth_relative * bandwidth,
    )
