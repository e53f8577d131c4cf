"""The outcome of the range campaign: results, tables, figures, and the definitions they rest on."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.outcome import Outcome, Table
from procedures.arrival_ground import ROUGHNESS_M
from procedures.range_statistics import CHANCE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from belahil.values import Estimate
    from procedures.range_table import Cell, Headline

NOTES = (
    "True range: c/2 times the beam-weighted mean of the two-way time 2 (H - z) / c at nominal pointing. "
    "With the post in the middle, or the plane there, in the place of the mean it would change as "
    "`definitions` tells.",
    "Slope and roughness: tilt of, and standard deviation about, the least-squares plane over the 1/e^2 "
    "disc, every post alike. The cells hold footprints with a slope of 9 to 11 degrees.",
    "False detection: the candidate nearest to the truth is more than 10 m off, after the correction of "
    "arrivals.",
    "Error: rms over detections after the calibrated bias was taken off. The bias, the mean that the "
    "correction leaves without noise at that altitude, is told apart, and so is the mean error with noise.",
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


def outcome(headline: Headline) -> Outcome:
    """Make the outcome of the headline table."""
    return Outcome(
        results={
            "dark_noise_rms_v": {
                distance: _night_v(headline, distance)
                for distance in dict.fromkeys(one.condition.distance for one in headline.cells)
            },
            "chance_detection": CHANCE,
            "table": [_row(one) for one in headline.cells],
            "definitions": [
                {
                    "altitude_m": altitude_m,
                    "by_centre_m": {"mean": of_centre[0], "std": of_centre[1]},
                    "by_plane_m": {
                        "mean": headline.by_plane[altitude_m][0],
                        "std": headline.by_plane[altitude_m][1],
                    },
                }
                for altitude_m, of_centre in headline.by_centre.items()
            ],
            "noise_clusters": [
                {
                    "noise_rms_v": level_v,
                    "a": {"value": law.a, "standard_uncertainty": law.a_u, "unit": "1"},
                    "b": {"value": law.b, "standard_uncertainty": law.b_u, "unit": "1"},
                    "windows": law.windows,
                }
                for level_v, law in headline.laws.items()
            ],
        },
        tables={"cell": _table(headline.cells)},
        figures={"range-table": lambda: _figure(headline)},
        notes=NOTES,
    )


def _night_v(headline: Headline, distance: str) -> float | None:
    found = [
        one.condition.noise_rms_v
        for one in headline.cells
        if (one.condition.distance, one.condition.light) == (distance, "night")
    ]
    return found[0] if found else None


def _json(one: Estimate | None) -> dict[str, float | str] | None:
    return None if one is None else one.as_json()


def _row(one: Cell) -> dict[str, Any]:
    linear, brute = one.linear, one.brute
    return {
        "altitude_m": one.altitude_m,
        "sun": one.condition.distance,
        "light": one.condition.light,
        "reflectance": one.condition.reflectance,
        "noise_rms_v": one.condition.noise_rms_v,
        "pfd": _json(one.pfd),
        "pfd_conditional": _json(one.conditional),
        "error": _json(one.spread),
        "by_source": {"shape": _json(one.shape), "pointing": _json(one.jitter), "noise": _json(one.noise)},
        "bias": _json(one.bias),
        "mean_error": _json(one.mean_error),
        "linear": {
            "total_m": linear.total_m,
            "shape_m": linear.shape_m,
            "pointing_m": linear.jitter_m,
            "noise_m": linear.noise_m,
            "snr": linear.snr,
            "valid": linear.valid,
        },
        "brute": None
        if brute is None
        else {"shots": brute.shots, "pfd": _json(brute.pfd), "error": _json(brute.spread)},
    }


def _table(cells: tuple[Cell, ...]) -> Table:
    def masked(ones: list[Estimate | None], part: str) -> np.ma.MaskedArray[Any, Any]:
        values = [0.0 if one is None else getattr(one, part) for one in ones]
        return np.ma.masked_array(values, [one is None for one in ones])

    columns: dict[str, Any] = {
        "cell": (np.arange(len(cells)), "1", "number of the cell"),
        "altitude": (np.array([one.altitude_m for one in cells]), "m", "altitude"),
        "reflectance": (
            np.array([one.condition.reflectance for one in cells]),
            "1",
            "normal albedo at 1064 nm",
        ),
        "day": (np.array([int(one.condition.light == "day") for one in cells]), "1", "1 at noon, 0 at night"),
        "perihelion": (
            np.array([int(one.condition.distance == "perihelion") for one in cells]),
            "1",
            "1 with the Sun at perihelion, 0 at mean distance",
        ),
        "noise_rms": (
            np.array([one.condition.noise_rms_v for one in cells]),
            "V",
            "stationary noise at the converter",
        ),
    }
    estimates: dict[str, tuple[list[Estimate | None], str, str]] = {
        "pfd": ([one.pfd for one in cells], "1", "probability of false detection"),
        "pfd_conditional": ([one.conditional for one in cells], "1", "the same by the very windows of noise"),
        "range_error": ([one.spread for one in cells], "m", "rms error of detections, bias taken off"),
        "range_error_shape": ([one.shape for one in cells], "m", "part of the shape of pulse and ground"),
        "range_error_pointing": ([one.jitter for one in cells], "m", "part of the wandering beam"),
        "range_error_noise": ([one.noise for one in cells], "m", "part of all noise"),
        "range_bias": ([one.bias for one in cells], "m", "calibrated bias"),
        "pfd_brute": ([None if one.brute is None else one.brute.pfd for one in cells], "1", "by whole shots"),
        "range_error_brute": (
            [None if one.brute is None else one.brute.spread for one in cells],
            "m",
            "by whole shots",
        ),
    }
    for name, (ones, unit, told) in estimates.items():
        columns[name] = (masked(ones, "value"), unit, told)
        columns[f"{name}_u"] = (masked(ones, "standard_uncertainty"), unit, "its standard uncertainty")
    columns["range_error_linear"] = (
        np.array([one.linear.total_m for one in cells]),
        "m",
        "rms error by linear propagation",
    )
    return Table(columns, "cell")


def _figure(headline: Headline) -> Figure:
    from procedures.range_figures import table_figure

    return table_figure(headline)
