"""Two runs side by side: what differs by more than their uncertainties, and what cannot be compared.

Every measured number (``value``, ``standard_uncertainty``, ``unit``) that both runs have under the same name
is tested for a difference of zero, two-sided, with normal law. As many numbers are tested at once, the
p-values are adjusted after Holm (1979), which holds whatever the numbers have in common: at level 0.05 two
runs of one receiver are called different once in twenty comparisons, and not once in twenty numbers.

An error that both runs share does not make them differ. Where the budgets of both runs break an uncertainty
into sources, a source that both share moves both numbers together, and only the difference of what it does
counts: u^2 = u1'^2 + u2'^2 + sum (c1 - c2)^2, with c the shared parts and u' the rest (JCGM 100:2008,
F.1.2.3).

Not modelled: what two numbers of one run have in common, degrees of freedom (an uncertainty is taken for
known), and shared errors of numbers without a budget, which are counted twice: the test is then too mild.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from belahil.errors import RefusedInput

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from belahil.values import Estimate

LEVEL = 0.05
AGREES, DIFFERS = "agrees", "differs"
ONLY_FIRST, ONLY_SECOND, OTHER_UNIT = "only_first", "only_second", "other_unit"


@dataclass(frozen=True, slots=True)
class RunSide:
    """One of two runs.

    Parameters
    ----------
    name : str
        How to call it.
    summary : mapping
        Its ``summary.json``.
    budget : sequence of mapping
        Of its ``report.json``: ``quantity``, ``source``, ``value``, ``unit``; empty where there is none.
    shares : mapping of str to object
        By source of a budget, whose error it is: equal in both runs where the error is the same one.
    """

    name: str
    summary: Mapping[str, Any]
    budget: Sequence[Mapping[str, Any]] = ()
    shares: Mapping[str, object] | None = None


@dataclass(frozen=True, slots=True)
class Compared:
    """One measured number in both runs.

    Parameters
    ----------
    name : str
        Where it is in the results: ``gain_codes[code=4].gain``.
    first, second : Estimate or None
        None where that run has not measured it.
    difference : Estimate or None
        Second minus first with its combined standard uncertainty; None where they cannot be compared.
    z, p_value : float or None
        Difference over uncertainty; probability of so large a one by chance, adjusted after Holm.
    verdict : str
        "agrees", "differs", "only_first", "only_second" or "other_unit".
    statuses : tuple of (str or None)
        The status nearest to the number in either run.
    common : tuple of str
        Sources of the budget that were taken for one error.
    """

    name: str
    first: Estimate | None
    second: Estimate | None
    difference: Estimate | None
    z: float | None
    p_value: float | None
    verdict: str
    statuses: tuple[str | None, str | None]
    common: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two runs side by side.

    Parameters
    ----------
    level : float
        Probability that any number of equal runs is called different.
    numbers : tuple of Compared
        In the order of the results.
    words : tuple of (name, first, second)
        Words and whole numbers that differ; they have no uncertainty and are not tested.
    notes : tuple of str
        What to keep in mind.
    """

    level: float
    numbers: tuple[Compared, ...]
    words: tuple[tuple[str, Any, Any], ...]
    notes: tuple[str, ...]

    @property
    def tested(self) -> tuple[Compared, ...]:
        """Numbers that both runs have."""
        return tuple(one for one in self.numbers if one.difference is not None)

    @property
    def differing(self) -> tuple[Compared, ...]:
        """Numbers that differ significantly."""
        return tuple(one for one in self.numbers if one.verdict == DIFFERS)


def compare(first: RunSide, second: RunSide, level: float = LEVEL) -> Comparison:
    """Compare all measured numbers of two runs.

    Parameters
    ----------
    first, second : RunSide
        Differences are second minus first.
    level : float
        Probability, above 0 and below 1, that a comparison of equal runs finds a difference at all.

    Raises
    ------
    RefusedInput
        The level is no probability, or the runs have no measured number in common.
    """
    from belahil.comparison_pairs import is_measured, pairs

    if not 0 < level < 1:
        raise RefusedInput(f"level {level:g}: must be above 0 and below 1")
    found: list[Compared] = []
    words: list[tuple[str, Any, Any]] = []
    for pair in pairs(first.summary["results"], second.summary["results"]):
        if is_measured(pair.first) or is_measured(pair.second):
            found.append(_compared(pair.name, pair.first, pair.second, pair.statuses, first, second))
        elif pair.first != pair.second:
            words.append((pair.name, pair.first, pair.second))
    if not any(one.difference for one in found):
        raise RefusedInput(
            f"{first.name} ({first.summary['procedure']}) and {second.name} "
            f"({second.summary['procedure']}) have no measured number in common"
        )
    return Comparison(level, tuple(_judged(found, level)), tuple(words), tuple(_notes(first, second)))


