"""Cells of the range campaign as results and as tables of the data file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from belahil.outcome import Table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from belahil.outcome import Column
    from belahil.values import Estimate
    from procedures.range_scenes import Condition
    from procedures.range_table import Cell


def json_or_none(one: Estimate | None) -> dict[str, float | str] | None:
    """Return a measured number as results hold it, None where there is none."""
    return None if one is None else one.as_json()


def row_of(one: Cell) -> dict[str, Any]:
    """Return a cell as the results show it."""
    linear = one.linear
    return {
        "altitude_m": one.altitude_m,
        "sun": one.condition.distance,
        "light": one.condition.light,
        "reflectance": one.condition.reflectance,
        "noise_rms_v": one.condition.noise_rms_v,
        "pfd": one.pfd.as_json(),
        "error": json_or_none(one.spread),
        "by_source": {
            "shape": json_or_none(one.shape),
            "pointing": json_or_none(one.jitter),
            "noise": json_or_none(one.noise),
        },
        "bias": one.bias.as_json(),
        "mean_error": json_or_none(one.mean_error),
        "linear": {
            "total_m": linear.total_m,
            "shape_m": linear.shape_m,
            "pointing_m": linear.jitter_m,
            "noise_m": linear.noise_m,
            "snr": linear.snr,
            "valid": linear.valid,
        },
    }


def estimate_columns(name: str, ones: list[Estimate | None], unit: str, told: str) -> dict[str, Column]:
    """Return a column of measured numbers and one of their uncertainties, masked where there is none."""
    missing = [one is None for one in ones]
    values, uncertainties = (
        np.ma.masked_array([0.0 if one is None else getattr(one, part) for one in ones], missing)
        for part in ("value", "standard_uncertainty")
    )
    return {name: (values, unit, told), f"{name}_u": (uncertainties, unit, "its standard uncertainty")}


class Placed(Protocol):
    """A cell of any campaign."""

    @property
    def altitude_m(self) -> float:
        """Altitude, m."""
        ...

    @property
    def condition(self) -> Condition:
        """Reflectance and noise."""
        ...


def circumstances(cells: Sequence[Placed], dimension: str, prefix: str) -> dict[str, Column]:
    """Return the columns that say which cells they are."""
    return {
        dimension: (np.arange(len(cells)), "1", "number of the cell"),
        f"{prefix}altitude": (np.array([one.altitude_m for one in cells]), "m", "altitude"),
        f"{prefix}reflectance": (
            np.array([one.condition.reflectance for one in cells]),
            "1",
            "normal albedo at 1064 nm",
        ),
        f"{prefix}day": (
            np.array([int(one.condition.light == "day") for one in cells]),
            "1",
            "1 at noon, 0 at night",
        ),
        f"{prefix}perihelion": (
            np.array([int(one.condition.distance == "perihelion") for one in cells]),
            "1",
            "1 with the Sun at perihelion, 0 at mean distance",
        ),
        f"{prefix}noise_rms": (
            np.array([one.condition.noise_rms_v for one in cells]),
            "V",
            "stationary noise at the converter",
        ),
    }


def cells_table(cells: Sequence[Cell], dimension: str, prefix: str) -> Table:
    """Return cells as a table of the data file, each name with a prefix."""
    columns = circumstances(cells, dimension, prefix)
    columns |= {
        f"{prefix}range_error_linear": (
            np.array([one.linear.total_m for one in cells]),
            "m",
            "rms error by linear propagation",
        ),
    }
    estimates: dict[str, tuple[list[Estimate | None], str, str]] = {
        "pfd": ([one.pfd for one in cells], "1", "probability of false detection"),
        "range_error": ([one.spread for one in cells], "m", "rms error of detections, bias taken off"),
        "range_error_shape": ([one.shape for one in cells], "m", "part of the shape of pulse and ground"),
        "range_error_pointing": ([one.jitter for one in cells], "m", "part of the wandering beam"),
        "range_error_noise": ([one.noise for one in cells], "m", "part of all noise"),
        "range_bias": ([one.bias for one in cells], "m", "calibrated bias"),
    }
    for name, (ones, unit, told) in estimates.items():
        columns |= estimate_columns(f"{prefix}{name}", ones, unit, told)
    return Table(columns, dimension)
