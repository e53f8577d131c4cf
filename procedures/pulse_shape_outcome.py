"""What a campaign of played echoes hands over: results, tables, checks, figures, notes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.outcome import BudgetLine, Outcome
from belahil.uncertainty import sized
from belahil.values import Estimate
from belahil.verdict import Check, decide
from procedures.pulse_shape_plan import trigger_late_s
from procedures.pulse_shape_tables import tables

if TYPE_CHECKING:
    from collections.abc import Iterator

    from matplotlib.figure import Figure

    from belahil.config import BenchConfig
    from procedures.pulse_shape_plan import PulseShapePlan
    from procedures.pulse_shape_results import CaseResult, Compared, Tested

_NAMES = {
    "cutoff_hz": "cutoff",
    "highpass_hz": "highpass",
    "output": "bandwidth",
    "interleave_skew_s": "interleave_skew",
}
"""What the moved numbers are called in the results; a pull has no unit."""


def outcome(plan: PulseShapePlan, found: Compared, config: BenchConfig) -> Outcome:
    """Put together what `procedures.pulse_shape.analyse` returns."""
    return Outcome(
        results={
            "verdict": found.verdict,
            "shot_noise": plan.shot_noise,
            "receiver": found.receiver.origin,
            "attenuation_db": {"fitted": config.generator.attenuation_db, "advised": plan.advised_db},
            "cases": [_case(one, config) for one in found.cases],
            "noise": [
                {
                    "code": code,
                    "rms": _estimate(noise.rms_v, noise.rms_v * noise.relative_u / 2, "V"),
                    "samples": noise.samples,
                    "status": noise.status,
                }
                for code, noise in found.noise.items()
            ],
        },
        tables=tables(found),
        figures=_figures(found),
        budget=list(_budget(found)),
        notes=list(_notes(plan, found, config)),
        checks=[
            Check("tests_failed", one.case.name, 0, 0, failed, decide(0, 0, failed))
            for one in found.cases
            for failed in [_failed(one)]
        ],
        verdict_values={
            "reduced_chi_square": [(one.case.name, one.level(one.played)) for one in found.cases]
        },
    )


def _failed(one: CaseResult) -> Estimate | None:
    """How many of the three tests say that the prediction differs: a whole number, known for certain."""
    return Estimate(len(one.played.failed), 0.0) if one.status == "ok" and one.played else None


def _estimate(value: float, uncertainty: float, unit: str) -> dict[str, Any] | None:
    return Estimate(value, uncertainty, unit).as_json() if math.isfinite(uncertainty) else None


def _case(one: CaseResult, config: BenchConfig) -> dict[str, Any]:
    case, echo = one.case, one.case.echo
    judged = one.status == "ok" and one.played is not None
    return {
        "name": case.name,
        "altitude_m": echo.altitude_m if echo else None,
        "slope_deg": echo.slope_deg if echo else None,
        "azimuth_deg": echo.azimuth_deg if echo else None,
        "gain_code": case.gain_code,
        "windows": one.windows,
        "peak_v": one.peak_v if one.played else None,
        "setting_vpp": min((pulse.setting_vpp for pulse in case.pulses), default=None),
        "converter_range": min((pulse.full_range for pulse in case.pulses), default=None),
        "played": _tests(one.played) if judged and one.played else None,
        "wished": _tests(one.wished) if judged and one.wished else None,
        "residual_rms": _residual_rms(one),
        "residual_largest_counts": _largest_counts(one),
        "trigger_delay": _delay(one, config),
        "verdict": one.verdict,
        "status": one.status,
    }


def _tests(tested: Tested) -> dict[str, Any]:
    fit = tested.fit
    return {
        "reduced_chi_square": Estimate(tested.reduced, tested.level_u).as_json(),
        "degrees_of_freedom": fit.freedom,
        "delays": "free" if fit.placement.is_free else "spread",
        "adjusted_chi_square": fit.adjusted,
        "pulls": {_NAMES.get(name, name): pull for name, pull in fit.pulls.items()},
        "shape_chi_square": fit.shape,
        "shape_degrees_of_freedom": fit.shape_freedom,
        "failed": list(tested.failed),
        "verdict": tested.verdict,
    }


def _residual_rms(one: CaseResult) -> dict[str, Any] | None:
    """Rms of the residuals; its uncertainty from the scatter between windows."""
    if one.played is None:
        return None
    squares = np.mean(one.played.fit.residual_v**2, axis=1)
    rms_v = math.sqrt(float(squares.mean()))
    u_v = float(squares.std(ddof=1)) / math.sqrt(squares.size) / (2 * rms_v) if rms_v else 0.0
    return _estimate(rms_v, u_v, "V")


def _largest_counts(one: CaseResult) -> float | None:
    if one.played is None:
        return None
    return float(np.max(np.abs(one.played.fit.residual_v))) / one.count_v


def _delay(one: CaseResult, config: BenchConfig) -> dict[str, Any] | None:
    """Mean of the found places about the middle of the sample in which the trigger is expected."""
    if one.played is None or one.status not in ("ok", "noise_no_signal", "noise_below_dither"):
        return None
    late_s = one.played.fit.late_s
    return _estimate(float(late_s.mean()), float(late_s.std(ddof=1)) / math.sqrt(late_s.size), "s")


def _figures(found: Compared) -> dict[str, Any]:
    drawn = [one for one in found.cases if one.played is not None]

    def pulse() -> Figure:
        from procedures.pulse_shape_figures import pulse_figure

        # The echo whose prediction does worst is the one to look at.
        return pulse_figure(max(drawn, key=lambda one: one.played.reduced if one.played else 0.0))

    def cases() -> Figure:
        from procedures.pulse_shape_figures import cases_figure

        return cases_figure(found)

    figures = {}
    if drawn:
        figures["pulse"] = pulse
    if len(found.cases) > 1:
        figures["cases"] = cases
    return figures


def _budget(found: Compared) -> Iterator[BudgetLine]:
    for one in found.cases:
        if one.level(one.played) is None or one.played is None:
            continue
        chance = math.sqrt(2 / one.played.fit.freedom)
        noise = math.sqrt(max(one.played.level_u**2 - chance**2, 0.0))
        quantity = f"reduced chi-square, {one.case.name}"
        for source, value in (
            ("chance in the residuals", chance),
            ("noise measured in silent windows", noise),
        ):
            yield BudgetLine(quantity, source, value, "1", (value / one.played.level_u) ** 2)


def _notes(plan: PulseShapePlan, found: Compared, config: BenchConfig) -> Iterator[str]:
    yield (
        "Each shot plays a realization with shot noise, sunlight and jitter, and is compared with the "
        "prediction for its own waveform."
        if plan.shot_noise == "inside"
        else "No noise of the light is in the waveforms; the predictions are without any, too."
    )
    yield (
        f"The receiver is known from: {found.receiver.origin}. Where it was characterized through the same "
        "generator and attenuator their errors cancel; the declared ones then make the test of the numbers "
        "milder than it needs to be."
    )
    fitted_db = config.generator.attenuation_db
    if plan.advised_db is not None and plan.advised_db != fitted_db:
        yield (
            f"The generator plays all echoes at ease behind an attenuator of {plan.advised_db:g} dB; "
            f"fitted are {fitted_db:g} dB."
        )
    if any(one.status == "echo_too_faint" for one in found.cases):
        yield "Echoes with status echo_too_faint need less than the generator's smallest amplitude."
    late_s = trigger_late_s(config)
    if late_s:
        yield f"The receiver's trigger comes {sized(late_s, 's')} after the pulse's: the bench file says so."
    yield (
        "Not modelled: noise that differs between silent and played windows; a gain that depends on "
        "amplitude; the frequency response of attenuator and cables; jitter of the generator within a pulse."
    )