def holm(p_values: Sequence[float]) -> list[float]:
    """Adjust p-values for many tests after Holm (Scandinavian Journal of Statistics 6, 65, 1979).

    Examples
    --------
    >>> holm([0.01, 0.04, 0.03, 0.005])
    [0.03, 0.06, 0.06, 0.02]
    """
    adjusted, largest = [0.0] * len(p_values), 0.0
    for rank, place in enumerate(sorted(range(len(p_values)), key=p_values.__getitem__)):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[place]))
        adjusted[place] = largest
    return adjusted


def _compared(
    name: str,
    told_first: Any,
    told_second: Any,
    statuses: tuple[str | None, str | None],
    first: RunSide,
    second: RunSide,
) -> Compared:
    one, other = _estimate(told_first), _estimate(told_second)
    if one is None or other is None:
        verdict = ONLY_SECOND if one is None else ONLY_FIRST
        return Compared(name, one, other, None, None, None, verdict, statuses)
    if one.unit != other.unit:
        return Compared(name, one, other, None, None, None, OTHER_UNIT, statuses)
    common, spread = _combined(one, other, first, second)
    difference = other.value - one.value
    z = 0.0 if difference == 0 else math.copysign(math.inf, difference) if not spread else difference / spread
    p_value = math.erfc(abs(z) / math.sqrt(2))
    from belahil.values import Estimate

    told = Estimate(difference, spread, one.unit)
    return Compared(name, one, other, told, z, p_value, AGREES, statuses, common)


def _combined(
    one: Estimate, other: Estimate, first: RunSide, second: RunSide
) -> tuple[tuple[str, ...], float]:
    """Return which sources are one error, and the standard uncertainty of the difference."""
    mine, theirs = _parts(one, first), _parts(other, second)
    if mine is None or theirs is None or mine[0] != theirs[0]:
        return (), math.hypot(one.standard_uncertainty, other.standard_uncertainty)
    own, its = first.shares or {}, second.shares or {}
    common = [
        source
        for source in mine[1]
        if source in theirs[1] and source in own and own[source] == its.get(source)
    ]
    apart = [part[source] for part in (mine[1], theirs[1]) for source in part if source not in common]
    moved = [theirs[1][source] - mine[1][source] for source in common]
    return tuple(common), math.hypot(*apart, *moved)


def _parts(number: Estimate, run: RunSide) -> tuple[str, dict[str, float]] | None:
    """Find the lines of the budget that make up the uncertainty of a number; None where no or several do."""
    quantities: dict[str, dict[str, float]] = {}
    for line in run.budget:
        if line["unit"] == number.unit:
            quantities.setdefault(line["quantity"], {})[line["source"]] = line["value"]
    # A budget names its quantities in words; the sum of its lines is their key in the results.
    found = [
        (quantity, parts)
        for quantity, parts in quantities.items()
        if math.isclose(math.hypot(*parts.values()), number.standard_uncertainty, rel_tol=1e-9)
    ]
    return found[0] if len(found) == 1 and number.standard_uncertainty > 0 else None


def _judged(found: list[Compared], level: float) -> Iterator[Compared]:
    from dataclasses import replace

    adjusted = iter(holm([one.p_value for one in found if one.p_value is not None]))
    for one in found:
        if one.p_value is None:
            yield one
            continue
        p_value = next(adjusted)
        yield replace(one, p_value=p_value, verdict=DIFFERS if p_value <= level else AGREES)


def _estimate(told: Any) -> Estimate | None:
    from belahil.comparison_pairs import is_measured
    from belahil.values import Estimate

    return Estimate(told["value"], told["standard_uncertainty"], told["unit"]) if is_measured(told) else None


def _notes(first: RunSide, second: RunSide) -> Iterator[str]:
    one, other = first.summary, second.summary
    if one["procedure"] != other["procedure"]:
        yield f"the procedures differ: {one['procedure']} and {other['procedure']}"
    chance = one.get("seed")
    if chance is not None and chance == other.get("seed"):
        yield f"both runs have seed {chance}: where they share draws, they differ by less than is stated"
    if one.get("instruments") != other.get("instruments"):
        for part in sorted({*(one.get("instruments") or {}), *(other.get("instruments") or {})}):
            names = [(run.get("instruments") or {}).get(part) for run in (one, other)]
            if names[0] != names[1]:
                yield f"the {part}s differ: {names[0]} and {names[1]}"
