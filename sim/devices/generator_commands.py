"""Commands whose settings depend on each other, of all families: shape, frequency, voltages, load, apply."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Generic, TypeVar

from sim.devices.generator_channel import Channel
from sim.devices.generator_levels import Levels
from sim.devices.scpi.numeric import (
    AMPLITUDE,
    HERTZ,
    OHM,
    SAMPLES_PER_SECOND,
    SECOND,
    VOLT,
    Units,
    answer_number,
    read_number,
)
from sim.devices.scpi.parameters import Choices, read_boolean, read_limit, read_name, read_within
from sim.devices.scpi.parser import Token
from sim.devices.scpi.tree import Action, Call, HeaderTree, forms

Tokens = tuple[Token, ...]
Span = tuple[float, float, float]
C = TypeVar("C", bound=Levels)

SHAPES = ("SINusoid", "SQUare", "TRIangle", "RAMP", "PULSe", "PRBS", "NOISe", "ARBitrary", "DC")
_UNIT_CHOICES = Choices("VPP", "VRMS", "DBM")
LEVEL = "[SOURce#:]VOLTage[:LEVel][:IMMediate]"


class ChannelCommands(Generic[C]):
    """Adds commands that act on the channel which their numeric suffix names.

    Parameters
    ----------
    tree : HeaderTree
        Where to.
    choose : callable
        Finds the channel of a call.
    answer : callable
        Writes a number as the family does.
    """

    def __init__(
        self,
        tree: HeaderTree,
        choose: Callable[[Call], C],
        answer: Callable[[float], str] = answer_number,
    ) -> None:
        self._tree = tree
        self._choose = choose
        self.answer = answer

    def add(
        self,
        header: str,
        command: Callable[[C, Tokens], None] | None = None,
        query: Callable[[C, Tokens], str] | None = None,
        takes: tuple[int, int] = (1, 1),
        asks: int = 0,
    ) -> None:
        """Add a header; the command has `takes` parameters, the query at most `asks`."""
        choose = self._choose
        self._tree.add(
            header,
            command and Action(lambda call: command(choose(call), call.parameters), *takes),
            query and Action(lambda call: query(choose(call), call.parameters), 0, asks),
        )

    def add_number(
        self,
        header: str,
        units: Units,
        span: Callable[[C], Span],
        read: Callable[[C], float],
        write: Callable[[C, float], None],
        infinite: bool = False,
    ) -> None:
        """Add a number; `span` gives its smallest and largest value and its default, in this order."""

        def set_it(channel: C, tokens: Tokens) -> None:
            least, most, default = span(channel)
            write(channel, read_within(tokens[0], units, least, most, default, channel.report, infinite))

        def get_it(channel: C, tokens: Tokens) -> str:
            word = read_limit(tokens[0]) if tokens else ""
            known = dict(zip(("MIN", "MAX", "DEF"), span(channel), strict=True))
            return self.answer(known[word] if word in known else read(channel))

        self.add(header, set_it, get_it, asks=1)


def add_shape_commands(
    commands: ChannelCommands[C], shapes: tuple[str, ...] = SHAPES, frequency: str = "FREQuency[:CW]"
) -> None:
    """Add shape and frequency, whose header is `frequency`; `shapes` are written like ``SINusoid``."""
    choices = Choices(*shapes)
    commands.add(
        "[SOURce#:]FUNCtion[:SHAPe]",
        lambda channel, tokens: channel.set_function(choices.read(tokens[0])),
        lambda channel, _: channel.function,
    )
    commands.add_number(
        f"[SOURce#:]{frequency}",
        HERTZ,
        lambda channel: (channel.model.min_sine_hz, channel.most_hz, _first_hz(channel)),
        lambda channel: channel.frequency_hz,
        Levels.set_frequency,
    )


def add_apply_commands(commands: ChannelCommands[C], shapes: tuple[str, ...] = SHAPES) -> None:
    """Add what sets shape, frequency and voltages at once, and plays them."""
    for shape in shapes:
        commands.add(f"[SOURce#:]APPLy:{shape}", _apply(forms(shape)[0]), takes=(0, 3))
    commands.add("[SOURce#:]APPLy", query=_applied(commands.answer))


def add_period_command(commands: ChannelCommands[C], header: str) -> None:
    """Add the period of pulses, which is one over the frequency."""
    commands.add_number(
        header,
        SECOND,
        lambda channel: (1 / channel.most_hz, 1 / channel.model.min_sine_hz, 1 / _first_hz(channel)),
        lambda channel: 1 / channel.frequency_hz,
        lambda channel, period_s: channel.set_frequency(1 / period_s),
    )


def add_keysight_commands(commands: ChannelCommands[Channel]) -> None:
    """Add what only the 33500B and 33600A have: named waveforms, both edges of a pulse, aligned phases."""
    commands.add("[SOURce#:]FUNCtion:ARBitrary", _select_arb, lambda channel, _: f'"{channel.arb_name}"')
    add_period_command(commands, "[SOURce#:]FUNCtion:PULSe:PERiod")
    commands.add("[SOURce#:]FUNCtion:PULSe:TRANsition:BOTH", _set_both_edges)
    commands.add("[SOURce#:]PHASe:SYNChronize", lambda channel, tokens: None, takes=(0, 0))


def _first_hz(channel: Levels) -> float:
    return channel.model.after_reset.frequency_hz


def _select_arb(channel: Channel, tokens: Tokens) -> None:
    name = read_name(tokens[0]).upper()
    channel.arbs.codes(name)
    channel.arb_name = name


def _set_both_edges(channel: Channel, tokens: Tokens) -> None:
    edge_s = read_within(tokens[0], SECOND, 2.9e-9, 1e-6, 10e-9, channel.report)
    channel.pulse_lead_s = channel.pulse_trail_s = edge_s


def _apply(shape: str) -> Callable[[Levels, Tokens], None]:
    """Return the command that chooses a shape, its frequency or rate, amplitude and offset, and plays it."""

    def apply(channel: Levels, tokens: Tokens) -> None:
        apply_levels(channel, tokens, shape)
        channel.trigger_source, channel.burst, channel.autorange = "IMM", False, "ON"
        channel.output = True

    return apply


def apply_levels(channel: Levels, tokens: Tokens, shape: str) -> None:
    """Set shape, frequency or rate, amplitude and offset as APPLy does; what is left out is default."""
    default = Token("character", "DEF")
    first, amplitude, offset = (*tokens, default, default, default)[:3]
    channel.frequency_hz, channel.offset_v = _first_hz(channel), 0.0
    channel.set_function(shape)
    if channel.plays_by_rate:
        most, usual = channel.model.max_arb_rate_hz, channel.model.after_reset.sample_rate_hz
        channel.arb_rate_hz = read_within(first, SAMPLES_PER_SECOND, 1e-6, most, usual, channel.report)
    else:
        least = channel.model.min_sine_hz
        channel.set_frequency(
            read_within(first, HERTZ, least, channel.most_hz, _first_hz(channel), channel.report)
        )
    _set_amplitude(channel, (amplitude,))
    channel.set_offset(read_within(offset, VOLT, *channel.offset_span_v, 0.0, channel.report))


def _applied(answer: Callable[[float], str]) -> Callable[[Levels, Tokens], str]:
    def applied(channel: Levels, _: Tokens) -> str:
        first = channel.arb_rate_hz if channel.plays_by_rate else channel.frequency_hz
        numbers = (first, channel.amplitude_in(channel.amplitude_vpp), channel.offset_v)
        return f'"{channel.function} {",".join(map(answer, numbers))}"'

    return applied


def add_level_commands(commands: ChannelCommands[C]) -> None:
    """Add amplitude, offset, levels and unit."""
    commands.add(f"{LEVEL}[:AMPLitude]", _set_amplitude, _amplitude(commands.answer), asks=1)
    commands.add_number(
        f"{LEVEL}:OFFSet",
        VOLT,
        lambda channel: (*channel.offset_span_v, 0.0),
        lambda channel: channel.offset_v,
        Levels.set_offset,
    )
    for high, name in ((True, "HIGH"), (False, "LOW")):
        _add_level(commands, name, high)
    commands.add("[SOURce#:]VOLTage:UNIT", _set_unit, lambda channel, _: channel.unit)


def add_load_command(commands: ChannelCommands[C], header: str) -> None:
    """Add the load setting."""
    commands.add_number(
        header,
        OHM,
        lambda channel: (*channel.model.load_span_ohm, 50.0),
        lambda channel: channel.load_ohm,
        Levels.set_load,
        infinite=True,
    )


def _add_level(commands: ChannelCommands[C], name: str, high: bool) -> None:
    def level_span(channel: Levels) -> Span:
        low, top = channel.window_v
        step, usual = channel.least_vpp, channel.model.after_reset.amplitude_vpp / 2
        return (low + step, top, usual) if high else (low, top - step, -usual)

    commands.add_number(
        f"{LEVEL}:{name}",
        VOLT,
        level_span,
        lambda channel: channel.levels()[high],
        lambda channel, volts: channel.set_level(volts, high),
    )


def add_limit_commands(commands: ChannelCommands[C], header: str, state: str | None = ":STATe") -> None:
    """Add the instrument's own voltage limits: ``header:HIGH``, ``:LOW``, and their switch if any."""
    if state is not None:
        commands.add(
            f"{header}{state}",
            lambda channel, tokens: channel.set_limits(read_boolean(tokens[0])),
            lambda channel, _: "1" if channel.limits_on else "0",
        )
    for high, name in ((True, "HIGH"), (False, "LOW")):
        _add_limit(commands, f"{header}:{name}", high)


