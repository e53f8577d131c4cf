"""The brute-force campaign on one and on two workers, beside a loop of pure arithmetic in as many processes.

    python benchmarks/scaling.py                     # 5 repeats, some 3 minutes on an idle machine
    python benchmarks/scaling.py --memory            # largest memory of a worker against the number of shots
    python benchmarks/scaling.py --costs             # processor time of a shot by its stages, bytes on disk

The whole shots of the range campaign run through the real engine: chunks to fresh processes, results to
files. What a process does once (imports, ground, tables) is told apart from the pace; a campaign of any
length takes the one and so many times the other, and both are put together for some lengths.

Three clocks: wall time, which is the one to look at on an idle machine and tells nothing on a busy one; the
processor time of the busiest worker, and that of the mean worker, each with that of the process that hands
out the chunks as if it came after. Where other programs hold one worker up, the other takes more chunks: then
the busiest tells of them, and the mean does not. The loop runs in the same processes and tells what the
machine itself can give: two cores may share what they compute with. Repeats go in turn, and medians are told.
Nothing asserts these figures.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "benchmarks")]

from belahil._blas import pin_to_one_thread  # noqa: E402

pin_to_one_thread()

import numpy as np  # noqa: E402
from reference_loop import SAMPLES, one_round  # noqa: E402

from belahil.chunks import Chunk, ChunkStore, run_chunks, work  # noqa: E402
from belahil.executors import Workers  # noqa: E402
from procedures.campaign_range import RangeOptions  # noqa: E402
from procedures.range_parts import brute_chunks, levels_chunks, points, shared_chunks  # noqa: E402

SEED = 2


def chunks_of(shots: int) -> list[Chunk]:
    return brute_chunks(RangeOptions(("table",), shots=shots), SEED)


def one_cell_of_each_altitude(shots: int) -> list[Chunk]:
    return [chunk for chunk in chunks_of(shots) if "day, reflectance 0.17" in chunk.name]


class Crew:
    """Fresh processes that stay, and what they have used."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.pool = ProcessPoolExecutor(count, mp_context=multiprocessing.get_context("spawn"))
        list(self.pool.map(rounds, [20] * 4 * count))

    def used_s(self) -> dict[int, float]:
        import psutil

        own = [psutil.Process(pid) for pid in self.pool._processes]
        return {one.pid: sum(one.cpu_times()[:2]) for one in own}

    def timed(self, work: Callable[[], object]) -> dict[str, float]:
        """Wall time, and processor time: of the busiest and of the mean worker, with ours."""
        before, own, wall = self.used_s(), time.process_time(), time.perf_counter()
        work()
        wall, own = time.perf_counter() - wall, time.process_time() - own
        busy = [after - before[pid] for pid, after in self.used_s().items()]
        return {"wall_s": wall, "busy_s": max(busy) + own, "mean_s": sum(busy) / self.count + own}

    def campaign(self, shots: int, first: Sequence[Chunk] = ()) -> dict[str, float]:
        def work() -> None:
            with tempfile.TemporaryDirectory() as folder:
                store, workers = ChunkStore(Path(folder)), Workers(self.count, lambda: nullcontext(self.pool))
                run_chunks([*first, *chunks_of(shots)], store, workers.open, workers.in_flight)

        return self.timed(work)

    def loop(self, total: int) -> dict[str, float]:
        return self.timed(lambda: list(self.pool.map(rounds, [total // self.count] * self.count)))


def rounds(count: int) -> None:
    angles = np.linspace(0.0, 1000.0, SAMPLES)
    for _ in range(count):
        one_round(angles)


CLOCKS = {"wall_s": "wall time", "busy_s": "busiest worker", "mean_s": "mean worker"}


def speedups(repeats: int, shots: int, total: int) -> dict[str, Any]:
    crews = Crew(1), Crew(2)
    print(f"{len(chunks_of(shots))} chunks of whole shots, {24 * 11 * shots} shots; {os.cpu_count()} cores")
    common = shared_chunks(list(points(RangeOptions(("table",)))))
    once = [crew.campaign(1, common) for crew in crews]
    for crew, one in zip(crews, once, strict=True):
        print(
            f"start and 264 shots, {crew.count} workers: {one['busy_s']:.1f} s of processor time", flush=True
        )
    runs: list[dict[str, Any]] = []
    for _ in range(repeats):
        run: dict[str, Any] = {f"loop {crew.count}": crew.loop(total) for crew in crews}
        run |= {f"campaign {crew.count}": crew.campaign(shots) for crew in crews}
        for clock in CLOCKS:
            run[clock] = {
                one: run[f"{one} 1"][clock] / run[f"{one} 2"][clock] for one in ("loop", "campaign")
            }
            run[clock]["ratio"] = run[clock]["campaign"] / run[clock]["loop"]
        runs.append(run)
        print(told(run), flush=True)
    median = {
        clock: {one: statistics.median(run[clock][one] for run in runs) for one in runs[0][clock]}
        for clock in CLOCKS
    }
    print("median of each: " + told(median))
    pace = statistics.median(run["campaign 1"]["busy_s"] for run in runs) / (24 * 11 * shots)
    for number in (26_400, 105_600, 264_000, 1_100_000):
        whole = once[0]["busy_s"] + pace * number
        gained = whole / (once[1]["busy_s"] + pace * number / median["mean_s"]["campaign"])
        print(
            f"{number} shots with the start: {whole:.0f} s on one worker, speed-up {gained:.2f}, "
            f"{gained / median['mean_s']['loop']:.3f} of the loop's"
        )
    return {"shots": 24 * 11 * shots, "once": once, "runs": runs, "median": median}


def told(one: dict[str, Any]) -> str:
    return "; ".join(
        f"{words}: campaign {one[clock]['campaign']:.3f}, loop {one[clock]['loop']:.3f}, "
        f"ratio {one[clock]['ratio']:.3f}"
        for clock, words in CLOCKS.items()
    )


ALONE = """
import resource, sys, tempfile
from pathlib import Path
sys.path[:0] = [{root!r}, {here!r}]
from scaling import *
from belahil.chunks import ThisProcess
with tempfile.TemporaryDirectory() as folder:
    run_chunks(one_cell_of_each_altitude({shots}), ChunkStore(Path(folder)), ThisProcess, 1)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3))
"""


def memory_mb(shots: int) -> float:
    """Largest memory of a fresh worker that takes so many shots in four cells."""
    text = ALONE.format(root=str(ROOT), here=str(ROOT / "benchmarks"), shots=shots)
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    return float(done.stdout)


def costs() -> None:
    """Processor time of chunks by what is in them, and their bytes on disk."""
    options = RangeOptions(("table",), shots=100)
    every = points(options)
    brute, draws = brute_chunks(options, SEED)[0], next(every).chunks()[0]
    noise = levels_chunks(list(every), options.noise_windows, SEED)[0]
    with tempfile.TemporaryDirectory() as folder:
        store = ChunkStore(Path(folder))

        def used(chunk: Chunk, **other: int) -> tuple[float, int]:
            own = Chunk(chunk.name, chunk.work, dict(chunk.given) | other)
            begun = time.process_time()
            store.put(own, work(own.work, own.given))
            return time.process_time() - begun, (store.folder / f"{own.key}.npz").stat().st_size

        print(f"imports before the first chunk: {time.process_time():.2f} s")
        first = used(brute, count=1)[0]
        print(f"first chunk of a process, of 11 shots: {first:.2f} s")
        for what, chunk, name, few, many, each in (
            ("whole shots", brute, "count", 1, 100, 11),
            ("echoes with 6 draws each", draws, "count", 1, 60, 11),
            ("windows of noise", noise, "windows", 20, 250, 1),
        ):
            used(chunk, **{name: few})
            one, more = (
                [used(chunk, **{name: size, "seed": seed}) for seed in range(5)] for size in (few, many)
            )
            little, much = (statistics.median(row[0] for row in rows) for rows in (one, more))
            pace, size = (much - little) / (many - few) / each, (more[0][1] - one[0][1]) / (many - few) / each
            base, head = little - pace * few * each, one[0][1] - size * few * each
            print(
                f"{what}: {1e3 * pace:.3f} ms each and {base:.3f} s a chunk; "
                f"on disk {size:.0f} B each and {head:.0f} B a chunk"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument(
        "--shots", type=int, default=100, help="on each of eleven terrains in each of 24 cells"
    )
    parser.add_argument("--rounds", type=int, default=8000, help="of the loop, about 0.3 ms each")
    parser.add_argument("--json", type=Path, help="where all numbers go")
    parser.add_argument("--memory", action="store_true", help="memory of a worker in the place of times")
    parser.add_argument(
        "--costs", action="store_true", help="time and bytes of a shot in the place of speed-ups"
    )
    asked = parser.parse_args()
    if asked.costs:
        costs()
    elif asked.memory:
        for shots in (50, 200, 800):
            print(f"{4 * 11 * shots} shots: {memory_mb(shots):.0f} MB", flush=True)
    else:
        found = speedups(asked.repeats, asked.shots, asked.rounds)
        if asked.json:
            asked.json.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
