"""A recording beside emulated instruments: they equal themselves, and only what was changed is found."""

from __future__ import annotations

import json
import re
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import pytest
import scope_bench
from faulty_bench import SCRIPT, FaultyBench, _played_by, config
from hypothesis import given, settings
from hypothesis import strategies as st
from served import served

from belahil.bench import open_bench
from belahil.cli.bench_parity import beside
from belahil.cli.bench_parity_told import report_lines
from belahil.cli.main import main
from belahil.config import BenchConfig, DigitizerTable, GeneratorTable, as_toml, seeded
from belahil.errors import LinkClosed, RefusedInput
from belahil.generators import FAMILIES
from belahil.grm_link import (
    Acknowledge,
    HousekeepingReport,
    IdentityReport,
    Refusal,
    SpecReport,
    Telemetry,
    WindowSegment,
    framed,
    packet_stream,
    read_answer,
    segments,
    telemetry,
    unpack_window,
)
from belahil.oscilloscopes import SCOPES
from belahil.recording import Recorder, read_session
from belahil.recording_file import Record, RecordingReader, RecordingWriter
from drivers.visa_link import VisaLink
from sim.build import VISA_ADDRESS, endpoints
from sim.devices.scpi.status import ScpiError
from sim.faults import Fault, FaultPlan

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from belahil.grm_link import Answer
    from belahil.parity import Parity
    from belahil.stimuli import Stimulus
    from belahil.values import WindowRequest
    from sim.devices.scpi import ScpiDevice

Captured = pytest.CaptureFixture[str]


def recorded(
    path: Path, bench: BenchConfig, script: Sequence[tuple[Stimulus, WindowRequest]] = SCRIPT
) -> Path:
    """Measure a script on the emulated bench, recorded."""
    with open_bench(bench, record=path) as opened:
        for stimulus, request in script:
            opened.measure(_played_by(stimulus, opened.generator_model), request)
    return path


def found(path: Path, bench: Path | None = None) -> Parity:
    return beside(path, None if bench is None else str(bench), 3).parity


def differing(parity: Parity) -> list[tuple[str, str, str]]:
    """Return question, kind and what was recorded of all that differs."""
    return [
        (row.question, one.kind, one.recorded)
        for row in parity.rows
        for one in row.differences
        if one.kind != "measured"
    ]


def edited(path: Path, change: Callable[[Record, bytes], bytes | None]) -> Path:
    """Write a recording anew with other bytes; None leaves the record out."""
    other = path.with_name(f"edited-{path.name}")
    writer = RecordingWriter(other)
    with RecordingReader(path) as reader:
        for record, data in reader:
            changed = change(record, data)
            if changed is not None:
                writer.append(record, changed)
    writer.close()
    return other


def dialogue(
    path: Path, messages: Sequence[bytes], changed: Callable[[ScpiDevice], None] | None = None
) -> Path:
    """Record messages to a generator, which may have been changed; a question is read once."""
    bench = config("serial")
    ends = endpoints(bench)
    if changed is not None:
        changed(ends.visa_library._devices[VISA_ADDRESS])
    recorder = Recorder(path, bench, ends.clock)
    link, _ = recorder.opened("generator", lambda: (VisaLink(VISA_ADDRESS, ends.visa_library), "lines"))
    for message in messages:
        link.write(message)
        if b"?" in message:
            link.read(65536, 0.1)
    recorder.leaving()
    link.close()
    recorder.close()
    return path


@pytest.fixture(scope="module")
def serial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("parity") / "serial.rec", config("serial"))


# ---- an emulation equals itself


@pytest.mark.parametrize("driver", FAMILIES)
def test_a_recorded_emulation_equals_the_emulation(tmp_path: Path, driver: str) -> None:
    # given a recorded session of any generator, with a receiver on USB
    path = recorded(tmp_path / "bench.rec", config("usb", driver=driver))
    # when it is gone through again
    parity = found(path)
    # then all answers are equal to the bit, windows too
    assert not parity.differ
    assert not parity.measured
    assert not parity.events
    assert not parity.passed_over
    windows = next(row for row in parity.rows if row.question == "ARM: window")
    assert windows.count == windows.equal == len(SCRIPT)


