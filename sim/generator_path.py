"""From the settings of an emulated generator to volts at the cut: converter, errors, attenuator, loading.

What this does not model: the flatness error acts on sines only, since a linear change of amplitude belongs to
no causal filter that a pulse could pass; distortion, spurs, noise and jitter of the generator; its frequency
error (the frequencies are true, clock errors are the receiver's); reflections of an unmatched input; a pad
that differs from its nominal attenuation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from belahil.config import BenchConfig, default_model_name
from belahil.errors import ConfigError
from belahil.generators import (
    MODELS,
    SOURCE_OHM,
    ArbBlock,
    GeneratorModel,
    GeneratorSetting,
    dac_codes,
    open_circuit,
    stimulus_of,
)
from belahil.stimuli import NoSignal, SampledPulse, Sine, scaled

FLATNESS_HZ = 40e6


def true_model(config: BenchConfig) -> GeneratorModel:
    """Return the model that an emulated generator claims to be, with its true highest sample rate.

    Its true resolution does not show here: waveforms are kept as they were sent, and `GeneratorPath` rounds
    what leaves the output.
    """
    model, rate_hz = MODELS[default_model_name(config)], config.emulation.generator.sample_rate_hz
    return replace(model, max_arb_rate_hz=rate_hz or model.max_arb_rate_hz)


@dataclass(frozen=True, slots=True)
class GeneratorPath:
    """What a generator's setting becomes at the cut.

    Parameters
    ----------
    dac_bits : int
        Of the arbitrary waveforms.
    gain : float
        Volts at the cut per open-circuit volt of the setting, with the amplitude error.
    flatness : float
        Relative change of a sine's amplitude from DC to 40 MHz, linear in frequency.
    bandwidth_hz : float
        Of the output's one pole; ``inf`` for none.
    """

    dac_bits: int
    gain: float
    flatness: float
    bandwidth_hz: float

    def stimulus(self, setting: GeneratorSetting) -> NoSignal | Sine | SampledPulse:
        """Return what a setting plays, in volts at the cut."""
        if setting.arb is not None and self.dac_bits < 16:
            setting = replace(setting, arb=_requantized(setting.arb, self.dac_bits))
        played = scaled(stimulus_of(setting), open_circuit(setting.load_ohm) * self.gain)
        if isinstance(played, Sine):
            changed = 1 + self.flatness * played.frequency_hz / FLATNESS_HZ
            passed = 1 / math.hypot(1, played.frequency_hz / self.bandwidth_hz)
            return replace(played, amplitude_vpp=played.amplitude_vpp * changed * passed)
        if isinstance(played, SampledPulse):
            if math.isfinite(self.bandwidth_hz):
                return replace(played, poles=(complex(-2 * math.pi * self.bandwidth_hz),))
            return played
        return NoSignal()


def _requantized(block: ArbBlock, bits: int) -> ArbBlock:
    return replace(block, codes=dac_codes(block.codes / block.full_code, bits, block.full_code))


def generator_path(config: BenchConfig) -> GeneratorPath:
    """Return the emulated path of a bench file.

    The attenuator is a matched 50-ohm pad: cut voltage = V_open 10**(-dB/20) R_in / (50 + R_in), with the
    receiver's true input resistance.

    Raises
    ------
    ConfigError
        Errors that leave no amplitude, or a bandwidth below the receiver's high-pass.
    """
    truth, model = config.emulation.generator, true_model(config)
    if truth.sample_rate_hz is not None and model.arb_played_by == "frequency":
        raise ConfigError(
            f"[emulation.generator] sample_rate_hz = {truth.sample_rate_hz:g}: {model.name} plays waveforms "
            "by their frequency; leave it out"
        )
    if truth.amplitude_error <= -1 or 1 + truth.flatness * model.max_sine_hz / FLATNESS_HZ <= 0:
        raise ConfigError(
            f"[emulation.generator] amplitude_error = {truth.amplitude_error:g}, flatness = "
            f"{truth.flatness:g}: no amplitude is left; allowed: above -1 at every frequency"
        )
    highpass_hz = config.emulation.receiver.highpass_hz
    if truth.bandwidth_hz <= highpass_hz:
        raise ConfigError(
            f"[emulation.generator] bandwidth_hz = {truth.bandwidth_hz:g}: must be above highpass_hz = "
            f"{highpass_hz:g} of the receiver"
        )
    input_ohm = config.emulation.receiver.input_ohm
    divider = 1.0 if math.isinf(input_ohm) else input_ohm / (SOURCE_OHM + input_ohm)
    gain = (1 + truth.amplitude_error) * 10 ** (-config.generator.attenuation_db / 20) * divider
    return GeneratorPath(truth.bits or model.dac_bits, gain, truth.flatness, truth.bandwidth_hz)
