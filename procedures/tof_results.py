"""What pairs of pulses say: their kinds, one fit of all, and what a known receiver makes of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.pole_response import response
from belahil.pulse_fit import gaussian_fit
from belahil.values import Estimate
from procedures.energy_fit import clusters
from procedures.played_pulses import PlayedPulse
from procedures.pulse_pairs import PulsePair
from procedures.tof_fit import TofFit, fit_pairs

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from procedures.known_receiver import KnownReceiver

PHASES = 16
BINS = 8
"""Of distances, in which residuals are averaged."""


@dataclass(frozen=True)
class TofResults:
    """Everything found.

    Parameters
    ----------
    pairs : list of PulsePair
        All windows with a sampled pulse.
    receiver : KnownReceiver
        What is expected of it.
    mixed : bool
        The windows have several gain codes, so their heights and their noise are not of one receiver.
    """

    pairs: list[PulsePair]
    receiver: KnownReceiver
    mixed: bool = False

    @property
    def status(self) -> str:
        """Return "ok", or why there is no scale.

        ``mixed_gain_codes``: there are several; ``no_usable_point``: no window has two pulses;
        ``equal_windows``: all are equal, though several were measured; ``too_few_points``: the pairs do not
        determine the fit.
        """
        if self.mixed:
            return "mixed_gain_codes"
        if not self.usable:
            return "no_usable_point"
        if self._equal:
            return "equal_windows"
        return "ok" if self.fit is not None else "too_few_points"

    @property
    def _equal(self) -> bool:
        return len(self.usable) > 1 and float(np.ptp(self.arrivals_s, axis=0).max()) == 0.0

    @cached_property
    def usable(self) -> list[PulsePair]:
        """Pairs with both arrivals."""
        return [one for one in self.pairs if one.status == "ok"]

    @cached_property
    def distance_s(self) -> NDArray[np.float64]:
        """Of the played pulses, shape (n,)."""
        return np.array([one.distance_s for one in self.usable])

    @cached_property
    def excess_s(self) -> NDArray[np.float64]:
        """Measured less played distance, shape (n,)."""
        return np.array([one.excess_s for one in self.usable])

    @cached_property
    def arrivals_s(self) -> NDArray[np.float64]:
        """Of both pulses, shape (n, 2)."""
        return np.array([[pulse.arrival_s for pulse in one.detected] for one in self.usable]).reshape(-1, 2)

    @cached_property
    def widths(self) -> NDArray[np.int64]:
        """Number of the played width of both pulses, shape (n, 2)."""
        every = np.array([[pulse.width_s for pulse in one.played] for one in self.usable])
        return clusters(every.ravel()).reshape(-1, 2)

    @cached_property
    def kinds(self) -> NDArray[np.int64]:
        """Number of the kind (width and height) of both pulses, shape (n, 2); 0 is the usual first pulse."""
        peaks = np.array([[pulse.peak_v for pulse in one.played] for one in self.usable])
        heights = clusters(peaks.ravel(), apart=0.05).reshape(-1, 2)
        both = self.widths * (int(heights.max(initial=0)) + 1) + heights
        names = np.unique(both)
        numbers = np.searchsorted(names, both)
        if not numbers.size:
            return numbers
        usual = int(np.bincount(numbers[:, 0]).argmax())
        order = np.concatenate([[usual], np.delete(np.arange(names.size), usual)])
        return np.argsort(order)[numbers]

    @cached_property
    def fit(self) -> TofFit | None:
        """Scale, delays and wobble."""
        if self._equal or self.mixed:
            return None
        variances = np.array([np.square(one.arrival_u_s).sum() for one in self.usable])
        wobble = np.array([one.std() if one.size else 0.0 for one in self.width_delays_s])
        return fit_pairs(
            self.distance_s,
            self.excess_s,
            np.sqrt(variances),
            self.arrivals_s / self.receiver.sample_interval_s,
            self.kinds,
            self.widths,
            self.receiver.converters,
            np.hypot(*wobble[self.widths].T) if self.usable else np.zeros(0),
        )

    @cached_property
    def kind_pulses(self) -> list[PlayedPulse]:
        """A played pulse of each kind."""
        return self._first_of(self.kinds)

    @cached_property
    def width_pulses(self) -> list[PlayedPulse]:
        """A played pulse of each width."""
        return self._first_of(self.widths)

    @cached_property
    def width_delays_s(self) -> list[NDArray[np.float64]]:
        """Expected delays of each width at `PHASES` places between two samples; see `expected_delays_s`."""
        return [self.expected_delays_s(one, self.receiver) for one in self.width_pulses]

    def _first_of(self, numbers: NDArray[np.int64]) -> list[PlayedPulse]:
        found: dict[int, PlayedPulse] = {}
        for pair, row in zip(self.usable, numbers.tolist(), strict=True):
            for pulse, number in zip(pair.played, row, strict=True):
                found.setdefault(number, pulse)
        return [found[number] for number in sorted(found)]

    def expected_delays_s(self, pulse: PlayedPulse, receiver: KnownReceiver) -> NDArray[np.float64]:
        """Return what a known receiver delays a played pulse by at `PHASES` places between samples, s.

        Empty where the fit fails, as it does for pulses without a width.
        """
        interval_s = receiver.sample_interval_s
        size = 42
        found = []
        for phase in range(PHASES):
            # The fitted centre comes about the filter's own delay after the pulse's.
            middle_s = pulse.centre_s + receiver_delay_s(receiver)
            first_s = middle_s - (size // 2 - phase / PHASES) * interval_s
            wave = pulse.waveform
            volts = response(
                wave.volts,
                wave.sample_rate_hz,
                wave.start_s,
                wave.interpolation,
                (*wave.poles, *receiver.poles),
                first_s + np.arange(size) * interval_s,
                receiver.zeros,
            )
            fit = gaussian_fit(volts, interval_s)
            if fit.status != "ok" or fit.pulse is None:
                return np.zeros(0)
            found.append(first_s + fit.pulse.arrival_s - pulse.centre_s)
        return np.array(found)

    def expected_walk_s(self, receiver: KnownReceiver) -> NDArray[np.float64]:
        """Return the expected delay of each kind against the reference, s; NaN where it has none."""
        means = [
            float(np.mean(found)) if (found := self.expected_delays_s(one, receiver)).size else math.nan
            for one in self.kind_pulses
        ]
        return np.array(means) - means[0]

    @cached_property
    def expected_s(self) -> NDArray[np.float64]:
        """Of the known receiver."""
        return self.expected_walk_s(self.receiver)

    @cached_property
    def agreement(self) -> dict[str, Any] | None:
        """Chi-square of the measured delays against the expected ones; None without two kinds."""
        fit, expected = self.fit, self.expected_s
        there = np.flatnonzero(np.isfinite(expected) & (np.arange(expected.size) > 0))
        if fit is None or not there.size:
            return None
        cutoff = self.receiver.cutoff
        moved = replace(cutoff, value=cutoff.value + cutoff.standard_uncertainty)
        slope = np.nan_to_num(self.expected_walk_s(replace(self.receiver, cutoff=moved)) - expected)[there]
        delays = np.array([one.value for one in fit.delays])[there]
        covariance = fit.delay_covariance[np.ix_(there, there)] + np.multiply.outer(slope, slope)
        left = delays - expected[there]
        return {
            "chi_square": float(left @ np.linalg.solve(covariance, left)),
            "degrees_of_freedom": int(there.size),
            "largest": float(np.abs(left).max()),
        }

    @cached_property
    def residual_bins(self) -> list[tuple[float, Estimate]]:
        """Distance and mean residual of each bin of distances, s."""
        fit = self.fit
        if fit is None:
            return []
        edges = np.quantile(self.distance_s, np.linspace(0, 1, BINS + 1)[1:-1])
        member = np.searchsorted(edges, self.distance_s, side="right")
        found = []
        for one in np.unique(member):
            mine = member == one
            weight = fit.residual_u_s[mine] ** -2
            mean = float(weight @ fit.residual_s[mine] / weight.sum())
            spread = fit.birge / math.sqrt(weight.sum())
            found.append((float(self.distance_s[mine].mean()), Estimate(mean, spread, "s")))
        return found

    def by_amplitude(self, kind: int) -> Estimate | None:
        """Return the delay of a kind less that of the highest pulse of the same width, s."""
        assert self.fit is not None
        pulses = self.kind_pulses
        same = [k for k, one in enumerate(pulses) if abs(one.width_s / pulses[kind].width_s - 1) < 0.02]
        highest = max(same, key=lambda k: pulses[k].peak_v)
        if highest == kind:
            return None
        along = np.zeros(len(pulses))
        along[kind], along[highest] = 1.0, -1.0
        value = self.fit.delays[kind].value - self.fit.delays[highest].value
        variance = float(along @ self.fit.delay_covariance @ along)
        return Estimate(value, math.sqrt(max(variance, 0.0)), "s")


def receiver_delay_s(receiver: KnownReceiver) -> float:
    """Return the delay of a low-pass at 0 Hz, s: the sum of the time constants of its poles."""
    low = sorted(receiver.poles, key=abs)[receiver.zeros :]
    return float(sum((-1 / pole).real for pole in low))
