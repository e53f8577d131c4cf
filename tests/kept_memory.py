"""Whether something keeps memory: traced in the last tenth of a long run only, since tracing is slow."""

from __future__ import annotations

import gc
import tracemalloc


class Kept:
    """Looks at the memory of a run of `count` steps.

    Parameters
    ----------
    count : int
        Of steps; `look` is called after each.
    """

    def __init__(self, count: int) -> None:
        self._start, self._middle, self._stop = count * 9 // 10, count * 19 // 20, count - 1
        self._before = 0
        self.growth_bytes = 0
        """From the middle of the last tenth to its end."""

    def look(self, number: int) -> None:
        """Take notice that step `number` is done."""
        if number == self._start:
            tracemalloc.start()
        elif number == self._middle:
            self._before = self._now()
        elif number == self._stop:
            self.growth_bytes = self._now() - self._before
            tracemalloc.stop()

    def _now(self) -> int:
        gc.collect()
        return tracemalloc.get_traced_memory()[0]
