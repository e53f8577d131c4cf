"""Tests of another project are recorded one by one, and each is replayed from its own file."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_pytest_plugin import TINY, project

from belahil.errors import RefusedInput
from belahil.pytest_recordings import Recordings, parts, recordings_at

__all__ = ["project"]

pytest_plugins = ["pytester"]
TESTS = """
    import pytest
    from belahil.stimuli import Sine
    from belahil.values import WindowRequest

    @pytest.mark.parametrize("code", [3, 4])
    def test_sine(bench, code):
        assert bench.measure(Sine(1e6, 0.05), WindowRequest(0, code, 64)).window.gain_code == code

    def test_run(belahil_run):
        assert belahil_run("characterize", codes=[3]).verdict == "none"

    def test_two(belahil_open):
        for _ in range(2):
            with belahil_open() as opened:
                opened.measure(Sine(2e6, 0.05), WindowRequest(0, 4, 64))

    def test_none(): pass
"""
FILES = ["test_run.rec", "test_sine[3].rec", "test_sine[4].rec", "test_two-2.rec", "test_two.rec"]


def test_each_test_is_recorded_and_replays_its_own(project: pytest.Pytester) -> None:
    # given tests that open no bench, one, or two
    project.makeconftest(TINY)
    project.makepyfile(test_gain=TESTS)
    # when they are recorded
    answer = project.runpytest_subprocess("--belahil-record", "session", "--junitxml", "junit.xml")
    answer.assert_outcomes(passed=5)
    # then each bench has its file, which is named
    found = sorted(project.path.rglob("*.rec"))
    assert [file.name for file in found] == FILES
    assert {file.parent for file in found} == {project.path / "session" / "test_gain.py"}
    answer.stdout.fnmatch_lines(["recorded: *session/test_gain.py/test_sine?3?.rec"])
    assert 'name="belahil_recording"' in (project.path / "junit.xml").read_text()
    # and each test is replayed from it, in any order and by itself
    again = project.runpytest_subprocess("--bench", "replay:session", "-k", "two or 4 or none")
    again.assert_outcomes(passed=3, deselected=2)


@pytest.mark.slow
def test_what_was_not_recorded_says_so_in_a_line(project: pytest.Pytester) -> None:
    project.makeconftest(TINY)
    project.makepyfile(test_gain=TESTS)
    project.runpytest_subprocess("--belahil-record", "session").assert_outcomes(passed=5)
    # What was not recorded says so, as does what goes another way; what is marked as for
    # instruments is replayed where there is a recording, and skipped where there is none
    changed = TESTS.replace("0.05", "0.04").replace(
        "def test_none", "@pytest.mark.hardware\n    def test_none"
    )
    changed = changed.replace("def test_run", "@pytest.mark.hardware\n    def test_run")
    project.makepyfile(test_gain=f"{changed}\n    def test_new(bench): pass\n")
    other = project.runpytest_subprocess("--bench", "replay:session", "-k", "new or 4 or none or run")
    other.assert_outcomes(passed=1, failed=1, errors=2, skipped=1, deselected=2)
    told = other.stdout
    told.fnmatch_lines(["belahil: *test_new.rec: there is no such recording; needed is one of this test"])
    told.fnmatch_lines(["*ReplayDiffers*write to the generator differs from the recorded one*"])
    told.no_fnmatch_line("*During handling*")


def test_a_bench_without_links_is_not_recorded(project: pytest.Pytester) -> None:
    project.makepyfile("def test_a(bench): pass")
    answer = project.runpytest_subprocess("--belahil-record", "new", "--bench", "simulated")
    assert answer.ret == pytest.ExitCode.USAGE_ERROR
    answer.stderr.fnmatch_lines(["*--belahil-record *new: the bench is simulated and has no links"])


def test_folders_that_cannot_serve_are_refused(tmp_path: Path) -> None:
    # given a folder with something else in it, and a recording
    (tmp_path / "full").mkdir()
    (tmp_path / "full/notes.txt").touch()
    # then nothing is recorded into it, but by a worker that is not the first
    with pytest.raises(RefusedInput, match="--belahil-record full: must be a new or an empty folder"):
        recordings_at(tmp_path, "full", "emulated", may_be_filled=False)
    assert recordings_at(tmp_path, "full", "emulated", may_be_filled=True) is not None
    # and nothing is replayed from it
    replayed = recordings_at(tmp_path, None, "replay:full", may_be_filled=False)
    assert replayed is not None
    with pytest.raises(RefusedInput, match=r"replay:.*full: holds no recording"):
        replayed.first_bench()
    # while a file is one recording for all
    assert recordings_at(tmp_path, None, "replay:none.rec", may_be_filled=False) is None


@pytest.mark.slow
def test_workers_record_into_one_folder(project: pytest.Pytester) -> None:
    project.makeconftest(TINY)
    project.makepyfile(test_gain=TESTS)
    project.runpytest_subprocess("--belahil-record", "session", "-n", "2").assert_outcomes(passed=5)
    assert sorted(file.name for file in project.path.rglob("*.rec")) == FILES
    project.runpytest_subprocess("--bench", "replay:session", "-n", "2").assert_outcomes(passed=5)


NAMES = st.text("ab/.:[]-%é\0* ", min_size=1, max_size=20)


@given(NAMES, NAMES)
def test_no_two_tests_share_a_file_and_none_lies_elsewhere(one: str, other: str) -> None:
    ours, theirs = f"test_a.py::test_{one}", f"test_a.py::test_{other}"
    if ours.replace("::", "/") != theirs.replace("::", "/"):
        assert parts(ours) != parts(theirs)
    for name in parts(f"../{ours}"):
        assert not {"/", "\\", "\0", ":", "*"} & set(name)
        assert name not in (".", "..")


def test_long_names_are_cut_and_stay_apart() -> None:
    ours, theirs = (parts(f"t.py::test_a[{300 * 'x'}{end}]")[-1] for end in "ab")
    assert ours != theirs
    assert len(ours) < 140


def test_files_are_counted_by_test(tmp_path: Path) -> None:
    recordings = Recordings(tmp_path, replays=False)
    names = [recordings.next_file(test).name for test in ("t.py::a", "t.py::b", "t.py::a")]
    assert names == ["a.rec", "b.rec", "a-2.rec"]
    with pytest.raises(RefusedInput, match="there is no such recording"):
        Recordings(tmp_path, replays=True).next_file("t.py::a")
