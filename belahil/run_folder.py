"""The folder of a run: claimed by one process, read back by the next."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from belahil.config import BenchConfig, as_toml, parse_bench
from belahil.errors import RefusedInput, StorageError
from belahil.storage import FolderLock, storage_error, write_whole

BENCH_HEADER = "# The bench as this run used it. Only an emulated or simulated bench reads [emulation].\n\n"


def journal_of(folder: Path) -> Path:
    """Return where a run keeps its shots; the file is there as soon as there is something to resume."""
    return folder / "journal" / "shots"


def refuse_used(folder: str | Path) -> None:
    """Refuse a run folder that has something in it.

    Raises
    ------
    RefusedInput
        With the way to continue it, if it holds a run.
    StorageError
        It cannot be looked into.
    """
    folder = Path(folder)
    try:
        if not folder.exists():
            return
        if not folder.is_dir():
            raise RefusedInput(f"--out {folder}: is a file; a run needs a folder of its own")
        if next(folder.iterdir(), None) is None:
            return
    except OSError as error:
        raise storage_error(f"--out {folder}: cannot be looked into", error) from error
    hint = f"; --resume {folder} continues the run in it" if journal_of(folder).exists() else ""
    raise RefusedInput(f"--out {folder}: the folder is not empty{hint}")


def claim(folder: Path) -> FolderLock:
    """Make a run folder and take it for this process.

    Raises
    ------
    RefusedInput
        It is not empty, or somebody else was quicker.
    StorageError
        It cannot be made.
    """
    refuse_used(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "journal").mkdir()
    except FileExistsError as error:
        raise RefusedInput(f"--out {folder}: another process has just begun a run there") from error
    except OSError as error:
        raise storage_error(f"--out {folder}: cannot be made", error) from error
    return lock(folder)


def lock(folder: Path) -> FolderLock:
    """Take a run folder for this process.

    Raises
    ------
    RefusedInput
        Another process has it.
    """
    return FolderLock(folder / "journal" / "lock")


def write_bench(folder: Path, config: BenchConfig) -> None:
    """Write the bench as a run uses it."""
    write_whole(folder / "bench.toml", BENCH_HEADER + as_toml(config))


def read_bench(folder: Path) -> BenchConfig:
    """Read the bench that a run was begun with.

    Raises
    ------
    StorageError
        The file cannot be read.
    ConfigError
        Somebody wrote into it what is not allowed.
    """
    path = folder / "bench.toml"
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise StorageError(f"{path}: cannot be read") from error
    return parse_bench(text, str(path))


def read_json(path: Path) -> dict[str, Any]:
    """Read one of the JSON files of a run.

    Raises
    ------
    StorageError
        It is missing or damaged.
    """
    try:
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise StorageError(f"{path}: cannot be read, or is not JSON") from error
    return found
