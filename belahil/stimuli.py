"""What can be played at the cut, in volts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.errors import RefusedInput

if TYPE_CHECKING:
    from numpy.typing import NDArray

Interpolation = Literal["linear", "hold"]


@dataclass(frozen=True, slots=True)
class NoSignal:
    """0 V DC with the output on: the receiver sees the generator's source resistance."""


@dataclass(frozen=True, slots=True)
class Sine:
    """A free-running sine ``offset_v + amplitude_vpp / 2 * sin(2 pi f t + phase)``; the phase is unknown.

    Parameters
    ----------
    frequency_hz : float
        Above zero.
    amplitude_vpp : float
        Peak to peak, V.
    offset_v : float
        Mean voltage, V.

    Raises
    ------
    RefusedInput
        When the frequency or the amplitude is not a positive, finite number, or the offset is not finite.
    """

    frequency_hz: float
    amplitude_vpp: float
    offset_v: float = 0.0

    def __post_init__(self) -> None:
        if not (0 < self.frequency_hz < np.inf and 0 < self.amplitude_vpp < np.inf):
            raise RefusedInput(
                f"a sine of {self.frequency_hz!r} Hz and {self.amplitude_vpp!r} Vpp: "
                "both must be positive and finite"
            )
        if not np.isfinite(self.offset_v):
            raise RefusedInput(f"a sine with an offset of {self.offset_v!r} V: must be finite")


@dataclass(frozen=True, slots=True, eq=False)
class SampledPulse:
    """A waveform given by samples, zero before the first and after the last interval.

    Parameters
    ----------
    volts : ndarray of float64, shape (n,)
        Break points, V; at least two.
    sample_rate_hz : float
        Break points per second.
    start_s : float
        Time of the first break point after the trigger, s.
    interpolation : {"linear", "hold"}
        Between break points: straight lines, or steps held for one interval. With "hold" the last value
        lasts one interval too; with "linear" the waveform jumps to zero after the last point.
    poles : tuple of complex
        Poles (rad/s) of a unit-gain all-pole filter that the waveform has passed already.
    """

    volts: NDArray[np.float64]
    sample_rate_hz: float
    start_s: float = 0.0
    interpolation: Interpolation = "linear"
    poles: tuple[complex, ...] = ()

    def __post_init__(self) -> None:
        volts = np.array(self.volts, dtype=np.float64)
        if volts.ndim != 1 or volts.size < 2 or not np.all(np.isfinite(volts)):
            raise RefusedInput(
                f"a sampled pulse of shape {volts.shape}: needs at least two finite volts in one row"
            )
        if not 0 < self.sample_rate_hz < np.inf:
            raise RefusedInput(
                f"a sampled pulse at {self.sample_rate_hz!r} samples per second: must be positive"
            )
        if not np.isfinite(self.start_s):
            raise RefusedInput(f"a sampled pulse that starts at {self.start_s!r} s: must be finite")
        volts.setflags(write=False)
        object.__setattr__(self, "volts", volts)

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Voltage at any times.

        Parameters
        ----------
        times_s : ndarray of float64, shape (m,)
            Times after the trigger, s.

        Returns
        -------
        ndarray of float64, shape (m,)
            V.
        """
        times = np.asarray(times_s, dtype=np.float64)
        if self.poles:
            from belahil.pole_response import response

            return response(
                self.volts, self.sample_rate_hz, self.start_s, self.interpolation, self.poles, times
            )
        place = (times - self.start_s) * self.sample_rate_hz
        last = self.volts.size - 1
        if self.interpolation == "linear":
            inside = (place >= 0) & (place <= last)
            volts: NDArray[np.float64] = np.interp(place, np.arange(last + 1), self.volts)
            return np.where(inside, volts, 0.0)
        index = np.floor(place).astype(np.int64)
        inside = (index >= 0) & (index <= last)
        return np.where(inside, self.volts[np.clip(index, 0, last)], 0.0)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, SampledPulse):
            return NotImplemented
        return np.array_equal(self.volts, other.volts) and self._words() == other._words()

    def __hash__(self) -> int:
        return hash((self.volts.tobytes(), self._words()))

    def _words(self) -> tuple[object, ...]:
        return self.sample_rate_hz, self.start_s, self.interpolation, self.poles


@dataclass(frozen=True, slots=True)
class TransmittedPulse:
    """The generator is silent; the laser's own pulse reaches the receiver through its fibre."""


Stimulus = NoSignal | Sine | SampledPulse | TransmittedPulse


def scaled(stimulus: Stimulus, factor: float) -> Stimulus:
    """Multiply every voltage of a stimulus, for example from the cut to the generator's setting.

    Parameters
    ----------
    stimulus : Stimulus
        Left unchanged.
    factor : float
        Dimensionless, positive.
    """
    if isinstance(stimulus, Sine):
        return replace(
            stimulus, amplitude_vpp=stimulus.amplitude_vpp * factor, offset_v=stimulus.offset_v * factor
        )
    if isinstance(stimulus, SampledPulse):
        return replace(stimulus, volts=stimulus.volts * factor)
    return stimulus


def largest_volts(stimulus: Stimulus) -> float:
    """Largest magnitude of the voltage, offset included, V."""
    if isinstance(stimulus, Sine):
        return abs(stimulus.offset_v) + stimulus.amplitude_vpp / 2
    if isinstance(stimulus, SampledPulse):
        return float(np.max(np.abs(stimulus.volts)))
    return 0.0
