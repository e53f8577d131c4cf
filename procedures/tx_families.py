"""What the fibre may do to the pulse: four families of shapes, fitted and compared by likelihood.

``hard_cut``: what is below a threshold is lost. ``soft_cut``: the same with an edge of some width.
``shorter_tail``: the pulse falls faster than it was measured to, and nothing is cut. ``fractional_loss``:
everything is weakened alike, which cannot change the shape (Nishiyama et al., appendix "Time delay of
transmitted pulse"). A family is judged by twice its log-likelihood less twice its number of free parameters
(Akaike 1974); hard and soft cut are nested, so their difference is a chi-square of one degree of freedom.

What this does not model: a loss that depends on the history of the pulse, and families beyond these; whether
any of these describes the windows at all is asked in `procedures.tx_misfit`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from procedures.tx_response import HIGHEST, CutResponses

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from procedures.known_receiver import KnownReceiver
    from procedures.tx_likelihood import PulseLikelihood
    from procedures.tx_pulse import KnownPulse

Family = Literal["hard_cut", "soft_cut", "shorter_tail", "fractional_loss"]
FREE: dict[Family, int] = {"hard_cut": 1, "soft_cut": 2, "shorter_tail": 1, "fractional_loss": 0}
"""Free parameters of the common shape."""

COVERAGE = 3.841458820694124
"""Loss of twice the log-likelihood at the ends of an interval of 95 %: the quantile of chi-square(1)."""

_GRID = np.concatenate([np.linspace(0, 0.1, 6), np.linspace(0.1, HIGHEST, 24)[1:]])
_NEAR = np.array([-0.3, -0.16, -0.08, -0.03, 0.0, 0.03, 0.08, 0.16, 0.3])
_SETTLED, _COARSE = 1e-6, 1e-4
"""Where a search ends, of the peak; the second loses below 0.01 of the log-likelihood."""
_WIDTHS = np.array([0.02, 0.05, 0.1, 0.2, 0.35, 0.6])
_SHORTEST = 0.02
"""Least part of the fall that the family of shorter tails looks at."""


@dataclass(frozen=True, slots=True, eq=False)
class FamilyFit:
    """The best shape of a family.

    Parameters
    ----------
    family : str
        Which.
    merit : float
        Twice the log-likelihood, up to a constant that all families share.
    response : ndarray of float64, shape (m,)
        Of the best shape.
    threshold, width, fall : float or None
        What the family leaves free: of the peak; of the peak; factor on the time scale of the fall.
    """

    family: Family
    merit: float
    response: NDArray[np.float64]
    threshold: float | None = None
    width: float | None = None
    fall: float | None = None

    @property
    def criterion(self) -> float:
        """Akaike's information criterion, up to the same constant: less is better."""
        return 2 * FREE[self.family] - self.merit


def fit_families(
    windows: PulseLikelihood, pulse: KnownPulse, receiver: KnownReceiver, responses: CutResponses
) -> dict[Family, FamilyFit]:
    """Fit all families.

    Parameters
    ----------
    windows : PulseLikelihood
        Of the windows.
    pulse, receiver
        What is assumed.
    responses : CutResponses
        Of just these two.
    """
    hard = fit_hard(windows, responses)
    whole = responses.hard(0.0)
    return {
        "hard_cut": hard,
        "soft_cut": _fit_soft(windows, responses, hard),
        "shorter_tail": _fit_shorter(windows, pulse, receiver),
        "fractional_loss": FamilyFit("fractional_loss", windows.fit(whole).merit, whole),
    }


def fit_hard(
    windows: PulseLikelihood,
    responses: CutResponses,
    merit: Callable[[NDArray[np.float64]], float] | None = None,
    near: float | None = None,
) -> FamilyFit:
    """Find the threshold of the largest likelihood.

    Parameters
    ----------
    windows, responses
        As in `fit_families`.
    merit : callable or None
        Of a response; None: that of the windows.
    near : float or None
        Where it is expected. Then the table over thresholds, which pays off after some hundred responses, is
        not made.
    """
    of = merit or (lambda response: windows.fit(response).merit)
    at, grid = responses.hard, _GRID
    if near is not None:
        at, grid = responses.exact, np.unique(np.clip(near + _NEAR, 0.0, HIGHEST))
    threshold = _largest(lambda one: of(at(one)), grid)
    return FamilyFit("hard_cut", of(at(threshold)), at(threshold), threshold=threshold)


