"""From silent windows to what is told of each gain code, and to the best of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from belahil.errors import RefusedInput
from belahil.stimuli import NoSignal
from belahil.values import Estimate, RangeWindow, Shot
from procedures.clipping import with_clipping
from procedures.dark_noise import LEAST_SIGMA_COUNTS, DarkNoise, centred, dark_noise
from procedures.gaussianity import Gaussianity, gaussianity
from procedures.shot_locked import ShotLocked, shot_locked
from procedures.spectral_lines import SpectralLine, find_lines, spectrum

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from procedures.known_receiver import KnownReceiver
    from procedures.noise import NoisePlan

HIDDEN = ("below_dither", "no_signal")
"""Statuses of a noise that the steps of the converter hide: such a code may be the best."""


@dataclass(frozen=True, slots=True)
class Condition:
    """Noise at one gain code in one condition, laser off or firing.

    Parameters
    ----------
    dark : DarkNoise
        What the histogram and the spectrum tell.
    rms : Estimate or None
        Analog noise at the converter with what is locked to the shot, V rms.
    gaussianity : Gaussianity or None
        None where the status is not "ok".
    lines : tuple of SpectralLine
        Interference at fixed frequencies, the strongest first.
    locked : ShotLocked or None
        What windows have in common; None with the laser off, and where the status is not "ok".
    interval_s : float
        Nominal time between samples, s.
    """

    dark: DarkNoise
    rms: Estimate | None
    gaussianity: Gaussianity | None
    lines: tuple[SpectralLine, ...]
    locked: ShotLocked | None
    interval_s: float


@dataclass(frozen=True, slots=True)
class CodeNoise:
    """Noise at one gain code.

    Parameters
    ----------
    code : int or None
        Gain code.
    off : Condition
        Laser off.
    firing : Condition or None
        Laser firing, where it was measured.
    gain : Estimate or None
        Of the known receiver, V/V; None where it knows none.
    """

    code: int | None
    off: Condition
    firing: Condition | None
    gain: Estimate | None

    @property
    def combined(self) -> Estimate | None:
        """Dark noise and interference of the laser together, at the converter, V: what flight will have."""
        return (self.firing or self.off).rms

    @property
    def is_hidden(self) -> bool:
        """Whether the steps of the converter hide the combined noise."""
        return self.combined is None and (self.firing or self.off).dark.status in HIDDEN

    @property
    def input_off(self) -> Estimate | None:
        """Dark noise by the gain, V at the cut."""
        return referred(self.off.rms, self.gain)

    @property
    def input_combined(self) -> Estimate | None:
        """Combined noise by the gain, V at the cut."""
        return referred(self.combined, self.gain)


def referred(noise: Estimate | None, gain: Estimate | None) -> Estimate | None:
    """Refer noise to the input, with the uncertainties of both; None where one is missing."""
    if noise is None or gain is None or gain.value <= 0 or noise.value <= 0:
        return None
    relative = math.hypot(noise.standard_uncertainty / noise.value, gain.standard_uncertainty / gain.value)
    return Estimate(noise.value / gain.value, noise.value / gain.value * relative, "V")


@dataclass(frozen=True, slots=True)
class NoiseResults:
    """Everything that silent windows tell.

    Parameters
    ----------
    codes : tuple of CodeNoise
        In the order of the plan.
    firing : tuple of bool
        For each shot of the run whether its window was started by the shot pulse, which fired the laser.
    """

    codes: tuple[CodeNoise, ...]
    firing: tuple[bool, ...]

    @property
    def ranked(self) -> list[tuple[Estimate, int]]:
        """Combined input-referred noise and gain code, the least noise first."""
        known = [(one.input_combined, one.code) for one in self.codes]
        found = [(noise, code) for noise, code in known if noise is not None and code is not None]
        return sorted(found, key=lambda pair: pair[0].value)

    @property
    def best_code(self) -> int | None:
        """Gain code of least combined noise at the input; None where nobody can tell."""
        if any(one.gain is not None and one.is_hidden for one in self.codes) or not self.ranked:
            return None
        return self.ranked[0][1]

    @property
    def runner_up(self) -> tuple[int, Estimate] | None:
        """The next code, and how much more noise it has, V at the cut."""
        if self.best_code is None or len(self.ranked) < 2:
            return None
        (least, _), (more, code) = self.ranked[:2]
        spread = math.hypot(least.standard_uncertainty, more.standard_uncertainty)
        return code, Estimate(more.value - least.value, spread, "V")


def noise_results(plan: NoisePlan, shots: Iterable[Shot], known: KnownReceiver) -> NoiseResults:
    """Read every silent window of a plan.

    Parameters
    ----------
    plan : NoisePlan
        What was measured.
    shots : iterable of Shot
        In any order; those that are not in the plan are passed over.
    known : KnownReceiver
        Whose gains refer the noise to the input.
    """
    planned = {shot: (code, firing) for shot, code, firing in plan.windows}
    windows: dict[tuple[int | None, bool], list[RangeWindow]] = {}
    fired = []
    for shot in shots:
        fired.append(planned.get(shot.window.shot, (None, False))[1])
        window = with_clipping(shot, plan.bits).window
        if isinstance(shot.played, NoSignal) and window.shot in planned:
            code, firing = planned[window.shot]
            windows.setdefault((window.gain_code, firing), []).append(window)
            if window.gain_code != code:
                raise RefusedInput(f"shot {window.shot} has gain code {window.gain_code}, planned was {code}")
    return NoiseResults(
        tuple(
            CodeNoise(
                code,
                condition(windows[code, False], plan.converters, firing=False),
                condition(windows[code, True], plan.converters, firing=True)
                if (code, True) in windows
                else None,
                _gain(known, code, windows[code, False][0].sample_interval_s),
            )
            for code in plan.codes
        ),
        tuple(fired),
    )


def _gain(known: KnownReceiver, code: int | None, interval_s: float) -> Estimate | None:
    """Return the known gain; None at another code, or for windows of another receiver."""
    if not known.samples_every(interval_s):
        return None
    return next((one.gain for one in known.codes if one.code == code), None)


def condition(windows: Sequence[RangeWindow], converters: int, *, firing: bool) -> Condition:
    """Analyse the windows of one gain code in one condition.

    Parameters
    ----------
    windows : sequence of RangeWindow
        At least one.
    converters : int
        Interleaved converters.
    firing : bool
        Whether they start with the shot pulse, so that they may have something in common.
    """
    dark, interval_s = dark_noise(windows, converters), windows[0].sample_interval_s
    if dark.status != "ok" or dark.fit is None:
        return Condition(dark, None, None, (), None, interval_s)
    volts = np.array([centred(one.counts, converters) for one in windows]) * windows[0].volts_per_count
    locked, rms = None, dark.rms
    if firing:
        locked = shot_locked(windows, converters, dark.effective)
        if locked.status == "ok":
            volts -= locked.mean_v
            rms = with_burst(locked, windows[0].volts_per_count)
    lines = find_lines(spectrum(volts, 1 / interval_s))
    return Condition(dark, rms, gaussianity(windows, dark.fit), lines, locked, interval_s)


def with_burst(locked: ShotLocked, volts_per_count: float) -> Estimate | None:
    """Return the rms of noise and burst together without rounding, V; None where the steps hide it.

    A burst leaves no Gaussian whose histogram could be fitted. So the variances serve: that of what differs
    between windows, less a twelfth of a squared code, and that of what they have in common. What rounding
    adds beside that twelfth depends on the mean within a code and counts as uncertainty, as in
    `procedures.sine_noise`.

    Parameters
    ----------
    locked : ShotLocked
        Of status "ok".
    volts_per_count : float
        Size of a code, V.
    """
    assert locked.locked_rms is not None
    square = volts_per_count**2
    noise = locked.random_v2 / square - 1 / 12
    if noise < LEAST_SIGMA_COUNTS**2:
        return None
    rounding = (1 / math.pi**2 + 4 * noise) * math.exp(-2 * math.pi**2 * noise) / math.sqrt(2) * square
    burst = locked.locked_rms
    total = noise * square + burst.value**2
    spread = math.hypot(locked.random_u_v2, rounding, 2 * burst.value * burst.standard_uncertainty)
    return Estimate(math.sqrt(total), spread / (2 * math.sqrt(total)), "V")
