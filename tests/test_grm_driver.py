"""The receiver's driver against the emulated device, over lines with and without faults."""

from __future__ import annotations

import contextlib
from dataclasses import replace

import numpy as np
import pytest
from grm_bench import SPEC, FakeClock, FakeLink, FakeReceiver, window_for
from grm_cases import damaged, same

from belahil.errors import (
    CorruptData,
    InstrumentError,
    InstrumentRefused,
    LimitExceeded,
    LinkClosed,
    LinkError,
    LinkTimeout,
    StaleData,
)
from belahil.grm_link import (
    Acknowledge,
    Answer,
    IdentityReport,
    Reason,
    Telemetry,
    framed,
    packet_stream,
    segments,
    telemetry,
)
from belahil.values import WindowRequest
from drivers.grm import GrmDigitizer
from sim.devices.grm import GrmDevice

FRAMINGS = ["cobs", "raw"]


class Bench:
    def __init__(self, framing: str = "cobs", segment_bytes: int = 300) -> None:
        self.framing = framing
        self.clock = FakeClock()
        self.receiver = FakeReceiver()
        self.link = FakeLink(GrmDevice(self.receiver, framing, segment_bytes=segment_bytes), self.clock)
        self.digitizer = GrmDigitizer(self.link, self.clock, framing)

    def measure(self, request: WindowRequest):
        self.digitizer.arm(request)
        return self.digitizer.read(1.0)

    def arm(self, request: WindowRequest) -> int:
        """Arm, with the capture right after; return the request number."""
        self.receiver.captured = False
        self.digitizer.arm(request)
        self.receiver.captured = True
        return self.link.device._armed

    def say(self, answer: Answer) -> None:
        """Put an answer on the line, before what the device has ready."""
        self.link.pending.append(framed(telemetry(answer, 0).pack(), self.framing))

    def frames(self, data: bytes) -> list[bytes]:
        """Cut what the device sends into frames."""
        stream = packet_stream(Telemetry, self.framing)
        return [framed(packet.pack(), self.framing) for packet in stream.feed(data)]


@pytest.fixture(params=FRAMINGS)
def bench(request: pytest.FixtureRequest) -> Bench:
    return Bench(request.param)


REQUEST = WindowRequest(shot=5, gain_code=4, sample_count=400)


def request_for(shot: int) -> WindowRequest:
    return WindowRequest(shot=shot, gain_code=shot % 16, sample_count=300 + shot % 3)


# --- a line without faults


def test_opening_asks_who_answers_and_what_it_can(bench: Bench) -> None:
    assert bench.digitizer.identity == FakeReceiver.identity
    assert bench.digitizer.spec == SPEC
    assert bench.link.clears == 1


def test_windows_come_with_their_shots(bench: Bench) -> None:
    for shot in range(40):
        assert same(bench.measure(request_for(shot)), window_for(request_for(shot)))
    assert bench.receiver.armed == [request_for(shot) for shot in range(40)]
    assert (bench.digitizer.dropped.damaged, bench.digitizer.dropped.stale) == (0, 0)
    assert bench.clock.now_s() == 0.0


def test_sequence_counts_go_round(bench: Bench) -> None:
    bench.digitizer._session._sequence_count = 2**14 - 3

    for shot in range(6):
        assert bench.measure(request_for(shot)).shot == shot


def test_a_window_may_wait_for_its_trigger(bench: Bench) -> None:
    bench.receiver.captured = False
    bench.digitizer.arm(replace(REQUEST, trigger="generator"))

    bench.receiver.captured = True

    assert bench.digitizer.read(1.0).shot == 5


def test_housekeeping_has_names(bench: Bench) -> None:
    assert bench.digitizer.housekeeping() == {"temperature_k": 293.15, "windows": 0.0}


def test_a_refusal_has_its_reason_and_costs_nothing(bench: Bench) -> None:
    with pytest.raises(
        InstrumentRefused, match=r"ARM of shot 5.*gain code 16.*reason 3 GAIN_CODE"
    ) as refusal:
        bench.digitizer.arm(replace(REQUEST, gain_code=16))

    assert refusal.value.reason == Reason.GAIN_CODE
    assert bench.measure(REQUEST).shot == 5
    assert bench.link.clears == 1