def interval(windows: PulseLikelihood, responses: CutResponses, best: FamilyFit) -> tuple[float, float]:
    """Return where the likelihood of a threshold has fallen to the ends of an interval of 95 %.

    0 or `HIGHEST` stand for an end that is not reached.
    """
    from scipy.optimize import brentq

    assert best.threshold is not None

    def lost(threshold: float) -> float:
        return best.merit - windows.fit(responses.hard(threshold)).merit - COVERAGE

    ends = []
    for end in (0.0, HIGHEST):
        far = np.linspace(best.threshold, end, 9)[1:]
        losses = [lost(float(one)) for one in far]
        beyond = next((place for place, loss in enumerate(losses) if loss > 0), None)
        if beyond is None:
            ends.append(end)
            continue
        near = best.threshold if beyond == 0 else float(far[beyond - 1])
        ends.append(float(brentq(lost, near, float(far[beyond]), xtol=1e-5)))
    return ends[0], ends[1]


def family_response(
    fit: FamilyFit, pulse: KnownPulse, receiver: KnownReceiver, times_s: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the best response of a family at other times than those it was fitted at, s after the peak."""
    light = pulse.pulse(fall=1.0 if fit.fall is None else fit.fall)
    made = CutResponses(light, receiver.poles, receiver.zeros, times_s)
    if fit.width:
        assert fit.threshold is not None
        return made.soft(fit.threshold, fit.width)
    return made.exact(fit.threshold or 0.0)


def _largest(merit: Callable[[float], float], grid: NDArray[np.float64], settled: float = _SETTLED) -> float:
    """Return where a function is largest: the best of a grid, then Brent's method between its neighbours."""
    from scipy.optimize import minimize_scalar

    values = [merit(float(one)) for one in grid]
    best = int(np.argmax(values))
    around = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, grid.size - 1)])
    found = minimize_scalar(
        lambda one: -merit(float(one)), bounds=around, method="bounded", options={"xatol": settled}
    )
    # Brent's method never asks at the ends, where a threshold of 0 lies.
    return float(found.x) if -found.fun > values[best] else float(grid[best])


def _fit_soft(windows: PulseLikelihood, responses: CutResponses, hard: FamilyFit) -> FamilyFit:
    def at(threshold: float, width: float) -> NDArray[np.float64]:
        return responses.soft(threshold, width)

    def best_threshold(width: float) -> tuple[float, float]:
        grid = np.linspace(0.0, HIGHEST - width / 2, 8)
        threshold = _largest(lambda one: windows.fit(at(one, width)).merit, grid, _COARSE)
        return threshold, windows.fit(at(threshold, width)).merit

    assert hard.threshold is not None
    width = _largest(
        lambda one: best_threshold(one)[1] if one else hard.merit, np.concatenate([[0.0], _WIDTHS]), _COARSE
    )
    if not width:
        return FamilyFit("soft_cut", hard.merit, hard.response, threshold=hard.threshold, width=0.0)
    threshold, merit = best_threshold(width)
    return FamilyFit("soft_cut", merit, at(threshold, width), threshold=threshold, width=width)


def _fit_shorter(windows: PulseLikelihood, pulse: KnownPulse, receiver: KnownReceiver) -> FamilyFit:
    def at(fall: float) -> NDArray[np.float64]:
        made = CutResponses(pulse.pulse(fall=fall), receiver.poles, receiver.zeros, windows.grid.times_s)
        return made.exact(0.0)

    fall = _largest(lambda one: windows.fit(at(one)).merit, np.linspace(_SHORTEST, 1.0, 9))
    return FamilyFit("shorter_tail", windows.fit(at(fall)).merit, at(fall), fall=fall)
