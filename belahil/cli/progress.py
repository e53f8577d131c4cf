"""How far a measurement is: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from collections import Counter, defaultdict
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING

from belahil.cli import signals

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from typing import Protocol

    class Progress(Protocol):
        """What is called after each shot or chunk."""

        def __call__(self, done: int, total: int, left: Mapping[str, int] | None = None) -> None:
            """Tell what is done, of how many, and what is left by its kind, where it has kinds."""


PLAIN_EVERY_S = 5.0
BAR_EVERY_S = 0.1

_FEWEST = 4
"""So many of a kind tell its pace."""
_ENOUGH = 0.9
"""Part of what is left whose pace must be known before anything is said of the time."""


class Pace:
    """The steady pace of each kind of work, in this process.

    The first of each kind tells nothing: before it processes start, libraries are read and loops compiled.

    Examples
    --------
    >>> pace = Pace()
    >>> for done, now_s in enumerate([0.0, 60.0, 61.0, 62.0, 63.0, 64.0]):
    ...     pace.see({"echoes": 10 - done}, now_s)
    >>> pace.left_s({"echoes": 5})
    5.0
    """

    def __init__(self) -> None:
        self._seen: Mapping[str, int] = {}
        self._last_s = 0.0
        self._met: set[str] = set()
        self._spent_s: defaultdict[str, float] = defaultdict(float)
        self._counted: Counter[str] = Counter()

    def see(self, left: Mapping[str, int], now_s: float) -> None:
        """Take notice of what is left now, by kind, at a time of any clock, s."""
        done = {kind: count - left.get(kind, 0) for kind, count in self._seen.items()}
        done = {kind: count for kind, count in done.items() if count > 0}
        for kind, count in done.items():
            if kind in self._met:
                self._spent_s[kind] += (now_s - self._last_s) / len(done)
                self._counted[kind] += count
        self._met |= done.keys()
        self._seen, self._last_s = dict(left), now_s

    def left_s(self, left: Mapping[str, int]) -> float | None:
        """Time that is left, s; None while too little is known of it."""
        total = sum(left.values())
        if not total:
            return 0.0
        known = {kind: count for kind, count in left.items() if self._counted[kind] >= _FEWEST}
        covered = sum(known.values())
        if not covered or covered < _ENOUGH * total:
            return None
        own_s = sum(self._spent_s[kind] / self._counted[kind] * count for kind, count in known.items())
        return float(own_s * total / covered)


@contextmanager
def shown(quiet: bool, kept: int | None = None, things: str = "windows") -> Iterator[Progress]:
    """Yield what a procedure calls after each shot, with (done, total).

    It is also where an interrupt that waited for the end of a shot takes effect.

    Parameters
    ----------
    quiet : bool
        Show nothing.
    kept : int or None
        Shots that were measured before; None: what the first call says is done.
    things : str
        What is counted.
    """
    if quiet:
        yield lambda done, total, left=None: signals.check()
    elif sys.stderr.isatty():
        with _bar(kept, things) as tell:
            yield tell
    else:
        yield _every(PLAIN_EVERY_S, kept, partial(_line, things))


def _every(pause_s: float, kept: int | None, tell: Callable[[int, int, str], None]) -> Progress:
    last, pace = time.monotonic(), Pace()

    def progress(done: int, total: int, left: Mapping[str, int] | None = None) -> None:
        nonlocal last
        signals.check()
        now, kinds = time.monotonic(), {"": total - done} if left is None else left
        if kept is None or done >= kept:
            pace.see(kinds, now)
        if now - last >= pause_s or done == total:
            last, left_s = now, pace.left_s(kinds)
            tell(done, total, "" if left_s is None else f", {left_s:.0f} s left")

    return progress


def _line(things: str, done: int, total: int, left: str) -> None:
    print(f"{done} of {total} {things}{left}", file=sys.stderr, flush=True)


@contextmanager
def _bar(kept: int | None, things: str) -> Iterator[Progress]:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    columns = (BarColumn(), MofNCompleteColumn(), TextColumn(f"{things}{{task.fields[left]}}"))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("measuring", total=None, left="")

        def tell(done: int, total: int, left: str) -> None:
            bar.update(task, completed=done, total=total, left=left)

        yield _every(BAR_EVERY_S, kept, tell)
