"""Windows whose receiver did not count what its converter clipped."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from belahil.values import RangeWindow, Shot

CLIPPED_SAMPLES = 2
"""So many samples at an end code are taken for clipped; a single one may be an extreme of the noise."""


def with_clipping(shot: Shot, bits: int) -> Shot:
    """Return a shot whose window tells of clipped samples, when its receiver told of none but shows some.

    Parameters
    ----------
    shot : Shot
        As recorded.
    bits : int
        Of the converter.
    """
    window = shot.window
    if window.saturated or not window.counts.size:
        return shot
    low, high = span_of(window, bits)
    # Most windows stay far from both ends, which one pass over the counts tells.
    if window.counts.max() < high and window.counts.min() > low:
        return shot
    ends = int(np.count_nonzero((window.counts == low) | (window.counts == high)))
    return replace(shot, window=replace(window, saturated=ends)) if ends >= CLIPPED_SAMPLES else shot


def span_of(window: RangeWindow, bits: int) -> tuple[int, int]:
    """Return the lowest and the highest count of a converter, numbered about zero or from zero.

    Counts that fit both are numbered from zero when 0 V lies nearer to the middle of that span.
    """
    half = 1 << (bits - 1)
    lowest, highest = int(window.counts.min()), int(window.counts.max())
    from_zero = bits < 16 and lowest >= 0 and (highest >= half or window.zero_count >= half / 2)
    return (0, 2 * half - 1) if from_zero else (-half, half - 1)
