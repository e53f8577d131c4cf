"""What every `FunctionGenerator` refuses, and that it works afterwards.

All of it is asked for while the output is off.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from belahil.conformance.rules import promised, refused, require, shown
from belahil.errors import InstrumentRefused, LimitExceeded, RefusedInput
from belahil.stimuli import NoSignal, SampledPulse, Sine

if TYPE_CHECKING:
    from belahil.conformance.generator import GeneratorTried
    from belahil.conformance.rules import Rule


@promised("a frequency that the model cannot make is refused")
def _refuses_frequency(tried: GeneratorTried) -> str:
    model, vpp = tried.player.generator.limits, tried.player.sine().amplitude_vpp
    refused("a sine below the lowest frequency", tried.asked(Sine(model.min_sine_hz / 2, vpp)), LimitExceeded)
    high = Sine(1.01 * model.max_sine_hz, vpp)
    return refused("a sine above the highest frequency", tried.asked(high), LimitExceeded)


@promised("an amplitude that the model cannot make at its load is refused")
def _refuses_amplitude(tried: GeneratorTried) -> str:
    player, hertz = tried.player, tried.player.sine_hz
    refused("an amplitude too small", tried.asked(Sine(hertz, 0.9 * player.smallest_vpp)), LimitExceeded)
    refused("an amplitude too large", tried.asked(Sine(hertz, 1.01 * player.largest_vpp)), LimitExceeded)
    offset = Sine(hertz, 0.5 * player.largest_vpp, 0.26 * player.largest_vpp)
    refused("an amplitude with too large an offset", tried.asked(offset), LimitExceeded)
    pulse = player.pulse()
    tall = replace(pulse, volts=pulse.volts * (0.51 * player.largest_vpp / float(np.max(pulse.volts))))
    return refused("a pulse too tall", tried.asked(tall, "generator"), LimitExceeded)


@promised("a waveform with too many points, or too fast, is refused")
def _refuses_waveform(tried: GeneratorTried) -> str:
    model, pulse = tried.player.generator.limits, tried.player.pulse()
    fast = replace(pulse, sample_rate_hz=1.01 * model.max_arb_rate_hz)
    refused("a waveform too fast", tried.asked(fast, "generator"), LimitExceeded)
    volts = np.zeros(model.max_points + 1)
    volts[1] = float(np.max(pulse.volts))
    return refused("one point too many", tried.asked(replace(pulse, volts=volts), "generator"), LimitExceeded)


@promised("a start that the model cannot make is refused")
def _refuses_start(tried: GeneratorTried) -> str:
    model, pulse = tried.player.generator.limits, tried.player.pulse()
    most_s = model.max_delay_s or model.max_points / pulse.sample_rate_hz
    early, late = replace(pulse, start_s=-1e-6), replace(pulse, start_s=1.01 * most_s)
    refused("a start before the trigger", tried.asked(early, "generator"), LimitExceeded)
    return refused("a start too late", tried.asked(late, "generator"), LimitExceeded)


@promised("a shape that no points make, and one that nobody can start, are refused")
def _refuses_shape(tried: GeneratorTried) -> str:
    model, pulse = tried.player.generator.limits, tried.player.pulse()
    filtered = replace(pulse, poles=(complex(-1e8),))
    refused("a pulse behind a filter", tried.asked(filtered, "generator"), LimitExceeded)
    if "hold" not in model.interpolations:
        held = replace(pulse, interpolation="hold")
        refused("a pulse of steps", tried.asked(held, "generator"), LimitExceeded)
    refused("a pulse with a trigger that is none", tried.asked(pulse, "nobody"), RefusedInput)
    return refused("a pulse that runs freely", tried.asked(pulse, "immediate"), LimitExceeded)


@promised("numbers beyond all bounds are refused; values that are not finite cannot be built")
def _refuses_absurd_numbers(tried: GeneratorTried) -> str:
    pulse, vpp = tried.player.pulse(), tried.player.sine().amplitude_vpp
    for name, asked in (
        ("a frequency of 1e300 Hz", Sine(1e300, vpp)),
        ("a frequency of 1e-300 Hz", Sine(1e-300, vpp)),
        ("an amplitude of 1e300 Vpp", Sine(tried.player.sine_hz, 1e300)),
        ("an offset of 1e300 V", Sine(tried.player.sine_hz, vpp, 1e300)),
        ("a rate of 1e300 Sa/s", replace(pulse, sample_rate_hz=1e300)),
        ("a rate of 1e-300 Sa/s", replace(pulse, sample_rate_hz=1e-300)),
        ("a start at 1e300 s", replace(pulse, start_s=1e300)),
        ("a start at -1e300 s", replace(pulse, start_s=-1e300)),
    ):
        trigger = "generator" if isinstance(asked, SampledPulse) else "immediate"
        seen = refused(name, tried.asked(asked, trigger), LimitExceeded)
    return seen


@promised("a refusal changes nothing: what was prepared before still waits for its trigger")
def _refusal_changes_nothing(tried: GeneratorTried) -> str:
    model = tried.player.generator.limits
    tried.player.prepare(tried.player.pulse(), "generator")
    beyond = Sine(1.01 * model.max_sine_hz, tried.player.sine().amplitude_vpp)
    refused("a sine above the highest frequency", tried.asked(beyond), LimitExceeded)
    tried.player.generator.trigger()
    return "the pulse takes its trigger after the refusal"


@promised("after a refusal the next stimulus is prepared")
def _works_after_refusal(tried: GeneratorTried) -> str:
    pulse = tried.player.pulse()
    early = replace(pulse, start_s=-1e-6)
    refused("a start before the trigger", tried.asked(early, "generator"), LimitExceeded)
    played = tried.player.prepare(pulse, "generator")
    require(isinstance(played, SampledPulse), f"asked for a pulse, to be played is {shown(played)}")
    return "a pulse is prepared after the refusal"


@promised("a trigger that nothing waits for is refused")
def _refuses_needless_trigger(tried: GeneratorTried) -> str:
    for stimulus, trigger in (
        (NoSignal(), "immediate"),
        (tried.player.sine(), "immediate"),
        (tried.player.pulse(), "digitizer"),
    ):
        tried.player.prepare(stimulus, trigger)
        name = f"a trigger for {type(stimulus).__name__} with trigger = {trigger}"
        seen = refused(name, tried.player.generator.trigger, InstrumentRefused)
    return seen


RULES: tuple[Rule[GeneratorTried], ...] = (
    _refuses_frequency,
    _refuses_amplitude,
    _refuses_waveform,
    _refuses_start,
    _refuses_shape,
    _refuses_absurd_numbers,
    _refuses_needless_trigger,
    _refusal_changes_nothing,
    _works_after_refusal,
)
