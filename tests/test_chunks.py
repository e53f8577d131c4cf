"""Large jobs in chunks: any executor gives the same bits, and nothing finished is ever lost."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from cluster import ENVIRONMENT, ROOT, free_port, scheduler

from belahil import chunks as subject
from belahil.chunks import ATTEMPTS, Chunk, ChunkStore, ThisProcess, run_chunks
from belahil.errors import RefusedInput, StorageError, WorkerLost
from belahil.executors import cluster_workers, local_workers
from tests import chunk_work

NOISE = tuple(Chunk(f"noise {n}", "tests.chunk_work:noise", {"seed": n, "count": 100 + n}) for n in range(7))


def told(store: ChunkStore, chunks: tuple[Chunk, ...] = NOISE) -> list[bytes]:
    return [result["values"].tobytes() for result in store.results(chunks)]


@pytest.fixture
def store(tmp_path: Path) -> ChunkStore:
    return ChunkStore(tmp_path / "chunks")


@pytest.fixture
def expected(tmp_path: Path) -> list[bytes]:
    plain = ChunkStore(tmp_path / "plain")
    assert run_chunks(NOISE, plain, ThisProcess, 1) == len(NOISE)
    return told(plain)


@pytest.mark.parametrize("in_flight", [1, 2, 50])
@pytest.mark.parametrize("order", [1, -1])
def test_threads_in_any_order_give_the_same_bits(
    store: ChunkStore, expected: list[bytes], in_flight: int, order: int
) -> None:
    # given chunks in either order, when three threads compute them
    run_chunks(NOISE[::order], store, lambda: ThreadPoolExecutor(3), in_flight)
    # then the results are those of one process
    assert told(store) == expected


@pytest.mark.parametrize("count", [2, 3])
def test_processes_give_the_same_bits(store: ChunkStore, expected: list[bytes], count: int) -> None:
    workers = local_workers(count)
    assert run_chunks(NOISE, store, workers.open, workers.in_flight) == len(NOISE)
    assert told(store) == expected


def test_what_is_there_is_not_computed_again(store: ChunkStore) -> None:
    # given three of seven results, one of them damaged
    run_chunks(NOISE[:3], store, ThisProcess, 1)
    damaged = store.folder / f"{NOISE[1].key}.npz"
    damaged.write_bytes(damaged.read_bytes()[:-9])
    seen: list[tuple[int, int]] = []
    # when the job goes on, then the others and the damaged one are computed
    assert run_chunks(NOISE, store, ThisProcess, 1, lambda *at: seen.append(at[:2])) == 5
    assert seen == [(2, 7), (3, 7), (4, 7), (5, 7), (6, 7), (7, 7)]


@pytest.mark.parametrize("state", ["there", "absent", "damaged", "other folder"])
def test_what_many_need_is_read_where_it_is_there_and_else_worked_out(
    store: ChunkStore, expected: list[bytes], state: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a chunk that needs the result of another
    needed, needs = NOISE[0], Chunk("sum", "tests.chunk_work:sum_of_noise", dict(NOISE[0].given))
    made: list[int] = []
    if state != "absent":
        run_chunks([needed], store, ThisProcess, 1)
    if state == "damaged":
        file = store.folder / needed.file_name
        file.write_bytes(file.read_bytes()[:-9])
    if state == "other folder":
        store = ChunkStore(store.folder / "another")
    real = chunk_work.noise
    monkeypatch.setattr(chunk_work, "noise", lambda seed, count: made.append(seed) or real(seed, count))
    # when it is done, then it has the same bits, and what was there is not made again
    run_chunks([needs], store, ThisProcess, 1)
    assert store.get(needs)["sum"] == np.frombuffer(expected[0]).sum()
    assert made == ([] if state == "there" else [0])


def test_other_processes_read_what_is_there(store: ChunkStore) -> None:
    # given a result that no work would give
    store.put(NOISE[0], {"values": np.array([1.0, 2.0])})
    needs = Chunk("sum", "tests.chunk_work:sum_of_noise", dict(NOISE[0].given))
    workers = local_workers(2)
    # when workers need it, then they have read it
    run_chunks([needs], store, workers.open, workers.in_flight)
    assert store.get(needs)["sum"] == 3.0
    # and outside of a chunk's work nothing is read
    assert subject.shared(NOISE[0].work, NOISE[0].given)["values"].size == 100


def test_a_key_depends_on_all_that_is_given() -> None:
    one = Chunk("a", "tests.chunk_work:noise", {"seed": 1, "count": 5})
    assert one.key == Chunk("b", one.work, {"count": 5, "seed": 1}).key
    assert (
        len({one.key, Chunk("a", one.work, {"seed": 2, "count": 5}).key, Chunk("a", "x:y", one.given).key})
        == 3
    )


def test_never_more_than_so_many_are_handed_out(store: ChunkStore) -> None:
    out, most = 0, 0

    class Counting(ThreadPoolExecutor):
        def submit(self, *words, **more):  # type: ignore[no-untyped-def]
            nonlocal out, most
            out += 1
            most = max(most, out)
            future = super().submit(*words, **more)
            return future

    real = store.put

    def put(*words) -> None:  # type: ignore[no-untyped-def]
        nonlocal out
        out -= 1
        real(*words)

    store.put = put  # type: ignore[method-assign]
    run_chunks(NOISE, store, lambda: Counting(3), 3)
    assert most == 3


def test_a_worker_that_dies_costs_nothing_but_time(
    store: ChunkStore, expected: list[bytes], tmp_path: Path
) -> None:
    # given a chunk that kills its worker once
    deadly = Chunk("deadly", "tests.chunk_work:dies_once", {"seed": 3, "mark": str(tmp_path / "mark")})
    said: list[str] = []
    workers = local_workers(2)
    # when the job runs, then all is there and the log names what was done again
    run_chunks((*NOISE[:3], deadly, *NOISE[3:]), store, workers.open, workers.in_flight, log=said.append)
    assert told(store) == expected
    assert store.has(deadly)
    assert any("deadly" in line for line in said)


def test_a_chunk_that_kills_every_worker_is_named(store: ChunkStore) -> None:
    workers = local_workers(2)
    deadly = Chunk("cell 500 km", "tests.chunk_work:dies", {})
    with pytest.raises(WorkerLost, match=f"workers were lost {ATTEMPTS} times on cell 500 km"):
        run_chunks((*NOISE, deadly), store, workers.open, 1)
    assert all(map(store.has, NOISE))


@pytest.mark.parametrize("count", [1, 2])
def test_an_error_of_the_work_keeps_what_is_finished_and_names_the_chunk(
    store: ChunkStore, count: int
) -> None:
    workers = local_workers(count)
    wrong = Chunk("cell 7", "tests.chunk_work:refuses", {})
    with pytest.raises(RefusedInput, match="altitude_m = -1") as refused:
        run_chunks((*NOISE, wrong), store, workers.open, 1)
    assert any("cell 7" in note for note in refused.value.__notes__)
    assert all(map(store.has, NOISE))


def test_a_full_disk_names_the_chunk(store: ChunkStore, monkeypatch: pytest.MonkeyPatch) -> None:
    run_chunks(NOISE[:2], store, ThisProcess, 1)

    def full(*words, **more) -> None:  # type: ignore[no-untyped-def]
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(subject.np, "savez", full)
    with pytest.raises(StorageError, match=r"chunk noise 2: .*No space left"):
        run_chunks(NOISE, store, ThisProcess, 1)
    assert [store.has(chunk) for chunk in NOISE] == [True, True, *[False] * 5]
    assert not list(store.folder.glob(".*"))


SCRIPT = """
import sys
from pathlib import Path
from belahil.chunks import Chunk, ChunkStore, run_chunks
from belahil.executors import local_workers
from belahil.cli import signals
if __name__ == "__main__":
    chunks = [Chunk(f"c{n}", "tests.chunk_work:slow", {"seed": n, "seconds": 0.3}) for n in range(40)]
    workers = local_workers(2)
    store = ChunkStore(Path(sys.argv[1]))
    try:
        with signals.watched():
            run_chunks(chunks, store, workers.open, workers.in_flight,
                       lambda done, total, left: (print(done, flush=True), signals.check()))
    except signals.Interrupted:
        print("kept", sum(map(store.has, chunks)))
