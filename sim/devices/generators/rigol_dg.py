"""A Rigol DG1000Z function generator, as messages make it appear.

It differs from the 33500B: a reset leaves the load at high impedance, numbers have seven digits, switches
answer ON and OFF, errors have no plus sign, a waveform is VOLATILE with codes of 0 to 16383 for each
channel, APPLy does not switch the output on, and ``*RST`` empties the error queue.

What this does not model: the 50 ms that a setting takes to act, and an output that goes on with an old
waveform when the shape changes under it; named built-in waveforms beside Sinc; modulation, sweeps, harmonics,
coupled channels, the counter, stored states; the filter behind the converter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from belahil.generators import Function, TriggerSource
from sim.devices.generator_base import EmulatedGenerator, GeneratorPort
from sim.devices.generator_commands import (
    ChannelCommands,
    Tokens,
    add_level_commands,
    add_load_command,
    add_shape_commands,
    apply_levels,
)
from sim.devices.generator_levels import Levels
from sim.devices.generator_settings import Number, Setting, Switch, Word
from sim.devices.generators.rigol_dg_arbs import Volatile, add_volatile_commands
from sim.devices.scpi.numeric import DEGREE, PERCENT, SAMPLES_PER_SECOND, SECOND
from sim.devices.scpi.parameters import Choices, read_within
from sim.devices.scpi.tree import Action, Call, forms

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    from numpy.typing import NDArray

    from belahil.generators import GeneratorModel

SHAPES = ("SINusoid", "SQUare", "RAMP", "PULSe", "NOISe", "USER", "HARMonic", "DC")
_ON_OFF = ("OFF", "ON")
_EDGES = Choices("POSitive", "NEGative")
_SHAPES: dict[str, Function] = {"SIN": "SIN", "USER": "ARB", "DC": "DC"}
_SOURCES: dict[str, TriggerSource] = {"INT": "IMM", "EXT": "EXT", "MAN": "BUS"}
# Highest frequencies beside a sine's, in parts of it, so that those of the DG1062Z come out right; those of
# the DG1032Z are 15, 0.5, 15 and 10 MHz.
_MOST_PART = {"SQU": 25 / 60, "RAMP": 1 / 60, "PULS": 25 / 60, "USER": 20 / 60, "HARM": 20 / 60}


def seven_digits(value: float) -> str:
    """Write a number as these instruments do."""
    return f"{9.9e37 if math.isinf(value) else value:.6E}"


@dataclass(slots=True)
class DgChannel(Levels):
    """One channel; volts are volts into `load_ohm`."""

    volatile: Volatile = field(kw_only=True)
    arb_mode: str = "FREQ"
    trigger_output: str = "OFF"
    idle: str = "FPT"
    output_gate: str = "POS"
    sync: bool = True
    trigger_source: str = "INT"
    square_duty_percent: float = 50.0
    ramp_symmetry_percent: float = 50.0
    pulse_width_s: float = 500e-6
    pulse_duty_percent: float = 50.0
    pulse_hold: str = "DCYC"

    @property
    def most_hz(self) -> float:
        """Highest frequency of the present shape."""
        return self.model.max_sine_hz * _MOST_PART.get(self.function, 1.0)

    @property
    def plays_by_rate(self) -> bool:
        """Whether the sample rate says how fast the present shape is, and not the frequency."""
        return self.function == "USER" and self.arb_mode == "SRAT"

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
        """Points of the waveform."""
        return self.volatile.codes

    def take(self, points: NDArray[np.int16], keeps_mode: bool = True) -> None:
        """Play an uploaded waveform; in frequency mode few points are made 8192."""
        if not keeps_mode or points.size > self.volatile.period_points:
            self.arb_mode = "SRAT"
        self.volatile.hold(points, extended=self.arb_mode == "FREQ")
        self.set_function("USER")


class RigolDg(EmulatedGenerator):
    """A DG1000Z.

    Parameters
    ----------
    model : GeneratorModel
        Limits and grids.
    port : GeneratorPort
        As for `EmulatedGenerator`, and so are the others.
    """

    channels: list[DgChannel]
    shared_fields = ("beeper",)
    signed = False

    def __init__(
        self,
        model: GeneratorModel,
        port: GeneratorPort,
        serial_number: str = "EMULATED",
        firmware: str = "0.00-emulated",
    ) -> None:
        super().__init__(model, port, serial_number, firmware)
        self.beeper = True
        self._set_defaults()
        self._add_commands()

    def _set_defaults(self) -> None:
        self.channels = [
            DgChannel(self.model, self.report, volatile=Volatile(self.model))
            for _ in range(self.model.channels)
        ]

    def reset(self) -> None:
        """Bring all settings to their defaults and forget errors and waveforms."""
        self._set_defaults()
        self.status.errors.clear()

    def _choose(self, call: Call) -> DgChannel:
        return self.channels[call.suffixes[0] - 1]

    def _add_commands(self) -> None:
        commands = ChannelCommands(self.tree, self._choose, seven_digits)
        add_shape_commands(commands, SHAPES, frequency="FREQuency[:FIXed]")
        add_level_commands(commands)
        for header in ("OUTPut#:LOAD", "OUTPut#:IMPedance"):
            add_load_command(commands, header)
        for shape in SHAPES:
            commands.add(f"[SOURce#:]APPLy:{shape}", _applying(shape), takes=(0, 4))
        commands.add("[SOURce#:]APPLy:ARBitrary", _applying("ARB"), takes=(0, 3))
        commands.add("[SOURce#:]APPLy", query=_applied)
        add_volatile_commands(commands, self.model.max_points)
        for setting in _channel_settings(self.model):
            setting.enter(self.tree, self._choose, seven_digits)
        for header in ("[SOURce#:]BURSt:TRIGger[:IMMediate]", "TRIGger#[:IMMediate]"):
            self.tree.add(header, Action(self._trigger_one))
        self.tree.add("OUTPut#:GATe:POLarity", Action(self._set_output_gate, 1, 1), Action(self._output_gate))
        Switch("SYSTem:BEEPer:STATe", "beeper", _ON_OFF).enter(self.tree, lambda call: self)
        self.tree.add("SYSTem:BEEPer[:IMMediate]", Action(lambda call: None))
        self.tree.add("SYSTem:CHANnel:NUMber", query=Action(lambda call: str(self.model.channels)))

    def _set_output_gate(self, call: Call) -> None:
        self._choose(call).output_gate = _EDGES.read(call.parameters[0])

    def _output_gate(self, call: Call) -> str:
        # In full: QCoDeS expects it so.
        return {"POS": "POSITIVE", "NEG": "NEGATIVE"}[self._choose(call).output_gate]

    def _trigger_one(self, call: Call) -> None:
        """Start the burst of one channel; ignored unless it waits for this (the public guide)."""
        self.settled()
        if call.suffixes[0] == 1 and self.channels[0].source == "BUS":
            self._port.trigger()


def _applying(shape: str) -> Callable[[DgChannel, Tokens], None]:
    """Return the command that sets a shape with its numbers; the fourth one is a phase."""
    word = "USER" if shape == "ARB" else forms(shape)[0]

    def apply(channel: DgChannel, tokens: Tokens) -> None:
        channel.arb_mode = "SRAT" if shape == "ARB" else "FREQ"
        apply_levels(channel, tokens[:3], word)
        if len(tokens) == 4:
            channel.phase_deg = read_within(tokens[3], DEGREE, 0.0, 360.0, 0.0, channel.report)

    return apply


def _applied(channel: DgChannel, _: Tokens) -> str:
    first = channel.arb_rate_hz if channel.plays_by_rate else channel.frequency_hz
    volts = channel.amplitude_in(channel.amplitude_vpp)
    numbers = (first, volts, channel.offset_v, channel.phase_deg)
    return f'"{channel.function},{",".join(map(seven_digits, numbers))}"'


def _channel_settings(model: GeneratorModel) -> tuple[Setting, ...]:
    source, burst = "[SOURce#:]", "[SOURce#:]BURSt"
    sign = Choices("NORMal", "INVerted")
    shapes = []
    for shape in (f"{source}FUNCtion:", source):
        shapes += [
            Number(f"{shape}PULSe:WIDTh", "pulse_width_s", SECOND, 16e-9, 1e6, 500e-6),
            Number(f"{shape}PULSe:DCYCle", "pulse_duty_percent", PERCENT, 0.001, 99.999, 50.0),
        ]
    return (
        *shapes,
        Word(f"{source}FUNCtion:PULSe:HOLD", "pulse_hold", Choices("WIDTh", "DCYCle")),
        Number(f"{source}FUNCtion:SQUare:DCYCle", "square_duty_percent", PERCENT, 0.01, 99.99, 50.0),
        Number(f"{source}FUNCtion:RAMP:SYMMetry", "ramp_symmetry_percent", PERCENT, 0.0, 100.0, 50.0),
        Word(f"{source}FUNCtion:ARBitrary:MODE", "arb_mode", Choices("FREQ", "SRATe")),
        Number(
            f"{source}FUNCtion:ARBitrary:SRATe",
            "arb_rate_hz",
            SAMPLES_PER_SECOND,
            1e-6,
            model.max_arb_rate_hz,
            model.after_reset.sample_rate_hz,
            step=1e-6,
        ),
        Number(f"{source}PHASe[:ADJust]", "phase_deg", DEGREE, 0.0, 360.0, 0.0),
        Word(f"{source}VOLTage:RANGe:AUTO", "autorange", Choices("OFF", "ON")),
        Switch(f"{burst}[:STATe]", "burst", _ON_OFF),
        Word(f"{burst}:MODE", "burst_mode", Choices("TRIGgered", "INFinity", "GATed")),
        Number(f"{burst}:NCYCles", "burst_cycles", None, 1.0, 1e6, 1.0, step=1.0),
        Number(f"{burst}:PHASe", "burst_phase_deg", DEGREE, 0.0, 360.0, 0.0),
        Number(f"{burst}:INTernal:PERiod", "burst_period_s", SECOND, 2.0166e-6, 500.0, 10e-3),
        Number(
            f"{burst}:TDELay", "trigger_delay_s", SECOND, 0.0, model.max_delay_s, 0.0, step=model.delay_step_s
        ),
        Word(f"{burst}:GATE:POLarity", "gate_polarity", sign),
        Word(f"{burst}:IDLE", "idle", Choices("FPT", "TOP", "CENTER", "BOTTOM")),
        Word(f"{burst}:TRIGger:SOURce", "trigger_source", Choices("INTernal", "EXTernal", "MANual")),
        Word(f"{burst}:TRIGger:SLOPe", "trigger_slope", _EDGES),
        Word(f"{burst}:TRIGger:TRIGOut", "trigger_output", Choices("POSitive", "NEGative", "OFF")),
        Switch("OUTPut#[:STATe]", "output", _ON_OFF),
        Word("OUTPut#:POLarity", "polarity", sign),
        Switch("OUTPut#:SYNC[:STATe]", "sync", _ON_OFF),
    )
