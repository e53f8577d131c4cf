"""A comb of pulses in one window: equal test pulses between two reference pulses.

Where a window begins between two samples of the receiver is not known, so one pulse tells when it arrives
only to a part of a sample. All pulses of one window share that unknown, and the arrival of the test pulses
relative to the two reference pulses is free of it. The comb lies symmetric about its middle, so an error of
the receiver's clock cancels in their mean as well. From one pulse to the next the comb moves by an equal
part of the period in which the receiver samples (of all its converters together): the mean over the test
pulses is the mean over places between two samples, whatever the trigger does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput
from procedures.gaussian_pulses import TrainPulse, gaussian_train

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.generators import GeneratorModel
    from belahil.stimuli import SampledPulse

SEPARATION_S = 600e-9
"""At least so far apart, the widest pulses leave nothing in the windows of their neighbours."""

FEWEST_TESTS = 4

_UNEVEN = 0.01
"""Of the spacing: a pulse as narrow as the distance of its points moves with them, by less."""

_FOOT = 0.05
"""Of the largest magnitude: what is below lies between two pulses."""


@dataclass(frozen=True, slots=True)
class PulseComb:
    """A comb to be played.

    Parameters
    ----------
    fwhm_s, reference_fwhm_s : float
        Full width at half maximum of the test pulses; of the two references, the first and the last pulse, s.
    peak_v : float
        Height of all pulses, V at the cut.
    tests : int
        Number of test pulses, at least 4: their mean is free of what repeats 1 to tests - 1 times in a
        period.
    first_s : float
        Centre of the first pulse, s after the trigger.
    spacing_s : float
        From one centre to the next, s.

    Raises
    ------
    RefusedInput
        Fewer test pulses, or pulses closer than `SEPARATION_S`.
    """

    fwhm_s: float
    reference_fwhm_s: float
    peak_v: float
    tests: int
    first_s: float
    spacing_s: float

    def __post_init__(self) -> None:
        if self.tests < FEWEST_TESTS:
            raise RefusedInput(f"{self.tests} test pulses in a comb: at least {FEWEST_TESTS} are needed")
        if not SEPARATION_S <= self.spacing_s < math.inf:
            raise RefusedInput(f"pulses {self.spacing_s!r} s apart: at least {SEPARATION_S:g} s are needed")

    @property
    def centres_s(self) -> NDArray[np.float64]:
        """Centres of all pulses, s after the trigger, shape (tests + 2,)."""
        return self.first_s + self.spacing_s * np.arange(self.tests + 2.0)

    def stimulus(self, model: GeneratorModel) -> SampledPulse:
        """Return the comb as points that `model` can play; errors as `gaussian_train`."""
        widths_s = [self.reference_fwhm_s, *[self.fwhm_s] * self.tests, self.reference_fwhm_s]
        return gaussian_train(
            [
                TrainPulse(width_s, self.peak_v, float(centre_s))
                for width_s, centre_s in zip(widths_s, self.centres_s, strict=True)
            ],
            model,
        )


def comb_spacing_s(sample_interval_s: float, converters: int, tests: int) -> float:
    """Return the least spacing of a comb whose test pulses take all places between two samples in turn, s.

    It is a whole number of periods, each a sample of every converter, and one of `tests` parts of a period.
    """
    period_s = converters * sample_interval_s
    return (math.ceil(SEPARATION_S / period_s - 1e-9) + 1 / tests) * period_s


@dataclass(frozen=True, slots=True, eq=False)
class PlayedComb:
    """A comb as a generator played it.

    Parameters
    ----------
    centres_s : ndarray of float64, shape (n,)
        Centroids of the pulses, s after the trigger.
    widths_s : ndarray of float64, shape (n,)
        Full widths at half maximum between the points, s, before the poles of the generator.
    """

    centres_s: NDArray[np.float64]
    widths_s: NDArray[np.float64]

    @property
    def middle_s(self) -> float:
        """Half way between the first and the last centre, s."""
        return float(self.centres_s[0] + self.centres_s[-1]) / 2


def played_comb(played: SampledPulse) -> PlayedComb:
    """Find the pulses in what a generator played.

    Parameters
    ----------
    played : SampledPulse
        From ``Shot.played``. Poles that it has passed delay every centroid by the sum of -1 / pole.

    Raises
    ------
    RefusedInput
        No comb: fewer than six pulses, or pulses that are not evenly spaced, or that point downwards.
    """
    volts = played.volts
    edges = np.diff((volts > _FOOT * np.max(np.abs(volts))).astype(np.int8), prepend=0, append=0)
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    if begins.size < FEWEST_TESTS + 2:
        raise RefusedInput(
            f"what was played has {begins.size} pulses: a comb of at least {FEWEST_TESTS + 2} is needed, as "
            "belahil arrival-time plays it"
        )
    # A pulse reaches to the middle of the gap to the next.
    middles = (ends[:-1] + begins[1:]) // 2
    parts = zip((0, *middles), (*middles, volts.size), strict=True)
    interval_s = 1 / played.sample_rate_hz
    # A step lasts an interval, a straight line is centred on its point.
    late_s = interval_s / 2 if played.interpolation == "hold" else 0.0
    late_s += sum((-1 / pole).real for pole in played.poles)
    found = [_pulse(volts[low:high], float(low), interval_s) for low, high in parts]
    centres_s, widths_s = np.transpose(found)
    steps_s = np.diff(centres_s)
    if np.ptp(steps_s) > _UNEVEN * steps_s.mean():
        raise RefusedInput(
            f"pulses {steps_s.min():.4g} to {steps_s.max():.4g} s apart were played: a comb has equal steps"
        )
    return PlayedComb(played.start_s + late_s + centres_s, widths_s)


def _pulse(volts: NDArray[np.float64], first: float, interval_s: float) -> tuple[float, float]:
    """Return centroid and full width at half maximum of straight lines, s from point 0."""
    places = np.arange(float(volts.size))
    top = int(np.argmax(volts))
    half = volts[top] / 2
    left = np.interp(half, volts[: top + 1], places[: top + 1])
    right = np.interp(half, volts[top:][::-1], places[top:][::-1])
    return (first + float(volts @ places / volts.sum())) * interval_s, float(right - left) * interval_s
