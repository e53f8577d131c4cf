"""The generator's commands for arbitrary waveforms: upload, catalog, attributes."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from belahil.generators import round_to_step
from sim.devices.generator_arbs import BUILT_IN, average, crest_factor, peak_to_peak, read_points
from sim.devices.generator_channel import Channel
from sim.devices.generator_commands import ChannelCommands, Tokens
from sim.devices.scpi.numeric import HERTZ, SECOND, VOLT, answer_number
from sim.devices.scpi.parameters import read_name

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_RATE_STEP_HZ = 1e-6

_ATTRIBUTES: tuple[tuple[str, Callable[[NDArray[np.int16]], str]], ...] = (
    ("POINts", lambda codes: f"{codes.size:+d}"),
    ("AVERage", lambda codes: answer_number(average(codes))),
    ("PTPeak", lambda codes: answer_number(peak_to_peak(codes))),
    ("CFACtor", lambda codes: answer_number(crest_factor(codes))),
)


def add_arb_commands(
    commands: ChannelCommands[Channel], most_points: int, swapped: Callable[[], bool]
) -> None:
    """Add them.

    Parameters
    ----------
    commands : ChannelCommands
        Where to.
    most_points : int
        Longest list of points.
    swapped : callable
        Whether blocks have their least significant byte first.
    """

    def upload(dac: bool) -> Callable[[Channel, Tokens], None]:
        def store(channel: Channel, tokens: Tokens) -> None:
            points = read_points(tokens[1:], dac, swapped())
            channel.arbs.store(read_name(tokens[0]), points, channel.report)

        return store

    takes = (2, most_points + 1)
    commands.add("[SOURce#:]DATA:ARBitrary", upload(dac=False), takes=takes)
    commands.add("[SOURce#:]DATA:ARBitrary:DAC", upload(dac=True), takes=takes)
    commands.add("[SOURce#:]DATA:VOLatile:CLEar", _clear, takes=(0, 0))
    commands.add("[SOURce#:]DATA:VOLatile:CATalog", query=lambda channel, _: channel.arbs.catalog())
    commands.add("[SOURce#:]DATA:VOLatile:FREE", query=lambda channel, _: f"{channel.arbs.free_points():+d}")
    _add_arb_rates(commands)
    for name, attribute in _ATTRIBUTES:
        commands.add(f"[SOURce#:]DATA:ATTRibute:{name}", query=_attribute(attribute), asks=1)


def _add_arb_rates(commands: ChannelCommands[Channel]) -> None:
    """Add the other names of rate and amplitude: frequency and period of the whole waveform, its span."""

    def points(channel: Channel) -> int:
        return int(channel.arbs.codes(channel.arb_name).size)

    def span(channel: Channel) -> tuple[float, float, float]:
        count = points(channel)
        return 1e-6 / count, channel.model.max_arb_rate_hz / count, 40e3 / count

    def set_rate(channel: Channel, hertz: float) -> None:
        channel.arb_rate_hz = round_to_step(hertz * points(channel), _RATE_STEP_HZ)

    def periods(channel: Channel) -> tuple[float, float, float]:
        least, most, default = span(channel)
        return 1 / most, 1 / least, 1 / default

    form = "[SOURce#:]FUNCtion:ARBitrary"
    commands.add(f"{form}:POINts", query=lambda channel, _: f"{points(channel):+d}")
    commands.add_number(
        f"{form}:FREQuency", HERTZ, span, lambda channel: channel.arb_rate_hz / points(channel), set_rate
    )
    commands.add_number(
        f"{form}:PERiod",
        SECOND,
        periods,
        lambda channel: points(channel) / channel.arb_rate_hz,
        lambda channel, period_s: set_rate(channel, 1 / period_s),
    )
    commands.add_number(
        f"{form}:PTPeak",
        VOLT,
        lambda channel: (channel.least_vpp, channel.most_vpp, 0.1),
        lambda channel: channel.amplitude_vpp,
        lambda channel, volts: channel.set_amplitude(volts, "VPP"),
    )


def _clear(channel: Channel, _: Tokens) -> None:
    channel.arbs.clear()
    channel.arb_name = BUILT_IN


def _attribute(read: Callable[[NDArray[np.int16]], str]) -> Callable[[Channel, Tokens], str]:
    """Return the query of one attribute, of the named waveform or the selected one."""

    def answer(channel: Channel, tokens: Tokens) -> str:
        name = read_name(tokens[0]).upper() if tokens else channel.arb_name
        return read(channel.arbs.codes(name))

    return answer