"""


@pytest.mark.skipif(os.name != "posix", reason="Ctrl-C for a whole process group is POSIX")
def test_ctrl_c_keeps_what_has_begun(tmp_path: Path) -> None:
    script = tmp_path / "job.py"
    script.write_text(SCRIPT, encoding="utf-8")
    with subprocess.Popen(
        [sys.executable, str(script), str(tmp_path / "chunks")],
        cwd=ROOT,
        env=ENVIRONMENT,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    ) as process:
        assert process.stdout is not None
        lines = iter(process.stdout.readline, "")
        done = next(int(line) for line in lines if int(line) >= 3)
        # when the whole group hears Ctrl-C, workers too
        os.killpg(process.pid, signal.SIGINT)
        last = [*lines][-1].split()
    # then what was running is finished and kept
    assert process.returncode == 0
    assert last[0] == "kept"
    assert done <= int(last[1]) < 40


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_cluster_gives_the_same_bits_and_bears_the_loss_of_a_worker(
    store: ChunkStore, expected: list[bytes]
) -> None:
    pytest.importorskip("distributed", reason="the extra [cluster] is not installed")
    with scheduler() as (address, begun):
        workers = cluster_workers(address)
        late = tuple(Chunk(f"s{n}", "tests.chunk_work:slow", {"seed": n, "seconds": 0.2}) for n in range(20))

        def kill_one(done: int, total: int, left: Mapping[str, int]) -> None:
            if done == 5:
                begun[1].kill()

        run_chunks((*NOISE, *late), store, workers.open, workers.in_flight, kill_one)
        assert told(store) == expected
        # and when the scheduler goes, the line says so and all that was finished is kept
        more = tuple(Chunk(f"m{n}", "tests.chunk_work:slow", {"seed": n, "seconds": 0.3}) for n in range(20))

        def kill_scheduler(done: int, total: int, left: Mapping[str, int]) -> None:
            if done == 3:
                begun[0].kill()

        with pytest.raises(WorkerLost, match=r"chunk m\d+: .*no scheduler answers"):
            run_chunks(more, store, workers.open, workers.in_flight, kill_scheduler)
        assert sum(map(store.has, more)) >= 3


def test_wrong_workers_are_refused_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(RefusedInput, match="at least 1"):
        local_workers(0)
    pytest.importorskip("distributed", reason="the extra [cluster] is not installed")
    monkeypatch.setattr("belahil.executors.SCHEDULER_TIMEOUT_S", 0.5)
    with pytest.raises(WorkerLost, match="no scheduler answers"):
        cluster_workers(f"tcp://127.0.0.1:{free_port()}")
