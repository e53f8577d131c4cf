"""From the shots of a campaign to what each echo says: statuses, three tests, a verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from belahil.stimuli import SampledPulse, largest_volts
from belahil.values import Estimate
from procedures.clipping import with_clipping
from procedures.known_receiver import KnownReceiver, preset_receiver
from procedures.noise_covariance import StretchNoise, stretch_noise
from procedures.pulse_prediction import known_path, uncertain_numbers
from procedures.pulse_shape_fit import ShapeFit, fit_shape
from procedures.pulse_shape_plan import LONGEST_STRETCH, trigger_late_s

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from belahil.config import BenchConfig
    from belahil.values import RangeWindow, Shot
    from procedures.pulse_shape_plan import PulseShapePlan, ShapeCase, ShapeStatus

Verdict = Literal["agrees", "differs", "undecided"]

FALSE_ALARMS = 0.0027
"""Probability that a campaign whose predictions are true differs anywhere: that of three standard deviations,
shared by all echoes and tests (Bonferroni)."""
STANDS_OUT, ALL_STAND_OUT = 9.0, 25.0
"""Square of a matched filter, in standard deviations of the noise, below which there is no pulse: the mean of
all windows, or that of all windows at once. Noise alone has some 5, or 10, at the best of all places."""
LEAST_EXPECTED = 100.0
"""The same as predicted for all windows at once: fainter echoes say nothing."""
_SAME_RATE = 1e-3
"""Relative difference of sample intervals from which on a file is another receiver's; clocks err by less."""


@dataclass(frozen=True, slots=True)
class Tested:
    """The three tests of one prediction.

    Parameters
    ----------
    fit : ShapeFit
        The comparison.
    level_u : float
        Standard uncertainty of a reduced chi-square about 1: chance, and the measured noise.
    failed : tuple of str
        Which of "level", "shape" and "numbers" say that it differs.
    """

    fit: ShapeFit
    level_u: float
    failed: tuple[str, ...]

    @property
    def reduced(self) -> float:
        """Chi-square over its degrees of freedom, with the numbers as they are known."""
        return self.fit.chi_square / self.fit.freedom

    @property
    def verdict(self) -> Verdict:
        """Whether anything failed."""
        return "differs" if self.failed else "agrees"


@dataclass(frozen=True, slots=True, eq=False)
class CaseResult:
    """What the windows of one echo say.

    Parameters
    ----------
    case : ShapeCase
        Of the plan.
    status : str
        "ok", or why there is no verdict; where the noise alone is missing, the residuals are there.
    windows : int
        That were used.
    shots : ndarray of int64, shape (m,)
        Their indexes.
    first : int
        First sample of the compared stretch.
    peak_v : float
        Of what was played, at the cut, V.
    count_v, interval_s : float
        Size of a converter step, V; true time between samples, s.
    played : Tested or None
        Against the prediction for what was played; its tests count only with status "ok".
    wished : Tested or None
        Against the prediction for what was wished; None where that is not known.
    """

    case: ShapeCase
    status: ShapeStatus
    windows: int = 0
    shots: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    first: int = 0
    peak_v: float = 0.0
    count_v: float = 0.0
    interval_s: float = 0.0
    played: Tested | None = None
    wished: Tested | None = None

    def level(self, tested: Tested | None) -> Estimate | None:
        """Return the reduced chi-square of one of the two, where noise and pulse allow one."""
        if self.status != "ok" or tested is None:
            return None
        return Estimate(tested.reduced, tested.level_u)

    @property
    def verdict(self) -> Verdict:
        """Of the prediction for what was played."""
        return self.played.verdict if self.status == "ok" and self.played is not None else "undecided"


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """A campaign, compared.

    Parameters
    ----------
    receiver : KnownReceiver
        What the predictions assume.
    cases : tuple of CaseResult
        In the order of the plan.
    noise : mapping of (int or None) to StretchNoise
        By gain code; of a stretch as long as the longest that was compared.
    """

    receiver: KnownReceiver
    cases: tuple[CaseResult, ...]
    noise: Mapping[int | None, StretchNoise]

    @property
    def verdict(self) -> Verdict:
        """Differs when one echo does, else undecided when one is, else agrees."""
        verdicts = {one.verdict for one in self.cases}
        worst: tuple[Verdict, ...] = ("differs", "undecided")
        return next((one for one in worst if one in verdicts), "agrees")


