"""Which assumed numbers a prediction hangs on: each moved over its range, with the same random numbers.

Every constant that no publication gives has a default and a range that seems possible. The campaign is drawn
again with each at both ends of its range, all else the same, from the same places and the same noise. So
differences have little chance in them. The interval of a prediction takes the constants for independent, and
each for as likely anywhere in its range: a half range over sqrt(3), upwards and downwards apart.

The dark noise follows from the text by the noise of the sun. What changes that noise changes the dark noise
with it; the dark noise by itself is a constant of its own, for what the text's "about 80 %" leaves open.

What this does not vary: the range finder's templates and arithmetic, the form of pulse and beam, speckle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from msgspec import structs

from belahil.values import Estimate
from procedures.range_chunks import correction
from procedures.range_ground import GroundKey
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
    from collections.abc import Callable, Iterator, Mapping

    from numpy.typing import NDArray

    from procedures.campaign_range import RangeOptions
    from procedures.noise_clusters import LevelLaws
    from procedures.range_points import Drawn
    from procedures.range_table import Cell
    from sim.scene import Scene

PART, BASE = "budget", "as assumed"
TILTS = {500e3: 0.0, 800e3: 0.5, 1100e3: 1.0, 1400e3: 2.0}
"""Of the noise, by altitude: the same for all that are compared."""
_ENDS = ("low", "high")


@dataclass(frozen=True, slots=True)
class Constant:
    """A number that is assumed.

    Parameters
    ----------
    name, unit : str
        For people.
    low, assumed, high : float
        Ends of its range, and the default.
    scene : callable
        Puts a value into a scene.
    ground : callable
        Puts it into the ground.
    reflectances : callable
        Puts it into the reflectances of dark ground, regolith and ice.
    dark_follows : bool
        Whether the dark noise is derived again with it.
    """

    name: str
    unit: str
    low: float
    assumed: float
    high: float
    scene: Callable[[Scene, float], Scene] = lambda scene, value: scene
    ground: Callable[[GroundKey, float], GroundKey] = lambda ground, value: ground
    reflectances: Callable[[float], tuple[float, ...]] = lambda value: REFLECTANCES
    dark_follows: bool = True


def _detector(**keys: float) -> Callable[[Scene, float], Scene]:
    (key,), scale = keys, next(iter(keys.values()))
    return lambda scene, value: structs.replace(
        scene, detector=structs.replace(scene.detector, **{key: scale * value})
    )


def _laser(**keys: float) -> Callable[[Scene, float], Scene]:
    (key,), scale = keys, next(iter(keys.values()))
    return lambda scene, value: structs.replace(
        scene, laser=structs.replace(scene.laser, **{key: scale * value})
    )


def _jitter(scene: Scene, value: float) -> Scene:
    return structs.replace(scene, laser=structs.replace(scene.laser, jitter_rad=(1e-6 * value, 1e-6 * value)))


def _dark(scene: Scene, value: float) -> Scene:
    return structs.replace(scene, noise=structs.replace(scene.noise, dark_rms_v=1e-3 * value))


def _full_scale(scene: Scene, value: float) -> Scene:
    return structs.replace(scene, electronics=structs.replace(scene.electronics, adc_full_scale_v=value))


def _other(ground: GroundKey, value: float) -> GroundKey:
    return replace(ground, seed=ground.seed + int(50 * value))


OTHER_GROUND = "other fractals"
"""No number, but what the chance of the ground makes of a prediction."""

CONSTANTS = (
    Constant("effective R_f", "kohm", 40.0, 45.0, 50.0, _detector(feedback_ohm=1e3)),
    Constant("excess noise exponent", "", 0.2, 0.3, 0.5, _detector(excess_noise_exponent=1.0)),
    Constant("dark noise by itself", "mV", 0.7, 0.825, 1.2, _dark, dark_follows=False),
    Constant("extra pole of the amplifier", "MHz", 20.0, math.inf, math.inf, _detector(tia_pole_hz=1e6)),
    Constant("span of the converter", "V", 1.04, 2.0, 4.0, _full_scale),
    Constant("pointing jitter", "urad", 0.5, 1.0, 2.0, _jitter),
    Constant("divergence", "urad", 42.0, 50.0, 60.0, _laser(divergence_rad=1e-6)),
    Constant("pulse width", "ns", 3.0, 5.4, 8.0, _laser(fwhm_s=1e-9)),
    Constant("pulse tail", "ns", 0.0, 3.0, 10.0, _laser(tail_s=1e-9)),
    Constant("reflectance of ice", "", 0.25, 0.30, 0.40, reflectances=lambda x: (*REFLECTANCES[:2], x)),
    Constant("relief of the fractals", "x", 0.5, 1.0, 2.0, ground=lambda one, x: replace(one, factor=x)),
    Constant(OTHER_GROUND, "", 1.0, 0.0, 2.0, ground=_other),
)


def budget_points(options: RangeOptions, seed: int) -> Iterator[Point]:
    """Return the points: as assumed, and each constant at both ends of its range."""
    for altitude_m in ALTITUDES_M:
        yield _point(options, seed, altitude_m, BASE, base_scene(altitude_m))
        for one in CONSTANTS:
            for end in _ENDS:
                value = getattr(one, end)
                if math.isinf(value):
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
        ends = [(one.low[which].value, one.high[which].value) for one in self.shifts]
        up = math.sqrt(sum(max(*pair, 0.0) ** 2 for pair in ends) / 3)
        down = math.sqrt(sum(min(*pair, 0.0) ** 2 for pair in ends) / 3)
        if which == 1:
            value = self.cell.pfd.value
            return max(value - 2 * down, 0.0), min(value + 2 * up, 1.0)
        value = self.cell.spread.value if self.cell.spread is not None else 0.0
        return value * math.exp(-2 * down), value * math.exp(2 * up)


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
