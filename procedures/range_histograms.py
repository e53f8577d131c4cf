"""Distributions of range errors by source, and whether they are normal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from procedures.range_chunks import correction
from procedures.range_scenes import noise_scene
from procedures.range_table import cell_draws
from sim.scene import as_toml

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from procedures.noise_clusters import LevelLaws
    from procedures.range_points import Drawn

EDGES = np.linspace(-4.0, 4.0, 65)
"""Of the bins, in standard deviations: then all distributions share an axis."""
_FEWEST = 20
"""For D'Agostino and Pearson's test."""


@dataclass(frozen=True, slots=True, eq=False)
class Histogram:
    """A distribution of errors.

    Parameters
    ----------
    altitude_m : float
        m.
    source : str
        "shape", "pointing", "noise by day", "noise by night", "all by day" or "all by night".
    errors_m : ndarray of float64, shape (n,)
        Independent ones, about their mean, m.
    density : ndarray of float64, shape (64,)
        Of all shots by their weights, over `EDGES` times `rms_m`, 1/m.
    p_value : float or None
        That a normal distribution is as far from one as this is (D'Agostino and Pearson, Biometrika 60,
        1973); None with fewer than 20 errors.
    rms_m : float
        Standard deviation of all shots, m.
    skewness, excess_kurtosis : float
        Of the independent ones.
    """

    altitude_m: float
    source: str
    errors_m: NDArray[np.float64]
    density: NDArray[np.float64]
    rms_m: float
    p_value: float | None
    skewness: float
    excess_kurtosis: float


def histograms(drawn: Drawn, laws: Mapping[str, LevelLaws], reflectance: float) -> tuple[Histogram, ...]:
    """Return the distributions at a point, at one reflectance.

    Parameters
    ----------
    drawn : Drawn
        The point.
    laws : mapping of str to LevelLaws
        From `Collected.laws`.
    reflectance : float
        One of its conditions'.

    Notes
    -----
    Errors of detections have weights; so many of them are taken, evenly along the sum of weights, as they are
    worth: (sum w)^2 / sum w^2. One shot of each echo is taken, so that they are independent.
    """
    linear, curve = drawn.linear, correction(drawn.scene)
    altitude_m = drawn.scene.altitude_m
    found = [
        histogram(altitude_m, "shape", linear.still_m[:, None], np.ones((linear.still_m.size, 1)), 1),
        histogram(
            altitude_m,
            "pointing",
            (linear.moved_m - linear.still_m)[:, None],
            np.ones((linear.still_m.size, 1)),
            1,
        ),
    ]
    own = laws[as_toml(noise_scene(drawn.scene))]
    repeats = drawn.arrays["weight"].size // linear.still_m.size
    moved_m = np.repeat(linear.moved_m, repeats)[:, None]
    for row, condition in enumerate(drawn.conditions):
        if condition.reflectance != reflectance:
            continue
        draws = cell_draws(drawn, row, curve, 0.0)
        weights = draws.weights(own.at(condition.noise_rms_v))
        for name, values in (("noise", draws.error_m - moved_m), ("all", draws.error_m)):
            found.append(histogram(altitude_m, f"{name} by {condition.light}", values, weights, repeats))
    return tuple(found)


def worth(values: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return as many values as the weights are worth, evenly along their sum, in the order of the values."""
    total = float(weights.sum())
    if not total > 0:
        return np.zeros(0)
    count = round(total**2 / float((weights**2).sum()))
    order = np.argsort(values, axis=None)
    reached = np.cumsum(weights.ravel()[order]) / total
    places = np.minimum(np.searchsorted(reached, (np.arange(count) + 0.5) / count), order.size - 1)
    return np.asarray(values.ravel()[order][places])


def histogram(
    altitude_m: float,
    source: str,
    values_m: NDArray[np.float64],
    weights: NDArray[np.float64],
    repeats: int,
) -> Histogram:
    """Describe a distribution and test it.

    Parameters
    ----------
    altitude_m, source
        As of `Histogram`.
    values_m, weights : ndarray of float64, shape (n, k)
        Errors and their weights.
    repeats : int
        So many rows share an echo; the first of them is tested.
    """
    from scipy.stats import kurtosis, normaltest, skew

    total = float(weights.sum()) or 1.0
    mean_m = float((weights * values_m).sum()) / total
    about_m = values_m - mean_m
    rms_m = float(np.sqrt((weights * about_m**2).sum() / total))
    counts = np.histogram(about_m, EDGES * (rms_m or 1.0), weights=weights)[0]
    density = counts / (total * np.diff(EDGES) * (rms_m or 1.0))
    errors_m = worth(about_m[::repeats], weights[::repeats])
    if errors_m.size < _FEWEST or not np.ptp(errors_m) > 0:
        return Histogram(altitude_m, source, errors_m, density, rms_m, None, 0.0, 0.0)
    tested = float(normaltest(errors_m).pvalue), float(skew(errors_m)), float(kurtosis(errors_m))
    return Histogram(altitude_m, source, errors_m, density, rms_m, *tested)
