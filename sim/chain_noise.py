"""The noise of the light in a chain: drawn before the filter, or as the filter leaves it.

Shot noise of the echo is white with a variance that follows the photon rate, so it is drawn on fine steps
before the filter and only where there is light. Sunlight and dark current are stationary, so they are drawn
at the sample instants, as the filter leaves them.

What this does not model: the discreteness of photons (see `sim.light_noise`), and noise of sunlight that
follows the reflectance under the beam.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from belahil.errors import RefusedInput
from belahil.pole_modes import modes, ordered_poles
from belahil.pole_response import SampledNoise, autocovariance
from belahil.uncertainty import sized
from sim.light_noise import shot_noise_density, white_step_rms_v
from sim.reference import polyphase

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim.detector import Detector
    from sim.draws import Draws
    from sim.kernel import Kernel
    from sim.optical_echo import OpticalEcho

STEPS = 16
"""Draws in a sample interval, where nothing else decides. The spectrum behind the filter is exact for any
number of them; it decides how well the draws follow the photon rate."""

_FEWEST_STEPS, _MOST_STEPS, _REFUSED_STEPS = 8, 40, 4096

_ENDED = 1e-6
"""Of the largest value of a response: where it counts as over."""


class Filter(Protocol):
    """What stands between the cut and the samples, as far as noise sees it."""

    @property
    def starts_s(self) -> float:
        """When its response to an impulse begins, s."""
        ...

    @property
    def ends_s(self) -> float:
        """When it ends, s."""
        ...

    @property
    def bandwidth_hz(self) -> float:
        """Noise bandwidth, Hz."""
        ...

    def impulse(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Response to an impulse of unit area, 1/s, with the shape of `times_s`."""
        ...

    def noise(self, interval_s: float) -> UnitNoise:
        """Return a generator of stationary noise of unit rms behind it."""
        ...


class UnitNoise(Protocol):
    """Stationary noise of unit rms, sampled."""

    def draw(self, rng: np.random.Generator, sample_count: int) -> NDArray[np.float64]:
        """Return a stretch, shape (sample_count,)."""
        ...


