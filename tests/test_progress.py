"""What is told of the time that is left: nothing until enough is known, and then the steady pace."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from belahil.chunks import Chunk, ChunkStore, ThisProcess, run_chunks
from belahil.cli import progress as module
from belahil.cli.progress import Pace, shown

Captured = pytest.CaptureFixture[str]
ROOT = Path(__file__).parents[1]


class Clock:
    """A clock that is moved by hand."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def monotonic(self) -> float:
        return self.now_s


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(module.time, "monotonic", made.monotonic)
    return made


def forecasts(err: str) -> list[tuple[int, float | None]]:
    """What lines told: how many were done, and the time left, s."""
    found = re.findall(r"^(\d+) of \d+ \w+(?:, (\d+) s left)?$", err, re.MULTILINE)
    assert len(found) == err.count("\n")
    return [(int(done), float(left) if left else None) for done, left in found]


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("warm_up_s", [0.0, 3.0, 90.0])
def test_the_first_forecast_is_that_of_the_steady_pace(
    warm_up_s: float, workers: int, clock: Clock, capsys: Captured
) -> None:
    # given a job whose first chunks wait for processes and compilers, and then 100 chunks of 2 s a worker
    total = 100
    with shown(False, things="chunks") as progress:
        progress(0, total, {"echoes": total})
        clock.now_s += warm_up_s
        for done in range(1, total + 1):
            # workers that begin together end together
            clock.now_s += 2.0 if done % workers == 0 else 0.0
            progress(done, total, {"echoes": total - done})
    told = forecasts(capsys.readouterr().err)
    # then whatever is told is right, to a chunk of each worker in the few that were seen
    rest = [(done, left_s) for done, left_s in told if left_s is not None]
    assert rest[0][0] <= 10
    for done, left_s in rest:
        assert left_s == pytest.approx(2.0 * (total - done) / workers, rel=0.45 if done < 10 else 0.15)
    assert rest[-1] == (total, 0.0)


def test_nothing_is_told_before_most_of_what_is_left_has_a_pace(clock: Clock, capsys: Captured) -> None:
    # given 30 quick chunks before 60 slow ones, and 4 of another kind at the end
    left = {"fractal": 30, "echoes": 60, "shots": 4}
    spent = {"fractal": 1.0, "echoes": 10.0, "shots": 12.0}
    total = sum(left.values())
    with shown(False, things="chunks") as progress:
        progress(0, total, left)
        for kind in ("fractal", "echoes", "shots"):
            while left[kind]:
                clock.now_s += spent[kind]
                left[kind] -= 1
                progress(total - sum(left.values()), total, left)
    told = forecasts(capsys.readouterr().err)
    # then the quick ones are no measure of the slow ones
    assert all(left_s is None for done, left_s in told if done < 30 + 5)
    assert dict(told)[35] == pytest.approx(55 * 10 + 4 * 12, rel=0.02)


def test_what_was_there_before_is_no_measure_of_the_pace(clock: Clock, capsys: Captured) -> None:
    # given a run of 60 shots of which 50 are read back at once, and the others take 6 s
    with shown(False, kept=50) as progress:
        for done in range(1, 61):
            clock.now_s += 6.0 if done > 50 else 0.0
            progress(done, 60)
    told = dict(forecasts(capsys.readouterr().err))
    assert told[52] is None
    assert told[56] == 24.0
    assert told[60] == 0.0


def test_a_campaign_that_goes_on_counts_what_it_does_now(clock: Clock, capsys: Captured) -> None:
    # given a job that says at once that 6 of 20 are done, and does the others in 6 s each
    with shown(False, things="chunks") as progress:
        for done in range(6, 21):
            progress(done, 20, {"echoes": 20 - done})
            clock.now_s += 6.0
    told = dict(forecasts(capsys.readouterr().err))
    assert told[7] is None
    assert told[11] == 54.0


@given(
    st.lists(st.tuples(st.sampled_from("abc"), st.floats(0.0, 1e3)), min_size=1, max_size=40),
    st.dictionaries(st.sampled_from("abc"), st.integers(0, 50)),
)
def test_a_forecast_is_between_the_quickest_and_the_slowest_pace(
    done: list[tuple[str, float]], more: dict[str, int]
) -> None:
    pace, now_s = Pace(), 0.0
    left = {kind: more.get(kind, 0) + sum(one == kind for one, _ in done) for kind in "abc"}
    pace.see(left, now_s)
    for kind, took_s in done:
        now_s += took_s
        left[kind] -= 1
        pace.see(left, now_s)
    told = pace.left_s(left)
    if told is not None:
        times_s = [took_s for _, took_s in done]
        count = sum(left.values())
        assert min(times_s) * count * (1 - 1e-9) <= told <= max(times_s) * count * (1 + 1e-9) + 1e-9


def test_a_job_tells_what_is_left_by_its_kind(tmp_path: Path) -> None:
    # given two kinds of chunks, of which one is there already
    job = [Chunk(f"c{n}", "tests.chunk_work:noise", {"seed": n, "count": 2}) for n in range(3)]
    other = Chunk("sum", "tests.chunk_work:sum_of_noise", {"seed": 1, "count": 2})
    run_chunks(job[:1], ChunkStore(tmp_path), ThisProcess, 1)
    told = []
    run_chunks(
        [other, *job],
        ChunkStore(tmp_path),
        ThisProcess,
        1,
        lambda done, total, left: told.append((done, total, dict(left))),
    )
    noise, sums = "tests.chunk_work:noise", other.work
    assert told == [
        (1, 4, {noise: 2, sums: 1}),
        (2, 4, {noise: 2, sums: 0}),
        (3, 4, {noise: 1, sums: 0}),
        (4, 4, {noise: 0, sums: 0}),
    ]


SHOWS_PROGRESS = """
import time
from belahil.cli.progress import shown
with shown(False, kept=0) as progress:
    for done in range(1, 21):
        time.sleep(0.04)
        progress(done, 20)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
def test_a_terminal_sees_a_bar_with_the_time_left() -> None:
    import pty

    master, slave = pty.openpty()
    process = subprocess.Popen([sys.executable, "-c", SHOWS_PROGRESS], cwd=ROOT, stderr=slave)
    os.close(slave)
    seen = b""
    try:
        while portion := os.read(master, 4096):
            seen += portion
    except OSError:  # the way Linux tells that the other end is closed
        pass
    os.close(master)
    assert process.wait(timeout=20) == 0
    told = re.findall(rb"(\d+)/20\x1b\[0m windows(?:, (\d+) s left)?", seen)
    assert len(told) > 4
    assert not any(left for done, left in told if int(done) < 6)
    assert all(left for done, left in told if int(done) >= 6)
