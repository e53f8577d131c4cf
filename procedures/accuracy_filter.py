"""Pulse and receiver's filter at 42 samples: closed form, tables, and digital filters on a time step."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from belahil.pole_response import response
from procedures.accuracy_footprint import INTERVAL_S, SAMPLES, UNIT, kernel
from procedures.accuracy_rows import Measured, Setting, short
from sim.kernel import Kernel
from sim.laser import PulseShape
from sim.reference import plane_echo

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Reference = Callable[[NDArray[np.float64]], NDArray[np.float64]]

CLOSED_FORM_ERROR = 1e-12
STEPS_PER_SAMPLE = (5, 10, 25, 50, 125)
_FIRST_S = -50e-9
_PHASES = 7
_JUMP_RATE_HZ = 1e9

SMOOTH = "laser pulse"
JUMP = "pulse cut at 17 %"
_SMOOTH_REFERENCE = "Fourier integration of pulse and filter, without poles taken apart"
_JUMP_REFERENCE = "each straight piece of the pulse through each mode, in closed form (belahil.pole_response)"


def filter_settings() -> Iterator[Setting]:
    """List what is measured."""
    smooth = partial(_setting, SMOOTH, _SMOOTH_REFERENCE)
    yield smooth(
        "closed form", "partial fractions and Faddeeva", partial(_exact, _laser_kernel), CLOSED_FORM_ERROR
    )
    for tolerance in (1e-3, 1e-5, 1e-7, 1e-9, 1e-11):
        yield smooth("table", f"tolerance {short(tolerance, 0)}", partial(_table, tolerance), tolerance)
    for steps in STEPS_PER_SAMPLE:
        yield smooth("bilinear", _step(steps), partial(_bilinear, _laser_kernel, steps))
    cut = partial(_setting, JUMP, _JUMP_REFERENCE)
    yield cut("closed form", "piece by piece", partial(_exact, _cut_kernel), CLOSED_FORM_ERROR)
    for steps in STEPS_PER_SAMPLE:
        yield cut("bilinear", _step(steps), partial(_bilinear, _cut_kernel, steps))


def _setting(
    case: str,
    reference: str,
    method: str,
    setting: str,
    measure: Callable[[], Measured],
    requested: float | None = None,
) -> Setting:
    return Setting("filter", case, method, setting, reference, UNIT, measure, requested)


def _step(steps: int) -> str:
    return f"step {1e9 * INTERVAL_S / steps:.3g} ns"


def _laser_kernel() -> tuple[Kernel, Reference]:
    one = kernel(1e-4)
    return one, lambda times_s: plane_echo(one, (0.0, 0.0), (0.0, 0.0), 0.0, 1.0, times_s)


def _cut_kernel() -> tuple[Kernel, Reference]:
    """Cut the laser's pulse where its power is below 17 % of the peak, as the fibre's threshold does."""
    laser = kernel(1e-4)
    times_s = np.arange(-8e-9, 25e-9, 1 / _JUMP_RATE_HZ)
    power = laser.pulse.density(times_s)
    above = np.flatnonzero(power >= 0.17 * power.max())
    kept = slice(above[0], above[-1] + 1)
    pulse = PulseShape(times_s=times_s[kept], relative=power[kept])
    one = replace(laser, pulse=pulse)

    def true(at_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return response(pulse.relative, _JUMP_RATE_HZ, float(pulse.times_s[0]), "linear", one.poles, at_s)

    return one, true


def _sampled(phase: float) -> NDArray[np.float64]:
    return _FIRST_S + INTERVAL_S * (phase + np.arange(SAMPLES, dtype=np.float64))


def _worst(true: Reference, samples: Callable[[float], NDArray[np.float64]]) -> float:
    """Return the worst max |dV| / peak of several sampling phases."""
    phases = (np.arange(_PHASES) + 1 / math.e) / _PHASES
    peak = np.abs(true(np.linspace(0, 60e-9, 601))).max()
    return max(float(np.abs(samples(phase) - true(_sampled(phase))).max() / peak) for phase in phases)


def _exact(make: Callable[[], tuple[Kernel, Reference]]) -> Measured:
    one, true = make()
    times_s = _sampled(0.3)
    error = _worst(true, lambda phase: one.exact(_sampled(phase)))
    return Measured(error, lambda: one.exact(times_s), predicted=CLOSED_FORM_ERROR)


def _table(tolerance: float) -> Measured:
    laser, true = _laser_kernel()
    one = replace(laser, tolerance=tolerance)
    table, times_s = one.table, _sampled(0.3)
    if table is None:
        raise RuntimeError("the kernel has no table")
    error = _worst(true, lambda phase: one.at(_sampled(phase)))
    work = {"polynomials": table.coefficients.shape[1]}
    return Measured(error, lambda: one.at(times_s), predicted=table.error, work=work)


def _bilinear(make: Callable[[], tuple[Kernel, Reference]], steps: int) -> Measured:
    """A digital Butterworth filter over the whole window, as a straightforward program has it."""
    from scipy.signal import butter, lfilter

    one, true = make()
    step_s = INTERVAL_S / steps
    cutoff_hz = abs(one.poles[0]) / (2 * math.pi)
    numerator, denominator = butter(len(one.poles), cutoff_hz, fs=1 / step_s)
    count = steps * (SAMPLES - 1) + 1

    def samples(phase: float) -> NDArray[np.float64]:
        pulse = one.pulse.density(_FIRST_S + INTERVAL_S * phase + step_s * np.arange(count))
        return np.asarray(lfilter(numerator, denominator, pulse)[::steps])

    return Measured(_worst(true, samples), lambda: samples(0.3), work={"steps": count})
