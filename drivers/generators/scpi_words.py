"""What dialects share whose output, amplitude and autorange are plain SCPI headers."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from drivers.generators.dialect import Item, agrees, item

if TYPE_CHECKING:
    from belahil.generators import GeneratorSetting
    from drivers.generators.dialect import Expected


class ScpiWords:
    """Reset, output, trigger, and the order of a setting; a family names its headers."""

    output: ClassVar[str]
    """Header of the output's switch."""
    amplitude: ClassVar[str]
    """Header of the amplitude."""
    autorange: ClassVar[str] = ""
    """Header of the voltage autorange, which a waveform leaves off; empty without one."""
    trigger = "*TRG"

    @property
    def off(self) -> Item:
        """What switches the output off."""
        return item(self.output, "0")

    def reset(self) -> tuple[str, ...]:
        """Commands to the settings after a reset, with the smallest amplitude and an empty error queue."""
        return "*RST", "*CLS", f"{self.amplitude} MIN"

    def agrees(self, answer: str, expected: Expected) -> bool:
        """Tell whether an answer is what an item expects."""
        return agrees(answer, expected)

    def ordered(
        self, items: list[Item], setting: GeneratorSetting, before: GeneratorSetting | None
    ) -> list[Item]:
        """Return the items of a setting with the output, which is switched off first and on last."""
        was_waveform = before is not None and before.function == "ARB" and setting.function != "ARB"
        if self.autorange and was_waveform:
            items = [Item(f"{self.autorange} ON", f"{self.autorange}?", "1"), *items]
        output = item(self.output, "1") if setting.output else self.off
        return [*items, output] if setting.output else [output, *items]
