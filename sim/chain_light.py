"""The light of a chain: where a shot's photons come from, and when they reach the photodiode."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput
from sim.constants import SPEED_OF_LIGHT_M_PER_S
from sim.detector import in_field_of_view, optical_transmission, solid_angle_sr
from sim.echo import echo
from sim.footprint import Delays, NoReturn, delays, plan_footprint
from sim.footprint_edges import refined
from sim.footprint_plan import Seen
from sim.laser import energy_factor, photon_energy_j, photon_number, pointing_jitter
from sim.optical_echo import Lit, span_s
from sim.terrain_relief import RadialRelief

if TYPE_CHECKING:
    from collections.abc import Callable, Set

    from numpy.typing import NDArray

    from sim.accuracy import Accuracy
    from sim.draws import Draws
    from sim.footprint import FootprintPlan
    from sim.footprint_plan import Method
    from sim.kernel import Kernel
    from sim.pulse_shape import PulseShape
    from sim.scene import Scene
    from sim.terrain import Surface

    Factor = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]

_WANDERED = 6.0
"""Standard deviations of the jitter, to which pixels serve edges: one shot in 65 million is further off."""

_LONGEST_S = 20e-6
"""Of an echo, when pixels are tried."""


_FINER = 16
"""Bins of light in one of the samples', at least, where the pulse has none of its own: 1 % of a picture."""

_FINEST = 4096
"""Of them in a sample interval."""

_SMOOTH = 32
"""Steps of delay from pixel to pixel in the standard deviation of such a pulse: a slope would show them."""

_MOST_PIXELS = 200_000
"""For them, since they are there for the light alone, which no tolerance binds before the receiver."""


def straight_line_step_s(pulse: PulseShape, tolerance: float) -> float:
    """Return the time between points of a pulse from a table at which straight lines keep a tolerance.

    Between two points next to a bend they miss an area of up to step^2 / 8 times the change of slope, next to
    a jump of step / 2 times its height. No filter makes more of such an area than of the pulse, which has 1.
    Half of the tolerance is taken.
    """
    slopes = np.diff(pulse.relative) / np.diff(pulse.times_s)
    bends = float(np.abs(np.diff(slopes, prepend=0.0, append=0.0)).sum())
    jumps = float(pulse.relative[0] + pulse.relative[-1])
    # The root of bends h^2 / 8 + jumps h / 2 = tolerance / 2, in the form that stands without bends.
    root = math.sqrt(jumps**2 + bends * tolerance)
    return 2 * tolerance / (jumps + root) if root else math.inf


