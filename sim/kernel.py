"""What a receiver makes of a laser pulse: K(t), volts for one photon a second times one second.

The transmitted pulse and the receiver's poles are one response in the s-plane. It has a closed form at any
lag (partial fractions and the Faddeeva function), so there is no time step. A table serves where many lags
are asked for, and taps serve where the lags lie on a grid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput
from belahil.pole_modes import modes, ordered_poles, transfer
from sim.kernel_table import KernelTable, Late, TableStates, table_states
from sim.pulse_shape import PulseShape

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from sim.pulse_shape import PulsePiece

_GAUSSIAN_END = 9.0
"""Standard deviations, after which a Gaussian is below 1e-17 of its peak."""

_NO_TAIL = 1e-17
"""Of the Gaussian's width: a tail so short moves nothing in double precision."""


@dataclass(frozen=True)
class Kernel:
    """The response of a filter to a pulse of unit area.

    Parameters
    ----------
    pulse : PulseShape
        S_T.
    poles : tuple of complex
        Of the filter, rad/s. None: the pulse itself, which gives photon rates instead of volts.
    zeros : int
        Zeros at s = 0, which make high-passes of the slowest poles, as in `belahil.pole_modes`.
    gain : float
        In the pass band.
    tolerance : float
        Error of `at`, relative to the peak.

    Raises
    ------
    RefusedInput
        Poles that are not stable or not conjugate, zeros without poles, or a tolerance outside 1e-13 to 1.
    """

    pulse: PulseShape
    poles: tuple[complex, ...] = ()
    zeros: int = 0
    gain: float = 1.0
    tolerance: float = 1e-7

    def __post_init__(self) -> None:
        if not 1e-13 <= self.tolerance < 1:
            raise RefusedInput(f"tolerance {self.tolerance!r} of a kernel: must be 1e-13 to below 1")
        if self.poles or self.zeros:
            ordered_poles(self.poles, self.zeros)

    def exact(self, lags_s: ArrayLike) -> NDArray[np.float64]:
        """Return K in closed form, with the shape of `lags_s`.

        Error: below 1e-12 of the peak for any width of the pulse and any gap between poles.
        """
        lags = np.asarray(lags_s, dtype=np.float64)
        if not self.poles:
            return self.gain * self.pulse.density(lags)
        total = np.zeros(lags.shape)
        for piece in self.pulse.pieces:
            for pole, weight in self._piece_modes(piece):
                since = lags - piece.offset_s
                total += piece.weight * (weight * gaussian_response(pole, piece.sigma_s, since)).real
        if not self.pulse.pieces:
            for weight, states in self._driven_modes:
                total += (weight * states.at(lags)).real
        return self.gain * total

    def at(self, lags_s: ArrayLike) -> NDArray[np.float64]:
        """Return K within the tolerance, with the shape of `lags_s`, from a table where one is possible.

        There is none where the pulse jumps behind fewer than three poles; then this is `exact`.
        """
        lags = np.asarray(lags_s, dtype=np.float64)
        return self.exact(lags) if self.table is None else self.table.at(lags)

    def transform(self, frequency_hz: ArrayLike) -> NDArray[np.complex128]:
        """Return the Fourier transform of K, the integral of K e^(-j 2 pi f t), shaped as its input."""
        s = 2j * np.pi * np.asarray(frequency_hz, dtype=np.float64)
        passed = self.gain * self.pulse.transform(s)
        if self.poles:
            passed *= transfer(ordered_poles(self.poles, self.zeros), self.zeros, s)
        return np.asarray(passed)

    def widened(self, sigma_s: float) -> Kernel:
        """Return this kernel behind a Gaussian of `sigma_s`: a tilted plane, or a Gaussian filter.

        Raises
        ------
        RefusedInput
            The pulse is a table.
        """
        if sigma_s == 0:
            return self
        if not self.pulse.pieces:
            raise RefusedInput("a pulse from a table has no closed form behind a Gaussian")
        pieces = tuple(
            replace(piece, sigma_s=math.hypot(piece.sigma_s, sigma_s)) for piece in self.pulse.pieces
        )
        return replace(self, pulse=PulseShape(pieces))

    def taps(self, step_s: float, phase_s: float, last_s: float) -> tuple[NDArray[np.float64], int]:
        """Return K at ``phase_s + q step_s`` for whole q, and the first q.

        Parameters
        ----------
        step_s : float
            Above zero.
        phase_s : float
            0 to below `step_s`.
        last_s : float
            Up to here; earlier where K has ended.

        Returns
        -------
        taps : ndarray of float64, shape (n,)
            Without a phase they are in closed form, read-only and kept for the next call; else as `at`.
        first : int
            K is zero, to 1e-17 of its peak, before it.
        """
        if phase_s == 0:
            return _whole_taps(self, step_s, last_s)
        lags_s, first = self._tap_lags(step_s, phase_s, last_s)
        return self.at(lags_s), first

    def _tap_lags(self, step_s: float, phase_s: float, last_s: float) -> tuple[NDArray[np.float64], int]:
        first = math.ceil((self.starts_s - phase_s) / step_s)
        last = math.floor((min(last_s, self.ends_s) - phase_s) / step_s)
        return phase_s + step_s * np.arange(first, max(last, first) + 1.0), first

    @cached_property
    def table(self) -> KernelTable | None:
        """The table behind `at`, None where there is none; made when first asked for."""
        if not self.poles:
            return None
        return KernelTable.build(self.exact, self.starts_s, self._late, self.finest_s, self.tolerance)

    @cached_property
    def starts_s(self) -> float:
        """Lag before which K is below 1e-17 of its peak, s."""
        if not self.pulse.pieces:
            return float(self.pulse.times_s[0])
        return min(piece.offset_s - _GAUSSIAN_END * piece.sigma_s for piece in self.pulse.pieces)

    @cached_property
    def ends_s(self) -> float:
        """Lag after which K is below 1e-17 of its peak, s."""
        return self._late.ends_s

    @cached_property
    def finest_s(self) -> float:
        """Time that K needs to change: width of the pulse and time of the fastest pole together, s."""
        fastest = max(map(abs, self.poles), default=math.inf)
        if not self.pulse.pieces:
            return min(1 / fastest + 0.25 * self.pulse.std_s, self.pulse.std_s)
        return math.hypot(1 / fastest, min(piece.sigma_s for piece in self.pulse.pieces))

    @cached_property
    def _own_modes(self) -> tuple[tuple[complex, complex], ...]:
        return modes(ordered_poles(self.poles, self.zeros), self.zeros)

    @cached_property
    def _driven_modes(self) -> tuple[tuple[complex, TableStates], ...]:
        """Weights of the modes, and the modes driven by a pulse from a table."""
        times_s, values = self.pulse.times_s, self.pulse.relative
        return tuple((weight, table_states(times_s, values, pole)) for pole, weight in self._own_modes)

    def _piece_modes(self, piece: PulsePiece) -> tuple[tuple[complex, complex], ...]:
        """Modes of the filter with the piece's tail as one more pole.

        `modes` gives each zero to one of the slowest poles; should that be the tail, its gain is put right.
        """
        if piece.tau_s <= _NO_TAIL * piece.sigma_s:
            return self._own_modes
        own = ordered_poles(self.poles, self.zeros)
        tail = complex(-1 / piece.tau_s)
        every = ordered_poles((*self.poles, tail), self.zeros)
        right = math.prod((-pole for pole in own[self.zeros :]), start=-tail)
        given = math.prod((-pole for pole in every[self.zeros :]), start=1 + 0j)
        scale = (right / given).real
        return tuple((pole, weight * scale) for pole, weight in modes(every, self.zeros))

    @cached_property
    def _late(self) -> Late:
        """K after the pulse: what is left in the modes."""
        if not self.pulse.pieces:
            begin = float(self.pulse.times_s[-1])
            found = [
                (states.pole, self.gain * weight * states.last)
                for weight, states in (self._driven_modes if self.poles else ())
            ]
            return Late.of(begin, found)
        pieces = self.pulse.pieces
        begin = max(piece.offset_s + _GAUSSIAN_END * piece.sigma_s for piece in pieces)
        found = []
        for piece in pieces:
            since = begin - piece.offset_s
            each: tuple[tuple[complex, complex], ...] = ()
            if self.poles:
                each = self._piece_modes(piece)
            elif piece.tau_s:
                each = ((complex(-1 / piece.tau_s), 1 / piece.tau_s + 0j),)
            for pole, weight in each:
                at = complex(gaussian_response(pole, piece.sigma_s, np.array([since]))[0])
                found.append((pole, self.gain * piece.weight * weight * at))
        return Late.of(begin, found)


