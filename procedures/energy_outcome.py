"""The outcome of an energy calibration: results for JSON, tables, budget and notes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.outcome import Outcome, Table
from belahil.values import Estimate
from belahil.verdict import Check, disagreement, not_measured
from procedures.energy_model import REFERENCE_GAIN, REFERENCE_M, at_reference
from procedures.energy_results import (
    INTEGRALS,
    PUBLISHED,
    PUBLISHED_DEVIATION,
    RESPONSIVITY_RELATIVE,
    Agreement,
    EnergyResults,
    intercept_by_slope,
    published_deviation,
)
from sim.detector import multiplication

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from belahil.config import BenchConfig
    from belahil.outcome import Column, Number
    from procedures.energy_calibration import EnergyOptions
    from procedures.energy_fit import EnergyFit
    from procedures.energy_points import Readings
    from procedures.known_receiver import KnownReceiver
    from sim.scene import Scene

FAINT = 0.05
"""Relative scatter of a slope above which a difference says nothing of the receiver: so near noise (pulses
of 2 mV, noise of 0.16 mV) amplitudes that are too high weigh more, and move every mean."""


def outcome(
    readings: Readings, receiver: KnownReceiver, scene: Scene, options: EnergyOptions, config: BenchConfig
) -> Outcome:
    """Bring everything into the form that a run keeps."""
    found = EnergyResults(readings, receiver, scene, options, config)
    return Outcome(
        results=_results(found),
        tables=_tables(found),
        numbers=_numbers(found),
        figures={"energy": lambda: _figure(found)} if found.status == "ok" else {},
        budget=found.budget,
        notes=_notes(found),
        checks=_checks(found),
    )


def _checks(found: EnergyResults) -> list[Check]:
    if found.status != "ok":
        return [not_measured("slope", found.status)]
    checks = []
    for name, label in (("gaussian", "fitted Gaussian"), ("window", "correlation window")):
        fit, told = found.measured[name], found.agreement[name]
        if fit is None or told is None:
            continue
        differs = disagreement(label, told.chi_square, told.degrees_of_freedom)
        if differs and fit.slope.standard_uncertainty > FAINT * abs(fit.slope.value):
            differs = [not_measured("chi_square", f"{label}, pulse_below_noise")]
        checks += differs
    return checks


def _results(found: EnergyResults) -> dict[str, Any]:
    gains = np.unique(found.readings.gain[found.readings.gain > 0])
    return {
        "status": found.status,
        "measured": {
            name: _fit(found.measured[name], name, found.slope(name), found.intercept(name))
            for name in INTEGRALS
        },
        "agreement": {name: _agreement(found.agreement[name]) for name in INTEGRALS},
        "linearity": [
            {"peak_v": one.peak_v, "ratio": one.ratio.as_json(), "points": one.points}
            for one in found.linearity
        ],
        "model": [
            {
                "echoes": echoes,
                "points": int(points.fwhm_s.size),
                **{name: _fit(points.fit(name), name) for name in INTEGRALS},
                "rectified": _fit(points.fit("rectified"), "window"),
            }
            for echoes, points in found.model.items()
        ],
        "published": {
            name: {
                "slope": slope,
                "intercept": intercept,
                "intercept_by_slope": intercept / slope,
                "left": left,
            }
            for name, (slope, intercept, left) in PUBLISHED.items()
        }
        | {"largest_deviation": PUBLISHED_DEVIATION},
        "multiplication": multiplication(found.scene.detector),
        "feedback_ohm": found.scene.detector.feedback_ohm,
        "gains": gains.tolist(),
        "scales": [1 / at_reference(found.scene, float(gain)) for gain in gains],
        "points": found.readings.counted,
    }


def _fit(
    fit: EnergyFit | None, name: str, slope: Estimate | None = None, intercept: Estimate | None = None
) -> dict[str, Any]:
    if fit is None:
        keys = ("slope", "intercept", "intercept_by_slope", "slope_by_published", "largest_deviation")
        return {**dict.fromkeys(keys), "published_deviation": None, "left": None, "status": "too_few_points"}
    slope, intercept = slope or fit.slope, intercept or fit.intercept
    by_published = slope.value / PUBLISHED[name][0]
    relative = math.hypot(slope.standard_uncertainty / slope.value, RESPONSIVITY_RELATIVE)
    return {
        "slope": slope.as_json(),
        "intercept": intercept.as_json(),
        "intercept_by_slope": intercept_by_slope(fit).as_json(),
        "slope_by_published": Estimate(by_published, abs(by_published) * relative).as_json(),
        "largest_deviation": fit.largest_deviation.as_json(),
        "published_deviation": published_deviation(fit, name).as_json(),
        "left": fit.left_rms,
        "status": "ok",
    }


def _agreement(one: Agreement | None) -> dict[str, Any] | None:
    if one is None:
        return None
    return {
        "chi_square": one.chi_square,
        "degrees_of_freedom": one.degrees_of_freedom,
        "largest": one.largest,
    }


def _numbers(found: EnergyResults) -> dict[str, Number]:
    words = {"gaussian": "area of the fitted Gaussian", "window": "integral of the correlation window"}
    numbers: dict[str, Number] = {}
    for name in INTEGRALS:
        about = f"of optical energy against the {words[name]}, both by amplitude, at the reference gains"
        numbers[f"energy_slope_{name}"] = (found.slope(name), "J V-1 s-1", f"slope {about}")
        numbers[f"energy_intercept_{name}"] = (found.intercept(name), "J V-1", f"intercept {about}")
    return numbers


def _tables(found: EnergyResults) -> dict[str, Table]:
    readings, usable = found.readings, found.readings.usable

    def of_pulse(name: str) -> Any:
        values = np.array([getattr(one, name) for one in readings.pulses])
        return np.ma.masked_array(values, ~usable)

    tables = {
        "energy_point": Table(
            {
                "energy_shot": (readings.shot, "1", "shot that the point was read from"),
                "energy_status": (
                    np.array([one.status for one in readings.pulses], dtype=np.str_),
                    "1",
                    "ok, or why the point is not used",
                ),
                "energy_played_width_s": (
                    readings.width_s,
                    "s",
                    "full width of the played pulse",
                ),
                "energy_played_peak_v": (readings.peak_v, "V", "height of the played pulse at the cut"),
                "energy_optical_j": (readings.energy_j, "J", "optical energy at the reference gains"),
                "energy_window_v_s": (of_pulse("window_v_s"), "V s", "integral of the correlation window"),
                "energy_gaussian_v_s": (of_pulse("gaussian_v_s"), "V s", "area of the fitted Gaussian"),
                "energy_fwhm_s": (of_pulse("fwhm_s"), "s", "detected full width at half maximum"),
                "energy_amplitude_v": (of_pulse("amplitude_v"), "V", "detected height at the converter"),
            },
            "energy_point",
        )
    }
    fits = {name: fit for name in INTEGRALS if (fit := found.measured[name]) is not None}
    if fits:
        columns: dict[str, Column] = {}
        for name, fit in fits.items():
            about = f"of the {name} integral"
            columns |= {
                f"energy_{name}_place_s": (
                    fit.places_s,
                    "s",
                    f"integral by amplitude, mean of a width {about}",
                ),
                f"energy_{name}_ratio": (fit.ratios, "1", f"energy divided by the line {about}"),
                f"energy_{name}_ratio_u": (fit.ratio_u, "1", "its standard uncertainty by the scatter"),
            }
        tables["energy_width"] = Table(columns, "energy_width")
    for echoes, points in found.model.items():
        if points.fwhm_s.size:
            tables[echoes] = _cloud(echoes.removesuffix("s"), points)
    return tables


def _cloud(echo: str, points: Any) -> Table:
    about = f"of a simulated echo ({echo})"
    return Table(
        {
            f"{echo}_gaussian_s": (
                points.gaussian_s,
                "s",
                f"area of the fitted Gaussian by amplitude {about}",
            ),
            f"{echo}_window_s": (
                points.window_s,
                "s",
                f"integral of the correlation window by amplitude {about}",
            ),
            f"{echo}_energy_j_per_v": (
                points.energy_j_per_v,
                "J V-1",
                f"optical energy by amplitude, at the reference gains, {about}",
            ),
            f"{echo}_fwhm_s": (points.fwhm_s, "s", f"detected full width {about}"),
        },
        f"simulated_{echo}",
    )


def _notes(found: EnergyResults) -> list[str]:
    return [
        f"Energies and lines are those of gains of {REFERENCE_M:g} (photodiode) and {REFERENCE_GAIN:g} "
        "(receiver), to which the published lines are scaled; a value of `scales` takes them to this run's.",
        f"A bench has no photodiode: {found.scene.detector.feedback_ohm:g} ohm and a gain of "
        f"{multiplication(found.scene.detector):.4g} are the scene's, and turn volt seconds at the cut into "
        "joule.",
        "45 kohm were derived from the published lines, so an equal slope proves nothing; intercept by "
        "slope, the ratio of both slopes, and the curves do not depend on it.",
        "rectified: the correlation window with its samples below 0 V taken for 0 V, for comparison.",
        "Not modelled: the photodiode's own behaviour, the noise of light, pulses on the slope of another.",
    ]


def _figure(found: EnergyResults) -> Figure:
    from procedures.energy_figure import energy_figure

    return energy_figure(found)
