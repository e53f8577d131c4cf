"""What a receiver makes of a transmitted pulse that was cut at a threshold, for every threshold quickly.

A mode of the filter that is driven by the whole pulse has the state x(t). Where the pulse passes only from
t1 to t2, its state is x(t) - exp(p (t - t1)) x(t1) inside, and exp(p (t - t2)) times its last value after. So
one pass over the pulse gives the response to any cut in closed form, and a table over thresholds with cubic
splines between them gives it in microseconds.

A soft edge, of which a part passes that rises in a straight line over a width w about the threshold, is the
mean of hard cuts over thresholds from q - w/2 to q + w/2; the antiderivative of the same splines holds it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from belahil.pole_modes import modes, ordered_poles
from belahil.pole_response import phi

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray
    from scipy.interpolate import CubicSpline

    from procedures.tx_pulse import OpticalPulse

HIGHEST = 0.97
"""Highest threshold that is looked at: what is left is an impulse to the filter, whatever the threshold."""

_THRESHOLDS = 161
_NARROWEST = 1e-6
"""A soft edge below this width is a hard one."""


@dataclass(frozen=True, eq=False)
class CutResponses:
    """Responses of a filter to a pulse above any threshold, on a grid of times.

    Parameters
    ----------
    pulse : OpticalPulse
        Before the cut; its peak is at time 0.
    poles : tuple of complex
        Of the filter, rad/s.
    zeros : int
        As in `belahil.pole_modes`.
    times_s : ndarray of float64, shape (m,)
        Where the responses are wanted, s after the peak.
    """

    pulse: OpticalPulse
    poles: tuple[complex, ...]
    zeros: int
    times_s: NDArray[np.float64]

    def exact(self, threshold: float) -> NDArray[np.float64]:
        """Return the response to what is not below a threshold, shape (m,), for a peak of 1 V before it."""
        return self.between(self.pulse.above(threshold))

    def between(self, stretches: Iterable[tuple[float, float]]) -> NDArray[np.float64]:
        """Return the response to the pulse within stretches of time, shape (m,)."""
        total = np.zeros(self.times_s.size)
        for begin_s, end_s in stretches:
            inside = (self.times_s >= begin_s) & (self.times_s < end_s)
            after = self.times_s >= end_s
            for pole, weight, states in self._driven:
                begun, ended = self._at(pole, states, np.array([begin_s, end_s]))
                left = ended - np.exp(pole * (end_s - begin_s)) * begun
                here = self._whole(pole)[inside] - np.exp(pole * (self.times_s[inside] - begin_s)) * begun
                total[inside] += (weight * here).real
                total[after] += (weight * left * np.exp(pole * (self.times_s[after] - end_s))).real
        return total

    def hard(self, threshold: float) -> NDArray[np.float64]:
        """Return `exact` from the table, shape (m,); thresholds from 0 to `HIGHEST`.

        The error is below 1e-5 of the response's peak (`tests/test_tx_response.py`).
        """
        return np.asarray(self._spline(threshold))

    def soft(self, threshold: float, width: float) -> NDArray[np.float64]:
        """Return the response behind a soft edge, shape (m,).

        Parameters
        ----------
        threshold, width : float
            Of the peak; `threshold + width / 2` at most `HIGHEST`. Below 0 everything passes.
        """
        if width < _NARROWEST:
            return self.hard(threshold)
        low, high = threshold - width / 2, threshold + width / 2
        whole = max(-low, 0.0) * self.hard(0.0)
        return np.asarray((whole + self._area(high) - self._area(max(low, 0.0))) / width)

    @cached_property
    def _spline(self) -> CubicSpline:
        from scipy.interpolate import CubicSpline

        # Denser towards both ends, where the crossings move fastest.
        nodes = HIGHEST * np.sin(np.linspace(0, np.pi / 2, _THRESHOLDS)) ** 2
        return CubicSpline(nodes, [self.exact(float(one)) for one in nodes])

    @cached_property
    def _area(self) -> CubicSpline:
        return self._spline.antiderivative()

    @cached_property
    def _driven(self) -> list[tuple[complex, complex, NDArray[np.complex128]]]:
        """Pole, weight, and the state at each point of the pulse, of every mode."""
        found = []
        for pole, weight in modes(ordered_poles(self.poles, self.zeros), self.zeros):
            found.append((pole, weight, self._states(pole)))
        return found

    def _states(self, pole: complex) -> NDArray[np.complex128]:
        from scipy.signal import lfilter

        step_s, power = self.pulse.step_s, self.pulse.relative
        first, second = (complex(one[0]) for one in phi(np.array([pole * step_s])))
        drive = step_s * ((first - second) * power[:-1] + second * power[1:])
        moved = lfilter([1.0], [1.0, -np.exp(pole * step_s)], drive)
        return np.concatenate([[0j], moved])

    def _whole(self, pole: complex) -> NDArray[np.complex128]:
        return self._wholes[pole]

    @cached_property
    def _wholes(self) -> dict[complex, NDArray[np.complex128]]:
        return {pole: self._at(pole, states, self.times_s) for pole, _, states in self._driven}

    def _at(
        self, pole: complex, states: NDArray[np.complex128], times_s: NDArray[np.float64]
    ) -> NDArray[np.complex128]:
        """State of a mode of weight 1 at any times, driven by the whole pulse."""
        pulse = self.pulse
        place = np.floor((times_s - pulse.first_s) / pulse.step_s)
        piece = np.clip(place, 0, pulse.relative.size - 2).astype(np.intp)
        since_s = np.clip(times_s - (pulse.first_s + piece * pulse.step_s), 0, pulse.step_s)
        first, second = phi(np.asarray(pole * since_s, dtype=np.complex128))
        left, right = pulse.relative[piece], pulse.relative[piece + 1]
        value = states[piece] * np.exp(pole * since_s)
        value = value + since_s * (first * left + second * (right - left) * since_s / pulse.step_s)
        value = value * np.exp(pole * np.maximum(times_s - pulse.last_s, 0))
        return np.asarray(np.where(times_s < pulse.first_s, 0, value))
