"""Show a scene's echo, from the ground to the samples.

One shot is shown whole: the ground, the light, the voltage before and behind the amplifier, and the samples
without noise, by night and by day, each with a Gaussian. More shots, with the noise of the scene itself, tell
how much arrival, width and amplitude vary.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from msgspec import structs

from belahil.errors import RefusedInput
from belahil.pulse_fit import gaussian_fit
from belahil.run import utc_now
from belahil.stimuli import SampledPulse
from belahil.values import PRODUCTS, Shot
from sim.accuracy import Accuracy
from sim.chain import Chain
from sim.constants import SPEED_OF_LIGHT_M_PER_S
from sim.laser import beam_sigma_m, photon_number
from sim.scene import load_scene

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from belahil.pulse_fit import FitStatus, GaussianPulse
    from belahil.values import Products
    from sim.scene import Scene

CASES = ("noise-free", "night", "day")
SHOWN_SHOT = 0
SHOTS = 10
FALSE_BEYOND_M = 10.0
"""A candidate further off the range is another pulse (Nishiyama et al.)."""
_MANY = 100
"""So many shots repay the time in which the compiled loops of the range finder are loaded."""
_CURVE_STEPS = 20
"""Places on a curve in a sample interval."""
_GROUND_POSTS = 121
_GROUND_RADII = 1.7


@dataclass(frozen=True, slots=True)
class SimulateOptions:
    """What a user may choose.

    Parameters
    ----------
    tolerance : float
        As in `sim.accuracy.Accuracy`.
    shots : int
        Whole windows with the noise of the scene.
    products : {"window", "candidates", "correlation_windows", "window_and_candidates"}
        What of each the receiver reports into the data file; see `sim.rfm.RangeFinder.report`.

    Raises
    ------
    RefusedInput
        No shot, a tolerance outside its range, or products that do not exist.
    """

    tolerance: float = Accuracy().tolerance
    shots: int = SHOTS
    products: Products = "window"

    def __post_init__(self) -> None:
        Accuracy(self.tolerance)
        if self.shots < 1:
            raise RefusedInput(f"{self.shots} shots: at least 1 is needed")
        if self.products not in PRODUCTS:
            raise RefusedInput(f"products {self.products!r}: allowed are {', '.join(PRODUCTS)}")


@dataclass(frozen=True, slots=True)
class Fitted:
    """The Gaussian of an echo.

    Parameters
    ----------
    status : str
        That of a `belahil.pulse_fit.PulseFit`; ``no_light`` where no light comes back: nothing was fitted.
    pulse : GaussianPulse or None
        Arrival from the first sample; None where there is none.
    """

    status: FitStatus | Literal["no_light"]
    pulse: GaussianPulse | None


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """The samples of one shot in one case of noise.

    Parameters
    ----------
    name : str
        One of `CASES`.
    noise_rms_v : float
        Stationary noise at the converter, V.
    times_s : ndarray of float64, shape (n,)
        True times of the samples from the gate, s.
    volts : ndarray of float64, shape (n,)
        From the counts, at the converter, V.
    fit : Fitted
        Its Gaussian.
    """

    name: str
    noise_rms_v: float
    times_s: NDArray[np.float64]
    volts: NDArray[np.float64]
    fit: Fitted


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """Heights about the footprint.

    Parameters
    ----------
    x_m, y_m : ndarray of float64, shape (n,)
        From nadir.
    height_m : masked array of float64, shape (n, n)
        Rows along y.
    centre_m, radii_m : tuple of float
        Of the footprint, where the beam has 1/e^2 of its peak, along its axes.
    azimuth_deg : float
        Of the first axis.
    """

    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    height_m: np.ma.MaskedArray[Any, np.dtype[np.float64]]
    centre_m: tuple[float, float]
    radii_m: tuple[float, float]
    azimuth_deg: float


@dataclass(frozen=True)
class Simulation:
    """A scene, simulated.

    Parameters
    ----------
    chain : Chain
        Of the scene.
    shots : tuple of Shot
        Whole windows with their candidates; `played` is the mean echo at the cut.
    products : {"window", "candidates", "correlation_windows", "window_and_candidates"}
        As in `SimulateOptions`.
    """

    chain: Chain
    shots: tuple[Shot, ...]
    products: Products = "window"

    @property
    def reported(self) -> tuple[Shot, ...]:
        """The shots with what the receiver reports of them."""
        if self.products == "window":
            return self.shots
        finder = replace(self.chain.range_finder, compiled=len(self.shots) >= _MANY)
        return tuple(replace(one, window=finder.report(one.window, self.products)) for one in self.shots)

    @cached_property
    def dark(self) -> bool:
        """Whether no light comes back from the mean shot."""
        return self.chain.echo().status != "ok"

    @cached_property
    def cases(self) -> tuple[Case, ...]:
        """One shot in the three cases, with equal draws of what they share."""
        return tuple(_case(name, _chain_of(name, self.chain), self.dark) for name in CASES)

    @cached_property
    def times_s(self) -> NDArray[np.float64]:
        """Places on the curves, from the gate, s."""
        step_s = self.chain.receiver.grid.interval_s / _CURVE_STEPS
        times_s = self.cases[0].times_s
        begin_s = min(times_s[0], self.chain.echo(SHOWN_SHOT).span_s[0], 0.0)
        return np.arange(begin_s, times_s[-1], step_s)

    @cached_property
    def curves(self) -> dict[str, NDArray[np.float64]]:
        """Curves at `times_s`: photon rates (1/s), power (W) and volts."""
        chain, times_s = self.chain, self.times_s
        first_s, step_s, count = float(times_s[0]), float(times_s[1] - times_s[0]), times_s.size
        light = chain.echo(SHOWN_SHOT)
        sent = photon_number(chain.scene.laser) * chain.light_kernel.pulse.density(times_s)
        shot_noise = _chain_of("shot noise", chain).stimulus(SHOWN_SHOT)
        noisy = np.zeros(count)
        if isinstance(shot_noise, SampledPulse):
            noisy = shot_noise.at(times_s + chain.gate_s)
        return {
            "transmitted_rate": sent,
            "received_rate": light.photon_rate_hz(first_s, step_s, count),
            "received_power": light.power_w(first_s, step_s, count),
            "before_amplifier": noisy,
            "amplified": chain.curve(SHOWN_SHOT, first_s, step_s, count),
        }

    @cached_property
    def ground(self) -> Ground:
        """The terrain about the footprint."""
        scene = self.chain.scene
        centre_m = tuple(scene.altitude_m * math.tan(angle) for angle in scene.laser.pointing_rad)
        major_m, minor_m = beam_sigma_m(scene.laser, scene.altitude_m)
        reach_m = _GROUND_RADII * 2 * major_m
        offsets = np.linspace(-reach_m, reach_m, _GROUND_POSTS)
        x_m, y_m = centre_m[0] + offsets, centre_m[1] + offsets
        found = self.chain.surface.sample(x_m[None, :], y_m[:, None])
        heights = np.ma.masked_array(found.height_m, ~found.known)
        turned = scene.laser.beam_azimuth_deg if scene.laser.beam == "elliptical" else 0.0
        return Ground(x_m, y_m, heights, (centre_m[0], centre_m[1]), (2 * major_m, 2 * minor_m), turned)

    @cached_property
    def fits(self) -> tuple[Fitted, ...]:
        """A Gaussian in the correlation window of every shot."""
        if self.dark:
            return (_NO_LIGHT,) * len(self.shots)
        request = self.chain.correlation_window()
        first = self.chain.receiver.edges(request)
        return tuple(
            _fit(self.chain, shot.window.volts[first : first + request.sample_count]) for shot in self.shots
        )

    @cached_property
    def detected(self) -> int:
        """How many shots have a candidate where the echo is."""
        chain = self.chain
        # As they are before the converter, whose span they may exceed.
        there = None if self.dark else _fit(chain, chain.samples().volts, math.inf).pulse
        if there is None:
            return 0
        true_s = chain.correlation_window().delay_s + there.arrival_s
        near_s = 2 * FALSE_BEYOND_M / SPEED_OF_LIGHT_M_PER_S
        # A sample for the phase, which differs from shot to shot.
        near_s += chain.receiver.spec.sample_interval_s
        return sum(
            any(abs(shot.window.start_s + one.arrival_s - true_s) < near_s for one in shot.window.candidates)
            for shot in self.shots
        )


def simulate(
    scene: Scene,
    options: SimulateOptions,
    progress: Callable[[int, int], None] | None = None,
    chain: Chain | None = None,
) -> Simulation:
    """Simulate a scene.

    Parameters
    ----------
    scene : Scene
        What is there.
    options : SimulateOptions
        How well, and how many shots.
    progress : callable or None
        Called with shots done and shots in all.
    chain : Chain or None
        Of this scene and tolerance, where it has been made already to tell its plan.

    Raises
    ------
    RefusedInput
        As `sim.chain.Chain`.
    """
    chain = chain or Chain(scene, Accuracy(options.tolerance))
    played, date = chain.stimulus(), utc_now()
    finder = replace(chain.range_finder, compiled=options.shots >= _MANY)
    shots = []
    for index in range(options.shots):
        shots.append(Shot(played, finder.report(chain.window(index), "window"), date))
        if progress is not None:
            progress(index + 1, options.shots)
    return Simulation(chain, tuple(shots), options.products)


def _chain_of(case: str, chain: Chain) -> Chain:
    """Return the chain of a case of noise, over the same ground."""
    scene = chain.scene
    usual = scene.receiver_spec.noise_rms_v_by_code[scene.gain_code]
    silent = structs.replace(scene.noise, dark_rms_v=None, dark_windows="", shot=False)
    dark_v = scene.noise.dark_rms_v
    if dark_v is None and not scene.noise.dark_windows:
        dark_v = usual
    noisy = structs.replace(scene.noise, dark_rms_v=dark_v, shot=True)
    changed = {
        "noise-free": structs.replace(scene, noise=silent, sun=None),
        "shot noise": structs.replace(scene, noise=structs.replace(silent, shot=True), sun=None),
        "night": structs.replace(scene, noise=noisy, sun=None),
        "day": structs.replace(scene, noise=noisy, sun=scene.sun or load_scene("day").sun),
    }[case]
    return Chain(changed, chain.accuracy, chain.surface)


def _case(name: str, chain: Chain, dark: bool) -> Case:
    request = chain.correlation_window(SHOWN_SHOT)
    volts = chain.window(SHOWN_SHOT, request).volts
    interval_s = chain.receiver.grid.interval_s
    times_s = chain.first_sample_s(SHOWN_SHOT, request) + interval_s * np.arange(float(volts.size))
    return Case(name, chain.noise_rms_v, times_s, volts, _NO_LIGHT if dark else _fit(chain, volts))


_NO_LIGHT = Fitted("no_light", None)


def _fit(chain: Chain, volts: NDArray[np.float64], clip_v: float | None = None) -> Fitted:
    if clip_v is None:
        clip_v = (chain.receiver.quantizer.full_scale_v / 2) - chain.receiver.quantizer.volts_per_count
    found = gaussian_fit(volts, chain.receiver.spec.sample_interval_s, clip_v)
    return Fitted(found.status, found.pulse)
