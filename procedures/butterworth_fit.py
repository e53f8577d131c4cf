"""Fit of a Butterworth filter to measured gains.

The model is `belahil.butterworth.magnitude` times a gain. Gain is linear, so each cut-off of a logarithmic
grid has its best gain in closed form (variable projection, Golub and Pereyra 1973); the best grid point
starts a least-squares fit in log parameters, which therefore needs no starting values from the user. The
high-pass enters by ``q = f_h**2``, which the gains determine nearly linearly and without a wall at zero.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.butterworth import magnitude

if TYPE_CHECKING:
    from numpy.typing import NDArray

Status = Literal["ok", "too_few_points", "cutoff_not_identified", "order_not_identified"]
Loss = Literal["linear", "soft_l1"]

ORDERS = (1, 2, 3, 4, 5, 6)
GRID_POINTS = 400
HIGHPASS_SIGNIFICANCE = 4.0
"""A high-pass counts as found when q exceeds this many of its standard uncertainties. By chance that happens
once in 30 000 fits, and a run has sixteen."""
LOW_SPAN = 20.0
"""Ratio of highest to lowest frequency from which on a high-pass is fitted."""
BIRGE_PROBABILITY = 1e-3
"""Below this chi-square probability the uncertainties are scaled by the Birge ratio (Birge 1932)."""
IDENTIFIED = 0.2
"""Largest relative standard uncertainty of a cut-off that is still reported."""
RIVAL = 9.0
"""Another whole order fits as well when its chi square is larger by less than this (three standard
deviations), times the Birge ratio."""


@dataclass(frozen=True, slots=True, eq=False)
class Shifts:
    """Changes of a fit's parameters; gain in V/V, frequencies in Hz."""

    gain: float
    cutoff_hz: float
    highpass_hz: float
    order: float


