"""How the gain depends on the amplitude: a dead zone and a cubic term, from gains at several amplitudes.

Behind the filter, on the input-referred voltage u, a receiver may have a dead zone d and a cubic term c: u
becomes ``w = sign(u) max(|u| - d, 0)`` and then ``w + c w^3``. What a sine fit sees of it is the first
harmonic (a describing function, Kochenburger 1950). For a sine of peak a, with x = d / a, C = sqrt(1 - x^2)::

    N = 1 - (2 / pi) (asin x + x C) + (4 / pi) c a^2 (S4 - 3 x S3 + 3 x^2 S2 - x^3 S1)

with Sk the integral of sin^k from asin x to pi / 2. Small signals show d, large ones c: N is close to
``1 - (4 / pi) x + (3 / 4) c a^2``. A small negative d, which chance may give, turns the sign of what it does,
so that estimates scatter about zero.

The gains of one gain code at all amplitudes and frequencies are fitted at once, the filter with them, since
it sets the amplitude behind it.

Not modelled: noise before the nonlinearity, which would smooth a dead zone; any other nonlinearity (the chi
square tells); an amplitude error of the generator that differs from range to range, which looks like one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.butterworth import magnitude
from belahil.values import Estimate
from procedures.butterworth_fit import HIGHPASS_SIGNIFICANCE, IDENTIFIED, LOW_SPAN

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from procedures.butterworth_fit import ButterworthFit

    Array = NDArray[np.float64]

SmallSignalStatus = Literal["ok", "not_significant", "too_few_amplitudes", "not_identified", "inconsistent"]

LEAST_AMPLITUDES = 3
"""One for the gain, one for each of dead zone and cubic term."""
PROBABILITY = 1e-3
"""Below it chance and declared errors do not explain a departure from a linear receiver, or from this one."""
SIGNIFICANT = 3.5
"""Standard uncertainties that one of the two numbers of all codes must reach: 5e-4 by chance."""
_STEP = 1e-6


@dataclass(frozen=True, slots=True)
class SmallSignalResult:
    """What one gain code, or all together, says of the dependence on amplitude.

    Parameters
    ----------
    status : str
        "ok": the receiver is not linear, and this describes it. "not_significant": the numbers are zero as
        far as their uncertainties tell. "inconsistent": chance does not explain what is left (probability
        below 1e-3); uncertainties are widened by Birge's ratio. "too_few_amplitudes": fewer than three.
        "not_identified": the amplitudes tell neither.
    cubic_per_v2, deadband_v : Estimate or None
        V^-2, V at the cut, behind the filter.
    gain : Estimate or None
        V/V of signals that neither reaches; None for all codes together.
    cutoff, highpass : Estimate or None
        -3 dB frequencies of the filter in the same fit, Hz; a cut-off known to worse than 20 %, a high-pass
        that is not significant, and those of all codes together are None.
    chi_square : float
        Of the gains about the fit; for all codes together, of the codes about their mean.
    freedom : int
        Its degrees of freedom.
    scatter : (float, float)
        Standard uncertainties of cubic term and dead zone without what is declared.
    declared : tuple of (float, float)
        What each declared error moves them by.
    """

    status: SmallSignalStatus
    cubic_per_v2: Estimate | None = None
    deadband_v: Estimate | None = None
    gain: Estimate | None = None
    cutoff: Estimate | None = None
    highpass: Estimate | None = None
    chi_square: float = 0.0
    freedom: int = 0
    scatter: tuple[float, float] = (0.0, 0.0)
    declared: tuple[tuple[float, float], ...] = ()


def first_harmonic(peak_v: Array, deadband_v: float, cubic_per_v2: float) -> Array:
    """Return N, the first harmonic of the distorted sine by the peak of the sine.

    Parameters
    ----------
    peak_v : ndarray of float64, shape (n,)
        Peaks behind the filter, V at the cut; positive.
    deadband_v : float
        V; a negative one turns the sign of what it does to small signals.
    cubic_per_v2 : float
        V^-2.

    Examples
    --------
    >>> first_harmonic(np.array([0.1]), 0.0, 2.0).round(6), first_harmonic(np.array([0.1]), 0.2, 0.0)
    (array([1.015]), array([0.]))
    """
    x = np.minimum(abs(deadband_v) / peak_v, 1.0)
    root, angle = np.sqrt(1 - x**2), np.arccos(x)
    kept = 1 - 2 / math.pi * (np.arcsin(x) + x * root)
    # Integrals of the first four powers of the sine over the part of a quarter wave above the dead zone.
    second = (angle + x * root) / 2
    third = root - root**3 / 3
    fourth = 3 * angle / 8 + x * root * (3 / 8 + x**2 / 4)
    bent = 4 / math.pi * cubic_per_v2 * peak_v**2 * (fourth - 3 * x * third + 3 * x**2 * second - x**3 * root)
    if deadband_v < 0:
        kept = 2 - kept
    return np.asarray(kept + bent)


def fit_small_signal(
    whole: ButterworthFit,
    frequency_hz: Array,
    played_vpp: Array,
    gain: Array,
    gain_u: Array,
    declared: Sequence[Array] = (),
) -> SmallSignalResult:
    """Fit gain, filter, dead zone and cubic term of one gain code.

    Parameters
    ----------
    whole : ButterworthFit
        Of whole order over all amplitudes: where to begin, and the order. A high-pass is fitted anew where
        the frequencies tell one.
    frequency_hz, played_vpp, gain, gain_u : ndarray of float64, shape (n,)
        Usable points: Hz, V at the cut, V/V with statistical standard uncertainty.
    declared : sequence of ndarray of float64, shape (n,)
        Relative shifts of the gains by declared errors, one standard uncertainty each.
    """
    from scipy.optimize import least_squares
    from scipy.special import gammaincc

    if np.unique(np.round(played_vpp / played_vpp.min(), 3)).size < LEAST_AMPLITUDES:
        return SmallSignalResult("too_few_amplitudes")
    peak_v = played_vpp / 2
    # So that all parameters have a size of about one: 1 per mille at the least and the largest amplitude.
    units = np.array([1.0, 1.0, 1e-3 * float(peak_v.min()), 1e-3 / float(peak_v.max()) ** 2, 1.0])
    lowest_hz = float(frequency_hz.min())
    # The pooled fit may push what the amplitudes do into its high-pass, so that one is fitted here anew.
    size = 5 if frequency_hz.max() > LOW_SPAN * lowest_hz else 4

    def model(values: Array) -> Array:
        scale, stretch, deadband, cubic = values[:4] * units[:4]
        shape = magnitude(frequency_hz, whole.cutoff_hz * math.exp(stretch), whole.order)
        if size == 5:
            shape = shape / np.sqrt(np.maximum(1 + values[4] * (lowest_hz / frequency_hz) ** 2, 0.1))
        return np.asarray(
            whole.gain * math.exp(scale) * shape * first_harmonic(peak_v * shape, deadband, cubic)
        )

    def left(values: Array) -> Array:
        return np.asarray((model(values) - gain) / gain_u)

    solved = least_squares(left, np.zeros(size), x_scale="jac")
    slopes = _slopes(model, solved.x) / gain_u[:, None]
    normal = slopes.T @ slopes
    if not solved.success or not np.all(np.isfinite(normal)) or np.linalg.cond(normal) > 1e12:
        return SmallSignalResult("not_identified")
    covariance = np.linalg.inv(normal)
    chi_square, freedom = float(2 * solved.cost), gain.size - size
    consistent = freedom < 1 or float(gammaincc(freedom / 2, chi_square / 2)) >= PROBABILITY
    if not consistent:
        covariance = covariance * chi_square / freedom
    pull, scatter = covariance @ slopes.T, np.sqrt(covariance.diagonal()) * units[:size]
    moves = [pull @ (gain * shift / gain_u) for shift in declared]
    covariance = covariance + sum((np.outer(one, one) for one in moves), np.zeros((size, size)))
    values, spread = solved.x * units[:size], np.sqrt(covariance.diagonal()) * units[:size]
    both = solved.x[2:4] @ np.linalg.solve(covariance[2:4, 2:4], solved.x[2:4])
    significant = math.exp(-float(both) / 2) < PROBABILITY
    passed, edge_hz = whole.gain * math.exp(values[0]), whole.cutoff_hz * math.exp(values[1])
    known = spread[1] <= IDENTIFIED
    return SmallSignalResult(
        status="inconsistent" if not consistent else "ok" if significant else "not_significant",
        cubic_per_v2=Estimate(float(values[3]), float(spread[3]), "V-2"),
        deadband_v=Estimate(float(values[2]), float(spread[2]), "V"),
        gain=Estimate(passed, passed * float(spread[0]), "1"),
        cutoff=Estimate(edge_hz, edge_hz * float(spread[1]), "Hz") if known else None,
        highpass=_highpass(lowest_hz, *(float(one[4]) for one in (values, spread, scatter)))
        if size == 5
        else None,
        chi_square=chi_square,
        freedom=freedom,
        scatter=(float(scatter[3]), float(scatter[2])),
        declared=tuple((float(one[3] * units[3]), float(one[2] * units[2])) for one in moves),
    )


def _highpass(lowest_hz: float, q: float, q_u: float, scatter: float) -> Estimate | None:
    """Return the corner from its square, by that of the lowest frequency; None where chance may make one."""
    if not q > HIGHPASS_SIGNIFICANCE * scatter > 0:
        return None
    return Estimate(lowest_hz * math.sqrt(q), lowest_hz * q_u / (2 * math.sqrt(q)), "Hz")


def _slopes(model: Callable[[Array], Array], values: Array) -> Array:
    """Return derivatives by central differences, one column for each value."""
    columns = []
    for place in range(values.size):
        step = np.zeros(values.size)
        step[place] = 1e-2 if place in (2, 3) else _STEP
        columns.append((model(values + step) - model(values - step)) / (2 * step[place]))
    return np.stack(columns, axis=1)


def of_all_codes(found: Sequence[SmallSignalResult]) -> SmallSignalResult:
    """Join the gain codes, as one nonlinearity at the input would show it.

    Parameters
    ----------
    found : sequence of SmallSignalResult
        One for each gain code. What is declared moves all of them together and does not average out.
    """
    from scipy.special import gammaincc

    known = [one for one in found if one.cubic_per_v2 is not None and one.deadband_v is not None]
    if not known:
        return SmallSignalResult(found[0].status if found else "too_few_amplitudes")
    values = np.array(
        [
            (one.cubic_per_v2.value, one.deadband_v.value)
            for one in known
            if one.cubic_per_v2 and one.deadband_v
        ]
    )
    weights = np.array([one.scatter for one in known]) ** -2.0
    share = weights / weights.sum(axis=0)
    means, variances = np.sum(share * values, axis=0), 1 / weights.sum(axis=0)
    chi_square, freedom = float(np.sum(weights * (values - means) ** 2)), 2 * (len(known) - 1)
    consistent = freedom < 1 or float(gammaincc(freedom / 2, chi_square / 2)) >= PROBABILITY
    if not consistent:
        variances = variances * chi_square / freedom
    moves = np.einsum(
        "kd,kmd->md", share, np.array([one.declared for one in known]).reshape(len(known), -1, 2)
    )
    spread = np.sqrt(variances + np.sum(moves**2, axis=0))
    status: SmallSignalStatus = "ok" if np.any(np.abs(means) > SIGNIFICANT * spread) else "not_significant"
    if not consistent or any(one.status == "inconsistent" for one in known):
        status = "inconsistent"
    return SmallSignalResult(
        status,
        Estimate(float(means[0]), float(spread[0]), "V-2"),
        Estimate(float(means[1]), float(spread[1]), "V"),
        chi_square=chi_square,
        freedom=freedom,
    )
