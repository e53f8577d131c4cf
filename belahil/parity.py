"""How the answers of emulated instruments differ from recorded ones: the report as values, and its tally."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

DifferenceKind = Literal[
    "text", "number", "format", "error", "wording", "shape", "points", "silence", "measured"
]
"""Other words; another number; the same number written otherwise; another number from the error queue; its
text; another form or size of binary data; other bytes where bytes have to be equal; only one answers; and
numbers that the instrument measures, which count as equal."""

FEWEST_FOR_P99 = 100
"""Below this count the 99th percentile is the largest, or nearly so."""


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
    recorded, emulated : str
        The first that differ, else the first.
    differences : tuple of Difference
        The first of those that differ, then of those that were measured.
    """

    link: str
    question: str
    count: int
    equal: int
    measured: int
    differ: int
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


@dataclass
class _Count:
    equal: int = 0
    measured: int = 0
    differ: int = 0
    first: tuple[str, str] = ("", "")
    differences: list[Difference] = field(default_factory=list)
    noises: list[Difference] = field(default_factory=list)


class Tally:
    """Counts answers while a recording is gone through.

    Parameters
    ----------
    examples : int
        Differences that are kept for each question.
    """

    def __init__(self, examples: int) -> None:
        self._examples = examples
        self._counts: dict[tuple[str, str], _Count] = {}
        self._errors: Counter[tuple[str, int]] = Counter()
        self._times: dict[tuple[str, str], list[tuple[float, float]]] = {}
        self._windows: dict[str, list[tuple[list[float], list[float]]]] = {}
        self._events: list[LinkEvent] = []
        self.passed_over = 0

    def equal(self, link: str, question: str, answer: str) -> None:
        """Count an answer that both gave."""
        self._count(link, question, answer, answer).equal += 1

    def differs(self, link: str, question: str, difference: Difference) -> None:
        """Count an answer that differs, or that differs in what was measured."""
        count = self._count(link, question, difference.recorded, difference.emulated)
        noise = difference.kind == "measured"
        kept = count.noises if noise else count.differences
        if noise:
            count.measured += 1
        else:
            count.differ += 1
        if len(kept) < self._examples:
            kept.append(difference)

    def _count(self, link: str, question: str, recorded: str, emulated: str) -> _Count:
        if (link, question) not in self._counts:
            self._counts[link, question] = _Count(first=(recorded, emulated))
        return self._counts[link, question]

    def error(self, link: str, code: int) -> None:
        """Count an error that both gave."""
        self._errors[link, code] += 1

    def took(self, link: str, kind: str, recorded_s: float, emulated_s: float) -> None:
        """Note how long both took for an answer."""
        self._times.setdefault((link, kind), []).append((recorded_s, emulated_s))

    def window(
        self,
        link: str,
        record: int,
        question: str,
        shape: str,
        recorded: NDArray[np.integer],
        emulated: NDArray[np.integer],
    ) -> None:
        """Count two windows of the same shape: equal to the sample, or else each with its noise."""
        ours, theirs = _statistics(recorded), _statistics(emulated)
        self._windows.setdefault(link, []).append((ours, theirs))
        if np.array_equal(recorded, emulated):
            self.equal(link, question, shape)
        else:
            told = [f"mean {mean:.4g}, rms {rms:.4g}, peak {peak:.4g}" for mean, rms, peak in (ours, theirs)]
            self.differs(link, question, Difference(record, "measured", told[0], told[1]))

    def event(self, record: int, link: str, what: str) -> None:
        """Note what broke the exchange."""
        self._events.append(LinkEvent(record, link, what))

    def parity(self) -> Parity:
        """Return what was counted."""
        return Parity(
            rows=tuple(
                Row(
                    link,
                    question,
                    count.equal + count.measured + count.differ,
                    count.equal,
                    count.measured,
                    count.differ,
                    *_shown(count),
                    (*count.differences, *count.noises),
                )
                for (link, question), count in self._counts.items()
            ),
            errors=tuple(ErrorCount(*key, count) for key, count in sorted(self._errors.items())),
            windows=tuple(_beside(link, pairs) for link, pairs in self._windows.items()),
            latencies=tuple(
                Latency(*key, len(times), *(_percentiles(side) for side in zip(*times, strict=True)))
                for key, times in self._times.items()
            ),
            events=tuple(self._events),
            passed_over=self.passed_over,
        )


def _shown(count: _Count) -> tuple[str, str]:
    kept = count.differences or count.noises
    return (kept[0].recorded, kept[0].emulated) if kept else count.first


def _statistics(counts: NDArray[np.integer]) -> list[float]:
    values = counts.astype(np.float64)
    mean = float(values.mean())
    return [mean, float(values.std()), float(np.max(np.abs(values - mean)))]


def _beside(link: str, pairs: Sequence[tuple[list[float], list[float]]]) -> WindowStatistics:
    both = np.array(pairs)
    recorded, emulated = np.median(both, axis=0)
    largest = np.max(np.abs(both[:, 0] - both[:, 1]), axis=0)
    return WindowStatistics(link, len(pairs), *(_three(row) for row in (recorded, emulated, largest)))


def _three(row: NDArray[np.float64]) -> tuple[float, float, float]:
    mean, rms, peak = map(float, row)
    return mean, rms, peak


def _percentiles(times_s: Sequence[float]) -> tuple[float, float, float, float]:
    median, p90, p99, largest = map(float, np.percentile(times_s, [50, 90, 99, 100]))
    return median, p90, p99, largest
