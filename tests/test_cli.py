"""The command line: what it prints, where, and its exit status."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import tiny_procedure
from hypothesis import given
from hypothesis import strategies as st

from belahil.bench import Bench
from belahil.cli.main import main
from belahil.errors import InstrumentError
from belahil.run import Run

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(autouse=True)
def tiny(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Let ``characterize`` take a moment, in an empty folder."""
    monkeypatch.setitem(sys.modules, "procedures.characterize", tiny_procedure)
    monkeypatch.chdir(tmp_path)


@pytest.fixture(autouse=True)
def heard() -> Iterator[None]:
    """Let an interrupt be heard: a shell starts what runs in the background with SIGINT ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def closed(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Benches that were closed, which switches the output off."""
    found: list[str] = []
    close = Bench.close

    def noted(self: Bench) -> bool:
        found.append(self.source)
        return close(self)

    monkeypatch.setattr(Bench, "close", noted)
    return found


def characterize(*words: str, bench: str | None = "simulated") -> int:
    return main(["characterize", *(["--bench", bench] if bench else []), *words])


Captured = pytest.CaptureFixture[str]


def one_line(capsys: Captured) -> str:
    """The only line on standard error."""
    answer = capsys.readouterr()
    assert answer.err.count("\n") == 1
    assert answer.err.startswith("belahil: ")
    return answer.err


@pytest.mark.parametrize(
    ("word", "end"),
    [("charcterize", " Did you mean 'characterize'?"), ("reprot", " Did you mean 'report'?"), ("xyz", "")],
)
def test_a_command_that_is_none_brings_the_nearest(capsys: Captured, word: str, end: str) -> None:
    assert main([word]) == 2
    assert one_line(capsys) == f"belahil: No such command '{word}'.{end}\n"


# ---- a measurement


def test_a_measurement_ends_with_the_best_code_and_the_report(capsys: Captured, closed: list[str]) -> None:
    assert characterize("--out", "run", "--seed", "5") == 0
    answer = capsys.readouterr()
    assert re.search(r"^best gain code: 3 \(gain [\d.()]+, cut-off \S, input noise \S\)$", answer.out, re.M)
    assert answer.out.splitlines()[-2:] == ["verdict: none", f"report: {Path('run/report.html')}"]
    assert "4 of 4 windows, 0 s left" in answer.err
    assert answer.err.splitlines()[-3:] == ["analysing", "writing", "drawing"]
    assert re.search(r"4 windows, [\d.]+ ms each, of which [\d.]+ ms waiting for the disk", answer.err)
    assert closed == ["simulated"]
    summary = json.loads(Path("run/summary.json").read_text())
    assert (summary["seed"], summary["source"], summary["procedure"]) == (5, "simulated", "characterize")


def test_json_is_the_summary_and_nothing_else(capsys: Captured) -> None:
    assert characterize("--json") == 0
    answer = capsys.readouterr()
    (folder,) = Path().iterdir()
    assert answer.out == (folder / "summary.json").read_text(encoding="utf-8")
    assert json.loads(answer.out)["results"]["best_code"] == 3


def test_quiet_says_nothing(capsys: Captured) -> None:
    assert characterize("--out", "run", "--quiet") == 0
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("words", [(), ("--quiet",)])
def test_a_folder_that_nobody_named_is_dated_and_told(capsys: Captured, words: tuple[str, ...]) -> None:
    assert characterize(*words) == 0
    (folder,) = Path().iterdir()
    assert re.fullmatch(r"belahil-characterize-\d{8}T\d{6}Z", folder.name)
    assert capsys.readouterr().out.splitlines()[0] == f"run folder: {folder}"


def test_the_choices_reach_the_procedure() -> None:
    chosen = ("--codes", "0-2,7", "--amplitudes-mvpp", "3,200", "--frequencies-mhz", "0.1,29.7")
    assert characterize(*chosen, "--dark-windows", "2", "--out", "run") == 0
    with Run.resume("run") as run:
        assert run.begun.options == {
            "codes": [0, 1, 2, 7],
            "amplitudes_vpp": [0.003, 0.2],
            "frequencies_hz": [0.1e6, 29.7e6],
            "dark_windows": 2,
        }
        assert len(run.shots()) == 4 * 2 * 2


