"""A regional roughness from the whole cumulative curve of residuals, not from their mean logarithm alone.

The share of residuals at or below a level is fitted to simulated footprints, for each of a few levels, as a
logistic curve in how much their mean logarithm grows with roughness (`procedures.roughness_region`) and its
square: below some roughness there is only noise. Stacked over a region, whose roughness scatters as a
log-normal as wide as that of the simulated terrains, these make the curve that is expected of it. A region's
residuals, sorted into classes between the levels, then have a likelihood for each roughness; its logarithm is
divided by how much more the curves of terrains scatter than those of as many strangers would. What is assumed
of a region before it is seen is that of the other module.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import expit

from procedures.roughness_region import (
    FEWEST_OF_REGION,
    GRID_M,
    NODES,
    WEIGHTS,
    Region,
    Simulated,
    dispersion_of_means,
    likeliest,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

CLASSES = 12
_LEAST = 1e-3
"""Share of a class at least: where the fitted curves touch, no residual is impossible."""
_ROUNDS = 30
_HELD = 1.0
"""Weight of a footprint with which slopes of logistic curves are held to 0, so that they stay finite."""


@dataclass(frozen=True, eq=False)
class StackedCurves(Simulated):
    """Footprints with which regions are compared, by their curves."""

    @cached_property
    def levels_v2(self) -> NDArray[np.float64]:
        """Between classes with as many simulated residuals each, V^2."""
        return np.quantile(self.msr_v2, np.arange(1, CLASSES) / CLASSES)

    @cached_property
    def shares(self) -> NDArray[np.float64]:
        """Share of each class in regions with the roughness of `GRID_M`, shape (grid, classes)."""
        known = _powers(self.growth(np.log(self.roughness_m)))
        fitted = [_logistic(known, self.msr_v2 <= level_v2) for level_v2 in self.levels_v2]
        inside = _powers(self.growth(np.log(GRID_M)[:, None] + self.width * NODES))
        below = expit(inside @ np.array(fitted).T).swapaxes(1, 2) @ (WEIGHTS / WEIGHTS.sum())
        found = np.maximum(np.diff(below, axis=1, prepend=0.0, append=1.0), _LEAST)
        return np.asarray(found / found.sum(axis=1, keepdims=True))

    @cached_property
    def dispersion(self) -> float:
        """By how much terrains scatter more about the stacked curves than strangers; at least 1.

        That of the curves by class, or that of their mean logarithms where it is larger: what moves all
        classes together is what looks like roughness.
        """
        squares = []
        for one in np.unique(self.terrain):
            at = self.terrain == one
            if at.sum() >= FEWEST_OF_REGION:
                true = np.log(self.roughness_m[at]).mean()
                expected = self.shares[np.argmin(np.abs(np.log(GRID_M) - true))]
                off = self._own(self.msr_v2[at]) - expected
                squares.append(float(at.sum() * (off**2 / expected).sum()) / (CLASSES - 1))
        return max(dispersion_of_means(self), float(np.mean(squares)) if squares else 1.0)

    def region(self, msr_v2: NDArray[np.float64]) -> Region:
        """Estimate a region's roughness from its residuals, V^2, shape (n,)."""
        log_likelihood = np.log(self.shares) @ self._own(msr_v2) * msr_v2.size / self.dispersion
        return likeliest(log_likelihood, msr_v2.size)

    def _own(self, msr_v2: NDArray[np.float64]) -> NDArray[np.float64]:
        classes = np.searchsorted(self.levels_v2, msr_v2, side="left")
        return np.bincount(classes, minlength=CLASSES) / msr_v2.size


def _powers(growth: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack([np.ones_like(growth), growth, growth**2], axis=-1)


def _logistic(known: NDArray[np.float64], below: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Fit a logistic curve by Newton's method; `known` has shape (n, 3)."""
    held = np.diag([0.0, _HELD, _HELD])
    at = np.zeros(known.shape[1])
    for _ in range(_ROUNDS):
        chance = expit(known @ at)
        bend = known.T @ (known * (chance * (1 - chance))[:, None]) + held
        step = np.linalg.solve(bend, known.T @ (below - chance) - held @ at)
        # Far from the solution a whole step may lead astray.
        at += step / max(1.0, float(np.abs(step).max()) / 2)
        if np.abs(step).max() < 1e-9:
            break
    return at
