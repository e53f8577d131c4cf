"""Verdicts from ``[limits]``: guarded acceptance and guarded rejection (JCGM 106:2012, 8.3).

A value passes when it keeps inside its limits by twice its standard uncertainty, fails when it is outside
by as much, and is undecided otherwise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from belahil.uncertainty import UNLIKELY, by_chance

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from belahil.config import LimitsTable
    from belahil.values import Estimate

COVERAGE = 2.0
"""Guard band in standard uncertainties: about 95 % for a normal distribution."""

Decision = Literal["pass", "fail", "undecided"]
Verdict = Literal["pass", "fail", "undecided", "none"]


@dataclass(frozen=True, slots=True)
class Check:
    """One value beside its limits.

    Parameters
    ----------
    limit : str
        Key in ``[limits]``.
    label : str
        Which value, for example ``code 4``.
    low, high : float
        Limits in the unit of the key.
    estimate : Estimate or None
        What was measured, if anything was.
    decision : {"pass", "fail", "undecided"}
        What follows.
    """

    limit: str
    label: str
    low: float
    high: float
    estimate: Estimate | None
    decision: Decision

    def as_json(self) -> dict[str, Any]:
        """Return the form that ``summary.json`` uses; an infinite limit is null."""
        return {
            "limit": self.limit,
            "label": self.label,
            "measured": None if self.estimate is None else self.estimate.as_json(),
            "low": self.low if math.isfinite(self.low) else None,
            "high": self.high if math.isfinite(self.high) else None,
            "verdict": self.decision,
        }


def decide(low: float, high: float, estimate: Estimate | None) -> Decision:
    """Compare one value with its limits; what was not measured is undecided.

    Examples
    --------
    >>> from belahil.values import Estimate
    >>> decide(18e6, 20e6, Estimate(19e6, 0.4e6, "Hz")), decide(18e6, 20e6, Estimate(19e6, 0.6e6, "Hz"))
    ('pass', 'undecided')
    >>> decide(18e6, 20e6, Estimate(21e6, 0.4e6, "Hz")), decide(18e6, 20e6, None)
    ('fail', 'undecided')
    """
    if estimate is None:
        return "undecided"
    guard = COVERAGE * estimate.standard_uncertainty
    if low <= estimate.value - guard and estimate.value + guard <= high:
        return "pass"
    if estimate.value + guard < low or high < estimate.value - guard:
        return "fail"
    return "undecided"


def checks(
    limits: LimitsTable | None, values: Mapping[str, Sequence[tuple[str, Estimate | None]]]
) -> list[Check]:
    """Compare what was measured with the limits of a bench file.

    Parameters
    ----------
    limits : LimitsTable or None
        As in the file. A limit on something that this procedure does not measure asks nothing of it.
    values : mapping of str to sequence of (label, Estimate or None)
        By key of ``[limits]``. A key without any value is undecided.
    """
    found: list[Check] = []
    for key in () if limits is None else limits.__struct_fields__:
        span = getattr(limits, key)
        if span is None or key not in values:
            continue
        low, high = span
        found += [
            Check(key, label, low, high, estimate, decide(low, high, estimate))
            for label, estimate in values[key] or [("nothing measured", None)]
        ]
    return found


def not_judged(limits: LimitsTable | None, values: Mapping[str, Sequence[Any]]) -> str:
    """Tell which limits of a bench file a procedure cannot judge, in a line; empty where it judges all.

    Parameters
    ----------
    limits : LimitsTable or None
        As in the file.
    values : mapping of str to sequence
        By key of ``[limits]``, as for `checks`.

    Examples
    --------
    >>> from belahil.config import LimitsTable
    >>> not_judged(LimitsTable(gain=(4.9, 5.5), enob=(9.0, 12.0)), {"gain": []})
    'not judged by this procedure: [limits] enob'
    """
    keys = () if limits is None else limits.__struct_fields__
    left = [key for key in keys if getattr(limits, key) is not None and key not in values]
    return f"not judged by this procedure: [limits] {', '.join(left)}" if left else ""


def not_measured(limit: str, status: str) -> Check:
    """Say that a procedure found nothing to judge, and which status is the reason.

    Examples
    --------
    >>> not_measured("threshold", "no_pulse").decision
    'undecided'
    """
    return Check(limit, status, -math.inf, math.inf, None, "undecided")


def disagreement(label: str, chi_square: float, degrees_of_freedom: int) -> list[Check]:
    """Fail a chi-square that chance does not make; of one that it makes nothing is said, for nobody asked.

    Parameters
    ----------
    label : str
        What was compared.
    chi_square : float
        Of measured values about those of a model.
    degrees_of_freedom : int
        At least 1.

    Examples
    --------
    >>> disagreement("delays", 31.2, 11)
    []
    >>> [(one.limit, round(one.high, 2), one.decision) for one in disagreement("delays", 31.3, 11)]
    [('chi_square', 31.26, 'fail')]
    """
    from scipy.special import chdtri

    from belahil.values import Estimate

    if by_chance(chi_square, degrees_of_freedom):
        return []
    high = float(f"{chdtri(degrees_of_freedom, UNLIKELY):.4g}")  # as a reader wants it
    return [Check("chi_square", label, 0.0, high, Estimate(chi_square, 0.0), "fail")]


def overall(found: Sequence[Check]) -> Verdict:
    """Fail when one fails, else undecided when one is, else pass; none when nothing was asked."""
    decisions = {check.decision for check in found}
    worst: tuple[Decision, ...] = ("fail", "undecided", "pass")
    return next((decision for decision in worst if decision in decisions), "none")
