"""The delay of the detected pulse, in each definition, and what the published figures would need.

The appendix "Time delay of transmitted pulse" of Nishiyama et al. prints 5.49 ns (main laser, 17 %) and
5.45 ns (redundant, 22 %) without saying between which two instants. Behind a Butterworth filter of third
order and 19 MHz no plain definition gives so little: the group delay at 0 Hz alone is 16.75 ns. So each
definition is stated here, and with it which reference would have to be taken off, or which tail the pulse
would have.

The centre is that of the Gaussian which the range finder fits to a correlation window, as a mean over all
places of the pulse between two samples; a single shot scatters about it by some 0.5 ns.

What this does not model: the delays of fibre, telescope and cables, which the offsets of a range carry.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from belahil.pulse_fit import gaussian_fit
from procedures.tx_likelihood import PHASES
from procedures.tx_response import CutResponses

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from procedures.known_receiver import KnownReceiver
    from procedures.tx_pulse import KnownPulse, OpticalPulse

Definition = Literal[
    "centre_minus_peak", "centre_minus_cut_centroid", "centre_minus_full_centroid", "filtered_peak_minus_peak"
]
DEFINITIONS: tuple[Definition, ...] = get_args(Definition)
MEANING: dict[Definition, str] = {
    "centre_minus_peak": "centre of the fitted Gaussian minus peak of the light",
    "centre_minus_cut_centroid": "centre of the fitted Gaussian minus centroid of the light behind the fibre",
    "centre_minus_full_centroid": "centre of the fitted Gaussian minus centroid of the whole light",
    "filtered_peak_minus_peak": "peak of the filtered pulse minus peak of the light",
}
Reference = Literal["none", "dc_group_delay", "sample_interval"]
REFERENCES: tuple[Reference, ...] = get_args(Reference)

PUBLISHED: dict[str, tuple[float, float]] = {"main": (0.17, 5.49e-9), "redundant": (0.22, 5.45e-9)}
"""Threshold and delay (s) of each laser, Nishiyama et al., appendix "Time delay of transmitted pulse"."""

_HOLDS = ("ok", "width_undetermined")
"""With a width below a sample, as behind 25 MHz at some places between samples, the centre holds."""
_STEP = 2
"""Of the 32 arrivals in a sample, every second one is fitted: 16."""
_FEWEST = 4
_FALLS = np.geomspace(0.1, 8.0, 16)
"""Factors on the time scale of the fall among which the published delays are looked for."""


@dataclass(frozen=True, slots=True)
class CorrelationWindow:
    """What the range finder fits a Gaussian to.

    Parameters
    ----------
    sample_interval_s : float
        s.
    count : int
        Samples, the pulse in their middle.
    """

    sample_interval_s: float
    count: int

    @property
    def times_s(self) -> NDArray[np.float64]:
        """Times after the arrival at which a response is needed, s, in steps of a 32nd of a sample."""
        middle = self.count // 2
        steps = np.arange(-(middle + 1) * PHASES, (self.count - middle) * PHASES + 1)
        return np.asarray(steps * (self.sample_interval_s / PHASES), dtype=np.float64)

    def centre_s(self, response: NDArray[np.float64]) -> float | None:
        """Return the centre of the fitted Gaussian after the arrival, s; None where no Gaussian fits.

        Parameters
        ----------
        response : ndarray of float64, shape (m,)
            At `times_s`.
        """
        middle, found = self.count // 2, []
        for phase in range(0, PHASES, _STEP):
            samples = response[np.arange(self.count) * PHASES + PHASES - phase]
            fit = gaussian_fit(samples, self.sample_interval_s)
            if fit.status not in _HOLDS or fit.pulse is None:
                return None
            found.append(fit.pulse.arrival_s - (middle + phase / PHASES) * self.sample_interval_s)
        return float(np.mean(found))

    def peak_s(self, response: NDArray[np.float64]) -> float:
        """Return when a response is largest, s after the arrival, by a parabola through three points."""
        top = int(np.clip(response.argmax(), 1, response.size - 2))
        below, peak, after = response[top - 1 : top + 2]
        bend = below - 2 * peak + after
        part = 0.5 * (below - after) / bend if bend < 0 else 0.0
        return float(self.times_s[top] + part * self.sample_interval_s / PHASES)


def delays_s(
    window: CorrelationWindow, response: NDArray[np.float64], pulse: OpticalPulse, threshold: float
) -> dict[Definition, float] | None:
    """Return the delay in each definition, s; None where no Gaussian fits.

    Parameters
    ----------
    window : CorrelationWindow
        Of the range finder.
    response : ndarray of float64, shape (m,)
        Of the receiver to the pulse behind the fibre, at `CorrelationWindow.times_s`.
    pulse : OpticalPulse
        Before the fibre.
    threshold : float
        Of the cut.
    """
    centre_s = window.centre_s(response)
    if centre_s is None:
        return None
    return {
        "centre_minus_peak": centre_s,
        "centre_minus_cut_centroid": centre_s - pulse.centroid_s(threshold),
        "centre_minus_full_centroid": centre_s - pulse.centroid_s(),
        "filtered_peak_minus_peak": window.peak_s(response),
    }


def references_s(receiver: KnownReceiver) -> dict[Reference, float]:
    """Return what may have been taken off a published delay, s: nothing, group delay at 0 Hz, a sample."""
    low_pass = sorted(receiver.poles, key=abs)[receiver.zeros :]
    group_s = sum((-1 / pole).real for pole in low_pass)
    return {"none": 0.0, "dc_group_delay": group_s, "sample_interval": receiver.sample_interval_s}


@lru_cache(maxsize=8)
def needed_falls(
    window: CorrelationWindow, pulse: KnownPulse, receiver: KnownReceiver
) -> dict[str, dict[Definition, dict[Reference, float | None]]]:
    """Return by how much longer the fall of the pulse would have to be for the published delays.

    Returns
    -------
    dict
        For each laser, definition and reference the factor on the time scale of the fall, from 0.1 to 8, that
        gives the published delay at the published threshold; None where none does.
    """
    taken_s = references_s(receiver)
    found: dict[str, dict[Definition, dict[Reference, float | None]]] = {}
    for laser, (threshold, published_s) in PUBLISHED.items():
        rows = [_delays_at(window, pulse, receiver, float(fall), threshold) for fall in _FALLS]
        found[laser] = {
            one: {
                reference: _crossing(rows, lambda row, one=one: row[one], published_s + taken_s[reference])  # type: ignore[misc]
                for reference in REFERENCES
            }
            for one in DEFINITIONS
        }
    return found


def _delays_at(
    window: CorrelationWindow, pulse: KnownPulse, receiver: KnownReceiver, fall: float, threshold: float
) -> dict[Definition, float] | None:
    made = pulse.pulse(fall=fall)
    responses = CutResponses(made, receiver.poles, receiver.zeros, window.times_s)
    return delays_s(window, responses.exact(threshold), made, threshold)


def _crossing(
    rows: list[dict[Definition, float] | None],
    of: Callable[[dict[Definition, float]], float],
    wanted_s: float,
) -> float | None:
    """Factor at which a delay meets the wanted one: of a cubic spline in the factor's logarithm."""
    from scipy.interpolate import CubicSpline

    known = [(np.log(fall), of(row)) for fall, row in zip(_FALLS, rows, strict=True) if row]
    if len(known) < _FEWEST:
        return None
    factors, late_s = np.transpose(known)
    roots = CubicSpline(factors, late_s / wanted_s).solve(1.0, extrapolate=False)
    return float(np.exp(roots[0])) if roots.size else None
