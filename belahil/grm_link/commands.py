"""Commands to the receiver, and the numbers of its reasons to refuse them."""

from __future__ import annotations

import math
import struct
from enum import IntEnum
from typing import TYPE_CHECKING, TypeVar

from belahil.errors import InstrumentRefused, LimitExceeded
from belahil.grm_link.packets import Telecommand
from belahil.values import PRODUCTS, SOURCES, TRIGGERS, WindowRequest

if TYPE_CHECKING:
    from collections.abc import Sequence

RECEIVER_SERVICE = 200
NO_GAIN_CODE = 255

_ARM = struct.Struct(">IBBBBId")

T = TypeVar("T", bound=str)


class Verb(IntEnum):
    """Subtypes of the commands, all of service 200."""

    IDENTIFY = 1
    SPEC = 2
    ARM = 3
    HOUSEKEEPING = 4
    ABORT = 5


class Reason(IntEnum):
    """Why a receiver refuses; 16 bits, further numbers are allowed."""

    UNKNOWN_COMMAND = 1
    MALFORMED = 2
    GAIN_CODE = 3
    SAMPLE_COUNT = 4
    DELAY = 5
    TRIGGER = 6
    SOURCE = 7
    PRODUCTS = 8
    NOT_CAPTURED = 9
    OTHER = 10


def telecommand(
    verb: Verb, sequence_count: int, request: WindowRequest | None = None, *, checked: bool = False
) -> Telecommand:
    """Return the packet of a command; `request` goes with ``Verb.ARM`` only.

    Raises
    ------
    LimitExceeded
        A value of the request does not fit its field.
    """
    data = b"" if request is None else _arm_data(request)
    return Telecommand(RECEIVER_SERVICE, verb, sequence_count, data, checked)


def _arm_data(request: WindowRequest) -> bytes:
    code = NO_GAIN_CODE if request.gain_code is None else request.gain_code
    if request.gain_code == NO_GAIN_CODE:
        raise LimitExceeded(f"gain code {NO_GAIN_CODE}: the link carries 0 to {NO_GAIN_CODE - 1}")
    try:
        return _ARM.pack(
            request.shot,
            code,
            TRIGGERS.index(request.trigger),
            SOURCES.index(request.source),
            PRODUCTS.index(request.products),
            request.sample_count,
            request.delay_s,
        )
    except (struct.error, ValueError) as error:
        raise LimitExceeded(f"{request} does not fit the link: {error}") from error


def read_command(command: Telecommand) -> tuple[Verb, WindowRequest | None]:
    """Return what a telecommand asks, with the request of an arm command.

    Raises
    ------
    InstrumentRefused
        With the `Reason` that the receiver has to answer.
    """
    if command.service != RECEIVER_SERVICE or command.subtype not in set(Verb):
        raise InstrumentRefused(
            f"no command {command.subtype} in service {command.service}", Reason.UNKNOWN_COMMAND
        )
    verb = Verb(command.subtype)
    expected = _ARM.size if verb is Verb.ARM else 0
    if len(command.data) != expected:
        raise InstrumentRefused(
            f"{verb.name} with {len(command.data)} octets of data; it takes {expected}", Reason.MALFORMED
        )
    return verb, _read_arm(command.data) if verb is Verb.ARM else None


def _read_arm(data: bytes) -> WindowRequest:
    shot, code, trigger, source, products, sample_count, delay_s = _ARM.unpack(data)
    if not math.isfinite(delay_s):
        raise InstrumentRefused(f"delay of {delay_s} s", Reason.DELAY)
    return WindowRequest(
        shot=shot,
        gain_code=None if code == NO_GAIN_CODE else code,
        sample_count=sample_count,
        delay_s=delay_s,
        trigger=_chosen(TRIGGERS, trigger, Reason.TRIGGER),
        source=_chosen(SOURCES, source, Reason.SOURCE),
        products=_chosen(PRODUCTS, products, Reason.PRODUCTS),
    )


def _chosen(names: Sequence[T], number: int, reason: Reason) -> T:
    if number >= len(names):
        raise InstrumentRefused(f"{reason.name.lower()} {number}; allowed: 0 to {len(names) - 1}", reason)
    return names[number]
