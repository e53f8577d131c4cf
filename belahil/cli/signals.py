"""Ctrl-C and SIGTERM: stop between two shots, with the output off."""

from __future__ import annotations

import signal
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import FrameType


class Interrupted(BaseException):
    """The user or the system asked us to stop."""


class _Watch:
    def __init__(self) -> None:
        self.asked = 0
        self.deferring = False

    def heard(self, number: int, frame: FrameType | None) -> None:
        # While measuring, the first request waits for the end of the shot, so that no instrument is left in
        # the middle of an exchange; the second does not wait. More would disturb switching the output off.
        self.asked += 1
        if self.asked == (2 if self.deferring else 1):
            raise Interrupted


_watch = _Watch()
_SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def watched() -> Iterator[None]:
    """Turn both signals into `Interrupted` while the context lasts."""
    global _watch
    _watch = _Watch()
    before = {number: signal.signal(number, _watch.heard) for number in _SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def deferred() -> Iterator[None]:
    """Let the first signal wait until `check`."""
    _watch.deferring = True
    try:
        yield
    finally:
        _watch.deferring = False


def check() -> None:
    """Raise `Interrupted` if a signal came."""
    if _watch.asked:
        raise Interrupted
