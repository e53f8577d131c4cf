"""Bench files: TOML, strictly checked; every table and key may be left out.

`BenchConfig` is what the file says. `receiver_truth` turns its ``[emulation]`` table, which only the
emulation may read, into numbers without gaps.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct, field

from belahil.errors import ConfigError
from belahil.generators import DEFAULT_MODEL, FAMILIES
from belahil.receiver import RECEIVERS, receiver_preset

Positive = Annotated[float, Meta(gt=0)]
NotNegative = Annotated[float, Meta(ge=0)]
Span = tuple[float, float]

LOAD_OHM = (1.0, 10e3)
"""Load settings of the 33500 and 33600 families beside high impedance (their public manuals)."""


class Strict(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=False):
    """A table that accepts only the keys it names."""


class BenchTable(Strict, frozen=True):
    """``[bench]``: who triggers, and when."""

    trigger: Literal["generator", "digitizer"] = "generator"
    trigger_delay_s: NotNegative = 0.0
    settle_s: NotNegative = 0.0


class GeneratorUncertainty(Strict, frozen=True):
    """``[generator] uncertainty``: declared standard uncertainties, taken into every budget.

    `amplitude_v` is volts peak to peak of the generator's setting; `flatness_relative` is the relative
    change of amplitude between DC and 40 MHz, linear in frequency.
    """

    amplitude_relative: NotNegative = 0.0
    amplitude_v: NotNegative = 0.0
    flatness_relative: NotNegative = 0.0
    attenuation_db: NotNegative = 0.0


class GeneratorTable(Strict, frozen=True):
    """``[generator]``."""

    driver: str = "keysight-33500"
    address: str = "emulated"
    visa_library: str = ""
    load_ohm: Positive = 50.0
    attenuation_db: Annotated[float, Meta(ge=0, le=200)] = 0.0
    max_vpp: Positive = 0.5
    uncertainty: GeneratorUncertainty = GeneratorUncertainty()


class DigitizerTable(Strict, frozen=True):
    """``[digitizer]``."""

    driver: str = "grm"
    link: str = "emulated:serial"
    receiver: str = "bela-grm"
    input_ohm: Positive = 50.0


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
    input_ohm: Positive = 50.0


class EmulatedTransmitter(Strict, frozen=True):
    """``[emulation.transmitter]``: the laser's own pulse as it reaches the cut (all defaults assumed)."""

    pulse: Literal["gaussian", "tailed", "table"] = "tailed"
    fwhm_s: Positive = 5.4e-9
    tail_s: Positive = 3.0e-9
    table: str = ""
    threshold: Annotated[float, Meta(ge=0, lt=1)] = 0.17
    cut: Literal["hard", "soft"] = "hard"
    cut_width: NotNegative = 0.0
    peak_v: Positive = 20e-3
    energy_jitter: NotNegative = 0.014


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


class BenchConfig(Strict, frozen=True):
    """A whole bench file."""

    bench: BenchTable = BenchTable()
    generator: GeneratorTable = GeneratorTable()
    digitizer: DigitizerTable = DigitizerTable()
    emulation: EmulationTable = field(default_factory=EmulationTable)
    limits: LimitsTable | None = None

    @property
    def source(self) -> Literal["simulated", "emulated", "hardware"]:
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
                "emulated, both simulated, or both real"
            )
        (kind,) = kinds
        return kind


