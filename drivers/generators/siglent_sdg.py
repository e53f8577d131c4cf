"""Siglent SDG2000X function generators.

Commands are a channel, a word, and names with values; an answer repeats channel and word, and its values
carry units. What cannot be is changed without a word, and there is no error queue to rely on, so all is read
back: the settings, and the waveform point by point.

The sample rate says how fast a waveform is played (TrueArb). Some instruments take no burst in that mode, so
it is left for as long as the burst is told. There are no voltage limits to be set: the interlock of the bench
is the only one.
"""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

from belahil.errors import CorruptData
from drivers.generators.dialect import Fields, Item, agrees

if TYPE_CHECKING:
    from belahil.generators import ArbBlock, GeneratorModel, GeneratorSetting
    from drivers.generators.dialect import Expected
    from drivers.scpi import ScpiSession

NAME = "BELAHIL"
"""The waveform that is uploaded; the instrument keeps it, so there is only this one."""
_DIGITS = {"FRQ": 10, "VALUE": 10}
_FEWEST_DIGITS = 6
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_INTERPOLATIONS = {"linear": "LINE", "hold": "HOLD"}


class SiglentSdgDialect:
    """How an SDG2000X is told a setting."""

    off = Item("C1:OUTP OFF", "C1:OUTP?", Fields((("STATE", "OFF"),)))
    trigger = "C1:BTWV MTRIG"

    def reset(self) -> tuple[str, ...]:
        """Commands to the settings after a reset, with the smallest amplitude that every load allows."""
        return "*RST", "*CLS", "C1:BSWV AMP,0.004"

    def base_items(self, model: GeneratorModel, load_ohm: float, largest_v: float) -> list[Item]:
        """Return what is set once: the load, which is high impedance after a reset."""
        load = "HZ" if math.isinf(load_ohm) else f"{load_ohm:g}"
        expected = load if math.isinf(load_ohm) else load_ohm
        return [Item(f"C1:OUTP LOAD,{load}", "C1:OUTP?", Fields((("LOAD", expected),)))]

    def items(
        self, setting: GeneratorSetting, model: GeneratorModel, before: GeneratorSetting | None = None
    ) -> list[Item]:
        """Return a setting in the order in which an instrument accepts it."""
        no_burst = Item("C1:BTWV STATE,OFF", "C1:BTWV?", Fields((("STATE", "OFF"),)))
        if setting.function == "SIN":
            items = [no_burst, _sine_item(setting, before)]
        elif setting.arb is not None:
            items = _pulse_items(setting, setting.arb)
        else:
            items = [no_burst, _told("BSWV", ("WVTP", "DC"), ("OFST", setting.offset_v))]
        state = "ON" if setting.output else "OFF"
        output = Item(f"C1:OUTP {state}", "C1:OUTP?", Fields((("STATE", state),)))
        return [*items, output] if setting.output else [output, *items]

    def upload(self, session: ScpiSession, arb: ArbBlock) -> None:
        """Send the points of a waveform, with the output off, and read them back.

        Raises
        ------
        CorruptData
            Other points came back.
        """
        data = arb.codes.astype("<i2").tobytes()
        session.send(self.off.command)
        session.send_raw(f"C1:WVDT WVNM,{NAME},LENGTH,{len(data)}B,WAVEDATA,", data)
        if session.ask_raw(f"WVDT? USER,{NAME}", b"WAVEDATA,", len(data)) != data:
            raise CorruptData(f"{arb.codes.size} points were uploaded as {NAME}, and others were read back")

    def agrees(self, answer: str, expected: Expected) -> bool:
        """Tell whether an answer has what an item expects among its values."""
        if not isinstance(expected, Fields):
            return agrees(answer, expected)
        said = fields_of(answer)
        return all(key in said and _same(key, said[key], value) for key, value in expected.values)


def fields_of(answer: str) -> dict[str, str]:
    """Read an answer such as ``C1:OUTP ON,LOAD,50,PLRT,NOR``; what follows CARR belongs to other words."""
    words = [word.strip().upper() for word in answer.partition(" ")[2].split(",")]
    if words[0] in ("ON", "OFF"):
        words.insert(0, "STATE")
    if "CARR" in words:
        words = words[: words.index("CARR")]
    return dict(zip(words[::2], words[1::2], strict=False))


def _same(key: str, said: str, wanted: str | float) -> bool:
    if isinstance(wanted, str):
        return said == wanted
    number = _NUMBER.match(said)
    if number is None:
        return False
    digits = _DIGITS.get(key, _FEWEST_DIGITS)
    step = 10.0 ** (math.floor(math.log10(abs(wanted))) - digits + 1) if wanted else 0.0
    # One unit in the last digit that is shown: the instrument may round where we would not.
    return abs(float(number.group()) - wanted) <= step * (1 + 1e-6)


def _told(word: str, *pairs: tuple[str, str | float]) -> Item:
    sent = ",".join(
        f"{key},{value if isinstance(value, str) else repr(float(value))}" for key, value in pairs
    )
    return Item(f"C1:{word} {sent}", f"C1:{word}?", Fields(pairs))


def _sine_item(setting: GeneratorSetting, before: GeneratorSetting | None) -> Item:
    """Return the sine; values are taken one after the other, and the order must fit on the way."""
    frequency = ("FRQ", setting.frequency_hz)
    amplitude, offset = ("AMP", setting.amplitude_vpp), ("OFST", setting.offset_v)
    was_sine = before is not None and before.function == "SIN"
    larger = was_sine and before is not None and setting.amplitude_vpp > before.amplitude_vpp
    faster = was_sine and before is not None and setting.frequency_hz > before.frequency_hz
    volts = (offset, amplitude) if larger else (amplitude, offset)
    return _told("BSWV", ("WVTP", "SINE"), *((*volts, frequency) if faster else (frequency, *volts)))


def _pulse_items(setting: GeneratorSetting, arb: ArbBlock) -> list[Item]:
    by_us = setting.trigger_source == "BUS"
    burst = _told(
        "BTWV",
        ("STATE", "ON"),
        ("GATE_NCYC", "NCYC"),
        ("TIME", 1.0),
        ("TRSR", "MAN" if by_us else "EXT"),
        ("TRMD", "RISE") if by_us else ("EDGE", "RISE"),
        ("DLAY", setting.trigger_delay_s),
    )
    inter = _INTERPOLATIONS[arb.interpolation]
    rate = f"C1:SRATE MODE,TARB,VALUE,{float(arb.sample_rate_hz)!r},INTER,{inter}"
    # Not all firmware shows INTER; LINE is what it has after a reset.
    shown = (("INTER", inter),) if inter == "HOLD" else ()
    return [
        Item(f"C1:ARWV NAME,{NAME}", "C1:ARWV?", Fields((("NAME", NAME),))),
        _told("BSWV", ("WVTP", "ARB"), ("AMP", setting.amplitude_vpp), ("OFST", setting.offset_v)),
        Item(f"C1:SRATE MODE,DDS;{burst.command};{rate}", burst.query, burst.expected),
        Item(rate, "C1:SRATE?", Fields((("MODE", "TARB"), ("VALUE", arb.sample_rate_hz), *shown))),
    ]