def test_simulated_and_emulated_benches_give_equal_results() -> None:
    found = []
    for bench in ("simulated", "emulated"):
        assert characterize("--out", bench, bench=bench) == 0
        found.append(json.loads(Path(bench, "summary.json").read_text()))
    assert found[0]["results"] == found[1]["results"]
    assert [one["source"] for one in found] == ["simulated", "emulated"]


@pytest.mark.parametrize(
    ("gain", "status", "verdict"),
    [
        ("[0, 9]", 0, "pass"),
        ("[0, 0.01]", 1, "fail"),
        ("[-9, -8]", 1, "fail"),
        ("[0.0, 0.1]", 1, "undecided"),
    ],
)
def test_limits_decide_the_status(
    capsys: Captured, monkeypatch: pytest.MonkeyPatch, gain: str, status: int, verdict: str
) -> None:
    bench = '[generator]\naddress = "simulated"\n[digitizer]\nlink = "simulated"\n[limits]\ngain = '
    Path("bench.toml").write_text(bench + gain)
    monkeypatch.setattr("tiny_procedure.np.std", lambda volts: 0.05)  # two windows a code: a gain of 0.1
    assert characterize("--out", "run", bench="bench.toml") == status
    out = capsys.readouterr().out
    assert f"verdict: {verdict}\n" in out
    assert (f"\n{verdict}: gain (code 3, code 4)\n" in out) == (status == 1)


@pytest.mark.parametrize(
    ("limits", "told"),
    [
        ("gain = [0, 9]", None),
        ("gain = [0, 9]\nenob = [1, 2]\ncutoff_hz = [1, 2]", "cutoff_hz, enob"),
        ("sinad_db = [1, 2]", "sinad_db"),
    ],
)
def test_limits_that_nothing_judges_are_told(capsys: Captured, limits: str, told: str | None) -> None:
    bench = '[generator]\naddress = "simulated"\n[digitizer]\nlink = "simulated"\n[limits]\n'
    Path("bench.toml").write_text(bench + limits)
    for words in (("--out", "run"), ("--resume", "run")):
        main(["characterize", *words]) if "--resume" in words else characterize(*words, bench="bench.toml")
        lines = [line for line in capsys.readouterr().out.splitlines() if "[limits]" in line]
        assert lines == ([] if told is None else [f"not judged by this procedure: [limits] {told}"])
    page = Path("run/report.html").read_text(encoding="utf-8")
    assert page.count("not judged by this procedure") == (0 if told is None else 2)


def test_the_report_says_what_its_emulation_leaves_out() -> None:
    assert characterize("--out", "run") == 0
    told = json.loads(Path("run/report.json").read_text())
    assert any(line.startswith("converter: differential and integral") for line in told["not_modelled"])
    assert "What this simulated bench does not model" in Path("run/report.html").read_text()


def test_the_report_tells_the_options_in_words() -> None:
    assert characterize("--amplitudes-mvpp", "3,200", "--out", "run") == 0
    told = json.loads(Path("run/report.json").read_text())
    assert told["conditions"]["options"].startswith("codes: default; amplitudes_vpp: 0.003, 0.2; frequenc")


# ---- what goes wrong


def break_after(monkeypatch: pytest.MonkeyPatch, count: int, happen: Any) -> None:
    """Let something happen when `count` shots are measured."""
    measure = Bench.measure
    left = [count]

    def counted(self: Bench, *words: Any) -> Any:
        if not left[0]:
            happen()
        left[0] -= 1
        return measure(self, *words)

    monkeypatch.setattr(Bench, "measure", counted)


def fail(error: BaseException) -> Any:
    def happen() -> None:
        raise error

    return happen


