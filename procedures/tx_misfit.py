"""Whether a hard cut describes the windows at all: a test for what it leaves of the pulse's shape.

The chi-square of all samples hides a wrong shape among thousands of degrees of freedom. So the test looks
only where a wrong shape can show: along a cut-off, fall and rise that are not the assumed ones, an AC
coupling, a soft edge, and bumps anywhere on the passed light. What of these amplitude, arrival and threshold
of the fit can imitate is taken out; what remains is a score test (Rao 1948) along the three combinations that
would show best, each with one degree of freedom.

What this does not model: a wrong shape that looks like another threshold. Nothing in the windows shows it;
the model terms of `procedures.tx_terms` stand for it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from belahil.values import Estimate
from procedures.tx_families import FamilyFit
from procedures.tx_likelihood import PulseLikelihood
from procedures.tx_pulse import OpticalPulse
from procedures.tx_response import HIGHEST, CutResponses
from procedures.tx_score import score_of, threshold_slope
from procedures.tx_terms import TRIED_HZ

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from procedures.known_receiver import KnownReceiver
    from procedures.tx_pulse import KnownPulse

LEVEL = 0.05
"""A misfit is told where chance alone would give a larger gain in fewer than so many analyses."""

_CUTOFF, _SCALE, _WIDTH, _BUMP = 0.01, 0.1, 0.2, 0.2
"""Sizes that one unit of each departure has: relative, relative, of the peak, relative."""
_BUMPS = 6
_MODES = 3
_VISIBLE = 1.0
"""Expected gain of one unit below which a combination of departures is left out."""


@dataclass(frozen=True, slots=True)
class Misfit:
    """What is left of the shape.

    Parameters
    ----------
    gain : float
        In chi-square, if the shape were free along the combinations that would show.
    freedom : int
        How many those are; 0 where none would show.
    probability : float
        Of a larger gain by chance, were every assumption right.
    probability_within_terms : float
        The same where cut-off, fall, rise and power may be wrong by their uncertainties.
    looks_like : str
        The single departure that explains most of it: ``cutoff``, ``fall``, ``rise``, ``ac_coupling``,
        ``soft_edge`` or ``bump``; empty where nothing shows.
    size : float
        Of that departure, in the unit of its model term; of a soft edge its width, of a bump its height.
    size_uncertainty : float
        Of the same.
    """

    gain: float
    freedom: int
    probability: float
    probability_within_terms: float
    looks_like: str
    size: float
    size_uncertainty: float

    @property
    def shows(self) -> bool:
        """Tell whether a hard cut of just the assumed pulse does not describe the windows."""
        return self.probability < LEVEL

    @property
    def beyond_terms(self) -> bool:
        """Tell whether even the uncertainties of the assumptions do not account for what is left."""
        return self.shows and self.probability_within_terms < LEVEL


def misfit(
    windows: PulseLikelihood,
    pulse: KnownPulse,
    receiver: KnownReceiver,
    responses: CutResponses,
    best: FamilyFit,
) -> Misfit:
    """Test a fitted hard cut; parameters as in `procedures.tx_families.fit_families`."""
    from scipy.stats import chi2

    names, sizes, moved = _departures(windows, pulse, receiver, responses, best)
    score, information = score_of(windows, best, moved)
    # The first row is the threshold, which the fit has used already.
    taken = information[1:, 0] / information[0, 0] if information[0, 0] > 0 else np.zeros(len(names))
    score = score[1:] - taken * score[0]
    information = information[1:, 1:] - np.outer(taken, information[0, 1:])
    values, axes = np.linalg.eigh(information)
    kept = np.flatnonzero(values > max(_VISIBLE, 1e-9 * values[-1]))[-_MODES:]
    if not kept.size:
        return Misfit(0.0, 0, 1.0, 1.0, "", 0.0, 0.0)
    along = axes[:, kept].T @ score
    gain = float(np.sum(along**2 / values[kept]))
    probability = float(chi2.sf(gain, kept.size))
    # Assumptions that are wrong by their uncertainties add to the covariance of the score.
    pushed = axes[:, kept].T @ information * _units(names, pulse, receiver)
    spread = np.diag(values[kept]) + pushed @ pushed.T
    within = float(chi2.sf(along @ np.linalg.solve(spread, along), kept.size))
    own = np.diag(information)
    single = np.where(own > _VISIBLE, score**2 / np.where(own > 0, own, 1.0), 0.0)
    one = int(single.argmax())
    shows = probability < LEVEL
    size = float(score[one] / own[one]) * sizes[one]
    return Misfit(
        gain,
        int(kept.size),
        probability,
        within,
        names[one] if shows else "",
        size if shows else 0.0,
        sizes[one] / float(np.sqrt(own[one])) if shows else 0.0,
    )


def _units(names: list[str], pulse: KnownPulse, receiver: KnownReceiver) -> NDArray[np.float64]:
    """Uncertainty of each departure in its own units; of what has none, 0."""
    known = {
        "cutoff": receiver.cutoff.standard_uncertainty / (_CUTOFF * receiver.cutoff.value),
        "fall": pulse.fall_relative / _SCALE,
        "rise": pulse.rise_relative / _SCALE,
        "bump": pulse.shape_relative / _BUMP,
    }
    return np.array([known.get(name, 0.0) for name in names])


def _departures(
    windows: PulseLikelihood,
    pulse: KnownPulse,
    receiver: KnownReceiver,
    responses: CutResponses,
    best: FamilyFit,
) -> tuple[list[str], list[float], list[NDArray[np.float64]]]:
    """Name, size of a unit, and change of the response by one unit; before them that by the threshold."""
    assert best.threshold is not None
    threshold, times_s = best.threshold, windows.grid.times_s

    def by(made: OpticalPulse, other: KnownReceiver) -> NDArray[np.float64]:
        changed = CutResponses(made, other.poles, other.zeros, times_s)
        return changed.exact(threshold) - best.response

    cutoff, corner_hz = receiver.cutoff, receiver.highpass_hz + TRIED_HZ
    own = pulse.pulse()
    rows = [
        ("cutoff", _CUTOFF * cutoff.value,
         by(own, replace(receiver, cutoff=Estimate((1 + _CUTOFF) * cutoff.value, 0.0, "Hz")))),
        ("fall", _SCALE, by(pulse.pulse(fall=1 + _SCALE), receiver)),
        ("rise", _SCALE, by(pulse.pulse(rise=1 + _SCALE), receiver)),
        ("ac_coupling", TRIED_HZ, by(own, replace(receiver, highpass=Estimate(corner_hz, 0.0, "Hz")))),
        ("soft_edge", _WIDTH,
         responses.soft(min(threshold, HIGHEST - _WIDTH / 2), _WIDTH)
         - responses.hard(min(threshold, HIGHEST - _WIDTH / 2))),
        *(("bump", _BUMP, one) for one in _bumps(own, threshold, receiver, times_s)),
    ]  # fmt: skip
    moved = [threshold_slope(responses, threshold), *(row[2] for row in rows)]
    return [row[0] for row in rows], [row[1] for row in rows], moved


def _bumps(
    own: OpticalPulse, threshold: float, receiver: KnownReceiver, times_s: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """Response to the passed light times one of a row of bells that overlap and together cover it."""
    passed = own.above(max(threshold, 1e-3))
    begin_s, end_s = passed[0][0], passed[-1][1]
    apart_s = (end_s - begin_s) / (_BUMPS - 1)
    found = []
    for number in range(_BUMPS):
        away = (own.times_s - begin_s - number * apart_s) / apart_s
        with np.errstate(under="ignore"):
            light = OpticalPulse(own.first_s, own.step_s, own.relative * _BUMP * np.exp(-0.5 * away**2))
        found.append(CutResponses(light, receiver.poles, receiver.zeros, times_s).between(passed))
    return found
