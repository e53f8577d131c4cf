"""Bench files: TOML, strictly checked; every table and key may be left out.

`BenchConfig` is what the file says; `belahil.receiver_truth` makes numbers without gaps of its
``[emulation.receiver]``, which only the emulation may read.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

from msgspec import Meta, field
from msgspec.structs import replace

from belahil import strict_toml
from belahil.errors import ConfigError, RefusedInput
from belahil.generators import DEFAULT_MODEL, FAMILIES, MODELS
from belahil.oscilloscopes import SCOPES, check_scope
from belahil.receiver import ReceiverSpec, receiver_preset
from belahil.strict_toml import NotNegative, Positive, Strict

Span = tuple[float, float]

REPLAY = "replay:"
"""What stands before the name of a recording where an address or a link is expected."""


class BenchTable(Strict, frozen=True):
    """``[bench]``: who triggers, and when."""

    trigger: Literal["generator", "digitizer"] = "generator"
    trigger_delay_s: NotNegative = 0.0
    settle_s: NotNegative = 0.0


class GeneratorUncertainty(Strict, frozen=True):
    """``[generator] uncertainty``: declared standard uncertainties, taken into every budget.

    `amplitude_v` is volts peak to peak of the generator's setting; `flatness_relative` is the relative
    change of amplitude between DC and 40 MHz, linear in frequency; `bandwidth_relative` is that of
    ``bandwidth_hz``.
    """

    amplitude_relative: NotNegative = 0.0
    amplitude_v: NotNegative = 0.0
    flatness_relative: NotNegative = 0.0
    attenuation_db: NotNegative = 0.0
    bandwidth_relative: NotNegative = 0.0


class GeneratorTable(Strict, frozen=True):
    """``[generator]``."""

    driver: str = "keysight-33500"
    address: str = "emulated"
    visa_library: str = ""
    load_ohm: Positive = 50.0
    attenuation_db: Annotated[float, Meta(ge=0, le=200)] = 0.0
    max_vpp: Positive = 0.5
    bandwidth_hz: Positive = math.inf  # not known: what is played is taken for unfiltered
    uncertainty: GeneratorUncertainty = GeneratorUncertainty()


class DigitizerTable(Strict, frozen=True):
    """``[digitizer]``."""

    driver: str = "grm"
    link: str = "emulated:serial"
    receiver: str = "bela-grm"
    input_ohm: Positive = 50.0
    full_scale_v: Annotated[float, Meta(ge=1e-3, le=1e3)] | None = None  # of an oscilloscope, as is the next
    sample_rate_hz: Positive | None = None


class EmulatedGenerator(Strict, frozen=True):
    """``[emulation.generator]``: what the generator hides."""

    bits: Annotated[int, Meta(ge=2, le=16)] | None = None
    sample_rate_hz: Positive | None = None
    amplitude_error: float = 0.0
    flatness: float = 0.0
    bandwidth_hz: Positive = math.inf


class SmallSignal(Strict, frozen=True):
    """``small_signal``: a dead zone, then ``u + cubic u^3``, on the filtered input-referred voltage u."""

    cubic_per_v2: float = 0.0
    deadband_v: NotNegative = 0.0


class Interleave(Strict, frozen=True):
    """``interleave``: even samples plus half of each, odd samples minus half."""

    gain: float = 0.0
    offset_v: float = 0.0
    skew_s: float = 0.0


class EmcBurst(Strict, frozen=True):
    """``emc_burst``: a damped sine at the cut with each shot pulse of the receiver (all but 0 V assumed).

    `delay_s` is from the shot pulse to its beginning.
    """

    amplitude_v: float = 0.0
    frequency_hz: Annotated[float, Meta(ge=1e3, le=1e9)] = 8e6
    decay_s: Annotated[float, Meta(ge=1e-9, le=1e-3)] = 0.5e-6
    delay_s: NotNegative = 2e-6


class EmulatedReceiver(Strict, frozen=True):
    """``[emulation.receiver]``: the receiver to be found; None means the preset's value."""

    cutoff_hz: Positive | None = None
    order: Annotated[int, Meta(ge=1, le=6)] | None = None
    highpass_hz: NotNegative = 0.0
    gain_by_code: tuple[Positive, ...] | None = None
    noise_rms_v_by_code: tuple[NotNegative, ...] | None = None
    small_signal: SmallSignal = SmallSignal()
    adc_full_scale_v: Annotated[float, Meta(ge=1e-3, le=1e3)] | None = None  # what the GRM link allows
    adc_bits: Annotated[int, Meta(ge=2, le=16)] | None = None
    clock_ppm: Annotated[float, Meta(ge=-250, le=250)] = 0.0
    interleave: Interleave = Interleave()
    emc_burst: EmcBurst = EmcBurst()
    input_ohm: Positive = 50.0


