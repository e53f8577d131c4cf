"""The tables of an arrival curve for the data file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.delay_curve import NARROWEST_S, WIDEST_S, DelayCurve, published_curve
from belahil.outcome import Table

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from procedures.arrival_curve import FootprintCurve
    from procedures.arrival_footprints import Footprints
    from procedures.arrival_outcome import Arrival
    from procedures.arrival_points import WidthPoint

_STEP_S = 0.5e-9


def tables(arrival: Arrival) -> dict[str, Table]:
    """Return the points, the curves, and the footprints with their means, as far as they are there."""
    made = {"arrival_fwhm": _curves(arrival)}
    if arrival.points.points:
        made["arrival_point"] = _points(arrival.points.points)
    if arrival.found is not None and arrival.found.width_s.size:
        made["footprint"] = _footprints(arrival.found)
    if arrival.terrain is not None and arrival.terrain.bins.count.size:
        made["shift_bin"] = _bins(arrival.terrain)
    return made


def _points(points: tuple[WidthPoint, ...]) -> Table:
    missing = np.array([one.delay is None for one in points])

    def column(pick: Any) -> np.ma.MaskedArray[Any, Any]:
        return np.ma.masked_array([0.0 if one.delay is None else pick(one) for one in points], missing)

    return Table(
        {
            "arrival_played_fwhm": (
                np.array([one.played_fwhm_s for one in points]),
                "s",
                "full width at half maximum as played",
            ),
            "arrival_detected_fwhm": (column(lambda one: one.width.value), "s", "detected full width"),
            "arrival_detected_fwhm_u": (
                column(lambda one: one.width.standard_uncertainty),
                "s",
                "its standard uncertainty",
            ),
            "arrival_delay": (
                column(lambda one: one.delay.value),
                "s",
                "delay of the detected arrival after that of the reference pulses",
            ),
            "arrival_delay_u": (
                column(lambda one: one.delay.standard_uncertainty),
                "s",
                "its standard uncertainty",
            ),
            "arrival_model_delay": (column(lambda one: one.model_delay_s), "s", "the same by the model"),
            "arrival_model_delay_u": (
                column(lambda one: abs(one.model_u_s)),
                "s",
                "its standard uncertainty",
            ),
            "arrival_windows": (np.array([one.windows for one in points]), "1", "windows used"),
            "arrival_status": (np.array([one.status for one in points]), "1", "ok, or what is missing"),
        },
        "arrival_point",
    )


def _curves(arrival: Arrival) -> Table:
    widths_s = np.arange(NARROWEST_S, WIDEST_S + _STEP_S / 2, _STEP_S)
    terrain = None if arrival.terrain is None else arrival.terrain.curve
    return Table(
        {
            "arrival_fwhm": (widths_s, "s", "detected full width of the curves"),
            "model_arrival_delay": (_along(arrival.model, widths_s), "s", "delay by the model"),
            "bench_arrival_delay": (
                _along(arrival.bench, widths_s),
                "s",
                "delay by the bench, with that of the references",
            ),
            "footprint_arrival_delay": (_along(terrain, widths_s), "s", "mean delay over footprints"),
            "published_shift": (
                published_curve().at(widths_s.clip(NARROWEST_S, WIDEST_S)),
                "s",
                "published polynomial with a linear coefficient of 9.37e-2",
            ),
            "published_shift_printed": (
                published_curve(as_printed=True).at(widths_s.clip(NARROWEST_S, WIDEST_S)),
                "s",
                "published polynomial as printed, with 9.37e-1",
            ),
        },
        "arrival_fwhm",
    )


def _along(curve: DelayCurve | None, widths_s: NDArray[np.float64]) -> np.ma.MaskedArray[Any, Any]:
    values = np.zeros(widths_s.shape)
    if curve is None:
        return np.ma.masked_array(values, np.ones(widths_s.shape, dtype=np.bool_))
    inside = (widths_s >= curve.narrowest_s) & (widths_s <= curve.widest_s)
    values[inside] = curve.at(widths_s[inside])
    return np.ma.masked_array(values, ~inside)


def _footprints(found: Footprints) -> Table:
    return Table(
        {
            "footprint_shift": (
                found.shift_s,
                "s",
                "detected arrival after the mean of the light and the centroid of the pulse",
            ),
            "footprint_fwhm": (found.width_s, "s", "detected full width at half maximum"),
            "footprint_altitude": (found.altitude_m, "m", "altitude"),
            "footprint_terrain": (found.ground, "1", "number of the terrain"),
        },
        "footprint",
    )


def _bins(terrain: FootprintCurve) -> Table:
    bins = terrain.bins
    return Table(
        {
            "shift_bin": (bins.low_s, "s", "where a bin of detected widths begins"),
            "shift_fwhm": (bins.width_s, "s", "mean detected full width in it"),
            "shift_mean": (bins.shift_s, "s", "mean shift of its footprints"),
            "shift_mean_u": (bins.shift_u_s, "s", "its standard uncertainty"),
            "shift_spread": (bins.spread_s, "s", "standard deviation of the shifts"),
            "shift_count": (bins.count, "1", "footprints"),
        },
        "shift_bin",
    )
