"""A plan: every shot of a procedure, decided before the first is measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable

    from belahil.bench import Bench
    from belahil.stimuli import Stimulus
    from belahil.values import Shot, Trigger, WindowRequest


@dataclass(frozen=True, slots=True)
class PlannedShot:
    """One shot to be measured.

    Parameters
    ----------
    request : WindowRequest
        Its `shot` is the index in the plan.
    stimulus : Stimulus
        In volts at the cut.
    """

    request: WindowRequest
    stimulus: Stimulus


class Journal(Protocol):
    """What a procedure needs of a run: a shot is measured unless it is there already."""

    def shot(self, request: WindowRequest, measure: Callable[[], Shot]) -> Shot:
        """Return the kept shot of this index, or measure and keep it."""
        ...


def measure_all(
    bench: Bench,
    run: Journal,
    shots: tuple[PlannedShot, ...],
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Measure every shot of a plan that the run does not hold yet.

    Parameters
    ----------
    bench : Bench
        Where to measure.
    run : Journal
        Keeps each shot as it comes.
    shots : tuple of PlannedShot
        In this order, which changes the stimulus as seldom as possible.
    progress : callable or None
        Told (done, all) after each shot.

    Raises
    ------
    InstrumentError
        What is measured so far is kept.
    """
    for done, planned in enumerate(shots, start=1):
        run.shot(planned.request, lambda one=planned: bench.measure(one.stimulus, one.request))  # type: ignore[misc]
        if progress is not None:
            progress(done, len(shots))


def check_all(bench: Bench, shots: tuple[PlannedShot, ...]) -> None:
    """Refuse a plan of which a single shot cannot be made, before anything is measured.

    Raises
    ------
    LimitExceeded, InterlockRefused
        For the first shot that generator, receiver or interlock would refuse.
    """
    stimuli: set[tuple[Stimulus, Trigger]] = set()
    codes: set[int | None] = set()
    for one in shots:
        played = one.stimulus, one.request.trigger
        if played not in stimuli or one.request.gain_code not in codes:
            bench.check(one.stimulus, one.request)
            stimuli.add(played)
            codes.add(one.request.gain_code)
