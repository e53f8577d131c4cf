"""The outcome of a characterization: results as the contract names them, tables, figures, budget, notes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.bench import setting_per_cut_volt
from belahil.config import GeneratorUncertainty
from belahil.outcome import Outcome
from belahil.report.tables import one_text
from belahil.verdict import Check, not_measured
from procedures.gain_results import characterization
from procedures.gain_tables import integer_order, numbers, tables
from procedures.noise import noise_note

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.figure import Figure

    from belahil.config import BenchConfig
    from belahil.values import Estimate
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
    found = characterization(plan.codes, readings, config.generator, setting_per_cut_volt(config))
    return Outcome(
        results=_results(found),
        tables=tables(plan, found, readings),
        numbers=numbers(found),
        figures=_figures(found),
        budget=found.budget,
        conditions=_conditions(found),
        notes=_notes(found, plan.converters, config.generator.uncertainty),
        verdict_values=_verdict_values(found),
        checks=_checks(found),
    )


def _json(estimate: Estimate | None) -> dict[str, Any] | None:
    return None if estimate is None else estimate.as_json()


def _results(found: Characterization) -> dict[str, Any]:
    return {
        "gain_codes": [_code_json(one) for one in found.codes],
        "best_code": found.best_code,
        "best_code_runner_up": None
        if found.runner_up is None
        else {"code": found.runner_up.code, "difference": found.runner_up.difference.as_json()},
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
                "sine_fit": row.estimate.as_json(),
                "filter_u": row.filter_u,
                "rms": row.rms,
                "peak_to_peak": row.peak_to_peak,
                "points": row.count,
            }
            for row in found.by_amplitude
        ],
        "small_signal": {
            "cubic_per_v2": _json(found.small_signal.cubic_per_v2),
            "deadband_v": _json(found.small_signal.deadband_v),
            "status": found.small_signal.status,
        },
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
            "integer": integer_order(one),
        },
        "noise_rms": _json(one.noise),
        "noise_rms_total": _json(one.noise_total),
        "input_noise_rms": _json(one.input_noise),
        "fit": _chi_square(one.fit),
        "linearity": _chi_square(one.linearity),
        "small_signal": {
            "cubic_per_v2": _json(one.small_signal.cubic_per_v2),
            "deadband_v": _json(one.small_signal.deadband_v),
            "gain": _json(one.small_signal.gain),
            "cutoff": _json(one.small_signal.cutoff),
            "highpass": _json(one.small_signal.highpass),
            "chi_square": one.small_signal.chi_square,
            "degrees_of_freedom": one.small_signal.freedom,
            "status": one.small_signal.status,
        },
        "status": one.status,
    }


def _chi_square(tested: ButterworthFit | Linearity | None) -> dict[str, Any] | None:
    if tested is None or tested.freedom < 1:
        return None
    return {"chi_square": tested.chi_square, "degrees_of_freedom": tested.freedom}


def _counted(found: Characterization) -> dict[str, int]:
    names, counts = np.unique(found.points.status, return_counts=True)
    return {str(name): int(count) for name, count in zip(names, counts, strict=True)}


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
    notes += _of_small_signals(found)
    if found.runner_up is not None and found.runner_up.is_within:
        notes.append(
            f"Gain code {found.runner_up.code} is within the uncertainty of the best, {found.best_code}: "
            "its input-referred noise is larger by less than two standard uncertainties of the difference."
        )
    if left_out:
        listed = ", ".join(f"{count} {name}" for name, count in left_out.items())
        notes.append(f"Windows left out of the fits: {listed}.")
    return notes


def _of_small_signals(found: Characterization) -> list[str]:
    """Say what a dead zone and a cubic term explain of the gains at different amplitudes."""
    told = found.small_signal
    if told.status != "ok" or told.cubic_per_v2 is None or told.deadband_v is None:
        return []
    return [
        "A dead zone and a cubic term behind the filter explain how the gain depends on the amplitude: "
        f"{one_text(told.deadband_v.as_json())} and {one_text(told.cubic_per_v2.as_json())}, at the cut."
    ]


def _conditions(found: Characterization) -> dict[str, str]:
    played = np.unique(found.points.frequency_hz)
    return {"frequencies played": ", ".join(f"{one / 1e6:.14g}" for one in played) + " MHz"}


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


def _checks(found: Characterization) -> list[Check]:
    """Leave a run undecided that found no gain at all."""
    if any(one.gain is not None for one in found.codes):
        return []
    return [not_measured("gain", ", ".join(dict.fromkeys(one.status for one in found.codes)))]
