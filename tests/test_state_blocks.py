"""A linear recursion in blocks, against the same recursion one sample after the other."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from belahil import butterworth
from belahil.state_blocks import BLOCK, StateBlocks

LENGTHS = (1, 2, BLOCK - 1, BLOCK, BLOCK + 1, 2 * BLOCK, BLOCK**2, BLOCK**2 + 1, BLOCK**2 + BLOCK + 5, 16064)


def stepped(
    move: np.ndarray, push: np.ndarray, see: np.ndarray, through: np.ndarray, state: np.ndarray, u: np.ndarray
) -> np.ndarray:
    outputs = []
    for driven in u:
        outputs.append(see @ state + through @ driven)
        state = move @ state + push @ driven
    return np.array(outputs)


@pytest.mark.parametrize("count", LENGTHS)
@pytest.mark.parametrize(("states", "inputs", "outputs"), [(1, 1, 1), (3, 1, 1), (4, 2, 3)])
def test_blocks_give_what_steps_give(count: int, states: int, inputs: int, outputs: int) -> None:
    # Given any stable system, with one slow state, and any inputs
    rng = np.random.default_rng(count + states)
    move = rng.standard_normal((states, states))
    move *= 0.999 / np.max(np.abs(np.linalg.eigvals(move)))
    push, see = rng.standard_normal((states, inputs)), rng.standard_normal((outputs, states))
    through, state = rng.standard_normal((outputs, inputs)), rng.standard_normal(states)
    u = rng.standard_normal((count, inputs))
    # When it is run in blocks
    made = StateBlocks(move, push, see, through).run(state, u)
    # Then it is the recursion, but for the rounding of some thousand remembered terms
    expected = stepped(move, push, see, through, state, u)
    assert made.shape == (count, outputs)
    np.testing.assert_allclose(made, expected, rtol=0, atol=1e-12 * np.max(np.abs(expected)))


@pytest.mark.parametrize("highpass_hz", [0.0, 20e3])
def test_blocks_give_what_the_filter_of_scipy_gives(highpass_hz: float) -> None:
    poles = np.exp(np.array(butterworth.poles(19e6, 3, highpass_hz)) * 12.5e-9)
    denominator = np.poly(poles).real
    numerator = np.concatenate([[0.3, -0.2, 0.1], np.zeros(denominator.size - 3)])
    move, push, see, through = signal.tf2ss(numerator, denominator)
    u = np.random.default_rng(1).standard_normal(16064)
    made = StateBlocks(move, push, see, through).run(np.zeros(len(poles)), u[:, None])[:, 0]
    expected = signal.lfilter(numerator, denominator, u)
    np.testing.assert_allclose(made, expected, rtol=0, atol=1e-12 * np.max(np.abs(expected)))


def test_a_run_leaves_inputs_and_state_as_they_were() -> None:
    state, u = np.ones(2), np.ones((100, 1))
    system = StateBlocks(0.5 * np.eye(2), np.ones((2, 1)), np.ones((1, 2)), np.zeros((1, 1)))
    first = system.run(state, u)
    np.testing.assert_array_equal(system.run(state, u), first)
    assert (state == 1).all()
    assert (u == 1).all()