def _add_limit(commands: ChannelCommands[C], header: str, high: bool) -> None:
    def limit_span(channel: Levels) -> Span:
        low, top = channel.limit_span(high)
        return low, top, top if high else low

    def set_limit(channel: Levels, volts: float) -> None:
        if high:
            channel.limit_high_v = volts
        else:
            channel.limit_low_v = volts

    commands.add_number(
        header,
        VOLT,
        limit_span,
        lambda channel: channel.limit_high_v if high else channel.limit_low_v,
        set_limit,
    )


def _amplitude_span(channel: Levels) -> dict[str, float]:
    usual = channel.model.after_reset.amplitude_vpp
    return {"MIN": channel.least_vpp, "MAX": channel.most_vpp, "DEF": usual}


def _set_amplitude(channel: Levels, tokens: Tokens) -> None:
    word = read_limit(tokens[0])
    span = _amplitude_span(channel)
    if word in span:
        channel.set_amplitude(span[word], "VPP")
        return
    beyond = {"INF": (math.inf, "VPP"), "NINF": (-math.inf, "VPP")}
    value, unit = beyond[word] if word else read_number(tokens[0], AMPLITUDE)
    channel.set_amplitude(value, "VPP" if unit == "V" else unit or channel.unit)


def _amplitude(answer: Callable[[float], str]) -> Callable[[Levels, Tokens], str]:
    def amplitude(channel: Levels, tokens: Tokens) -> str:
        word = read_limit(tokens[0]) if tokens else ""
        return answer(channel.amplitude_in(_amplitude_span(channel).get(word, channel.amplitude_vpp)))

    return amplitude


def _set_unit(channel: Levels, tokens: Tokens) -> None:
    unit = _UNIT_CHOICES.read(tokens[0])
    if unit == "DBM":
        channel.check_load()
    channel.unit = unit
