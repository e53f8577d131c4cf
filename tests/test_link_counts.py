"""What a receiver's link dropped is told in the log, though every window came out right."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest
from faulty_bench import FaultyBench, config

from belahil.bench import open_bench
from belahil.cli.main import main
from sim.faults import Fault, FaultPlan

if TYPE_CHECKING:
    from pathlib import Path

    from sim.faults import LinkName

SWEEP = [
    "characterize",
    "--quiet",
    "--codes",
    "4",
    "--amplitudes-mvpp",
    "50",
    "--frequencies-mhz",
    "1,5,15,20,29",
]


def _log(folder: Path, line: LinkName, faults: list[Fault], monkeypatch: pytest.MonkeyPatch) -> str:
    plan = FaultPlan(faults)
    monkeypatch.setattr("belahil.bench.open_bench", lambda *_, **__: FaultyBench(config(line), plan).open())
    assert main([*SWEEP, "--out", str(folder)]) == 0
    plan.require_fired()
    return (folder / "log.txt").read_text()


@pytest.mark.parametrize("line", ["serial", pytest.param("usb", marks=pytest.mark.slow)])
def test_the_log_tells_what_the_link_dropped(
    line: LinkName, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a link on which an acknowledge comes twice and another message is damaged, when a run ends
    faults = [Fault(line, "from_device", "flip", 5, 1), Fault(line, "from_device", "double", 2, 1)]
    log = _log(tmp_path / "run", line, faults, monkeypatch)
    # then its log tells of both, beside the shot that was measured again
    assert re.search(r"the receiver's link dropped [1-9]\d* damaged and [1-9]\d* stale packets", log)
    # and a link that dropped nothing is not mentioned
    assert "dropped" not in _log(tmp_path / "sound", line, [], monkeypatch)


def test_a_bench_without_a_link_drops_nothing() -> None:
    with open_bench("simulated") as bench:
        assert (bench.link_counts.damaged, bench.link_counts.stale) == (0, 0)
