"""What goes wrong in a campaign: nothing finished is lost, and going on gives equal results."""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cluster import ENVIRONMENT, ROOT, scheduler
from tiny_campaign import analyse, plan

from belahil import chunks as engine
from belahil.chunks import Chunk, ChunkStore, ThisProcess, run_chunks
from belahil.cli.main import main
from belahil.errors import WorkerLost
from belahil.executors import local_workers
from belahil.run_folder import read_json
from procedures import campaign_range
from procedures.campaign_range import RangeOptions

CHUNKS = 12
WORDS = ["campaign", "range", "--quiet", "--echoes", str(CHUNKS)]
posix = pytest.mark.skipif(os.name != "posix", reason="signals to processes are POSIX")


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaign_range, "plan", plan)
    monkeypatch.setattr(campaign_range, "analyse", analyse)


def expected(count: int = 24, **more: int) -> dict[str, Any]:
    """What an uninterrupted campaign finds, computed here one after the other."""
    options = RangeOptions(echoes=CHUNKS, study_echoes=count, **more)
    planned = plan(options)
    return analyse(planned, [engine.work(one.work, one.given) for one in planned.chunks]).results


def results(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = read_json(folder / "summary.json")["results"]
    return found


def started(folder: Path, *words: str, **more: Any) -> subprocess.Popen[str]:
    """The same command as a process, its own leader of a group."""
    return subprocess.Popen(
        [sys.executable, "-m", "tests.tiny_campaign", *WORDS, "--out", str(folder), *words],
        env=ENVIRONMENT | more,
        cwd=ROOT,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # A test runner in the background may ignore the signal, and children would inherit that.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )


def wait_for_chunks(folder: Path, count: int, process: subprocess.Popen[str]) -> set[Path]:
    deadline = time.monotonic() + 100
    while len(found := kept(folder)) < count:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.01)
    return found


def kept(folder: Path) -> set[Path]:
    return set((folder / "chunks").glob("*.npz"))


# ---- in this process


def test_chunks_that_are_finished_are_checked_once(
    tiny: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a campaign whose last step failed
    monkeypatch.setattr(campaign_range, "analyse", lambda plan, results: 1 / 0)
    assert main([*WORDS, "--workers", "1", "--out", str(tmp_path / "run")]) == 70
    monkeypatch.setattr(campaign_range, "analyse", analyse)
    looked: list[str] = []
    real = ChunkStore.has
    monkeypatch.setattr(ChunkStore, "has", lambda store, one: looked.append(one.name) or real(store, one))
    # when it goes on, then each file is read once to see that it is whole
    assert main(["campaign", "range", "--quiet", "--resume", str(tmp_path / "run")]) == 0
    assert sorted(looked) == sorted(f"cell {n}" for n in range(CHUNKS))
    assert results(tmp_path / "run") == expected()


@pytest.mark.parametrize("workers", [1, 2])
def test_a_full_disk_stops_a_campaign_that_can_go_on(
    tiny: None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    workers: int,
) -> None:
    # given a disk with room for five chunks
    room, real = iter(range(5)), np.savez

    def savez(*words: Any, **more: Any) -> None:
        if next(room, None) is None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(*words, **more)

    run = tmp_path / "run"
    with monkeypatch.context() as patch:
        patch.setattr(engine.np, "savez", savez)
        assert main([*WORDS, "--workers", str(workers), "--out", str(run)]) == 4
    told = capsys.readouterr().err
    assert "belahil: chunk cell " in told
    assert os.strerror(errno.ENOSPC) in told
    assert f"continue with: belahil campaign range --resume {run}" in told
    # then what was finished is there, and the rest follows
    before = {path: path.stat().st_mtime_ns for path in kept(run)}
    assert len(before) == 5
    assert main(["campaign", "range", "--quiet", "--workers", str(workers), "--resume", str(run)]) == 0
    assert results(run) == expected()
    assert before.items() <= {path: path.stat().st_mtime_ns for path in kept(run)}.items()


def test_a_worker_with_another_belahil_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Other(ThisProcess):
        def submit(self, fn, /, *words, **more):  # type: ignore[no-untyped-def]
            with monkeypatch.context() as there:
                there.setattr(engine, "belahil_version", lambda: "0.0.1")
                return super().submit(fn, *words, **more)

    chunk = Chunk("cell 3", "tests.chunk_work:noise", {"seed": 1, "count": 3})
    store = ChunkStore(tmp_path)
    with pytest.raises(WorkerLost, match=r"chunk cell 3: a worker has belahil 0\.0\.1; this job needs"):
        run_chunks([chunk], store, Other, 1)
    assert not store.has(chunk)


def test_the_job_holds_no_more_results_than_are_handed_out(tmp_path: Path) -> None:
    import tracemalloc

    # given results of a megabyte each
    size, peaks = 125_000, []
    for total in (8, 32):
        job = [Chunk(f"c{n}", "tests.chunk_work:noise", {"seed": n, "count": size}) for n in range(total)]
        tracemalloc.start()
        run_chunks(job, ChunkStore(tmp_path / str(total)), ThisProcess, 1)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    # then four times as many take the same memory, to a quarter of one of them
    assert abs(peaks[1] - peaks[0]) < 0.25 * 8 * size
    assert peaks[1] < 4 * 8 * size


# ---- processes


@posix
def test_ctrl_c_keeps_what_is_finished(tmp_path: Path) -> None:
    run = tmp_path / "run"
    with started(run, "--workers", "2", "--repeats", "150") as process:
        before = wait_for_chunks(run, 3, process)
        os.killpg(process.pid, signal.SIGINT)
        _, told = process.communicate(timeout=100)
    assert process.returncode == 130
    assert told == f"belahil: interrupted; continue with: belahil campaign range --resume {run}\n"
    assert before <= kept(run)
    assert len(kept(run)) < CHUNKS
    # and going on gives what it would have given
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "tests.tiny_campaign",
            "campaign",
            "range",
            "--quiet",
            "--workers",
            "1",
            "--resume",
            str(run),
        ],
        env=ENVIRONMENT,
        cwd=ROOT,
        check=False,
    )
    assert done.returncode == 0
    assert results(run) == expected()


