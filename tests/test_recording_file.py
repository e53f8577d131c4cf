"""The file of a recording: what goes in comes out, and no damage goes unseen."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from belahil.errors import ConfigError, RefusedInput, StorageError
from belahil.recording_file import Record, RecordingReader, RecordingWriter

FINITE = st.floats(allow_nan=False, allow_infinity=False)
RECORDS = st.builds(
    Record,
    kind=st.sampled_from(["open", "write", "read", "clear", "close", "run", "closing", "end"]),
    link=st.sampled_from(["", "generator", "digitizer"]),
    began_s=FINITE,
    ended_s=FINITE,
    elapsed_s=FINITE,
    count=st.integers(0, 2**40),
    timeout_s=st.none() | FINITE,
    clock_s=st.lists(FINITE, max_size=4).map(tuple),
    error=st.none() | st.tuples(st.text(max_size=9), st.text(max_size=9)),
)
SESSIONS = st.lists(st.tuples(RECORDS, st.binary(max_size=70)), min_size=1, max_size=5)


@pytest.fixture(scope="module")
def place() -> Path:
    # hypothesis runs all examples of a test in one call, which has one tmp_path.
    return Path(tempfile.mkdtemp(prefix="belahil-recording-")) / "file.rec"


def written(path: Path, session: list[tuple[Record, bytes]]) -> bytes:
    path.unlink(missing_ok=True)
    writer = RecordingWriter(path)
    for record, data in session:
        writer.append(record, data)
    writer.close()
    return path.read_bytes()


def read(path: Path, found: list[tuple[Record, bytes]] | None = None) -> tuple[list[Any], bool]:
    """Return the records, which are put into `found`, and whether the file ended within one."""
    found = [] if found is None else found
    with RecordingReader(path) as reader:
        for one in reader:
            found.append(one)
        return found, reader.torn


@settings(max_examples=50)
@given(session=SESSIONS)
def test_every_sequence_of_records_comes_back(place: Path, session: list[tuple[Record, bytes]]) -> None:
    written(place, session)

    assert read(place) == (session, False)


@settings(max_examples=50)
@given(session=SESSIONS, data=st.data())
def test_a_truncated_file_gives_its_whole_records_and_says_that_it_is_torn(
    place: Path, session: list[tuple[Record, bytes]], data: st.DataObject
) -> None:
    ends = [len(written(place, session[:count])) for count in range(len(session) + 1)]
    whole = written(place, session)
    size = data.draw(st.integers(ends[0], len(whole)))

    place.write_bytes(whole[:size])

    # a cut between two records shows only in the missing last record, which the replay looks for
    assert read(place) == (
        [one for one, end in zip(session, ends[1:], strict=True) if end <= size],
        size not in ends,
    )


@settings(max_examples=50)
@given(session=SESSIONS, data=st.data())
def test_a_changed_byte_is_refused_and_the_records_before_it_are_right(
    place: Path, session: list[tuple[Record, bytes]], data: st.DataObject
) -> None:
    damaged = bytearray(written(place, session))
    at = data.draw(st.integers(0, len(damaged) - 1))
    damaged[at] ^= data.draw(st.integers(1, 255))
    place.write_bytes(damaged)
    found: list[tuple[Record, bytes]] = []

    with pytest.raises((StorageError, ConfigError)):
        read(place, found)

    assert found == session[: len(found)]
    assert len(found) < len(session)


@given(beginning=st.binary(max_size=80))
def test_any_other_file_is_no_recording(place: Path, beginning: bytes) -> None:
    place.write_bytes(beginning)

    with pytest.raises(ConfigError, match="is no recording of belahil"):
        RecordingReader(place)


def test_zeros_that_a_power_cut_leaves_are_a_torn_end_and_other_bytes_are_damage(place: Path) -> None:
    whole = written(place, [(Record("end"), b"")])

    place.write_bytes(whole + bytes(5000))
    assert read(place) == ([(Record("end"), b"")], True)

    place.write_bytes(whole + bytes(5000) + b"x")
    with pytest.raises(StorageError, match=f"damaged at byte {len(whole)}, after 1 good records"):
        read(place)


def test_another_version_of_the_format_is_refused_in_one_line(place: Path) -> None:
    place.write_bytes(written(place, []).replace(b"recording 1\n", b"recording 12\n"))

    with pytest.raises(ConfigError) as caught:
        RecordingReader(place)

    assert str(caught.value) == (
        f"{place}: is a recording in version 12 of the format; this belahil reads version 1"
    )


def test_a_file_that_is_there_is_never_written_over(place: Path) -> None:
    before = written(place, [(Record("end"), b"kept")])

    with pytest.raises(RefusedInput, match=r"is there already"):
        RecordingWriter(place)

    assert place.read_bytes() == before


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no disk that is always full")
def test_a_full_disk_raises_nothing_and_is_kept(tmp_path: Path) -> None:
    # given a recording whose disk is full from now on
    writer = RecordingWriter(tmp_path / "file.rec")
    os.dup2(os.open("/dev/full", os.O_WRONLY), writer._file.fileno())

    # when more is written
    writer.append(Record("write", "generator"), b"*RST\n")
    writer.append(Record("write", "generator"), b"*CLS\n")
    writer.close()

    # then nothing is raised, and it is told why the file ends
    assert "ends after 0 records (No space left on device)" in str(writer.failed)
