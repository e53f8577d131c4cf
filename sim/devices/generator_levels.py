"""What generator channels of all families have: shape, frequency, voltages, and the rules between them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from belahil.generators import (
    GeneratorModel,
    per_50_ohm,
    round_amplitude,
    round_to_step,
)
from sim.devices.scpi.parameters import LIMIT_SLACK, Report, clamp
from sim.devices.scpi.status import ScpiError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from belahil.stimuli import Interpolation

# Peak-to-peak volts per volt rms; that of a sine serves for noise and arbitrary waveforms too (assumed).
_PEAK_TO_PEAK_PER_RMS = {"SQU": 2.0, "PULS": 2.0, "PRBS": 2.0, "RAMP": 2 * 3**0.5, "TRI": 2 * 3**0.5}
_SINE_PEAK_TO_PEAK_PER_RMS = 2 * 2**0.5


@dataclass(slots=True)
class Levels:
    """What channels of all families have; a family overrides what is otherwise there.

    Volts are volts into `load_ohm`. A new one holds the values after ``*RST``.
    """

    model: GeneratorModel
    report: Report
    output: bool = False
    function: str = "SIN"
    frequency_hz: float = field(init=False)
    amplitude_vpp: float = field(init=False)
    offset_v: float = 0.0
    unit: str = "VPP"
    load_ohm: float = field(init=False)
    autorange: str = "ON"
    limits_on: bool = False
    limit_high_v: float = field(init=False)
    limit_low_v: float = field(init=False)
    polarity: str = "NORM"
    burst: bool = False
    burst_mode: str = "TRIG"
    burst_cycles: float = 1.0
    burst_phase_deg: float = 0.0
    burst_period_s: float = 10e-3
    gate_polarity: str = "NORM"
    trigger_source: str = "IMM"
    trigger_slope: str = "POS"
    trigger_delay_s: float = 0.0
    phase_deg: float = 0.0
    arb_rate_hz: float = field(init=False)

    def __post_init__(self) -> None:
        """Take what the model has after a reset."""
        first = self.model.after_reset
        self.frequency_hz, self.amplitude_vpp = first.frequency_hz, first.amplitude_vpp
        self.load_ohm, self.arb_rate_hz = first.load_ohm, first.sample_rate_hz
        self.limit_high_v, self.limit_low_v = self.peak_v, -self.peak_v

    @property
    def peak_v(self) -> float:
        """Largest voltage at the load setting."""
        return self.model.max_peak_v * per_50_ohm(self.load_ohm)

    @property
    def least_vpp(self) -> float:
        """Smallest amplitude at the load setting."""
        return self.model.min_amplitude_vpp * per_50_ohm(self.load_ohm)

    @property
    def window_v(self) -> tuple[float, float]:
        """Lowest and highest voltage that the waveform may reach."""
        if self.limits_on:
            return max(self.limit_low_v, -self.peak_v), min(self.limit_high_v, self.peak_v)
        return -self.peak_v, self.peak_v

    @property
    def half_v(self) -> float:
        """What the waveform adds to its offset."""
        return 0.0 if self.function == "DC" else self.amplitude_vpp / 2

    @property
    def most_vpp(self) -> float:
        """Largest amplitude beside the present offset."""
        low, high = self.window_v
        most = min(2 * min(high - self.offset_v, self.offset_v - low), self._most_vpp_here)
        return max(most, self.least_vpp)

    @property
    def is_sine(self) -> bool:
        """Whether the shape is a sine."""
        return self.function == "SIN"

    @property
    def _most_vpp_here(self) -> float:
        """Largest amplitude at the present frequency, which matters to sines alone (assumed)."""
        frequency_hz = self.frequency_hz if self.is_sine else 0.0
        return self.model.max_vpp_at(frequency_hz) * per_50_ohm(self.load_ohm)

    @property
    def offset_span_v(self) -> tuple[float, float]:
        """Smallest and largest offset beside the present amplitude; equal where limits are too close."""
        low, high = self.window_v
        lowest = min(low + self.half_v, self.peak_v - self.half_v)
        return lowest, max(high - self.half_v, lowest)

    @property
    def most_hz(self) -> float:
        """Highest frequency of the present shape."""
        return self.model.max_sine_hz

    @property
    def plays_by_rate(self) -> bool:
        """Whether the sample rate says how fast the present shape is, and not the frequency."""
        return False

    @property
    def is_plain_burst(self) -> bool:
        """Whether a burst is one whole waveform per trigger."""
        return self.burst_mode == "TRIG" and self.burst_cycles == 1 and self.burst_phase_deg == 0

    @property
    def arb_codes(self) -> NDArray[np.int16]:
        """Points of the selected waveform, which each family keeps in its own way."""
        raise NotImplementedError

    @property
    def full_code(self) -> int:
        """Code of half the amplitude."""
        return self.model.full_code

    @property
    def point_rate_hz(self) -> float:
        """Points of the selected waveform per second: as told, or as many as it has at its frequency."""
        return self.arb_rate_hz if self.plays_by_rate else self.arb_codes.size * self.frequency_hz

    @property
    def interpolation(self) -> Interpolation:
        """What is between points: the filter behind the converter makes lines of its steps (assumed)."""
        return "linear"

    def set_frequency(self, hertz: float) -> None:
        """Round to the frequency grid and clamp."""
        clamped = clamp(hertz, self.model.min_sine_hz, self.most_hz, self.report)
        self.frequency_hz = round_to_step(clamped, self.model.frequency_step_hz)
        self._fit_amplitude(self._most_vpp_here, "frequency")

    def _fit_amplitude(self, most_vpp: float, new: str) -> None:
        """Reduce an amplitude that something new does not allow, with an error."""
        if self.amplitude_vpp > most_vpp * (1 + LIMIT_SLACK):
            self.amplitude_vpp = most_vpp
            self.report(ScpiError(self.model.conflict_code, f"amplitude reduced for the new {new}"))

    def set_function(self, name: str) -> None:
        """Choose a shape; what the new one cannot do is reduced, with -221."""
        self.function = name
        if self.frequency_hz > self.most_hz:
            self.frequency_hz = self.most_hz
            self.report(ScpiError(self.model.conflict_code, "frequency reduced for the new function"))
        self._fit_amplitude(self._most_vpp_here, "frequency")
        if name != "DC":
            # Limits that were set beside a constant voltage may lie closer than the amplitude it has kept.
            low, high = self.window_v
            self._fit_amplitude(max(high - low, self.least_vpp), "function")
        lowest, highest = self.offset_span_v
        if not lowest - LIMIT_SLACK <= self.offset_v <= highest + LIMIT_SLACK:
            self.offset_v = min(max(self.offset_v, lowest), highest)
            self.report(ScpiError(self.model.conflict_code, "offset changed for the new function"))

    def set_amplitude(self, value: float, unit: str) -> None:
        """Set the amplitude; it is rounded in the unit it is given in.

        Raises
        ------
        ScpiError
            -221 for dBm without a load.
        """
        exact = self.to_vpp(value, unit)
        clamped = clamp(exact, self.least_vpp, self.most_vpp, self.report)
        if clamped == exact:
            rounded = self.to_vpp(round_amplitude(value, self.model), unit)
            clamped = min(max(rounded, self.least_vpp), self.most_vpp)
        self.amplitude_vpp = clamped

    def set_offset(self, volts: float) -> None:
        """Set the offset beside the present amplitude."""
        lowest, highest = self.offset_span_v
        clamped = clamp(volts, lowest, highest, self.report)
        self.offset_v = min(max(round_amplitude(clamped, self.model), lowest), highest)

    def levels(self) -> tuple[float, float]:
        """Low and high level, to 1 nV (assumed), V."""
        half = self.amplitude_vpp / 2
        return round(self.offset_v - half, 9), round(self.offset_v + half, 9)

    def set_level(self, volts: float, high: bool) -> None:
        """Set one level and keep the other; a level on the wrong side moves the other one, with -221."""
        floor, ceiling = self.window_v
        step = self.least_vpp
        low, top = self.levels()
        if high:
            top = clamp(volts, floor + step, ceiling, self.report)
        else:
            low = clamp(volts, floor, ceiling - step, self.report)
        if top - low < step * (1 - LIMIT_SLACK):
            low, top = (top - step, top) if high else (low, low + step)
            self.report(ScpiError(self.model.conflict_code, f"{'low' if high else 'high'} level changed"))
        # At an odd load neither the largest voltage nor the least amplitude is on the grid of 1 nV.
        self.amplitude_vpp = min(max(round(top - low, 9), step), max(ceiling - floor, step))
        lowest, highest = self.offset_span_v
        self.offset_v = min(max(round((top + low) / 2, 9), lowest), highest)

    def set_limits(self, on: bool) -> None:
        """Switch the voltage limits; refused while the waveform exceeds them (assumed)."""
        low, high = self.offset_v - self.half_v, self.offset_v + self.half_v
        if on and (high > self.limit_high_v + LIMIT_SLACK or low < self.limit_low_v - LIMIT_SLACK):
            raise ScpiError(
                self.model.conflict_code, "the present waveform exceeds the limits; limits are off"
            )
        self.limits_on = on

    def limit_span(self, high: bool) -> tuple[float, float]:
        """Where a voltage limit may be: outside of the waveform while limits are on, V."""
        if high:
            return (self.offset_v + self.half_v if self.limits_on else self.limit_low_v), self.peak_v
        return -self.peak_v, (self.offset_v - self.half_v if self.limits_on else self.limit_high_v)

    def set_load(self, ohm: float) -> None:
        """Change the load setting: numbers are rescaled, what leaves the output is not."""
        factor = per_50_ohm(ohm) / per_50_ohm(self.load_ohm)
        self.load_ohm = ohm
        self.amplitude_vpp *= factor
        self.offset_v *= factor
        self.limit_high_v *= factor
        self.limit_low_v *= factor
        if math.isinf(ohm) and self.unit == "DBM":
            self.unit = "VPP"

    def to_vpp(self, value: float, unit: str) -> float:
        """Peak-to-peak volts of an amplitude in VPP, VRMS or DBM."""
        factor = _PEAK_TO_PEAK_PER_RMS.get(self.function, _SINE_PEAK_TO_PEAK_PER_RMS)
        if unit == "DBM":
            self.check_load()
            # 400 dBm is far beyond any limit, and its power of ten is a float.
            return factor * math.sqrt(self.load_ohm * 1e-3 * 10 ** (min(value, 400.0) / 10))
        return value * factor if unit == "VRMS" else value

    def amplitude_in(self, vpp: float) -> float:
        """Write an amplitude in the present unit; converted ones are rounded as entered ones are."""
        if self.unit == "VPP":
            return vpp
        rms = vpp / _PEAK_TO_PEAK_PER_RMS.get(self.function, _SINE_PEAK_TO_PEAK_PER_RMS)
        if self.unit == "DBM":
            rms = 10 * math.log10(rms * rms / self.load_ohm * 1e3)
        return round_amplitude(rms, self.model)

    def check_load(self) -> None:
        """Refuse a power without a load.

        Raises
        ------
        ScpiError
            -221.
        """
        if math.isinf(self.load_ohm):
            raise ScpiError(self.model.conflict_code, "DBM needs a finite load")
