"""The likelihood of a pulse's shape over many windows, each with an amplitude and an arrival of its own.

The samples of a window are a g(t - tau) plus noise. The noise was white before the receiver's filter, so its
covariance follows from the filter's poles, and quantization adds 1/12 of a squared count; samples and
response are whitened with it. For a shape g the best amplitude is linear, and the best arrival is the top of
the explained chi-square u^2 / s along tau, with u the product of samples and response and s its square. Both
are found from the responses at 32 arrivals in a sample interval, by polynomials of degree 4 between them.

Arrivals that are fitted in each window pull the common shape: every window adds a bias of second order in the
noise (Box 1971, J. R. Stat. Soc. B 33, for nonlinear least squares), which does not shrink with the number of
windows. Half of the logarithm of each arrival's information takes it away.

What this does not model: noise of the light, noise that is not stationary, and a response that depends on the
amplitude.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.errors import RefusedInput
from belahil.pulse_bound import filtered_noise_covariance

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from procedures.known_receiver import KnownReceiver

PHASES = 32
"""Arrivals in a sample interval at which responses are computed."""

Baseline = Literal["common", "window"]
_AROUND = np.arange(-2, 3)
_POLYNOMIAL = np.linalg.inv(np.vander(_AROUND, increasing=True)).T
_STEPS = 4
_NOTHING = 1e-200


@dataclass(frozen=True, slots=True)
class SegmentGrid:
    """The samples of a window round its pulse, and the times at which responses are needed for them.

    Parameters
    ----------
    sample_interval_s : float
        s.
    before, count : int
        Samples before the arrival, and in all.
    """

    sample_interval_s: float
    before: int
    count: int

    @property
    def times_s(self) -> NDArray[np.float64]:
        """Times after the arrival, s, in steps of a 32nd of the sample interval."""
        first, last = -(self.before + 2) * PHASES, (self.count - self.before + 1) * PHASES
        steps = np.arange(first, last + 1)
        return np.asarray(steps * (self.sample_interval_s / PHASES), dtype=np.float64)

    @property
    def arrivals(self) -> NDArray[np.int64]:
        """Arrivals after sample `before`, in 32nds of a sample: from one sample early to two late."""
        return np.arange(-PHASES, 2 * PHASES + 1)

    @property
    def places(self) -> NDArray[np.int64]:
        """Index into `times_s` of every sample (columns) for every arrival (rows)."""
        sample = (np.arange(self.count) - self.before) * PHASES
        return sample - self.arrivals[:, None] + (self.before + 2) * PHASES


@dataclass(frozen=True, slots=True, eq=False)
class WindowFits:
    """What the fit of one shape makes of each window.

    Parameters
    ----------
    explained : ndarray of float64, shape (n,)
        Part of the chi-square that the shape takes away.
    arrival : ndarray of float64, shape (n,)
        After sample `SegmentGrid.before` of the segment, in samples.
    amplitude_v : ndarray of float64, shape (n,)
        Height before the cut, V at the converter.
    log_information : ndarray of float64, shape (n,)
        Logarithm of the information on the arrival for amplitude 1, relative to that on the amplitude.
    """

    explained: NDArray[np.float64]
    arrival: NDArray[np.float64]
    amplitude_v: NDArray[np.float64]
    log_information: NDArray[np.float64]

    @property
    def merit(self) -> float:
        """Twice the log-likelihood up to a constant, without the bias of fitted arrivals."""
        return float(self.explained.sum() - 0.5 * self.log_information.sum())


@dataclass(frozen=True, eq=False)
class PulseLikelihood:
    """Whitened windows of one receiver, ready to be compared with any shape.

    Parameters
    ----------
    grid : SegmentGrid
        Of every segment.
    whitener : ndarray of float64, shape (k, count)
        Takes samples to independent ones of unit variance; a free baseline is projected out.
    white : ndarray of float64, shape (n, k)
        Whitened segments.
    odd : ndarray of bool, shape (n,)
        Segments that begin with an odd sample of their window.
    skew_s : float
        Even samples are taken half of it later, odd ones half of it earlier, s.
    """

    grid: SegmentGrid
    whitener: NDArray[np.float64]
    white: NDArray[np.float64]
    odd: NDArray[np.bool_]
    skew_s: float = 0.0

    def __len__(self) -> int:
        return int(self.white.shape[0])

    def templates(self, response: NDArray[np.float64], odd: bool = False) -> NDArray[np.float64]:
        """Return the whitened response at each arrival of the grid, shape (arrivals, k).

        Parameters
        ----------
        response : ndarray of float64, shape (m,)
            At `SegmentGrid.times_s`.
        odd : bool
            For segments that begin with an odd sample.
        """
        samples = response[self._places]
        if self.skew_s:
            slope = np.gradient(response, self.grid.sample_interval_s / PHASES)
            late = np.where((np.arange(self.grid.count) + odd) % 2, -0.5, 0.5) * self.skew_s
            samples = samples + late * slope[self._places]
        return np.asarray(samples @ self.whitener.T)

    def fit(self, response: NDArray[np.float64]) -> WindowFits:
        """Fit amplitude and arrival of a shape in every window.

        Parameters
        ----------
        response : ndarray of float64, shape (m,)
            At `SegmentGrid.times_s`, on any scale.
        """
        found = np.empty((4, len(self)))
        for odd in (False, True) if self.skew_s else (None,):
            rows = slice(None) if odd is None else self.odd == odd
            found[:, rows] = _profile(self.white[rows], self.templates(response, bool(odd)))
        explained, arrival, amplitude_v, log_information = found
        return WindowFits(explained, arrival + self.grid.arrivals[0] / PHASES, amplitude_v, log_information)

    def expected(self, response: NDArray[np.float64], amplitude_v: float) -> PulseLikelihood:
        """Return windows without noise of a shape, at 16 arrivals spread over a sample.

        Parameters
        ----------
        response : ndarray of float64, shape (m,)
            As in `fit`.
        amplitude_v : float
            V.
        """
        rows = slice(PHASES, 2 * PHASES, 2)
        white = np.concatenate([self.templates(response, odd)[rows] for odd in self._orders])
        odd = np.repeat(self._orders, PHASES // 2)
        return replace(self, white=amplitude_v * white, odd=odd)

    @property
    def _orders(self) -> list[bool]:
        return [False, True] if self.skew_s else [False]

    @cached_property
    def _places(self) -> NDArray[np.int64]:
        return self.grid.places


def _profile(white: NDArray[np.float64], templates: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return explained chi-square, arrival (samples after the first template), amplitude, log information."""
    # A response of nothing explains nothing.
    square = np.maximum(np.einsum("kn,kn->k", templates, templates), _NOTHING)
    product = white @ templates.T
    slope = np.gradient(templates, axis=0) * PHASES
    along = np.einsum("kn,kn->k", slope, templates)
    relative = (np.einsum("kn,kn->k", slope, slope) - along**2 / square) / square
    explained = np.where(product > 0, product, 0.0) ** 2 / square
    top = np.clip(explained.argmax(axis=1), 2, square.size - 3)
    near = top[:, None] + _AROUND
    u_terms = np.take_along_axis(product, near, axis=1) @ _POLYNOMIAL
    s_terms = square[near] @ _POLYNOMIAL
    place = np.zeros(top.size)
    for _ in range(_STEPS):
        (u, u1, u2), (s, s1, s2) = _derivatives(u_terms, place), _derivatives(s_terms, place)
        with np.errstate(divide="ignore", invalid="ignore"):
            rise = 2 * u1 / u - s1 / s
            bend = 2 * (u2 / u - (u1 / u) ** 2) - (s2 / s - (s1 / s) ** 2)
            step = np.where((bend < 0) & (u > 0), -rise / bend, 0.0)
        place = np.clip(place + step, -1.5, 1.5)
    u, s = _derivatives(u_terms, place)[0], _derivatives(s_terms, place)[0]
    u = np.maximum(u, 0.0)
    # Between arrivals of a response that is too fast for its samples a polynomial may fall below zero.
    least = np.maximum(relative[near].min(axis=1), _NOTHING)
    information = np.maximum(_derivatives(relative[near] @ _POLYNOMIAL, place)[0], least)
    return np.stack([u * u / s, (top + place) / PHASES, u / s, np.log(information)])


