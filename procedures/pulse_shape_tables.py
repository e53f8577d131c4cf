"""Tables of played echoes for the data file: one row for each echo, and one for each compared window."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.outcome import Table

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from procedures.pulse_shape_fit import ShapeFit
    from procedures.pulse_shape_results import Compared


def tables(found: Compared) -> dict[str, Table]:
    """Return the tables of a campaign by name."""
    return {"cases": _case_table(found), **_window_tables(found)}


def _case_table(found: Compared) -> Table:
    cases = found.cases

    def column(values: list[float | None]) -> NDArray[Any]:
        known = [value is not None for value in values]
        numbers = np.array([0.0 if value is None else value for value in values])
        return np.ma.masked_array(numbers, ~np.array(known))

    played = [one.level(one.played) for one in cases]
    wished = [one.level(one.wished) for one in cases]
    shape = [one.played.fit.shape if one.played and one.status == "ok" else None for one in cases]
    freedom = [one.played.fit.shape_freedom if one.played and one.status == "ok" else None for one in cases]
    echo = [one.case.echo for one in cases]
    codes = [-1 if one.case.gain_code is None else one.case.gain_code for one in cases]
    columns = {
        "case": (np.arange(len(cases)), "1", "echo, in the order of results.cases of summary.json"),
        "case_gain_code": (np.array(codes), "1", "gain code, -1 where the receiver has none"),
        "case_altitude_m": (
            column([e.altitude_m if e else None for e in echo]),
            "m",
            "altitude of the scene",
        ),
        "case_slope_deg": (
            column([e.slope_deg if e else None for e in echo]),
            "degree",
            "slope of the ground",
        ),
        "case_azimuth_deg": (column([e.azimuth_deg if e else None for e in echo]), "degree", "its azimuth"),
        "case_peak_v": (
            column([one.peak_v if one.played else None for one in cases]),
            "V",
            "largest voltage that was played, at the cut",
        ),
        "case_windows": (np.array([one.windows for one in cases]), "1", "windows that were compared"),
        "case_chi_square": (
            column([one.value if one else None for one in played]),
            "1",
            "reduced chi-square of the prediction for what was played",
        ),
        "case_chi_square_u": (
            column([one.standard_uncertainty if one else None for one in played]),
            "1",
            "its standard uncertainty, by chance and by the measured noise",
        ),
        "case_chi_square_wished": (
            column([one.value if one else None for one in wished]),
            "1",
            "reduced chi-square of the prediction for what was wished",
        ),
        "case_shape_chi_square": (column(shape), "1", "by how much a free curve lowers chi-square"),
        "case_shape_freedom": (column([*map(_float, freedom)]), "1", "degrees of freedom of this curve"),
        "case_status": (np.array([one.status for one in cases]), "1", "ok, or why there is no verdict"),
    }
    return Table(columns, "case")


def _float(value: int | None) -> float | None:
    return None if value is None else float(value)


def _window_tables(found: Compared) -> dict[str, Table]:
    """Every compared window: where it was placed, what was predicted, what is left."""
    ones = [(place, one) for place, one in enumerate(found.cases) if one.played is not None]
    if not ones:
        return {}
    longest = max(one.played.fit.residual_v.shape[1] for _, one in ones if one.played)

    def padded(of: Callable[[ShapeFit], NDArray[np.float64]]) -> NDArray[Any]:
        rows = []
        for _, one in ones:
            assert one.played is not None
            values = of(one.played.fit)
            rows.append(np.pad(values, ((0, 0), (0, longest - values.shape[1])), constant_values=np.nan))
        return np.ma.masked_invalid(np.concatenate(rows))

    fits = [one.played.fit for _, one in ones if one.played]
    one_row = {
        "compared_shot": (np.concatenate([one.shots for _, one in ones]), "1", "shot of the window"),
        "compared_case": (
            np.concatenate([np.full(one.shots.size, place) for place, one in ones]),
            "1",
            "its echo",
        ),
        "compared_first_sample": (
            np.concatenate([np.full(one.shots.size, one.first) for _, one in ones]),
            "1",
            "sample of the window with which the comparison begins",
        ),
        "compared_start_s": (
            np.concatenate([fit.placement.first_s for fit in fits]),
            "s",
            "found time of this sample on the time axis of the pulse",
        ),
    }
    many = {
        "compared_predicted_v": (
            padded(lambda fit: fit.placement.predicted_v),
            "V",
            "prediction at the converter",
        ),
        "compared_residual_v": (
            padded(lambda fit: fit.residual_v),
            "V",
            "measured minus predicted, converter offsets removed",
        ),
    }
    return {
        "compared": Table(one_row, "compared"),
        "residuals": Table(many, "compared", "compared_sample"),
    }
