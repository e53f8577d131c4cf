"""The parts of a `sim.kernel.Kernel`: its table, its late part, and the answer to a pulse from a table."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.pole_response import phi

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Response = Callable[["NDArray[np.float64]"], "NDArray[np.float64]"]

_MOST_POINTS = 200_000
_ENDED = 40.0
"""Time constants, after which an exponential is below 1e-17."""

# Row k: the coefficient of u^k of the polynomial through the values at u = -2, -1, 0, 1, 2, 3.
_QUINTIC = np.linalg.inv(np.vander(np.arange(-2.0, 4.0), increasing=True))


@dataclass(frozen=True, eq=False)
class Late:
    """A sum of decaying exponentials, the real part of ``values exp(poles (t - begin_s))``.

    Parameters
    ----------
    begin_s : float
        When it begins to hold, s.
    poles, values : ndarray of complex128, shape (n,)
        rad/s; what the exponentials are at `begin_s`.
    ends_s : float
        When the last of them is below 1e-17 of its beginning, s.
    """

    begin_s: float
    poles: NDArray[np.complex128]
    values: NDArray[np.complex128]
    ends_s: float

    @classmethod
    def of(cls, begin_s: float, found: Sequence[tuple[complex, complex]]) -> Late:
        """Make it from (pole, value) at `begin_s`; those that are zero do not count."""
        kept = [(pole, value) for pole, value in found if value]
        poles = np.array([pole for pole, _ in kept], dtype=np.complex128)
        slowest = -poles.real.max() if poles.size else math.inf
        values = np.array([value for _, value in kept], dtype=np.complex128)
        return cls(begin_s, poles, values, begin_s + _ENDED / slowest)

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the sum at times from `begin_s` on, shape (n,)."""
        since = times_s - self.begin_s
        with np.errstate(under="ignore"):
            return np.asarray(np.exp(np.multiply.outer(since, self.poles)) @ self.values).real.copy()


@dataclass(frozen=True, eq=False)
class KernelTable:
    """Polynomials of degree five on equal steps, through six values each; `late` after the last.

    Parameters
    ----------
    first_s, step_s : float
        Where the first polynomial begins; its length, s.
    coefficients : ndarray of float64, shape (6, n)
        Of the powers of the part of a step.
    late : Late
        What holds after the last polynomial.
    error : float
        The largest found between the values, relative to the largest value.
    """

    first_s: float
    step_s: float
    coefficients: NDArray[np.float64]
    late: Late
    error: float

    @classmethod
    def build(
        cls, exact: Response, starts_s: float, late: Late, scale_s: float, tolerance: float
    ) -> KernelTable | None:
        """Choose the step so that the error between the values is within a tolerance.

        Parameters
        ----------
        exact : callable
            The function, of times in s, zero before `starts_s`.
        starts_s : float
            s.
        late : Late
            Holds from its beginning on. Slow exponentials are left to it.
        scale_s : float
            Time in which the function changes, s: where to begin the search.
        tolerance : float
            Relative to the largest value.

        Returns
        -------
        KernelTable or None
            None where more than 200 000 values would be needed: the function is not smooth enough.
        """
        step_s, fastest = scale_s / 2, float(np.abs(late.poles).max(initial=0.0))
        decay = _ENDED / fastest * 4 if fastest else 0.0
        while True:
            ends_s = min(late.ends_s, late.begin_s + decay)
            count = math.ceil((ends_s - starts_s) / step_s) + 1
            if count > _MOST_POINTS:
                return None
            values = exact(starts_s + step_s * np.arange(-2.0, count + 3))
            coefficients = _QUINTIC @ np.lib.stride_tricks.sliding_window_view(values, 6).T
            between = exact(starts_s + step_s * np.arange(0.5, count))
            halves = 0.5 ** np.arange(6)
            error = float(np.abs(halves @ coefficients - between).max() / np.abs(values).max())
            if error <= tolerance:
                return cls(starts_s, step_s, coefficients, late, error)
            step_s *= min(0.9, max(0.25, 0.9 * (tolerance / error) ** (1 / 6)))

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the function, with the shape of `times_s`."""
        flat = times_s.ravel()
        places = (flat - self.first_s) / self.step_s
        count = self.coefficients.shape[1]
        index = np.clip(np.floor(places), 0, count - 1).astype(np.intp)
        part = places - index
        six = self.coefficients[:, index]
        value = six[5]
        for k in range(4, -1, -1):
            value = value * part + six[k]
        value[places < 0] = 0.0
        over = places >= count
        if over.any():
            value[over] = self.late.at(flat[over])
        return np.asarray(value.reshape(times_s.shape))


@dataclass(frozen=True, eq=False)
class TableStates:
    """A mode of weight 1, driven by straight lines between break points: its state at each of them."""

    times_s: NDArray[np.float64]
    values: NDArray[np.float64]
    pole: complex
    states: NDArray[np.complex128]

    @property
    def last(self) -> complex:
        """State at the last break point."""
        return complex(self.states[-1])

    def at(self, lags_s: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the mode at any times, zero before the first break point."""
        last = self.times_s.size - 1
        piece = np.searchsorted(self.times_s, lags_s, side="right") - 1
        inside = np.clip(piece, 0, last - 1)
        since = lags_s - self.times_s[inside]
        over = piece >= last
        elapsed = np.where((piece >= 0) & ~over, since, 0.0)
        first, second = phi(self.pole * elapsed)
        left, right = self.values[inside], self.values[inside + 1]
        rise = (right - left) / np.diff(self.times_s)[inside]
        value = self.states[inside] * np.exp(self.pole * elapsed)
        value = value + elapsed * (first * left + second * rise * elapsed)
        after = np.where(over, lags_s - self.times_s[-1], 0.0)
        value = np.where(over, self.states[-1] * np.exp(self.pole * after), value)
        return np.asarray(np.where(piece < 0, 0.0, value))


def table_states(times_s: NDArray[np.float64], values: NDArray[np.float64], pole: complex) -> TableStates:
    """Drive a mode 1 / (s - pole) by straight lines between break points, in closed form.

    Parameters
    ----------
    times_s, values : ndarray of float64, shape (n,)
        Rising, s; the drive there. It is zero outside.
    pole : complex
        rad/s, in the left half plane.
    """
    width = np.diff(times_s)
    first, second = phi(np.asarray(pole * width, dtype=np.complex128))
    push = width * ((first - second) * values[:-1] + second * values[1:])
    states = np.zeros(times_s.size, dtype=np.complex128)
    for k, (decay, added) in enumerate(zip(np.exp(pole * width), push, strict=True)):
        states[k + 1] = states[k] * decay + added
    return TableStates(times_s, values, pole, states)
