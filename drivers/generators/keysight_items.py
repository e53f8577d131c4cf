"""What a setting is in the words of a Keysight generator, and what it must read back as."""

from __future__ import annotations

import math
from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING, NamedTuple
from zlib import crc32

import numpy as np

from belahil.generators import FULL_CODE, per_50_ohm, round_amplitude

if TYPE_CHECKING:
    from belahil.generators import ArbBlock, GeneratorModel, GeneratorSetting

_INFINITE = 9.9e37  # SCPI-1999, volume 1, 7.2.1.4
_RANGE = ":SOUR1:VOLT:RANG:AUTO"
_SWITCHES = {"OFF": "0", "ON": "1"}
_FILTERS = {"linear": "NORM", "hold": "STEP"}


class Shown(NamedTuple):
    """A number that the instrument computes: it is compared to the digits that the answer shows."""

    value: float


class Item(NamedTuple):
    """One setting: the command that makes it, the query that reads it back, and what that must answer.

    The command is empty for what another item makes.
    """

    command: str
    query: str
    expected: str | float | Shown


def _item(header: str, value: str | float) -> Item:
    sent = value if isinstance(value, str) else repr(float(value))
    return Item(f"{header} {sent}", f"{header}?", value)


def base_items(model: GeneratorModel, load_ohm: float, largest_v: float) -> list[Item]:
    """Return what is set once: load, unit, and the instrument's own voltage limits.

    Parameters
    ----------
    model : GeneratorModel
        What the limits may be at most.
    load_ohm : float
        Load setting.
    largest_v : float
        Largest voltage into it, V; rounded up to the grid of half an amplitude, and to no less than the
        smallest amplitude needs.
    """
    unit = per_50_ohm(load_ohm)
    limit_v = round_amplitude(2 * largest_v, model, up=True) / 2
    limit_v = min(max(limit_v, model.min_amplitude_vpp * unit / 2), model.max_peak_v * unit)
    load = _item(":OUTP1:LOAD", load_ohm)
    return [
        load if math.isfinite(load_ohm) else Item(":OUTP1:LOAD INF", load.query, _INFINITE),
        _item(":SOUR1:VOLT:UNIT", "VPP"),
        _item(":SOUR1:VOLT:LIM:HIGH", limit_v),
        _item(":SOUR1:VOLT:LIM:LOW", -limit_v),
        _item(":SOUR1:VOLT:LIM:STAT", "1"),
    ]


def channel_items(setting: GeneratorSetting, before: GeneratorSetting | None = None) -> list[Item]:
    """Return a setting in the order in which an instrument accepts it.

    Parameters
    ----------
    setting : GeneratorSetting
        Function SIN, DC or ARB.
    before : GeneratorSetting or None
        What is set now: offset and half the amplitude must stay within the limits on the way.
    """
    if setting.function == "SIN":
        items = _sine_items(setting, before)
    elif setting.arb is not None:
        items = _pulse_items(setting, setting.arb)
    else:
        items = [
            _item(":SOUR1:BURS:STAT", "0"),
            _item(":SOUR1:FUNC", "DC"),
            _item(":SOUR1:VOLT:OFFS", setting.offset_v),
        ]
    if before is not None and before.function == "ARB" and setting.function != "ARB":
        items.insert(0, Item(f"{_RANGE} ON", f"{_RANGE}?", "1"))
    output = _item(":OUTP1", "1" if setting.output else "0")
    return [*items, output] if setting.output else [output, *items]


def _sine_items(setting: GeneratorSetting, before: GeneratorSetting | None) -> list[Item]:
    volts = [
        _item(":SOUR1:VOLT", setting.amplitude_vpp),
        _item(":SOUR1:VOLT:OFFS", setting.offset_v),
    ]
    if before is not None and before.function == "SIN" and setting.amplitude_vpp > before.amplitude_vpp:
        volts.reverse()
    return [
        _item(":SOUR1:BURS:STAT", "0"),
        _item(":SOUR1:FUNC", "SIN"),
        _item(":SOUR1:FREQ", setting.frequency_hz),
        *volts,
    ]


def _pulse_items(setting: GeneratorSetting, arb: ArbBlock) -> list[Item]:
    name = uploaded_name(arb)
    points = arb.codes.size
    average = int(arb.codes.sum(dtype="int64")) / (FULL_CODE * points)
    peak_to_peak = (int(arb.codes.max()) - int(arb.codes.min())) / FULL_CODE
    source = _item(":TRIG1:SOUR", setting.trigger_source)
    trigger_output = _item(":OUTP:TRIG", "1" if setting.trigger_source == "BUS" else "0")
    return [
        Item(f':SOUR1:FUNC:ARB "{name}"', ":SOUR1:FUNC:ARB?", name),
        Item("", f':SOUR1:DATA:ATTR:POIN? "{name}"', Shown(points)),
        Item("", f':SOUR1:DATA:ATTR:AVER? "{name}"', Shown(average)),
        Item("", f':SOUR1:DATA:ATTR:PTP? "{name}"', Shown(peak_to_peak)),
        _item(":SOUR1:FUNC", "ARB"),
        _item(":SOUR1:FUNC:ARB:SRAT", arb.sample_rate_hz),
        _item(":SOUR1:FUNC:ARB:FILT", _FILTERS[arb.interpolation]),
        _item(":SOUR1:VOLT:OFFS", setting.offset_v),
        # The range for this amplitude, and then held: no relay moves while pulses of one amplitude follow.
        Item(
            f"{_RANGE} ON;:SOUR1:VOLT {float(setting.amplitude_vpp)!r};{_RANGE} OFF",
            ":SOUR1:VOLT?",
            setting.amplitude_vpp,
        ),
        Item("", f"{_RANGE}?", "0"),
        _item(":SOUR1:BURS:MODE", "TRIG"),
        _item(":SOUR1:BURS:NCYC", 1.0),
        # One connector is the trigger's input or its output.
        *([source, trigger_output] if setting.trigger_source == "BUS" else [trigger_output, source]),
        _item(":TRIG1:DEL", setting.trigger_delay_s),
        _item(":SOUR1:BURS:STAT", "1"),
    ]


def same_codes(first: ArbBlock | None, second: ArbBlock | None) -> bool:
    """Tell whether two settings use the same points, or both none."""
    if first is None or second is None:
        return first is second
    return np.array_equal(first.codes, second.codes)


def uploaded_name(arb: ArbBlock) -> str:
    """Name of a waveform in the instrument; it follows from the codes, so that it cannot name others."""
    return f"B{crc32(uploaded_block(arb)):08X}"


def uploaded_block(arb: ArbBlock) -> bytes:
    """Codes as they are sent: most significant byte first, as after ``*RST``."""
    return arb.codes.astype(">i2").tobytes()


def agrees(answer: str, expected: str | float | Shown) -> bool:
    """Tell whether an answer is what it must be: a word in any quotes, or exactly the same number.

    A switch may be answered as a word.
    """
    if isinstance(expected, str):
        said = answer.strip('"').upper()
        return _SWITCHES.get(said, said) == expected
    try:
        if isinstance(expected, Shown):
            shown = Decimal(answer)
            last_digit = Decimal(1).scaleb(int(shown.as_tuple().exponent))
            return abs(shown - Decimal(expected.value)) <= last_digit
        return float(answer) == expected
    except (ValueError, InvalidOperation):
        return False
