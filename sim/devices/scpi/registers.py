"""The registers below a status byte: OPERation and QUEStionable (SCPI-1999 volume 1, chapter 9)."""

from __future__ import annotations

from dataclasses import dataclass

ALL_BITS = 0x7FFF
"""Bit 15 is not used, so that the number is never negative."""


@dataclass(slots=True)
class Register:
    """A condition, the filters of its changes, the events that they let through, and their mask.

    Parameters
    ----------
    condition : int
        What is so now.
    event : int
        What happened since it was read or cleared.
    enable : int
        Which events count for the status byte.
    positive, negative : int
        Conditions whose rise, and whose fall, makes an event.
    """

    condition: int = 0
    event: int = 0
    enable: int = 0
    positive: int = ALL_BITS
    negative: int = 0

    @property
    def summary(self) -> bool:
        """Whether an enabled event has happened."""
        return bool(self.event & self.enable)

    def set(self, bit: int, on: bool) -> None:
        """Follow a condition; what passes the filters is latched in `event`."""
        before = self.condition
        self.condition = before | bit if on else before & ~bit
        self.event |= (self.condition & ~before & self.positive) | (before & ~self.condition & self.negative)

    def take_event(self) -> int:
        """Read and clear the latched events."""
        event, self.event = self.event, 0
        return event

    def preset(self) -> None:
        """Enable nothing, and let each rise through; conditions and events stay."""
        self.enable, self.positive, self.negative = 0, ALL_BITS, 0
