"""A plan: every shot of a procedure, decided before the first is measured."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Protocol, TypeVar

from belahil.errors import LimitExceeded

if TYPE_CHECKING:
    from collections.abc import Callable

    from belahil.bench import Bench
    from belahil.receiver import DigitizerSpec
    from belahil.stimuli import Stimulus
    from belahil.values import Shot, Trigger, WindowRequest

NOMINAL_CODE = 4
"""Chosen for the least noise at the input of BELA's GRM (paper, appendix on the filter)."""


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


class ChosenOptions(Protocol):
    """Options of a procedure: a dataclass."""

    __dataclass_fields__: ClassVar[dict[str, Any]]


Options = TypeVar("Options", bound=ChosenOptions)


@dataclass(frozen=True)
class RecordablePlan(Generic[Options]):
    """A plan whose analysis needs no more than the windows, so that recorded ones serve as well.

    Parameters
    ----------
    shots : tuple of PlannedShot
        In the order in which they are measured; empty for recorded windows.
    converters, bits : int
        Interleaved converters, and their resolution.
    options : dataclass
        As the user chose.
    """

    shots: tuple[PlannedShot, ...] = field(repr=False)
    converters: int
    bits: int
    options: Options

    def as_json(self) -> dict[str, Any]:
        """Return what the shots follow from, as plain values, for the run's fingerprint."""
        return {
            "converters": self.converters,
            "bits": self.bits,
            "requests": [asdict(one.request) for one in self.shots],
            "options": asdict(self.options),
        }


class Journal(Protocol):
    """What a procedure needs of a run: a shot is measured unless it is there already."""

    def shot(self, request: WindowRequest, measure: Callable[[], Shot], why: Callable[[], str] = str) -> Shot:
        """Return the kept shot of this index, or measure and keep it; `why` tells why it was repeated."""
        ...


def usual_code(spec: DigitizerSpec, wanted: int | None) -> int | None:
    """Return the gain code of a procedure that needs one only.

    Parameters
    ----------
    spec : DigitizerSpec
        The receiver on the bench.
    wanted : int or None
        As the user chose; None: 4 where the receiver has it, else its first.

    Returns
    -------
    int or None
        None for a receiver without gain codes. Whether it has the wanted one is left to `check_all`.

    Raises
    ------
    LimitExceeded
        A code is wanted of a receiver without any.
    """
    if spec.gain_codes is None:
        if wanted is not None:
            raise LimitExceeded(f"gain code {wanted}: this receiver has no gain codes")
        return None
    if wanted is not None:
        return wanted
    return NOMINAL_CODE if NOMINAL_CODE in spec.gain_codes else spec.gain_codes[0]


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
        run.shot(
            planned.request,
            lambda one=planned: bench.measure(one.stimulus, one.request),  # type: ignore[misc]
            lambda: bench.repeated_because,
        )
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
