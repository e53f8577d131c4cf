"""What a fresh process pays before its first shot; run as a program, it measures itself and prints JSON.

Imports and compilation are paid once a process, or once a machine, so they are told apart from the cost of a
shot. A single shot in a fresh process does better without the compiled loop.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from importlib import import_module
from pathlib import Path

_COMPILED_CALL = "first call of the compiled loop"
_TIMEOUT_S = 120
_IMPORTS = ("numpy", "scipy.special", "scipy.signal", "numba")


def startup_s() -> dict[str, float]:
    """Measure in two fresh processes with a cache of their own: the first compiles, the second finds it done.

    Returns
    -------
    dict of str to float
        Seconds by name; empty where no process can be started.
    """
    root = str(Path(__file__).resolve().parent.parent)
    found: list[dict[str, float]] = []
    with tempfile.TemporaryDirectory(prefix="belahil-accuracy-") as cache:
        path = os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH")])])
        environment = os.environ | {"NUMBA_CACHE_DIR": cache, "PYTHONPATH": path}
        for _ in range(2):
            try:
                answer = subprocess.run(
                    [sys.executable, "-m", "procedures.accuracy_startup"],
                    env=environment,
                    capture_output=True,
                    text=True,
                    timeout=_TIMEOUT_S,
                    check=True,
                )
                found.append(json.loads(answer.stdout))
            except (OSError, subprocess.SubprocessError, ValueError):
                return {}
    first, second = found
    shortest = {name: min(seconds, second.get(name, seconds)) for name, seconds in first.items()}
    if shortest.pop(_COMPILED_CALL, None) is not None:
        shortest[f"{_COMPILED_CALL}: compiled"] = first[_COMPILED_CALL]
        shortest[f"{_COMPILED_CALL}: from the cache"] = second[_COMPILED_CALL]
    return shortest


def _since(begin: float) -> float:
    return time.perf_counter() - begin


def _measure() -> dict[str, float]:
    spent: dict[str, float] = {}
    for name in _IMPORTS:
        begin = time.perf_counter()
        try:
            import_module(name)
        except ImportError:
            continue
        spent[f"import {name}"] = _since(begin)
    begin = time.perf_counter()
    footprint = import_module("procedures.accuracy_footprint")
    spent["import of belahil's physics"] = _since(begin)
    begin = time.perf_counter()
    footprint.one_shot()
    spent["first shot: plan, tables, 42 samples"] = _since(begin)
    if "import numba" in spent:
        begin = time.perf_counter()
        footprint.first_compiled_shot()
        spent[_COMPILED_CALL] = _since(begin)
    return spent


if __name__ == "__main__":
    print(json.dumps(_measure()))