def compared(plan: PulseShapePlan, shots: Iterable[Shot], config: BenchConfig) -> Compared:
    """Compare all windows of a campaign; see `procedures.pulse_shape.analyse`."""
    receiver = plan.receiver or preset_receiver(config)
    place = {shot: number for number, case in enumerate(plan.cases) for shot in case.members}
    silent = {shot: code for code, members in plan.dark for shot in members}
    dark: dict[int | None, list[RangeWindow]] = {code: [] for code, _ in plan.dark}
    found: list[list[Shot]] = [[] for _ in plan.cases]
    for shot in shots:
        index = shot.window.shot
        if index in silent:
            dark[silent[index]].append(with_clipping(shot, plan.bits).window)
        elif index in place:
            found[place[index]].append(with_clipping(shot, plan.bits))
    alpha = FALSE_ALARMS / (3 * len(plan.cases))
    noise = {}
    for code, windows in dark.items():
        counts = [case.sample_count for case in plan.cases if case.gain_code == code]
        length = min(max(counts, default=1), LONGEST_STRETCH)
        noise[code] = stretch_noise(windows, length, plan.converters)
    comparer = _Comparer(plan, config, receiver, noise, alpha)
    cases = tuple(comparer.of(case, ones) for case, ones in zip(plan.cases, found, strict=True))
    return Compared(receiver, cases, noise)


@dataclass(frozen=True, slots=True)
class _Comparer:
    plan: PulseShapePlan
    config: BenchConfig
    receiver: KnownReceiver
    noise: Mapping[int | None, StretchNoise]
    alpha: float

    def of(self, case: ShapeCase, shots: Sequence[Shot]) -> CaseResult:
        """Compare one echo."""
        whole = [shot for shot in shots if not shot.window.saturated]
        status = self._status(case, shots, whole)
        if status != "ok":
            return CaseResult(case, status, len(whole))
        noise = self.noise.get(case.gain_code)
        missing: ShapeStatus = "too_few_samples" if noise is None else noise.status
        played = [shot.played for shot in whole if isinstance(shot.played, SampledPulse)]
        window = whole[0].window
        first, count = self._stretch(case, played[0], whole)
        rows = np.stack([shot.window.volts[first : first + count] for shot in whole])
        if noise is None or noise.status != "ok":
            # Without a law of the noise the residuals stand beside the steps of the converter.
            whitener = np.eye(count) * (math.sqrt(12) / window.volts_per_count)
            offset_v = np.zeros(self.plan.converters) if noise is None else noise.offset_v
            level_u = 0.0
        else:
            whitener, offset_v, level_u = noise.whitener()[:count, :count], noise.offset_v, noise.relative_u
        rows -= np.resize(offset_v, count)
        since_s = [shot.window.start_s + first * window.sample_interval_s for shot in whole]
        expected_s = np.array(since_s) + trigger_late_s(self.config) + window.sample_interval_s / 2
        test = _Testing(self, case, rows, expected_s, whitener, level_u)
        tested = test.of(played, is_played=True)
        wishes = self._wishes(case, whole)
        if missing == "ok":
            missing = _seen(tested.fit)
        return CaseResult(
            case=case,
            status=missing,
            windows=len(whole),
            shots=np.array([shot.window.shot for shot in whole], dtype=np.int64),
            first=first,
            peak_v=max(map(largest_volts, played)),
            count_v=window.volts_per_count,
            interval_s=self.receiver.true_interval_s,
            played=tested,
            wished=test.of(wishes, is_played=False) if wishes else None,
        )

    def _status(self, case: ShapeCase, shots: Sequence[Shot], whole: Sequence[Shot]) -> ShapeStatus:
        """What makes a comparison impossible."""
        if case.status != "ok":
            return case.status
        if {shot.window.gain_code for shot in shots} != {case.gain_code}:
            return "mixed_gain_codes"
        window = shots[0].window
        ratio = window.sample_interval_s / self.receiver.sample_interval_s
        if abs(ratio - 1) > _SAME_RATE or self.plan.converters != self.receiver.converters:
            return "another_receiver"
        if all(code.code != case.gain_code for code in self.receiver.codes):
            return "another_receiver"
        if len(whole) < 2:
            return "saturated"
        alike = all(np.array_equal(shot.window.counts, whole[0].window.counts) for shot in whole[1:])
        noise = self.noise.get(case.gain_code)
        noisy = noise is not None and noise.status == "ok"
        return "equal_windows" if alike and noisy else "ok"

    def _stretch(self, case: ShapeCase, pulse: SampledPulse, shots: Sequence[Shot]) -> tuple[int, int]:
        """First sample and number of samples that are compared: all, or those round the predicted pulse."""
        size = min(shot.window.counts.size for shot in shots)
        count = min(size, LONGEST_STRETCH)
        window, path = shots[0].window, known_path(self.receiver, case.gain_code)
        if size == count:
            return 0, count
        begin_s = trigger_late_s(self.config) + window.start_s
        volts = np.abs(path.volts(pulse, np.array([begin_s]), size)[0])
        first = int(np.argmax(volts)) - count // 2
        first = min(max(first, 0), size - count)
        # It begins with the first converter, as the windows do.
        return first - first % self.plan.converters, count

    def _wishes(self, case: ShapeCase, shots: Sequence[Shot]) -> list[SampledPulse]:
        where = {shot: place for place, shot in enumerate(case.members)}
        pulses = [case.pulse_of(where[shot.window.shot]) for shot in shots]
        return [one.wished for one in pulses if one is not None]


