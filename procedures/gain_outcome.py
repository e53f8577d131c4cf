"""The outcome of a characterization: results as the contract names them, tables, figures, budget, notes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.bench import setting_per_cut_volt
from belahil.config import GeneratorUncertainty
from belahil.outcome import Outcome, Table
from belahil.values import Estimate
from procedures.gain_results import characterization
from procedures.noise import noise_note, spectrum_table

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.figure import Figure

    from belahil.config import BenchConfig
    from procedures.butterworth_fit import ButterworthFit
    from procedures.characterize import GainPlan
    from procedures.gain_amplitudes import Linearity
    from procedures.gain_points import WindowReadings
    from procedures.gain_results import Characterization, CodeResult


def outcome(plan: GainPlan, readings: WindowReadings, config: BenchConfig) -> Outcome:
    """Make the outcome of what the windows told.

    Parameters
    ----------
    plan : GainPlan
        What was measured.
    readings : WindowReadings
        From `procedures.gain_points.read_windows`.
    config : BenchConfig
        Attenuation, load and declared uncertainties.
    """
    found = characterization(plan.codes, readings, config.generator.uncertainty, setting_per_cut_volt(config))
    return Outcome(
        results=_results(found),
        tables=_tables(found, readings),
        figures=_figures(found),
        budget=found.budget,
        notes=_notes(found, plan.converters, config.generator.uncertainty),
        verdict_values=_verdict_values(found),
    )


def _json(estimate: Estimate | None) -> dict[str, Any] | None:
    return None if estimate is None else estimate.as_json()


def _results(found: Characterization) -> dict[str, Any]:
    return {
        "gain_codes": [_code_json(one) for one in found.codes],
        "best_code": found.best_code,
        "clock_ppm": _json(found.clock_ppm),
        "interleave": {
            "gain": _json(found.interleave.gain),
            "offset_v": _json(found.interleave.offset_v),
            "skew_s": _json(found.interleave.skew_s),
        },
        "gain_by_amplitude": [
            {
                "code": row.code,
                "amplitude_vpp": row.amplitude_vpp,
                "sine_fit": Estimate(row.sine_fit, row.sine_fit_u, "1").as_json(),
                "rms": row.rms,
                "peak_to_peak": row.peak_to_peak,
                "points": row.count,
            }
            for row in found.small_signal
        ],
        "points": _counted(found),
    }


def _code_json(one: CodeResult) -> dict[str, Any]:
    return {
        "code": one.code,
        "gain": _json(one.gain),
        "cutoff": _json(one.cutoff),
        "highpass": _json(one.highpass),
        "order": {
            "free": _json(one.order_free),
            "integer": round(one.fit.order) if one.fit is not None and one.fit.status == "ok" else None,
        },
        "noise_rms": _json(one.noise),
        "noise_rms_total": _json(one.noise_total),
        "input_noise_rms": _json(one.input_noise),
        "fit": _chi_square(one.fit),
        "linearity": _chi_square(one.linearity),
        "status": one.status,
    }


def _chi_square(tested: ButterworthFit | Linearity | None) -> dict[str, Any] | None:
    if tested is None or tested.freedom < 1:
        return None
    return {"chi_square": tested.chi_square, "degrees_of_freedom": tested.freedom}


def _counted(found: Characterization) -> dict[str, int]:
    names, counts = np.unique(found.points.status, return_counts=True)
    return {str(name): int(count) for name, count in zip(names, counts, strict=True)}


def _tables(found: Characterization, readings: WindowReadings) -> dict[str, Table]:
    points = found.points
    columns = {
        "point_gain_code": (points.code, "1", "gain code, -1 where the receiver has none"),
        "point_amplitude_vpp": (points.amplitude_vpp, "V", "planned amplitude at the cut, peak to peak"),
        "point_played_vpp": (points.played_vpp, "V", "played amplitude at the cut, peak to peak"),
        "point_frequency_hz": (points.frequency_hz, "Hz", "frequency as played"),
        "point_gain": (_where(points.gain, points.usable), "1", "gain by the sine fit"),
        "point_gain_u": (_where(points.gain_u, points.usable), "1", "its statistical standard uncertainty"),
        "point_gain_rms": (points.gain_rms, "1", "gain from the rms of the record, noise included"),
        "point_gain_peak": (points.gain_peak, "1", "gain from the span of the record, noise included"),
        "point_status": (points.status, "1", "ok, or why the point is not used"),
    }
    return {
        "points": Table(columns, "point"),
        "codes": Table(_code_columns(found), "gain_code_row"),
        "spectrum": spectrum_table(readings.dark),
    }


def _where(values: np.ndarray, known: np.ndarray) -> np.ma.MaskedArray[Any, Any]:
    return np.ma.masked_array(np.where(known, values, 0.0), ~known)


def _code_columns(found: Characterization) -> dict[str, tuple[Any, str, str]]:
    columns: dict[str, tuple[Any, str, str]] = {
        "code": (np.array([-1 if one.code is None else one.code for one in found.codes]), "1", "gain code"),
        "code_status": (np.array([one.status for one in found.codes]), "1", "ok, or what is missing"),
    }
    for name, unit, words in (
        ("gain", "1", "pass-band gain, cut to converter"),
        ("cutoff", "Hz", "-3 dB frequency of the low-pass"),
        ("highpass", "Hz", "-3 dB frequency of the high-pass"),
        ("order_free", "1", "order of the low-pass, fitted as a real number"),
        ("noise", "V", "analog noise at the converter, rms"),
        ("noise_total", "V", "raw noise at the converter, rms"),
        ("input_noise", "V", "noise divided by gain, rms"),
    ):
        estimates = [getattr(one, name) for one in found.codes]
        known = np.array([one is not None for one in estimates])
        value = np.array([0.0 if one is None else one.value for one in estimates])
        spread = np.array([0.0 if one is None else one.standard_uncertainty for one in estimates])
        columns[f"code_{name}"] = (_where(value, known), unit, words)
        columns[f"code_{name}_u"] = (_where(spread, known), unit, f"standard uncertainty of: {words}")
    return columns


def _figures(found: Characterization) -> dict[str, Callable[[], Figure]]:
    from procedures import gain_figures

    return {
        "gain": lambda: gain_figures.gain_figure(found),
        "estimators": lambda: gain_figures.estimator_figure(found),
        "residuals": lambda: gain_figures.residual_figure(found),
    }


def _notes(found: Characterization, converters: int, declared: GeneratorUncertainty) -> list[str]:
    left_out = {name: count for name, count in _counted(found).items() if name != "ok"}
    mean = {1: "", 2: ", the mean of both converters"}.get(
        converters, f", the mean of {converters} converters"
    )
    notes = [
        f"Gain is from the cut to the converter{mean}; amplitudes are peak to peak at "
        "the cut. Gain and cut-off come from the fit of whole order over all usable amplitudes.",
        noise_note(converters),
        "A high-pass is reported when it is larger than four of its standard uncertainties (in its square).",
        "Not modelled: drift during the sweep, harmonic distortion, a filter that is not Butterworth. The "
        "residual figure shows them.",
    ]
    if found.clock_ppm is not None:
        notes.append("The clock error is relative to the generator's own reference, whose error is in it.")
    if declared == GeneratorUncertainty():
        notes.append(
            "No generator uncertainty is declared ([generator] uncertainty): the uncertainties hold for the "
            "scatter only."
        )
    bent = [one for one in found.codes if one.linearity is not None and not one.linearity.is_linear]
    if bent:
        codes = ", ".join(str(one.code) for one in bent if one.code is not None)
        notes.append(
            f"The receiver or the generator is not linear{codes and f' at gain code {codes}'}: gains at "
            "different amplitudes differ by more than chance and declared errors explain. The difference is "
            "in the uncertainties of gain and cut-off."
        )
    if left_out:
        listed = ", ".join(f"{count} {name}" for name, count in left_out.items())
        notes.append(f"Windows left out of the fits: {listed}.")
    return notes


def _verdict_values(found: Characterization) -> dict[str, list[tuple[str, Estimate | None]]]:
    def column(name: str) -> list[tuple[str, Estimate | None]]:
        return [
            ("all" if one.code is None else f"code {one.code}", getattr(one, name)) for one in found.codes
        ]

    return {
        "gain": column("gain"),
        "cutoff_hz": column("cutoff"),
        "highpass_hz": column("highpass"),
        "noise_rms_v": column("noise"),
        "input_noise_rms_v": column("input_noise"),
    }