def test_an_instrument_that_fails_ends_the_run_and_keeps_the_data(
    capsys: Captured, monkeypatch: pytest.MonkeyPatch, closed: list[str]
) -> None:
    break_after(monkeypatch, 3, fail(InstrumentError("the generator is on fire")))
    assert characterize("--out", "run", "--quiet") == 3
    assert one_line(capsys) == (
        "belahil: the generator is on fire; 3 shots are kept; "
        "continue with: belahil characterize --resume run\n"
    )
    assert closed == ["simulated"]
    assert "stopped: the generator is on fire" in Path("run/log.txt").read_text()


def test_a_bug_is_one_line_and_a_traceback_in_the_log(
    capsys: Captured, monkeypatch: pytest.MonkeyPatch, closed: list[str]
) -> None:
    break_after(monkeypatch, 1, fail(KeyError("surprise")))
    assert characterize("--out", "run", "--quiet") == 70
    line = one_line(capsys)
    assert "internal error, please report it: KeyError: 'surprise'" in line
    assert "traceback in " in line
    log = Path("run/log.txt").read_text()
    assert "Traceback (most recent call last)" in log
    assert "KeyError: 'surprise'" in log
    assert closed == ["simulated"]


def test_a_bug_before_there_is_a_run_leaves_its_traceback_too(
    capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(Path().absolute()))
    monkeypatch.setattr(tiny_procedure, "plan", lambda *words: 1 / 0)
    assert characterize("--out", "run") == 70
    place = one_line(capsys).split("traceback in ")[1].strip()
    assert "ZeroDivisionError" in Path(place).read_text()
    assert not Path("run").exists()


# Windows has no terminal that hangs up.
SIGNALS = [signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGINT)]


@pytest.mark.parametrize("number", SIGNALS)
def test_an_interrupt_waits_for_the_shot_and_can_be_resumed(
    capsys: Captured, monkeypatch: pytest.MonkeyPatch, closed: list[str], number: signal.Signals
) -> None:
    # given a run that is interrupted in the middle of its third shot
    break_after(monkeypatch, 2, lambda: os.kill(os.getpid(), number))
    before = signal.getsignal(number)
    # when it stops
    assert characterize("--out", "run", "--quiet") == 130
    # then that shot is kept, the output is off, it says how to go on, and the handlers are those of before
    assert one_line(capsys) == (
        "belahil: interrupted; 3 shots are kept; continue with: belahil characterize --resume run\n"
    )
    assert closed == ["simulated"]
    assert signal.getsignal(number) == before


def test_a_second_interrupt_does_not_wait(
    capsys: Captured, monkeypatch: pytest.MonkeyPatch, closed: list[str]
) -> None:
    def twice() -> None:
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)

    break_after(monkeypatch, 2, twice)
    assert characterize("--out", "run", "--quiet") == 130
    assert "interrupted; 2 shots are kept" in one_line(capsys)
    assert closed == ["simulated"]


def test_an_interrupt_before_the_first_shot_leaves_no_run(
    capsys: Captured, monkeypatch: pytest.MonkeyPatch, closed: list[str]
) -> None:
    monkeypatch.setattr(tiny_procedure, "plan", lambda *words: os.kill(os.getpid(), signal.SIGTERM))
    assert characterize("--out", "run") == 130
    assert one_line(capsys) == "belahil: interrupted\n"
    assert closed == ["simulated"]
    assert not Path("run").exists()


def test_no_number_of_interrupts_keeps_the_output_on(
    capsys: Captured, monkeypatch: pytest.MonkeyPatch, closed: list[str]
) -> None:
    # given a user who hits Ctrl-C again and again while the bench is being closed after the last shot
    close = Bench.close

    def disturbed(self: Bench) -> bool:
        for _ in range(3):
            os.kill(os.getpid(), signal.SIGINT)
        return close(self)

    monkeypatch.setattr(Bench, "close", disturbed)
    # when the run is interrupted, then the bench was closed first, and the run can be finished
    assert characterize("--out", "run", "--quiet") == 130
    assert closed == ["simulated"]
    assert "shots are kept; continue with" in one_line(capsys)
    monkeypatch.setattr(Bench, "close", close)
    assert characterize("--resume", "run", "--quiet", bench=None) == 0


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no terminal that hangs up")
def test_a_run_under_nohup_outlives_its_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        break_after(monkeypatch, 2, lambda: os.kill(os.getpid(), signal.SIGHUP))
        assert characterize("--out", "run", "--quiet") == 0
    finally:
        signal.signal(signal.SIGHUP, before)