class EmulatedTransmitter(Strict, frozen=True):
    """``[emulation.transmitter]``: the laser's own pulse as it reaches the cut (all defaults assumed).

    `delay_s` is from the receiver's shot pulse to the centre of the Gaussian, or to time 0 of the table.
    """

    pulse: Literal["gaussian", "tailed", "table"] = "tailed"
    fwhm_s: Annotated[float, Meta(ge=1e-12, le=1e-3)] = 5.4e-9
    tail_s: Annotated[float, Meta(gt=0, le=1e-3)] = 3.0e-9
    table: str = ""
    threshold: Annotated[float, Meta(ge=0, le=0.99)] = 0.17
    cut: Literal["hard", "soft"] = "hard"
    cut_width: NotNegative = 0.0
    peak_v: Positive = 20e-3
    energy_jitter: Annotated[float, Meta(ge=0, le=0.1)] = 0.014
    delay_s: NotNegative = 500e-9  # so that a correlation window fits before and after the pulse
    jitter_s: NotNegative = 0.0


class EmulationTable(Strict, frozen=True):
    """``[emulation]``: the hidden truth, read only by the emulation."""

    seed: Annotated[int, Meta(ge=0)] = 1
    generator: EmulatedGenerator = EmulatedGenerator()
    receiver: EmulatedReceiver = EmulatedReceiver()
    transmitter: EmulatedTransmitter = EmulatedTransmitter()


class LimitsTable(Strict, frozen=True):
    """``[limits]``: low and high of what must hold at every gain code that was measured."""

    gain: Span | None = None
    cutoff_hz: Span | None = None
    highpass_hz: Span | None = None
    noise_rms_v: Span | None = None
    input_noise_rms_v: Span | None = None
    enob: Span | None = None
    sinad_db: Span | None = None
    reduced_chi_square: Span | None = None


class BenchConfig(Strict, frozen=True):
    """A whole bench file."""

    bench: BenchTable = BenchTable()
    generator: GeneratorTable = GeneratorTable()
    digitizer: DigitizerTable = DigitizerTable()
    emulation: EmulationTable = field(default_factory=EmulationTable)
    limits: LimitsTable | None = None

    @property
    def source(self) -> Source:
        """What kind of bench this is, from address and link.

        Raises
        ------
        ConfigError
            When one part is emulated or simulated and the other is not the same.
        """
        kinds = {_kind(self.generator.address), _kind(self.digitizer.link)}
        if len(kinds) != 1:
            raise ConfigError(
                f'address = "{self.generator.address}" with link = "{self.digitizer.link}": both must be '
                "emulated, both simulated, or both real; or one recording for both"
            )
        (kind,) = kinds
        return kind


Source = Literal["simulated", "emulated", "hardware", "replay"]


def _kind(place: str) -> Source:
    if place == "simulated":
        return "simulated"
    if place.startswith(REPLAY):
        return "replay"
    return "emulated" if place.split(":", 1)[0] == "emulated" else "hardware"


def emulated() -> BenchConfig:
    """Return the bench of ``--bench emulated``: every key at its default."""
    return BenchConfig()


def simulated() -> BenchConfig:
    """Return the bench of ``--bench simulated``: the same, without any link."""
    return BenchConfig(
        generator=GeneratorTable(address="simulated"), digitizer=DigitizerTable(link="simulated")
    )


def load_bench(name: str) -> BenchConfig:
    """Read ``--bench``: a file, ``emulated``, ``simulated`` or ``replay:FILE``.

    Raises
    ------
    ConfigError
        The file is not there, or says something that is not allowed.
    StorageError
        A recording is damaged where it tells of its bench.
    """
    if name == "emulated":
        return emulated()
    if name == "simulated":
        return simulated()
    if name.startswith(REPLAY):
        from belahil.recording import read_session

        return read_session(name.removeprefix(REPLAY)).config
    return parse_bench(strict_toml.read(name, "bench file"), name)


def seeded(config: BenchConfig, seed: int, option: str = "--seed") -> BenchConfig:
    """Return a bench with another seed of the emulation; `option` is what the user typed.

    Raises
    ------
    RefusedInput
        The seed is negative, or not that of a recording.
    """
    if seed < 0:
        raise RefusedInput(f"{option} {seed}: must not be negative")
    if config.source == "replay" and seed != config.emulation.seed:
        raise RefusedInput(f"{option} {seed}: a recording keeps its own seed; leave it out")
    return replace(config, emulation=replace(config.emulation, seed=seed))


def parse_bench(text: str, name: str = "bench file") -> BenchConfig:
    """Read a bench file from its text and check it whole.

    Parameters
    ----------
    text : str
        TOML.
    name : str
        How to call it in messages.

    Raises
    ------
    ConfigError
        One line: where, what was found, what is allowed.
    """
    config = strict_toml.typed(strict_toml.parse(text, name), BenchConfig, name)
    with strict_toml.about(name):
        check_bench(config)
    return config