def _derivatives(terms: NDArray[np.float64], at: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Value and two derivatives of polynomials of degree 4, one a row, each at a place of its own."""
    value, first, second = terms[:, 4], np.zeros(at.size), np.zeros(at.size)
    for power in (3, 2, 1, 0):
        second = second * at + 2 * first
        first = first * at + value
        value = value * at + terms[:, power]
    return value, first, second


def whitener(
    receiver: KnownReceiver, count: int, noise_rms_v: float, white_rms_v: float, baseline: Baseline
) -> NDArray[np.float64]:
    """Return what whitens segments of a receiver, shape (k, count).

    Parameters
    ----------
    receiver : KnownReceiver
        Its poles colour the noise.
    count : int
        Samples of a segment.
    noise_rms_v, white_rms_v : float
        Analog noise, and what comes after the filter, as quantization does; V at the converter.
    baseline : {"common", "window"}
        With "window" a constant is projected out of every window, and its information is spent.

    Raises
    ------
    RefusedInput
        There is no noise at all.
    """
    if not math.hypot(noise_rms_v, white_rms_v) > 0:
        raise RefusedInput("windows without any noise and quantization: they have no likelihood")
    covariance = filtered_noise_covariance(
        receiver.poles, receiver.zeros, receiver.true_interval_s, count, noise_rms_v, white_rms_v
    )
    found = np.linalg.inv(np.linalg.cholesky(covariance))
    if baseline == "window":
        level = found.sum(axis=1)
        level /= np.linalg.norm(level)
        found = found - np.outer(level, level @ found)
    return np.asarray(found)