def test_a_capture_that_fails_is_reported_as_a_refusal(bench: Bench) -> None:
    bench.arm(REQUEST)
    bench.receiver.failing = InstrumentError("no\npulse")

    with pytest.raises(InstrumentRefused, match="no pulse") as refusal:
        bench.digitizer.read(1.0)

    assert refusal.value.reason == Reason.NOT_CAPTURED


def test_a_request_that_does_not_fit_is_not_sent(bench: Bench) -> None:
    with pytest.raises(LimitExceeded, match="shot=-1"):
        bench.digitizer.arm(replace(REQUEST, shot=-1))

    assert bench.receiver.armed == []
    assert bench.measure(REQUEST).shot == 5


def test_reading_without_arming_is_a_mistake(bench: Bench) -> None:
    with pytest.raises(InstrumentError, match="before it was armed"):
        bench.digitizer.read(1.0)


def test_a_window_that_was_never_read_is_not_taken_for_the_next(bench: Bench) -> None:
    bench.digitizer.arm(request_for(1))

    assert same(bench.measure(request_for(2)), window_for(request_for(2)))


def test_closing_disarms_and_may_be_repeated_on_a_dead_link(bench: Bench) -> None:
    bench.receiver.captured = False
    bench.digitizer.arm(REQUEST)

    bench.digitizer.close()
    bench.link.error = LinkClosed("gone")
    bench.digitizer.close()

    assert bench.link.closed
    assert bench.receiver.aborts == 1


# --- nobody, or somebody else


def test_nobody_there_is_a_time_out_and_the_link_is_closed() -> None:
    bench = Bench()
    bench.link.back = lambda data: b""

    with pytest.raises(LinkTimeout, match=r"ABORT: no complete answer in time; is this the receiver's link?"):
        GrmDigitizer(bench.link, bench.clock, "cobs")

    assert bench.link.closed
    assert bench.clock.now_s() == 2.0


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (b"Agilent Technologies,33522B\n", "frame of 28 octets without a zero byte .* 41 67 69 6c"),
        (b"\0\x09wrong\0", "frame of 6 octets that are not COBS"),
    ],
)
def test_somebody_else_there_is_shown_by_his_first_octets(line: bytes, said: str) -> None:
    bench = Bench()
    answers = iter([line])
    bench.link.back = lambda data: next(answers, b"")

    with pytest.raises(CorruptData, match=f"ABORT: .*{said}.*; is this the receiver's link?"):
        GrmDigitizer(bench.link, bench.clock, "cobs")


def test_a_wrong_request_number_is_shown_beside_the_one_that_was_due() -> None:
    bench = Bench()
    bench.link.back = lambda data: b""
    bench.say(Acknowledge(0))
    bench.link.clear = lambda: None

    with pytest.raises(StaleData, match=r"number 1864c000; 1 came under others, the last under 00000000$"):
        GrmDigitizer(bench.link, bench.clock, "cobs")


def test_a_receiver_whose_spec_breaks_the_rules_is_not_opened() -> None:
    bench = Bench()
    bench.receiver.spec = replace(SPEC, bits=20)

    with pytest.raises(CorruptData, match="receiver, SPEC: spec: bits 20; allowed: 1 to 16"):
        GrmDigitizer(bench.link, bench.clock, "cobs")

    assert bench.link.closed


def test_another_receiver_on_the_link_is_noticed(bench: Bench) -> None:
    bench.arm(REQUEST)
    bench.receiver.request = None
    with pytest.raises(LinkTimeout):
        bench.digitizer.read(1.0)
    bench.receiver.identity = "Other receiver"

    with pytest.raises(InstrumentError, match='was "Fake receiver, number 1" and now says "Other receiver"'):
        bench.digitizer.arm(REQUEST)


def test_a_closed_link_says_so_at_each_step(bench: Bench) -> None:
    bench.arm(REQUEST)
    bench.link.error = LinkClosed("gone")

    with pytest.raises(LinkClosed):
        bench.digitizer.read(1.0)
    with pytest.raises(LinkClosed):
        bench.digitizer.arm(REQUEST)


# --- late, older, wrong


