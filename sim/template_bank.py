"""The range finder's templates: Gaussians, widths in geometric steps, and a cheap way to correlate with all.

A Gaussian convolved with a Gaussian is a Gaussian. So a template is made from the widest narrower one that
serves: its output is filtered once more with few taps, several samples apart where it is smooth enough.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput
from belahil.pulse_fit import CURVATURE
from belahil.uncertainty import sized

if TYPE_CHECKING:
    from numpy.typing import NDArray

SIDE_TAPS = 4
"""Taps on each side of the middle one."""

_REACH = 1.5
"""Full widths at half maximum, after which a Gaussian's taps are left out (0.2 % of the peak)."""
_NARROWEST = 1.2
"""Full width, in taps, below which a sampled Gaussian no longer has its variance."""
_TAPS_IN_WIDTH = 2.4
"""Taps may be so far apart that the full width of what goes in holds 2.4."""
_MOST_WIDTHS, _WIDEST, _NOTHING = 64, 1000, 1e-10


@dataclass(frozen=True, eq=False)
class Stage:
    """One filter of the bank.

    Parameters
    ----------
    source : int
        The earlier stage whose output goes in; -1: the samples.
    stride : int
        Samples from tap to tap.
    taps : ndarray of float64, shape (5,)
        The middle one, and those at 1, 2, 3, 4 strides on either side.
    scored : bool
        Whether it is a template; else it only feeds others.
    fwhm : float
        Of the Gaussian that it makes of the samples, in samples.
    response : ndarray of float64, shape (2 reach + 1,)
        That Gaussian.
    """

    source: int
    stride: int
    taps: NDArray[np.float64]
    scored: bool
    fwhm: float
    response: NDArray[np.float64]

    @property
    def energy(self) -> float:
        """Sum of the squares of the response."""
        return float(self.response @ self.response)


@dataclass(frozen=True)
class TemplateBank:
    """Gaussian templates.

    Parameters
    ----------
    sample_interval_s : float
        Between samples, s.
    count : int
        Number of widths, 3 to 64. Default 12: assumed.
    narrowest_s, widest_s : float
        Full widths at half maximum, s, from 1.2 to 1000 sample intervals; the rest lie between in geometric
        steps. Default 18 and 120 ns: the published range of 20 to 110 ns with a margin, assumed.

    Raises
    ------
    RefusedInput
        Values outside these ranges.
    """

    sample_interval_s: float
    count: int = 12
    narrowest_s: float = 18e-9
    widest_s: float = 120e-9

    def __post_init__(self) -> None:
        if not 3 <= self.count <= _MOST_WIDTHS:
            raise RefusedInput(f"{self.count} templates: 3 to {_MOST_WIDTHS} are allowed")
        if not 0 < self.sample_interval_s < math.inf:
            raise RefusedInput(f"sample interval {self.sample_interval_s!r} s: must be above zero")
        least_s, most_s = _NARROWEST * self.sample_interval_s, _WIDEST * self.sample_interval_s
        if not least_s <= self.narrowest_s < self.widest_s <= most_s:
            raise RefusedInput(
                f"templates from {self.narrowest_s!r} to {self.widest_s!r} s: rising widths from "
                f"{sized(least_s, 's', 3)} to {sized(most_s, 's', 3)} are allowed"
            )

    @cached_property
    def widths(self) -> NDArray[np.float64]:
        """Full widths at half maximum, in samples, shape (count,), rising."""
        return np.geomspace(self.narrowest_s, self.widest_s, self.count) / self.sample_interval_s

    @cached_property
    def stages(self) -> tuple[Stage, ...]:
        """The filters that make all the scores, each after those it needs."""
        found: list[Stage] = []
        for width in self.widths:
            while (stage := _template(found, float(width))) is None:
                found.append(_bridge(found, float(width)))
            found.append(stage)
        return tuple(found)

    @cached_property
    def reach(self) -> int:
        """Samples on either side that a stage touches at most."""
        return max(stage.response.size // 2 for stage in self.stages)

    @cached_property
    def plan(
        self,
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float32], NDArray[np.float32]]:
        """The stages' sources, strides, taps and what makes a score of an output, 0 where it is none."""
        return (
            np.array([stage.source for stage in self.stages]),
            np.array([stage.stride for stage in self.stages]),
            np.array([stage.taps for stage in self.stages], dtype=np.float32),
            np.array([stage.scored / math.sqrt(stage.energy) for stage in self.stages], dtype=np.float32),
        )

    @cached_property
    def templates(self) -> NDArray[np.float32]:
        """What the stages amount to: templates of unit energy, shape (count, 2 reach + 1)."""
        rows = [
            np.pad(stage.response / math.sqrt(stage.energy), self.reach - stage.response.size // 2)
            for stage in self.stages
            if stage.scored
        ]
        templates = np.array(rows)
        # The outermost taps are products of many small ones: in single precision subnormal, and slow.
        return np.where(templates > _NOTHING, templates, 0.0).astype(np.float32)

    @cached_property
    def tap_reach(self) -> int:
        """Samples on either side of the middle beyond which no template has a tap; at most `reach`."""
        lit = np.flatnonzero(self.templates.any(axis=0))
        return int(max(self.reach - lit[0], lit[-1] - self.reach))

    @cached_property
    def lit_templates(self) -> NDArray[np.float32]:
        """The templates as far as they have taps, shape (count, 2 tap_reach + 1)."""
        return self.templates[:, self.reach - self.tap_reach : self.reach + self.tap_reach + 1]


def _template(found: list[Stage], width: float) -> Stage | None:
    """Make a template from the widest earlier stage that few taps can widen, or from the samples."""
    for source in range(len(found) - 1, -2, -1):
        before = found[source].fwhm if source >= 0 else 0.0
        added = math.sqrt(max(width**2 - before**2, 0.0))
        if added < _NARROWEST:
            continue
        stride = max(1, math.floor(min(before / _TAPS_IN_WIDTH, added / _NARROWEST)))
        if math.ceil(_REACH * added / stride) <= SIDE_TAPS:
            return _stage(found, source, stride, added, scored=True)
    return None


def _bridge(found: list[Stage], width: float) -> Stage:
    """Make a stage on the way to a template that is too wide for one step: as few taps reach, or half way."""
    before = found[-1].fwhm if found else 0.0
    stride = max(1, math.floor(before / _TAPS_IN_WIDTH))
    added = min(stride * SIDE_TAPS / _REACH, math.sqrt((width**2 - before**2) / 2))
    return _stage(found, len(found) - 1, stride, added, scored=False)


def _stage(found: list[Stage], source: int, stride: int, added: float, scored: bool) -> Stage:
    distance = stride * np.arange(SIDE_TAPS + 1) / added
    taps = np.where(distance < _REACH + stride / added, np.exp(-0.5 * CURVATURE * distance**2), 0.0)
    before = found[source].response if source >= 0 else np.ones(1)
    spread = np.zeros(2 * SIDE_TAPS * stride + 1)
    spread[::stride] = np.concatenate([taps[:0:-1], taps])
    width = math.hypot(found[source].fwhm if source >= 0 else 0.0, added)
    response = np.convolve(before, spread)
    unused = int(np.flatnonzero(response)[0])
    return Stage(source, stride, taps, scored, width, response[unused : response.size - unused])
