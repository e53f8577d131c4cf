"""The results of a characterization as tables for the data file."""

from __future__ import annotations

from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.outcome import Table
from belahil.stimuli import Sine
from procedures.noise_outcome import spectrum_tables

if TYPE_CHECKING:
    from belahil.outcome import Number
    from procedures.characterize import GainPlan
    from procedures.gain_points import WindowReadings
    from procedures.gain_results import Characterization, CodeResult


def integer_order(one: CodeResult) -> int | None:
    """Return the whole order of a gain code; None where several fit, or none."""
    return round(one.fit.order) if one.fit is not None and one.fit.status == "ok" else None


def numbers(found: Characterization) -> dict[str, Number]:
    """Return what is one number for the whole sweep: clock and interleave."""
    interleave = found.interleave
    between = "of two interleaved converters, even minus odd"
    return {
        "clock_ppm": (found.clock_ppm, "1e-6", "relative error of the receiver's clock, above zero: fast"),
        "cubic_per_v2": (found.small_signal.cubic_per_v2, "V-2", "cubic term, at the cut behind the filter"),
        "deadband_v": (found.small_signal.deadband_v, "V", "dead zone, at the cut behind the filter"),
        "interleave_gain": (interleave.gain, "1", f"relative difference of the gains {between}"),
        "interleave_offset_v": (interleave.offset_v, "V", f"difference of the offsets {between}"),
        "interleave_skew_s": (interleave.skew_s, "s", f"difference of the sampling times {between}"),
    }


def tables(plan: GainPlan, found: Characterization, readings: WindowReadings) -> dict[str, Table]:
    """Return the tables of points, gain codes, noise densities, and of what was planned for each shot."""
    points = found.points
    planned = [one.stimulus.amplitude_vpp if isinstance(one.stimulus, Sine) else np.nan for one in plan.shots]
    words = "planned amplitude of a sine at the cut, peak to peak"
    columns = {
        "point_shot": (points.shot, "1", "shot that the point was read from"),
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
    # What somebody else planned for recorded windows is not known.
    known = {} if plan.recorded else {"planned_amplitude_vpp": (np.array(planned), "V", words)}
    return {
        "points": Table(columns, "point"),
        **({"plan": Table(known, "shot")} if known else {}),
        "codes": Table(_code_columns(found), "code"),
        **spectrum_tables(readings.dark),
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
        ("small_signal.gain", "1", "gain of signals that neither dead zone nor cubic term reaches"),
        ("small_signal.cutoff", "Hz", "-3 dB frequency of the low-pass in the fit with both"),
        ("small_signal.highpass", "Hz", "-3 dB frequency of the high-pass in the fit with both"),
    ):
        estimates = [attrgetter(name)(one) for one in found.codes]
        known = np.array([one is not None for one in estimates])
        value = np.array([0.0 if one is None else one.value for one in estimates])
        spread = np.array([0.0 if one is None else one.standard_uncertainty for one in estimates])
        column = f"code_{name.replace('.', '_')}"
        columns[column] = (_where(value, known), unit, words)
        columns[f"{column}_u"] = (_where(spread, known), unit, f"standard uncertainty of: {words}")
    told = np.array([one.small_signal.status for one in found.codes])
    columns["code_small_signal_status"] = (told, "1", "what the fit of dead zone and cubic term says")
    orders = [integer_order(one) for one in found.codes]
    order = np.ma.masked_array([one or 0 for one in orders], [one is None for one in orders])
    columns["code_order_integer"] = (order, "1", "whole order of the low-pass")
    for name in ("fit", "linearity"):
        tests = [getattr(one, name) for one in found.codes]
        known = np.array([one is not None and one.freedom > 0 for one in tests])
        value = np.array([one.chi_square if ok else 0.0 for one, ok in zip(tests, known, strict=True)])
        freedom = np.array([one.freedom if ok else 0 for one, ok in zip(tests, known, strict=True)])
        words = "fit of whole order" if name == "fit" else "gains by amplitude about their mean"
        columns[f"code_{name}_chi_square"] = (_where(value, known), "1", f"chi square: {words}")
        columns[f"code_{name}_freedom"] = (freedom, "1", f"degrees of freedom: {words}")
    return columns
