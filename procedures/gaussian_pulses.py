"""Gaussian test pulses as points that a generator can play.

A generator joins points by straight lines, on its own grid of volts and of delays. What it makes of a pulse
comes back in ``Shot.played``, and an analysis takes that for the truth; these pulses come near enough.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput
from belahil.generators import round_to_step
from belahil.pulse_fit import CURVATURE
from belahil.stimuli import SampledPulse
from belahil.uncertainty import sized

if TYPE_CHECKING:
    from collections.abc import Sequence

    from belahil.generators import GeneratorModel

POINTS_PER_WIDTH = 256
"""More are not sent: straight lines between so many differ from a Gaussian by 1e-5 of its peak."""

_BELOW_CODE = 0.25
"""The pulse is cut off where it is smaller than this part of a step of the converter."""


@dataclass(frozen=True, slots=True)
class TrainPulse:
    """One Gaussian of a train.

    Parameters
    ----------
    fwhm_s : float
        Full width at half maximum, s; above zero.
    peak_v : float
        Height, V, positive or negative.
    centre_s : float
        Centre, s after the trigger.

    Raises
    ------
    RefusedInput
        A number that is not finite, a width that is not above zero, or a height of zero.
    """

    fwhm_s: float
    peak_v: float
    centre_s: float

    def __post_init__(self) -> None:
        if not (0 < self.fwhm_s < math.inf and math.isfinite(self.peak_v) and self.peak_v != 0):
            raise RefusedInput(
                f"a pulse {self.fwhm_s!r} s wide and {self.peak_v!r} V high: both must be finite, not 0"
            )


def gaussian_pulse(fwhm_s: float, peak_v: float, model: GeneratorModel, centre_s: float) -> SampledPulse:
    """Return a Gaussian as straight lines between points that `model` can play; see `gaussian_train`."""
    return gaussian_train((TrainPulse(fwhm_s, peak_v, centre_s),), model)


def gaussian_train(pulses: Sequence[TrainPulse], model: GeneratorModel) -> SampledPulse:
    """Return Gaussians, one after the other or over each other, as points that `model` can play.

    Parameters
    ----------
    pulses : sequence of TrainPulse
        At least one; volts at the cut where it is given to a bench. A width is at least one interval of the
        generator's highest rate.
    model : GeneratorModel
        Of the generator that answers: its highest rate, resolution and grid of delays.

    Returns
    -------
    SampledPulse
        Begins and ends with a zero, on the generator's grids of time. The points lie on Gaussians of exactly
        these centres, so a coarse grid of delays does not move them.

    Raises
    ------
    RefusedInput
        No pulse; a width below one interval; or a centre so early that its pulse would begin before the
        trigger.

    Notes
    -----
    Straight lines of interval h leave up to ``ln 2 (h / fwhm)**2`` of the peak: 0.0002 for 256 ns of width at
    250 MSa/s, 0.03 for 20 ns. Below about two intervals a triangle is played rather than a Gaussian.
    """
    if not pulses:
        raise RefusedInput("a train of no pulses: at least one is needed")
    narrowest_s, finest_s = min(one.fwhm_s for one in pulses), 1 / model.max_arb_rate_hz
    if narrowest_s < finest_s * (1 - 1e-9):
        raise RefusedInput(
            f"a pulse {sized(narrowest_s, 's', 4)} wide: {model.name} plays points "
            f"{sized(finest_s, 's', 4)} apart, and that is the least width"
        )
    rate_hz = round_to_step(min(model.max_arb_rate_hz, POINTS_PER_WIDTH / narrowest_s), 1e-6)
    start_s = math.inf
    for one in pulses:
        lead_s = _reach_s(one.fwhm_s, model) + 1 / rate_hz
        if not lead_s <= one.centre_s < math.inf:
            raise RefusedInput(
                f"a pulse {one.fwhm_s:.4g} s wide at {one.centre_s!r} s after its trigger: it begins "
                f"{lead_s:.4g} s before its centre, and must begin after the trigger"
            )
        start_s = min(start_s, one.centre_s - lead_s)
    start_s = max(model.started_s(start_s, rate_hz), 0.0)
    end_s = max(one.centre_s + _reach_s(one.fwhm_s, model) for one in pulses)
    times_s = start_s + np.arange(math.ceil((end_s - start_s) * rate_hz) + 2) / rate_hz
    volts = np.zeros(times_s.size)
    with np.errstate(under="ignore"):
        for one in pulses:
            volts += one.peak_v * np.exp(-0.5 * CURVATURE * ((times_s - one.centre_s) / one.fwhm_s) ** 2)
    volts[0] = volts[-1] = 0.0
    return SampledPulse(volts, rate_hz, start_s)


def earliest_centre_s(fwhm_s: float, model: GeneratorModel) -> float:
    """Return a centre, s after the trigger, that `gaussian_pulse` takes for this width and all narrower."""
    interval_s = max(1 / model.max_arb_rate_hz, fwhm_s / POINTS_PER_WIDTH)
    return _reach_s(fwhm_s, model) + interval_s + 2 * model.start_step_s(1 / interval_s)


def _reach_s(fwhm_s: float, model: GeneratorModel) -> float:
    """Return how far from its centre a pulse of full scale is larger than a part of a step."""
    steps = 2.0 ** (model.dac_bits - 1)
    return fwhm_s * math.sqrt(2 * math.log(steps / _BELOW_CODE) / CURVATURE)
