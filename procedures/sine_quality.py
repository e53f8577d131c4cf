"""What a sine says of a digitizer after IEEE Std 1057-2017: SINAD, ENOB, SNR, THD, SFDR, noise floor.

With P the mean square of the sine, NAD^2 that of what the three-parameter fit leaves, and FSR the span::

    SINAD = P / NAD^2          ENOB = log2(FSR / (NAD sqrt(12)))
    THD   = sum of harmonics 2 to 10 / P
    SNR   = P / (NAD^2 - those harmonics)
    SFDR  = P / the strongest other line

What differs between two interleaved converters (images, the line at half the sample rate) is in NAD and, as
lines, in SFDR, since a user of the samples has it too. What noise adds to a line on average is taken off.

Not modelled: distortion and noise of the generator, which count as the digitizer's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from belahil.values import Estimate
from procedures.sine_harmonics import Line
from procedures.spectral_lines import find_lines

if TYPE_CHECKING:
    from procedures.sine_harmonics import Harmonics

FoundStatus = Literal["ok", "noise_limited"]

SEEN = 5.0
"""Standard uncertainties that a line of the sine must reach to be taken for one: 4e-6 by chance."""
KNOWN = 2.0
"""Standard uncertainties by which a sum of harmonics must exceed zero to be written in decibels."""
_DB = 10 / math.log(10)


@dataclass(frozen=True, slots=True)
class Ratio:
    """A ratio of powers that may be lost in noise.

    Parameters
    ----------
    value : Estimate or None
        dB; None with status "noise_limited".
    bound : float
        What it is at most (THD) or at least (SFDR), dB; with two standard uncertainties.
    status : {"ok", "noise_limited"}
        Whether the distortion stands out of the noise.
    """

    value: Estimate | None
    bound: float
    status: FoundStatus


@dataclass(frozen=True, slots=True)
class SineQuality:
    """Figures of one sine at one gain code.

    Parameters
    ----------
    sinad, snr : Estimate
        dB.
    enob : Estimate
        Effective number of bits.
    thd, sfdr : Ratio
        Total harmonic distortion (below zero) and spurious-free dynamic range (above), dB.
    noise_rms : Estimate
        Noise and quantization without any line of the sine, V.
    noise_floor : Estimate
        The same for each Hz, in dB of the power of a full-scale sine.
    """

    sinad: Estimate
    snr: Estimate
    enob: Estimate
    thd: Ratio
    sfdr: Ratio
    noise_rms: Estimate
    noise_floor: Estimate


def sine_quality(found: Harmonics, full_scale_v: float, sample_rate_hz: float) -> SineQuality:
    """Take the figures from the lines of a sine.

    Parameters
    ----------
    found : Harmonics
        Its sine is known to better than 10 %.
    full_scale_v : float
        Whole span of the converter, V.
    sample_rate_hz : float
        Of all converters together, Hz.
    """
    sine = found.line(1)
    assert sine is not None
    power, power_u = sine.power, sine.power_u
    harmonics = [one for one in found.lines if one.harmonic >= 2 and not one.image]
    distortion = sum(one.power for one in harmonics)
    distortion_u = math.hypot(*(one.power_u for one in harmonics))
    others_u = [one.power_u for one in found.lines if one.image]
    rest = max(found.residual_v2 - distortion, found.noise_v2)
    nad_relative = found.residual_u_v2 / found.residual_v2
    enob = math.log2(full_scale_v / math.sqrt(12 * found.residual_v2))
    noise = math.sqrt(found.noise_v2)
    floor = found.noise_v2 / (sample_rate_hz / 2) / (full_scale_v**2 / 8)
    return SineQuality(
        sinad=_ratio(power, power_u, found.residual_v2, found.residual_u_v2),
        snr=_ratio(power, power_u, rest, math.hypot(found.noise_u_v2, *others_u)),
        enob=Estimate(enob, nad_relative / (2 * math.log(2)), "1"),
        thd=_distortion(distortion, distortion_u, power, power_u),
        sfdr=_spurious_free(found, sine),
        noise_rms=Estimate(noise, found.noise_u_v2 / (2 * noise), "V"),
        noise_floor=Estimate(_DB * math.log(floor), _DB * found.noise_u_v2 / found.noise_v2, "dB"),
    )


def _ratio(above: float, above_u: float, below: float, below_u: float) -> Estimate:
    spread = math.hypot(above_u / above, below_u / below)
    return Estimate(_DB * math.log(above / below), _DB * spread, "dB")


def _distortion(distortion: float, distortion_u: float, power: float, power_u: float) -> Ratio:
    bound = _DB * math.log((max(distortion, 0.0) + 2 * distortion_u) / power)
    if distortion <= KNOWN * distortion_u:
        return Ratio(None, bound, "noise_limited")
    return Ratio(_ratio(distortion, distortion_u, power, power_u), bound, "ok")


def _spurious_free(found: Harmonics, sine: Line) -> Ratio:
    others = [one for one in found.lines if one.image or one.harmonic >= 2]
    seen = [(one.power, one.power_u) for one in others if one.amplitude > SEEN * one.amplitude_u]
    seen += [
        (one.rms.value**2, 2 * one.rms.value * one.rms.standard_uncertainty)
        for one in find_lines(found.spectrum)
    ]
    unseen = max(
        float(found.spectrum.least_line_v2.max()), *(one.power + 2 * one.power_u for one in others), 0.0
    )
    if not seen:
        return Ratio(None, _DB * math.log(sine.power / unseen), "noise_limited")
    power, power_u = max(seen)
    bound = _DB * math.log(sine.power / (power + 2 * power_u))
    return Ratio(_ratio(sine.power, sine.power_u, power, power_u), bound, "ok")