@dataclass(frozen=True)
class PoleFilter:
    """A filter of poles (rad/s), and zeros at s = 0, as in `belahil.pole_response`."""

    poles: tuple[complex, ...]
    zeros: int = 0

    @property
    def starts_s(self) -> float:
        """0."""
        return 0.0

    @cached_property
    def ends_s(self) -> float:
        """Time after which the response stays below 1e-6 of its peak, s."""
        fastest = min(1 / abs(pole) for pole in self.poles)
        peak = np.abs(self.impulse(fastest * np.arange(64.0) / 4)).max()
        slow = [(weight, pole) for pole, weight in modes(ordered_poles(self.poles, self.zeros), self.zeros)]
        left = [
            math.log(max(abs(weight) * len(slow) / (_ENDED * peak), 1)) / -pole.real for weight, pole in slow
        ]
        return float(max(left))

    @cached_property
    def bandwidth_hz(self) -> float:
        """Integral of the squared magnitude, Hz."""
        return float(autocovariance(self.poles, 0.0, self.zeros))

    def impulse(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return h, 1/s, zero before 0."""
        total = np.zeros(times_s.shape)
        after = np.maximum(times_s, 0.0)
        with np.errstate(under="ignore"):
            for pole, weight in modes(ordered_poles(self.poles, self.zeros), self.zeros):
                total += (weight * np.exp(pole * after)).real
        return np.where(times_s >= 0, total, 0.0)

    def noise(self, interval_s: float) -> UnitNoise:
        """Return noise of unit rms behind it."""
        return SampledNoise(self.poles, self.zeros, interval_s)


@dataclass(frozen=True)
class GaussianFilter:
    """The low-pass of earlier models: a Gaussian of `sigma_s` about 0, of unit gain."""

    sigma_s: float

    @property
    def starts_s(self) -> float:
        """Where it is 1e-6 of its peak, s."""
        return -self.ends_s

    @property
    def ends_s(self) -> float:
        """Where it is 1e-6 of its peak, s."""
        return self.sigma_s * math.sqrt(-2 * math.log(_ENDED))

    @property
    def bandwidth_hz(self) -> float:
        """Integral of the squared magnitude, Hz."""
        return 1 / (4 * math.sqrt(math.pi) * self.sigma_s)

    def impulse(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return h, 1/s."""
        with np.errstate(under="ignore"):
            bell = np.exp(-0.5 * (times_s / self.sigma_s) ** 2)
        return np.asarray(bell / (self.sigma_s * math.sqrt(2 * math.pi)))

    def noise(self, interval_s: float) -> UnitNoise:
        """Return noise of unit rms behind it."""
        return GaussianNoise(self.sigma_s, interval_s)


class GaussianNoise:
    """White noise behind a Gaussian, sampled: a symmetric moving average whose spectrum is the sampled one.

    Parameters
    ----------
    sigma_s, interval_s : float
        Of the Gaussian; between samples, s.
    """

    def __init__(self, sigma_s: float, interval_s: float) -> None:
        # The autocovariance of the Gaussian is one of twice its variance.
        reach = math.ceil(12 * sigma_s / interval_s) + 8
        lags = np.minimum(np.arange(2 * reach), 2 * reach - np.arange(2 * reach)) * interval_s
        with np.errstate(under="ignore"):
            spectrum = np.fft.rfft(np.exp(-0.25 * (lags / sigma_s) ** 2)).real
        self._taps = np.fft.fftshift(np.fft.irfft(np.sqrt(np.maximum(spectrum, 0.0))))

    def draw(self, rng: np.random.Generator, sample_count: int) -> NDArray[np.float64]:
        """Return a stretch, shape (sample_count,)."""
        white = rng.standard_normal(sample_count + self._taps.size - 1)
        return np.convolve(white, self._taps, mode="valid")


def steps_for(bins: int, fewest: int = _FEWEST_STEPS) -> int:
    """Return how many draws a sample interval of so many time bins gets: draws on bins cost least."""
    dividing = [steps for steps in range(fewest, max(_MOST_STEPS, 2 * fewest) + 1) if bins % steps == 0]
    return min(dividing, key=lambda steps: abs(steps - STEPS), default=max(STEPS, fewest))


def fewest_steps(light: Kernel, passed: Filter, interval_s: float) -> int:
    """Return how many draws a sample interval needs, to follow a pulse of light and a filter's response.

    Parameters
    ----------
    light : Kernel
        The pulse, before any filter.
    passed : Filter
        Between cut and converter.
    interval_s : float
        Between samples, s.

    Raises
    ------
    RefusedInput
        More than 4096.

    Notes
    -----
    The variance is the trapezoid rule's of a product of pulse and squared response. Steps of 1.25 standard
    deviations of a Gaussian leave 1e-5 of it, steps of 0.1 of 1 / bandwidth 1e-4; where the response jumps,
    as that of one pole does, steps of 0.01 of it are needed for 3e-3.
    """
    jumps = abs(passed.impulse(np.zeros(1))[0]) > 1e-6 * passed.bandwidth_hz and passed.starts_s == 0
    longest_s = min(1.25 * light.finest_s, (0.01 if jumps else 0.1) / passed.bandwidth_hz)
    steps = math.ceil(interval_s / longest_s)
    if steps > _REFUSED_STEPS:
        raise RefusedInput(
            f"shot noise in steps of {sized(longest_s, 's', 3)}, as the pulse or the filter need it: {steps} "
            f"in a sample interval, at most {_REFUSED_STEPS} are allowed"
        )
    return max(_FEWEST_STEPS, steps)


@dataclass(frozen=True)
class ShotNoise:
    """Shot noise of the echo.

    Parameters
    ----------
    detector : Detector
        Its gain and excess noise.
    passed : Filter
        Between cut and converter.
    interval_s : float
        Between samples, s.
    steps : int
        Draws in a sample interval.
    """

    detector: Detector
    passed: Filter
    interval_s: float
    steps: int = STEPS

    @property
    def step_s(self) -> float:
        """Between draws, s."""
        return self.interval_s / self.steps

    def before_filter(
        self, light: OpticalEcho, first_s: float, draws: Draws
    ) -> tuple[int, NDArray[np.float64]]:
        """Draw it at the cut.

        Parameters
        ----------
        light : OpticalEcho
            Of this shot.
        first_s : float
            Any sample instant of this shot, from the gate; the draws lie at whole steps from it, so that
            windows of one shot share them.
        draws : Draws
            Of this shot: "shot_noise".

        Returns
        -------
        begin : int
            The first draw is at ``first_s + begin step_s``.
        volts : ndarray of float64, shape (n,)
            Independent, one a step; empty without light.
        """
        start_s, end_s = light.span_s
        if end_s <= start_s:
            return 0, np.zeros(0)
        begin = math.floor((start_s - first_s) / self.step_s)
        count = math.ceil((end_s - start_s) / self.step_s) + 1
        rate_hz = light.photon_rate_hz(first_s + begin * self.step_s, self.step_s, count)
        # A pulse shorter than the bins undershoots between them; cutting that off must not add light.
        counted = float(rate_hz.sum()) * self.step_s
        if counted:
            rate_hz *= light.photons / counted
        rms_v = white_step_rms_v(shot_noise_density(self.detector, rate_hz), self.step_s)
        return begin, rms_v * draws.stream("shot_noise").standard_normal(count)

    def add(self, volts: NDArray[np.float64], first_s: float, light: OpticalEcho, draws: Draws) -> None:
        """Add it to input-referred volts behind the filter, in place.

        Parameters
        ----------
        volts : ndarray of float64, shape (n,)
            Samples; the first is taken at `first_s` from the gate.
        first_s, light, draws
            As in `before_filter`.
        """
        begin, white = self.before_filter(light, first_s, draws)
        if not white.size:
            return
        first, taps = self.taps
        # Samples that light can reach; the others have none of this noise.
        low = max(0, math.floor((begin + first) / self.steps))
        high = min(volts.size, math.ceil((begin + white.size + first + taps.size) / self.steps) + 1)
        if high > low:
            offset = low * self.steps - begin - first
            volts[low:high] += polyphase(white, taps, offset, self.steps, high - low)

    @cached_property
    def taps(self) -> tuple[int, NDArray[np.float64]]:
        """First tap and taps: the filter's response at whole steps, times the step."""
        first = math.floor(self.passed.starts_s / self.step_s)
        last = math.ceil(self.passed.ends_s / self.step_s)
        taps = self.passed.impulse(np.arange(first, last + 1, dtype=np.float64) * self.step_s) * self.step_s
        if first == 0:
            # A filter of one pole jumps here; half of the square keeps the variance.
            taps[0] /= math.sqrt(2)
        return first, taps


@dataclass(frozen=True)
class StationaryNoise:
    """White noise at the cut, as the filter leaves it.

    Parameters
    ----------
    effect : str
        Keys its draws.
    density : float
        One-sided, V/sqrt(Hz) at the cut.
    passed : Filter
        Between cut and converter.
    interval_s : float
        Between samples, s.
    """

    effect: str
    density: float
    passed: Filter
    interval_s: float

    @property
    def rms_v(self) -> float:
        """Behind the filter, input-referred, V."""
        return self.density * math.sqrt(self.passed.bandwidth_hz)

    def add(self, volts: NDArray[np.float64], first_s: float, light: OpticalEcho, draws: Draws) -> None:
        """Add it to input-referred volts behind the filter, in place."""
        volts += self.rms_v * self._unit.draw(draws.stream(self.effect), volts.size)

    def before_filter(self, count: int, step_s: float, draws: Draws) -> NDArray[np.float64]:
        """Draw it at the cut on steps, V, shape (count,): another draw of the same noise than `add`."""
        rms_v = float(white_step_rms_v(np.array(self.density), step_s))
        return rms_v * draws.stream(f"{self.effect}_at_cut").standard_normal(count)

    @cached_property
    def _unit(self) -> UnitNoise:
        return self.passed.noise(self.interval_s)
