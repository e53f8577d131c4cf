"""The file of a recording (``docs/recording.md``): it only grows, and a killed process cannot spoil it.

The first line names format and version. Then come frames (`belahil.frames`). The payload of a frame is a
record: one line of JSON, and behind its line feed the bytes that crossed the link.
"""

from __future__ import annotations

import os
import re
import zlib
from contextlib import suppress
from typing import TYPE_CHECKING, Literal

import msgspec

from belahil.errors import ConfigError, RefusedInput, StorageError
from belahil.frames import HEAD, framed, whole_head
from belahil.storage import storage_error

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from types import TracebackType

VERSION = 1
_FIRST_LINE = "belahil recording {}\n"
_FIRST_LINE_BYTES = 64

Kind = Literal["header", "open", "write", "read", "clear", "close", "instruments", "run", "closing", "end"]


class Record(msgspec.Struct, frozen=True, omit_defaults=True):
    """What the line of JSON of a record holds.

    Parameters
    ----------
    kind : str
        ``header``, ``instruments``, ``run``, ``closing`` and ``end`` tell of the session, the others are
        verbs of a link.
    link : str
        ``generator`` or ``digitizer``.
    began_s, ended_s : float
        When the verb was called and came back, s, on the clock of the bench.
    elapsed_s : float
        Real time since the recording began, s, when the verb came back.
    count : int
        How many bytes a read asked for.
    timeout_s : float or None
        How long a read would wait.
    clock_s : tuple of float
        What the clock of the bench told since the record before.
    error : tuple of str or None
        Name of the class and message of the error that the verb raised.
    """

    kind: Kind
    link: str = ""
    began_s: float = 0.0
    ended_s: float = 0.0
    elapsed_s: float = 0.0
    count: int = 0
    timeout_s: float | None = None
    clock_s: tuple[float, ...] = ()
    error: tuple[str, str] | None = None


_encoder = msgspec.json.Encoder()
_decoder = msgspec.json.Decoder(Record)


class RecordingWriter:
    """Appends records; each is with the operating system when `append` returns.

    Parameters
    ----------
    path : Path
        A file that is not there yet.

    Attributes
    ----------
    failed : StorageError or None
        Why no more is written. It is not raised: a full disk must not keep a bench from switching its
        output off.

    Raises
    ------
    RefusedInput
        The file is there already.
    StorageError
        It cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.failed: StorageError | None = None
        self._count = 0
        try:
            self._file = open(path, "xb", buffering=0)  # noqa: SIM115  (held until close)
        except FileExistsError as error:
            raise RefusedInput(f"--record {path}: is there already; give another name") from error
        except OSError as error:
            raise storage_error(f"--record {path}: cannot be made", error) from error
        self._end = 0
        self._put(_FIRST_LINE.format(VERSION).encode())

    def append(self, record: Record, data: bytes = b"") -> None:
        """Write one record; nothing once `failed` is set."""
        if self.failed is None:
            self._put(framed(b"%b\n%b" % (_encoder.encode(record), data)))
            self._count += 1

    def _put(self, data: bytes) -> None:
        try:
            rest = memoryview(data)
            while rest:
                rest = rest[self._file.write(rest) :]
            self._end += len(data)
        except OSError as error:
            self.failed = storage_error(f"{self.path}: ends after {self._count} records", error)
            with suppress(OSError):
                self._file.truncate(self._end)

    def close(self) -> None:
        """Wait for the disk and let go of the file."""
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            self.failed = self.failed or storage_error(f"{self.path}: cannot be written", error)
        self._file.close()


class RecordingReader:
    """Reads the records of a file in their order.

    Parameters
    ----------
    path : Path
        Of the file.

    Attributes
    ----------
    count : int
        Records read so far.
    torn : bool
        Whether the file ended within a record, as after a kill or a power cut.

    Raises
    ------
    ConfigError
        There is no such file, it is no recording, or one of another version of the format.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.count = 0
        self.torn = False
        self._place = 0
        try:
            self._file = open(path, "rb")  # noqa: SIM115  (held until close)
        except OSError as error:
            raise ConfigError(f"recording {path}: cannot be read ({error.strerror})") from error
        try:
            self._check_version(self._taken(_FIRST_LINE_BYTES))
        except BaseException:
            self._file.close()
            raise

    def _check_version(self, beginning: bytes) -> None:
        found = re.match(rb"belahil recording ([1-9][0-9]{0,8})\n", beginning)
        if found is None:
            raise ConfigError(f"{self.path}: is no recording of belahil")
        if int(found[1]) != VERSION:
            raise ConfigError(
                f"{self.path}: is a recording in version {found[1].decode()} of the format; "
                f"this belahil reads version {VERSION}"
            )
        self._place = len(found[0])
        self._file.seek(self._place)

    def __iter__(self) -> Iterator[tuple[Record, bytes]]:
        """Yield records and their bytes up to the end of the file.

        Raises
        ------
        StorageError
            The file is damaged, or cannot be read.
        """
        while (payload := self._next()) is not None:
            line, mark, data = payload.partition(b"\n")
            try:
                record = _decoder.decode(line)
            except msgspec.DecodeError as error:
                raise self._damaged() from error
            if not mark:
                raise self._damaged()
            self.count += 1
            self._place += HEAD.size + len(payload)
            yield record, data

    def _next(self) -> bytes | None:
        head = self._taken(HEAD.size)
        if len(head) < HEAD.size or not any(head):
            self.torn = bool(head)
            # A file system may leave zeros behind when the power is cut.
            if self._more_than_zeros():
                raise self._damaged()
            return None
        announced = whole_head(head)
        if announced is None:
            raise self._damaged()
        length, checksum = announced
        payload = self._taken(length)
        if len(payload) < length:
            self.torn = True
            return None
        if zlib.crc32(payload) != checksum:
            raise self._damaged()
        return payload

    def _more_than_zeros(self) -> bool:
        while rest := self._taken(1 << 20):
            if any(rest):
                return True
        return False

    def _taken(self, count: int) -> bytes:
        try:
            return self._file.read(count)
        except OSError as error:
            raise storage_error(f"{self.path}: cannot be read", error) from error

    def _damaged(self) -> StorageError:
        return StorageError(f"{self.path}: damaged at byte {self._place}, after {self.count} good records")

    def close(self) -> None:
        """Let go of the file."""
        self._file.close()

    def __enter__(self) -> RecordingReader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
