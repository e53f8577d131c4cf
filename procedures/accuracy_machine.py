"""The circumstances under which a work-precision table was measured."""

from __future__ import annotations

import math
import os
import platform
import time
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

from belahil.provenance import belahil_version
from sim.loops import loops

if TYPE_CHECKING:
    from collections.abc import Callable

    from procedures.accuracy_rows import Effort

_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
_LIBRARIES = ("numpy", "scipy", "numba")
_TURNS = 200_000
_REPEATS = 7


@dataclass(frozen=True, slots=True)
class Machine:
    """Where a table was measured, and with what.

    Parameters
    ----------
    processor, system : str
        As the system tells.
    cpus : int
        That this process may use.
    threads : str
        What the number of BLAS threads is set to.
    loops : str
        Whether the loops are compiled.
    versions : dict of str to str
        Of belahil, Python and the libraries that take part.
    repeats : str
        How times were taken.
    reference_loop_us : dict of str to float
        Two fixed pieces of work, to compare machines by: a loop in Python, and NumPy.
    """

    processor: str
    system: str
    cpus: int
    threads: str
    loops: str
    versions: dict[str, str]
    repeats: str
    reference_loop_us: dict[str, float]


def this_machine(effort: Effort) -> Machine:
    """Describe the machine and the process at work."""
    pinned = {name: os.environ[name] for name in _THREADS if name in os.environ}
    numbers = set(pinned.values())
    if len(numbers) == 1:
        threads = f"BLAS pinned to {numbers.pop()}"
    else:
        threads = ", ".join(f"{name}={number}" for name, number in pinned.items()) or "not pinned"
    return Machine(
        processor=_processor(),
        system=f"{platform.system()} {platform.release()} {platform.machine()}",
        cpus=len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1,
        threads=threads,
        loops="compiled by numba" if _compiled() else "of NumPy: numba cannot be imported",
        versions={
            "belahil": belahil_version(),
            "python": platform.python_version(),
            **{name: _version(name) for name in _LIBRARIES},
        },
        repeats=(
            f"shortest warm call of two rounds, each of up to {effort.calls} within {effort.budget_s:g} s, "
            "at least 3"
        ),
        reference_loop_us=reference_loop_us(),
    )


def _compiled() -> bool:
    return getattr(loops(), "__name__", "") == "sim.compiled"


def reference_loop_us() -> dict[str, float]:
    """Time two fixed pieces of work, us: the shortest of seven."""
    import numpy as np

    values = np.linspace(-1, 1, 1_000_000)
    return {
        f"Python, {_TURNS} turns of a loop": _shortest_us(_turns),
        "NumPy, exp of 1000000 numbers": _shortest_us(lambda: np.exp(values)),
    }


def _turns() -> int:
    total = 0
    for number in range(_TURNS):
        total += number & 7
    return total


def _shortest_us(run: Callable[[], object]) -> float:
    shortest = math.inf
    for _ in range(_REPEATS):
        begin = time.perf_counter()
        run()
        shortest = min(shortest, time.perf_counter() - begin)
    return 1e6 * shortest


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def _processor() -> str:
    """Model of the processor where the system has it in a file, else what Python knows."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            for line in lines:
                if line.startswith("model name"):
                    return " ".join(line.partition(":")[2].split())
    except OSError:
        pass
    return platform.processor() or platform.machine()
