"""How the answers of emulated instruments differ from recorded ones, as values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

if TYPE_CHECKING:
    from collections.abc import Mapping

DifferenceKind = Literal[
    "error", "silence", "shape", "text", "number", "points", "format", "wording", "measured"
]
"""Another number from the error queue, or a refusal; only one answers; another form or size; other words;
another number; other bytes where bytes have to be equal; the same number written otherwise; another text of
the same error; and numbers that the instrument measures, which count as equal."""
KINDS: tuple[DifferenceKind, ...] = get_args(DifferenceKind)
"""The gravest first."""


@dataclass(frozen=True, slots=True)
class Difference:
    """Two answers to the same question.

    Parameters
    ----------
    record : int
        Number of the record with the question, from 1 as in a replay.
    kind : str
        See `DifferenceKind`.
    recorded, emulated : str
        What was answered.
    after : tuple of str
        Of an entry of an error queue: what was written since the queue was asked before.
    raised_by : str
        Of an emulated error: the message that raised it.
    """

    record: int
    kind: DifferenceKind
    recorded: str
    emulated: str
    after: tuple[str, ...] = ()
    raised_by: str = ""


@dataclass(frozen=True, slots=True)
class Row:
    """All answers to one question of one instrument.

    Parameters
    ----------
    link : str
        ``generator`` or ``digitizer``.
    question : str
        Header, or verb and kind of the telemetry.
    count, equal, measured, differ : int
        How many were compared; how many are equal; how many are equal but for numbers that were measured;
        how many differ.
    kinds : mapping
        How many differ, or were measured, by `DifferenceKind`.
    recorded, emulated : str
        The first of the gravest difference, else the first.
    differences : tuple of Difference
        The first of each kind, the gravest kind first.
    """

    link: str
    question: str
    count: int
    equal: int
    measured: int
    differ: int
    kinds: Mapping[DifferenceKind, int]
    recorded: str
    emulated: str
    differences: tuple[Difference, ...]


@dataclass(frozen=True, slots=True)
class Latency:
    """How long answers of one kind took.

    Parameters
    ----------
    link, kind : str
        Of the instrument; of the answer.
    count : int
        Of answers.
    recorded_s, emulated_s : tuple of float
        Median, 90th and 99th percentile, and largest, s. Those of the emulated instrument are of a call
        within the process, without any line.
    """

    link: str
    kind: str
    count: int
    recorded_s: tuple[float, float, float, float]
    emulated_s: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class WindowStatistics:
    """Windows of samples beside each other, in counts of the converter.

    Parameters
    ----------
    link : str
        Of the digitizer.
    count : int
        Of pairs of windows.
    recorded, emulated : tuple of float
        Medians over the windows of their mean, their rms about it, and their largest distance from it.
    largest_difference : tuple of float
        Of the same three, within a pair.
    """

    link: str
    count: int
    recorded: tuple[float, float, float]
    emulated: tuple[float, float, float]
    largest_difference: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class LinkEvent:
    """What broke the exchange; nothing behind it is compared up to the next clear of that link.

    Parameters
    ----------
    record : int
        Its number.
    link : str
        Whose.
    what : str
        One line.
    """

    record: int
    link: str
    what: str


@dataclass(frozen=True, slots=True)
class ErrorCount:
    """How often both instruments gave the same error.

    Parameters
    ----------
    link : str
        Of the instrument.
    code : int
        Its number; of a receiver, that of its reason.
    count : int
        How often.
    """

    link: str
    code: int
    count: int


@dataclass(frozen=True, slots=True)
class Parity:
    """What the comparison of a recording with emulated instruments found.

    Parameters
    ----------
    rows : tuple of Row
        In the order in which the questions came up.
    errors : tuple of ErrorCount
        That both gave.
    windows : tuple of WindowStatistics
        Of the digitizer; empty when there were none.
    latencies : tuple of Latency
        By link and kind.
    events : tuple of LinkEvent
        Errors of the links, and how the recording ends where it does not end well.
    passed_over : int
        Questions that were not compared because a link had failed before.
    """

    rows: tuple[Row, ...]
    errors: tuple[ErrorCount, ...]
    windows: tuple[WindowStatistics, ...]
    latencies: tuple[Latency, ...]
    events: tuple[LinkEvent, ...]
    passed_over: int

    @property
    def count(self) -> int:
        """Answers that were compared."""
        return sum(row.count for row in self.rows)

    @property
    def differ(self) -> int:
        """Answers that differ."""
        return sum(row.differ for row in self.rows)

    @property
    def measured(self) -> int:
        """Answers that are equal but for numbers that were measured."""
        return sum(row.measured for row in self.rows)

    @property
    def kinds(self) -> dict[DifferenceKind, int]:
        """How many answers differ, by kind, the gravest first."""
        found = {kind: sum(row.kinds.get(kind, 0) for row in self.rows) for kind in KINDS}
        return {kind: count for kind, count in found.items() if count and kind != "measured"}
