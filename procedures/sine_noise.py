"""Noise where silence shows none: from what sine fits leave over.

A converter whose steps are much larger than the noise gives the same code all through a dark window. A sine
of many codes carries the noise over the steps: what its fit leaves is the noise and the rounding, and
rounding adds a twelfth of a squared code. What is missing to that, with A, c, s the sine's amplitude, its
offset and the noise in codes, is (after Widrow and Kollar, Quantization Noise, 2008)::

    -(1 / pi^2 + 4 s^2) exp(-2 pi^2 s^2) J0(2 pi A) cos(2 pi c)

which turns its sign with every half code of amplitude, and counts as uncertainty here.

Not modelled: distortion of the receiver, which counts as noise here and does not in a dark window.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.values import Estimate

if TYPE_CHECKING:
    from collections.abc import Sequence

LEAST_AMPLITUDE_COUNTS = 4.0
"""A smaller sine does not visit enough codes."""
MOST_RELATIVE = 0.1
"""Largest relative standard uncertainty with which a noise is told."""


@dataclass(frozen=True, slots=True)
class Leftover:
    """What one sine fit left over.

    Parameters
    ----------
    counts : float
        Amplitude at the converter, codes.
    variance : float
        Of the residual, squared codes.
    """

    counts: float
    variance: float


def noise_beside_sines(leftovers: Sequence[Leftover]) -> Estimate | None:
    """Return the analog noise in codes, rms; None when the rounding hides it here too.

    Parameters
    ----------
    leftovers : sequence of Leftover
        Of usable fits at one gain code.

    Examples
    --------
    >>> found = noise_beside_sines([Leftover(counts, 0.2**2 + 1 / 12) for counts in range(10, 100)])
    >>> round(found.value, 6), round(found.standard_uncertainty, 4)
    (0.2, 0.0008)
    """
    large = [one for one in leftovers if one.counts > LEAST_AMPLITUDE_COUNTS]
    if len(large) < 2:
        return None
    noise = np.array([one.variance for one in large]) - 1 / 12
    square = float(np.mean(noise))
    if square <= 0:
        return None
    known = (1 / math.pi**2 + 4 * square) * math.exp(-2 * math.pi**2 * square)
    # Root mean square over the offset within a code, and over the phase of J0, with its envelope.
    rounding = [known / 2 / (math.pi * math.sqrt(one.counts)) for one in large]
    different = len({round(2 * one.counts) for one in large})
    scatter = float(np.std(noise, ddof=1)) / math.sqrt(noise.size)
    square_u = math.hypot(scatter, float(np.mean(rounding)) / math.sqrt(different))
    sigma = math.sqrt(square)
    sigma_u = square_u / (2 * sigma)
    return Estimate(sigma, sigma_u) if sigma_u < MOST_RELATIVE * sigma else None
