"""A transmitted pulse of which only what exceeds a threshold passes, and how well that threshold shows.

What this does not model: a threshold that is soft, or that follows the pulse's own height with a delay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.errors import RefusedInput
from sim.kernel import Kernel
from sim.pulse_shape import PulseShape, crossing_s

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

_POINTS = 4001
_SAMPLES, _PHASES = 42, 4
"""Samples from the beginning of the pulse, at so many places between them."""

_STEP = 1e-3
_WORST_CONDITION = 1e12


def cut_pulse(shape: PulseShape, threshold: float) -> PulseShape:
    """Set a pulse to zero below a fraction of its peak, exactly at its crossings, and scale it to unit area.

    Parameters
    ----------
    shape : PulseShape
        With one peak.
    threshold : float
        Fraction of the peak; 0 leaves the pulse as it is. Towards 1 the pulse behind a filter becomes the
        filter's impulse response, and its scale stays that of one photon.

    Returns
    -------
    PulseShape
        A table of 4001 points; straight lines between them err by some 1e-6 of the peak.

    Raises
    ------
    RefusedInput
        A threshold outside 0 to below 1, where nothing is left; or a pulse with several peaks above it.
    """
    if not 0 <= threshold < 1:
        raise RefusedInput(f"threshold {threshold!r}: must be from 0 to below 1, as a fraction of the peak")
    if threshold == 0:
        return shape
    top_s, peak = _top(shape)
    level = threshold * peak
    reach_s = 12 * shape.std_s
    while shape.density(np.array([top_s - reach_s, top_s + reach_s])).max() >= level:
        reach_s *= 2
    edges = [crossing_s(shape, level, top_s, top_s + side * reach_s) for side in (-1, 1)]
    around_s = np.linspace(top_s - reach_s, top_s + reach_s, 20 * _POINTS)
    above = around_s[shape.density(around_s) > level]
    if above.size and not edges[0] <= above[0] <= above[-1] <= edges[1]:
        raise RefusedInput(f"threshold {threshold!r} of a pulse with several peaks: one is allowed")
    times_s = np.linspace(edges[0], edges[1], _POINTS)
    return PulseShape(times_s=times_s, relative=np.maximum(shape.density(times_s), level))


def _top(shape: PulseShape) -> tuple[float, float]:
    middle_s, half_s = shape.mean_s, 12 * shape.std_s
    for _ in range(6):
        grid_s = np.linspace(middle_s - half_s, middle_s + half_s, _POINTS)
        values = shape.density(grid_s)
        middle_s, half_s = float(grid_s[values.argmax()]), half_s / 100
    return middle_s, float(values.max())


@dataclass(frozen=True, slots=True)
class ThresholdBound:
    """How well a threshold can be known from samples behind the filter.

    Parameters
    ----------
    status : {"ok", "flat"}
        ``flat``: one standard deviation reaches 1, so all higher thresholds fit as well.
    standard_deviation : float
        Cramer-Rao bound, as a fraction of the peak; infinite where the samples do not depend on it.
    """

    status: Literal["ok", "flat"]
    standard_deviation: float


def threshold_bound(
    shape: PulseShape,
    threshold: float,
    poles: Sequence[complex],
    sample_interval_s: float,
    noise_rms: float,
) -> ThresholdBound:
    """Return the Cramer-Rao bound of a threshold, with arrival and amplitude unknown.

    Parameters
    ----------
    shape : PulseShape
        Before the cut.
    threshold : float
        0 to below 1.
    poles : sequence of complex
        Of the filter, rad/s.
    sample_interval_s : float
        s.
    noise_rms : float
        White, of each sample, relative to the peak of the cut and filtered pulse; of n shots together it is
        that of one over sqrt(n).

    Raises
    ------
    RefusedInput
        As `cut_pulse`, or noise that is not above zero.
    """
    if not 0 < noise_rms < math.inf:
        raise RefusedInput(f"noise {noise_rms!r} of the peak: must be above zero and finite")
    low, high = max(threshold - _STEP, 0.0), min(threshold + _STEP, (1 + threshold) / 2)
    made = [Kernel(cut_pulse(shape, one), tuple(poles)) for one in (threshold, low, high)]
    begin_s = made[0].starts_s
    window_s = begin_s + sample_interval_s * np.linspace(0, _SAMPLES, 100 * _SAMPLES)
    noise = noise_rms * float(made[0].exact(window_s).max())
    information = np.zeros((3, 3))
    for phase in range(_PHASES):
        times_s = begin_s + sample_interval_s * (np.arange(_SAMPLES) + phase / _PHASES)
        volts, below, above = (kernel.exact(times_s) for kernel in made)
        early, late = (made[0].exact(times_s + side * _STEP * sample_interval_s) for side in (-1, 1))
        rows = np.stack([(above - below) / (high - low), (late - early) / (2 * _STEP), volts])
        information += rows @ rows.T / (_PHASES * noise**2)
    spread = _spread(information)
    return ThresholdBound("flat" if spread >= 1 - threshold else "ok", spread)


def _spread(information: NDArray[np.float64]) -> float:
    scale = np.sqrt(np.diag(information))
    if not scale.all():
        return math.inf
    unit = information / np.multiply.outer(scale, scale)
    if not np.linalg.cond(unit) < _WORST_CONDITION:
        return math.inf
    return math.sqrt(float(np.linalg.inv(unit)[0, 0])) / float(scale[0])
