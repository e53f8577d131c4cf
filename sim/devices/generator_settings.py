"""The generator's plain settings as tables: a header, a field of the channel, and what it may be."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

from belahil.generators import GeneratorModel, round_to_step
from sim.devices.scpi.numeric import (
    DEGREE,
    HERTZ,
    PERCENT,
    SAMPLES_PER_SECOND,
    SECOND,
    Units,
    answer_number,
)
from sim.devices.scpi.parameters import Choices, read_boolean, read_limit, read_within
from sim.devices.scpi.status import ScpiError
from sim.devices.scpi.tree import Action, Call, HeaderTree


class Reporting(Protocol):
    """What has settings, and hears of values beyond their limits."""

    def report(self, error: ScpiError, /) -> None:
        """Take an error that does not stop the command."""
        ...


Choose = Callable[[Call], Reporting]
Answer = Callable[[float], str]
ChooseAny = Callable[[Call], object]


class Number(NamedTuple):
    """A number with fixed limits; `default` is what DEF means, `step` its grid, `infinite` allows INF."""

    header: str
    field: str
    units: Units | None
    least: float
    most: float
    default: float
    step: float = 0.0
    infinite: bool = False

    def enter(self, tree: HeaderTree, choose: Choose, answer: Answer = answer_number) -> None:
        """Add command and query to a tree; `choose` finds the channel of a call, `answer` writes numbers."""
        most, step = self.most, self.step

        def set_it(call: Call) -> None:
            channel = choose(call)
            value = read_within(
                call.parameters[0],
                self.units,
                self.least,
                most,
                self.default,
                channel.report,
                infinite=self.infinite,
            )
            setattr(channel, self.field, round_to_step(value, step) if step and value < math.inf else value)

        def get_it(call: Call) -> str:
            word = read_limit(call.parameters[0]) if call.parameters else ""
            known = {"MIN": self.least, "MAX": most, "DEF": self.default}
            return answer(known.get(word, getattr(choose(call), self.field)))

        tree.add(self.header, Action(set_it, 1, 1), Action(get_it, 0, 1))


class Word(NamedTuple):
    """One of some words."""

    header: str
    field: str
    choices: Choices

    def enter(self, tree: HeaderTree, choose: ChooseAny, answer: Answer = answer_number) -> None:
        """Add command and query to a tree; `choose` finds the channel of a call."""

        def set_it(call: Call) -> None:
            setattr(choose(call), self.field, self.choices.read(call.parameters[0]))

        tree.add(
            self.header, Action(set_it, 1, 1), Action(lambda call: str(getattr(choose(call), self.field)))
        )


class Switch(NamedTuple):
    """On or off; `words` are what a query answers."""

    header: str
    field: str
    words: tuple[str, str] = ("0", "1")

    def enter(self, tree: HeaderTree, choose: ChooseAny, answer: Answer = answer_number) -> None:
        """Add command and query to a tree; `choose` finds the channel of a call."""

        def set_it(call: Call) -> None:
            setattr(choose(call), self.field, read_boolean(call.parameters[0]))

        def get_it(call: Call) -> str:
            return self.words[bool(getattr(choose(call), self.field))]

        tree.add(self.header, Action(set_it, 1, 1), Action(get_it))


Setting = Number | Word | Switch

_SOURCE_TRIGGER = "SOURce#:TRIGger"
_SOURCE_OUTPUT = "SOURce#:OUTPut:TRIGger"
OTHER_NAMES = frozenset(
    {
        f"{_SOURCE_TRIGGER}:SOURce",
        f"{_SOURCE_TRIGGER}:SLOPe",
        f"{_SOURCE_OUTPUT}[:STATe]",
        f"{_SOURCE_OUTPUT}:SLOPe",
    }
)
"""Of settings: clients in use (pylablib) name the channel so; that instruments take them is assumed."""


def channel_settings(model: GeneratorModel) -> tuple[Setting, ...]:
    """Return the settings of one channel that depend on no other setting.

    Parameters
    ----------
    model : GeneratorModel
        Gives the limits that differ; all other limits are those of the 33500B's public manual, or assumed.
    """
    source, shape = "[SOURce#:]", "[SOURce#:]FUNCtion:"
    burst, trigger, output = "[SOURce#:]BURSt:", "TRIGger#:", "OUTPut#:"
    sign = Choices("NORMal", "INVerted")
    edge = Choices("POSitive", "NEGative")
    trigger_sources = Choices("IMMediate", "EXTernal", "TIMer", "BUS")
    percent = (PERCENT, 0.01, 99.99)
    period = (SECOND, 1e-6, 8000.0)
    return (
        Word(f"{source}FREQuency:MODE", "frequency_mode", Choices("CW", "LIST", "SWEep", "FIXed")),
        Number(f"{source}PHASe[:ADJust]", "phase_deg", DEGREE, -360.0, 360.0, 0.0),
        Word(f"{source}VOLTage:RANGe:AUTO", "autorange", Choices("OFF", "ON", "ONCE")),
        Number(f"{shape}SQUare:DCYCle", "square_duty_percent", *percent, 50.0),
        Number(f"{shape}RAMP:SYMMetry", "ramp_symmetry_percent", PERCENT, 0.0, 100.0, 100.0),
        Number(f"{shape}PULSe:WIDTh", "pulse_width_s", SECOND, 16e-9, 1e6, 100e-6),
        Number(f"{shape}PULSe:DCYCle", "pulse_duty_percent", *percent, 10.0),
        Word(f"{shape}PULSe:HOLD", "pulse_hold", Choices("WIDTh", "DCYCle")),
        Number(f"{shape}PULSe:TRANsition[:LEADing]", "pulse_lead_s", SECOND, 2.9e-9, 1e-6, 10e-9),
        Number(f"{shape}PULSe:TRANsition:TRAiling", "pulse_trail_s", SECOND, 2.9e-9, 1e-6, 10e-9),
        Number(f"{shape}NOISe:BANDwidth", "noise_bandwidth_hz", HERTZ, 1e-3, model.max_sine_hz, 100e3),
        Number(f"{shape}PRBS:BRATe", "bit_rate_hz", HERTZ, 1e-3, model.max_sine_hz, 1e3),
        Number(
            f"{shape}ARBitrary:SRATe",
            "arb_rate_hz",
            SAMPLES_PER_SECOND,
            1e-6,
            model.max_arb_rate_hz,
            40e3,
            step=1e-6,
        ),
        Word(f"{shape}ARBitrary:FILTer", "arb_filter", Choices("NORMal", "STEP", "OFF")),
        Word(f"{shape}ARBitrary:ADVance", "arb_advance", Choices("TRIGger", "SRATe")),
        Switch(f"{burst}STATe", "burst"),
        Word(f"{burst}MODE", "burst_mode", Choices("TRIGgered", "GATed")),
        Number(f"{burst}NCYCles", "burst_cycles", None, 1.0, 1e8, 1.0, step=1.0, infinite=True),
        Number(f"{burst}PHASe", "burst_phase_deg", DEGREE, -360.0, 360.0, 0.0),
        Number(f"{burst}INTernal:PERiod", "burst_period_s", *period, 10e-3),
        Word(f"{burst}GATE:POLarity", "gate_polarity", sign),
        Word(f"{trigger}SOURce", "trigger_source", trigger_sources),
        Word(f"{_SOURCE_TRIGGER}:SOURce", "trigger_source", trigger_sources),
        Word(f"{_SOURCE_TRIGGER}:SLOPe", "trigger_slope", edge),
        Number(
            f"{trigger}DELay",
            "trigger_delay_s",
            SECOND,
            0.0,
            model.max_delay_s,
            0.0,
            step=model.delay_step_s,
        ),
        Word(f"{trigger}SLOPe", "trigger_slope", edge),
        Number(f"{trigger}TIMer", "trigger_timer_s", *period, 1.0),
        Number(f"{trigger}COUNt", "trigger_count", None, 1.0, 1e6, 1.0, step=1.0, infinite=True),
        Word(f"{output}POLarity", "polarity", sign),
        Word(f"{output}MODE", "output_mode", Choices("NORMal", "GATed")),
        Switch(f"{output[:-1]}[:STATe]", "output"),
    )


# Settings of the instrument as a whole.
SHARED_SETTINGS: tuple[Word | Switch, ...] = (
    Switch("OUTPut#:SYNC[:STATe]", "sync"),
    Word("OUTPut#:SYNC:SOURce", "sync_source", Choices("CH1", "CH2")),
    Switch("OUTPut#:TRIGger[:STATe]", "trigger_output"),
    Word("OUTPut#:TRIGger:SLOPe", "trigger_output_slope", Choices("POSitive", "NEGative")),
    Switch(f"{_SOURCE_OUTPUT}[:STATe]", "trigger_output"),
    Word(f"{_SOURCE_OUTPUT}:SLOPe", "trigger_output_slope", Choices("POSitive", "NEGative")),
    Word("OUTPut#:TRIGger:SOURce", "trigger_output_source", Choices("CH1", "CH2")),
    Word("UNIT:ANGLe", "angle_unit", Choices("DEGree")),
    Switch("SYSTem:BEEPer:STATe", "beeper"),
    Switch("DISPlay[:WINDow][:STATe]", "display_on"),
    Word("FORMat:BORDer", "byte_order", Choices("NORMal", "SWAPped")),
)
