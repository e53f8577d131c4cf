"""Modulations, sweeps and edges of a Tektronix AFG: remembered and answered, never played.

Headers and words are those of the public programmer manual of the AFG3000 series; defaults are assumed where
it has none, and limits that depend on other settings are not kept. No file is opened: names of files are
remembered alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from sim.devices.generator_levels import Levels
from sim.devices.generator_settings import Number, Setting, Switch, Word
from sim.devices.scpi.numeric import DEGREE, HERTZ, PERCENT, SECOND
from sim.devices.scpi.parameters import Choices, read_name
from sim.devices.scpi.parser import Token
from sim.devices.scpi.tree import Action

if TYPE_CHECKING:
    from belahil.generators import GeneratorModel
    from sim.devices.generator_settings import Answer, ChooseAny
    from sim.devices.scpi.tree import Call, HeaderTree

_WAVES = Choices(
    "SINusoid", "SQUare", "TRIangle", "RAMP", "NRAMp", "PRNoise", "USER1", "USER2", "USER3", "USER4",
    "EMEMory", "EFILe",
)  # fmt: skip
_SOURCES = Choices("INTernal", "EXTernal")


@dataclass(slots=True)
class AfgModulated(Levels):
    """What may change the waveform of a channel while it plays, and what only other shapes have."""

    am: bool = False
    am_source: str = "INT"
    am_function: str = "SIN"
    am_hz: float = 10e3
    am_depth_percent: float = 50.0
    fm: bool = False
    fm_source: str = "INT"
    fm_function: str = "SIN"
    fm_hz: float = 10e3
    fm_deviation_hz: float = 1e6
    pm: bool = False
    pm_source: str = "INT"
    pm_function: str = "SIN"
    pm_hz: float = 10e3
    pm_deviation_deg: float = 90.0
    pwm: bool = False
    pwm_source: str = "INT"
    pwm_function: str = "SIN"
    pwm_hz: float = 10e3
    pwm_deviation_percent: float = 5.0
    fsk: bool = False
    fsk_source: str = "INT"
    fsk_rate_hz: float = 50.0
    fsk_hz: float = 1e6
    sweep_start_hz: float = 100e3
    sweep_stop_hz: float = 1e6
    sweep_center_hz: float = 550e3
    sweep_span_hz: float = 900e3
    sweep_mode: str = "AUTO"
    sweep_spacing: str = "LIN"
    sweep_time_s: float = 10e-3
    sweep_hold_s: float = 0.0
    sweep_return_s: float = 1e-3
    frequency_together: bool = False
    voltage_together: bool = False
    combined: str = ""
    file: str = ""
    am_file: str = ""
    fm_file: str = ""
    pm_file: str = ""
    pwm_file: str = ""
    pulse_width_s: float = 500e-9
    pulse_delay_s: float = 0.0
    pulse_lead_s: float = 5e-9
    pulse_trail_s: float = 5e-9

    @property
    def is_modulated(self) -> bool:
        """Whether any modulation is on, or another signal is added."""
        return bool(self.combined) or self.am or self.fm or self.pm or self.pwm or self.fsk


class Text(NamedTuple):
    """A string, kept as it was sent; one of some words may have to stand in it."""

    header: str
    field: str
    choices: Choices | None = None

    def enter(self, tree: HeaderTree, choose: ChooseAny, answer: Answer) -> None:
        """Add command and query to a tree; `choose` finds the channel of a call."""

        def set_it(call: Call) -> None:
            token = call.parameters[0]
            text = read_name(token)
            if self.choices and text:
                text = self.choices.read(Token("character", text))
            setattr(choose(call), self.field, text)

        def get_it(call: Call) -> str:
            text = str(getattr(choose(call), self.field))
            return text if self.choices and text else '"' + text.replace('"', '""') + '"'

        tree.add(self.header, Action(set_it, 1, 1), Action(get_it))


def file_settings() -> tuple[Text, ...]:
    """Return what a channel remembers of files and of signals that are added to its own."""
    shape = "[SOURce#:]FUNCtion:EFILe"
    by_wave = [
        Text(f"[SOURce#:]{way}:INTernal:FUNCtion:EFILe", f"{way.lower()}_file")
        for way in ("AM", "FM", "PM", "PWM")
    ]
    added = Text("[SOURce#:]COMBine:FEED", "combined", Choices("NOISe", "EXTernal", "BOTH"))
    return (*by_wave, Text(shape, "file"), added)


def modulation_settings(model: GeneratorModel) -> tuple[Setting, ...]:
    """Return what a channel remembers of these.

    Parameters
    ----------
    model : GeneratorModel
        Gives the limits of frequencies.
    """
    source = "[SOURce#:]"
    hertz = (HERTZ, model.min_sine_hz, model.max_sine_hz)
    span = (HERTZ, 0.0, model.max_sine_hz)
    by_wave: list[Setting] = []
    for way in ("AM", "FM", "PM", "PWM"):
        field = way.lower()
        by_wave += [
            Switch(f"{source}{way}:STATe", field),
            Word(f"{source}{way}:SOURce", f"{field}_source", _SOURCES),
            Word(f"{source}{way}:INTernal:FUNCtion", f"{field}_function", _WAVES),
            Number(f"{source}{way}:INTernal:FREQuency", f"{field}_hz", HERTZ, 2e-3, 50e3, 10e3),
        ]
    return (
        *by_wave,
        Number(f"{source}AM:DEPTh", "am_depth_percent", PERCENT, 0.0, 120.0, 50.0),
        Number(f"{source}FM:DEViation", "fm_deviation_hz", *span, 1e6),
        Number(f"{source}PM:DEViation", "pm_deviation_deg", DEGREE, 0.0, 180.0, 90.0),
        Number(f"{source}PWM:DEViation:DCYCle", "pwm_deviation_percent", PERCENT, 0.0, 50.0, 5.0),
        Switch(f"{source}FSKey:STATe", "fsk"),
        Word(f"{source}FSKey:SOURce", "fsk_source", _SOURCES),
        Number(f"{source}FSKey:INTernal:RATE", "fsk_rate_hz", HERTZ, 2e-3, 1e6, 50.0),
        Number(f"{source}FSKey:FREQuency", "fsk_hz", *hertz, 1e6),
        Number(f"{source}FREQuency:STARt", "sweep_start_hz", *hertz, 100e3),
        Number(f"{source}FREQuency:STOP", "sweep_stop_hz", *hertz, 1e6),
        Number(f"{source}FREQuency:CENTer", "sweep_center_hz", *hertz, 550e3),
        Number(f"{source}FREQuency:SPAN", "sweep_span_hz", *span, 900e3),
        Word(f"{source}SWEep:MODE", "sweep_mode", Choices("AUTO", "MANual")),
        Word(f"{source}SWEep:SPACing", "sweep_spacing", Choices("LINear", "LOGarithmic")),
        Number(f"{source}SWEep:TIME", "sweep_time_s", SECOND, 1e-3, 300.0, 10e-3),
        Number(f"{source}SWEep:HTIMe", "sweep_hold_s", SECOND, 0.0, 300.0, 0.0),
        Number(f"{source}SWEep:RTIMe", "sweep_return_s", SECOND, 0.0, 300.0, 1e-3),
        Switch(f"{source}FREQuency:CONCurrent[:STATe]", "frequency_together"),
        Switch(f"{source}VOLTage:CONCurrent[:STATe]", "voltage_together"),
        Number(f"{source}PULSe:WIDTh", "pulse_width_s", SECOND, 2e-9, 1e6, 500e-9),
        Number(f"{source}PULSe:DELay", "pulse_delay_s", SECOND, 0.0, 1e6, 0.0),
        Number(f"{source}PULSe:TRANsition[:LEADing]", "pulse_lead_s", SECOND, 1.8e-9, 1e3, 5e-9),
        Number(f"{source}PULSe:TRANsition:TRAiling", "pulse_trail_s", SECOND, 1.8e-9, 1e3, 5e-9),
    )
