"""Recordings of tests: a file for each bench that a test opens, found again by the name of the test."""

from __future__ import annotations

import zlib
from collections import Counter
from typing import TYPE_CHECKING
from urllib.parse import quote

from belahil.config import REPLAY, BenchConfig, load_bench
from belahil.errors import RefusedInput, StorageError

if TYPE_CHECKING:
    from pathlib import Path

_LONGEST_NAME = 120


class Recordings:
    """The folder in which the benches of tests are recorded, or from which they are replayed.

    Parameters
    ----------
    folder : Path
        Of ``--belahil-record`` or ``--bench replay:FOLDER``.
    replays : bool
        Which of the two.
    """

    def __init__(self, folder: Path, replays: bool) -> None:
        self.folder = folder
        self.replays = replays
        self._opened: Counter[str] = Counter()

    def next_file(self, test: str) -> Path:
        """Return the file of the bench that a test opens next.

        Parameters
        ----------
        test : str
            Its node id.

        Raises
        ------
        RefusedInput
            The test was not recorded, or opened fewer benches then.
        StorageError
            The folder cannot be made.
        """
        self._opened[test] += 1
        file = self._file(test, self._opened[test])
        if self.replays and not file.is_file():
            raise RefusedInput(f"{file}: there is no such recording; needed is one of this test")
        if not self.replays:
            try:
                file.parent.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise StorageError(f"{file.parent}: cannot be made ({error.strerror})") from error
        return file

    def holds(self, test: str) -> bool:
        """Tell whether a test can be replayed from here."""
        return self.replays and self._file(test, 1).is_file()

    def first_bench(self) -> BenchConfig:
        """Return the bench of the first recording, which stands for that of all.

        Raises
        ------
        RefusedInput
            There is none.
        """
        for file in sorted(self.folder.rglob("*.rec")):
            return load_bench(f"{REPLAY}{file}")
        raise RefusedInput(f"replay:{self.folder}: holds no recording (*.rec)")

    def _file(self, test: str, number: int) -> Path:
        path = self.folder.joinpath(*parts(test))
        return path.with_name(f"{path.name}{'' if number == 1 else f'-{number}'}.rec")


def recordings_at(base: Path, record: str | None, bench: str, *, may_be_filled: bool) -> Recordings | None:
    """Return where tests are recorded or replayed one by one; None where a bench is a single recording.

    Parameters
    ----------
    base : Path
        What folders are relative to.
    record : str or None
        Of ``--belahil-record``.
    bench : str
        Of ``--bench``.
    may_be_filled : bool
        Whether the folder of new recordings may hold some.

    Raises
    ------
    RefusedInput
        It does, and must not.
    """
    if record is None:
        replayed = base / bench.removeprefix(REPLAY)
        return Recordings(replayed, replays=True) if replayed.is_dir() else None
    folder = base / record
    if not may_be_filled and folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise RefusedInput(f"--belahil-record {record}: must be a new or an empty folder")
    return Recordings(folder, replays=False)


def parts(test: str) -> list[str]:
    """Return folders and name of the recording of a test, such that no other test has the same.

    >>> parts("tests/test_gain.py::TestNight::test_code[4-a/b]")
    ['tests', 'test_gain.py', 'TestNight', 'test_code[4-a%2Fb]']
    >>> parts("../far.py::test_it")
    ['%2E%2E', 'far.py', 'test_it']
    """
    place, bracket, parameters = test.partition("[")
    names = place.replace("::", "/").split("/")
    names[-1] += bracket + parameters
    return [_name(name) for name in names]


def _name(name: str) -> str:
    """Return a name that every file system takes."""
    quoted = quote(name, safe="[]-_., =+@")
    if len(quoted) > _LONGEST_NAME:
        quoted = f"{quoted[:_LONGEST_NAME]}~{zlib.crc32(name.encode()):08x}"
    return quoted.replace(".", "%2E") if quoted.strip(".") == "" else quoted