class Illumination:
    """Finds the light of each shot of a scene.

    Parameters
    ----------
    scene : Scene
        Laser, detector and law of scattering.
    surface : Surface
        Its ground.
    stages : set of str
        Names from `sim.selection` that the scene calls for.
    """

    def __init__(self, scene: Scene, surface: Surface, stages: Set[str]) -> None:
        self._scene, self._surface = scene, surface
        self.photon_energy_j = photon_energy_j(scene.laser.wavelength_m)
        self.photons_from_white = (
            photon_number(scene.laser)
            / math.pi
            * solid_angle_sr(scene.detector.telescope_radius_m, scene.altitude_m)
            * optical_transmission(scene.detector)
        )
        self._scatters, self._leans, self._looks = True, False, "field of view" in stages
        if "radiation factor" in stages:
            constant = _constant_factor(scene)
            if constant is None:
                self._leans = True
            elif constant:
                self.photons_from_white *= constant
            else:
                self._scatters = False
        self.has_factor = self._leans or self._looks
        self._jitters = "pointing jitter" in stages
        self._energy_jitters = "energy jitter" in stages
        self._means: dict[FootprintPlan, Delays] = {}

    def plan(self, accuracy: Accuracy, kernel: Kernel, interval_s: float) -> FootprintPlan:
        """Plan the footprint for a kernel, as if the light on the ground had no edges.

        Errors as `sim.footprint_plan.plan_footprint`.
        """
        method: Method | None = "grid" if self.has_factor else None
        scene = self._scene
        seen = None
        if self._looks:
            detector, altitude_m = scene.detector, scene.altitude_m
            along, across = (altitude_m * math.tan(angle) for angle in detector.boresight_rad)
            seen = Seen((along, across), altitude_m * math.tan(detector.field_of_view_rad))
        return plan_footprint(
            accuracy, kernel, scene.laser, scene.altitude_m, self._surface, interval_s, method, seen
        )

    def plan_light(
        self, accuracy: Accuracy, kernel: Kernel, interval_s: float, samples: FootprintPlan
    ) -> FootprintPlan:
        """Plan the footprint for the light itself, whose kernel no filter has smoothed.

        No bins keep the tolerance there where a pulse from a table bends or jumps. Then they are so fine that
        straight lines between them keep it behind the receiver, and the pixels so small that a picture of the
        light has no steps; on steep slopes those of a pulse that jumps remain, some percent of the peak.
        Never are pixels larger than those, which edges may have made small.
        """
        try:
            found = self.plan(accuracy, kernel, interval_s)
        except RefusedInput as error:
            if kernel.pulse.pieces:
                raise
            step_s = straight_line_step_s(kernel.pulse, accuracy.tolerance)
            if step_s * _FINEST < interval_s:
                raise RefusedInput(f"{error}; begin and end the table of the pulse with no power") from error
            area_m2 = samples.pixels * samples.pixel_m**2
            tilt = 2 * math.tan(samples.slope_rad) / SPEED_OF_LIGHT_M_PER_S
            smooth_m = kernel.pulse.std_s / _SMOOTH / tilt if tilt else math.inf
            finer = math.ceil(samples.pixel_m / max(smooth_m, math.sqrt(area_m2 / _MOST_PIXELS)))
            pixel_m = samples.pixel_m / max(1, finer)
            return replace(
                samples,
                bin_s=samples.bin_s / max(_FINER, math.ceil(samples.bin_s / step_s)),
                pixel_m=pixel_m,
                pixels=math.ceil(area_m2 / pixel_m**2),
            )
        if 0 < samples.pixel_m < found.pixel_m:
            return replace(found, pixel_m=samples.pixel_m, pixels=samples.pixels)
        return found

    def lit(self, plan: FootprintPlan, draws: Draws | None, align_s: float = 0.0) -> Lit:
        """Return what one shot lights.

        Parameters
        ----------
        plan : FootprintPlan
            From `plan`.
        draws : Draws or None
            Of this shot: "pointing", "energy". None: the mean shot, without jitter.
        align_s : float
            As in `sim.footprint.delays`; without moving beam the delays of the mean shot serve every shot.
        """
        if draws is None or not self._jitters:
            if plan not in self._means:
                self._means[plan] = self._delays(plan, (0.0, 0.0), 0.0)
            light = self._means[plan]
        else:
            light = self._delays(plan, pointing_jitter(self._scene.laser, draws), align_s)
        if draws is None or not self._energy_jitters:
            return Lit(light)
        return Lit(light, energy_factor(self._scene.laser, draws))

    def _delays(self, plan: FootprintPlan, pointing_rad: tuple[float, float], align_s: float) -> Delays:
        scene = self._scene
        if not self._scatters:
            return NoReturn("the ground scatters nothing back: its radiation factor is 0")
        return delays(
            self._surface,
            scene.laser,
            scene.altitude_m,
            plan,
            pointing_rad,
            align_s=align_s,
            factor=self._factor(plan.pixel_m) if self.has_factor else None,
        )

    def refined(self, found: FootprintPlan, accuracy: Accuracy, kernel: Kernel) -> FootprintPlan:
        """Return a plan whose pixels serve edges too; errors as `sim.footprint_edges.refined`.

        They are tried with the mean shot and, where the beam wanders, with shots as far off as `_WANDERED`
        allows: to the edge of a field of view and past it, to axis and rim of a crater or boulder. Errors are
        relative to the brightest of them: of its own peak a shot that an edge darkens may have more.
        """
        if found.method != "grid" or not (self._looks or isinstance(self._surface.relief, RadialRelief)):
            return found
        scene, tries = self._scene, [(0.0, 0.0)]
        if self._jitters:
            tries += self._wandered_rad()
        whole = [delays(self._surface, scene.laser, scene.altitude_m, found, one) for one in tries]
        spans_s = [span_s(kernel, light) for light in whole]
        step_s = found.bin_s * max(1, math.floor(kernel.finest_s / found.bin_s))
        first_s = math.floor(min(begin for begin, _ in spans_s) / found.bin_s) * found.bin_s
        # What a slow high-pass makes of it later tells nothing new.
        last_s = max(min(end, begin + _LONGEST_S) for begin, end in spans_s)
        count = math.ceil((last_s - first_s) / step_s) + 1

        def samples(plan: FootprintPlan) -> NDArray[np.float64]:
            lights = [self._delays(plan, one, 0.0) for one in tries]
            return np.stack([echo(kernel, light, first_s, step_s, count) for light in lights])

        return refined(found, accuracy.spacing, samples)

    def _wandered_rad(self) -> list[tuple[float, float]]:
        """Pointing, beside the laser's own, of shots that an edge meets as wandering lets it."""
        scene, relief = self._scene, self._surface.relief
        far_rad, ways = _WANDERED * max(scene.laser.jitter_rad), set()
        if self._looks:
            away = np.subtract(scene.laser.pointing_rad, scene.detector.boresight_rad)
            off_rad = math.hypot(*away)
            to_edge_rad = max(scene.detector.field_of_view_rad - off_rad, 0.0)
            along, across = away / off_rad if off_rad else (1.0, 0.0)
            ways |= {(one * along, one * across) for one in (far_rad, min(far_rad, to_edge_rad))}
        if isinstance(relief, RadialRelief):
            away = np.arctan(np.divide(relief.centre_m, scene.altitude_m)) - scene.laser.pointing_rad
            off_rad, rim_rad = math.hypot(*away), relief.radius_m / scene.altitude_m
            along, across = away / off_rad if off_rad else (1.0, 0.0)
            for one in (off_rad, off_rad - rim_rad):
                short = min(max(one, -far_rad), far_rad)
                ways.add((short * along, short * across))
        return sorted((float(along), float(across)) for along, across in ways)

    def _factor(self, pixel_m: float) -> Factor:
        factors: list[Factor] = [self._cosine] if self._leans else []
        if self._looks:
            detector, altitude_m = self._scene.detector, self._scene.altitude_m
            factors.append(lambda x_m, y_m: in_field_of_view(detector, altitude_m, x_m, y_m, pixel_m))
        return lambda x_m, y_m: np.asarray(math.prod(factor(x_m, y_m) for factor in factors))

    def _cosine(self, x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Cosine of the incidence, from heights half a step to either side; level where there is none."""
        step_m = self._slope_step_m
        climb = np.zeros(np.broadcast(x_m, y_m).shape)
        for along, across in ((step_m, 0.0), (0.0, step_m)):
            ahead = self._surface.sample(x_m + along / 2, y_m + across / 2)
            behind = self._surface.sample(x_m - along / 2, y_m - across / 2)
            known = ahead.known & behind.known
            climb += np.where(known, (ahead.height_m - behind.height_m) / step_m, 0.0) ** 2
        return np.asarray(1 / np.sqrt(1 + climb))

    @cached_property
    def _slope_step_m(self) -> float:
        if self._surface.spacing_m:
            return self._surface.spacing_m
        return 1e-3 * self._scene.surface.diameter_m


def _constant_factor(scene: Scene) -> float | None:
    """Return the radiation factor, None where it depends on the place."""
    surface = scene.surface
    if surface.photometry == "factor":
        return surface.radiation_factor
    return math.cos(math.radians(surface.slope_deg)) if surface.kind == "plane" else None
