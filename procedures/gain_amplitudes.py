"""Gains at different amplitudes: are they one number, and what does it say of the receiver if not."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from procedures.butterworth_fit import fit_order

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from procedures.butterworth_fit import ButterworthFit
    from procedures.gain_points import Points

PASS_BAND = 0.5
"""Highest frequency of the pass band as a part of the cut-off: the filter takes less than 1 % there."""
LINEAR_PROBABILITY = 1e-3
"""Below this chi-square probability gains at different amplitudes are different gains."""


@dataclass(frozen=True, slots=True)
class AmplitudeRow:
    """Pass-band gain at one amplitude by three estimators, V/V; the bench file declares `declared_u`."""

    code: int | None
    amplitude_vpp: float
    sine_fit: float
    sine_fit_u: float
    declared_u: float
    rms: float
    peak_to_peak: float
    count: int


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
    code: int | None, fit: ButterworthFit, points: Points, declared: NDArray[np.float64]
) -> tuple[AmplitudeRow, ...]:
    """Average the pass band of each amplitude, filter taken out, by all three estimators.

    Parameters
    ----------
    code : int or None
        Gain code.
    fit : ButterworthFit
        Of this code; its gain is known.
    points : Points
        n points.
    declared : ndarray of float64, shape (n,)
        Relative standard uncertainty of each gain by all declared terms.
    """
    rows = []
    for amplitude in np.unique(points.amplitude_vpp):
        mine = points.chosen(code, float(amplitude)) & points.usable
        mine &= points.frequency_hz < PASS_BAND * fit.cutoff_hz
        if not np.any(mine):
            continue
        shape = fit.shape(points.frequency_hz[mine])
        weight = (shape / points.gain_u[mine]) ** 2
        gain = float(np.average(points.gain[mine] / shape, weights=weight))
        rows.append(
            AmplitudeRow(
                code,
                float(amplitude),
                gain,
                float(weight.sum() ** -0.5),
                gain * float(np.average(declared[mine], weights=weight)),
                float(np.average(points.gain_rms[mine] / shape, weights=weight)),
                float(np.average(points.gain_peak[mine] / shape, weights=weight)),
                int(np.count_nonzero(mine)),
            )
        )
    return tuple(rows)


def linearity(rows: tuple[AmplitudeRow, ...]) -> Linearity:
    """Compare the gains of one gain code at all its amplitudes.

    A declared error of the generator may differ from one of its ranges to the next by all that is declared,
    so each amplitude has it for itself here.
    """
    if len(rows) < 2:
        return Linearity(0.0, 0)
    gains = np.array([row.sine_fit for row in rows])
    spread = np.array([math.hypot(row.sine_fit_u, row.declared_u) for row in rows])
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
