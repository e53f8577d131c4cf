"""A run: one folder, one process, every shot once, and the same end whatever interrupted it."""

from __future__ import annotations

import importlib
import json
import math
import os
import subprocess
import sys
import tracemalloc
from pathlib import Path

import pytest
from small_run import INSTRUMENTS, begin, made, measure, outcome, requested

from belahil.circumstances import conditions, not_modelled
from belahil.config import BenchConfig, DigitizerTable, GeneratorTable, LimitsTable, parse_bench
from belahil.errors import RefusedInput, StorageError
from belahil.run import Run
from belahil.run_folder import claim
from belahil.values import Estimate, Shot, WindowRequest
from belahil.verdict import Check, Decision

TESTS = Path(__file__).resolve().parent
ENVIRONMENT = os.environ | {"PYTHONPATH": os.pathsep.join([str(TESTS.parent), str(TESTS)])}


def test_a_resumed_run_measures_only_what_is_missing(tmp_path: Path) -> None:
    # given a run that stopped after five shots
    with begin(tmp_path / "run") as run:
        assert measure(run, 5) == [0, 1, 2, 3, 4]
    # when it is resumed
    with Run.resume(tmp_path / "run") as run:
        taken = measure(run, 12)
        # then the others are measured, and all are there in the order of the plan
        assert taken == list(range(5, 12))
        assert run.measured == 7
        found = list(run.shots())
        assert len(run.shots()) == 12
        assert all(shot.window.equals(made(number).window) for number, shot in enumerate(found))
        assert [shot.played for shot in found] == [made(number).played for number in range(12)]
        assert [shot.attempt for shot in run.shots()] == [made(number).attempt for number in range(12)]


def test_everything_a_resume_needs_is_in_the_folder(tmp_path: Path) -> None:
    config = parse_bench("[generator]\nload_ohm = inf\n[emulation]\nseed = 7\n[limits]\ngain = [1, 2]")
    with begin(tmp_path / "run", config) as run:
        begun = run.begun
    with Run.resume(tmp_path / "run") as run:
        assert run.config == config
        assert run.begun == begun
        assert run.begun.options == {"codes": [0, 1, 2], "span": float("inf")}
        assert (run.begun.procedure, run.begun.seed, run.begun.instruments) == ("noise", 7, INSTRUMENTS)
        run.confirm({"windows": 12, "levels": (0.1, 0.3)}, INSTRUMENTS)


def test_a_shot_that_fails_leaves_the_others(tmp_path: Path) -> None:
    def fail() -> Shot:
        raise ZeroDivisionError

    with begin(tmp_path / "run") as run:
        measure(run, 2)
        with pytest.raises(ZeroDivisionError):
            run.shot(requested(2), fail)
        assert len(run.shots()) == 2
        assert measure(run, 3) == [2]


def test_a_kept_shot_answers_only_its_own_request(tmp_path: Path) -> None:
    with begin(tmp_path / "run") as run:
        measure(run, 1)
        with pytest.raises(StorageError, match="shot 0 answers"):
            run.shot(WindowRequest(0, gain_code=2), lambda: made(0))


@pytest.mark.parametrize(
    ("plan", "instruments", "said"),
    [
        ({"windows": 13, "levels": (0.1, 0.3)}, INSTRUMENTS, "plan.windows was 12 and is 13"),
        ({"windows": 12, "levels": (0.1,)}, INSTRUMENTS, r"plan.levels was \[0.1, 0.3\]"),
        (
            {"windows": 12, "levels": (0.1, 0.3)},
            INSTRUMENTS | {"digitizer": "other"},
            "begun with the digitizer 'belahil,bela-grm,EMULATED,0'; now 'other' answers",
        ),
    ],
)
def test_another_plan_or_instrument_is_refused(
    tmp_path: Path, plan: dict[str, object], instruments: dict[str, str], said: str
) -> None:
    begin(tmp_path / "run").close()
    with Run.resume(tmp_path / "run") as run, pytest.raises(RefusedInput, match=said):
        run.confirm(plan, instruments)


@pytest.mark.parametrize(
    ("line", "other", "said"),
    [
        ("max_vpp = 0.5", "max_vpp = 0.4", "bench.generator.max_vpp was 0.5 and is 0.4"),
        ("seed = 1", "seed = 2", "bench.emulation.seed was 1 and is 2"),
    ],
)
def test_a_changed_bench_is_refused(tmp_path: Path, line: str, other: str, said: str) -> None:
    begin(tmp_path / "run").close()
    path = tmp_path / "run" / "bench.toml"
    text = path.read_text()
    assert text.count(f"\n{line}\n") == 1
    path.write_text(text.replace(f"\n{line}\n", f"\n{other}\n"))
    with pytest.raises(RefusedInput, match=said):
        Run.resume(tmp_path / "run")


