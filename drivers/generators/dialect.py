"""What differs between families of generators: how a setting is spelt, read back, uploaded, started."""

from __future__ import annotations

from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING, NamedTuple, Protocol

from belahil.generators import per_50_ohm, round_amplitude

if TYPE_CHECKING:
    from collections.abc import Sequence

    from belahil.generators import ArbBlock, GeneratorModel, GeneratorSetting
    from drivers.scpi import ScpiSession

SCPI_INFINITY = 9.9e37  # SCPI-1999, volume 1, 7.2.1.4
_SWITCHES = {"OFF": "0", "ON": "1"}


class Shown(NamedTuple):
    """A number that the instrument computes: it is compared to the digits that the answer shows."""

    value: float


class Fields(NamedTuple):
    """Names with values that an answer holds among others; numbers to the digits that the family shows."""

    values: tuple[tuple[str, str | float], ...]

    def __str__(self) -> str:
        return ",".join(f"{key},{value}" for key, value in self.values)


Expected = str | float | Shown | Fields


class Item(NamedTuple):
    """One setting: the command that makes it, the query that reads it back, and what that must answer.

    The command is empty for what another item makes.
    """

    command: str
    query: str
    expected: Expected


class Dialect(Protocol):
    """One family's words for the first channel; it holds no state, and talks by itself only in `upload`."""

    @property
    def off(self) -> Item:
        """What switches the output off."""
        ...

    @property
    def trigger(self) -> str:
        """What starts a burst that waits for the bus."""
        ...

    def reset(self) -> Sequence[str]:
        """Commands to the settings after a reset, with the smallest amplitude and an empty error queue."""
        ...

    def base_items(self, model: GeneratorModel, load_ohm: float, largest_v: float) -> list[Item]:
        """Return what is set once after a reset: load, unit, and the instrument's own voltage limits.

        Parameters
        ----------
        model : GeneratorModel
            What the limits may be at most.
        load_ohm : float
            Load setting.
        largest_v : float
            Largest voltage into it, V.
        """
        ...

    def items(
        self, setting: GeneratorSetting, model: GeneratorModel, before: GeneratorSetting | None = None
    ) -> list[Item]:
        """Return a setting in the order in which an instrument accepts it.

        Parameters
        ----------
        setting : GeneratorSetting
            Function SIN, DC or ARB.
        model : GeneratorModel
            Grids of the instrument.
        before : GeneratorSetting or None
            What is set now: offset and half the amplitude must stay within the limits on the way.
        """
        ...

    def upload(self, session: ScpiSession, arb: ArbBlock) -> None:
        """Send the points of a waveform, with the output off."""
        ...

    def agrees(self, answer: str, expected: Expected) -> bool:
        """Tell whether an answer is what an item expects."""
        ...


def item(header: str, value: str | float) -> Item:
    """Return the item of a plain header: ``HEADER value``, read back by ``HEADER?``."""
    sent = value if isinstance(value, str) else repr(float(value))
    return Item(f"{header} {sent}", f"{header}?", value)


def voltage_limit(model: GeneratorModel, load_ohm: float, largest_v: float) -> float:
    """Limit to be set in the instrument, V.

    It is `largest_v` rounded up to the grid of half an amplitude, and no less than the smallest amplitude
    needs.
    """
    unit = per_50_ohm(load_ohm)
    limit_v = round_amplitude(2 * largest_v, model, up=True) / 2
    return min(max(limit_v, model.min_amplitude_vpp * unit / 2), model.max_peak_v * unit)


def sine_voltages(
    amplitude: Item, offset: Item, setting: GeneratorSetting, before: GeneratorSetting | None
) -> list[Item]:
    """Return amplitude and offset of a sine in an order that stays within limits which both respect."""
    rising = before is not None and before.function == "SIN" and setting.amplitude_vpp > before.amplitude_vpp
    return [offset, amplitude] if rising else [amplitude, offset]


def agrees(answer: str, expected: Expected) -> bool:
    """Tell whether an answer is what it must be: a word in any quotes, or exactly the same number.

    A switch may be answered as a word. `Fields` are for the dialects that use them.
    """
    if isinstance(expected, Fields):
        return False
    if isinstance(expected, str):
        said = answer.strip('"').upper()
        return _SWITCHES.get(said, said) == expected
    try:
        if isinstance(expected, Shown):
            shown = Decimal(answer)
            last_digit = Decimal(1).scaleb(int(shown.as_tuple().exponent))
            return abs(shown - Decimal(expected.value)) <= last_digit
        return float(answer) == expected
    except (ValueError, InvalidOperation):
        return False
