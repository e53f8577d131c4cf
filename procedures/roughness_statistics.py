"""Footprints of a roughness campaign as columns, and shares, means and quantiles of them with uncertainties.

Footprints on one terrain share its relief, and those of a grid may touch: the uncertainty of a share or mean
is that between terrains (a ratio of sums over clusters), not that of single footprints.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from belahil.campaign_run import CampaignPlan

    Mask = NDArray[np.bool_]
    Residual = Literal["window", "pulse", "largest", "timed"]

SLOPE_DEG, WITHIN_DEG = 10.0, 1.0
"""Of the best pulse of footprints whose residuals are compared (paper: 10 degrees; one step of the library on
either side is assumed to count, so that there are enough)."""


@dataclass(frozen=True, slots=True, eq=False)
class Footprints:
    """Footprints as columns, arrays of shape (n,) or (reflectances, cases, n).

    Parameters
    ----------
    chunk : ndarray of int64
        From which chunk.
    ground : ndarray of int64
        On which relief: that of a terrain is the same at every tilt.
    slope_deg, azimuth_deg, roughness_m, skewness, raw_skewness : ndarray of float64
        Of the ground.
    width_s, amplitude, msr_v2, pulse_msr_v2, largest_v2, timed_msr_v2, library_deg, library_azimuth_deg, \
    timed_deg : ndarray of float64
        Of the echo, by reflectance and case; zero width where it was not detected.
    compared_deg : float
        Slope of the best pulse of those whose residuals are compared.
    """

    chunk: NDArray[np.int64]
    ground: NDArray[np.int64]
    slope_deg: NDArray[np.float64]
    azimuth_deg: NDArray[np.float64]
    roughness_m: NDArray[np.float64]
    skewness: NDArray[np.float64]
    raw_skewness: NDArray[np.float64]
    width_s: NDArray[np.float64]
    amplitude: NDArray[np.float64]
    msr_v2: NDArray[np.float64]
    pulse_msr_v2: NDArray[np.float64]
    largest_v2: NDArray[np.float64]
    timed_msr_v2: NDArray[np.float64]
    library_deg: NDArray[np.float64]
    library_azimuth_deg: NDArray[np.float64]
    timed_deg: NDArray[np.float64]
    compared_deg: float = field(default=SLOPE_DEG, kw_only=True)

    @property
    def size(self) -> int:
        """How many."""
        return self.chunk.size

    def residual_v2(self, residual: Residual, case: int, reflectance: int = 0) -> NDArray[np.float64]:
        """Return squared residuals, V^2.

        Parameters
        ----------
        residual : {"window", "pulse", "largest", "timed"}
            Mean over all samples of the window; over those of the pulse alone; the largest of them; mean over
            all about the best pulse that is not moved in time.
        case, reflectance : int
            Which.
        """
        found = {
            "window": self.msr_v2,
            "pulse": self.pulse_msr_v2,
            "largest": self.largest_v2,
            "timed": self.timed_msr_v2,
        }[residual]
        return np.asarray(found[reflectance, case])

    def best_deg(self, residual: Residual, case: int, reflectance: int = 0) -> NDArray[np.float64]:
        """Return the slope of the best pulse, which a residual is about, deg."""
        found = self.timed_deg if residual == "timed" else self.library_deg
        return np.asarray(found[reflectance, case])

    def compared(self, case: int, reflectance: int = 0, residual: Residual = "window") -> Mask:
        """Detected footprints whose best pulse has the slope at which residuals are compared."""
        off = np.abs(self.best_deg(residual, case, reflectance) - self.compared_deg)
        return np.asarray((self.width_s[reflectance, case] > 0) & (off <= WITHIN_DEG))


COLUMNS = ("slope_deg", "azimuth_deg", "roughness_m", "skewness", "raw_skewness")
ECHOES = (
    "width_s",
    "amplitude",
    "msr_v2",
    "pulse_msr_v2",
    "largest_v2",
    "timed_msr_v2",
    "library_deg",
    "library_azimuth_deg",
    "timed_deg",
)


def gathered(plan: CampaignPlan, results: Sequence[dict[str, NDArray[Any]]], kind: str) -> Footprints | None:
    """Put footprints together whose chunks have a kind, their first word, out of some parted by |."""
    found = [
        (at, results[at])
        for at, chunk in enumerate(plan.chunks)
        if chunk.name.split(" ")[0].rstrip(",") in kind.split("|")
    ]
    if not found:
        return None
    chunk = np.concatenate([np.full(one["slope_deg"].size, at) for at, one in found])
    ground = np.concatenate(
        [np.full(one["slope_deg"].size, _ground(plan.chunks[at].given, at)) for at, one in found]
    )
    plain = (np.concatenate([one[name] for _, one in found]) for name in COLUMNS)
    deep = (np.concatenate([one[name] for _, one in found], axis=2) for name in ECHOES)
    steepest_deg = max(one.given.get("tilt_deg", 0.0) for one in plan.chunks)
    return Footprints(chunk, ground, *plain, *deep, compared_deg=steepest_deg)


def _ground(given: Mapping[str, Any], at: int) -> int:
    """The seed of a fractal; each block of a terrain model for itself."""
    return int(given["ground_seed"] + given["level"]) if "level" in given else -1 - at


def joined(parts: Sequence[Footprints]) -> Footprints:
    """Several collections as one."""
    names = ("chunk", "ground", *COLUMNS, *ECHOES)
    columns = (np.concatenate([getattr(one, name) for one in parts], axis=-1) for name in names)
    return Footprints(*columns, compared_deg=parts[0].compared_deg)


def mean_of(values: NDArray[np.float64], cluster: NDArray[np.int64]) -> tuple[float, float]:
    """Return a mean and its standard uncertainty, from the scatter between clusters.

    Parameters
    ----------
    values : ndarray of float64, shape (n,)
        n at least 1; booleans for a share.
    cluster : ndarray of int64, shape (n,)
        Which of them belong together.

    Notes
    -----
    The variance of a ratio of sums over clusters (Cochran 1977, eq. 6.13), a cluster for each terrain. Or
    that of independent values where it is larger: few clusters tell their own scatter badly. Where all values
    are alike a share of 0 or 1 counts as half a value away from it.
    """
    mean, count = float(np.mean(values)), values.size
    _, number = np.unique(cluster, return_inverse=True)
    clusters = int(number.max()) + 1
    rest = np.bincount(number, values - mean, clusters)
    among = math.sqrt(clusters / (clusters - 1) * float(rest @ rest)) / count if clusters > 1 else 0.0
    spread = float(np.std(values)) or math.sqrt(0.5 / count)
    return mean, max(among, spread / math.sqrt(count))


def cumulative(values: NDArray[np.float64], levels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share of values at or below each level."""
    return np.searchsorted(np.sort(values), levels, side="right") / max(values.size, 1)


def quantile_of(
    values: NDArray[np.float64], cluster: NDArray[np.int64], share: float, stream: np.random.Generator
) -> tuple[float, float]:
    """Return a quantile and its standard uncertainty, by a bootstrap of clusters."""
    names = np.unique(cluster)
    groups = [values[cluster == one] for one in names]
    drawn = [
        np.quantile(
            np.concatenate([groups[at] for at in stream.integers(names.size, size=names.size)]), share
        )
        for _ in range(200)
    ]
    return float(np.quantile(values, share)), float(np.std(drawn))
