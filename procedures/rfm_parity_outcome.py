"""The outcome of a comparison with our range finder: results, tables, checks, figure, notes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.outcome import Outcome, Table
from belahil.values import Estimate
from belahil.verdict import Check, not_measured
from procedures.echo_agreement import COMPARISONS_TOGETHER, FALSE_ALARMS, FEWEST_DETECTED, LEVEL
from procedures.intervals import Interval, normal_factor

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from belahil.verdict import Decision
    from procedures.echo_agreement import Comparison, EchoAgreement
    from procedures.rfm_parity_results import EchoRow, Findings

QUANTITIES = (
    ("probability", "detection_probability", "1", "detection probability"),
    ("spread", "arrival_spread", "s", "standard deviation of the time from marker to echo"),
    ("apart", "echo_after_marker", "s", "mean time from marker to echo"),
)
"""Field of `EchoAgreement`, key of the results, unit, words."""


def outcome(found: Findings) -> Outcome:
    """Make the outcome of what was compared."""
    return Outcome(
        results={
            "status": found.status,
            "parity": _parity(found),
            "echoes": [_echo(one) for one in found.echoes],
            "together": _together(found),
        },
        tables=_tables(found),
        figures=_figures(found),
        conditions={"receiver taken for known": found.receiver.origin},
        notes=_notes(found),
        checks=list(_checks(found)) or [not_measured("windows_agreeing", found.status)],
    )


def _parity(found: Findings) -> dict[str, Any]:
    rows = found.compared
    pairs = [pair for row in rows for pair in row.pairs]
    largest = [max((abs(pair[at]) for pair in pairs), default=None) for at in range(4)]
    return {
        "windows": len(found.windows),
        "compared": len(rows),
        "agreeing": found.agreeing,
        "out_of_order": sum(not row.in_order for row in rows),
        "candidates": {
            name: sum(getattr(row, name) for row in rows) for name in ("matched", "missing", "extra")
        },
        "largest_difference": dict(
            zip(("arrival_s", "fwhm_s", "amplitude_v", "first_sample"), largest, strict=True)
        ),
        "samples_differing": sum(pair[4] for pair in pairs),
        "tolerances": {
            name: getattr(found.plan.tolerances, name)
            for name in ("arrival_s", "fwhm_relative", "amplitude_relative")
        },
    }


def _echo(row: EchoRow) -> dict[str, Any]:
    told: dict[str, Any] = {
        "fwhm_s": row.fwhm_s,
        "snr": row.snr,
        "code": row.code,
        "status": row.status,
        "windows": row.windows,
        "saturated": row.saturated,
        "unmarked": row.unmarked,
        "detected": 0 if row.measured is None else row.measured.detected,
    }
    for name, key, unit, _ in QUANTITIES:
        told[key] = _compared(None if row.agreement is None else getattr(row.agreement, name), name, unit)
    return told


def _together(found: Findings) -> dict[str, Any]:
    return {
        key: _compared(getattr(found.together, name), name, unit)
        for name, key, unit, _ in QUANTITIES[:COMPARISONS_TOGETHER]
    }


def _compared(one: Comparison | None, name: str, unit: str) -> dict[str, Any] | None:
    if one is None:
        return None
    return {
        "measured": estimate(one.measured, unit).as_json(),
        "interval": _ends(one.measured),
        "model": estimate(one.model, unit).as_json(),
        "model_interval": _ends(one.model),
        "measured_against_model": _ends(one.between),
        "measured_against_model_unit": "1" if name == "spread" else unit,
        "decision": one.decision,
    }


def estimate(one: Interval, unit: str) -> Estimate:
    """Return a value with the standard uncertainty that an interval of its width at 95 % means."""
    return Estimate(one.value, (one.high - one.low) / (2 * normal_factor(LEVEL)), unit)


def _ends(one: Interval) -> list[float]:
    return [one.low, one.high]


def _checks(found: Findings) -> Iterator[Check]:
    if found.status == "ok":
        share = found.agreeing / len(found.compared)
        same = found.agreeing == len(found.compared)
        yield Check("windows_agreeing", "all", 1.0, 1.0, Estimate(share, 0.0), "pass" if same else "fail")
    elif found.status != "no_samples":
        yield Check("windows_agreeing", found.status, 1.0, 1.0, None, "undecided")
    for row in found.echoes:
        if row.agreement is None:
            if found.plan.echoes or row.status in ("saturated", "no_candidates", "marker_lost"):
                # Of recorded windows nobody knows whether the marker was inside.
                lost = row.status == "marker_lost" and bool(found.plan.echoes)
                label = f"{name_of(row)}, {row.status}"
                decision: Decision = "fail" if lost else "undecided"
                yield Check("detection_probability_difference", label, -1.0, 1.0, None, decision)
            continue
        yield from _checked(row.agreement, name_of(row))
    yield from _checked(found.together, "all echoes")


def _checked(told: EchoAgreement, label: str) -> Iterator[Check]:
    for name, key, unit, _ in QUANTITIES:
        one: Comparison | None = getattr(told, name)
        if one is not None:
            limit, unit = ("arrival_spread_ratio", "1") if name == "spread" else (f"{key}_difference", unit)
            low, high = (float(f"{end:.4g}") for end in (one.low, one.high))  # as a reader wants them
            limit += "" if unit == "1" else f"_{unit}"
            yield Check(limit, label, low, high, estimate(one.between, unit), one.decision)


def name_of(row: EchoRow) -> str:
    """Name an echo in a few words."""
    code = "" if row.code is None else f", code {row.code}"
    if row.fwhm_s is None or row.snr is None:
        height = "" if row.echo_v is None else f" of {1e3 * row.echo_v:.3g} mV"
        return f"echo{height}{code}"
    return f"{1e9 * row.fwhm_s:.3g} ns, SNR {row.snr:.3g}{code}"


def _tables(found: Findings) -> dict[str, Table]:
    rows = found.windows
    none = np.array([not row.pairs for row in rows])
    arrivals = np.array([max((abs(pair[0]) for pair in row.pairs), default=0.0) for row in rows])
    windows = {
        "parity_status": (np.array([row.status for row in rows]), "1", "ok, or why the window is not"),
        "parity_matched": (np.array([row.matched for row in rows]), "1", "candidates found by both"),
        "parity_missing": (
            np.array([row.missing for row in rows]),
            "1",
            "candidates that were not reported, but found again",
        ),
        "parity_extra": (
            np.array([row.extra for row in rows]),
            "1",
            "candidates that were reported, but not found again",
        ),
        "parity_arrival_difference_s": (
            np.ma.masked_array(arrivals, none),
            "s",
            "largest difference of arrival between reported and found",
        ),
        "parity_samples_differing": (
            np.array([sum(pair[4] for pair in row.pairs) for row in rows]),
            "1",
            "samples of correlation windows that are not those of the window",
        ),
    }
    tables = {"parity": Table(windows, "shot")}
    return tables | ({"echoes": Table(_echo_columns(found), "echo")} if found.echoes else {})


def _echo_columns(found: Findings) -> dict[str, tuple[NDArray[Any], str, str]]:
    rows = found.echoes

    def numbers(values: list[float | None]) -> NDArray[Any]:
        return np.ma.masked_array(
            [0.0 if one is None else one for one in values], [one is None for one in values]
        )

    columns: dict[str, tuple[NDArray[Any], str, str]] = {
        "echo_fwhm_s": (numbers([row.fwhm_s for row in rows]), "s", "full width at the cut, as planned"),
        "echo_snr": (numbers([row.snr for row in rows]), "1", "height over the rms of the noise, as planned"),
        "echo_v": (numbers([row.echo_v for row in rows]), "V", "height at the converter without noise"),
        "echo_gain_code": (
            np.array([-1 if row.code is None else row.code for row in rows]),
            "1",
            "gain code, -1 where the receiver has none",
        ),
        "echo_windows": (np.array([row.windows for row in rows]), "1", "windows in which it was played"),
        "echo_detected": (
            np.array([0 if row.measured is None else row.measured.detected for row in rows]),
            "1",
            "windows in which it was among the candidates",
        ),
        "echo_status": (np.array([row.status for row in rows]), "1", "ok, or why it was not compared"),
    }
    for name, key, unit, words in QUANTITIES:
        ones = [None if row.agreement is None else getattr(row.agreement, name) for row in rows]
        for side, told in (("measured", words), ("model", f"{words}, by the model")):
            for end, ending in (
                ("value", ""),
                ("low", ", lower end at 95 %"),
                ("high", ", upper end at 95 %"),
            ):
                values = numbers([None if one is None else getattr(getattr(one, side), end) for one in ones])
                tail = "" if end == "value" else f"_{end}"
                columns[f"{key}{'_model' if side == 'model' else ''}{tail}"] = (values, unit, told + ending)
    return columns


def _figures(found: Findings) -> dict[str, Callable[[], Figure]]:
    def draw() -> Figure:
        from procedures.rfm_parity_figure import parity_figure

        return parity_figure(found)

    return {"rfm-parity": draw}


def _notes(found: Findings) -> list[str]:
    plan, within = found.plan, found.plan.tolerances
    notes = [
        f"Two candidates count as the same within {1e12 * within.arrival_s:g} ps of arrival and "
        f"{within.fwhm_relative:g} of width and {within.amplitude_relative:g} of amplitude; first samples "
        "and the samples of correlation windows must be equal.",
        "Intervals of the detection probability are those of Clopper and Pearson, which cover at least as "
        "often as they say; those of the standard deviation are chi-square with the kurtosis of the model's "
        "arrivals. The model's intervals contain what its gain, noise and cut-off are uncertain by.",
        "Intervals are at 95 %. A comparison is of measured minus model (for the spread, measured over "
        "model); allowed is what chance and what the model is uncertain by make of no difference, at a level "
        "at which a receiver that is as the model says fails any of them in at most "
        f"{FALSE_ALARMS:.0%} of runs.",
        "All echoes together are compared by their mean probability and their geometric mean spread.",
        f"Spread and mean of the arrival need {FEWEST_DETECTED} detected echoes.",
        "Not modelled: noise that is not stationary or not white before the filter, a receiver that is not "
        "linear, a trigger that jitters by more than a sample.",
    ]
    if found.status == "no_samples":
        notes.append(
            f"The receiver reports {plan.products} without the samples of the same window, so its search "
            "cannot be repeated; only the echoes tell."
        )
    if found.status == "no_candidates":
        notes.append("No window came with candidates, so there is nothing to compare the search with.")
    if found.status == "another_receiver":
        notes.append(
            "Sample interval, bits or converters of the windows are not those of the receiver that the bench "
            "file names: windows of another receiver are not compared."
        )
    return notes
