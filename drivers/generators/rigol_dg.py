"""Rigol DG1000Z function generators.

A reset leaves the load setting at high impedance, so that is always set. Numbers are answered with seven
digits. Waveforms are played by their sample rate and read back whole after they were uploaded; this needs
the sample-rate mode before the upload, for in the other mode the instrument makes 8192 points of fewer. The
model has no voltage limits of its own: the interlock of the bench is the only one. A new shape needs the
output off meanwhile, which it is, and some time before it is on again (`GeneratorModel.rest_before_on_s`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from belahil.errors import CorruptData
from drivers.generators.dialect import SCPI_INFINITY, Item, Shown, item, sine_voltages
from drivers.generators.scpi_words import ScpiWords

if TYPE_CHECKING:
    from belahil.generators import ArbBlock, GeneratorModel, GeneratorSetting
    from drivers.generators.dialect import Expected
    from drivers.scpi import ScpiSession

_RANGE = ":SOUR1:VOLT:RANG:AUTO"
_MODE = ":SOUR1:FUNC:ARB:MODE"
_LOADED = ":SOUR1:DATA:LOAD?"
_ZERO_CODE = 8192
_SOURCES = {"BUS": "MAN", "EXT": "EXT"}


class RigolDgDialect(ScpiWords):
    """How a DG1000Z is told a setting."""

    output = ":OUTP1"
    amplitude = ":SOUR1:VOLT"
    autorange = _RANGE

    def base_items(self, model: GeneratorModel, load_ohm: float, largest_v: float) -> list[Item]:
        """Return what is set once: load, in whole ohms, and unit."""
        if math.isinf(load_ohm):
            load = Item(":OUTP1:LOAD INF", ":OUTP1:LOAD?", Shown(SCPI_INFINITY))
        else:
            load = Item(f":OUTP1:LOAD {load_ohm:.15g}", ":OUTP1:LOAD?", Shown(load_ohm))
        return [load, item(":SOUR1:VOLT:UNIT", "VPP")]

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
                item(":SOUR1:BURS", "0"),
                item(_MODE, "FREQ"),
                item(":SOUR1:FUNC", "DC"),
                _number(":SOUR1:VOLT:OFFS", setting.offset_v),
            ]
        return self.ordered(items, setting, before)

    def upload(self, session: ScpiSession, arb: ArbBlock) -> None:
        """Send the points of a waveform, with the output off, and read them back."""
        session.send(self.off.command, f"{_MODE} SRAT")
        block = (arb.codes.astype("int32") + _ZERO_CODE).astype("<u2").tobytes()
        session.send_block(":SOUR1:DATA:DAC VOLATILE,", block)
        (answer,) = session.ask(f"{_LOADED} VOLATILE")
        try:
            packages = int(float(answer))
        except ValueError as error:
            raise CorruptData(f"{_LOADED} VOLATILE answers {answer!r}, and not how many packages") from error
        # As many as can hold the longest waveform in the smallest packages that anybody saw.
        held = b"".join(session.ask_block(f"{_LOADED} {one}") for one in range(1, min(packages, 64) + 1))
        if held != block:
            raise CorruptData(
                f"{arb.codes.size} points were uploaded, and {len(held) // 2} came back that are not the same"
            )

    def agrees(self, answer: str, expected: Expected) -> bool:
        """Tell whether an answer is what an item expects; a word may come in its long form."""
        if isinstance(expected, str) and expected.isalpha():
            return answer.strip('"').upper().startswith(expected)
        return super().agrees(answer, expected)


def _number(header: str, value: float) -> Item:
    return Item(f"{header} {float(value)!r}", f"{header}?", Shown(value))


def _sine_items(setting: GeneratorSetting, before: GeneratorSetting | None) -> list[Item]:
    frequency = _number(":SOUR1:FREQ", setting.frequency_hz)
    volts = sine_voltages(
        _number(":SOUR1:VOLT", setting.amplitude_vpp),
        _number(":SOUR1:VOLT:OFFS", setting.offset_v),
        setting,
        before,
    )
    # The faster, the smaller an amplitude may be.
    rising = before is not None and before.function == "SIN" and setting.frequency_hz > before.frequency_hz
    return [
        item(":SOUR1:BURS", "0"),
        item(_MODE, "FREQ"),
        item(":SOUR1:FUNC", "SIN"),
        *([*volts, frequency] if rising else [frequency, *volts]),
    ]


def _pulse_items(setting: GeneratorSetting, arb: ArbBlock) -> list[Item]:
    manual = setting.trigger_source == "BUS"
    source = item(":SOUR1:BURS:TRIG:SOUR", _SOURCES.get(setting.trigger_source, "INT"))
    trigger_output = item(":SOUR1:BURS:TRIG:TRIGO", "POS" if manual else "OFF")
    volts = f":SOUR1:VOLT {float(setting.amplitude_vpp)!r}"
    return [
        item(_MODE, "SRAT"),
        item(":SOUR1:FUNC", "USER"),
        _number(":SOUR1:FUNC:ARB:SRAT", arb.sample_rate_hz),
        _number(":SOUR1:VOLT:OFFS", setting.offset_v),
        # The range for this amplitude, and then held: no relay moves while pulses of one amplitude follow.
        Item(f"{_RANGE} ON;{volts};{_RANGE} OFF", ":SOUR1:VOLT?", Shown(setting.amplitude_vpp)),
        Item("", f"{_RANGE}?", "0"),
        item(":SOUR1:BURS:MODE", "TRIG"),
        Item(":SOUR1:BURS:NCYC 1", ":SOUR1:BURS:NCYC?", Shown(1)),
        # One connector is the trigger's input or its output.
        *([source, trigger_output] if manual else [trigger_output, source]),
        _number(":SOUR1:BURS:TDEL", setting.trigger_delay_s),
        item(":SOUR1:BURS", "1"),
    ]
