"""What can be said of a generator model, and the settings that a generator can have."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.stimuli import Interpolation

Function = Literal["SIN", "ARB", "DC", "OTHER"]
TriggerSource = Literal["IMM", "EXT", "BUS", "TIM"]
PlayedBy = Literal["rate", "frequency"]

SOURCE_OHM = 50.0
FULL_CODE = 32767


@dataclass(frozen=True, slots=True)
class AfterReset:
    """What ``*RST`` leaves: a sine of these numbers, the output off; volts are volts into `load_ohm`."""

    frequency_hz: float = 1e3
    amplitude_vpp: float = 0.1
    load_ohm: float = 50.0
    sample_rate_hz: float = 40e3


@dataclass(frozen=True, slots=True)
class GeneratorModel:
    """Limits of one generator model; volts are volts into 50 ohm.

    Parameters
    ----------
    name : str
        Model field of ``*IDN?``.
    manufacturer : str
        Manufacturer field of ``*IDN?``.
    max_sine_hz : float
        Highest sine frequency.
    max_arb_rate_hz : float
        Highest sample rate of an arbitrary waveform.
    dac_bits : int
        Resolution of an arbitrary waveform.
    max_points : int
        Longest arbitrary waveform.
    min_amplitude_vpp, max_peak_v : float
        Smallest amplitude; largest magnitude of offset plus half the amplitude.
    min_sine_hz, frequency_step_hz, min_points, amplitude_digits, delay_step_s
        Lowest frequency, frequency grid, shortest waveform, significant digits of amplitude and offset,
        grid of the trigger delay.
    max_delay_s : float
        Largest trigger delay; 0 for a model that has none, where zeros before a waveform take its place.
    delay_digits : int
        Significant digits of the trigger delay, beside its grid.
    channels : int
        Outputs.
    arb_played_by : {"rate", "frequency"}
        What says how fast a waveform is played: its sample rate, or the frequency of all of it, on the grid
        of `frequency_step_hz`.
    max_arb_hz : float
        Highest frequency of a whole waveform, where that says how fast.
    full_code : int
        Code of half the amplitude; codes go from minus to plus this.
    interpolations : tuple of str
        What it can make of its points.
    load_span_ohm : tuple of float
        Load settings beside high impedance.
    vpp_above_hz : tuple of tuple of float
        Largest amplitude of a sine, Vpp, above a frequency; rising frequencies.
    error_queue_depth : int
        Entries of the error queue; 0 for a model with none that can be relied on.
    conflict_code : int
        Number of the error that tells of settings which do not go together.
    rest_before_on_s : float
        How long a setting takes to act; an output that is switched on earlier plays what was set before.
    after_reset : AfterReset
        Settings after ``*RST``.
    """

    name: str
    manufacturer: str
    max_sine_hz: float
    max_arb_rate_hz: float
    dac_bits: int
    max_points: int
    min_amplitude_vpp: float = 1e-3
    max_peak_v: float = 5.0
    min_sine_hz: float = 1e-6
    frequency_step_hz: float = 1e-6
    min_points: int = 8
    amplitude_digits: int = 4
    delay_step_s: float = 1e-9  # assumed
    max_delay_s: float = 1000.0
    delay_digits: int = 15
    channels: int = 2
    arb_played_by: PlayedBy = "rate"
    max_arb_hz: float = math.inf
    full_code: int = FULL_CODE
    interpolations: tuple[Interpolation, ...] = ("linear", "hold")
    load_span_ohm: tuple[float, float] = (1.0, 10e3)
    vpp_above_hz: tuple[tuple[float, float], ...] = ()
    error_queue_depth: int = 20
    conflict_code: int = -221
    rest_before_on_s: float = 0.0
    after_reset: AfterReset = AfterReset()

    def start_step_s(self, rate_hz: float) -> float:
        """Grid on which a pulse can start after its trigger: of the delay, or of points at `rate_hz`."""
        return self.delay_step_s if self.max_delay_s else 1 / rate_hz

    def started_s(self, start_s: float, rate_hz: float) -> float:
        """Return the nearest start on that grid."""
        if self.max_delay_s:
            stepped = round_to_step(start_s, self.delay_step_s) + 0.0
            return float(f"{stepped:.{self.delay_digits - 1}e}")
        return round(start_s * rate_hz) / rate_hz + 0.0

    def max_vpp_at(self, frequency_hz: float) -> float:
        """Largest amplitude of a sine into 50 ohm, Vpp."""
        most = 2 * self.max_peak_v
        for above_hz, vpp in self.vpp_above_hz:
            if frequency_hz > above_hz:
                most = vpp
        return most


@dataclass(frozen=True, slots=True, eq=False)
class ArbBlock:
    """An arbitrary waveform as the instrument holds it.

    Parameters
    ----------
    codes : ndarray of int16, shape (n,)
        -`full_code` to `full_code` for minus to plus half the amplitude.
    sample_rate_hz : float
        Points per second.
    interpolation : {"linear", "hold"}
        Output filter NORM (assumed: straight lines) or STEP.
    full_code : int
        As in `GeneratorModel`.
    """

    codes: NDArray[np.int16]
    sample_rate_hz: float
    interpolation: Interpolation = "linear"
    full_code: int = FULL_CODE

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if not isinstance(other, ArbBlock):
            return NotImplemented
        return (self.sample_rate_hz, self.interpolation, self.full_code) == (
            other.sample_rate_hz,
            other.interpolation,
            other.full_code,
        ) and np.array_equal(self.codes, other.codes)

    def __hash__(self) -> int:
        return hash((self.codes.tobytes(), self.sample_rate_hz, self.interpolation))


@dataclass(frozen=True, slots=True)
class GeneratorSetting:
    """The settings that decide what leaves the output; volts are volts into `load_ohm`.

    Parameters
    ----------
    output : bool
        Output relay.
    function : {"SIN", "ARB", "DC", "OTHER"}
        What is played; "OTHER" is a shape the plant does not know.
    frequency_hz, amplitude_vpp, offset_v : float
        As set.
    load_ohm : float
        The load setting; ``inf`` for high impedance.
    arb : ArbBlock or None
        The selected arbitrary waveform.
    burst : bool
        One waveform per trigger.
    trigger_source : {"IMM", "EXT", "BUS", "TIM"}
        What starts a burst.
    trigger_delay_s : float
        From the trigger to the first point, s.
    """

    output: bool = False
    function: Function = "SIN"
    frequency_hz: float = 1e3
    amplitude_vpp: float = 0.1
    offset_v: float = 0.0
    load_ohm: float = 50.0
    arb: ArbBlock | None = None
    burst: bool = False
    trigger_source: TriggerSource = "IMM"
    trigger_delay_s: float = 0.0


def per_50_ohm(load_ohm: float) -> float:
    """Setting at `load_ohm` that plays what a setting of 1 plays at 50 ohm; 2 for high impedance."""
    return 2.0 if math.isinf(load_ohm) else 2.0 * load_ohm / (load_ohm + SOURCE_OHM)


def open_circuit(load_ohm: float) -> float:
    """Open-circuit volts per volt of setting: ``(load + 50) / load``."""
    return 1.0 if math.isinf(load_ohm) else (load_ohm + SOURCE_OHM) / load_ohm


def dac_codes(relative: NDArray[np.float64], bits: int, full_code: int = FULL_CODE) -> NDArray[np.int16]:
    """Round a waveform of -1 to 1 to the codes of a DAC with `bits` bits.

    Parameters
    ----------
    relative : ndarray of float64, shape (n,)
        Fraction of half the amplitude.
    bits : int
        2 to 16; codes of a DAC with fewer bits than `full_code` has are multiples of its step.
    full_code : int
        Code of 1.

    Returns
    -------
    ndarray of int16, shape (n,)
        -`full_code` to `full_code`.
    """
    step = code_step(bits, full_code)
    top = full_code // step
    codes = np.clip(np.rint(relative * (full_code / step)), -top, top) * step
    result: NDArray[np.int16] = codes.astype(np.int16)
    return result


def code_step(bits: int, full_code: int) -> int:
    """Return the step of a DAC with `bits` bits, in codes of which `full_code` is half the amplitude."""
    return max(1, (full_code + 1) >> (bits - 1))


def whole_waveform_hz(sample_rate_hz: float, points: int, model: GeneratorModel) -> float:
    """Frequency, on the model's grid, at which `points` points follow each other at a sample rate."""
    return round_to_step(sample_rate_hz / points, model.frequency_step_hz)


def round_to_step(value: float, step: float) -> float:
    """Round to a multiple of a power-of-ten step, exactly as decimal text would."""
    return round(value, -round(math.log10(step)))