# ---- resume


def stopped(monkeypatch: pytest.MonkeyPatch, after: int, *words: str) -> None:
    with monkeypatch.context() as context:
        break_after(context, after, fail(InstrumentError("stop")))
        assert characterize("--out", "run", "--quiet", *words) == 3


def test_a_resumed_run_equals_an_uninterrupted_one(monkeypatch: pytest.MonkeyPatch) -> None:
    words = ("--codes", "2,5", "--frequencies-mhz", "1,2,3", "--seed", "9")
    assert characterize("--out", "whole", *words) == 0
    stopped(monkeypatch, 4, *words)
    assert characterize("--resume", "run", bench=None) == 0
    one, other = (json.loads(Path(name, "summary.json").read_text()) for name in ("whole", "run"))
    assert one["results"] == other["results"]
    with Run.resume("whole") as whole, Run.resume("run") as run:
        assert len(whole.shots()) == len(run.shots()) == 6
        for first, second in zip(whole.shots(), run.shots(), strict=True):
            assert first.window.equals(second.window)
            assert first.played == second.played


def test_a_finished_run_is_told_again_without_a_bench(
    capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert characterize("--out", "run", "--json") == 0
    first = capsys.readouterr().out
    monkeypatch.setattr("belahil.bench.open_bench", fail(AssertionError("a bench was opened")))
    assert characterize("--resume", "run", "--json", bench=None) == 0
    assert capsys.readouterr().out == first


def test_resume_takes_everything_from_the_folder(capsys: Captured, monkeypatch: pytest.MonkeyPatch) -> None:
    stopped(monkeypatch, 1)
    capsys.readouterr()
    assert characterize("--resume", "run", "--codes", "1", "--seed", "3") == 2
    assert "takes everything from that folder; leave out --codes, --bench, --seed" in one_line(capsys)


def test_a_run_of_another_procedure_is_not_continued(
    capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    stopped(monkeypatch, 1)
    capsys.readouterr()
    assert main(["noise", "--resume", "run"]) == 2
    assert "use belahil characterize --resume run" in one_line(capsys)


# ---- wrong use


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["chracterize"], "No such command 'chracterize'"),
        (["characterize", "--cods", "4"], "No such option '--cods'"),
        (["characterize", "--codes", "4-"], "write gain codes as 0-15 or 4,5"),
        (["characterize", "--codes", "5-3"], "5-3 is no span of gain codes"),
        (["characterize", "--codes", "0-999999999"], "is no span of gain codes"),
        (["characterize", "--codes", ""], "write gain codes as 0-15 or 4,5"),
        (["characterize", "--amplitudes-mvpp", "3;13"], "write numbers with commas between"),
        (["characterize", "--amplitudes-mvpp", "3,-1"], "-1 must be above zero"),
        (["characterize", "--frequencies-mhz", "nan"], "nan must be above zero"),
        (["characterize", "--frequencies-mhz", "inf"], "inf must be above zero"),
        (["characterize", "--dark-windows", "0"], "0 is not in the range x>=1"),
        (["characterize", "--seed", "-1"], "--seed -1: must not be negative"),
        (["characterize", "--seed", "x"], "'x' is not a valid integer"),
        (["characterize", "--bench", "replay:f"], "f: cannot be read (No such file or directory)"),
        (["characterize", "--bench", "nowhere.toml"], "nowhere.toml: cannot be read (No such file"),
        (["characterize", "extra"], "unexpected extra argument"),
        (["report"], "Missing argument 'RUN'"),
        (["report", "nowhere"], "nowhere: holds no finished run"),
        (["characterize", "--resume", "nowhere"], "--resume nowhere: there is no run in this folder"),
    ],
)
def test_wrong_use_is_one_line_and_status_2(capsys: Captured, words: list[str], said: str) -> None:
    assert main(words) == 2
    assert said in one_line(capsys)
    assert list(Path().iterdir()) == []


