"""Guard against other packages that carry the plain names ``drivers``, ``sim`` or ``procedures``."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

ROOMS = ("drivers", "sim", "procedures")
MARK = "A room of belahil"  # begins the docstring of each room's __init__.py


def complaint(root: Path) -> str | None:
    """Say what is wrong with the first room that is not belahil's own.

    Parameters
    ----------
    root : Path
        Folder that holds ``belahil``; the other rooms must lie in it.

    Returns
    -------
    str or None
        One line, or None when all rooms are in place.
    """
    for room in ROOMS:
        spec = find_spec(room)
        found = Path(spec.origin).resolve() if spec and spec.origin else None
        own = root / room / "__init__.py"
        if found == own and MARK in own.read_text(encoding="utf-8", errors="replace"):
            continue
        what = "none" if found is None else "another package's file" if found == own else str(found)
        return (
            f"belahil: needs its own package '{room}' at {own.parent}, and found {what}; "
            "install belahil into an environment of its own"
        )
    return None
