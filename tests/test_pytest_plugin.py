"""The pytest plugin, as another project's tests meet it: in a pytest process of their own."""

from __future__ import annotations

import os
import shutil
import tomllib
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

pytest_plugins = ["pytester"]

ROOT = Path(__file__).resolve().parent.parent
HARDWARE = """
[generator]
address = "TCPIP::192.0.2.10::5025::SOCKET"
[digitizer]
link = "socket://192.0.2.10:5026"
"""
# Stands where procedures.characterize stands and takes a moment; its gain is about 0.1 at code 3.
TINY = """
import sys, tiny_procedure
sys.modules["procedures.characterize"] = tiny_procedure
"""
INI = """
[pytest]
addopts = -p no:cacheprovider -p no:benchmark -p no:hypothesispytest -p no:randomly
"""


@pytest.fixture
def project(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> pytest.Pytester:
    """A project in an environment where belahil is installed, with the entry points that it declares."""
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    metadata = pytester.path / "site/belahil-0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: belahil\nVersion: 0\n")
    points = [f"{name} = {module}" for name, module in declared["entry-points"]["pytest11"].items()]
    (metadata / "entry_points.txt").write_text("\n".join(["[pytest11]", *points, ""]))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(map(str, (metadata.parent, ROOT, ROOT / "tests"))))
    pytester.makeini(INI)
    return pytester


def test_who_uses_none_of_it_imports_none_of_it(project: pytest.Pytester) -> None:
    project.makepyfile("""
        import sys
        def test_modules():
            ours = ("belahil", "drivers", "sim", "procedures")
            found = {name for name in sys.modules if name.split(".")[0] in ours}
            assert found == {"belahil", "belahil.pytest_plugin"}
            assert not {"numpy", "msgspec", "pyvisa", "matplotlib"} & set(sys.modules)
    """)

    answer = project.runpytest_subprocess()

    answer.assert_outcomes(passed=1)
    assert "belahil" not in "\n".join(answer.outlines[answer.outlines.index("") :])


def test_a_project_that_wants_none_of_it_switches_it_off(project: pytest.Pytester) -> None:
    project.makepyfile("def test_a(): pass\ndef test_b(bench): pass")

    answer = project.runpytest_subprocess("-p", "no:belahil")

    answer.assert_outcomes(passed=1, errors=1)
    answer.stdout.fnmatch_lines(["*fixture 'bench' not found"])
    refused = project.runpytest_subprocess("-p", "no:belahil", "--bench", "emulated")
    assert refused.ret == pytest.ExitCode.USAGE_ERROR


def test_another_plugins_option_of_that_name_is_left_alone(project: pytest.Pytester) -> None:
    project.makepyfile(
        other="def pytest_addoption(parser): parser.addoption('--bench', action='store_true')",
        test_it="""
            def test_both(request, bench_config):
                assert request.config.getoption("--bench") is True
                assert bench_config.source == "simulated"
        """,
    )

    answer = project.runpytest_subprocess("-p", "other", "--bench", "--belahil-bench", "simulated")

    answer.assert_outcomes(passed=1)


def test_each_test_has_a_fresh_bench_whose_output_is_off_at_the_end(project: pytest.Pytester) -> None:
    # given two tests that keep their benches
    project.makepyfile("""
        from belahil.stimuli import Sine
        from belahil.values import WindowRequest

        kept, off = [], []

        def measured(bench):
            return bench.measure(Sine(1e6, 0.05), WindowRequest(0, 4, 64)).window.counts

        def test_first(bench):
            kept.append((bench, measured(bench)))
            assert bench.source == "emulated" and bench.config.emulation.seed == 5
            close = bench.close
            bench.close = lambda: off.append(close()) or off[-1]

        def test_second(bench, bench_config):
            (other, counts), = kept
            assert bench is not other and bench.config is bench_config
            assert (measured(bench) == counts).all()
            assert off == [True]
    """)
    # when they are run with a seed
    answer = project.runpytest_subprocess("--belahil-seed", "5", "-W", "error")
    # then each has its own, and equal windows
    answer.assert_outcomes(passed=2)


