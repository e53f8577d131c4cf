"""Limits and grids of the generator models, by family; the sources are in docs/instruments.md."""

from __future__ import annotations

import math

from belahil.errors import LimitExceeded
from belahil.generator_models import AfterReset, GeneratorModel

# Frequencies, amplitudes and memory as in the vendors' public manuals; amplitude digits, delay grid and
# the 33600A's sample rate (summaries disagree between 660 MSa/s and 1 GSa/s) are assumed.
_MODELS_33500 = tuple(
    GeneratorModel(name, "Agilent Technologies", hz, 250e6, 16, 1_000_000, channels=channels)
    for name, hz, channels in (
        ("33509B", 20e6, 1),
        ("33510B", 20e6, 2),
        ("33511B", 20e6, 1),
        ("33512B", 20e6, 2),
        ("33519B", 30e6, 1),
        ("33520B", 30e6, 2),
        ("33521B", 30e6, 1),
        ("33522B", 30e6, 2),
    )
)
_MODELS_33600 = tuple(
    GeneratorModel(name, "Keysight Technologies", hz, rate, 14, 4_000_000, channels=channels)
    for name, hz, rate, channels in (
        ("33611A", 80e6, 660e6, 1),
        ("33612A", 80e6, 660e6, 2),
        ("33621A", 120e6, 1e9, 1),
        ("33622A", 120e6, 1e9, 2),
    )
)
# The 33220A as in its public manual where docs/instruments.md says so; the rest is assumed there.
_MODELS_33220 = (
    GeneratorModel(
        "33220A",
        "Agilent Technologies",
        20e6,
        50e6,
        14,
        65_536,
        min_amplitude_vpp=10e-3,
        min_points=2,
        max_delay_s=0.0,
        channels=1,
        arb_played_by="frequency",
        max_arb_hz=6e6,
        full_code=8191,
        interpolations=("linear",),
        conflict_code=-222,
    ),
)
# The DG1000Z as in its public programming guide where docs/instruments.md says so; the rest is assumed there.
_MODELS_RIGOL = tuple(
    GeneratorModel(
        name,
        "Rigol Technologies",
        hz,
        60e6,
        14,
        16_384,
        vpp_above_hz=((10e6, 5.0), (30e6, 2.5)),
        max_delay_s=100.0,
        full_code=8191,
        interpolations=("linear",),
        rest_before_on_s=0.1,
        after_reset=AfterReset(1e3, 5.0, math.inf, 20e6),
    )
    for name, hz in (("DG1022Z", 25e6), ("DG1032Z", 30e6), ("DG1062Z", 60e6))
)
_AFG_START = AfterReset(frequency_hz=1e6, amplitude_vpp=1.0)


def _afg(
    name: str, hz: float, least_vpp: float, peak_v: float, above: tuple[tuple[float, float], ...] = ()
) -> GeneratorModel:
    """Return an AFG3000C or AFG31000; how far this is checked is in docs/instruments.md.

    The sample rate is what waveforms of every length have; up to 16384 points some models have more.
    """
    return GeneratorModel(
        name,
        "TEKTRONIX",
        hz,
        250e6,
        14,
        131_072,
        min_amplitude_vpp=least_vpp,
        max_peak_v=peak_v,
        min_points=2,
        max_delay_s=85.0,
        delay_digits=5,
        channels=int(name[-1] if name[-1].isdigit() else name[-2]),
        arb_played_by="frequency",
        max_arb_hz=hz / 2,
        full_code=8191,
        interpolations=("linear",),
        vpp_above_hz=above,
        error_queue_depth=32,
        after_reset=_AFG_START,
    )


_AFG31_FALLS = ((60e6, 8.0), (80e6, 6.0))
_MODELS_AFG = (
    _afg("AFG3011C", 10e6, 20e-3, 10.0),
    _afg("AFG3021C", 25e6, 10e-3, 5.0),
    _afg("AFG3022C", 25e6, 10e-3, 5.0),
    _afg("AFG3051C", 50e6, 10e-3, 5.0),
    _afg("AFG3052C", 50e6, 10e-3, 5.0),
    _afg("AFG3101C", 100e6, 20e-3, 5.0),
    _afg("AFG3102C", 100e6, 20e-3, 5.0),
    _afg("AFG3151C", 150e6, 20e-3, 5.0, ((100e6, 8.0),)),
    _afg("AFG3152C", 150e6, 20e-3, 5.0, ((100e6, 8.0),)),
    _afg("AFG3251C", 240e6, 50e-3, 2.5, ((200e6, 4.0),)),
    _afg("AFG3252C", 240e6, 50e-3, 2.5, ((200e6, 4.0),)),
    *(_afg(f"AFG3102{n}", 25e6, 1e-3, 5.0, _AFG31_FALLS) for n in "12"),
    *(_afg(f"AFG3105{n}", 50e6, 1e-3, 5.0, _AFG31_FALLS) for n in "12"),
    *(_afg(f"AFG3110{n}", 100e6, 1e-3, 5.0, _AFG31_FALLS) for n in "12"),
    *(_afg(f"AFG3115{n}", 150e6, 1e-3, 2.5, ((200e6, 4.0),)) for n in "12"),
    *(_afg(f"AFG3125{n}", 250e6, 1e-3, 2.5, ((200e6, 4.0),)) for n in "12"),
)
# The rate is that of TrueArb; errors are not queued, and loads begin with high impedance.
_MODELS_SDG = tuple(
    GeneratorModel(
        name,
        "Siglent Technologies",
        hz,
        75e6,
        16,
        8_000_000,
        min_amplitude_vpp=2e-3,
        max_delay_s=100.0,
        load_span_ohm=(50.0, 100e3),
        vpp_above_hz=((20e6, 5.0),),
        error_queue_depth=0,
        after_reset=AfterReset(amplitude_vpp=4.0, load_ohm=math.inf, sample_rate_hz=1e6),
    )
    for name, hz in (("SDG2042X", 40e6), ("SDG2082X", 80e6), ("SDG2122X", 120e6))
)
_BY_FAMILY = {
    "keysight-33500": _MODELS_33500,
    "keysight-33600": _MODELS_33600,
    "agilent-33220": _MODELS_33220,
    "rigol-dg": _MODELS_RIGOL,
    "tektronix-afg": _MODELS_AFG,
    "siglent-sdg": _MODELS_SDG,
}
MODELS = {model.name: model for models in _BY_FAMILY.values() for model in models}
FAMILIES = {family: tuple(model.name for model in models) for family, models in _BY_FAMILY.items()}
DEFAULT_MODEL = {
    "keysight-33500": "33522B",
    "keysight-33600": "33622A",
    "agilent-33220": "33220A",
    "rigol-dg": "DG1062Z",
    "tektronix-afg": "AFG3152C",
    "siglent-sdg": "SDG2042X",
}


def family_of(model: GeneratorModel) -> str:
    """Find the family of a model, by its name."""
    return next(family for family, names in FAMILIES.items() if model.name in names)


def model_of(identity: str) -> GeneratorModel:
    """Find the model in an ``*IDN?`` answer.

    Raises
    ------
    LimitExceeded
        The model is not in the tables.
    """
    fields = [part.strip() for part in identity.split(",")]
    name = fields[1] if len(fields) > 1 else ""
    if name not in MODELS:
        raise LimitExceeded(
            f"generator model {name!r} (from {identity!r}) is unknown; known: {', '.join(MODELS)}"
        )
    return MODELS[name]
