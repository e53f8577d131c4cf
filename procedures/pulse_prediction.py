"""What a known receiver makes of a pulse: volts at the converter, and how they move with what is uncertain.

The pulse passes the generator's declared pole and the receiver's filter in closed form, the gain, and the
two converters with their differences in gain and time. Offsets are measured in silent windows and added by
who compares.

Not modelled: a gain that depends on the amplitude; a bandwidth that depends on the gain code.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from belahil import butterworth
from belahil.pole_response import response

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from belahil.config import BenchConfig
    from belahil.stimuli import SampledPulse
    from belahil.values import Estimate
    from procedures.known_receiver import KnownReceiver

_PART = 0.01
"""Part of a standard uncertainty by which a number is moved to see what the prediction does."""


@dataclass(frozen=True, slots=True)
class Path:
    """Numbers of the way from the generator's waveform to the counts.

    Parameters
    ----------
    gain : float
        From the cut to the converter, V/V.
    order : int
        Of the Butterworth low-pass.
    cutoff_hz, highpass_hz : float
        Corners; 0 for no high-pass.
    output : float
        The generator's true bandwidth over the declared one.
    interleave_gain, interleave_skew_s : float
        Even minus odd samples: relative, and in s.
    interval_s : float
        True time between samples.
    """

    gain: float
    order: int
    cutoff_hz: float
    highpass_hz: float = 0.0
    output: float = 1.0
    interleave_gain: float = 0.0
    interleave_skew_s: float = 0.0
    interval_s: float = 12.5e-9

    def volts(
        self, played: SampledPulse, first_s: NDArray[np.float64], sample_count: int
    ) -> NDArray[np.float64]:
        """Return volts at the converter.

        Parameters
        ----------
        played : SampledPulse
            V at the cut; its poles are those of the generator's output.
        first_s : ndarray of float64, shape (m,)
            Time of each window's sample 0, on the time axis of the pulse, s.
        sample_count : int
            n.

        Returns
        -------
        ndarray of float64, shape (m, n)
            Without the converters' offsets.
        """
        sign = np.where(np.arange(sample_count) % 2, -0.5, 0.5)
        since_s = np.arange(sample_count) * self.interval_s + sign * self.interleave_skew_s
        volts = response(
            played.volts,
            played.sample_rate_hz,
            played.start_s,
            played.interpolation,
            tuple(pole * self.output for pole in played.poles)
            + butterworth.poles(self.cutoff_hz, self.order, self.highpass_hz),
            np.add.outer(first_s, since_s).reshape(-1),
            zeros=1 if self.highpass_hz else 0,
        ).reshape(first_s.size, sample_count)
        volts *= self.gain * (1 + sign * self.interleave_gain)
        return volts

    def derivatives(
        self,
        played: SampledPulse,
        first_s: NDArray[np.float64],
        sample_count: int,
        uncertain: Mapping[str, float],
    ) -> NDArray[np.float64]:
        """Return how the volts move when each uncertain number moves by its standard uncertainty.

        Parameters
        ----------
        played, first_s, sample_count
            As in `volts`.
        uncertain : mapping of str to float
            Standard uncertainty by field of this class, p of them.

        Returns
        -------
        ndarray of float64, shape (p, m, n)
            V, by central differences.
        """
        found = np.empty((len(uncertain), first_s.size, sample_count))
        for row, (name, sigma) in enumerate(uncertain.items()):
            value = getattr(self, name)
            more = replace(self, **{name: value + _PART * sigma})
            less = replace(self, **{name: value - _PART * sigma})
            difference = more.volts(played, first_s, sample_count) - less.volts(played, first_s, sample_count)
            found[row] = difference / (2 * _PART)
        return found


def known_path(receiver: KnownReceiver, code: int | None) -> Path:
    """Return the numbers of a receiver at a gain code; what nobody measured is taken for absent."""
    return Path(
        gain=receiver.at(code).gain.value,
        order=receiver.order,
        cutoff_hz=receiver.cutoff.value,
        highpass_hz=receiver.highpass_hz,
        interleave_gain=_value(receiver.interleave_gain),
        interleave_skew_s=_value(receiver.interleave_skew),
        interval_s=receiver.true_interval_s,
    )


def uncertain_numbers(
    receiver: KnownReceiver, code: int | None, config: BenchConfig, setting_vpp: float
) -> dict[str, float]:
    """Return the standard uncertainties of the fields of `known_path`, those above zero.

    Parameters
    ----------
    receiver : KnownReceiver
        What is known of it.
    code : int or None
        Gain code.
    config : BenchConfig
        Declared uncertainties of the generator and the attenuator: they act like one of the gain.
    setting_vpp : float
        Amplitude of the generator's setting, V; 0 where it is not known, and ``amplitude_v`` with it.
    """
    gain, declared = receiver.at(code).gain, config.generator.uncertainty
    played = math.hypot(
        declared.amplitude_relative,
        declared.amplitude_v / setting_vpp if setting_vpp else 0.0,
        declared.attenuation_db * math.log(10) / 20,
    )
    found = {
        "gain": math.hypot(gain.standard_uncertainty, gain.value * played),
        "cutoff_hz": receiver.cutoff.standard_uncertainty,
        "highpass_hz": _uncertainty(receiver.highpass),
        "output": declared.bandwidth_relative if math.isfinite(config.generator.bandwidth_hz) else 0.0,
        "interleave_gain": _uncertainty(receiver.interleave_gain),
        "interleave_skew_s": _uncertainty(receiver.interleave_skew),
    }
    return {name: sigma for name, sigma in found.items() if sigma > 0}


def _value(estimate: Estimate | None) -> float:
    return 0.0 if estimate is None else estimate.value


def _uncertainty(estimate: Estimate | None) -> float:
    return 0.0 if estimate is None else estimate.standard_uncertainty
