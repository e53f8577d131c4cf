"""Results, tables, figures and budget of a transmitted pulse."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.outcome import BudgetLine, Outcome, Table
from belahil.uncertainty import budget
from belahil.values import Estimate
from belahil.verdict import not_measured
from procedures.tx_definitions import MEANING, PUBLISHED, REFERENCES, Definition
from procedures.tx_families import FREE
from procedures.tx_misfit import LEVEL
from procedures.tx_picture import EquivalentTime, equivalent_time
from procedures.tx_terms import SHOWS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from procedures.known_receiver import KnownReceiver
    from procedures.tx_analysis import Interval, TxFound
    from procedures.tx_delay import TxPlan
    from procedures.tx_windows import PulseWindows

_WHY = {
    "no_pulse": "no pulse stands out of the noise in half of the windows",
    "saturated": "more than half of the windows are clipped",
    "equal_windows": "all windows are equal, count by count: they are one measurement, repeated or replayed",
    "mixed_gain_codes": "the windows have different gain codes; name one",
    "other_receiver": "sample interval, bits, gain code or scale are not those of the assumed receiver",
    "pulse_cut_off": "the pulse is not all inside half of the windows; change their length or their delay",
    "too_few_samples": "the windows are too short for the pulse behind this receiver",
    "noise_not_known": "too few samples lie before the pulse to tell the noise, and nothing else tells it",
}
_MEANS = {
    "other_family": "another family fits better than a hard cut, by more than the uncertainties account for",
    "model_misfit": "what a hard cut leaves of the shape is more than the uncertainties account for",
    "residual_not_noise": "the reduced chi-square is not 1: a wrong shape, interference, or too little noise "
    "for the steps of the converter; the part of noise in the uncertainty is wrong as well",
    "threshold_not_seen": "without any cut the windows are described as well; the upper end is a limit",
    "threshold_weakly_determined": "the bound of the threshold is above 0.4 points",
    "no_gaussian_fit": "the detected pulse has no Gaussian fit, so there is no delay",
}
MEANINGS = _WHY | _MEANS
"""What each status but ``ok`` says, in words."""

NOT_MODELLED = (
    "Not modelled: a pulse whose shape changes from shot to shot, noise of the light, a receiver that "
    "depends on the amplitude, interference that is locked to the shot, and a wrong shape that looks like "
    "another threshold, for which only the model terms stand."
)


def nothing_found(windows: PulseWindows, plan: TxPlan, receiver: KnownReceiver) -> Outcome:
    """Return the outcome of windows that cannot be analysed."""
    return Outcome(
        results={
            "status": windows.status,
            "statuses": [windows.status],
            "gain_code": windows.gain_code,
            "windows": windows.counted,
            "threshold": None,
            "threshold_interval": None,
            "delay": None,
            "delay_interval": None,
            "definition": plan.definition,
        },
        conditions=_conditions(plan, receiver),
        notes=[f"{windows.status}: {_WHY[windows.status]}.", NOT_MODELLED],
        checks=[not_measured("threshold", windows.status)],
    )


def outcome(found: TxFound, windows: PulseWindows, plan: TxPlan, receiver: KnownReceiver) -> Outcome:
    """Return the outcome of windows that were analysed."""
    picture = equivalent_time(found)
    delay = None if found.delays is None else found.delays[plan.definition]
    return Outcome(
        results=_results(found, windows, plan, receiver, delay),
        tables=_tables(found, windows, picture),
        numbers={
            "tx_threshold": (_estimate(found.threshold, "1"), "1", "threshold of a hard cut, of the peak"),
            "tx_delay": (_estimate(delay, "s"), "s", MEANING[plan.definition]),
        },
        figures={"tx-delay": lambda: _figure(found, picture)},
        budget=_budget(found, plan.definition),
        conditions=_conditions(plan, receiver),
        notes=[*(f"{one}: {_MEANS[one]}." for one in found.statuses if one in _MEANS), *_notes(found)],
    )


def _conditions(plan: TxPlan, receiver: KnownReceiver) -> dict[str, str]:
    cutoff, pulse = receiver.cutoff, plan.pulse
    return {
        "receiver assumed": f"{receiver.origin}: order {receiver.order}, cut-off "
        f"{cutoff.value / 1e6:.6g} MHz with a standard uncertainty of "
        f"{cutoff.standard_uncertainty / 1e3:.3g} kHz, "
        + (f"high-pass {receiver.highpass_hz:g} Hz" if receiver.highpass else "no high-pass"),
        "pulse assumed before the fibre": f"{pulse.words}; relative uncertainty {pulse.fall_relative:g} of "
        f"the fall, {pulse.rise_relative:g} of the rise, {pulse.shape_relative:g} of the power",
        "baseline": "one level for all windows" if plan.baseline == "common" else "free in each window",
    }


def _notes(found: TxFound) -> list[str]:
    left = found.misfit
    told = (
        "The result rests on the assumed pulse and receiver: its uncertainty holds "
        f"{found.statistical * 100:.2g} points of noise (the bound is {found.bound * 100:.2g}), and "
        + ", ".join(f"{one.threshold_uncertainty * 100:.2g} of {one.source}" for one in found.terms)
        + "."
    )
    shape = (
        f"The shape that is left explains {left.gain:.3g} in chi-square with "
        f"{left.freedom} degrees of freedom"
    )
    if left.shows:
        within = "more than" if left.beyond_terms else "no more than"
        like = left.looks_like.replace("_", " ")
        shape += (
            f" (by chance in {left.probability:.1g} of all cases), {within} the assumed uncertainties allow; "
            f"it looks most like {like}, {left.size:.3g} +- {left.size_uncertainty:.2g}"
        )
    return [
        told,
        f"{shape}. A departure from the model with an expected gain below {SHOWS:g} may stay unseen.",
        "The Gaussian of a single shot scatters about the mean delay with the place of the pulse between two "
        "samples.",
        NOT_MODELLED,
    ]


def _results(
    found: TxFound, windows: PulseWindows, plan: TxPlan, receiver: KnownReceiver, delay: Interval | None
) -> dict[str, Any]:
    gain = receiver.at(windows.gain_code).gain
    peaks_v = found.fits.amplitude_v / gain.value
    scatter_v = float(np.std(peaks_v, ddof=1)) if peaks_v.size > 1 else 0.0
    # Noise scatters a fitted height by the height over the root of the chi-square that it explains.
    of_noise = float(np.mean(1 / np.maximum(found.fits.explained, 1.0)))
    mean_v = float(np.mean(peaks_v))
    declared_v = mean_v * gain.standard_uncertainty / gain.value
    peak_u = float(np.hypot(scatter_v / np.sqrt(peaks_v.size), declared_v))
    return {
        "status": found.statuses[0],
        "statuses": list(found.statuses),
        "gain_code": windows.gain_code,
        "windows": windows.counted,
        "threshold": _json(found.threshold, "1"),
        "threshold_interval": _ends(found.threshold),
        "threshold_bound": found.bound if np.isfinite(found.bound) else None,
        "threshold_noise_uncertainty": found.statistical,
        "delay": _json(delay, "s"),
        "delay_interval": _ends(delay),
        "definition": plan.definition,
        "delays": _delays(found, plan),
        "families": _families(found),
        "preferred_family": found.preferred,
        "families_that_fit": found.that_fit,
        "joint": {
            "status": found.joint.status,
            "threshold": None if found.joint.threshold is None else found.joint.threshold.as_json(),
            "cutoff": None if found.joint.cutoff is None else found.joint.cutoff.as_json(),
        },
        "misfit": _misfit(found),
        "reduced_chi_square": found.reduced_chi_square,
        "model_terms": [
            {
                "source": one.source,
                "standard_uncertainty": one.uncertainty,
                "unit": one.unit,
                "threshold_standard_uncertainty": one.threshold_uncertainty,
                "delay_standard_uncertainty_s": one.delay_uncertainty_s(plan.definition)
                if plan.definition in one.delay_s
                else None,
                "expected_gain": one.gain,
            }
            for one in found.terms
        ],
        "noise_rms": Estimate(windows.noise_rms_v, windows.noise_rms_u_v, "V").as_json(),
        "peak": Estimate(mean_v, peak_u, "V").as_json(),
        "peak_scatter": float(np.sqrt(max((scatter_v / mean_v) ** 2 - of_noise, 0.0))) if mean_v else None,
    }


def _misfit(found: TxFound) -> dict[str, Any]:
    left = found.misfit
    return {
        "shows": left.shows,
        "beyond_model_terms": left.beyond_terms,
        "chi_square_gain": left.gain,
        "freedom": left.freedom,
        "probability": left.probability,
        "probability_within_model_terms": left.probability_within_terms,
        "level": LEVEL,
        "looks_like": left.looks_like or None,
        "size": left.size if left.looks_like else None,
        "size_standard_uncertainty": left.size_uncertainty if left.looks_like else None,
    }


def _families(found: TxFound) -> list[dict[str, Any]]:
    hard = found.hard
    return [
        {
            "family": name,
            "free_parameters": FREE[name],
            "log_likelihood_ratio": (one.merit - hard.merit) / 2,
            "criterion_difference": one.criterion - hard.criterion,
            "threshold": one.threshold,
            "width": one.width,
            "fall": one.fall,
            "centre_minus_peak_s": found.family_centres_s[name],
        }
        for name, one in found.families.items()
    ]


def _delays(found: TxFound, plan: TxPlan) -> list[dict[str, Any]]:
    return [
        {
            "definition": one,
            "meaning": MEANING[one],
            "delay": _json(late, "s"),
            "delay_interval": _ends(late),
            "published": [
                {
                    "laser": laser,
                    "threshold": threshold,
                    "delay_s": published_s,
                    "reference_needed_s": late.value - published_s,
                    "fall_needed": {
                        reference: _fall(found.needed_falls[laser][one][reference], plan)
                        for reference in REFERENCES
                    },
                }
                for laser, (threshold, published_s) in PUBLISHED.items()
            ],
        }
        for one, late in (found.delays or {}).items()
    ]


def _fall(factor: float | None, plan: TxPlan) -> dict[str, float] | None:
    """Factor on the fall, and the time constant that this is where the pulse has one."""
    if factor is None:
        return None
    if plan.pulse.times_s or not plan.pulse.tail_s:
        return {"factor": factor}
    return {"factor": factor, "tail_s": factor * plan.pulse.tail_s}


def _budget(found: TxFound, definition: Definition) -> list[BudgetLine]:
    of_threshold = {"noise": found.statistical}
    of_threshold |= {one.source: one.threshold_uncertainty for one in found.terms}
    lines = budget("threshold", "1", of_threshold)
    if found.delays is not None:
        terms = {one.source: one.delay_uncertainty_s(definition) for one in found.terms if one.delay_s}
        lines += budget("delay", "s", {"noise": found.delay_noise_s[definition], **terms})
    return lines


def _tables(found: TxFound, windows: PulseWindows, picture: EquivalentTime) -> dict[str, Table]:
    assert windows.grid is not None
    interval_s = windows.grid.sample_interval_s
    arrival_s = (windows.first + windows.grid.before + found.fits.arrival) * interval_s
    return {
        "windows": Table(
            {
                "tx_shot": (windows.shots, "1", "index of the shot"),
                "tx_arrival": (arrival_s, "s", "peak of the light in the fit, after the first sample"),
                "tx_peak": (
                    found.fits.amplitude_v,
                    "V",
                    "height before the cut in the fit, at the converter",
                ),
            },
            "tx_shot",
        ),
        "equivalent_time": Table(
            {
                "tx_time": (picture.times_s, "s", "time after the peak of the light"),
                "tx_hard_cut": (picture.hard, "1", "fitted pulse, hard cut, of the height before the cut"),
                "tx_uncut": (picture.uncut, "1", "the pulse without a cut, scaled to the same peak"),
            },
            "tx_time",
        ),
        "likelihood": Table(
            {
                "tx_tried": (picture.thresholds, "1", "threshold that was tried"),
                "tx_log_likelihood": (picture.log_likelihood, "1", "log-likelihood less its maximum"),
            },
            "tx_tried",
        ),
    }


def _estimate(one: Interval | None, unit: str) -> Estimate | None:
    return None if one is None else Estimate(one.value, one.standard_uncertainty, unit)


def _json(one: Interval | None, unit: str) -> dict[str, Any] | None:
    found = _estimate(one, unit)
    return None if found is None else found.as_json()


def _ends(one: Interval | None) -> dict[str, float] | None:
    return None if one is None else {"low": one.low, "high": one.high, "coverage": 0.95}


def _figure(found: TxFound, picture: EquivalentTime) -> Figure:
    from procedures.tx_figure import tx_figure

    return tx_figure(found, picture)
