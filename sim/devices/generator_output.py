"""From the settings of a channel to what leaves its output."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from belahil.generators import ArbBlock, Function, GeneratorSetting, TriggerSource

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from belahil.stimuli import Interpolation

_DEFAULT = GeneratorSetting()


class Played(Protocol):
    """What the output of a channel depends on; volts are volts into `load_ohm`."""

    @property
    def output(self) -> bool:
        """Whether the output is on."""
        ...

    @property
    def function(self) -> str:
        """Shape in the family's own word."""
        ...

    @property
    def shape(self) -> Function:
        """The same as the plant knows it."""
        ...

    @property
    def frequency_hz(self) -> float:
        """Of a sine."""
        ...

    @property
    def amplitude_vpp(self) -> float:
        """Peak to peak."""
        ...

    @property
    def offset_v(self) -> float:
        """Offset."""
        ...

    @property
    def load_ohm(self) -> float:
        """The load setting; ``inf`` for high impedance."""
        ...

    @property
    def polarity(self) -> str:
        """NORM or INV."""
        ...

    @property
    def burst(self) -> bool:
        """Whether bursts are played."""
        ...

    @property
    def is_plain_burst(self) -> bool:
        """Whether a burst is one whole waveform per trigger."""
        ...

    @property
    def burst_mode(self) -> str:
        """TRIG for a number of cycles."""
        ...

    @property
    def burst_cycles(self) -> float:
        """How many; infinity for no end."""
        ...

    @property
    def source(self) -> TriggerSource:
        """What starts a burst."""
        ...

    @property
    def trigger_delay_s(self) -> float:
        """From the trigger to the first point."""
        ...

    @property
    def arb_codes(self) -> NDArray[np.int16]:
        """Points of the selected waveform; the same object until it changes."""
        ...

    @property
    def full_code(self) -> int:
        """Code of half the amplitude."""
        ...

    @property
    def point_rate_hz(self) -> float:
        """Points of the selected waveform per second."""
        ...

    @property
    def interpolation(self) -> Interpolation:
        """What is between its points."""
        ...


class OutputStage:
    """Turns a channel's settings into a `GeneratorSetting`; an unchanged waveform stays the same object."""

    def __init__(self) -> None:
        self._codes: NDArray[np.int16] | None = None
        self._block: ArbBlock | None = None
        self._polarity = ""

    def setting(self, channel: Played) -> GeneratorSetting:
        """Return what leaves the output; fields that do not matter to it have their defaults.

        A burst that a `GeneratorSetting` cannot describe (several cycles, gated, from a phase, point by
        point) is function "OTHER", as are the shapes that the plant does not know.
        """
        function = channel.shape
        burst = channel.burst and function != "DC"
        if burst and not channel.is_plain_burst:
            function = "OTHER"
        has_amplitude = function in ("SIN", "ARB")
        return GeneratorSetting(
            output=channel.output,
            function=function,
            frequency_hz=channel.frequency_hz if function == "SIN" else _DEFAULT.frequency_hz,
            amplitude_vpp=channel.amplitude_vpp if has_amplitude else _DEFAULT.amplitude_vpp,
            offset_v=channel.offset_v if function != "OTHER" else _DEFAULT.offset_v,
            load_ohm=channel.load_ohm,
            arb=self._arb_block(channel) if function == "ARB" else None,
            burst=burst,
            trigger_source=channel.source if burst else _DEFAULT.trigger_source,
            trigger_delay_s=channel.trigger_delay_s if burst else _DEFAULT.trigger_delay_s,
        )

    def _arb_block(self, channel: Played) -> ArbBlock:
        codes, rate_hz, interpolation = channel.arb_codes, channel.point_rate_hz, channel.interpolation
        block = self._block
        if (
            block is None
            or self._codes is not codes
            or self._polarity != channel.polarity
            or (block.sample_rate_hz, block.interpolation) != (rate_hz, interpolation)
        ):
            played = -codes if channel.polarity == "INV" else codes
            block = ArbBlock(played, rate_hz, interpolation, channel.full_code)
            self._codes, self._polarity, self._block = codes, channel.polarity, block
        return block


def burst_s(channel: Played) -> float:
    """Time from a trigger to the end of the burst, s; infinity when it does not end by itself."""
    if channel.burst_mode != "TRIG" or channel.function == "DC":
        return 0.0
    if channel.shape == "ARB":
        cycle_s = channel.arb_codes.size / channel.point_rate_hz
    else:
        cycle_s = 1 / channel.frequency_hz
    return channel.trigger_delay_s + channel.burst_cycles * cycle_s


def is_played(setting: GeneratorSetting) -> bool:
    """Tell whether the plant plays a setting as the instrument would."""
    if not setting.output:
        return True
    if setting.function == "SIN":
        return not setting.burst
    if setting.function == "ARB" and not setting.burst:
        return False
    return setting.function != "OTHER" and setting.offset_v == 0
