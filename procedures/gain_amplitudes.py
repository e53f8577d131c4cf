"""Gains at different amplitudes: are they one number, and what does it say of the receiver if not."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.values import Estimate
from procedures.butterworth_fit import fit_order
from procedures.sine_design import DENSITY_FREEDOM

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from procedures.butterworth_fit import ButterworthFit
    from procedures.gain_points import Points

PASS_BAND = 0.5
"""Highest frequency of the pass band as a part of the cut-off: the filter takes less than 1 % there."""
LINEAR_PROBABILITY = 1e-3
"""Below this chi-square probability gains at different amplitudes are different gains."""


@dataclass(frozen=True, slots=True)
class AmplitudeRow:
    """Pass-band gain at one amplitude by three estimators, V/V.

    Parameters
    ----------
    code : int or None
        Gain code.
    amplitude_vpp : float
        Planned, at the cut, V.
    sine_fit, sine_fit_u : float
        Gain with the statistical standard uncertainty by all points of the code.
    scatter_u : float
        What the points of this amplitude alone would give of it.
    filter_u : float
        What the pooled filter gives of it; that moves the gains at all amplitudes alike.
    declared : tuple of (str, float)
        Source, and what one standard uncertainty of it moves the gain by.
    declared_u : float
        All of them, with the filter held.
    rms, peak_to_peak : float
        Gains, noise included.
    count : int
        Points.
    """

    code: int | None
    amplitude_vpp: float
    sine_fit: float
    sine_fit_u: float
    scatter_u: float
    filter_u: float
    declared: tuple[tuple[str, float], ...]
    declared_u: float
    rms: float
    peak_to_peak: float
    count: int

    @property
    def estimate(self) -> Estimate:
        """The gain by the sine fit with its combined standard uncertainty."""
        moved = (by for _, by in self.declared)
        return Estimate(self.sine_fit, math.hypot(self.sine_fit_u, *moved), "1")


@dataclass(frozen=True, slots=True)
class Linearity:
    """Chi square of the gains at all amplitudes about their mean.

    Parameters
    ----------
    chi_square : float
        By statistical and declared uncertainties.
    freedom : int
        Amplitudes with a gain, less one; with 0 nothing can be told.
    """

    chi_square: float
    freedom: int

    @property
    def is_linear(self) -> bool:
        """Whether chance and declared errors explain the differences."""
        from scipy.special import gammaincc

        if self.freedom < 1:
            return True
        return float(gammaincc(self.freedom / 2, self.chi_square / 2)) >= LINEAR_PROBABILITY


def amplitude_rows(
    code: int | None, fit: ButterworthFit, points: Points, shifts: Sequence[tuple[str, NDArray[np.float64]]]
) -> tuple[AmplitudeRow, ...]:
    """Average the pass band of each amplitude, filter taken out, by all three estimators.

    The filter is that of all amplitudes, with its high-pass even where chance may have made one: whether one
    is significant may change from run to run, and the gains would jump with it.

    Parameters
    ----------
    code : int or None
        Gain code.
    fit : ButterworthFit
        Over all usable points of this code; its gain is known.
    points : Points
        n points.
    shifts : sequence of (str, ndarray of float64 of shape (n,))
        Declared errors: source, and the relative shift of each gain by one standard uncertainty.

    Notes
    -----
    Points move a gain as its own, by their weights, and through the filter, to first order (JCGM 100, 5.2.2).
    Their weights are measured too: where the amplitudes have different gains, what chance makes of a weight
    moves the filter by as much of the difference. The logarithm of a squared uncertainty from m degrees of
    freedom has the variance 2 / m.
    """
    whole = points.chosen(code) & points.usable
    rows = []
    for amplitude in np.unique(points.amplitude_vpp[whole]):
        mine = whole & (points.amplitude_vpp == amplitude) & (points.frequency_hz < PASS_BAND * fit.cutoff_hz)
        if np.any(mine):
            rows.append(_row(code, float(amplitude), fit, points, (whole, mine), shifts))
    return tuple(rows)


def _row(
    code: int | None,
    amplitude_vpp: float,
    fit: ButterworthFit,
    points: Points,
    chosen: tuple[NDArray[np.bool_], NDArray[np.bool_]],
    shifts: Sequence[tuple[str, NDArray[np.float64]]],
) -> AmplitudeRow:
    whole, mine = chosen
    frequency, measured, spread = (one[mine] for one in (points.frequency_hz, points.gain, points.gain_u))
    shape = fit.fitted_shape(frequency)
    weight = (shape / spread) ** 2
    weight /= weight.sum()
    gains = measured / shape
    gain = float(weight @ gains)
    # What a move of each point of the code, and a relative one of its weight, do to this gain: by itself, ...
    model = fit.gain * fit.fitted_shape(points.frequency_hz[whole])
    own, own_weight, at = np.zeros(model.size), np.zeros(model.size), mine[whole]
    own[at], own_weight[at] = weight / shape, weight * (gains - gain)
    # ... and through the filter.
    pulled = -(weight * gains) @ fit.shape_moves(frequency) / model
    pulled_weight = pulled * (points.gain[whole] - model)
    weight_u = math.sqrt(2 / DENSITY_FREEDOM)

    def spread_of(moves: NDArray[np.float64], weight_moves: NDArray[np.float64]) -> float:
        return float(np.linalg.norm(np.concatenate([moves * points.gain_u[whole], weight_moves * weight_u])))

    rivals = [float(weight @ (measured / one.fitted_shape(frequency))) - gain for one in fit.rivals]
    between = max(map(abs, rivals), default=0.0)
    declared = np.sqrt(sum((relative[mine] ** 2 for _, relative in shifts), np.zeros(frequency.size)))
    return AmplitudeRow(
        code,
        amplitude_vpp,
        gain,
        math.hypot(spread_of(own + pulled, own_weight + pulled_weight), between),
        spread_of(own, own_weight),
        math.hypot(spread_of(pulled, pulled_weight), between),
        tuple(
            (source, float((own + pulled) @ (points.gain * relative)[whole])) for source, relative in shifts
        ),
        gain * float(weight @ declared),
        float(weight @ (points.gain_rms[mine] / shape)),
        float(weight @ (points.gain_peak[mine] / shape)),
        int(np.count_nonzero(mine)),
    )


def linearity(rows: tuple[AmplitudeRow, ...]) -> Linearity:
    """Compare the gains of one gain code at all its amplitudes.

    A declared error of the generator may differ from one of its ranges to the next by all that is declared,
    so each amplitude has it for itself here.
    """
    if len(rows) < 2:
        return Linearity(0.0, 0)
    gains = np.array([row.sine_fit for row in rows])
    spread = np.array([math.hypot(row.scatter_u, row.declared_u) for row in rows])
    mean = np.average(gains, weights=spread**-2.0)
    return Linearity(float(np.sum(((gains - mean) / spread) ** 2)), len(rows) - 1)


def between_amplitudes(whole: ButterworthFit, points: Points, mine: NDArray[np.bool_]) -> tuple[float, float]:
    """Return what the differences between amplitudes add to the uncertainties of gain (V/V) and cut-off (Hz).

    Each amplitude is fitted alone. The receiver's small-signal value lies as far from that of the pooled fit
    as the amplitude that is farthest away, or less: a rectangle of this half width (JCGM 100, 4.3.7). What
    the scatter of that amplitude adds to the distance is taken off.

    Parameters
    ----------
    whole : ButterworthFit
        Of whole order, over all amplitudes.
    points : Points
        n points.
    mine : ndarray of bool, shape (n,)
        Those of the fit.
    """
    gains, cutoffs = [0.0], [0.0]
    for amplitude in np.unique(points.amplitude_vpp[mine]):
        one = mine & (points.amplitude_vpp == amplitude)
        fit = fit_order(points.frequency_hz[one], points.gain[one], points.gain_u[one], round(whole.order))
        if fit.knows_gain:
            gains.append((fit.gain - whole.gain) ** 2 - fit.gain_u**2)
        if fit.status == "ok":
            cutoffs.append((fit.cutoff_hz - whole.cutoff_hz) ** 2 - fit.cutoff_u_hz**2)
    return math.sqrt(max(gains) / 3), math.sqrt(max(cutoffs) / 3)
