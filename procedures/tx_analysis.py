"""From windows of a transmitted pulse to threshold, delay, and how well they are known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.uncertainty import combined
from procedures.tx_definitions import (
    CorrelationWindow,
    Definition,
    Reference,
    delays_s,
    needed_falls,
    references_s,
)
from procedures.tx_families import (
    COVERAGE,
    Family,
    FamilyFit,
    family_response,
    fit_families,
    interval,
)
from procedures.tx_joint import JointFit, joint_fit
from procedures.tx_misfit import Misfit, misfit
from procedures.tx_response import HIGHEST, CutResponses
from procedures.tx_terms import NORMAL_95, ModelTerm, model_terms, threshold_bound

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from procedures.known_receiver import KnownReceiver
    from procedures.tx_likelihood import Baseline, PulseLikelihood, WindowFits
    from procedures.tx_pulse import KnownPulse, OpticalPulse
    from procedures.tx_windows import PulseWindows

WELL_DETERMINED = 0.004
"""Largest bound of a threshold, of the peak, that is called determined: 0.4 points."""
DECIDED = 6.0
"""Difference of Akaike's criterion from which another family is preferred to the hard cut."""
_EQUAL = 1e-6
_FAR, _SLACK = 5.0, 0.05
"""Standard deviations, and part, by which a reduced chi-square may differ from 1."""


@dataclass(frozen=True, slots=True)
class Interval:
    """A number with its standard uncertainty and an interval of 95 %, which need not lie evenly about it."""

    value: float
    standard_uncertainty: float
    low: float
    high: float


@dataclass(frozen=True, slots=True, eq=False)
class TxFound:
    """What was found.

    Parameters
    ----------
    statuses : tuple of str
        All that apply, the gravest first: ``other_family`` (another family fits far better, and no
        uncertainty of an assumption accounts for it),
        ``model_misfit`` (a hard cut leaves a shape for which no uncertainty of an assumption accounts),
        ``residual_not_noise`` (the reduced chi-square is far from 1),
        ``threshold_not_seen`` (without a cut the windows are described as well),
        ``threshold_weakly_determined`` (the bound is above 0.4 points), ``no_gaussian_fit``; else ``ok``.
    threshold : Interval
        Of the peak.
    statistical : float
        Standard uncertainty of the threshold from noise alone: from the likelihood's interval of 95 %.
    bound : float
        Cramer-Rao bound of the threshold, of the peak.
    families : dict
        The best of each family.
    family_centres_s : dict
        Centre of the fitted Gaussian minus peak of the light for the best of each family, s; None where no
        Gaussian fits.
    terms : list of ModelTerm
        What the assumptions add.
    joint : JointFit
        Threshold with cut-off and pulse free within their uncertainties.
    misfit : Misfit
        Test for what the hard cut leaves.
    reduced_chi_square : float
        Of all samples about the hard cut.
    freedom : int
        Its degrees of freedom.
    delays : dict or None
        By definition, relative to nothing; None where no Gaussian fits the detected pulse.
    references_s : dict
        What may have been taken off a published delay.
    needed_falls : dict
        See `procedures.tx_definitions.needed_falls`.
    fits : WindowFits
        Of each window, by the hard cut.
    noise_interval : tuple of float
        Interval of 95 % of the threshold from noise alone.
    delay_noise_s : dict
        Standard uncertainty of each delay from noise alone, s; empty where there is no delay.
    segments_v : ndarray of float64, shape (n, count)
        The windows.
    windows, responses
        As they were compared.
    """

    statuses: tuple[str, ...]
    threshold: Interval
    statistical: float
    bound: float
    families: dict[Family, FamilyFit]
    family_centres_s: dict[Family, float | None]
    terms: list[ModelTerm]
    joint: JointFit
    misfit: Misfit
    reduced_chi_square: float
    freedom: int
    delays: dict[Definition, Interval] | None
    references_s: dict[Reference, float]
    needed_falls: dict[str, dict[Definition, dict[Reference, float | None]]]
    fits: WindowFits
    noise_interval: tuple[float, float]
    delay_noise_s: dict[Definition, float]
    segments_v: NDArray[np.float64]
    windows: PulseLikelihood
    responses: CutResponses

    @property
    def hard(self) -> FamilyFit:
        """The best hard cut."""
        return self.families["hard_cut"]

    @property
    def preferred(self) -> Family:
        """The family of the least criterion; a hard cut among equals."""
        return _preferred(self.families)

    @property
    def that_fit(self) -> list[Family]:
        """Families whose criterion is within 6 of the least, the best first."""
        least = self.families[self.preferred].criterion
        near = [name for name, one in self.families.items() if one.criterion - least <= DECIDED]
        return sorted(near, key=lambda name: self.families[name].criterion)


