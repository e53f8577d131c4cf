"""The journal: what goes in comes out bit for bit, and a killed writer costs at most the last shot."""

from __future__ import annotations

import math
import os
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from belahil.errors import StorageError
from belahil.journal import Journal
from belahil.shot_record import from_bytes, to_bytes
from belahil.stimuli import NoSignal, SampledPulse, Sine, Stimulus, TransmittedPulse
from belahil.values import PRODUCTS, SOURCES, TRIGGERS, Candidate, RangeWindow, Shot, WindowRequest

HEADER = {"procedure": "noise", "facts": {"numbers": [1.5, math.inf]}}


def bits(number: float) -> bytes:
    return struct.pack("<d", number)


floats = st.floats(allow_nan=True, allow_infinity=True)
finite = st.floats(allow_nan=False, allow_infinity=False)
positive = st.floats(min_value=0, exclude_min=True, allow_infinity=False)
naturals = st.integers(0, 2**32 - 1)
stimuli = st.one_of(
    st.just(NoSignal()),
    st.just(TransmittedPulse()),
    st.builds(Sine, positive, positive, finite),
    st.builds(
        SampledPulse,
        arrays(np.float64, st.integers(2, 40), elements=finite),
        positive,
        finite,
        st.sampled_from(["linear", "hold"]),
        st.lists(st.complex_numbers(allow_nan=False), max_size=3).map(tuple),
    ),
)
windows = st.builds(
    RangeWindow,
    arrays(np.int16, st.integers(0, 60)),
    floats,
    floats,
    floats,
    floats,
    st.none() | st.integers(0, 255),
    naturals,
    st.integers(0, 60),
    st.lists(
        st.builds(
            Candidate,
            finite,
            finite,
            finite,
            st.lists(st.integers(-(2**15), 2**15)).map(tuple),
            st.integers(0, 2**32 - 1),
        ),
        max_size=4,
    ).map(tuple),
    st.dictionaries(st.text(max_size=8), floats, max_size=3),
)
requests = st.builds(
    WindowRequest,
    naturals,
    st.none() | st.integers(0, 255),
    st.integers(1, 20000),
    finite,
    st.sampled_from(TRIGGERS),
    st.sampled_from(SOURCES),
    st.sampled_from(PRODUCTS),
)
shots = st.builds(Shot, stimuli, windows, st.text(max_size=30), st.integers(1, 3))


def no_pulse(place: int) -> Stimulus:
    raise AssertionError(f"no pulse at {place}")


@settings(max_examples=300, suppress_health_check=[HealthCheck.too_slow])
@given(requests, shots)
def test_a_shot_comes_back_bit_for_bit(request_: WindowRequest, shot: Shot) -> None:
    # when any shot is written and read
    asked, found = from_bytes(to_bytes(request_, shot), no_pulse)
    # then every word is the same, and every float has the same bits
    assert asked == request_
    assert (found.played, found.date, found.attempt) == (shot.played, shot.date, shot.attempt)
    assert found.window.counts.dtype == np.int16
    assert found.window.counts.tobytes() == shot.window.counts.tobytes()
    for name in ("volts_per_count", "zero_count", "sample_interval_s", "start_s"):
        assert bits(getattr(found.window, name)) == bits(getattr(shot.window, name))
    for name in ("gain_code", "shot", "saturated", "candidates"):
        assert getattr(found.window, name) == getattr(shot.window, name)
    assert {key: bits(value) for key, value in found.window.housekeeping.items()} == {
        key: bits(value) for key, value in shot.window.housekeeping.items()
    }
    if isinstance(shot.played, SampledPulse):
        assert isinstance(found.played, SampledPulse)
        assert found.played.volts.tobytes() == shot.played.volts.tobytes()


def one_shot(number: int, played: Stimulus | None = None) -> tuple[WindowRequest, Shot]:
    counts = np.arange(number, number + 30, dtype=np.int16)
    window = RangeWindow(counts, 1e-3, 2048.0, 12.5e-9, 0.0, 4, number)
    return WindowRequest(number, 4, 30), Shot(
        played or Sine(1e6 + number, 0.05), window, "2030-01-01T00:00:00+00:00"
    )


def written(path: Path, count: int) -> bytes:
    journal = Journal.create(path, HEADER)
    for number in range(count):
        journal.append(*one_shot(number))
    journal.close()
    return path.read_bytes()


def numbers_in(path: Path) -> list[int]:
    journal = Journal(path)
    for number in journal:
        assert journal.read(number)[1].window.equals(one_shot(number)[1].window)
    found = list(journal)
    journal.close()
    return found


def test_the_header_and_the_order_of_the_plan_come_back(tmp_path: Path) -> None:
    journal = Journal.create(tmp_path / "shots", HEADER)
    for number in (5, 1, 3):
        journal.append(*one_shot(number))
    journal.close()

    again = Journal(tmp_path / "shots")

    assert again.header == HEADER
    assert list(again) == [1, 3, 5]
    assert (3 in again, 4 in again, len(again)) == (True, False, 3)
    again.close()


def test_a_journal_cut_anywhere_in_its_last_shot_loses_that_shot_alone(tmp_path: Path) -> None:
    # given a journal of three shots
    path = tmp_path / "shots"
    two = len(written(path, 2))
    path.unlink()
    three = written(path, 3)
    # when a writer was killed after any number of bytes of the third
    for length in range(two, len(three)):
        path.write_bytes(three[:length])
        # then two are there, the file ends with them, and the third can be written again
        assert numbers_in(path) == [0, 1]
        assert path.stat().st_size == two
    journal = Journal(path)
    journal.append(*one_shot(2))
    journal.close()
    assert path.read_bytes() == three