def test_no_window_in_time_is_a_time_out_of_that_length(bench: Bench) -> None:
    bench.receiver.captured = False
    bench.digitizer.arm(REQUEST)

    with pytest.raises(LinkTimeout, match="window of shot 5"):
        bench.digitizer.read(0.75)

    assert bench.clock.now_s() == 0.75


def test_a_window_that_comes_late_is_not_taken_for_the_next(bench: Bench) -> None:
    # Given a window that missed its deadline and stayed on the line
    bench.receiver.captured = False
    bench.digitizer.arm(request_for(1))
    with pytest.raises(LinkTimeout):
        bench.digitizer.read(1.0)
    bench.receiver.captured = True
    late = bench.link.device.read(65536)
    assert len(late) > 600
    bench.link.clear = lambda: None
    bench.link.pending.append(late)

    # When the next shot is measured, then it is that shot, and the late packets are counted
    assert same(bench.measure(request_for(2)), window_for(request_for(2)))
    assert bench.digitizer.dropped.stale == len(bench.frames(late))


def test_an_older_window_instead_of_the_answer_is_called_stale(bench: Bench) -> None:
    old = segments(window_for(request_for(4)), 0x18640000)
    bench.arm(REQUEST)
    bench.link.device.read(65536)
    bench.say(old[0])

    request_id = bench.link.device._armed or bench.digitizer._armed[1]
    said = f"under request number {request_id:08x}; 1 came under others, the last under 18640000"
    with pytest.raises(StaleData, match=said):
        bench.digitizer.read(1.0)


def test_a_window_of_another_shot_under_the_right_request_is_stale(bench: Bench) -> None:
    request_id = bench.arm(REQUEST)
    bench.say(segments(window_for(request_for(4)), request_id)[0])

    with pytest.raises(StaleData, match="asked for shot 5"):
        bench.digitizer.read(1.0)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"gain_code": 3}, "asked for gain code 4, it has 3"),
        ({"counts": np.zeros(399, np.int16)}, "asked for 400 samples, 399 came"),
        ({"counts": np.full(400, -30000, np.int16)}, "counts from -30000 to 300; allowed with 12 bits: "),
        ({"sample_interval_s": 1e-7}, "sample interval 1e-07 s; the spec's 80000000.0 Hz mean 1.25e-08 s"),
        ({"start_s": 1.0}, "start 1.0 s; asked for a delay of 0.0 s"),
        ({"volts_per_count": 4.88e-300}, "volts per count 4.88e-300, with 12 bits a span of"),
        ({"zero_count": 1e300}, r"zero count 1e\+300; allowed: -65536 to 65536"),
    ],
)
def test_a_window_that_contradicts_request_or_spec_is_refused(bench: Bench, change: dict, said: str) -> None:
    request_id = bench.arm(REQUEST)
    (segment,) = segments(replace(window_for(REQUEST), **change), request_id)
    bench.say(segment)

    with pytest.raises(CorruptData, match=f"window of shot 5: {said}"):
        bench.digitizer.read(1.0)
    assert bench.measure(REQUEST).shot == 5


def test_candidates_alone_bring_no_samples(bench: Bench) -> None:
    request = replace(REQUEST, products="candidates")

    assert bench.measure(request).counts.size == 0

    request_id = bench.arm(request)
    bench.say(segments(window_for(REQUEST), request_id)[0])
    with pytest.raises(CorruptData, match="asked for 0 samples, 400 came"):
        bench.digitizer.read(1.0)


def test_an_acknowledge_that_comes_twice_is_dropped(bench: Bench) -> None:
    request_id = bench.arm(REQUEST)
    bench.say(Acknowledge(request_id))

    assert same(bench.digitizer.read(1.0), window_for(REQUEST))
    assert bench.digitizer.dropped.stale == 1


def test_an_answer_of_the_wrong_kind_is_refused(bench: Bench) -> None:
    request_id = bench.arm(REQUEST)
    bench.say(IdentityReport(request_id, "?"))

    with pytest.raises(CorruptData, match="IdentityReport came, WindowSegment was due"):
        bench.digitizer.read(1.0)


def test_a_missing_segment_is_noticed_without_waiting(bench: Bench) -> None:
    bench.arm(REQUEST)
    frames = bench.frames(bench.link.device.read(65536))
    bench.link.pending.append(b"".join(frames[:1] + frames[2:]))

    with pytest.raises(CorruptData, match="segment 2 came where 1 was due"):
        bench.digitizer.read(1.0)

    assert bench.clock.now_s() == 0.0
    assert bench.measure(REQUEST).shot == 5


