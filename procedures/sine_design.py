"""The linear algebra of a sine fit: columns, blocks, and the noise density where the sine is.

A record is cut into blocks. The sums of each block against the columns of the model are all that a fit needs:
their total gives the parameters, and what the fit leaves of them gives the noise *at the frequency of each
column*, since noise of another frequency averages out within a block. So no spectrum is computed. And the
columns are alike in all blocks but for a turn of the phase, so that one block of them suffices.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

# 64 blocks give the noise density to 9 % of its square root from one record, within 32 bins of the sine.
_BLOCKS, _LEAST_BLOCKS, _LEAST_LENGTH = 64, 8, 8
DENSITY_FREEDOM = 2 * _BLOCKS
"""Degrees of freedom of the noise density of a record: each block tells it by cos and by sin."""


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """What a design says of one record.

    Parameters
    ----------
    values : ndarray of float64, shape (k,)
        Coefficients of the columns, without the two of the drift.
    covariance : ndarray of float64, shape (k, k)
        Of `values`, for the noise density found at each column.
    drift : ndarray of float64, shape (4,)
        From the fit with drift columns: cos, sin, t cos, t sin.
    drift_u : float
        Standard uncertainty of each of the last two.
    density : float
        Noise at the sine's frequency, as the variance that a sample had if all noise were like that.
    variance : float
        Mean square of the residual, all frequencies.
    phasors : ndarray of complex128, shape (blocks,)
        Sum over each block of the record, less offsets and image, times exp(-i 2 pi f t).
    """

    values: Array
    covariance: Array
    drift: Array
    drift_u: float
    density: float
    variance: float
    phasors: NDArray[np.complex128]


class SineDesign:
    """Columns of a sine model on uniform samples, prepared for many records.

    The columns are cos, sin, 1; with two converters also (-1)^n, (-1)^n cos, (-1)^n sin; and t cos, t sin
    with t from -1 to 1, for the drift of the phase only. Time counts from the sample `middle`.

    Parameters
    ----------
    cycles_per_sample : float
        Frequency over sample rate, any positive number.
    sample_count : int
        Samples in a record.
    interleaved : bool
        Two converters.
    keep : ndarray of bool, shape (sample_count,), or None
        Samples to use; None for all.

    Attributes
    ----------
    condition : float
        Ratio of the largest to the smallest singular value of the columns at unit length, drift left out.
    """

    def __init__(
        self,
        cycles_per_sample: float,
        sample_count: int,
        interleaved: bool,
        keep: NDArray[np.bool_] | None = None,
    ) -> None:
        self.sample_count = sample_count
        self.used = sample_count if keep is None else int(np.count_nonzero(keep))
        self.middle = (sample_count - 1) // 2
        self._blocks = max(1, min(_BLOCKS, sample_count // _LEAST_LENGTH))
        self._length = -(-sample_count // self._blocks)
        self._padding = self._blocks * self._length - sample_count
        # Whole cycles drop out before an angle is formed: less rounding, and any frequency is its own alias.
        cycles = cycles_per_sample - round(cycles_per_sample)
        block = _block(cycles, self._length, sample_count, interleaved)
        starts = np.arange(self._blocks) * self._length
        self._moves = _moves(cycles, starts, self.middle, sample_count, interleaved)
        self._block = np.ascontiguousarray(block.T)
        self.size = block.shape[0] - 2
        used = np.zeros(self._blocks * self._length)
        used[:sample_count] = 1.0 if keep is None else keep
        products = (used.reshape(self._blocks, 1, -1) * block) @ self._block
        self._products = self._moves @ products @ self._moves.transpose(0, 2, 1)
        whole = self._products.sum(axis=0)
        self.condition = _condition(whole[: self.size, : self.size])
        if np.isfinite(self.condition):
            self._prepare(whole, interleaved)

    def _prepare(self, whole: Array, interleaved: bool) -> None:
        own = slice(self.size)
        self._own = np.ascontiguousarray(self._products[:, own, own])
        self._sine = np.ascontiguousarray(self._products[:, :2, :2]).reshape(-1, 2)
        self._whole = np.ascontiguousarray(whole[own, own])
        self._inverse = np.linalg.inv(self._whole)
        self._drift_inverse = np.linalg.pinv(whole, rcond=1e-12, hermitian=True)
        # What white noise of unit variance leaves, on average, of the block sums of each column.
        left = self._own - self._own @ self._inverse @ self._own
        white = left.diagonal(0, 1, 2).sum(axis=0)
        # cos and sin, of the sine and of its image, see one density each; so do the two constants.
        self._groups = np.array([0, 2, 3, 4] if interleaved else [0, 2])
        self._group_of = np.array([0, 0, 1, 2, 3, 3] if interleaved else [0, 0, 1])
        self._white = np.add.reduceat(white, self._groups)

    def solve(self, samples: Array) -> Solution:
        """Fit one record.

        Parameters
        ----------
        samples : ndarray of float64, shape (sample_count,)
            Finite, and zero where not kept.
        """
        rows = np.pad(samples, (0, self._padding)) if self._padding else samples
        sums = np.matvec(self._moves, rows.reshape(self._blocks, self._length) @ self._block)
        total = sums.sum(axis=0)
        values = self._inverse @ total[: self.size]
        drift = self._drift_inverse @ total
        left = sums[:, : self.size] - (self._own.reshape(-1, self.size) @ values).reshape(-1, self.size)
        squares = float(samples @ samples)
        variance = max(squares - float(values @ total[: self.size]), 0.0) / max(self.used - self.size, 1)
        if self._blocks < _LEAST_BLOCKS:
            density = np.full(self._groups.size, variance)
        else:
            density = np.add.reduceat((left * left).sum(axis=0), self._groups) / self._white
        # A record without noise still has that of rounding to 53 bits.
        density = np.maximum(density, 1e-32 * squares / self.used)
        half = self._inverse * np.sqrt(density)[self._group_of]
        turned = left[:, :2] + (self._sine @ values[:2]).reshape(-1, 2)
        return Solution(
            values=values,
            covariance=half @ self._whole @ half.T,
            drift=drift[[0, 1, -2, -1]],
            drift_u=float(np.sqrt(self._drift_inverse[-1, -1] * density[0])),
            density=float(density[0]),
            variance=variance,
            phasors=turned[:, 0] - 1j * turned[:, 1],
        )


def _block(cycles: float, length: int, sample_count: int, interleaved: bool) -> Array:
    """Return the columns over one block as rows, with time counted from its first sample."""
    number = np.arange(length)
    turns = number * cycles
    angle = 2 * np.pi * (turns - np.rint(turns))
    cos, sin, one = np.cos(angle), np.sin(angle), np.ones(length)
    time = number / (sample_count / 2)
    if not interleaved:
        return np.stack([cos, sin, one, time * cos, time * sin])
    turn = np.where(number % 2, -1.0, 1.0)
    return np.stack([cos, sin, one, turn, turn * cos, turn * sin, time * cos, time * sin])


def _moves(
    cycles: float, starts: NDArray[np.int64], middle: int, sample_count: int, interleaved: bool
) -> NDArray[np.float64]:
    """Return what turns sums over `_block` into sums over the columns, shape (blocks, k, k).

    A later block sees the same columns, turned by the angle of its first sample, and at a later time.
    """
    since = (starts - middle).astype(np.float64)
    turns = since * cycles
    angle = 2 * np.pi * (turns - np.rint(turns))
    cos, sin = np.cos(angle), np.sin(angle)
    turned = np.array([[cos, -sin], [sin, cos]]).transpose(2, 0, 1)
    size = 8 if interleaved else 5
    moves = np.zeros((starts.size, size, size))
    moves[:, :2, :2] = moves[:, -2:, -2:] = turned
    moves[:, 2, 2] = 1.0
    moves[:, -2:, :2] = (since / (sample_count / 2))[:, None, None] * turned
    if interleaved:
        sign = np.where(starts % 2, -1.0, 1.0)
        moves[:, 3, 3] = sign
        moves[:, 4:6, 4:6] = sign[:, None, None] * turned
    return moves


def _condition(products: Array) -> float:
    length = np.sqrt(products.diagonal())
    # A sine at zero or half the sample rate leaves a column of rounding errors.
    if not np.all(length > 1e-9 * length.max()):
        return float("inf")
    size = np.linalg.eigvalsh(products / np.outer(length, length))
    # Below some 1e-14 an eigenvalue of a matrix of ones is rounding.
    return float(np.sqrt(size[-1] / size[0])) if size[0] > 1e-14 * size[-1] else float("inf")
