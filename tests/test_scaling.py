"""Large campaigns: what a worker holds does not grow with the shots, and the page's example runs."""

from __future__ import annotations

import re
import sys
import tracemalloc
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import asdict
from gc import collect
from pathlib import Path
from types import ModuleType

import pytest
from tiny_campaign import analyse, plan

from belahil.chunks import Chunk, ChunkStore, ThisProcess, run_chunks
from belahil.cli.main import main
from procedures import campaign_range, range_parts
from procedures.campaign_range import RangeOptions
from procedures.range_ground import GroundKey

PAGE = Path(__file__).resolve().parent.parent / "docs" / "scaling.md"


@pytest.mark.slow
def test_a_worker_holds_no_more_for_four_times_as_many_shots(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given whole shots of one cell over a plane, in parts of at most 25
    monkeypatch.setattr(range_parts, "SHOTS_IN_CHUNK", 25)

    def chunks_of(shots: int) -> list[Chunk]:
        chunks = [
            Chunk(one.name, one.work, dict(one.given) | {"ground": asdict(GroundKey("plane"))})
            for one in range_parts.brute_chunks(RangeOptions(("table",), shots=shots), 3)
            if one.name.startswith("shots from 800 km, day, reflectance 0.17")
        ]
        assert len(chunks) == shots // 25
        return chunks

    def peak_bytes(shots: int) -> int:
        tracemalloc.start()
        # What is dropped must not wait for the collector, which comes when it likes.
        run_chunks(chunks_of(shots), ChunkStore(tmp_path / str(shots)), ThisProcess, 1, lambda *at: collect())
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return int(peak)

    # what is imported and made once
    run_chunks(chunks_of(25), ChunkStore(tmp_path / "first"), ThisProcess, 1)
    # when a worker takes 50 and 200 of them, then it holds the same, to less than one window of volts
    few, many = peak_bytes(50), peak_bytes(200)
    assert abs(many - few) < 16_064 * 8


@pytest.mark.parametrize("kind", [ThreadPoolExecutor, ProcessPoolExecutor])
def test_the_example_of_the_page_runs_with_any_executor(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: type[Executor]
) -> None:
    # given the page's program, another executor under the name of the one for MPI, and small work
    found = re.search(r"```python\n(# campaign_mpi\.py.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert found is not None
    stands_in = ModuleType("mpi4py.futures")
    stands_in.MPIPoolExecutor = kind  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "mpi4py", ModuleType("mpi4py"))
    monkeypatch.setitem(sys.modules, "mpi4py.futures", stands_in)
    monkeypatch.setattr(campaign_range, "plan", plan)
    monkeypatch.setattr(campaign_range, "analyse", analyse)
    monkeypatch.chdir(tmp_path)

    exec(compile(found[1], "campaign_mpi.py", "exec"), {"__name__": "__main__"})

    # then the command takes it from there, and has nothing left to compute
    assert main(["campaign", "range", "--quiet", "--workers", "1", "--resume", "large"]) == 0
    assert "0 chunks on 1 workers" in (tmp_path / "large" / "log.txt").read_text()
