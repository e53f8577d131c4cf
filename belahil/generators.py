"""Limits and grids of generator models, as data, and the one rounding that drivers and the plant share.

A stimulus becomes a `GeneratorSetting` by `setting_for`; `stimulus_of` says what such a setting plays.
A driver sends the setting, an emulated instrument builds it from the commands, a simulated instrument takes
it as it is: all three hold equal values.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.errors import LimitExceeded
from belahil.stimuli import Interpolation, NoSignal, SampledPulse, Sine, Stimulus, TransmittedPulse
from belahil.uncertainty import PREFIXES, prefix_power

if TYPE_CHECKING:
    from numpy.typing import NDArray

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


def round_amplitude(volts: float, model: GeneratorModel, *, up: bool = False) -> float:
    """Round an amplitude or offset to the model's significant digits.

    Parameters
    ----------
    volts : float
        V.
    model : GeneratorModel
        Gives the number of digits.
    up : bool
        Away from zero, for an amplitude that must cover a waveform.
    """
    rounded = float(f"{volts:.{model.amplitude_digits - 1}e}")
    if up and rounded < volts:
        exponent = math.floor(math.log10(rounded)) - model.amplitude_digits + 1
        rounded = float(f"{rounded + 10.0**exponent:.{model.amplitude_digits - 1}e}")
    return rounded


def round_to_step(value: float, step: float) -> float:
    """Round to a multiple of a power-of-ten step, exactly as decimal text would."""
    return round(value, -round(math.log10(step)))


def setting_for(
    stimulus: Stimulus, model: GeneratorModel, load_ohm: float = 50.0, trigger: str = "immediate"
) -> GeneratorSetting:
    """Turn a stimulus into the settings that play it, output on.

    A burst rests at the first point of its waveform. A pulse that begins with a jump is therefore played with
    a zero one interval before it; with linear interpolation that makes the jump a ramp over this interval.

    Parameters
    ----------
    stimulus : Stimulus
        In volts into `load_ohm`.
    model : GeneratorModel
        Limits and grids.
    load_ohm : float
        The generator's load setting.
    trigger : {"immediate", "generator", "digitizer"}
        Who starts it; a sampled pulse cannot run by itself and needs one of the last two.

    Raises
    ------
    LimitExceeded
        The model cannot make it; or a pulse begins with a jump less than one interval after its trigger.
    """
    if isinstance(stimulus, Sine):
        return _sine_setting(stimulus, model, load_ohm)
    if isinstance(stimulus, SampledPulse):
        source: TriggerSource = "EXT" if trigger == "digitizer" else "BUS"
        return _pulse_setting(stimulus, model, load_ohm, source)
    return GeneratorSetting(output=True, function="DC", load_ohm=load_ohm)


def _sine_setting(sine: Sine, model: GeneratorModel, load_ohm: float) -> GeneratorSetting:
    if not model.min_sine_hz <= sine.frequency_hz <= model.max_sine_hz:
        raise LimitExceeded(
            f"a sine of {_hertz(sine.frequency_hz)}: {model.name} makes "
            f"{_hertz(model.min_sine_hz)} to {_hertz(model.max_sine_hz)}"
        )
    amplitude = round_amplitude(sine.amplitude_vpp, model)
    offset = round_amplitude(sine.offset_v, model)
    _check_volts(amplitude, abs(offset), model, load_ohm)
    return GeneratorSetting(
        output=True,
        function="SIN",
        frequency_hz=round_to_step(sine.frequency_hz, model.frequency_step_hz),
        amplitude_vpp=amplitude,
        offset_v=offset,
        load_ohm=load_ohm,
    )


def _hertz(frequency_hz: float) -> str:
    power = prefix_power(frequency_hz, "Hz")
    return f"{frequency_hz / 10.0**power:.10g} {PREFIXES[power]}Hz"


def _check_volts(amplitude_vpp: float, offset_v: float, model: GeneratorModel, load_ohm: float) -> None:
    unit = per_50_ohm(load_ohm)
    least, most = model.min_amplitude_vpp * unit, model.max_peak_v * unit
    if amplitude_vpp < least * (1 - 1e-12):
        raise LimitExceeded(
            f"an amplitude of {amplitude_vpp:.4g} Vpp: {model.name} makes at least {least:.4g} Vpp "
            f"into {load_ohm:g} ohm; a larger attenuation_db helps"
        )
    if amplitude_vpp / 2 + offset_v > most * (1 + 1e-12):
        raise LimitExceeded(
            f"{amplitude_vpp:.4g} Vpp with an offset of {offset_v:.4g} V: {model.name} makes at most "
            f"{most:.4g} V peak into {load_ohm:g} ohm"
        )


def _pulse_setting(
    pulse: SampledPulse, model: GeneratorModel, load_ohm: float, source: TriggerSource
) -> GeneratorSetting:
    if pulse.poles:
        raise LimitExceeded(
            f"a pulse that has passed a filter of {len(pulse.poles)} poles: a generator plays points and "
            "straight lines or steps between them; sample what `at` gives"
        )
    rate = round_to_step(pulse.sample_rate_hz, 1e-6)
    if not 0 < rate <= model.max_arb_rate_hz:
        raise LimitExceeded(
            f"an arbitrary waveform at {rate:.10g} Sa/s: {model.name} plays "
            f"at most {model.max_arb_rate_hz:g} Sa/s"
        )
    volts = pulse.volts if pulse.volts[-1] == 0 else np.append(pulse.volts, 0.0)
    peak = float(np.max(np.abs(volts)))
    amplitude = max(
        round_amplitude(2 * peak, model, up=True) if peak else 0.0,
        round_amplitude(model.min_amplitude_vpp * per_50_ohm(load_ohm), model, up=True),
    )
    _check_volts(amplitude, 0.0, model, load_ohm)
    codes = dac_codes(volts * (2 / amplitude), model.dac_bits)
    # A burst rests at the first point of its waveform, so that point must be zero.
    jumps = int(codes[0] != 0)
    delay = round_to_step(pulse.start_s - jumps / rate, model.delay_step_s) + 0.0
    if jumps and pulse.start_s >= 0 > delay:
        raise LimitExceeded(
            f"a pulse that begins with a jump to {pulse.volts[0]:.4g} V at start_s = {pulse.start_s:g}: "
            f"{model.name} rests at the first point, so a zero goes before it; allowed: start_s of at least "
            f"one interval, {1 / rate:.4g} s"
        )
    if not 0 <= delay <= model.max_delay_s:
        raise LimitExceeded(
            f"a pulse that starts {pulse.start_s:g} s after its trigger: {model.name} "
            f"allows 0 to {model.max_delay_s:g} s"
        )
    codes = np.pad(codes, (jumps, max(0, model.min_points - jumps - codes.size)))
    if codes.size > model.max_points:
        raise LimitExceeded(
            f"an arbitrary waveform of {codes.size} points: {model.name} holds at most {model.max_points}"
        )
    block = ArbBlock(codes, rate, pulse.interpolation)
    return GeneratorSetting(
        output=True,
        function="ARB",
        amplitude_vpp=amplitude,
        load_ohm=load_ohm,
        arb=block,
        burst=True,
        trigger_source=source,
        trigger_delay_s=delay,
    )


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


def stimulus_of(setting: GeneratorSetting) -> Stimulus:
    """Return what a setting plays, in volts into its load; `NoSignal` for an unknown shape or an open output.

    A DC offset counts only with a sine: the plant has no use for a constant voltage elsewhere.
    """
    if not setting.output:
        return NoSignal()
    if setting.function == "SIN" and not setting.burst:
        return Sine(setting.frequency_hz, setting.amplitude_vpp, setting.offset_v)
    if setting.function == "ARB" and setting.burst and setting.arb is not None:
        block = setting.arb
        volts = block.codes.astype(np.float64) * (setting.amplitude_vpp / (2 * FULL_CODE))
        return SampledPulse(volts, block.sample_rate_hz, setting.trigger_delay_s, block.interpolation)
    return NoSignal()


def on_grid(
    stimulus: Stimulus, model: GeneratorModel, load_ohm: float = 50.0, trigger: str = "generator"
) -> Stimulus:
    """Return what `model` will really play for a stimulus, in volts into `load_ohm`.

    Raises
    ------
    LimitExceeded
        The model cannot make it.
    """
    if isinstance(stimulus, NoSignal | TransmittedPulse):
        return stimulus
    return stimulus_of(setting_for(stimulus, model, load_ohm, trigger))
