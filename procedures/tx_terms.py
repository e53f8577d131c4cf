"""How well a threshold can be known: the bound that noise sets, and what the assumed model adds.

The bound is that of Cramer and Rao for the common threshold when every window has an amplitude and an arrival
of its own, in the coloured noise of the windows. It is small against what a wrong model does: 1 % of the
cut-off moves the threshold by points. So each assumption is changed to both ends of its interval of 95 %,
windows without noise of the fitted shape are fitted again with it, and how far threshold and delay move is
the term of that assumption.

An AC coupling that the receiver is not known to have would show in the windows; its term is the shift at the
corner at which it just would (a gain of 12 in chi-square), taken for the end of such an interval. The power
of the pulse may err independently every 4 ns; the squares of the shifts by each of these errors add.

What this does not model: errors of order and kind of the filter, and assumptions that err together.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from belahil.values import Estimate
from procedures.tx_families import FamilyFit, fit_hard
from procedures.tx_likelihood import PulseLikelihood
from procedures.tx_pulse import BEND_S
from procedures.tx_response import CutResponses
from procedures.tx_score import score_of, threshold_slope

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from procedures.known_receiver import KnownReceiver
    from procedures.tx_definitions import Definition
    from procedures.tx_pulse import KnownPulse, OpticalPulse

SHOWS = 12.0
"""Gain in chi-square at which a departure from the model is expected to show."""

TRIED_HZ = 20e3
"""Corner of the AC coupling that is tried where none is known; effects are linear in it to some 100 kHz."""

_FAINT = 1e-2
"""Of the peak, below which nothing that passes moves a threshold."""
NORMAL_95 = 1.959963984540054

DelaysOf = Callable[["OpticalPulse", "KnownReceiver", float], "dict[Definition, float] | None"]
"""Delay (s) in each definition for a pulse, a receiver, and a threshold."""


@dataclass(frozen=True, slots=True)
class ModelTerm:
    """What one assumption adds.

    Parameters
    ----------
    source : {"cutoff", "fall", "rise", "shape", "ac_coupling"}
        The assumption.
    uncertainty : float
        Its standard uncertainty: Hz for cut-off and AC coupling, relative for the others.
    unit : str
        Of it.
    threshold : tuple of float
        Shift of the threshold when the assumption is at the low and at the high end of its interval of 95 %.
    delay_s : dict of str to tuple of float
        The same of the delay in each definition, s; empty where no Gaussian fits.
    gain : float
        Chi-square that the smaller of both changes would leave unexplained in these windows.
    """

    source: str
    uncertainty: float
    unit: str
    threshold: tuple[float, float]
    delay_s: dict[Definition, tuple[float, float]]
    gain: float

    @property
    def threshold_uncertainty(self) -> float:
        """Standard uncertainty of the threshold from this alone."""
        return max(map(abs, self.threshold)) / NORMAL_95

    def delay_uncertainty_s(self, definition: Definition) -> float:
        """Return the standard uncertainty of a delay from this alone, s."""
        return max(map(abs, self.delay_s[definition])) / NORMAL_95


def threshold_bound(windows: PulseLikelihood, responses: CutResponses, best: FamilyFit) -> float:
    """Return the Cramer-Rao bound of a hard threshold from these windows.

    Parameters
    ----------
    windows, responses
        As in `procedures.tx_families`.
    best : FamilyFit
        Of a hard cut; its amplitudes and arrivals are taken as they were fitted.

    Returns
    -------
    float
        Standard deviation, of the peak; infinite where the windows do not depend on the threshold.
    """
    assert best.threshold is not None
    _, information = score_of(windows, best, [threshold_slope(responses, best.threshold)])
    return 1 / math.sqrt(information[0, 0]) if information[0, 0] > 0 else math.inf


def model_terms(
    windows: PulseLikelihood,
    pulse: KnownPulse,
    receiver: KnownReceiver,
    best: FamilyFit,
    delays: DelaysOf,
) -> list[ModelTerm]:
    """Return what each assumption adds to threshold and delay of a hard cut.

    Parameters
    ----------
    windows : PulseLikelihood
        Of the windows.
    pulse, receiver
        What is assumed, with uncertainties.
    best : FamilyFit
        Of a hard cut.
    delays : callable
        The delay in each definition.
    """
    assert best.threshold is not None
    amplitude_v = float(np.median(windows.fit(best.response).amplitude_v))
    clean = windows.expected(best.response, amplitude_v)
    weight = len(windows) / len(clean)
    whole = float(np.einsum("nk,nk->", clean.white, clean.white))
    own = pulse.pulse()
    start_s = delays(own, receiver, best.threshold)

    def changed(made: OpticalPulse, other: KnownReceiver) -> _Changed:
        again = fit_hard(
            windows,
            CutResponses(made, other.poles, other.zeros, windows.grid.times_s),
            lambda one: float(clean.fit(one).explained.sum()),
            near=best.threshold,
        )
        assert again.threshold is not None
        assert best.threshold is not None
        moved_s, late_s = delays(made, other, again.threshold), {}
        if moved_s is not None and start_s is not None:
            late_s = {one: moved_s[one] - start_s[one] for one in start_s}
        return _Changed(again.threshold - best.threshold, late_s, max(weight * (whole - again.merit), 0.0))

    def term(source: str, size: float, unit: str, each: list[_Changed]) -> ModelTerm:
        low, high = each
        both = {
            one: (low.delay_s[one], high.delay_s[one]) for one in low.delay_s.keys() & high.delay_s.keys()
        }
        return ModelTerm(source, size, unit, (low.threshold, high.threshold), both, min(low.gain, high.gain))

    ends = (-NORMAL_95, NORMAL_95)
    fall, rise, cutoff = pulse.fall_relative, pulse.rise_relative, receiver.cutoff.standard_uncertainty
    found = [
        term("cutoff", cutoff, "Hz", [changed(own, with_cutoff(receiver, end)) for end in ends]),
        term("fall", fall, "1", [changed(pulse.pulse(fall=1 + end * fall), receiver) for end in ends]),
        term("rise", rise, "1", [changed(pulse.pulse(rise=1 + end * rise), receiver) for end in ends]),
    ]
    if pulse.shape_relative:
        size = NORMAL_95 * pulse.shape_relative
        each = [changed(own.bent(at_s, size), receiver) for at_s in bends_s(own, best.threshold)]
        found.append(_joined("shape", pulse.shape_relative, each))
    if receiver.highpass is not None:
        size, corner_hz = receiver.highpass.standard_uncertainty, receiver.highpass_hz
        each = [changed(own, _with_highpass(receiver, corner_hz + end * size)) for end in ends]
        return [*found, term("ac_coupling", size, "Hz", each)]
    tried = changed(own, _with_highpass(receiver, TRIED_HZ))
    # Both shift and the root of the gain are linear in so low a corner.
    part = math.sqrt(SHOWS / tried.gain) if tried.gain > 0 else 1.0
    late_s = {one: (0.0, part * value) for one, value in tried.delay_s.items()}
    size = part * TRIED_HZ / NORMAL_95
    return [*found, ModelTerm("ac_coupling", size, "Hz", (0.0, part * tried.threshold), late_s, SHOWS)]


@dataclass(frozen=True, slots=True)
class _Changed:
    """Shift of threshold and delays under one change, and the chi-square that it leaves."""

    threshold: float
    delay_s: dict[Definition, float]
    gain: float


def bends_s(pulse: OpticalPulse, threshold: float) -> NDArray[np.float64]:
    """Return times at which an error of the power moves a threshold, s: all round what passes."""
    passed = pulse.above(max(threshold, _FAINT))
    return np.arange(passed[0][0] - BEND_S / 2, passed[-1][1] + BEND_S, BEND_S)


def _joined(source: str, size: float, each: list[_Changed]) -> ModelTerm:
    """Join independent errors of one size into a term that is even about zero."""
    threshold = math.hypot(*(one.threshold for one in each))
    known = set.intersection(*(set(one.delay_s) for one in each))
    delay_s = {one: math.hypot(*(change.delay_s[one] for change in each)) for one in known}
    both = {one: (-late_s, late_s) for one, late_s in delay_s.items()}
    return ModelTerm(source, size, "1", (-threshold, threshold), both, min(one.gain for one in each))


def with_cutoff(receiver: KnownReceiver, by: float) -> KnownReceiver:
    """Return a receiver whose cut-off is off by so many of its standard uncertainties."""
    cutoff = receiver.cutoff
    moved_hz = cutoff.value + by * cutoff.standard_uncertainty
    return replace(receiver, cutoff=Estimate(moved_hz, cutoff.standard_uncertainty, "Hz"))


def _with_highpass(receiver: KnownReceiver, corner_hz: float) -> KnownReceiver:
    return replace(receiver, highpass=Estimate(corner_hz, 0.0, "Hz") if corner_hz > 0 else None)
