"""Gaussian test pulses as points that a generator can play.

A generator joins points by straight lines, on its own grid of volts and of delays. What it makes of a pulse
comes back in ``Shot.played``, and an analysis takes that for the truth; these pulses come near enough.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput
from belahil.generators import round_to_step
from belahil.pulse_fit import CURVATURE
from belahil.stimuli import SampledPulse

if TYPE_CHECKING:
    from belahil.generators import GeneratorModel

POINTS_PER_WIDTH = 256
"""More are not sent: straight lines between so many differ from a Gaussian by 1e-5 of its peak."""

_BELOW_CODE = 0.25
"""The pulse is cut off where it is smaller than this part of a step of the converter."""


def gaussian_pulse(fwhm_s: float, peak_v: float, model: GeneratorModel, centre_s: float) -> SampledPulse:
    """Return a Gaussian as straight lines between points that `model` can play.

    Parameters
    ----------
    fwhm_s : float
        Full width at half maximum, s; at least one interval of the generator's highest rate.
    peak_v : float
        Its height, V, positive or negative: at the cut where it is given to a bench.
    model : GeneratorModel
        Of the generator that answers: its highest rate, resolution, memory and grid of delays.
    centre_s : float
        Centre, s after the trigger; the first point must not come before the trigger.

    Returns
    -------
    SampledPulse
        Begins and ends with a zero, on the generator's grids of time. The points lie on the Gaussian of
        exactly this centre, so a coarse grid of delays does not move it.

    Raises
    ------
    RefusedInput
        A width, height or centre that is no such number; a width below one interval; or a centre so early
        that the pulse would begin before its trigger.

    Notes
    -----
    Straight lines of interval h leave up to ``ln 2 (h / fwhm)**2`` of the peak: 0.0002 for 256 ns of width at
    250 MSa/s, 0.03 for 20 ns. Below about two intervals a triangle is played rather than a Gaussian.
    """
    if not (0 < fwhm_s < math.inf and math.isfinite(peak_v) and peak_v != 0):
        raise RefusedInput(f"a pulse {fwhm_s!r} s wide and {peak_v!r} V high: both must be finite, not 0")
    finest_s = 1 / model.max_arb_rate_hz
    if fwhm_s < finest_s * (1 - 1e-9):
        raise RefusedInput(
            f"a pulse {fwhm_s:.4g} s wide: {model.name} plays points {finest_s:.4g} s apart, "
            f"and that is the least width"
        )
    rate_hz = round_to_step(min(model.max_arb_rate_hz, POINTS_PER_WIDTH / fwhm_s), 1e-6)
    reach_s = _reach_s(fwhm_s, model)
    start_s = round_to_step(centre_s - reach_s - 1 / rate_hz, model.delay_step_s)
    if not 0 <= start_s < math.inf:
        raise RefusedInput(
            f"a pulse {fwhm_s:.4g} s wide at {centre_s!r} s after its trigger: it begins "
            f"{reach_s + 1 / rate_hz:.4g} s before its centre, and must begin after the trigger"
        )
    count = math.ceil((centre_s + reach_s - start_s) * rate_hz) + 2
    away = (start_s + np.arange(count) / rate_hz - centre_s) / fwhm_s
    volts = peak_v * np.exp(-0.5 * CURVATURE * away**2)
    volts[0] = volts[-1] = 0.0
    return SampledPulse(volts, rate_hz, start_s)


def earliest_centre_s(fwhm_s: float, model: GeneratorModel) -> float:
    """Return a centre, s after the trigger, that `gaussian_pulse` takes for this width and all narrower."""
    interval_s = max(1 / model.max_arb_rate_hz, fwhm_s / POINTS_PER_WIDTH)
    return _reach_s(fwhm_s, model) + interval_s + 2 * model.delay_step_s


def _reach_s(fwhm_s: float, model: GeneratorModel) -> float:
    """Return how far from its centre a pulse of full scale is larger than a part of a step."""
    steps = 2.0 ** (model.dac_bits - 1)
    return fwhm_s * math.sqrt(2 * math.log(steps / _BELOW_CODE) / CURVATURE)
