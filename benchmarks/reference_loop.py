"""A fixed piece of work, so that times from different machines, or from a busy one, can be compared.

One round is in kind what a window costs, none of it ours: the sine of 16 064 numbers, their rounding to
16-bit integers, the CRC-32 of those, and a loop of 2000 steps in plain Python.
"""

from __future__ import annotations

import time
import zlib

import numpy as np

SAMPLES = 16064
STEPS = 2000


def one_round(angles: np.ndarray) -> int:
    values = np.sin(angles)
    values *= 2000.0
    checksum = zlib.crc32(np.rint(values).astype(np.int16).data)
    total = 0
    for step in range(STEPS):
        total += step * step
    return checksum ^ total


def reference_ms(rounds: int = 400) -> tuple[float, float]:
    """Return the wall and the CPU time of a round, ms, each the median of five batches."""
    angles = np.linspace(0.0, 1000.0, SAMPLES)
    walls, cpus = [], []
    for _ in range(5):
        wall, cpu = time.perf_counter(), time.process_time()
        for _ in range(rounds // 5):
            one_round(angles)
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
    each = 1e3 / (rounds // 5)
    return float(np.median(walls)) * each, float(np.median(cpus)) * each
