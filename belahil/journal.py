"""The journal of a run: one file that only grows, and that a killed process cannot spoil.

The file begins with `MAGIC`. Then come records, the first of which is the header. A record is a frame
(`belahil.frames`) with a payload in msgpack. Each shot is on the disk before the next one is measured, so
that a kill or a power cut leaves at most one broken record, at the end; opening the journal cuts it off. A
broken record anywhere else means a damaged disk, and is an error that changes nothing.
"""

from __future__ import annotations

import os
import struct
import time
import zlib
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import msgspec

from belahil.errors import StorageError
from belahil.frames import HEAD, framed, whole_head
from belahil.shot_record import SamePulse, from_bytes, request_in, to_bytes
from belahil.stimuli import SampledPulse, Stimulus
from belahil.storage import storage_error, write_whole

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from belahil.values import Shot, WindowRequest

MAGIC = b"belahil journal 1\n"
# The data and the length of the file suffice; its time of change need not be on the disk.
_sync = getattr(os, "fdatasync", os.fsync)


class Journal:
    """Shots by index; `append` returns when the shot is safe.

    Parameters
    ----------
    path : Path
        File that `create` made.
    sync : bool
        Wait for the disk after each shot. Without it a power cut may cost the newest shots, a kill still
        costs none.

    Attributes
    ----------
    header : dict
        As given to `create`.
    cut_bytes : int
        What a broken last record left behind, cut off when the journal was opened.
    fsync_s : float
        Time spent waiting for the disk, s.

    Raises
    ------
    StorageError
        There is no journal, or it is damaged elsewhere than at its end.
    """

    def __init__(self, path: Path, *, sync: bool = True) -> None:
        self.path = path
        self.fsync_s = 0.0
        self._sync = sync
        self._places: dict[int, int] = {}
        self._pulse: tuple[int, Stimulus] | None = None
        try:
            self._file = open(path, "r+b", buffering=0)  # noqa: SIM115  (held until close)
        except OSError as error:
            raise storage_error(f"{path}: cannot be opened", error) from error
        try:
            self._open()
        except OSError as error:
            self._file.close()
            raise storage_error(f"{path}: cannot be read", error) from error
        except StorageError:
            self._file.close()
            raise

    @classmethod
    def create(cls, path: Path, header: dict[str, Any], *, sync: bool = True) -> Journal:
        """Begin a journal; `header` must be plain values.

        Raises
        ------
        StorageError
            The file could not be written.
        """
        write_whole(path, MAGIC + framed(msgspec.msgpack.encode(header)))
        return cls(path, sync=sync)

    def _open(self) -> None:
        if self._file.read(len(MAGIC)) != MAGIC:
            raise StorageError(f"{self.path}: is no journal of this version")
        self._end = len(MAGIC)
        header = self._next()
        if header is None:
            raise StorageError(f"{self.path}: has no complete header; nothing was measured")
        self.header: dict[str, Any] = msgspec.msgpack.decode(header)
        place = self._end
        while (record := self._next()) is not None:
            self._places[self._decoded(request_in, record, place).shot] = place
            place = self._end
        self.cut_bytes = self._file.seek(0, os.SEEK_END) - self._end
        self._file.truncate(self._end)

    def _next(self) -> bytes | None:
        """Read the record at `_end` and move on; None when the file ends here, whole or torn."""
        self._file.seek(self._end)
        head = self._file.read(HEAD.size)
        if len(head) < HEAD.size or not any(head):
            self._allow_tail(head)
            return None
        found = whole_head(head)
        if found is None:
            raise self._damaged(self._end)
        length, checksum = found
        payload = self._file.read(length)
        if len(payload) < length or (zlib.crc32(payload) != checksum and not self._file.read(1)):
            return None
        if zlib.crc32(payload) != checksum:
            raise self._damaged(self._end)
        self._end += HEAD.size + length
        return payload

    def _allow_tail(self, head: bytes) -> None:
        """Let a tail of zeros pass: a file system may leave one when the power is cut."""
        rest = head
        while rest:
            if any(rest):
                if len(head) == HEAD.size:
                    raise self._damaged(self._end)
                return
            rest = self._file.read(1 << 20)

    def _damaged(self, place: int) -> StorageError:
        return StorageError(
            f"{self.path}: damaged at byte {place}, after {len(self._places)} good shots; nothing was changed"
        )

    def _decoded(self, decode: Any, record: bytes, place: int, *more: Any) -> Any:
        try:
            return decode(record, *more)
        except ValueError as error:
            raise self._damaged(place) from error

    def __len__(self) -> int:
        return len(self._places)

    def __contains__(self, shot: int) -> bool:
        return shot in self._places

    def __iter__(self) -> Iterator[int]:
        return iter(sorted(self._places))

    def append(self, request: WindowRequest, shot: Shot) -> None:
        """Keep a shot under its request's index.

        Raises
        ------
        StorageError
            It could not be written; what was there before is kept.
        """
        if request.shot in self._places:
            raise ValueError(f"shot {request.shot} is in the journal already")
        record = framed(to_bytes(request, shot, self._known(shot.played)))
        place = self._end
        try:
            self._file.seek(place)
            rest = memoryview(record)
            while rest:
                rest = rest[self._file.write(rest) :]
            self._wait_for_disk()
        except OSError as error:
            with suppress(OSError):
                self._file.truncate(place)
            raise storage_error(
                f"{self.path}: shot {request.shot} cannot be written, {len(self)} shots are kept", error
            ) from error
        self._end = place + len(record)
        self._places[request.shot] = place
        if isinstance(shot.played, SampledPulse) and not self._known(shot.played):
            self._pulse = (place, shot.played)

    def _known(self, played: Stimulus) -> SamePulse | None:
        """Spare the disk a long pulse that the bench played again without a change."""
        return SamePulse(self._pulse[0]) if self._pulse is not None and self._pulse[1] is played else None

    def _wait_for_disk(self) -> None:
        if self._sync:
            started = time.perf_counter()
            _sync(self._file.fileno())
            self.fsync_s += time.perf_counter() - started

    def read(self, shot: int) -> tuple[WindowRequest, Shot]:
        """Return a kept shot and the request it answered.

        Raises
        ------
        KeyError
            No such shot.
        StorageError
            The disk does not give back what was written.
        """
        return self._at(self._places[shot])

    def _at(self, place: int) -> tuple[WindowRequest, Shot]:
        try:
            self._file.seek(place)
            length, checksum, _ = HEAD.unpack(self._file.read(HEAD.size))
            record = self._file.read(length)
        except (OSError, struct.error) as error:
            raise self._damaged(place) from error
        if zlib.crc32(record) != checksum:
            raise self._damaged(place)
        found: tuple[WindowRequest, Shot] = self._decoded(from_bytes, record, place, self._pulse_at)
        return found

    def _pulse_at(self, place: int) -> Stimulus:
        if self._pulse is None or self._pulse[0] != place:
            self._pulse = (place, self._at(place)[1].played)
        return self._pulse[1]

    def close(self) -> None:
        """Let go of the file."""
        self._file.close()
