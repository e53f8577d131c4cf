"""Compare windows with predicted pulses: one delay for each window, then three tests.

Each window is compared with the prediction in its measured noise, r^T C^-1 r. Where the trigger fell between
two samples is not known, so each window has a delay of its own, by Gauss-Newton from the best of a search.
What is left is tested three times:

- the *level*: the sum of all r^T C^-1 r, one degree of freedom less than samples for each window;
- the *shape*: by how much a free curve, straight lines between nodes one sample interval apart and common to
  all windows, lowers that sum. It sees errors that windows share, far below the noise of one window;
- the *numbers*: gain, cut-off and the like are known with an uncertainty. They may move, at the price of
  their squared pulls, to first order; they may not move further than their uncertainties allow.

The level and the shape are tested with the numbers so moved.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from belahil.stimuli import SampledPulse
    from procedures.pulse_prediction import Path

SEARCHED = 8
"""Sample intervals before and after the expected place in which a pulse is looked for."""
_PLACES = 4
"""Places of the search in a sample interval."""
_FEWEST = 3
"""Values in a bin of which a mean is told."""
_STEPS, _CLOSE = 8, 1e-4
"""Of Gauss-Newton, at most; sample intervals below which a step ends it. Three are needed where a pulse
stands out, and its delay is uncertain by a hundredth of an interval at best."""


@dataclass(frozen=True, slots=True, eq=False)
class ShapeFit:
    """How m windows of n samples agree with their predictions.

    Parameters
    ----------
    chi_square : float
        Sum over all windows, with the numbers as they are known.
    freedom : int
        m (n - 1).
    adjusted : float
        The same with the numbers moved, their squared pulls included; it has the same degrees of freedom.
    pulls : mapping of str to float
        By how many of its standard uncertainties each number moved.
    shape : float
        By how much the free curve lowers `adjusted`.
    shape_freedom : int
        Of the free curve.
    first_s : ndarray of float64, shape (m,)
        Time of each window's first sample on the time axis of the pulses, as found, s.
    late_s : ndarray of float64, shape (m,)
        By how much this is later than expected, s.
    within : ndarray of bool, shape (m,)
        False where the best place is at an end of the search.
    predicted_v, residual_v : ndarray of float64, shape (m, n)
        At the converter, V, with the numbers as they are known.
    stands_out : float
        Mean square of what a filter matched to the prediction finds, in standard deviations of the noise;
        some 5 without any pulse, since the best place is chosen.
    expected : float
        The same as predicted.
    """

    chi_square: float
    freedom: int
    adjusted: float
    pulls: Mapping[str, float]
    shape: float
    shape_freedom: int
    first_s: NDArray[np.float64]
    late_s: NDArray[np.float64]
    within: NDArray[np.bool_]
    predicted_v: NDArray[np.float64]
    residual_v: NDArray[np.float64]
    stands_out: float
    expected: float


def fit_shape(
    path: Path,
    uncertain: Mapping[str, float],
    pulses: Sequence[SampledPulse],
    windows_v: NDArray[np.float64],
    expected_s: NDArray[np.float64],
    whitener: NDArray[np.float64],
) -> ShapeFit:
    """Compare windows with the pulses that were played in them.

    Parameters
    ----------
    path : Path
        From the waveform to the converter.
    uncertain : mapping of str to float
        Standard uncertainties of its numbers.
    pulses : sequence of SampledPulse
        m, equal ones next to each other.
    windows_v : ndarray of float64, shape (m, n)
        V at the converter, without the converters' offsets.
    expected_s : ndarray of float64, shape (m,)
        Time of the first samples, to some `SEARCHED` sample intervals, s.
    whitener : ndarray of float64, shape (n, n)
        From `procedures.noise_covariance.StretchNoise.whitener`.
    """
    shape = windows_v.shape
    first_s, within = np.empty(shape[0]), np.empty(shape[0], dtype=bool)
    predicted_v, late = np.empty(shape), np.empty(shape)
    moved = np.empty((len(uncertain), *shape))
    for rows in _alike(pulses, expected_s):
        pulse = pulses[rows.start]
        first_s[rows], within[rows] = _placed(path, pulse, windows_v[rows], expected_s[rows.start], whitener)
        predicted_v[rows], late[rows] = _with_slope(path, pulse, first_s[rows], shape[1])
        moved[:, rows] = path.derivatives(pulse, first_s[rows], shape[1], uncertain)
    residual_v = windows_v - predicted_v
    nodes = _nodes(first_s, shape[1], path.interval_s)
    test = _Tests(residual_v @ whitener.T, late @ whitener.T)
    pulls, adjusted = test.numbers(moved @ whitener.T)
    curve, curve_freedom = test.curve(nodes @ whitener.T)
    whole = predicted_v @ whitener.T
    energy = np.sum(whole**2, axis=1)
    matched = np.sum(whole * (windows_v @ whitener.T), axis=1) ** 2
    seen = energy > 0
    return ShapeFit(
        chi_square=test.chi_square,
        freedom=shape[0] * (shape[1] - 1),
        adjusted=adjusted,
        pulls=dict(zip(uncertain, pulls.tolist(), strict=True)),
        shape=curve,
        shape_freedom=curve_freedom,
        first_s=first_s,
        late_s=first_s - expected_s,
        within=within,
        predicted_v=predicted_v,
        residual_v=residual_v,
        stands_out=float(np.sum(matched[seen] / energy[seen]) / shape[0]),
        expected=float(energy.mean()),
    )


def _alike(pulses: Sequence[SampledPulse], expected_s: NDArray[np.float64]) -> list[slice]:
    """Stretches of windows with one pulse at one expected place."""
    ends = [
        row
        for row in range(1, len(pulses))
        if expected_s[row] != expected_s[row - 1]
        or not (pulses[row] is pulses[row - 1] or pulses[row] == pulses[row - 1])
    ]
    return [slice(begin, end) for begin, end in zip([0, *ends], [*ends, len(pulses)], strict=True)]


def _placed(
    path: Path,
    pulse: SampledPulse,
    windows_v: NDArray[np.float64],
    expected_s: float,
    whitener: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Time of the first samples, shape (m,), and whether the search found an inner place."""
    count = windows_v.shape[1]
    offsets_s = (path.interval_s / _PLACES) * np.arange(-SEARCHED * _PLACES, SEARCHED * _PLACES + 1.0)
    white = windows_v @ whitener.T
    bank = path.volts(pulse, expected_s + offsets_s, count) @ whitener.T
    best = np.argmin(np.sum(bank**2, axis=1) - 2 * white @ bank.T, axis=1)
    first_s: NDArray[np.float64] = expected_s + offsets_s[best]
    for _ in range(_STEPS):
        volts, slope = _with_slope(path, pulse, first_s, count)
        left, slope = white - volts @ whitener.T, slope @ whitener.T
        power = np.sum(slope**2, axis=1)
        step_s = np.divide(np.sum(left * slope, axis=1), power, out=np.zeros(power.size), where=power > 0)
        first_s += np.clip(step_s, -path.interval_s / 4, path.interval_s / 4)
        if np.max(np.abs(step_s)) < _CLOSE * path.interval_s:
            break
    return first_s, (best > 0) & (best < offsets_s.size - 1)


