"""Counting what emulated instruments answer beside recorded ones."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from belahil.parity import (
    KINDS,
    Difference,
    ErrorCount,
    Latency,
    LinkEvent,
    Parity,
    Row,
    WindowStatistics,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from belahil.parity import DifferenceKind


@dataclass
class _Count:
    equal: int = 0
    kinds: Counter[DifferenceKind] = field(default_factory=Counter)
    first: tuple[str, str] = ("", "")
    kept: list[Difference] = field(default_factory=list)

    def keep(self, found: Difference, examples: int) -> None:
        """Keep so many of a kind, and of errors each new pair: no error hides behind others."""
        alike = [one for one in self.kept if one.kind == found.kind]
        pairs = {(one.recorded, one.emulated) for one in alike}
        if len(alike) < examples or (found.kind == "error" and (found.recorded, found.emulated) not in pairs):
            self.kept.append(found)


class Tally:
    """Counts answers while a recording is gone through.

    Parameters
    ----------
    examples : int
        Differences of each kind that are kept for each question.
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
        count.kinds[difference.kind] += 1
        count.keep(difference, self._examples)

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
            rows=tuple(_row(*key, count) for key, count in self._counts.items()),
            errors=tuple(ErrorCount(*key, count) for key, count in sorted(self._errors.items())),
            windows=tuple(_beside(link, pairs) for link, pairs in self._windows.items()),
            latencies=tuple(
                Latency(*key, len(times), *(_percentiles(side) for side in zip(*times, strict=True)))
                for key, times in self._times.items()
            ),
            events=tuple(self._events),
            passed_over=self.passed_over,
        )


def _row(link: str, question: str, count: _Count) -> Row:
    kept = tuple(sorted(count.kept, key=lambda one: KINDS.index(one.kind)))
    measured = count.kinds["measured"]
    differ = count.kinds.total() - measured
    shown = (kept[0].recorded, kept[0].emulated) if kept else count.first
    return Row(
        link,
        question,
        count.equal + count.kinds.total(),
        count.equal,
        measured,
        differ,
        {kind: count.kinds[kind] for kind in KINDS if count.kinds[kind]},
        *shown,
        kept,
    )


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
