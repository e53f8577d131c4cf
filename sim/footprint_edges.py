"""Pixels where the light on the ground has an edge or a kink: halved until that no longer shows.

The spectra of `sim.footprint_error` foretell what pixels do to light that is smooth. The edge of a field of
view, and the foot or rim of a body of revolution, are not smooth; there the pixels are tried.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput
from sim.footprint_plan import MOST_PIXELS

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from sim.footprint_plan import FootprintPlan

_LEFT = 1.6
"""Error over the change when pixels are halved, for one that falls with the power 1.5: 1 / (1 - 2^-1.5)."""

_LEFT_THEN = 0.6
"""The same for the halved pixels."""

_BESIDE = (0.7, 0.83)
"""Pixels of these sizes, too: by chance an edge may lie alike among pixels and halved ones."""


def refined(
    plan: FootprintPlan, allowed: float, samples: Callable[[FootprintPlan], NDArray[np.float64]]
) -> FootprintPlan:
    """Halve the pixels of a plan until the error that they leave is allowed.

    Parameters
    ----------
    plan : FootprintPlan
        With pixels that serve smooth light.
    allowed : float
        Share of the pixels' spacing in the tolerance.
    samples : callable
        Samples of the echo, V, by a plan; of any shape, the same for all.

    Returns
    -------
    FootprintPlan
        Its `spacing_error` is the estimate from the last halving, where that is the larger. It is met within
        a factor of 3.

    Raises
    ------
    RefusedInput
        More pixels than are allowed; the message has the error that is left.
    """
    smooth, wanted_m = plan.spacing_error, plan.pixel_m
    if 4 * plan.pixels > MOST_PIXELS:
        # They can be tried as the halves of pixels twice as large.
        plan = replace(plan, pixel_m=2 * plan.pixel_m, pixels=plan.pixels // 4)
    coarse = samples(plan)
    while True:
        finer = replace(plan, pixel_m=plan.pixel_m / 2, pixels=4 * plan.pixels)
        if finer.pixels > MOST_PIXELS:
            raise RefusedInput(
                f"tolerance {plan.tolerance:g} with an edge or a kink in the light on the ground: "
                f"{plan.pixels} pixels, one every {plan.pixel_m:.3g} m, leave a predicted error of "
                f"{plan.spacing_error:.2g}"
            )
        fine = samples(finer)
        beside = [samples(replace(plan, pixel_m=size * plan.pixel_m)) for size in _BESIDE]
        peak = float(np.abs(fine).max())
        moved = max(float(np.abs(fine - one).max()) for one in (coarse, *beside))
        change = moved / peak if peak else 0.0
        if _LEFT * change <= allowed and plan.pixel_m <= wanted_m:
            return replace(plan, spacing_error=max(smooth, _LEFT * change))
        finer = replace(finer, spacing_error=max(smooth, _LEFT_THEN * change))
        if finer.spacing_error <= allowed:
            return finer
        plan, coarse = finer, fine
