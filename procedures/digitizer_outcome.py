"""The outcome of a digitizer test: results as the contract names them, tables, figure, budget, notes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.config import GeneratorUncertainty
from belahil.outcome import Outcome, Table
from procedures.digitizer_summary import of_all_converters, shown_of_code

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from belahil.config import BenchConfig
    from belahil.outcome import Column, Number
    from belahil.values import Estimate
    from procedures.digitizer import DigitizerPlan
    from procedures.digitizer_points import DigitizerReadings, SinePoint
    from procedures.digitizer_summary import Converters


def outcome(plan: DigitizerPlan, readings: DigitizerReadings, config: BenchConfig) -> Outcome:
    """Make the outcome of what the windows told.

    Parameters
    ----------
    plan : DigitizerPlan
        What was measured.
    readings : DigitizerReadings
        From `procedures.digitizer_points.read_points`.
    config : BenchConfig
        Declared uncertainties.
    """
    found = of_all_converters(readings.points, plan.converters)
    by_code = [shown_of_code(readings.points, code) for code in plan.codes]
    return Outcome(
        results={
            "gain_codes": [
                {"code": code, **(_figures_of(one) if one else {**_NOTHING, "status": "no_signal"})}
                for code, one in zip(plan.codes, by_code, strict=True)
            ],
            "interleave": _converters(found),
            "clock_ppm": _json(readings.clock_ppm),
            "points": [{"code": one.code, **_figures_of(one)} for one in readings.points],
        },
        tables={"points": Table(_columns(readings.points), "point")},
        numbers=_numbers(readings, found),
        figures={"digitizer": lambda: _figure(readings, by_code, found)},
        notes=_notes(plan, readings, config.generator.uncertainty),
        verdict_values={
            name: [(_label(code), _of(one, part)) for code, one in zip(plan.codes, by_code, strict=True)]
            for name, part in (("enob", "enob"), ("sinad_db", "sinad"))
        },
    )


def _label(code: int | None) -> str:
    return "all" if code is None else f"code {code}"


def _of(point: SinePoint | None, part: str) -> Estimate | None:
    return None if point is None or point.quality is None else getattr(point.quality, part)


def _json(estimate: Estimate | None) -> dict[str, Any] | None:
    return None if estimate is None else estimate.as_json()


_ESTIMATES = ("level_dbfs", "gain", "offset")
_QUALITY = ("sinad", "enob", "snr", "noise_rms", "noise_floor")
_NOTHING: dict[str, Any] = {
    **dict.fromkeys(("frequency_hz", "amplitude_vpp", *_ESTIMATES, *_QUALITY)),
    **dict.fromkeys(("thd", "thd_at_most", "thd_status", "sfdr", "sfdr_at_least", "sfdr_status")),
    "interleave": {"gain": None, "offset_v": None, "skew_s": None},
}


def _figures_of(point: SinePoint) -> dict[str, Any]:
    quality, between = point.quality, point.interleave
    told = {
        **_NOTHING,
        "frequency_hz": point.frequency_hz,
        "amplitude_vpp": point.amplitude_vpp,
        **{name: _json(getattr(point, name)) for name in _ESTIMATES},
        "interleave": {name: _json(getattr(between, name)) for name in ("gain", "offset_v", "skew_s")},
        "records": point.records,
        "status": point.status,
    }
    if quality is None:
        return told
    return told | {
        **{name: _json(getattr(quality, name)) for name in _QUALITY},
        "thd": _json(quality.thd.value),
        "thd_at_most": quality.thd.bound,
        "thd_status": quality.thd.status,
        "sfdr": _json(quality.sfdr.value),
        "sfdr_at_least": quality.sfdr.bound,
        "sfdr_status": quality.sfdr.status,
    }


def _converters(found: Converters) -> dict[str, Any]:
    between = found.interleave
    return {
        "gain": _json(between.gain),
        "offset_v": _json(between.offset_v),
        "skew_s": _json(between.skew_s),
        "status": found.status,
    }


def _numbers(readings: DigitizerReadings, found: Converters) -> dict[str, Number]:
    between = "of two interleaved converters, even minus odd"
    return {
        "clock_ppm": (readings.clock_ppm, "1e-6", "relative error of the receiver's clock, above zero: fast"),
        "interleave_gain": (found.interleave.gain, "1", f"relative difference of the gains {between}"),
        "interleave_offset_v": (found.interleave.offset_v, "V", f"difference of the offsets {between}"),
        "interleave_skew_s": (found.interleave.skew_s, "s", f"difference of the sampling times {between}"),
    }


_OF_POINT = (
    ("level_dbfs", "dB", "peak at the converter, of half its span", lambda one: one.level_dbfs),
    ("gain", "1", "amplitude at the converter by that at the cut", lambda one: one.gain),
    ("offset", "V", "mean of the converters without a signal", lambda one: one.offset),
    ("sinad", "dB", "signal to noise and distortion", lambda one: _of(one, "sinad")),
    ("enob", "1", "effective number of bits", lambda one: _of(one, "enob")),
    ("snr", "dB", "signal to noise without harmonics", lambda one: _of(one, "snr")),
    ("thd", "dB", "total harmonic distortion", lambda one: one.quality and one.quality.thd.value),
    ("sfdr", "dB", "spurious-free dynamic range", lambda one: one.quality and one.quality.sfdr.value),
    ("noise", "V", "noise and quantization without lines, rms", lambda one: _of(one, "noise_rms")),
    ("interleave_gain", "1", "relative difference of gains", lambda one: one.interleave.gain),
    ("interleave_offset", "V", "difference of offsets", lambda one: one.interleave.offset_v),
    ("interleave_skew", "s", "difference of sampling times", lambda one: one.interleave.skew_s),
)


def _columns(points: tuple[SinePoint, ...]) -> dict[str, Column]:
    columns: dict[str, Column] = {
        "point_gain_code": (
            np.array([-1 if one.code is None else one.code for one in points]),
            "1",
            "gain code, -1 where the receiver has none",
        ),
        "point_frequency_hz": (np.array([one.frequency_hz for one in points]), "Hz", "frequency as played"),
        "point_played_vpp": (
            np.array([one.amplitude_vpp for one in points]),
            "V",
            "played amplitude at the cut, peak to peak",
        ),
        "point_status": (np.array([one.status for one in points]), "1", "ok, or why there are no figures"),
    }
    for name, unit, words, of in _OF_POINT:
        ones = [of(point) for point in points]
        missing = [one is None for one in ones]
        for ending, part, told in (
            ("", "value", words),
            ("_u", "standard_uncertainty", f"standard uncertainty of: {words}"),
        ):
            values = np.array([0.0 if one is None else getattr(one, part) for one in ones])
            columns[f"point_{name}{ending}"] = (np.ma.masked_array(values, missing), unit, told)
    return columns


def _notes(plan: DigitizerPlan, readings: DigitizerReadings, declared: GeneratorUncertainty) -> list[str]:
    notes = [
        "Figures after IEEE Std 1057-2017: SINAD, ENOB and SNR contain what differs between interleaved "
        "converters; THD counts harmonics 2 to 10. Of each gain code the point of the lowest frequency that "
        "reached the highest level is shown.",
        "Not modelled: distortion and noise of the generator, which count as the receiver's; INL and DNL; "
        "aperture jitter apart from other noise.",
    ]
    if declared == GeneratorUncertainty():
        notes.append(
            "No generator uncertainty is declared ([generator] uncertainty): that of a gain holds for the "
            "scatter only. The other figures do not depend on it."
        )
    left_out = [one.status for one in readings.points if one.status != "ok"]
    if left_out:
        listed = ", ".join(f"{left_out.count(name)} {name}" for name in dict.fromkeys(left_out))
        notes.append(f"Sines without figures: {listed}.")
    if plan.converters != 2:
        notes.append(f"The receiver has {plan.converters} converters: differences are told for two.")
    return notes


def _figure(readings: DigitizerReadings, by_code: list[SinePoint | None], found: Converters) -> Figure:
    from procedures.digitizer_figures import digitizer_figure

    return digitizer_figure(readings, [one for one in by_code if one is not None], found)
