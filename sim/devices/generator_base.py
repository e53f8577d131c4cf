"""What emulated generators of all families share: who hears of a new output, and who starts a burst."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from belahil.generators import GeneratorSetting
from sim.devices.generator_output import OutputStage, Played, is_played
from sim.devices.scpi import ScpiDevice
from sim.devices.scpi.status import ScpiError

if TYPE_CHECKING:
    from collections.abc import Sequence

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


class EmulatedGenerator(ScpiDevice):
    """One generator; the first channel is the one that is connected.

    A family derives from it, fills `channels` and adds its headers. What is not emulated puts error +901
    into the queue when it meets an output that is on, and sets bit 12 of the questionable condition.

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

    channels: Sequence[Played]

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
        self._stage = OutputStage()
        self._played = GeneratorSetting(load_ohm=model.after_reset.load_ohm)
        self._complained = False

    def settled(self) -> None:
        """Tell the plant what leaves the output now, when that has changed."""
        setting = self._stage.setting(self.channels[0])
        if setting == self._played:
            return
        self._played = setting
        self.status.questionable.set(NOT_PLAYED_BIT, not is_played(setting))
        unknown = setting.output and self.channels[0].shape == "OTHER"
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
        waiting = [channel.burst and channel.source == "BUS" for channel in self.channels]
        started = waiting[0] and self._port.trigger()
        if not (started or any(waiting[1:])):
            raise ScpiError(-211)
