"""A Keysight 33500B or 33600A function generator, as messages make it appear.

What the plant plays is a sine that runs freely, one arbitrary waveform per trigger, and zero volts. All
other shapes, bursts and offsets are accepted, remembered and answered as the real instrument does, but
nothing is played: a shape that is not emulated puts error +901 into the queue when it meets an output that
is on, and everything that is not played sets bit 12 of ``STATus:QUEStionable:CONDition``.

What this does not model: the time that a setting takes, autorange clicks, what a modulation or a sweep does
(all of it is remembered), what coupled channels, a marker, the clock and the network do, angles in other
units than degrees, sequences, mass memory, the output of the second channel, the frequency of an arbitrary
waveform (``FREQ`` is kept apart from its sample rate), and the ties between pulse width, duty cycle, edges
and period.
"""

from __future__ import annotations

from itertools import chain
from typing import TYPE_CHECKING

from sim.devices.generator_arb_commands import add_arb_commands
from sim.devices.generator_arbs import BUILT_IN, ArbMemory
from sim.devices.generator_base import NOT_PLAYED_BIT, EmulatedGenerator, GeneratorPort
from sim.devices.generator_channel import Channel
from sim.devices.generator_commands import (
    LEVEL,
    ChannelCommands,
    add_apply_commands,
    add_keysight_commands,
    add_level_commands,
    add_limit_commands,
    add_load_command,
    add_shape_commands,
)
from sim.devices.generator_modulation import modulation_settings
from sim.devices.generator_settings import (
    OTHER_NAMES,
    SHARED_SETTINGS,
    channel_settings,
)
from sim.devices.generator_system import (
    NO_SETTINGS,
    add_system_commands,
    marker_settings,
    system_settings,
)
from sim.devices.scpi.parameters import read_name
from sim.devices.scpi.status import ScpiError
from sim.devices.scpi.tree import Action, Call

if TYPE_CHECKING:
    from belahil.generators import GeneratorModel

__all__ = ["NOT_PLAYED_BIT", "GeneratorDevice", "GeneratorPort"]


class GeneratorDevice(EmulatedGenerator):
    """A 33500B or 33600A.

    Parameters
    ----------
    model : GeneratorModel
        Limits and grids.
    port : GeneratorPort
        As for `EmulatedGenerator`, and so are the others.
    """

    channels: list[Channel]
    learns = True
    learn_first = (
        "OUTPut#:LOAD",
        "[SOURce#:]FUNCtion:ARBitrary",
        "[SOURce#:]FUNCtion[:SHAPe]",
        "[SOURce#:]VOLTage:UNIT",
        "[SOURce#:]FREQuency[:CW]",
        f"{LEVEL}[:AMPLitude]",
        f"{LEVEL}:OFFSet",
        "[SOURce#:]VOLTage:LIMit:HIGH",
        "[SOURce#:]VOLTage:LIMit:LOW",
    )
    learn_not = frozenset(
        {
            f"{LEVEL}:HIGH",
            f"{LEVEL}:LOW",
            "[SOURce#:]FUNCtion:PULSe:PERiod",
            "[SOURce#:]FUNCtion:ARBitrary:FREQuency",
            "[SOURce#:]FUNCtion:ARBitrary:PERiod",
            "[SOURce#:]FUNCtion:ARBitrary:PTPeak",
            *OTHER_NAMES,
            *NO_SETTINGS,
            "DISPlay:TEXT",
        }
    )

    def __init__(
        self,
        model: GeneratorModel,
        port: GeneratorPort,
        serial_number: str = "EMULATED",
        firmware: str = "0.00-emulated",
    ) -> None:
        super().__init__(model, port, serial_number, firmware)
        self._arbs = [ArbMemory(model) for _ in range(model.channels)]
        self.display = ""
        self._system = system_settings(model)
        rows = (*SHARED_SETTINGS, *(row for row, _ in self._system))
        self.shared_fields = tuple(row.field for row in rows)
        self._set_defaults()
        self._add_commands()

    def _set_defaults(self) -> None:
        self.channels = [Channel(self.model, self.report, arbs=arbs) for arbs in self._arbs]
        self.sync = True
        self.sync_source = "CH1"
        self.trigger_output = False
        self.trigger_output_slope = "POS"
        self.trigger_output_source = "CH1"
        self.byte_order = "NORM"
        self.beeper = True
        self.angle_unit = "DEG"
        self.display_on = True
        for row, value in self._system:
            setattr(self, row.field, value)

    def reset(self) -> None:
        """Bring all settings to their defaults; waveforms in memory stay (assumed)."""
        self._set_defaults()

    def bring_back(self, kept: object) -> None:
        """Make all settings what they were; a waveform that is no more in memory is the built-in one."""
        super().bring_back(kept)
        for channel in self.channels:
            try:
                channel.arbs.codes(channel.arb_name)
            except ScpiError as error:
                channel.arb_name = BUILT_IN
                self.report(error)

    def _choose(self, call: Call) -> Channel:
        return self.channels[call.suffixes[0] - 1]

    def _add_commands(self) -> None:
        commands = ChannelCommands(self.tree, self._choose)
        add_shape_commands(commands)
        add_apply_commands(commands)
        add_keysight_commands(commands)
        add_level_commands(commands)
        add_limit_commands(commands, "[SOURce#:]VOLTage:LIMit")
        add_load_command(commands, "OUTPut#:LOAD")
        add_arb_commands(commands, self.model.max_points, lambda: self.byte_order == "SWAP")
        of_channels = channel_settings, modulation_settings, marker_settings
        for setting in chain.from_iterable(settings(self.model) for settings in of_channels):
            setting.enter(self.tree, self._choose)
        for setting in SHARED_SETTINGS:
            setting.enter(self.tree, lambda call: self)
        for row, _ in self._system:
            row.enter(self.tree, lambda call: self)
        add_system_commands(self)
        self.tree.add("ABORt", Action(lambda call: self.stop()))
        self.tree.add("SYSTem:BEEPer[:IMMediate]", Action(lambda call: None))
        self.tree.add("DISPlay:TEXT", Action(self._show, 1, 1), Action(self._shown))
        self.tree.add("DISPlay:TEXT:CLEar", Action(self._show))

    def _shown(self, call: Call) -> str:
        return '"' + self.display.replace('"', '""') + '"'

    def _show(self, call: Call) -> None:
        self.display = read_name(call.parameters[0]) if call.parameters else ""
