"""From the coefficients of a sine fit to amplitude, phase, offset and the mismatch of two converters."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from belahil.values import Estimate

if TYPE_CHECKING:
    from procedures.sine_design import Solution

# A phase difference that is less certain than this says nothing of the skew's effect on the amplitude.
_KNOWN_ANGLE = 0.3
_SMALLEST = 1e-150
_SINE_AND_IMAGE = np.ix_([0, 1, 4, 5], [0, 1, 4, 5])


@dataclass(frozen=True, slots=True)
class SineValues:
    """What the coefficients mean: as in `procedures.sine_fit.SineFit`, but the phase at the middle sample."""

    amplitude: Estimate
    phase: Estimate
    offset: Estimate
    gain_mismatch: Estimate | None = None
    skew: Estimate | None = None
    offset_difference: Estimate | None = None


def one_converter(found: Solution, omega: float) -> SineValues:
    """Read the coefficients of cos, sin, 1; `omega` (rad/s) is not needed."""
    cos, sin, one = found.values.tolist()
    covariance = found.covariance
    size = max(math.hypot(cos, sin), _SMALLEST)
    radial = np.array([cos, sin]) / size
    across = np.array([-sin, cos]) / size
    spread = covariance[:2, :2]
    return SineValues(
        amplitude=Estimate(size, math.sqrt(radial @ spread @ radial), "V"),
        phase=Estimate(math.atan2(-sin, cos), math.sqrt(across @ spread @ across) / size, "rad"),
        offset=Estimate(one, math.sqrt(covariance[2, 2]), "V"),
    )


def two_converters(found: Solution, omega: float) -> SineValues:
    """Read the coefficients of cos, sin, 1, (-1)^n, (-1)^n cos, (-1)^n sin.

    Parameters
    ----------
    found : Solution
        Of a design with two converters.
    omega : float
        True angular frequency, rad/s.
    """
    cos, sin, one, turn, turn_cos, turn_sin = found.values.tolist()
    both, image = complex(cos, -sin), complex(turn_cos, -turn_sin)
    even, odd = both + image, both - image
    even_size, odd_size = max(abs(even), _SMALLEST), max(abs(odd), _SMALLEST)
    angle = cmath.phase(even * odd.conjugate())
    middle = cmath.phase(odd) + angle / 2
    total = even_size + odd_size
    # Partial derivatives of (mean magnitude, gain mismatch, phase difference, mean phase) with respect to the
    # magnitude and angle of each converter's phasor; then those with respect to (cos, sin) of each.
    of_phasors = np.array(
        [
            [0.5, 0.0, 0.5, 0.0],
            [4 * odd_size / total**2, 0.0, -4 * even_size / total**2, 0.0],
            [0.0, 1 / even_size, 0.0, -1 / odd_size],
            [0.0, 0.5 / even_size, 0.0, 0.5 / odd_size],
        ]
    )
    rows = of_phasors @ np.array([*_turned(even / even_size, 1), *_turned(odd / odd_size, -1)])
    spread = found.covariance[_SINE_AND_IMAGE]
    variances = ((rows @ spread) * rows).sum(axis=1)
    amplitude_u, gain_u, angle_u, phase_u = np.sqrt(np.maximum(variances, 0.0)).tolist()
    # Noise in the phase difference looks like skew; its part in the mean of the two magnitudes is taken out.
    amplitude = total / 2 - abs(both) * angle_u**2 / 8 if angle_u < _KNOWN_ANGLE else abs(both)
    return SineValues(
        amplitude=Estimate(amplitude, amplitude_u, "V"),
        phase=Estimate(middle, phase_u, "rad"),
        offset=Estimate(one, math.sqrt(found.covariance[2, 2]), "V"),
        gain_mismatch=Estimate(2 * (even_size - odd_size) / total, gain_u),
        skew=Estimate(angle / omega, angle_u / omega, "s"),
        offset_difference=Estimate(2 * turn, 2 * math.sqrt(found.covariance[3, 3]), "V"),
    )


def _turned(direction: complex, sign: int) -> list[list[float]]:
    """Return derivatives of magnitude, and of magnitude times angle, of one converter's phasor.

    They are with respect to (cos, sin, turn_cos, turn_sin); the phasor is
    ``(cos - i sin) + sign (turn_cos - i turn_sin)``.
    """
    along, across = direction.real, direction.imag
    return [
        [along, -across, sign * along, -sign * across],
        [-across, -along, -sign * across, -sign * along],
    ]


def with_quantization(values: SineValues, variance: float, volts_per_count: float) -> SineValues:
    """Add what rounding to whole codes may do to amplitude and offset where noise does not dither it away.

    The mean code of a sine of a counts with Gaussian noise of d counts has, beside the sine, the first
    harmonic ``(2/pi) J1(2 pi a) exp(-2 pi^2 d^2) cos(2 pi offset)`` of the rounding error, and a constant
    with J0 in place of 2 J1 (after Wagdy, IEEE Trans. Instrum. Meas. 38, 1989). The offset within a code is
    not known, so the root mean square over it counts as a standard uncertainty.

    Parameters
    ----------
    values : SineValues
        From `one_converter` or `two_converters`.
    variance : float
        Of the residual, V^2; it contains that of rounding, a twelfth of a squared code.
    volts_per_count : float
        V; 0 leaves the values as they are.
    """
    if not volts_per_count:
        return values
    noise = max(variance / volts_per_count**2 - 1 / 12, 0.0)
    counts = max(values.amplitude.value / volts_per_count, _SMALLEST)
    left = volts_per_count * math.exp(-2 * math.pi**2 * noise) / math.sqrt(2)
    if left < 1e-9 * volts_per_count:
        return values
    # Largest values of J1 and J0, and their envelopes for large arguments.
    sine = left * 2 / math.pi * min(0.582, 1 / (math.pi * math.sqrt(counts)))
    constant = left / math.pi * min(1.0, 1 / (math.pi * math.sqrt(counts)))
    wide = replace(values, amplitude=_wider(values.amplitude, sine), offset=_wider(values.offset, constant))
    if values.gain_mismatch is None or values.offset_difference is None:
        return wide
    relative = sine / max(values.amplitude.value, _SMALLEST)
    return replace(
        wide,
        gain_mismatch=_wider(values.gain_mismatch, math.sqrt(2) * relative),
        offset_difference=_wider(values.offset_difference, math.sqrt(2) * constant),
    )


def _wider(estimate: Estimate, part: float) -> Estimate:
    return replace(estimate, standard_uncertainty=math.hypot(estimate.standard_uncertainty, part))
