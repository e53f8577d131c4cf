"""The text of a new bench file: every key with its default and what it means."""

from __future__ import annotations

import json
from collections.abc import Iterable

from belahil.config import REPLAY
from belahil.receiver import receiver_preset

HARDWARE_SETTLE_S = 0.05

_BENCH = """\
# A bench for belahil. Any table and any key may be left out and then has the value of the emulated bench,
# which `belahil bench new --no-search` writes.

[bench]
trigger = "generator"        # who starts the window of a pulse: generator | digitizer
trigger_delay_s = 0.0        # from that trigger to the window, or to the generator's output
settle_s = {settle_s:<18}# wait after each change of stimulus or gain code; real generators need some 0.05

[generator]
driver = {driver}   # `belahil bench show` lists them
address = {address}         # emulated | simulated | a VISA resource name
visa_library = {visa_library}            # empty: PyVISA chooses
load_ohm = {load_ohm}                # the generator's load setting; inf is allowed
attenuation_db = {attenuation_db}         # matched 50-ohm pad between generator and cut
max_vpp = {max_vpp}                # interlock: largest span at the cut, offset included
bandwidth_hz = inf           # of the output, one pole, where it was measured; inf takes it for unfiltered
# Declared standard uncertainties, taken into every budget: of the amplitude (relative, and in V peak to peak
# of the setting), of its change between DC and 40 MHz, of the attenuator, and of the bandwidth (relative).
uncertainty = {{ amplitude_relative = 0.0, amplitude_v = 0.0, flatness_relative = 0.0, attenuation_db = 0.0, \
bandwidth_relative = 0.0 }}

[digitizer]
driver = {digitizer}
link = {link}     # emulated:serial | emulated:usb | simulated | serial:COM3
                             # serial:///dev/ttyUSB0?baud=921600 | socket://host:port | usb:VID:PID[:SERIAL]
                             # of an oscilloscope: emulated:visa | simulated | visa:RESOURCE
receiver = {receiver}        # preset of the design
input_ohm = 50               # inf is allowed
# full_scale_v = 0.512       # of an oscilloscope, the span of all its codes; the preset's when left out
# sample_rate_hz = 100e6     # of an oscilloscope; the preset's when left out
"""

_EMULATION = """
# The truth that the emulation hides. A procedure never reads it: it measures.
[emulation]
seed = 1

[emulation.generator]        # bits and sample_rate_hz: those of the driver's model when left out
amplitude_error = 0.0        # relative
flatness = 0.0               # relative change of the amplitude from DC to 40 MHz, linear in frequency
bandwidth_hz = inf

[emulation.receiver]
cutoff_hz = {cutoff_hz}
order = {order}
highpass_hz = 0.0            # 0: none
# V/V from the cut to the converter, by gain code, mean of the two converters
gain_by_code = [{gain_by_code}]
# rms at the converter before quantization, coloured by the receiver's filter
noise_rms_v_by_code = [{noise_by_code}]
small_signal = {{ cubic_per_v2 = 0.0, deadband_v = 0.0 }}   # on the filtered voltage at the cut
adc_full_scale_v = {full_scale_v}       # the whole span; clips at both ends
adc_bits = {bits}
clock_ppm = 0.0              # above zero: the receiver's clock is fast
interleave = {{ gain = 0.0, offset_v = 0.0, skew_s = 0.0 }}   # even samples plus half, odd minus half
# a damped sine at the cut with each shot pulse
emc_burst = {{ amplitude_v = 0.0, frequency_hz = 8e6, decay_s = 0.5e-6, delay_s = 2e-6 }}
input_ohm = 50

[emulation.transmitter]      # the laser's own pulse through the fibre, at the cut (assumed)
pulse = "tailed"             # gaussian | tailed | table
fwhm_s = 5.4e-9
tail_s = 3.0e-9
table = ""                   # file of time_s, relative power
threshold = 0.17
cut = "hard"                 # hard | soft
cut_width = 0.0              # part of the peak
peak_v = 20e-3               # before the receiver's filter
energy_jitter = 0.014
delay_s = 500e-9             # from the receiver's shot pulse to the light at the cut
jitter_s = 0.0               # of that, from shot to shot
"""

_LIMITS = """
# With this table a run has a verdict: pass, fail or undecided.
# [limits]
# gain = [4.9, 5.5]              # V/V, at every gain code that is measured
# cutoff_hz = [18.0e6, 20.0e6]
# highpass_hz = [0.0, 20.0e3]
# noise_rms_v = [0.0, 1.0e-3]
# input_noise_rms_v = [0.0, 0.2e-3]
# enob = [8.0, 12.0]            # of the digitizer test, and sinad_db
"""


def bench_file(
    driver: str,
    address: str,
    link: str,
    receiver: str,
    *,
    digitizer: str = "grm",
    visa_library: str = "",
    load_ohm: float = 50.0,
    attenuation_db: float = 0.0,
    max_vpp: float = 0.5,
) -> str:
    """Write a bench file with comments; the emulation's tables only where they are read.

    Parameters
    ----------
    driver, address, visa_library : str
        As in ``[generator]``.
    link, receiver, digitizer : str
        As in ``[digitizer]``; the last is its driver.
    load_ohm, attenuation_db, max_vpp : float
        As in ``[generator]``.

    Raises
    ------
    ConfigError
        No such receiver.
    """
    spec = receiver_preset(receiver)
    words = {
        "driver": driver,
        "address": address,
        "visa_library": visa_library,
        "digitizer": digitizer,
        "link": link,
        "receiver": receiver,
    }
    numbers = {"load_ohm": load_ohm, "attenuation_db": attenuation_db, "max_vpp": max_vpp}
    is_software = address in ("emulated", "simulated")
    numbers["settle_s"] = 0.0 if is_software or address.startswith(REPLAY) else HARDWARE_SETTLE_S
    text = _BENCH.format(**{key: json.dumps(word) for key, word in words.items()}, **numbers)
    if is_software:
        emulation = _EMULATION.format(
            cutoff_hz=f"{spec.cutoff_hz:.6g}",
            order=spec.order,
            gain_by_code=_row(spec.gain_by_code),
            noise_by_code=_row(spec.noise_rms_v_by_code),
            full_scale_v=spec.adc_full_scale_v,
            bits=spec.digitizer.bits,
        )
        # An oscilloscope's converter is no part of the receiver.
        text += emulation if digitizer == "grm" else emulation.replace("\nadc_", "\n# adc_")
    return text + _LIMITS


def _row(numbers: Iterable[float]) -> str:
    return ", ".join(repr(number) for number in numbers)