def test_where_an_instrument_is_plugged_in_may_change(tmp_path: Path) -> None:
    def lab(address: str, link: str) -> BenchConfig:
        return BenchConfig(generator=GeneratorTable(address=address), digitizer=DigitizerTable(link=link))

    begin(tmp_path / "run", lab("USB0::1::2::A::INSTR", "serial:COM3")).close()
    from belahil.run_folder import write_bench

    write_bench(tmp_path / "run", lab("TCPIP::lab::INSTR", "serial:COM4"))
    with Run.resume(tmp_path / "run") as run:
        assert run.config.digitizer.link == "serial:COM4"


def test_another_version_of_belahil_does_not_go_on_with_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin(tmp_path / "run").close()
    monkeypatch.setattr("belahil.fingerprint.belahil_version", lambda: "99.0")
    with pytest.raises(RefusedInput, match=r"belahil was '.*' and is '99.0'"):
        Run.resume(tmp_path / "run")


def test_the_fingerprint_is_that_of_the_facts(tmp_path: Path) -> None:
    prints = set()
    for number, changes in enumerate(
        [
            {},
            {"seed": 8},
            {"plan": {"windows": 13}},
            {"config": BenchConfig(generator=GeneratorTable(max_vpp=0.4))},
        ]
    ):
        with begin(tmp_path / str(number), **changes) as run:
            prints.add(run.fingerprint)
    with begin(tmp_path / "again") as run:
        assert run.fingerprint in prints
    assert len(prints) == 4


# ---- the folder


def test_a_folder_with_something_in_it_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(RefusedInput, match="not empty"):
        begin(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]
    with pytest.raises(RefusedInput, match="is a file"):
        begin(tmp_path / "notes.txt")


def test_a_used_run_folder_is_refused_with_the_way_to_continue(tmp_path: Path) -> None:
    begin(tmp_path / "run").close()
    with pytest.raises(RefusedInput, match=r"--resume .*run continues the run in it"):
        begin(tmp_path / "run")


