"""From a voltage wished at the cut to the waveform that the bench's generator can play.

A generator plays points on its own sample grid, rounded to its converter, with straight lines or steps
between them. Points taken straight off the wished curve would play it too high where it is hollow and too low
where it bulges. So the points are those of least squares: of all that such a generator could play the nearest
to what is wished (de Boor, A Practical Guide to Splines, 1978, chapter II and XIV). Behind the receiver's
filter the difference that is left falls with the fourth power of the interval, where that of points off the
curve falls with the square.

The points reach to the converter's full code, so a pulse with one sign uses half of its codes. An echo is
0.4 to 14 mV at the cut, near or below the 1 mVpp that generators make at least, where their amplitude is
uncertain by as much: a fixed attenuator between generator and cut lets them play at ease.

Not modelled: that the attenuator has a frequency response; errors of the generator beyond its grid, its
rounding and one declared pole (``[generator] bandwidth_hz``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.bench import setting_per_cut_volt
from belahil.errors import LimitExceeded
from belahil.generators import behind_output, per_50_ohm, setting_for, stimulus_of
from belahil.stimuli import SampledPulse, largest_volts, scaled

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from belahil.config import BenchConfig
    from belahil.generators import GeneratorModel
    from belahil.stimuli import Interpolation

PADS_DB = (0.0, 3.0, 6.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0)
"""Fixed attenuators that a laboratory has, alone or two in a row."""
AT_EASE_VPP = 0.1
"""Setting into 50 ohm from which on the 1 mVpp by which the amplitude of such generators is uncertain, as
their manuals say, is at most 1 %."""
_FINER = 8
"""Places in an interval at which wished and played curve are compared."""
_OVERSHOOT = (1 + math.sqrt(3)) / 2
"""How far points of least squares, joined by lines, reach beyond a step; less beyond a rounded pulse."""
_ROUNDED = 1 - 1e-9
"""A setting that is just allowed stays so however its decibels were reckoned."""
_FADED = 14.0
"""Time constants after which a pole's tail is below 1e-6."""


@dataclass(frozen=True, slots=True)
class Playable:
    """A pulse that a generator can play.

    Parameters
    ----------
    wished : SampledPulse
        What was asked for, V at the cut.
    stimulus : SampledPulse
        What to hand to `belahil.bench.Bench.measure`: points on the generator's grid, not yet rounded.
    played : SampledPulse
        What the generator will play of it, V at the cut.
    setting_vpp : float
        Amplitude of the generator's setting, V peak to peak into its load setting.
    full_range : float
        Largest code over the converter's full code, 0 to 1.
    """

    wished: SampledPulse
    stimulus: SampledPulse
    played: SampledPulse
    setting_vpp: float
    full_range: float


def playable(
    wished: SampledPulse, model: GeneratorModel, config: BenchConfig, interpolation: Interpolation = "linear"
) -> Playable:
    """Turn a wished pulse into one that the bench's generator can play.

    Parameters
    ----------
    wished : SampledPulse
        V at the cut, sampled as finely as its maker likes; filters that it has passed are taken along.
    model : GeneratorModel
        `belahil.bench.Bench.generator_model`.
    config : BenchConfig
        Attenuation, load and declared bandwidth.
    interpolation : {"linear", "hold"}
        What the generator makes of its points.

    Returns
    -------
    Playable
        At the model's highest sample rate. It begins and ends with 0 V, at which a burst rests.

    Raises
    ------
    LimitExceeded
        It is so faint that the generator's smallest amplitude would leave part of its converter unused, with
        the attenuator that would serve; or too large, too long, or before the trigger.
    """
    check_not_too_faint([wished], model, config)
    _check_not_too_large(wished, model, config)
    stimulus = _on_grid(wished, model, interpolation)
    factor = setting_per_cut_volt(config)
    setting = setting_for(scaled(stimulus, factor), model, config.generator.load_ohm, config.bench.trigger)
    played = scaled(behind_output(stimulus_of(setting), config.generator.bandwidth_hz), 1 / factor)
    assert setting.arb is not None
    assert isinstance(played, SampledPulse)
    codes = np.abs(setting.arb.codes.astype(np.int32))
    return Playable(
        wished, stimulus, played, setting.amplitude_vpp, float(codes.max()) / setting.arb.full_code
    )


def _check_not_too_large(pulse: SampledPulse, model: GeneratorModel, config: BenchConfig) -> None:
    peak_v = largest_volts(pulse)
    most_vpp = 2 * model.max_peak_v * per_50_ohm(config.generator.load_ohm)
    if _setting_vpp(peak_v, config) <= most_vpp:
        return
    advised_db = advised_attenuation_db([peak_v], model, config)
    advice = "no attenuator helps" if advised_db is None else f"{advised_db:g} dB would serve"
    raise LimitExceeded(
        f"a pulse of {peak_v:.4g} V at the cut behind {config.generator.attenuation_db:g} dB is a setting of "
        f"{_setting_vpp(peak_v, config):.4g} Vpp; {model.name} makes at most {most_vpp:.4g} Vpp; {advice}"
    )


def is_too_faint(pulse: SampledPulse, model: GeneratorModel, config: BenchConfig) -> bool:
    """Tell whether a pulse needs less than the smallest amplitude of a generator behind this attenuator."""
    return _setting_vpp(largest_volts(pulse), config) < _least_vpp(model, config) * _ROUNDED


