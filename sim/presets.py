"""Lasers and detectors by name, the three thermal sets, and where each number comes from.

Sources
-------
- *paper*: Nishiyama et al., "Prospects for Mercury Observations with the BepiColombo Laser Altimeter (BELA)";
  its table 1 holds the parameters of the instrument.
- *derived*: follows from printed numbers; the text says how.
- *assumed*: no published number was found; the text gives the range that seems possible.

Miller check. The paper prints n = 0.103624, M(320 V) = 48.4 and M(370 V) = 113. No single breakdown voltage
gives both gains: 391.43 V gives 48.4 and 171.9, and 403.14 V gives 42.3 and 113. The preset keeps the nominal
pair, 320 V and 48.4; the difference would be 5 K of photodiode temperature.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import msgspec

from belahil.errors import ConfigError
from sim.scene_tables import Detector, Laser

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim.scene_tables import Thermal


Preset = TypeVar("Preset", Laser, Detector)


@dataclass(frozen=True, slots=True)
class Source:
    """Where a number comes from.

    Parameters
    ----------
    text : str
        Author and place, or the reason.
    assumed : bool
        No published number was found.
    """

    text: str
    assumed: bool = False


@dataclass(frozen=True, slots=True)
class ThermalSet:
    """How a temperature of the laser head changes a laser.

    Parameters
    ----------
    fwhm, tail, divergence : float
        Factors.
    pointing_rad : tuple of float
        Added to the pointing.
    """

    fwhm: float = 1.0
    tail: float = 1.0
    divergence: float = 1.0
    pointing_rad: tuple[float, float] = (0.0, 0.0)


# Althaus et al. (2019) measured the three; their numbers are not public. Assumed, so that the digitized
# pulse changes by 2 mV at most (paper, appendix A) while its peak moves.
THERMAL: Mapping[Thermal, ThermalSet] = {
    "cold": ThermalSet(fwhm=0.95, tail=0.90, divergence=0.97, pointing_rad=(-5e-6, 0.0)),
    "ambient": ThermalSet(),
    "hot": ThermalSet(fwhm=1.05, tail=1.15, divergence=1.03, pointing_rad=(5e-6, 0.0)),
}
THERMAL_SOURCE = Source("three named scalings; the measured ones (Althaus et al. 2019) are not public", True)

# Gaussian pulse and beam as in the models before the paper, with a gain 25 % above its 48.4.
LASERS: Mapping[str, Laser] = {
    "bela": Laser(),
    "gala-like": Laser(
        preset="gala-like", energy_j=17e-3, pulse="gaussian", fwhm_s=5.5e-9, divergence_rad=100e-6
    ),
    "previous-model": Laser(preset="previous-model", pulse="gaussian"),
}
DETECTORS: Mapping[str, Detector] = {
    "bela": Detector(),
    "gala-like": Detector(preset="gala-like", telescope_radius_m=0.125, field_of_view_rad=225e-6),
    "previous-model": Detector(preset="previous-model", multiplication=1.25 * 48.4),
}

_TABLE_1 = Source("paper, table 1")
_NADIR = Source("aligned with nadir")
_OFF = Source("off")

_BELA_LASER: dict[str, Source] = {
    "energy_j": _TABLE_1,
    "wavelength_m": _TABLE_1,
    "pulse": Source("paper: narrow rise, long decay tail; the form is assumed", True),
    "fwhm_s": Source("3 to 8 ns is possible; sister instruments have 5.5 to 6 ns", True),
    "tail_s": Source("0 to 10 ns is possible", True),
    "beam": Source("paper: neither Gaussian nor axisymmetric, no numbers; Gaussian is assumed", True),
    "image_pixel_rad": Source("scale of an image that does not tell", True),
    "divergence_rad": Source("derived: footprints of 20 m at 400 km and 70 m at 1400 km (paper)"),
    "ellipticity": Source("for an elliptical beam", True),
    "beam_azimuth_deg": Source("for an elliptical beam", True),
    "pointing_rad": _NADIR,
    "jitter_rad": Source("0.5 to 2 urad is possible", True),
    "energy_jitter": Source("paper, citing Althaus et al. 2019: less than 1.4 %"),
}
_BELA_DETECTOR: dict[str, Source] = {
    "telescope_radius_m": _TABLE_1,
    "field_of_view_rad": _TABLE_1,
    "boresight_rad": _NADIR,
    "optical_efficiency": _TABLE_1,
    "filter_transmission": _TABLE_1,
    "filter_width_m": _TABLE_1,
    "quantum_efficiency": _TABLE_1,
    "bias_v": Source("paper, pulse reception: nominal bias"),
    "breakdown_v": Source(
        "derived: gives M = 48.4 at 320 V with the printed exponent; 20 C is assumed", True
    ),
    "breakdown_v_per_k": Source("2.0 to 2.6 V/K is usual for silicon", True),
    "breakdown_reference_c": Source("where breakdown_v holds", True),
    "apd_temperature_c": Source("no temperature is printed", True),
    "miller_exponent": Source("paper, pulse reception"),
    "excess_noise_exponent": Source("0.2 to 0.5 is usual for silicon", True),
    "surface_dark_a": Source("part of the receiver's dark noise", True),
    "bulk_dark_a": Source("part of the receiver's dark noise", True),
    "feedback_ohm": Source("derived from the paper's energy calibration, 43.7 to 46.1 kohm"),
    "tia_bandwidth_hz": _TABLE_1,
    "tia_pole_hz": _OFF,
}
_GALA = Source("Hussmann et al. 2019")
_GALA_ASSUMED = Source("GALA-like; not found in print", True)
_FORMER = Source("paper: earlier models took Gaussian shapes")

LASER_SOURCES: Mapping[str, Mapping[str, Source]] = {
    "bela": _BELA_LASER,
    "gala-like": _BELA_LASER
    | dict.fromkeys(("wavelength_m", "fwhm_s"), _GALA)
    | {"divergence_rad": Source("derived: footprint of 50 m at 500 km (Hussmann et al. 2019)")}
    | dict.fromkeys(("energy_j", "pulse", "beam", "energy_jitter"), _GALA_ASSUMED),
    "previous-model": _BELA_LASER | dict.fromkeys(("pulse", "beam"), _FORMER),
}
DETECTOR_SOURCES: Mapping[str, Mapping[str, Source]] = {
    "bela": _BELA_DETECTOR,
    "gala-like": dict.fromkeys(_BELA_DETECTOR, _GALA_ASSUMED)
    | {"boresight_rad": _NADIR, "tia_pole_hz": _OFF},
    "previous-model": _BELA_DETECTOR
    | {"multiplication": Source("paper: earlier models had a gain 25 % above 48.4")},
}


_GRM_CODE_4 = Source("paper, table 1 and appendix C: gain code 4")
_HUETTIG = Source("Huettig et al. 2024")
RECEIVER_SOURCES: Mapping[str, Mapping[str, Source]] = {
    "bela-grm": {
        "cutoff_hz": Source("paper, appendix C"),
        "order": Source("paper, appendix C"),
        "highpass_hz": Source("0 to 100 kHz is possible; the paper's energy calibration allows 10 kHz", True),
        "gain": Source("1.5 dB a code from the known 5.19 at gain code 4", True),
        "gain_at_code_4": _GRM_CODE_4,
        "sample_interval_s": _TABLE_1,
        "adc_bits": _HUETTIG,
        "adc_full_scale_v": Source("1.04 to 4 V is possible", True),
        "window_samples": Source("paper, pulse reception"),
        "correlation_window_samples": Source("paper; Huettig et al. 2024 have 64"),
        "candidates": _HUETTIG,
    },
    "gala-like": dict.fromkeys(
        ("cutoff_hz", "order", "highpass_hz", "gain", "adc_full_scale_v", "window_samples"), _GALA_ASSUMED
    )
    | {"gain_at_code_4": _GALA_ASSUMED, "sample_interval_s": _GALA}
    | dict.fromkeys(("adc_bits", "correlation_window_samples", "candidates"), _HUETTIG),
}


def laser_preset(name: str = "bela", thermal: Thermal = "ambient", **given: Any) -> Laser:
    """Return a laser by name at a temperature, with the given keys in place of its own.

    Parameters
    ----------
    name : str
        One of `LASERS`.
    thermal : {"cold", "ambient", "hot"}
        One of `THERMAL`; it acts on the preset, not on what is given.
    **given
        Keys of `Laser`; not checked here.

    Raises
    ------
    ConfigError
        No such preset.
    """
    laser, change = _named(LASERS, name, "laser"), THERMAL[thermal]
    changed = msgspec.structs.replace(
        laser,
        thermal=thermal,
        fwhm_s=laser.fwhm_s * change.fwhm,
        tail_s=laser.tail_s * change.tail,
        divergence_rad=laser.divergence_rad * change.divergence,
        pointing_rad=(
            laser.pointing_rad[0] + change.pointing_rad[0],
            laser.pointing_rad[1] + change.pointing_rad[1],
        ),
    )
    return msgspec.structs.replace(changed, **given)


def detector_preset(name: str = "bela", **given: Any) -> Detector:
    """Return a detector by name, with the given keys in place of its own.

    Raises
    ------
    ConfigError
        No such preset.
    """
    return msgspec.structs.replace(_named(DETECTORS, name, "detector"), **given)


def _named(presets: Mapping[str, Preset], name: str, table: str) -> Preset:
    if name not in presets:
        raise ConfigError(f'[{table}] preset = "{name}" is unknown; allowed: {", ".join(presets)}')
    return presets[name]