def test_an_empty_folder_and_a_new_one_within_new_ones_are_taken(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    begin(tmp_path / "empty").close()
    begin(tmp_path / "a" / "b" / "c").close()
    assert (tmp_path / "a" / "b" / "c" / "bench.toml").is_file()


def test_a_folder_that_cannot_be_made_is_a_storage_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(StorageError, match="cannot be"):
        begin(tmp_path / "file" / "run")


def test_what_is_no_run_cannot_be_resumed(tmp_path: Path) -> None:
    with pytest.raises(RefusedInput, match="there is no run"):
        Run.resume(tmp_path)
    begin(tmp_path / "run").close()
    (tmp_path / "run" / "bench.toml").unlink()
    with pytest.raises(StorageError, match=r"bench.toml: cannot be read"):
        Run.resume(tmp_path / "run")


def test_a_run_that_was_killed_before_its_journal_is_begun_again(tmp_path: Path) -> None:
    # given a folder that was claimed, and no more
    claim(tmp_path / "run").release()
    # then it is neither resumed nor said to be resumable, in one line each
    with pytest.raises(RefusedInput, match="ended before its first shot; remove the folder and begin again"):
        Run.resume(tmp_path / "run")
    with pytest.raises(RefusedInput, match=r"the folder is not empty$"):
        begin(tmp_path / "run")


OTHER_PROCESS = """
import sys
from belahil.errors import RefusedInput
from belahil.run import Run
try:
    Run.resume(sys.argv[1]).close()
except RefusedInput as error:
    print(error)
"""


def test_two_processes_on_one_folder_are_refused(tmp_path: Path) -> None:
    def other() -> str:
        return subprocess.run(
            [sys.executable, "-c", OTHER_PROCESS, str(tmp_path / "run")],
            env=ENVIRONMENT,
            capture_output=True,
            text=True,
            check=True,
        ).stdout

    with begin(tmp_path / "run"):
        assert "another process is using this run folder" in other()
    assert other() == ""


# ---- the end


def test_a_finished_run_holds_what_the_contract_names(tmp_path: Path) -> None:
    with begin(tmp_path / "run") as run:
        measure(run, 12)
        summary = run.finish(outcome())
    assert {path.name for path in (tmp_path / "run").iterdir()} == {
        "summary.json",
        "data.nc",
        "report.html",
        "report.json",
        "bench.toml",
        "journal",
        "log.txt",
        "figure-noise.svg",
        "figure-noise.png",
    }
    told = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert told == summary
    assert list(told) == [
        *("schema", "procedure", "source", "verdict", "checks", "seed", "software", "instruments"),
        *("started", "finished", "results"),
    ]
    assert (told["procedure"], told["source"], told["verdict"], told["seed"]) == (
        "noise",
        "emulated",
        "none",
        7,
    )
    assert told["instruments"] == INSTRUMENTS
    assert told["software"]["belahil"]
    assert told["started"] <= told["finished"]
    assert told["results"] == outcome().results


@pytest.mark.parametrize(
    ("span", "verdict"), [((4.0, 6.0), "undecided"), ((5.5, 6.0), "fail"), ((5.19, 6.0), "undecided")]
)
def test_limits_give_a_verdict(tmp_path: Path, span: tuple[float, float], verdict: str) -> None:
    config = BenchConfig(limits=LimitsTable(gain=span))
    with begin(tmp_path / "run", config) as run:
        summary = run.finish(outcome())
    assert summary["verdict"] == verdict
    # and each value stands beside its limits
    gain = outcome().results["gain_codes"][0]["gain"]
    both = {"limit": "gain", "low": span[0], "high": span[1]}
    assert [one | both for one in summary["checks"]] == summary["checks"]
    assert [(one["label"], one["measured"]) for one in summary["checks"]] == [
        ("code 0", gain),
        ("code 1", None),
    ]
    assert verdict in [one["verdict"] for one in summary["checks"]]
    assert summary["checks"][1]["verdict"] == "undecided"


@pytest.mark.parametrize(
    ("own", "span", "verdict"),
    [
        ("fail", (0.0, 9.0), "fail"),
        ("pass", (8.0, 9.0), "fail"),
        ("pass", (0.0, 9.0), "pass"),
        ("undecided", None, "undecided"),
    ],
)
def test_what_a_procedure_decides_itself_counts_for_the_verdict(
    tmp_path: Path, own: Decision, span: tuple[float, float] | None, verdict: str
) -> None:
    # Given a check of the procedure's own beside what [limits] asks, if anything
    check = Check("agreement", "all", 0.0, 1.0, None, own)
    limits = None if span is None else LimitsTable(gain=span)
    with begin(tmp_path / "run", BenchConfig(limits=limits)) as run:
        summary = run.finish(outcome(checks=[check], verdict_values={"gain": [("all", Estimate(5.0, 0.1))]}))
    # Then it stands first, and both decide
    assert summary["verdict"] == verdict
    assert [one["limit"] for one in summary["checks"]] == ["agreement"] + ["gain"] * (span is not None)


def test_a_limit_without_an_end_is_null_in_the_summary(tmp_path: Path) -> None:
    config = BenchConfig(limits=LimitsTable(gain=(4.0, math.inf)))
    with begin(tmp_path / "run", config) as run:
        found = run.finish(outcome())["checks"]
    assert [(one["low"], one["high"], one["verdict"]) for one in found] == [
        (4.0, None, "pass"),
        (4.0, None, "undecided"),
    ]
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["checks"] == found


def test_a_resumed_run_tells_the_command_that_began_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["belahil", "noise", "--seed", "7"])
    with begin(tmp_path / "run") as run:
        measure(run, 2)
    monkeypatch.setattr("sys.argv", ["belahil", "noise", "--resume", "run"])
    with Run.resume(tmp_path / "run") as run:
        told = conditions(run)
    assert told["command"] == "belahil noise --seed 7"
    assert told["options"] == "codes: 0, 1, 2; span: inf"


def test_what_is_not_modelled_is_told_of_our_own_emulation_only(tmp_path: Path) -> None:
    # given that parts of the emulation are loaded
    importlib.import_module("sim.receiver_model")
    client = parse_bench('[generator]\naddress = "A::1::SOCKET"\n[digitizer]\nlink = "socket://a:1"\n')
    with begin(tmp_path / "own") as own, begin(tmp_path / "far", client, seed=None, source="emulated") as far:
        assert any(line.startswith("receiver model: ") for line in not_modelled(own))
        assert not_modelled(far) == []
        # and instruments elsewhere have no seed that is known here
        assert far.finish(outcome(figures={}))["seed"] is None
    page = (tmp_path / "far" / "report.html").read_text(encoding="utf-8")
    assert "<tr><th>seed</th><td>\N{EN DASH}</td></tr>" in page
    with Run.resume(tmp_path / "far") as run:
        assert run.begun.seed is None


def test_limits_that_are_kept_pass(tmp_path: Path) -> None:
    config = BenchConfig(limits=LimitsTable(gain=(4.0, 6.0)))
    values = outcome().verdict_values["gain"][:1]
    with begin(tmp_path / "run", config) as run:
        assert run.finish(outcome(verdict_values={"gain": values}))["verdict"] == "pass"


def test_a_number_that_is_none_never_gets_into_the_summary(tmp_path: Path) -> None:
    with begin(tmp_path / "run") as run:
        with pytest.raises(ValueError, match="not JSON compliant"):
            run.finish(outcome(results={"gain": float("nan")}))
        assert not run.finished
    assert not (tmp_path / "run" / "summary.json").exists()


