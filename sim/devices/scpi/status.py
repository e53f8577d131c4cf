"""Errors, the error queue and the status registers of IEEE 488.2 and SCPI-1999 (volume 2, chapter 21)."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

QUEUE_DEPTH = 20
_LONGEST_DETAIL = 80

MESSAGES = {
    0: "No error",
    -101: "Invalid character",
    -102: "Syntax error",
    -103: "Invalid separator",
    -104: "Data type error",
    -108: "Parameter not allowed",
    -109: "Missing parameter",
    -112: "Program mnemonic too long",
    -113: "Undefined header",
    -114: "Header suffix out of range",
    -121: "Invalid character in number",
    -123: "Exponent too large",
    -128: "Numeric data not allowed",
    -131: "Invalid suffix",
    -138: "Suffix not allowed",
    -141: "Invalid character data",
    -148: "Character data not allowed",
    -151: "Invalid string data",
    -158: "String data not allowed",
    -161: "Invalid block data",
    -168: "Block data not allowed",
    -178: "Expression data not allowed",
    -211: "Trigger ignored",
    -221: "Settings conflict",
    -222: "Data out of range",
    -223: "Too much data",
    -224: "Illegal parameter value",
    -230: "Data corrupt or stale",
    -350: "Queue overflow",
    -363: "Input buffer overrun",
    -430: "Query DEADLOCKED",
}

OPERATION_COMPLETE, QUERY_ERROR, DEVICE_ERROR, EXECUTION_ERROR, COMMAND_ERROR, POWER_ON = (
    1 << bit for bit in (0, 2, 3, 4, 5, 7)
)
ERROR_QUEUE_BIT, QUESTIONABLE_BIT, MESSAGE_AVAILABLE, EVENT_BIT, MASTER_BIT, OPERATION_BIT = (
    1 << bit for bit in (2, 3, 4, 5, 6, 7)
)


class ScpiError(Exception):
    """An error on its way to the queue; it never leaves the device.

    Parameters
    ----------
    code : int
        SCPI number; above zero for the device's own.
    detail : str
        Added to the standard text after a semicolon; the whole text for a code that has none.
    """

    def __init__(self, code: int, detail: str = "") -> None:
        super().__init__(code, detail)
        self.code = code
        self.detail = detail

    @property
    def is_command_error(self) -> bool:
        """Whether the message could not be understood (-100 to -199)."""
        return -200 < self.code <= -100

    def __str__(self) -> str:
        detail = "".join(_printable(letter) for letter in self.detail[:_LONGEST_DETAIL])
        text = "; ".join(part for part in (MESSAGES.get(self.code, ""), detail) if part)
        return f'{self.code:+d},"{text}"'


def _printable(letter: str) -> str:
    """Keep the answer to ``SYST:ERR?`` one line of ASCII with two quotes."""
    if letter == '"':
        return "'"
    return letter if letter.isascii() and letter.isprintable() else "?"


def event_bit(code: int) -> int:
    """Bit of the standard event register that an error number sets."""
    for bit, last in ((COMMAND_ERROR, -200), (EXECUTION_ERROR, -300), (DEVICE_ERROR, -400)):
        if last < code <= last + 100:
            return bit
    return DEVICE_ERROR if code > 0 else QUERY_ERROR


@dataclass(slots=True)
class Register:
    """Condition, event and enable of OPERation or QUEStionable, with positive transitions only."""

    condition: int = 0
    event: int = 0
    enable: int = 0

    def set(self, bit: int, on: bool) -> None:
        """Follow a condition; what rises is latched in `event`."""
        before = self.condition
        self.condition = before | bit if on else before & ~bit
        self.event |= self.condition & ~before

    def take_event(self) -> int:
        """Read and clear the latched events."""
        event, self.event = self.event, 0
        return event


@dataclass(slots=True)
class Status:
    """Everything a status byte is made of."""

    events: int = POWER_ON
    event_enable: int = 0
    service_enable: int = 0
    questionable: Register = field(default_factory=Register)
    operation: Register = field(default_factory=Register)
    errors: deque[str] = field(default_factory=deque)

    def report(self, error: ScpiError) -> None:
        """Queue an error and set its event bit; a full queue has its newest entry replaced by -350."""
        self.events |= event_bit(error.code)
        if len(self.errors) == QUEUE_DEPTH:
            self.errors[-1] = str(ScpiError(-350))
        else:
            self.errors.append(str(error))

    def next_error(self) -> str:
        """Take the oldest error, as number and text."""
        return self.errors.popleft() if self.errors else str(ScpiError(0))

    def take_events(self) -> int:
        """Read and clear the standard event register."""
        events, self.events = self.events, 0
        return events

    def clear(self) -> None:
        """Do what ``*CLS`` does: events and errors go, enable masks stay."""
        self.events = self.questionable.event = self.operation.event = 0
        self.errors.clear()

    def byte(self, message_available: bool) -> int:
        """Return the status byte with the master summary in bit 6."""
        value = (
            (ERROR_QUEUE_BIT if self.errors else 0)
            | (QUESTIONABLE_BIT if self.questionable.event & self.questionable.enable else 0)
            | (MESSAGE_AVAILABLE if message_available else 0)
            | (EVENT_BIT if self.events & self.event_enable else 0)
            | (OPERATION_BIT if self.operation.event & self.operation.enable else 0)
        )
        return value | (MASTER_BIT if value & self.service_enable & ~MASTER_BIT else 0)
