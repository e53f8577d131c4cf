"""Where chunks are computed: in this process, in processes of this machine, or on a cluster."""

from __future__ import annotations

import multiprocessing
import os
import signal
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from belahil.chunks import ThisProcess
from belahil.errors import RefusedInput, WorkerLost

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

SCHEDULER_TIMEOUT_S = 10.0
_SCHEMES = ("tcp", "tls", "ws", "wss")
"""Of a scheduler's address."""


@dataclass(frozen=True, slots=True)
class Workers:
    """Who computes.

    Parameters
    ----------
    count : int
        How many work at once.
    open : callable
        Opens an executor of them.
    ahead : int
        Chunks that wait behind the one that each computes.
    """

    count: int
    open: Callable[[], AbstractContextManager[Executor]]
    ahead: int = 0

    @property
    def in_flight(self) -> int:
        """Chunks to hand out at once."""
        return self.count * (1 + self.ahead)


def available_cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def local_workers(count: int | None = None) -> Workers:
    """Return workers of this machine.

    Parameters
    ----------
    count : int or None
        None: one for each core; 1: this process itself.

    Raises
    ------
    RefusedInput
        Fewer than one.
    """
    found = available_cores() if count is None else count
    if found < 1:
        raise RefusedInput(f"--workers {found}: at least 1 is needed")
    if found == 1:
        return Workers(1, ThisProcess)
    return Workers(found, lambda: _processes(found), ahead=1)


@contextmanager
def _processes(count: int) -> Iterator[Executor]:
    # Fresh processes everywhere: a fork of one with threads may hang, and platforms should not differ.
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(count, mp_context=fresh, initializer=_leave_signals) as pool:
        yield pool


def _leave_signals() -> None:
    """Let only the process that hands out the work hear Ctrl-C; it waits for what has begun."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def cluster_workers(address: str) -> Workers:
    """Return the workers of a dask scheduler.

    Parameters
    ----------
    address : str
        As in ``tcp://host:8786``.

    Raises
    ------
    RefusedInput
        The library is not installed, or the address is none.
    WorkerLost
        No scheduler answers, or it has no workers.
    """
    _check_address(address)
    try:
        from distributed import Client, KilledWorker
    except ImportError as error:
        raise RefusedInput(
            f"--cluster {address}: needs the library distributed; install belahil[cluster]"
        ) from error
    with _client(Client, address) as client:
        count = sum(client.nthreads().values())
    if not count:
        raise WorkerLost(f"--cluster {address}: the scheduler has no workers")

    @contextmanager
    def opened() -> Iterator[Executor]:
        with _client(Client, address) as client, client.get_executor(pure=False, retries=1) as pool:
            try:
                yield pool
            except KilledWorker as error:
                raise WorkerLost("every worker that began it died") from error

    # None ahead: a scheduler blames a worker's death on all that was with it.
    return Workers(count, opened)


def _check_address(address: str) -> None:
    """Refuse what is no address, at once: the library's own refusal takes 20 s to take its threads down."""
    try:
        parts = urlsplit(address)
        whole = parts.scheme in _SCHEMES and parts.hostname and parts.port and not parts.path
    except ValueError:
        whole = False
    if not whole:
        raise RefusedInput(f"--cluster {address}: write tcp://HOST:PORT, as in tcp://scheduler:8786")


@contextmanager
def _client(kind: Any, address: str) -> Iterator[Any]:
    try:
        client = kind(address, timeout=SCHEDULER_TIMEOUT_S, set_as_default=False)
    except OSError as error:
        raise WorkerLost(f"--cluster {address}: no scheduler answers") from error
    with client:
        yield client