def test_a_run_that_died_while_it_ended_can_end_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a run whose disk is full when the figures are drawn
    def full(*words: object) -> None:
        raise StorageError("full")

    with begin(tmp_path / "run") as run:
        measure(run, 12)
        monkeypatch.setattr("belahil.report.save_figures", full)
        with pytest.raises(StorageError):
            run.finish(outcome())
    monkeypatch.undo()
    # when it is resumed
    with Run.resume(tmp_path / "run") as run:
        assert not run.finished
        assert measure(run, 12) == []
        run.finish(outcome())
    # then it is whole, and no temporary file is left
    with Run.resume(tmp_path / "run") as run:
        assert run.finished
    assert not list((tmp_path / "run").glob(".*"))


def test_a_finished_run_is_opened_by_any_version(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with begin(tmp_path / "run") as run:
        run.finish(outcome())
    monkeypatch.setattr("belahil.fingerprint.belahil_version", lambda: "99.0")
    with Run.resume(tmp_path / "run") as run:
        assert run.finished


def test_the_log_tells_what_happened(tmp_path: Path) -> None:
    with begin(tmp_path / "run") as run:
        measure(run, 6)
    with open(tmp_path / "run" / "journal" / "shots", "ab") as file:
        file.write(b"torn")
    with Run.resume(tmp_path / "run") as run:
        run.finish(outcome())
    log = (tmp_path / "run" / "log.txt").read_text()
    for part in (
        "begun with belahil ",
        "generator: Agilent Technologies,33522B",
        "shot 5 came at attempt 2",
        "resumed with 6 shots",
        "4 bytes of a torn shot were cut",
        "finished with 6 shots, verdict none",
    ):
        assert part in log


# ---- limits of the machine

FILLS_ITS_DISK = """
import resource, sys
from belahil.errors import StorageError
from small_run import begin, measure
run = begin(sys.argv[1])
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), int(sys.argv[2])))
try:
    measure(run, 1000)
except StorageError as error:
    print(error)
print(len(run.shots()))
run.close()
"""


def test_a_full_disk_ends_the_run_and_keeps_what_is_there(tmp_path: Path) -> None:
    pytest.importorskip("resource", reason="only POSIX limits the size of files")
    # given a process that may not write more than 20 kB into a file
    answer = subprocess.run(
        [sys.executable, "-c", FILLS_ITS_DISK, str(tmp_path / "run"), "20000"],
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=True,
    )
    error, kept = answer.stdout.splitlines()
    # then it says so, and all that it counted is there for a resume
    assert f"{kept} shots are kept (File too large)" in error
    assert 20 < int(kept) < 45
    with Run.resume(tmp_path / "run") as run:
        assert measure(run, int(kept) + 2) == [int(kept), int(kept) + 1]


ENDS_ON_A_FULL_DISK = """
import resource, sys
from belahil.errors import StorageError
from small_run import begin, made, outcome, requested
run = begin(sys.argv[1], sync=False)
for number in range(40):
    run.shot(requested(number), lambda: made(number, 16064))
resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, 1_000_000))
try:
    run.finish(outcome())
except StorageError as error:
    print(error)
run.close()
"""


def test_a_disk_that_is_full_at_the_end_is_told_and_leaves_no_half_file(tmp_path: Path) -> None:
    pytest.importorskip("resource", reason="only POSIX limits the size of files")
    answer = subprocess.run(
        [sys.executable, "-W", "error", "-c", ENDS_ON_A_FULL_DISK, str(tmp_path / "run")],
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert "data.nc: cannot be written (File too large)" in answer.stdout
    assert answer.stderr == ""
    assert {path.name for path in (tmp_path / "run").iterdir()} == {"bench.toml", "journal", "log.txt"}
    # and with room it ends
    with Run.resume(tmp_path / "run") as run:
        run.finish(outcome())
        assert run.finished


def test_shots_are_read_one_at_a_time(tmp_path: Path) -> None:
    # given 6 MB of windows
    with begin(tmp_path / "run", sync=False) as run:
        for number in range(200):
            run.shot(requested(number), lambda number=number: made(number, samples=16064))  # type: ignore[misc]
        # when all are passed over, twice
        tracemalloc.start()
        shots = run.shots()
        assert sum(1 for _ in shots) == sum(1 for _ in shots) == 200
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    # then memory held a few of them
    assert peak < 8 * 2 * 16064


def test_the_run_waits_for_the_disk_once_a_shot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[int] = []
    monkeypatch.setattr("belahil.journal._sync", synced.append)
    with begin(tmp_path / "run") as run:
        measure(run, 3)
        assert len(synced) == 3
        assert run.fsync_s > 0
    with Run.resume(tmp_path / "run", sync=False) as run:
        measure(run, 5)
        assert len(synced) == 3
