"""A chain: from a scene to volts at the cut, and through the receiver to samples.

A chain holds the stages that its scene calls for and no others. The pulse, the amplifier and the receiver's
filter are one response in the s-plane, so an echo costs one evaluation at each sample that is asked for. The
receiver right of the cut is the `sim.receiver_model.ReceiverModel` that emulated benches have too.

Times count from the trigger of the receiver's window. The gate, the light from z = 0 at nadir, comes in the
middle of the longest window, at `Chain.gate_s`; the time of flight before it is left out.

What this does not model: a window that does not follow the altitude, and other echoes in it.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from msgspec import structs

from belahil.config import Interleave
from belahil.values import RangeWindow, Waveform, WindowRequest, check_whole
from sim.accuracy import Accuracy
from sim.chain_light import Illumination
from sim.chain_noise import StationaryNoise
from sim.chain_response import echo_volts, filtered, light_noises
from sim.chain_stimulus import stimulus
from sim.dark_windows import DarkWindows, read_dark_windows
from sim.detector import volts_per_photon_rate
from sim.draws import Draws
from sim.echo import echo, posts_error
from sim.kernel import Kernel
from sim.laser import pulse_shape
from sim.optical_echo import Lit, OpticalEcho, span_s
from sim.receiver_model import ReceiverModel
from sim.selection import select
from sim.terrain_build import build_surface

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from belahil.stimuli import NoSignal, SampledPulse
    from belahil.values import Candidate
    from sim.footprint import FootprintPlan
    from sim.rfm import RangeFinder
    from sim.scene import Scene
    from sim.terrain import Surface

_SETTLED = 20.0
"""Times that the response needs to change, after which the echo of a pulse is over, but for slow tails."""


class Chain:
    """What a scene's instrument measures.

    Parameters
    ----------
    scene : Scene
        What is there.
    accuracy : Accuracy
        How exactly the echo is computed.
    surface : Surface or None
        The scene's ground, where it has been made already.

    Raises
    ------
    RefusedInput
        The tolerance cannot be met, or something in the scene cannot be; `ConfigError` with the key.
    OffTerrain
        The beam does not meet the terrain.
    """

    def __init__(
        self, scene: Scene, accuracy: Accuracy | None = None, surface: Surface | None = None
    ) -> None:
        self.scene, self.accuracy = scene, accuracy or Accuracy()
        self.stages = select(scene, self.accuracy)
        names = frozenset(stage.name for stage in self.stages)
        self.surface = surface or build_surface(scene.surface)
        self.receiver = ReceiverModel(scene.truth, scene.receiver_spec.digitizer)
        self._noise_free = self.receiver
        if "dark noise" in names:
            silent = tuple(0.0 for _ in scene.truth.noise_rms_v_by_code)
            truth = structs.replace(scene.truth, noise_rms_v_by_code=silent)
            self._noise_free = ReceiverModel(truth, scene.receiver_spec.digitizer)
        self._interval_s = self.receiver.grid.interval_s
        self.gate_s = (self.receiver.spec.max_sample_count // 2) * self.receiver.spec.sample_interval_s
        self._illumination = Illumination(scene, self.surface, names)
        white = self._illumination.photons_from_white
        pulse = pulse_shape(scene.laser)
        self.light_kernel = Kernel(pulse, gain=white, tolerance=self.accuracy.kernel)
        self.passed, self.kernel = filtered(
            scene, self.receiver, pulse, white * volts_per_photon_rate(scene.detector), self.accuracy.kernel
        )
        smooth = self._illumination.plan(self.accuracy, self.kernel, self._interval_s)
        self.plan = self._illumination.refined(smooth, self.accuracy, self.kernel)
        self.light_noise = light_noises(self, names)
        self._recorded: tuple[Callable[[NDArray[np.float64], Draws], None], ...] = ()
        if "recorded dark noise" in names:
            self._recorded = (self._add_recorded,)

    # ---- what comes out

    def echo(self, shot: int | None = None) -> OpticalEcho:
        """Return the light on the photodiode.

        Parameters
        ----------
        shot : int or None
            With its jitter; None: the mean shot, without any.
        """
        draws = None if shot is None else Draws(self.scene.seed, shot)
        return self.optical(self._illumination.lit(self._echo_plan, draws))

    def stimulus(
        self, shot: int | None = None, sample_rate_hz: float | None = None
    ) -> SampledPulse | NoSignal:
        """Return the voltage at the cut, round the echo.

        Parameters
        ----------
        shot : int or None
            With its jitter, its shot noise, and noise of the sunlight; None: the mean shot without noise.
        sample_rate_hz : float or None
            Of the break points; None: so fine that straight lines keep the tolerance behind the filter.

        Returns
        -------
        SampledPulse or NoSignal
            On the time axis of `window`, from a whole nanosecond on. The pole of the amplifier is left to the
            pulse's `poles`. `NoSignal` where there is neither light nor noise.

        Notes
        -----
        Shot noise is, up to the sample rate, that of `window` for the same shot. Noise of sunlight and of
        dark current is another draw of the same kind.
        """
        return stimulus(self, shot, sample_rate_hz)

    def samples(self, shot: int | None = None, request: WindowRequest | None = None) -> Waveform:
        """Return volts at the converter before quantization.

        Parameters
        ----------
        shot : int or None
            Index of the shot; None: the mean shot without noise, sampled at phase 0.
        request : WindowRequest or None
            Of which stretch; None: that of `correlation_window`. Its `shot` does not count.
        """
        request = request or self.correlation_window(shot or 0)
        volts = self._at_converter(shot, request)
        start_s = self.receiver.edges(request) * self.receiver.spec.sample_interval_s
        return Waveform(volts, self.receiver.spec.sample_rate_hz, start_s)

    def curve(self, shot: int | None, first_s: float, step_s: float, count: int) -> NDArray[np.float64]:
        """Return the echo at the converter without noise, as a curve.

        Parameters
        ----------
        shot : int or None
            With its jitter; None: the mean shot.
        first_s, step_s : float
            Of the places on the curve; the first from the gate, s.
        count : int
            How many.

        Returns
        -------
        ndarray of float64, shape (count,)
            V; without what differs between the converters.
        """
        lit = self.lit(shot)
        volts = echo(self.kernel, lit.delays, first_s, step_s, count) * lit.energy
        return self._one_converter.at_converter(volts, self._gain_code, Draws(self.scene.seed, shot or 0))

    def window(self, shot: int | None = None, request: WindowRequest | None = None) -> RangeWindow:
        """Return counts, as a receiver reports them.

        Parameters
        ----------
        shot, request
            As in `samples`; None for the request: the longest window, from the trigger on.
        """
        request = request or self.whole_window(shot or 0)
        return self.receiver.digitized(self._at_converter(shot, request), request)

    def shot(self, index: int) -> RangeWindow:
        """Return the longest window of a shot, with all the noise of the scene."""
        return self.window(index)

    def candidates(
        self, shot: int | None = None, request: WindowRequest | None = None, with_samples: bool = False
    ) -> tuple[Candidate, ...]:
        """Return the pulses that the range finder finds in a window, best first.

        Parameters
        ----------
        shot, request
            As in `window`.
        with_samples : bool
            Whether each carries its correlation window.
        """
        return self.range_finder.candidates(self.window(shot, request), with_samples)

    @cached_property
    def range_finder(self) -> RangeFinder:
        """The receiver's range finder."""
        from sim.rfm import RangeFinder

        return RangeFinder.of(self.scene.receiver_spec, self.scene.range_finder)

    def whole_window(self, shot: int = 0) -> WindowRequest:
        """Return the request for the longest window."""
        return WindowRequest(shot, self._gain_code, self.receiver.spec.max_sample_count)

    def correlation_window(self, shot: int = 0, sample_count: int | None = None) -> WindowRequest:
        """Return the request for the samples round the echo of a mean shot.

        Parameters
        ----------
        shot : int
            Index of the shot.
        sample_count : int or None
            None: as many as the receiver's range finder keeps.
        """
        kept = self.scene.correlation_window_samples
        count = kept if sample_count is None else sample_count
        check_whole("sample_count", count, 1)
        first = round(self._centre_s / self.receiver.spec.sample_interval_s) - count // 2
        return WindowRequest(shot, self._gain_code, count, first * self.receiver.spec.sample_interval_s)

    def first_sample_s(self, shot: int | None, request: WindowRequest) -> float:
        """Return the true time of a window's first sample from the gate, s: what no receiver knows."""
        phase = 0.0 if shot is None else Draws(self.scene.seed, shot).uniform("sampling_phase")
        return (phase + self.receiver.edges(request)) * self._interval_s - self.gate_s

    @property
    def noise_rms_v(self) -> float:
        """Stationary noise at the converter before quantization, V rms; shot noise of the echo is not in it.

        What a dead zone or a cubic term makes of it is left out.
        """
        dark_v = self.scene.noise.dark_rms_v or 0.0
        if self._recorded:
            dark_v = self._dark_windows.rms_v
        light = [noise.rms_v for noise in self.light_noise if isinstance(noise, StationaryNoise)]
        return math.hypot(dark_v, *(self.scene.gain * rms_v for rms_v in light))

    # ---- what it will cost, and why

    @cached_property
    def posts_error(self) -> float:
        """What relief between the posts of a terrain model may have done, max |dV| / peak; see `sim.echo`."""
        scene = self.scene
        return posts_error(
            self.surface, scene.laser, scene.altitude_m, self.plan, self.kernel, self._interval_s
        )

    def explain(self) -> str:
        """Return, as lines to print, the stages, why they run, and their predicted error and cost."""
        from sim.chain_plan import told

        return told(self)

    # ---- its parts

    def lit(self, shot: int | None = None, align_s: float = 0.0) -> Lit:
        """Return what a shot lights, by the plan for samples; see `sim.chain_light.Illumination.lit`."""
        draws = None if shot is None else Draws(self.scene.seed, shot)
        return self._illumination.lit(self.plan, draws, align_s)

    @property
    def light_bin_s(self) -> float:
        """Time bins of the light before any filter, s; 0 with the closed form."""
        return self._echo_plan.bin_s

    @property
    def has_factor(self) -> bool:
        """Whether a field of view or a law of scattering weighs the light of each place."""
        return self._illumination.has_factor

    def optical(self, lit: Lit) -> OpticalEcho:
        """Return the light of what a shot lights."""
        return OpticalEcho(self.light_kernel, lit, self._illumination.photon_energy_j)

    def _at_converter(self, shot: int | None, request: WindowRequest) -> NDArray[np.float64]:
        draws = Draws(self.scene.seed, shot or 0)
        first_s = self.first_sample_s(shot, request)
        lit = self.lit(shot, first_s)
        volts = echo_volts(self.kernel, lit, first_s, self.receiver.grid, request.sample_count)
        if shot is None:
            return self._noise_free.at_converter(volts, request.gain_code, draws)
        for noise in self.light_noise:
            noise.add(volts, first_s, self.optical(lit), draws)
        self.receiver.at_converter(volts, request.gain_code, draws)
        for add in self._recorded:
            add(volts, draws)
        return volts

    def _add_recorded(self, volts: NDArray[np.float64], draws: Draws) -> None:
        volts += self._dark_windows.draw(draws, volts.size)

    @property
    def _dark_windows(self) -> DarkWindows:
        """Recorded noise, read once for as long as its file does not change."""
        noise = self.scene.noise
        return read_dark_windows(noise.dark_windows, self.scene.gain_code, noise.dark_laser)

    @cached_property
    def _echo_plan(self) -> FootprintPlan:
        """Steps for the light itself, which no filter has smoothed."""
        light = self.light_kernel
        return self._illumination.plan_light(self.accuracy, light, self._interval_s, self.plan)

    @cached_property
    def _one_converter(self) -> ReceiverModel:
        truth = structs.replace(self._noise_free.truth, interleave=Interleave())
        return ReceiverModel(truth, self.scene.receiver_spec.digitizer)

    @property
    def _gain_code(self) -> int | None:
        return self.scene.gain_code if self.receiver.spec.gain_codes else None

    @cached_property
    def _centre_s(self) -> float:
        """Where the echo of a mean shot is largest, to a sample, s."""
        begin_s, end_s = span_s(self.light_kernel, self.lit().delays)
        settled_s = min(self.passed.ends_s, _SETTLED * self.kernel.finest_s)
        count = math.ceil((end_s - begin_s + settled_s) / self._interval_s) + 1
        volts = np.abs(echo(self.kernel, self.lit().delays, begin_s, self._interval_s, count))
        above = np.flatnonzero(volts >= volts.max() / 2)
        return self.gate_s + begin_s + float(above[0] + above[-1]) / 2 * self._interval_s
