"""A fit of the known response in coloured noise: what the ground can do with a correlation window.

A Gaussian is the wrong shape for a short echo behind a filter, and equal weights are wrong for coloured
noise. Where the response of laser and receiver is known, and so is the covariance of the noise, samples and
response are whitened (Cholesky), and arrival and amplitude follow by least squares: the maximum of the
likelihood, which reaches the Cramer-Rao bound at a few times the noise.

What this does not model: noise that depends on the signal, and a response that is not the true one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.errors import RefusedInput
from belahil.pulse_bound import bound

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

Response = Callable[["NDArray[np.float64]"], "NDArray[np.float64]"]
"""Volts of a pulse of amplitude 1 that arrives at 0, at times in s: `sim.kernel.Kernel.at`, for one."""

_PHASES = 8
"""Starting points in a sample interval."""
_SETTLED = 1e-7
"""Of the way between two of them: far below what any noise permits to know."""
_DIFFERENCE = 1e-3
"""Of a sample interval: for derivatives by time; its square is lost."""


@dataclass(frozen=True, slots=True)
class WhitenedPulse:
    """What a `WhitenedFit` found.

    Parameters
    ----------
    status : {"ok", "no_pulse"}
        ``no_pulse``: the response fits nowhere with a positive amplitude.
    arrival_s, amplitude : float
        s after the first sample; in units of the response. 0 without a pulse.
    arrival_uncertainty_s, amplitude_uncertainty : float
        Standard deviations by the Cramer-Rao bound at the fit.
    misfit : float
        Sum of the squared whitened residuals over its degrees of freedom: about 1 where the model holds.
    """

    status: Literal["ok", "no_pulse"]
    arrival_s: float = 0.0
    amplitude: float = 0.0
    arrival_uncertainty_s: float = 0.0
    amplitude_uncertainty: float = 0.0
    misfit: float = 0.0


@dataclass(frozen=True, eq=False)
class WhitenedFit:
    """A fit, prepared for many windows.

    Parameters
    ----------
    response : callable
        The known response: volts at times (s) from its arrival. Its scale is the unit of the amplitude.
    noise_covariance : ndarray of float64, shape (n, n)
        Of the samples of a window, V^2; see `belahil.pulse_bound.filtered_noise_covariance`.
    sample_interval_s : float
        s.
    edge_samples : int
        Arrivals nearer to an edge of the window are not searched.

    Raises
    ------
    RefusedInput
        A covariance that is not square and positive definite, or nothing left between the edges.
    """

    response: Response
    noise_covariance: NDArray[np.float64]
    sample_interval_s: float
    edge_samples: int = 4

    def __post_init__(self) -> None:
        shape = self.noise_covariance.shape
        if len(shape) != 2 or shape[0] != shape[1] or shape[0] <= 2 * self.edge_samples + 1:
            raise RefusedInput(
                f"noise covariance of shape {shape} with {self.edge_samples} samples left out at each edge: "
                "it must be square and hold more"
            )
        if not self.sample_interval_s > 0:
            raise RefusedInput(f"sample interval {self.sample_interval_s!r} s: must be above zero")
        if self._whitener.size == 0 or not self._grid[1].any():
            raise RefusedInput("a response that is zero in the whole window cannot be fitted")

    def fit(self, volts: ArrayLike) -> WhitenedPulse:
        """Fit a window.

        Parameters
        ----------
        volts : array_like of float, shape (n,)
            As many samples as the covariance has.

        Raises
        ------
        RefusedInput
            Another shape, or samples that are not finite.
        """
        samples = np.asarray(volts, dtype=np.float64)
        if samples.shape != self.noise_covariance.shape[:1] or not np.isfinite(samples).all():
            raise RefusedInput(
                f"samples of shape {samples.shape}: {self.noise_covariance.shape[:1]} finite ones are allowed"
            )
        white = self._whitener @ samples
        arrivals_s, shapes = self._grid
        scores = shapes @ white
        best = int(np.argmax(scores))
        if not scores[best] > 0:
            return WhitenedPulse("no_pulse")
        arrival_s = self._best_arrival(white, float(arrivals_s[best]))
        amplitude = self._project(white, arrival_s)[0]
        if not amplitude > 0:
            return WhitenedPulse("no_pulse")
        left = white - amplitude * self._white_response(arrival_s)
        arrival_uncertainty_s, amplitude_uncertainty = self.bound(arrival_s, amplitude)
        return WhitenedPulse(
            "ok",
            arrival_s,
            amplitude,
            arrival_uncertainty_s,
            amplitude_uncertainty,
            float(left @ left) / (white.size - 2),
        )

    def bound(self, arrival_s: float, amplitude: float) -> tuple[float, float]:
        """Return the least standard deviations of arrival (s) and amplitude, both unknown (Cramer-Rao).

        Parameters
        ----------
        arrival_s, amplitude : float
            Of the pulse; the amplitude not zero.
        """
        gradient = np.stack([amplitude * self._white_slope(arrival_s), self._white_response(arrival_s)])
        least = bound(gradient, 1.0)
        return math.sqrt(least[0, 0]), math.sqrt(least[1, 1])

    def _best_arrival(self, white: NDArray[np.float64], near_s: float) -> float:
        """Climb from the best starting point to the top between its neighbours, by Brent's method.

        Gauss-Newton steps would converge slowly here: with noise of a tenth of a short echo the curvature of
        the response counts.
        """
        from scipy.optimize import minimize_scalar

        step_s = self.sample_interval_s / _PHASES

        def lost(steps: float) -> float:
            return -self._project(white, near_s + steps * step_s)[1]

        return near_s + step_s * float(
            minimize_scalar(lost, bounds=(-1.0, 1.0), method="bounded", options={"xatol": _SETTLED}).x
        )

    def _project(self, white: NDArray[np.float64], arrival_s: float) -> tuple[float, float]:
        """Return the best amplitude at an arrival, and how much of the samples it explains."""
        shape = self._white_response(arrival_s)
        along, norm = float(shape @ white), float(shape @ shape)
        return (along / norm, along * along / norm) if norm > 0 else (0.0, 0.0)

    @cached_property
    def _whitener(self) -> NDArray[np.float64]:
        try:
            root = np.linalg.cholesky(self.noise_covariance)
        except np.linalg.LinAlgError:
            raise RefusedInput("a noise covariance that is not positive definite") from None
        return np.asarray(np.linalg.inv(root))

    @cached_property
    def _times_s(self) -> NDArray[np.float64]:
        return self.sample_interval_s * np.arange(float(self.noise_covariance.shape[0]))

    @cached_property
    def _grid(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Starting points, and the whitened response of unit norm at each, shape (points, n)."""
        last = self.noise_covariance.shape[0] - 1 - self.edge_samples
        arrivals_s = self.sample_interval_s * np.arange(self.edge_samples, last + 0.5 / _PHASES, 1 / _PHASES)
        shapes = np.array([self._white_response(float(arrival_s)) for arrival_s in arrivals_s])
        norm = np.linalg.norm(shapes, axis=1, keepdims=True)
        return arrivals_s, np.divide(shapes, norm, out=np.zeros_like(shapes), where=norm > 0)

    def _white_response(self, arrival_s: float) -> NDArray[np.float64]:
        return np.asarray(self._whitener @ self.response(self._times_s - arrival_s))

    def _white_slope(self, arrival_s: float) -> NDArray[np.float64]:
        """Derivative by the arrival."""
        away_s = _DIFFERENCE * self.sample_interval_s
        since_s = self._times_s - arrival_s
        rise = self.response(since_s - away_s) - self.response(since_s + away_s)
        return np.asarray(self._whitener @ rise / (2 * away_s))
