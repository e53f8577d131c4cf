"""The outcome of an arrival curve: results, tables, figure, budget, notes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import chi2

from belahil.outcome import BudgetLine, Outcome
from belahil.uncertainty import budget
from belahil.values import Estimate
from belahil.verdict import Check, disagreement, not_measured
from procedures.arrival_curve import (
    FootprintCurve,
    curve_through,
    footprint_curve,
    model_curve,
    with_published,
)
from procedures.arrival_footprints import footprints, transmitted
from procedures.arrival_ground import grounds
from procedures.arrival_points import relative_to_model
from procedures.arrival_tables import tables

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from belahil.delay_curve import DelayCurve
    from procedures.arrival_footprints import Footprints
    from procedures.arrival_points import BenchPoints
    from procedures.arrival_time import ArrivalOptions
    from procedures.known_receiver import KnownReceiver

CHANCE = 1e-3
"""A chi-square less probable than this is not taken for chance."""

_APART = 3.0

ALIKE_S = 0.15e-9
"""Curves that differ by less, rms, have the same shape: three printed digits leave as much."""


@dataclass(frozen=True, slots=True, eq=False)
class Arrival:
    """All that was found.

    Parameters
    ----------
    known : KnownReceiver
        The model of the receiver.
    model : DelayCurve
        Its curve.
    points : BenchPoints
        What the bench's windows tell.
    bench : DelayCurve or None
        Curve through the points, with the delay of the references where that is known; None where they do not
        determine one.
    expected : DelayCurve or None
        The same curve of what the model expects at the same pulses.
    found : Footprints or None
        Echoes of footprints; None where none were asked for.
    terrain : FootprintCurve or None
        Their curve.
    """

    known: KnownReceiver
    model: DelayCurve
    points: BenchPoints
    bench: DelayCurve | None
    expected: DelayCurve | None
    found: Footprints | None
    terrain: FootprintCurve | None


def outcome(options: ArrivalOptions, known: KnownReceiver, points: BenchPoints) -> Outcome:
    """Make the outcome.

    Parameters
    ----------
    options : ArrivalOptions
        As chosen.
    known : KnownReceiver
        The model of the receiver.
    points : BenchPoints
        What the bench's windows tell.
    """
    found, terrain = None, None
    if options.footprints:
        lands = tuple(grounds(options.terrain, options.ground_seed))
        found = footprints(lands, options.altitudes_m, options.footprints, known, options.ground_seed)
        terrain = footprint_curve(found, transmitted(lands[0].laser, known))
    arrival = Arrival(known, model_curve(known), points, *_bench_curves(points), found, terrain)
    return Outcome(
        results={
            "model": _model_json(arrival),
            "bench": _bench_json(arrival),
            "footprints": None
            if terrain is None or found is None
            else _terrain_json(arrival, terrain, found),
        },
        tables=tables(arrival),
        figures={"arrival": lambda: _figure(arrival)},
        budget=_budget(arrival),
        notes=_notes(arrival),
        checks=_checks(arrival),
    )


def _checks(arrival: Arrival) -> list[Check]:
    """Judge the shape alone: the constant is only as well known as ``[bench] trigger_delay_s``."""
    if arrival.points.status != "ok":
        return [not_measured("delay", arrival.points.status)]
    return disagreement("bench and model", *relative_to_model(arrival.points.usable))


def _bench_curves(points: BenchPoints) -> tuple[DelayCurve | None, DelayCurve | None]:
    usable = points.usable
    widths_s = np.array([one.width.value for one in usable if one.width])
    measured_s = np.array([one.delay.value for one in usable if one.delay])
    expected_s = np.array([one.model_delay_s for one in usable])
    if points.reference is not None:
        measured_s = measured_s + points.reference.value
    if points.reference_model is not None:
        expected_s = expected_s + points.reference_model.value
    return curve_through(widths_s, measured_s), curve_through(widths_s, expected_s)


def _figure(arrival: Arrival) -> Figure:
    from procedures.arrival_figure import arrival_figure

    return arrival_figure(arrival)


# ---- results


def _model_json(arrival: Arrival) -> dict[str, Any]:
    known = arrival.known
    return {
        "origin": known.origin,
        "cutoff": known.cutoff.as_json(),
        "order": known.order,
        "curve": curve_json(arrival.model),
        "published": _published(arrival.model, _constant_u_s(arrival)),
    }


def _constant_u_s(arrival: Arrival) -> float:
    """Return what the uncertainty of the cut-off makes of a constant that is common to all widths, s."""
    cutoff = arrival.known.cutoff
    moved = model_curve(arrival.known, 1 + cutoff.standard_uncertainty / cutoff.value)
    middle_s = (max(arrival.model.narrowest_s, moved.narrowest_s) + arrival.model.widest_s) / 2
    return abs(float(moved.at(middle_s) - arrival.model.at(middle_s)))


def curve_json(curve: DelayCurve | None) -> dict[str, Any] | None:
    """Return a curve as plain values: Legendre coefficients on its range of widths."""
    if curve is None:
        return None
    return {
        "coefficients_s": list(curve.coefficients_s),
        "narrowest_s": curve.narrowest_s,
        "widest_s": curve.widest_s,
    }


def _published(curve: DelayCurve | None, constant_u_s: float | None) -> list[dict[str, Any]]:
    """Compare with both forms; a constant that nobody measured is null."""
    rows = []
    for as_printed in (False, True):
        found = None if curve is None else with_published(curve, as_printed=as_printed)
        if found is not None:
            known = constant_u_s is not None
            rows.append(
                {
                    "linear_coefficient": found.linear_coefficient,
                    "constant": Estimate(found.constant_s, constant_u_s or 0.0, "s").as_json()
                    if known
                    else None,
                    "rms_s": found.rms_s,
                    "rms_about_known_s": found.rms_about_known_s if known else None,
                    "narrowest_s": found.narrowest_s,
                    "widest_s": found.widest_s,
                }
            )
    return rows


def _bench_json(arrival: Arrival) -> dict[str, Any]:
    points = arrival.points
    return {
        "status": points.status,
        "points": [
            {
                "played_fwhm_s": one.played_fwhm_s,
                "fwhm": _json(one.width),
                "delay": _json(one.delay),
                "model_fwhm_s": one.model_width_s if one.delay else None,
                "model_delay": Estimate(one.model_delay_s, abs(one.model_u_s), "s").as_json()
                if one.delay
                else None,
                "windows": one.windows,
                "windows_not_used": one.windows_bad,
                "status": one.status,
            }
            for one in points.points
        ],
        "reference_fwhm_s": points.reference_fwhm_s or None,
        "reference_delay": _json(points.reference),
        "reference_status": points.reference_status,
        "reference_model": _json(points.reference_model),
        "clock_ppm": _json(points.clock_ppm),
        "curve": curve_json(arrival.bench),
        "curve_status": "too_few_points" if arrival.bench is None else "ok",
        "agreement": _agreement(arrival),
        "published": _published(
            arrival.bench, None if points.reference is None else points.reference.standard_uncertainty
        ),
    }


def _agreement(arrival: Arrival) -> dict[str, Any] | None:
    """Compare bench and model: the shape by chi-square, the constant by the reference pulses."""
    points = arrival.points
    if points.reference is None or points.reference_model is None:
        return None
    chi_square, freedom = relative_to_model(points.usable)
    probability = float(chi2.sf(chi_square, freedom))
    apart = points.reference.value - points.reference_model.value
    apart_u = float(
        np.hypot(points.reference.standard_uncertainty, points.reference_model.standard_uncertainty)
    )
    rms_s = None
    if arrival.bench is not None and arrival.expected is not None:
        widths_s = np.linspace(arrival.bench.narrowest_s, arrival.bench.widest_s, 200)
        apart_s = arrival.bench.at(widths_s) - arrival.expected.at(widths_s)
        rms_s = float(apart_s.std())
    return {
        "chi_square": chi_square,
        "degrees_of_freedom": freedom,
        "probability": probability,
        "status": "agree" if probability >= CHANCE else "differ",
        "curves_rms_s": rms_s,
        "constant": Estimate(apart, apart_u, "s").as_json(),
        "constant_status": "agree" if abs(apart) <= _APART * apart_u else "differ",
    }


def _terrain_json(arrival: Arrival, terrain: FootprintCurve, found: Footprints) -> dict[str, Any]:
    return {
        "status": terrain.status,
        "footprints": int(found.width_s.size),
        "footprints_inside": terrain.inside,
        "footprints_without_data": found.dark,
        "terrains": len(found.names),
        "altitudes_m": sorted({float(one) for one in found.altitude_m}),
        "transmitted_fwhm_s": terrain.transmitted_width_s,
        "transmitted_delay_s": terrain.transmitted_delay_s,
        "curve": curve_json(terrain.curve),
        "bias": _json(terrain.bias),
        "bias_fwhm_s": terrain.bias_width_s or None,
        "residual": _json(terrain.residual),
        "residual_largest": _json(terrain.residual_largest),
        "published": _published(terrain.curve, _constant_u_s(arrival)),
    }


def _json(estimate: Estimate | None) -> dict[str, Any] | None:
    return None if estimate is None else estimate.as_json()


# ---- budget and notes


def _budget(arrival: Arrival) -> list[BudgetLine]:
    lines: list[BudgetLine] = []
    points = arrival.points
    for one in points.usable[:1] + points.usable[-1:]:
        assert one.delay is not None
        assert one.width is not None
        parts = {
            "scatter of the windows": one.delay.standard_uncertainty,
            f"cut-off of the model ({arrival.known.origin})": abs(one.model_u_s),
        }
        lines += budget(f"delay at {1e9 * one.width.value:.1f} ns less the model's", "s", parts)
    if points.reference is not None and points.reference_model is not None:
        parts = {
            "trigger between two samples, and noise": points.reference.standard_uncertainty,
            f"cut-off of the model ({arrival.known.origin})": points.reference_model.standard_uncertainty,
        }
        lines += budget("delay of the reference less the model's", "s", parts)
    return lines


def _notes(arrival: Arrival) -> list[str]:
    notes = [
        "A delay of the bench is that of the test pulses after the reference pulses of the same window. What "
        "is common to all widths is known only through [bench] trigger_delay_s, taken for exact, and because "
        "a trigger falls within one sample.",
        "The model's curve is that of Gaussian pulses behind its filter; no curve is continued beyond its "
        "widths.",
        "Not modelled: jitter of the generator, small-signal behaviour, a receiver that is not linear; in "
        "footprints noise, quantization, relief between posts, shadows and wandering of the beam.",
    ]
    plain, printed = (with_published(arrival.model, as_printed=one) for one in (False, True))
    if plain and printed:
        judged = ""
        if plain.rms_s < ALIKE_S < printed.rms_s:
            judged = ", so the printed one is probably a misprint"
        notes.append(
            "The published polynomial and the model's delay sum to a constant of "
            f"{1e9 * plain.constant_s:.2f} ns within {1e9 * plain.rms_s:.2f} ns rms with a linear "
            "coefficient of 9.37e-2; with the printed 9.37e-1 the sum varies by "
            f"{1e9 * printed.rms_s:.1f} ns rms{judged}."
        )
    return notes
