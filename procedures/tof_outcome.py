"""The outcome of a test of the time of flight: results for JSON, tables, numbers and notes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.outcome import Outcome, Table
from belahil.pole_response import response
from belahil.pulse_fit import gaussian_fit
from belahil.values import Estimate
from procedures.energy_fit import clusters
from procedures.played_pulses import PlayedPulse
from procedures.pulse_pairs import PulsePair, counted
from procedures.range_reduction import HALF_LIGHT_M_PER_S
from procedures.tof_fit import TofFit, fit_pairs

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from procedures.known_receiver import KnownReceiver

PHASES = 16
BINS = 8
"""Of distances, in which residuals are averaged."""
_AROUND = 4
"""Correlation windows' halves, in widths and time constants, that the expected pulse is computed on."""


@dataclass(frozen=True)
class TofResults:
    """Everything found.

    Parameters
    ----------
    pairs : list of PulsePair
        All windows with a sampled pulse.
    receiver : KnownReceiver
        What is expected of it.
    """

    pairs: list[PulsePair]
    receiver: KnownReceiver

    @property
    def status(self) -> str:
        """Return "ok", or why there is no scale.

        ``no_usable_point``: no window has two pulses; ``equal_windows``: all are equal, though several were
        measured; ``too_few_points``: the pairs do not determine the fit.
        """
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
        if self._equal:
            return None
        variances = np.array([np.square(one.arrival_u_s).sum() for one in self.usable])
        return fit_pairs(
            self.distance_s,
            self.excess_s,
            np.sqrt(variances),
            self.arrivals_s / self.receiver.sample_interval_s,
            self.kinds,
            self.widths,
            self.receiver.converters,
        )

    @cached_property
    def kind_pulses(self) -> list[PlayedPulse]:
        """A played pulse of each kind."""
        return self._first_of(self.kinds)

    @cached_property
    def width_pulses(self) -> list[PlayedPulse]:
        """A played pulse of each width."""
        return self._first_of(self.widths)

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


def outcome(pairs: list[PulsePair], receiver: KnownReceiver) -> Outcome:
    """Bring everything into the form that a run keeps."""
    found = TofResults(pairs, receiver)
    clock = None if found.fit is None else found.fit.scale_ppm
    return Outcome(
        results=_results(found),
        tables=_tables(found),
        numbers={
            "clock_ppm": (clock, "1e-6", "relative error of the receiver's clock, above zero: fast"),
        },
        figures={"tof-linearity": lambda: _figure(found)} if found.status == "ok" else {},
        notes=[
            "The scale is relative to the time base of the generator, whose own error is not in its "
            "uncertainty.",
            "Delays are against the first pulse; a fitted centre is compared with the centroid of the pulse "
            "as it was played.",
            "Not modelled: overlapping pulses, jitter of the generator, a clock that changes in a window.",
        ],
    )


def _results(found: TofResults) -> dict[str, Any]:
    fit = found.fit
    results: dict[str, Any] = {
        "status": found.status,
        "clock_ppm": None if fit is None else fit.scale_ppm.as_json(),
        "wobble": [],
        "range_walk": [],
        "agreement": found.agreement if fit else None,
        "linearity": None,
        "fit": None,
        "points": counted(found.pairs),
    }
    if fit is None:
        return results
    results["wobble"] = [_wobble(found, fit, number) for number in range(len(found.width_pulses))]
    results["range_walk"] = [_walk(found, fit, kind) for kind in range(len(found.kind_pulses))]
    distance_s, worst = max(
        found.residual_bins, key=lambda one: abs(one[1].value) / one[1].standard_uncertainty
    )
    results["linearity"] = {
        "distance_s": distance_s,
        "residual": worst.as_json(),
        "chi_square": sum((one.value / one.standard_uncertainty) ** 2 for _, one in found.residual_bins),
        "bins": len(found.residual_bins),
    }
    results["fit"] = {
        "chi_square": fit.chi_square,
        "degrees_of_freedom": fit.degrees_of_freedom,
        "birge": fit.birge,
    }
    return results


def _wobble(found: TofResults, fit: TofFit, number: int) -> dict[str, Any]:
    pulse = found.width_pulses[number]
    expected = found.expected_delays_s(pulse, found.receiver)
    mine = found.widths == number
    detected = [
        pulse.fwhm_s
        for pair, row in zip(found.usable, mine, strict=True)
        for pulse, own in zip(pair.detected, row, strict=True)
        if own
    ]
    return {
        "width_s": pulse.width_s,
        "detected_width_s": float(np.mean(detected)),
        "rms": fit.wobble_rms(number).as_json() if fit.wobble.any() else None,
        "expected_rms_s": float(np.std(expected)) if expected.size else None,
    }


def _walk(found: TofResults, fit: TofFit, kind: int) -> dict[str, Any]:
    pulse, delay = found.kind_pulses[kind], fit.delays[kind]
    expected_s = float(found.expected_s[kind])
    by_amplitude = found.by_amplitude(kind)
    return {
        "width_s": pulse.width_s,
        "peak_v": pulse.peak_v,
        "delay": delay.as_json(),
        "expected_s": expected_s if math.isfinite(expected_s) else None,
        "by_amplitude": None if by_amplitude is None else by_amplitude.as_json(),
        "range": Estimate(
            HALF_LIGHT_M_PER_S * delay.value, HALF_LIGHT_M_PER_S * delay.standard_uncertainty, "m"
        ).as_json(),
        "pairs": int(np.count_nonzero(found.kinds[:, 1] == kind)),
    }


def _tables(found: TofResults) -> dict[str, Table]:
    pairs = found.pairs
    if not pairs:
        return {}
    ok = np.array([one.status == "ok" for one in pairs])

    def column(values: list[float]) -> Any:
        whole = np.zeros(len(pairs))
        whole[ok] = values
        return np.ma.masked_array(whole, ~ok)

    columns = {
        "tof_shot": (np.array([one.shot for one in pairs]), "1", "shot that the pair was read from"),
        "tof_status": (
            np.array([one.status for one in pairs], dtype=np.str_),
            "1",
            "ok, or why the pair is not used",
        ),
        "tof_distance_s": (column(list(found.distance_s)), "s", "from one played pulse to the other"),
        "tof_excess_s": (column(list(found.excess_s)), "s", "measured less played distance"),
        "tof_excess_u_s": (
            column([math.hypot(*one.arrival_u_s) for one in found.usable]),
            "s",
            "its standard uncertainty by the noise of the window",
        ),
    }
    for number, name in enumerate(("first", "second")):
        for what, unit, text in (
            ("arrival_s", "s", "fitted arrival after the first sample"),
            ("fwhm_s", "s", "detected full width at half maximum"),
            ("amplitude_v", "V", "detected height at the converter"),
        ):
            values = [getattr(one.detected[number], what) for one in found.usable]
            columns[f"tof_{name}_{what}"] = (column(values), unit, f"{text} of the {name} pulse")
        for what, unit, text in (("width_s", "s", "width"), ("peak_v", "V", "peak at the cut")):
            values = [getattr(one.played[number], what) for one in found.usable]
            columns[f"tof_{name}_played_{what}"] = (
                column(values),
                unit,
                f"played {text} of the {name} pulse",
            )
    if found.fit is not None:
        columns["tof_residual_s"] = (column(list(found.fit.residual_s)), "s", "what the fit leaves")
    return {"tof_pair": Table(columns, "tof_pair")}


def _figure(found: TofResults) -> Figure:
    from procedures.tof_figure import tof_figure

    return tof_figure(found)