def check_not_too_faint(pulses: Sequence[SampledPulse], model: GeneratorModel, config: BenchConfig) -> None:
    """Refuse pulses of which the faintest is too faint for the generator.

    Raises
    ------
    LimitExceeded
        One line, with the attenuator that would serve all of them.
    """
    faintest = min(pulses, key=largest_volts)
    if not is_too_faint(faintest, model, config):
        return
    peak_v = largest_volts(faintest)
    advised_db = advised_attenuation_db(map(largest_volts, pulses), model, config)
    advice = "no attenuator of up to 60 dB would do"
    if advised_db is not None:
        advice = (
            f"put {advised_db:g} dB before the cut and say so: [generator] attenuation_db = {advised_db:g}"
        )
    raise LimitExceeded(
        f"a pulse of {peak_v:.4g} V at the cut behind {config.generator.attenuation_db:g} dB is a setting of "
        f"{_setting_vpp(peak_v, config):.4g} Vpp; {model.name} makes at least "
        f"{_least_vpp(model, config):.4g} Vpp; {advice}"
    )


def advised_attenuation_db(
    peaks_v: Iterable[float], model: GeneratorModel, config: BenchConfig
) -> float | None:
    """Return the least attenuation with which a generator plays all of some pulses at ease.

    Parameters
    ----------
    peaks_v : iterable of float
        Largest magnitudes at the cut, V, above zero.
    model : GeneratorModel
        Its smallest and largest amplitude.
    config : BenchConfig
        Load and input resistance; its own attenuation does not count.

    Returns
    -------
    float or None
        One of `PADS_DB`. Where none gives every pulse `AT_EASE_VPP`, the largest with which the largest pulse
        can be made; None where the faintest pulse cannot be made even so.
    """
    peaks = list(peaks_v)
    bare = 10 ** (-config.generator.attenuation_db / 20)
    unit = per_50_ohm(config.generator.load_ohm)

    def setting_vpp(peak_v: float, pad_db: float) -> float:
        return _setting_vpp(peak_v, config) * bare * float(10 ** (pad_db / 20))

    most_vpp = 2 * model.max_peak_v * unit / (_OVERSHOOT * _ROUNDED)
    makeable = [pad for pad in PADS_DB if setting_vpp(max(peaks), pad) <= most_vpp]
    at_ease = [pad for pad in makeable if setting_vpp(min(peaks), pad) >= AT_EASE_VPP * unit * _ROUNDED]
    best = at_ease[0] if at_ease else max(makeable, default=None)
    if best is None or setting_vpp(min(peaks), best) < _least_vpp(model, config) * _ROUNDED:
        return None
    return best


def _setting_vpp(peak_v: float, config: BenchConfig) -> float:
    return 2 * peak_v * setting_per_cut_volt(config)


def _least_vpp(model: GeneratorModel, config: BenchConfig) -> float:
    return model.min_amplitude_vpp * per_50_ohm(config.generator.load_ohm)


def _on_grid(wished: SampledPulse, model: GeneratorModel, interpolation: Interpolation) -> SampledPulse:
    """Return the points of least squares, first and last of them zero."""
    rate_hz = model.max_arb_rate_hz
    grid_s = model.start_step_s(rate_hz)
    # One interval before, for the zero at which the burst rests; nothing before the trigger.
    before_s = math.ceil(1 / rate_hz / grid_s - 1e-9) * grid_s
    start_s = math.floor(wished.start_s / grid_s + 1e-6) * grid_s
    start_s = max(start_s - before_s, min(start_s, 0.0))
    slowest = min((abs(pole.real) for pole in wished.poles), default=math.inf)
    last = wished.volts.size - (1 if wished.interpolation == "linear" else 0)
    end_s = wished.start_s + last / wished.sample_rate_hz + _FADED / slowest
    count = math.ceil((end_s - start_s) * rate_hz) + 2
    if count > model.max_points:
        raise LimitExceeded(
            f"an arbitrary waveform of {count} points: {model.name} holds at most {model.max_points}"
        )
    finer = max(_FINER, math.ceil(2 * wished.sample_rate_hz / rate_hz))
    places_s = start_s + np.arange((count - 1) * finer + 1) / (rate_hz * finer)
    curve = wished.at(places_s)
    points = _lines(curve, finer) if interpolation == "linear" else _steps(curve, finer)
    return SampledPulse(points, rate_hz, start_s, interpolation)


def _lines(curve: NDArray[np.float64], finer: int) -> NDArray[np.float64]:
    """Least squares with straight lines, shape (n,), from places `finer` times as dense."""
    from scipy.linalg import solveh_banded

    rise = np.arange(1.0, finer) / finer
    hat = np.concatenate([rise, [1.0], rise[::-1]])
    inner = np.convolve(curve, hat, mode="same")[finer:-1:finer]
    normal = np.empty((2, inner.size))
    normal[0], normal[1] = np.sum(rise * (1 - rise)), np.sum(hat**2)
    points = np.zeros(inner.size + 2)
    points[1:-1] = solveh_banded(normal, inner)
    return points


def _steps(curve: NDArray[np.float64], finer: int) -> NDArray[np.float64]:
    """Mean over each interval, shape (n,), from places `finer` times as dense; zero first and last."""
    middles = (curve[1:] + curve[:-1]) / 2
    points = np.zeros(middles.size // finer + 1)
    points[:-1] = middles.reshape(-1, finer).mean(axis=1)
    points[0] = 0.0
    return points
