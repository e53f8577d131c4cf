"""Sine fit after IEEE Std 1057-2017 for one converter, or for two that are interleaved.

With two converters the model of sample n is, with + for even and - for odd n::

    (1 +- g/2) S(t_n +- s/2) + c +- o/2,    S(t) = A cos(2 pi f t + phase)

gain mismatch g, skew s (even samples are taken later), offset difference o. Both converters are fitted at
once, so that mismatch does not leak into the amplitude where the image f_s / 2 - f comes near f.

What this does not model: harmonics, a drift of amplitude, and noise whose density changes within 32 bins.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.values import Estimate
from procedures.sine_design import SineDesign, Solution
from procedures.sine_values import one_converter, two_converters, with_quantization

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

SineStatus = Literal[
    "ok", "masked", "clipped", "below_dither", "short_record", "frequency_not_measurable", "no_signal"
]

WORST_CONDITION = 1e3
"""Above it the columns are the same to a part in a thousand, and noise decides between them."""

_INFINITE = float("inf")
_SMALLEST = 1e-150


@dataclass(frozen=True, slots=True, eq=False)
class SineFit:
    """One fitted sine.

    An estimate that a record cannot give has the value 0 and an infinite standard uncertainty, so that its
    weight is 0. With one converter `gain_mismatch`, `skew` and `offset_difference` are None.

    Parameters
    ----------
    status : str
        "ok"; "masked": samples were left out, and what is left is good; "clipped": samples lie at the
        converter's end, and no fit is made, since noise selects the others (their amplitude is some percent
        too small); "below_dither": less than half a code and too little noise to see it; "short_record": less
        than half a cycle; "frequency_not_measurable": at this frequency offset, image and sine are one (a
        multiple of f_s / 4 with two converters, of f_s / 2 with one); "no_signal": all samples equal.
    frequency : Estimate
        Hz; known exactly unless it was fitted.
    amplitude : Estimate
        Of the mean of both converters, V. Noise adds some u^2 / (2 A) to it, as to any magnitude.
    phase : Estimate
        Of the cosine at the first sample, rad.
    offset : Estimate
        Mean of both converters, V.
    gain_mismatch, skew, offset_difference : Estimate or None
        Even minus odd converter: relative, s, V.
    frequency_error : Estimate
        Relative; how far the record's frequency lies above `frequency`, from the drift of the phase.
    noise_rms_v : float
        Residual, all frequencies, V.
    noise_density : float
        One-sided noise density at the sine's (alias) frequency, V^2/Hz.
    condition : float
        Of the columns; infinite when they are not independent.
    used : int
        Samples that were used.
    phasors : ndarray of complex128, shape (blocks,)
        Sums of the record, turned back by the sine's phase, over equal parts of it; V.
    """

    status: SineStatus
    frequency: Estimate
    amplitude: Estimate
    phase: Estimate
    offset: Estimate
    gain_mismatch: Estimate | None
    skew: Estimate | None
    offset_difference: Estimate | None
    frequency_error: Estimate
    noise_rms_v: float
    noise_density: float
    condition: float
    used: int
    phasors: NDArray[np.complex128]

    @property
    def usable(self) -> bool:
        """Whether the amplitude may be used."""
        return self.status in ("ok", "masked")


class SinePlan:
    """A sine fit with known frequency, prepared for many records.

    Parameters
    ----------
    frequency_hz : float
        True frequency, Hz, positive; above half the sample rate it is seen through its alias.
    sample_rate_hz : float
        True sample rate of both converters together, Hz.
    sample_count : int
        Samples in a record.
    interleaved : bool
        Even and odd samples come from two converters.
    """

    def __init__(
        self, frequency_hz: float, sample_rate_hz: float, sample_count: int, interleaved: bool = True
    ) -> None:
        self.frequency_hz = frequency_hz
        self.sample_rate_hz = sample_rate_hz
        self.sample_count = sample_count
        self.interleaved = interleaved
        self._design = self._designed()

    def _designed(self, keep: NDArray[np.bool_] | None = None) -> SineDesign:
        return SineDesign(self.frequency_hz / self.sample_rate_hz, self.sample_count, self.interleaved, keep)

    @property
    def cycles(self) -> float:
        """Cycles of the alias in a record."""
        ratio = self.frequency_hz / self.sample_rate_hz
        return abs(ratio - round(ratio)) * self.sample_count

    @property
    def foreseen(self) -> SineStatus:
        """What the frequency alone says of every record: "ok", or why none can be fitted."""
        if self._design.condition > WORST_CONDITION:
            return "frequency_not_measurable"
        return "short_record" if self.cycles < 0.5 else "ok"

    def fit(
        self,
        volts: Array,
        keep: NDArray[np.bool_] | None = None,
        saturated: int = 0,
        volts_per_count: float = 0.0,
    ) -> SineFit:
        """Fit one record.

        Parameters
        ----------
        volts : ndarray of float64, shape (sample_count,)
            V; what is not finite is left out.
        keep : ndarray of bool, shape (sample_count,), or None
            Samples to use; None for all.
        saturated : int
            How many samples the digitizer says are clipped.
        volts_per_count : float
            Size of one code, V; 0 when the record is not quantized.

        Raises
        ------
        ValueError
            A record of another length than planned.
        """
        if volts.shape != (self.sample_count,):
            raise ValueError(f"a record of shape {volts.shape}; the plan is for {self.sample_count} samples")
        if saturated:
            return self._nothing("clipped", self._design)
        design, record, seen = self._design, volts, volts
        # One product tells whether every sample is finite.
        if keep is not None or not math.isfinite(volts @ volts):
            used = np.isfinite(volts) if keep is None else keep & np.isfinite(volts)
            if not used.all():
                design, record, seen = self._designed(used), np.where(used, volts, 0.0), volts[used]
        # A fit from fewer than three samples for each column would be no measurement.
        if seen.size < 3 * design.size:
            return self._nothing("no_signal", design)
        if design.condition > WORST_CONDITION:
            return self._nothing("frequency_not_measurable", design)
        if _is_constant(seen):
            return self._nothing("no_signal", design)
        fit = self._described(design, design.solve(record), volts_per_count)
        status: SineStatus = "ok" if design is self._design else "masked"
        if self.cycles < 0.5:
            status = "short_record"
        elif volts_per_count and _is_lost(fit, volts_per_count):
            status = "below_dither"
        return fit if status == "ok" else replace(fit, status=status)

    def _described(self, design: SineDesign, found: Solution, volts_per_count: float) -> SineFit:
        describe = two_converters if self.interleaved else one_converter
        values = describe(found, 2 * math.pi * self.frequency_hz)
        values = with_quantization(values, found.variance, volts_per_count)
        ratio = self.frequency_hz / self.sample_rate_hz
        start = values.phase.value - 2 * math.pi * ((ratio - round(ratio)) * design.middle)
        cos, sin, time_cos, time_sin = found.drift.tolist()
        size = max(math.hypot(cos, sin), _SMALLEST)
        # A phasor that turns by w t / T has the drift i w: in quadrature with itself.
        turn = (time_cos * sin - time_sin * cos) / size**2
        per_turn = self.sample_rate_hz / (math.pi * self.frequency_hz * self.sample_count)
        return SineFit(
            status="ok",
            frequency=Estimate(self.frequency_hz, 0.0, "Hz"),
            amplitude=values.amplitude,
            phase=Estimate(math.remainder(start, 2 * math.pi), values.phase.standard_uncertainty, "rad"),
            offset=values.offset,
            gain_mismatch=values.gain_mismatch,
            skew=values.skew,
            offset_difference=values.offset_difference,
            frequency_error=Estimate(turn * per_turn, found.drift_u / size * per_turn),
            noise_rms_v=math.sqrt(found.variance),
            noise_density=2 * found.density / self.sample_rate_hz,
            condition=design.condition,
            used=design.used,
            phasors=found.phasors,
        )

    def _nothing(self, status: SineStatus, design: SineDesign) -> SineFit:
        volt, one = Estimate(0.0, _INFINITE, "V"), Estimate(0.0, _INFINITE)
        return SineFit(
            status=status,
            frequency=Estimate(self.frequency_hz, 0.0, "Hz"),
            amplitude=volt,
            phase=Estimate(0.0, _INFINITE, "rad"),
            offset=volt,
            gain_mismatch=one if self.interleaved else None,
            skew=Estimate(0.0, _INFINITE, "s") if self.interleaved else None,
            offset_difference=volt if self.interleaved else None,
            frequency_error=one,
            noise_rms_v=0.0,
            noise_density=0.0,
            condition=design.condition,
            used=design.used,
            phasors=np.zeros(0, dtype=np.complex128),
        )


def _is_constant(volts: Array) -> bool:
    return bool(volts[0] == volts[-1] == volts[volts.size // 2]) and bool(np.ptp(volts) == 0)


def _is_lost(fit: SineFit, volts_per_count: float) -> bool:
    """Whether a sine is smaller than half a code and the noise does not dither it.

    Half a code, undithered, is a square wave of one code whose first harmonic is 2 / pi. The limit of the
    noise is half a code less what chance and rounding make of it; just above, 2 % of rounding error are left.
    """
    square = volts_per_count**2
    dither = fit.noise_rms_v**2 / square - 1 / 12
    return fit.amplitude.value < 0.65 * volts_per_count and dither < 0.47**2


def amplitude_from_rms(volts: Array) -> float:
    """Return sqrt(2) times the rms about the mean, V: right for a sine alone, too large by any noise.

    Parameters
    ----------
    volts : ndarray of float64, shape (n,)
        V.
    """
    centred = volts - volts.mean()
    return math.sqrt(2 * float(centred @ centred) / volts.size)


def amplitude_from_peak_to_peak(volts: Array | NDArray[np.int16]) -> float:
    """Return half the span, V: too large by the extremes of any noise.

    Parameters
    ----------
    volts : ndarray of float64 or int16, shape (n,)
        V; or counts, which give the half span in counts, sooner.
    """
    return (float(np.max(volts)) - float(np.min(volts))) / 2
