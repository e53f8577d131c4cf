"""Locks among the HiSLIP clients of one instrument (IVI-6.1, 6.5): one exclusive, one that several share."""

from __future__ import annotations

from enum import IntEnum


class LockAnswer(IntEnum):
    """Control code of the answer to a lock request."""

    FAILURE = 0
    GRANTED = 1
    ERROR = 3


class ReleaseAnswer(IntEnum):
    """Control code of the answer to a release."""

    EXCLUSIVE = 1
    SHARED = 2
    ERROR = 3


class Locks:
    """Who holds which lock; clients are numbers."""

    def __init__(self) -> None:
        self._exclusive: int | None = None
        self._shared: set[int] = set()
        self._key = ""

    def request(self, client: int, key: str) -> LockAnswer:
        """Try to get a lock: the exclusive one without a key, else the one that is shared under it.

        A failure may become a success when others let go; an error cannot.
        """
        if key:
            return self._request_shared(client, key)
        if self._exclusive == client:
            return LockAnswer.ERROR
        if self._exclusive is not None or (self._shared and client not in self._shared):
            return LockAnswer.FAILURE
        self._exclusive = client
        return LockAnswer.GRANTED

    def release(self, client: int) -> ReleaseAnswer:
        """Let go of a lock, of the exclusive one first."""
        if self._exclusive == client:
            self._exclusive = None
            return ReleaseAnswer.EXCLUSIVE
        if client in self._shared:
            self._shared.discard(client)
            return ReleaseAnswer.SHARED
        return ReleaseAnswer.ERROR

    def drop(self, client: int) -> None:
        """Let go of all locks of a client that has left."""
        while self.release(client) is not ReleaseAnswer.ERROR:
            pass

    def bars(self, client: int) -> bool:
        """Whether a client has to wait for others before the instrument listens to it."""
        if self._exclusive is not None:
            return self._exclusive != client
        return bool(self._shared) and client not in self._shared

    @property
    def is_exclusive(self) -> bool:
        """Whether somebody has the exclusive lock."""
        return self._exclusive is not None

    @property
    def holders(self) -> int:
        """How many clients have a lock."""
        return len(self._shared | ({self._exclusive} - {None}))

    def _request_shared(self, client: int, key: str) -> LockAnswer:
        if client in self._shared or self._exclusive == client:
            return LockAnswer.ERROR
        if (self._shared and key != self._key) or (self._exclusive is not None and not self._shared):
            return LockAnswer.FAILURE
        self._key = key
        self._shared.add(client)
        return LockAnswer.GRANTED
