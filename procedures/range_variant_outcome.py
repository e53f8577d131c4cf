"""The outcome of the variants of the range campaign: budget, ladder, bias and temperature, other ground."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.outcome import Table
from procedures.range_budget import PART, budget
from procedures.range_cells_told import cells_table, row_of
from procedures.range_constants import OTHER_GROUND
from procedures.range_corrections import corrections
from procedures.range_scenes import MEAN_REFLECTANCE
from procedures.range_table import cells
from procedures.range_variants import COLUMNS
from sim.detector import multiplication

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from matplotlib.figure import Figure

    from procedures.noise_clusters import LevelLaws
    from procedures.range_budget import BudgetCell
    from procedures.range_points import Collected
    from procedures.range_table import Cell

    Part = tuple[Any, dict[str, Table], dict[str, Callable[[], Figure]]]


NEXT_ALTITUDES_M = (800e3, 1400e3)
"""Where constants are ranked: where false detections begin, and the highest of the table."""


def corrected_part(found: Collected, laws: Mapping[str, LevelLaws]) -> Part:
    """Tell what each correction of arrivals does, from the points of the part ``altitude``."""
    from procedures.range_variant_figures import correction_figure

    ones = [one for drawn in found.of("altitude") for one in corrections(drawn, laws, MEAN_REFLECTANCE)]
    told = [
        {
            "altitude_m": one.altitude_m,
            "light": one.light,
            "correction": one.name,
            "error": None if one.error is None else one.error.as_json(),
            "bias_m": one.bias_m,
        }
        for one in ones
    ]
    return told, {}, {"range-corrections": lambda: correction_figure(ones)}


def budget_part(found: Collected, laws: Mapping[str, LevelLaws]) -> Part:
    """Tell what hangs on the assumed constants, and the intervals of the predictions."""
    from procedures.range_variant_figures import tornado_figure

    made = budget(found.of(PART), laws)
    told = {"cells": [_budget_row(one) for one in made], "measure_next": _next(made)}
    ends = {
        name: np.array([one.interval(which) for one in made])
        for which, name in enumerate(("range_error", "pfd"))
    }
    table = cells_table([one.cell for one in made], "budget_cell", "budget_")
    columns = dict(table.columns)
    for name, unit in (("range_error", "m"), ("pfd", "1")):
        for k, end in enumerate(("low", "high")):
            columns[f"budget_{name}_{end}"] = (ends[name][:, k], unit, f"{end} end of the interval of {name}")
    return (
        told,
        {"budget_cell": Table(columns, "budget_cell")},
        {"range-tornado": lambda: tornado_figure(made)},
    )


def _budget_row(one: BudgetCell) -> dict[str, Any]:
    constants = []
    for shift, error_share, pfd_share in zip(one.shifts, one.shares(0), one.shares(1), strict=True):
        constants.append(
            {
                "constant": shift.constant.name,
                "unit": shift.constant.unit,
                "low": shift.constant.low,
                "assumed": _finite(shift.constant.assumed),
                "high": _finite(shift.constant.high),
                "why": shift.constant.why,
                "error_relative": [shift.low[0].as_json(), shift.high[0].as_json()],
                "error_share": error_share,
                "pfd_share": pfd_share,
                "pfd_change": [shift.low[1].as_json(), shift.high[1].as_json()],
                "error_derivative": shift.derivative(0).as_json() if _has_width(shift.constant) else None,
                "pfd_derivative": shift.derivative(1).as_json() if _has_width(shift.constant) else None,
            }
        )
    return row_of(one.cell) | {
        "error_interval_m": list(one.interval(0)),
        "pfd_interval": list(one.interval(1)),
        "constants": constants,
    }


def _next(made: tuple[BudgetCell, ...]) -> list[dict[str, Any]]:
    """Constants by their part of the variance at the mean reflectance, those a laboratory should measure."""
    found = []
    for one in made:
        altitude_m, condition = one.cell.altitude_m, one.cell.condition
        if altitude_m not in NEXT_ALTITUDES_M or condition.reflectance != MEAN_REFLECTANCE:
            continue
        for which, number in enumerate(("error", "pfd")):
            shares = zip(one.shares(which), (shift.constant.name for shift in one.shifts), strict=True)
            ranked = sorted(shares, key=lambda pair: -pair[0])
            found.append(
                {
                    "altitude_m": altitude_m,
                    "light": condition.light,
                    "of": number,
                    "ranked": [{"constant": name, "share": share} for share, name in ranked],
                }
            )
    return found


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _has_width(constant: Any) -> bool:
    """A switch, and a seed, have no derivative."""
    return bool(np.isfinite(constant.high)) and constant.name != OTHER_GROUND


def ladder_part(found: Collected, laws: Mapping[str, LevelLaws]) -> Part:
    """Tell the rungs from an earlier model to this one."""
    from procedures.range_variant_figures import ladder_figure

    rows = _labelled(found, laws, "ladder")
    told = [{"rung": label, **row_of(one)} for label, one in rows]
    table = cells_table([one for _, one in rows], "ladder_cell", "ladder_")
    return told, {"ladder_cell": table}, {"range-ladder": lambda: ladder_figure(rows)}


def bias_part(found: Collected, laws: Mapping[str, LevelLaws]) -> Part:
    """Tell error and false detection by bias and temperature of the photodiode."""
    from procedures.range_variant_figures import bias_figure

    rows, told = [], []
    for drawn in found.of("bias"):
        detector = drawn.scene.detector
        for one in cells(drawn, laws):
            rows.append((detector.bias_v, detector.apd_temperature_c, one))
            told.append(
                {
                    "bias_v": detector.bias_v,
                    "apd_temperature_c": detector.apd_temperature_c,
                    "multiplication": multiplication(detector),
                    **row_of(one),
                }
            )
    table = cells_table([one for _, _, one in rows], "bias_cell", "bias_")
    columns = {
        **table.columns,
        "bias_voltage": (np.array([one[0] for one in rows]), "V", "bias of the photodiode"),
        "bias_temperature": (
            np.array([one[1] + 273.15 for one in rows]),
            "K",
            "temperature of the photodiode",
        ),
    }
    return told, {"bias_cell": Table(columns, "bias_cell")}, {"range-bias": lambda: bias_figure(rows)}


def columns_part(found: Collected, laws: Mapping[str, LevelLaws]) -> Part:
    """Tell the table's cells on other ground, and draw them beside the table's own where there are some."""
    from procedures.range_variant_figures import columns_figure

    rows = _labelled(found, laws, "columns")
    told = [{"ground": label, **row_of(one)} for label, one in rows]
    table = cells_table([one for _, one in rows], "column_cell", "column_")
    fractals = [(COLUMNS[0], one) for drawn in found.of("table") for one in cells(drawn, laws)]
    return told, {"column_cell": table}, {"range-columns": lambda: columns_figure([*fractals, *rows])}


def _labelled(found: Collected, laws: Mapping[str, LevelLaws], part: str) -> list[tuple[str, Cell]]:
    return [(drawn.label.partition(", ")[2], one) for drawn in found.of(part) for one in cells(drawn, laws)]