def test_a_used_folder_is_refused_before_a_bench_is_opened(
    capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    Path("run").mkdir()
    Path("run/mine.txt").touch()
    monkeypatch.setattr("belahil.bench.open_bench", fail(AssertionError("a bench was opened")))
    assert characterize("--out", "run") == 2
    assert "--out run: the folder is not empty" in one_line(capsys)


def test_a_folder_that_cannot_be_made_is_status_4(capsys: Captured) -> None:
    Path("file").touch()
    assert characterize("--out", "file/run") == 4
    assert "file/run: cannot be" in one_line(capsys)


# ---- the program itself


def program(*words: str, code: str | None = None) -> subprocess.CompletedProcess[str]:
    start = ["-c", code] if code else ["-m", "belahil", *words]
    return subprocess.run(
        [sys.executable, *start], cwd=ROOT, capture_output=True, text=True, timeout=60, check=False
    )


def test_help_needs_no_numerical_library() -> None:
    answer = program(
        code="import sys; from belahil.cli.main import main; main(['--help']);"
        "print([name for name in ('numpy', 'scipy', 'pyvisa', 'rich', 'h5py') if name in sys.modules])"
    )
    assert "characterize" in answer.stdout
    assert answer.stdout.splitlines()[-1] == "[]"


def test_the_program_tells_its_version() -> None:
    for words in (("--version",), ("characterize", "--version"), ("bench", "--version")):
        answer = program(*words)
        assert (answer.returncode, answer.stderr) == (0, "")
        assert re.fullmatch(r"belahil \d+\.\d+\.\d+\n", answer.stdout)


def test_every_command_has_its_help(capsys: Captured) -> None:
    for words in (["characterize"], ["noise"], ["bench"], ["bench", "new"], ["emulate"], ["report"]):
        assert main([*words, "--help"]) == 0
        assert "Usage: belahil" in capsys.readouterr().out


def test_without_a_command_the_help_comes_with_status_2(capsys: Captured) -> None:
    assert main([]) == 2
    assert "Usage: belahil" in capsys.readouterr().err


def test_a_reader_who_leaves_early_is_no_error() -> None:
    answer = subprocess.run(
        f"{sys.executable} -m belahil bench show | true; echo ${{PIPESTATUS[0]}}",
        shell=True,
        executable="/bin/bash",
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert (answer.stdout, answer.stderr) == ("0\n", "")


# ---- bench files and reports


@pytest.mark.parametrize("words", [[], ["--address", "simulated"], ["--receiver", "gala-like"]])
def test_a_new_bench_file_says_every_default(capsys: Captured, words: list[str]) -> None:
    from belahil.config import parse_bench
    from belahil.receiver_truth import receiver_truth

    assert main(["bench", "new", "lab.toml", *words]) == 0
    written = parse_bench(Path("lab.toml").read_text())
    kind = words[1] if "--address" in words else "emulated"
    short = f'[generator]\naddress = "{kind}"\n[digitizer]\nlink = "{written.digitizer.link}"\n'
    meant = parse_bench(short + f'receiver = "{written.digitizer.receiver}"')
    assert receiver_truth(written) == receiver_truth(meant)
    assert (written.bench, written.generator, written.digitizer) == (
        meant.bench,
        meant.generator,
        meant.digitizer,
    )
    assert written.emulation.generator == meant.emulation.generator
    assert written.emulation.transmitter == meant.emulation.transmitter
    # and no key is left out
    missing = [
        key
        for table in (meant.bench, meant.generator, meant.digitizer, meant.emulation.receiver)
        for key in table.__struct_fields__
        if not re.search(rf"^(# )?{key} = ", Path("lab.toml").read_text(), re.M)
    ]
    assert missing == []
    assert "lab.toml" in capsys.readouterr().out


def test_a_new_bench_file_for_a_laboratory_has_no_emulation() -> None:
    words = ["--address", "USB0::2391::11271::MY1::INSTR", "--link", r"serial:\\.\COM12"]
    assert main(["bench", "new", *words]) == 0
    text = Path("bench.toml").read_text()
    assert "[emulation" not in text
    assert r'link = "serial:\\\\.\\COM12"' in text


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--address", "GPIB::7"], "needs --link too"),
        (["--address", "GPIB::7", "--link", "emulated:usb"], "both must be emulated"),
        (["--driver", "x"], 'driver = "x" is unknown'),
        (["--receiver", "x"], 'receiver = "x" is unknown'),
    ],
)
def test_a_bench_that_cannot_be_is_not_written(capsys: Captured, words: list[str], said: str) -> None:
    assert main(["bench", "new", *words]) == 2
    assert said in one_line(capsys)
    assert list(Path().iterdir()) == []


