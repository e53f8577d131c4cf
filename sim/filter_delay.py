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
    every = tuple(poles)
    optical_s = spread_widths_s(every, zeros, sample_interval_s, _PULSE_S, _WIDTHS)
    found = [detected(every, zeros, sample_interval_s, one) for one in optical_s]
    widths_s, delays_s = np.transpose(found)
    # Where a shorter pulse is detected narrower than 20 ns, the first of these may miss 20 ns by a little.
    least_s = _narrowest(every, zeros, sample_interval_s, _PULSE_S) or float(widths_s.min())
    first_s = max(NARROWEST_S, least_s)
    inside = (widths_s >= first_s) & (widths_s <= WIDEST_S)
    return fit_delay_curve(widths_s[inside], delays_s[inside], degree, first_s)


def spread_widths_s(
    poles: tuple[complex, ...], zeros: int, sample_interval_s: float, shortest_s: float, count: int
) -> tuple[float, ...]:
    """Return widths of Gaussian pulses whose detected widths lie nearly evenly from 20 to 110 ns, s.

    Parameters
    ----------
    poles, zeros, sample_interval_s
        As in `filter_delay_curve`.
    shortest_s : float
        No pulse is shorter, s; where it is detected wider than 20 ns, that is the first width.
    count : int
        Of widths.

    Raises
    ------
    RefusedInput
        Behind this filter every pulse is wider than 110 ns.
    """
    least_s = _narrowest(poles, zeros, sample_interval_s, shortest_s)
    if least_s >= WIDEST_S:
        raise RefusedInput(
            f"behind this filter every pulse is {least_s:.3g} s wide or wider: a curve has widths from "
            f"{NARROWEST_S:.3g} to {WIDEST_S:.3g} s"
        )
    # Squares of widths add, nearly: what the filter adds is read off one pulse.
    if least_s:
        added_s2 = least_s**2 - shortest_s**2
    else:
        added_s2 = detected(poles, zeros, sample_interval_s, NARROWEST_S)[0] ** 2 - NARROWEST_S**2
    wanted_s = np.linspace(max(NARROWEST_S, least_s), WIDEST_S, count)
    widths_s = np.sqrt(np.maximum(wanted_s**2 - added_s2, shortest_s**2))
    return tuple(float(one) for one in widths_s)


def _narrowest(poles: tuple[complex, ...], zeros: int, sample_interval_s: float, shortest_s: float) -> float:
    """Return the detected width of the shortest pulse, s; 0 where its samples do not tell one."""
    try:
        return detected(poles, zeros, sample_interval_s, shortest_s)[0]
    except RefusedInput:
        return 0.0


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
