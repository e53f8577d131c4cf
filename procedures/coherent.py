"""Sine frequencies that a window samples coherently and that interleaved converters cannot confuse.

A window of N samples holds J whole cycles of the frequency J f_s / N. With J odd and coprime with N every
sample meets another phase (IEEE Std 1057-2017). Two interleaved converters add an image at f_s / 2 - f and a
line at f_s / 2; a good frequency keeps away from both, and from its low harmonics and their images.
"""

from __future__ import annotations

import math

import numpy as np

from belahil.errors import RefusedInput
from belahil.uncertainty import sized

DISTANCE_BINS = 3
"""Least distance, in bins of f_s / N, from every multiple of f_s / 4 and from low harmonics and images."""


def alias_hz(frequency_hz: float, sample_rate_hz: float) -> float:
    """Return where a frequency appears between 0 and half the sample rate, Hz.

    Examples
    --------
    >>> alias_hz(50e6, 80e6), alias_hz(90e6, 80e6), alias_hz(10e6, 80e6)
    (30000000.0, 10000000.0, 10000000.0)
    """
    return abs(frequency_hz - round(frequency_hz / sample_rate_hz) * sample_rate_hz)


def coherent_frequency(wanted_hz: float, sample_rate_hz: float, sample_count: int) -> float:
    """Return the good coherent frequency nearest to a wanted one.

    Parameters
    ----------
    wanted_hz : float
        Hz, positive; may lie above half the sample rate.
    sample_rate_hz : float
        Of all interleaved converters together, Hz.
    sample_count : int
        Samples in a window.

    Raises
    ------
    RefusedInput
        Fewer than 64 samples: nearly every frequency is too close to another's image.

    Examples
    --------
    >>> round(coherent_frequency(10e6, 80e6, 16064) / 1e6, 6)
    9.99502
    """
    return _nearest(wanted_hz, sample_rate_hz, sample_count, math.inf, set()) * sample_rate_hz / sample_count


def default_frequencies(
    sample_rate_hz: float, sample_count: int, max_sine_hz: float, count: int = 24
) -> tuple[float, ...]:
    """Return a grid of coherent frequencies for a gain sweep.

    A third of the grid is spaced geometrically from f_s / 800 to f_s / 20, where an AC coupling shows, and
    the rest evenly from there to 0.475 f_s or the generator's limit, where the low-pass shows. When the
    generator reaches 0.725 f_s, a sixth of the grid lies between 0.525 f_s and there and is seen through its
    alias. At 80 MHz these are 0.1, 4, 38, 58 and 42 MHz.

    Parameters
    ----------
    sample_rate_hz, sample_count
        As in `coherent_frequency`.
    max_sine_hz : float
        The generator's limit, Hz.
    count : int
        Number of frequencies, at least 3.

    Returns
    -------
    tuple of float
        Hz, rising, all different.

    Raises
    ------
    RefusedInput
        A limit below f_s / 800, fewer than 3 frequencies, or a window too short for so many.
    """
    lowest = sample_rate_hz / 800
    if count < 3 or max_sine_hz <= lowest:
        raise RefusedInput(
            f"{count} frequencies up to {sized(max_sine_hz, 'Hz')}: at least 3, "
            f"and a generator above {sized(lowest, 'Hz')}"
        )
    beyond = count // 6 if max_sine_hz >= 0.725 * sample_rate_hz else 0
    top = min(0.475 * sample_rate_hz, max_sine_hz)
    low = count // 3
    knee = min(sample_rate_hz / 20, top / 2)
    wanted = [
        *np.geomspace(lowest, knee, low),
        *np.linspace(knee, top, count - low - beyond + 1)[1:],
        *np.linspace(0.525 * sample_rate_hz, 0.725 * sample_rate_hz, beyond),
    ]
    taken: set[int] = set()
    for one in wanted:
        taken.add(_nearest(float(one), sample_rate_hz, sample_count, max_sine_hz, taken))
    return tuple(cycles * sample_rate_hz / sample_count for cycles in sorted(taken))


def _nearest(
    wanted_hz: float, sample_rate_hz: float, sample_count: int, max_hz: float, taken: set[int]
) -> int:
    wish = wanted_hz * sample_count / sample_rate_hz
    most = math.floor(min(max_hz * sample_count / sample_rate_hz, wish + sample_count))
    for cycles in sorted(range(1, most + 1, 2), key=lambda one: abs(one - wish)):
        if cycles not in taken and _is_good(cycles, sample_count):
            return cycles
    raise RefusedInput(
        f"no coherent frequency near {sized(wanted_hz, 'Hz')}: "
        f"{sample_count} samples at {sized(sample_rate_hz, 'Hz')} are too few"
    )


def _is_good(cycles: int, sample_count: int) -> bool:
    if math.gcd(cycles, sample_count) != 1:
        return False
    half = sample_count / 2
    own = _folded(cycles, sample_count)
    # The offset and its image, the image of the sine, harmonics 2 and 3 and their images.
    others = [0.0, half, half - own]
    for harmonic in (2, 3):
        line = _folded(harmonic * cycles, sample_count)
        others += [line, half - line]
    return all(abs(own - other) > DISTANCE_BINS for other in others)


def _folded(cycles: int, sample_count: int) -> float:
    rest = cycles % sample_count
    return float(min(rest, sample_count - rest))
