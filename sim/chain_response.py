"""What light meets behind the photodiode: amplifier and filter, the echo behind them, its noise there."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from msgspec import structs

from belahil.errors import ConfigError
from sim.chain_noise import (
    Filter,
    GaussianFilter,
    PoleFilter,
    ShotNoise,
    StationaryNoise,
    fewest_steps,
    steps_for,
)
from sim.detector import gaussian_filter_sigma_s, tia_poles
from sim.echo import echo
from sim.kernel import Kernel
from sim.light_noise import background_density
from sim.optical_echo import span_s

if TYPE_CHECKING:
    from collections.abc import Set

    from numpy.typing import NDArray

    from sim.chain import Chain
    from sim.converter import SampleGrid
    from sim.optical_echo import Lit
    from sim.pulse_shape import PulseShape
    from sim.receiver_model import ReceiverModel
    from sim.scene import Scene


def filtered(
    scene: Scene, receiver: ReceiverModel, pulse: PulseShape, gain: float, tolerance: float
) -> tuple[Filter, Kernel]:
    """Return what the pulse passes on its way to the converter, and what becomes of it.

    Parameters
    ----------
    scene : Scene
        Its detector, filter and electronics.
    receiver : ReceiverModel
        Of the scene.
    pulse : PulseShape
        Of the light.
    gain : float
        Volts before the filter by relative light.
    tolerance : float
        Of the kernel, see `sim.accuracy.Accuracy.kernel`.

    Raises
    ------
    ConfigError
        Poles beside a Gaussian filter, or an amplifier's pole at or below the receiver's high-pass.
    """
    if scene.filter == "gaussian":
        idle = {
            "[detector] tia_pole_hz": scene.detector.tia_pole_hz,
            "[electronics] highpass_hz": scene.truth.highpass_hz,
        }
        for key, value in idle.items():
            if value:
                raise ConfigError(
                    f'{key} = {value:g}: must be 0 with filter = "gaussian", which has no poles'
                )
        sigma_s = gaussian_filter_sigma_s(scene.detector.tia_bandwidth_hz)
        own = Kernel(pulse, gain=gain, tolerance=tolerance)
        return GaussianFilter(sigma_s), own.widened(sigma_s)
    if receiver.zeros and 0 < scene.detector.tia_pole_hz <= scene.truth.highpass_hz:
        raise ConfigError(
            f"[detector] tia_pole_hz = {scene.detector.tia_pole_hz:g}: must be above highpass_hz = "
            f"{scene.truth.highpass_hz:g} of the receiver"
        )
    poles = (*tia_poles(scene.detector), *receiver.poles)
    kernel = Kernel(pulse, poles, receiver.zeros, gain, tolerance)
    return PoleFilter(poles, receiver.zeros), kernel


def light_noises(chain: Chain, names: Set[str]) -> tuple[ShotNoise | StationaryNoise, ...]:
    """Return the noise of light and dark current that a chain's stages name, behind its filter."""
    scene, detector, interval_s = chain.scene, chain.scene.detector, chain.receiver.grid.interval_s
    found: list[ShotNoise | StationaryNoise] = []
    if "shot noise" in names:
        bins = round(interval_s / chain.plan.bin_s) if chain.plan.bin_s else 0
        fewest = fewest_steps(chain.light_kernel, chain.passed, interval_s)
        found.append(ShotNoise(detector, chain.passed, interval_s, steps_for(bins, fewest)))
    if "sunlight" in names:
        no_current = structs.replace(detector, surface_dark_a=0.0, bulk_dark_a=0.0)
        density = background_density(structs.replace(scene, detector=no_current))
        found.append(StationaryNoise("sunlight", density, chain.passed, interval_s))
    if "dark current" in names:
        density = background_density(structs.replace(scene, sun=None))
        found.append(StationaryNoise("dark_current", density, chain.passed, interval_s))
    return tuple(found)


def echo_volts(kernel: Kernel, lit: Lit, first_s: float, grid: SampleGrid, count: int) -> NDArray[np.float64]:
    """Return input-referred volts behind the filter, computed only where the echo has begun and not ended.

    Parameters
    ----------
    kernel : Kernel
        Of pulse and filter.
    lit : Lit
        The light of the shot.
    first_s : float
        First sample from the gate, s.
    grid : SampleGrid
        Interval and skew of the converters.
    count : int
        Samples.

    Returns
    -------
    ndarray of float64, shape (count,)
    """
    volts = np.zeros(count)
    begin_s, end_s = span_s(kernel, lit.delays)
    low = max(0, math.floor((begin_s - first_s) / grid.interval_s))
    high = min(count, math.ceil((end_s - first_s) / grid.interval_s) + 1)
    if high <= low:
        return volts
    if not grid.skew_s:
        place_s = first_s + low * grid.interval_s
        volts[low:high] = echo(kernel, lit.delays, place_s, grid.interval_s, high - low)
    else:
        for one in (low, low + 1):
            late_s = grid.skew_s / 2 if one % 2 == 0 else -grid.skew_s / 2
            place_s = first_s + one * grid.interval_s + late_s
            size = len(range(one, high, 2))
            volts[one:high:2] = echo(kernel, lit.delays, place_s, 2 * grid.interval_s, size)
    if lit.energy != 1:
        volts *= lit.energy
    return volts
