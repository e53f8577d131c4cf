"""Echoes and noise told apart by a mixture, beside the rule of 10 m.

Within some distance of the truth, errors of true detections are taken for normal and those of noise for
uniform: shares, mean and width are those of the largest likelihood. Where an echo is hardly above the noise
its own errors have wider tails than a normal distribution; they count as noise here and not in the 10 m rule.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.values import Estimate

if TYPE_CHECKING:
    from numpy.typing import NDArray

REACH_M = 100.0
"""Errors further off are noise for certain; of four candidates at random one in 37 is nearer."""
_STEPS, _SETTLED, _FEWEST = 2000, 1e-10, 20


@dataclass(frozen=True, slots=True)
class Mixture:
    """Normal and uniform errors.

    Parameters
    ----------
    pfd : Estimate
        Share of shots whose error is not of the normal part.
    spread : Estimate
        Standard deviation of the normal part, m.
    mean_m : float
        Of it, m.
    """

    pfd: Estimate
    spread: Estimate
    mean_m: float


def fit_mixture(errors_m: NDArray[np.float64]) -> Mixture | None:
    """Fit the mixture to errors of the nearest candidates.

    Parameters
    ----------
    errors_m : ndarray of float64, shape (n,)
        m; infinite where there is no candidate.

    Returns
    -------
    Mixture or None
        None with fewer than 20 errors within 100 m, or where no normal part is left.
    """
    near = errors_m[np.abs(errors_m) <= REACH_M]
    if near.size < _FEWEST:
        return None
    uniform = 1 / (2 * REACH_M)
    share = 0.5
    mean_m = float(np.median(near))
    width_m = max(1.4826 * float(np.median(np.abs(near - mean_m))), 1e-3)
    for _ in range(_STEPS):
        with np.errstate(under="ignore"):
            normal = np.exp(-0.5 * ((near - mean_m) / width_m) ** 2) / (width_m * math.sqrt(2 * math.pi))
        true = share * normal / (share * normal + (1 - share) * uniform)
        total = float(true.sum())
        if total < 2:
            return None
        mean_m = float(true @ near) / total
        width_m, before = math.sqrt(max(float(true @ (near - mean_m) ** 2) / total, 1e-12)), width_m
        moved, share = abs(total / near.size - share), total / near.size
        if moved + abs(width_m / before - 1) < _SETTLED:
            break
    pfd = 1 - share * near.size / errors_m.size
    pfd_u = math.sqrt(max(pfd * (1 - pfd), 1 / errors_m.size) / errors_m.size)
    width_u_m = _width_u_m(near, share, mean_m, width_m)
    return Mixture(Estimate(pfd, pfd_u, "1"), Estimate(width_m, width_u_m, "m"), mean_m)


def _width_u_m(near_m: NDArray[np.float64], share: float, mean_m: float, width_m: float) -> float:
    """Standard uncertainty of the normal part's width, from the scatter of the errors' scores, m.

    Which errors belong to it is not known: with few true detections that is most of it.
    """
    q = (near_m - mean_m) / width_m
    with np.errstate(under="ignore"):
        normal = np.exp(-0.5 * q**2) / (width_m * math.sqrt(2 * math.pi))
    density = share * normal + (1 - share) / (2 * REACH_M)
    true = share * normal / density
    # Derivatives of the logarithm of the density by share, mean and logarithm of the width.
    scores = np.stack([(normal - 1 / (2 * REACH_M)) / density, true * q / width_m, true * (q**2 - 1)])
    return width_m * math.sqrt(float(np.linalg.pinv(scores @ scores.T)[2, 2]))
