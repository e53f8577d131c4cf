"""Reading the other parameters: booleans, words of a choice, names, blocks, and numbers within limits."""

from __future__ import annotations

import math
from collections.abc import Callable

from sim.devices.scpi.numeric import Units, read_number
from sim.devices.scpi.parser import Token
from sim.devices.scpi.status import ScpiError
from sim.devices.scpi.tree import forms

Report = Callable[[ScpiError], None]

# Clamping forgives what comes from computing a limit in another order than a driver does.
LIMIT_SLACK = 1e-12


class Choices:
    """Words that a parameter may be.

    Parameters
    ----------
    *words : str
        Written like ``SINusoid``; answers use the short form.
    """

    def __init__(self, *words: str) -> None:
        self._short = {form: forms(word)[0] for word in words for form in forms(word)}
        self._full = dict(map(forms, words))

    def read(self, token: Token) -> str:
        """Return the short form of what was sent.

        Raises
        ------
        ScpiError
            -128, -158 or -168 for data that is no word, -224 for a word that is none of the choices.
        """
        if token.kind != "character":
            raise ScpiError({"number": -128, "string": -158}.get(token.kind, -168), token.text)
        short = self._short.get(token.text.upper())
        if short is None:
            raise ScpiError(-224, token.text)
        return short

    def full(self, short: str) -> str:
        """Return the long form of one of the words."""
        return self._full[short]


_LIMITS = Choices("MINimum", "MAXimum", "DEFault", "INFinity", "NINFinity")
_ON = {"ON": True, "OFF": False}


def read_boolean(token: Token) -> bool:
    """Read ON, OFF or a number, which is rounded and then on unless it is 0."""
    if token.kind == "character":
        if token.text.upper() not in _ON:
            raise ScpiError(-224, token.text)
        return _ON[token.text.upper()]
    return abs(read_number(token).value) >= 0.5


def read_integer(token: Token, least: int, most: int) -> int:
    """Read a number, round it, and refuse it outside of its range with -222."""
    value = read_number(token).value
    if not least - 0.5 <= value <= most + 0.5:
        raise ScpiError(-222, f"{least} to {most}")
    return min(max(round(value), least), most)


def read_name(token: Token) -> str:
    """Read a word or a quoted string."""
    if token.kind not in ("character", "string"):
        raise ScpiError(-104, token.text)
    return token.text


def read_block(token: Token) -> bytes:
    """Read a block."""
    if token.kind != "block":
        raise ScpiError(-104, token.text)
    return token.block


def read_limit(token: Token) -> str:
    """Return MIN, MAX, DEF, INF or NINF, empty for a token that is no word."""
    if token.kind != "character":
        return ""
    try:
        return _LIMITS.read(token)
    except ScpiError as error:
        raise ScpiError(-141, token.text) from error


def read_within(
    token: Token,
    units: Units | None,
    least: float,
    most: float,
    default: float,
    report: Report,
    infinite: bool = False,
) -> float:
    """Read a number or MIN, MAX, DEF; outside of its limits it becomes the limit, and -222 is reported.

    Parameters
    ----------
    token : Token
        The parameter.
    units : Units or None
        Suffixes it may have.
    least, most, default : float
        Limits, and what DEF means.
    report : callable
        Takes the error that does not stop the command.
    infinite : bool
        Whether INF is a value of its own.
    """
    word = read_limit(token)
    if word in ("MIN", "MAX", "DEF"):
        return {"MIN": least, "MAX": most, "DEF": default}[word]
    value = {"INF": math.inf, "NINF": -math.inf}[word] if word else read_number(token, units).value
    if infinite and value == math.inf:
        return value
    return clamp(value, least, most, report)


def clamp(value: float, least: float, most: float, report: Report) -> float:
    """Move a value to the limit it exceeds, and report -222."""
    if value > most + LIMIT_SLACK * abs(most):
        report(ScpiError(-222, "value clipped to upper limit"))
    elif value < least - LIMIT_SLACK * abs(least):
        report(ScpiError(-222, "value clipped to lower limit"))
    return min(max(value, least), most)
