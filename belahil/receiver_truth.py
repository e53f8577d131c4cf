"""``[emulation.receiver]`` of a bench file, or a table like it, without gaps: only an emulation may ask."""

from __future__ import annotations

from belahil.config import BenchConfig, EmcBurst, EmulatedReceiver, Interleave, SmallSignal
from belahil.receiver import RECEIVERS, ReceiverSpec
from belahil.strict_toml import Strict


class ReceiverTruth(Strict, frozen=True):
    """``[emulation.receiver]`` without gaps, and the rates of the preset."""

    cutoff_hz: float
    order: int
    highpass_hz: float
    gain_by_code: tuple[float, ...]
    noise_rms_v_by_code: tuple[float, ...]
    small_signal: SmallSignal
    adc_full_scale_v: float
    adc_bits: int
    clock_ppm: float
    interleave: Interleave
    input_ohm: float
    emc_burst: EmcBurst = EmcBurst()


def receiver_truth(config: BenchConfig) -> ReceiverTruth:
    """Fill the gaps of ``[emulation.receiver]`` from the receiver's preset."""
    return without_gaps(config.emulation.receiver, RECEIVERS[config.digitizer.receiver])


def without_gaps(given: EmulatedReceiver, spec: ReceiverSpec) -> ReceiverTruth:
    """Fill the gaps of a table of receiver keys from a receiver's preset."""
    return ReceiverTruth(
        cutoff_hz=given.cutoff_hz or spec.cutoff_hz,
        order=given.order or spec.order,
        highpass_hz=given.highpass_hz,
        gain_by_code=given.gain_by_code or spec.gain_by_code,
        noise_rms_v_by_code=given.noise_rms_v_by_code or spec.noise_rms_v_by_code,
        small_signal=given.small_signal,
        adc_full_scale_v=given.adc_full_scale_v or spec.adc_full_scale_v,
        adc_bits=given.adc_bits or spec.digitizer.bits,
        clock_ppm=given.clock_ppm,
        interleave=given.interleave,
        emc_burst=given.emc_burst,
        input_ohm=given.input_ohm,
    )
