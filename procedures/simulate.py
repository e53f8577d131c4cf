"""Show a scene's echo, from the ground to the samples.

One shot is shown whole: the ground, the light, the voltage before and behind the amplifier, and the samples
without noise, by night and by day, each with a Gaussian. More shots, with the noise of the scene itself, tell
how much arrival, width and amplitude vary.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec import structs

from belahil.errors import RefusedInput
from belahil.outcome import Outcome, Table
from belahil.pulse_fit import gaussian_fit
from belahil.run import utc_now
from belahil.stimuli import SampledPulse
from belahil.values import Shot
from sim.accuracy import Accuracy
from sim.chain import Chain
from sim.laser import beam_sigma_m, photon_number
from sim.scene import load_scene

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from belahil.pulse_fit import PulseFit
    from sim.scene import Scene

CASES = ("noise-free", "night", "day")
SHOWN_SHOT = 0
SHOTS = 10
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

    Raises
    ------
    RefusedInput
        No shot, or a tolerance outside its range.
    """

    tolerance: float = Accuracy().tolerance
    shots: int = SHOTS

    def __post_init__(self) -> None:
        Accuracy(self.tolerance)
        if self.shots < 1:
            raise RefusedInput(f"{self.shots} shots: at least 1 is needed")


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
    fit : PulseFit
        Its Gaussian; arrival from the first sample.
    """

    name: str
    noise_rms_v: float
    times_s: NDArray[np.float64]
    volts: NDArray[np.float64]
    fit: PulseFit


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
        Whole windows; `played` is the mean echo at the cut.
    """

    chain: Chain
    shots: tuple[Shot, ...]

    @cached_property
    def cases(self) -> tuple[Case, ...]:
        """One shot in the three cases, with equal draws of what they share."""
        return tuple(_case(name, _chain_of(name, self.chain)) for name in CASES)

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
    def fits(self) -> tuple[PulseFit, ...]:
        """A Gaussian in the correlation window of every shot."""
        request = self.chain.correlation_window()
        first = self.chain.receiver.edges(request)
        return tuple(
            _fit(self.chain, shot.window.volts[first : first + request.sample_count]) for shot in self.shots
        )


