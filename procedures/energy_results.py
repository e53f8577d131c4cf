"""From points to results: lines and curves of measured and of simulated pulses, and whether they agree."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from belahil.delay_curve import NARROWEST_S, WIDEST_S
from belahil.uncertainty import budget, combined
from belahil.values import Estimate
from procedures.energy_fit import EnergyFit, clusters, fit_energy, mean_variances
from procedures.energy_model import EnergyPoints, footprint_points, plane_points, played_points

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.config import BenchConfig
    from belahil.outcome import BudgetLine
    from procedures.energy_calibration import EnergyOptions
    from procedures.energy_points import Readings
    from procedures.known_receiver import KnownReceiver
    from sim.scene import Scene

INTEGRALS = ("gaussian", "window")
_LEAST_FREEDOM = 2.5
"""Below it the mean of the square of Student's t has no value, or none that says anything."""
_ROUNDING = 1e-5
"""Relative; keeps a covariance without noise invertible."""

PUBLISHED = {"gaussian": (2.94e-7, 4.62e-16, 0.025), "window": (3.09e-7, -3.31e-16, 0.031)}
"""Slope, J/(V s), intercept, J/V, and what remains after interpolation (Nishiyama et al., equations of
E_optical; printed in fJ, mV and ns)."""
PUBLISHED_DEVIATION = 0.14

RESPONSIVITY_RELATIVE = 0.03
"""Assumed standard uncertainty of the scene's transimpedance. It is not published, and 45 kohm were derived
from these very lines, so that an absolute slope is no independent comparison; intercept by slope is one."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """Whether measured pulses are those of the known receiver.

    Parameters
    ----------
    chi_square : float
        Of the mean ratio of each width.
    degrees_of_freedom : int
        Widths.
    largest : float
        Largest relative difference of a width.
    """

    chi_square: float
    degrees_of_freedom: int
    largest: float


@dataclass(frozen=True, slots=True)
class Linearity:
    """E_CW divided by gain and played area, at one height.

    Parameters
    ----------
    peak_v : float
        Played, at the cut.
    ratio : Estimate
        1 for a receiver of the known gain that is linear; its uncertainty is the scatter.
    points : int
        Pulses in it.
    """

    peak_v: float
    ratio: Estimate
    points: int


@dataclass(frozen=True)
class EnergyResults:
    """Everything found.

    Parameters
    ----------
    readings : Readings
        Of the windows.
    receiver : KnownReceiver
        Under test, as far as it is known.
    scene : Scene
        Detector, laser and ground.
    options : EnergyOptions
        As chosen.
    config : BenchConfig
        Declared uncertainties.
    """

    readings: Readings
    receiver: KnownReceiver
    scene: Scene
    options: EnergyOptions
    config: BenchConfig

    @property
    def status(self) -> str:
        """Return "ok", or why there is no line.

        ``no_usable_point``: no window has both integrals; ``equal_windows``: all windows are equal, though
        several were measured; ``too_few_points``: pulses of fewer than three widths.
        """
        if not self.readings.usable.any():
            return "no_usable_point"
        if self._equal:
            return "equal_windows"
        return "ok" if self.measured["gaussian"] else "too_few_points"

    @cached_property
    def points(self) -> EnergyPoints:
        """Measured pulses."""
        return self.readings.points

    @property
    def _equal(self) -> bool:
        points = self.points
        return points.window_s.size > 1 and float(np.ptp(points.window_s)) == 0.0

    @cached_property
    def groups(self) -> NDArray[np.int64]:
        """Width of each measured pulse, by number."""
        return self.readings.group[self.readings.usable]

    @cached_property
    def measured(self) -> dict[str, EnergyFit | None]:
        """Line and curve of each integral; the noise of a pulse goes with 1 / amplitude."""
        points = self.points
        if self._equal:
            return dict.fromkeys(INTEGRALS)
        weights = points.amplitude_v**2
        return {
            name: fit_energy(points.of(name), points.energy_j_per_v, self.groups, weights)
            for name in INTEGRALS
        }

    @cached_property
    def played(self) -> list[EnergyPoints]:
        """The played pulses behind the known receiver, by width."""
        return self._played(self.receiver)

    @cached_property
    def _moved(self) -> list[EnergyPoints]:
        """The same with a cut-off that is higher by its standard uncertainty."""
        cutoff = self.receiver.cutoff
        moved = replace(cutoff, value=cutoff.value + cutoff.standard_uncertainty)
        return self._played(replace(self.receiver, cutoff=moved))

    def _played(self, receiver: KnownReceiver) -> list[EnergyPoints]:
        readings = self.readings
        return played_points(readings.stimuli, receiver, self.scene, readings.finder)

    @cached_property
    def model(self) -> dict[str, EnergyPoints]:
        """Simulated echoes by kind, within the widths that the receiver's range finder is to detect."""
        made = {"planes": plane_points(self.scene, self.receiver, self.readings.finder)}
        if self.options.altitudes_m:
            made["footprints"] = footprint_points(
                self.scene,
                self.receiver,
                self.readings.finder,
                self.options.altitudes_m,
                self.options.footprints,
            )
        return {name: points.within(NARROWEST_S, WIDEST_S) for name, points in made.items()}

    @cached_property
    def scale_parts(self) -> dict[str, float]:
        """Relative standard uncertainties that all points have in common, by source."""
        declared = self.config.generator.uncertainty
        gains = [one.gain for one in self.receiver.codes if one.gain.value in self.readings.gain]
        return {
            f"gain of the receiver ({self.receiver.origin})": max(
                (one.standard_uncertainty / one.value for one in gains), default=0.0
            ),
            "[generator] uncertainty.amplitude_relative": declared.amplitude_relative,
            "[generator] uncertainty.attenuation_db": declared.attenuation_db * math.log(10) / 20,
        }

    @cached_property
    def scale_relative(self) -> float:
        """All of them together."""
        return combined(self.scale_parts.values())

    @cached_property
    def agreement(self) -> dict[str, Agreement | None]:
        """Measured against played pulses; None without a fit."""
        return {name: self._agreement(name) for name in INTEGRALS}

    def _agreement(self, name: str) -> Agreement | None:
        fit = self.measured[name]
        if fit is None:
            return None
        expected, shifted = (_mean_ratios(fit, name, points) for points in (self.played, self._moved))
        there, member = np.unique(self.groups, return_inverse=True)
        weights = self.points.amplitude_v**2
        share = weights / np.bincount(member, weights)[member]
        ratio = self.points.energy_j_per_v / fit.line(self.points.of(name))
        left = np.bincount(member, share * ratio) / expected[there] - 1
        by_cutoff = shifted[there] / expected[there] - 1
        # The wobble with the sampling phase is known, where few points do not tell their scatter.
        each = np.bincount(member, share**2).astype(np.float64)
        wobble = _spreads(fit, name, self.played)[there] ** 2 * each
        spread = np.maximum(_widened(mean_variances(ratio, share, member), each), wobble)
        covariance = (
            np.diag(spread + _ROUNDING**2) + self.scale_relative**2 + np.multiply.outer(by_cutoff, by_cutoff)
        )
        return Agreement(
            float(left @ np.linalg.solve(covariance, left)), there.size, float(np.abs(left).max())
        )

    @cached_property
    def linearity(self) -> list[Linearity]:
        """Conversion of the correlation window by height."""
        readings, found = self.readings, []
        usable = readings.usable
        heights = clusters(readings.peak_v)
        area = readings.gain * readings.area_v_s
        integral = np.array([one.window_v_s for one in readings.pulses])
        for one in np.unique(heights[usable]):
            mine = usable & (heights == one)
            ratio = integral[mine] / area[mine]
            # Pulses of small area are the noisy ones.
            share = area[mine] ** 2 / np.sum(area[mine] ** 2)
            mean = float(share @ ratio)
            freedom = max(1, int(mine.sum()) - 1)
            scatter = math.sqrt(float(share @ (ratio - mean) ** 2) / freedom)
            peak_v = float(readings.peak_v[mine].mean())
            found.append(Linearity(peak_v, Estimate(mean, scatter), int(mine.sum())))
        return found

    def slope(self, name: str) -> Estimate | None:
        """Return the slope of a measured line with all of its uncertainty, J/(V s)."""
        fit = self.measured[name]
        return None if fit is None else self._with_scale(fit.slope)

    def intercept(self, name: str) -> Estimate | None:
        """Return the intercept of a measured line with all of its uncertainty, J/V."""
        fit = self.measured[name]
        return None if fit is None else self._with_scale(fit.intercept)

    def _with_scale(self, one: Estimate) -> Estimate:
        whole = math.hypot(one.standard_uncertainty, self.scale_relative * one.value)
        return replace(one, standard_uncertainty=whole)

    @property
    def budget(self) -> list[BudgetLine]:
        """Of both slopes."""
        lines: list[BudgetLine] = []
        for name in INTEGRALS:
            fit = self.measured[name]
            if fit is not None:
                parts = {source: part * fit.slope.value for source, part in self.scale_parts.items() if part}
                parts["scatter of the pulses"] = fit.slope.standard_uncertainty
                lines += budget(f"slope, {name}", fit.slope.unit, parts)
        return lines