def test_a_bench_file_is_not_written_over(capsys: Captured) -> None:
    Path("bench.toml").write_text("mine")
    assert main(["bench", "new"]) == 2
    assert "is there already" in one_line(capsys)
    assert Path("bench.toml").read_text() == "mine"


def test_show_lists_what_there_is(capsys: Captured) -> None:
    assert main(["bench", "show"]) == 0
    out = capsys.readouterr().out
    for part in (
        "keysight-33500",
        "33622A: sine up to 120 MHz",
        "10 mVpp to 10 Vpp into 50 ohm, waveforms by their frequency, up to 6 MHz, no trigger delay",
        "5 Vpp above 10 MHz, 2.5 Vpp above 30 MHz, set to high impedance by a reset",
        "bela-grm",
        "gala-like",
        "emulated:usb",
        "socket://",
    ):
        assert part in out
    limits = "[limits]\ngain = [5, 6]\ncutoff_hz = [18.5e6, 2e7]"
    Path("lab.toml").write_text(f"[generator]\nattenuation_db = 20\n{limits}")
    assert main(["bench", "show", "lab.toml"]) == 0
    out = capsys.readouterr().out
    assert "20 dB to the cut" in out
    assert "limits: gain 5 to 6, cutoff_hz 18.5 to 20 MHz" in out
    assert main(["bench", "show", "--bench", "lab.toml"]) == 0
    assert capsys.readouterr().out == out


def test_show_takes_no_preset_for_a_fact_about_an_instrument(capsys: Captured) -> None:
    assert main(["bench", "show", "emulated"]) == 0
    assert "receiver: bela-grm: 2 converters of 12 bit" in capsys.readouterr().out
    Path("lab.toml").write_text('[generator]\naddress = "GPIB::7"\n[digitizer]\nlink = "serial:COM3"')
    assert main(["bench", "show", "lab.toml"]) == 0
    out = capsys.readouterr().out
    assert (
        "receiver: tells its converters when it is asked (bench check); to compare with, the preset b" in out
    )


@pytest.mark.parametrize("verb", ["show", "check"])
def test_two_names_for_one_bench_are_refused(capsys: Captured, verb: str) -> None:
    assert main(["bench", verb, "simulated", "--bench", "emulated"]) == 2
    assert "simulated and --bench emulated: name one bench" in one_line(capsys)


@pytest.mark.parametrize(
    "words", [["lab.toml"], ["--bench", "lab.toml"], ["lab.toml", "--bench", "lab.toml"]]
)
def test_a_bench_to_be_checked_is_named_either_way(capsys: Captured, words: list[str]) -> None:
    Path("lab.toml").write_text('[generator]\ndriver = "keysight-33600"')
    assert main(["bench", "check", *words]) == 0
    assert "generator: Keysight Technologies,33622A" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("row", "line"),
    [
        ((4, 5), "best gain code: 4 (gain 5, cut-off \u2013, input noise \u2013)"),
        ((None, 5), "receiver without gain codes: gain 5, cut-off \u2013, input noise \u2013"),
        ((None, None), "the receiver could not be characterized: too_few_points"),
        ((4, None), "no gain code could be characterized: too_few_points at code 4"),
    ],
)
def test_the_line_of_a_result_suits_its_receiver(row: tuple[int | None, int | None], line: str) -> None:
    from belahil.cli.characterize import _lines

    code, gain = row
    status = "ok" if gain else "too_few_points"
    found = {"code": code, "gain": gain, "cutoff": None, "input_noise_rms": None, "status": status}
    results = {"gain_codes": [found], "best_code": code if gain else None, "best_code_runner_up": None}
    assert _lines(results) == [line]