@posix
def test_a_worker_that_is_killed_is_replaced(tmp_path: Path) -> None:
    psutil = pytest.importorskip("psutil", reason="finds the workers")
    run = tmp_path / "run"
    with started(run, "--workers", "2", "--repeats", "150") as process:
        wait_for_chunks(run, 3, process)
        workers = [
            one for one in psutil.Process(process.pid).children() if "spawn_main" in str(one.cmdline())
        ]
        assert len(workers) == 2
        workers[0].kill()
        _, told = process.communicate(timeout=100)
    assert (process.returncode, told) == (0, "")
    assert "a worker was lost; chunk cell " in (run / "log.txt").read_text()
    assert results(run) == expected()


@posix
@pytest.mark.slow
def test_a_chunk_that_kills_every_worker_ends_the_campaign_by_its_name(tmp_path: Path) -> None:
    run, cure = tmp_path / "run", tmp_path / "cure"
    with started(run, "--workers", "2", DEADLY=str(cure)) as process:
        _, told = process.communicate(timeout=100)
    assert process.returncode == 3
    assert "workers were lost 3 times on " in told
    assert "cell of death" in told
    before = kept(run)
    # and when the cause is gone, it goes on
    cure.touch()
    words = ["campaign", "range", "--quiet", "--workers", "2", "--resume", str(run)]
    done = subprocess.run(
        [sys.executable, "-m", "tests.tiny_campaign", *words],
        env=ENVIRONMENT | {"DEADLY": str(cure)},
        cwd=ROOT,
        check=False,
    )
    assert done.returncode == 0
    assert len(kept(run)) == CHUNKS + 1
    assert before <= kept(run)
    cells = results(run)["cells"]["digests"]
    assert [*cells[:1], *cells[2:]] == expected()["cells"]["digests"]


