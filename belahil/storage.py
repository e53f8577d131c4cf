"""Files that are either whole or not there, and a folder that one process has to itself."""

from __future__ import annotations

import errno
import os
import sys
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING

from belahil.errors import RefusedInput, StorageError

if TYPE_CHECKING:
    from collections.abc import Iterator

_PORTION_BYTES = 1 << 20

if sys.platform == "win32":
    import msvcrt

    def _lock(handle: IO[bytes]) -> None:
        msvcrt.locking(handle.fileno(), msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _lock(handle: IO[bytes]) -> None:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


def storage_error(what: str, error: OSError) -> StorageError:
    """Put the operating system's reason into one line of ours."""
    return StorageError(f"{what} ({error.strerror or error})")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary name to write to; it takes the place of `path` when all went well.

    Raises
    ------
    StorageError
        The file could not be written; an older `path` is as it was.
    """
    temporary = path.with_name(f".{path.name}.part")
    try:
        yield temporary
        with open(temporary, "r+b") as handle:
            os.fsync(handle.fileno())
        os.replace(temporary, path)
        sync_folder(path.parent)
    except OSError as error:
        raise storage_error(f"{path}: cannot be written", error) from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def write_whole(path: Path, data: str | bytes) -> None:
    """Write a file so that a reader sees the old one or the new one, never a part.

    Raises
    ------
    StorageError
        The file could not be written.
    """
    with replacing(path) as temporary:
        temporary.write_bytes(data.encode() if isinstance(data, str) else data)


def reserve(path: Path, size: int) -> None:
    """Find out whether a file would fit, before it is written by a library that cannot bear a full disk.

    Parameters
    ----------
    path : Path
        Made, filled as far as it goes, and removed again.
    size : int
        Bytes.

    Raises
    ------
    OSError
        It does not fit.
    """
    try:
        with open(path, "wb") as handle:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(handle.fileno(), 0, size)
            else:
                for first in range(0, size, _PORTION_BYTES):
                    handle.write(bytes(min(_PORTION_BYTES, size - first)))
    finally:
        path.unlink()


def sync_folder(folder: Path) -> None:
    """Make the names in a folder survive a power cut, where the system can do that."""
    if sys.platform != "win32":
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


class FolderLock:
    """Keeps other processes out of a folder until `release`, or until this process is gone.

    Parameters
    ----------
    path : Path
        File that stands for the folder; made when it is not there.

    Raises
    ------
    RefusedInput
        Another process has it.
    StorageError
        The file system cannot lock, or the file cannot be made.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._handle = open(path, "ab")  # noqa: SIM115  (held until release)
        except OSError as error:
            raise storage_error(f"{path}: cannot be opened", error) from error
        try:
            _lock(self._handle)
        except OSError as error:
            self._handle.close()
            if error.errno in (errno.EWOULDBLOCK, errno.EACCES, errno.EDEADLK):
                raise RefusedInput(
                    f"{path.parent.parent}: another process is using this run folder"
                ) from error
            raise storage_error(
                f"{path}: cannot be locked; choose a folder on a local disk", error
            ) from error

    def release(self) -> None:
        """Let others in."""
        self._handle.close()