def test_a_verdict_is_the_tests_and_runs_are_kept_and_named(project: pytest.Pytester) -> None:
    # given tests with limits that hold, that do not, and none
    project.makeconftest(TINY)
    project.makepyfile("""
        import pytest
        from belahil.errors import LimitExceeded, RefusedInput

        def test_none(belahil_run):
            assert belahil_run("characterize", codes=[3]).verdict == "none"

        def test_pass(belahil_run):
            run = belahil_run("characterize", codes=[3], limits={"gain": [0, 9]})
            assert run.verdict == "pass" and run.results["best_code"] == 3

        def test_fail(belahil_run):
            belahil_run("characterize", codes=[3], limits={"gain": [-9, -8]})

        def test_undecided(belahil_run):
            run = belahil_run("characterize", codes=[3], limits={"gain": [0, 0.1]}, must_pass=False)
            assert run.verdict == "undecided" and not run.passed
            belahil_run("characterize", codes=[3], limits={"gain": [0, 0.1]})

        @pytest.fixture(scope="module")
        def measured(belahil_run):
            return belahil_run("characterize", codes=[3])

        def test_on_the_tests_bench(measured, bench, belahil_run):
            bench.check = lambda *_: (_ for _ in ()).throw(LimitExceeded("this very bench"))
            with pytest.raises(LimitExceeded, match="this very bench"):
                belahil_run("characterize")

        @pytest.mark.parametrize("words", [{"code": 3}, {"codes": "x"}, {"limits": {"gian": [0, 1]}}])
        def test_refused(belahil_run, words):
            with pytest.raises(RefusedInput):
                belahil_run("characterize", **words)

        def test_unknown(belahil_run):
            belahil_run("caracterize")
    """)
    # when they are run, in two processes, with a folder for what they leave
    answer = project.runpytest_subprocess(
        "-n", "2", "--bench", "simulated", "--belahil-out", "kept", "--junitxml", "j.xml"
    )
    # then two verdicts and a refusal fail
    answer.assert_outcomes(passed=6, failed=3)
    told = answer.stdout.str()
    folder = project.path / "kept"
    assert "belahil characterize: verdict fail: gain (code 3) = 0." in told
    assert f"allowed -9 to -8 (fail); run folder: {folder / 'test_a_verdict'}" in told
    assert "allowed 0 to 0.1 (undecided); run folder: " in told
    assert "RefusedInput: procedure 'caracterize' is unknown; allowed: characterize, noise" in told
    assert "procedure_run.py" not in told
    # and each run is there, named, and in the report of JUnit
    kept = {str(path.parent) for path in folder.rglob("summary.json")}
    listed = told.split("belahil runs")[1]
    assert len(kept) == 6
    assert {line.split()[-1] for line in listed.splitlines() if line.startswith("characterize:")} == kept
    properties = [
        (one.get("name"), one.get("value"))
        for one in ElementTree.parse(project.path / "j.xml").iter("property")
    ]
    assert {value for name, value in properties if name == "belahil_characterize_folder"} == kept
    verdicts = [value for name, value in properties if name == "belahil_characterize_verdict"]
    assert sorted(map(str, verdicts)) == ["fail", "none", "none", "pass", "undecided", "undecided"]
    # and nothing is left of what was refused
    assert not list(folder.glob("*refused*"))


def test_what_needs_instruments_is_skipped_without_them(project: pytest.Pytester) -> None:
    project.makepyfile("""
        import pytest

        @pytest.mark.hardware
        def test_real(): raise AssertionError("played into a real receiver")
    """)

    answer = project.runpytest_subprocess("-rs", "--strict-markers")

    answer.assert_outcomes(skipped=1)
    answer.stdout.fnmatch_lines(["*the bench is emulated*--bench FILE*"])


def test_what_needs_instruments_runs_with_them_and_in_one_process(project: pytest.Pytester) -> None:
    (project.path / "lab.toml").write_text(HARDWARE)
    project.makeini(f"{INI}belahil_bench = lab.toml\n")
    project.makepyfile("""
        import pytest

        @pytest.mark.hardware
        def test_real(bench_config): assert bench_config.source == "hardware"
    """)

    answer = project.runpytest_subprocess()

    answer.assert_outcomes(passed=1)
    answer.stdout.fnmatch_lines(["belahil: bench *lab.toml (hardware)"])
    refused = project.runpytest_subprocess("-n", "2")
    assert refused.ret == pytest.ExitCode.USAGE_ERROR
    refused.stderr.fnmatch_lines(["*lab.toml is real and serves one process; leave out -n"])


def test_a_marker_hardware_of_their_own_is_theirs(project: pytest.Pytester) -> None:
    project.makeini(f"{INI}markers =\n    hardware: needs the lamp\n")
    project.makepyfile("""
        import pytest

        @pytest.mark.hardware
        def test_lamp(): pass

        @pytest.mark.hardware
        def test_receiver(bench): pass
    """)

    project.runpytest_subprocess("--strict-markers").assert_outcomes(passed=1, skipped=1)


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--bench", "no.toml"], "*belahil: bench file no.toml: cannot be read*"),
        (["--belahil-seed", "-1"], "*--belahil-seed -1: must not be negative"),
    ],
)
def test_a_bench_that_cannot_be_is_refused_before_any_test(
    project: pytest.Pytester, words: list[str], line: str
) -> None:
    project.makepyfile("def test_a(): pass")

    answer = project.runpytest_subprocess(*words)

    assert answer.ret == pytest.ExitCode.USAGE_ERROR
    answer.stderr.fnmatch_lines([line])


def test_a_recording_that_is_not_gone_through_fails_in_a_line(project: pytest.Pytester) -> None:
    project.makepyfile("""
        from belahil.bench import open_bench

        def test_recorded():
            with open_bench("emulated", record="day.rec"):
                pass
    """)
    project.runpytest_subprocess().assert_outcomes(passed=1)
    project.makepyfile("""
        def test_same(bench): assert bench.source == "replay"

        def test_other(bench): bench._generator.output(True)
    """)

    answer = project.runpytest_subprocess("--bench", "replay:day.rec", "-k", "same or other")

    told = answer.stdout.str()
    answer.assert_outcomes(passed=1, failed=1, errors=1)
    assert "verified.py" not in told.split("ERROR at teardown")[1].split("FAILURES")[0]


@pytest.mark.slow
def test_the_example_project_passes(project: pytest.Pytester) -> None:
    shutil.copytree(ROOT / "docs/example-project", project.path / "example")
    os.chdir(project.path / "example")

    answer = project.runpytest_subprocess("--belahil-out", "runs", "-W", "error", "-p", "no:hypothesispytest")

    answer.assert_outcomes(passed=3, skipped=1)
    answer.stdout.fnmatch_lines(["belahil: bench *bench.toml (emulated, seed 7)", "characterize: pass *"])
    assert len(list(Path("runs").rglob("report.html"))) == 1
