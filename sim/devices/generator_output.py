"""From the settings of a channel to what leaves its output."""

from __future__ import annotations

from typing import TYPE_CHECKING

from belahil.generators import ArbBlock, Function, GeneratorSetting, TriggerSource

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from belahil.stimuli import Interpolation
    from sim.devices.generator_channel import Channel

_SHAPES: dict[str, Function] = {"SIN": "SIN", "ARB": "ARB", "DC": "DC"}
_SOURCES: dict[str, TriggerSource] = {"IMM": "IMM", "EXT": "EXT", "BUS": "BUS", "TIM": "TIM"}
_DEFAULT = GeneratorSetting()


class OutputStage:
    """Turns a channel's settings into a `GeneratorSetting`; an unchanged waveform stays the same object."""

    def __init__(self) -> None:
        self._codes: NDArray[np.int16] | None = None
        self._block: ArbBlock | None = None
        self._polarity = ""

    def setting(self, channel: Channel) -> GeneratorSetting:
        """Return what leaves the output; fields that do not matter to it have their defaults.

        A burst that a `GeneratorSetting` cannot describe (several cycles, gated, from a phase, point by
        point) is function "OTHER", as are the shapes that the plant does not know.
        """
        function = _SHAPES.get(channel.function, "OTHER")
        burst = channel.burst and function != "DC"
        if burst and not _is_plain(channel):
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
            trigger_source=_SOURCES[channel.trigger_source] if burst else _DEFAULT.trigger_source,
            trigger_delay_s=channel.trigger_delay_s if burst else _DEFAULT.trigger_delay_s,
        )

    def _arb_block(self, channel: Channel) -> ArbBlock:
        codes = channel.arbs.codes(channel.arb_name)
        # NORM is a vendor's filter without published response; straight lines are assumed.
        interpolation: Interpolation = "linear" if channel.arb_filter == "NORM" else "hold"
        block = self._block
        if (
            block is None
            or self._codes is not codes
            or self._polarity != channel.polarity
            or (block.sample_rate_hz, block.interpolation) != (channel.arb_rate_hz, interpolation)
        ):
            played = -codes if channel.polarity == "INV" else codes
            block = ArbBlock(played, channel.arb_rate_hz, interpolation)
            self._codes, self._polarity, self._block = codes, channel.polarity, block
        return block


def _is_plain(channel: Channel) -> bool:
    """Tell whether a burst is one whole waveform per trigger."""
    return (
        channel.burst_mode == "TRIG"
        and channel.burst_cycles == 1
        and channel.burst_phase_deg == 0
        and channel.arb_advance == "SRAT"
    )


def is_played(setting: GeneratorSetting) -> bool:
    """Tell whether the plant plays a setting as the instrument would."""
    if not setting.output:
        return True
    if setting.function == "SIN":
        return not setting.burst
    if setting.function == "ARB" and not setting.burst:
        return False
    return setting.function != "OTHER" and setting.offset_v == 0