FULL = """
set -e
mkdir -p {disk}
mount -t tmpfs -o size=300k none {disk}
set +e
{command} campaign range --quiet --echoes 12 --study-echoes 6000 --workers 2 --out {disk}/run
echo status $?
ls {disk}/run/chunks | wc -l
mount -o remount,size=50m {disk}
{command} campaign range --quiet --workers 2 --resume {disk}/run
echo status $?
cp {disk}/run/summary.json {copy}
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="makes a small disk by namespaces of Linux")
def test_a_disk_that_is_really_full(tmp_path: Path) -> None:
    if shutil.which("unshare") is None or subprocess.run(["unshare", "-Urm", "true"], check=False).returncode:
        pytest.skip("this system gives no namespace of its own")
    # given a disk of 300 kB for twelve chunks of 48 kB
    disk, copy = tmp_path / "disk", tmp_path / "summary.json"
    text = FULL.format(disk=disk, copy=copy, command=f"{sys.executable} -m tests.tiny_campaign")
    done = subprocess.run(
        ["unshare", "-Urm", "sh", "-c", text],
        env=ENVIRONMENT,
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    )
    first, chunks, second = done.stdout.splitlines()
    assert (first, second) == ("status 4", "status 0")
    assert 3 <= int(chunks) <= 6
    assert "belahil: chunk cell " in done.stderr
    assert os.strerror(errno.ENOSPC) in done.stderr
    assert json.loads(copy.read_text())["results"] == expected(6000)


# ---- a cluster


@pytest.fixture
def cluster() -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    pytest.importorskip("distributed", reason="the extra [cluster] is not installed")
    with scheduler() as made:
        yield made


@posix
@pytest.mark.slow
@pytest.mark.timeout(400)
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("how", ["scheduler", "ctrl-c"])
def test_a_cluster_that_is_left_keeps_what_is_finished(
    tmp_path: Path, cluster: tuple[str, list[subprocess.Popen[bytes]]], how: str
) -> None:
    run, (address, begun) = tmp_path / "run", cluster
    with started(run, "--cluster", address, "--repeats", "300") as process:
        before = wait_for_chunks(run, 3, process)
        if how == "scheduler":
            begun[0].kill()
        else:
            process.send_signal(signal.SIGINT)
        _, told = process.communicate(timeout=200)
    last = told.splitlines()[-1]
    assert last.endswith(f"continue with: belahil campaign range --resume {run}")
    if how == "scheduler":
        assert process.returncode == 3
        assert "belahil: chunk cell " in last
        assert "no scheduler answers" in last
    else:
        assert process.returncode == 130
        assert last.startswith("belahil: interrupted")
        assert told.count("\n") == 1
    assert before <= kept(run)
    assert len(kept(run)) < CHUNKS
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "tests.tiny_campaign",
            "campaign",
            "range",
            "--quiet",
            "--workers",
            "2",
            "--resume",
            str(run),
        ],
        env=ENVIRONMENT,
        cwd=ROOT,
        check=False,
    )
    assert done.returncode == 0
    assert results(run) == expected()


@pytest.mark.slow
@pytest.mark.timeout(400)
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_chunk_that_kills_workers_of_a_cluster_is_named(
    tmp_path: Path,
) -> None:
    pytest.importorskip("distributed", reason="the extra [cluster] is not installed")
    # given a scheduler that gives a chunk up when its first worker died
    with scheduler(DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="0") as (address, _):
        run = tmp_path / "run"
        with started(run, "--cluster", address, DEADLY=str(tmp_path / "cure")) as process:
            _, told = process.communicate(timeout=200)
    assert process.returncode == 3
    assert "belahil: chunk cell of death: every worker that began it died" in told


OPTIONS = RangeOptions(("table",), echoes=2, repeats=1, sets=4, noise_windows=20, shots=1)
RANGE = ["campaign", "range", "--quiet", "--parts", "table", "--echoes", "2", "--repeats", "1"]
RANGE += ["--sets", "4", "--noise-windows", "20", "--shots", "1"]


def chunk_files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.glob("*.npz")}


@posix
@pytest.mark.slow
@pytest.mark.timeout(3000)
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_campaign_on_a_cluster_that_loses_a_worker_equals_one_of_one_process(
    tmp_path: Path, cluster: tuple[str, list[subprocess.Popen[bytes]]]
) -> None:
    # given the same campaign in one process, in two, and on a cluster of two of which one is killed
    address, begun = cluster
    runs = {name: tmp_path / name for name in ("one", "two", "cluster")}
    where = {"one": ["--workers", "1"], "two": ["--workers", "2"], "cluster": ["--cluster", address]}
    for name, folder in runs.items():
        words = [sys.executable, "-m", "belahil", *RANGE, *where[name], "--out", str(folder)]
        with subprocess.Popen(words, env=ENVIRONMENT, cwd=ROOT, stderr=subprocess.PIPE, text=True) as process:
            if name == "cluster":
                wait_for_chunks(folder, 5, process)
                begun[1].kill()
            _, told = process.communicate(timeout=900)
        assert (process.returncode, told) == (0, "")
    # then chunks and results are equal, bit for bit
    chunks, found = chunk_files(runs["one"] / "chunks"), results(runs["one"])
    planned = [*campaign_range.plan(OPTIONS).chunks]
    assert chunks.keys() == {f"{one.key}.npz" for one in planned}
    for name in ("two", "cluster"):
        assert chunk_files(runs[name] / "chunks") == chunks
        assert results(runs[name]) == found
    # and so they are when the chunks come in another order
    shuffled = [planned[n] for n in np.random.default_rng(1).permutation(len(planned))]
    workers = local_workers(2)
    run_chunks(shuffled, ChunkStore(tmp_path / "shuffled"), workers.open, workers.in_flight)
    assert chunk_files(tmp_path / "shuffled") == chunks
