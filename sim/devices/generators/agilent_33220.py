"""An Agilent 33220A function generator, as messages make it appear.

It differs from the 33500B: headers without numbers, one VOLATILE waveform of 14 bits that is played by the
frequency of the whole, no trigger delay, no voltage limits of its own, and -222 where that says -221.

What this does not model: the 50-MHz converter, which leaves points out of a waveform that is played faster
(here all are played), and its filter; autorange clicks; modulation and sweeps; stored states and
waveforms that outlast the power; the built-in CARDIAC; the ties between pulse width, edges and period.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from belahil.generators import Function, TriggerSource
from sim.devices.generator_base import EmulatedGenerator, GeneratorPort
from sim.devices.generator_commands import (
    LEVEL,
    ChannelCommands,
    add_apply_commands,
    add_level_commands,
    add_load_command,
    add_period_command,
    add_shape_commands,
)
from sim.devices.generator_levels import Levels
from sim.devices.generator_settings import Number, Setting, Switch, Word
from sim.devices.generators.agilent_33220_arbs import EXP_RISE, UserMemory, add_user_commands
from sim.devices.scpi.numeric import DEGREE, PERCENT, SECOND
from sim.devices.scpi.parameters import Choices, read_name
from sim.devices.scpi.status import ScpiError
from sim.devices.scpi.tree import Action, Call

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from belahil.generators import GeneratorModel

SHAPES = ("SINusoid", "SQUare", "RAMP", "PULSe", "NOISe", "DC", "USER")
# Highest frequencies beside a sine's and a square's (public data sheet, from memory: assumed).
_MOST_HZ = {"RAMP": 200e3, "PULS": 5e6}
_SHAPES: dict[str, Function] = {"SIN": "SIN", "USER": "ARB", "DC": "DC"}
_SOURCES: dict[str, TriggerSource] = {"IMM": "IMM", "EXT": "EXT", "BUS": "BUS"}


# Settings of the instrument as a whole.
_SHARED_SETTINGS: tuple[Word | Switch, ...] = (
    Switch("OUTPut:SYNC[:STATe]", "sync"),
    Switch("OUTPut:TRIGger[:STATe]", "trigger_output"),
    Word("OUTPut:TRIGger:SLOPe", "trigger_output_slope", Choices("POSitive", "NEGative")),
    Word("FORMat:BORDer", "byte_order", Choices("NORMal", "SWAPped")),
    Word("UNIT:ANGLe", "angle_unit", Choices("DEGree", "RADian")),
    Switch("DISPlay[:STATe]", "display_on"),
    Switch("SYSTem:BEEPer:STATe", "beeper"),
    Word("SYSTem:COMMunicate:RLSTate", "remote", Choices("LOCal", "REMote", "RWLock")),
)


@dataclass(slots=True)
class UserChannel(Levels):
    """The one channel; volts are volts into `load_ohm`."""

    memory: UserMemory = field(kw_only=True)
    user_name: str = EXP_RISE
    square_duty_percent: float = 50.0
    ramp_symmetry_percent: float = 100.0
    pulse_width_s: float = 100e-6
    pulse_duty_percent: float = 10.0
    pulse_hold: str = "WIDT"
    pulse_edge_s: float = 5e-9

    @property
    def most_hz(self) -> float:
        """Highest frequency of the present shape."""
        if self.function == "USER":
            return self.model.max_arb_hz
        return _MOST_HZ.get(self.function, self.model.max_sine_hz)

    @property
    def shape(self) -> Function:
        """Shape as the plant knows it."""
        return _SHAPES.get(self.function, "OTHER")

    @property
    def source(self) -> TriggerSource:
        """What starts a burst."""
        return _SOURCES[self.trigger_source]

    @property
    def arb_codes(self) -> NDArray[np.int16]:
        """Points of the selected waveform."""
        return self.memory.codes(self.user_name)


class Agilent33220(EmulatedGenerator):
    """A 33220A.

    Parameters
    ----------
    model : GeneratorModel
        Limits and grids.
    port : GeneratorPort
        As for `EmulatedGenerator`, and so are the others.
    """

    channels: list[UserChannel]
    shared_fields = tuple(setting.field for setting in _SHARED_SETTINGS)
    learns = True
    learn_first = (
        "OUTPut:LOAD",
        "[SOURce#:]FUNCtion:USER",
        "[SOURce#:]FUNCtion[:SHAPe]",
        "[SOURce#:]VOLTage:UNIT",
        "[SOURce#:]FREQuency[:CW]",
        f"{LEVEL}[:AMPLitude]",
        f"{LEVEL}:OFFSet",
    )
    learn_not = frozenset(
        {
            f"{LEVEL}:HIGH",
            f"{LEVEL}:LOW",
            "[SOURce#:]PULSe:PERiod",
            "DISPlay:TEXT",
            "SYSTem:COMMunicate:RLSTate",
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
        self._memory = UserMemory(model)
        self.display = ""
        self.remote = "REM"
        self._set_defaults()
        self._add_commands()

    def _set_defaults(self) -> None:
        self.channels = [UserChannel(self.model, self.report, memory=self._memory)]
        self.sync = True
        self.trigger_output = False
        self.trigger_output_slope = "POS"
        self.byte_order = "NORM"
        self.angle_unit = "DEG"
        self.beeper = True
        self.display_on = True

    def reset(self) -> None:
        """Bring all settings to their defaults; waveforms in memory stay (assumed)."""
        self._set_defaults()

    def bring_back(self, kept: object) -> None:
        """Make all settings what they were; a waveform that is no more in memory is the built-in one."""
        super().bring_back(kept)
        (channel,) = self.channels
        try:
            self._memory.codes(channel.user_name)
        except ScpiError as error:
            channel.user_name = EXP_RISE
            self.report(error)

    def _choose(self, call: Call) -> UserChannel:
        return self.channels[0]

    def _add_commands(self) -> None:
        commands = ChannelCommands(self.tree, self._choose)
        add_shape_commands(commands, SHAPES)
        add_apply_commands(commands, SHAPES)
        add_period_command(commands, "[SOURce#:]PULSe:PERiod")
        add_level_commands(commands)
        add_load_command(commands, "OUTPut:LOAD")
        add_user_commands(commands, self.model.max_points, lambda: self.byte_order == "SWAP")
        for setting in _channel_settings():
            setting.enter(self.tree, self._choose)
        for shared in _SHARED_SETTINGS:
            shared.enter(self.tree, lambda call: self)
        self.tree.add("SYSTem:BEEPer[:IMMediate]", Action(lambda call: None))
        self.tree.add("DISPlay:TEXT", Action(self._show, 1, 1), Action(self._shown))
        self.tree.add("DISPlay:TEXT:CLEar", Action(self._show))

    def _shown(self, call: Call) -> str:
        return '"' + self.display.replace('"', '""') + '"'

    def _show(self, call: Call) -> None:
        self.display = read_name(call.parameters[0]) if call.parameters else ""


def _channel_settings() -> tuple[Setting, ...]:
    shape, burst = "[SOURce#:]FUNCtion:", "[SOURce#:]BURSt:"
    sign = Choices("NORMal", "INVerted")
    return (
        Word("[SOURce#:]VOLTage:RANGe:AUTO", "autorange", Choices("OFF", "ON", "ONCE")),
        Number(f"{shape}SQUare:DCYCle", "square_duty_percent", PERCENT, 20.0, 80.0, 50.0),
        Number(f"{shape}RAMP:SYMMetry", "ramp_symmetry_percent", PERCENT, 0.0, 100.0, 100.0),
        Number(f"{shape}PULSe:WIDTh", "pulse_width_s", SECOND, 20e-9, 2000.0, 100e-6),
        Number(f"{shape}PULSe:DCYCle", "pulse_duty_percent", PERCENT, 0.0, 100.0, 10.0),
        Word(f"{shape}PULSe:HOLD", "pulse_hold", Choices("WIDTh", "DCYCle")),
        Number(f"{shape}PULSe:TRANsition", "pulse_edge_s", SECOND, 5e-9, 100e-9, 5e-9),
        Switch(f"{burst}STATe", "burst"),
        Word(f"{burst}MODE", "burst_mode", Choices("TRIGgered", "GATed")),
        Number(f"{burst}NCYCles", "burst_cycles", None, 1.0, 50e3, 1.0, step=1.0, infinite=True),
        Number(f"{burst}PHASe", "burst_phase_deg", DEGREE, -360.0, 360.0, 0.0),
        Number(f"{burst}INTernal:PERiod", "burst_period_s", SECOND, 1e-6, 500.0, 10e-3),
        Word(f"{burst}GATE:POLarity", "gate_polarity", sign),
        Word("TRIGger:SOURce", "trigger_source", Choices("IMMediate", "EXTernal", "BUS")),
        Word("TRIGger:SLOPe", "trigger_slope", Choices("POSitive", "NEGative")),
        Switch("OUTPut[:STATe]", "output"),
        Word("OUTPut:POLarity", "polarity", sign),
    )
