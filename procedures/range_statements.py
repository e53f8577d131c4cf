"""What the study's text says of ranges, beside the results of a range campaign.

It takes the results as `summary.json` holds them, so that a finished run can be asked again. The study's
slope is 10 degrees and its reflectance 0.17 unless it says otherwise.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from belahil.values import Estimate
from procedures.paper_statements import Statement
from procedures.range_scenes import LIGHTS, MEAN_REFLECTANCE, REFLECTANCES

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    Row = Mapping[str, Any]

_COMPARABLE = 0.1
"""Least share of the variance of a part that is comparable to the others: assumed, the text does not say."""
_NORMAL = 1.0
"""Largest excess kurtosis of errors that are about normal: assumed as well."""
_POSSIBLE = 0.5
"""Largest PFD at which measurements are possible: assumed as well."""
_SEEN = {"day": 0.08, "night": 0.24}
_HIGHEST = {"day": (3.0, 0.92), "night": (2.0, 0.76)}
"""Error, m, and PFD at 1400 km."""
_NOTHING = 1e-12
_DARK, _, _ICE = REFLECTANCES
_ROUNDED = 0.005
"""Half a percent."""
_NEAR_DEG = 1.5
_SOURCES = ("shape", "pointing", "noise")


def statements(results: Mapping[str, Any]) -> list[Statement]:
    """Return the statements that the computed parts decide.

    Parameters
    ----------
    results : mapping
        Of the campaign: "altitude", "map", "table" and "budget", as many as there are.

    Returns
    -------
    list of Statement
        By key. A statement about an altitude or a slope that
        is not there, or where nothing was detected, is left out.
    """
    altitude = results.get("altitude", {"cells": (), "histograms": ()})
    # Where both have a cell that of the table counts, which has more draws: two numbers of one quantity.
    every = (*altitude["cells"], *results.get("table", {"cells": ()})["cells"])
    budget = results.get("budget", {"cells": ()})["cells"]
    found = [*_shapes(altitude["histograms"]), *_in_shadow(every)]
    for light in LIGHTS:
        found += _by_source(_by_km(altitude["cells"], light), light)
        found += _along(_by_km(every, light), light)
        found += _at_highest(_by_km(every, light), _by_km(budget, light), light)
    found += _on_slopes(results.get("map", {"cells": ()})["cells"])
    return sorted(found, key=lambda one: int(one.key[1:]))


def _by_km(cells: Iterable[Row], light: str, reflectance: float = MEAN_REFLECTANCE) -> dict[int, Row]:
    """Return the cells with detections and the Sun at its mean distance, by altitude in km; the last."""
    wanted = (light, reflectance, "mean")
    return {
        round(one["altitude_m"] / 1e3): one
        for one in cells
        if (one["light"], one["reflectance"], one["sun"]) == wanted and one["error"] is not None
    }


def _by_source(cells: dict[int, Row], light: str) -> Iterator[Statement]:
    """What is said of the parts of the error, by day or by night: all altitudes with as many draws."""
    if 500 in cells:
        share = _least_share(cells[500])
        told = f"least share of variance at 500 km by {light}"
        yield Statement("R1", told, "at least", _COMPARABLE, 0.0, share)
    if {400, 1500} <= set(cells):
        growths = [_quotient(_part(cells[1500], one), _part(cells[400], one)) for one in _SOURCES]
        least = min(growths, key=lambda one: one.value)
        told = f"growth of each part from 400 to 1500 km by {light}"
        yield Statement("R2", told, "at least", 1.0, 0.0, least)
    for key, km in (("R3", 800), ("R4", 1000), ("R4", 1500)):
        if km in cells:
            told = f"noise over the other parts at {km} km by {light}"
            yield Statement(key, told, "at least", 1.0, 0.0, _dominance(cells[km]))


def _along(cells: dict[int, Row], light: str) -> Iterator[Statement]:
    """What is said of errors and detections at single altitudes, by day or by night."""
    if 1500 in cells:
        pfd = _pfd(cells[1500])
        seen = Estimate(1.0 - pfd.value, pfd.standard_uncertainty, "1")
        told = f"detected at 1500 km by {light}"
        yield Statement("R10", told, "at least", _SEEN[light], _ROUNDED, seen)
    if 800 in cells:
        yield Statement("R11", f"PFD at 800 km by {light}", "at most", 0.05, _ROUNDED, _pfd(cells[800]))
    if 1000 in cells:
        error = _estimate(cells[1000]["error"])
        yield Statement("R15", f"error at 1000 km by {light}", "at most", 1.5, 0.05, error)


def _shapes(histograms: Iterable[Row]) -> Iterator[Statement]:
    for one in histograms:
        if one["source"].startswith("all "):
            light = one["source"].removeprefix("all ")
            # The standard error is that of a normal sample.
            size = Estimate(abs(one["excess_kurtosis"]), math.sqrt(24.0 / one["errors"]), "1")
            told = f"size of excess kurtosis at {one['altitude_m'] / 1e3:g} km {light}"
            yield Statement("R5", told, "at most", _NORMAL, 0.0, size)


def _in_shadow(cells: Sequence[Row]) -> Iterator[Statement]:
    for name, reflectance in (("dark", _DARK), ("ice", _ICE)):
        found = _by_km(cells, "night", reflectance)
        if 800 in found:
            told = f"PFD at 800 km by night, {name}"
            yield Statement("R13", told, "at most", 0.05, _ROUNDED, _pfd(found[800]))


def _at_highest(cells: dict[int, Row], budget: dict[int, Row], light: str) -> Iterator[Statement]:
    """At 1400 km, with what the assumed constants leave open."""
    if 1400 not in cells:
        return
    number = LIGHTS.index(light)
    error_m, pfd = _HIGHEST[light]
    error_ends, pfd_ends = (
        tuple(budget[1400][key]) if 1400 in budget else None for key in ("error_interval_m", "pfd_interval")
    )
    told, cell = f"at 1400 km by {light}", cells[1400]
    yield Statement(
        f"R{6 + number}", f"error {told}", "about", error_m, 0.5, _estimate(cell["error"]), error_ends
    )
    yield Statement(f"R{8 + number}", f"PFD {told}", "about", pfd, _ROUNDED, _pfd(cell), pfd_ends)


def _on_slopes(cells: Sequence[Row]) -> Iterator[Statement]:
    steep = [one for one in cells if abs(one["slope_deg"] - 30.0) < _NEAR_DEG]
    for light in LIGHTS:
        found = _by_km(steep, light)
        if 1100 in found:
            told = f"PFD at 1100 km and 30 degrees by {light}"
            yield Statement("R12", told, "at most", 0.9, _ROUNDED, _pfd(found[1100]))
    level = _by_km((one for one in cells if one["slope_deg"] < _NEAR_DEG), "night", _DARK)
    if 1000 in level:
        told = "PFD at 1000 km by night, dark and level"
        yield Statement("R14", told, "at most", _POSSIBLE, _ROUNDED, _pfd(level[1000]))


def _estimate(measured: Mapping[str, Any]) -> Estimate:
    return Estimate(measured["value"], measured["standard_uncertainty"], measured["unit"])


def _pfd(cell: Row) -> Estimate:
    found = _estimate(cell["pfd"])
    # What sums leave of 1 - 1 is no probability.
    return found if found.value > _NOTHING else Estimate(0.0, 0.0, "1")


def _part(cell: Row, source: str) -> Estimate:
    return _estimate(cell["by_source"][source])


def _quotient(above: Estimate, below: Estimate) -> Estimate:
    value = above.value / below.value
    relative = math.hypot(above.standard_uncertainty / above.value, below.standard_uncertainty / below.value)
    return Estimate(value, value * relative, "1")


def _least_share(cell: Row) -> Estimate:
    parts = [_part(cell, one) for one in _SOURCES]
    total = sum(one.value**2 for one in parts)
    least = min(parts, key=lambda one: one.value)
    share = least.value**2 / total
    # That of the part itself counts most: the others are in the total only.
    relative = 2.0 * least.standard_uncertainty / least.value
    return Estimate(share, share * relative, "1")


def _dominance(cell: Row) -> Estimate:
    shape, pointing = _part(cell, "shape"), _part(cell, "pointing")
    others = math.hypot(shape.value, pointing.value)
    spread = math.hypot(
        shape.value * shape.standard_uncertainty, pointing.value * pointing.standard_uncertainty
    )
    return _quotient(_part(cell, "noise"), Estimate(others, spread / others, "m"))