def simulate(
    scene: Scene, options: SimulateOptions, progress: Callable[[int, int], None] | None = None
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

    Raises
    ------
    RefusedInput
        As `sim.chain.Chain`.
    """
    chain = Chain(scene, Accuracy(options.tolerance))
    played, date = chain.stimulus(), utc_now()
    shots = []
    for index in range(options.shots):
        shots.append(Shot(played, chain.window(index), date))
        if progress is not None:
            progress(index + 1, options.shots)
    return Simulation(chain, tuple(shots))


def analyse(simulation: Simulation) -> Outcome:
    """Turn a simulation into results, tables and the figure."""
    chain = simulation.chain
    return Outcome(
        results=_results(simulation),
        tables=_tables(simulation),
        figures={"simulation": lambda: _figure(simulation)},
        notes=[
            "night and day: the scene's own noise, without and with sunlight; what it does not name is the "
            "receiver's dark noise, the shot noise of the echo, and the Sun of the ready scene `day`.",
            "arrivals count from the gate, the time of flight to the plane z = 0 at nadir, and have the "
            "delay of the receiver's filter.",
            *([f"no light comes back: {chain.echo().status}"] if chain.echo().status != "ok" else []),
        ],
    )


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


def _case(name: str, chain: Chain) -> Case:
    request = chain.correlation_window(SHOWN_SHOT)
    volts = chain.window(SHOWN_SHOT, request).volts
    interval_s = chain.receiver.grid.interval_s
    times_s = chain.first_sample_s(SHOWN_SHOT, request) + interval_s * np.arange(float(volts.size))
    return Case(name, chain.noise_rms_v, times_s, volts, _fit(chain, volts))


def _fit(chain: Chain, volts: NDArray[np.float64]) -> PulseFit:
    clip_v = (chain.receiver.quantizer.full_scale_v / 2) - chain.receiver.quantizer.volts_per_count
    return gaussian_fit(volts, chain.receiver.spec.sample_interval_s, clip_v)


def _results(simulation: Simulation) -> dict[str, Any]:
    chain, curves = simulation.chain, simulation.curves
    light = chain.echo()
    return {
        "status": "ok" if light.status == "ok" else "no_light",
        "tolerance": chain.accuracy.tolerance,
        "predicted_error": chain.plan.predicted_error,
        "terrain_posts_error": chain.posts_error,
        "method": chain.plan.method.replace(" ", "_"),
        "pixels": chain.plan.pixels,
        "echo": {
            "photons": light.photons,
            "energy_j": light.energy_j,
            "peak_rate_hz": float(curves["received_rate"].max()),
            "peak_at_converter_v": float(curves["amplified"].max()),
        },
        "cases": [
            {"case": case.name, "noise_rms_v": case.noise_rms_v, **_of_fit(case.fit, case.times_s[0])}
            for case in simulation.cases
        ],
        "shots": _of_shots(simulation),
        "stages": [
            {"stage": stage.name, "place": stage.place, "draws": stage.draw, "because": stage.reason}
            for stage in chain.stages
        ],
    }


def _of_fit(fit: PulseFit, first_s: float) -> dict[str, Any]:
    pulse = fit.pulse
    return {
        "arrival_s": None if pulse is None else float(first_s) + pulse.arrival_s,
        "fwhm_s": None if pulse is None else pulse.fwhm_s,
        "amplitude_v": None if pulse is None else pulse.amplitude_v,
        "status": fit.status,
    }


def _arrivals(simulation: Simulation) -> list[dict[str, Any]]:
    chain = simulation.chain
    return [
        _of_fit(fit, chain.first_sample_s(index, chain.correlation_window(index)))
        for index, fit in enumerate(simulation.fits)
    ]


def _of_shots(simulation: Simulation) -> dict[str, Any]:
    """Mean and spread over the shots whose fit holds; what needs two shots is null with one."""
    rows = [row for row in _arrivals(simulation) if row["status"] == "ok"]
    found: dict[str, Any] = {"count": len(simulation.shots), "fitted": len(rows)}
    for key, unit in (("arrival_s", "s"), ("fwhm_s", "s"), ("amplitude_v", "V")):
        name = key.rpartition("_")[0]
        values = np.array([row[key] for row in rows])
        found[name] = found[f"{name}_spread"] = None
        if values.size > 1:
            spread = float(values.std(ddof=1))
            found[name] = _measured(float(values.mean()), spread / math.sqrt(values.size), unit)
            found[f"{name}_spread"] = _measured(spread, spread / math.sqrt(2 * (values.size - 1)), unit)
    return found


def _measured(value: float, uncertainty: float, unit: str) -> dict[str, Any]:
    return {"value": value, "standard_uncertainty": uncertainty, "unit": unit}


def _tables(simulation: Simulation) -> dict[str, Table]:
    ground, curves = simulation.ground, simulation.curves
    x_m, y_m = np.meshgrid(ground.x_m, ground.y_m)
    texts = {
        "transmitted_rate": ("s-1", "photons sent; the laser fires at time 0"),
        "received_rate": ("s-1", "photons on the photodiode"),
        "received_power": ("W", "optical power on the photodiode"),
        "before_amplifier": ("V", "at the cut, with shot noise of the echo"),
        "amplified": ("V", "at the converter, without noise"),
    }
    samples: dict[str, Any] = {
        "sample_time": (simulation.cases[0].times_s, "s", "true time of the sample from the gate")
    }
    samples |= {
        case.name.replace("-", "_"): (case.volts, "V", f"samples, {case.name}") for case in simulation.cases
    }
    rows = _arrivals(simulation)
    fits: dict[str, Any] = {
        key: (np.array([np.nan if row[key] is None else row[key] for row in rows]), unit, text)
        for key, unit, text in (
            ("arrival_s", "s", "centre of the Gaussian from the gate"),
            ("fwhm_s", "s", "its full width at half maximum"),
            ("amplitude_v", "V", "its height at the converter"),
        )
    }
    fits["status"] = (np.array([row["status"] for row in rows]), "1", "ok, or what is missing")
    tables = {
        "curve": Table(
            {"time": (simulation.times_s, "s", "from the gate")}
            | {name: (curves[name], unit, text) for name, (unit, text) in texts.items()},
            "time",
        ),
        "samples": Table(samples, "sample_time"),
        "fit": Table(fits, "shot"),
        "ground": Table(
            {
                "x": (x_m.ravel(), "m", "from nadir"),
                "y": (y_m.ravel(), "m", "from nadir"),
                "height": (ground.height_m.ravel(), "m", "above z = 0"),
            },
            "place",
        ),
    }
    return {
        name: Table(
            {
                column if column == table.dimension or column.startswith(name) else f"{name}_{column}": values
                for column, values in table.columns.items()
            },
            table.dimension,
        )
        for name, table in tables.items()
    }


def _figure(simulation: Simulation) -> Figure:
    from procedures.simulate_figure import simulation_figure

    return simulation_figure(simulation)
