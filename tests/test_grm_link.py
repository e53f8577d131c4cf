"""The codec of the GRM link: round trips, damage, and an independent judge of its packets."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from cobs import cobs
from grm_cases import (
    a_window,
    damaged,
    numbers,
    packets_of,
    requests,
    same,
    specs,
    stream_of,
    u32,
    windows,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from spacepackets.ecss import PusTc, PusTm

from belahil.errors import CorruptData, InstrumentRefused, LimitExceeded, LinkError, StaleData
from belahil.grm_link import (
    MAX_PACKET_BYTES,
    Acknowledge,
    HousekeepingReport,
    IdentityReport,
    Reason,
    Refusal,
    SpecReport,
    Telecommand,
    Telemetry,
    Verb,
    WindowAssembler,
    crc16,
    framed,
    pack_window,
    packet_stream,
    read_answer,
    read_command,
    segments,
    telecommand,
    telemetry,
    unpack_window,
)
from belahil.grm_link.spec import pack_spec
from belahil.receiver import DigitizerSpec
from belahil.values import WindowRequest

FRAMINGS = ["cobs", "raw"]
u8 = st.integers(0, 255)
u14 = st.integers(0, 2**14 - 1)
telecommands = st.builds(Telecommand, u8, u8, u14, st.binary(max_size=60))
times = st.floats(0, 2**32 - 1)
telemetries = st.builds(Telemetry, u8, u8, u14, st.binary(max_size=300), st.integers(0, 3), times)


# --- packets


@given(telecommands)
def test_a_telecommand_equals_that_of_spacepackets_both_ways(command: Telecommand) -> None:
    judge = PusTc(
        service=command.service,
        message_subtype=command.subtype,
        apid=0x64,
        seq_count=command.sequence_count,
        app_data=command.data,
        ack_flags=1,
    )

    assert command.pack() == bytes(judge.pack())
    assert Telecommand.unpack(bytes(judge.pack())) == command
    assert PusTc.unpack(command.pack()) == judge
    assert command.request_id == int.from_bytes(command.pack()[:4], "big")


@given(telemetries)
def test_telemetry_equals_that_of_spacepackets_both_ways(packet: Telemetry) -> None:
    fraction = int(packet.time_s * 2**24)
    judge = PusTm(
        service=packet.service,
        message_subtype=packet.subtype,
        timestamp=fraction.to_bytes(7, "big"),
        apid=0x64,
        seq_count=packet.sequence_count,
        source_data=packet.data,
    )
    judge.seq_flags = packet.grouping

    assert packet.pack() == bytes(judge.pack())
    back = Telemetry.unpack(bytes(judge.pack()))
    assert back == replace(packet, time_s=fraction / 2**24)
    assert PusTm.unpack(packet.pack(), timestamp_len=7).source_data == packet.data


def test_packets_have_these_very_bytes() -> None:
    arm = telecommand(Verb.ARM, 2, WindowRequest(shot=7, gain_code=4, trigger="generator"))
    answer = telemetry(Acknowledge(arm.request_id), 3, time_s=1.5)

    assert telecommand(Verb.IDENTIFY, 1).pack().hex(" ") == "18 64 c0 01 00 06 21 c8 01 00 00 4c 75"
    assert arm.pack().hex(" ") == (
        "18 64 c0 02 00 1a 21 c8 03 00 00 00 00 00 07 04 01 00 00 00 00 3e c0 00 00 00 00 00 00 00 00 9b 94"
    )
    assert answer.pack().hex(" ") == (
        "08 64 c0 03 00 13 20 01 01 00 00 00 00 00 00 00 01 80 00 00 18 64 c0 02 6f c9"
    )


def test_the_checksum_is_the_catalogued_one() -> None:
    assert crc16(b"123456789") == 0x29B1
    assert crc16(b"123456789\x29\xb1") == 0


@pytest.mark.parametrize("packet", [telecommand(Verb.ABORT, 9), telemetry(Acknowledge(5), 6)])
def test_every_flipped_bit_of_a_packet_is_seen(packet: Telecommand | Telemetry) -> None:
    whole = packet.pack()
    for bit in range(8 * len(whole)):
        spoiled = (int.from_bytes(whole, "big") ^ 1 << bit).to_bytes(len(whole), "big")
        with pytest.raises(CorruptData):
            type(packet).unpack(spoiled)


@given(st.binary(max_size=80))
def test_unpacking_anything_raises_nothing_but_corrupt_data(data: bytes) -> None:
    for kind in (Telecommand, Telemetry):
        with pytest.raises(CorruptData):
            kind.unpack(data)


def test_a_packet_of_another_pus_version_is_refused() -> None:
    for packet in (telecommand(Verb.ABORT, 9), telemetry(Acknowledge(5), 6)):
        head = bytearray(packet.pack()[:-2])
        head[6] = 0x10 | head[6] & 0x0F
        other = bytes(head) + crc16(bytes(head)).to_bytes(2, "big")

        with pytest.raises(CorruptData, match="PUS version"):
            type(packet).unpack(other)


def test_a_packet_over_the_limit_is_not_made() -> None:
    with pytest.raises(ValueError, match="16385"):
        Telemetry(200, 131, 0, bytes(MAX_PACKET_BYTES - 22 + 1)).pack()
    assert len(Telemetry(200, 131, 0, bytes(MAX_PACKET_BYTES - 22)).pack()) == MAX_PACKET_BYTES


# --- commands and answers


@given(requests, u14)
def test_an_arm_command_comes_back_as_its_request(request: WindowRequest, count: int) -> None:
    packet = telecommand(Verb.ARM, count, request)

    assert read_command(Telecommand.unpack(packet.pack())) == (Verb.ARM, request)


@pytest.mark.parametrize("verb", [verb for verb in Verb if verb is not Verb.ARM])
def test_a_bare_command_comes_back(verb: Verb) -> None:
    assert read_command(telecommand(verb, 5)) == (verb, None)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"shot": -1}, "shot=-1"),
        ({"shot": 2**32}, "shot=4294967296"),
        ({"gain_code": 255}, "255"),
        ({"gain_code": 256}, "gain_code=256"),
        ({"sample_count": -1}, "sample_count=-1"),
        ({"trigger": "bus"}, "bus"),
    ],
)
def test_a_request_that_does_not_fit_is_refused_before_it_is_sent(change: dict, named: str) -> None:
    with pytest.raises(LimitExceeded, match=named):
        telecommand(Verb.ARM, 0, replace(WindowRequest(shot=1), **change))


ARM = telecommand(Verb.ARM, 0, WindowRequest(shot=1)).data


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        (Telecommand(200, 99, 0), Reason.UNKNOWN_COMMAND),
        (Telecommand(17, 1, 0), Reason.UNKNOWN_COMMAND),
        (Telecommand(200, Verb.IDENTIFY, 0, b"?"), Reason.MALFORMED),
        (Telecommand(200, Verb.ARM, 0, ARM[:-1]), Reason.MALFORMED),
        (Telecommand(200, Verb.ARM, 0, ARM[:5] + b"\x03" + ARM[6:]), Reason.TRIGGER),
        (Telecommand(200, Verb.ARM, 0, ARM[:6] + b"\x02" + ARM[7:]), Reason.SOURCE),
        (Telecommand(200, Verb.ARM, 0, ARM[:7] + b"\x04" + ARM[8:]), Reason.PRODUCTS),
        (Telecommand(200, Verb.ARM, 0, ARM[:12] + b"\x7f\xf8" + bytes(6)), Reason.DELAY),
    ],
)
def test_a_command_that_makes_no_sense_has_its_reason(command: Telecommand, reason: Reason) -> None:
    with pytest.raises(InstrumentRefused) as refusal:
        read_command(command)

    assert refusal.value.reason == reason


names = st.text(st.characters(codec="utf-8"), max_size=60)
answers = st.one_of(
    st.builds(Acknowledge, u32),
    st.builds(Refusal, u32, st.integers(0, 65535), names),
    st.builds(IdentityReport, u32, names.filter(str.strip)),
    st.builds(SpecReport, u32, specs),
    st.builds(HousekeepingReport, u32, st.dictionaries(names, numbers, max_size=9)),
)


@given(answers, u14)
def test_an_answer_comes_back(answer: Acknowledge, count: int) -> None:
    packet = Telemetry.unpack(telemetry(answer, count).pack())

    assert read_answer(packet) == answer
    assert packet.sequence_count == count


def test_a_long_text_is_cut_between_characters() -> None:
    (answer,) = [read_answer(telemetry(Refusal(1, 10, "x" + "é" * 600), 0))]

    assert answer == Refusal(1, 10, "x" + "é" * 511)


def test_telemetry_of_another_kind_is_nothing() -> None:
    assert read_answer(Telemetry(17, 2, 0, bytes(4))) is None


@given(
    st.sampled_from([(1, 1), (1, 2), (200, 129), (200, 130), (200, 131), (200, 132)]), st.binary(max_size=60)
)
def test_reading_any_contents_raises_nothing_but_corrupt_data(kind: tuple[int, int], data: bytes) -> None:
    try:
        answer = read_answer(Telemetry(*kind, 0, data))
    except CorruptData:
        return
    assert answer is not None


SPEC = DigitizerSpec(80e6, 12, 2, 16064, (0, 1, 4))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"sample_rate_hz": 1e-314}, r"spec: sample rate 1e-314 Hz; allowed: 1 to 1e\+12 Hz"),
        ({"sample_rate_hz": math.nan}, "spec: sample rate nan Hz"),
        ({"sample_rate_hz": math.inf}, "spec: sample rate inf Hz"),
        ({"sample_rate_hz": -80e6}, "spec: sample rate -80000000.0 Hz"),
        ({"bits": 0}, "spec: bits 0; allowed: 1 to 16"),
        ({"bits": 20}, "spec: bits 20; allowed: 1 to 16"),
        ({"converters": 0}, "spec: converters 0; allowed: 1 or more"),
        ({"max_sample_count": 0}, "spec: largest sample count 0; allowed: 1 to 16777216"),
        ({"max_sample_count": 2**24 + 1}, "spec: largest sample count 16777217"),
        ({"triggers": ()}, "mask of triggers names none; allowed: at least one of immediate, generator,"),
        ({"products": ()}, "mask of products names none; allowed: at least one of window, candidates,"),
        ({"gain_codes": (4, 4, 6)}, "spec: gain codes 4, 4, 6; allowed: each once"),
        ({"gain_codes": (4, 255)}, "spec: gain code 255; allowed: 0 to 254"),
    ],
)
def test_a_spec_that_contradicts_the_page_is_refused_with_its_field(change: dict, said: str) -> None:
    packet = telemetry(SpecReport(1, replace(SPEC, **change)), 0)

    with pytest.raises(CorruptData, match=said):
        read_answer(packet)


LONG = "one octet of text, " * 54  # 1026 octets


@pytest.mark.parametrize(
    ("kind", "data", "said"),
    [
        ((1, 1), b"", "acknowledge: the request number would end at octet 4, but there are 0 octets"),
        ((1, 1), b"1234!", "acknowledge: ends at octet 4, but there are 5 octets"),
        ((1, 2), b"12345", "refusal: the reason would end at octet 6, but there are 5 octets"),
        ((200, 129), b"1234", "identity '' is blank"),
        ((200, 129), b"1234 \n", "is blank"),
        ((200, 129), b"1234\xff\xfe", "identity is not UTF-8: invalid start byte at octet 0"),
        ((200, 129), b"1234" + LONG.encode(), "identity of 1026 octets; allowed: at most 1024"),
        ((200, 130), b"1234" + pack_spec(SPEC) + b"!", "spec: ends at octet 24, but there are 25 octets"),
        (
            (200, 130),
            b"1234" + pack_spec(SPEC)[:-1],
            "list of 3 gain codes would end at octet 24, .* 23 octets",
        ),
        ((200, 130), b"1234" + pack_spec(SPEC)[:9], "spec: its last field would end at octet 21"),
        ((200, 131), b"1234", "window segment: the CRC-32 would end at octet 16"),
        ((200, 131), b"1234" + bytes(5) + b"\1\0\1" + bytes(4), "window segment 1 of 1"),
        ((200, 132), b"1234", "housekeeping: the number of named values would end at octet 5"),
        ((200, 132), b"1234\1\3ab", "housekeeping: the name of named value 1 of 1 would end at octet 9"),
        ((200, 132), b"1234\1\1\xff" + bytes(8), "named value 1 of 1 is not UTF-8"),
        ((200, 132), b"1234\2\0" + bytes(8) + b"\0" + bytes(8), "2 named values with only 1 different"),
    ],
)
def test_an_answer_that_contradicts_the_page_says_where(
    kind: tuple[int, int], data: bytes, said: str
) -> None:
    with pytest.raises(CorruptData, match=said):
        read_answer(Telemetry(*kind, 0, data))


@pytest.mark.parametrize("flags", [0, 1, 2])
def test_only_windows_come_in_several_packets(flags: int) -> None:
    packet = replace(telemetry(Acknowledge(1), 0), grouping=flags)

    with pytest.raises(CorruptData, match=f"acknowledge with sequence flags {flags}; allowed: 3"):
        read_answer(packet)


def test_a_segment_whose_flags_say_something_else_is_refused() -> None:
    packet = telemetry(segments(a_window(), 1)[0], 0)

    with pytest.raises(CorruptData, match="window segment 0 of 1 with sequence flags 0; 3 are due"):
        read_answer(replace(packet, grouping=0))


# --- streams


@pytest.mark.parametrize("framing", FRAMINGS)
@given(packets=st.lists(telemetries, max_size=6), data=st.data())
def test_a_stream_gives_its_packets_however_it_is_split(
    framing: str, packets: list, data: st.DataObject
) -> None:
    packets = [replace(packet, time_s=0.0) for packet in packets]
    stream = packet_stream(Telemetry, framing)
    whole = stream_of([packet.pack() for packet in packets], framing)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(whole)), max_size=8)))

    taken = [stream.feed(whole[a:b]) for a, b in itertools.pairwise([0, *cuts, len(whole)])]

    assert [packet for some in taken for packet in some] + stream.end() == packets
    assert stream.damaged == 0


@pytest.mark.parametrize("framing", FRAMINGS)
def test_bytes_may_come_one_by_one(framing: str) -> None:
    stream = packet_stream(Telemetry, framing)
    whole = packets_of(a_window())

    taken = [stream.feed(bytes([byte])) for byte in stream_of(whole, framing)]

    assert [packet.pack() for some in taken for packet in some] == whole


@pytest.mark.parametrize("framing", FRAMINGS)
@pytest.mark.parametrize("fault", ["flip", "drop", "double"])
def test_a_damaged_byte_costs_its_packet_only(framing: str, fault: str) -> None:
    # Given three packets, the middle one with a fault at each of its places in turn
    before, middle, after = packets_of(a_window(samples=200))[:3]
    frame = framed(middle, framing)
    survivors = set()
    for at in range(len(frame)):
        with_fault = {
            "flip": frame[:at] + bytes([frame[at] ^ 0x55]) + frame[at + 1 :],
            "drop": frame[:at] + frame[at + 1 :],
            "double": frame[: at + 1] + frame[at:],
        }[fault]
        stream = packet_stream(Telemetry, framing)

        # When the stream is read to its end
        taken = stream.feed(framed(before, framing) + with_fault + framed(after, framing)) + stream.end()

        # Then both neighbours are there, and the loss of the middle one is counted
        came = [packet.pack() for packet in taken]
        assert [packet for packet in came if packet != middle] == [before, after]
        assert stream.damaged > 0 or middle in came
        survivors.add(middle in came)
    assert False in survivors


@pytest.mark.parametrize("framing", FRAMINGS)
@given(st.lists(st.binary(max_size=300), max_size=5), st.binary(max_size=3))
@settings(max_examples=60)
def test_a_packet_is_found_behind_anything(framing: str, garbage: list[bytes], start: bytes) -> None:
    stream = packet_stream(Telemetry, framing)
    packet = telemetry(IdentityReport(3, "GRM"), 0)
    for some in garbage:
        stream.feed(some)

    taken = stream.feed(packet.pack()[: len(start)] + framed(packet.pack(), framing)) + stream.end()

    assert packet in taken


@pytest.mark.parametrize("framing", FRAMINGS)
def test_a_stream_without_end_is_not_kept(framing: str) -> None:
    stream = packet_stream(Telemetry, framing)

    for _ in range(20):
        stream.feed(b"\x01" * 5000)

    assert len(stream._held) <= MAX_PACKET_BYTES + 200
    assert stream.damaged > 0


def resealed(packet: bytes, at: int, octets: bytes) -> bytes:
    """The packet with other octets at one place, and the CRC-16 that belongs to them."""
    changed = packet[:at] + octets + packet[at + len(octets) : -2]
    return changed + crc16(changed).to_bytes(2, "big")


INTACT = telemetry(Acknowledge(0x1864C000), 0).pack()


@pytest.mark.parametrize("framing", FRAMINGS)
@pytest.mark.parametrize(
    ("packet", "rule"),
    [
        (INTACT[:-1] + b"\0", f"packet with CRC-16 0xcd00, not 0x{INTACT[-2:].hex()}"),
        (resealed(INTACT, 0, b"\x18"), "packet with identification 0x1864, not 0x0864"),
        (resealed(INTACT, 6, b"\x10"), "packet of PUS version 1, not 2"),
        (resealed(INTACT, 4, b"\xff\xff"), "length field means 65542"),
        (INTACT[:9], "packet of 9 octets; allowed: 22 to 16384"),
    ],
)
def test_a_dropped_packet_leaves_its_rule_and_its_first_octets(
    framing: str, packet: bytes, rule: str
) -> None:
    stream = packet_stream(Telemetry, framing)

    assert stream.feed(framed(packet, framing)) + stream.end() == []

    assert stream.damaged == 1
    assert rule in stream.complaint
    assert stream.complaint.endswith(f"; it begins with {packet[:12].hex(' ')}")


@pytest.mark.parametrize(
    ("line", "rule"),
    [
        (b"\0\x09wrong\0", "frame of 6 octets that are not COBS"),
        (cobs.encode(INTACT), "frame of 27 octets without a zero byte behind them"),
    ],
)
def test_a_dropped_frame_leaves_its_rule(line: bytes, rule: str) -> None:
    stream = packet_stream(Telemetry, "cobs")

    assert stream.feed(line) + stream.end() == []

    assert rule in stream.complaint


def test_a_segmented_telecommand_is_refused() -> None:
    packet = resealed(telecommand(Verb.ABORT, 9).pack(), 2, b"\x40")

    with pytest.raises(CorruptData, match="packet with sequence flags 1, not 3"):
        Telecommand.unpack(packet)


# --- windows


@given(windows(), u32, st.integers(1, 2000))
def test_a_window_comes_back_bit_for_bit(window, request_id: int, segment_bytes: int) -> None:
    assembler = WindowAssembler(request_id, window.shot)

    packets = packets_of(window, request_id, max(segment_bytes, len(pack_window(window)) // 900))
    *early, last = [assembler.add(read_answer(Telemetry.unpack(packet))) for packet in packets]

    assert early == [None] * len(early)
    assert same(last, window)
    assert not last.counts.flags.writeable


@given(windows(most_samples=40), st.data())
def test_a_payload_that_is_cut_or_longer_is_refused(window, data: st.DataObject) -> None:
    payload = pack_window(window)
    size = data.draw(st.integers(0, len(payload) - 1))

    for wrong in (payload[:size], payload + b"\0"):
        with pytest.raises(CorruptData):
            unpack_window(wrong)


@given(st.binary(max_size=300))
def test_unpacking_any_payload_raises_nothing_but_corrupt_data(data: bytes) -> None:
    try:
        window = unpack_window(data)
    except CorruptData:
        return
    assert pack_window(window) == data[:6] + bytes(2) + data[8:]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"volts_per_count": 0.0}, "volts per count 0.0; allowed: finite, above 0"),
        ({"volts_per_count": math.nan}, "volts per count nan"),
        ({"zero_count": math.inf}, "zero count inf; allowed: finite$"),
        ({"sample_interval_s": -1.0}, "sample interval -1.0; allowed: finite, above 0"),
        ({"start_s": math.nan}, "start nan; allowed: finite$"),
        ({"saturated": 901}, "901 of 900 samples saturated"),
    ],
)
def test_a_window_with_unusable_numbers_is_refused(change: dict, said: str) -> None:
    with pytest.raises(CorruptData, match=f"^window of shot 7: {said}"):
        unpack_window(pack_window(replace(a_window(), **change)))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda payload: payload[:20], "window: its head would end at octet 48, but there are 20 octets"),
        (lambda payload: payload[:60], "window of shot 7: its 9 counts would end at octet 66, .* 60 octets"),
        (lambda payload: payload[:70], "window of shot 7: candidate 1 would end at octet 96"),
        (
            lambda payload: payload[:98],
            "window of shot 7: the 3 counts of candidate 1 would end at octet 102",
        ),
        (lambda payload: payload[:102], "7, behind 9 counts and 1 candidates: the number of named values"),
        (lambda payload: payload[:5] + b"\5" + payload[6:], "shot 7: 5 candidates; allowed: at most 4"),
        (lambda payload: payload[:6] + b"\0" + payload[7:], "shot 7: candidates of form 0; allowed: 1"),
        (
            lambda payload: payload[:74] + b"\x7f\xf8" + payload[76:],
            "shot 7: candidate 1 has a number nan; allowed: finite ones",
        ),
        # the field of the number of samples is one too small, or one too large
        (lambda payload: payload[:11] + b"\x08" + payload[12:], "window of shot 7.* ends at octet 97, but"),
        (lambda payload: payload[:11] + b"\x0a" + payload[12:], "window of shot 7.* would end at octet"),
    ],
)
def test_a_window_of_the_wrong_layout_says_where(change: object, said: str) -> None:
    payload = pack_window(replace(a_window(samples=9)))

    with pytest.raises(CorruptData, match=said):
        unpack_window(change(payload))


def test_a_wrong_crc_32_is_shown_beside_the_right_one() -> None:
    (segment,) = segments(a_window(), 1)

    said = f"window of shot 7: its segments say CRC-32 0x00000001, .* have 0x{segment.payload_crc32:08x}"
    with pytest.raises(CorruptData, match=said):
        WindowAssembler(1, 7).add(replace(segment, payload_crc32=1))


@pytest.mark.parametrize(
    "change",
    [
        {"counts": np.zeros(3)},
        {"counts": np.zeros((2, 2), np.int16)},
        {"candidates": a_window().candidates * 5},
        {"gain_code": 255},
        {"gain_code": -1},
        {"shot": 2**32},
        {"housekeeping": {"n" * 256: 0.0}},
        {"housekeeping": {str(n): 0.0 for n in range(256)}},
    ],
)
def test_a_window_that_does_not_fit_is_not_packed(change: dict) -> None:
    with pytest.raises(ValueError, match=r".+"):
        pack_window(replace(a_window(), **change))


def test_the_assembler_refuses_gaps_doubles_and_mixtures() -> None:
    # Given the segments of a window, of the next shot, and of another window of the same request and shot
    request_id = 0x1864C003
    first, second, third, *_ = segments(a_window(shot=7), request_id, 300)
    next_shot = segments(a_window(shot=8), request_id, 300)
    older = segments(a_window(shot=7), request_id - 1, 300)
    other = segments(a_window(shot=7, seed=2), request_id, 300)
    shorter = segments(a_window(shot=7, samples=100), request_id, 300)

    for given_first, then, error in [
        ([], second, CorruptData),
        ([first], first, CorruptData),
        ([first], third, CorruptData),
        ([first, second], second, CorruptData),
        ([first], other[1], CorruptData),
        ([first], shorter[1], CorruptData),
        ([first], next_shot[1], StaleData),
        ([], next_shot[0], StaleData),
        ([], older[0], StaleData),
    ]:
        assembler = WindowAssembler(request_id, 7)
        for segment in given_first:
            assert assembler.add(segment) is None

        # When one comes that does not continue the window, then it is refused
        with pytest.raises(error):
            assembler.add(then)


def test_the_assembler_refuses_a_payload_that_fails_its_checksum() -> None:
    first, *rest = segments(a_window(), 1, 300)
    spoiled = replace(first, payload=first.payload[:60] + b"\x7f" + first.payload[61:])
    assembler = WindowAssembler(1, 7)
    for segment in [spoiled, *rest[:-1]]:
        assert assembler.add(segment) is None

    with pytest.raises(CorruptData, match="CRC-32"):
        assembler.add(rest[-1])


def test_the_assembler_refuses_a_window_that_names_another_shot_inside() -> None:
    (segment,) = segments(a_window(shot=8), 1)
    assembler = WindowAssembler(1, 7)

    with pytest.raises(StaleData, match="says shot 8"):
        assembler.add(replace(segment, shot=7))


@pytest.mark.parametrize("framing", FRAMINGS)
def test_no_damage_makes_a_wrong_window(framing: str) -> None:
    # Given streams of two windows of the same size, 400 times with faults
    wanted, request_id = a_window(shot=7), 0x1864C003
    packets = packets_of(a_window(shot=6), request_id - 1) + packets_of(wanted, request_id)
    whole = stream_of(packets, framing)
    rng = np.random.default_rng(20)
    outcomes = []
    for _ in range(400):
        stream, assembler = packet_stream(Telemetry, framing), WindowAssembler(request_id, 7)

        # When the second is put together from what is left
        window = None
        try:
            for packet in stream.feed(damaged(whole, rng)) + stream.end():
                answer = read_answer(packet)
                if answer.request_id == request_id:
                    window = assembler.add(answer)
        except LinkError:
            pass

        # Then it is that window or none
        assert window is None or same(window, wanted)
        outcomes.append(window is not None)
    assert 50 < sum(outcomes) < 350


def test_framing_is_that_of_cobs_between_zeros() -> None:
    packet = bytes(range(256)) * 3

    assert framed(packet, "cobs") == b"\0" + cobs.encode(packet) + b"\0"
    assert framed(packet, "raw") == packet
