"""A filter taken apart into modes, ``H(s) = sum of weight / (s - pole)``, for any poles.

A filter is given by all its poles (rad/s) and by the number of its zeros at s = 0. Each zero belongs to one
of the slowest poles q and makes a high-pass s / (s - q) of it; every other pole p contributes -p / (s - p).
So the gain is 1 in the pass band, or at 0 Hz when there is no high-pass.

Poles that (nearly) coincide have weights that grow without bound and cancel. Such a cluster is replaced by
Cauchy's integral on a circle round it, by the trapezoid rule at 16 points (Trefethen and Weideman, SIAM
Review 56, 2014, theorem 2.1). Its points are modes like any other; no gap, not even zero, is a special case.
"""

from __future__ import annotations

import cmath
import math
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

# A pair closer than this loses two digits in its weights; a circle must keep 1/8 of the way to other poles
# and hold its own within 1/8 of its radius, so that 16 points leave 8^-16 = 4e-15. It is at most 1/8 of
# the decay rate either: the rule leaves (radius t)^16 / 16! of e^(pole t), 4e-16 at the worst time.
_GAP, _RATIO, _POINTS = 1e-2, 8.0, 16


@lru_cache(maxsize=64)
def ordered_poles(poles: tuple[complex, ...], zeros: int) -> tuple[complex, ...]:
    """Return the poles slowest first and exactly conjugate; the first `zeros` are the high-pass ones.

    Raises
    ------
    RefusedInput
        Poles that are not stable or not conjugate, or no pole left for a low-pass.
    """
    if not 0 <= zeros < len(poles):
        raise RefusedInput(f"{zeros} zeros and {len(poles)} poles: at least one pole must be without a zero")
    if any(not (pole.real < 0 and cmath.isfinite(pole)) for pole in poles):
        raise RefusedInput(f"poles {poles}: all must lie in the left half of the s-plane")
    upper = sorted((pole for pole in poles if pole.imag > 0), key=_size_and_height)
    lower = sorted((pole.conjugate() for pole in poles if pole.imag < 0), key=_size_and_height)
    if len(upper) != len(lower) or not np.allclose(upper, lower, rtol=1e-9, atol=0):
        raise RefusedInput(f"poles {poles}: complex ones must come in conjugate pairs")
    real = [complex(pole.real) for pole in poles if pole.imag == 0]
    return tuple(sorted([*upper, *(pole.conjugate() for pole in upper), *real], key=abs))


def _size_and_height(pole: complex) -> tuple[float, float]:
    return abs(pole), pole.imag


def transfer(ordered: tuple[complex, ...], zeros: int, s: ArrayLike) -> NDArray[np.complex128]:
    """Return H(s) of poles from `ordered_poles`; the shape is that of `s` (rad/s)."""
    at = np.asarray(s, dtype=np.complex128)
    value = np.ones(at.shape, dtype=np.complex128)
    for number, pole in enumerate(ordered):
        value *= (at if number < zeros else -pole) / (at - pole)
    return value


@lru_cache(maxsize=64)
def modes(ordered: tuple[complex, ...], zeros: int) -> tuple[tuple[complex, complex], ...]:
    """Return (pole, weight) whose responses to a real input sum to the filter's in their real part.

    Of two conjugate modes the upper one stands for both, with twice the weight.

    Parameters
    ----------
    ordered : tuple of complex
        From `ordered_poles`, rad/s.
    zeros : int
        As there.
    """
    found: list[tuple[complex, complex]] = []
    for cluster in _clusters(ordered):
        centre = sum(cluster) / len(cluster)
        own_conjugate = all(pole.conjugate() in cluster for pole in cluster)
        if centre.imag < 0 and not own_conjugate:
            continue
        if len(cluster) == 1:
            factor = 1 if own_conjugate else 2
            found.append((cluster[0], factor * _residue(ordered, zeros, cluster[0])))
            continue
        if own_conjugate:
            centre = complex(centre.real)
        others = [abs(pole - centre) for pole in ordered if pole not in cluster]
        radius = min([-centre.real / _RATIO, *(distance / _RATIO for distance in others)])
        for k in range(_POINTS // 2 if own_conjugate else _POINTS):
            arm = cmath.rect(radius, 2 * math.pi * (k + 0.5) / _POINTS)
            weight = 2 * complex(transfer(ordered, zeros, centre + arm)) * arm / _POINTS
            found.append((centre + arm, weight))
    return tuple(found)


def _residue(ordered: tuple[complex, ...], zeros: int, own: complex) -> complex:
    value = 1 + 0j
    for number, pole in enumerate(ordered):
        gain = own if number < zeros else -pole
        value *= gain if pole == own else gain / (own - pole)
    return value


def _clusters(ordered: tuple[complex, ...]) -> list[list[complex]]:
    """Group poles so that each group of several is small against its distance to the others."""
    groups = [[pole] for pole in ordered]
    merged = True
    while merged:
        merged = False
        for i, j in ((second, first) for second in range(len(groups)) for first in range(second)):
            gap = min(abs(a - b) for a in groups[i] for b in groups[j])
            size = max(_size(groups[i]), _size(groups[j]))
            slowest = min(-pole.real for pole in groups[i] + groups[j])
            if gap < max(_GAP * slowest, _RATIO**2 * size):
                groups[j] += groups.pop(i)
                merged = True
                break
    return groups


def _size(group: list[complex]) -> float:
    centre = sum(group) / len(group)
    return max(abs(pole - centre) for pole in group)
