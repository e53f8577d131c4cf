"""The echo of a chain as a voltage at the cut, which a generator can play."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput
from belahil.stimuli import NoSignal, SampledPulse
from belahil.uncertainty import sized
from sim.chain_noise import StationaryNoise
from sim.constants import SPEED_OF_LIGHT_M_PER_S
from sim.detector import tia_poles, volts_per_photon_rate
from sim.draws import Draws
from sim.optical_echo import span_s

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim.chain import Chain
    from sim.kernel import Kernel

_START_STEP_S = 1e-9
"""Stimuli start at whole nanoseconds, the grid on which generators delay."""

_SETTLED = 20.0
"""Times that the response needs to change, by which noise begins before the first sample."""

_MOST_POINTS = 20_000_000

_COARSEST = 8
"""Break points in a sample interval, at least: shot noise is to fill the band of the receiver."""


def stimulus(chain: Chain, shot: int | None, sample_rate_hz: float | None) -> SampledPulse | NoSignal:
    """Return the voltage at the cut; see `sim.chain.Chain.stimulus`."""
    rate_hz = sample_rate_hz
    if rate_hz is not None and not 0 < rate_hz < math.inf:
        raise RefusedInput(f"a stimulus at {rate_hz!r} Hz: must be positive and finite")
    if rate_hz is None:
        enough_hz = break_points_hz(
            chain.kernel, chain.accuracy.tolerance, chain.receiver.spec.sample_rate_hz
        )
        if not chain.light_kernel.pulse.pieces:
            enough_hz = max(enough_hz, 1 / chain.light_bin_s)
        rate_hz = _on_bins(enough_hz, chain.light_bin_s)
    begin_s, end_s = _stretch_s(chain)
    count = math.ceil((end_s - begin_s) * rate_hz) + 1
    if count > _MOST_POINTS:
        raise RefusedInput(
            f"a stimulus of {count} points at {sized(rate_hz, 'Hz', 3)}: at most {_MOST_POINTS} are allowed"
        )
    volts = chain.echo(shot).photon_rate_hz(begin_s - chain.gate_s, 1 / rate_hz, count)
    volts *= volts_per_photon_rate(chain.scene.detector)
    if shot is not None and chain.light_noise:
        volts += _noise(chain, Draws(chain.scene.seed, shot), begin_s, count, rate_hz)
    if not volts.any():
        return NoSignal()
    return SampledPulse(volts, rate_hz, begin_s, "linear", tia_poles(chain.scene.detector))


@lru_cache(maxsize=16)
def break_points_hz(kernel: Kernel, tolerance: float, sample_rate_hz: float) -> float:
    """Return the rate at which straight lines keep a tolerance behind a filter.

    Parameters
    ----------
    kernel : Kernel
        Pulse and receiver: the sharpest echo, of level ground.
    tolerance : float
        Relative to the peak.
    sample_rate_hz : float
        Of the receiver; the result is at least eight times as much.

    Notes
    -----
    Lines between points add step^2 / 12 times the second derivative, where the filter sees no more of them
    than their mean.
    """
    step_s = kernel.finest_s / 64
    volts = kernel.at(kernel.starts_s + step_s * np.arange(4096.0))
    bend = float(np.abs(np.diff(volts, 2)).max() / step_s**2 / np.abs(volts).max())
    return max(_COARSEST * sample_rate_hz, math.sqrt(bend / (12 * tolerance)))


def _on_bins(rate_hz: float, bin_s: float) -> float:
    """The next higher rate whose step is a whole number of time bins, or divides one.

    The echo then costs a product for each bin and point, and no table of all their lags.
    """
    if not bin_s:
        return rate_hz
    bins = 1 / (rate_hz * bin_s)
    return 1 / (math.floor(bins) * bin_s) if bins >= 1 else math.ceil(1 / bins) / bin_s


def _noise(chain: Chain, draws: Draws, begin_s: float, count: int, rate_hz: float) -> NDArray[np.float64]:
    interval_s = chain.receiver.grid.interval_s
    volts, phase_s = np.zeros(count), draws.uniform("sampling_phase") * interval_s - chain.gate_s
    times_s = begin_s - chain.gate_s + np.arange(count) / rate_hz
    for noise in chain.light_noise:
        if isinstance(noise, StationaryNoise):
            volts += noise.before_filter(count, 1 / rate_hz, draws)
            continue
        begin, drawn = noise.before_filter(chain.optical(chain.lit(draws.shot, phase_s)), phase_s, draws)
        if drawn.size:
            places_s = phase_s + (begin + np.arange(drawn.size)) * noise.step_s
            volts += np.interp(times_s, places_s, drawn, left=0.0, right=0.0)
    return volts


def _stretch_s(chain: Chain) -> tuple[float, float]:
    """First and last time of a stimulus, s: all the light, and noise for the samples round the echo."""
    light_s = span_s(chain.light_kernel, chain.lit().delays)
    request = chain.correlation_window()
    moved_m = 6 * max(chain.scene.laser.jitter_rad) * chain.scene.altitude_m
    moved_s = 2 * moved_m * math.tan(chain.plan.slope_rad) / SPEED_OF_LIGHT_M_PER_S
    settled_s = request.delay_s - _SETTLED * chain.kernel.finest_s
    begin_s = min(light_s[0] + chain.gate_s - moved_s, settled_s)
    last_s = request.delay_s + (request.sample_count + 1) * chain.receiver.grid.interval_s
    end_s = max(light_s[1] + chain.gate_s + moved_s, last_s)
    return math.floor(begin_s / _START_STEP_S) * _START_STEP_S, end_s
