"""What an all-pole filter, with or without AC coupling, does to pulses, sines and white noise: exactly.

A filter is given by all its poles (rad/s) and its number of zeros at s = 0, each of which makes a high-pass
of one of the slowest poles; see `belahil.pole_modes`. Each mode is integrated over each piece of the input in
closed form, so there is no time step.
"""

from __future__ import annotations

import cmath
import math
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.errors import RefusedInput
from belahil.pole_modes import modes, ordered_poles, transfer
from belahil.state_blocks import StateBlocks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

_MOST_TAPS, _FORGOTTEN = 96, 1e-7
_FORGOTTEN_BY_A_STEP = 1e-17


def frequency_response(
    poles: Sequence[complex], frequency_hz: ArrayLike, zeros: int = 0
) -> NDArray[np.complex128]:
    """Return H(j 2 pi f): what a sine in the steady state is multiplied by.

    Parameters
    ----------
    poles : sequence of complex
        rad/s, in the left half plane, real or in conjugate pairs.
    frequency_hz : array_like of float, shape (n,)
        Hz.
    zeros : int
        Number of zeros at s = 0.

    Returns
    -------
    ndarray of complex128, shape (n,)

    Raises
    ------
    RefusedInput
        Poles that are not stable or not conjugate, or no pole left for a low-pass.
    """
    s = 2j * np.pi * np.asarray(frequency_hz, dtype=np.float64)
    return transfer(ordered_poles(tuple(poles), zeros), zeros, s)


def response(
    volts: ArrayLike,
    sample_rate_hz: float,
    start_s: float,
    interpolation: Literal["linear", "hold"],
    poles: Sequence[complex],
    times_s: ArrayLike,
    zeros: int = 0,
) -> NDArray[np.float64]:
    """Return a sampled pulse behind a filter that was at rest before it.

    Parameters
    ----------
    volts : array_like of float, shape (n,)
        Break points of the pulse, V.
    sample_rate_hz, start_s : float
        Break points a second; time of the first, s.
    interpolation : {"linear", "hold"}
        Straight lines between the break points and 0 V after the last, or steps of one interval each.
    poles, zeros
        As in `frequency_response`.
    times_s : array_like of float, shape (m,)
        When to evaluate, s; any order, any spacing.

    Returns
    -------
    ndarray of float64, shape (m,)
        V; zero before `start_s`.

    Raises
    ------
    RefusedInput
        As `frequency_response`.
    """
    linear = interpolation == "linear"
    pulse = np.asarray(volts, dtype=np.float64)
    since = np.asarray(times_s, dtype=np.float64) - start_s
    interval = 1.0 / sample_rate_hz
    pieces = pulse.size - 1 if linear else pulse.size
    piece = np.clip(np.floor(since * sample_rate_hz), -1, pieces).astype(np.int64)
    begun, over = piece >= 0, piece >= pieces
    result = np.zeros(since.shape)
    inside = begun & ~over
    at, elapsed = piece[inside], since[inside] - piece[inside] * interval
    after = since[over] - pieces * interval
    rise = np.diff(pulse, append=0.0)
    for pole, weight in modes(ordered_poles(tuple(poles), zeros), zeros):
        state = _states(pulse, interval, pole, linear)
        first, second = phi(pole * elapsed)
        value = state[at] * np.exp(pole * elapsed) + elapsed * first * pulse[at]
        if linear:
            value = value + elapsed * second * rise[at] * (elapsed * sample_rate_hz)
        result[inside] += (weight * value).real
        result[over] += (weight * state[-1] * np.exp(pole * after)).real
    return result


def _states(
    pulse: NDArray[np.float64], interval: float, pole: complex, linear: bool
) -> NDArray[np.complex128]:
    """State of a mode of weight 1 at every break point and at the end of the pulse."""
    from scipy.signal import lfilter

    first, second = (complex(one[0]) for one in phi(np.array([pole * interval])))
    levels = pulse.astype(np.complex128)
    drive = (first - second) * levels[:-1] + second * levels[1:] if linear else first * levels
    moved = lfilter([1.0], [1.0, -cmath.exp(pole * interval)], interval * drive)
    return np.concatenate([[0j], moved])