def gaussian_response(pole: complex, sigma_s: float, since_s: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return what a mode 1 / (s - pole) makes of a Gaussian of unit area about 0.

    Parameters
    ----------
    pole : complex
        rad/s, in the left half plane.
    sigma_s : float
        s; above zero.
    since_s : ndarray of float64
        s.

    Notes
    -----
    With z = -(t + pole sigma^2) / (sigma sqrt 2) it is exp(-t^2 / 2 sigma^2) w(j z) / 2, w the Faddeeva
    function. Where Re z < 0 that overflows, and w's reflection serves: exp(pole t + pole^2 sigma^2 / 2) less
    the same with -z (Abramowitz and Stegun, 7.1.11).
    """
    from scipy.special import wofz

    z = -(since_s / sigma_s + pole * sigma_s) / math.sqrt(2)
    late = z.real < 0
    with np.errstate(under="ignore"):
        half = 0.5 * np.exp(-0.5 * (since_s / sigma_s) ** 2) * wofz(1j * np.where(late, -z, z))
        rest = np.where(late, pole * (since_s + pole * sigma_s**2 / 2), 0.0)
        return np.asarray(np.where(late, np.exp(rest) - half, half))


@lru_cache(maxsize=64)
def _whole_taps(kernel: Kernel, step_s: float, last_s: float) -> tuple[NDArray[np.float64], int]:
    lags_s, first = kernel._tap_lags(step_s, 0.0, last_s)
    found = kernel.exact(lags_s)
    found.setflags(write=False)
    return found, first
