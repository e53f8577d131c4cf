"""What the study's text says of the energy of return pulses, beside the cells of an energy campaign.

Slopes of 10 degrees and the Sun at its mean distance. The text's error is one number; here it is the rms, and
the spread about the mean stands beside it, since the text does not say whether the mean error is in it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from belahil.values import Estimate
from procedures.energy_curves import MOST_PFD, Case, at_altitude, cases, until_rare
from procedures.energy_parts import MAIN_DEG
from procedures.paper_statements import Statement
from procedures.range_scenes import MEAN_REFLECTANCE, REFLECTANCES

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from procedures.energy_cells import EnergyCell

    Ratio = tuple[Estimate, EnergyCell]

ERROR, ALTITUDE_M = 0.30, 900e3
"""The text's: an error below so much at altitudes below."""
_ROUNDED = 0.005
"""Half a percent."""
_SEEN_PFD, _LIMITED = 0.5, 1.5
"""Assumed: slopes that matter little change the error by less than so many times where half are detected."""


def statements(cells: Sequence[EnergyCell]) -> list[dict[str, Any]]:
    """Return the statements that the cells decide, as `procedures.paper_statements` tells them."""
    rows = [
        *_at_altitude(cells, "E6", "day", (MEAN_REFLECTANCE,)),
        *_at_altitude(cells, "E7", "night", REFLECTANCES),
        *_better(cells),
        *_slopes(cells),
    ]
    return [one.as_json() for one in rows]


def _at_altitude(
    cells: Sequence[EnergyCell], key: str, light: str, reflectances: tuple[float, ...]
) -> Iterator[Statement]:
    curves = cases(cells)
    for reflectance in reflectances:
        row = curves.get(Case("mean", light, reflectance, MAIN_DEG), [])
        for name, curve in (
            ("error", until_rare(row, lambda one: one.error())),
            ("spread", until_rare(row, lambda one: one.spread())),
        ):
            here = at_altitude(curve, ALTITUDE_M)
            if here is not None:
                told = f"{name} of the energy at 900 km by {light}, reflectance {reflectance:g}"
                yield Statement(key, told, "at most", ERROR, _ROUNDED, here)


def _better(cells: Sequence[EnergyCell]) -> Iterator[Statement]:
    ratios = [
        one.window_by_gaussian
        for one in cells
        if one.window_by_gaussian is not None and one.pfd.value <= MOST_PFD
    ]
    if ratios:
        least = min(ratios, key=lambda one: one.value)
        told = f"least error of E_CW over that of E_G, of {len(ratios)} cells"
        yield Statement("E8", told, "at least", 1.0, 0.0, least)


def _slopes(cells: Sequence[EnergyCell]) -> Iterator[Statement]:
    by_slope: dict[float, list[Ratio]] = {}
    for one, cell in slope_ratios(cells):
        if cell.slope_deg > MAIN_DEG:
            by_slope.setdefault(cell.slope_deg, []).append((one, cell))
    for slope_deg, pairs in sorted(by_slope.items()):
        largest, cell = max(pairs, key=lambda pair: pair[0].value)
        told = (
            f"largest error at {slope_deg:g} over that at {MAIN_DEG:g} degrees, "
            f"{cell.altitude_m / 1e3:g} km by {cell.condition.light}"
        )
        yield Statement("E9", told, "at most", _LIMITED, 0.0, largest)


def slope_ratios(cells: Sequence[EnergyCell]) -> list[Ratio]:
    """Return errors of E_G over those at 10 degrees, reflectance 0.17, where half are detected at both."""
    here = [
        one
        for one in cells
        if (one.condition.distance, one.condition.reflectance) == ("mean", MEAN_REFLECTANCE)
        and one.pfd.value <= _SEEN_PFD
    ]
    main = {(one.condition.light, one.altitude_m): one for one in here if one.slope_deg == MAIN_DEG}
    found = []
    for one in here:
        other = main.get((one.condition.light, one.altitude_m))
        if one.slope_deg == MAIN_DEG or other is None:
            continue
        error, reference = one.error(), other.error()
        if error is None or reference is None:
            continue
        value = error.value / reference.value
        parts = [part.standard_uncertainty / part.value for part in (error, reference)]
        found.append((Estimate(value, value * math.hypot(*parts)), one))
    return found
