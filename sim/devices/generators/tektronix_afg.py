"""A Tektronix AFG3000C or AFG31000 function generator, as messages make it appear.

It differs from the 33500B: numbers without a sign and with as many digits as they need (four after the point
at least), voltage limits that are always on, one edit memory per channel that is played by the frequency of
the whole, and bursts that ``*TRG`` starts whatever else may start them.

What this does not model: the converter's clock, which leaves points out of a waveform that is played faster
(here all are played), and its filter; modulation, sweeps, added noise; the ties between pulse width, edges
and period; waveforms that outlast the power; the sequencer of an AFG31000.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from belahil.generators import Function, TriggerSource
from sim.devices.generator_base import EmulatedGenerator, GeneratorPort
from sim.devices.generator_commands import (
    ChannelCommands,
    add_level_commands,
    add_limit_commands,
    add_load_command,
    add_period_command,
)
from sim.devices.generator_levels import Levels
from sim.devices.generator_output import burst_s
from sim.devices.generator_settings import Number, Switch, Word
from sim.devices.generators.tektronix_afg_arbs import EditMemory, add_memory_commands, memory_name
from sim.devices.generators.tektronix_afg_modulation import (
    AfgModulated,
    file_settings,
    modulation_settings,
)
from sim.devices.scpi.numeric import DEGREE, HERTZ, PERCENT, SECOND, Units
from sim.devices.scpi.parameters import Choices
from sim.devices.scpi.status import ScpiError
from sim.devices.scpi.tree import Action, Call

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from belahil.generators import GeneratorModel
    from sim.devices.generator_commands import Tokens

_WORDS = Choices(
    "SINusoid", "SQUare", "PULSe", "RAMP", "PRNoise", "DC", "SINC", "GAUSsian", "LORentz", "ERISe",
    "EDECay", "HAVersine",
)  # fmt: skip
# Highest frequencies as shares of a sine's (public driver tables of the vendor; RAMP and the like 1 %).
_HALF = ("SQU", "PULS")
_WHOLE = ("SIN", "DC", "PRN")


def answer_number(value: float) -> str:
    """Write a number with four digits after the point, and up to eleven where they are needed (assumed)."""
    if math.isinf(value):
        return "9.9E+37" if value > 0 else "-9.9E+37"
    for digits in range(4, 11):
        text = f"{value:.{digits}E}"
        if float(text) == value:
            return text
    return f"{value:.11E}"


def answer_short(value: float) -> str:
    """Write a load or a count: a whole number as it is."""
    if math.isinf(value):
        return answer_number(value)
    return f"{value:.0f}" if value.is_integer() else f"{value:g}"


@dataclass(slots=True)
class AfgChannel(AfgModulated):
    """One channel; volts are volts into `load_ohm`."""

    memory: EditMemory = field(kw_only=True)
    number: int = field(kw_only=True)
    burst_cycles: float = 5.0
    limits_on: bool = True
    trigger_source: str = "TIM"
    frequency_mode: str = "CW"
    pulse_duty_percent: float = 50.0
    pulse_hold: str = "DUTY"
    ramp_symmetry_percent: float = 50.0

    @property
    def most_hz(self) -> float:
        """Highest frequency of the present shape."""
        if self.memory_name:
            return self.model.max_arb_hz
        if self.function in _WHOLE:
            return self.model.max_sine_hz
        return self.model.max_sine_hz * (0.5 if self.function in _HALF else 0.01)

    @property
    def memory_name(self) -> str:
        """The waveform that is played; empty for a built-in shape."""
        return self.function if self.function.startswith(("EMEM", "USER")) else ""

    @property
    def shape(self) -> Function:
        """Shape as the plant knows it."""
        if self.is_modulated:
            return "OTHER"
        if self.memory_name:
            return "ARB"
        return "SIN" if self.function == "SIN" else "DC" if self.function == "DC" else "OTHER"

    @property
    def source(self) -> TriggerSource:
        """What starts a burst beside ``*TRG``."""
        return "EXT" if self.trigger_source == "EXT" else "TIM"

    @property
    def is_plain_burst(self) -> bool:
        """Whether a burst is one whole waveform per trigger."""
        return self.burst_mode == "TRIG" and self.burst_cycles == 1 and self.phase_deg == 0

    @property
    def arb_codes(self) -> NDArray[np.int16]:
        """Points of the selected waveform, from -8191 to 8191."""
        return self.memory.codes(self.memory_name)


class TektronixAfg(EmulatedGenerator):
    """An AFG3000C or AFG31000.

    Parameters
    ----------
    model : GeneratorModel
        Limits and grids.
    port : GeneratorPort
        As for `EmulatedGenerator`, and so are the others.
    """

    channels: list[AfgChannel]
    signed = False
    shared_fields = (
        *("trigger_timer_s", "noise_3_percent", "noise_4_percent"),
        *("trigger_mode", "trigger_slope", "reference"),
    )

    def __init__(
        self,
        model: GeneratorModel,
        port: GeneratorPort,
        serial_number: str = "EMULATED",
        firmware: str = "SCPI:99.0 FV:0.00-emulated",
    ) -> None:
        super().__init__(model, port, serial_number, firmware)
        self._memory = EditMemory(model)
        self._set_defaults()
        self._add_commands()

    def _set_defaults(self) -> None:
        self.channels = [
            AfgChannel(self.model, self.report, memory=self._memory, number=number)
            for number in range(1, self.model.channels + 1)
        ]
        self.trigger_mode = "TRIG"
        self.trigger_timer_s, self.noise_3_percent, self.noise_4_percent = 1e-3, 0.0, 0.0
        self.trigger_slope = "POS"
        self.reference = "INT"

    def reset(self) -> None:
        """Bring all settings to their defaults; waveforms in memory stay (assumed)."""
        self._set_defaults()

    def triggered(self) -> None:
        """Start the bursts that wait for any trigger.

        Raises
        ------
        ScpiError
            -211 when no channel waits for one.
        """
        self.settled()
        waiting = [channel.burst for channel in self.channels]
        if not any(waiting):
            raise ScpiError(-211)
        if waiting[0]:
            # The plant knows one source at a time; this instrument takes this one beside the other.
            self._port.play(replace(self._played, trigger_source="BUS"))
            self._port.trigger()
            self._port.play(self._played)
        begun = zip(self.channels, waiting, strict=True)
        self.begin(max(burst_s(channel) for channel, runs in begun if runs))

    def bring_back(self, kept: object) -> None:
        """Make all settings what they were; a waveform that is no longer there becomes a sine."""
        super().bring_back(kept)
        for channel in self.channels:
            if channel.memory_name and channel.memory_name not in self._memory.names:
                self.report(ScpiError(-224, f"{channel.memory_name} is empty"))
                channel.set_function("SIN")

    def _choose(self, call: Call) -> AfgChannel:
        return self.channels[call.suffixes[0] - 1]

    def _set_trigger(self, source: str) -> None:
        for channel in self.channels:
            channel.trigger_source = source

    def _add_commands(self) -> None:
        commands = ChannelCommands(self.tree, self._choose, answer_number)
        _add_shapes(commands)
        add_period_command(commands, "[SOURce#:]PULSe:PERiod")
        add_level_commands(commands)
        add_limit_commands(commands, "[SOURce#:]VOLTage:LIMit", state=None)
        short = ChannelCommands(self.tree, self._choose, answer_short)
        add_load_command(short, "OUTPut#:IMPedance")
        _add_numbers(commands, short)
        add_memory_commands(
            self.tree, self._memory, self.report, lambda: [channel.function for channel in self.channels]
        )
        for setting in _CHANNEL_SETTINGS:
            setting.enter(self.tree, self._choose)
        for remembered in modulation_settings(self.model):
            remembered.enter(self.tree, self._choose, answer_number)
        for kept in file_settings():
            kept.enter(self.tree, self._choose, answer_number)
        for shared in _SHARED_SETTINGS:
            shared.enter(self.tree, lambda call: self)
        for number in _SHARED_NUMBERS:
            number.enter(self.tree, lambda call: self, answer_number)
        sources = Choices("TIMer", "EXTernal")
        self.tree.add(
            "TRIGger[:SEQuence]:SOURce",
            Action(lambda call: self._set_trigger(sources.read(call.parameters[0])), 1, 1),
            Action(lambda call: self.channels[0].trigger_source),
        )
        self.tree.add("TRIGger[:SEQuence][:IMMediate]", Action(lambda call: self.triggered()))
        self.tree.add("ABORt", Action(lambda call: None))
        self.tree.add("SYSTem:BEEPer[:IMMediate]", Action(lambda call: None))


def _add_shapes(commands: ChannelCommands[AfgChannel]) -> None:
    def choose(channel: AfgChannel, tokens: Tokens) -> None:
        name = memory_name(tokens[0], channel.number)
        if name:
            channel.memory.codes(name)
        channel.set_function(name or _WORDS.read(tokens[0]))

    def shown(channel: AfgChannel, _: Tokens) -> str:
        return channel.function[:4] if channel.function.startswith("EMEM") else channel.function

    commands.add("[SOURce#:]FUNCtion[:SHAPe]", choose, shown)


def _add_numbers(commands: ChannelCommands[AfgChannel], short: ChannelCommands[AfgChannel]) -> None:
    for name in ("[:CW]", ":FIXed"):
        commands.add_number(
            f"[SOURce#:]FREQuency{name}",
            HERTZ,
            lambda channel: (channel.model.min_sine_hz, channel.most_hz, 1e6),
            lambda channel: channel.frequency_hz,
            Levels.set_frequency,
        )
    for header, name, units, span in (
        ("PHASe[:ADJust]", "phase_deg", DEGREE, (-180.0, 180.0, 0.0)),
        ("PULSe:DCYCle", "pulse_duty_percent", PERCENT, (0.001, 99.999, 50.0)),
        ("FUNCtion:RAMP:SYMMetry", "ramp_symmetry_percent", PERCENT, (0.0, 100.0, 50.0)),
    ):
        _add_plain(commands, f"[SOURce#:]{header}", name, units, span)
    commands.add_number(
        "[SOURce#:]BURSt:TDELay",
        SECOND,
        lambda channel: (0.0, channel.model.max_delay_s, 0.0),
        lambda channel: channel.trigger_delay_s,
        _set_delay,
    )
    short.add_number(
        "[SOURce#:]BURSt:NCYCles",
        Units(()),
        lambda channel: (1.0, 1e6, 5.0),
        lambda channel: channel.burst_cycles,
        _set_cycles,
        infinite=True,
    )


def _set_delay(channel: AfgChannel, delay_s: float) -> None:
    channel.trigger_delay_s = channel.model.started_s(delay_s, channel.model.max_arb_rate_hz)


def _set_cycles(channel: AfgChannel, cycles: float) -> None:
    channel.burst_cycles = cycles if math.isinf(cycles) else float(round(cycles))


def _add_plain(
    commands: ChannelCommands[AfgChannel],
    header: str,
    name: str,
    units: Units,
    span: tuple[float, float, float],
) -> None:
    commands.add_number(
        header,
        units,
        lambda channel: span,
        lambda channel: float(getattr(channel, name)),
        lambda channel, value: setattr(channel, name, value),
    )


_CHANNEL_SETTINGS: tuple[Word | Switch, ...] = (
    Switch("OUTPut#[:STATe]", "output"),
    Word("OUTPut#:POLarity", "polarity", Choices("NORMal", "INVerted")),
    Switch("[SOURce#:]BURSt[:STATe]", "burst"),
    Word("[SOURce#:]BURSt:MODE", "burst_mode", Choices("TRIGgered", "GATed")),
    Word("[SOURce#:]FREQuency:MODE", "frequency_mode", Choices("CW", "FIXed", "SWEep")),
    Word("[SOURce#:]PULSe:HOLD", "pulse_hold", Choices("WIDTh", "DUTY")),
)
# Settings of the instrument as a whole.
_SHARED_SETTINGS: tuple[Word | Switch, ...] = (
    Word("OUTPut:TRIGger:MODE", "trigger_mode", Choices("TRIGger", "SYNC")),
    Word("TRIGger[:SEQuence]:SLOPe", "trigger_slope", Choices("POSitive", "NEGative")),
    Word("[SOURce:]ROSCillator:SOURce", "reference", Choices("INTernal", "EXTernal")),
)
_SHARED_NUMBERS = (
    Number("TRIGger[:SEQuence]:TIMer", "trigger_timer_s", SECOND, 1e-6, 500.0, 1e-3),
    # Of the noise that may be added to each channel; its sources are called 3 and 4, in short and in full.
    *(
        Number(
            f"{source}{number}:POWer[:LEVel][:IMMediate][:AMPLitude]",
            f"noise_{number}_percent",
            PERCENT,
            0.0,
            50.0,
            0.0,
        )
        for number in (3, 4)
        for source in ("SOUR", "SOURCE")
    ),
)
