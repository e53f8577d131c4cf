"""What every `FunctionGenerator` promises, as rules that are tried one by one.

What leaves the output can only be seen with a digitizer at the other end of the cut; without one those rules
do not apply. Whatever lies beyond a limit is asked for while the output is off.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from belahil.conformance.rules import NotApplicable, Rule, promised, refused, require, shown
from belahil.conformance.stand import silence, tone_v
from belahil.errors import LinkClosed
from belahil.stimuli import NoSignal, SampledPulse, Sine, TransmittedPulse
from belahil.uncertainty import sized

if TYPE_CHECKING:
    from collections.abc import Callable

    from belahil.conformance.stand import GuardedGenerator, Receiving
    from belahil.stimuli import Stimulus
    from belahil.values import RangeWindow

STANDS_OUT = 5.0
"""What is played is so many times what is seen without it."""
NEAR = 2e-3
"""Relative: an amplitude of four digits, a pulse of twelve bits."""


@dataclass(frozen=True, slots=True)
class GeneratorTried:
    """A generator under test, and who sees what it plays.

    Parameters
    ----------
    player : GuardedGenerator
        Holds the generator.
    seen_by : Receiving or None
        At the other end of the cut.
    """

    player: GuardedGenerator
    seen_by: Receiving | None = None

    @property
    def eye(self) -> Receiving:
        """Who sees what is played."""
        if self.seen_by is None:
            raise NotApplicable("no digitizer was given that sees what is played")
        return self.seen_by

    def tone(self) -> float:
        """Amplitude of the sine that is played in a new window, V at the converter."""
        return tone_v(self.eye.settled(), self.player.sine_hz)

    def asked(self, stimulus: Stimulus, trigger: str = "immediate") -> Callable[[], Stimulus]:
        """Return what asks for a stimulus that may lie beyond the limits, once the output is off.

        An output that cannot be switched off ends the rule before anything is asked.
        """
        generator = self.player.generator
        generator.output(False)
        return lambda: generator.prepare(stimulus, trigger)


def _loudest(window: RangeWindow) -> float:
    return float(np.max(np.abs(window.volts)))


@promised("opening switches the output off")
def _output_off_at_opening(tried: GeneratorTried) -> str:
    at_opening = tried.eye.settled()
    silence(tried.player)
    quiet = tried.eye.settled()
    seen = (
        f"{sized(_loudest(at_opening), 'V', 3)} at the converter, {sized(_loudest(quiet), 'V', 3)} when off"
    )
    require(_loudest(at_opening) <= STANDS_OUT * max(_loudest(quiet), quiet.volts_per_count), seen)
    return seen


@promised("identity is one line that stays the same")
def _identity(tried: GeneratorTried) -> str:
    said = tried.player.generator.identity
    again = tried.player.generator.identity
    require(bool(said.strip()) and said.isprintable() and said == again, f"{said!r}, then {shown(again)}")
    return said


@promised("limits are those of a model that can be")
def _limits(tried: GeneratorTried) -> str:
    model = tried.player.generator.limits
    require(
        0 < model.min_sine_hz < model.max_sine_hz, f"sines of {model.min_sine_hz} to {model.max_sine_hz} Hz"
    )
    require(0 < model.min_points <= model.max_points, f"{model.min_points} to {model.max_points} points")
    require(
        0 < model.min_amplitude_vpp < 2 * model.max_peak_v,
        f"{model.min_amplitude_vpp} Vpp to a peak of {model.max_peak_v} V",
    )
    require(
        2 <= model.dac_bits <= 16 and model.max_arb_rate_hz > 0 and bool(model.interpolations),
        f"{model.dac_bits} bit at {model.max_arb_rate_hz} Sa/s, interpolation {model.interpolations}",
    )
    return (
        f"{model.name}: {sized(2 * model.max_peak_v, 'Vpp')}, {sized(model.max_sine_hz, 'Hz')}, "
        f"{model.max_points} points"
    )


@promised("silence is prepared as it is asked for")
def _prepares_silence(tried: GeneratorTried) -> str:
    for quiet in (NoSignal(), TransmittedPulse()):
        played = tried.player.prepare(quiet)
        require(played == quiet, f"asked for {shown(quiet)}, to be played is {shown(played)}")
    return "NoSignal and TransmittedPulse come back"


@promised("prepare returns the sine that will be played, near the one asked for")
def _prepares_sines(tried: GeneratorTried) -> str:
    for asked in _sines(tried.player):
        played = tried.player.prepare(asked)
        near = (
            isinstance(played, Sine)
            and math.isclose(played.frequency_hz, asked.frequency_hz, rel_tol=NEAR)
            and math.isclose(played.amplitude_vpp, asked.amplitude_vpp, rel_tol=NEAR)
            and abs(played.offset_v - asked.offset_v) <= NEAR * asked.amplitude_vpp
        )
        require(near, f"asked for {shown(asked)}, to be played is {shown(played)}")
    return f"{len(_sines(tried.player))} sines; the last as {shown(played)}"


@promised("prepare returns the pulse that will be played, near the one asked for")
def _prepares_pulses(tried: GeneratorTried) -> str:
    asked = tried.player.pulse()
    for trigger in ("generator", "digitizer"):
        played = tried.player.prepare(asked, trigger)
        require(isinstance(played, SampledPulse), f"asked for a pulse, to be played is {shown(played)}")
        assert isinstance(played, SampledPulse)
        late_s = round(_centre_s(played) - _centre_s(asked), 13)
        model = tried.player.generator.limits
        step_s = max(model.start_step_s(asked.sample_rate_hz), NEAR / asked.sample_rate_hz)
        high, due = float(np.max(played.volts)), float(np.max(asked.volts))
        seen = (
            f"{sized(high, 'V', 6)} of {sized(due, 'V', 6)}, {sized(late_s, 's', 3)} late, trigger {trigger}"
        )
        require(abs(high - due) <= NEAR * due and abs(late_s) <= step_s, seen)
    return seen


@promised("preparing what prepare returned returns it unchanged")
def _stays_on_its_grid(tried: GeneratorTried) -> str:
    pulse = tried.player.pulse()
    odd = replace(pulse, volts=pulse.volts * 0.7531, start_s=pulse.start_s + 0.123456789e-9)
    stimuli: tuple[Stimulus, ...] = (*_sines(tried.player), pulse, odd)
    for asked in stimuli:
        trigger = "generator" if isinstance(asked, SampledPulse) else "immediate"
        played = tried.player.prepare(asked, trigger)
        again = tried.player.prepare(played, trigger)
        require(again == played, f"{shown(played)} becomes {shown(again)} when it is prepared again")
    return f"{len(_sines(tried.player))} sines and 2 pulses come back equal"


@promised("a pulse takes as many triggers as it is given")
def _takes_triggers(tried: GeneratorTried) -> str:
    tried.player.prepare(tried.player.pulse(), "generator")
    for _ in range(3):
        tried.player.generator.trigger()
    played = tried.player.prepare(tried.player.pulse(), "generator")
    require(isinstance(played, SampledPulse), f"after three triggers {shown(played)} is played")
    return "three"


@promised("switching on what is on, and off what is off, changes nothing")
def _output_may_be_repeated(tried: GeneratorTried) -> str:
    with tried.player.playing(NoSignal()):
        tried.player.generator.output(True)
        played = tried.player.prepare(NoSignal())
    tried.player.generator.output(False)
    tried.player.generator.output(False)
    require(played == NoSignal(), f"0 V that are on become {shown(played)}")
    return "on, on, off, off, off with 0 V"


@promised("the output plays when it is on and does not when it is off; prepare does not switch it on")
def _output_switches(tried: GeneratorTried) -> str:
    sine = tried.player.sine()
    silence(tried.player)
    before_v = tried.tone()
    with tried.player.playing(sine):
        on_v = tried.tone()
    off_v = tried.tone()
    tried.player.prepare(sine)
    prepared_v = tried.tone()
    with tried.player.playing(sine):
        again_v = tried.tone()
    told = ", ".join(sized(volts, "V", 3) for volts in (before_v, on_v, off_v, prepared_v, again_v))
    seen = f"silence, on, off, prepared, on: {told} at the converter"
    require(min(on_v, again_v) > STANDS_OUT * max(before_v, off_v, prepared_v), seen)
    return seen


@promised("a triggered pulse reaches the digitizer")
def _pulse_arrives(tried: GeneratorTried) -> str:
    player, eye = tried.player, tried.eye
    if player.trigger not in eye.digitizer.spec.triggers:
        raise NotApplicable(f"the digitizer has no trigger = {player.trigger}")
    whole = eye.digitizer.spec.max_sample_count
    silence(player)
    quiet = eye.taken(eye.request(sample_count=whole))
    delay_s = player.trigger_delay_s if player.trigger == "digitizer" else 0.0
    request = eye.request(sample_count=whole, trigger=player.trigger, delay_s=delay_s)
    with player.playing(player.pulse(), player.trigger):
        eye.clock.sleep_s(eye.settle_s)
        eye.digitizer.arm(request)
        if player.trigger == "generator":
            player.generator.trigger()
        window = eye.digitizer.read(2.0)
    swing_v, noise_v = (float(np.max(np.abs(one.volts - np.median(quiet.volts)))) for one in (window, quiet))
    seen = f"{sized(swing_v, 'V', 3)} at the converter, without it {sized(noise_v, 'V', 3)}"
    require(swing_v > STANDS_OUT * max(noise_v, quiet.volts_per_count), seen)
    return seen


@promised("close returns whether the output is off, and it is")
def _off_when_closed(tried: GeneratorTried) -> str:
    tried.player.prepare(tried.player.sine())
    tried.player.generator.output(True)
    on_v = None if tried.seen_by is None else tried.tone()
    answer = tried.player.generator.close()
    require(isinstance(answer, bool), f"close returns {answer!r}")
    require(answer, "close returns False: the instrument does not confirm that its output is off")
    if on_v is None:
        return "close returns True; no digitizer was given that sees it"
    off_v = tried.tone()
    seen = f"close returns True, {sized(off_v, 'V', 3)} at the converter, {sized(on_v, 'V', 3)} before"
    require(on_v > STANDS_OUT * off_v, seen)
    return seen


@promised("a second close returns the same and raises nothing")
def _closes_twice(tried: GeneratorTried) -> str:
    first, second = tried.player.generator.close(), tried.player.generator.close()
    require(first is second, f"close returns {first!r}, then {second!r}")
    return f"{first}, {second}"


@promised("after close every verb raises LinkClosed; identity and limits still answer")
def _closed_stays_closed(tried: GeneratorTried) -> str:
    generator = tried.player.generator
    generator.close()
    verbs: tuple[tuple[str, Callable[[], object]], ...] = (
        ("prepare", lambda: generator.prepare(NoSignal(), "immediate")),
        ("output(True)", lambda: generator.output(True)),
        ("output(False)", lambda: generator.output(False)),
        ("trigger", generator.trigger),
    )
    for name, verb in verbs:
        seen = refused(f"{name} after close", verb, LinkClosed)
    require(bool(generator.identity) and bool(generator.limits.name), "identity or limits are gone")
    return seen


RULES: tuple[Rule[GeneratorTried], ...] = (
    _output_off_at_opening,
    _identity,
    _limits,
    _prepares_silence,
    _prepares_sines,
    _prepares_pulses,
    _stays_on_its_grid,
    _takes_triggers,
    _output_may_be_repeated,
    _output_switches,
    _pulse_arrives,
)
CLOSING_RULES: tuple[Rule[GeneratorTried], ...] = (_off_when_closed, _closes_twice, _closed_stays_closed)


def _sines(player: GuardedGenerator) -> tuple[Sine, ...]:
    model, sine = player.generator.limits, player.sine()
    rate_hz = min(12.3456789e6, 0.83 * model.max_sine_hz)
    vpp = max(0.53 * sine.amplitude_vpp, player.smallest_vpp)
    offset_v = 0.0371 * sine.amplitude_vpp
    return sine, Sine(rate_hz, vpp, -offset_v), Sine(max(1.2345678e3, model.min_sine_hz), vpp, offset_v)


def _centre_s(pulse: SampledPulse) -> float:
    times_s = pulse.start_s + np.arange(pulse.volts.size) / pulse.sample_rate_hz
    return float(np.sum(times_s * pulse.volts) / np.sum(pulse.volts))
