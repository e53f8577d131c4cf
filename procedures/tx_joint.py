"""A threshold with cut-off and pulse free within their uncertainties, as far as the windows tell them.

The best hard cut holds cut-off and pulse where they are assumed, and its uncertainty grows by what each of
them may be wrong. The windows know better: a wrong cut-off leaves a shape that no threshold imitates. So the
cut-off, the time scales of fall and rise and the power in steps of 4 ns are free here beside the threshold,
each held to its assumption by its uncertainty: least squares with prior information, by Gauss-Newton steps
from the best cut (Tarantola, Inverse Problem Theory, 2005, eq. 3.51).

What this does not model: errors of the model that are none of these. It trusts the assumed kind of filter and
the assumed sizes of errors of the pulse, where the best cut only adds them to its uncertainty.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.values import Estimate
from procedures.tx_families import FamilyFit
from procedures.tx_response import HIGHEST, CutResponses
from procedures.tx_score import score_of, threshold_slope
from procedures.tx_terms import bends_s, with_cutoff

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from procedures.known_receiver import KnownReceiver
    from procedures.tx_likelihood import PulseLikelihood
    from procedures.tx_pulse import KnownPulse, OpticalPulse

_STEPS = 12
_SETTLED = 0.02
"""Of a standard uncertainty."""
_SLOPE = 0.1
"""Of a standard uncertainty: the difference that stands for a derivative."""
_OTHERS = 3
"""Cut-off, fall and rise; the power comes after them."""


@dataclass(frozen=True, slots=True)
class JointFit:
    """What was found.

    Parameters
    ----------
    status : {"ok", "not_converged", "threshold_not_told"}
        The last two have no numbers.
    threshold, cutoff : Estimate or None
        Of the peak; Hz.
    """

    status: str
    threshold: Estimate | None = None
    cutoff: Estimate | None = None


@dataclass(frozen=True, eq=False)
class _Model:
    """Responses with every assumption off by so many of its standard uncertainties."""

    pulse: KnownPulse
    receiver: KnownReceiver
    times_s: NDArray[np.float64]
    bends_s: NDArray[np.float64]

    def responses(self, off: NDArray[np.float64]) -> CutResponses:
        filtered = with_cutoff(self.receiver, float(off[0]))
        return CutResponses(self.light(off), filtered.poles, filtered.zeros, self.times_s)

    def light(self, off: NDArray[np.float64]) -> OpticalPulse:
        known = self.pulse
        made = known.pulse(1 + off[1] * known.fall_relative, 1 + off[2] * known.rise_relative)
        for at_s, by in zip(self.bends_s, off[_OTHERS:], strict=True):
            made = made.bent(float(at_s), float(by) * known.shape_relative)
        return made


def joint_fit(
    windows: PulseLikelihood, pulse: KnownPulse, receiver: KnownReceiver, best: FamilyFit
) -> JointFit:
    """Fit threshold, cut-off and pulse together.

    Parameters
    ----------
    windows : PulseLikelihood
        Of the windows.
    pulse, receiver
        What is assumed, with uncertainties.
    best : FamilyFit
        The best hard cut with these assumptions, where to begin.
    """
    assert best.threshold is not None
    places_s = bends_s(pulse.pulse(), best.threshold) if pulse.shape_relative else np.zeros(0)
    model = _Model(pulse, receiver, windows.grid.times_s, places_s)
    threshold, off = best.threshold, np.zeros(_OTHERS + places_s.size)
    # The assumptions have unit information of their own, the threshold none.
    prior = np.diag([0.0, *np.ones(off.size)])
    for _ in range(_STEPS):
        now = model.responses(off)
        response = now.exact(threshold)
        moved = [threshold_slope(now, threshold)]
        for number in range(off.size):
            there = off + _SLOPE * (np.arange(off.size) == number)
            moved.append((model.responses(there).exact(threshold) - response) / _SLOPE)
        fit = FamilyFit("hard_cut", 0.0, response, threshold=threshold)
        score, information = score_of(windows, fit, moved)
        if not information[0, 0] > 0:
            return JointFit("threshold_not_told")
        covariance = np.linalg.inv(information + prior)
        step = covariance @ (score - prior @ np.concatenate([[0.0], off]))
        spread = np.sqrt(np.diag(covariance))
        threshold, off = float(np.clip(threshold + step[0], 0.0, HIGHEST)), off + step[1:]
        if np.abs(step / spread).max() < _SETTLED:
            break
        if np.abs(off).max() > 1 / max(pulse.fall_relative, pulse.rise_relative, pulse.shape_relative, 0.1):
            return JointFit("not_converged")
    else:
        return JointFit("not_converged")
    cutoff = receiver.cutoff
    size_hz = cutoff.standard_uncertainty
    return JointFit(
        "ok",
        Estimate(threshold, float(spread[0])),
        Estimate(cutoff.value + float(off[0]) * size_hz, float(spread[1]) * size_hz, "Hz"),
    )
