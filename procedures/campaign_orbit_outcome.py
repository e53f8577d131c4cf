"""The outcome of the orbit campaign: results, tables and figure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.outcome import Outcome, Table
from belahil.uncertainty import budget
from belahil.values import Estimate
from procedures.orbit_results import study
from procedures.orbit_shares import ENERGY, LEVELS, LIGHTS, QUANTILES
from procedures.range_cells_told import cells_table, estimate_columns, json_or_none

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from belahil.outcome import BudgetLine
    from procedures.campaign_orbit import OrbitOptions
    from procedures.echo_energy import Conversion
    from procedures.orbit_results import OrbitStudy, Row
    from procedures.orbit_shares import Told
    from procedures.range_points import Collected

NOTES = (
    "Share: part of the time of an orbit; shots follow each other in equal times, so it is the part of the "
    "shots as well. Good range: one that is no false detection.",
    "Ground and dark noise are those of the range campaign. Slopes are within 1 degree of the one that is "
    "named.",
    "Day is noon everywhere, night has no sunlight: whole orbits under either. Local time is the mean over a "
    "polar orbit whose plane has any angle to the Sun, each as likely; the noise of sunlight follows the "
    "cosine of the angle of incidence on level ground.",
    "Energy: E_G, by the Gaussian that the range finder fits, with the errors of the energy campaign: rms "
    "over detections, the mean that noise adds included.",
    "The orbit is an ellipse about the centre of Mercury, altitudes count from the mean radius of 2439.4 km, "
    "and the beam points to nadir.",
    "When the periapsis falls by the pull of the Sun, the period stays and the apoapsis rises by as much: "
    "`lowered, same period`. `lowered, same apoapsis` holds the apoapsis, as a manoeuvre could.",
    "Uncertainties are those of the draws, of the law of noise peaks and of the interpolation between "
    "altitudes. What the assumed constants leave open is far more: see the budget of the range campaign.",
    "Not modelled: saturation of the converter, flattening and gravity field of the planet, pointing off "
    "nadir, relief under the orbit, slopes in the shade, times at which the laser is off.",
)


def outcome(options: OrbitOptions, found: Collected, convert: Conversion) -> Outcome:
    """Make the outcome of what the chunks gave."""
    made, definitions = study(options, found, convert), found.definitions.told()
    return Outcome(
        results={"definitions": definitions, **_results(made)},
        tables=_tables(made),
        figures={"orbit": lambda: _figure(made)},
        budget=_budget(made),
        notes=(*definitions.values(), *NOTES),
    )


def _figure(made: OrbitStudy) -> Figure:
    from procedures.campaign_orbit_figure import orbit_figure

    return orbit_figure(made)


def _results(made: OrbitStudy) -> dict[str, Any]:
    return {
        "orbits": [_orbit(made, name) for name in made.orbits],
        "rate_hz": made.options.rate_hz,
        "sun": made.options.sun,
        "periapsis_latitude_deg": made.options.periapsis_latitude_deg,
        "crossings": [
            {
                "slope_deg": one.slope_deg,
                "reflectance": one.reflectance,
                "light": one.light,
                "pfd": one.level,
                "status": one.found.status,
                "altitude": json_or_none(one.found.altitude),
            }
            for one in made.crossings
        ],
        "shares": [_row(made, one) for one in made.shares],
        "limits": [_limit(made, km) for km in made.options.limits_km],
        "limited": [_row(made, one) for one in made.limits],
        "lowered": [_change(made, one) for one in made.shares if one.orbit != next(iter(made.orbits))],
        "converter": {
            "largest_peak_v": made.largest_peak_v,
            "end_v": made.half_span_v,
            "clips": made.largest_peak_v > made.half_span_v,
        },
    }


def _orbit(made: OrbitStudy, name: str) -> dict[str, Any]:
    orbit = made.orbits[name]
    return {
        "orbit": name,
        "periapsis_m": orbit.periapsis_m,
        "apoapsis_m": orbit.apoapsis_m,
        "semi_major_axis_m": orbit.semi_major_axis_m,
        "eccentricity": orbit.eccentricity,
        "time_below_nominal": orbit.time_below(next(iter(made.orbits.values())).periapsis_m),
        "period_s": orbit.period_s,
        "shots": made.shots(name),
        "shots_a_day": made.shots(name) * made.turns_a_day(name),
    }


def _limit(made: OrbitStudy, km: float) -> dict[str, Any]:
    name, orbit = next(iter(made.orbits.items()))
    share = orbit.time_below(1e3 * km)
    return {
        "limit_m": 1e3 * km,
        "time_share": share,
        "shots": share * made.shots(name),
        "shots_a_day": share * made.shots(name) * made.turns_a_day(name),
    }


def _row(made: OrbitStudy, row: Row) -> dict[str, Any]:
    told = row.told
    where = {"orbit": row.orbit} if row.limit_m is None else {"limit_m": row.limit_m}
    ground = {"slope_deg": row.slope_deg, "reflectance": row.reflectance, "light": row.light}
    return where | ground | _numbers(told) | _counts(made, row.orbit, told.good)


def _numbers(told: Told) -> dict[str, Any]:
    shares = {f"below_{100 * level:g}": one.as_json() for level, one in zip(LEVELS, told.below, strict=True)}
    errors = dict(zip(_ERROR_BELOW, told.error_below or (None,) * len(QUANTILES), strict=True))
    return shares | {
        f"energy_below_{100 * ENERGY:g}": told.energy.as_json(),
        "good": told.good.as_json(),
        "error": json_or_none(told.error),
        **{name: json_or_none(one) for name, one in errors.items()},
    }


_ERROR_BELOW = tuple(f"error_{100 * part:g}" for part in QUANTILES)


def _counts(made: OrbitStudy, orbit: str, good: Estimate) -> dict[str, Any]:
    """Good ranges of a turn and of 24 hours."""
    found = {}
    for name, turns in (("ranges", 1.0), ("ranges_a_day", made.turns_a_day(orbit))):
        shots = made.shots(orbit) * turns
        found[name] = Estimate(good.value * shots, good.standard_uncertainty * shots, "1").as_json()
    return found


def _change(made: OrbitStudy, row: Row) -> dict[str, Any]:
    """What an orbit adds to the nominal one, copy by copy; ranges of a day differ by the period as well."""
    first = next(iter(made.orbits))
    nominal = made.share(first, row.slope_deg, row.reflectance, row.light)
    told = row.copies.less(nominal.copies).told()
    ground = {"slope_deg": row.slope_deg, "reflectance": row.reflectance, "light": row.light}
    # A day has as many shots in every orbit.
    shots = made.shots(row.orbit) * made.turns_a_day(row.orbit)
    value, u = told.good.value * shots, told.good.standard_uncertainty * shots
    added = {name: one for name, one in _numbers(told).items() if name not in _ERROR_BELOW}
    return {"orbit": row.orbit} | ground | added | {"ranges_a_day": Estimate(value, u, "1").as_json()}


def _budget(made: OrbitStudy) -> list[BudgetLine]:
    """What chance and interpolation add to the shares of the nominal orbit over the usual ground."""
    lines: list[BudgetLine] = []
    slope_deg, reflectance = made.usual
    for light in LIGHTS:
        copies = made.share(next(iter(made.orbits)), slope_deg, reflectance, light).copies
        for number, level in enumerate(LEVELS):
            chance, between = copies.parts(number)
            lines += budget(
                f"PFD below {100 * level:g} %, {light}, reflectance {reflectance:g}, {slope_deg:g} deg",
                "1",
                {"draws and law of noise peaks": chance, "interpolation between altitudes": between},
            )
    return lines


def _tables(made: OrbitStudy) -> dict[str, Table]:
    rows = [one for _, ones, _ in made.cells for one in ones]
    slopes = np.radians([slope for slope, ones, _ in made.cells for _ in ones])
    energies = [one.error() for _, _, ones in made.cells for one in ones]
    table = cells_table(rows, "orbit_cell", "orbit_cell_")
    columns = {
        **table.columns,
        "orbit_cell_slope": (slopes, "rad", "slope of the planes under the footprints"),
    }
    columns |= estimate_columns("orbit_cell_energy_error", energies, "1", "rms error of E_G of detections")
    names = list(made.orbits)
    return {
        "orbit_cell": Table(columns, "orbit_cell"),
        "orbit_share": _share_table(made.shares, "orbit_share", names),
        "orbit_limit": _share_table(made.limits, "orbit_limit", names),
        "orbit_crossing": _crossing_table(made),
    }


def _share_table(rows: tuple[Row, ...], dimension: str, names: list[str]) -> Table:
    told, prefix = [one.told for one in rows], f"{dimension}_"
    limits = [one.limit_m for one in rows]
    missing = [one is None for one in limits]
    columns: dict[str, Any] = {
        dimension: (np.arange(len(rows)), "1", "number of the row"),
        f"{prefix}orbit": (np.array([names.index(one.orbit) for one in rows]), "1", "; ".join(_said(names))),
        f"{prefix}altitude_limit": (
            np.ma.masked_array([0.0 if one is None else one for one in limits], missing),
            "m",
            "altitude up to which the laser is fired",
        ),
        f"{prefix}slope": (np.radians([one.slope_deg for one in rows]), "rad", "slope of the ground"),
        f"{prefix}reflectance": (
            np.array([one.reflectance for one in rows]),
            "1",
            "normal albedo at 1064 nm",
        ),
        f"{prefix}light": (
            np.array([LIGHTS.index(one.light) for one in rows]),
            "1",
            "; ".join(_said(list(LIGHTS))),
        ),
    }
    for number, level in enumerate(LEVELS):
        said = f"part of the orbit's time with a probability of false detection below {100 * level:g} %"
        columns |= estimate_columns(
            f"{prefix}below_{100 * level:g}", [one.below[number] for one in told], "1", said
        )
    said = f"part of the orbit's time with an error of E_G below {100 * ENERGY:g} %"
    columns |= estimate_columns(f"{prefix}energy", [one.energy for one in told], "1", said)
    columns |= estimate_columns(
        f"{prefix}good", [one.good for one in told], "1", "part of all shots: good ranges"
    )
    columns |= estimate_columns(
        f"{prefix}error", [one.error for one in told], "m", "rms error of good ranges"
    )
    return Table(columns, dimension)


def _said(names: list[str]) -> list[str]:
    return [f"{number}: {name}" for number, name in enumerate(names)]


def _crossing_table(made: OrbitStudy) -> Table:
    rows = made.crossings
    columns: dict[str, Any] = {
        "orbit_crossing": (np.arange(len(rows)), "1", "number of the row"),
        "crossing_slope": (np.radians([one.slope_deg for one in rows]), "rad", "slope of the ground"),
        "crossing_reflectance": (
            np.array([one.reflectance for one in rows]),
            "1",
            "normal albedo at 1064 nm",
        ),
        "crossing_day": (np.array([int(one.light == "day") for one in rows]), "1", "1 at noon, 0 at night"),
        "crossing_pfd": (np.array([one.level for one in rows]), "1", "probability of false detection"),
    }
    found = [one.found.altitude for one in rows]
    columns |= estimate_columns("crossing_altitude", found, "m", "altitude at which it is first reached")
    return Table(columns, "orbit_crossing")