@dataclass(frozen=True, slots=True, eq=False)
class ButterworthFit:
    """A fitted filter.

    Parameters
    ----------
    status : str
        "ok", "too_few_points", "cutoff_not_identified", or "order_not_identified" where several whole orders
        fit; `knows_gain` and `knows_cutoff` say which numbers are for use, the order is with "ok" only.
    gain, cutoff_hz, order, highpass_hz : float
        Pass-band gain (V/V), -3 dB frequencies, order; no high-pass: 0.
    gain_u, cutoff_u_hz, order_u, highpass_u_hz : float
        Standard uncertainties from those of the points; 0 for what was not fitted.
    chi_square : float
        Weighted sum of squares.
    freedom : int
        Degrees of freedom.
    highpass_squared_hz2 : float
        As fitted, significant or not; chance may make it negative.
    rivals : tuple of ButterworthFit
        Of other whole orders that fit as well.
    """

    status: Status
    gain: float
    cutoff_hz: float
    order: float
    highpass_hz: float
    gain_u: float
    cutoff_u_hz: float
    order_u: float
    highpass_u_hz: float
    chi_square: float
    freedom: int
    highpass_squared_hz2: float
    _pull: NDArray[np.float64]
    rivals: tuple[ButterworthFit, ...] = ()

    @property
    def knows_gain(self) -> bool:
        """Whether the gain may be used; the points may tell it without telling the cut-off."""
        return self.knows_cutoff or 0 < self.gain_u <= IDENTIFIED * self.gain

    @property
    def knows_cutoff(self) -> bool:
        """Whether the cut-off may be used; the orders that fit may agree on it."""
        return self.status in ("ok", "order_not_identified")

    def shape(self, frequency_hz: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return gain relative to the pass band, shape of `frequency_hz`."""
        return magnitude(frequency_hz, self.cutoff_hz, self.order, self.highpass_hz)

    def fitted_shape(self, frequency_hz: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return `shape` with the high-pass of the fit even where that is not significant.

        Parameters
        ----------
        frequency_hz : ndarray of float64, shape (n,)
            None below those of the fit.
        """
        return self._shape_and_slopes(frequency_hz)[0]

    def shape_moves(self, frequency_hz: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how `fitted_shape` moves, to first order, when gains move; both by relative amounts.

        Parameters
        ----------
        frequency_hz : ndarray of float64, shape (k,)
            None below those of the fit.

        Returns
        -------
        ndarray of float64, shape (k, n)
            A column for each point of the fit, in their order.
        """
        shape, slopes = self._shape_and_slopes(frequency_hz)
        return np.asarray((slopes[1:] / shape).T @ self._pull[1:])

    def _shape_and_slopes(
        self, frequency_hz: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        whole = [0.0, math.log(self.cutoff_hz), math.log(self.order), self.highpass_squared_hz2]
        return _model(np.array(whole), frequency_hz, 1.0)

    def shifts(self, relative: NDArray[np.float64]) -> Shifts:
        """Return how the result moves, to first order, when each gain moves by a relative amount.

        Parameters
        ----------
        relative : ndarray of float64, shape (n,)
            One for each point of the fit, in their order.
        """
        gain, cutoff, order, q = self._pull @ relative
        highpass = q / (2 * self.highpass_hz) if self.highpass_hz else 0.0
        return Shifts(self.gain * gain, self.cutoff_hz * cutoff, highpass, self.order * order)


@dataclass(frozen=True, slots=True, eq=False)
class FilterFits:
    """The filter by whole order and by free order.

    Parameters
    ----------
    integer, free : ButterworthFit
        The whole order that fits best; a real order with its uncertainty.
    chi_square_by_order : dict of int to float
        For every whole order tried.
    """

    integer: ButterworthFit
    free: ButterworthFit
    chi_square_by_order: dict[int, float]


def fit_filter(
    frequency_hz: NDArray[np.float64],
    gain: NDArray[np.float64],
    gain_u: NDArray[np.float64],
    loss: Loss = "linear",
) -> FilterFits:
    """Fit gain, cut-off, order and, where the points show one, a high-pass.

    Parameters
    ----------
    frequency_hz, gain, gain_u : ndarray of float64, shape (n,)
        Points with standard uncertainties, in any order; several amplitudes may share a frequency.
    loss : {"linear", "soft_l1"}
        The second is for records with outliers (Charbonnier's smooth absolute value).

    Returns
    -------
    FilterFits
        A status instead of numbers where the points cannot tell. Where another whole order fits as well, the
        order is not identified and the difference counts as uncertainty; with more than 20 % in the cut-off,
        that is not identified either.
    """
    tell = _can_tell_highpass(frequency_hz)
    whole = {order: _fit(frequency_hz, gain, gain_u, order, tell, loss) for order in ORDERS}
    best = min(ORDERS, key=lambda order: whole[order].chi_square)
    free = _fit(frequency_hz, gain, gain_u, None, tell, loss, start_order=float(best))
    integer = _against_rivals(whole[best], [one for order, one in whole.items() if order != best])
    return FilterFits(integer, free, {order: one.chi_square for order, one in whole.items()})


def fit_order(
    frequency_hz: NDArray[np.float64], gain: NDArray[np.float64], gain_u: NDArray[np.float64], order: int
) -> ButterworthFit:
    """Fit a filter of given whole order; otherwise as `fit_filter`."""
    return _fit(frequency_hz, gain, gain_u, order, _can_tell_highpass(frequency_hz), "linear")


def _against_rivals(best: ButterworthFit, others: list[ButterworthFit]) -> ButterworthFit:
    if best.status == "too_few_points" or best.freedom < 1:
        return best
    limit = best.chi_square + RIVAL * max(1.0, best.chi_square / best.freedom)
    rivals = [one for one in others if one.chi_square < limit]
    if not rivals:
        return best
    away = max(abs(one.cutoff_hz - best.cutoff_hz) for one in rivals)
    known = all(one.status == "ok" for one in [best, *rivals]) and away <= IDENTIFIED * best.cutoff_hz
    return replace(
        best,
        status="order_not_identified" if known else "cutoff_not_identified",
        gain_u=math.hypot(best.gain_u, max(abs(one.gain - best.gain) for one in rivals)),
        cutoff_u_hz=math.hypot(best.cutoff_u_hz, away),
        rivals=tuple(one for one in rivals if one.cutoff_hz),
    )


def _can_tell_highpass(frequency_hz: NDArray[np.float64]) -> bool:
    """Tell whether a high-pass can be told from a gain, which needs points far below the others.

    Where it can, it stays in the model even when it is not significant: leaving it out would push what the
    lowest points show into the gain.
    """
    lowest = frequency_hz.min()
    return bool(frequency_hz.max() > LOW_SPAN * lowest and np.unique(frequency_hz).size >= 5)


def _fit(
    frequency: NDArray[np.float64],
    gain: NDArray[np.float64],
    gain_u: NDArray[np.float64],
    order: int | None,
    highpass: bool,
    loss: Loss,
    start_order: float = 3.0,
) -> ButterworthFit:
    from scipy.optimize import least_squares

    count = 2 + (order is None) + highpass
    if frequency.size <= count or np.unique(frequency).size < count:
        return _no_fit("too_few_points", frequency.size)
    lowest = float(frequency.min())
    shape_order = start_order if order is None else float(order)
    gain0, cutoff0 = _grid_start(frequency, gain, gain_u, shape_order)
    start = np.array([math.log(gain0), math.log(cutoff0)])
    if order is None:
        start = np.append(start, math.log(shape_order))
    if highpass:
        start = np.append(start, 0.0)
    free = [True, True, order is None, highpass]
    box = _box(frequency, gain)

    def misfit(parameters: NDArray[np.float64]) -> NDArray[np.float64]:
        whole = np.clip(_whole(parameters, free, shape_order), *box)
        return (_model(whole, frequency, lowest)[0] - gain) / gain_u

    def slopes(parameters: NDArray[np.float64]) -> NDArray[np.float64]:
        whole = _whole(parameters, free, shape_order)
        inside = np.clip(whole, *box)
        moving = (whole == inside)[:, None] / gain_u
        rows: NDArray[np.float64] = (_model(inside, frequency, lowest)[1] * moving)[free]
        return rows.T

    solved = least_squares(
        misfit,
        start,
        jac=slopes,
        method="lm" if loss == "linear" else "trf",
        loss=loss,
        x_scale="jac",
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
    )
    whole = _whole(solved.x, free, shape_order)
    found = np.clip(whole, *box)
    if not np.array_equal(found, whole):
        return _no_fit("cutoff_not_identified", frequency.size, math.exp(found[0]), 2 * float(solved.cost))
    return _described(found, free, frequency, gain, gain_u, lowest, 2 * float(solved.cost))


def _box(
    frequency: NDArray[np.float64], gain: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return limits of (ln G, ln f_c, ln order, q / lowest**2), far from all that points can tell."""
    largest = math.log(max(float(gain.max()), 1e-300))
    # q may fall below zero by chance, but never so far that a gain would be infinite.
    low = [largest - 20, math.log(frequency.min() / 30), math.log(0.1), -0.75]
    high = [largest + 60, math.log(frequency.max() * 30), math.log(20.0), 1e6]
    return np.array(low), np.array(high)


def _whole(parameters: NDArray[np.float64], free: list[bool], order: float) -> NDArray[np.float64]:
    found = np.array([0.0, 0.0, math.log(order), 0.0])
    found[free] = parameters
    return found


def _model(
    parameters: NDArray[np.float64], frequency: NDArray[np.float64], lowest: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return gains (n,) and derivatives (4, n) for (ln G, ln f_c, ln order, q / lowest**2)."""
    log_gain, log_cutoff, log_order, q = parameters
    order = math.exp(log_order)
    power = 2 * order * (np.log(frequency) - log_cutoff)
    share = np.exp(-np.logaddexp(0.0, -power))
    squared = (lowest / frequency) ** 2
    passed = 1 + q * squared
    gains = np.exp(log_gain - 0.5 * np.logaddexp(0.0, power)) / np.sqrt(passed)
    slopes = np.stack([np.ones_like(frequency), order * share, -0.5 * share * power, -0.5 * squared / passed])
    return gains, slopes * gains


def _grid_start(
    frequency: NDArray[np.float64], gain: NDArray[np.float64], gain_u: NDArray[np.float64], order: float
) -> tuple[float, float]:
    # Points of one frequency (there is one for each amplitude) act as their weighted mean.
    frequencies, which = np.unique(frequency, return_inverse=True)
    weight = (gain_u.min() / gain_u) ** 2
    weights, products = np.bincount(which, weight), np.bincount(which, weight * gain)
    cutoffs = np.geomspace(frequency.min() / 4, frequency.max() * 8, GRID_POINTS)
    power = 2 * order * (np.log(frequencies)[None, :] - np.log(cutoffs)[:, None])
    shapes = np.exp(-0.5 * np.logaddexp(0.0, power))
    along, size = shapes @ products, shapes**2 @ weights
    # The best gain of each cut-off takes along**2 / size off the sum of squares.
    best = int(np.argmax(np.where(along > 0, along**2 / size, -1.0)))
    return max(float(along[best] / size[best]), 1e-300), float(cutoffs[best])


def _described(
    found: NDArray[np.float64],
    free: list[bool],
    frequency: NDArray[np.float64],
    gain: NDArray[np.float64],
    gain_u: NDArray[np.float64],
    lowest: float,
    chi_square: float,
) -> ButterworthFit:
    gains, slopes = _model(found, frequency, lowest)
    jacobian = (slopes / gain_u)[free].T
    # Scaled columns: the covariance of a well-posed fit must not depend on units.
    scale = np.linalg.norm(jacobian, axis=0)
    if not np.all(scale > 0) or np.linalg.cond(jacobian / scale) > 1e8:
        return _no_fit("cutoff_not_identified", frequency.size, math.exp(found[0]), chi_square)
    inverse = np.linalg.pinv(jacobian / scale) / scale[:, None]
    freedom = frequency.size - jacobian.shape[1]
    covariance = inverse @ inverse.T * _birge(chi_square, freedom)
    spread = np.zeros(4)
    spread[free] = np.sqrt(np.diag(covariance))
    pull = np.zeros((4, frequency.size))
    pull[free] = inverse * (gains / gain_u)
    q, q_u = found[3] * lowest**2, spread[3] * lowest**2
    pull[3] *= lowest**2
    highpass = math.sqrt(q) if q > HIGHPASS_SIGNIFICANCE * q_u > 0 else 0.0
    cutoff = math.exp(min(found[1], 700.0))
    return ButterworthFit(
        status="ok" if spread[1] <= IDENTIFIED else "cutoff_not_identified",
        gain=math.exp(found[0]),
        cutoff_hz=cutoff,
        order=math.exp(found[2]) if free[2] else round(math.exp(found[2])),
        highpass_hz=highpass,
        gain_u=math.exp(found[0]) * spread[0],
        cutoff_u_hz=cutoff * spread[1],
        order_u=math.exp(found[2]) * spread[2],
        highpass_u_hz=q_u / (2 * highpass) if highpass else 0.0,
        chi_square=chi_square,
        freedom=freedom,
        highpass_squared_hz2=float(q),
        _pull=pull,
    )


def _birge(chi_square: float, freedom: int) -> float:
    from scipy.special import gammaincc

    if freedom < 1 or gammaincc(freedom / 2, chi_square / 2) >= BIRGE_PROBABILITY:
        return 1.0
    return chi_square / freedom


def _no_fit(status: Status, count: int, gain: float = 0.0, chi_square: float = math.inf) -> ButterworthFit:
    return ButterworthFit(
        status=status,
        gain=gain,
        cutoff_hz=0.0,
        order=0.0,
        highpass_hz=0.0,
        gain_u=0.0,
        cutoff_u_hz=0.0,
        order_u=0.0,
        highpass_u_hz=0.0,
        chi_square=chi_square,
        freedom=0,
        highpass_squared_hz2=0.0,
        _pull=np.zeros((4, count)),
    )
