"""The generator's commands whose settings depend on each other: shape, frequency, voltages, load, apply."""

from __future__ import annotations

import math
from collections.abc import Callable

from sim.devices.generator_channel import Channel
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
from sim.devices.scpi.tree import Action, Call, HeaderTree

Tokens = tuple[Token, ...]
Span = tuple[float, float, float]

SHAPES = ("SINusoid", "SQUare", "TRIangle", "RAMP", "PULSe", "PRBS", "NOISe", "ARBitrary", "DC")
_SHAPE_CHOICES = Choices(*SHAPES)
_UNIT_CHOICES = Choices("VPP", "VRMS", "DBM")
_LEVEL = "[SOURce#:]VOLTage[:LEVel][:IMMediate]"
_DEFAULT_HZ = 1e3
_DEFAULT_VPP = 0.1


class ChannelCommands:
    """Adds commands that act on the channel which their numeric suffix names.

    Parameters
    ----------
    tree : HeaderTree
        Where to.
    choose : callable
        Finds the channel of a call.
    """

    def __init__(self, tree: HeaderTree, choose: Callable[[Call], Channel]) -> None:
        self._tree = tree
        self._choose = choose

    def add(
        self,
        header: str,
        command: Callable[[Channel, Tokens], None] | None = None,
        query: Callable[[Channel, Tokens], str] | None = None,
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
        span: Callable[[Channel], Span],
        read: Callable[[Channel], float],
        write: Callable[[Channel, float], None],
        infinite: bool = False,
    ) -> None:
        """Add a number; `span` gives its smallest and largest value and its default, in this order."""

        def set_it(channel: Channel, tokens: Tokens) -> None:
            least, most, default = span(channel)
            write(channel, read_within(tokens[0], units, least, most, default, channel.report, infinite))

        def get_it(channel: Channel, tokens: Tokens) -> str:
            word = read_limit(tokens[0]) if tokens else ""
            known = dict(zip(("MIN", "MAX", "DEF"), span(channel), strict=True))
            return answer_number(known[word] if word in known else read(channel))

        self.add(header, set_it, get_it, asks=1)


def add_shape_commands(commands: ChannelCommands) -> None:
    """Add shape, frequency, pulse period, and what sets all at once."""
    commands.add(
        "[SOURce#:]FUNCtion[:SHAPe]",
        lambda channel, tokens: channel.set_function(_SHAPE_CHOICES.read(tokens[0])),
        lambda channel, _: channel.function,
    )
    commands.add("[SOURce#:]FUNCtion:ARBitrary", _select_arb, lambda channel, _: f'"{channel.arb_name}"')
    commands.add_number(
        "[SOURce#:]FREQuency[:CW]",
        HERTZ,
        lambda channel: (channel.model.min_sine_hz, channel.most_hz, _DEFAULT_HZ),
        lambda channel: channel.frequency_hz,
        Channel.set_frequency,
    )
    commands.add_number(
        "[SOURce#:]FUNCtion:PULSe:PERiod",
        SECOND,
        lambda channel: (1 / channel.most_hz, 1 / channel.model.min_sine_hz, 1 / _DEFAULT_HZ),
        lambda channel: 1 / channel.frequency_hz,
        lambda channel, period_s: channel.set_frequency(1 / period_s),
    )
    commands.add("[SOURce#:]FUNCtion:PULSe:TRANsition:BOTH", _set_both_edges)
    for shape in SHAPES:
        commands.add(f"[SOURce#:]APPLy:{shape}", _apply(shape), takes=(0, 3))
    commands.add("[SOURce#:]APPLy", query=_applied)
    commands.add("[SOURce#:]PHASe:SYNChronize", lambda channel, tokens: None, takes=(0, 0))


def _select_arb(channel: Channel, tokens: Tokens) -> None:
    name = read_name(tokens[0]).upper()
    channel.arbs.codes(name)
    channel.arb_name = name


def _set_both_edges(channel: Channel, tokens: Tokens) -> None:
    edge_s = read_within(tokens[0], SECOND, 2.9e-9, 1e-6, 10e-9, channel.report)
    channel.pulse_lead_s = channel.pulse_trail_s = edge_s


