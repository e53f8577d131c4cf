"""What ``belahil bench show`` prints."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from belahil.generators import FAMILIES, MODELS
from belahil.oscilloscopes import SCOPES
from belahil.receiver import RECEIVERS
from belahil.report.tables import span_text
from belahil.uncertainty import sized

if TYPE_CHECKING:
    from belahil.config import BenchConfig
    from belahil.generators import GeneratorModel
    from belahil.receiver import ReceiverSpec

LINKS = (
    ("emulated:serial", "the emulated receiver behind pyserial"),
    ("emulated:usb", "the emulated receiver behind pyusb"),
    ("emulated:visa", "an emulated oscilloscope behind PyVISA"),
    ("simulated", "the receiver's model without any link"),
    ("serial:COM3", "a serial port; serial:///dev/ttyUSB0?baud=921600 sets the rate too"),
    ("socket://host:port", "a serial line over TCP"),
    ("usb:VID:PID[:SERIAL]", "USB bulk, numbers in hexadecimal"),
    ("visa:RESOURCE", "an oscilloscope, by its VISA resource name"),
    ("replay:FILE", "a recording of the links, with [generator] address = the same"),
)


def catalogue() -> str:
    """List generator drivers with their models, receivers and links."""
    lines = ["generators ([generator] driver):"]
    for family, names in FAMILIES.items():
        lines.append(f"  {family}")
        lines += [f"    {_generator(MODELS[name])}" for name in names]
    lines += ["digitizers ([digitizer] driver):", "  grm: the GRM link, docs/grm-link.md"]
    lines += [f"  {driver}: an oscilloscope at the receiver's analog output" for driver in SCOPES]
    lines += ["receivers ([digitizer] receiver):", *(f"  {_receiver(spec)}" for spec in RECEIVERS.values())]
    lines += ["links ([digitizer] link):", *(f"  {link}: {what}" for link, what in LINKS)]
    return "\n".join(lines)


def _generator(model: GeneratorModel) -> str:
    """Say what a model can do, and what a reset leaves it with where that is no 50 ohm."""
    told = (
        f"{model.name}: sine up to {sized(model.max_sine_hz, 'Hz')}, "
        f"waveforms of {model.min_points} to {model.max_points} points "
        f"at up to {sized(model.max_arb_rate_hz, 'Sa/s')}, {model.dac_bits} bit, "
        f"{sized(model.min_amplitude_vpp, 'Vpp')} to {sized(2 * model.max_peak_v, 'Vpp')} into 50 ohm"
    )
    told += "".join(f", {vpp:g} Vpp above {sized(hertz, 'Hz')}" for hertz, vpp in model.vpp_above_hz)
    if model.arb_played_by == "frequency":
        told += f", waveforms by their frequency, up to {sized(model.max_arb_hz, 'Hz')}"
    if not model.max_delay_s:
        told += ", no trigger delay"
    if math.isinf(model.after_reset.load_ohm):
        told += ", set to high impedance by a reset"
    return told


def _output(bandwidth_hz: float) -> str:
    return "" if math.isinf(bandwidth_hz) else f", output of {bandwidth_hz / 1e6:g} MHz"


def described(config: BenchConfig) -> str:
    """Say what one bench is."""
    generator, digitizer = config.generator, config.digitizer
    lines = [
        f"{config.source} bench",
        f"generator: {generator.driver} at {generator.address}, set to {generator.load_ohm:g} ohm, "
        f"{generator.attenuation_db:g} dB to the cut, at most {generator.max_vpp:g} Vpp there"
        + _output(generator.bandwidth_hz),
        f"digitizer: {digitizer.driver} at {digitizer.link}, {digitizer.input_ohm:g} ohm",
        f"receiver: {_known_of(config)}",
        f"trigger: {config.bench.trigger}",
    ]
    limits = config.limits
    if limits is None:
        return "\n".join([*lines, "limits: none, so that a run has no verdict"])
    spans = {key: getattr(limits, key) for key in limits.__struct_fields__}
    told = ", ".join(f"{key} {span_text(key, *span)}" for key, span in spans.items() if span is not None)
    return "\n".join([*lines, f"limits: {told}"])


def _known_of(config: BenchConfig) -> str:
    """Say what the preset is: of a real receiver nothing is known before it answers."""
    preset = _receiver(RECEIVERS[config.digitizer.receiver])
    if config.source == "hardware":
        return f"tells its converters when it is asked (bench check); to compare with, the preset {preset}"
    return preset


def _receiver(spec: ReceiverSpec) -> str:
    digitizer = spec.digitizer
    codes = len(digitizer.gain_codes or ())
    return (
        f"{spec.name}: {digitizer.converters} converter{'s' if digitizer.converters > 1 else ''} of "
        f"{digitizer.bits} bit at {sized(digitizer.sample_rate_hz, 'Sa/s')} in all, windows of up to "
        f"{digitizer.max_sample_count} samples, "
        f"{codes or 'no'} gain codes, order {spec.order}, cut-off {sized(spec.cutoff_hz, 'Hz')}"
    )
