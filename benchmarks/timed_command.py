"""Run a belahil command in this process with clocks at its stages, and write what they showed.

    python benchmarks/timed_command.py RESULT.json [--profile PROFILE] -- characterize --out DIR

The command is the real one, from its entry point to its exit; a stage is timed by putting a clock round the
function that does it. Time spent waiting for the disk (fsync, fdatasync) is kept apart everywhere.
"""

from __future__ import annotations

import cProfile
import functools
import importlib
import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

STAGES = {
    # name: (module, where in it)
    "open": ("belahil.bench", "open_bench"),
    "plan": ("procedures.characterize", "plan"),
    "measure": ("procedures.characterize", "measure"),
    "shot": ("belahil.run", "Run.shot"),
    "capture": ("sim.plant", "Plant._capture"),
    "analyse": ("procedures.characterize", "analyse"),
    "read_windows": ("procedures.gain_points", "read_windows"),
    "finish": ("belahil.run", "Run.finish"),
    "write_data": ("belahil.export", "write_data"),
    "save_figures": ("belahil.report", "save_figures"),
    "write_page": ("belahil.report", "write_page"),
}
# What these stages import when they are first reached would hide what they do.
LOADED_BEFORE = {
    "analyse": ("scipy.optimize", "scipy.special", "matplotlib.figure"),
    "finish": ("h5netcdf", "jinja2"),
}


class Clock:
    """Wall and CPU time, s, both less what went into waiting for the disk."""

    def __init__(self) -> None:
        self.disk_s = self.disk_cpu_s = 0.0

    def wait_for_disk(self, sync: Callable[[int], None]) -> Callable[[int], None]:
        def timed(handle: int) -> None:
            wall, cpu = time.perf_counter(), time.process_time()
            try:
                sync(handle)
            finally:
                self.disk_s += time.perf_counter() - wall
                self.disk_cpu_s += time.process_time() - cpu

        return timed

    def now(self) -> tuple[float, float]:
        return time.perf_counter() - self.disk_s, time.process_time() - self.disk_cpu_s


class Stages:
    """What each stage took, call by call."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self.calls: dict[str, list[tuple[float, float]]] = {}

    def put_clocks(self) -> None:
        for name, (module, path) in STAGES.items():
            place: Any = importlib.import_module(module)
            *owners, last = path.split(".")
            for owner in owners:
                place = getattr(place, owner)
            setattr(place, last, self._timed(name, getattr(place, last)))

    def _timed(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        calls = self.calls.setdefault(name, [])
        loaded = LOADED_BEFORE.get(name, ())

        @functools.wraps(function)
        def timed(*given: Any, **named: Any) -> Any:
            for module in loaded:
                importlib.import_module(module)
            wall, cpu = self._clock.now()
            try:
                return function(*given, **named)
            finally:
                wall_after, cpu_after = self._clock.now()
                calls.append((wall_after - wall, cpu_after - cpu))

        return timed


def main(arguments: list[str]) -> int:
    split = arguments.index("--")
    result, profile = Path(arguments[0]), arguments[2] if "--profile" in arguments[:split] else None
    clock = Clock()
    # Before anything of ours is imported: the journal takes its function once.
    for name in ("fsync", "fdatasync"):
        if hasattr(os, name):
            setattr(os, name, clock.wait_for_disk(getattr(os, name)))
    from belahil.__main__ import main as belahil

    stages = Stages(clock)
    sys.argv = ["belahil", *arguments[split + 1 :]]
    from belahil._blas import pin_to_one_thread

    pin_to_one_thread()
    stages.put_clocks()
    if profile is None:
        status = belahil()
    else:
        profiler = cProfile.Profile()
        status = profiler.runcall(belahil)
        profiler.dump_stats(profile)
    _, cpu = clock.now()
    told = {"disk_s": clock.disk_s, "disk_cpu_s": clock.disk_cpu_s, "cpu_s": cpu, "stages": stages.calls}
    result.write_text(json.dumps(told))
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