def phi(z: NDArray[np.complex128]) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return (e^z - 1) / z and (e^z - 1 - z) / z^2 without cancellation, shaped as `z`, which may be 0."""
    small = np.abs(z) < 1
    near = z[small]
    total = np.zeros(near.shape, dtype=np.complex128)
    for k in range(19, 1, -1):  # 1 / 20! is below the last digit
        total = total * near + 1 / math.factorial(k)
    series = np.zeros(z.shape, dtype=np.complex128)
    series[small] = total
    far = np.where(small, 1.0, z)
    first = np.where(small, 1 + z * series, np.expm1(z) / far)
    return first, np.where(small, series, (first - 1) / far)


def autocovariance(poles: Sequence[complex], lags_s: ArrayLike, zeros: int = 0) -> NDArray[np.float64]:
    """Return the autocovariance of white noise behind a filter, for a one-sided density of 1 V^2/Hz.

    Parameters
    ----------
    poles, zeros
        As in `frequency_response`.
    lags_s : array_like of float, shape (n,)
        s.

    Returns
    -------
    ndarray of float64, shape (n,)
        V^2; at lag 0 the noise bandwidth in Hz.

    Raises
    ------
    RefusedInput
        As `frequency_response`.
    """
    lags = np.abs(np.asarray(lags_s, dtype=np.float64))
    total = np.zeros(lags.shape)
    for pole, weight in _noise_modes(tuple(poles), zeros):
        total += (weight * np.exp(pole * lags)).real
    return total


def _noise_modes(poles: tuple[complex, ...], zeros: int) -> list[tuple[complex, complex]]:
    """Return (pole, weight) of the autocovariance: residues of H(s) H(-s) in the left half plane."""
    ordered = ordered_poles(poles, zeros)
    return [
        (pole, weight * complex(transfer(ordered, zeros, -pole)) / 2)
        for pole, weight in modes(ordered, zeros)
    ]


class SampledNoise:
    """White noise behind a filter, sampled: an exact stationary generator of unit rms.

    The samples are an autoregressive moving average with as many terms as the filter has poles, in the
    innovations form of the sampled state (Anderson and Moore, Optimal Filtering, 1979, section 9.3), which is
    found once; a draw is one recursion that starts in the stationary state.

    Parameters
    ----------
    poles, zeros
        As in `frequency_response`.
    sample_interval_s : float
        s.

    Attributes
    ----------
    taps : ndarray of float32, shape (m,), or None
        The same noise as a moving average of white noise, the newest first; None where more than 96 of them
        are needed before what is left is below 1e-7.

    Raises
    ------
    RefusedInput
        As `frequency_response`; or an interval so short against the time constants that the recursion would
        miss the spectrum by more than 1e-6 of its peak.
    """

    def __init__(self, poles: Sequence[complex], zeros: int, sample_interval_s: float) -> None:
        from scipy.linalg import expm, solve_continuous_lyapunov, solve_discrete_are

        ordered = ordered_poles(tuple(poles), zeros)
        unit = max(map(abs, ordered))
        move, push, see = _cascade([pole / unit for pole in ordered], zeros)
        spread = solve_continuous_lyapunov(move, -np.outer(push, push))
        see = see / np.sqrt(see @ spread @ see)
        step = expm(move * (unit * sample_interval_s))
        if unit * sample_interval_s > 1:
            # What a pole has forgotten by the next sample; the solver's scaling overflows on it.
            step[np.abs(step) < _FORGOTTEN_BY_A_STEP] = 0.0
        fresh = spread - step @ spread @ step.T
        # A zero next to the unit circle (an AC coupling, sampled fast) can hide from the solver; a trace of
        # white noise, far below the permitted error, moves it away.
        for trace in (0.0, 1e-14, 1e-12):
            try:
                unknown = solve_discrete_are(step.T, see[:, None], (fresh + fresh.T) / 2, [[trace]])
            except np.linalg.LinAlgError:
                continue
            innovation = float(see @ unknown @ see) + trace
            if innovation <= 0:
                continue
            gain = step @ unknown @ see / innovation
            error = _spectrum_error(step, gain, see, innovation, ordered, zeros, sample_interval_s)
            if error < 1e-6:
                break
        else:
            raise RefusedInput(
                f"noise sampled every {sample_interval_s!r} s behind {len(ordered)} poles, the fastest "
                f"{unit:.4g} rad/s: so many samples in a time constant are beyond double precision"
            )
        size, axes = np.linalg.eigh(spread - unknown)
        self._start = axes * np.sqrt(np.maximum(size, 0.0))
        step_rms = np.sqrt(innovation)
        self.taps = _taps(step, step_rms * gain, see, float(step_rms))
        self._filter = StateBlocks(
            step, step_rms * gain[:, None], see[None, :], np.array([[step_rms]], dtype=np.float64)
        )

    def draw(self, rng: np.random.Generator, sample_count: int) -> NDArray[np.float64]:
        """Draw a stretch of noise, shape (sample_count,), of zero mean and unit rms.

        Parameters
        ----------
        rng : numpy.random.Generator
            Gives as many normal deviates as there are poles for the start, then one for each sample.
        sample_count : int
            At least 1.
        """
        order = self._start.shape[0]
        normal = rng.standard_normal(order + sample_count)
        return self._filter.run(self._start @ normal[:order], normal[order:, None])[:, 0]


def _taps(
    step: NDArray[np.float64], push: NDArray[np.float64], see: NDArray[np.float64], through: float
) -> NDArray[np.float32] | None:
    found, state = [through], push
    while np.abs(state).max() > _FORGOTTEN:
        if len(found) == _MOST_TAPS:
            return None
        found.append(float(see @ state))
        state = step @ state
    return np.array(found, dtype=np.float32)


def _spectrum_error(
    step: NDArray[np.float64],
    gain: NDArray[np.float64],
    see: NDArray[np.float64],
    innovation: float,
    ordered: tuple[complex, ...],
    zeros: int,
    sample_interval_s: float,
) -> float:
    """Largest error of the recursion's spectrum against the true one, relative to the peak."""
    band = min(2 * max(map(abs, ordered)) * sample_interval_s, np.pi)
    z = np.exp(1j * np.concatenate([np.linspace(0, np.pi, 33), np.linspace(0, band, 33)]))
    resolvent = z[:, None, None] * np.eye(see.size) - step
    made = innovation * np.abs(1 + np.linalg.solve(resolvent, gain[:, None])[:, :, 0] @ see) ** 2
    true = np.zeros(z.shape)
    total = 0.0
    for pole, weight in _noise_modes(ordered, zeros):
        root = cmath.exp(pole * sample_interval_s)
        true += (weight * (1 - root**2) / ((1 - root * z) * (1 - root / z))).real
        total += weight.real
    return float(np.max(np.abs(made - true / total)) / np.max(true / total))


def _cascade(
    ordered: list[complex], zeros: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return real state matrices (move, push, see) of the sections one after the other."""
    order = len(ordered)
    move, push, see = np.zeros((order, order)), np.zeros(order), np.zeros(order)
    through, first = 1.0, 0
    for number, pole in enumerate(ordered):
        if pole.imag < 0:
            continue
        size = abs(pole)
        block = slice(first, first + (2 if pole.imag else 1))
        entry = block.stop - 1
        # Each section is driven by the output of those before it: see @ state + through * input.
        move[entry] = size * see
        move[block, block] = [[0, size], [-size, 2 * pole.real]] if pole.imag else pole.real
        push[entry] = size * through
        if number < zeros:
            see[entry] = -1.0
        else:
            see, through = np.zeros(order), 0.0
            see[first] = 1.0
        first = block.stop
    return move, push, see
