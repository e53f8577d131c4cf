"""Which assumed numbers a prediction hangs on: each moved over its range, with the same random numbers.

Every constant that no publication gives has a default and a range that seems possible. The campaign is drawn
again with each at both ends of its range, all else the same, from the same places and the same noise. So
differences have little chance in them. The interval of a prediction takes the constants for independent, and
each for as likely anywhere in its range: a half range over sqrt(3), upwards and downwards apart.

The dark noise follows from the text by the noise of the sun. What changes that noise changes the dark noise
with it; the dark noise by itself is a constant of its own, for what the text's "about 80 %" leaves open.

Constants that no formula bounds are two alternatives: the number that is assumed, and one other.

What this does not vary: a range finder in whole numbers or with a threshold, a pulse that is no Gaussian with
a tail, a beam that is no ellipse, noise that is not white before the filter, a gain that falls below 13 mV,
speckle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from msgspec import structs

from belahil.values import Estimate
from procedures.range_chunks import correction
from procedures.range_constants import CONSTANTS, OTHER_GROUND, Constant
from procedures.range_points import Point
from procedures.range_scenes import (
    ALTITUDES_M,
    REFLECTANCES,
    base_scene,
    conditions,
    noise_scene,
    text_dark_rms_v,
)
from procedures.range_statistics import influences
from procedures.range_table import cell_draws, cells
from sim.scene import as_toml

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

    from procedures.campaign_range import RangeOptions
    from procedures.noise_clusters import LevelLaws
    from procedures.range_ground import GroundKey
    from procedures.range_points import Drawn
    from procedures.range_table import Cell
    from sim.scene import Scene

PART, BASE = "budget", "as assumed"
TILTS = {500e3: 0.0, 800e3: 0.5, 1100e3: 1.0, 1400e3: 2.0}
"""Of the noise, by altitude: the same for all that are compared."""
_ENDS = ("low", "high")


def budget_points(options: RangeOptions, seed: int) -> Iterator[Point]:
    """Return the points: as assumed, and each constant at both ends of its range."""
    for altitude_m in ALTITUDES_M:
        yield _point(options, seed, altitude_m, BASE, base_scene(altitude_m))
        for one in CONSTANTS:
            for end in _ENDS:
                value = getattr(one, end)
                if value == one.assumed:
                    continue
                scene = one.scene(base_scene(altitude_m), value)
                if one.dark_follows:
                    dark_v = text_dark_rms_v(scene)
                    scene = structs.replace(scene, noise=structs.replace(scene.noise, dark_rms_v=dark_v))
                ground, shine = one.ground(options.ground, value), one.reflectances(value)
                yield _point(options, seed, altitude_m, f"{one.name}, {end}", scene, ground, shine)


def _point(
    options: RangeOptions,
    seed: int,
    altitude_m: float,
    label: str,
    scene: Scene,
    ground: GroundKey | None = None,
    shine: tuple[float, ...] = REFLECTANCES,
) -> Point:
    return Point(
        part=PART,
        label=f"{altitude_m / 1e3:g} km, {label}",
        scene=scene,
        conditions=conditions(scene, shine),
        echoes=options.study_echoes,
        repeats=options.repeats,
        sets=1,
        seed=seed,
        ground=ground or options.ground,
        tilt=TILTS[altitude_m],
    )


@dataclass(frozen=True, slots=True)
class Shift:
    """What a constant does to one cell.

    Parameters
    ----------
    constant : Constant
        Which.
    low, high : tuple of Estimate
        Change of error (relative, 1) and of the probability of false detection (1) at the low and the high
        end; zeros where that end is the default.
    """

    constant: Constant
    low: tuple[Estimate, Estimate]
    high: tuple[Estimate, Estimate]

    def derivative(self, which: int) -> Estimate:
        """Return the change over the range, by its width in units of the constant; 0: error, 1: PFD."""
        ends = (self.constant.low, self.constant.high)
        low, high = (one[which] for one in (self.low, self.high))
        places = [x for x in (*ends, self.constant.assumed) if math.isfinite(x)]
        width = max(places) - min(places)
        u = math.hypot(low.standard_uncertainty, high.standard_uncertainty)
        return Estimate((high.value - low.value) / width, u / width, "1")


@dataclass(frozen=True, slots=True)
class BudgetCell:
    """The prediction of one cell with its interval.

    Parameters
    ----------
    cell : Cell
        As assumed.
    shifts : tuple of Shift
        By constant.
    """

    cell: Cell
    shifts: tuple[Shift, ...]

    def interval(self, which: int) -> tuple[float, float]:
        """Return error, m, or PFD at two standard uncertainties below and above; 0: error, 1: PFD."""
        up, down = (math.sqrt(sum(side)) for side in zip(*self._variances(which), strict=True))
        if which == 1:
            value = self.cell.pfd.value
            return max(value - 2 * down, 0.0), min(value + 2 * up, 1.0)
        value = self.cell.spread.value if self.cell.spread is not None else 0.0
        return value * math.exp(-2 * down), value * math.exp(2 * up)

    def shares(self, which: int) -> tuple[float, ...]:
        """Return each constant's part of the variance, both sides together; zeros where nothing moves."""
        variances = [up + down for up, down in self._variances(which)]
        total = sum(variances)
        return tuple(one / total if total else 0.0 for one in variances)

    def _variances(self, which: int) -> list[tuple[float, float]]:
        """Of each constant upwards and downwards: a half range over sqrt(3), squared.

        Other grounds have no range. Each differs from the assumed one by the chance of both: half of the mean
        square is the variance of one, on either side.
        """
        found = []
        for one in self.shifts:
            ends = one.low[which].value, one.high[which].value
            if one.constant.name == OTHER_GROUND:
                chance = (ends[0] ** 2 + ends[1] ** 2) / 4
                found.append((chance, chance))
            else:
                found.append((max(*ends, 0.0) ** 2 / 3, min(*ends, 0.0) ** 2 / 3))
        return found