@given(value=st.floats(-30, 30), spread=st.floats(0.1, 10), code=st.none() | st.integers(0, 15))
def test_what_a_perfect_receiver_has_not_is_told_where_it_is_seen(
    value: float, spread: float, code: int | None
) -> None:
    from belahil.cli.characterize import _lines
    from belahil.report.tables import one_text

    def measured(unit: str, power: int = 0) -> dict[str, Any]:
        return {"value": value * 10**power, "standard_uncertainty": spread * 10**power, "unit": unit}

    row = {"code": code, "gain": 5, "cutoff": None, "input_noise_rms": None, "highpass": measured("Hz", 3)}
    # another code tells a seen coupling worse
    vague = {"value": 9e4, "standard_uncertainty": 1e4 + 1e3 * spread, "unit": "Hz"}
    worse = row | {"code": 16, "highpass": vague if abs(value) > 3 * spread else None}
    results = {
        "gain_codes": [row] if code is None else [row, worse],
        "best_code": code,
        "best_code_runner_up": None,
        "clock_ppm": measured("1e-6"),
        "interleave": {"gain": None, "offset_v": measured("V", -3), "skew_s": measured("s", -12)},
        "small_signal": {"cubic_per_v2": measured("V-2"), "deadband_v": None, "status": "ok"},
    }
    told = [line for line in _lines(results) if not re.match("(best )?gain code|receiver", line)]

    place = "" if code is None else f" at code {code}"
    assert told == (
        [
            f"not linear: cubic term {one_text(measured('V-2'))}",
            f"clock error: {one_text(measured('1e-6'))}",
            f"AC coupling: corner {one_text(measured('Hz', 3))}{place}",
            "converters differ, even minus odd: "
            f"offset {one_text(measured('V', -3))}, skew {one_text(measured('s', -12))}",
        ]
        if abs(value) > 3 * spread
        else []
    )


@pytest.mark.parametrize(("spread", "end"), [(0.5e-6, "; code 5 is within the uncertainty"), (0.4e-6, "")])
def test_a_second_code_that_may_be_the_best_is_told(spread: float, end: str) -> None:
    from belahil.cli.characterize import _lines

    row = {"code": 4, "gain": 5, "cutoff": None, "input_noise_rms": None, "status": "ok"}
    second = {"code": 5, "difference": {"value": 1e-6, "standard_uncertainty": spread, "unit": "V"}}
    (line,) = _lines({"gain_codes": [row], "best_code": 4, "best_code_runner_up": second})
    assert line.partition(")")[2] == end


def test_the_line_without_a_best_code_says_which_codes_are_in_its_way() -> None:
    from belahil.cli.characterize import _lines

    statuses = ("noise_no_signal", "noise_no_signal", "ok", "too_few_points")
    unknown = {"cutoff": None, "input_noise_rms": None}
    rows = [{"code": code, "gain": 5, "status": status, **unknown} for code, status in enumerate(statuses)]
    assert _lines({"gain_codes": rows, "best_code": None}) == [
        *(f"gain code {code}: gain 5, cut-off \u2013, input noise \u2013" for code in range(4)),
        "no best gain code: noise_no_signal at code 0, 1; too_few_points at code 3",
    ]


