"""How far a measurement is: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING

from belahil.cli import signals

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

PLAIN_EVERY_S = 5.0
BAR_EVERY_S = 0.1


def left_s(done: int, total: int, kept: int, elapsed_s: float) -> float:
    """Time that is left, s, from the pace of the shots that were really measured.

    Parameters
    ----------
    done, total : int
        Shots.
    kept : int
        Shots of `done` that an earlier process measured.
    elapsed_s : float
        Since this one began.

    Examples
    --------
    >>> left_s(done=60, total=100, kept=50, elapsed_s=2.0)
    8.0
    """
    measured = done - kept
    return elapsed_s / measured * (total - done) if measured > 0 else 0.0


@contextmanager
def shown(
    quiet: bool, kept: int | None = None, things: str = "windows"
) -> Iterator[Callable[[int, int], None]]:
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
        yield lambda done, total: signals.check()
    elif sys.stderr.isatty():
        with _bar(kept, things) as tell:
            yield tell
    else:
        yield _every(PLAIN_EVERY_S, kept, partial(_line, things))


def _every(
    pause_s: float, kept: int | None, tell: Callable[[int, int, float], None]
) -> Callable[[int, int], None]:
    begun = last = time.monotonic()

    def progress(done: int, total: int) -> None:
        nonlocal begun, last, kept
        signals.check()
        now = time.monotonic()
        if kept is None:
            kept, begun = done, now
        if now - last >= pause_s or done == total:
            last = now
            tell(done, total, left_s(done, total, min(kept, done), now - begun))

    return progress


def _line(things: str, done: int, total: int, left: float) -> None:
    print(f"{done} of {total} {things}, {left:.0f} s left", file=sys.stderr, flush=True)


@contextmanager
def _bar(kept: int | None, things: str) -> Iterator[Callable[[int, int], None]]:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    columns = (BarColumn(), MofNCompleteColumn(), TextColumn(f"{things}, {{task.fields[left]:.0f}} s left"))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("measuring", total=None, left=0.0)

        def tell(done: int, total: int, left: float) -> None:
            bar.update(task, completed=done, total=total, left=left)

        yield _every(BAR_EVERY_S, kept, tell)
