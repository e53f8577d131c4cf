"""The outcome of the energy campaign: results, table, figures, and the definitions they rest on."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.outcome import Outcome, Table
from procedures.echo_energy import INTEGRALS
from procedures.energy_cells import CONVERSIONS, LEVELS, EnergyCell, energy_cells
from procedures.energy_curves import cases, crossing, until_rare
from procedures.energy_parts import MAIN_DEG, slope_of
from procedures.energy_statements import ERROR, slope_ratios, statements
from procedures.range_cells_told import circumstances, estimate_columns, json_or_none

if TYPE_CHECKING:
    from belahil.values import Estimate
    from procedures.echo_energy import Conversion
    from procedures.energy_cells import EnergyError
    from procedures.energy_fit import EnergyFit
    from procedures.range_points import Collected

NOTES = (
    "Energy of a pulse: from amplitude and width of the range finder's Gaussian (E_G), or the trapezoids "
    "over its 42 samples (E_CW), by a line and the curve about it. Both were fitted to echoes without noise "
    "of other places of the same ground, slopes of 0 to 40 degrees, from 400 to 1400 km, 20 to 110 ns wide; "
    "beyond those the line goes on and the curve stays as it is at its end.",
    "Error: rms over detected pulses, relative to the energy of the light of that very pulse at the "
    "photodiode, after the bias was taken off that the calibration leaves there without noise. What noise "
    "adds to the mean is in it and told apart (mean_error): of faint echoes those are detected that noise "
    "makes larger. Spread: standard deviation about that mean.",
    "False detection: the candidate nearest to the truth is more than 10 m off. Such pulses are left out; "
    "every draw about an echo counts with its probability to be kept, by the law of noise peaks.",
    "Published line: the paper's two lines as printed, without the curve about them, which is a figure "
    "there. The transimpedance of the detector model was derived from these lines, so their scale is no "
    "comparison.",
    "Ground, dark noise, sunlight and what is assumed: as in the range campaign. Slopes are those of planes "
    "under the footprints, within one degree.",
    "Curves end where the probability of false detection reaches 90 %.",
)


def outcome(found: Collected, convert: Conversion) -> Outcome:
    """Make the outcome of the campaign."""
    from procedures.campaign_energy_figures import error_figure, integral_figure

    laws = found.laws()
    by_slope = sorted(found.points, key=lambda drawn: _order(slope_of(drawn.label)))
    cells = [cell for drawn in by_slope for cell in energy_cells(drawn, laws, convert)]
    results = {
        "calibration": {name: _fit_told(fit) for name, fit in convert.fits.items()},
        "cells": [row_of(one) for one in cells],
        "reach": _reach(cells),
        "slopes": [
            {
                "slope_deg": one.slope_deg,
                "altitude_m": one.altitude_m,
                "light": one.condition.light,
                "by_10_deg": by_main.as_json(),
            }
            for by_main, one in slope_ratios(cells)
        ],
        "statements": statements(cells),
    }
    return Outcome(
        results=results,
        tables={"cell": _table(cells)},
        figures={
            "energy-error": lambda: error_figure(cells),
            "energy-integrals": lambda: integral_figure(cells),
        },
        notes=NOTES,
    )


def _order(slope_deg: float) -> tuple[bool, float]:
    """Slopes of 10 degrees first, which have most draws."""
    return slope_deg != MAIN_DEG, slope_deg


def _fit_told(fit: EnergyFit) -> dict[str, Any]:
    return {
        "slope": fit.slope.as_json(),
        "intercept": fit.intercept.as_json(),
        "largest_deviation": fit.largest_deviation.as_json(),
        "left_rms": fit.left_rms,
    }


def row_of(one: EnergyCell) -> dict[str, Any]:
    """Return a cell as the results show it."""
    errors: dict[str, dict[str, Any]] = {integral: {} for integral in INTEGRALS}
    for (integral, by), told in one.errors.items():
        errors[integral][by] = _error_told(told)
    return {
        "altitude_m": one.altitude_m,
        "slope_deg": one.slope_deg,
        "sun": one.condition.distance,
        "light": one.condition.light,
        "reflectance": one.condition.reflectance,
        "noise_rms_v": one.condition.noise_rms_v,
        "pfd": one.pfd.as_json(),
        "errors": errors,
        "window_by_gaussian": json_or_none(one.window_by_gaussian),
    }


def _error_told(one: EnergyError) -> dict[str, Any]:
    return {
        "error": one.error.rms.as_json(),
        "mean_error": one.error.mean.as_json(),
        "spread": one.error.spread.as_json(),
        "bias": one.bias.as_json(),
        "shape": one.shape,
        "quantiles": {
            f"{100 * level:g} %": float(value) for level, value in zip(LEVELS, one.levels, strict=True)
        },
    }


def _reach(cells: list[EnergyCell]) -> list[dict[str, Any]]:
    """Altitudes at which errors reach 30 %, by curve and integral."""
    found = []
    for case, curve in cases(cells).items():
        for integral in INTEGRALS:
            told = {
                name: crossing(until_rare(curve, read), ERROR).as_json()
                for name, read in (
                    ("error", lambda one, key=integral: one.error(key)),
                    ("spread", lambda one, key=integral: one.spread(key)),
                )
            }
            found.append(
                {
                    "sun": case.distance,
                    "light": case.light,
                    "reflectance": case.reflectance,
                    "slope_deg": case.slope_deg,
                    "integral": integral,
                    "level": ERROR,
                    **told,
                }
            )
    return found


def _table(cells: list[EnergyCell]) -> Table:
    columns = circumstances(cells, "cell", "")
    columns["slope"] = (np.radians([one.slope_deg for one in cells]), "rad", "slope of the footprints")
    numbers: dict[str, tuple[list[Estimate | None], str]] = {
        "pfd": ([one.pfd for one in cells], "probability of false detection"),
        "window_by_gaussian": (
            [one.window_by_gaussian for one in cells],
            "error by the samples over that by the Gaussian",
        ),
    }
    for integral in INTEGRALS:
        for by in CONVERSIONS:
            errors = [one.errors.get((integral, by)) for one in cells]
            name, told = f"{integral}_{by}", f"{integral} integral, {by} conversion: "
            numbers |= {
                f"energy_error_{name}": (_each(errors, "rms"), told + "rms relative error, bias taken off"),
                f"energy_mean_error_{name}": (_each(errors, "mean"), told + "mean error beside the bias"),
                f"energy_spread_{name}": (_each(errors, "spread"), told + "spread about the mean"),
                f"energy_bias_{name}": (
                    [None if one is None else one.bias for one in errors],
                    told + "bias without noise",
                ),
            }
    for name, (ones, told) in numbers.items():
        columns |= estimate_columns(name, ones, "1", told)
    return Table(columns, "cell")


def _each(errors: list[EnergyError | None], part: str) -> list[Estimate | None]:
    return [None if one is None else getattr(one.error, part) for one in errors]
