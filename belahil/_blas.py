"""One BLAS thread per process, for the command line, the tests and the benchmarks."""

from __future__ import annotations

import os


def pin_to_one_thread() -> None:
    """Ask for one BLAS thread, unless the user asked for a number; works only before numpy is imported."""
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