def intercept_by_slope(fit: EnergyFit) -> Estimate:
    """Return b / a, s, which no gain and no responsivity changes."""
    a, b = fit.slope.value, fit.intercept.value
    along = np.array([-b / a**2, 1 / a])
    return Estimate(b / a, math.sqrt(float(along @ fit.covariance @ along)), "s")


def published_deviation(fit: EnergyFit, name: str) -> Estimate:
    """Return the largest relative deviation of the groups of a fit from the published line, with its sign."""
    slope, intercept, _ = PUBLISHED[name]
    scale = fit.line(fit.places_s) / (slope * fit.places_s + intercept)
    ratios = fit.ratios * scale
    worst = int(np.argmax(np.abs(ratios - 1)))
    return Estimate(float(ratios[worst] - 1), float(fit.ratio_u[worst] * scale[worst]))


def _widened(variances: NDArray[np.float64], each: NDArray[np.float64]) -> NDArray[np.float64]:
    """Variances of means for a chi-square, where they were estimated from few points themselves.

    The square of Student's t with n degrees of freedom has the mean n / (n - 2), n + 1 being the number of
    equal points that have the same sum of squared weights, `each`.
    """
    freedom = np.maximum(1 / each - 1, _LEAST_FREEDOM)
    return np.asarray(variances * freedom / (freedom - 2))


def _mean_ratios(fit: EnergyFit, name: str, pulses: list[EnergyPoints]) -> NDArray[np.float64]:
    """Mean over sampling phases of y / line for each group; 1 where no phase has a fit."""
    return np.array([np.mean(one) if one.size else 1.0 for one in _ratios(fit, name, pulses)])


def _spreads(fit: EnergyFit, name: str, pulses: list[EnergyPoints]) -> NDArray[np.float64]:
    """Standard deviation of the same over sampling phases."""
    return np.array([np.std(one) if one.size else 0.0 for one in _ratios(fit, name, pulses)])


def _ratios(fit: EnergyFit, name: str, pulses: list[EnergyPoints]) -> list[NDArray[np.float64]]:
    return [one.energy_j_per_v / fit.line(one.of(name)) for one in pulses]
