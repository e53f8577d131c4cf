"""What a roughness campaign found, computed once from the footprints of all chunks."""

from __future__ import annotations

import itertools
import re
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from procedures.footprint_moments import disc, white_skewness
from procedures.library_azimuths import Azimuths, azimuths
from procedures.pulse_library import PulseLibrary
from procedures.range_ground import SPACING_M
from procedures.range_scenes import MEAN_REFLECTANCE, REFLECTANCES
from procedures.roughness_chunks import CASES, library_of, noise_rms_v
from procedures.roughness_curves import StackedCurves
from procedures.roughness_region import Simulated, Trial, trial
from procedures.roughness_shape import READINGS, Power, Shape, power, shape, slopes_by_library
from procedures.roughness_statistics import Footprints, gathered, joined, mean_of
from procedures.roughness_width import WidthRoughness, terms_s, width_roughness
from sim.draws import Draws
from sim.laser import beam_sigma_m
from sim.scene import Scene, parse_scene

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.campaign_run import CampaignPlan
    from procedures.roughness_statistics import Residual

WHITE = 20_000
"""Footprints of white noise."""
RESIDUALS: tuple[Residual, ...] = ("window", "pulse")
LIMITS = {"single": 0.05, "stacked": 3.0}
"""From which on the shape tells: share of rough footprints above 99 % of the smooth ones; separation of 100
of each in standard deviations. Assumed."""


@dataclass(frozen=True, slots=True)
class Reach:
    """How well rough and smooth ground differ from an altitude.

    Parameters
    ----------
    altitude_m, reflectance : float
        From where, and of the ground.
    powers : dict of Power or None
        By residual; None with too few footprints that were detected.
    """

    altitude_m: float
    reflectance: float
    powers: dict[Residual, Power | None]


@dataclass(frozen=True, slots=True, eq=False)
class Skewness:
    """Skewness of footprints of one kind.

    Parameters
    ----------
    values : ndarray of float64
        About the planes.
    spread : float
        Root mean square.
    beyond, beyond_u : float
        Share outside of what 99 % of white noise has, and its uncertainty; 1 % is white noise.
    white : float
        Standard deviation of white noise on as many posts.
    """

    values: NDArray[np.float64]
    spread: float
    beyond: float
    beyond_u: float
    white: float


