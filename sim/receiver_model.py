"""The receiver right of the cut: filter, small-signal behaviour, gain, noise, converters.

The plant and the chain of a scene use the same model. What a receiver lacks is left out when the model is
built: each gain code has its list of effects, and no effect that would change nothing is on it.

What this does not model: saturation, slewing and recovery of the amplifiers (only the converters clip), a
bandwidth that depends on the gain code, noise that is not white before the filter (1/f, lines, interference),
drift with time and temperature, and everything that `sim.converter` leaves out. The skew of the converters
moves the signal, not the noise. What a `ReceiverTruth` takes from a preset is mostly assumed there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING

import numpy as np

from belahil import butterworth
from belahil.errors import ConfigError, RefusedInput
from belahil.pole_response import SampledNoise, response
from belahil.stimuli import NoSignal, SampledPulse, Sine
from belahil.values import RangeWindow
from sim.converter import Quantizer, SampleGrid, mismatch_gain, mismatch_offset
from sim.draws import Draws
from sim.emc_burst import FilteredBurst

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from belahil.receiver import DigitizerSpec
    from belahil.receiver_truth import ReceiverTruth
    from belahil.values import WindowRequest

Effect = Callable[["NDArray[np.float64]", Draws], None]
"""Changes the volts of a window in place."""


@dataclass(frozen=True)
class ReceiverModel:
    """A receiver as it really is.

    Parameters
    ----------
    truth : ReceiverTruth
        Filter, gain, noise, small-signal behaviour and converters. Its `input_ohm` is not used here: a
        stimulus is in volts at the cut, with the receiver connected.
    digitizer : DigitizerSpec
        Nominal rate, gain codes and longest window; the resolution is that of `truth`.

    Raises
    ------
    ConfigError
        A high-pass above the low-pass, or a mismatch of another number of converters than two.

    Notes
    -----
    In this order: interference of the shot; low-pass and high-pass; dead zone; cubic term; gain; noise; gain
    and offset of each converter; quantization. The first four act on the input-referred voltage u. The dead
    zone turns u into ``sign(u) max(|u| - deadband, 0)``, the cubic term into ``u + cubic u**3``.
    """

    truth: ReceiverTruth
    digitizer: DigitizerSpec
    spec: DigitizerSpec = field(init=False)
    grid: SampleGrid = field(init=False)
    quantizer: Quantizer = field(init=False)
    poles: tuple[complex, ...] = field(init=False)
    burst: FilteredBurst | None = field(init=False, repr=False, compare=False)
    effects: dict[int | None, tuple[Effect, ...]] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        truth, digitizer = self.truth, self.digitizer
        mismatch = truth.interleave
        if digitizer.converters != 2 and (mismatch.gain or mismatch.offset_v or mismatch.skew_s):
            raise ConfigError(
                f"interleave with {digitizer.converters} converters: mismatch is modelled for two converters"
            )
        if truth.highpass_hz >= truth.cutoff_hz:
            raise ConfigError(
                f"highpass_hz = {truth.highpass_hz:g}: must be below cutoff_hz = {truth.cutoff_hz:g}"
            )
        true_interval_s = digitizer.sample_interval_s / (1 + truth.clock_ppm * 1e-6)
        poles = butterworth.poles(truth.cutoff_hz, truth.order, truth.highpass_hz)
        self._set("spec", replace(digitizer, bits=truth.adc_bits))
        self._set("grid", SampleGrid(true_interval_s, mismatch.skew_s))
        self._set("quantizer", Quantizer(truth.adc_full_scale_v, truth.adc_bits))
        self._set("poles", poles)
        burst = truth.emc_burst if truth.emc_burst.amplitude_v else None
        self._set("burst", None if burst is None else FilteredBurst(burst, poles, self.zeros))
        codes: tuple[int | None, ...] = digitizer.gain_codes or (None,)
        noise = None
        if any(truth.noise_rms_v_by_code):
            noise = SampledNoise(poles, self.zeros, true_interval_s)
        by_code = zip(codes, truth.gain_by_code, truth.noise_rms_v_by_code, strict=True)
        self._set(
            "effects",
            {code: _effects(truth, gain, noise if rms_v else None, rms_v) for code, gain, rms_v in by_code},
        )

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    @property
    def zeros(self) -> int:
        """Zeros at s = 0: one with a high-pass."""
        return 1 if self.truth.highpass_hz else 0

    def window(
        self,
        stimulus: NoSignal | Sine | SampledPulse,
        request: WindowRequest,
        draws: Draws,
        trigger_s: float = 0.0,
    ) -> RangeWindow:
        """Digitize one window.

        Parameters
        ----------
        stimulus : NoSignal, Sine or SampledPulse
            Volts at the cut.
        request : WindowRequest
            Its gain code is one of `spec`.
        draws : Draws
            Of this shot: "phase" of a sine, "sampling_phase" of a pulse, "noise".
        trigger_s : float
            When the trigger reaches the receiver, on the time axis of the stimulus, s.

        Returns
        -------
        RangeWindow
            Read-only counts. The trigger arrives at a random part of a sample before an edge of the
            receiver's clock; sample 0 is taken ``round(delay_s / nominal interval)`` edges later, and
            `start_s` is that many nominal intervals.
        """
        return self.digitized(self.converted(stimulus, request, draws, trigger_s), request)

    def converted(
        self,
        stimulus: NoSignal | Sine | SampledPulse,
        request: WindowRequest,
        draws: Draws,
        trigger_s: float = 0.0,
    ) -> NDArray[np.float64]:
        """Return the volts at the converter that `window` quantizes, shape (sample_count,)."""
        edges = self.edges(request)
        volts = self._filtered(stimulus, request.sample_count, edges, draws, trigger_s)
        # A shot pulse that starts a window also fires the laser.
        if self.burst is not None and request.trigger == "digitizer":
            since_s = (draws.uniform("sampling_phase") + edges) * self.grid.interval_s
            volts += self.burst.at(self.grid.times_s(request.sample_count, since_s))
        return self.at_converter(volts, request.gain_code, draws)

    def edges(self, request: WindowRequest) -> int:
        """Return how many edges of the receiver's clock after its trigger a window begins.

        Raises
        ------
        RefusedInput
            A request that no receiver could take, see `WindowRequest.check`; or a gain code that this one
            has not.
        """
        request.check()
        if request.gain_code not in self.effects:
            codes = self.spec.gain_codes
            allowed = f"{codes[0]} to {codes[-1]}" if codes else "None, since the receiver has no codes,"
            raise RefusedInput(f"gain code {request.gain_code!r}: {allowed} is allowed")
        return round(request.delay_s / self.spec.sample_interval_s)

    def at_converter(
        self, volts: NDArray[np.float64], gain_code: int | None, draws: Draws
    ) -> NDArray[np.float64]:
        """Turn filtered, input-referred volts, shape (n,), in place into volts at the converter."""
        for effect in self.effects[gain_code]:
            effect(volts, draws)
        return volts

    def digitized(self, volts: NDArray[np.float64], request: WindowRequest) -> RangeWindow:
        """Quantize volts at the converter, shape (n,), which are overwritten."""
        counts, saturated = self.quantizer.counts(volts)
        counts.setflags(write=False)
        return RangeWindow(
            counts=counts,
            volts_per_count=self.quantizer.volts_per_count,
            zero_count=float(self.quantizer.zero_count),
            sample_interval_s=self.spec.sample_interval_s,
            start_s=self.edges(request) * self.spec.sample_interval_s,
            gain_code=request.gain_code,
            shot=request.shot,
            saturated=saturated,
        )

    def _filtered(
        self,
        stimulus: NoSignal | Sine | SampledPulse,
        sample_count: int,
        edges: int,
        draws: Draws,
        trigger_s: float,
    ) -> NDArray[np.float64]:
        """Input-referred volts after the filter at the true sample instants."""
        if isinstance(stimulus, Sine):
            return self._steady_state(stimulus, sample_count, 2 * np.pi * draws.uniform("phase"))
        if isinstance(stimulus, SampledPulse):
            first_s = trigger_s + (draws.uniform("sampling_phase") + edges) * self.grid.interval_s
            return response(
                stimulus.volts,
                stimulus.sample_rate_hz,
                stimulus.start_s,
                stimulus.interpolation,
                stimulus.poles + self.poles,
                self.grid.times_s(sample_count, first_s),
                zeros=self.zeros,
            )
        return np.zeros(sample_count)

    def _steady_state(self, sine: Sine, sample_count: int, phase_rad: float) -> NDArray[np.float64]:
        """Closed form: the sine keeps its frequency, the offset passes unless there is a high-pass."""
        truth = self.truth
        passed, turned = _transfer(sine.frequency_hz, truth.cutoff_hz, truth.order, truth.highpass_hz)
        volts = self.grid.sine(sample_count, sine.frequency_hz, phase_rad + turned)
        volts *= sine.amplitude_vpp / 2 * passed
        if sine.offset_v and not self.zeros:
            volts += sine.offset_v
        return volts


@lru_cache(maxsize=1024)
def _transfer(frequency_hz: float, cutoff_hz: float, order: int, highpass_hz: float) -> tuple[float, float]:
    filtered = frequency_hz, cutoff_hz, order, highpass_hz
    return float(butterworth.magnitude(*filtered)), float(butterworth.phase(*filtered))


def _effects(
    truth: ReceiverTruth, gain: float, noise: SampledNoise | None, rms_v: float
) -> tuple[Effect, ...]:
    """List what happens between filter and quantization at one gain code; what is neutral is not on it."""
    found = small_signal_effects(truth)
    if gain != 1:
        found.append(partial(amplify, gain=gain))
    if noise is not None:
        found.append(partial(add_noise, noise=noise, rms_v=rms_v))
    if truth.interleave.gain:
        found.append(partial(mismatch_gain, gain=truth.interleave.gain))
    if truth.interleave.offset_v:
        found.append(partial(mismatch_offset, offset_v=truth.interleave.offset_v))
    return tuple(found)


def small_signal_effects(truth: ReceiverTruth) -> list[Effect]:
    """List what acts on the input-referred voltage behind the filter, in this order."""
    found: list[Effect] = []
    if truth.small_signal.deadband_v:
        found.append(partial(dead_zone, deadband_v=truth.small_signal.deadband_v))
    if truth.small_signal.cubic_per_v2:
        found.append(partial(cubic, cubic_per_v2=truth.small_signal.cubic_per_v2))
    return found


def dead_zone(volts: NDArray[np.float64], draws: Draws, *, deadband_v: float) -> None:
    """Remove what is smaller than the dead band, and the dead band from the rest."""
    np.copysign(np.maximum(np.abs(volts) - deadband_v, 0.0), volts, out=volts)


def cubic(volts: NDArray[np.float64], draws: Draws, *, cubic_per_v2: float) -> None:
    """Add ``cubic u**3``."""
    volts += cubic_per_v2 * volts * volts * volts


def amplify(volts: NDArray[np.float64], draws: Draws, *, gain: float) -> None:
    """From the input to the converter."""
    volts *= gain


def add_noise(volts: NDArray[np.float64], draws: Draws, *, noise: SampledNoise, rms_v: float) -> None:
    """Add stationary Gaussian noise, coloured by the receiver's filter; `rms_v` at the converter."""
    drawn = noise.draw(draws.stream("noise"), volts.size)
    drawn *= rms_v
    volts += drawn
