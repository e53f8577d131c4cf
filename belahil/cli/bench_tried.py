"""What ``belahil bench check`` does: who is there, noise, a known sine, a pulse with its trigger.

Bench and receiver are compared with what is known of the receiver, which is its preset unless a run of
``characterize`` says better. A preset is no fact: differing from it is told, and is no failure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.butterworth import group_delay
from belahil.errors import InstrumentError, RefusedInput
from belahil.stimuli import NoSignal, Sine
from belahil.uncertainty import sized
from belahil.values import Estimate, WindowRequest

if TYPE_CHECKING:
    from collections.abc import Iterator

    from belahil.bench import Bench
    from belahil.stimuli import SampledPulse
    from belahil.values import RangeWindow
    from procedures.known_receiver import KnownReceiver

FREQUENCY_HZ = 1e6  # in the pass band of every receiver we know
GAIN_CODE = 4
LARGEST_VPP = 30e-3
NOISE_FACTOR = 5.0  # a sine that came back stands this far above what the dark window has at its frequency
NEIGHBOURS = range(3, 35)  # of the sine's frequency, in cycles a window: none is reached by its own leakage
DIFFERS = 3.0  # standard uncertainties
PULSES = 3
FWHM_S = 100e-9
PULSE_FACTOR = 6.0  # of the noise: chance reaches it once in some million samples
SLACK_SAMPLES = 2.0  # the trigger falls between two samples, and the peak of a pulse is one sample


@dataclass(frozen=True, slots=True)
class Fact:
    """One line of a check.

    Parameters
    ----------
    line : str
        For the user.
    agrees : bool
        False where the receiver differs from what a run measured of it.
    """

    line: str
    agrees: bool = True


def tried(bench: Bench, known: KnownReceiver | None = None) -> Iterator[Fact]:
    """Try a bench out and yield a line for each thing that is in order.

    Parameters
    ----------
    bench : Bench
        Three windows and three pulses are measured.
    known : KnownReceiver or None
        What a run measured of this receiver; None: the preset, from which nothing is concluded.

    Raises
    ------
    InstrumentError
        The sine or a pulse did not come back, or came back clipped.
    RefusedInput
        The run did not measure this gain code.
    """
    for part, identity in bench.identities.items():
        yield Fact(f"{part}: {identity}")
    codes = bench.spec.gain_codes
    if codes is not None and known is not None:
        codes = tuple(one.code for one in known.codes if one.code in codes) or codes
    code = None if codes is None else min(codes, key=lambda one: abs(one - GAIN_CODE))
    dark = bench.measure(NoSignal(), WindowRequest(0, code, bench.spec.max_sample_count)).window
    setting = "" if code is None else f" at gain code {code}"
    yield Fact(f"dark window{setting}: {sized(float(np.std(dark.volts)), 'V', 3)} rms at the converter")
    yield from _sine(bench, code, dark, known)
    yield from _pulses(bench, code, dark, known)


def _sine(bench: Bench, code: int | None, dark: RangeWindow, known: KnownReceiver | None) -> Iterator[Fact]:
    samples = bench.spec.max_sample_count
    asked = Sine(FREQUENCY_HZ, min(LARGEST_VPP, bench.config.generator.max_vpp / 2))
    shot = bench.measure(asked, WindowRequest(1, code, samples))
    played = shot.played
    assert isinstance(played, Sine)
    found_v, noise_v = amplitude(shot.window, played.frequency_hz), amplitude(dark, played.frequency_hz)
    hertz, volts = sized(played.frequency_hz, "Hz", 3), sized(played.amplitude_vpp, "Vpp", 3)
    sine = f"the sine of {hertz} and {volts} at the cut"
    if shot.window.saturated:
        raise InstrumentError(f"{sine}: {shot.window.saturated} samples of {samples} are clipped")
    if found_v < NOISE_FACTOR * noise_v or found_v < dark.volts_per_count / 4:
        raise InstrumentError(
            f"{sine} does not come back: {sized(found_v, 'V', 3)} at the converter with it, "
            f"{sized(noise_v, 'V', 3)} without; is the cable in place, is the receiver powered?"
        )
    spread_v = amplitude_uncertainty(dark, played.frequency_hz)
    peak_v = played.amplitude_vpp / 2
    declared = declared_relative(bench, played)
    gain = Estimate(found_v / peak_v, math.hypot(spread_v / peak_v, declared * found_v / peak_v))
    yield Fact(f"{sine} comes back: amplitude {_text(Estimate(found_v, spread_v, 'V'))} at the converter")
    yield _beside(bench, code, gain, known)


def _beside(bench: Bench, code: int | None, gain: Estimate, known: KnownReceiver | None) -> Fact:
    """Compare the gain with what is known of the receiver."""
    from procedures.known_receiver import preset_receiver

    receiver = known or preset_receiver(bench.config)
    try:
        expected = receiver.at(code).gain
    except RefusedInput:
        lacking = "is one with gain codes" if code is None else f"has no gain code {code}"
        return Fact(f"gain {_text(gain)}; {receiver.origin} {lacking}")
    apart = (gain.value - expected.value) / math.hypot(
        gain.standard_uncertainty, expected.standard_uncertainty
    )
    assumed = " (assumed to 1 %)" if known is None else ""
    differs = abs(apart) > DIFFERS
    said = (
        f"differs by {apart:+.1f} standard uncertainties"
        if differs
        else f"{apart:+.1f} standard uncertainties"
    )
    return Fact(
        f"gain {_text(gain)}, {receiver.origin}: {_text(expected)}{assumed}: {said}",
        agrees=known is None or not differs,
    )


def _pulses(bench: Bench, code: int | None, dark: RangeWindow, known: KnownReceiver | None) -> Iterator[Fact]:
    """Play pulses and see whether each is where its trigger puts it."""
    from procedures.gaussian_pulses import earliest_centre_s, gaussian_pulse
    from procedures.known_receiver import preset_receiver
    from procedures.pulse_place import first_sample

    model, samples, interval_s = (
        bench.generator_model,
        bench.spec.max_sample_count,
        bench.spec.sample_interval_s,
    )
    fwhm_s = max(FWHM_S, 8 * interval_s, 4 / model.max_arb_rate_hz)
    delay_s, begin_s = first_sample(bench.config)
    centre_s = begin_s + 4 * fwhm_s + earliest_centre_s(fwhm_s, model)
    peak_v = min(LARGEST_VPP, bench.config.generator.max_vpp / 2) / 2
    try:
        pulse = gaussian_pulse(fwhm_s, peak_v, model, centre_s)
        bench.check(pulse, WindowRequest(2, code, samples, delay_s))
    except RefusedInput as refused:
        yield Fact(f"trigger: not tried, {refused}")
        return
    receiver = known or preset_receiver(bench.config)
    expected_s = centre_s + float(group_delay(0.0, receiver.cutoff.value, receiver.order))
    places = [
        begin_s + _peak_s(bench, pulse, WindowRequest(shot, code, samples, delay_s), dark)
        for shot in range(2, 2 + PULSES)
    ]
    trigger, apart_s = bench.config.bench.trigger, max(places) - min(places)
    name = f"a pulse of {sized(peak_v, 'V', 3)} and {sized(fwhm_s, 's', 3)}"
    if apart_s > 2 * SLACK_SAMPLES * interval_s:
        raise InstrumentError(
            f"{name} comes {sized(min(places), 's', 4)} to {sized(max(places), 's', 4)} after its trigger: "
            f"trigger = {trigger} does not start the windows"
        )
    yield Fact(
        f"trigger by the {trigger}: {name} is in {PULSES} of {PULSES} windows, "
        f"at places {round(apart_s / interval_s)} samples apart"
    )
    late_s = float(np.mean(places)) - expected_s
    if abs(late_s) > SLACK_SAMPLES * interval_s:
        yield Fact(
            f"the pulses come {sized(abs(late_s), 's', 3)} {'later' if late_s > 0 else 'earlier'} than "
            f"[bench] trigger_delay_s = {bench.config.bench.trigger_delay_s:g} and the receiver's filter say"
        )


def _peak_s(bench: Bench, pulse: SampledPulse, request: WindowRequest, dark: RangeWindow) -> float:
    """Play a pulse and return when its largest sample comes after the first of the window, s."""
    window = bench.measure(pulse, request).window
    volts = window.volts - np.median(dark.volts)
    top, noise_v = int(np.argmax(volts)), float(np.std(dark.volts))
    if volts[top] < PULSE_FACTOR * max(noise_v, dark.volts_per_count):
        raise InstrumentError(
            f"no pulse in the window that trigger = {bench.config.bench.trigger} started: at most "
            f"{sized(float(volts[top]), 'V', 3)} at the converter, noise {sized(noise_v, 'V', 3)}; "
            "is the trigger's cable in place, is trigger_delay_s right?"
        )
    return top * window.sample_interval_s


def amplitude(window: RangeWindow, frequency_hz: float) -> float:
    """Amplitude of a sine of known frequency in a window, V at the converter, by linear least squares."""
    phase = 2 * np.pi * frequency_hz * window.sample_interval_s * np.arange(window.counts.size)
    design = np.column_stack((np.cos(phase), np.sin(phase), np.ones_like(phase)))
    cosine, sine, _ = np.linalg.lstsq(design, window.volts, rcond=None)[0]
    return float(np.hypot(cosine, sine))


def amplitude_uncertainty(dark: RangeWindow, frequency_hz: float) -> float:
    """Standard uncertainty of `amplitude` by the noise near a frequency, V.

    Parameters
    ----------
    dark : RangeWindow
        Without a signal; the noise need not be white.
    frequency_hz : float
        Where.

    Notes
    -----
    The square of the amplitude of mere noise is on average twice the variance of either component, and for a
    sine well above the noise that is the variance of its amplitude.
    """
    duration_s = dark.counts.size * dark.sample_interval_s
    near = [frequency_hz + sign * step / duration_s for step in NEIGHBOURS for sign in (-1, 1)]
    return math.sqrt(np.mean([amplitude(dark, one) ** 2 for one in near if one > 1 / duration_s]) / 2)


def declared_relative(bench: Bench, played: Sine) -> float:
    """Relative standard uncertainty of a sine's amplitude at the cut, by what the bench file declares."""
    declared = bench.config.generator.uncertainty
    return math.hypot(
        declared.amplitude_relative,
        declared.amplitude_v / (played.amplitude_vpp * bench.setting_per_cut_volt),
        declared.flatness_relative * played.frequency_hz / 40e6,
        declared.attenuation_db * math.log(10) / 20,
    )


def _text(one: Estimate) -> str:
    from belahil.report.tables import one_text

    return one_text(one.as_json())
