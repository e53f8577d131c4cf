"""Modulations and sweeps of a 33500B or 33600A: remembered and answered, never played.

Headers, words and defaults are those of the public manual; limits that depend on other settings are not kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sim.devices.generator_levels import Levels
from sim.devices.generator_settings import Number, Setting, Switch, Word
from sim.devices.scpi.numeric import DEGREE, HERTZ, PERCENT, SECOND
from sim.devices.scpi.parameters import Choices

if TYPE_CHECKING:
    from belahil.generators import GeneratorModel

SHAPES = Choices("SINusoid", "SQUare", "RAMP", "NRAMp", "TRIangle", "NOISe", "PRBS", "ARB")
SOURCES = Choices("INTernal", "EXTernal", "CH1", "CH2")
KEYS = Choices("INTernal", "EXTernal")

MODULATIONS = {
    "SWEep": "sweep",
    "AM": "am",
    "FM": "fm",
    "PM": "pm",
    "PWM": "pwm",
    "FSKey": "fsk",
    "BPSK": "bpsk",
    "SUM": "summed",
}
"""What changes a waveform while it plays, and the field that says whether it is on."""


@dataclass(slots=True)
class Modulated(Levels):
    """What may change the waveform of a channel while it plays."""

    sweep: bool = False
    sweep_start_hz: float = 100.0
    sweep_stop_hz: float = 1e3
    sweep_spacing: str = "LIN"
    sweep_time_s: float = 1.0
    sweep_hold_s: float = 0.0
    sweep_return_s: float = 0.0
    am: bool = False
    am_source: str = "INT"
    am_function: str = "SIN"
    am_hz: float = 100.0
    am_depth_percent: float = 100.0
    am_without_carrier: bool = False
    fm: bool = False
    fm_source: str = "INT"
    fm_function: str = "SIN"
    fm_hz: float = 10.0
    fm_deviation_hz: float = 100.0
    pm: bool = False
    pm_source: str = "INT"
    pm_function: str = "SIN"
    pm_hz: float = 10.0
    pm_deviation_deg: float = 180.0
    pwm: bool = False
    pwm_source: str = "INT"
    pwm_function: str = "SIN"
    pwm_hz: float = 10.0
    pwm_deviation_s: float = 10e-6
    pwm_deviation_percent: float = 1.0
    fsk: bool = False
    fsk_source: str = "INT"
    fsk_rate_hz: float = 10.0
    fsk_hz: float = 100.0
    bpsk: bool = False
    bpsk_source: str = "INT"
    bpsk_rate_hz: float = 10.0
    bpsk_phase_deg: float = 180.0
    summed: bool = False
    summed_source: str = "INT"
    summed_function: str = "SIN"
    summed_hz: float = 100.0
    summed_percent: float = 0.1

    @property
    def is_modulated(self) -> bool:
        """Whether any of it is on."""
        return any(getattr(self, field) for field in MODULATIONS.values())


def modulation_settings(model: GeneratorModel) -> tuple[Setting, ...]:
    """Return the settings of a channel's modulations and of its sweep.

    Parameters
    ----------
    model : GeneratorModel
        Gives the limits of frequencies.
    """
    source, most_hz = "[SOURce#:]", model.max_sine_hz
    hertz, rate = (HERTZ, model.min_sine_hz, most_hz), (HERTZ, 125e-6, 1e6)
    by_wave: list[Setting] = []
    for way, field, default_hz in (
        ("AM", "am", 100.0),
        ("FM", "fm", 10.0),
        ("PM", "pm", 10.0),
        ("PWM", "pwm", 10.0),
        ("SUM", "summed", 100.0),
    ):
        by_wave += [
            Word(f"{source}{way}:SOURce", f"{field}_source", SOURCES),
            Word(f"{source}{way}:INTernal:FUNCtion", f"{field}_function", SHAPES),
            Number(f"{source}{way}:INTernal:FREQuency", f"{field}_hz", *hertz, default_hz),
        ]
    return (
        *_sweep(source, model),
        *by_wave,
        Number(f"{source}AM[:DEPTh]", "am_depth_percent", PERCENT, 0.0, 120.0, 100.0),
        Switch(f"{source}AM:DSSC", "am_without_carrier"),
        Number(f"{source}FM[:DEViation]", "fm_deviation_hz", HERTZ, 0.0, most_hz, 100.0),
        Number(f"{source}PM[:DEViation]", "pm_deviation_deg", DEGREE, 0.0, 360.0, 180.0),
        Number(f"{source}PWM[:DEViation]", "pwm_deviation_s", SECOND, 0.0, 1e6, 10e-6),
        Number(f"{source}PWM:DEViation:DCYCle", "pwm_deviation_percent", PERCENT, 0.0, 100.0, 1.0),
        Word(f"{source}FSKey:SOURce", "fsk_source", KEYS),
        Number(f"{source}FSKey:INTernal:RATE", "fsk_rate_hz", *rate, 10.0),
        Number(f"{source}FSKey:FREQuency", "fsk_hz", *hertz, 100.0),
        Word(f"{source}BPSK:SOURce", "bpsk_source", KEYS),
        Number(f"{source}BPSK:INTernal:RATE", "bpsk_rate_hz", *rate, 10.0),
        Number(f"{source}BPSK[:PHASe]", "bpsk_phase_deg", DEGREE, 0.0, 360.0, 180.0),
        Number(f"{source}SUM:AMPLitude", "summed_percent", PERCENT, 0.0, 100.0, 0.1),
        *(Switch(f"{source}{way}:STATe", field) for way, field in MODULATIONS.items()),
    )


def _sweep(source: str, model: GeneratorModel) -> tuple[Setting, ...]:
    hertz = (HERTZ, model.min_sine_hz, model.max_sine_hz)
    seconds = (SECOND, 0.0, 3600.0)
    return (
        Number(f"{source}FREQuency:STARt", "sweep_start_hz", *hertz, 100.0),
        Number(f"{source}FREQuency:STOP", "sweep_stop_hz", *hertz, 1e3),
        Word(f"{source}SWEep:SPACing", "sweep_spacing", Choices("LINear", "LOGarithmic")),
        Number(f"{source}SWEep:TIME", "sweep_time_s", SECOND, 1e-3, 250e3, 1.0),
        Number(f"{source}SWEep:HTIMe", "sweep_hold_s", *seconds, 0.0),
        Number(f"{source}SWEep:RTIMe", "sweep_return_s", *seconds, 0.0),
    )
