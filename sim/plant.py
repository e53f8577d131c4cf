"""The simulated world that an emulated generator and an emulated receiver share.

The generator's side is `Plant.play` and `Plant.trigger`, the receiver's side `Plant.arm`, `Plant.collect`
and `Plant.abort`. The emulated devices and the simulated instruments make exactly these calls, so equal
seeds give equal counts.

The receiver's range finder is that of the chain of a scene, `sim.rfm`; it runs only for windows of which
candidates were asked for.

What this does not model: jitter of any trigger beside the sub-sample phase and the laser's; bursts of sines,
and pulses that repeat or were triggered before the window was armed: such a window sees 0 V; the rest of a
burst at its first point where that is not zero, which no driver of ours sends; anything that changes while a
window is being digitized; time that passes other than by shots, settling and expired time-outs.
`sim.generator_path`, `sim.transmitter`, `sim.receiver_model` and `sim.rfm` say what they leave out.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

from belahil.config import BenchConfig
from belahil.errors import InstrumentRefused
from belahil.generators import GeneratorSetting
from belahil.grm_link import Reason
from belahil.receiver import receiver_preset
from belahil.receiver_truth import receiver_truth
from belahil.stimuli import NoSignal, SampledPulse, Sine
from sim.draws import Draws
from sim.generator_path import generator_path
from sim.receiver_model import ReceiverModel
from sim.transmitter import Transmitter

if TYPE_CHECKING:
    from collections.abc import Mapping

    from belahil.receiver import DigitizerSpec
    from belahil.values import RangeWindow, Trigger, WindowRequest
    from sim.oscilloscope import ScopeReceiver
    from sim.rfm import RangeFinder

FEWEST_SEARCHED = 4
"""Samples that the range finder takes, at least."""
SHOT_PERIOD_S = 0.1
"""The laser's pulse repetition frequency is 10 Hz."""


class PlantClock:
    """Time that moves by what happens, never by sleeping."""

    def __init__(self) -> None:
        self._now_s = 0.0

    def now_s(self) -> float:
        """Time since the plant was built, s."""
        return self._now_s

    def sleep_s(self, duration_s: float) -> None:
        """Let `duration_s` seconds pass at once; nothing when it is not positive."""
        if duration_s > 0:
            self._now_s += duration_s


class Plant:
    """One generator, one receiver and the cut between them.

    Parameters
    ----------
    config : BenchConfig
        The hidden truth in ``[emulation]``, the attenuator, and who triggers when.
    receiver : ReceiverModel or ScopeReceiver, optional
        What digitizes; by default the receiver of the bench file with its own converters.

    Raises
    ------
    ConfigError
        A truth that cannot be.
    """

    def __init__(self, config: BenchConfig, receiver: ReceiverModel | ScopeReceiver | None = None) -> None:
        self._preset = preset = receiver_preset(config.digitizer.receiver)
        self.clock = PlantClock()
        self.identity = f"belahil,{preset.name},EMULATED,0.00-emulated"
        self._path = generator_path(config)
        self._transmitter = Transmitter(config.emulation.transmitter)
        self._receiver = receiver or ReceiverModel(receiver_truth(config), preset.digitizer)
        self._seed = config.emulation.seed
        self._trigger_delay_s = config.bench.trigger_delay_s
        self._setting = GeneratorSetting()
        self._stimulus: NoSignal | Sine | SampledPulse | None = None
        self._armed: WindowRequest | None = None
        self._window: RangeWindow | None = None
        self._window_count = 0

    @property
    def spec(self) -> DigitizerSpec:
        """What the receiver reports of its converters."""
        return self._receiver.spec

    def play(self, setting: GeneratorSetting) -> None:
        """Take notice that what leaves the generator's output has changed."""
        self._setting = setting
        self._stimulus = None

    def trigger(self) -> bool:
        """Give the generator its bus trigger, which also starts a window that waits for the generator.

        Returns
        -------
        bool
            False when the generator does not wait for one.
        """
        if not (self._setting.burst and self._setting.trigger_source == "BUS"):
            return False
        if self._armed is not None and self._armed.trigger == "generator":
            self._capture(self._armed, self._trigger_delay_s)
        return True

    def arm(self, request: WindowRequest) -> None:
        """Prepare one window, in place of any before; unless it waits for the generator it is digitized now.

        Parameters
        ----------
        request : WindowRequest
            Within `spec`.

        Raises
        ------
        InstrumentRefused
            A window of the transmitted pulse that no shot pulse starts, or candidates of too few samples.
        """
        self.abort()
        if request.source == "transmit" and request.trigger != "digitizer":
            raise InstrumentRefused(
                f"source transmit with trigger {request.trigger}; allowed: trigger digitizer, "
                "since the shot pulse fires the laser",
                Reason.SOURCE,
            )
        if request.products != "window" and request.sample_count < FEWEST_SEARCHED:
            raise InstrumentRefused(
                f"{request.sample_count} samples with products {request.products}; "
                f"allowed: {FEWEST_SEARCHED} to {self.spec.max_sample_count}",
                Reason.SAMPLE_COUNT,
            )
        if request.trigger == "generator":
            self._armed = request
        else:
            self._capture(request, -self._trigger_delay_s)

    def collect(self) -> RangeWindow | None:
        """Hand over the window once it has been digitized, and only once; None before."""
        window, self._window = self._window, None
        return window

    def abort(self) -> None:
        """Forget what is armed and what has not been collected."""
        self._armed = self._window = None

    def housekeeping(self) -> Mapping[str, float]:
        """Return the time since the plant was built, and how many windows were digitized."""
        return {"uptime_s": self.clock.now_s(), "window_count": float(self._window_count)}

    def _capture(self, request: WindowRequest, trigger_s: float) -> None:
        """Digitize; `trigger_s` is from the generator's trigger to the receiver's."""
        self._armed = None
        draws = Draws(self._seed, request.shot)
        if request.source == "transmit":
            window = self._receiver.window(self._transmitter.pulse(draws), request, draws)
        else:
            window = self._receiver.window(self._seen_by(request.trigger), request, draws, trigger_s)
        if request.products != "window":
            window = self._range_finder.report(window, request.products)
        self._window = window
        self._window_count += 1
        self.clock.sleep_s(SHOT_PERIOD_S)

    @cached_property
    def _range_finder(self) -> RangeFinder:
        from sim.rfm import RangeFinder

        return RangeFinder.of(self._preset)

    def _seen_by(self, trigger: Trigger) -> NoSignal | Sine | SampledPulse:
        """What is at the cut during a window that was started in this way."""
        if self._stimulus is None:
            self._stimulus = self._path.stimulus(self._setting)
        starts = {"generator": "BUS", "digitizer": "EXT", "immediate": ""}[trigger]
        if isinstance(self._stimulus, SampledPulse) and self._setting.trigger_source != starts:
            return NoSignal()
        return self._stimulus
