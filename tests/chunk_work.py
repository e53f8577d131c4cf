"""What chunks of the tests do."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np

from belahil.chunks import shared
from belahil.errors import RefusedInput


def noise(seed: int, count: int) -> dict[str, np.ndarray]:
    return {"values": np.random.Generator(np.random.Philox(key=seed)).standard_normal(count)}


def sum_of_noise(seed: int, count: int) -> dict[str, np.ndarray]:
    return {"sum": shared("tests.chunk_work:noise", {"seed": seed, "count": count})["values"].sum()}


def slow(seed: int, seconds: float, count: int = 4) -> dict[str, np.ndarray]:
    time.sleep(seconds)
    return noise(seed, count)


def dies_once(seed: int, mark: str) -> dict[str, np.ndarray]:
    """Kill the process of the worker, the first time."""
    if not Path(mark).exists():
        Path(mark).touch()
        os._exit(9)
    return noise(seed, 4)


def dies_without(seed: int, mark: str) -> dict[str, np.ndarray]:
    """Kill the process of the worker, unless a file is there."""
    if not Path(mark).exists():
        os._exit(9)
    return noise(seed, 4)


def dies() -> dict[str, np.ndarray]:
    os._exit(9)


def refuses() -> dict[str, np.ndarray]:
    raise RefusedInput("altitude_m = -1: must be above zero")
