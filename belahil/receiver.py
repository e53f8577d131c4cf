"""The device under test, as data: what it reports of itself, and presets with assumed defaults."""

from __future__ import annotations

from dataclasses import dataclass

from belahil.errors import ConfigError
from belahil.values import PRODUCTS, Products, Trigger


@dataclass(frozen=True, slots=True)
class DigitizerSpec:
    """What a digitizer reports of itself.

    Parameters
    ----------
    sample_rate_hz : float
        Effective rate of all interleaved converters together.
    bits : int
        Resolution of a converter.
    converters : int
        Interleaved converters; sample n belongs to converter ``n % converters``.
    max_sample_count : int
        Longest window.
    gain_codes : tuple of int or None
        Allowed gain codes; None where gain is fixed.
    triggers : tuple of str
        Trigger modes it can be armed with.
    products : tuple of str
        Products it can report.
    """

    sample_rate_hz: float
    bits: int
    converters: int
    max_sample_count: int
    gain_codes: tuple[int, ...] | None
    triggers: tuple[Trigger, ...] = ("immediate", "generator", "digitizer")
    products: tuple[Products, ...] = ("window",)

    @property
    def sample_interval_s(self) -> float:
        """Nominal time between samples, s."""
        return 1.0 / self.sample_rate_hz


@dataclass(frozen=True, slots=True)
class ReceiverSpec:
    """A receiver design: the preset that emulation starts from, and what a report compares with.

    Preset values are never limits, and no procedure uses them as measurements.

    Parameters
    ----------
    name : str
        As in ``[digitizer] receiver``.
    digitizer : DigitizerSpec
        Its converters.
    order : int
        Order of the low-pass Butterworth filter.
    cutoff_hz : float
        Its -3 dB frequency.
    gain_by_code : tuple of float
        V/V from the cut to the converter, pass band.
    noise_rms_v_by_code : tuple of float
        Noise at the converter before quantization, V rms.
    adc_full_scale_v : float
        Whole span, V.
    correlation_window_samples : int
        Samples the range finder keeps round a candidate.
    candidate_count : int
        Candidates it keeps.
    """

    name: str
    digitizer: DigitizerSpec
    order: int
    cutoff_hz: float
    gain_by_code: tuple[float, ...]
    noise_rms_v_by_code: tuple[float, ...]
    adc_full_scale_v: float
    correlation_window_samples: int
    candidate_count: int = 4


def _assumed_gain(code: int) -> float:
    # Only code 4 = 5.19 is published (Nishiyama et al., appendix C); 1.5 dB a code is assumed.
    return round(5.19 * 10 ** (1.5 * (code - 4) / 20), 4)


def _assumed_noise_v(code: int) -> float:
    # Assumed: an input part, a part after the gain and a part that grows with gain squared, equal in
    # the last two at code 4, so that input-referred noise is least there, at 0.83 mV in all.
    gain = _assumed_gain(code)
    input_v, after_v, growing_v = 0.607e-3 * gain / 5.19, 0.4e-3, 0.4e-3 * (gain / 5.19) ** 2
    return float(round((input_v**2 + after_v**2 + growing_v**2) ** 0.5, 8))


_CODES = tuple(range(16))

BELA_GRM = ReceiverSpec(
    name="bela-grm",
    digitizer=DigitizerSpec(
        sample_rate_hz=80e6,
        bits=12,
        converters=2,
        max_sample_count=16064,
        gain_codes=_CODES,
        products=PRODUCTS,
    ),
    order=3,
    cutoff_hz=19.0e6,
    gain_by_code=tuple(_assumed_gain(code) for code in _CODES),
    noise_rms_v_by_code=tuple(_assumed_noise_v(code) for code in _CODES),
    adc_full_scale_v=2.0,  # assumed: 1.04 to 4 V is possible
    correlation_window_samples=42,
)

# GALA (Hussmann et al. 2019; Huettig et al. 2024): 200 MHz, 12 bit, 64-sample windows, APD bandwidth
# 100 MHz. Filter order, window length, gain and noise are assumed: no figure is published.
GALA_LIKE = ReceiverSpec(
    name="gala-like",
    digitizer=DigitizerSpec(
        sample_rate_hz=200e6,
        bits=12,
        converters=2,
        max_sample_count=32000,
        gain_codes=_CODES,
        products=PRODUCTS,
    ),
    order=3,
    cutoff_hz=60e6,
    gain_by_code=tuple(_assumed_gain(code) for code in _CODES),
    noise_rms_v_by_code=tuple(_assumed_noise_v(code) for code in _CODES),
    adc_full_scale_v=2.0,
    correlation_window_samples=64,
)

# A receiver that ends in a connector, with an oscilloscope behind it; all its numbers are assumed: BELA's
# filter and gain code 4, more noise, and what an oscilloscope of eight bits takes of it at 10 us a division.
ANALOG = ReceiverSpec(
    name="analog",
    digitizer=DigitizerSpec(
        sample_rate_hz=100e6, bits=8, converters=1, max_sample_count=10000, gain_codes=None
    ),
    order=3,
    cutoff_hz=19.0e6,
    gain_by_code=(5.19,),
    noise_rms_v_by_code=(2e-3,),
    adc_full_scale_v=0.512,
    correlation_window_samples=42,
)

RECEIVERS = {spec.name: spec for spec in (BELA_GRM, GALA_LIKE, ANALOG)}


def receiver_preset(name: str) -> ReceiverSpec:
    """Look up a receiver by its name in a bench file.

    Raises
    ------
    ConfigError
        No such receiver.
    """
    if name not in RECEIVERS:
        raise ConfigError(f'receiver = "{name}" is unknown; allowed: {", ".join(sorted(RECEIVERS))}')
    return RECEIVERS[name]
