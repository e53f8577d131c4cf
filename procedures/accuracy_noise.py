"""Noise at the converter: how well its spectrum follows the analytic density, and what a window costs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import TYPE_CHECKING

import numpy as np

from belahil import butterworth
from belahil.config import EmulatedReceiver
from belahil.pole_response import SampledNoise, autocovariance
from belahil.receiver import BELA_GRM
from belahil.receiver_truth import without_gaps
from belahil.stimuli import NoSignal
from belahil.values import WindowRequest
from procedures.accuracy_rows import Measured, Setting
from procedures.accuracy_shot_noise import shot_noise_settings
from sim.draws import Draws
from sim.receiver_model import ReceiverModel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Draw = Callable[[np.random.Generator], NDArray[np.float64]]

SAMPLES = BELA_GRM.digitizer.max_sample_count
INTERVAL_S = BELA_GRM.digitizer.sample_interval_s
BANDS, BINS = 40, 200
"""Each band is 200 bins of 4.98 kHz, 1 MHz."""

ASKED = 1e-2
MANY, SOME = 800, 100
"""Windows: the chance error of the many is 0.25 % of the density in a band."""
GAIN_CODE = 4
UNIT = "of the density, rms of 40 bands of 1 MHz"
_REFERENCE = "expected periodogram of 16064 samples with the analytic autocovariance, what is folded included"
_CASE = "dark noise"


def noise_settings() -> Iterator[Setting]:
    """List what is measured."""
    yield _setting("sampled filter", "at the samples", partial(_exact, MANY))
    yield _setting("receiver model", "counts, quantized", partial(_counts, MANY))
    for steps in (1, 2, 5, 10, 20):
        text = f"step {1e9 * INTERVAL_S / steps:.3g} ns"
        yield _setting("white noise, bilinear", text, partial(_fine_grid, steps, SOME))
    yield _setting("white noise", "no filter", partial(_white, SOME))
    yield from shot_noise_settings()


def _setting(method: str, setting: str, measure: Callable[[], Measured]) -> Setting:
    return Setting("noise", _CASE, method, setting, _REFERENCE, UNIT, measure, ASKED)


@lru_cache(maxsize=1)
def _poles() -> tuple[complex, ...]:
    return butterworth.poles(BELA_GRM.cutoff_hz, BELA_GRM.order)


@lru_cache(maxsize=1)
def expected() -> NDArray[np.float64]:
    """Return the expected periodogram of filtered white noise of unit rms, shape (SAMPLES // 2 + 1,).

    A window of N samples sees the autocovariance at lag k with the weight 1 - k / N.
    """
    lags = np.arange(SAMPLES)
    seen = autocovariance(_poles(), lags * INTERVAL_S) * (1 - lags / SAMPLES)
    both = seen + np.concatenate([[0.0], seen[:0:-1]])
    return np.asarray(np.fft.rfft(both).real / seen[0])


@dataclass(frozen=True)
class _Spectrum:
    """Mean periodogram of windows over the expected one, by bands."""

    bands: NDArray[np.float64]

    @classmethod
    def of(
        cls, draw: Callable[[int], NDArray[np.float64]], windows: int, true: NDArray[np.float64]
    ) -> _Spectrum:
        total = np.zeros(SAMPLES // 2 + 1)
        for number in range(windows):
            total += np.abs(np.fft.rfft(draw(number))) ** 2
        return cls(_by_band(total / (windows * SAMPLES) / true))

    @property
    def error(self) -> float:
        return float(np.sqrt(np.mean((self.bands - 1) ** 2)))


def _by_band(values: NDArray[np.float64]) -> NDArray[np.float64]:
    # Without DC, and without the last bins below half of the sample rate.
    return np.asarray(values[1 : 1 + BANDS * BINS].reshape(BANDS, BINS).mean(axis=1))


def _foretold(windows: int, made: NDArray[np.float64] | None = None) -> float:
    """Return the error to expect: of chance, and of a spectrum that is `made` in place of the true one."""
    chance = 1 / math.sqrt(BINS * windows)
    if made is None:
        return chance
    ratio = _by_band(made / expected())
    return float(np.sqrt(np.mean((ratio - 1) ** 2 + (ratio * chance) ** 2)))


def _measured(draw: Draw, windows: int, made: NDArray[np.float64] | None = None) -> Measured:
    rng = np.random.Generator(np.random.SFC64(1))
    found = _Spectrum.of(lambda _: draw(rng), windows, expected())
    return Measured(found.error, lambda: draw(rng), 1, _foretold(windows, made), {"windows": windows})


def _exact(windows: int) -> Measured:
    noise = SampledNoise(_poles(), 0, INTERVAL_S)
    return _measured(lambda rng: noise.draw(rng, SAMPLES), windows)


def _counts(windows: int) -> Measured:
    """Count the quantization in, as white noise of LSB^2 / 12."""
    receiver = ReceiverModel(without_gaps(EmulatedReceiver(), BELA_GRM), BELA_GRM.digitizer)
    rms_v = BELA_GRM.noise_rms_v_by_code[GAIN_CODE]

    def window(number: int) -> NDArray[np.float64]:
        request = WindowRequest(number, GAIN_CODE, SAMPLES, 0.0, "immediate")
        seen = receiver.window(NoSignal(), request, Draws(1, number))
        return np.asarray((seen.counts - seen.zero_count) * seen.volts_per_count, dtype=np.float64)

    lsb_v = receiver.quantizer.volts_per_count
    found = _Spectrum.of(window, windows, rms_v**2 * expected() + lsb_v**2 / 12)
    return Measured(found.error, lambda: window(0), 1, _foretold(windows), {"windows": windows})


def _fine_grid(steps: int, windows: int) -> Measured:
    """White noise on a step before a digital filter, and every so many-th value of it."""
    from scipy.signal import butter, freqz, lfilter

    rate_hz = steps / INTERVAL_S
    numerator, denominator = butter(BELA_GRM.order, BELA_GRM.cutoff_hz, fs=rate_hz)
    # Of unit density before the filter; unit rms behind the true one.
    step_rms = math.sqrt(rate_hz / 2 / butterworth.noise_bandwidth(BELA_GRM.cutoff_hz, BELA_GRM.order))
    begin = 100 * steps  # the filter has settled

    def draw(rng: np.random.Generator) -> NDArray[np.float64]:
        drive = step_rms * rng.standard_normal(begin + steps * SAMPLES)
        return np.asarray(lfilter(numerator, denominator, drive)[begin::steps])

    frequency_hz = np.arange(SAMPLES // 2 + 1) / (SAMPLES * INTERVAL_S)
    made = np.zeros(frequency_hz.size)
    for image in range(steps):
        _, passed = freqz(numerator, denominator, frequency_hz + image / INTERVAL_S, fs=rate_hz)
        made += step_rms**2 / steps * np.abs(passed) ** 2
    return _measured(draw, windows, made)


def _white(windows: int) -> Measured:
    """Noise of the right rms, but as if the receiver had no filter."""
    return _measured(lambda rng: rng.standard_normal(SAMPLES), windows, np.ones(SAMPLES // 2 + 1))
