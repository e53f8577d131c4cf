"""Which stages a scene calls for, each with its reason.

A stage is here when it would change a number. What a scene leaves out, or what would change nothing, is not
in the list, is not built, and is never called.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from belahil.uncertainty import sized
from sim.beam import beam_sigma_m

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sim.accuracy import Accuracy
    from sim.scene import Scene

Place = Literal["light", "cut", "receiver", "converter"]

_JITTER_REACH = 6.0
"""Standard deviations of the pointing jitter that the field of view must hold, to be left out."""


@dataclass(frozen=True, slots=True)
class Stage:
    """Something that happens between laser and samples.

    Parameters
    ----------
    name : str
        One of the names in this module.
    place : {"light", "cut", "receiver", "converter"}
        Up to the photodiode; volts at the cut; right of the cut before, and in, the converter.
    reason : str
        What in the scene calls for it.
    draw : str
        Effect that keys its random numbers, see `sim.draws`; empty: it draws none.
    """

    name: str
    place: Place
    reason: str
    draw: str = ""


def select(scene: Scene, accuracy: Accuracy) -> tuple[Stage, ...]:
    """Return the stages of a scene in the order in which they act.

    Parameters
    ----------
    scene : Scene
        What is there.
    accuracy : Accuracy
        Says how far out the edge of a beam counts.
    """
    return (
        *_of_light(scene, accuracy),
        *_at_cut(scene),
        *_in_receiver(scene),
        *_in_converter(scene),
    )


def _of_light(scene: Scene, accuracy: Accuracy) -> Iterator[Stage]:
    laser, surface = scene.laser, scene.surface
    yield Stage("pulse", "light", f'laser.pulse = "{laser.pulse}"')
    if any(laser.jitter_rad):
        yield Stage(
            "pointing jitter", "light", f"laser.jitter_rad = {_numbers(laser.jitter_rad)}", "pointing"
        )
    if laser.energy_jitter:
        yield Stage("energy jitter", "light", f"laser.energy_jitter = {laser.energy_jitter:g}", "energy")
    yield Stage("surface", "light", f'surface.kind = "{surface.kind}"')
    if surface.reflectance_map:
        yield Stage("reflectance map", "light", f"surface.reflectance_map = {surface.reflectance_map}")
    if surface.photometry == "lambert" and (surface.kind != "plane" or surface.slope_deg):
        yield Stage("radiation factor", "light", 'surface.photometry = "lambert" on ground that is not level')
    if surface.photometry == "factor" and surface.radiation_factor != 1:
        yield Stage("radiation factor", "light", f"surface.radiation_factor = {surface.radiation_factor:g}")
    missed_m = _beyond_view_m(scene, accuracy)
    if missed_m > 0:
        yield Stage("field of view", "light", f"the beam reaches {missed_m:.3g} m beyond it")


def _at_cut(scene: Scene) -> Iterator[Stage]:
    detector, sun = scene.detector, scene.sun
    yield Stage("detector", "cut", "turns photons into volts")
    if scene.noise.shot:
        yield Stage("shot noise", "cut", "noise.shot = true", "shot_noise")
    if sun is not None and 0 <= sun.incidence_deg < 90 and sun.irradiance_1au_w_per_m3:
        lit = f"sun.incidence_deg = {sun.incidence_deg:g}, sun.distance_au = {sun.distance_au:g}"
        if scene.surface.reflectance:
            yield Stage("sunlight", "cut", lit, "sunlight")
    if detector.surface_dark_a or detector.bulk_dark_a:
        currents = _numbers((detector.surface_dark_a, detector.bulk_dark_a))
        yield Stage("dark current", "cut", f"detector surface and bulk current = {currents}", "dark_current")
    if detector.tia_pole_hz:
        yield Stage("amplifier pole", "cut", f"detector.tia_pole_hz = {detector.tia_pole_hz:g}")


def _in_receiver(scene: Scene) -> Iterator[Stage]:
    truth = scene.truth
    if scene.filter == "gaussian":
        yield Stage(
            "Gaussian low-pass", "receiver", f"tia_bandwidth_hz = {scene.detector.tia_bandwidth_hz:g}"
        )
    else:
        yield Stage(
            "low-pass",
            "receiver",
            f"Butterworth of order {truth.order} at {sized(truth.cutoff_hz, 'Hz')}",
        )
        if truth.highpass_hz:
            yield Stage("high-pass", "receiver", f"electronics.highpass_hz = {truth.highpass_hz:g}")
    small = truth.small_signal
    if small.deadband_v:
        yield Stage("dead zone", "receiver", f"small_signal.deadband_v = {small.deadband_v:g}")
    if small.cubic_per_v2:
        yield Stage("cubic", "receiver", f"small_signal.cubic_per_v2 = {small.cubic_per_v2:g}")
    if scene.gain != 1:
        yield Stage("gain", "receiver", f"{scene.gain:g} at gain code {scene.gain_code}")
    if scene.noise.dark_rms_v:
        yield Stage("dark noise", "receiver", f"noise.dark_rms_v = {scene.noise.dark_rms_v:g}", "noise")


def _in_converter(scene: Scene) -> Iterator[Stage]:
    truth = scene.truth
    if truth.interleave.gain:
        yield Stage("gain mismatch", "converter", f"interleave.gain = {truth.interleave.gain:g}")
    if truth.interleave.offset_v:
        yield Stage("offset mismatch", "converter", f"interleave.offset_v = {truth.interleave.offset_v:g}")
    if truth.interleave.skew_s:
        yield Stage("skew", "converter", f"interleave.skew_s = {truth.interleave.skew_s:g}")
    if scene.noise.dark_windows:
        yield Stage(
            "recorded dark noise", "converter", f"noise.dark_windows = {scene.noise.dark_windows}", "dark"
        )
    yield Stage(
        "quantization",
        "converter",
        f"{truth.adc_bits} bits over {sized(truth.adc_full_scale_v, 'V')}",
        "sampling_phase",
    )


def _beyond_view_m(scene: Scene, accuracy: Accuracy) -> float:
    """How far the edge of the beam lies beyond the edge of the field of view; not positive: nowhere."""
    laser, detector, altitude_m = scene.laser, scene.detector, scene.altitude_m
    reach = math.sqrt(2 * math.log(1 / accuracy.beam_cut))
    off_rad = math.dist(laser.pointing_rad, detector.boresight_rad) + _JITTER_REACH * max(laser.jitter_rad)
    edge_m = altitude_m * math.tan(off_rad) + reach * beam_sigma_m(laser, altitude_m)[0]
    return edge_m - altitude_m * math.tan(detector.field_of_view_rad)


def _numbers(row: tuple[float, ...]) -> str:
    return "(" + ", ".join(f"{number:g}" for number in row) + ")"
