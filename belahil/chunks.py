"""A large job in chunks: run by any executor, each result a file of its own, none lost, none computed twice.

A chunk is a function's name and plain values, so that it can be sent anywhere, and its result depends on
nothing else: not on the number of workers, not on their order. What many chunks need may be a chunk before
them: `shared` reads it where it is within reach, and else works it out again, to the same bits.
"""

from __future__ import annotations

import hashlib
import importlib
import json
import zipfile
from collections import Counter, deque
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from belahil.errors import StorageError, WorkerLost
from belahil.provenance import belahil_version
from belahil.storage import replacing, storage_error

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from contextlib import AbstractContextManager

    from numpy.typing import NDArray

    Arrays = Mapping[str, NDArray[Any]]
    """What a chunk gives, by name."""

ATTEMPTS = 3
"""A chunk on which a worker was lost so often is given up."""


@dataclass(frozen=True, slots=True)
class Chunk:
    """A part of a large job.

    Parameters
    ----------
    name : str
        What it is, for people; no two of a job have the same.
    work : str
        ``module:function`` that a worker imports; it takes `given` as keywords and returns arrays by name.
    given : mapping
        Values that JSON can hold, key to all randomness included.
    """

    name: str
    work: str
    given: Mapping[str, Any]

    @property
    def key(self) -> str:
        """Digest of all that the result depends on."""
        told = json.dumps([belahil_version(), self.work, dict(self.given)], sort_keys=True)
        return hashlib.sha256(told.encode()).hexdigest()[:32]

    @property
    def file_name(self) -> str:
        """Of its result."""
        return f"{self.key}.npz"


_RESULTS: ContextVar[str | None] = ContextVar("folder of the results of the job", default=None)


def work(
    name: str, given: Mapping[str, Any], version: str | None = None, folder: str | None = None
) -> dict[str, NDArray[Any]]:
    """Do the work of a chunk in this process.

    Parameters
    ----------
    name, given
        As `work` and `given` of `Chunk`.
    version : str or None
        Of belahil where the job was planned; None: this one.
    folder : str or None
        Of the results of the job, for `shared`; None: it works everything out.

    Raises
    ------
    WorkerLost
        This process has another belahil, and would give other results under the same name.
    """
    if version not in (None, belahil_version()):
        raise WorkerLost(f"a worker has belahil {belahil_version()}; this job needs {version}")
    module, _, function = name.partition(":")
    with results_of_job(folder):
        made: Arrays = getattr(importlib.import_module(module), function)(**given)
    return {key: np.asarray(array) for key, array in made.items()}


@contextmanager
def results_of_job(folder: str | None) -> Iterator[None]:
    """Within it, `shared` reads the results in a folder; None: it works everything out."""
    before = _RESULTS.set(folder)
    try:
        yield
    finally:
        _RESULTS.reset(before)


