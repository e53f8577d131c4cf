"""Delay of fitted arrivals behind a receiver's filter against the detected width, by simulation.

What this does not model: pulses that are not Gaussian before the filter, as slopes with relief make them, and
noise; both scatter about this curve.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from belahil.delay_curve import NARROWEST_S, WIDEST_S, DelayCurve, fit_delay_curve
from belahil.errors import RefusedInput
from belahil.pulse_fit import gaussian_fit
from sim.kernel import Kernel
from sim.pulse_shape import FWHM_OF_SIGMA, PulsePiece, PulseShape

if TYPE_CHECKING:
    from collections.abc import Sequence

_PHASES = 20
"""Places of the pulse between two samples: the fit of a narrow pulse wobbles by 0.5 ns with them."""

_WIDTHS = 46
_PULSE_S = 0.5e-9
"""As wide as nothing behind any receiver that samples each some nanoseconds."""


def filter_delay_curve(
    poles: Sequence[complex], sample_interval_s: float, zeros: int = 0, degree: int = 5
) -> DelayCurve:
    """Return the delay of Gaussian pulses from their centre to that of the fitted Gaussian.

    The curve begins at 20 ns, or at the width of the shortest pulse where that is more.

    Parameters
    ----------
    poles, zeros
        Of the receiver, as in `belahil.pole_modes`.
    sample_interval_s : float
        s.
    degree : int
        Of the polynomial.

    Raises
    ------
    RefusedInput
        Poles that are not stable or not conjugate, or a filter behind which every pulse is too wide.

    Notes
    -----
    Widths behind the filter are spread evenly: each has the same weight.
    """
    found = [detected(tuple(poles), zeros, sample_interval_s, _PULSE_S)]
    narrowest_s = found[0][0]
    if narrowest_s >= WIDEST_S:
        raise RefusedInput(
            f"behind this filter every pulse is {narrowest_s:.3g} s wide or wider: a curve has widths from "
            f"{NARROWEST_S:.3g} to {WIDEST_S:.3g} s"
        )
    first_s = max(NARROWEST_S, narrowest_s)
    for wanted_s in np.linspace(first_s, WIDEST_S, _WIDTHS)[1:]:
        optical_s = math.sqrt(wanted_s**2 - narrowest_s**2)  # nearly: squares of widths add
        found.append(detected(tuple(poles), zeros, sample_interval_s, optical_s))
    widths_s, delays_s = np.transpose(found)
    inside = (widths_s >= first_s) & (widths_s <= WIDEST_S)
    return fit_delay_curve(widths_s[inside], delays_s[inside], degree, first_s)


def detected(
    poles: tuple[complex, ...], zeros: int, sample_interval_s: float, fwhm_s: float
) -> tuple[float, float]:
    """Return detected width and delay of a Gaussian pulse, means over places between two samples, s.

    Raises
    ------
    RefusedInput
        As `filter_delay_curve`; or a pulse that has no fit.
    """
    kernel = Kernel(PulseShape((PulsePiece(1.0, fwhm_s / FWHM_OF_SIGMA),)), poles, zeros)
    before = math.ceil((1.5 * fwhm_s + 20e-9) / sample_interval_s)
    count = before + math.ceil((1.5 * fwhm_s + 10 / abs(poles[0])) / sample_interval_s)
    pulses = []
    for phase in range(_PHASES):
        first_s = (phase / _PHASES - before) * sample_interval_s
        volts = kernel.exact(first_s + sample_interval_s * np.arange(count))
        fit = gaussian_fit(volts, sample_interval_s)
        if fit.status != "ok" or fit.pulse is None:
            raise RefusedInput(f"a pulse of {fwhm_s:.3g} s behind this filter: the fit says {fit.status}")
        pulses.append((fit.pulse.fwhm_s, first_s + fit.pulse.arrival_s))
    width_s, delay_s = np.mean(pulses, axis=0).tolist()
    return width_s, delay_s