@pytest.mark.parametrize("driver", SCOPES)
def test_a_recorded_oscilloscope_equals_its_emulation(tmp_path: Path, driver: str) -> None:
    script = scope_bench.SCRIPT[2:4]
    path = recorded(tmp_path / "scope.rec", scope_bench.config(driver, receiver=""), script)
    parity = found(path)
    # The drift of the receiver's clock was hidden truth, which is not in a recording.
    assert not differing(parity)
    assert parity.windows[0].count >= len(script)
    assert {one.kind for one in parity.latencies if one.link == "digitizer"} == {"question", "block"}


@pytest.mark.slow
@pytest.mark.parametrize("digitizer", SCOPES)
@pytest.mark.parametrize("driver", FAMILIES)
def test_every_generator_with_every_oscilloscope_equals_its_emulation(
    tmp_path: Path, driver: str, digitizer: str
) -> None:
    bench = scope_bench.config(digitizer)
    bench = msgspec.structs.replace(bench, generator=msgspec.structs.replace(bench.generator, driver=driver))
    assert not differing(found(recorded(tmp_path / "both.rec", bench, scope_bench.SCRIPT)))


# ---- what was changed is exactly what is found


def test_another_error_number_is_found_with_the_command_that_gave_it(tmp_path: Path) -> None:
    # given a generator that calls an impossible voltage a conflict of settings
    def changed(device: ScpiDevice) -> None:
        def report(error: ScpiError) -> None:
            device.status.report(ScpiError(-221) if error.code == -222 else error)

        device.report = report  # type: ignore[method-assign]

    messages = (
        b"*IDN?\n",
        b"*RST;*CLS\n",
        b":SOUR1:FUNC SIN;:SOUR1:VOLT 1000\n",
        b"SYST:ERR?\n",
        b":SOUR1:NONSENSE 1\n",
        b"SYST:ERR?\n",
        b"SYST:ERR?\n",
    )
    sound = found(dialogue(tmp_path / "sound.rec", messages))
    # then the unchanged one gives equal errors
    assert not sound.differ
    assert [(one.code, one.count) for one in sound.errors] == [(-222, 1), (-113, 1)]
    # and of the changed one exactly this is found, with what came before
    parity = found(dialogue(tmp_path / "changed.rec", messages, changed))
    (row,) = (row for row in parity.rows if row.differ)
    (one,) = row.differences
    assert (row.question, row.count, row.differ, one.kind) == ("SYST:ERR?", 3, 1, "error")
    assert one.recorded.startswith("-221,")
    assert one.emulated.startswith("-222,")
    assert one.after[-2:] == (":SOUR1:FUNC SIN", ":SOUR1:VOLT 1000")
    assert one.raised_by == ":SOUR1:FUNC SIN; :SOUR1:VOLT 1000"
    assert [(one.code, one.count) for one in parity.errors] == [(-113, 1)]


@pytest.mark.parametrize(
    ("was", "becomes", "kind"),
    [
        (b"+3.000000000000000E+06", b"3E6", "format"),
        (b"+3.000000000000000E+06", b"+3.000001000000000E+06", "number"),
        (b"VPP", b"VRMS", "text"),
        (b'+0,"No error"', b'+0,"No Error"', "wording"),
        (b'+0,"No error"', b'-221,"Settings conflict"', "error"),
    ],
)
def test_one_answer_that_was_changed_is_the_only_difference(
    serial: Path, was: bytes, becomes: bytes, kind: str
) -> None:
    # given a recording in which one answer is another one
    left = [1]

    def change(record: Record, data: bytes) -> bytes:
        if record.link == "generator" and record.kind == "read" and was in data and left:
            left.clear()
            return data.replace(was, becomes, 1)
        return data

    path = edited(serial, change)
    # then this answer is found, and nothing else
    parity = found(path)
    path.unlink()
    assert [one[1:] for one in differing(parity)] == [(kind, becomes.decode())]
    assert parity.count == found(serial).count


