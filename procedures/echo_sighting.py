"""Did a range finder see the echo, and when: a weak pulse behind a strong one that was played with it.

A receiver's clock is not that of the generator, so where a pulse lies between two samples is unknown and no
cable is known to a nanosecond. The strong pulse, the marker, tells both: the echo must come a known time
after it. Of that time the receiver's filter changes nothing, since it delays two pulses of one width alike.

Not modelled: that the marker takes one of the candidates, and its flanks may take another. Both happen in the
receiver and in the model alike, so a detection probability found here is one beside a strong pulse.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.pole_response import response

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from belahil.stimuli import SampledPulse
    from procedures.known_receiver import KnownReceiver
    from sim.rfm import RangeFinder

SEEN_AT = 0.02
"""Of the highest pulse of a stimulus: what is lower is not taken for a pulse."""
PHASES = 16
"""Places of a pulse between two samples over which its expected arrival is averaged."""
_ROUND_SAMPLES = 48
"""On either side of a pulse: so far its fit reaches when it is expected without noise."""

PulseStatus = Literal["ok", "no_pulse", "no_marker"]


@dataclass(frozen=True, slots=True)
class Expectation:
    """What a range finder should make of marker and echo, without noise.

    Parameters
    ----------
    marker_s : float
        Arrival of the marker on the time axis of the stimulus, s; behind the receiver's filter.
    marker_v, echo_v : float
        Heights at the converter, V.
    apart_s : float
        Arrival of the echo minus that of the marker, s.
    gate_s : float
        How far from there a candidate may be and still be the echo: half of the echo's full width, s.
    """

    marker_s: float
    marker_v: float
    echo_v: float
    apart_s: float
    gate_s: float


@dataclass(frozen=True, slots=True)
class Sighting:
    """What a window tells of the echo.

    Parameters
    ----------
    marker_s : float or None
        Arrival of the marker after the first sample, s; None where no candidate is as high.
    apart_s : float or None
        From the marker to the echo, s; None where the echo was not among the candidates.
    """

    marker_s: float | None
    apart_s: float | None


def pulse_places(stimulus: SampledPulse) -> tuple[PulseStatus, tuple[float, ...]]:
    """Find the pulses of a stimulus.

    Returns
    -------
    status : str
        ``no_pulse``: nothing above 0 V; ``no_marker``: a single pulse; else ``ok``.
    places : tuple of float
        Times of their tops, s after the trigger.
    """
    from scipy.signal import find_peaks

    volts = np.concatenate([[0.0], stimulus.volts, [0.0]])
    top = float(volts.max())
    if top <= 0:
        return "no_pulse", ()
    found, _ = find_peaks(volts, height=SEEN_AT * top, prominence=SEEN_AT * top)
    times = stimulus.start_s + (found - 1) / stimulus.sample_rate_hz
    return ("ok" if found.size > 1 else "no_marker"), tuple(times.tolist())


def expectation(
    stimulus: SampledPulse,
    places_s: tuple[float, ...],
    receiver: KnownReceiver,
    gain: float,
    finder: RangeFinder,
) -> Expectation:
    """Let the range finder look at each pulse without noise.

    Parameters
    ----------
    stimulus : SampledPulse
        As played, V at the cut.
    places_s : tuple of float
        Of its pulses, from `pulse_places`; at least two. The highest is the marker, the lowest the echo.
    receiver : KnownReceiver
        Its filter and clock.
    gain : float
        V/V, cut to converter.
    finder : RangeFinder
        Of the receiver.
    """
    rows = np.array([_one(stimulus, place_s, receiver, gain, finder) for place_s in places_s])
    marker, echo = rows[np.argmax(rows[:, 2])], rows[np.argmin(rows[:, 2])]
    return Expectation(
        marker_s=float(marker[0]),
        marker_v=float(marker[2]),
        echo_v=float(echo[2]),
        apart_s=float(echo[0] - marker[0]),
        gate_s=float(echo[1] / 2),
    )


def _one(
    stimulus: SampledPulse, place_s: float, receiver: KnownReceiver, gain: float, finder: RangeFinder
) -> NDArray[np.float64]:
    """Return arrival (time axis of the stimulus), width and height of one pulse, means over phases."""
    interval_s = receiver.true_interval_s
    steps = np.arange(2 * _ROUND_SAMPLES + 1) - _ROUND_SAMPLES
    rows = np.empty((PHASES, 3))
    for row, phase in zip(rows, (np.arange(PHASES) + 0.5) / PHASES, strict=True):
        first_s = place_s + (steps[0] + phase) * interval_s
        volts = gain * response(
            stimulus.volts,
            stimulus.sample_rate_hz,
            stimulus.start_s,
            stimulus.interpolation,
            stimulus.poles + receiver.poles,
            first_s + np.arange(steps.size) * interval_s,
            zeros=receiver.zeros,
        )
        arrival_s, fwhm_s, height_v, _ = finder.search(volts)[0]
        row[:] = first_s + arrival_s, fwhm_s, height_v
    return np.asarray(rows.mean(axis=0))


def sighting(candidates: Iterable[tuple[float, float]], expected: Expectation) -> Sighting:
    """Look for marker and echo among the candidates of a window.

    Parameters
    ----------
    candidates : iterable of (arrival_s, amplitude_v)
        Best first.
    expected : Expectation
        Of the stimulus that was played.
    """
    arrivals = []
    marker_s = None
    for arrival_s, amplitude_v in candidates:
        if marker_s is None and amplitude_v > expected.marker_v / 2:
            marker_s = arrival_s
        else:
            arrivals.append(arrival_s)
    if marker_s is None:
        return Sighting(None, None)
    apart = [one - marker_s for one in arrivals]
    nearest = min(apart, key=lambda one: abs(one - expected.apart_s), default=float("inf"))
    return Sighting(marker_s, nearest if abs(nearest - expected.apart_s) <= expected.gate_s else None)
