"""Candidates that a receiver reported beside those that our range finder finds in the same samples.

Both lists hold a few pulses. They are paired so that arrivals, widths and amplitudes differ least in sum; a
pair whose arrivals are further apart than half of the range finder's exclusion is none. What remains on
either side is missing or extra.

Not modelled: why they differ. A receiver with another bank of templates, another baseline or fixed-point
arithmetic differs in its own way, and the differences are shown as they are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.errors import RefusedInput

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.values import Candidate, RangeWindow
    from sim.rfm import RangeFinder

ParityStatus = Literal["ok", "differs", "no_samples", "no_candidates", "too_few_samples"]
"""Of one window: the same candidates; others; no samples; no candidates; too few samples to search."""

FEWEST_SEARCHED = 4
_NEVER = 1e6


@dataclass(frozen=True, slots=True)
class Tolerances:
    """How far a reported candidate may be from ours.

    First samples and the samples of correlation windows are integers and must be equal.

    Parameters
    ----------
    arrival_s : float
        s. Default 10 ps, 1.5 mm of range: far below what noise does to an arrival (2 ns at an SNR of 10)
        and far above rounding. It is assumed.
    fwhm_relative, amplitude_relative : float
        Parts of our value. Default 1e-3, assumed likewise.

    Raises
    ------
    RefusedInput
        A negative one, or one that is no number.
    """

    arrival_s: float = 10e-12
    fwhm_relative: float = 1e-3
    amplitude_relative: float = 1e-3

    def __post_init__(self) -> None:
        for name in self.__slots__:
            if not 0 <= getattr(self, name) < math.inf:
                raise RefusedInput(f"tolerance {name} = {getattr(self, name)!r}: 0 or more is allowed")


@dataclass(frozen=True, slots=True)
class Pair:
    """One candidate as reported and as found again.

    Parameters
    ----------
    reported, found : Candidate
        The receiver's, and ours.
    samples_differing : int
        Counts of the reported correlation window that are not those of the range window at its place.
    """

    reported: Candidate
    found: Candidate
    samples_differing: int

    @property
    def arrival_s(self) -> float:
        """Reported minus found arrival, s."""
        return self.reported.arrival_s - self.found.arrival_s

    @property
    def fwhm_s(self) -> float:
        """Reported minus found width, s."""
        return self.reported.fwhm_s - self.found.fwhm_s

    @property
    def amplitude_v(self) -> float:
        """Reported minus found amplitude, V."""
        return self.reported.amplitude_v - self.found.amplitude_v

    @property
    def first_sample(self) -> int:
        """Reported minus found first sample of the correlation window; 0 where none was reported."""
        if not self.reported.correlation_window and not self.reported.first_sample:
            return 0
        return self.reported.first_sample - self.found.first_sample

    def agrees(self, within: Tolerances) -> bool:
        """Tell whether both are the same candidate."""
        size = len(self.reported.correlation_window)
        return (
            abs(self.arrival_s) <= within.arrival_s
            and abs(self.fwhm_s) <= within.fwhm_relative * self.found.fwhm_s
            and abs(self.amplitude_v) <= within.amplitude_relative * abs(self.found.amplitude_v)
            and self.first_sample == 0
            and self.samples_differing == 0
            and size in (0, len(self.found.correlation_window))
        )


@dataclass(frozen=True, slots=True)
class WindowParity:
    """One window.

    Parameters
    ----------
    status : str
        Out of `ParityStatus`.
    pairs : tuple of Pair
        In the order of ours.
    missing, extra : tuple of Candidate
        Found by us and not reported; reported and not found by us.
    in_order : bool
        Whether the pairs have the same order on both sides.
    """

    status: ParityStatus
    pairs: tuple[Pair, ...] = ()
    missing: tuple[Candidate, ...] = ()
    extra: tuple[Candidate, ...] = ()
    in_order: bool = True


def compare(window: RangeWindow, finder: RangeFinder, within: Tolerances) -> WindowParity:
    """Search a window again and set what is found beside what was reported.

    Parameters
    ----------
    window : RangeWindow
        Its samples and what the receiver reported of them.
    finder : RangeFinder
        With the sample interval of the window.
    within : Tolerances
        What still counts as the same.
    """
    if not window.counts.size:
        return WindowParity("no_samples")
    if window.counts.size < FEWEST_SEARCHED:
        return WindowParity("too_few_samples")
    ours = finder.candidates(window, with_samples=True)
    if ours and not window.candidates:
        return WindowParity("no_candidates", missing=ours)
    near = _paired(ours, window.candidates, finder)
    pairs = tuple(
        Pair(window.candidates[there], ours[here], samples_differing(window.candidates[there], window))
        for here, there in near.items()
    )
    missing = tuple(one for place, one in enumerate(ours) if place not in near)
    extra = tuple(one for place, one in enumerate(window.candidates) if place not in near.values())
    same = not missing and not extra and all(pair.agrees(within) for pair in pairs)
    places = list(near.values())
    return WindowParity("ok" if same else "differs", pairs, missing, extra, places == sorted(places))


def _paired(
    ours: tuple[Candidate, ...], reported: tuple[Candidate, ...], finder: RangeFinder
) -> dict[int, int]:
    """Return for places in our list the place in the reported one, in the order of ours."""
    from scipy.optimize import linear_sum_assignment

    interval_s = finder.bank.sample_interval_s
    here, there = _numbers(ours), _numbers(reported)
    apart = np.abs(here[:, None, :] - there[None, :, :])
    reach = (finder.exclusion_samples + 1) / 2
    arrival = apart[..., 0] / interval_s
    # Two candidates may have been refined to one arrival; width and amplitude tell which is which.
    size = np.maximum(np.abs(here[:, None, 1:]), np.abs(there[None, :, 1:]))
    other = apart[..., 1:] / np.maximum(size, np.finfo(float).tiny)
    cost = np.where(arrival <= reach, arrival + other.sum(axis=-1), _NEVER)
    rows, columns = linear_sum_assignment(cost)
    return {
        int(row): int(column) for row, column in zip(rows, columns, strict=True) if cost[row, column] < _NEVER
    }


def _numbers(candidates: tuple[Candidate, ...]) -> NDArray[np.float64]:
    rows = [(one.arrival_s, one.fwhm_s, one.amplitude_v) for one in candidates]
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def samples_differing(reported: Candidate, window: RangeWindow) -> int:
    """Count the samples of a correlation window that are not those of the range window at its place."""
    told = np.array(reported.correlation_window, dtype=np.int64)
    there = window.counts[reported.first_sample : reported.first_sample + told.size]
    return int(np.count_nonzero(told[: there.size] != there)) + told.size - there.size
