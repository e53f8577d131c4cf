"""Ctrl-C, SIGTERM and a terminal that goes away: stop between two shots, with the output off."""

from __future__ import annotations

import signal
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import FrameType

    from belahil.bench import Bench


class Interrupted(BaseException):
    """The user or the system asked us to stop."""


class _Watch:
    def __init__(self) -> None:
        self.asked = False
        self.deferring = False
        self.leaving = False

    def heard(self, number: int, frame: FrameType | None) -> None:
        # While measuring, the first request waits for the end of the shot, so that no instrument is left in
        # the middle of an exchange; the second does not wait. On the way out none may disturb switching the
        # output off.
        waits = self.leaving or (self.deferring and not self.asked)
        self.asked = True
        if not waits:
            self.leave()

    def leave(self) -> None:
        self.leaving = True
        raise Interrupted


_watch = _Watch()
# Not every system has all: Windows sends the last one for Ctrl-Break.
_SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name)
)


@contextmanager
def watched() -> Iterator[None]:
    """Turn these signals into `Interrupted` for a while; what is ignored (under nohup) stays so."""
    global _watch
    _watch = _Watch()
    heeded = [number for number in _SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, _watch.heard) for number in heeded}
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


@contextmanager
def closing(bench: Bench) -> Iterator[Bench]:
    """Close a bench at the end, where a signal waits until its output is off."""
    try:
        yield bench
    finally:
        left, _watch.leaving = _watch.leaving, True
        bench.__exit__(*sys.exc_info())
        _watch.leaving = left
    check()


def check() -> None:
    """Raise `Interrupted` if a signal came."""
    if _watch.asked:
        _watch.leave()