def _with_slope(
    path: Path, pulse: SampledPulse, first_s: NDArray[np.float64], count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Predictions, V, and their change with the time of the first sample, V/s."""
    little_s = 1e-3 * path.interval_s
    places_s = np.concatenate([first_s, first_s + little_s, first_s - little_s])
    volts, later, sooner = np.split(path.volts(pulse, places_s, count), 3)
    return volts, (later - sooner) / (2 * little_s)


def _nodes(first_s: NDArray[np.float64], count: int, interval_s: float) -> NDArray[np.float64]:
    """Straight lines between nodes one interval apart, shape (k, m, n): each row is 1 V at one node."""
    place = (first_s - first_s.min())[:, None] / interval_s + np.arange(count)
    below = np.floor(place).astype(np.int64)
    nodes = np.zeros((int(below.max()) + 2, *place.shape))
    rows, columns = np.indices(place.shape)
    nodes[below, rows, columns] = 1 - (place - below)
    nodes[below + 1, rows, columns] = place - below
    return nodes


class _Tests:
    """Whitened residuals r (m, n), and everything seen past what a delay of each window can take up."""

    def __init__(self, residual: NDArray[np.float64], late: NDArray[np.float64]) -> None:
        power = np.sqrt(np.sum(late**2, axis=1, keepdims=True))
        self._late = np.divide(late, power, out=np.zeros(late.shape), where=power > 0)
        self._residual = self._past(residual)
        self.chi_square = float(np.sum(self._residual**2))

    def _past(self, columns: NDArray[np.float64]) -> NDArray[np.float64]:
        taken: NDArray[np.float64] = columns - self._late * np.sum(
            columns * self._late, axis=-1, keepdims=True
        )
        return taken

    def numbers(self, moved: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
        """Pulls, shape (p,), and chi-square at their price; `moved` (p, m, n) is for one uncertainty."""
        flat = self._past(moved).reshape(moved.shape[0], -1)
        self._moved = flat
        self._known = np.linalg.inv(np.eye(flat.shape[0]) + flat @ flat.T)
        pulls = self._known @ (flat @ self._residual.reshape(-1))
        return pulls, self.chi_square - float(pulls @ flat @ self._residual.reshape(-1))

    def curve(self, nodes: NDArray[np.float64]) -> tuple[float, int]:
        """By how much a free curve on `nodes` (k, m, n) lowers chi-square beside the numbers; its freedom."""
        flat = self._past(nodes).reshape(nodes.shape[0], -1)
        shared = self._moved @ flat.T
        information = flat @ flat.T - shared.T @ self._known @ shared
        left = self._residual.reshape(-1)
        pushed = flat @ left - shared.T @ self._known @ (self._moved @ left)
        size, axes = np.linalg.eigh(information)
        kept = size > 1e-9 * size[-1]
        return float(np.sum((axes.T @ pushed)[kept] ** 2 / size[kept])), int(np.count_nonzero(kept))


@dataclass(frozen=True, slots=True, eq=False)
class Means:
    """Means of values in bins of their places, shape (k,); bins with fewer than three values are left out."""

    places: NDArray[np.float64]
    means: NDArray[np.float64]
    uncertainties: NDArray[np.float64]


def binned(places: NDArray[np.float64], values: NDArray[np.float64], width: float) -> Means:
    """Return means of values by place, with the standard uncertainty that their scatter gives.

    Parameters
    ----------
    places, values : ndarray of float64, of the same shape
        In any unit.
    width : float
        Of a bin, in that of `places`.
    """
    number = np.floor((places.reshape(-1) - places.min()) / width).astype(np.int64)
    flat = values.reshape(-1)
    count = np.bincount(number)
    kept = count >= _FEWEST
    count = np.where(kept, count, _FEWEST)
    mean = np.bincount(number, flat) / count
    scatter = np.bincount(number, (flat - mean[number]) ** 2) / (count - 1)
    middle = places.min() + (np.arange(count.size) + 0.5) * width
    return Means(middle[kept], mean[kept], np.sqrt(scatter / count)[kept])
