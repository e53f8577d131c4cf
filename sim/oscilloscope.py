"""An oscilloscope at the receiver's analog output: the receiver's own filter, gain and noise, its converter.

What this does not model: noise, bandwidth and gain error of the oscilloscope itself (they count as the
receiver's), missing codes, jitter of its trigger beside the place between two samples, peak detection,
averages and high resolution.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from belahil.oscilloscopes import SCOPES, scope_spec
from belahil.receiver import receiver_preset
from belahil.receiver_truth import receiver_truth
from belahil.values import RangeWindow
from sim.receiver_model import ReceiverModel

if TYPE_CHECKING:
    from belahil.config import BenchConfig
    from belahil.stimuli import NoSignal, SampledPulse, Sine
    from belahil.values import WindowRequest
    from sim.draws import Draws


_MOST_MODELS = 8


class ScopeReceiver:
    """A receiver without a converter, and the oscilloscope that digitizes what comes out of it.

    Parameters
    ----------
    config : BenchConfig
        Its driver is one of `SCOPES`.

    Attributes
    ----------
    full_scale_v, offset_v, interval_s : float
        What the oscilloscope is set to: span of all codes, volts in the middle of the screen, time between
        samples.
    """

    def __init__(self, config: BenchConfig) -> None:
        preset = receiver_preset(config.digitizer.receiver)
        self.model = SCOPES[config.digitizer.driver]
        self.spec = scope_spec(config.digitizer, preset)
        self.full_scale_v = config.digitizer.full_scale_v or preset.adc_full_scale_v
        self.offset_v = 0.0
        self.interval_s = self.spec.sample_interval_s
        self._truth = receiver_truth(config)
        self._models: dict[float, ReceiverModel] = {}
        self._sampled()

    @property
    def zero_code(self) -> float:
        """Code of zero volts."""
        return self.model.zero_code - self.offset_v / self.full_scale_v * self.model.code_count

    def prepare(self) -> None:
        """Make ready for records at `interval_s`.

        Raises
        ------
        RefusedInput
            The receiver's noise cannot be computed there, see `SampledNoise`.
        """
        self._sampled()

    def window(
        self,
        stimulus: NoSignal | Sine | SampledPulse,
        request: WindowRequest,
        draws: Draws,
        trigger_s: float = 0.0,
    ) -> RangeWindow:
        """Digitize a record as `ReceiverModel.window` does a window.

        Returns
        -------
        RangeWindow
            Codes from 0, clipped at both ends; ``trigger_phase_s`` in `housekeeping` is when the first
            sample came after `start_s`.
        """
        receiver = self._sampled()
        volts = receiver.converted(stimulus, request, draws, trigger_s)
        volts *= self.model.code_count / self.full_scale_v
        np.rint(volts + self.zero_code, out=volts)
        lowest, top = self.model.lowest_code, self.model.top_code
        np.clip(volts, lowest, top, out=volts)
        return RangeWindow(
            counts=volts.astype(np.int16),
            volts_per_count=self.full_scale_v / self.model.code_count,
            zero_count=self.zero_code,
            sample_interval_s=self.interval_s,
            start_s=receiver.edges(request) * self.interval_s,
            gain_code=None,
            shot=request.shot,
            saturated=int(np.count_nonzero((volts == lowest) | (volts == top))),
            housekeeping={"trigger_phase_s": draws.uniform("sampling_phase") * self.interval_s},
        )

    def _sampled(self) -> ReceiverModel:
        """Return the receiver as sampled at this interval; few are kept, as clients may try any number."""
        if self.interval_s not in self._models:
            if len(self._models) == _MOST_MODELS:
                del self._models[next(iter(self._models))]
            spec = replace(self.spec, sample_rate_hz=1 / self.interval_s)
            self._models[self.interval_s] = ReceiverModel(self._truth, spec)
        return self._models[self.interval_s]
