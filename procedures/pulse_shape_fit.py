"""Compare windows with predicted pulses: one delay for each window, then three tests.

Each window is compared with the prediction in its measured noise, r^T C^-1 r. Where the trigger fell
between two samples is not known, so each window has a delay of its own, see `procedures.pulse_delays`. What
is left is tested three times:

- the *level*: the sum of all r^T C^-1 r, and of the price of delays that are not free;
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

from procedures.pulse_delays import Placement, alike, placed

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from belahil.stimuli import SampledPulse
    from procedures.pulse_prediction import Path

_FEWEST = 3
"""Values in a bin of which a mean is told."""


@dataclass(frozen=True, slots=True, eq=False)
class ShapeFit:
    """How m windows of n samples agree with their predictions.

    Parameters
    ----------
    chi_square : float
        Sum over all windows, with the numbers as they are known.
    freedom : int
        m (n - 1) where every window has a free delay, m n - 1 where the delays spread about a common one.
    adjusted : float
        The same with the numbers moved, their squared pulls included; it has the same degrees of freedom.
    pulls : mapping of str to float
        By how many of its standard uncertainties each number moved.
    shape : float
        By how much the free curve lowers `adjusted`.
    shape_freedom : int
        Of the free curve.
    placement : Placement
        Where the pulses were found, and the predictions there, with the numbers as they are known.
    late_s : ndarray of float64, shape (m,)
        By how much the first samples are later than expected, s.
    residual_v : ndarray of float64, shape (m, n)
        Measured minus predicted at the converter, V.
    stands_out : float
        Mean square of what a filter matched to the prediction finds in a window, in standard deviations of
        the noise; where the delays are not free, the square for all windows at once. Without any pulse it is
        some 5 or 10, since the best place is chosen.
    expected : float
        The same as predicted.
    """

    chi_square: float
    freedom: int
    adjusted: float
    pulls: Mapping[str, float]
    shape: float
    shape_freedom: int
    placement: Placement
    late_s: NDArray[np.float64]
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
    count = windows_v.shape[0]
    found = placed(path, pulses, windows_v, expected_s, whitener)
    moved = np.empty((len(uncertain), *windows_v.shape))
    for rows in alike(pulses, expected_s):
        moved[:, rows] = path.derivatives(
            pulses[rows.start], found.first_s[rows], windows_v.shape[1], uncertain
        )
    residual_v = windows_v - found.predicted_v
    late = found.slope_v_per_s @ whitener.T
    # About the common delay, from which the delays of faint pulses spread.
    residual = residual_v @ whitener.T + late * (found.first_s - found.common_s)[:, None]
    test = _Tests(residual, late, found.spread_s)
    pulls, adjusted = test.numbers(moved @ whitener.T)
    nodes = _nodes(found.first_s, windows_v.shape[1], path.interval_s)
    curve, curve_freedom = test.curve(nodes @ whitener.T)
    stands_out, expected = _seen(found.predicted_v @ whitener.T, windows_v @ whitener.T, each=found.is_free)
    return ShapeFit(
        chi_square=test.chi_square,
        freedom=windows_v.size - (count if found.is_free else 1),
        adjusted=adjusted,
        pulls=dict(zip(uncertain, pulls.tolist(), strict=True)),
        shape=curve,
        shape_freedom=curve_freedom,
        placement=found,
        late_s=found.first_s - expected_s,
        residual_v=residual_v,
        stands_out=stands_out,
        expected=expected,
    )


def _seen(predicted: NDArray[np.float64], windows: NDArray[np.float64], *, each: bool) -> tuple[float, float]:
    """What a matched filter finds and what it should: mean square in each window, or that of all at once."""
    energy, matched = np.sum(predicted**2, axis=1), np.sum(predicted * windows, axis=1)
    if not each:
        total = float(energy.sum())
        return (float(matched.sum()) ** 2 / total if total else 0.0), total
    seen = energy > 0
    return float(np.sum(matched[seen] ** 2 / energy[seen]) / energy.size), float(energy.mean())


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

    def __init__(self, residual: NDArray[np.float64], late: NDArray[np.float64], spread_s: float) -> None:
        power = np.sum(late**2, axis=1, keepdims=True)
        # Root of the inverse of 1 + late late^T spread^2: with a free delay, all but the direction of `late`.
        kept = np.sqrt(1 / (1 + power * spread_s**2)) if np.isfinite(spread_s) else np.zeros(power.shape)
        size = np.sqrt(power)
        self._late = np.divide(late, size, out=np.zeros(late.shape), where=size > 0)
        self._taken = 1 - kept
        self._residual = self._past(residual)
        self.chi_square = float(np.sum(self._residual**2))

    def _past(self, columns: NDArray[np.float64]) -> NDArray[np.float64]:
        along = np.sum(columns * self._late, axis=-1, keepdims=True)
        past: NDArray[np.float64] = columns - self._taken * self._late * along
        return past

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
