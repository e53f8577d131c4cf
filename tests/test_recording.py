"""Record and replay: the real drivers on a file go the way that they went on the instruments."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import pytest
import tiny_procedure
from faulty_bench import SCRIPT, FaultyBench, config
from test_faults import CASES

from belahil.bench import Bench, open_bench
from belahil.cli.main import main
from belahil.config import as_toml, load_bench, parse_bench
from belahil.errors import (
    BelahilError,
    ConfigError,
    InstrumentError,
    RecordingEnds,
    RefusedInput,
    ReplayDiffers,
    StorageError,
)
from belahil.frames import HEAD, framed
from belahil.recording import read_session
from belahil.recording_file import RecordingReader
from belahil.replay import Replay
from belahil.stimuli import SampledPulse, Sine
from belahil.values import Shot, WindowRequest
from sim.build import VISA_ADDRESS
from sim.faults import Fault, FaultPlan

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sim.faults import Direction, Kind, LinkName

SINE, REQUEST = Sine(2e6, 0.05), WindowRequest(3, 4, 64)


def outcomes(bench: Bench) -> list[Shot | str]:
    """Measure the script, with what failed as its message."""
    found: list[Shot | str] = []
    for stimulus, request in SCRIPT:
        try:
            found.append(bench.measure(stimulus, request))
        except InstrumentError as error:
            found.append(f"{type(error).__name__}: {error}")
    return found


def named_as_live(message: str, path: Path) -> str:
    return message.replace(f"replay:{path}", VISA_ADDRESS).removeprefix("in the recorded session ")


def whole(open_it: Callable[[], Bench]) -> list[Shot | str]:
    """Return all outcomes of a session, or that of its opening or closing."""
    try:
        with open_it() as bench:
            return outcomes(bench)
    except InstrumentError as error:
        return [str(error)]


def replayed(path: Path, count: int | None = None, more: Sequence[Any] = ()) -> list[Shot]:
    """Replay the script, or its first shots, and something else behind it."""
    with open_bench(f"replay:{path}") as bench:
        return [bench.measure(*one) for one in [*SCRIPT[:count], *more]]


def kept(path: Path, found: list[Shot | str]) -> None:
    """Replay the script as far as it goes."""
    with open_bench(f"replay:{path}") as bench:
        for stimulus, request in SCRIPT:
            found.append(bench.measure(stimulus, request))


def same(first: list[Shot | str], second: list[Shot | str]) -> bool:
    def equal(one: Shot | str, two: Shot | str) -> bool:
        if isinstance(one, str) or isinstance(two, str):
            return one == two
        return one.window.equals(two.window) and one.played == two.played and one.attempt == two.attempt

    return all(equal(*pair) for pair in zip(first, second, strict=True))


def recorded(path: Path, link: str = "serial") -> list[Shot | str]:
    with open_bench(config(link), record=path) as bench:
        return outcomes(bench)


def rewritten(path: Path, change: Any) -> Path:
    """Write a recording anew, with each record and its bytes as `change` returns them."""
    with RecordingReader(path) as reader:
        found = [change(number, *one) for number, one in enumerate(reader, start=1)]
    other = path.with_name("rewritten.rec")
    frames = [framed(msgspec.json.encode(record) + b"\n" + data) for record, data in found]
    other.write_bytes(b"belahil recording 1\n" + b"".join(frames))
    return other


@pytest.mark.parametrize("link", ["serial", "usb"])
def test_a_recording_replays_with_drivers_alone(
    tmp_path: Path, link: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a recorded session, and no way to any instrument or emulation any more
    shots = recorded(tmp_path / "a.rec", link)
    for room in ("sim.build", "pyvisa", "serial", "usb", "drivers.visa_link"):
        monkeypatch.setitem(sys.modules, room, None)
    # when it is replayed
    with open_bench(f"replay:{tmp_path / 'a.rec'}") as bench:
        again = outcomes(bench)
        # then all is as it was, but for the source
        assert bench.source == "replay"
        assert bench.identities["generator"].startswith("Agilent")
    assert same(shots, again)


@pytest.mark.parametrize(("link", "kind"), CASES)
def test_time_outs_damage_and_repeats_replay_as_they_were(tmp_path: Path, link: LinkName, kind: Kind) -> None:
    # given a bench whose links fail at some place, recorded from the opening to the end, whatever that was
    line = "serial" if link == "visa" else link
    direction: Direction = "from_device" if kind in ("old_shot", "late") else "to_device"
    for at in (0, 4, 9):
        path = tmp_path / f"{at}.rec"
        plan = FaultPlan([Fault(link, direction, kind, at, at)])
        live = whole(lambda: FaultyBench(config(line), plan).open(path))  # noqa: B023  (called at once)
        # when it is replayed
        again = whole(lambda: open_bench(f"replay:{path}"))  # noqa: B023
        # then every window, error and attempt is the same, but for the place that an error names
        assert same(
            live,
            [one if isinstance(one, Shot) else named_as_live(one, path) for one in again],
        )


def test_a_bench_with_an_oscilloscope_replays_too(tmp_path: Path) -> None:
    # given a recorded bench whose windows an oscilloscope takes, which is asked until it is ready
    bench = parse_bench(
        '[digitizer]\ndriver = "keysight-infiniivision"\nlink = "emulated:visa"\nreceiver = "analog"\n'
    )
    request = WindowRequest(3, None, 1000)
    script = [(SINE, request), (SampledPulse(np.hanning(64) * 0.02, 80e6), replace(request, shot=4))]
    with open_bench(bench, record=tmp_path / "a.rec") as opened:
        shots = [opened.measure(*one) for one in script]
    # when it is replayed, then its windows are the same
    with open_bench(f"replay:{tmp_path / 'a.rec'}") as opened:
        assert opened.spec.gain_codes is None
        for shot, one in zip(shots, script, strict=True):
            assert opened.measure(*one).window.equals(shot.window)


def test_the_clock_tells_in_a_replay_what_it_told(tmp_path: Path) -> None:
    told: dict[str, list[float]] = {}
    for name, words in {"live": {"record": tmp_path / "a.rec"}, "again": {}}.items():
        with open_bench(config("serial") if words else f"replay:{tmp_path / 'a.rec'}", **words) as bench:
            told[name] = []
            for stimulus, request in SCRIPT:
                bench.measure(stimulus, request)
                told[name].append(bench._clock.now_s())

    assert told["live"] == told["again"]
    assert told["live"] == sorted(set(told["live"]))


def test_the_truth_is_not_in_a_recording_and_the_bench_file_is(tmp_path: Path) -> None:
    text = as_toml(config("serial")).replace("cubic_per_v2 = 0.0", "cubic_per_v2 = 12345.5")
    bench = parse_bench(text.replace("max_vpp = 0.5", "max_vpp = 0.25"))

    with open_bench(bench, record=tmp_path / "a.rec"):
        pass

    assert b"12345.5" not in (tmp_path / "a.rec").read_bytes()
    session = read_session(tmp_path / "a.rec")
    assert (session.source, session.seed, session.config.generator.max_vpp) == ("emulated", 7, 0.25)
    assert session.config.emulation.seed == 7


def test_the_first_changed_byte_is_shown_beside_the_recorded_one(tmp_path: Path) -> None:
    # given a recording
    recorded(tmp_path / "a.rec")
    # when something else is asked at one place
    stimulus, request = SCRIPT[1]
    with pytest.raises(ReplayDiffers) as caught:
        replayed(tmp_path / "a.rec", 1, [(stimulus, replace(request, gain_code=6))])
    # then the error says where, and its excerpt shows both sides one above the other
    assert "a write to the digitizer differs from the recorded one at byte" in str(caught.value)
    lines = caught.value.excerpt
    assert [line.split()[0] for line in lines[:5]] == ["record", "record", "record", "record", "now"]
    at = next(at for at, line in enumerate(lines) if "^" in line)
    mark, one, two = lines[at], *(line[: len(lines[at])] for line in lines[at - 2 : at])
    assert (" recorded  " in one, " now       " in two) == (True, True)
    # with marks below all that differs, in the digits and in the text (two digits may share one)
    differing = [place for place in range(23, len(mark)) if one[place] != two[place]]
    assert differing
    assert all(mark[place] == "^" for place in differing)
    assert {mark[place] for place in range(23) if place < len(mark)} == {" "}
    # no note tells to switch an output off that is not there
    assert not hasattr(caught.value, "__notes__")
    assert lines[-1].startswith("record ")


def test_a_recording_of_drivers_that_spoke_otherwise_is_refused_in_one_line(tmp_path: Path) -> None:
    # given a recording of a belahil that opened the generator first, and told no number of its conversation
    recorded(tmp_path / "a.rec")

    def older(number: int, record: Any, data: bytes) -> tuple[Any, bytes]:
        if record.kind == "header":
            header = json.loads(data)
            assert header.pop("conversation") == 2
            data = json.dumps(header).encode()
        return record, data

    path = rewritten(tmp_path / "a.rec", older)
    with pytest.raises(ConfigError, match=r"spoke otherwise \(conversation 1\).*\(2\).* parity` reads it"):
        replayed(path)
    # but what it holds can still be read
    assert read_session(path).instruments["generator"].startswith("Agilent")


def test_a_changed_answer_is_what_the_drivers_see(tmp_path: Path) -> None:
    # given a recording in which one byte of a window's packet was changed, with a right checksum of the file
    recorded(tmp_path / "a.rec")

    def changed(number: int, record: Any, data: bytes) -> tuple[Any, bytes]:
        if record.kind == "read" and record.link == "digitizer" and len(data) > 100:
            return record, data[:50] + bytes([data[50] ^ 1 or 2]) + data[51:]
        return record, data

    path = rewritten(tmp_path / "a.rec", changed)
    # when it is replayed, then the driver takes it for no window, and asks what was not recorded
    with pytest.raises(ReplayDiffers):
        replayed(path)


def test_a_session_that_goes_on_longer_or_ends_earlier_than_recorded_is_a_difference(tmp_path: Path) -> None:
    # given a session that was closed after its last window, with nothing more asked
    bench = open_bench(config("serial"), record=tmp_path / "a.rec")
    outcomes(bench)
    bench.close()
    # when its replay is closed before that
    earlier = open_bench(f"replay:{tmp_path / 'a.rec'}")
    earlier.measure(*SCRIPT[0])
    earlier.close()
    with pytest.raises(ReplayDiffers, match=r"recorded is a write to the .*, and now comes the closing of"):
        earlier.links.check()
    # or goes on behind it
    with pytest.raises(RecordingEnds, match=r"the recorded session ends here, and now comes a write to"):
        replayed(tmp_path / "a.rec", None, [(SINE, REQUEST)])


@pytest.mark.parametrize("window", [1, 3, len(SCRIPT)])
def test_a_killed_recording_replays_up_to_its_end_and_says_so(tmp_path: Path, window: int) -> None:
    # given a recording that ends in the middle of a window's last record
    shots: list[Shot | str] = []
    with open_bench(config("serial"), record=tmp_path / "a.rec") as bench:
        for stimulus, request in SCRIPT[:window]:
            shots.append(bench.measure(stimulus, request))
        content = (tmp_path / "a.rec").read_bytes()
    (tmp_path / "cut.rec").write_bytes(content[:-30])
    # when it is replayed
    found: list[Shot | str] = []
    with pytest.raises(RecordingEnds, match=r"in the middle of a record: it was cut short; now comes a read"):
        kept(tmp_path / "cut.rec", found)
    # then what it holds is as it was
    assert len(found) == window - 1
    assert same(found, shots[: len(found)])


def test_a_recording_without_its_last_record_says_so(tmp_path: Path) -> None:
    recorded(tmp_path / "a.rec")
    content = (tmp_path / "a.rec").read_bytes()
    (tmp_path / "cut.rec").write_bytes(content[: content.rindex(b'{"kind":"end"') - HEAD.size])

    with pytest.raises(RecordingEnds, match=r"without its last record: it was cut short"):
        replayed(tmp_path / "cut.rec")


def test_damage_is_told_when_the_replay_comes_to_it(tmp_path: Path) -> None:
    recorded(tmp_path / "a.rec")
    damaged = bytearray((tmp_path / "a.rec").read_bytes())
    damaged[-3000] ^= 1
    (tmp_path / "b.rec").write_bytes(damaged)

    with pytest.raises(InstrumentError, match=r"damaged at byte \d+, after \d+ good records"):
        replayed(tmp_path / "b.rec")

    other = (tmp_path / "a.rec").read_bytes() + framed(b'{"kind":"closing"}\n')
    (tmp_path / "d.rec").write_bytes(other)
    with pytest.raises(InstrumentError, match="goes on behind the end of its session"):
        replayed(tmp_path / "d.rec")

    damaged[40] ^= 1
    (tmp_path / "c.rec").write_bytes(damaged)
    with pytest.raises(StorageError, match=r"damaged at byte 20, after 0 good records"):
        load_bench(f"replay:{tmp_path / 'c.rec'}")


def test_a_disk_that_fills_lets_the_output_be_switched_off_and_is_told(tmp_path: Path) -> None:
    # given a bench whose recording fails while it measures
    bench = open_bench(config("serial"), record=tmp_path / "a.rec")
    bench.measure(SINE, REQUEST)
    bench.links._file.failed = StorageError("no space")  # type: ignore[attr-defined]
    # when it goes on, then measuring and closing go well, with the output confirmed to be off
    bench.measure(SINE, replace(REQUEST, shot=4))
    assert bench.close()
    # and why the recording is not whole is told last
    with pytest.raises(StorageError, match="no space"):
        bench.links.check()


@pytest.mark.parametrize("bench", ["simulated", "replay"])
def test_what_has_no_links_cannot_be_recorded(tmp_path: Path, bench: str) -> None:
    recorded(tmp_path / "a.rec")
    name = f"replay:{tmp_path / 'a.rec'}" if bench == "replay" else bench

    with pytest.raises(RefusedInput, match=f"the bench is {bench} and has no links to record"):
        open_bench(name, record=tmp_path / "b.rec")

    assert not (tmp_path / "b.rec").exists()


def test_a_recording_keeps_its_seed(tmp_path: Path) -> None:
    recorded(tmp_path / "a.rec")

    with pytest.raises(RefusedInput, match="--seed 8: a recording keeps its own seed"):
        open_bench(f"replay:{tmp_path / 'a.rec'}", seed=8)
    open_bench(f"replay:{tmp_path / 'a.rec'}", seed=7).close()


# ---- the command line

FEW = {
    "characterize": ["--codes", "3,4", "--amplitudes-mvpp", "30,50", "--frequencies-mhz", "1,5,10,15,20,30"],
    "noise": ["--codes", "4", "--dark-windows", "4"],
    "tx-delay": ["--shots", "30"],
}


def summary(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "summary.json").read_text())
    return found


@pytest.mark.parametrize(
    "name",
    [
        "characterize",
        pytest.param("noise", marks=pytest.mark.slow),
        pytest.param("tx-delay", marks=pytest.mark.slow),
    ],
)
def test_a_recorded_run_replays_to_an_equal_summary(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # given a recorded run
    monkeypatch.chdir(tmp_path)
    assert main([name, *FEW[name], "--seed", "5", "--record", "a.rec", "--out", "live", "--quiet"]) == 0
    # when it is replayed with the options that were recorded
    assert main([name, "--bench", "replay:a.rec", "--out", "again"]) == 0
    # then its summary differs in source and dates alone
    live, again = summary(Path("live")), summary(Path("again"))
    assert {key for key in live if live[key] != again[key]} == {"source", "started", "finished"}
    assert (live["source"], again["source"], again["seed"]) == ("emulated", "replay", 5)
    # and all say that it is a replay
    assert "REPLAYED DATA" in Path("again/report.html").read_text()
    assert f"replay of {tmp_path / 'a.rec'}, begun" in capsys.readouterr().err


def test_another_plan_is_status_3_with_an_excerpt_and_what_differs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # given a recorded run of a procedure that takes a moment
    monkeypatch.setitem(sys.modules, "procedures.characterize", tiny_procedure)
    monkeypatch.chdir(tmp_path)
    assert main(["characterize", "--quiet", "--codes", "4", "--record", "a.rec", "--out", "live"]) == 0
    # when another plan is replayed
    words = ["characterize", "--quiet", "--codes", "5", "--bench", "replay:a.rec", "--out", "other"]
    assert main(words) == 3
    # then one line says where and why, and an excerpt follows on the terminal and in the log
    first, *excerpt = capsys.readouterr().err.splitlines()
    assert "a write to the digitizer differs from the recorded one at byte" in first
    assert "the options are not those of the recording: codes was [4] and is [5]" in first
    assert sum(" recorded  " in line for line in excerpt) >= 1
    assert set(excerpt) <= set(Path("other/log.txt").read_text().splitlines())
    # and a replay is begun again, not resumed
    assert main(["characterize", "--resume", "other"]) == 2
    assert "is a replay, which has to begin with its recording" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--record", "there.rec"], "--record there.rec: is there already; give another name"),
        (["--record", "no/where.rec"], "--record no/where.rec: cannot be made (No such file or directory)"),
        (["--record", "run/a.rec"], "--record run/a.rec: lies in the run folder; put it beside run"),
        (["--record", "a.rec", "--windows", "w.nc"], "windows of a file cross no link; leave it out"),
        (["--bench", "replay:there.rec"], "there.rec: is no recording of belahil"),
        (["--bench", "replay:nowhere.rec"], "nowhere.rec: cannot be read (No such file or directory)"),
    ],
)
def test_wrong_use_is_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("there.rec").write_text("precious")

    assert main(["noise", "--out", "run", *words]) in (2, 4)

    answer = capsys.readouterr().err
    assert said in answer
    assert answer.count("\n") == 1
    assert Path("there.rec").read_text() == "precious"
    assert not Path("run").exists()


def test_a_recording_cannot_be_served(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recorded(tmp_path / "a.rec")

    assert main(["emulate", "--bench", f"replay:{tmp_path / 'a.rec'}"]) == 2
    assert "a recording holds no truth to emulate" in capsys.readouterr().err


def test_a_resumed_run_takes_no_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["noise", "--resume", str(tmp_path), "--record", str(tmp_path / "a.rec")]) == 2
    assert "takes everything from that folder; leave out --record" in capsys.readouterr().err


def test_the_replay_of_an_unknown_file_never_escapes_our_errors(tmp_path: Path) -> None:
    path = tmp_path / "a.rec"
    path.write_bytes(b"belahil recording 1\n" + framed(b'{"kind":"end"}\n'))

    with pytest.raises(BelahilError, match="has no complete header"):
        load_bench(f"replay:{path}")
    replay = Replay(path)
    with pytest.raises(RecordingEnds, match="the recorded session ends here"):
        replay.opened("generator", lambda: pytest.fail("opened"))
    replay.close()


def test_no_number_is_lost_on_the_way(tmp_path: Path) -> None:
    shots = recorded(tmp_path / "a.rec")

    with RecordingReader(tmp_path / "a.rec") as reader:
        records = list(reader)

    # records are in the order of time, and the windows are in them byte by byte
    began = [record.began_s for record, _ in records]
    assert began == sorted(began)
    elapsed = np.diff([record.elapsed_s for record, _ in records])
    assert (elapsed >= 0).all()
    assert [record.kind for record, _ in records[:1] + records[-1:]] == ["header", "end"]
    assert sum(record.link == "digitizer" and record.kind == "read" for record, _ in records) >= len(shots)


def test_the_reader_in_the_page_reads_what_ours_reads(tmp_path: Path) -> None:
    recorded(tmp_path / "a.rec")
    page = (Path(__file__).parent.parent / "docs" / "recording.md").read_text(encoding="utf-8")
    (source,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    shown: dict[str, Any] = {}
    exec(source, shown)

    told = list(shown["records"](tmp_path / "a.rec"))

    with RecordingReader(tmp_path / "a.rec") as reader:
        ours = [(json.loads(msgspec.json.encode(record)), data) for record, data in reader]
    assert told == ours
