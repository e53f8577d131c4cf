"""Statements of the study's text (Nishiyama et al.) as checks that a campaign makes of its own results.

`docs/paper-statements.md` has all of them, by the same keys; campaigns make those that their numbers decide.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from belahil.values import Estimate

COVERAGE = 2.0
"""Standard uncertainties of our number within which a statement still holds."""


@dataclass(frozen=True, slots=True)
class Statement:
    """A statement of the text beside our number.

    Parameters
    ----------
    key : str
        On the page of statements: "R6".
    says : str
        The statement in a few words.
    criterion : str
        "about" the published number, "at most" or "at least" it.
    published : float
        In the unit of `ours`.
    rounding : float
        Half of the last place that the text gives, in the same unit.
    ours : Estimate
        Our number.
    interval : tuple of float or None
        What the assumed constants leave open, in the same unit; None where no budget was computed.
    """

    key: str
    says: str
    criterion: Literal["about", "at most", "at least"]
    published: float
    rounding: float
    ours: Estimate
    interval: tuple[float, float] | None = None

    @property
    def verdict(self) -> str:
        """Say "agrees", "open" (the assumed constants leave room for it) or "differs".

        Examples
        --------
        >>> from belahil.values import Estimate
        >>> ours = Estimate(2.4, 0.1, "m")
        >>> Statement("R6", "", "about", 3.0, 0.5, ours).verdict
        'agrees'
        >>> Statement("R6", "", "about", 3.0, 0.1, ours).verdict
        'differs'
        >>> Statement("R6", "", "about", 3.0, 0.1, ours, (1.8, 3.2)).verdict
        'open'
        """
        spread = COVERAGE * self.ours.standard_uncertainty
        if self._holds(self.ours.value - spread, self.ours.value + spread):
            return "agrees"
        if self.interval is not None and self._holds(*self.interval):
            return "open"
        return "differs"

    @property
    def within_uncertainty(self) -> bool:
        """Whether it agrees though our number alone does not fit the statement.

        Examples
        --------
        >>> from belahil.values import Estimate
        >>> [Statement("R13", "", "at most", 0.05, 0.005, Estimate(ours, 0.1, "1")).within_uncertainty
        ...  for ours in (0.02, 0.19, 0.9)]
        [False, True, False]
        """
        return self.verdict == "agrees" and not self._holds(self.ours.value, self.ours.value)

    def _holds(self, low: float, high: float) -> bool:
        """Whether any number from `low` to `high` fits the statement."""
        above = self.criterion == "at least" or low <= self.published + self.rounding
        below = self.criterion == "at most" or high >= self.published - self.rounding
        return above and below

    def as_json(self) -> dict[str, Any]:
        """Return the row that results hold."""
        return {
            "statement": self.key,
            "says": self.says,
            "criterion": self.criterion,
            "published": self.published,
            "in": self.ours.unit,
            "ours": self.ours.as_json(),
            "ours_interval": None if self.interval is None else list(self.interval),
            "verdict": self.verdict,
            "within_uncertainty": self.within_uncertainty,
        }


def told(rows: list[dict[str, Any]]) -> list[str]:
    """Return rows of results for the terminal, a line each.

    Examples
    --------
    >>> from belahil.values import Estimate
    >>> one = Statement("R6", "error at 1400 km by day", "about", 3.0, 0.5, Estimate(2.61, 0.02, "m"))
    >>> told([one.as_json()])
    ['R6 error at 1400 km by day: about 3 m, here 2.610(20) m: agrees']
    >>> told([Statement("R13", "PFD", "at most", 0.05, 0.005, Estimate(0.19, 0.1, "1")).as_json()])
    ['R13 PFD: at most 0.05, here 0.19(10): agrees within 2 standard uncertainties']
    """
    from belahil.report.tables import one_text

    lines = []
    for one in rows:
        ours = one["ours"]
        within = f" within {COVERAGE:g} standard uncertainties" if one["within_uncertainty"] else ""
        unit = "" if ours["unit"] == "1" else f" {ours['unit']}"
        lines.append(
            f"{one['statement']} {one['says']}: {one['criterion']} {one['published']:g}{unit}, "
            f"here {one_text({**ours, 'unit': '1'})}{unit}: {one['verdict']}{within}"
        )
    return lines