def _apply(word: str) -> Callable[[Channel, Tokens], None]:
    """Return the command that chooses a shape, its frequency or rate, amplitude and offset, and plays it."""
    shape = _SHAPE_CHOICES.read(Token("character", word))
    default = Token("character", "DEF")

    def apply(channel: Channel, tokens: Tokens) -> None:
        first, amplitude, offset = (*tokens, default, default, default)[:3]
        channel.frequency_hz, channel.offset_v = _DEFAULT_HZ, 0.0
        channel.set_function(shape)
        if shape == "ARB":
            most = channel.model.max_arb_rate_hz
            channel.arb_rate_hz = read_within(first, SAMPLES_PER_SECOND, 1e-6, most, 40e3, channel.report)
        else:
            least = channel.model.min_sine_hz
            channel.set_frequency(
                read_within(first, HERTZ, least, channel.most_hz, _DEFAULT_HZ, channel.report)
            )
        _set_amplitude(channel, (amplitude,))
        channel.set_offset(read_within(offset, VOLT, *channel.offset_span_v, 0.0, channel.report))
        channel.trigger_source, channel.burst, channel.autorange = "IMM", False, "ON"
        channel.output = True

    return apply


def _applied(channel: Channel, _: Tokens) -> str:
    first = channel.arb_rate_hz if channel.function == "ARB" else channel.frequency_hz
    numbers = (first, channel.amplitude_in(channel.amplitude_vpp), channel.offset_v)
    return f'"{channel.function} {",".join(map(answer_number, numbers))}"'


def add_voltage_commands(commands: ChannelCommands) -> None:
    """Add amplitude, offset, levels, unit, limits and load."""
    commands.add(f"{_LEVEL}[:AMPLitude]", _set_amplitude, _amplitude, asks=1)
    commands.add_number(
        f"{_LEVEL}:OFFSet",
        VOLT,
        lambda channel: (*channel.offset_span_v, 0.0),
        lambda channel: channel.offset_v,
        Channel.set_offset,
    )
    for high, name in ((True, "HIGH"), (False, "LOW")):
        _add_level(commands, name, high)
    commands.add("[SOURce#:]VOLTage:UNIT", _set_unit, lambda channel, _: channel.unit)
    commands.add(
        "[SOURce#:]VOLTage:LIMit:STATe",
        lambda channel, tokens: channel.set_limits(read_boolean(tokens[0])),
        lambda channel, _: "1" if channel.limits_on else "0",
    )
    commands.add_number(
        "OUTPut#:LOAD",
        OHM,
        lambda channel: (1.0, 10e3, 50.0),
        lambda channel: channel.load_ohm,
        Channel.set_load,
        infinite=True,
    )


def _add_level(commands: ChannelCommands, name: str, high: bool) -> None:
    def level_span(channel: Channel) -> Span:
        low, top = channel.window_v
        step = channel.least_vpp
        return (low + step, top, _DEFAULT_VPP / 2) if high else (low, top - step, -_DEFAULT_VPP / 2)

    def limit_span(channel: Channel) -> Span:
        low, top = channel.limit_span(high)
        return low, top, top if high else low

    def set_limit(channel: Channel, volts: float) -> None:
        if high:
            channel.limit_high_v = volts
        else:
            channel.limit_low_v = volts

    commands.add_number(
        f"{_LEVEL}:{name}",
        VOLT,
        level_span,
        lambda channel: channel.levels()[high],
        lambda channel, volts: channel.set_level(volts, high),
    )
    commands.add_number(
        f"[SOURce#:]VOLTage:LIMit:{name}",
        VOLT,
        limit_span,
        lambda channel: channel.limit_high_v if high else channel.limit_low_v,
        set_limit,
    )


def _amplitude_span(channel: Channel) -> dict[str, float]:
    return {"MIN": channel.least_vpp, "MAX": channel.most_vpp, "DEF": _DEFAULT_VPP}


def _set_amplitude(channel: Channel, tokens: Tokens) -> None:
    word = read_limit(tokens[0])
    span = _amplitude_span(channel)
    if word in span:
        channel.set_amplitude(span[word], "VPP")
        return
    beyond = {"INF": (math.inf, "VPP"), "NINF": (-math.inf, "VPP")}
    value, unit = beyond[word] if word else read_number(tokens[0], AMPLITUDE)
    channel.set_amplitude(value, "VPP" if unit == "V" else unit or channel.unit)


def _amplitude(channel: Channel, tokens: Tokens) -> str:
    word = read_limit(tokens[0]) if tokens else ""
    return answer_number(channel.amplitude_in(_amplitude_span(channel).get(word, channel.amplitude_vpp)))


def _set_unit(channel: Channel, tokens: Tokens) -> None:
    unit = _UNIT_CHOICES.read(tokens[0])
    if unit == "DBM":
        channel.check_load()
    channel.unit = unit
