"""From a stimulus to the setting of a generator and back: the one rounding that drivers and the plant share.

A stimulus becomes a `GeneratorSetting` by `setting_for`; `stimulus_of` says what such a setting plays.
A driver sends the setting, an emulated instrument builds it from the commands, a simulated instrument takes
it as it is: all three hold equal values. What a model can do is in `belahil.generator_models` and
`belahil.generator_families`, whose names are here too.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import LimitExceeded
from belahil.generator_families import DEFAULT_MODEL, FAMILIES, MODELS, family_of, model_of
from belahil.generator_models import (
    FULL_CODE,
    SOURCE_OHM,
    ArbBlock,
    Function,
    GeneratorModel,
    GeneratorSetting,
    TriggerSource,
    code_step,
    dac_codes,
    open_circuit,
    per_50_ohm,
    round_to_step,
    whole_waveform_hz,
)
from belahil.stimuli import NoSignal, SampledPulse, Sine, Stimulus, TransmittedPulse
from belahil.uncertainty import sized
from belahil.values import TRIGGERS

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = [
    "DEFAULT_MODEL",
    "FAMILIES",
    "FULL_CODE",
    "MODELS",
    "SOURCE_OHM",
    "ArbBlock",
    "Function",
    "GeneratorModel",
    "GeneratorSetting",
    "TriggerSource",
    "bandwidth_sensitivity",
    "behind_output",
    "dac_codes",
    "family_of",
    "model_of",
    "on_grid",
    "open_circuit",
    "per_50_ohm",
    "round_amplitude",
    "round_to_step",
    "setting_for",
    "stimulus_of",
    "whole_waveform_hz",
]


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
    # What an instrument plays at its full code may come out of the calculation one bit higher.
    if up and rounded * (1 + 1e-12) < volts:
        exponent = math.floor(math.log10(rounded)) - model.amplitude_digits + 1
        rounded = float(f"{rounded + 10.0**exponent:.{model.amplitude_digits - 1}e}")
    return rounded


def setting_for(
    stimulus: Stimulus, model: GeneratorModel, load_ohm: float = 50.0, trigger: str = "generator"
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
        The model cannot make it, or nobody can start it so; or a pulse begins with a jump less than one
        interval after its trigger.
    """
    allowed = TRIGGERS[1:] if isinstance(stimulus, SampledPulse) else TRIGGERS
    if trigger not in allowed:
        raise LimitExceeded(
            f"a {type(stimulus).__name__} with trigger = {trigger}: allowed: {', '.join(allowed)}"
        )
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
    most = model.max_vpp_at(sine.frequency_hz) * per_50_ohm(load_ohm)
    if amplitude > most * (1 + 1e-12):
        raise LimitExceeded(
            f"a sine of {_hertz(sine.frequency_hz)} with {amplitude:.4g} Vpp: {model.name} makes at most "
            f"{most:.4g} Vpp there into {load_ohm:g} ohm"
        )
    return GeneratorSetting(
        output=True,
        function="SIN",
        frequency_hz=round_to_step(sine.frequency_hz, model.frequency_step_hz),
        amplitude_vpp=amplitude,
        offset_v=offset,
        load_ohm=load_ohm,
    )


def _hertz(frequency_hz: float) -> str:
    return sized(frequency_hz, "Hz", 10)


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
    if pulse.interpolation not in model.interpolations:
        raise LimitExceeded(
            f"a pulse with interpolation {pulse.interpolation} between its points: {model.name} makes "
            f"{' or '.join(model.interpolations)}"
        )
    rate = round_to_step(pulse.sample_rate_hz, 1e-6)
    if not 0 < rate <= model.max_arb_rate_hz:
        raise LimitExceeded(
            f"an arbitrary waveform at {rate:.10g} Sa/s: {model.name} plays "
            f"at most {model.max_arb_rate_hz:g} Sa/s"
        )
    volts = pulse.volts if pulse.volts[-1] == 0 else np.append(pulse.volts, 0.0)
    _check_points(volts.size, model)
    amplitude, codes = _codes(volts, model, load_ohm)
    # A burst rests at the first point of its waveform, so that point must be zero.
    jumps = int(codes[0] != 0)
    delay = _delay(pulse, jumps / rate, model)
    if not model.max_delay_s:
        delay, waited = 0.0, round(delay * rate)
        jumps += waited
    codes = np.pad(codes, (jumps, max(0, _fewest_points(rate, model) - jumps - codes.size)))
    _check_points(codes.size, model)
    if model.arb_played_by == "frequency":
        whole_hz = whole_waveform_hz(rate, codes.size, model)
        if codes.size * whole_hz > model.max_arb_rate_hz:
            whole_hz = round_to_step(whole_hz - model.frequency_step_hz, model.frequency_step_hz)
        rate = codes.size * whole_hz
    return GeneratorSetting(
        output=True,
        function="ARB",
        amplitude_vpp=amplitude,
        load_ohm=load_ohm,
        arb=ArbBlock(codes, rate, pulse.interpolation, model.full_code),
        burst=True,
        trigger_source=source,
        trigger_delay_s=delay,
    )


