"""What ``belahil bench check`` does: a dark window, a sine, and whether the sine came back."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import InstrumentError
from belahil.receiver import receiver_preset
from belahil.stimuli import NoSignal, Sine
from belahil.uncertainty import sized
from belahil.values import WindowRequest

if TYPE_CHECKING:
    from collections.abc import Iterator

    from belahil.bench import Bench
    from belahil.values import RangeWindow

FREQUENCY_HZ = 1e6  # in the pass band of every receiver we know
GAIN_CODE = 4
LARGEST_VPP = 30e-3
NOISE_FACTOR = 5.0  # a sine that came back stands this far above what the dark window has at its frequency


def tried(bench: Bench) -> Iterator[str]:
    """Try a bench out and yield a line for each thing that is in order.

    Raises
    ------
    InstrumentError
        The sine did not come back, or came back clipped.
    """
    for part, identity in bench.identities.items():
        yield f"{part}: {identity}"
    codes = bench.spec.gain_codes
    code = None if codes is None else min(codes, key=lambda one: abs(one - GAIN_CODE))
    samples = bench.spec.max_sample_count
    dark = bench.measure(NoSignal(), WindowRequest(0, code, samples)).window
    setting = "" if code is None else f" at gain code {code}"
    yield f"dark window{setting}: {sized(float(np.std(dark.volts)), 'V', 3)} rms at the converter"

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
    gain = 2 * found_v / played.amplitude_vpp
    yield f"{sine} comes back: gain {gain:.3g}{_beside_preset(bench, code)}"


def amplitude(window: RangeWindow, frequency_hz: float) -> float:
    """Amplitude of a sine of known frequency in a window, V at the converter, by linear least squares."""
    phase = 2 * np.pi * frequency_hz * window.sample_interval_s * np.arange(window.counts.size)
    design = np.column_stack((np.cos(phase), np.sin(phase), np.ones_like(phase)))
    cosine, sine, _ = np.linalg.lstsq(design, window.volts, rcond=None)[0]
    return float(np.hypot(cosine, sine))


def _beside_preset(bench: Bench, code: int | None) -> str:
    preset = receiver_preset(bench.config.digitizer.receiver)
    codes = preset.digitizer.gain_codes
    if code is None or codes is None or code not in codes:
        return ""
    return f" (preset {preset.name}: {preset.gain_by_code[codes.index(code)]:.3g})"
