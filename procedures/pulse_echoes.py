"""The echoes of a campaign: scenes, by slope and azimuth where asked, as voltages wished at the cut."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from msgspec import structs

from belahil.errors import RefusedInput
from belahil.stimuli import NoSignal, SampledPulse
from sim.accuracy import Accuracy
from sim.chain import Chain
from sim.scene import parse_scene

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sim.scene import Scene


@dataclass(frozen=True, slots=True)
class NamedScene:
    """A scene as text, so that a run that is continued needs no file.

    Parameters
    ----------
    name : str
        As the user wrote it.
    toml : str
        Every key, as `sim.scene.as_toml` writes it.
    """

    name: str
    toml: str


@dataclass(frozen=True, slots=True)
class Echo:
    """An echo that is to be played.

    Parameters
    ----------
    name : str
        Scene, and slope and azimuth where they were asked for.
    altitude_m : float
        Of the scene.
    slope_deg, azimuth_deg : float
        Of its plane.
    gain_code : int or None
        With which the receiver is to see it.
    delay_s : float
        First sample of the window round it, s on the time axis of the pulses.
    sample_count : int
        Of this window.
    wished : tuple of SampledPulse
        V at the cut, one for all shots or one for each; empty where there is no light.
    """

    name: str
    altitude_m: float
    slope_deg: float
    azimuth_deg: float
    gain_code: int | None
    delay_s: float
    sample_count: int
    wished: tuple[SampledPulse, ...]


def check_grid(slopes_deg: Sequence[float] | None, azimuths_deg: Sequence[float] | None) -> None:
    """Refuse slopes and azimuths that no plane has.

    Raises
    ------
    RefusedInput
        An empty list, a slope outside 0 to 90 degrees, or an azimuth that is no such number.
    """
    for name, values in (("slopes", slopes_deg), ("azimuths", azimuths_deg)):
        if values is not None and not values:
            raise RefusedInput(f"{name}: at least one is needed")
    for slope_deg in slopes_deg or ():
        if not 0 <= slope_deg < 90:
            raise RefusedInput(f"a slope of {slope_deg:g} degrees: 0 to below 90 are allowed")
    for azimuth_deg in azimuths_deg or ():
        if not -360 <= azimuth_deg <= 360:
            raise RefusedInput(f"an azimuth of {azimuth_deg:g} degrees: -360 to 360 are allowed")


def echoes(
    scenes: Sequence[NamedScene],
    slopes_deg: Sequence[float] | None,
    azimuths_deg: Sequence[float] | None,
    *,
    shots: int,
    shot_noise: bool,
    tolerance: float,
    gain_code: int | None,
    receiver: str,
) -> tuple[Echo, ...]:
    """Compute all echoes of a campaign, scene by scene, slope by slope, azimuth by azimuth.

    Parameters
    ----------
    scenes : sequence of NamedScene
        At least one.
    slopes_deg, azimuths_deg : sequence of float or None
        In place of those of each scene's ground, which must be a plane then.
    shots : int
        Realizations of each echo, where it has any.
    shot_noise : bool
        Whether each shot is a realization with shot noise, sunlight and jitter; else all are the mean.
    tolerance : float
        As in `sim.accuracy.Accuracy`.
    gain_code : int or None
        In place of the scenes' own.
    receiver : str
        Preset of the bench; scenes must be for the same.

    Raises
    ------
    RefusedInput
        A scene for another receiver; a grid of slopes over ground that is no plane; what `Chain` refuses.
    """
    found = []
    for one in scenes:
        scene = parse_scene(one.toml, one.name)
        if scene.receiver != receiver:
            raise RefusedInput(
                f'scene {one.name} is for receiver = "{scene.receiver}", the bench has "{receiver}"'
            )
        for name, grounded in _on_grounds(one.name, scene, slopes_deg, azimuths_deg):
            found.append(_echo(name, grounded, shots if shot_noise else 0, tolerance, gain_code))
    return tuple(found)


def _on_grounds(
    name: str, scene: Scene, slopes_deg: Sequence[float] | None, azimuths_deg: Sequence[float] | None
) -> Iterator[tuple[str, Scene]]:
    if slopes_deg is None and azimuths_deg is None:
        yield name, scene
        return
    if scene.surface.kind != "plane":
        raise RefusedInput(
            f"scene {name} has kind = {scene.surface.kind}: slopes and azimuths are set on planes only"
        )
    for slope_deg in slopes_deg or (scene.surface.slope_deg,):
        for azimuth_deg in azimuths_deg or (scene.surface.azimuth_deg,):
            surface = structs.replace(scene.surface, slope_deg=slope_deg, azimuth_deg=azimuth_deg)
            told = f"{name} slope {slope_deg:g} azimuth {azimuth_deg:g}"
            yield told, structs.replace(scene, surface=surface)


def _echo(name: str, scene: Scene, realizations: int, tolerance: float, gain_code: int | None) -> Echo:
    chain = Chain(scene, Accuracy(tolerance))
    request = chain.correlation_window()
    stimuli = [chain.stimulus(shot) for shot in (range(realizations) if realizations else (None,))]
    dark = any(isinstance(one, NoSignal) for one in stimuli)
    code = gain_code if gain_code is not None and request.gain_code is not None else request.gain_code
    return Echo(
        name=name,
        altitude_m=scene.altitude_m,
        slope_deg=scene.surface.slope_deg,
        azimuth_deg=scene.surface.azimuth_deg,
        gain_code=code,
        delay_s=request.delay_s,
        sample_count=request.sample_count,
        wished=() if dark else tuple(one for one in stimuli if isinstance(one, SampledPulse)),
    )