def _kind(place: str) -> Literal["simulated", "emulated", "hardware"]:
    if place == "simulated":
        return "simulated"
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
    """Read ``--bench``: a file, ``emulated`` or ``simulated``.

    Raises
    ------
    ConfigError
        The file is not there, or says something that is not allowed.
    """
    if name == "emulated":
        return emulated()
    if name == "simulated":
        return simulated()
    if name.startswith("replay:"):
        raise ConfigError(
            f"--bench {name}: this version replays no recording; allowed: FILE, emulated, simulated"
        )
    path = Path(name)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else "not a text file"
        raise ConfigError(f"bench file {name}: cannot be read ({reason})") from error
    return parse_bench(text, name)


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
    try:
        config = msgspec.toml.decode(text.encode(), type=BenchConfig)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{name}: {_explained(str(error))}") from error
    except msgspec.DecodeError as error:
        raise ConfigError(f"{name}: not valid TOML ({error})") from error
    try:
        check_bench(config)
    except ConfigError as error:
        raise ConfigError(f"{name}: {error}") from error
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
    if not (LOAD_OHM[0] <= load_ohm <= LOAD_OHM[1] or math.isinf(load_ohm) or math.isnan(load_ohm)):
        raise ConfigError(
            f"[generator] load_ohm = {load_ohm:g}: allowed: {LOAD_OHM[0]:g} to {LOAD_OHM[1]:g} ohm, or inf"
        )
    if config.digitizer.driver != "grm":
        raise ConfigError(f'[digitizer] driver = "{config.digitizer.driver}" is unknown; allowed: grm')
    spec = receiver_preset(config.digitizer.receiver)
    link = config.digitizer.link
    kinds = ("emulated:serial", "emulated:usb", "simulated")
    if link not in kinds and not link.startswith(("serial:", "socket:", "usb:")):
        raise ConfigError(
            f'[digitizer] link = "{link}" is unknown; allowed: {", ".join(kinds)}, '
            "serial:PORT, socket://HOST:PORT, usb:VID:PID[:SERIAL]"
        )
    _ = config.source
    codes = spec.digitizer.gain_codes or (0,)
    for key in ("gain_by_code", "noise_rms_v_by_code"):
        numbers = getattr(config.emulation.receiver, key)
        if numbers is not None and len(numbers) != len(codes):
            raise ConfigError(
                f"[emulation.receiver] {key} has {len(numbers)} numbers; "
                f"{spec.name} has {len(codes)} gain codes"
            )
    for where, numbers in _floats(config):
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


_MAY_BE_INFINITE = ("load_ohm", "input_ohm", "bandwidth_hz")


def _floats(table: Any, where: str = "") -> list[tuple[str, tuple[float, ...]]]:
    found: list[tuple[str, tuple[float, ...]]] = []
    for key in table.__struct_fields__:
        value = getattr(table, key)
        if isinstance(value, Struct):
            found += _floats(value, f"{where}{key}.")
        elif isinstance(value, float):
            found.append((where + key, (value,)))
        elif isinstance(value, tuple):
            found.append((where + key, value))
    return found


_UNKNOWN = re.compile(r"Object contains unknown field `(?P<key>[^`]*)`(?: - at `\$\.?(?P<path>[^`]*)`)?")
_AT = re.compile(r"^(?P<what>.*?)(?: - at `\$\.?(?P<path>[^`]*)`)?$")


def _explained(message: str) -> str:
    unknown = _UNKNOWN.fullmatch(message)
    if unknown:
        path = unknown["path"] or ""
        allowed = ", ".join(_fields_at(path))
        place = f"[{path}] has an" if path else "there is an"
        return f"{place} unknown key `{unknown['key']}`; allowed: {allowed}"
    known = _AT.fullmatch(message)
    if known and known["path"]:
        table, _, key = known["path"].rpartition(".")
        return f"{f'[{table}] ' if table else ''}{key}: {known['what'][0].lower()}{known['what'][1:]}"
    return message


def _fields_at(path: str) -> tuple[str, ...]:
    table: Any = BenchConfig
    for key in filter(None, re.sub(r"\[[^]]*\]", "", path).split(".")):
        annotation = {field.name: field.type for field in msgspec.structs.fields(table)}[key]
        choices = getattr(annotation, "__args__", ()) or (annotation,)
        table = next(choice for choice in choices if isinstance(choice, type) and issubclass(choice, Struct))
    return tuple(field.name for field in msgspec.structs.fields(table))


def as_toml(config: BenchConfig) -> str:
    """Write a bench file that says every key; ``parse_bench`` gives the same config back."""
    import tomli_w

    return tomli_w.dumps(_without_none(msgspec.to_builtins(config)))


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    if isinstance(value, list | tuple):
        return [_without_none(item) for item in value]
    return value


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


def receiver_truth(config: BenchConfig) -> ReceiverTruth:
    """Fill the gaps of ``[emulation.receiver]`` from the receiver's preset."""
    given = config.emulation.receiver
    spec = RECEIVERS[config.digitizer.receiver]
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
        input_ohm=given.input_ohm,
    )


def default_model_name(config: BenchConfig) -> str:
    """Model that an emulated or simulated generator of this bench claims to be."""
    return DEFAULT_MODEL[config.generator.driver]
