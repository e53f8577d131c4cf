"""A Keysight 33500B or 33600A function generator, as messages make it appear.

What the plant plays is a sine that runs freely, one arbitrary waveform per trigger, and zero volts. All
other shapes, bursts and offsets are accepted, remembered and answered as the real instrument does, but
nothing is played: a shape that is not emulated puts error +901 into the queue when it meets an output that
is on, and everything that is not played sets bit 12 of ``STATus:QUEStionable:CONDition``.

What this does not model: the time that a setting takes, autorange clicks, modulation, sweeps, sequences,
mass memory, the output of the second channel, the frequency of an arbitrary waveform (``FREQ`` is kept apart
from its sample rate), and the ties between pulse width, duty cycle, edges and period.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from belahil.generators import GeneratorSetting
from sim.devices.generator_arb_commands import add_arb_commands
from sim.devices.generator_arbs import ArbMemory
from sim.devices.generator_channel import Channel
from sim.devices.generator_commands import ChannelCommands, add_shape_commands, add_voltage_commands
from sim.devices.generator_output import OutputStage, is_played
from sim.devices.generator_settings import SHARED_SETTINGS, channel_settings
from sim.devices.scpi import ScpiDevice
from sim.devices.scpi.parameters import read_name
from sim.devices.scpi.status import ScpiError
from sim.devices.scpi.tree import Action, Call

if TYPE_CHECKING:
    from belahil.generators import GeneratorModel

NOT_PLAYED_BIT = 1 << 12


class GeneratorPort(Protocol):
    """The generator's side of the plant."""

    def play(self, setting: GeneratorSetting) -> None:
        """Take notice that what leaves the output has changed."""
        ...

    def trigger(self) -> bool:
        """Start a burst that waits for the bus; False when there is nothing to start."""
        ...


class GeneratorDevice(ScpiDevice):
    """One generator of either family; the first channel is the one that is connected.

    Parameters
    ----------
    model : GeneratorModel
        Limits and grids.
    port : GeneratorPort
        What the first channel plays into. It is told after each message that changed what leaves the
        output, and knows that a new generator is silent.
    serial_number : str
        Third field of ``*IDN?``.
    firmware : str
        Fourth field of ``*IDN?``; the default says that this is no real instrument.
    """

    def __init__(
        self,
        model: GeneratorModel,
        port: GeneratorPort,
        serial_number: str = "EMULATED",
        firmware: str = "0.00-emulated",
    ) -> None:
        super().__init__(f"{model.manufacturer},{model.name},{serial_number},{firmware}", model.channels)
        self.model = model
        self._port = port
        self._arbs = [ArbMemory(model) for _ in range(model.channels)]
        self._stage = OutputStage()
        self._played = GeneratorSetting()
        self._complained = False
        self.display = ""
        self._set_defaults()
        self._add_commands()

    def _set_defaults(self) -> None:
        self.channels = [Channel(self.model, arbs, self.report) for arbs in self._arbs]
        self.sync = True
        self.sync_source = "CH1"
        self.trigger_output = False
        self.trigger_output_slope = "POS"
        self.byte_order = "NORM"

    def reset(self) -> None:
        """Bring all settings to their defaults; waveforms in memory stay (assumed)."""
        self._set_defaults()

    def settled(self) -> None:
        """Tell the plant what leaves the output now, when that has changed."""
        setting = self._stage.setting(self.channels[0])
        if setting == self._played:
            return
        self._played = setting
        self.status.questionable.set(NOT_PLAYED_BIT, not is_played(setting))
        unknown = setting.output and self.channels[0].function not in ("SIN", "ARB", "DC")
        if unknown and not self._complained:
            self.report(ScpiError(901, f"{self.channels[0].function} is not emulated; the output is silent"))
        self._complained = unknown
        self._port.play(setting)

    def triggered(self) -> None:
        """Start the bursts that wait for a bus trigger.

        Raises
        ------
        ScpiError
            -211 when no channel waits for one.
        """
        self.settled()
        waiting = [channel.burst and channel.trigger_source == "BUS" for channel in self.channels]
        started = waiting[0] and self._port.trigger()
        if not (started or any(waiting[1:])):
            raise ScpiError(-211)

    def _choose(self, call: Call) -> Channel:
        return self.channels[call.suffixes[0] - 1]

    def _add_commands(self) -> None:
        commands = ChannelCommands(self.tree, self._choose)
        add_shape_commands(commands)
        add_voltage_commands(commands)
        add_arb_commands(commands, self.model.max_points, lambda: self.byte_order == "SWAP")
        for setting in channel_settings(self.model):
            setting.enter(self.tree, self._choose)
        for setting in SHARED_SETTINGS:
            setting.enter(self.tree, lambda call: self)
        self.tree.add("SYSTem:BEEPer[:IMMediate]", Action(lambda call: None))
        self.tree.add("DISPlay:TEXT", Action(self._show, 1, 1), Action(self._shown))
        self.tree.add("DISPlay:TEXT:CLEar", Action(self._show))

    def _shown(self, call: Call) -> str:
        return '"' + self.display.replace('"', '""') + '"'

    def _show(self, call: Call) -> None:
        self.display = read_name(call.parameters[0]) if call.parameters else ""
