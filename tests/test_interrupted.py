"""Killed at any moment, a run ends as if nothing had happened."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from small_run import begin, measure, outcome

from belahil.run import Run

TESTS = Path(__file__).resolve().parent
ENVIRONMENT = os.environ | {"PYTHONPATH": os.pathsep.join([str(TESTS.parent), str(TESTS)])}
KILLS = 20

# Measures as slowly as an instrument does, and writes down each measurement that it begins.
WRITER = """
import os, sys, time
from belahil.run import Run
from small_run import begin, made, requested
folder, begun, count = sys.argv[1], sys.argv[2], int(sys.argv[3])
run = Run.resume(folder) if os.path.exists(folder) else begin(folder)
notes = os.open(begun, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
def take(shot):
    os.write(notes, b"%d\\n" % shot)
    time.sleep(0.002)
    return made(shot)
for shot in range(count):
    run.shot(requested(shot), lambda: take(shot))
run.close()
"""


def start(*words: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, *words], env=ENVIRONMENT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )


def wait_for(path: Path, size: int, process: subprocess.Popen[bytes]) -> bool:
    """Wait until a file has a size; False when the process ended before."""
    deadline = time.monotonic() + 60
    while process.poll() is None:
        assert time.monotonic() < deadline
        if path.exists() and path.stat().st_size >= size:
            return True
        time.sleep(0.0003)
    return False


def test_a_run_that_is_killed_again_and_again_loses_nothing(tmp_path: Path) -> None:
    # given the results of an uninterrupted run
    count = 20 * KILLS
    with begin(tmp_path / "whole", sync=False) as run:
        measure(run, count)
        run.finish(outcome(figures={}))
    # when a run is killed at random moments, and continued each time
    draw = random.Random(20)
    folder, notes = tmp_path / "run", tmp_path / "begun"
    journal = folder / "journal" / "shots"
    shots_bytes = (tmp_path / "whole" / "journal" / "shots").stat().st_size / count
    kills = 0
    while kills < KILLS:
        process = start("-c", WRITER, str(folder), str(notes), str(count))
        size = int(shots_bytes * (kills + draw.random()) * count / KILLS)
        assert wait_for(journal, size, process)
        time.sleep(draw.uniform(0, 0.004))
        process.kill()
        process.wait()
        kills += 1
    with Run.resume(folder) as run:
        measure(run, count)
        run.finish(outcome(figures={}))
    # then each shot was begun once, but for the one that was in progress at a kill
    begun = [int(line) for line in notes.read_text().split()]
    assert len(begun) - len(set(begun)) <= KILLS
    again = {shot for shot in begun if begun.count(shot) > 1}
    assert all(begun.count(shot) <= 1 + KILLS for shot in again)
    # and counts and results are equal
    results = [
        json.loads((tmp_path / name / "summary.json").read_text())["results"] for name in ("whole", "run")
    ]
    assert results[0] == results[1]


COMMAND = ["-m", "belahil", "characterize", "--quiet"]
PLAN = ["--codes", "2-5", "--amplitudes-mvpp", "30,50", "--frequencies-mhz", "1,5,10,15,19,25"]
PLAN += ["--dark-windows", "2", "--seed", "11"]
WINDOWS = 4 * (2 + 2 * 6)


def counts_and_results(folder: Path) -> tuple[list[bytes], object]:
    with Run.resume(folder) as run:
        counts = [shot.window.counts.tobytes() for shot in run.shots()]
    return counts, json.loads((folder / "summary.json").read_text())["results"]


def finished(*words: str) -> None:
    process = start(*words)
    assert process.wait(timeout=60) == 0


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_characterization_that_is_killed_at_twenty_moments_ends_the_same(tmp_path: Path) -> None:
    # given an uninterrupted characterization on the emulated bench
    whole, folder = tmp_path / "whole", tmp_path / "run"
    finished(*COMMAND, *PLAN, "--out", str(whole))
    journal = folder / "journal" / "shots"
    shot_bytes = (whole / "journal" / "shots").stat().st_size / WINDOWS
    # when another one is killed at twenty random moments
    draw = random.Random(7)
    for kill in range(KILLS):
        words = ["--resume", str(folder)] if journal.exists() else [*PLAN, "--out", str(folder)]
        process = start(*COMMAND, *words)
        assert wait_for(journal, int(shot_bytes * (kill + draw.random()) * WINDOWS / KILLS), process)
        time.sleep(draw.uniform(0, 0.003))
        process.kill()
        process.wait()
    finished(*COMMAND, "--resume", str(folder))
    # then counts and results are those of the other
    assert counts_and_results(folder) == counts_and_results(whole)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_characterization_is_resumable(tmp_path: Path, number: signal.Signals) -> None:
    whole, folder = tmp_path / "whole", tmp_path / "run"
    finished(*COMMAND, *PLAN, "--out", str(whole))
    shot_bytes = (whole / "journal" / "shots").stat().st_size / WINDOWS
    process = start(*COMMAND, *PLAN, "--out", str(folder))
    assert wait_for(folder / "journal" / "shots", int(10 * shot_bytes), process)
    process.send_signal(number)
    assert process.wait(timeout=10) == 130
    assert not (folder / "summary.json").exists()
    finished(*COMMAND, "--resume", str(folder))
    assert counts_and_results(folder) == counts_and_results(whole)
