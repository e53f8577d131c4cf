"""How fast bytes leave: the rate of a line, and how long an instrument takes before it answers."""

from __future__ import annotations

from collections import deque

_BITS_PER_BYTE = 10
"""A start bit, eight of data, a stop bit."""
_STEP_S = 1e-3
"""Bytes of so much time leave together, and none of them too early."""

_ROUNDING = 1e-6
"""Part of a byte that a clock's rounding may cost: without it the last byte of a step waits for nothing."""


class LinePace:
    """Tells how many of the bytes that a device has said may have left by now.

    Parameters
    ----------
    baud : float
        Bits per second of the line, ten of them to a byte; infinity for a line that takes no time.
    latency_s : float
        From when the device answers to when the first byte begins to leave.

    Notes
    -----
    What this does not model: the time that bytes take on their way to the device, and parity bits.
    """

    def __init__(self, baud: float, latency_s: float = 0.0) -> None:
        self._byte_s = _BITS_PER_BYTE / baud
        self._latency_s = latency_s
        # Begin of the first byte that has not left, and how many there are from there on.
        self._answers: deque[tuple[float, int]] = deque()
        self._free_at_s = 0.0

    def queue(self, count: int, now_s: float) -> None:
        """Take notice of an answer of `count` bytes, which goes behind those before it."""
        begin_s = max(now_s + self._latency_s, self._free_at_s)
        self._answers.append((begin_s, count))
        self._free_at_s = begin_s + count * self._byte_s

    def ready(self, now_s: float) -> int:
        """Bytes whose last bit may have left by `now_s`."""
        return sum(self._left(begin_s, count, now_s) for begin_s, count in self._answers)

    def sent(self, count: int) -> None:
        """Forget the first `count` bytes: they have left."""
        while count:
            begin_s, waiting = self._answers.popleft()
            gone = min(count, waiting)
            count -= gone
            if gone < waiting:
                self._answers.appendleft((begin_s + gone * self._byte_s, waiting - gone))

    def next_s(self, now_s: float) -> float:
        """Time when it is worth looking again; infinity when nothing waits."""
        for begin_s, count in self._answers:
            left = self._left(begin_s, count, now_s)
            if left < count:
                step = max(1, int(_STEP_S / self._byte_s)) if self._byte_s else count
                return begin_s + min(count, left + step) * self._byte_s
        return float("inf")

    def _left(self, begin_s: float, count: int, now_s: float) -> int:
        if now_s < begin_s:
            return 0
        return min(count, int((now_s - begin_s) / self._byte_s + _ROUNDING)) if self._byte_s else count
