"""Errors, the error queue and the status registers of IEEE 488.2 and SCPI-1999 (volume 2, chapter 21)."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

from sim.devices.scpi.registers import Register

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
    -144: "Character data too long",
    -148: "Character data not allowed",
    -151: "Invalid string data",
    -158: "String data not allowed",
    -161: "Invalid block data",
    -168: "Block data not allowed",
    -178: "Expression data not allowed",
    -211: "Trigger ignored",
    -213: "Init ignored",
    -221: "Settings conflict",
    -222: "Data out of range",
    -223: "Too much data",
    -224: "Illegal parameter value",
    -230: "Data corrupt or stale",
    -240: "Hardware error",
    -241: "Hardware missing",
    -310: "System error",
    -313: "Calibration memory lost",
    -330: "Self-test failed",
    -350: "Queue overflow",
    -363: "Input buffer overrun",
    -410: "Query INTERRUPTED",
    -420: "Query UNTERMINATED",
    -430: "Query DEADLOCKED",
    -440: "Query UNTERMINATED after indefinite response",
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

    def entry(self) -> ErrorEntry:
        """Return what stands in the queue."""
        detail = "".join(_printable(letter) for letter in self.detail[:_LONGEST_DETAIL])
        return ErrorEntry(
            self.code, "; ".join(part for part in (MESSAGES.get(self.code, ""), detail) if part)
        )


class ErrorEntry(NamedTuple):
    """Number and text of an error."""

    code: int
    text: str


NO_ERROR = ErrorEntry(0, MESSAGES[0])


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
class Status:
    """Everything a status byte is made of, but whether a message is available.

    Parameters
    ----------
    queue_depth : int
        Most errors that are kept.
    signed : bool
        Whether whole numbers are answered with a plus sign, as Keysight does.
    """

    queue_depth: int = QUEUE_DEPTH
    signed: bool = True
    events: int = POWER_ON
    event_enable: int = 0
    service_enable: int = 0
    power_on_clear: bool = True
    questionable: Register = field(default_factory=Register)
    operation: Register = field(default_factory=Register)
    errors: deque[ErrorEntry] = field(default_factory=deque)

    def integer(self, value: int) -> str:
        """Write a whole number."""
        return f"{value:+d}" if self.signed else f"{value:d}"

    def report(self, error: ScpiError) -> None:
        """Queue an error and set its event bit; a full queue has its newest entry replaced by -350."""
        self.events |= event_bit(error.code)
        if len(self.errors) == self.queue_depth:
            self.errors[-1] = ScpiError(-350).entry()
        else:
            self.errors.append(error.entry())

    def next_error(self) -> str:
        """Take the oldest error, as number and text."""
        return self._written(self.errors.popleft() if self.errors else NO_ERROR)

    def next_code(self) -> str:
        """Take the oldest error, as number."""
        return self.integer(self.errors.popleft().code if self.errors else 0)

    def all_errors(self) -> str:
        """Take all errors, oldest first."""
        return ",".join(map(self._written, self._emptied()))

    def all_codes(self) -> str:
        """Take all errors, oldest first, as numbers."""
        return ",".join(self.integer(entry.code) for entry in self._emptied())

    def _emptied(self) -> list[ErrorEntry]:
        taken = list(self.errors) or [NO_ERROR]
        self.errors.clear()
        return taken

    def _written(self, entry: ErrorEntry) -> str:
        return f'{self.integer(entry.code)},"{entry.text}"'

    def take_events(self) -> int:
        """Read and clear the standard event register."""
        events, self.events = self.events, 0
        return events

    def clear(self) -> None:
        """Do what ``*CLS`` does: events and errors go, enable masks and filters stay."""
        self.events = self.questionable.event = self.operation.event = 0
        self.errors.clear()

    def preset(self) -> None:
        """Do what ``STATus:PRESet`` does: nothing is enabled, and rising conditions make events."""
        self.questionable.preset()
        self.operation.preset()

    def power_on(self) -> None:
        """Begin anew; ``*PSC 0`` keeps the masks of service requests and standard events."""
        self.clear()
        self.preset()
        self.events = POWER_ON
        if self.power_on_clear:
            self.event_enable = self.service_enable = 0

    def byte(self, message_available: bool) -> int:
        """Return the status byte with the master summary in bit 6."""
        value = (
            (ERROR_QUEUE_BIT if self.errors else 0)
            | (QUESTIONABLE_BIT if self.questionable.summary else 0)
            | (MESSAGE_AVAILABLE if message_available else 0)
            | (EVENT_BIT if self.events & self.event_enable else 0)
            | (OPERATION_BIT if self.operation.summary else 0)
        )
        return value | (MASTER_BIT if value & self.service_enable & ~MASTER_BIT else 0)