def budget(points: tuple[Drawn, ...], laws: Mapping[str, LevelLaws]) -> tuple[BudgetCell, ...]:
    """Reduce the points of the budget.

    Parameters
    ----------
    points : tuple of Drawn
        From `budget_points`.
    laws : mapping of str to LevelLaws
        From `Collected.laws`.
    """
    by_label = {one.label: one for one in points}
    found = []
    for altitude_m in dict.fromkeys(one.scene.altitude_m for one in points):
        km = f"{altitude_m / 1e3:g} km, "
        base = by_label[km + BASE]
        for row, cell in enumerate(cells(base, laws)):
            shifts = []
            for one in CONSTANTS:
                ends = [by_label.get(f"{km}{one.name}, {end}") for end in _ENDS]
                shifts.append(Shift(one, *(_shift(base, end, row, laws) for end in ends)))
            found.append(BudgetCell(cell, tuple(shifts)))
    return tuple(found)


def _shift(
    base: Drawn, moved: Drawn | None, row: int, laws: Mapping[str, LevelLaws]
) -> tuple[Estimate, Estimate]:
    if moved is None:
        return Estimate(0.0, 0.0, "1"), Estimate(0.0, 0.0, "1")
    one, other = (_numbers(drawn, row, laws) for drawn in (base, moved))
    found = []
    for (value, influence), (changed, influenced) in zip(one, other, strict=True):
        alike = influenced.size == influence.size
        paired = influenced - influence if alike else np.concatenate([influenced, influence])
        found.append(Estimate(changed - value, math.sqrt(float(paired @ paired)), "1"))
    return found[0], found[1]


def _numbers(
    drawn: Drawn, row: int, laws: Mapping[str, LevelLaws]
) -> tuple[tuple[float, NDArray[np.float64]], ...]:
    """Logarithm of the spread and probability of false detection, with the influences of the echoes."""
    law = laws[as_toml(noise_scene(drawn.scene))].at(drawn.conditions[row].noise_rms_v)
    bias_m = float(drawn.linear.still_m.mean())
    return influences(cell_draws(drawn, row, correction(drawn.scene), bias_m), law)
