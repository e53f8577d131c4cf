"""Faults of a link: declared beforehand, checked against what the link can do, counted when they happen.

`sim.faulty_devices` applies a plan beneath the vendor libraries, so that drivers meet its faults as they
would meet those of a cable. What this does not model: the pace, and more than one fault of a message.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from belahil.errors import BelahilError, RefusedInput

LinkName = Literal["visa", "serial", "usb"]
Direction = Literal["to_device", "from_device"]
Kind = Literal["late", "drop", "double", "flip", "cut", "old_shot", "close"]

LINKS: tuple[LinkName, ...] = ("visa", "serial", "usb")
DIRECTIONS: tuple[Direction, ...] = ("to_device", "from_device")
KINDS: tuple[Kind, ...] = ("late", "drop", "double", "flip", "cut", "old_shot", "close")


class NeverFired(BelahilError):
    """A fault of a plan did not happen, so whatever was shown was not shown."""


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that goes wrong with one message.

    Parameters
    ----------
    link : {"visa", "serial", "usb"}
        Which link.
    direction : {"to_device", "from_device"}
        Which way the message goes.
    kind : {"late", "drop", "double", "flip", "cut", "old_shot", "close"}
        It comes only after a time-out has expired; never; twice; with one bit changed; without its end; as
        a window of an earlier shot; or it and all later ones fail since the link is closed.
    at : int
        Index of the message among those of its link and direction, from 0. "old_shot" strikes the first
        window at or after it that has an earlier one.
    seed : int
        Decides which bit, and where the message is cut.

    Raises
    ------
    RefusedInput
        The link cannot do that.
    """

    link: LinkName
    direction: Direction
    kind: Kind
    at: int
    seed: int = 0

    def __post_init__(self) -> None:
        for value, allowed in ((self.link, LINKS), (self.direction, DIRECTIONS), (self.kind, KINDS)):
            if value not in allowed:
                raise RefusedInput(f"a fault with {value!r}: allowed are {', '.join(allowed)}")
        if self.at < 0:
            raise RefusedInput(f"a fault of message {self.at}: the first one is 0")
        if self.kind == "old_shot" and (self.link == "visa" or self.direction == "to_device"):
            raise RefusedInput(
                f"old_shot on {self.link} {self.direction}: only serial and usb carry windows, from_device"
            )

    def struck(self, message: bytes) -> list[bytes]:
        """Return what becomes of a message that is dropped, doubled, flipped or cut."""
        chance = random.Random(self.seed)
        match self.kind:
            case "drop":
                return []
            case "double":
                return [message, message]
            case "flip":
                changed = bytearray(message)
                changed[chance.randrange(len(message))] ^= 1 << chance.randrange(8)
                return [bytes(changed)]
            case "cut":
                return [message[: chance.randrange(len(message))]]
        raise ValueError(f"{self.kind} is not done to the message alone")


class FaultPlan:
    """The faults of one bench.

    Parameters
    ----------
    faults : iterable of Fault
        At most one for each message.

    Raises
    ------
    RefusedInput
        Two for the same message.
    """

    def __init__(self, faults: Iterable[Fault]) -> None:
        self._faults: dict[tuple[LinkName, Direction, int], Fault] = {}
        for fault in faults:
            place = (fault.link, fault.direction, fault.at)
            if place in self._faults:
                raise RefusedInput(f"{fault} and {self._faults[place]}: one fault for each message")
            self._faults[place] = fault
        self.fired: Counter[Fault] = Counter()
        self.messages: Counter[tuple[LinkName, Direction]] = Counter()
        """Messages that each link has carried, whether struck or not."""

    def next(self, link: LinkName, direction: Direction) -> Fault | None:
        """Count a message and return the fault that is due with it."""
        index = self.messages[link, direction]
        self.messages[link, direction] += 1
        return self._faults.get((link, direction, index))

    def require_fired(self) -> None:
        """Check that each fault has happened exactly once.

        Raises
        ------
        NeverFired
            With those that have not.
        """
        missing = [fault for fault in self._faults.values() if self.fired[fault] != 1]
        if missing:
            raise NeverFired(f"{len(missing)} of {len(self._faults)} faults did not happen: {missing}")
