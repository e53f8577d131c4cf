"""The outcome of a test of the time of flight: results for JSON, tables, numbers and notes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.outcome import Outcome, Table
from belahil.values import Estimate
from belahil.verdict import Check, disagreement, not_measured
from procedures.pulse_pairs import PulsePair, counted
from procedures.range_reduction import HALF_LIGHT_M_PER_S
from procedures.tof_results import TofResults

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from procedures.known_receiver import KnownReceiver
    from procedures.tof_fit import TofFit


def outcome(pairs: list[PulsePair], receiver: KnownReceiver, *, mixed: bool = False) -> Outcome:
    """Bring everything into the form that a run keeps; `mixed` as in `TofResults`."""
    found = TofResults(pairs, receiver, mixed)
    clock = None if found.fit is None else found.fit.scale_ppm
    return Outcome(
        results=_results(found),
        tables=_tables(found),
        numbers={
            "clock_ppm": (clock, "1e-6", "relative error of the receiver's clock, above zero: fast"),
        },
        figures={"tof-linearity": lambda: _figure(found)} if found.status == "ok" else {},
        notes=[
            "The scale is relative to the time base of the generator, whose own error is not in its "
            "uncertainty.",
            "Delays are against the first pulse; a fitted centre is compared with the centroid of the pulse "
            "as it was played.",
            "Not modelled: overlapping pulses, jitter of the generator, a clock that changes in a window.",
        ],
        checks=_checks(found),
    )


def _checks(found: TofResults) -> list[Check]:
    if found.status != "ok":
        return [not_measured("clock_ppm", found.status)]
    told = found.agreement
    if told is None:
        return []
    return disagreement("delays of the known receiver", told["chi_square"], told["degrees_of_freedom"])


def _results(found: TofResults) -> dict[str, Any]:
    fit = found.fit
    results: dict[str, Any] = {
        "status": found.status,
        "clock_ppm": None if fit is None else fit.scale_ppm.as_json(),
        "wobble": [],
        "range_walk": [],
        "agreement": found.agreement if fit else None,
        "linearity": None,
        "fit": None,
        "points": counted(found.pairs),
    }
    if fit is None:
        return results
    results["wobble"] = [_wobble(found, fit, number) for number in range(len(found.width_pulses))]
    results["range_walk"] = [_walk(found, fit, kind) for kind in range(len(found.kind_pulses))]
    distance_s, worst = max(
        found.residual_bins, key=lambda one: abs(one[1].value) / one[1].standard_uncertainty
    )
    results["linearity"] = {
        "distance_s": distance_s,
        "residual": worst.as_json(),
        "chi_square": sum((one.value / one.standard_uncertainty) ** 2 for _, one in found.residual_bins),
        "bins": len(found.residual_bins),
    }
    results["fit"] = {
        "chi_square": fit.chi_square,
        "degrees_of_freedom": fit.degrees_of_freedom,
        "birge": fit.birge,
    }
    return results


def _wobble(found: TofResults, fit: TofFit, number: int) -> dict[str, Any]:
    pulse = found.width_pulses[number]
    expected = found.width_delays_s[number]
    mine = found.widths == number
    detected = [
        pulse.fwhm_s
        for pair, row in zip(found.usable, mine, strict=True)
        for pulse, own in zip(pair.detected, row, strict=True)
        if own
    ]
    return {
        "width_s": pulse.width_s,
        "detected_width_s": float(np.mean(detected)),
        "rms": fit.wobble_rms(number).as_json() if fit.wobble.any() else None,
        "expected_rms_s": float(np.std(expected)) if expected.size else None,
    }


def _walk(found: TofResults, fit: TofFit, kind: int) -> dict[str, Any]:
    pulse, delay = found.kind_pulses[kind], fit.delays[kind]
    expected_s = float(found.expected_s[kind])
    by_amplitude = found.by_amplitude(kind)
    return {
        "width_s": pulse.width_s,
        "peak_v": pulse.peak_v,
        "delay": delay.as_json(),
        "expected_s": expected_s if math.isfinite(expected_s) else None,
        "by_amplitude": None if by_amplitude is None else by_amplitude.as_json(),
        "range": Estimate(
            HALF_LIGHT_M_PER_S * delay.value, HALF_LIGHT_M_PER_S * delay.standard_uncertainty, "m"
        ).as_json(),
        "pairs": int(np.count_nonzero(found.kinds[:, 1] == kind)),
    }


def _tables(found: TofResults) -> dict[str, Table]:
    pairs = found.pairs
    if not pairs:
        return {}
    ok = np.array([one.status == "ok" for one in pairs])

    def column(values: list[float]) -> Any:
        whole = np.zeros(len(pairs))
        whole[ok] = values
        return np.ma.masked_array(whole, ~ok)

    columns = {
        "tof_shot": (np.array([one.shot for one in pairs]), "1", "shot that the pair was read from"),
        "tof_status": (
            np.array([one.status for one in pairs], dtype=np.str_),
            "1",
            "ok, or why the pair is not used",
        ),
        "tof_distance_s": (column(list(found.distance_s)), "s", "from one played pulse to the other"),
        "tof_excess_s": (column(list(found.excess_s)), "s", "measured less played distance"),
        "tof_excess_u_s": (
            column([math.hypot(*one.arrival_u_s) for one in found.usable]),
            "s",
            "its standard uncertainty by the noise of the window",
        ),
    }
    for number, name in enumerate(("first", "second")):
        for what, unit, text in (
            ("arrival_s", "s", "fitted arrival after the first sample"),
            ("fwhm_s", "s", "detected full width at half maximum"),
            ("amplitude_v", "V", "detected height at the converter"),
        ):
            values = [getattr(one.detected[number], what) for one in found.usable]
            columns[f"tof_{name}_{what}"] = (column(values), unit, f"{text} of the {name} pulse")
        for what, unit, text in (("width_s", "s", "width"), ("peak_v", "V", "peak at the cut")):
            values = [getattr(one.played[number], what) for one in found.usable]
            columns[f"tof_{name}_played_{what}"] = (
                column(values),
                unit,
                f"played {text} of the {name} pulse",
            )
    if found.fit is not None:
        columns["tof_residual_s"] = (column(list(found.fit.residual_s)), "s", "what the fit leaves")
    return {"tof_pair": Table(columns, "tof_pair")}


def _figure(found: TofResults) -> Figure:
    from procedures.tof_figure import tof_figure

    return tof_figure(found)