def test_a_damaged_last_segment_is_called_damage_not_silence(bench: Bench) -> None:
    bench.arm(REQUEST)
    data = bytearray(bench.link.device.read(65536))
    data[-5] ^= 0x10
    bench.link.pending.append(bytes(data))

    # Then the rule that refused it is named, and how it began
    with pytest.raises(CorruptData, match=r"1 damaged, .* CRC-16 0x.*; it begins with 08 64 [0-9a-f ]{29}$"):
        bench.digitizer.read(1.0)


def test_a_line_that_never_stops_talking_ends_at_the_deadline(bench: Bench) -> None:
    bench.receiver.captured = False
    bench.digitizer.arm(REQUEST)
    chatter = framed(telemetry(Acknowledge(1), 0).pack(), bench.framing)

    def read(count: int, timeout_s: float) -> bytes:
        bench.clock.sleep_s(0.01)
        return chatter

    bench.link.read = read

    with pytest.raises(StaleData):
        bench.digitizer.read(1.0)
    assert bench.clock.now_s() == pytest.approx(1.0, abs=0.02)


# --- faults at random places


class Fault:
    """Damages one piece of the traffic, once."""

    def __init__(self, rng: np.random.Generator, skip: int) -> None:
        self.rng, self.skip, self.fired = rng, skip, False

    def __call__(self, data: bytes) -> bytes:
        self.skip -= 1
        if self.fired or self.skip >= 0:
            return data
        self.fired = True
        return damaged(data, self.rng)


@pytest.mark.parametrize("direction", ["there", "back"])
@pytest.mark.parametrize("framing", FRAMINGS)
def test_faults_give_the_right_window_or_a_typed_error(framing: str, direction: str) -> None:
    # Given one bench and 300 faults at random places of its traffic
    bench = Bench(framing)
    rng = np.random.default_rng(77)
    right = wrong = fired = 0
    for shot in range(300):
        fault = Fault(rng, skip=int(rng.integers(0, 2)))
        setattr(bench.link, direction, fault)

        # When a shot is measured, and again after an error, as the bench does
        for attempt in range(4):
            try:
                window = bench.measure(request_for(shot))
            except LinkError:
                wrong += 1
                assert attempt < 3
                continue
            break

        # Then it is that shot's window, in the end
        assert same(window, window_for(request_for(shot)))
        right += attempt == 0
        fired += fault.fired
    assert fired > 140
    assert right > 0
    assert wrong > 50


@pytest.mark.parametrize("framing", FRAMINGS)
def test_a_line_full_of_faults_never_gives_a_wrong_window(framing: str) -> None:
    bench = Bench(framing)
    rng = np.random.default_rng(78)
    bench.link.there = lambda data: damaged(data, rng) if rng.random() < 0.2 else data
    bench.link.back = lambda data: damaged(data, rng) if rng.random() < 0.3 else data
    right = 0
    for shot in range(300):
        with contextlib.suppress(LinkError):
            assert same(bench.measure(request_for(shot)), window_for(request_for(shot)))
            right += 1
    assert 30 < right < 270


@pytest.mark.parametrize("framing", FRAMINGS)
def test_doubled_dropped_and_reordered_packets_give_the_right_window_or_an_error(framing: str) -> None:
    bench = Bench(framing)
    rng = np.random.default_rng(79)
    kept: list[bytes] = []

    def shuffled(data: bytes) -> bytes:
        frames = bench.frames(data)
        kept.extend(frames)
        at = int(rng.integers(0, len(frames)))
        match rng.integers(0, 5):
            case 0:
                frames.insert(at, frames[at])
            case 1:
                del frames[at]
            case 2:
                frames[at:] = frames[at:][::-1]
            case 3:
                frames.insert(at, kept[int(rng.integers(0, len(kept)))])
        return b"".join(frames)

    bench.link.back = shuffled
    right = 0
    for shot in range(300):
        with contextlib.suppress(LinkError):
            assert same(bench.measure(request_for(shot)), window_for(request_for(shot)))
            right += 1
    assert 60 < right < 290