@dataclass(frozen=True, eq=False)
class RoughnessResults:
    """All of it, from the plan and the results of its chunks."""

    plan: CampaignPlan
    chunks: list[dict[str, NDArray[Any]]]

    @cached_property
    def scene(self) -> Scene:
        """That the campaign varies."""
        return parse_scene(self.plan.scene)

    @cached_property
    def library(self) -> PulseLibrary:
        """Of flat slopes, at the campaign's altitude."""
        return library_of(self.plan.scene)

    @cached_property
    def fractals(self) -> Footprints:
        """Over the eleven fractals, level and tilted."""
        return self._of("fractal")

    @cached_property
    def everything(self) -> Footprints:
        """The same, the rougher ones and a terrain model."""
        more = [self._of("extra")] + ([] if self.terrain is None else [self.terrain])
        return joined([self.fractals, *more])

    @cached_property
    def terrain(self) -> Footprints | None:
        """Over the terrain model; None without one, and where no footprint has data everywhere."""
        found = gathered(self.plan, self.chunks, "terrain")
        return found if found is not None and found.size else None

    def _of(self, kind: str) -> Footprints:
        found = gathered(self.plan, self.chunks, kind)
        assert found is not None  # every plan has them
        return found

    @cached_property
    def sigma_m(self) -> tuple[float, float]:
        """Standard deviations of the beam on the ground along x and y, m."""
        return beam_sigma_m(self.scene.laser, self.scene.altitude_m)

    @cached_property
    def noise_v(self) -> dict[str, float]:
        """Stationary noise by case, V."""
        return {case: noise_rms_v(self.scene, case, MEAN_REFLECTANCE) for case in CASES[1:]}

    # ---- width

    @cached_property
    def width(self) -> WidthRoughness:
        """Without noise, over the eleven fractals."""
        return width_roughness(self.fractals, self.library, 0)

    @cached_property
    def terms(self) -> dict[float, dict[str, float]]:
        """Of the width, by slope in degrees."""
        return {slope: terms_s(self.scene, self.library, slope) for slope in (0.0, 5.0, 10.0, 20.0, 30.0)}

    # ---- skewness

    @cached_property
    def white(self) -> NDArray[np.float64]:
        """Skewness of white noise on the posts of a footprint on the fractals."""
        return self._white(SPACING_M)

    def _white(self, spacing_m: float) -> NDArray[np.float64]:
        along_m, across_m = self.sigma_m
        by_beam = bool(self.plan.chunks[0].given["by_beam"])
        posts = disc(spacing_m, along_m, across_m=across_m, by_beam=by_beam)
        return white_skewness(posts, spacing_m, WHITE, Draws(self.plan.seed, 0).stream("white"))

    @cached_property
    def skewness(self) -> dict[str, Skewness]:
        """By kind of ground, with white noise on as many posts: level fractals, once; the terrain model."""
        level = np.array([chunk.given.get("tilt_deg") == 0.0 for chunk in self.plan.chunks])
        parts = {"fractals": (self.fractals, level[self.fractals.chunk], self.white)}
        if self.terrain is not None:
            spacing_m = float(self.chunks[int(self.terrain.chunk[0])]["spacing_m"])
            every = np.ones(self.terrain.size, dtype=np.bool_)
            parts["terrain"] = (self.terrain, every, self._white(spacing_m))
        found = {}
        for name, (seen, at, white) in parts.items():
            values = seen.skewness[at]
            low, high = np.quantile(white, (0.005, 0.995))
            outside = ((values < low) | (values > high)).astype(np.float64)
            share, u = mean_of(outside, seen.ground[at])
            spread = float(np.sqrt(np.mean(values**2)))
            found[name] = Skewness(values, spread, share, u, float(white.std()))
        return found

    # ---- shape

    @cached_property
    def shapes(self) -> dict[str, Shape]:
        """Residuals by case."""
        return {case: shape(self.everything, number) for number, case in enumerate(CASES)}

    @cached_property
    def powers(self) -> dict[str, dict[Residual, Power | None]]:
        """Rough against smooth, by case and residual."""
        stream = Draws(self.plan.seed, 0).stream("bootstrap")
        return {
            case: {one: power(self.everything, number, 0, one, stream) for one in READINGS}
            for number, case in enumerate(CASES)
        }

    @cached_property
    def slopes(self) -> dict[str, NDArray[np.float64]]:
        """Slopes of the ground by that of the best pulse, without noise."""
        return slopes_by_library(self.everything, 0)

    @cached_property
    def slope_bias_deg(self) -> tuple[float, float]:
        """Mean of the library's slope less that of the ground, without noise, over the fractals."""
        return mean_of(*self._slope_errors("window"))

    @cached_property
    def slope_lower(self) -> tuple[float, float]:
        """Share of footprints whose best pulse has less than the slope of the ground."""
        error_deg, ground = self._slope_errors("window")
        return mean_of((error_deg < 0).astype(np.float64), ground)

    @cached_property
    def timed_slope_bias_deg(self) -> tuple[float, float]:
        """The bias of best pulses that are not moved in time."""
        return mean_of(*self._slope_errors("timed"))

    def _slope_errors(self, residual: Residual) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        seen = self.fractals
        serves = (seen.width_s[0, 0] > 0) & (seen.slope_deg < self.library.slope_deg.max() - 1)
        return seen.best_deg(residual, 0)[serves] - seen.slope_deg[serves], seen.ground[serves]

    @cached_property
    def azimuths(self) -> Azimuths | None:
        """What the azimuth of a slope does to its pulse; None with a round beam."""
        if np.unique(self.library.azimuth_deg).size == 1:
            return None
        size = self.scene.receiver_spec.correlation_window_samples
        return azimuths(self.fractals, self.library, size)

    @cached_property
    def example(self) -> dict[str, NDArray[Any]]:
        """The footprint of the eleven fractals with the largest residual without noise."""
        own = [
            one
            for chunk, one in zip(self.plan.chunks, self.chunks, strict=True)
            if chunk.name.startswith("fractal") and "example_msr_v2" in one
        ]
        return max(own, key=lambda one: float(one["example_msr_v2"]))

    def beyond_noise(self, case: str) -> int:
        """Samples of the example more than two standard deviations of the noise off its best pulse."""
        off_v = np.abs(self.example["example_samples_v"] - self.example["example_best_v"])
        return int((off_v > 2 * self.noise_v[case]).sum())

    # ---- altitudes and regions

    @cached_property
    def reaches(self) -> tuple[Reach, ...]:
        """Rough against smooth by night, by reflectance and altitude."""
        stream, found = Draws(self.plan.seed, 1).stream("bootstrap"), []
        for altitude_m in self.altitudes_m:
            seen = gathered(self._at(altitude_m), self._results_at(altitude_m), "altitude")
            assert seen is not None
            for number, reflectance in enumerate(REFLECTANCES):
                powers = {one: power(seen, 0, number, one, stream) for one in READINGS}
                found.append(Reach(altitude_m, reflectance, powers))
        return tuple(sorted(found, key=lambda one: (one.reflectance, one.altitude_m)))

    @property
    def altitudes_m(self) -> list[float]:
        """From which rough and smooth ground were compared."""
        return sorted(
            {self._altitude(one.name) for one in self.plan.chunks if one.name.startswith("altitude")}
        )

    def _altitude(self, name: str) -> float:
        return float(name.split(" ")[1])

    def _at(self, altitude_m: float) -> CampaignPlan:
        return replace(self.plan, chunks=tuple(self.plan.chunks[at] for at in self._places(altitude_m)))

    def _results_at(self, altitude_m: float) -> list[dict[str, NDArray[Any]]]:
        return [self.chunks[at] for at in self._places(altitude_m)]

    def _places(self, altitude_m: float) -> list[int]:
        return [
            at
            for at, one in enumerate(self.plan.chunks)
            if one.name.startswith("altitude") and self._altitude(one.name) == altitude_m
        ]

    def highest_m(self, reflectance: float, how: str, residual: Residual) -> tuple[float | None, str]:
        """Return the altitude up to which the shape tells roughness, and how that is known.

        Linear between altitudes with enough footprints. Status "ok"; "not reached": not even from the lowest;
        "beyond": from all of them; "too_few": no altitude has enough.
        """
        found = [
            (one.altitude_m, one.powers[residual]) for one in self.reaches if one.reflectance == reflectance
        ]
        rows = [
            (altitude_m, one.share if how == "single" else one.separation)
            for altitude_m, one in found
            if one is not None
        ]
        least = LIMITS[how]
        if not rows:
            return None, "too_few"
        if rows[0][1] < least:
            return None, "not reached"
        for (low_m, above), (high_m, below) in itertools.pairwise(rows):
            if below < least:
                return low_m + (above - least) / (above - below) * (high_m - low_m), "ok"
        return rows[-1][0], "beyond"

    @cached_property
    def trials(self) -> dict[Residual, dict[str, Trial]]:
        """Regional estimates of terrains by the other sets, by residual, by night and by day."""
        return self._trials(Simulated)

    @cached_property
    def curve_trials(self) -> dict[Residual, dict[str, Trial]]:
        """The same from whole cumulative curves in place of mean logarithms."""
        return self._trials(StackedCurves)

    def _trials(self, stacked: type[Simulated | StackedCurves]) -> dict[Residual, dict[str, Trial]]:
        seen = joined([self.fractals, self._of("extra")])
        numbers = [re.search(r"set (\d+)", one.name) for one in self.plan.chunks]
        sets = np.array([-1 if one is None else int(one[1]) for one in numbers])[seen.chunk]
        return {
            residual: {case: trial(seen, sets, CASES.index(case), residual, stacked) for case in CASES[1:]}
            for residual in RESIDUALS
        }
