"""Who made a run: versions of this package and of what it stands on."""

from __future__ import annotations

import platform
import sys
from functools import cache
from pathlib import Path

# Those that take part in the numbers or carry them.
LIBRARIES = ("numpy", "scipy", "pyvisa", "pyvisa-py", "pyserial", "pyusb", "h5netcdf", "h5py", "matplotlib")


@cache
def belahil_version() -> str:
    """Version of this package: of the source tree it runs from, else of the installed package."""
    project = Path(__file__).resolve().parent.parent / "pyproject.toml"
    if project.is_file():
        import tomllib

        told = tomllib.loads(project.read_text(encoding="utf-8")).get("project", {})
        if told.get("name") == "belahil":
            return str(told["version"])
    from importlib.metadata import version

    return version("belahil")


def software() -> dict[str, str]:
    """Versions of belahil, Python, the system and the libraries, for ``summary.json``."""
    from importlib.metadata import PackageNotFoundError, version

    found = {
        "belahil": belahil_version(),
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
    }
    for name in LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def command_line() -> str:
    """The command that started this process, as one would type it."""
    import shlex

    return shlex.join(["belahil", *sys.argv[1:]])
