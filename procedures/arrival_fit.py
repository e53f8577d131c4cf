"""From a window with a comb of pulses to the delay and the width of its test pulses.

Every pulse is fitted with a Gaussian in the samples round it, as a range finder does. Before the first pulse
the window is silent: the mean of each converter there is taken off.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput
from belahil.pole_response import response
from belahil.pulse_fit import gaussian_fit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from belahil.stimuli import SampledPulse
    from procedures.arrival_comb import PlayedComb

FIT_SPAN_S = 525e-9
"""Samples of so much time go into a fit: 42 at 80 MHz, a correlation window of BELA (paper)."""

HEAD_S = 300e-9
"""Silence before the samples of the first fit, from which the baseline is taken."""

_EXPLAINED = 0.25

_PHASES = 2
"""Triggers between two samples; the comb itself takes the places between them."""


@dataclass(frozen=True, slots=True)
class CombReading:
    """What one window tells.

    Parameters
    ----------
    status : str
        ``ok``, or what kept a pulse of the comb from being fitted; then the numbers are 0.
    delay_s : float
        How much later the test pulses arrive than the references, less what was played, mean, s.
    width_s : float
        Mean detected full width at half maximum of the test pulses, s.
    reference_s : float
        Mean arrival of both references from the first sample, s by the receiver's clock.
    clock : float
        Time between the references by the receiver's samples over that of the generator, less 1.
    tests_s : ndarray of float64, shape (tests,)
        As `delay_s`, of each test pulse.
    """

    status: str
    delay_s: float = 0.0
    width_s: float = 0.0
    reference_s: float = 0.0
    clock: float = 0.0
    tests_s: tuple[float, ...] = ()


def window_shape(comb_s: float, sample_interval_s: float) -> tuple[float, int]:
    """Return how long before the first centre a window begins, s, and how many samples it has.

    Parameters
    ----------
    comb_s : float
        From the first centre to the last, s.
    sample_interval_s : float
        s.
    """
    lead_s = HEAD_S + FIT_SPAN_S / 2
    return lead_s, math.ceil((comb_s + 2 * lead_s) / sample_interval_s)


def read_comb(
    volts: NDArray[np.float64],
    sample_interval_s: float,
    comb: PlayedComb,
    first_place_s: float,
    converters: int = 1,
) -> CombReading:
    """Fit the pulses of a comb.

    Parameters
    ----------
    volts : ndarray of float64, shape (n,)
        A window at the converter, V.
    sample_interval_s : float
        s.
    comb : PlayedComb
        What was played.
    first_place_s : float
        About where the first pulse arrives, s from the first sample; to 50 ns.
    converters : int
        That take turns.
    """
    step, size = converters, round(FIT_SPAN_S / sample_interval_s)
    places = np.rint((first_place_s + comb.centres_s - comb.centres_s[0]) / sample_interval_s).astype(int)
    begins = places - size // 2
    if begins[0] < 2 * step or begins[-1] + size > volts.size:
        return CombReading("too_few_samples")
    head = begins[0] // step * step
    level = volts.astype(np.float64)
    for one in range(step):
        level[one::step] -= volts[one:head:step].mean()
    arrivals_s, widths_s = np.empty(places.size), np.empty(places.size)
    for k, begin in enumerate(begins):
        fit = gaussian_fit(level[begin : begin + size], sample_interval_s)
        if fit.status != "ok" or fit.pulse is None:
            return CombReading(fit.status)
        arrivals_s[k] = begin * sample_interval_s + fit.pulse.arrival_s
        widths_s[k] = fit.pulse.fwhm_s
    played_s = comb.centres_s[-1] - comb.centres_s[0]
    scale = played_s / (arrivals_s[-1] - arrivals_s[0])
    since_s = scale * (arrivals_s[1:-1] - arrivals_s[0]) - (comb.centres_s[1:-1] - comb.centres_s[0])
    return CombReading(
        "ok",
        float(since_s.mean()),
        float(scale * widths_s[1:-1].mean()),
        float(arrivals_s[0] + arrivals_s[-1]) / 2,
        1 / scale - 1,
        tuple(since_s.tolist()),
    )


def aligned(
    volts: NDArray[np.float64],
    sample_interval_s: float,
    played: SampledPulse,
    comb: PlayedComb,
    poles: Sequence[complex],
    zeros: int,
) -> float | None:
    """Find a comb in a window.

    Parameters
    ----------
    volts, sample_interval_s
        As in `read_comb`.
    played, comb, poles, zeros
        As in `expected_comb`.

    Returns
    -------
    float or None
        Where the first pulse arrives, s from the first sample, to a sample. None where the comb explains less
        than a quarter of the energy of the samples that it would lie on.
    """
    lasts_s = float(comb.centres_s[-1] - comb.centres_s[0])
    count = math.ceil((lasts_s + FIT_SPAN_S) / sample_interval_s)
    if count > volts.size:
        return None
    first_s = comb.centres_s[0] - FIT_SPAN_S / 2
    expected = _behind(played, poles, zeros, first_s + sample_interval_s * np.arange(count))
    along = np.correlate(volts, expected, "valid")
    lag = int(np.argmax(along))
    part = volts[lag : lag + count]
    energy = float(part @ part) * float(expected @ expected)
    if not along[lag] > 0 or along[lag] ** 2 < _EXPLAINED * energy:
        return None
    late_s = sum((-1 / pole).real for pole in sorted(poles, key=abs)[zeros:])
    return lag * sample_interval_s + FIT_SPAN_S / 2 + late_s


def expected_comb(
    played: SampledPulse,
    comb: PlayedComb,
    poles: Sequence[complex],
    zeros: int,
    sample_interval_s: float,
) -> CombReading:
    """Return what a receiver with this filter and no noise would show of a comb, mean over triggers.

    Parameters
    ----------
    played : SampledPulse
        What the generator played.
    comb : PlayedComb
        From `played_comb`.
    poles, zeros
        Of the receiver, as in `belahil.pole_modes`.
    sample_interval_s : float
        s.

    Returns
    -------
    CombReading
        Its `reference_s` is the delay of the references.

    Raises
    ------
    RefusedInput
        A filter behind which a pulse of the comb has no fit.
    """
    lead_s, count = window_shape(float(comb.centres_s[-1] - comb.centres_s[0]), sample_interval_s)
    late_s = sum((-1 / pole).real for pole in sorted(poles, key=abs)[zeros:])
    found = []
    for phase in range(_PHASES):
        first_s = comb.centres_s[0] - lead_s + late_s + phase / _PHASES * sample_interval_s
        times_s = first_s + sample_interval_s * np.arange(count)
        volts = _behind(played, poles, zeros, times_s)
        one = read_comb(volts, sample_interval_s, comb, comb.centres_s[0] + late_s - first_s)
        if one.status != "ok":
            raise RefusedInput(f"a pulse of the comb behind the model's filter: the fit says {one.status}")
        found.append(replace(one, reference_s=one.reference_s + first_s - comb.middle_s))
    tests_s = np.mean([one.tests_s for one in found], axis=0)
    return CombReading(
        "ok",
        float(np.mean([one.delay_s for one in found])),
        float(np.mean([one.width_s for one in found])),
        float(np.mean([one.reference_s for one in found])),
        float(np.mean([one.clock for one in found])),
        tuple(tests_s.tolist()),
    )


def _behind(
    played: SampledPulse, poles: Sequence[complex], zeros: int, times_s: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return what was played behind the receiver's filter."""
    every = (*played.poles, *poles)
    rate_hz = played.sample_rate_hz
    return response(played.volts, rate_hz, played.start_s, played.interpolation, every, times_s, zeros)
