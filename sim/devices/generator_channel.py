"""The settings of a channel of a 33500B or 33600A."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from belahil.generators import Function, TriggerSource
from sim.devices.generator_arbs import BUILT_IN, ArbMemory
from sim.devices.generator_modulation import Modulated

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from belahil.stimuli import Interpolation

# Highest frequency of a ramp as a share of that of a sine (assumed).
_RAMP_SHARE = 1 / 150
_SHAPES: dict[str, Function] = {"SIN": "SIN", "ARB": "ARB", "DC": "DC"}
_SOURCES: dict[str, TriggerSource] = {"IMM": "IMM", "EXT": "EXT", "BUS": "BUS", "TIM": "TIM"}


@dataclass(slots=True)
class Channel(Modulated):
    """One channel of a 33500B or 33600A."""

    arbs: ArbMemory = field(kw_only=True)
    frequency_mode: str = "CW"
    arb_name: str = BUILT_IN
    arb_filter: str = "NORM"
    arb_advance: str = "SRAT"
    square_duty_percent: float = 50.0
    ramp_symmetry_percent: float = 100.0
    pulse_width_s: float = 100e-6
    pulse_duty_percent: float = 10.0
    pulse_hold: str = "WIDT"
    pulse_lead_s: float = 10e-9
    pulse_trail_s: float = 10e-9
    noise_bandwidth_hz: float = 100e3
    bit_rate_hz: float = 1e3
    trigger_timer_s: float = 1.0
    trigger_count: float = 1.0
    output_mode: str = "NORM"
    marker_cycle: float = 2.0
    marker_hz: float = 500.0
    marker_point: float = 10.0
    sync_mode: str = "NORM"
    sync_polarity: str = "NORM"
    combined: str = "NONE"

    @property
    def is_changed(self) -> bool:
        """Whether anything changes the waveform while it plays, gates it, or is added to it."""
        return self.is_modulated or self.output_mode == "GAT" or self.combined != "NONE"

    @property
    def most_hz(self) -> float:
        """Highest frequency of the present shape."""
        top = self.model.max_sine_hz
        return top * _RAMP_SHARE if self.function in ("RAMP", "TRI") else top

    @property
    def plays_by_rate(self) -> bool:
        """Whether the sample rate says how fast the present shape is, and not the frequency."""
        return self.function == "ARB"

    @property
    def shape(self) -> Function:
        """Shape as the plant knows it."""
        return "OTHER" if self.is_changed else _SHAPES.get(self.function, "OTHER")

    @property
    def source(self) -> TriggerSource:
        """What starts a burst."""
        return _SOURCES[self.trigger_source]

    @property
    def is_plain_burst(self) -> bool:
        """Whether a burst is one whole waveform per trigger."""
        return self.arb_advance == "SRAT" and super(Channel, self).is_plain_burst

    @property
    def arb_codes(self) -> NDArray[np.int16]:
        """Points of the selected waveform."""
        return self.arbs.codes(self.arb_name)

    @property
    def interpolation(self) -> Interpolation:
        """What is between points: NORM is a filter without published response, lines are assumed."""
        return "linear" if self.arb_filter == "NORM" else "hold"
