"""How one family of oscilloscopes is spoken to."""

from __future__ import annotations

import itertools
import math
import re
from typing import TYPE_CHECKING, NamedTuple, Protocol

from belahil.errors import CorruptData

if TYPE_CHECKING:
    from belahil.oscilloscopes import ScopeModel, ScopeRecord, ScopeSetting
    from drivers.scpi import ScpiSession

READ_BACK_TOLERANCE = 1e-3
"""Relative; what the instrument rounded counts in its preamble all the same."""
_ALMOST_ZERO = 1e-12


class Item(NamedTuple):
    """A command, the question that reads it back (empty: none does), and what that has to answer."""

    command: str
    query: str
    expected: str | float | re.Pattern[str]
    tolerance: float = READ_BACK_TOLERANCE


def item(header: str, value: str | float) -> Item:
    """Return the usual form of an item: the header with the value, and the header with a question mark.

    A word may be written as guides do, ``NORMal``: its capitals are sent, and either form may come back.
    """
    return Item(f"{header} {_short(value) if isinstance(value, str) else repr(value)}", f"{header}?", value)


def _short(word: str) -> str:
    return "".join(itertools.takewhile(lambda letter: not letter.islower(), word))


class ScopeDialect(Protocol):
    """The words of one family; state and proof are the driver's."""

    model: ScopeModel
    known: re.Pattern[str]
    """Identities of this family."""
    stop: str
    """Waits no longer."""
    start: str
    """Waits for one trigger."""
    force: str
    """Takes the record now."""
    tells_errors: bool
    """Whether ``SYSTem:ERRor?`` is among its words."""

    def items(self, setting: ScopeSetting, identity: str) -> tuple[Item, ...]:
        """Return all that has to be set for a record by the instrument of that identity."""
        ...

    def mark(self, shot: int) -> Item:
        """Return how the shot is written where it changes nothing."""
        ...

    def forget(self, session: ScpiSession) -> None:
        """Empty the registers that tell of earlier acquisitions.

        Raises
        ------
        StaleData
            The instrument has not stopped.
        """
        ...

    def is_armed(self, session: ScpiSession) -> bool:
        """Tell whether the instrument waits for its trigger since `start`."""
        ...

    def is_done(self, session: ScpiSession) -> bool:
        """Tell whether the acquisition that was started has come to its end.

        Raises
        ------
        StaleData
            It has ended without a trigger.
        """
        ...

    def record(self, session: ScpiSession, setting: ScopeSetting) -> ScopeRecord:
        """Read the record.

        Raises
        ------
        CorruptData
            What came is none, or not in the format that was set.
        """
        ...


def agrees(answer: str, sent: Item) -> bool:
    """Tell whether a setting that was read back is the one that was sent."""
    if isinstance(sent.expected, re.Pattern):
        return bool(sent.expected.fullmatch(answer.strip()))
    if isinstance(sent.expected, str):
        return answer.strip().upper() in (_short(sent.expected), sent.expected.upper())
    try:
        return math.isclose(float(answer), sent.expected, rel_tol=sent.tolerance, abs_tol=_ALMOST_ZERO)
    except ValueError:
        return False


def numbers(answer: str, count: int, what: str) -> list[float]:
    """Read numbers with commas between them.

    Raises
    ------
    CorruptData
        There are not `count` of them, or one is not finite.
    """
    try:
        found = [float(field) for field in answer.split(",")]
    except ValueError:
        found = []
    if len(found) != count or not all(map(math.isfinite, found)):
        raise CorruptData(f"{what} {answer[:120]!r}: {count} numbers with commas between them are due")
    return found
