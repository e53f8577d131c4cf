"""The numbers of the range campaign that are assumed: default, ends of what seems possible, and why."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from msgspec import structs

from procedures.range_scenes import REFLECTANCES

if TYPE_CHECKING:
    from collections.abc import Callable

    from procedures.range_ground import GroundKey
    from sim.scene import Scene


@dataclass(frozen=True, slots=True)
class Constant:
    """A number that is assumed.

    Parameters
    ----------
    name, unit : str
        For people.
    low, assumed, high : float
        Ends of its range, and the default; an end that is the default is not computed.
    why : str
        Where the range is from.
    scene : callable
        Puts a value into a scene.
    ground : callable
        Puts it into the ground.
    reflectances : callable
        Puts it into the reflectances of dark ground, regolith and ice.
    dark_follows : bool
        Whether the dark noise is derived again with it.
    """

    name: str
    unit: str
    low: float
    assumed: float
    high: float
    why: str
    scene: Callable[[Scene, float], Scene] = lambda scene, value: scene
    ground: Callable[[GroundKey, float], GroundKey] = lambda ground, value: ground
    reflectances: Callable[[float], tuple[float, ...]] = lambda value: REFLECTANCES
    dark_follows: bool = True


def _in(table: str, key: str, scale: float = 1.0, **beside: Any) -> Callable[[Scene, float], Scene]:
    """Put a value, times a scale, into a table of a scene, and other keys with it."""

    def changed(scene: Scene, value: float) -> Scene:
        whole = type(getattr(getattr(scene, table), key)) is int
        keys = {key: round(value) if whole else scale * value}
        return structs.replace(scene, **{table: structs.replace(getattr(scene, table), **keys, **beside)})

    return changed


def _jitter(scene: Scene, value: float) -> Scene:
    return structs.replace(scene, laser=structs.replace(scene.laser, jitter_rad=(1e-6 * value, 1e-6 * value)))


def _window(scene: Scene, value: float) -> Scene:
    finder = structs.replace(scene.range_finder, correlation_window_samples=round(value))
    return structs.replace(scene, range_finder=finder)


def _interleave(key: str, scale: float) -> Callable[[Scene, float], Scene]:
    def changed(scene: Scene, value: float) -> Scene:
        unlike = structs.replace(scene.electronics.interleave, **{key: scale * value})
        return structs.replace(scene, electronics=structs.replace(scene.electronics, interleave=unlike))

    return changed


def _other(ground: GroundKey, value: float) -> GroundKey:
    return replace(ground, seed=ground.seed + int(50 * value))


def _relief(ground: GroundKey, value: float) -> GroundKey:
    return replace(ground, factor=value)


def _hurst(ground: GroundKey, value: float) -> GroundKey:
    return replace(ground, hurst=value)


OTHER_GROUND = "other fractals"
"""No number, but what the chance of the ground makes of a prediction."""

CONSTANTS = (
    Constant(
        "effective R_f",
        "kohm",
        40.0,
        45.0,
        50.0,
        "the paper's energy calibration",
        _in("detector", "feedback_ohm", 1e3),
    ),
    Constant(
        "gain of the photodiode",
        "",
        42.3,
        48.4,
        48.4,
        "the paper prints 48.4 at 320 V; its gain at 370 V means 42.3 there",
        _in("detector", "multiplication"),
    ),
    Constant(
        "excess noise exponent",
        "",
        0.2,
        0.3,
        0.5,
        "silicon photodiodes of this family",
        _in("detector", "excess_noise_exponent"),
    ),
    Constant(
        "dark noise by itself",
        "mV",
        0.7,
        0.825,
        1.2,
        "the text's 80 % by day, and the distance of the Sun",
        _in("noise", "dark_rms_v", 1e-3),
        dark_follows=False,
    ),
    Constant(
        "extra pole of the amplifier",
        "MHz",
        20.0,
        math.inf,
        math.inf,
        "the paper's table names 20 MHz for the amplifier",
        _in("detector", "tia_pole_hz", 1e6),
    ),
    Constant(
        "AC-coupling corner",
        "kHz",
        0.0,
        0.0,
        100.0,
        "the paper says AC-coupled and no number",
        _in("electronics", "highpass_hz", 1e3),
    ),
    Constant(
        "span of the converter",
        "V",
        1.04,
        2.0,
        4.0,
        "the largest stimulus of the paper is not clipped",
        _in("electronics", "adc_full_scale_v"),
    ),
    Constant(
        "offset between converters",
        "mV",
        0.0,
        0.0,
        2.44,
        "none to 5 counts, usual for interleaved converters",
        _interleave("offset_v", 1e-3),
    ),
    Constant(
        "gain between converters",
        "%",
        0.0,
        0.0,
        2.0,
        "usual for interleaved converters",
        _interleave("gain", 1e-2),
    ),
    Constant(
        "skew between converters",
        "ps",
        0.0,
        0.0,
        200.0,
        "usual for interleaved converters",
        _interleave("skew_s", 1e-12),
    ),
    Constant(
        "number of templates",
        "",
        4.0,
        12.0,
        32.0,
        "no design is published",
        _in("range_finder", "template_count"),
    ),
    Constant(
        "narrowest template",
        "ns",
        15.0,
        18.0,
        20.0,
        "about the 20 ns of the paper's narrowest pulse",
        _in("range_finder", "narrowest_s", 1e-9),
    ),
    Constant(
        "widest template",
        "ns",
        110.0,
        120.0,
        150.0,
        "from the 110 ns of the paper's widest pulse on",
        _in("range_finder", "widest_s", 1e-9),
    ),
    Constant(
        "exclusion about a candidate",
        "samples",
        5.0,
        10.0,
        20.0,
        "no rule is published",
        _in("range_finder", "exclusion_samples"),
    ),
    Constant(
        "correlation window",
        "samples",
        42.0,
        42.0,
        64.0,
        "the paper has 42, Huettig et al. (2024) 64",
        _window,
    ),
    Constant(
        "steps of the fit",
        "",
        1.0,
        1.0,
        4.0,
        "one is near least squares, four reach them",
        _in("range_finder", "refinement_steps"),
    ),
    Constant("pointing jitter", "urad", 0.5, 1.0, 2.0, "all three sources contribute at 500 km", _jitter),
    Constant(
        "divergence",
        "urad",
        42.0,
        50.0,
        60.0,
        "footprints of the paper at either end of two orbits",
        _in("laser", "divergence_rad", 1e-6),
    ),
    Constant(
        "ellipticity of the beam",
        "",
        0.0,
        0.0,
        0.2,
        "the paper's beam is not round, by no number",
        _in("laser", "ellipticity", beam="elliptical"),
    ),
    Constant("pulse width", "ns", 3.0, 5.4, 8.0, "comparable lasers", _in("laser", "fwhm_s", 1e-9)),
    Constant(
        "pulse tail",
        "ns",
        0.0,
        3.0,
        10.0,
        "the paper has a long tail, by no number",
        _in("laser", "tail_s", 1e-9),
    ),
    Constant(
        "reflectance of ice",
        "",
        0.25,
        0.30,
        0.40,
        "more than 1.5 times the mean",
        reflectances=lambda x: (*REFLECTANCES[:2], x),
    ),
    Constant("relief of the fractals", "x", 0.5, 1.0, 2.0, "their heights are in no text", ground=_relief),
    Constant(
        "Hurst exponent",
        "",
        0.66,
        0.8,
        0.9,
        "medians of Mercury's terrains are 0.66 to 0.81 (Fa et al. 2016); upwards assumed",
        ground=_hurst,
    ),
    Constant(OTHER_GROUND, "", 1.0, 0.0, 2.0, "chance of the ground", ground=_other),
)
