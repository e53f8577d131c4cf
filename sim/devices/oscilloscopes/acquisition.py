"""What all emulated oscilloscopes share: they are armed, they wait, they hold a record."""

from __future__ import annotations

import re
from copy import deepcopy
from typing import TYPE_CHECKING, Protocol, cast

from belahil.errors import RefusedInput
from belahil.values import WindowRequest
from sim.devices.scpi import ScpiDevice
from sim.devices.scpi.parameters import Choices
from sim.devices.scpi.parser import Token
from sim.devices.scpi.status import ScpiError

if TYPE_CHECKING:
    from belahil.oscilloscopes import ScopeModel
    from belahil.values import RangeWindow, Trigger


LARGEST_SHOT = (1 << 32) - 1
"""A larger number that a client writes is no shot of any plan."""
_MOST_DIGITS = len(str(LARGEST_SHOT))


class ScopePort(Protocol):
    """The oscilloscope's side of the plant."""

    def arm(self, request: WindowRequest) -> None:
        """Prepare a record; unless it waits for the generator it is digitized now."""
        ...

    def collect(self) -> RangeWindow | None:
        """Hand over the record once it has been digitized."""
        ...

    def abort(self) -> None:
        """Forget what is armed."""
        ...


class ScopeFront(Protocol):
    """The settings of an oscilloscope that decide which codes it gives."""

    model: ScopeModel
    full_scale_v: float
    offset_v: float
    interval_s: float

    def prepare(self) -> None:
        """Make ready for records with these settings.

        Raises
        ------
        RefusedInput
            No record can be computed with them.
        """
        ...


class ScopeDevice(ScpiDevice):
    """An oscilloscope with one channel that is connected, to the receiver's analog output.

    Parameters
    ----------
    port : ScopePort
        Takes the records.
    front : ScopeFront
        Is told the settings before each record.

    Notes
    -----
    A shot number that a client has written into the instrument keys the record's chance; without one the
    records are counted. What this does not model: the time that an acquisition takes, untriggered sweeps that
    go on, other channels, measurements, the screen, and ``*LRN?`` (Keysight's is a block that nobody but the
    instrument can read, and Tektronix's tells settings that are not here).
    """

    kept_fields: tuple[str, ...] = ()
    """Settings, for ``*SAV``."""
    signed = True
    """Whether error numbers and the like have a plus sign."""

    def __init__(self, port: ScopePort, front: ScopeFront) -> None:
        model = front.model
        super().__init__(f"{model.maker},{model.name},EMULATED,0.00-emulated", channels=4, signed=self.signed)
        self.model = model
        self._port = port
        self._front = front
        self._record: RangeWindow | None = None
        self._taken = 0
        self._trigger: Trigger = "generator"
        self.is_armed = False

    def kept(self) -> object:
        """Return all settings."""
        return {name: deepcopy(getattr(self, name)) for name in self.kept_fields}

    def bring_back(self, kept: object) -> None:
        """Make all settings what they were, and stop."""
        self.reset()
        for name, value in cast("dict[str, object]", kept).items():
            setattr(self, name, deepcopy(value))

    def shot(self) -> int | None:
        """Return the shot number that a client wrote, None without one."""
        raise NotImplementedError

    def view(self) -> tuple[float, float, float, float, int]:
        """Return full scale and offset in V, interval and start of a record in s, and its samples."""
        raise NotImplementedError

    def interval_over(self, span_s: float, points: int) -> float:
        """Return the interval of a record over a screen, s.

        It is never shorter than the fastest rate makes it: a record then reaches beyond a short screen.
        """
        return max(span_s / points, 1 / self.model.max_rate_hz)

    def acquired(self) -> None:
        """Take notice that a record has come."""

    def start(self, at_once: bool = False) -> None:
        """Wait for a trigger in place of any before, or take a record at once.

        Raises
        ------
        ScpiError
            -221 for a sample rate at which the receiver's noise cannot be computed.
        """
        self.halt()
        full_scale_v, offset_v, interval_s, start_s, points = self.view()
        front = self._front
        front.full_scale_v, front.offset_v, front.interval_s = full_scale_v, offset_v, interval_s
        try:
            front.prepare()
        except RefusedInput as error:
            raise ScpiError(-221, f"not emulated: {error}") from error
        shot = self.shot()
        self._record, self.is_armed = None, True
        trigger: Trigger = "immediate" if at_once else "generator"
        self._port.arm(
            WindowRequest(
                self._taken if shot is None else shot, None, points, delay_s=start_s, trigger=trigger
            )
        )

    def force(self) -> None:
        """Take a record at once where one is waited for."""
        if self.record() is None and self.is_armed:
            self.start(at_once=True)

    def halt(self) -> None:
        """Wait no longer; what was taken stays."""
        self.record()
        self._port.abort()
        self.is_armed = False

    def record(self) -> RangeWindow | None:
        """Return the last record, None when there is none since the start."""
        window = self._port.collect() if self.is_armed else None
        if window is not None:
            self._record, self.is_armed = window, False
            self._taken += 1
            self.acquired()
        return self._record


_CHANNEL = re.compile(r"CHAN(?:NEL)?([1-4])", re.IGNORECASE)


class Sources(Choices):
    """Words for what is acquired or triggers: channels by number, in both forms, and other words."""

    def read(self, token: Token) -> str:
        """Return the short form of what was sent."""
        found = _CHANNEL.fullmatch(token.text)
        return f"CHAN{found[1]}" if found and token.kind == "character" else super().read(token)


def shot_in(digits: str) -> int | None:
    """Return a shot number that a client wrote, None for what is none."""
    is_number = digits.isdecimal() and len(digits) <= _MOST_DIGITS
    return int(digits) if is_number and int(digits) <= LARGEST_SHOT else None


def quoted(text: str) -> str:
    """Return a text as the string of an answer."""
    return '"' + text.replace('"', '""') + '"'


def block(data: bytes, digits: int | None = None) -> str:
    """Return a definite-length block as the text of an answer, one character for each byte."""
    count = str(len(data)) if digits is None else f"{len(data):0{digits}d}"
    return f"#{len(count)}{count}" + data.decode("latin-1")
