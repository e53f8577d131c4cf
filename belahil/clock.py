"""Clocks for deadlines and settling."""

from __future__ import annotations

import time


class SystemClock:
    """The real time, for real instruments."""

    def now_s(self) -> float:
        """Monotonic time, s."""
        return time.monotonic()

    def sleep_s(self, duration_s: float) -> None:
        """Sleep for `duration_s` seconds; nothing when it is not positive."""
        if duration_s > 0:
            time.sleep(duration_s)
