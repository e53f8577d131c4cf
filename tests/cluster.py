"""A real dask scheduler and real workers on loopback, each a process of its own."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from belahil.errors import WorkerLost
from belahil.executors import cluster_workers

ROOT = Path(__file__).resolve().parent.parent
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def free_port() -> int:
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        return int(held.getsockname()[1])


def _begun(program: str, *words: str, **more: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", f"distributed.cli.{program}", *words],
        env=ENVIRONMENT | more,
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


@contextmanager
def scheduler(workers: int = 2, **more: str) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Yield the address and the processes: first the scheduler, then the workers, all connected."""
    port = free_port()
    address = f"tcp://127.0.0.1:{port}"
    begun = [
        _begun(
            "dask_scheduler",
            "--host",
            "127.0.0.1",
            "--port",
            str(port),
            "--no-dashboard",
            "--no-show",
            **more,
        )
    ]
    try:
        for _ in range(workers):
            begun.append(_begun("dask_worker", address, "--nthreads", "1", "--no-dashboard", "--no-nanny"))
        _wait(address, workers)
        yield address, begun
    finally:
        for process in begun:
            process.kill()
            process.wait()


def _wait(address: str, count: int) -> None:
    deadline = time.monotonic() + 60
    while True:
        try:
            if cluster_workers(address).count >= count:
                return
        except WorkerLost:
            if time.monotonic() > deadline:
                raise
        time.sleep(0.3)
