"""How exact is every stage on this machine, and what does that cost: the work-precision table.

Each row is a method at a setting: its error against a stated reference, what it foretold, and the time of a
shot. What fails stays in the table.

What this does not model: the cost of a whole shot, which is less than the sum of its stages where they share
work; and a machine that others use at the same time, on which the shortest of many times is still the best
guess.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from procedures.accuracy_machine import Machine, this_machine
from procedures.accuracy_rows import STAGES, Effort, Row, Setting, Stage, measured, timed_again, with_pareto
from procedures.accuracy_startup import startup_s

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class AccuracyOptions:
    """What to measure, and how long.

    Parameters
    ----------
    stages : tuple of str
        Of `STAGES`; in that order.
    effort : Effort
        For each row.
    """

    stages: tuple[Stage, ...] = STAGES
    effort: Effort = field(default_factory=Effort)


@dataclass(frozen=True, slots=True)
class WorkPrecision:
    """A work-precision table.

    Parameters
    ----------
    machine : Machine
        Where it was measured.
    startup_s : dict of str to float
        Imports and compilation in a fresh process, s; not in the times of the rows.
    rows : tuple of Row
        In the order of stages, cases and methods.
    """

    machine: Machine
    startup_s: dict[str, float]
    rows: tuple[Row, ...]


def settings(stages: Iterable[Stage]) -> tuple[Setting, ...]:
    """List the settings of some stages, in the order of `STAGES`."""
    wanted = set(stages)
    return tuple(setting for stage in STAGES if stage in wanted for setting in _of(stage))


def measure(options: AccuracyOptions, progress: Progress) -> WorkPrecision:
    """Measure every setting, and time all of them once more.

    Parameters
    ----------
    options : AccuracyOptions
        What.
    progress : callable
        Of (done, total), after each row of both rounds.
    """
    todo = settings(options.stages)
    first = []
    for setting in todo:
        first.append(measured(setting, options.effort))
        progress(len(first), 2 * len(todo))
    rows: list[Row] = []
    for row, found in first:
        rows.append(timed_again(row, found, options.effort))
        progress(len(todo) + len(rows), 2 * len(todo))
    return WorkPrecision(this_machine(options.effort), startup_s(), with_pareto(rows))


def by_case(unsorted: Iterable[Setting]) -> tuple[Setting, ...]:
    """Put the settings of each case together, in the order in which the cases first come."""
    every = tuple(unsorted)
    cases = list(dict.fromkeys(setting.case for setting in every))
    return tuple(sorted(every, key=lambda setting: cases.index(setting.case)))


def _of(stage: Stage) -> Iterable[Setting]:
    """Import a stage's module only where it is measured."""
    if stage == "footprint":
        from procedures.accuracy_footprint import footprint_settings

        return footprint_settings()
    if stage == "filter":
        from procedures.accuracy_filter import filter_settings

        return filter_settings()
    if stage == "detection":
        from procedures.accuracy_detection import detection_settings
        from procedures.accuracy_range_finder import range_finder_settings

        return by_case((*detection_settings(), *range_finder_settings()))
    from procedures.accuracy_noise import noise_settings

    return noise_settings()
