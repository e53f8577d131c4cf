"""The byte face of a receiver, spoken to in packets."""

from __future__ import annotations

from dataclasses import replace

import pytest
from grm_bench import SPEC, FakeClock, FakeReceiver, window_for
from grm_cases import same
from hypothesis import given
from hypothesis import strategies as st

from belahil.errors import InstrumentError, InstrumentRefused
from belahil.grm_link import (
    Acknowledge,
    Answer,
    HousekeepingReport,
    IdentityReport,
    Reason,
    Refusal,
    SpecReport,
    Telecommand,
    Telemetry,
    Verb,
    WindowAssembler,
    WindowSegment,
    framed,
    packet_stream,
    read_answer,
    telecommand,
)
from belahil.values import WindowRequest
from sim.devices.grm import GrmDevice

FRAMINGS = ["cobs", "raw"]
REQUEST = WindowRequest(shot=5, gain_code=4, sample_count=400)


class Client:
    """Numbers commands, frames them and reads whatever is ready."""

    def __init__(self, device: GrmDevice, framing: str) -> None:
        self.device = device
        self.framing = framing
        self.stream = packet_stream(Telemetry, framing)
        self.count = 0

    def say(self, verb: Verb, request: WindowRequest | None = None) -> int:
        return self.say_packet(telecommand(verb, self.count, request))

    def say_packet(self, command: Telecommand) -> int:
        self.count += 1
        self.device.write(framed(command.pack(), self.framing))
        return command.request_id

    def hear_packets(self) -> list[Telemetry]:
        packets = []
        while data := self.device.read(65536):
            packets += self.stream.feed(data)
        return packets

    def hear(self) -> list[Answer]:
        return [read_answer(packet) for packet in self.hear_packets()]


@pytest.fixture
def receiver() -> FakeReceiver:
    return FakeReceiver()


@pytest.fixture(params=FRAMINGS)
def client(request: pytest.FixtureRequest, receiver: FakeReceiver) -> Client:
    return Client(GrmDevice(receiver, request.param), request.param)


def test_each_question_has_its_answer(client: Client, receiver: FakeReceiver) -> None:
    ids = [client.say(verb) for verb in (Verb.IDENTIFY, Verb.SPEC, Verb.HOUSEKEEPING)]

    assert client.hear() == [
        IdentityReport(ids[0], receiver.identity),
        SpecReport(ids[1], SPEC),
        HousekeepingReport(ids[2], receiver.housekeeping()),
    ]


def test_an_armed_window_follows_its_acknowledge(client: Client, receiver: FakeReceiver) -> None:
    # Given a device that cuts windows small
    client.device = GrmDevice(receiver, client.framing, segment_bytes=100)

    # When it is armed
    request_id = client.say(Verb.ARM, REQUEST)
    acknowledge, *parts = client.hear()

    # Then the acknowledge comes, then the segments, once
    assert acknowledge == Acknowledge(request_id)
    assert [part.index for part in parts] == list(range(len(parts)))
    assert len(parts) > 8
    assembler = WindowAssembler(request_id, 5)
    assert same([assembler.add(part) for part in parts][-1], window_for(REQUEST))
    assert client.hear() == []


def test_a_window_captured_later_is_sent_at_the_next_poll(client: Client, receiver: FakeReceiver) -> None:
    receiver.captured = False
    request_id = client.say(Verb.ARM, replace(REQUEST, trigger="generator"))
    assert client.hear() == [Acknowledge(request_id)]
    assert client.device.waiting == 0

    receiver.captured = True

    assert client.device.waiting > 800
    (segment,) = client.hear()
    assert isinstance(segment, WindowSegment)


def test_abort_leaves_nothing_older_on_the_way(client: Client, receiver: FakeReceiver) -> None:
    # Given a window that is ready, and another that waits for its trigger
    client.say(Verb.ARM, REQUEST)
    assert client.device.waiting > 0
    receiver.captured = False
    client.say(Verb.ARM, replace(REQUEST, shot=6))

    # When the client aborts, and the trigger comes after that
    abort_id = client.say(Verb.ABORT)
    receiver.captured = True

    # Then the acknowledge of the abort is all that comes
    assert client.hear() == [Acknowledge(abort_id)]
    assert receiver.aborts == 1


def test_arming_again_replaces_what_was_armed(client: Client, receiver: FakeReceiver) -> None:
    receiver.captured = False
    client.say(Verb.ARM, REQUEST)
    client.say(Verb.ARM, replace(REQUEST, shot=6))
    receiver.captured = True

    parts = [answer for answer in client.hear() if isinstance(answer, WindowSegment)]

    assert {part.shot for part in parts} == {6}


@pytest.mark.parametrize(
    ("change", "reason", "named"),
    [
        ({"gain_code": 16}, Reason.GAIN_CODE, "gain code 16; allowed: 0, 1,"),
        ({"gain_code": None}, Reason.GAIN_CODE, "gain code None"),
        ({"sample_count": 0}, Reason.SAMPLE_COUNT, "0 samples; allowed: 1 to 16064"),
        ({"sample_count": 16065}, Reason.SAMPLE_COUNT, "16065 samples"),
        ({"delay_s": -1e-6}, Reason.DELAY, "delay of -1e-06 s"),
        ({"delay_s": 1.01}, Reason.DELAY, "delay of 1.01 s; allowed: 0 to 1 s"),
        ({"trigger": "digitizer"}, Reason.TRIGGER, "trigger digitizer; allowed: immediate, generator"),
        ({"products": "correlation_windows"}, Reason.PRODUCTS, "correlation_windows; allowed: window"),
    ],
)
def test_what_the_spec_excludes_is_refused_with_its_reason(
    client: Client, receiver: FakeReceiver, change: dict, reason: Reason, named: str
) -> None:
    receiver.spec = replace(SPEC, triggers=("immediate", "generator"))

    request_id = client.say(Verb.ARM, replace(REQUEST, **change))

    (refusal,) = client.hear()
    assert (refusal.request_id, refusal.reason) == (request_id, reason)
    assert named in refusal.text
    assert receiver.armed == []


