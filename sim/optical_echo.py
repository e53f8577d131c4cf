"""The light of one shot on the photodiode: how much, when it begins, and when it is over."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from sim.echo import echo
from sim.footprint import DelayHistogram, Delays, NoReturn

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim.kernel import Kernel

_FAINT = 1e-9
"""Of the peak of a pulse: what is left of its tail does not count as light that lasts."""


@dataclass(frozen=True, slots=True)
class Lit:
    """What one shot lights.

    Parameters
    ----------
    delays : Delays
        Of its light, from the gate.
    energy : float
        Of its pulse, relative to the laser's.
    """

    delays: Delays
    energy: float = 1.0


@dataclass(frozen=True, slots=True)
class OpticalEcho:
    """The light of one shot on the photodiode.

    Parameters
    ----------
    kernel : Kernel
        The pulse; its gain is the photons that a beam on white ground returns.
    lit : Lit
        Delays and energy of the shot.
    photon_energy_j : float
        Of one photon.
    """

    kernel: Kernel
    lit: Lit
    photon_energy_j: float

    @property
    def status(self) -> str:
        """Return "ok", or why no light comes back."""
        light = self.lit.delays
        return light.reason if isinstance(light, NoReturn) else "ok"

    @property
    def photons(self) -> float:
        """Mean number of photons."""
        return self.kernel.gain * self.lit.energy * self.lit.delays.total

    @property
    def energy_j(self) -> float:
        """Energy of the photons, J."""
        return self.photons * self.photon_energy_j

    @property
    def span_s(self) -> tuple[float, float]:
        """First and last time of the light, from the gate, s; (0, 0) where there is none."""
        return span_s(self.kernel, self.lit.delays)

    def photon_rate_hz(self, first_s: float, step_s: float, count: int) -> NDArray[np.float64]:
        """Return photons a second on equal steps of time, shape (count,); `first_s` is from the gate."""
        rate = echo(self.kernel, self.lit.delays, first_s, step_s, count) * self.lit.energy
        # The cubic deposit on bins undershoots by a trace; a rate cannot.
        return np.maximum(rate, 0.0)

    def power_w(self, first_s: float, step_s: float, count: int) -> NDArray[np.float64]:
        """Return optical power, W, at the times of `photon_rate_hz`."""
        return self.photon_rate_hz(first_s, step_s, count) * self.photon_energy_j


def span_s(kernel: Kernel, light: Delays) -> tuple[float, float]:
    """Return when a kernel's response to some light begins and ends, to 1e-9 of its peak, s."""
    if isinstance(light, NoReturn):
        return 0.0, 0.0
    first_s, last_s = lasting_s(kernel)
    if isinstance(light, DelayHistogram):
        return light.first_s + first_s, light.first_s + light.bin_s * (light.weights.size - 1) + last_s
    wide_s = 6.5 * light.std_s
    return light.mean_s - wide_s + first_s, light.mean_s + wide_s + last_s


@lru_cache(maxsize=32)
def lasting_s(kernel: Kernel) -> tuple[float, float]:
    """Return between which lags a kernel is above 1e-9 of its peak, s."""
    lags_s = np.linspace(kernel.starts_s, kernel.ends_s, 8192)
    level = np.abs(kernel.at(lags_s))
    above = np.flatnonzero(level > _FAINT * level.max())
    step_s = lags_s[1] - lags_s[0]
    return float(lags_s[above[0]] - step_s), float(lags_s[above[-1]] + step_s)