def shared(name: str, given: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Return, within the work of a chunk, the result of another one.

    Read from the results of the job, where they are on a disk of this machine and hold it; else worked out
    here. So a job may have what many need as its first chunks, and depends on none of them.

    Parameters
    ----------
    name, given
        ``work`` and ``given`` of that `Chunk`.
    """
    folder, chunk = _RESULTS.get(), Chunk(name, name, given)
    if folder is not None:
        try:
            return _read(Path(folder) / chunk.file_name)
        except (OSError, ValueError, zipfile.BadZipFile):
            pass
    return work(name, given, folder=folder)


def _read(path: Path) -> dict[str, NDArray[Any]]:
    # Opened here: of a damaged file numpy would leave its own open.
    with open(path, "rb") as opened, np.load(opened, allow_pickle=False) as file:
        return dict(file)


class ChunkStore:
    """Results of chunks as files in a folder, each whole or not there.

    Parameters
    ----------
    folder : Path
        Made when it is not there.

    Raises
    ------
    StorageError
        It cannot be made.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise storage_error(f"{folder}: cannot be made", error) from error

    def _path(self, chunk: Chunk) -> Path:
        return self.folder / chunk.file_name

    def has(self, chunk: Chunk) -> bool:
        """Tell whether its result is there and can be read whole."""
        try:
            with zipfile.ZipFile(self._path(chunk)) as file:
                return file.testzip() is None
        except (OSError, zipfile.BadZipFile):
            return False

    def put(self, chunk: Chunk, result: Arrays) -> None:
        """Keep a result.

        Raises
        ------
        StorageError
            It could not be written; the line names the chunk.
        """
        try:
            with replacing(self._path(chunk)) as temporary, open(temporary, "wb") as file:
                np.savez(file, allow_pickle=False, **result)
        except StorageError as error:
            raise StorageError(f"chunk {chunk.name}: {error}; all chunks before it are kept") from error

    def get(self, chunk: Chunk) -> dict[str, NDArray[Any]]:
        """Return a result.

        Raises
        ------
        StorageError
            It is not there, or damaged.
        """
        try:
            return _read(self._path(chunk))
        except (OSError, ValueError, zipfile.BadZipFile) as error:
            raise StorageError(f"chunk {chunk.name}: {self._path(chunk)} cannot be read ({error})") from error

    def results(self, chunks: Iterable[Chunk]) -> Iterator[dict[str, NDArray[Any]]]:
        """Read results one after the other; memory holds one."""
        return (self.get(chunk) for chunk in chunks)


def run_chunks(
    chunks: Sequence[Chunk],
    store: ChunkStore,
    executor: Callable[[], AbstractContextManager[Executor]],
    in_flight: int,
    progress: Callable[[int, int, Mapping[str, int]], None] = lambda done, total, left: None,
    log: Callable[[str], None] = lambda line: None,
) -> int:
    """Compute the chunks that a store does not hold yet.

    Parameters
    ----------
    chunks : sequence of Chunk
        Of different names.
    store : ChunkStore
        Gets each result as soon as it is there.
    executor : callable
        Opens an executor; called again when one broke because a worker died.
    in_flight : int
        Chunks that are handed out at once; with it memory is bounded.
    progress : callable
        Told (done, all, left by `work`) after each chunk; what it raises ends the job, and all that is
        finished is kept.
    log : callable
        Told when a worker was lost.

    Returns
    -------
    int
        How many were computed.

    Raises
    ------
    WorkerLost
        Workers died on a chunk again and again, or the executor is gone.
    StorageError
        A result could not be kept.
    BelahilError
        What the work itself raised, with the name of the chunk.
    """
    if len({chunk.name for chunk in chunks}) != len(chunks):
        raise ValueError("chunks of one job need different names")
    waiting = deque(chunk for chunk in chunks if not store.has(chunk))
    total, begun = len(chunks), len(waiting)
    left, lost = Counter(chunk.work for chunk in waiting), Counter[str]()
    progress(total - begun, total, left)
    while waiting:
        try:
            with executor() as pool:
                job = _Job(pool, store, waiting, in_flight, left)
                try:
                    job.run(lambda: progress(total - left.total(), total, left))
                except (BrokenExecutor, CancelledError) as error:
                    _again(job.given_back() or [waiting[0]], lost, error, log)
                except BaseException:
                    job.keep_finished()
                    raise
        except WorkerLost as error:
            # What an executor raises knows nothing of chunks.
            raise WorkerLost(f"chunk {waiting[0].name}: {error}; all finished chunks are kept") from error
    return begun


def _again(
    chunks: Sequence[Chunk], lost: Counter[str], error: BaseException, log: Callable[[str], None]
) -> None:
    """Count what was lost with a worker; give up what was lost too often."""
    for chunk in chunks:
        lost[chunk.name] += 1
        log(f"a worker was lost; chunk {chunk.name} is done again")
    if max(lost.values()) >= ATTEMPTS:
        names = ", ".join(name for name, times in lost.items() if times >= ATTEMPTS)
        raise WorkerLost(f"workers were lost {ATTEMPTS} times on {names} ({error or type(error).__name__})")


class _Job:
    """The chunks that are with an executor."""

    def __init__(
        self,
        pool: Executor,
        store: ChunkStore,
        waiting: deque[Chunk],
        in_flight: int,
        left: Counter[str],
    ) -> None:
        self.running: dict[Future[dict[str, NDArray[Any]]], Chunk] = {}
        self._left = left
        self._pool, self._store, self._waiting, self._in_flight = pool, store, waiting, in_flight
        self._folder = str(store.folder.resolve())

    def run(self, told: Callable[[], None]) -> None:
        while self._waiting or self.running:
            while self._waiting and len(self.running) < self._in_flight:
                chunk = self._waiting[0]
                given = (chunk.work, dict(chunk.given), belahil_version(), self._folder)
                self.running[self._pool.submit(work, *given)] = chunk
                self._waiting.popleft()
            done, _ = wait(self.running, return_when=FIRST_COMPLETED)
            for future in done:
                self._keep(future)
                told()

    def _keep(self, future: Future[dict[str, NDArray[Any]]]) -> None:
        chunk = self.running[future]
        try:
            result = future.result()
        except (BrokenExecutor, CancelledError):
            raise
        except Exception as error:
            error.add_note(f"in chunk {chunk.name}; all finished chunks are kept")
            del self.running[future]
            self._waiting.appendleft(chunk)
            raise
        self._store.put(chunk, result)
        self._left[chunk.work] -= 1
        del self.running[future]

    def given_back(self) -> list[Chunk]:
        """Put what was lost first again; return it."""
        self.keep_finished()
        lost = list(self.running.values())
        self._waiting.extendleft(reversed(lost))
        self.running.clear()
        return lost

    def keep_finished(self) -> None:
        """Wait for what has begun, and keep what came of it: a stop loses no finished work."""
        # An executor need not tell that it heard of a cancellation: none waits for that.
        wait([future for future in self.running if not future.cancel()])
        for future in list(self.running):
            if not future.cancelled() and future.exception() is None:
                self._keep(future)


class ThisProcess(Executor):
    """An executor that does the work at once, in this process: for one worker, and to find errors."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Do it, and return what came of it."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future