def _codes(
    volts: NDArray[np.float64], model: GeneratorModel, load_ohm: float
) -> tuple[float, NDArray[np.int16]]:
    """Return an amplitude on the grid that a waveform fills, and its codes at that amplitude.

    It is the smallest that covers the waveform, but where the peak, rounded down, is covered by a smaller one
    already: what is played would come out elsewhere when it is played again. There the smaller one is taken
    and cuts the peak by less than half a step; or, where its largest code leaves more than that of a peak,
    the peak is rounded up.
    """
    peak = float(np.max(np.abs(volts)))
    least = round_amplitude(model.min_amplitude_vpp * per_50_ohm(load_ohm), model, up=True)
    amplitude = max(_covering(peak, model), least)
    _check_volts(amplitude, 0.0, model, load_ohm)
    codes = dac_codes(volts * (2 / amplitude), model.dac_bits, model.full_code)
    smaller = max(_covering(_played_peak(amplitude, codes, model), model), least)
    if smaller >= amplitude:
        return amplitude, codes
    filled = dac_codes(volts * (2 / smaller), model.dac_bits, model.full_code)
    highest = np.abs(volts) == peak
    codes[highest] += np.sign(volts[highest]).astype(np.int16) * code_step(model.dac_bits, model.full_code)
    cut = peak - _played_peak(smaller, filled, model)
    return (smaller, filled) if cut < _played_peak(amplitude, codes, model) - peak else (amplitude, codes)


def _played_peak(amplitude: float, codes: NDArray[np.int16], model: GeneratorModel) -> float:
    return int(np.max(np.abs(codes))) * amplitude / (2 * model.full_code)


def _covering(peak_v: float, model: GeneratorModel) -> float:
    return round_amplitude(2 * peak_v, model, up=True) if peak_v else 0.0


def _check_points(points: int, model: GeneratorModel) -> None:
    if points > model.max_points:
        raise LimitExceeded(
            f"an arbitrary waveform of {points} points: {model.name} holds at most {model.max_points}"
        )


def _fewest_points(rate_hz: float, model: GeneratorModel) -> int:
    """Fewest points of a waveform at a rate: all of it may repeat no faster than the model can."""
    return max(model.min_points, math.ceil(rate_hz / model.max_arb_hz))


def _delay(pulse: SampledPulse, before_s: float, model: GeneratorModel) -> float:
    """Return the trigger delay of a waveform that starts `before_s` earlier than its pulse.

    It is on the model's grid; a model without one waits by zeros, on the grid of its points.
    """
    rate_hz = pulse.sample_rate_hz
    most = model.max_delay_s or model.max_points / rate_hz
    delay = pulse.start_s - before_s
    if abs(delay) <= 2 * most:  # what is beyond may have no number on the grid
        delay = model.started_s(delay, rate_hz)
    if before_s and pulse.start_s >= 0 > delay:
        raise LimitExceeded(
            f"a pulse that begins with a jump to {pulse.volts[0]:.4g} V at start_s = {pulse.start_s:g}: "
            f"{model.name} rests at the first point, so a zero goes before it; allowed: start_s of at least "
            f"one interval, {before_s:.4g} s"
        )
    if not 0 <= delay <= most:
        raise LimitExceeded(
            f"a pulse that starts {pulse.start_s:g} s after its trigger: {model.name} allows 0 to {most:g} s"
        )
    return delay


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
        volts = block.codes.astype(np.float64) * (setting.amplitude_vpp / (2 * block.full_code))
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


def behind_output(stimulus: Stimulus, bandwidth_hz: float) -> Stimulus:
    """Return what leaves an output stage of one pole.

    Parameters
    ----------
    stimulus : Stimulus
        Before it.
    bandwidth_hz : float
        -3 dB frequency; ``inf`` for a stage that changes nothing.
    """
    if math.isinf(bandwidth_hz):
        return stimulus
    if isinstance(stimulus, Sine):
        passed = 1 / math.hypot(1, stimulus.frequency_hz / bandwidth_hz)
        return replace(stimulus, amplitude_vpp=stimulus.amplitude_vpp * passed)
    if isinstance(stimulus, SampledPulse):
        return replace(stimulus, poles=(*stimulus.poles, complex(-2 * math.pi * bandwidth_hz)))
    return stimulus


def bandwidth_sensitivity(frequency_hz: ArrayLike, bandwidth_hz: float) -> NDArray[np.float64]:
    """Return by how much a relative change of `bandwidth_hz` changes a sine's amplitude, relative.

    That is x^2 / (1 + x^2) with x = f / f_b.

    Parameters
    ----------
    frequency_hz : array_like of float, shape (n,)
        Of the sines.
    bandwidth_hz : float
        As in `behind_output`; ``inf`` gives 0.
    """
    square = (np.asarray(frequency_hz, dtype=np.float64) / bandwidth_hz) ** 2
    return np.asarray(square / (1 + square))
