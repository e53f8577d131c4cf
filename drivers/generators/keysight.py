"""Keysight (formerly Agilent) 33500B and 33600A function generators; one dialect, limits by model.

Voltage autorange is on for sines: its relays click only when a setting changes, which is before a window.
For an arbitrary waveform it finds the range of the amplitude and is then off, so that the range is held, at
full resolution, until the amplitude changes.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING
from zlib import crc32

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

_RANGE = ":SOUR1:VOLT:RANG:AUTO"
_FILTERS = {"linear": "NORM", "hold": "STEP"}


class KeysightDialect(ScpiWords):
    """How a 33500B or 33600A is told a setting."""

    output = ":OUTP1"
    amplitude = ":SOUR1:VOLT"
    autorange = _RANGE

    def base_items(self, model: GeneratorModel, load_ohm: float, largest_v: float) -> list[Item]:
        """Return what is set once: load, unit, and the instrument's own voltage limits."""
        limit_v = voltage_limit(model, load_ohm, largest_v)
        load = item(":OUTP1:LOAD", load_ohm)
        return [
            load if math.isfinite(load_ohm) else Item(":OUTP1:LOAD INF", load.query, SCPI_INFINITY),
            item(":SOUR1:VOLT:UNIT", "VPP"),
            item(":SOUR1:VOLT:LIM:HIGH", limit_v),
            item(":SOUR1:VOLT:LIM:LOW", -limit_v),
            item(":SOUR1:VOLT:LIM:STAT", "1"),
        ]

    def items(
        self, setting: GeneratorSetting, model: GeneratorModel, before: GeneratorSetting | None = None
    ) -> list[Item]:
        """Return a setting in the order in which an instrument accepts it."""
        if setting.function == "SIN":
            items = _sine_items(setting, before)
        elif setting.arb is not None:
            items = _pulse_items(setting, setting.arb)
        else:
            items = [
                item(":SOUR1:BURS:STAT", "0"),
                item(":SOUR1:FUNC", "DC"),
                item(":SOUR1:VOLT:OFFS", setting.offset_v),
            ]
        return self.ordered(items, setting, before)

    def upload(self, session: ScpiSession, arb: ArbBlock) -> None:
        """Send the points of a waveform, with the output off."""
        session.send(self.off.command, ":SOUR1:DATA:VOL:CLE")
        session.send_block(f":SOUR1:DATA:ARB:DAC {uploaded_name(arb)},", uploaded_block(arb))


def _sine_items(setting: GeneratorSetting, before: GeneratorSetting | None) -> list[Item]:
    return [
        item(":SOUR1:BURS:STAT", "0"),
        item(":SOUR1:FUNC", "SIN"),
        item(":SOUR1:FREQ", setting.frequency_hz),
        *sine_voltages(
            item(":SOUR1:VOLT", setting.amplitude_vpp),
            item(":SOUR1:VOLT:OFFS", setting.offset_v),
            setting,
            before,
        ),
    ]


def _pulse_items(setting: GeneratorSetting, arb: ArbBlock) -> list[Item]:
    name = uploaded_name(arb)
    points = arb.codes.size
    average = int(arb.codes.sum(dtype="int64")) / (arb.full_code * points)
    peak_to_peak = (int(arb.codes.max()) - int(arb.codes.min())) / arb.full_code
    source = item(":TRIG1:SOUR", setting.trigger_source)
    trigger_output = item(":OUTP:TRIG", "1" if setting.trigger_source == "BUS" else "0")
    return [
        Item(f':SOUR1:FUNC:ARB "{name}"', ":SOUR1:FUNC:ARB?", name),
        Item("", f':SOUR1:DATA:ATTR:POIN? "{name}"', Shown(points)),
        Item("", f':SOUR1:DATA:ATTR:AVER? "{name}"', Shown(average)),
        Item("", f':SOUR1:DATA:ATTR:PTP? "{name}"', Shown(peak_to_peak)),
        item(":SOUR1:FUNC", "ARB"),
        item(":SOUR1:FUNC:ARB:SRAT", arb.sample_rate_hz),
        item(":SOUR1:FUNC:ARB:FILT", _FILTERS[arb.interpolation]),
        item(":SOUR1:VOLT:OFFS", setting.offset_v),
        # The range for this amplitude, and then held: no relay moves while pulses of one amplitude follow.
        Item(
            f"{_RANGE} ON;:SOUR1:VOLT {float(setting.amplitude_vpp)!r};{_RANGE} OFF",
            ":SOUR1:VOLT?",
            setting.amplitude_vpp,
        ),
        Item("", f"{_RANGE}?", "0"),
        item(":SOUR1:BURS:MODE", "TRIG"),
        item(":SOUR1:BURS:NCYC", 1.0),
        # One connector is the trigger's input or its output.
        *([source, trigger_output] if setting.trigger_source == "BUS" else [trigger_output, source]),
        item(":TRIG1:DEL", setting.trigger_delay_s),
        item(":SOUR1:BURS:STAT", "1"),
    ]


def uploaded_name(arb: ArbBlock) -> str:
    """Name of a waveform in the instrument; it follows from the codes, so that it cannot name others."""
    return f"B{crc32(uploaded_block(arb)):08X}"


def uploaded_block(arb: ArbBlock) -> bytes:
    """Codes as they are sent: most significant byte first, as after ``*RST``."""
    return arb.codes.astype(">i2").tobytes()
