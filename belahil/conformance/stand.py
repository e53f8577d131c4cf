"""What rules are tried on: a generator that plays no more than it may, a digitizer that counts its shots."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from belahil.clock import SystemClock
from belahil.conformance.rules import Broken, NotApplicable, shown
from belahil.generator_models import per_50_ohm
from belahil.stimuli import NoSignal, SampledPulse, Sine, largest_volts
from belahil.uncertainty import sized
from belahil.values import WindowRequest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from belahil.interfaces import Clock, Digitizer, FunctionGenerator
    from belahil.stimuli import Stimulus
    from belahil.values import RangeWindow, Trigger

READ_TIMEOUT_S = 2.0
GAIN_CODE = 4
SAMPLES = 4000
_SINE_HZ = 1e6
_SINE_PART, _PULSE_PART = 0.5, 0.8
"""Of `max_vpp`."""
_PULSE_RATE_HZ = 50e6
_PULSE_POINTS = 101
_PULSE_AFTER_S = 2e-6


@dataclass(frozen=True, slots=True)
class GuardedGenerator:
    """A generator whose output is on only for a stimulus that it may play, and off again afterwards.

    Parameters
    ----------
    generator : FunctionGenerator
        Under test, or the one that stands before the digitizer under test.
    max_vpp : float
        Largest span into the load setting, offset included: twice the largest magnitude, V.
    load_ohm : float
        The load that it is set to, ohm; ``inf`` for high impedance.
    trigger_delay_s : float
        ``[bench] trigger_delay_s``.
    trigger : {"generator", "digitizer"}
        Who triggers the other one on this bench.
    """

    generator: FunctionGenerator
    max_vpp: float
    load_ohm: float = 50.0
    trigger_delay_s: float = 0.0
    trigger: Literal["generator", "digitizer"] = "generator"

    @property
    def smallest_vpp(self) -> float:
        """Smallest amplitude into the load setting, V."""
        return self.generator.limits.min_amplitude_vpp * per_50_ohm(self.load_ohm)

    @property
    def largest_vpp(self) -> float:
        """Largest amplitude into the load setting at low frequencies, V."""
        return 2 * self.generator.limits.max_peak_v * per_50_ohm(self.load_ohm)

    @property
    def sine_hz(self) -> float:
        """Frequency of the sine that is played, Hz."""
        return min(_SINE_HZ, self.generator.limits.max_sine_hz / 10)

    def sine(self) -> Sine:
        """Return the sine that is played: half of what may be."""
        return Sine(self.sine_hz, self._vpp(_SINE_PART))

    def pulse(self) -> SampledPulse:
        """Return the pulse that is played: a Gaussian of 0.8 of what may be, positive alone."""
        rate_hz = min(_PULSE_RATE_HZ, self.generator.limits.max_arb_rate_hz / 2)
        place = np.arange(_PULSE_POINTS) - _PULSE_POINTS // 2
        shape = np.exp(-0.5 * (place / (_PULSE_POINTS / 8)) ** 2)
        shape[[0, -1]] = 0.0
        after_s = self.trigger_delay_s if self.trigger == "generator" else 0.0
        return SampledPulse(self._vpp(_PULSE_PART) / 2 * shape, rate_hz, after_s + _PULSE_AFTER_S)

    def plays(self) -> tuple[str, ...]:
        """Say what is played with the output on, a line for each stimulus."""
        try:
            sine, pulse = self.sine(), self.pulse()
        except NotApplicable as reason:
            return (f"nothing but 0 V: {reason}",)
        load = f"into {self.load_ohm:g} ohm"
        width_s = pulse.volts.size / pulse.sample_rate_hz
        return (
            f"0 V {load}",
            f"a sine of {sized(sine.frequency_hz, 'Hz')} and {sized(sine.amplitude_vpp, 'Vpp')} {load}",
            f"pulses of {sized(largest_volts(pulse), 'V')} {load}, {sized(width_s, 's', 3)} long",
            f"nothing above {sized(self.max_vpp, 'Vpp')} {load}: what lies beyond is only asked for, with "
            "the output off",
        )

    def prepare(self, stimulus: Stimulus, trigger: str = "immediate") -> Stimulus:
        """Prepare a stimulus, and see that what comes back is within `max_vpp`."""
        self._check(stimulus)
        played = self.generator.prepare(stimulus, trigger)
        self._check(played)
        return played

    @contextmanager
    def playing(self, stimulus: Stimulus, trigger: str = "immediate") -> Iterator[Stimulus]:
        """Play a stimulus for a while; the output is off afterwards, however this is left."""
        played = self.prepare(stimulus, trigger)
        try:
            self.generator.output(True)
            yield played
        finally:
            self.generator.output(False)

    def _vpp(self, part: float) -> float:
        wanted = min(part * self.max_vpp, part * self.largest_vpp)
        if wanted < self.smallest_vpp:
            raise NotApplicable(
                f"{part:g} of max_vpp = {self.max_vpp:g} is less than the smallest amplitude, "
                f"{self.smallest_vpp:g} Vpp"
            )
        return wanted

    def _check(self, stimulus: Stimulus) -> None:
        span_vpp = 2 * largest_volts(stimulus)
        if not span_vpp <= self.max_vpp * (1 + 1e-9):
            raise Broken(f"{shown(stimulus)} reaches {span_vpp:g} Vpp; max_vpp = {self.max_vpp:g} is allowed")


@dataclass(slots=True)
class Receiving:
    """A digitizer that is asked for one window after the other, each under a shot of its own.

    Parameters
    ----------
    digitizer : Digitizer
        Under test, or the one that sees what the generator under test plays.
    player : GuardedGenerator or None
        What stands before it.
    start : callable or None
        Starts a window that waits for trigger "generator", in place of `player`.
    clock : Clock
        By which it waits.
    settle_s : float
        After the output was switched, s.
    first_shot : int
        The shots go on from here.
    """

    digitizer: Digitizer
    player: GuardedGenerator | None = None
    start: Callable[[], None] | None = None
    clock: Clock = field(default_factory=SystemClock)
    settle_s: float = 0.0
    first_shot: int = 1

    @property
    def gain_code(self) -> int | None:
        """The gain code nearest to that of a receiver that we know; None without gain codes."""
        codes = self.digitizer.spec.gain_codes
        return None if codes is None else min(codes, key=lambda one: abs(one - GAIN_CODE))

    @property
    def own_trigger(self) -> Trigger:
        """A trigger that needs nobody else, or else the generator's."""
        for trigger in ("immediate", "digitizer"):
            if trigger in self.digitizer.spec.triggers:
                return trigger
        if not self.can_start:
            raise NotApplicable("no window starts without a generator, and none was given")
        return "generator"

    @property
    def can_start(self) -> bool:
        """Whether a window that waits for trigger "generator" can be started."""
        return self.start is not None or (self.player is not None and self.player.trigger == "generator")

    def request(self, **asked: Any) -> WindowRequest:
        """Return a request for the next shot, with what is asked in place of what is usual."""
        self.first_shot += 1
        usual = WindowRequest(
            self.first_shot,
            self.gain_code,
            min(SAMPLES, self.digitizer.spec.max_sample_count),
            trigger=self.own_trigger,
        )
        return replace(usual, **asked)

    def taken(self, request: WindowRequest) -> RangeWindow:
        """Return the window of a request, started by whoever has to."""
        if request.trigger != "generator":
            self.digitizer.arm(request)
            return self._read(request)
        if self.start is not None:
            self.digitizer.arm(request)
            self.start()
            return self._read(request)
        if self.player is None:
            raise NotApplicable("nobody was given who starts a window with trigger = generator")
        with self.player.playing(self.player.pulse(), "generator"):
            self.digitizer.arm(request)
            self.player.generator.trigger()
            return self._read(request)

    def settled(self) -> RangeWindow:
        """Wait until what was switched has settled, and return a window."""
        self.clock.sleep_s(self.settle_s)
        return self.taken(self.request())

    def _read(self, request: WindowRequest) -> RangeWindow:
        return self.digitizer.read(READ_TIMEOUT_S + max(0.0, request.delay_s))


def tone_v(window: RangeWindow, frequency_hz: float) -> float:
    """Amplitude at a frequency, V at the converter, seen through a Hann window."""
    weight = np.hanning(window.counts.size)
    volts = window.volts - np.average(window.volts, weights=weight)
    angle = -2j * np.pi * frequency_hz * window.sample_interval_s * np.arange(volts.size)
    return float(2 * np.abs(np.sum(weight * volts * np.exp(angle))) / np.sum(weight))


def silence(player: GuardedGenerator) -> None:
    """Switch off and prepare 0 V."""
    player.generator.output(False)
    player.prepare(NoSignal())
