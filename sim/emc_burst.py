"""Interference of the laser's drivers: a damped sine that couples into the receiver's input with each shot.

The drivers of Q-switch and pump diodes coupled into the photodiode of BELA's receiver, and laser firing
raised its noise in tests before launch (Kallenbach et al. 2016; Nishiyama et al., section on noise). No shape
is published; a ringing that begins with a jump of its slope and dies away is assumed::

    u(t) = amplitude exp(-(t - delay) / decay) sin(2 pi f (t - delay)),  t > delay

at the cut, before the receiver's filter, timed from the receiver's shot pulse, which fires the laser. It is
what the poles ``-1 / decay +- 2 pi i f`` make of an impulse, so that filter and burst together are a sum of
modes.

What this does not model: bursts whose size or time changes from shot to shot; coupling behind the filter;
corrupted packets; more than one burst.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import ConfigError
from belahil.pole_modes import modes, ordered_poles

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.config import EmcBurst


@dataclass(frozen=True)
class FilteredBurst:
    """A burst behind the receiver's filter.

    Parameters
    ----------
    truth : EmcBurst
        Amplitude, frequency, decay and delay.
    poles : tuple of complex
        Of the receiver's filter, rad/s.
    zeros : int
        Of it, at s = 0.

    Raises
    ------
    ConfigError
        A burst slower than the receiver's high-pass.
    """

    truth: EmcBurst
    poles: tuple[complex, ...]
    zeros: int

    def __post_init__(self) -> None:
        own = complex(-1 / self.truth.decay_s, 2 * math.pi * self.truth.frequency_hz)
        if self.zeros and abs(own) <= min(map(abs, self.poles)):
            raise ConfigError(
                f"[emulation.receiver] emc_burst of {self.truth.frequency_hz:g} Hz: must be above highpass_hz"
            )
        together = ordered_poles((own, own.conjugate(), *self.poles), self.zeros)
        size = self.truth.amplitude_v * own.imag / abs(own) ** 2
        object.__setattr__(self, "_modes", tuple((p, size * w) for p, w in modes(together, self.zeros)))

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return input-referred volts behind the filter.

        Parameters
        ----------
        times_s : ndarray of float64, shape (n,)
            From the shot pulse, s, rising.
        """
        volts = np.zeros(times_s.shape)
        first = int(np.searchsorted(times_s, self.truth.delay_s))
        since = times_s[first:] - self.truth.delay_s
        with np.errstate(under="ignore"):
            for pole, weight in self._modes:  # type: ignore[attr-defined]
                volts[first:] += (weight * np.exp(pole * since)).real
        return volts
