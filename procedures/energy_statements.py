"""What the paper's text says of the error of energies, beside the numbers of the campaign."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from belahil.values import Estimate
from procedures.energy_curves import MOST_PFD, Case, at_altitude, cases, crossing, until_rare
from procedures.energy_parts import MAIN_DEG
from procedures.range_scenes import MEAN_REFLECTANCE, REFLECTANCES

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from procedures.energy_cells import EnergyCell

    Curves = Mapping[Case, list[EnergyCell]]

ERROR, ALTITUDE_M = 0.30, 900e3
"""The paper's: an error below so much at altitudes below."""
_SURE = 2.0
"""Standard uncertainties from which on a statement is called right or wrong."""
_SEEN_PFD = 0.5
_LIMITED = 1.5
"""Assumed: "limited" and "not drastically" are changes by less than so many times."""


def statements(cells: Sequence[EnergyCell]) -> list[dict[str, Any]]:
    """Return each statement with our numbers and whether it holds: yes, no, or undecided."""
    curves = cases(cells)
    return [
        _error_below(curves, "day", (MEAN_REFLECTANCE,)),
        _error_below(curves, "night", REFLECTANCES),
        _better(cells),
        _slopes(cells),
    ]


def judged(one: Estimate, most: float) -> str:
    """Return whether a number is below a limit: "yes", "no" or "undecided"."""
    away = (most - one.value) / max(one.standard_uncertainty, 1e-12)
    return "yes" if away > _SURE else "no" if away < -_SURE else "undecided"


def worst(ones: Sequence[str]) -> str:
    """Return what a statement about all of them is."""
    return next((word for word in ("no", "undecided") if word in ones), "yes" if ones else "not_known")


def _error_below(curves: Curves, light: str, reflectances: tuple[float, ...]) -> dict[str, Any]:
    rows = []
    for case, cells in curves.items():
        if (case.light, case.slope_deg) != (light, MAIN_DEG) or case.reflectance not in reflectances:
            continue
        row: dict[str, Any] = {"sun": case.distance, "reflectance": case.reflectance}
        for name, read in (("error", lambda one: one.error()), ("spread", lambda one: one.spread())):
            curve = until_rare(cells, read)
            here = at_altitude(curve, ALTITUDE_M)
            row[name] = None if here is None else here.as_json()
            row[f"{name}_reaches"] = crossing(curve, ERROR).as_json()
            row[f"{name}_holds"] = "not_known" if here is None else judged(here, ERROR)
        rows.append(row)
    which = "all reflectances" if len(reflectances) > 1 else f"a reflectance of {MEAN_REFLECTANCE}"
    mean = [row for row in rows if row["sun"] == "mean"]
    return {
        "statement": f"error below 30 % at altitudes below 900 km, {which}, by {light}, E_G, 10 degrees",
        "holds": worst([row["error_holds"] for row in mean]),
        "holds_for_spread": worst([row["spread_holds"] for row in mean]),
        "cases": rows,
    }


def _better(cells: Sequence[EnergyCell]) -> dict[str, Any]:
    ratios = [
        (one.window_by_gaussian, one)
        for one in cells
        if one.window_by_gaussian is not None and one.pfd.value <= MOST_PFD
    ]
    least, most = (pick(ratios, key=lambda pair: pair[0].value, default=None) for pick in (min, max))
    better, worse = (
        sum(sign * (one.value - 1) > _SURE * one.standard_uncertainty for one, _ in ratios)
        for sign in (1, -1)
    )
    return {
        "statement": "E_G gives smaller errors than E_CW",
        "criterion": "assumed: smaller in at least half of the cells and larger in none, beyond two standard "
        "uncertainties",
        "holds": "not_known" if not ratios else "yes" if 2 * better >= len(ratios) and not worse else "no",
        "cells": len(ratios),
        "better_in": better,
        "worse_in": worse,
        "least": None if least is None else _placed(*least),
        "largest": None if most is None else _placed(*most),
    }


def _slopes(cells: Sequence[EnergyCell]) -> dict[str, Any]:
    """Errors at other slopes over those at 10 degrees, reflectance 0.17, while most are detected."""
    main: dict[tuple[str, float], EnergyCell] = {}
    for one in cells:
        condition = one.condition
        place = (condition.distance, condition.reflectance, one.slope_deg)
        if place == ("mean", MEAN_REFLECTANCE, MAIN_DEG):
            main[condition.light, one.altitude_m] = one
    rows = []
    for one in cells:
        condition = one.condition
        other = main.get((condition.light, one.altitude_m))
        if one.slope_deg == MAIN_DEG or condition.reflectance != MEAN_REFLECTANCE or other is None:
            continue
        here, there = one.error(), other.error()
        if here is None or there is None or max(one.pfd.value, other.pfd.value) > _SEEN_PFD:
            continue
        value = here.value / there.value
        relative = math.hypot(
            here.standard_uncertainty / here.value, there.standard_uncertainty / there.value
        )
        rows.append((Estimate(value, value * relative), one))
    by_slope: dict[float, list[tuple[Estimate, EnergyCell]]] = {}
    for pair in rows:
        by_slope.setdefault(pair[1].slope_deg, []).append(pair)
    steeper = [one for one, cell in rows if cell.slope_deg > MAIN_DEG]
    return {
        "statement": "slopes matter little: 10 degrees stand for steeper ones, E_G, reflectance 0.17",
        "criterion": f"assumed: errors up to {_LIMITED:g} times as large where at least half are detected",
        "holds": worst([judged(one, _LIMITED) for one in steeper]),
        "by_slope": [
            {
                "slope_deg": slope_deg,
                "cells": len(pairs),
                "least": _placed(*min(pairs, key=lambda pair: pair[0].value)),
                "largest": _placed(*max(pairs, key=lambda pair: pair[0].value)),
            }
            for slope_deg, pairs in sorted(by_slope.items())
        ],
    }


def _placed(one: Estimate, cell: EnergyCell) -> dict[str, Any]:
    return {
        "ratio": one.as_json(),
        "altitude_m": cell.altitude_m,
        "slope_deg": cell.slope_deg,
        "sun": cell.condition.distance,
        "light": cell.condition.light,
        "reflectance": cell.condition.reflectance,
        "pfd": cell.pfd.as_json(),
    }
