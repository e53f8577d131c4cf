"""Limits and grids of generator models, as data, and the settings that a generator can have."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.errors import LimitExceeded

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.stimuli import Interpolation

Function = Literal["SIN", "ARB", "DC", "OTHER"]
TriggerSource = Literal["IMM", "EXT", "BUS", "TIM"]

SOURCE_OHM = 50.0
FULL_CODE = 32767


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
    channels: int = 2


# Frequencies, amplitudes and memory as in the vendors' public manuals; amplitude digits, delay grid and
# the 33600A's sample rate (summaries disagree between 660 MSa/s and 1 GSa/s) are assumed.
_MODELS_33500 = tuple(
    GeneratorModel(name, "Agilent Technologies", hz, 250e6, 16, 1_000_000, channels=channels)
    for name, hz, channels in (
        ("33509B", 20e6, 1),
        ("33510B", 20e6, 2),
        ("33511B", 20e6, 1),
        ("33512B", 20e6, 2),
        ("33519B", 30e6, 1),
        ("33520B", 30e6, 2),
        ("33521B", 30e6, 1),
        ("33522B", 30e6, 2),
    )
)
_MODELS_33600 = tuple(
    GeneratorModel(name, "Keysight Technologies", hz, rate, 14, 4_000_000, channels=channels)
    for name, hz, rate, channels in (
        ("33611A", 80e6, 660e6, 1),
        ("33612A", 80e6, 660e6, 2),
        ("33621A", 120e6, 1e9, 1),
        ("33622A", 120e6, 1e9, 2),
    )
)
MODELS = {model.name: model for model in (*_MODELS_33500, *_MODELS_33600)}
FAMILIES = {
    "keysight-33500": tuple(model.name for model in _MODELS_33500),
    "keysight-33600": tuple(model.name for model in _MODELS_33600),
}
DEFAULT_MODEL = {"keysight-33500": "33522B", "keysight-33600": "33622A"}


@dataclass(frozen=True, slots=True, eq=False)
class ArbBlock:
    """An arbitrary waveform as the instrument holds it.

    Parameters
    ----------
    codes : ndarray of int16, shape (n,)
        -32767 to 32767 for minus to plus half the amplitude.
    sample_rate_hz : float
        Points per second.
    interpolation : {"linear", "hold"}
        Output filter NORM (assumed: straight lines) or STEP.
    """

    codes: NDArray[np.int16]
    sample_rate_hz: float
    interpolation: Interpolation = "linear"

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if not isinstance(other, ArbBlock):
            return NotImplemented
        return (self.sample_rate_hz, self.interpolation) == (
            other.sample_rate_hz,
            other.interpolation,
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


def model_of(identity: str) -> GeneratorModel:
    """Find the model in an ``*IDN?`` answer.

    Raises
    ------
    LimitExceeded
        The model is not in the tables.
    """
    fields = [part.strip() for part in identity.split(",")]
    name = fields[1] if len(fields) > 1 else ""
    if name not in MODELS:
        raise LimitExceeded(
            f"generator model {name!r} (from {identity!r}) is unknown; known: {', '.join(MODELS)}"
        )
    return MODELS[name]


def per_50_ohm(load_ohm: float) -> float:
    """Setting at `load_ohm` that plays what a setting of 1 plays at 50 ohm; 2 for high impedance."""
    return 2.0 if math.isinf(load_ohm) else 2.0 * load_ohm / (load_ohm + SOURCE_OHM)


def open_circuit(load_ohm: float) -> float:
    """Open-circuit volts per volt of setting: ``(load + 50) / load``."""
    return 1.0 if math.isinf(load_ohm) else (load_ohm + SOURCE_OHM) / load_ohm


def dac_codes(relative: NDArray[np.float64], bits: int) -> NDArray[np.int16]:
    """Round a waveform of -1 to 1 to the codes of a DAC with `bits` bits.

    Parameters
    ----------
    relative : ndarray of float64, shape (n,)
        Fraction of half the amplitude.
    bits : int
        2 to 16; codes of a smaller DAC are multiples of its step.

    Returns
    -------
    ndarray of int16, shape (n,)
        -32767 to 32767.
    """
    step = 2 ** (16 - bits)
    top = FULL_CODE // step
    codes = np.clip(np.rint(relative * (FULL_CODE / step)), -top, top) * step
    result: NDArray[np.int16] = codes.astype(np.int16)
    return result
