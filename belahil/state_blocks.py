"""A linear recursion over a long record, in a few matrix products instead of a step for each sample."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

# Shortest time for records of 16 064 samples; any length gives the same numbers to rounding.
BLOCK = 32


class StateBlocks:
    """The system ``y[n] = see x[n] + through u[n]``, ``x[n + 1] = move x[n] + push u[n]``, made ready.

    Within a block of samples the outputs are one matrix times the inputs and the state at its beginning. The
    states at the beginnings of all blocks obey a recursion of the same form, so the same is done with them.
    Beside ``scipy.signal.lfilter`` this takes the same time for a record, and spares each process the import
    of ``scipy.signal``, which costs as much as some thousand records.

    Parameters
    ----------
    move : ndarray of float64, shape (p, p)
        Stable: no eigenvalue outside the unit circle.
    push : ndarray of float64, shape (p, q)
        From the q inputs to the state.
    see : ndarray of float64, shape (m, p)
        From the state to the m outputs.
    through : ndarray of float64, shape (m, q)
        From the inputs straight to the outputs.
    """

    def __init__(self, move: Array, push: Array, see: Array, through: Array) -> None:
        outputs, inputs = through.shape
        self._outputs = outputs
        powers = [np.eye(move.shape[0])]
        for _ in range(BLOCK):
            powers.append(move @ powers[-1])
        # Rows are what goes in, columns what comes out: records are rows of memory.
        self._out_of_state = np.hstack([(see @ power).T for power in powers[:-1]])
        self._into_state = np.vstack([(power @ push).T for power in powers[-2::-1]])
        self._over = powers[-1]
        answers = [through, *(see @ power @ push for power in powers[:-2])]
        self._within = np.zeros((BLOCK * inputs, BLOCK * outputs))
        for late, answer in enumerate(answers):
            for at in range(BLOCK - late):
                rows = slice(at * inputs, (at + 1) * inputs)
                self._within[rows, (at + late) * outputs : (at + late + 1) * outputs] = answer.T
        self._between: StateBlocks | None = None

    def run(self, state: Array, inputs: Array) -> Array:
        """Return the outputs.

        Parameters
        ----------
        state : ndarray of float64, shape (p,)
            At the first sample.
        inputs : ndarray of float64, shape (n, q)
            One row for each sample.

        Returns
        -------
        ndarray of float64, shape (n, m)
        """
        count, width = inputs.shape
        if count <= BLOCK:
            end = count * self._outputs
            few: Array = inputs.reshape(-1) @ self._within[: count * width, :end]
            return (few + state @ self._out_of_state[:, :end]).reshape(count, -1)
        blocks = -(-count // BLOCK)
        driven = inputs
        if blocks * BLOCK > count:
            driven = np.zeros((blocks * BLOCK, width))
            driven[:count] = inputs
        driven = driven.reshape(blocks, -1)
        outputs: Array = driven @ self._within
        outputs += self._beginnings(state, driven @ self._into_state) @ self._out_of_state
        return outputs.reshape(-1, self._outputs)[:count]

    def _beginnings(self, state: Array, pushes: Array) -> Array:
        """States at the beginning of each block, shape (blocks, p)."""
        if self._between is None:
            one = np.eye(state.size)
            self._between = StateBlocks(self._over, one, one, np.zeros_like(one))
        return self._between.run(state, pushes)
