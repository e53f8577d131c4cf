"""Entry point of the command ``belahil`` and of ``python -m belahil``."""

from __future__ import annotations

import sys
from pathlib import Path

from belahil._blas import pin_to_one_thread
from belahil._neighbours import complaint


def main() -> int:
    """Prepare the process, check that all rooms are belahil's own, and run the command line.

    Returns
    -------
    int
        Exit status.
    """
    pin_to_one_thread()
    root = Path(__file__).resolve().parent.parent
    # A user's drivers.py in the current directory would be found before ours.
    sys.path.insert(0, str(root))
    wrong = complaint(root)
    if wrong is not None:
        print(wrong, file=sys.stderr)
        return 2
    from belahil.cli.main import main as command_line

    return command_line()


if __name__ == "__main__":
    sys.exit(main())
