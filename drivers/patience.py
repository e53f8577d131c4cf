"""How long an answer is waited for: longer after work, and longer as long as it comes."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from belahil.interfaces import Clock

SLOWEST_BYTES_PER_S = 200.0
"""No line in use is slower: 2400 baud carry 240 bytes a second."""


class Patience:
    """Until when an answer may take.

    Parameters
    ----------
    clock : Clock
        Of the bench.
    allowed_s : float
        Until the first byte, s.
    silent_s : float
        Between bytes, s. All together may take `allowed_s`, and what the bytes so far take on the slowest
        line.
    """

    def __init__(self, clock: Clock, allowed_s: float, silent_s: float) -> None:
        self._clock = clock
        self._begun_s = clock.now_s()
        self._allowed_s = allowed_s
        self._silent_s = silent_s
        self._until_s = self._begun_s + allowed_s
        self._bytes = 0

    def left_s(self) -> float:
        """Return how much longer it may take, s; at least 0."""
        return max(0.0, self._until_s - self._clock.now_s())

    def came(self, count: int) -> None:
        """Wait on: so many bytes have come now."""
        self._bytes += count
        longest_s = self._begun_s + self._allowed_s + self._bytes / SLOWEST_BYTES_PER_S
        self._until_s = max(self._until_s, min(self._clock.now_s() + self._silent_s, longest_s))

    def __str__(self) -> str:
        """How long it was waited, for a message."""
        return f"{self._clock.now_s() - self._begun_s:.3g} s"
