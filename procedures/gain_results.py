"""From points to results: one fit for each gain code, its uncertainty budget, and the best code."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.generators import bandwidth_sensitivity
from belahil.outcome import BudgetLine
from belahil.uncertainty import sized
from belahil.values import Estimate
from procedures.butterworth_fit import ButterworthFit, FilterFits, fit_filter
from procedures.gain_amplitudes import AmplitudeRow, Linearity, amplitude_rows, between_amplitudes, linearity
from procedures.small_signal import SmallSignalResult, fit_small_signal, of_all_codes

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.config import GeneratorTable
    from procedures.gain_points import Interleave, Points, WindowReadings

BETWEEN_AMPLITUDES = "difference between amplitudes"


@dataclass(frozen=True, slots=True)
class CodeResult:
    """What was found at one gain code; None where it could not be found.

    Parameters
    ----------
    code : int or None
        The gain code.
    status : str
        "ok", "no_usable_point", that of the fit, or that of the dark windows.
    fit : ButterworthFit or None
        Of integer order, over all usable amplitudes; None where the cut-off is unknown.
    gain, cutoff, highpass, order_free : Estimate or None
        With combined standard uncertainties.
    noise, noise_total, input_noise : Estimate or None
        At the converter without and with quantization and lines; referred to the cut.
    input_noise_scatter : float
        Standard uncertainty of `input_noise` without declared errors, V: those are common to all codes.
    noise_is_hidden : bool
        The noise is too small for the steps of the converter.
    linearity : Linearity or None
        Whether the gains at all amplitudes are one number.
    amplitudes : tuple of AmplitudeRow
        Those gains.
    small_signal : SmallSignalResult
        The dead zone and the cubic term that would explain their differences.
    """

    code: int | None
    status: str
    fit: ButterworthFit | None
    gain: Estimate | None
    cutoff: Estimate | None
    highpass: Estimate | None
    order_free: Estimate | None
    noise: Estimate | None
    noise_total: Estimate | None
    input_noise: Estimate | None
    input_noise_scatter: float
    noise_is_hidden: bool
    linearity: Linearity | None
    amplitudes: tuple[AmplitudeRow, ...]
    small_signal: SmallSignalResult


@dataclass(frozen=True, slots=True)
class RunnerUp:
    """The code that is next to the best, and how much more input-referred noise it has, V."""

    code: int
    difference: Estimate

    @property
    def is_within(self) -> bool:
        """Whether two standard uncertainties may make it the best."""
        return self.difference.value <= 2 * self.difference.standard_uncertainty


@dataclass(frozen=True, slots=True)
class Characterization:
    """All results of a characterization."""

    points: Points
    codes: tuple[CodeResult, ...]
    best_code: int | None
    runner_up: RunnerUp | None
    clock_ppm: Estimate | None
    interleave: Interleave
    budget: tuple[BudgetLine, ...]

    @property
    def small_signal(self) -> SmallSignalResult:
        """Dead zone and cubic term of all codes together."""
        return of_all_codes([one.small_signal for one in self.codes])

    @property
    def by_amplitude(self) -> tuple[AmplitudeRow, ...]:
        """Gains by amplitude of all codes."""
        return tuple(row for one in self.codes for row in one.amplitudes)


@dataclass(frozen=True, slots=True, eq=False)
class DeclaredShift:
    """A declared error common to many points, as the relative shift of each gain that it would cause."""

    source: str
    relative: NDArray[np.float64]


def declared_shifts(
    points: Points, generator: GeneratorTable, setting_per_cut_volt: float
) -> tuple[DeclaredShift, ...]:
    """Turn ``[generator] uncertainty`` into shifts of the gains by one standard uncertainty each.

    Parameters
    ----------
    points : Points
        n points.
    generator : GeneratorTable
        Of the bench file: its uncertainty and its bandwidth.
    setting_per_cut_volt : float
        Generator setting for 1 V at the cut.

    Notes
    -----
    Each term is one error that all points share: it moves gain or cut-off and does not average out.
    """
    declared, everywhere = generator.uncertainty, np.ones(points.gain.shape)
    bandwidth = bandwidth_sensitivity(points.frequency_hz, generator.bandwidth_hz)
    shifts = (
        ("amplitude_relative", declared.amplitude_relative * everywhere),
        ("amplitude_v", declared.amplitude_v / (points.played_vpp * setting_per_cut_volt)),
        ("flatness_relative", declared.flatness_relative * points.frequency_hz / 40e6),
        ("attenuation_db", declared.attenuation_db * math.log(10) / 20 * everywhere),
        ("bandwidth_relative", declared.bandwidth_relative * bandwidth),
    )
    return tuple(
        DeclaredShift(f"[generator] uncertainty.{name}", shift)
        for name, shift in shifts
        if np.any(shift != 0)
    )


def characterization(
    codes: tuple[int | None, ...],
    readings: WindowReadings,
    generator: GeneratorTable,
    setting_per_cut_volt: float,
) -> Characterization:
    """Fit every gain code and choose the best.

    Parameters
    ----------
    codes : tuple of (int or None)
        In the order of the plan.
    readings : WindowReadings
        From `procedures.gain_points.read_windows`.
    generator : GeneratorTable
        Of the bench file.
    setting_per_cut_volt : float
        Generator setting for 1 V at the cut.
    """
    points = readings.points
    shifts = declared_shifts(points, generator, setting_per_cut_volt)
    results, budget = [], []
    for code in codes:
        result, lines = _code_result(code, readings, shifts)
        results.append(result)
        budget += lines
    return Characterization(
        points=points,
        codes=tuple(results),
        best_code=best_code(results),
        runner_up=runner_up(results),
        clock_ppm=readings.clock_ppm,
        interleave=readings.interleave,
        budget=tuple(budget),
    )


def best_code(results: list[CodeResult]) -> int | None:
    """Return the gain code of least input-referred noise; None when nobody can tell.

    That is so when there is none to compare, and when the noise of a code is hidden by the converter's steps:
    just that one may be the best.
    """
    if any(one.gain is not None and one.noise_is_hidden for one in results):
        return None
    found = [(one.input_noise.value, one.code) for one in results if one.input_noise is not None]
    return min(found)[1] if found and found[0][1] is not None else None


def runner_up(results: list[CodeResult]) -> RunnerUp | None:
    """Return the code of the second least input-referred noise; None without a best code or a second one."""
    if best_code(results) is None:
        return None
    known = [(one.input_noise.value, one) for one in results if one.input_noise is not None]
    if len(known) < 2:
        return None
    (least, best), (more, second) = sorted(known, key=lambda pair: pair[0])[:2]
    spread = math.hypot(best.input_noise_scatter, second.input_noise_scatter)
    assert second.code is not None
    return RunnerUp(second.code, Estimate(more - least, spread, "V"))


def _code_result(
    code: int | None, readings: WindowReadings, shifts: tuple[DeclaredShift, ...]
) -> tuple[CodeResult, list[BudgetLine]]:
    points, dark = readings.points, readings.dark[code]
    mine = points.chosen(code) & points.usable
    name = "" if code is None else f", code {code}"
    fits = None
    if np.any(mine):
        fits = fit_filter(points.frequency_hz[mine], points.gain[mine], points.gain_u[mine])
    rows: tuple[AmplitudeRow, ...] = ()
    between = 0.0, 0.0
    if fits is not None and fits.integer.knows_gain:
        rows = amplitude_rows(code, fits.integer, points, [(one.source, one.relative) for one in shifts])
        if not linearity(rows).is_linear:
            between = between_amplitudes(fits.integer, points, mine)
    gain, cutoff, highpass, order, budget = _filter_numbers(
        fits, [(one.source, one.relative[mine]) for one in shifts], between, name
    )
    budget += _of_amplitudes(rows, name)
    noise = dark.rms or readings.beside_sines.get(code)
    input_noise, scatter = None, 0.0
    if gain is not None and noise is not None and gain.value > 0:
        ratio = noise.value / gain.value
        relative = math.hypot(
            noise.standard_uncertainty / noise.value, gain.standard_uncertainty / gain.value
        )
        input_noise = Estimate(ratio, ratio * relative, "V")
        assert fits is not None
        scatter = ratio * math.hypot(
            noise.standard_uncertainty / noise.value, fits.integer.gain_u / gain.value
        )
    status: str = "no_usable_point" if fits is None else fits.integer.status
    if status == "ok" and noise is None:
        status = f"noise_{dark.status}"
    result = CodeResult(
        code=code,
        status=status,
        fit=fits.integer if fits is not None and fits.integer.knows_cutoff else None,
        gain=gain,
        cutoff=cutoff,
        highpass=highpass,
        order_free=order,
        noise=noise,
        noise_total=dark.rms_total,
        input_noise=input_noise,
        input_noise_scatter=scatter,
        noise_is_hidden=noise is None and dark.status in ("below_dither", "no_signal"),
        linearity=linearity(rows) if rows else None,
        amplitudes=rows,
        small_signal=_small_signal(fits, points, mine, shifts),
    )
    return result, budget


def _of_amplitudes(rows: tuple[AmplitudeRow, ...], name: str) -> list[BudgetLine]:
    """Return the budgets of gains that have more than one source."""
    return [
        line
        for row in rows
        if any(by for _, by in row.declared)
        for line in _combined(
            f"gain at {sized(row.amplitude_vpp, 'V')}pp{name}",
            row.sine_fit,
            row.sine_fit_u,
            [*row.declared],
            "1",
        )[1]
    ]


def _small_signal(
    fits: FilterFits | None, points: Points, mine: NDArray[np.bool_], shifts: tuple[DeclaredShift, ...]
) -> SmallSignalResult:
    if fits is None or not fits.integer.knows_cutoff:
        return SmallSignalResult("not_identified")
    return fit_small_signal(
        fits.integer,
        points.frequency_hz[mine],
        points.played_vpp[mine],
        points.gain[mine],
        points.gain_u[mine],
        [one.relative[mine] for one in shifts],
    )


def _filter_numbers(
    fits: FilterFits | None,
    shifts: list[tuple[str, NDArray[np.float64]]],
    between: tuple[float, float],
    name: str,
) -> tuple[Estimate | None, Estimate | None, Estimate | None, Estimate | None, list[BudgetLine]]:
    if fits is None or not fits.integer.knows_gain:
        return None, None, None, None, []
    whole, free = fits.integer, fits.free
    moved = [(source, whole.shifts(relative)) for source, relative in shifts]
    gain_between, cutoff_between = ([(BETWEEN_AMPLITUDES, one)] if one else [] for one in between)
    terms = [(source, one.gain) for source, one in moved] + gain_between
    gain, lines = _combined(f"gain{name}", whole.gain, whole.gain_u, terms, "1")
    if not whole.knows_cutoff:
        return gain, None, None, None, lines
    terms = [(source, one.cutoff_hz) for source, one in moved] + cutoff_between
    cutoff, more = _combined(f"cut-off{name}", whole.cutoff_hz, whole.cutoff_u_hz, terms, "Hz")
    highpass = order = None
    if whole.highpass_hz:
        terms = [(source, one.highpass_hz) for source, one in moved]
        highpass, _ = _combined("", whole.highpass_hz, whole.highpass_u_hz, terms, "Hz")
    if free.status == "ok":
        terms = [(source, free.shifts(relative).order) for source, relative in shifts]
        order, _ = _combined("", free.order, free.order_u, terms, "1")
    return gain, cutoff, highpass, order, lines + more


def _combined(
    quantity: str, value: float, statistical: float, terms: list[tuple[str, float]], unit: str
) -> tuple[Estimate, list[BudgetLine]]:
    """Combine a statistical part with independent declared terms (JCGM 100, 5.1.2)."""
    parts = [("scatter of the points", statistical), *terms]
    variance = sum(part**2 for _, part in parts)
    lines = [
        BudgetLine(quantity, source, abs(part), unit, part**2 / variance if variance else 0.0)
        for source, part in parts
    ]
    return Estimate(value, math.sqrt(variance), unit), sorted(lines, key=lambda one: -one.value)
