"""Rules that a driver is tried by, what was seen of each, and the report of all."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from typing import Any, Generic, Literal, TypeVar

from belahil.errors import BelahilError, ConformanceFailed, LinkClosed, ReplayDiffers

Status = Literal["holds", "fails", "not_applicable"]
S = TypeVar("S")


class Broken(Exception):
    """What was seen is not what was promised."""


class NotApplicable(Exception):
    """The rule cannot be tried here, and why."""


@dataclass(frozen=True, slots=True)
class RuleResult:
    """What became of one rule.

    Parameters
    ----------
    rule : str
        Its name.
    promise : str
        What the protocol promises.
    status : {"holds", "fails", "not_applicable"}
        Of this instrument.
    seen : str
        One line: what was seen, or why the rule does not apply.
    error : str
        Class of an error that nothing promised, empty without one.
    """

    rule: str
    promise: str
    status: Status
    seen: str
    error: str = ""

    def __str__(self) -> str:
        """One line for people."""
        return f"{self.rule}: {self.status.replace('_', ' ')}: {self.seen}"


@dataclass(frozen=True, slots=True)
class ConformanceReport:
    """What was seen of an instrument, rule by rule.

    Parameters
    ----------
    instrument : str
        "generator" or "digitizer".
    identity : str
        Who answered; empty when nobody could be asked.
    plays : tuple of str
        What the generator was to play with its output on.
    results : tuple of RuleResult
        In the order in which the rules were tried.
    """

    instrument: str
    identity: str
    plays: tuple[str, ...]
    results: tuple[RuleResult, ...]

    @property
    def failures(self) -> tuple[RuleResult, ...]:
        """The rules that do not hold."""
        return tuple(one for one in self.results if one.status == "fails")

    @property
    def holds(self) -> bool:
        """Whether every rule that applies holds."""
        return not self.failures

    @property
    def link_lost(self) -> bool:
        """Whether a rule failed because the other end was gone."""
        return any(one.error == LinkClosed.__name__ for one in self.failures)

    def require(self) -> ConformanceReport:
        """Return the report itself.

        Raises
        ------
        ConformanceFailed
            With every rule that fails.
        """
        if self.failures:
            broken = "; ".join(map(str, self.failures))
            raise ConformanceFailed(
                f"{self.instrument} {self.identity}: {len(self.failures)} of {len(self.results)} rules fail: "
                f"{broken}",
                self.failures,
            )
        return self

    def as_json(self) -> dict[str, Any]:
        """Return the report as plain values."""
        return {**asdict(self), "holds": self.holds}


@dataclass(frozen=True, slots=True)
class Rule(Generic[S]):
    """A promise and how to see whether it is kept.

    Parameters
    ----------
    name, promise : str
        For people.
    see : callable
        Tries it and returns what was seen; raises `Broken` or `NotApplicable`.
    """

    name: str
    promise: str
    see: Callable[[S], str]


def promised(promise: str) -> Callable[[Callable[[S], str]], Rule[S]]:
    """Make a rule of a function, which lends it its name."""
    return lambda see: Rule(see.__name__.strip("_"), promise, see)


def judged(rules: Iterable[Rule[S]], subject: S) -> tuple[RuleResult, ...]:
    """Try rules one after the other; none keeps the next from being tried.

    Raises
    ------
    ReplayDiffers
        Of a recording: it can tell nothing more.
    """
    return tuple(_judged(rule, subject) for rule in rules)


def _judged(rule: Rule[S], subject: S) -> RuleResult:
    try:
        return RuleResult(rule.name, rule.promise, "holds", rule.see(subject))
    except NotApplicable as reason:
        return RuleResult(rule.name, rule.promise, "not_applicable", str(reason))
    except Broken as seen:
        return RuleResult(rule.name, rule.promise, "fails", str(seen))
    except ReplayDiffers:
        raise
    except Exception as error:  # whatever a driver of somebody else raises is what was seen
        return RuleResult(rule.name, rule.promise, "fails", told(error), type(error).__name__)


def require(is_so: bool, otherwise: str) -> None:
    """Raise `Broken` with what was seen unless it is so."""
    if not is_so:
        raise Broken(otherwise)


def refused(asked: str, verb: Callable[[], object], *due: type[BelahilError]) -> str:
    """See that something is refused with one line of one of these classes, and return that line.

    Raises
    ------
    Broken
        It was accepted, or another error came.
    """
    names = " or ".join(kind.__name__ for kind in due)
    try:
        answer = verb()
    except ReplayDiffers:
        raise
    except due as error:
        require(bool(str(error)) and "\n" not in str(error), f"{asked}: {told(error)}; due is one line")
        return told(error)
    except Exception as error:
        raise Broken(f"{asked}: {told(error)}; due is {names}") from error
    raise Broken(f"{asked}: accepted, {shown(answer)}; due is {names}")


def told(error: BaseException) -> str:
    """Return class and text of an error, on one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def shown(value: object) -> str:
    """Return what something looks like, on one line that is not long."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 120 else f"{text[:117]}..."