def analysed(
    found: PulseWindows,
    pulse: KnownPulse,
    receiver: KnownReceiver,
    baseline: Baseline,
    correlation_samples: int,
) -> TxFound:
    """Analyse windows that hold a pulse.

    Parameters
    ----------
    found : PulseWindows
        Of status ``ok``.
    pulse, receiver
        What is assumed.
    baseline : {"common", "window"}
        As in `procedures.tx_likelihood.whitener`.
    correlation_samples : int
        Of the window to which the range finder fits.
    """
    windows = found.likelihood(receiver, baseline)
    responses = CutResponses(pulse.pulse(), receiver.poles, receiver.zeros, windows.grid.times_s)
    families = fit_families(windows, pulse, receiver, responses)
    hard = families["hard_cut"]
    assert hard.threshold is not None
    gate = CorrelationWindow(receiver.true_interval_s, correlation_samples)

    def delays(made: OpticalPulse, other: KnownReceiver, at: float) -> dict[Definition, float] | None:
        response = CutResponses(made, other.poles, other.zeros, gate.times_s).exact(at)
        return delays_s(gate, response, made, at)

    ends = interval(windows, responses, hard)
    terms = model_terms(windows, pulse, receiver, hard, delays)
    fits = windows.fit(hard.response)
    square = float(np.einsum("nk,nk->", windows.white, windows.white) - fits.explained.sum())
    spent = 2 + (baseline == "window")
    freedom = windows.white.size - spent * len(windows) - 1
    bound = threshold_bound(windows, responses, hard)
    left = misfit(windows, pulse, receiver, responses, hard)
    rows = [delays(pulse.pulse(), receiver, one) for one in (hard.threshold, *ends)]
    late = _delays(rows, terms)
    return TxFound(
        statuses=_statuses(bound, families, left, square / freedom, freedom, late is not None),
        threshold=_interval(
            hard.threshold,
            ends,
            [one.threshold for one in terms],
            (0.0, HIGHEST),
        ),
        statistical=_half(hard.threshold, ends),
        bound=bound,
        families=families,
        family_centres_s={
            name: gate.centre_s(family_response(one, pulse, receiver, gate.times_s))
            for name, one in families.items()
        },
        terms=terms,
        joint=joint_fit(windows, pulse, receiver, hard),
        misfit=left,
        reduced_chi_square=square / freedom,
        freedom=freedom,
        delays=late,
        references_s=references_s(receiver),
        needed_falls=needed_falls(gate, pulse, receiver),
        fits=fits,
        noise_interval=ends,
        delay_noise_s={one: row.standard_uncertainty for one, row in (_delays(rows, []) or {}).items()},
        segments_v=found.segments_v,
        windows=windows,
        responses=responses,
    )


def _preferred(families: dict[Family, FamilyFit]) -> Family:
    return min(families, key=lambda one: families[one].criterion - _EQUAL * (one == "hard_cut"))


def noise_like(reduced_chi_square: float, freedom: int) -> bool:
    """Tell whether residuals can be the noise of the windows, which is itself known to a percent or two."""
    apart = _FAR * math.sqrt(2 / freedom)
    return 1 / (1 + _SLACK) - apart < reduced_chi_square < 1 + _SLACK + apart


def _statuses(
    bound: float,
    families: dict[Family, FamilyFit],
    left: Misfit,
    reduced: float,
    freedom: int,
    has_delay: bool,
) -> tuple[str, ...]:
    hard, none = families["hard_cut"], families["fractional_loss"]
    best = families[_preferred(families)]
    applies = {
        # Families are compared as if pulse and receiver were known: a fall that is wrong by its uncertainty
        # looks like a soft edge.
        "other_family": left.beyond_terms
        and hard.criterion - best.criterion > DECIDED
        and best.family != "fractional_loss",
        "model_misfit": left.beyond_terms,
        "residual_not_noise": not noise_like(reduced, freedom),
        "threshold_not_seen": hard.merit - none.merit < COVERAGE,
        "threshold_weakly_determined": not bound <= WELL_DETERMINED,
        "no_gaussian_fit": not has_delay,
    }
    return tuple(name for name, holds in applies.items() if holds) or ("ok",)


def _half(value: float, ends: tuple[float, float]) -> float:
    """Standard uncertainty from an interval of 95 %; an end that a limit cuts short does not count."""
    return max(abs(value - end) for end in ends) / NORMAL_95


def _interval(
    value: float,
    ends: tuple[float, float],
    shifts: list[tuple[float, float]],
    limits: tuple[float, float] = (-math.inf, math.inf),
) -> Interval:
    """Join noise and model terms, each side for itself: independent, so squares add."""
    down = combined([value - min(ends), *(min(*shift, 0.0) for shift in shifts)])
    up = combined([max(ends) - value, *(max(*shift, 0.0) for shift in shifts)])
    whole = combined([_half(value, ends), *(max(map(abs, shift)) / NORMAL_95 for shift in shifts)])
    return Interval(value, whole, max(value - down, limits[0]), min(value + up, limits[1]))


def _delays(
    rows: list[dict[Definition, float] | None], terms: list[ModelTerm]
) -> dict[Definition, Interval] | None:
    """Delay in each definition, from those at the best threshold and at the ends of its interval."""
    best, *others = rows
    if best is None:
        return None
    found = {}
    for one, value in best.items():
        ends = [value, *(row[one] for row in others if row)]
        shifts = [term.delay_s[one] for term in terms if one in term.delay_s]
        found[one] = _interval(value, (min(ends), max(ends)), shifts)
    return found
