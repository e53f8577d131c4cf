"""Errors of the energy along the altitude: curves until detections are rare, and where they reach a level."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.values import Estimate

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from procedures.energy_cells import EnergyCell

    Read = Callable[[EnergyCell], Estimate | None]
    """A number of a cell; None where nothing is detected."""

MOST_PFD = 0.90
"""Until which curves are drawn, as in the paper's figure."""


@dataclass(frozen=True, slots=True)
class Case:
    """A curve: everything but the altitude.

    Parameters
    ----------
    distance, light : str
        As of `procedures.range_scenes.Condition`.
    reflectance, slope_deg : float
        Of the ground.
    """

    distance: str
    light: str
    reflectance: float
    slope_deg: float


def case_of(cell: EnergyCell) -> Case:
    """Return the curve on which a cell lies."""
    condition = cell.condition
    return Case(condition.distance, condition.light, condition.reflectance, cell.slope_deg)


def cases(cells: Sequence[EnergyCell]) -> dict[Case, list[EnergyCell]]:
    """Put cells into curves by rising altitude."""
    found: dict[Case, list[EnergyCell]] = {}
    for cell in sorted(cells, key=lambda one: one.altitude_m):
        found.setdefault(case_of(cell), []).append(cell)
    return found


def until_rare(cells: Sequence[EnergyCell], read: Read) -> list[tuple[float, Estimate]]:
    """Return altitudes, m, and numbers of a curve until its probability of false detection is 90 %.

    The last one is interpolated to where it is, unless the curve ends before.
    """
    found: list[tuple[float, Estimate]] = []
    before: EnergyCell | None = None
    for cell in cells:
        value = read(cell)
        if value is None:
            break
        if cell.pfd.value > MOST_PFD:
            if before is not None:
                found.append(_between(found[-1], (cell.altitude_m, value), before, cell))
            break
        found.append((cell.altitude_m, value))
        before = cell
    return found


def _between(
    low: tuple[float, Estimate], high: tuple[float, Estimate], before: EnergyCell, after: EnergyCell
) -> tuple[float, Estimate]:
    share = (MOST_PFD - before.pfd.value) / (after.pfd.value - before.pfd.value)
    mixed = [
        (1 - share) * getattr(low[1], name) + share * getattr(high[1], name)
        for name in ("value", "standard_uncertainty")
    ]
    return low[0] + share * (high[0] - low[0]), Estimate(mixed[0], mixed[1])


@dataclass(frozen=True, slots=True)
class Crossing:
    """Where a curve reaches a level.

    Parameters
    ----------
    status : str
        "ok"; "below": it stays below the level as far as it was computed; "above": it is above from the
        lowest altitude on; "not_known": there is no curve.
    altitude : Estimate or None
        m; None unless "ok".
    """

    status: str
    altitude: Estimate | None = None

    def as_json(self) -> dict[str, Any]:
        """Return it as results hold it."""
        return {"status": self.status, "altitude": None if self.altitude is None else self.altitude.as_json()}


def crossing(curve: Sequence[tuple[float, Estimate]], level: float) -> Crossing:
    """Return where a rising curve of positive numbers first reaches a level, its logarithm interpolated.

    Parameters
    ----------
    curve : sequence of (float, Estimate)
        Altitudes, rising, m, and what is there.
    level : float
        Positive.
    """
    if not curve:
        return Crossing("not_known")
    if curve[0][1].value >= level:
        return Crossing("above")
    for (low_m, low), (high_m, high) in pairwise(curve):
        if high.value < level:
            continue
        pace = math.log(high.value / low.value) / (high_m - low_m)
        share = math.log(level / low.value) / (pace * (high_m - low_m))
        ends = [
            part * one.standard_uncertainty / one.value
            for part, one in zip((1 - share, share), (low, high), strict=True)
        ]
        at_m = low_m + share * (high_m - low_m)
        return Crossing("ok", Estimate(at_m, math.hypot(*ends) / pace, "m"))
    return Crossing("below")


def at_altitude(curve: Sequence[tuple[float, Estimate]], altitude_m: float) -> Estimate | None:
    """Return a curve's number at an altitude, the logarithm interpolated; None beyond its ends."""
    places = np.array([place for place, _ in curve])
    if not places.size or not places[0] <= altitude_m <= places[-1]:
        return None
    value = float(np.exp(np.interp(altitude_m, places, np.log([one.value for _, one in curve]))))
    relative = np.interp(altitude_m, places, [one.standard_uncertainty / one.value for _, one in curve])
    return Estimate(value, value * float(relative))
