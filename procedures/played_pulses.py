"""The pulses of a played waveform: where they are, how wide and how high, whatever the generator's grid.

Width and height are those of a Gaussian of the same moments. The highest point of a pulse says less: on a
grid of 4 ns that of an 8 ns pulse is up to a sixth too low.

Not modelled: pulses nearer to each other than 200 ns, which count as one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from belahil.pulse_fit import CURVATURE
from belahil.stimuli import SampledPulse

GAUSSIAN_AREA = math.sqrt(2 * math.pi / CURVATURE)
"""Area of a Gaussian of unit height and unit full width: sqrt(pi) / (2 sqrt(ln 2)) = 1.06447."""

_FAINT = 1e-3
"""Of the peak: what is less does not belong to a pulse."""
_APART_S = 200e-9
"""Of silence between two pulses, at least."""


@dataclass(frozen=True, slots=True)
class PlayedPulse:
    """One pulse of a played waveform.

    Parameters
    ----------
    centre_s : float
        Centroid, s after the trigger.
    width_s, peak_v : float
        Full width, s, and height at the cut, V, of the Gaussian with the same area and variance. Of a
        waveform without a positive variance: of the same area and largest point.
    area_v_s : float
        V s.
    waveform : SampledPulse
        It alone.
    """

    centre_s: float
    width_s: float
    peak_v: float
    area_v_s: float
    waveform: SampledPulse


def played_pulses(waveform: SampledPulse) -> tuple[PlayedPulse, ...]:
    """Take a waveform apart where it is silent for 200 ns or more; a part without area is left out."""
    volts = waveform.volts
    loud = np.flatnonzero(np.abs(volts) > _FAINT * np.abs(volts).max())
    if not loud.size:
        return ()
    gaps = np.flatnonzero(np.diff(loud) > _APART_S * waveform.sample_rate_hz)
    middles = [(loud[gap] + loud[gap + 1]) // 2 for gap in gaps]
    edges = [0, *middles, volts.size]
    found = (_one_pulse(waveform, int(begin), int(end)) for begin, end in pairwise(edges))
    return tuple(one for one in found if one is not None)


def _one_pulse(waveform: SampledPulse, begin: int, end: int) -> PlayedPulse | None:
    step_s = 1 / waveform.sample_rate_hz
    there = begin + np.flatnonzero(waveform.volts[begin:end])
    begin, end = max(0, int(there[0]) - 1), min(waveform.volts.size, int(there[-1]) + 2)
    volts = waveform.volts[begin:end]
    sum_v = float(volts.sum())
    if abs(sum_v) < 1e-9 * float(np.abs(volts).sum()):
        return None
    # Of straight lines that begin and end at zero, area and centroid are those of the points; of steps the
    # centroid is half a step later.
    places = np.arange(volts.size, dtype=np.float64)
    centre = float(volts @ places) / sum_v
    variance = float(volts @ (places - centre) ** 2) / sum_v
    late = 0.5 if waveform.interpolation == "hold" else 0.0
    area_v_s = sum_v * step_s
    if variance > 0:
        width_s = math.sqrt(CURVATURE * variance) * step_s
    else:
        width_s = area_v_s / float(volts[np.argmax(np.abs(volts))]) / GAUSSIAN_AREA
    alone = SampledPulse(
        np.pad(volts, (0, max(0, 2 - volts.size))),
        waveform.sample_rate_hz,
        waveform.start_s + begin * step_s,
        waveform.interpolation,
        waveform.poles,
    )
    centre_s = waveform.start_s + (begin + centre + late) * step_s
    return PlayedPulse(centre_s, width_s, area_v_s / width_s / GAUSSIAN_AREA, area_v_s, alone)
