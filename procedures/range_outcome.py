"""The outcome of the range campaign: results, tables, figures, and the definitions they rest on."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.outcome import Outcome, Table
from procedures.arrival_ground import ROUGHNESS_M
from procedures.energy_parts import slope_of
from procedures.range_cells_told import cells_table, estimate_columns, json_or_none, row_of
from procedures.range_histograms import histograms
from procedures.range_parts import HISTOGRAM_ALTITUDES_M
from procedures.range_scenes import MEAN_REFLECTANCE
from procedures.range_statements import statements
from procedures.range_statistics import CHANCE
from procedures.range_table import cells, headline
from procedures.range_truth import TRUTHS
from procedures.range_variant_outcome import (
    bias_part,
    budget_part,
    columns_part,
    corrected_part,
    ladder_part,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from belahil.outcome import Column
    from belahil.values import Estimate
    from procedures.noise_clusters import LevelLaws
    from procedures.paper_statements import Statement
    from procedures.range_points import Collected
    from procedures.range_table import TableCell

    Part = tuple[Any, dict[str, Table], dict[str, Callable[[], Figure]]]
    """Results, tables and figures."""

NOTES = (
    "With another definition in the place of this one the true range would change as `truths` of the table "
    "tells. The cells hold footprints with a slope of 9 to 11 degrees.",
    "The calibrated bias is the mean that the correction leaves without noise at that altitude; the mean "
    "error with noise is told apart.",
    "Arrivals are corrected by the project's own curve: the delay of Gaussian pulses behind the receiver's "
    "filter against the detected width; beyond its widths, 20 to 110 ns, its ends are held.",
    "Ground: the eleven fractals, Hurst exponent 0.8, each tilted by 10 degrees towards a side of its own. "
    f"Their RMS deviations at 65 m, {ROUGHNESS_M[0]:.2g} to {ROUGHNESS_M[-1]:.2g} m, are assumed.",
    "Dark noise: the chain's noise of sunlight at noon over sqrt(1.8^2 - 1), at a reflectance of 0.17 and at "
    "the distance that is named; day has that sunlight, night has none. Nothing was fitted, nothing set for "
    "a cell.",
    "Assumed, for want of a published number: among others the pulse's shape, pointing jitter, excess noise, "
    "the range finder's templates and the reflectance of ice, 0.30.",
    "Not modelled: speckle, photons one by one, recorded dark noise, and a window that does not follow the "
    "altitude.",
)


def outcome(found: Collected) -> Outcome:
    """Make the outcome of all parts that were computed."""
    laws = found.laws()
    definitions = found.definitions.told()
    results: dict[str, Any] = {"definitions": definitions, "chance_detection": CHANCE}
    tables: dict[str, Table] = {}
    figures: dict[str, Callable[[], Figure]] = {}
    made: dict[str, tuple[str, Callable[[Collected, Mapping[str, LevelLaws]], Part]]] = {
        "table": ("table", _headline),
        "altitude": ("altitude", _altitude),
        "corrections": ("altitude", corrected_part),
        "map": ("map", _map),
        "budget": ("budget", budget_part),
        "ladder": ("ladder", ladder_part),
        "bias": ("bias", bias_part),
        "columns": ("columns", columns_part),
    }
    for name, (part, make) in made.items():
        if found.of(part):
            told, more, drawn = make(found, laws)
            results[name] = told
            tables |= more
            figures |= drawn
    stated = statements(results)
    results["statements"] = [one.as_json() for one in stated]
    if stated:
        figures["range-statements"] = lambda: _statements_figure(stated)
    return Outcome(results=results, tables=tables, figures=figures, notes=(*definitions.values(), *NOTES))


def _statements_figure(stated: list[Statement]) -> Figure:
    from procedures.paper_statements_figure import statements_figure

    return statements_figure(stated)


def _headline(found: Collected, laws: Mapping[str, LevelLaws]) -> Part:
    from procedures.range_figures import table_figure

    made = headline(found, laws)
    told = {
        "dark_noise_rms_v": {
            one.cell.condition.distance: one.cell.condition.noise_rms_v
            for one in made.cells
            if one.cell.condition.light == "night"
        },
        "cells": [_table_row(one) for one in made.cells],
        "truths": [
            {"altitude_m": altitude_m, "truth": truth, "mean_m": mean_m, "std_m": std_m}
            for altitude_m, changes in made.truths.items()
            for truth, (mean_m, std_m) in changes.items()
        ],
        "noise_clusters": [
            {
                "noise_rms_v": law.unit_v,
                "a": {"value": law.a, "standard_uncertainty": law.a_u, "unit": "1"},
                "b": {"value": law.b, "standard_uncertainty": law.b_u, "unit": "1"},
                "windows": law.windows,
            }
            for law in made.laws
        ],
    }
    tables = {"cell": _table(made.cells), "truth_altitude": _truths(made.truths)}
    return told, tables, {"range-table": lambda: table_figure(made)}


def _truths(truths: Mapping[float, Mapping[str, tuple[float, float]]]) -> Table:
    columns: dict[str, Column] = {"truth_altitude": (np.array(list(truths)), "m", "altitude")}
    for truth in TRUTHS:
        for place, name in enumerate(("mean", "std")):
            values = np.array([one[truth][place] for one in truths.values()])
            told = f"{name} of the change of the true range with the definition {truth}"
            columns[f"truth_by_{truth}_{name}"] = (values, "m", told)
    return Table(columns, "truth_altitude")


def _altitude(found: Collected, laws: Mapping[str, LevelLaws]) -> Part:
    from procedures.range_figures import histogram_figure
    from procedures.range_study_figures import altitude_figure

    every = [cells(one, laws) for one in found.of("altitude")]
    shapes = [
        one
        for drawn in found.of("altitude")
        if drawn.scene.altitude_m in HISTOGRAM_ALTITUDES_M
        for one in histograms(drawn, laws, MEAN_REFLECTANCE)
    ]
    rows = [one for point in every for one in point]
    told = {
        "cells": [row_of(one) for one in rows],
        "histograms": [
            {
                "altitude_m": one.altitude_m,
                "source": one.source,
                "errors": int(one.errors_m.size),
                "rms_m": one.rms_m,
                "normality_p": one.p_value,
                "skewness": one.skewness,
                "excess_kurtosis": one.excess_kurtosis,
            }
            for one in shapes
        ],
    }
    tables = {"altitude_cell": cells_table(rows, "altitude_cell", "at_altitude_")}
    return (
        told,
        tables,
        {
            "range-histograms": lambda: histogram_figure(shapes),
            "range-altitude": lambda: altitude_figure(rows),
        },
    )


def _map(found: Collected, laws: Mapping[str, LevelLaws]) -> Part:
    from procedures.range_study_figures import map_figure

    slopes, rows = [], []
    by_slope = sorted(found.of("map"), key=lambda drawn: slope_of(drawn.label))
    for drawn in by_slope:
        for one in cells(drawn, laws):
            slopes.append(float(np.mean(drawn.arrays["slope_deg"])))
            rows.append(one)
    table = cells_table(rows, "map_cell", "map_")
    columns = {**table.columns, "map_slope": (np.radians(slopes), "rad", "mean slope of the footprints")}
    told = {"cells": [{"slope_deg": slope, **row_of(one)} for slope, one in zip(slopes, rows, strict=True)]}
    labels = [slope_of(drawn.label) for drawn in by_slope for _ in drawn.conditions]
    return told, {"map_cell": Table(columns, "map_cell")}, {"range-map": lambda: map_figure(labels, rows)}


def _table_row(one: TableCell) -> dict[str, Any]:
    brute = one.brute
    told = None
    if brute is not None:
        mixture = brute.mixture
        told = {
            "shots": brute.shots,
            "pfd": brute.pfd.as_json(),
            "error": json_or_none(brute.spread),
            "mixture_pfd": None if mixture is None else mixture.pfd.as_json(),
            "mixture_error": None if mixture is None else mixture.spread.as_json(),
        }
    return row_of(one.cell) | {"pfd_conditional": one.conditional.as_json(), "brute": told}


def _table(rows: tuple[TableCell, ...]) -> Table:
    plain = cells_table([one.cell for one in rows], "cell", "")
    columns = dict(plain.columns)
    brutes = [one.brute for one in rows]
    more: dict[str, tuple[list[Estimate | None], str, str]] = {
        "pfd_conditional": ([one.conditional for one in rows], "1", "pfd by the very windows of noise"),
        "pfd_brute": ([None if one is None else one.pfd for one in brutes], "1", "pfd by whole shots"),
        "range_error_brute": (
            [None if one is None else one.spread for one in brutes],
            "m",
            "rms error by whole shots",
        ),
    }
    for name, (ones, unit, told) in more.items():
        columns |= estimate_columns(name, ones, unit, told)
    return Table(columns, "cell")