def test_another_truth_gives_other_noise_and_no_difference(serial: Path, tmp_path: Path) -> None:
    # given a bench with another seed, as a twin is
    twin = tmp_path / "twin.toml"
    twin.write_text(as_toml(seeded(config("serial"), 8)))
    parity = found(serial, twin)
    # then only what was measured differs, and it is told by its statistics
    assert not parity.differ
    assert parity.measured == len(SCRIPT)
    (windows,) = parity.windows
    assert windows.count == len(SCRIPT)
    assert 0 < windows.largest_difference[1] < windows.recorded[1]


def test_a_bench_of_other_instruments_is_refused(serial: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.toml"
    other.write_text('[generator]\ndriver = "rigol-dg"\n')
    with pytest.raises(RefusedInput, match="its generator is rigol-dg, the recorded one keysight-33500"):
        beside(serial, str(other), 3)
    with pytest.raises(RefusedInput, match="needed is one whose instruments are emulated"):
        beside(serial, f"replay:{serial}", 3)


def refused(answer: Answer) -> Answer:
    return Refusal(answer.request_id, 4, "48 samples") if isinstance(answer, Acknowledge) else answer


def coarser(answer: Answer) -> Answer:
    if not isinstance(answer, SpecReport):
        return answer
    return SpecReport(answer.request_id, replace(answer.spec, bits=11))


def shifted(answer: Answer) -> Answer:
    if not isinstance(answer, WindowSegment):
        return answer
    window = replace(unpack_window(answer.payload), zero_count=0.5)
    (segment,) = segments(window, answer.request_id)
    return segment


def renamed(answer: Answer) -> Answer:
    return IdentityReport(answer.request_id, "someone else") if isinstance(answer, IdentityReport) else answer


@pytest.mark.parametrize(
    ("change", "question", "kind", "both"),
    [
        (refused, "ARM", "error", ("refusal 4, window of 48 samples", "acknowledge, window of 48 samples")),
        (coarser, "SPEC: spec", "shape", ("bits 11", "bits 12")),
        (shifted, "ARM: window", "shape", ("zero_count 0.5", "zero_count 2048.0")),
        (renamed, "IDENTIFY: identity", "text", ("text someone else", "text belahil,bela-grm")),
    ],
)
def test_telemetry_of_another_kind_or_with_other_fields_is_found(
    serial: Path, change: Callable[[Answer], Answer], question: str, kind: str, both: tuple[str, str]
) -> None:
    # given a receiver whose answers, but those to the first ABORT, are changed
    seen: list[Record] = []

    def changed(record: Record, data: bytes) -> bytes:
        if record.link != "digitizer" or record.kind != "read":
            return data
        seen.append(record)
        answers = [read_answer(packet) for packet in packet_stream(Telemetry, "cobs").feed(data)]
        return b"".join(
            framed(telemetry(one if len(seen) == 1 else change(one), 0).pack(), "cobs")
            for one in answers
            if one is not None
        )

    path = edited(serial, changed)
    parity = found(path)
    path.unlink()
    # then these are found, and nothing else
    assert {one[:2] for one in differing(parity)} == {(question, kind)}
    (first, *_) = (one for row in parity.rows for one in row.differences)
    assert first.recorded == both[0]
    assert first.emulated.startswith(both[1])


def test_housekeeping_may_differ_in_its_numbers_and_not_in_its_names(tmp_path: Path) -> None:
    # given a receiver that was asked twice for its housekeeping
    path = tmp_path / "housekeeping.rec"
    with open_bench(config("usb"), record=path) as opened:
        for _ in range(2):
            opened._digitizer.housekeeping()  # type: ignore[attr-defined]

    def changed(name: str) -> Callable[[Record, bytes], bytes]:
        def change(record: Record, data: bytes) -> bytes:
            if record.link != "digitizer" or record.kind != "read":
                return data
            (answer,) = map(read_answer, packet_stream(Telemetry, "raw").feed(data))
            if isinstance(answer, HousekeepingReport):
                values = {"uptime_s": 12.5, name: 3.0}
                return telemetry(HousekeepingReport(answer.request_id, values), 0).pack()
            return data

        return change

    # then other numbers are told as measured, and another name is a difference
    parity = found(edited(path, changed("window_count")))
    assert (parity.measured, parity.differ) == (2, 0)
    (tmp_path / "edited-housekeeping.rec").unlink()
    parity = found(edited(path, changed("temperature_k")))
    assert [one[:2] for one in differing(parity)] == 2 * [("HOUSEKEEPING: housekeeping", "shape")]


def test_a_waveform_of_another_shape_is_found_and_another_scale_too(tmp_path: Path) -> None:
    driver = "siglent-sds"
    path = recorded(tmp_path / "scope.rec", scope_bench.config(driver), scope_bench.SCRIPT[2:3])

    def change(record: Record, data: bytes) -> bytes:
        return data.replace(b"#9000014000", b"#514000", 1) if record.kind == "read" else data

    parity = found(edited(path, change))
    assert differing(parity) == [("C1:WF?", "shape", "DAT2,#514000<14000 bytes>")]


def test_a_question_that_was_repeated_is_a_wait(tmp_path: Path) -> None:
    # given an instrument that says twice that it is not ready, and then that it is
    path = dialogue(tmp_path / "wait.rec", [b"*IDN?\n", *[b"*OPC?\n"] * 3, b"*TST?\n"])
    answers = iter([b"0\n", b"0\n", b"1\n"])

    def change(record: Record, data: bytes) -> bytes:
        return next(answers) if record.kind == "read" and data == b"1\n" else data

    # then its last answer counts, once
    parity = found(edited(path, change))
    assert not parity.differ
    assert next(row.count for row in parity.rows if row.question == "*OPC?") == 1


def test_a_question_that_only_one_answers_is_silence(tmp_path: Path) -> None:
    path = dialogue(tmp_path / "silent.rec", [b"*IDN?\n", b"NO:SUCH?\n", b"SYST:ERR?\n", b"SYST:ERR?\n"])
    answered = edited(path, lambda record, data: data if record.kind != "read" else data or b"42\n")
    assert not found(path).differ
    assert differing(found(answered)) == [("NO:SUCH?", "silence", "42")]


def test_a_model_that_is_not_known_is_taken_for_the_usual_one(serial: Path) -> None:
    # given the session of a generator that belahil has never heard of, which was refused when it was opened
    def change(record: Record, data: bytes) -> bytes | None:
        return None if record.kind == "instruments" else data.replace(b"33522B", b"33599Z")

    path = edited(serial, change)
    told = beside(path, None, 3)
    path.unlink()
    # then the usual model of its family stands for it, under its name
    assert told.emulated["generator"] == "33522B"
    (row,) = (row for row in told.parity.rows if row.question == "*IDN?")
    assert row.recorded.startswith("Agilent Technologies,33599Z")
    assert not [row for row in told.parity.rows if row.differ and row.link == "generator"]


# ---- recordings in disorder


def test_a_recording_that_was_cut_anywhere_is_compared_as_far_as_it_goes(
    serial: Path, tmp_path: Path
) -> None:
    whole = serial.read_bytes()
    counts = []
    for place in range(len(whole) - 1, 1500, -len(whole) // 9):
        path = tmp_path / "cut.rec"
        path.write_bytes(whole[:place])
        parity = found(path)
        assert not parity.differ
        assert "it was cut short" in parity.events[-1].what
        counts.append(parity.count)
    # then less and less is compared
    assert counts == sorted(counts, reverse=True)
    assert counts[0] > 10 * counts[-1]


def test_a_damaged_recording_is_compared_up_to_the_damage(serial: Path, tmp_path: Path) -> None:
    whole = bytearray(serial.read_bytes())
    whole[len(whole) // 2] ^= 1
    path = tmp_path / "damaged.rec"
    path.write_bytes(whole)
    parity = found(path)
    assert not parity.differ
    assert "damaged at byte" in parity.events[-1].what
    assert 0 < parity.count < found(serial).count


@pytest.mark.parametrize("link", ["visa", "serial"])
def test_errors_of_links_are_listed_and_the_rest_goes_on(tmp_path: Path, link: str) -> None:
    # given a session with a damaged packet, or one whose generator went away
    kind, path = ("close" if link == "visa" else "flip"), tmp_path / "faulty.rec"
    bench = FaultyBench(config("serial"), FaultPlan([Fault(link, "from_device", kind, 9)]))  # type: ignore[arg-type]
    with pytest.raises(LinkClosed) if link == "visa" else nullcontext(), bench.open(path) as opened:
        for stimulus, request in SCRIPT:
            opened.measure(stimulus, request)
    parity = found(path)
    # then it is listed, and nothing differs on its account
    assert not parity.differ
    assert parity.events[0].link == ("generator" if link == "visa" else "digitizer")
    windows = next(row for row in parity.rows if row.question == "ARM: window")
    assert windows.equal == (2 if link == "visa" else len(SCRIPT))
    assert ("LinkClosed" if link == "visa" else "damaged") in parity.events[0].what


def test_a_file_without_an_answer_is_refused(serial: Path, tmp_path: Path) -> None:
    empty = edited(serial, lambda record, data: data if record.kind in ("header", "end") else None)
    with pytest.raises(RefusedInput, match="holds no answer to compare"):
        found(empty)
    empty.unlink()
    assert read_session(serial).instruments["generator"].startswith("Agilent Technologies,33522B")


# ---- the command


def test_the_command_tells_a_table_and_writes_json(serial: Path, tmp_path: Path, capsys: Captured) -> None:
    out = tmp_path / "parity.json"
    assert main(["bench", "parity", str(serial), "--out", str(out)]) == 0
    told = capsys.readouterr().out
    assert "75 answers" not in told
    assert "generator: Agilent Technologies,33522B" in told
    assert "calls within the process" in told
    written = json.loads(out.read_text())
    assert written["differ"] == 0
    assert written["compared"] == sum(row["count"] for row in written["rows"]) > 50
    # whose keys are those that the page describes
    page = (Path(__file__).parent.parent / "docs" / "parity.md").read_text(encoding="utf-8")
    lists = ("rows", "windows", "latencies")
    for key in {*written, *(key for one in lists for row in written[one] for key in row)}:
        assert f"`{key}`" in page.partition("## The file")[2]
    # and with a difference it says what, and ends with 1
    path = edited(
        serial, lambda record, data: data.replace(b"VPP", b"VRMS") if record.kind == "read" else data
    )
    assert main(["bench", "parity", str(path), "--examples", "1"]) == 1
    path.unlink()
    told = capsys.readouterr().out
    assert "SOUR1:VOLT:UNIT?: text\n    recorded  VRMS\n    emulated  VPP" in told
    assert re.search(r"SOUR1:VOLT:UNIT\?: \d+ more", told)


# ---- what else may be in a recording


@pytest.mark.timeout(60)
def test_a_session_over_sockets_equals_the_emulation(tmp_path: Path) -> None:
    # given a bench that is served over TCP, where nobody knows what was read, and whose clock is a real one
    path = tmp_path / "served.rec"
    with served() as (places, _):
        bench = BenchConfig(
            generator=GeneratorTable(address=places.address), digitizer=DigitizerTable(link=places.link)
        )
        recorded(path, bench)
    parity = found(path)
    # then all is equal, and the latencies are those of the line
    assert read_session(path).source == "hardware"
    assert not parity.differ
    assert not parity.measured
    assert min(one.recorded_s[0] for one in parity.latencies) > 10e-6


@settings(max_examples=8, deadline=None)
@given(
    st.integers(1, 1000),
    st.one_of(st.binary(max_size=50), st.just(None)),
    st.sampled_from(["read", "write", "clear", "close", "open", None]),
    st.sampled_from([None, ("LinkTimeout", "nobody answers")]),
)
def test_any_record_may_be_another_one(
    serial: Path, place: int, data: bytes | None, kind: str | None, error: tuple[str, str] | None
) -> None:
    # given a recording with one record of any kind and with any bytes in it
    path = serial.with_name("any.rec")
    writer = RecordingWriter(path)
    with RecordingReader(serial) as reader:
        records = list(reader)
    verbs = [number for number, (record, _) in enumerate(records) if record.link]
    chosen = verbs[place % len(verbs)]
    for number, (record, was) in enumerate(records):
        if number == chosen:
            changed = msgspec.structs.replace(record, kind=kind or record.kind, error=error)
            writer.append(changed, was if data is None else data)
        else:
            writer.append(record, was)
    writer.close()
    try:
        # then it is gone through to its end, and tells what it found
        found_here = beside(path, None, 3)
        assert found_here.parity.count > 0
        assert list(report_lines(found_here))
    finally:
        path.unlink()
