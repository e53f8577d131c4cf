"""Agilent 33220A function generators.

Headers have no channel number. There is one waveform, VOLATILE, with codes of -8191 to 8191; it is played by
the frequency of the whole. The model has no trigger delay, so a later start is zeros in the waveform, and
no voltage limits of its own: the interlock of the bench is the only one.

A waveform has no name that would tell it from an older one. So two points are uploaded and read back before
each: then the number of points that is read back afterwards proves that the new ones have come, and their
average and crest factor that they came whole.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import CorruptData
from belahil.generators import whole_waveform_hz
from drivers.generators.dialect import SCPI_INFINITY, Item, Shown, agrees, item, sine_voltages
from drivers.generators.scpi_words import ScpiWords

if TYPE_CHECKING:
    from belahil.generators import ArbBlock, GeneratorModel, GeneratorSetting
    from drivers.scpi import ScpiSession

_RANGE = ":VOLT:RANG:AUTO"
_POINTS = ":DATA:ATTR:POIN? VOLATILE"


class Agilent33220Dialect(ScpiWords):
    """How a 33220A is told a setting."""

    output = ":OUTP"
    amplitude = ":VOLT"
    autorange = _RANGE

    def base_items(self, model: GeneratorModel, load_ohm: float, largest_v: float) -> list[Item]:
        """Return what is set once: load and unit."""
        load = item(":OUTP:LOAD", load_ohm)
        return [
            load if math.isfinite(load_ohm) else Item(":OUTP:LOAD INF", load.query, SCPI_INFINITY),
            item(":VOLT:UNIT", "VPP"),
        ]

    def items(
        self, setting: GeneratorSetting, model: GeneratorModel, before: GeneratorSetting | None = None
    ) -> list[Item]:
        """Return a setting in the order in which an instrument accepts it."""
        if setting.function == "SIN":
            items = _sine_items(setting, before)
        elif setting.arb is not None:
            items = _pulse_items(setting, setting.arb, model)
        else:
            items = [item(":BURS:STAT", "0"), item(":FUNC", "DC"), item(":VOLT:OFFS", setting.offset_v)]
        return self.ordered(items, setting, before)

    def upload(self, session: ScpiSession, arb: ArbBlock) -> None:
        """Send the points of a waveform, with the output off, after two points that mark its place."""
        session.send(self.off.command, ":DATA:DAC VOLATILE,0,0")
        (points,) = session.ask(_POINTS)
        if not agrees(points, Shown(2)):
            raise CorruptData(f"two points were to be uploaded, and {_POINTS} answers {points}")
        session.send_block(":DATA:DAC VOLATILE,", arb.codes.astype(">i2").tobytes())


def _sine_items(setting: GeneratorSetting, before: GeneratorSetting | None) -> list[Item]:
    amplitude, offset = item(":VOLT", setting.amplitude_vpp), item(":VOLT:OFFS", setting.offset_v)
    return [
        item(":BURS:STAT", "0"),
        item(":FUNC", "SIN"),
        item(":FREQ", setting.frequency_hz),
        *sine_voltages(amplitude, offset, setting, before),
    ]


def _pulse_items(setting: GeneratorSetting, arb: ArbBlock, model: GeneratorModel) -> list[Item]:
    points = arb.codes.size
    average = int(arb.codes.sum(dtype="int64")) / (arb.full_code * points)
    source = item(":TRIG:SOUR", setting.trigger_source)
    trigger_output = item(":OUTP:TRIG", "1" if setting.trigger_source == "BUS" else "0")
    return [
        Item(":FUNC:USER VOLATILE", ":FUNC:USER?", "VOLATILE"),
        Item("", _POINTS, Shown(points)),
        Item("", ":DATA:ATTR:AVER? VOLATILE", Shown(average)),
        *_crest_item(arb),
        # Before the shape: a sine may be faster than waveforms can be.
        item(":FREQ", whole_waveform_hz(arb.sample_rate_hz, points, model)),
        item(":FUNC", "USER"),
        item(":VOLT:OFFS", setting.offset_v),
        # The range for this amplitude, and then held: no relay moves while pulses of one amplitude follow.
        Item(
            f"{_RANGE} ON;:VOLT {float(setting.amplitude_vpp)!r};{_RANGE} OFF",
            ":VOLT?",
            setting.amplitude_vpp,
        ),
        Item("", f"{_RANGE}?", "0"),
        item(":BURS:MODE", "TRIG"),
        item(":BURS:NCYC", 1.0),
        # One connector is the trigger's input or its output.
        *([source, trigger_output] if setting.trigger_source == "BUS" else [trigger_output, source]),
        item(":BURS:STAT", "1"),
    ]


def _crest_item(arb: ArbBlock) -> list[Item]:
    """Return what the crest factor must be; zeros have none."""
    wide = arb.codes.astype(np.float64)
    rms = math.sqrt(float(np.mean(wide * wide)))
    return [Item("", ":DATA:ATTR:CFAC? VOLATILE", Shown(float(np.max(np.abs(wide))) / rms))] if rms else []
