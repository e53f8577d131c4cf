"""Numbers: NR1, NR2 and NR3 with suffix units in, full precision out."""

from __future__ import annotations

import math
import re
from functools import lru_cache
from typing import NamedTuple

from sim.devices.scpi.parser import Token
from sim.devices.scpi.status import ScpiError

# SCPI-1999 volume 1, 7.2.1.4 and 7.2.1.5.
INFINITY = 9.9e37
_INFINITY_TEXT = "9.900000000000000E+37"
_NOT_A_NUMBER_TEXT = "+9.910000000000000E+37"

_PLAIN = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d{1,5})?", re.ASCII)
_FULL = re.compile(
    r"([+-]?(?:\d+(?:\.\d*)?|\.\d+))(?:\s*[eE]\s*([+-]?\d+))?\s*([A-Za-z][A-Za-z/0-9]*)?", re.ASCII
)
_LARGEST_EXPONENT = 32000
_MULTIPLIERS = {
    "EX": 18, "PE": 15, "T": 12, "G": 9, "MA": 6, "K": 3, "": 0,
    "M": -3, "U": -6, "N": -9, "P": -12, "F": -15, "A": -18,
}  # fmt: skip


class Units(NamedTuple):
    """Suffix units that a parameter takes.

    Parameters
    ----------
    names : tuple of str
        Units that take multipliers.
    bare : tuple of str
        Units that take none.
    mega : bool
        Whether M is mega (as before HZ and OHM) instead of milli.
    """

    names: tuple[str, ...]
    bare: tuple[str, ...] = ()
    mega: bool = False


HERTZ = Units(("HZ",), mega=True)
OHM = Units(("OHM",), mega=True)
SAMPLES_PER_SECOND = Units(("SA/S", "HZ"), mega=True)
SECOND = Units(("S",))
VOLT = Units(("V",))
AMPLITUDE = Units(("VPP", "VRMS", "V"), bare=("DBM",))
DEGREE = Units((), bare=("DEG",))
PERCENT = Units((), bare=("PCT",))


class Quantity(NamedTuple):
    """A number and its unit; the unit is empty when none was sent."""

    value: float
    unit: str


def read_number(token: Token, units: Units | None = None) -> Quantity:
    """Read a number exactly as ``float`` would read it, the multiplier included.

    Parameters
    ----------
    token : Token
        A parameter.
    units : Units, optional
        What suffixes it may have.

    Raises
    ------
    ScpiError
        -121, -123, -128 family, -131, -138.
    """
    if token.kind != "number":
        raise ScpiError({"string": -158, "block": -168}.get(token.kind, -141), token.text)
    if _PLAIN.fullmatch(token.text):
        return Quantity(_as_scpi(float(token.text)), "")
    parts = _FULL.fullmatch(token.text)
    if parts is None:
        raise ScpiError(-121, token.text)
    mantissa, exponent, suffix = parts.groups()
    if exponent and (len(exponent) > 6 or abs(int(exponent)) > _LARGEST_EXPONENT):
        raise ScpiError(-123, token.text)
    unit, shift = _unit_of(suffix.upper(), units) if suffix else ("", 0)
    return Quantity(_as_scpi(float(f"{mantissa}e{int(exponent or 0) + shift}")), unit)


def _as_scpi(value: float) -> float:
    return math.copysign(math.inf, value) if abs(value) >= INFINITY else value


@lru_cache(maxsize=1024)
def _unit_of(suffix: str, units: Units | None) -> tuple[str, int]:
    """Split a suffix into its unit and its power of ten."""
    if units is None:
        raise ScpiError(-138, suffix)
    if suffix in units.bare:
        return suffix, 0
    for multiplier, power in _MULTIPLIERS.items():
        unit = suffix.removeprefix(multiplier)
        if unit in units.names and multiplier + unit == suffix:
            return unit, 6 if multiplier == "M" and units.mega else power
    raise ScpiError(-131, suffix)


def answer_number(value: float) -> str:
    """Write a number with 16 digits as Keysight does, with 17 where 16 would not come back equal."""
    if math.isinf(value):
        return ("+" if value > 0 else "-") + _INFINITY_TEXT
    if math.isnan(value):
        return _NOT_A_NUMBER_TEXT
    text = f"{value:+.15E}"
    return text if float(text) == value else f"{value:+.16E}"
