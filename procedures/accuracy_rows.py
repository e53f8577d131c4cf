"""A row of the work-precision table: what a method promises, what it does, and what a shot costs with it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final, Literal

Stage = Literal["footprint", "filter", "detection", "noise"]
STAGES: Final[tuple[Stage, ...]] = ("footprint", "filter", "detection", "noise")

_LEAST_CALLS = 3
_AS_FAST = 1.05
"""Times within so much of each other count as equal: the clock tells no better."""


@dataclass(frozen=True, slots=True)
class Effort:
    """How long a method is timed in each of two rounds; see `measured` and `timed_again`.

    Parameters
    ----------
    calls : int
        At most, beside a first one to warm up; the shortest counts.
    budget_s : float
        No further call once so much time has gone, but at least three.
    """

    calls: int = 200
    budget_s: float = 0.05


@dataclass(frozen=True, slots=True)
class Measured:
    """What a setting gave.

    Parameters
    ----------
    error : float
        Against the reference, in the unit of the setting.
    shot : callable
        What is timed; all that can be prepared once has been.
    shots : int
        Shots in one call of it.
    predicted : float or None
        Error that the method foretells; None: it does not.
    work : mapping of str to int
        What is counted, as pixels or bins: the same on every machine.
    """

    error: float
    shot: Callable[[], object]
    shots: int = 1
    predicted: float | None = None
    work: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Setting:
    """A method with its setting, not yet measured.

    Parameters
    ----------
    stage : str
        One of `STAGES`.
    case : str
        The task; only methods for the same case compete.
    method, setting : str
        What is done, and how finely.
    reference : str
        What the error is measured against.
    unit : str
        Of the error.
    measure : callable
        Prepares the method and finds its error.
    requested : float or None
        Error that was asked for; more than that is a failure. None: nothing was promised.
    """

    stage: Stage
    case: str
    method: str
    setting: str
    reference: str
    unit: str
    measure: Callable[[], Measured]
    requested: float | None = None


@dataclass(frozen=True, slots=True)
class Row:
    """A measured setting; the first seven parameters are those of `Setting`.

    Parameters
    ----------
    error, predicted, microseconds : float or None
        None where the method failed before it had one, or foretells none. The last is a shot's, the shortest.
    work : dict of str to int
        See `Measured`.
    failure : str
        Why it failed; empty: it did not.
    pareto : bool
        No other row of its case is both as fast and as exact; see `with_pareto`.
    """

    stage: Stage
    case: str
    method: str
    setting: str
    reference: str
    unit: str
    requested: float | None
    error: float | None = None
    predicted: float | None = None
    microseconds: float | None = None
    work: dict[str, int] = field(default_factory=dict)
    failure: str = ""
    pareto: bool = False

    @property
    def of_predicted(self) -> float | None:
        """Error over predicted error."""
        return self.error / self.predicted if self.error is not None and self.predicted else None

    @property
    def of_requested(self) -> float | None:
        """Error over what was asked for."""
        return self.error / self.requested if self.error is not None and self.requested else None


def measured(setting: Setting, effort: Effort) -> tuple[Row, Measured | None]:
    """Measure one setting; beside its row return what `timed_again` needs, None where it failed.

    Whatever goes wrong with it becomes a row with a reason: a table that drops the settings that fail would
    show every method at its best.
    """
    empty = Row(
        setting.stage,
        setting.case,
        setting.method,
        setting.setting,
        setting.reference,
        setting.unit,
        setting.requested,
    )
    try:
        found = setting.measure()
        elapsed_us = microseconds(found.shot, effort) / found.shots
    except Exception as error:
        return replace(empty, failure=" ".join((str(error) or type(error).__name__).split())), None
    row = replace(empty, microseconds=elapsed_us, predicted=found.predicted, work=dict(found.work))
    if not math.isfinite(found.error):
        return replace(row, failure="the error is not a finite number"), found
    row = replace(row, error=float(found.error))
    if setting.requested is not None and found.error > setting.requested:
        row = replace(row, failure=f"error above the {number(setting.requested)} that was asked for")
    return row, found


def timed_again(row: Row, found: Measured | None, effort: Effort) -> Row:
    """Time a setting once more, some time later, and keep the shorter time.

    Others on the machine slow everything down for seconds: the calls of one round are then all too long.
    """
    if found is None or row.microseconds is None:
        return row
    elapsed_us = microseconds(found.shot, effort) / found.shots
    return replace(row, microseconds=min(row.microseconds, elapsed_us))


def short(value: float, digits: int = 1) -> str:
    """Write a number with so many digits behind the point and a power of ten, without zeros in that.

    Examples
    --------
    >>> short(1e-4, 0), short(0.0123)
    ('1e-4', '1.2e-2')
    """
    mantissa, _, power = f"{value:.{digits}e}".partition("e")
    return f"{mantissa}e{int(power)}"


def number(value: float) -> str:
    """Write a number plainly where that is short, else with a power of ten.

    Examples
    --------
    >>> number(247.6), number(1.0), number(0.0123)
    ('248', '1', '1.2e-2')
    """
    return f"{value:.3g}" if 0.1 <= value < 1000 else short(value)


def microseconds(run: Callable[[], object], effort: Effort) -> float:
    """Return the shortest of several calls, warm, us."""
    run()
    shortest_s, begun = math.inf, time.perf_counter()
    for number in range(1, effort.calls + 1):
        begin = time.perf_counter()
        run()
        now = time.perf_counter()
        shortest_s = min(shortest_s, now - begin)
        if number >= _LEAST_CALLS and now - begun > effort.budget_s:
            break
    return 1e6 * shortest_s


def with_pareto(rows: Iterable[Row]) -> tuple[Row, ...]:
    """Mark the rows that no other of their stage and case beats in both time and error.

    Rows that failed take no part. Times within 5 % of each other count as equal.
    """
    every = tuple(rows)
    return tuple(replace(row, pareto=_unbeaten(row, every)) for row in every)


def _unbeaten(row: Row, every: tuple[Row, ...]) -> bool:
    if row.failure or row.error is None or row.microseconds is None:
        return False
    return not any(_beats(other, row) for other in every)


def _beats(other: Row, row: Row) -> bool:
    if (other.stage, other.case) != (row.stage, row.case) or other.failure:
        return False
    if not (other.microseconds and row.microseconds) or other.error is None or row.error is None:
        return False
    slower = other.microseconds / row.microseconds
    if other.error < row.error:
        return slower <= _AS_FAST
    return other.error == row.error and slower < 1 / _AS_FAST
