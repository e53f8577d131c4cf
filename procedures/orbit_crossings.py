"""Where a curve of the probability of false detection crosses a level."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.values import Estimate
from procedures.orbit_curves import along, logit
from procedures.orbit_shares import uncertainties

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from procedures.orbit_curves import Nodes


@dataclass(frozen=True, slots=True)
class Crossing:
    """Where a probability of false detection is reached.

    Parameters
    ----------
    status : str
        "crosses", "crosses_more_than_once", "always_below" or "always_above", within the altitudes that were
        computed.
    altitude : Estimate or None
        Of the first, m.
    """

    status: str
    altitude: Estimate | None


def crossing(nodes: Nodes, light: str, level: float) -> Crossing:
    """Return where the curve of "day" or "night" first crosses a probability."""
    low_m, high_m = float(nodes.altitude_m[0]), float(nodes.altitude_m[-1])
    at_m = np.linspace(low_m, high_m, max(2, math.ceil((high_m - low_m) / 1e3) + 1))
    row, wanted = 0 if light == "night" else -1, float(logit(level))
    copies = along(nodes.altitude_m, nodes.logit, at_m)[:, :, row] - wanted
    straight = along(nodes.altitude_m, nodes.estimate.logit, at_m, True)[:, :, row] - wanted
    above = copies[0] >= 0
    changes = int(np.count_nonzero(above[1:] != above[:-1]))
    if not changes:
        return Crossing("always_above" if above[0] else "always_below", None)
    status = "crosses" if changes == 1 else "crosses_more_than_once"
    found_m = _first_m(at_m, copies)
    u_m = math.hypot(*uncertainties(found_m, float(_first_m(at_m, straight)[0])))
    return Crossing(status, Estimate(float(found_m[0]), u_m, "m"))


def _first_m(at_m: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where rows first change their sign; the end on its way where they do not."""
    changed = (values[:, 1:] >= 0) != (values[:, :-1] >= 0)
    at = changed.argmax(axis=1)
    rows = np.arange(len(values))
    before, after = values[rows, at], values[rows, at + 1]
    there = changed[rows, at]
    part = before / np.where(there, before - after, 1.0)
    ends_m = np.where(values[:, 0] >= 0, at_m[0], at_m[-1])
    return np.asarray(np.where(there, at_m[at] + part * (at_m[at + 1] - at_m[at]), ends_m))