@dataclass(frozen=True, slots=True)
class _Testing:
    comparer: _Comparer
    case: ShapeCase
    rows: NDArray[np.float64]
    expected_s: NDArray[np.float64]
    whitener: NDArray[np.float64]
    level_u: float

    def of(self, pulses: Sequence[SampledPulse], *, is_played: bool) -> Tested:
        """Compare the windows with the predictions for some pulses, and test them."""
        from scipy.stats import chi2, norm

        comparer, case = self.comparer, self.case
        setting_vpp = min((one.setting_vpp for one in case.pulses), default=0.0)
        uncertain = uncertain_numbers(comparer.receiver, case.gain_code, comparer.config, setting_vpp)
        if not is_played:
            # A wished pulse has passed no output whose bandwidth could be uncertain.
            uncertain.pop("output", None)
        path = known_path(comparer.receiver, case.gain_code)
        fit = fit_shape(path, uncertain, pulses, self.rows, self.expected_s, self.whitener)
        level_u = math.hypot(math.sqrt(2 / fit.freedom), self.level_u)
        failed = []
        if abs(fit.adjusted / fit.freedom - 1) > norm.isf(comparer.alpha / 2) * level_u:
            failed.append("level")
        if chi2.sf(fit.shape, fit.shape_freedom) < comparer.alpha:
            failed.append("shape")
        if (
            uncertain
            and chi2.sf(sum(pull**2 for pull in fit.pulls.values()), len(uncertain)) < comparer.alpha
        ):
            failed.append("numbers")
        return Tested(fit, level_u, tuple(failed))


def _seen(fit: ShapeFit) -> ShapeStatus:
    """Tell whether the windows show a pulse at all."""
    if not fit.placement.is_free and fit.expected < LEAST_EXPECTED:
        return "pulse_below_noise"
    if fit.stands_out < (STANDS_OUT if fit.placement.is_free else ALL_STAND_OUT):
        return "no_pulse"
    return "ok" if np.mean(fit.placement.within) > 0.5 else "not_converged"
