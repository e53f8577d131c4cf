"""Noise of a silent receiver: what is analog, what is the converter's.

The counts of a silent window are a Gaussian noise rounded to whole codes. Each converter has its own mean,
all share one standard deviation; both follow by maximum likelihood from the histogram (grouped data: Sheppard
1898, Kulldorff 1961), which stays unbiased where the rounding is as coarse as the noise. The means take out
the converters' offsets and with them the interleave line at half the sample rate.

Not modelled: noise that is not Gaussian or not stationary, and lines other than the interleave line; the
spectrum shows them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.errors import RefusedInput
from belahil.values import Estimate, RangeWindow

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

Status = Literal["ok", "clipped", "below_dither", "no_signal"]

SEGMENT = 256
LEAST_SAMPLES = 2 * SEGMENT
"""Shortest window of which a spectrum can be averaged."""
LEAST_SIGMA_COUNTS = 0.27
"""Below some 0.3 codes of noise a histogram may hold two codes only, which do not tell its width. The limit
is five standard deviations lower, so that chance does not select among windows with 0.3 codes."""


@dataclass(frozen=True, slots=True, eq=False)
class DarkNoise:
    """Noise at one gain code.

    Parameters
    ----------
    status : {"ok", "clipped", "below_dither", "no_signal"}
        The numbers of a code that is not "ok" are None where they would be wrong.
    rms : Estimate or None
        Analog noise at the converter, V rms: without quantization, offsets and the interleave line.
    rms_total : Estimate
        Raw rms about the common mean, V.
    offset_difference : Estimate or None
        Offset of even minus odd samples, V at the converter; None with a single converter.
    frequency_hz, density_v2_per_hz : ndarray of float64, shape (m,)
        One-sided spectrum with the converters' means removed (Welch 1967).
    window_count : int
        Windows used.
    effective : float
        Samples of white noise that would tell as much of a variance as these.
    fit : RoundedGaussian or None
        The histogram with what was fitted to it, where the status is "ok".
    """

    status: Status
    rms: Estimate | None
    rms_total: Estimate
    offset_difference: Estimate | None
    frequency_hz: NDArray[np.float64]
    density_v2_per_hz: NDArray[np.float64]
    window_count: int
    effective: float
    fit: RoundedGaussian | None


def dark_noise(windows: Sequence[RangeWindow], converters: int = 2) -> DarkNoise:
    """Measure the noise of silent windows of one gain code.

    Parameters
    ----------
    windows : sequence of RangeWindow
        At least one, all with the same scale, of at least 512 samples.
    converters : int
        Interleaved converters: sample n belongs to converter ``n % converters``.

    Raises
    ------
    RefusedInput
        No window, or windows of different scales or too short.
    """
    _check(windows)
    scale = windows[0].volts_per_count
    used = [one for one in windows if not one.saturated] or list(windows)
    zeroed = [centred(one.counts, converters) for one in used]
    frequency, density, effective = _spectrum(zeroed, windows[0].sample_interval_s, converters)
    total = math.sqrt(float(np.mean([np.var(one.counts) for one in used])))
    count = sum(one.counts.size for one in used)
    rms_total = Estimate(scale * total, scale * total / math.sqrt(2 * effective), "V")

    def answer(
        status: Status, rms: Estimate | None, offset: Estimate | None, fit: RoundedGaussian | None = None
    ) -> DarkNoise:
        return DarkNoise(
            status, rms, rms_total, offset, frequency, density * scale**2, len(used), effective, fit
        )

    if any(one.saturated for one in windows):
        return answer("clipped", None, None)
    fit = rounded_gaussian([one.counts for one in used], converters)
    if fit is None:
        return answer("no_signal" if total == 0 else "below_dither", None, None)
    if fit.sigma < LEAST_SIGMA_COUNTS:
        # Nor does it tell the means: a mean between two codes is known only by the noise that reaches both.
        return answer("below_dither", None, None)
    # The likelihood counts every sample as independent; coloured noise has `effective` of them.
    sigma_u = math.sqrt(count / effective / fit.information)
    offset = None
    if converters == 2:
        offset_u = math.sqrt(_line_density(density) / windows[0].sample_interval_s / 2 / count) * 2
        offset = Estimate(scale * float(fit.means[0] - fit.means[1]), scale * offset_u, "V")
    return answer("ok", Estimate(scale * fit.sigma, scale * sigma_u, "V"), offset, fit)


def _check(windows: Sequence[RangeWindow]) -> None:
    if not windows:
        raise RefusedInput("dark noise of no window: at least one is needed")
    scales = {(one.volts_per_count, one.sample_interval_s, one.counts.size) for one in windows}
    if len(scales) > 1:
        raise RefusedInput(f"dark windows of {len(scales)} different scales or lengths: they must be alike")
    if windows[0].counts.size < LEAST_SAMPLES:
        raise RefusedInput(
            f"dark windows of {windows[0].counts.size} samples: at least {LEAST_SAMPLES} are needed"
        )


def centred(counts: NDArray[np.int16], converters: int) -> NDArray[np.float64]:
    """Return counts less the mean of each converter, shape (n,).

    Parameters
    ----------
    counts : ndarray of int16, shape (n,)
        Of a window.
    converters : int
        Interleaved converters.
    """
    found = counts.astype(np.float64)
    for converter in range(converters):
        found[converter::converters] -= found[converter::converters].mean()
    return found


def _spectrum(
    zeroed: Sequence[NDArray[np.float64]], interval_s: float, converters: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return frequencies, one-sided density in counts**2/Hz, and the effective number of samples."""
    taper = np.hanning(SEGMENT + 1)[:-1]
    blocks = np.concatenate(
        [np.lib.stride_tricks.sliding_window_view(one, SEGMENT)[:: SEGMENT // 2] for one in zeroed]
    )
    power = np.mean(np.abs(np.fft.rfft(blocks * taper)) ** 2, axis=0) / np.sum(taper**2)
    frequency = np.asarray(np.fft.rfftfreq(SEGMENT, interval_s), dtype=np.float64)
    # Sum of squared autocorrelations = mean(S^2) / mean(S)^2 (Parseval), taken without the bins that the
    # removal of the means emptied, and without the excess that a periodogram of few blocks adds to S^2.
    weight = np.full(power.size, 2.0)
    weight[[0, -1]] = 0.0 if converters == 2 else 1.0
    weight[0] = 0.0
    blocks_free = max(1.0, blocks.shape[0] * 9 / 11)
    mean = np.average(power, weights=weight)
    spread = np.average(power**2, weights=weight) / (1 + 1 / blocks_free)
    count = sum(one.size for one in zeroed)
    effective = count if mean == 0 else count * min(1.0, mean**2 / spread)
    return frequency, np.asarray(2 * power * interval_s), float(effective)


def _line_density(density: NDArray[np.float64]) -> float:
    """Return the density in counts**2/Hz next to half the sample rate, where an offset difference shows."""
    return float(np.mean(density[-6:-2]))


@dataclass(frozen=True, slots=True, eq=False)
class RoundedGaussian:
    """A Gaussian that was rounded to codes, one mean for each converter, fitted to a histogram.

    Parameters
    ----------
    sigma : float
        Standard deviation, codes.
    means : ndarray of float64, shape (converters,)
        Codes.
    information : float
        Fisher's, on `sigma` for independent samples.
    lowest : int
        Code of the first column of `histogram`.
    histogram : ndarray of float64, shape (converters, codes)
        Samples at each code.
    """

    sigma: float
    means: NDArray[np.float64]
    information: float
    lowest: int
    histogram: NDArray[np.float64]


def rounded_gaussian(counts: Sequence[NDArray[np.int16]], converters: int) -> RoundedGaussian | None:
    """Fit a rounded Gaussian by maximum likelihood; None where a histogram has fewer than two codes.

    Parameters
    ----------
    counts : sequence of ndarray of int16
        At least one window.
    converters : int
        Interleaved converters.
    """
    from scipy.optimize import minimize

    lowest = min(int(one.min()) for one in counts)
    top = max(int(one.max()) for one in counts) - lowest + 1
    histogram = np.zeros((converters, top))
    for one in counts:
        for converter in range(converters):
            # int16 does not hold every difference of two counts.
            above = one[converter::converters].astype(np.intp) - lowest
            histogram[converter] += np.bincount(above, minlength=top)
    codes = np.arange(top, dtype=np.float64)
    number = histogram.sum(axis=1)
    means = histogram @ codes / number
    variance = float(np.sum(histogram * (codes - means[:, None]) ** 2) / number.sum())
    if variance <= 0 or not np.all(np.count_nonzero(histogram, axis=1) >= 2):
        return None
    start = np.append(means, 0.5 * math.log(max(variance - 1 / 12, 0.04)))
    solved = minimize(_misfit, start, args=(histogram, codes), jac=True, method="BFGS")
    sigma = math.exp(solved.x[-1])
    information = _information(solved.x, histogram, codes) / sigma**2
    return RoundedGaussian(sigma, solved.x[:-1] + lowest, information, lowest, histogram)


def _misfit(
    parameters: NDArray[np.float64], histogram: NDArray[np.float64], codes: NDArray[np.float64]
) -> tuple[float, NDArray[np.float64]]:
    """Return the mean negative log likelihood and its gradient for (means..., ln sigma)."""
    chance, by_mean, by_width = _chances(parameters, codes)
    share = histogram / histogram.sum()
    value = -float(np.sum(share * np.log(chance)))
    gradient = np.append(-np.sum(share * by_mean / chance, axis=1), -np.sum(share * by_width / chance))
    return value, gradient


def _chances(
    parameters: NDArray[np.float64], codes: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the chance of each code and its derivatives by mean and ln sigma, shape (converters, codes)."""
    from scipy.special import ndtr

    sigma = math.exp(min(float(parameters[-1]), 50.0))
    low = (codes - 0.5 - parameters[:-1, None]) / sigma
    high = (codes + 0.5 - parameters[:-1, None]) / sigma
    # Above the mean both tails are taken from the other side, where their difference keeps its digits.
    above = low > 0
    chance = np.where(above, ndtr(-low) - ndtr(-high), ndtr(high) - ndtr(low))
    chance = np.maximum(chance, 1e-300)
    density_low, density_high = _normal(low), _normal(high)
    return chance, (density_low - density_high) / sigma, low * density_low - high * density_high


def _normal(z: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.exp(-0.5 * np.minimum(z**2, 1400.0)) / math.sqrt(2 * math.pi)


def _information(
    parameters: NDArray[np.float64], histogram: NDArray[np.float64], codes: NDArray[np.float64]
) -> float:
    """Return Fisher's information on ln sigma, the means being unknown too."""
    chance, by_mean, by_width = _chances(parameters, codes)
    number = histogram.sum(axis=1)
    width = float(np.sum(number[:, None] * by_width**2 / chance))
    cross = number * np.sum(by_mean * by_width / chance, axis=1)
    mean = number * np.sum(by_mean**2 / chance, axis=1)
    return width - float(np.sum(cross**2 / mean))
