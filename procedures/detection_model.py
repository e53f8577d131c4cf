"""How often a range finder should see an echo, and how its arrival scatters: by windows with simulated noise.

The windows are those of the receiver model with what is known of the receiver under test; the range finder is
that of this project. Every simulated window has its own noise; its pulses lie at one of 32 places between two
samples, each taken as often as the others.

Not modelled: noise that is not white before the filter, a receiver that is not linear, and a trigger that
jitters by more than a sample.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from belahil.config import Interleave, SmallSignal
from belahil.pole_response import response
from belahil.receiver import DigitizerSpec
from belahil.receiver_truth import ReceiverTruth
from belahil.values import Estimate, RangeWindow, WindowRequest
from procedures.echo_sighting import Expectation, Sighting, sighting
from sim.draws import Draws
from sim.receiver_model import ReceiverModel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.stimuli import SampledPulse
    from procedures.known_receiver import KnownCode, KnownReceiver
    from sim.rfm import RangeFinder

PLACES = 32
"""Of the pulses between two samples."""
SEED = 0x52464D50
"""Of the model's own noise: no emulated bench is likely to draw the same."""
SHIFTED_PART = 4
"""One window in so many is searched again with a larger and a smaller signal."""


@dataclass(frozen=True)
class Sightings:
    """What many windows told of one echo.

    Parameters
    ----------
    used : int
        Windows that were searched; one without its marker counts as one without its echo.
    apart_s : ndarray of float64, shape (detected,)
        From the marker to the echo where it was found, s.
    """

    used: int
    apart_s: NDArray[np.float64]

    @classmethod
    def of(cls, ones: list[Sighting]) -> Sightings:
        """Collect those of single windows."""
        return cls(len(ones), np.array([one.apart_s for one in ones if one.apart_s is not None]))

    @property
    def detected(self) -> int:
        """Windows in which the echo was found."""
        return int(self.apart_s.size)


@dataclass(frozen=True)
class Prediction:
    """What the model says of one echo.

    Parameters
    ----------
    sightings : Sightings
        Of the simulated windows.
    shifted : tuple of Sightings or None
        Of a part of them with a signal that is larger, and one that is smaller, by one standard uncertainty
        of the ratio of signal to noise; None where that is known exactly.
    """

    sightings: Sightings
    shifted: tuple[Sightings, Sightings] | None


def signal_uncertainty(known: KnownCode, declared_relative: float, filter_relative: float) -> float:
    """Return the relative standard uncertainty of the ratio of signal to noise.

    Parameters
    ----------
    known : KnownCode
        Gain and noise, each with its uncertainty.
    declared_relative : float
        What the bench file declares of the generator's amplitude.
    filter_relative : float
        By how much an echo's height changes with one standard uncertainty of the cut-off.
    """
    assert known.noise_rms is not None
    parts = [one.standard_uncertainty / one.value for one in (known.gain, known.noise_rms) if one.value]
    return math.hypot(*parts, declared_relative, filter_relative)


def predict(
    stimulus: SampledPulse,
    example: RangeWindow,
    marker_s: float,
    receiver: KnownReceiver,
    finder: RangeFinder,
    expected: Expectation,
    windows: int,
    uncertainty: float,
    key: int = 0,
) -> Prediction:
    """Search simulated windows.

    Parameters
    ----------
    stimulus : SampledPulse
        As played, V at the cut.
    example : RangeWindow
        A measured window: samples, size of a count, gain code. Without samples, as many as its request had.
    marker_s : float
        Where the markers of the measured windows lie in the middle, s after the first sample: there those of
        the simulated ones lie.
    receiver : KnownReceiver
        With noise at the gain code.
    finder : RangeFinder
        This project's, for such a receiver.
    expected : Expectation
        Of the stimulus.
    windows : int
        To simulate.
    uncertainty : float
        Of the ratio of signal to noise, relative.
    key : int
        Of the noise: another one for each echo.
    """
    model = receiver_model(receiver, example)
    request = WindowRequest(0, None, example.counts.size)
    signals = _signals(stimulus, model, example.counts.size, expected.marker_s - marker_s)

    def one(shot: int, scale: float) -> Sighting:
        draws = Draws(SEED + key, shot)
        volts = model.at_converter(scale * signals[shot % PLACES], None, draws)
        found = finder.search(model.digitized(volts, request).volts)
        return sighting([(float(row[0]), float(row[2])) for row in found], expected)

    plain = Sightings.of([one(shot, 1.0) for shot in range(windows)])
    if not uncertainty:
        return Prediction(plain, None)
    few = range(-(-windows // SHIFTED_PART))
    larger, smaller = (Sightings.of([one(shot, 1 + sign * uncertainty) for shot in few]) for sign in (1, -1))
    return Prediction(plain, (larger, smaller))


def receiver_model(receiver: KnownReceiver, example: RangeWindow) -> ReceiverModel:
    """Return the model of a receiver with what is known of it.

    Parameters
    ----------
    receiver : KnownReceiver
        With noise at the gain code of `example`.
    example : RangeWindow
        Tells the gain code, the size of a count and the nominal interval.
    """
    known = receiver.at(example.gain_code)
    assert known.noise_rms is not None
    truth = ReceiverTruth(
        cutoff_hz=receiver.cutoff.value,
        order=receiver.order,
        highpass_hz=receiver.highpass_hz,
        gain_by_code=(known.gain.value,),
        noise_rms_v_by_code=(known.noise_rms.value,),
        small_signal=SmallSignal(),
        adc_full_scale_v=example.volts_per_count * 2.0**receiver.bits,
        adc_bits=receiver.bits,
        clock_ppm=_value(receiver.clock_ppm),
        interleave=Interleave(
            _value(receiver.interleave_gain),
            _value(receiver.interleave_offset),
            _value(receiver.interleave_skew),
        )
        if receiver.converters == 2
        else Interleave(),
        input_ohm=50.0,
    )
    samples = max(example.counts.size, 1)
    spec = DigitizerSpec(1 / example.sample_interval_s, receiver.bits, receiver.converters, samples, None)
    return ReceiverModel(truth, spec)


def _value(one: Estimate | None) -> float:
    return 0.0 if one is None else one.value


def _signals(
    stimulus: SampledPulse, model: ReceiverModel, samples: int, shift_s: float
) -> NDArray[np.float64]:
    """Return the filtered stimulus at every place between two samples, V, shape (places, samples).

    `shift_s` is the time of the first sample on the time axis of the stimulus, in the mean over the places.
    """
    interval_s = model.grid.interval_s
    rows = np.empty((PLACES, samples))
    for row, place in zip(rows, (np.arange(PLACES) + 0.5) / PLACES - 0.5, strict=True):
        row[:] = response(
            stimulus.volts,
            stimulus.sample_rate_hz,
            stimulus.start_s,
            stimulus.interpolation,
            stimulus.poles + model.poles,
            model.grid.times_s(samples, shift_s + place * interval_s),
            zeros=model.zeros,
        )
    return rows


def with_samples(example: RangeWindow, samples: int) -> RangeWindow:
    """Return a window of so many samples at 0 V, for what came without its samples."""
    return replace(example, counts=np.zeros(samples, np.int16))