def test_the_lines_of_noise_suit_their_receiver() -> None:
    from belahil.cli.noise import _lines

    rows = [{"code": None, "noise_rms": 1, "firing": None}]
    assert _lines({"gain_codes": rows, "best_code": None}) == ["receiver without gain codes: noise 1"]
    burst = {"status": "ok", "peak": 4}
    none = {"status": "no_burst"}
    fired: list[tuple[int, int, dict[str, Any], int | None]]
    fired = [(3, 3, burst, 1), (5, 2, none, 1), (7, 2, none, None)]
    rows = [
        {
            "code": code,
            "noise_rms": 2,
            "firing": {"noise_rms": rms, "burst": one},
            "combined_input_noise_rms": at_input,
        }
        for code, rms, one, at_input in fired
    ]
    clipped = {"noise_rms": None, "status": "clipped", "burst": None}
    hidden = [{"code": 3, "noise_rms": None, "status": "ok", "firing": clipped}]
    assert _lines({"gain_codes": hidden, "best_code": None})[-1] == "no best gain code: clipped at code 3"
    strange = [row | {"status": "ok", "firing": None, "combined_input_noise_rms": None} for row in hidden]
    told = "no best gain code: no gain is known at code 3"
    assert _lines({"gain_codes": strange, "best_code": None})[-1] == told
    near = {"code": 5, "difference": {"value": 1.0, "standard_uncertainty": 1.0}}
    assert _lines({"gain_codes": rows, "best_code": 3, "best_code_runner_up": near}) == [
        "gain code 3: noise 2, firing 3 with a burst of 4",
        "gain code 5: noise 2, firing 2",
        "gain code 7: noise 2, firing 2",
        "best gain code: 3; code 5 is within the uncertainty",
        "not compared, for want of a gain or of noise: code 7",
    ]


@pytest.mark.parametrize(
    ("chi_square", "walk", "clock"),
    [(11.2, "agree with", "is linear"), (817.3, "differ from", "is not linear")],
)
def test_the_lines_of_a_time_of_flight_judge_a_chi_square(chi_square: float, walk: str, clock: str) -> None:
    from belahil.cli.tof_linearity import _lines

    results: dict[str, Any] = {"status": "ok", "clock_ppm": 1, "wobble": [], "range_walk": []}
    results |= {"agreement": {"chi_square": chi_square, "degrees_of_freedom": 11}}
    results |= {"linearity": {"chi_square": chi_square, "bins": 8}, "points": {"ok": 3, "saturated": 1}}
    assert _lines(results) == [
        "clock error 1",
        f"delays {walk} those of the known receiver: chi-square {chi_square} for 11",
        f"the clock {clock}: chi-square {chi_square} for 8 distances",
        "windows: 3 ok, 1 saturated",
    ]


@pytest.mark.parametrize("link", ["simulated", "emulated:serial", "emulated:usb"])
def test_a_bench_in_order_is_checked(capsys: Captured, closed: list[str], link: str) -> None:
    kind = link.split(":")[0]
    assert main(["bench", "check", "--address", kind, "--link", link]) == 0
    out = capsys.readouterr().out
    assert "generator: Agilent Technologies,33522B" in out
    (sine,) = [line for line in out.splitlines() if line.startswith("gain ")]
    assert "preset bela-grm: 5.190(52) (assumed to 1 %)" in sine
    assert float(sine[5:].partition("(")[0]) == pytest.approx(5.19, rel=1e-3)
    assert "trigger by the generator: a pulse of 15 mV and 100 ns is in 3 of 3 windows" in out
    assert "the pulses come" not in out
    assert closed == [kind]


@pytest.mark.parametrize(
    ("receiver", "said"),
    [
        ("gain_by_code = " + str([1e-6] * 16), "does not come back"),
        ("adc_full_scale_v = 0.05", "are clipped"),
    ],
)
def test_a_bench_that_is_not_in_order_is_status_3(
    capsys: Captured, closed: list[str], receiver: str, said: str
) -> None:
    Path("lab.toml").write_text(f"[emulation.receiver]\n{receiver}\n")
    assert main(["bench", "check", "--bench", "lab.toml"]) == 3
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1
    assert closed == ["emulated"]


def test_a_report_is_made_again(capsys: Captured) -> None:
    assert characterize("--out", "run", "--quiet") == 0
    page = Path("run/report.html").read_text()
    Path("run/report.html").unlink()
    assert main(["report", "run"]) == 0
    assert capsys.readouterr().out == f"report: {Path('run/report.html')}\n"
    assert Path("run/report.html").read_text() == page
