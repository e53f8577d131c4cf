"""Tektronix AFG3000 and AFG31000 function generators.

There is one waveform for the first channel, the edit memory, with codes of 0 to 16382; it is played by the
frequency of the whole. A burst waits for the external trigger, and ``*TRG`` starts it as well: so the same
setting serves whoever triggers.

The edit memory has no name that would tell a waveform from an older one, so all its points are read back.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import CorruptData
from belahil.generators import whole_waveform_hz
from drivers.generators.dialect import (
    SCPI_INFINITY,
    Item,
    Shown,
    item,
    sine_voltages,
    voltage_limit,
)
from drivers.generators.scpi_words import ScpiWords

if TYPE_CHECKING:
    from belahil.generators import ArbBlock, GeneratorModel, GeneratorSetting
    from drivers.scpi import ScpiSession

_AMPLITUDE = ":SOUR1:VOLT:LEV:IMM:AMPL"
_OFFSET = ":SOUR1:VOLT:LEV:IMM:OFFS"


class TektronixAfgDialect(ScpiWords):
    """How an AFG3000 or AFG31000 is told a setting."""

    output = ":OUTP1:STAT"
    amplitude = _AMPLITUDE

    def base_items(self, model: GeneratorModel, load_ohm: float, largest_v: float) -> list[Item]:
        """Return what is set once: load, unit, and the instrument's own voltage limits."""
        limit_v = voltage_limit(model, load_ohm, largest_v)
        load = "INF" if math.isinf(load_ohm) else f"{load_ohm!r}OHM"
        shown = SCPI_INFINITY if math.isinf(load_ohm) else load_ohm
        return [
            Item(f":OUTP1:IMP {load}", ":OUTP1:IMP?", shown),
            item(":SOUR1:VOLT:UNIT", "VPP"),
            _number(":SOUR1:VOLT:LIM:HIGH", limit_v, "V"),
            _number(":SOUR1:VOLT:LIM:LOW", -limit_v, "V"),
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
            items = [
                item(":SOUR1:BURS:STAT", "0"),
                item(":SOUR1:FUNC:SHAP", "DC"),
                _number(_OFFSET, setting.offset_v, "V"),
            ]
        return self.ordered(items, setting, before)

    def upload(self, session: ScpiSession, arb: ArbBlock) -> None:
        """Send the points of a waveform, with the output off, and read them back.

        Raises
        ------
        CorruptData
            Other points came back.
        """
        data = (arb.codes.astype(np.int32) + arb.full_code).astype(">u2").tobytes()
        session.send(self.off.command, f":DATA:DEF EMEM,{arb.codes.size}")
        session.send_block(":DATA:DATA EMEM,", data)
        length = str(len(data))
        head = f"#{len(length)}{length}".encode("ascii")
        if session.ask_raw(":DATA:DATA? EMEM", head, len(data)) != data:
            raise CorruptData(f"{arb.codes.size} points were uploaded to EMEM, and others were read back")


def _number(header: str, value: float, unit: str) -> Item:
    """Return the item of a number that is answered with as many digits as the instrument likes."""
    return Item(f"{header} {float(value)!r}{unit}", f"{header}?", Shown(value))


def _sine_items(setting: GeneratorSetting, before: GeneratorSetting | None) -> list[Item]:
    """Frequency before the voltages when it falls, after them when it rises: it limits the amplitude."""
    frequency = _number(":SOUR1:FREQ:FIX", setting.frequency_hz, "HZ")
    voltages = sine_voltages(
        _number(_AMPLITUDE, setting.amplitude_vpp, "VPP"),
        _number(_OFFSET, setting.offset_v, "V"),
        setting,
        before,
    )
    rises = before is not None and before.function == "SIN" and setting.frequency_hz > before.frequency_hz
    return [
        item(":SOUR1:BURS:STAT", "0"),
        item(":SOUR1:FUNC:SHAP", "SIN"),
        *([*voltages, frequency] if rises else [frequency, *voltages]),
    ]


def _pulse_items(setting: GeneratorSetting, arb: ArbBlock, model: GeneratorModel) -> list[Item]:
    return [
        Item("", ":DATA:POIN? EMEM", Shown(arb.codes.size)),
        # Before the shape: a sine may be faster than waveforms can be.
        _number(":SOUR1:FREQ:FIX", whole_waveform_hz(arb.sample_rate_hz, arb.codes.size, model), "HZ"),
        item(":SOUR1:FUNC:SHAP", "EMEM"),
        _number(_OFFSET, setting.offset_v, "V"),
        _number(_AMPLITUDE, setting.amplitude_vpp, "VPP"),
        item(":SOUR1:BURS:MODE", "TRIG"),
        item(":SOUR1:BURS:NCYC", 1.0),
        _number(":SOUR1:BURS:TDEL", setting.trigger_delay_s, "S"),
        item(":OUTP:TRIG:MODE", "TRIG"),
        # Its own clock would start bursts that nobody asked for; *TRG is taken beside EXT.
        item(":TRIG:SEQ:SOUR", "EXT"),
        item(":SOUR1:BURS:STAT", "1"),
    ]