@pytest.mark.parametrize("tail", [b"\0" * 5, b"\0" * 5000])
def test_zeros_that_a_power_cut_leaves_are_cut(tmp_path: Path, tail: bytes) -> None:
    path = tmp_path / "shots"
    whole = written(path, 2)
    path.write_bytes(whole + tail)

    journal = Journal(path)

    assert (len(journal), journal.cut_bytes) == (2, len(tail))
    journal.close()
    assert path.read_bytes() == whole


def test_a_flipped_bit_is_never_read_as_data(tmp_path: Path) -> None:
    # given a journal of three shots
    path = tmp_path / "shots"
    whole = written(path, 3)
    two = len(whole) // 3 * 2
    # when any byte is spoiled
    for place in range(0, len(whole), 3):
        spoiled = bytearray(whole)
        spoiled[place] ^= 0x41
        path.write_bytes(spoiled)
        # then it was in the last shot, which looks like one that was cut short
        if outcome_of(path) == "read":
            assert place > two
            assert numbers_in(path) == [0, 1]
        # or it is refused and left as it is
        else:
            assert path.read_bytes() == bytes(spoiled)


def outcome_of(path: Path) -> str:
    try:
        Journal(path).close()
    except StorageError:
        return "refused"
    return "read"


def test_damage_between_opening_and_reading_is_found(tmp_path: Path) -> None:
    path = tmp_path / "shots"
    whole = bytearray(written(path, 2))
    journal = Journal(path)
    whole[-5] ^= 1
    path.write_bytes(whole)
    with pytest.raises(StorageError, match="damaged at byte"):
        journal.read(1)
    journal.close()


@pytest.mark.parametrize(
    "content", [b"", b"something else", b"belahil journal 1\n", b"belahil journal 1\n\1\2"]
)
def test_what_is_no_journal_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "shots").write_bytes(content)
    with pytest.raises(StorageError, match=r"no journal|no complete header"):
        Journal(tmp_path / "shots")
    with pytest.raises(StorageError, match="cannot be opened"):
        Journal(tmp_path / "not there")


def test_a_pulse_that_is_played_again_is_written_once(tmp_path: Path) -> None:
    # given a long pulse, played four times, another one in between
    pulse, other = (SampledPulse(np.full(5000, volts), 80e6) for volts in (0.01, 0.02))
    journal = Journal.create(tmp_path / "shots", HEADER)
    for number, played in enumerate([pulse, pulse, other, other, pulse]):
        journal.append(*one_shot(number, played))
    journal.close()
    # then the disk holds it twice and the other once, and all come back, in any order
    assert 3 * 40_000 < (tmp_path / "shots").stat().st_size < 3.2 * 40_000
    again = Journal(tmp_path / "shots")
    found = {number: again.read(number)[1].played for number in (4, 3, 1, 0, 2)}
    assert found == {0: pulse, 1: pulse, 2: other, 3: other, 4: pulse}
    again.close()


def test_a_shot_is_kept_once(tmp_path: Path) -> None:
    journal = Journal.create(tmp_path / "shots", HEADER)
    journal.append(*one_shot(0))
    with pytest.raises(ValueError, match="shot 0 is in the journal already"):
        journal.append(*one_shot(0))
    journal.close()


def test_counts_of_another_type_are_not_squeezed_in() -> None:
    request_, shot = one_shot(0)
    wide = RangeWindow(np.array([70000]), 1.0, 0.0, 1.0, 0.0, 4, 0)
    with pytest.raises(TypeError, match="must be one row of int16"):
        to_bytes(request_, Shot(shot.played, wide, shot.date))


def test_the_disk_is_waited_for_when_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[int] = []
    monkeypatch.setattr("belahil.journal._sync", synced.append)
    journal = Journal.create(tmp_path / "a", HEADER)
    journal.append(*one_shot(0))
    journal.append(*one_shot(1))
    assert len(synced) == 2
    assert journal.fsync_s > 0
    journal.close()
    hasty = Journal.create(tmp_path / "b", HEADER, sync=False)
    hasty.append(*one_shot(0))
    assert len(synced) == 2
    assert hasty.fsync_s == 0
    hasty.close()


@pytest.mark.parametrize("write_first", [0, 40])
def test_a_full_disk_costs_only_the_shot_that_did_not_fit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, write_first: int
) -> None:
    # given a journal of two shots on a disk that is full after some bytes more
    path = tmp_path / "shots"
    whole = written(path, 2)
    journal = Journal(path)
    real = journal._file

    class FullDisk:
        def __getattr__(self, name: str) -> object:
            return getattr(real, name)

        def write(self, data: memoryview) -> int:
            if real.tell() >= len(whole) + write_first:
                raise OSError(28, os.strerror(28))
            return real.write(data[:write_first])

    monkeypatch.setattr(journal, "_file", FullDisk())
    # when the third is appended
    with pytest.raises(StorageError, match=r"shot 2 cannot be written, 2 shots are kept \(No space left"):
        journal.append(*one_shot(2))
    journal.close()
    # then the file is as it was
    assert path.read_bytes() == whole
    assert numbers_in(path) == [0, 1]