def check_bench(config: BenchConfig) -> None:
    """Check what a type cannot say.

    Raises
    ------
    ConfigError
        With the key and what is allowed.
    """
    if config.generator.driver not in FAMILIES:
        raise ConfigError(
            f'[generator] driver = "{config.generator.driver}" is unknown; allowed: {", ".join(FAMILIES)}'
        )
    load_ohm = config.generator.load_ohm
    least, most = MODELS[DEFAULT_MODEL[config.generator.driver]].load_span_ohm
    if not (least <= load_ohm <= most or math.isinf(load_ohm) or math.isnan(load_ohm)):
        raise ConfigError(f"[generator] load_ohm = {load_ohm:g}: allowed: {least:g} to {most:g} ohm, or inf")
    spec = receiver_preset(config.digitizer.receiver)
    _check_digitizer(config, spec)
    if config.source == "replay" and config.generator.address != config.digitizer.link:
        raise ConfigError(
            f'address = "{config.generator.address}" with link = "{config.digitizer.link}": '
            "one recording serves both"
        )
    check_by_code(config.emulation.receiver, spec, "emulation.receiver")
    for where, numbers in strict_toml.numbers(config):
        table, _, key = where.rpartition(".")
        if any(math.isnan(number) for number in numbers):
            raise ConfigError(f"[{table}] {key} is not a number")
        if key not in _MAY_BE_INFINITE and table != "limits" and any(map(math.isinf, numbers)):
            raise ConfigError(f"[{table}] {key} is infinite: must be finite")
    if config.limits is not None:
        for key in config.limits.__struct_fields__:
            span = getattr(config.limits, key)
            if span is not None and not span[0] <= span[1]:
                raise ConfigError(f"[limits] {key} = [{span[0]:g}, {span[1]:g}]: low must not exceed high")


def _check_digitizer(config: BenchConfig, spec: ReceiverSpec) -> None:
    table = config.digitizer
    if table.driver != "grm" and table.driver not in SCOPES:
        raise ConfigError(
            f'[digitizer] driver = "{table.driver}" is unknown; allowed: {", ".join(("grm", *SCOPES))}'
        )
    is_scope = table.driver in SCOPES
    kinds = ("emulated:visa", "simulated") if is_scope else ("emulated:serial", "emulated:usb", "simulated")
    begins = ("visa:",) if is_scope else ("serial:", "socket:", "usb:")
    more = "visa:RESOURCE" if is_scope else "serial:PORT, socket://HOST:PORT, usb:VID:PID[:SERIAL]"
    if table.link not in kinds and not table.link.startswith((REPLAY, *begins)):
        raise ConfigError(
            f'[digitizer] link = "{table.link}" is unknown; allowed: {", ".join(kinds)}, {more}'
            + (f" with driver = {table.driver}" if is_scope else "; " + _SCOPE_HINT)
        )
    if is_scope:
        check_scope(table, spec)
        if config.bench.trigger == "digitizer":
            raise ConfigError(
                f'[bench] trigger = "digitizer" with driver = {table.driver}: nothing fires from an '
                "oscilloscope's trigger output; allowed: generator"
            )
    for key in ("full_scale_v", "sample_rate_hz"):
        if not is_scope and getattr(table, key) is not None:
            raise ConfigError(f"[digitizer] {key}: only an oscilloscope takes it; driver is grm")
    for key in ("adc_full_scale_v", "adc_bits"):
        if is_scope and getattr(config.emulation.receiver, key) is not None:
            raise ConfigError(
                f"[emulation.receiver] {key}: the converter is the oscilloscope's, leave it out; "
                "[digitizer] full_scale_v sets its span"
            )


_SCOPE_HINT = "an oscilloscope needs its driver (of bench new: --digitizer) and visa:RESOURCE"
_MAY_BE_INFINITE = ("load_ohm", "input_ohm", "bandwidth_hz")


def check_by_code(receiver: EmulatedReceiver, spec: ReceiverSpec, where: str) -> None:
    """Check that lists by gain code are as long as the receiver has codes; `where` names the table.

    Raises
    ------
    ConfigError
        With both numbers.
    """
    codes = spec.digitizer.gain_codes or (0,)
    for key in ("gain_by_code", "noise_rms_v_by_code"):
        numbers = getattr(receiver, key)
        if numbers is not None and len(numbers) != len(codes):
            raise ConfigError(
                f"[{where}] {key} has {len(numbers)} numbers; {spec.name} has {len(codes)} gain codes"
            )


def as_toml(config: BenchConfig, *, without: tuple[str, ...] = ()) -> str:
    """Write a bench file that says every key but tables `without`; ``parse_bench`` gives the config back."""
    return strict_toml.as_text(config, without)


def default_model_name(config: BenchConfig) -> str:
    """Model that an emulated or simulated generator of this bench claims to be."""
    return DEFAULT_MODEL[config.generator.driver]