@pytest.mark.parametrize(
    "wrong",
    [telecommand(Verb.ARM, 1, replace(REQUEST, gain_code=16)), Telecommand(200, Verb.ARM, 1, b"?")],
    ids=["excluded", "malformed"],
)
def test_a_refused_arm_leaves_nothing_armed(
    client: Client, receiver: FakeReceiver, wrong: Telecommand
) -> None:
    receiver.captured = False
    client.say(Verb.ARM, REQUEST)
    client.say_packet(wrong)
    receiver.captured = True

    acknowledge, *rest = client.hear()

    assert isinstance(acknowledge, Acknowledge)
    assert [type(answer) for answer in rest] == [Refusal]
    assert receiver.aborts == 1


def test_a_receiver_without_gain_codes_takes_none(client: Client, receiver: FakeReceiver) -> None:
    receiver.spec = replace(SPEC, gain_codes=None)

    client.say(Verb.ARM, replace(REQUEST, gain_code=None))
    client.say(Verb.ARM, replace(REQUEST, gain_code=0))

    *_, refusal = client.hear()
    assert refusal.reason == Reason.GAIN_CODE
    assert len(receiver.armed) == 1


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (InstrumentRefused("no light", 77), 77),
        (InstrumentRefused("no light"), Reason.OTHER),
        (InstrumentRefused("no light", -300), Reason.OTHER),
        (InstrumentError("no light"), Reason.OTHER),
    ],
)
def test_what_the_receiver_refuses_itself_is_passed_on(
    client: Client, receiver: FakeReceiver, error: Exception, reason: int
) -> None:
    receiver.refusing = error

    request_id = client.say(Verb.ARM, REQUEST)

    assert client.hear() == [Refusal(request_id, reason, "no light")]


def test_a_capture_that_fails_ends_the_request(client: Client, receiver: FakeReceiver) -> None:
    receiver.failing = InstrumentError("no pulse came")

    request_id = client.say(Verb.ARM, REQUEST)

    assert client.hear() == [
        Acknowledge(request_id),
        Refusal(request_id, Reason.NOT_CAPTURED, "no pulse came"),
    ]
    assert client.hear() == []


def test_unknown_commands_are_refused_and_damaged_ones_are_not_answered(client: Client) -> None:
    unknown = client.say_packet(Telecommand(200, 77, client.count))
    spoiled = bytearray(telecommand(Verb.IDENTIFY, 9).pack())
    spoiled[-1] ^= 1
    client.device.write(framed(bytes(spoiled), client.framing))
    known = client.say(Verb.IDENTIFY)

    refusal, identity = client.hear()

    assert (refusal.request_id, refusal.reason) == (unknown, Reason.UNKNOWN_COMMAND)
    assert identity.request_id == known


def test_telemetry_is_counted_and_stamped(receiver: FakeReceiver) -> None:
    clock = FakeClock()
    client = Client(GrmDevice(receiver, "raw", clock, segment_bytes=500), "raw")
    clock.sleep_s(2.25)
    client.device._sequence_count = 16382
    for _ in range(2):
        client.say(Verb.IDENTIFY)
    client.say(Verb.ARM, REQUEST)

    packets = client.hear_packets()

    assert [packet.sequence_count for packet in packets] == [16382, 16383, 0, 1, 2]
    assert [packet.grouping for packet in packets] == [3, 3, 3, 1, 2]
    assert {packet.time_s for packet in packets} == {2.25}


@given(st.lists(st.integers(1, 300), min_size=1))
def test_small_reads_lose_nothing(sizes: list[int]) -> None:
    whole = Client(GrmDevice(FakeReceiver(), "cobs"), "cobs")
    client = Client(GrmDevice(FakeReceiver(), "cobs"), "cobs")
    for one in (whole, client):
        one.say(Verb.SPEC)
        one.say(Verb.ARM, REQUEST)

    parts = [client.device.read(size) for size in sizes * 20]

    assert all(len(part) <= size for part, size in zip(parts, sizes * 20, strict=True))
    assert b"".join(parts) + client.device.read(65536) == whole.device.read(65536)


def test_raw_reads_hold_whole_packets_while_they_fit(receiver: FakeReceiver) -> None:
    device = GrmDevice(receiver, "raw", segment_bytes=100)
    client = Client(device, "raw")
    client.say(Verb.ARM, REQUEST)

    while data := device.read(512):
        packets = packet_stream(Telemetry, "raw").feed(data)

        assert sum(len(packet.pack()) for packet in packets) == len(data)


@given(st.lists(st.binary(max_size=200), max_size=4), st.sampled_from(FRAMINGS))
def test_whatever_came_before_a_command_is_answered(garbage: list[bytes], framing: str) -> None:
    client = Client(GrmDevice(FakeReceiver(), framing), framing)
    for data in garbage:
        client.device.write(data)
    client.hear()

    request_id = client.say(Verb.IDENTIFY)

    assert client.hear() == [IdentityReport(request_id, FakeReceiver.identity)]


def test_a_command_that_was_cut_does_not_swallow_the_next(client: Client) -> None:
    command = framed(telecommand(Verb.ARM, 0, REQUEST).pack(), client.framing)
    # All but the last byte of a frame is the whole packet: the next frame's first zero ends it as well.
    for size in range(len(command) - 1):
        client.device.write(command[:size])

        request_id = client.say(Verb.IDENTIFY)

        assert client.hear() == [IdentityReport(request_id, FakeReceiver.identity)]
