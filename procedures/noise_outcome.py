"""The outcome of a noise measurement: results as the contract names them, tables, figures, notes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.outcome import Outcome, Table
from belahil.values import Estimate
from procedures.noise import noise_note

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from belahil.outcome import Column
    from procedures.dark_noise import DarkNoise
    from procedures.gaussianity import Gaussianity
    from procedures.known_receiver import KnownReceiver
    from procedures.noise import NoisePlan
    from procedures.noise_results import CodeNoise, Condition, NoiseResults
    from procedures.shot_locked import ShotLocked


def outcome(plan: NoisePlan, found: NoiseResults, known: KnownReceiver) -> Outcome:
    """Make the outcome of what the windows told.

    Parameters
    ----------
    plan : NoisePlan
        What was measured.
    found : NoiseResults
        From `procedures.noise_results`.
    known : KnownReceiver
        Whose gains were used.
    """
    runner_up = found.runner_up
    return Outcome(
        results={
            "gain_codes": [_code_json(one) for one in found.codes],
            "best_code": found.best_code,
            "best_code_runner_up": None
            if runner_up is None
            else {"code": runner_up[0], "difference": runner_up[1].as_json()},
        },
        tables=_tables(plan, found),
        figures={"noise": lambda: _figure(found)},
        conditions={"gains": known.origin},
        notes=_notes(plan, found, known),
        verdict_values={
            "noise_rms_v": [
                (label, rms)
                for one in found.codes
                for label, rms in (
                    (_label(one.code), one.off.rms),
                    *([(f"{_label(one.code)}, firing", one.firing.rms)] if one.firing else []),
                )
            ],
            "input_noise_rms_v": [(_label(one.code), one.input_combined) for one in found.codes],
        },
    )


def _label(code: int | None) -> str:
    return "all" if code is None else f"code {code}"


def _json(estimate: Estimate | None) -> dict[str, Any] | None:
    return None if estimate is None else estimate.as_json()


def _code_json(one: CodeNoise) -> dict[str, Any]:
    return {
        "code": one.code,
        **_condition_json(one.off),
        "input_noise_rms": _json(one.input_off),
        "firing": None
        if one.firing is None
        else {**_condition_json(one.firing), "burst": _burst_json(one.firing.locked)},
        "combined_noise_rms": _json(one.combined),
        "combined_input_noise_rms": _json(one.input_combined),
    }


def _condition_json(one: Condition) -> dict[str, Any]:
    return {
        "noise_rms": _json(one.rms),
        "noise_rms_total": one.dark.rms_total.as_json(),
        "offset_difference": _json(one.dark.offset_difference),
        "gaussianity": _gaussianity_json(one.gaussianity),
        "lines": [{"frequency": _json(line.frequency), "rms": _json(line.rms)} for line in one.lines],
        "windows": one.dark.window_count,
        "status": one.dark.status,
    }


def _gaussianity_json(one: Gaussianity | None) -> dict[str, Any] | None:
    if one is None:
        return None
    return {
        "p_value": one.p_value,
        "skewness": one.skewness.as_json(),
        "excess_kurtosis": one.excess_kurtosis.as_json(),
        "status": one.status,
    }


def _burst_json(one: ShotLocked | None) -> dict[str, Any] | None:
    if one is None:
        return None
    return {
        "p_value": one.p_value,
        **{
            name: _json(getattr(one, name))
            for name in ("locked_rms", "peak", "peak_at", "frequency", "decay")
        },
        "status": one.status,
    }


def _tables(plan: NoisePlan, found: NoiseResults) -> dict[str, Table]:
    ones = found.codes
    dark = {one.code: one.off.dark for one in ones}
    columns: dict[str, Column] = {
        "code": (np.array([-1 if one.code is None else one.code for one in ones]), "1", "gain code"),
        "code_noise_status": (np.array([one.off.dark.status for one in ones]), "1", "ok, or what is missing"),
        "code_noise_total": (np.array([one.off.dark.rms_total.value for one in ones]), "V", "raw noise, rms"),
    }
    for name, words, values in (
        ("noise", "analog noise at the converter, rms", [one.off.rms for one in ones]),
        (
            "noise_firing",
            "the same with the laser firing",
            [one.firing.rms if one.firing else None for one in ones],
        ),
        ("input_noise", "combined noise divided by gain, rms", [one.input_combined for one in ones]),
    ):
        missing = [one is None for one in values]
        for ending, part, told in (
            ("", "value", words),
            ("_u", "standard_uncertainty", "its standard uncertainty"),
        ):
            numbers = np.array([0.0 if one is None else getattr(one, part) for one in values])
            columns[f"code_{name}{ending}"] = (np.ma.masked_array(numbers, missing), "V", told)
    tables = {"codes": Table(columns, "code"), **spectrum_tables(dark)}
    words = "1 where the receiver's shot pulse started the window and fired the laser"
    tables["plan"] = Table({"laser_firing": (np.array(found.firing), "1", words)}, "shot")
    fired = [one.firing.dark.density_v2_per_hz for one in ones if one.firing]
    if len(fired) == len(ones):
        words = "one-sided noise density at the converter with the laser firing"
        columns = {"noise_density_firing": (np.stack(fired), "V2 Hz-1", words)}
        tables["firing"] = Table(columns, "code", "noise_frequency")
    locked = [one.firing.locked if one.firing else None for one in ones]
    if any(one is not None for one in locked):
        mean = np.array([np.zeros(plan.sample_count) if one is None else one.mean_v for one in locked])
        hidden = np.repeat([[one is None] for one in locked], plan.sample_count, axis=1)
        words = "mean of the windows with the laser firing, converter offsets taken out"
        tables["locked"] = Table(
            {"locked_mean": (np.ma.masked_array(mean, hidden), "V", words)}, "code", "locked_sample"
        )
    return tables


def spectrum_tables(found: dict[int | None, DarkNoise]) -> dict[str, Table]:
    """Return frequencies and noise densities by code as tables for the data file."""
    frequency_hz = next(iter(found.values())).frequency_hz
    density = np.stack([one.density_v2_per_hz for one in found.values()])
    words = "one-sided noise density at the converter"
    return {
        "noise_frequency": Table(
            {"noise_frequency": (frequency_hz, "Hz", "frequency of noise_density")}, "noise_frequency"
        ),
        "noise_density": Table({"noise_density": (density, "V2 Hz-1", words)}, "code", "noise_frequency"),
    }


def _notes(plan: NoisePlan, found: NoiseResults, known: KnownReceiver) -> list[str]:
    notes = [
        noise_note(plan.converters),
        f"Noise at the input is that at the converter divided by the gain of: {known.origin}.",
    ]
    if plan.receiver is None:
        notes.append(
            "Those gains are assumed to 1 %, not measured: --receiver takes them from a run of characterize."
        )
    unknown = [str(one.code) for one in found.codes if one.gain is None]
    if unknown:
        notes.append(
            f"Gain code {', '.join(unknown)}: no gain is known, so no noise at the input. A receiver "
            "that samples at another interval is another one: name its own with --bench or --receiver."
        )
    if any(one.firing for one in found.codes):
        notes.append(
            "Windows with the laser firing start with the receiver's shot pulse. The combined noise, by "
            "which the best code is chosen, is theirs; what is locked to the shot is in it."
        )
    else:
        notes.append("The laser did not fire: interference that follows its shots is not in these numbers.")
    bursts = [
        one.code
        for one in found.codes
        if one.firing and one.firing.locked and one.firing.locked.status == "ok"
    ]
    if bursts:
        where = ", ".join(str(code) for code in bursts if code is not None)
        notes.append(f"A burst is locked to the shot{where and f' at gain code {where}'}.")
    odd = [
        one.code
        for one in found.codes
        if one.off.gaussianity is not None and one.off.gaussianity.status != "ok"
    ]
    if odd:
        where = ", ".join(str(code) for code in odd if code is not None)
        notes.append(f"The dark noise is not Gaussian{where and f' at gain code {where}'}.")
    lacking = [str(one.code) for one in found.codes if one.off.rms is not None and one.input_off is None]
    if lacking:
        notes.append(
            f"The gain at gain code {', '.join(lacking)} is not known, so that it is not among those of "
            "which the best is named."
        )
    near = found.runner_up
    if near is not None and near[1].value <= 2 * near[1].standard_uncertainty:
        notes.append(
            f"Gain code {near[0]} is within the uncertainty of the best, {found.best_code}: its "
            "input-referred noise is larger by less than two standard uncertainties of the difference."
        )
    notes.append(
        "Not modelled: noise that drifts during the measurement, bursts that change from shot to shot, and "
        "lines whose frequency moves."
    )
    return notes


def _figure(found: NoiseResults) -> Figure:
    from procedures.noise_figure import noise_figure

    return noise_figure(found)
