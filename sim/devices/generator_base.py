"""What emulated generators of all families share: who hears of a new output, and who starts a burst."""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING, Protocol, cast

from belahil.generators import GeneratorSetting
from sim.devices.generator_output import OutputStage, Played, burst_s, is_played
from sim.devices.scpi import ScpiDevice
from sim.devices.scpi.status import QUEUE_DEPTH, ScpiError

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
        output, and knows that a new generator is silent. When it has a `clock`, bursts take their time on it.
    serial_number : str
        Third field of ``*IDN?``.
    firmware : str
        Fourth field of ``*IDN?``; the default says that this is no real instrument.
    """

    channels: Sequence[Played]
    shared_fields: tuple[str, ...] = ()
    """Settings of the instrument as a whole, for ``*SAV``."""
    signed = True
    """Whether whole numbers and errors are answered with a plus sign."""

    def __init__(
        self,
        model: GeneratorModel,
        port: GeneratorPort,
        serial_number: str = "EMULATED",
        firmware: str = "0.00-emulated",
    ) -> None:
        super().__init__(
            f"{model.manufacturer},{model.name},{serial_number},{firmware}",
            model.channels,
            queue_depth=model.error_queue_depth or QUEUE_DEPTH,
            signed=self.signed,
            clock=getattr(port, "clock", None),
        )
        self.model = model
        self._port = port
        self._stage = OutputStage()
        self._played = GeneratorSetting(load_ohm=model.after_reset.load_ohm)
        self._complained = False

    def settled(self) -> None:
        """Tell the plant what leaves the output now, when that has changed."""
        if not any(channel.burst for channel in self.channels):
            self.stop()
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
        begun = (started, *waiting[1:])
        self.begin(max(burst_s(channel) for channel, runs in zip(self.channels, begun, strict=True) if runs))

    def kept(self) -> object:
        """Return copies of all settings: volts that a change of the load left between two steps stay so."""
        shared = {name: getattr(self, name) for name in self.shared_fields}
        return [copy(channel) for channel in self.channels], shared

    def bring_back(self, kept: object) -> None:
        """Make all settings what they were."""
        channels, shared = cast("tuple[list[Played], dict[str, object]]", kept)
        self.channels = [copy(channel) for channel in channels]
        for name, value in shared.items():
            setattr(self, name, value)
