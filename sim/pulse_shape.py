"""The shape of a pulse in time, S_T(t), of unit area: exponentially modified Gaussians, or a table."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput
from sim.pulse_forms import line_transform, modified_gaussian

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

FWHM_OF_SIGMA = 2 * math.sqrt(2 * math.log(2))


@dataclass(frozen=True, slots=True)
class PulsePiece:
    """A Gaussian convolved with a one-sided exponential.

    Parameters
    ----------
    weight : float
        Its area.
    sigma_s : float
        Standard deviation of the Gaussian, s; above zero.
    tau_s : float
        Time constant of the exponential, s; 0: the Gaussian alone.
    offset_s : float
        Centre of the Gaussian, s.
    """

    weight: float
    sigma_s: float
    tau_s: float = 0.0
    offset_s: float = 0.0


def _none() -> NDArray[np.float64]:
    return np.zeros(0)


@dataclass(frozen=True, eq=False)
class PulseShape:
    """A pulse of unit area: pieces, or break points with straight lines between them.

    Parameters
    ----------
    pieces : tuple of PulsePiece
        Their sum; empty where there is a table.
    times_s : ndarray of float64, shape (n,)
        Break points in rising order, s; empty where there are pieces.
    relative : ndarray of float64, shape (n,)
        Density there on any scale, not negative; kept scaled to unit area, 1/s. Zero outside: a table that
        does not begin or end at zero jumps.

    Raises
    ------
    RefusedInput
        Neither or both of them, a width that is not positive, break points that do not rise, or a table
        without area.
    """

    pieces: tuple[PulsePiece, ...] = ()
    times_s: NDArray[np.float64] = field(default_factory=_none)
    relative: NDArray[np.float64] = field(default_factory=_none)

    def __post_init__(self) -> None:
        times = np.array(self.times_s, dtype=np.float64)
        values = np.array(self.relative, dtype=np.float64)
        if bool(self.pieces) == bool(times.size):
            raise RefusedInput("a pulse shape needs pieces, or else a table")
        if self.pieces:
            self._check_pieces()
        else:
            values = _unit_area(times, values)
        for name, array in (("times_s", times), ("relative", values)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def _check_pieces(self) -> None:
        for piece in self.pieces:
            if not (0 < piece.sigma_s < math.inf and 0 <= piece.tau_s < math.inf and piece.weight >= 0):
                raise RefusedInput(
                    f"{piece}: sigma_s must be positive, tau_s and weight not negative, all finite"
                )
        area = sum(piece.weight for piece in self.pieces)
        if abs(area - 1) > 1e-12:
            raise RefusedInput(f"pieces with a total weight of {area!r}: must be 1")

    def density(self, times_s: ArrayLike) -> NDArray[np.float64]:
        """Return S_T, 1/s, with the shape of `times_s`.

        Relative error of a piece: below 1e-12 wherever the density is above 1e-300 of its scale.
        """
        times = np.asarray(times_s, dtype=np.float64)
        if not self.pieces:
            return np.interp(times, self.times_s, self.relative, left=0.0, right=0.0)
        total = np.zeros(times.shape)
        for piece in self.pieces:
            total += piece.weight * modified_gaussian(times - piece.offset_s, piece.sigma_s, piece.tau_s)
        return total

    def transform(self, s: ArrayLike) -> NDArray[np.complex128]:
        """Return the two-sided Laplace transform, the integral of S_T(t) e^(-s t), with the shape of `s`.

        Parameters
        ----------
        s : array_like of complex
            1/s. Of a piece with a tail the integral exists for Re s > -1 / tau; elsewhere this is its
            analytic continuation, with a pole at -1 / tau.
        """
        at = np.asarray(s, dtype=np.complex128)
        if not self.pieces:
            return line_transform(self.times_s, self.relative, at)
        total = np.zeros(at.shape, dtype=np.complex128)
        for piece in self.pieces:
            exponent = at * (at * piece.sigma_s**2 / 2 - piece.offset_s)
            total += piece.weight * np.exp(exponent) / (1 + at * piece.tau_s)
        return total

    @cached_property
    def mean_s(self) -> float:
        """Centroid, s."""
        if self.pieces:
            return sum(piece.weight * (piece.offset_s + piece.tau_s) for piece in self.pieces)
        return float(sum(area * centre for area, centre, _ in self._trapezoids))

    @cached_property
    def std_s(self) -> float:
        """Standard deviation about the centroid, s."""
        mean = self.mean_s
        if self.pieces:
            return math.sqrt(
                sum(
                    piece.weight
                    * (piece.sigma_s**2 + piece.tau_s**2 + (piece.offset_s + piece.tau_s - mean) ** 2)
                    for piece in self.pieces
                )
            )
        return math.sqrt(sum(area * (own + (centre - mean) ** 2) for area, centre, own in self._trapezoids))

    @cached_property
    def fwhm_s(self) -> float:
        """Time from the first to the last crossing of half of the maximum, s."""
        if self.pieces:
            return self._crossing(last=True) - self._crossing(last=False)
        half = self.relative.max() / 2
        above = np.flatnonzero(self.relative >= half)
        return self._table_crossing(above[-1], 1, half) - self._table_crossing(above[0], -1, half)

    @property
    def _trapezoids(self) -> list[tuple[float, float, float]]:
        """Area, centroid and variance of the table between neighbouring break points."""
        left, right, width = self.relative[:-1], self.relative[1:], np.diff(self.times_s)
        both = np.where(left + right > 0, left + right, 1.0)
        area = (left + right) * width / 2
        centre = self.times_s[:-1] + width * (left + 2 * right) / (3 * both)
        own = width**2 * (left**2 + 4 * left * right + right**2) / (18 * both**2)
        return list(zip(area.tolist(), centre.tolist(), own.tolist(), strict=True))

    def _table_crossing(self, inside: np.intp, step: int, half: float) -> float:
        outside = inside + step
        if not 0 <= outside < self.times_s.size:
            return float(self.times_s[inside])
        high, low = self.relative[inside], self.relative[outside]
        part = (high - half) / (high - low)
        return float(self.times_s[inside] + part * (self.times_s[outside] - self.times_s[inside]))

    def _crossing(self, last: bool) -> float:
        grid = self._places()
        values = self.density(grid)
        half = self._maximum(grid, int(values.argmax())) / 2
        above = np.flatnonzero(values >= half)
        inside, outside = (
            (grid[above[-1]], grid[above[-1] + 1]) if last else (grid[above[0]], grid[above[0] - 1])
        )
        for _ in range(60):
            middle = (inside + outside) / 2
            inside, outside = (middle, outside) if self.density(middle) >= half else (inside, middle)
        return float(inside)

    def _places(self) -> NDArray[np.float64]:
        """Times that show every piece: its rise in steps of sigma / 16, its tail in steps of tau / 256."""
        rise, tail = np.linspace(-8, 8, 257), np.linspace(0, 2, 513)
        return np.unique(
            [
                piece.offset_s + place
                for piece in self.pieces
                for place in np.concatenate([piece.sigma_s * rise, piece.tau_s * tail])
            ]
        )

    def _maximum(self, grid: NDArray[np.float64], index: int) -> float:
        low, high = grid[max(index - 1, 0)], grid[min(index + 1, grid.size - 1)]
        for _ in range(5):  # the bracket shrinks 20-fold each time, the error of the maximum 400-fold
            zoom = np.linspace(low, high, 41)
            values = self.density(zoom)
            at = int(values.argmax())
            low, high = zoom[max(at - 1, 0)], zoom[min(at + 1, 40)]
        return float(values.max())

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, PulseShape):
            return NotImplemented
        same = np.array_equal(self.times_s, other.times_s) and np.array_equal(self.relative, other.relative)
        return same and self.pieces == other.pieces

    def __hash__(self) -> int:
        return hash((self.pieces, self.times_s.tobytes(), self.relative.tobytes()))


def _unit_area(times: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    if times.ndim != 1 or times.shape != values.shape or times.size < 2:
        raise RefusedInput(
            f"a table of {times.shape} times and {values.shape} values: needs two equal rows of at least two"
        )
    if not (np.all(np.isfinite(times)) and np.all(np.diff(times) > 0)):
        raise RefusedInput("a table of a pulse: times must be finite and rise")
    if not (np.all(np.isfinite(values)) and np.all(values >= 0) and np.any(values > 0)):
        raise RefusedInput("a table of a pulse: power must be finite, not negative, and somewhere positive")
    area = np.sum(np.diff(times) * (values[:-1] + values[1:])) / 2
    return np.asarray(values / area)


def crossing_s(shape: PulseShape, level: float, inside_s: float, outside_s: float) -> float:
    """Return the last time on the way out at which a pulse is not below a level, s.

    Parameters
    ----------
    shape : PulseShape
        Falls from `inside_s` to `outside_s`, or rises the other way round.
    level : float
        Of its density, 1/s.
    inside_s, outside_s : float
        A time at which it is not below, and one at which it is, s.
    """
    for _ in range(100):
        middle_s = (inside_s + outside_s) / 2
        if float(shape.density(middle_s)) >= level:
            inside_s = middle_s
        else:
            outside_s = middle_s
    return float(inside_s)
